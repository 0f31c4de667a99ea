//! What a command says: answers on stdout, news on stderr; the form of their numbers.

use std::io::{ErrorKind, Write, stdout};

use interslice::{Error, Result};

/// Tells a person something, a line on stderr. A reader that has gone away is no failure: outputs are written all the same.
macro_rules! tell {
    ($($words:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($words)*);
    }};
}

/// Prints `text` as it is. A reader that has seen enough and gone away is no failure.
///
/// # Errors
/// [`Error::Write`].
pub fn say(text: &str) -> Result<()> {
    let mut out = stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(source) if source.kind() != ErrorKind::BrokenPipe => Err(Error::Write { path: "stdout".into(), source }),
        _ => Ok(()),
    }
}

/// A number without the tail that binary fractions leave.
pub fn short(v: f64) -> f64 {
    format!("{v:.9}").parse().unwrap_or(v) + 0.0 // no -0
}
