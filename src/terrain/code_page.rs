//! Code page of a shapefile's table: that of the .cpg, else that of byte 29 of the table (its language driver). No code page is a reason to refuse a
//! table: names and numbers that are ASCII need none, and a byte that a code page lacks is replaced.

use shapefile::dbase::CodePageMark;
use shapefile::dbase::encoding::{DynEncoding, EncodingRs, LossyCodePage, UnicodeLossy};
use shapefile::dbase::encoding_rs as web;
use shapefile::dbase::yore::code_pages as page;

/// Offset of the byte that says the code page, and where the fields begin.
const MARK: usize = 29;
const FIELDS: usize = 32;
/// Bytes of a field, of which the first are its name.
const FIELD: usize = 32;
const NAME: usize = 11;
/// Byte behind the last field.
const END: u8 = 0x0d;
/// Number of UTF-8 among code pages, and that of the parts of ISO 8859 less the part.
const UTF8: u16 = 65001;
const ISO: u16 = 28590;
/// Names without a number of code pages, or with another one.
const NAMES: [(&str, u16); 11] = [
    ("SHIFT_JIS", 932),
    ("SHIFT-JIS", 932),
    ("SJIS", 932),
    ("GBK", 936),
    ("GB2312", 936),
    ("GB18030", 936),
    ("EUC-KR", 949),
    ("BIG5", 950),
    ("BIG-5", 950),
    ("LATIN1", ISO + 1),
    ("LATIN2", ISO + 2),
];

/// What the bytes of a text are.
type OfBytes = fn(&[u8]) -> String;

/// How texts of a table are read.
pub struct TextPage {
    /// By the library for tables.
    pub encoding: DynEncoding,
    /// What bytes are, of a code page that the library has no name for: it reads them by page 437, which has a letter for every byte.
    bytes: Option<OfBytes>,
    /// Words where what the table says is not known here, and matters.
    pub doubt: Option<String>,
}

impl TextPage {
    /// A text that was read by the encoding.
    pub fn text(&self, read: String) -> String {
        match self.bytes {
            Some(of) => of(&page::CP437.encode_lossy(&read, b'?')),
            None => read,
        }
    }
}

/// How texts of a table that begins with `head` (all of its header) are read, beside a .cpg that says `cpg`.
pub fn text_page(cpg: Option<&str>, head: &[u8]) -> TextPage {
    let marked = || head.get(MARK).and_then(|mark| number(CodePageMark::from(*mark)));
    let said = cpg.and_then(named);
    let of_cpg = said.filter(|page| *page == UTF8 || known(*page).is_some());
    let chosen = of_cpg.or_else(marked);
    if let Some((encoding, bytes)) = chosen.and_then(known) {
        return TextPage { encoding, bytes, doubt: None };
    }
    if are_utf8(head) {
        return TextPage { encoding: UnicodeLossy.into(), bytes: None, doubt: None };
    }
    let unknown = match (cpg.map(str::trim), of_cpg, chosen) {
        (Some(name), None, _) if !name.is_empty() => Some(name.to_string()),
        (_, _, Some(page)) if page != UTF8 => Some(page.to_string()),
        _ => None,
    };
    let doubt = unknown.map(|page| {
        format!(
            "the code page `{page:.40}` of its table is not known here: names of attributes are read as Windows-1252; save it in UTF-8 if they matter"
        )
    });
    TextPage { encoding: LossyCodePage(page::CP1252).into(), bytes: None, doubt }
}

/// The number of the code page that a .cpg names, as in `1252`, `ANSI 1252`, `windows-1252`, `ISO-8859-1`, `LDID/87`, `UTF-8`; none for a name without one.
fn named(cpg: &str) -> Option<u16> {
    let name = cpg.trim_matches(|c: char| !c.is_ascii_graphic()).to_ascii_uppercase();
    if let Some(mark) = name.strip_prefix("LDID/") {
        return number(CodePageMark::from(mark.parse::<u8>().ok()?));
    }
    if let Some((_, page)) = NAMES.iter().find(|(known, _)| *known == name) {
        return Some(*page);
    }
    let digits: String = name.chars().filter(char::is_ascii_digit).collect();
    match digits.strip_prefix("8859").and_then(|part| part.parse::<u16>().ok()) {
        _ if name.starts_with("UTF") => Some(UTF8),
        Some(part @ 1..=16) => Some(ISO + part),
        _ => digits.parse().ok(),
    }
}

