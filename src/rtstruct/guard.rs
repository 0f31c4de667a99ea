//! Checks that a DICOM file is what its lengths say before anything is allocated by them.
//!
//! The DICOM library believes a length and allocates it, and follows nested sequences by recursion. Here every length is compared with what
//! is left of the file (or of the sequence or item around it), and nesting is bounded.

use std::borrow::Cow;

use dicom_core::VR;
use dicom_core::dictionary::{DataDictionary, DataDictionaryEntry};
use dicom_object::{StandardDataDictionary, Tag};

type Check<T> = std::result::Result<T, String>;

/// Deepest nesting of sequences; a structure set has 4.
const DEEPEST: usize = 16;
const EXPLICIT: &str = "1.2.840.10008.1.2.1";
const IMPLICIT: &str = "1.2.840.10008.1.2";
const BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";
const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
const ITEM: Tag = Tag(0xFFFE, 0xE000);
const ITEM_END: Tag = Tag(0xFFFE, 0xE00D);
const SEQUENCE_END: Tag = Tag(0xFFFE, 0xE0DD);
const GROUP_LENGTH: Tag = Tag(0x0002, 0x0000);
const TRANSFER_SYNTAX: Tag = Tag(0x0002, 0x0010);
const SOP_CLASS: Tag = Tag(0x0008, 0x0016);
/// Offset of the first element behind a preamble.
const BEGIN: usize = 132;
const UNDEFINED: u32 = u32::MAX;

/// Checks transfer syntax and all lengths; the file as the library takes it, with preamble and meta group. Where these are missing, as in what
/// some archives export, they are added, and the data set's first element tells how it is coded.
///
/// # Errors
/// A message with tag, value and place.
pub fn sound(bytes: &[u8]) -> Check<Cow<'_, [u8]>> {
    let (mut walk, begin) = Walk::begin(bytes)?;
    let meta = walk.meta(begin)?;
    walk.explicit = match meta.syntax.as_deref() {
        Some(EXPLICIT) => true,
        Some(IMPLICIT) => false,
        Some(other) => {
            return Err(format!(
                "Transfer Syntax UID is {other}; save it as Explicit or Implicit VR Little Endian ({EXPLICIT}, {IMPLICIT})"
            ));
        }
        None if walk.at == begin => walk.looks_explicit(),
        None => return Err("Transfer Syntax UID (0002,0010) is missing".into()),
    };
    let (explicit, data_set) = (walk.explicit, walk.at);
    walk.data_set(None, &mut |_, _| {})?;
    if begin == BEGIN && meta.has_length {
        return Ok(Cow::Borrowed(bytes));
    }
    let mut group = bytes[meta.elements..data_set].to_vec();
    if meta.syntax.is_none() {
        let mut uid = if explicit { EXPLICIT } else { IMPLICIT }.as_bytes().to_vec();
        uid.resize(uid.len().next_multiple_of(2), 0);
        group.extend([2, 0, 0x10, 0]);
        group.extend(b"UI");
        group.extend((uid.len() as u16).to_le_bytes());
        group.extend(uid);
    }
    let mut whole = vec![0; BEGIN - 4];
    whole.extend(b"DICM\x02\0\0\0UL\x04\0");
    whole.extend((group.len() as u32).to_le_bytes());
    whole.extend(group);
    whole.extend(&bytes[data_set..]);
    Ok(Cow::Owned(whole))
}

/// Hands the elements of a data set before the tag `end` to `each`, less those in sequences, tag and value. What is cut off, or is packed or runs
/// from the largest byte, is an error; what came before it has been handed over.
///
/// # Errors
/// A message with tag, value and place.
pub fn elements(bytes: &[u8], end: Tag, each: &mut dyn FnMut(Tag, &[u8])) -> Check<()> {
    let (mut walk, begin) = Walk::begin(bytes)?;
    let syntax = walk.meta(begin)?.syntax;
    walk.explicit = match syntax.as_deref() {
        Some(BIG_ENDIAN | DEFLATED) => return Err("is big-endian or deflated".into()),
        Some(syntax) => syntax != IMPLICIT,
        None => walk.looks_explicit(),
    };
    walk.data_set(Some(end), each)
}

/// SOP Class UID of what begins so; nothing where it is not found.
pub fn class(bytes: &[u8]) -> Option<String> {
    let (mut walk, begin) = Walk::begin(bytes).ok()?;
    let syntax = walk.meta(begin).ok()?.syntax;
    walk.explicit = syntax.map_or_else(|| walk.looks_explicit(), |syntax| syntax != IMPLICIT);
    while walk.peek_group()? <= SOP_CLASS.0 {
        let header = walk.header(bytes.len()).ok()?;
        let end = walk.value_end(&header, bytes.len()).ok()?;
        if header.tag == SOP_CLASS {
            return Some(uid(&bytes[walk.at..end]));
        }
        walk.at = end;
    }
    None
}

