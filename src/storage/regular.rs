//! Files that are read. A pipe or a device, to which a link in an unpacked archive may lead, would be waited for, or never end: it is refused.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// Whether a path is a file; a folder is left to who opens it.
///
/// # Errors
/// That it is something else; the errors of looking.
pub fn check(path: &Path) -> io::Result<()> {
    let kind = fs::metadata(path)?.file_type();
    match kind.is_file() || kind.is_dir() {
        true => Ok(()),
        false => Err(io::Error::new(ErrorKind::InvalidInput, "it is a pipe, a device or a socket, not a file")),
    }
}

/// Opens a file.
///
/// # Errors
/// The errors of [`check`] and of opening.
pub fn open(path: &Path) -> io::Result<File> {
    check(path)?;
    File::open(path)
}

/// All bytes of a file.
///
/// # Errors
/// The errors of [`open`] and of reading.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    check(path)?;
    fs::read(path)
}

/// All of a file as text, [`unmarked`].
///
/// # Errors
/// The errors of [`open`] and of reading; that it is no UTF-8.
pub fn read_to_string(path: &Path) -> io::Result<String> {
    check(path)?;
    let mut text = fs::read_to_string(path)?;
    text.drain(..text.len() - unmarked(&text).len());
    Ok(text)
}

/// A text without the mark of its encoding (byte order mark) that some editors write first.
pub fn unmarked(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// At most `most` bytes of a file's begin. One that has no bytes, as it says, is not opened: some of what the system shows as such files are waited for.
///
/// # Errors
/// The errors of [`open`] and of reading.
pub fn begin(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    if fs::metadata(path)?.len() > 0 {
        open(path)?.take(most).read_to_end(&mut bytes)?;
    }
    check(path)?;
    Ok(bytes)
}