/// The number of a mark's code page.
fn number(mark: CodePageMark) -> Option<u16> {
    Some(match mark {
        CodePageMark::Undefined | CodePageMark::Invalid => return None,
        CodePageMark::Utf8 => UTF8,
        CodePageMark::CP437 => 437,
        CodePageMark::CP620 => 620,
        CodePageMark::CP737 => 737,
        CodePageMark::CP850 => 850,
        CodePageMark::CP852 => 852,
        CodePageMark::CP857 => 857,
        CodePageMark::CP861 => 861,
        CodePageMark::CP865 => 865,
        CodePageMark::CP866 => 866,
        CodePageMark::CP874 => 874,
        CodePageMark::CP895 => 895,
        CodePageMark::CP932 => 932,
        CodePageMark::CP936 => 936,
        CodePageMark::CP949 => 949,
        CodePageMark::CP950 => 950,
        CodePageMark::CP1250 => 1250,
        CodePageMark::CP1251 => 1251,
        CodePageMark::CP1252 => 1252,
        CodePageMark::CP1253 => 1253,
        CodePageMark::CP1254 => 1254,
        CodePageMark::CP1255 => 1255,
        CodePageMark::CP1256 => 1256,
    })
}

/// A code page by its number, and what its bytes are where the library reads them by another; none for UTF-8, which a table says and is not often enough.
fn known(number: u16) -> Option<(DynEncoding, Option<OfBytes>)> {
    let by_bytes: OfBytes = match number {
        737 => |bytes| page::CP737.decode(bytes).into(),
        855 => |bytes| page::CP855.decode(bytes).into(),
        857 => |bytes| page::CP857.decode_lossy(bytes).into(),
        862 => |bytes| page::CP862.decode(bytes).into(),
        _ => return of_library(number).map(|encoding| (encoding, None)),
    };
    Some((LossyCodePage(page::CP437).into(), Some(by_bytes)))
}

/// Those that the library for tables knows; the parts of ISO 8859 that Windows has within a page of its own are that.
fn of_library(number: u16) -> Option<DynEncoding> {
    let of_web = |encoding| Some(EncodingRs::from(encoding).into());
    Some(match number {
        437 => LossyCodePage(page::CP437).into(),
        850 => LossyCodePage(page::CP850).into(),
        852 => LossyCodePage(page::CP852).into(),
        861 => LossyCodePage(page::CP861).into(),
        865 => LossyCodePage(page::CP865).into(),
        866 => LossyCodePage(page::CP866).into(),
        874 | 28601 => LossyCodePage(page::CP874).into(),
        1250 => LossyCodePage(page::CP1250).into(),
        1251 => LossyCodePage(page::CP1251).into(),
        1252 | 28591 => LossyCodePage(page::CP1252).into(),
        1253 => LossyCodePage(page::CP1253).into(),
        1254 | 28599 => LossyCodePage(page::CP1254).into(),
        1255 => LossyCodePage(page::CP1255).into(),
        1256 => LossyCodePage(page::CP1256).into(),
        932 => return of_web(web::SHIFT_JIS),
        936 => return of_web(web::GBK),
        949 => return of_web(web::EUC_KR),
        950 => return of_web(web::BIG5),
        1257 => return of_web(web::WINDOWS_1257),
        1258 => return of_web(web::WINDOWS_1258),
        28592 => return of_web(web::ISO_8859_2),
        28593 => return of_web(web::ISO_8859_3),
        28594 => return of_web(web::ISO_8859_4),
        28595 => return of_web(web::ISO_8859_5),
        28596 => return of_web(web::ISO_8859_6),
        28597 => return of_web(web::ISO_8859_7),
        28598 => return of_web(web::ISO_8859_8),
        28603 => return of_web(web::ISO_8859_13),
        28605 => return of_web(web::ISO_8859_15),
        _ => return None,
    })
}

