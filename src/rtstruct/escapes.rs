//! Text that changes its character set on the way, by the escape sequences of ISO 2022 (DICOM PS3.3, C.12.1.1.2): names in Japanese, Korean and
//! Chinese, mostly. And text in UTF-8 that does not say so.

use dicom_encoding::text::{SpecificCharacterSet, TextCodec};

const ESCAPE: char = '\u{1b}';

/// What follows an escape, and the set that bytes are of from there on.
const SETS: [(&str, &str); 17] = [
    ("(B", ASCII),
    ("(J", "ISO_IR 13"),
    (")I", "ISO_IR 13"),
    ("-A", "ISO_IR 100"),
    ("-B", "ISO_IR 101"),
    ("-C", "ISO_IR 109"),
    ("-D", "ISO_IR 110"),
    ("-F", "ISO_IR 126"),
    ("-G", "ISO_IR 127"),
    ("-H", "ISO_IR 138"),
    ("-L", "ISO_IR 144"),
    ("-T", "ISO_IR 166"),
    ("$)A", "GBK"),
    ("$)C", "ISO_IR 149"),
    ("$B", JAPANESE),
    ("$@", JAPANESE),
    ("$(D", JAPANESE),
];
/// Its decoder takes the escapes, too.
const JAPANESE: &str = "ISO_IR 87";

/// What `text` says in a file of the Specific Character Set `set`, whose bytes were taken for characters of the same number; itself where it has
/// no escape that is known here.
pub(super) fn read(text: &str, set: &str) -> String {
    let is_unsaid = [ASCII, ""].contains(&set) && !text.contains(ESCAPE);
    let read = if is_unsaid { utf_8(text) } else { spoken(text) };
    read.unwrap_or_else(|| text.to_string())
}

/// The set of a file that says none: it has no byte from 128 on.
const ASCII: &str = "ISO_IR 6";

/// The text whose UTF-8 these bytes are; nothing where they are none.
fn utf_8(text: &str) -> Option<String> {
    String::from_utf8(bytes(text)?).ok()
}

/// The bytes that were taken for characters.
fn bytes(text: &str) -> Option<Vec<u8>> {
    text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect()
}

fn spoken(text: &str) -> Option<String> {
    let mut pieces = text.split(ESCAPE);
    let mut out = pieces.next()?.to_string();
    for piece in pieces {
        let (escape, set) = SETS.into_iter().find(|(escape, _)| piece.starts_with(escape))?;
        let rest = &piece[escape.len()..];
        let bytes = match set {
            JAPANESE => bytes(&format!("{ESCAPE}{piece}"))?,
            _ => bytes(rest)?,
        };
        out += &SpecificCharacterSet::from_code(set)?.decode(&bytes).ok()?;
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes as the characters of the same numbers.
    fn taken(bytes: &[u8]) -> String {
        bytes.iter().map(|b| char::from(*b)).collect()
    }

    #[test]
    fn names_are_read_in_their_own_sets() {
        let cases: [(&[u8], &str); 6] = [
            (b"Heart", "Heart"),
            (b"\x1b$B?4B!\x1b(B left", "心臓 left"),
            (b"\x1b$)C\xbd\xc9\xc0\xe5", "심장"),
            (b"a \x1b$)A\xd0\xc4\xd4\xe0", "a 心脏"),
            (b"x\x1b-F\xea\xe1\xf1\xe4\xe9\xdc", "xκαρδιά"),
            (b"\x1b(J\x1b)I\xca\xb0\xc4", "ﾊｰﾄ"),
        ];
        for (bytes, wanted) in cases {
            assert_eq!(read(&taken(bytes), "ISO 2022 IR 6"), wanted);
        }
        // What nobody knows stays as it is.
        for strange in ["\u{1b}", "a\u{1b}Z?", "\u{1b}$)C\u{4e00}"] {
            assert_eq!(read(strange, ""), strange);
        }
    }
}