fn uid(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).trim_matches(['\0', ' ']).to_string()
}

/// The file's meta group.
struct Meta {
    /// Offset of its first element behind its length.
    elements: usize,
    has_length: bool,
    syntax: Option<String>,
}

struct Walk<'a> {
    bytes: &'a [u8],
    at: usize,
    explicit: bool,
}

struct Header {
    tag: Tag,
    /// Offset at which it begins.
    at: usize,
    length: u32,
    sequence: bool,
}

/// Sequences and items that are open around an element.
struct Open {
    kind: Kind,
    /// Its end, where its length says it; else a delimiter ends it.
    end: Option<usize>,
    /// The end of what has one.
    limit: usize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Sequence,
    Item,
}

impl Walk<'_> {
    /// At the first element, and where that is.
    fn begin(bytes: &[u8]) -> Check<(Walk<'_>, usize)> {
        let at = if bytes.get(BEGIN - 4..BEGIN) == Some(b"DICM") {
            BEGIN
        } else if bytes.starts_with(b"DICM") {
            4
        } else if matches!(bytes, [2 | 8, 0, ..]) {
            0
        } else {
            return Err("is no DICOM file: `DICM` is missing at byte 128, and it begins with no element".into());
        };
        Ok((Walk { bytes, at, explicit: true }, at))
    }

    /// The elements of group 2, which are explicit in any file.
    fn meta(&mut self, begin: usize) -> Check<Meta> {
        let limit = self.bytes.len();
        let mut meta = Meta { elements: begin, has_length: false, syntax: None };
        let mut said = None;
        while self.peek_group() == Some(2) {
            let header = self.header(limit)?;
            let end = self.value_end(&header, limit)?;
            match header.tag {
                GROUP_LENGTH if header.at != begin || header.length != 4 => {
                    let Header { at, length, .. } = header;
                    return Err(format!(
                        "byte {at}: {GROUP_LENGTH} has {length} bytes; it must be the first element, of 4"
                    ));
                }
                GROUP_LENGTH => {
                    let group = u32::from_le_bytes(self.take(limit)?);
                    said = Some(end.saturating_add(group as usize));
                    (meta.elements, meta.has_length) = (end, true);
                }
                TRANSFER_SYNTAX => meta.syntax = Some(uid(&self.bytes[self.at..end])),
                _ => {}
            }
            self.at = end;
        }
        match (said, self.at) {
            (Some(said), end) if said != end => {
                Err(format!("{GROUP_LENGTH} says that the file's meta group ends at byte {said}, but it ends at {end}"))
            }
            _ => Ok(meta),
        }
    }

    /// Whether the next element has a value representation, as all have in explicit files.
    fn looks_explicit(&self) -> bool {
        let code = self.bytes.get(self.at + 4..self.at + 6).and_then(|b| b.try_into().ok());
        code.and_then(VR::from_binary).is_some()
    }

    /// Walks to the end, or to the first element of the data set itself that is not before `last`; elements outside sequences go to `each`.
    fn data_set(&mut self, last: Option<Tag>, each: &mut dyn FnMut(Tag, &[u8])) -> Check<()> {
        let mut open: Vec<Open> = Vec::new();
        loop {
            while let Some(o) = open.last()
                && o.end == Some(self.at)
            {
                open.pop();
            }
            let limit = open.last().map_or(self.bytes.len(), |o| o.limit);
            if open.is_empty() && self.at == limit {
                return Ok(());
            }
            let ended = open.last().filter(|o| o.end.is_none()).map(|o| o.kind);
            if open.last().is_some_and(|o| o.kind == Kind::Sequence) {
                let (tag, length, at) = self.delimiter(limit)?;
                match tag {
                    ITEM => open.push(self.opened(Kind::Item, length, limit, tag, at)?),
                    SEQUENCE_END if ended.is_some() => drop(open.pop()),
                    _ => return Err(format!("byte {at}: {tag} where an item of a sequence must be")),
                }
                continue;
            }
            if self.peek_group() == Some(ITEM.0) {
                let (tag, _, at) = self.delimiter(limit)?;
                match (tag, ended) {
                    (ITEM_END, Some(Kind::Item)) => drop(open.pop()),
                    _ => return Err(format!("byte {at}: {tag} where an element must be")),
                }
                continue;
            }
            let header = self.header(limit)?;
            if open.is_empty() && last.is_some_and(|last| header.tag >= last) {
                return Ok(());
            }
            if header.sequence {
                if open.len() >= 2 * DEEPEST {
                    return Err(format!(
                        "byte {}: {} is nested more than {DEEPEST} sequences deep",
                        header.at, header.tag
                    ));
                }
                open.push(self.opened(Kind::Sequence, header.length, limit, header.tag, header.at)?);
            } else {
                let end = self.value_end(&header, limit)?;
                if open.is_empty() {
                    each(header.tag, &self.bytes[self.at..end]);
                }
                self.at = end;
            }
        }
    }

    fn opened(&self, kind: Kind, length: u32, limit: usize, tag: Tag, at: usize) -> Check<Open> {
        if length == UNDEFINED {
            return Ok(Open { kind, end: None, limit });
        }
        let end = self.value_end(&Header { tag, at, length, sequence: true }, limit)?;
        Ok(Open { kind, end: Some(end), limit: end })
    }

    fn value_end(&self, header: &Header, limit: usize) -> Check<usize> {
        let Header { tag, at, length, .. } = header;
        if *length == UNDEFINED {
            return Err(format!("byte {at}: {tag} has no length"));
        }
        self.at.checked_add(*length as usize).filter(|end| *end <= limit).ok_or_else(|| {
            format!("byte {at}: {tag} is said to be {length} bytes long, but {} are left there", limit - self.at)
        })
    }

    fn peek_group(&self) -> Option<u16> {
        self.bytes.get(self.at..self.at + 2).map(|b| u16::from_le_bytes([b[0], b[1]]))
    }

    fn take<const N: usize>(&mut self, limit: usize) -> Check<[u8; N]> {
        let end = self.at.saturating_add(N);
        let bytes = self.bytes.get(self.at..end).filter(|_| end <= limit).and_then(|b| b.try_into().ok());
        self.at = end;
        bytes.ok_or_else(|| format!("is cut off: an element begins at byte {} and does not end", end - N))
    }

    fn tag(&mut self, limit: usize) -> Check<Tag> {
        let [a, b, c, d] = self.take(limit)?;
        Ok(Tag(u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])))
    }

    fn delimiter(&mut self, limit: usize) -> Check<(Tag, u32, usize)> {
        let at = self.at;
        Ok((self.tag(limit)?, u32::from_le_bytes(self.take(limit)?), at))
    }

    fn header(&mut self, limit: usize) -> Check<Header> {
        let at = self.at;
        let tag = self.tag(limit)?;
        if !self.explicit {
            let length = u32::from_le_bytes(self.take(limit)?);
            let known = StandardDataDictionary.by_tag(tag).map(|e| e.vr().relaxed());
            let sequence = known == Some(VR::SQ) || (known.is_none() && length == UNDEFINED);
            whole(tag, at, known.unwrap_or(VR::UN), length)?;
            return Ok(Header { tag, at, length, sequence });
        }
        let code: [u8; 2] = self.take(limit)?;
        let vr = VR::from_binary(code).ok_or_else(|| {
            format!(
                "byte {at}: {tag} has the value representation {:?}, which there is not",
                String::from_utf8_lossy(&code)
            )
        })?;
        use VR::{OB, OD, OF, OL, OV, OW, SQ, SV, UC, UN, UR, UT, UV};
        let length = if matches!(vr, OB | OD | OF | OL | OV | OW | SQ | SV | UC | UN | UR | UT | UV) {
            let _reserved: [u8; 2] = self.take(limit)?;
            u32::from_le_bytes(self.take(limit)?)
        } else {
            u32::from(u16::from_le_bytes(self.take(limit)?))
        };
        whole(tag, at, vr, length)?;
        Ok(Header { tag, at, length, sequence: vr == SQ })
    }
}

/// Checks that a value is of whole numbers: of others the library leaves bytes unread, and takes them for the next element.
fn whole(tag: Tag, at: usize, vr: VR, length: u32) -> Check<()> {
    use VR::{AT, FD, FL, OD, OF, OL, OV, OW, SL, SS, SV, UL, US, UV};
    let size = match vr {
        OW | SS | US => 2,
        AT | FL | OF | OL | SL | UL => 4,
        FD | OD | OV | SV | UV => 8,
        _ => 1,
    };
    if length != UNDEFINED && !length.is_multiple_of(size) {
        return Err(format!("byte {at}: {tag} has {length} bytes; a number of it ({vr}) has {size}"));
    }
    Ok(())
}