/// Whether all names of fields are UTF-8: a file says the one and holds the other often enough.
fn are_utf8(head: &[u8]) -> bool {
    let fields = head.get(FIELDS..).unwrap_or_default().chunks(FIELD).take_while(|field| field[0] != END);
    let mut names = fields.map(|field| field.split(|b| *b == 0).next().unwrap_or_default());
    names.all(|name| std::str::from_utf8(&name[..name.len().min(NAME)]).is_ok())
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
            let page = text_page(cpg, &head(mark, name));
            page.text(page.encoding.decode(name).expect("nothing is refused").into_owned())
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
        assert_eq!(text_page(None, &[]).encoding.decode(b"a").expect("ASCII"), "a");
    }

    #[test]
    fn pages_of_east_and_west_are_known_by_cpg_and_mark() {
        let read = |cpg: Option<&str>, mark: u8, name: &[u8]| {
            let page = text_page(cpg, &head(mark, name));
            assert_eq!(page.doubt, None, "{cpg:?} {mark:02x}");
            page.text(page.encoding.decode(name).expect("nothing is refused").into_owned())
        };
        let (height, kanji, hanzi, hangul) =
            ("\u{3cd}\u{3c8}\u{3bf}\u{3c2}", "\u{6a19}\u{9ad8}", "\u{9ad8}\u{7a0b}", "\u{b192}\u{c774}");
        for (cpgs, marks, bytes, wanted) in [
            (&["737", "CP737", "IBM-737"][..], &[0x6a][..], &b"\xe7\xaf\xa6\xaa"[..], height),
            (&["857", "OEM 857"], &[0x6b], b"y\x81kseklik", "y\u{fc}kseklik"),
            (&["932", "SJIS", "Shift_JIS"], &[0x13, 0x7b], b"\x95W\x8d\x82", kanji),
            (&["936", "GBK", "GB2312", "gb18030"], &[0x4d, 0x7a], b"\xb8\xdf\xb3\xcc", "\u{9ad8}\u{7a0b}"),
            (&["949", "EUC-KR", "windows-949"], &[0x79], b"\xb3\xf4\xc0\xcc", hangul),
            (&["950", "BIG5", "Big-5"], &[0x78], b"\xb0\xaa\xb5{", hanzi),
            (&["ISO-8859-2", "8859-2", "ISO 88592", "latin2"], &[], b"v\xfd\xb9ka", "v\u{fd}\u{161}ka"),
            (&["1257"], &[], b"augst\xeeba", "augst\u{12b}ba"),
        ] {
            cpgs.iter().for_each(|cpg| assert_eq!(read(Some(cpg), 0x57, bytes), wanted, "{cpg}"));
            marks.iter().for_each(|mark| assert_eq!(read(None, *mark, bytes), wanted, "{mark:02x}"));
        }
        // Bytes that are ASCII are that in all of them, and what a page lacks is replaced.
        assert!(["737", "857", "932", "936", "949", "950"].iter().all(|cpg| read(Some(cpg), 0, b"Z_1 ~") == "Z_1 ~"));
        assert_eq!(read(Some("857"), 0, b"a\xe7b"), "a\u{fffd}b");
    }

    #[test]
    fn a_page_that_is_not_known_is_told_where_it_matters() {
        let doubt = |cpg: Option<&str>, mark: u8, name: &[u8]| text_page(cpg, &head(mark, name)).doubt;
        let told = doubt(Some("KOI8-R"), 0, b"H\xf6he").expect("it is not known");
        assert!(told.starts_with("the code page `KOI8-R` of its table is not known here"), "{told}");
        assert!(doubt(None, 0x68, b"v\x98ka").is_some_and(|told| told.contains("`895`")));
        // The table's own mark, names in UTF-8 or ASCII, and no word of a page.
        assert_eq!(doubt(Some("KOI8-R"), 0x03, b"H\xf6he"), None);
        for (cpg, mark, name) in [
            (Some("mine"), 0, &b"HEIGHT"[..]),
            (None, 0x68, b"H\xc3\xb6he"),
            (None, 0, b"H\xf6he"),
            (Some(""), 0, b"H\xf6he"),
        ] {
            assert_eq!(doubt(cpg, mark, name), None, "{cpg:?} {mark:02x}");
        }
    }
}
