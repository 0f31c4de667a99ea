//! What a command says: answers on stdout, news on stderr; the form of their numbers.

use std::borrow::Cow;
use std::io::{ErrorKind, Write, stdout};

use interslice::{Error, Result};

/// Tells a person something, a line on stderr. A reader that has gone away is no failure: outputs are written all the same.
macro_rules! tell {
    ($($words:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), "{}", $crate::cli::say::shown(&format!($($words)*)));
    }};
}

/// Text as a terminal may have it: names that a file holds may contain what a terminal obeys, or what turns the order of letters, which is shown as �.
pub fn shown(text: &str) -> Cow<'_, str> {
    let turns = |c: char| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let obeyed = |c: char| (c.is_control() && !matches!(c, '\n' | '\t')) || turns(c);
    if text.contains(obeyed) { text.replace(obeyed, "\u{fffd}").into() } else { text.into() }
}

/// Prints `text`, as far as it is [`shown`]. A reader that has seen enough and gone away is no failure.
///
/// # Errors
/// [`Error::Write`].
pub fn say(text: &str) -> Result<()> {
    say_exactly(&shown(text))
}

/// Prints `text` for a program, as it is. A reader that has seen enough and gone away is no failure.
///
/// # Errors
/// [`Error::Write`].
pub fn say_exactly(text: &str) -> Result<()> {
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

/// A length above zero, however small or large, by nine digits that count.
pub fn length(v: f64) -> String {
    let v: f64 = format!("{v:.8e}").parse().unwrap_or(v);
    if (1e-6..1e9).contains(&v) { v.to_string() } else { format!("{v:e}") }
}
