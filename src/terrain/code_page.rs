//! Code page of a shapefile's table: that of the .cpg, else that of byte 29 of the table (its language driver). No code page is a reason to refuse a
//! table: names and numbers that are ASCII need none, and a byte that a code page lacks is replaced.

use shapefile::dbase::CodePageMark;
use shapefile::dbase::encoding::{DynEncoding, LossyCodePage, UnicodeLossy};
use shapefile::dbase::yore::code_pages as page;

/// Offset of the byte that says the code page, and where the fields begin.
const MARK: usize = 29;
const FIELDS: usize = 32;
/// Bytes of a field, of which the first are its name.
const FIELD: usize = 32;
const NAME: usize = 11;
/// Byte behind the last field.
const END: u8 = 0x0d;

/// Numbers of code pages by which a .cpg knows them; those of ISO 8859 stand for the ones of Windows that contain them.
const NUMBERS: [(&str, CodePageMark); 16] = [
    ("437", CodePageMark::CP437),
    ("850", CodePageMark::CP850),
    ("852", CodePageMark::CP852),
    ("861", CodePageMark::CP861),
    ("865", CodePageMark::CP865),
    ("866", CodePageMark::CP866),
    ("874", CodePageMark::CP874),
    ("1250", CodePageMark::CP1250),
    ("1251", CodePageMark::CP1251),
    ("1252", CodePageMark::CP1252),
    ("1253", CodePageMark::CP1253),
    ("1254", CodePageMark::CP1254),
    ("1255", CodePageMark::CP1255),
    ("1256", CodePageMark::CP1256),
    ("88591", CodePageMark::CP1252),
    ("88599", CodePageMark::CP1254),
];

/// How texts of a table that begins with `head` (all of its header) are read, beside a .cpg that says `cpg`.
pub fn encoding(cpg: Option<&str>, head: &[u8]) -> DynEncoding {
    let marked = || head.get(MARK).map_or(CodePageMark::Undefined, |mark| CodePageMark::from(*mark));
    of(cpg.and_then(named).unwrap_or_else(marked)).unwrap_or_else(|| guess(head))
}

/// The code page that a .cpg names, as in `1252`, `ANSI 1252`, `windows-1252`, `ISO-8859-1`, `LDID/87`, `UTF-8`; none for a name that is not known.
fn named(cpg: &str) -> Option<CodePageMark> {
    let name = cpg.trim_matches(|c: char| !c.is_ascii_graphic()).to_ascii_uppercase();
    if let Some(mark) = name.strip_prefix("LDID/") {
        return mark.parse::<u8>().ok().map(CodePageMark::from);
    }
    let number: String = name.chars().filter(char::is_ascii_digit).collect();
    if name.starts_with("UTF") || number == "65001" {
        return Some(CodePageMark::Utf8);
    }
    NUMBERS.iter().find(|(known, _)| *known == number).map(|(_, mark)| *mark)
}

/// A code page that is a table of 256; none of the others, nor of what is UTF-8 or not said.
fn of(mark: CodePageMark) -> Option<DynEncoding> {
    Some(match mark {
        CodePageMark::CP437 => LossyCodePage(page::CP437).into(),
        CodePageMark::CP850 => LossyCodePage(page::CP850).into(),
        CodePageMark::CP852 => LossyCodePage(page::CP852).into(),
        CodePageMark::CP861 => LossyCodePage(page::CP861).into(),
        CodePageMark::CP865 => LossyCodePage(page::CP865).into(),
        CodePageMark::CP866 => LossyCodePage(page::CP866).into(),
        CodePageMark::CP874 => LossyCodePage(page::CP874).into(),
        CodePageMark::CP1250 => LossyCodePage(page::CP1250).into(),
        CodePageMark::CP1251 => LossyCodePage(page::CP1251).into(),
        CodePageMark::CP1252 => LossyCodePage(page::CP1252).into(),
        CodePageMark::CP1253 => LossyCodePage(page::CP1253).into(),
        CodePageMark::CP1254 => LossyCodePage(page::CP1254).into(),
        CodePageMark::CP1255 => LossyCodePage(page::CP1255).into(),
        CodePageMark::CP1256 => LossyCodePage(page::CP1256).into(),
        _ => return None,
    })
}

/// UTF-8 where all names of fields are, else Windows-1252: a file says the one and holds the other often enough.
fn guess(head: &[u8]) -> DynEncoding {
    let fields = head.get(FIELDS..).unwrap_or_default().chunks(FIELD).take_while(|field| field[0] != END);
    let mut names = fields.map(|field| field.split(|b| *b == 0).next().unwrap_or_default());
    match names.all(|name| std::str::from_utf8(&name[..name.len().min(NAME)]).is_ok()) {
        true => UnicodeLossy.into(),
        false => LossyCodePage(page::CP1252).into(),
    }
}

#[cfg(test)]
mod tests {
    use shapefile::dbase::encoding::Encoding;

    use super::*;

    /// The header of a table with one field.
    fn head(mark: u8, name: &[u8]) -> Vec<u8> {
        let mut head = vec![0; FIELDS + FIELD + 1];
        head[MARK] = mark;
        head[FIELDS..FIELDS + name.len()].copy_from_slice(name);
        head[FIELDS + FIELD] = END;
        head
    }

    #[test]
    fn the_cpg_decides_then_the_mark_then_the_names() {
        let read = |cpg: Option<&str>, mark: u8, name: &[u8]| {
            encoding(cpg, &head(mark, name)).decode(name).expect("nothing is refused").into_owned()
        };
        let (latin, dos, utf) = (&b"H\xf6he"[..], &b"H\x94he"[..], "H\u{f6}he".as_bytes());
        for cpg in
            ["1252", "ANSI 1252", "windows-1252\r\n", "CP1252", "ISO-8859-1", "ISO 88591", "8859-1", "LDID/3", "mine"]
        {
            assert_eq!(read(Some(cpg), 0, latin), "H\u{f6}he", "{cpg}");
        }
        for (cpg, mark, name) in [
            (None, 0x03, latin),
            (None, 0x57, latin),
            (None, 0x00, latin),
            (None, 0xc8, latin),
            (Some("UTF-8"), 0, latin),
            (None, 0x01, dos),
            (None, 0x02, dos),
            (Some("850"), 0x03, dos),
            (None, 0x00, utf),
            (None, 0x57, utf),
            (Some("UTF-8"), 0x03, utf),
            (Some("65001"), 0x57, utf),
        ] {
            assert_eq!(read(cpg, mark, name), "H\u{f6}he", "{cpg:?} {mark:02x} {name:02x?}");
        }
        // Greek, and bytes that a code page has nothing for.
        assert_eq!(read(None, 0xcb, b"\xfd\xf8\xef\xf2"), "\u{3cd}\u{3c8}\u{3bf}\u{3c2}");
        let lacking = read(Some("1253"), 0, b"a\xd2b");
        assert!(lacking.starts_with('a') && lacking.ends_with('b'), "{lacking}");
        for mark in 0..=255 {
            assert_eq!(read(None, mark, b"CONTOUR"), "CONTOUR", "{mark:02x}");
        }
        assert_eq!(encoding(None, &[]).decode(b"a").expect("ASCII"), "a");
    }
}
