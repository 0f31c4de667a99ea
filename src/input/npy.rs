//! Label volumes as numpy saves them (`.npy`, format 1 to 3), axes (z, y, x), in C or Fortran order.
//!
//! The crates for this read the header with a recursive parser of Python literals; a hostile header would overflow the stack.

use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::input::volume::data::{Coding, Data};
use crate::input::volume::element::{Element, Voxels};
use crate::input::volume::grid::{Failure, TAKE_ONE, VolumeGrid, three_of};
use crate::input::volume::{Volume, open};

/// Longest header.
const LONGEST: usize = 1 << 16;

/// What an array says of itself.
#[derive(Debug)]
pub(super) struct Header {
    /// Sizes, the slowest axis first.
    pub shape: Vec<usize>,
    /// Bytes before the first value.
    pub length: usize,
    element: (Element, bool),
    fortran: bool,
}

impl Header {
    /// Bytes of header and values.
    pub fn bytes(&self) -> Option<u64> {
        let count = self.shape.iter().try_fold(self.element.0.size(), |n, size| n.checked_mul(*size))?;
        u64::try_from(count.checked_add(self.length)?).ok()
    }

    /// Sizes along z, y and x: those of three axes, or of more all but three of which have a length of 1, as libraries for learning save a volume.
    pub fn sizes(&self) -> Option<[usize; 3]> {
        Some(three_of(&self.shape, |_| true)?.map(|axis| self.shape[axis]))
    }

    /// The volume of an array that has three sizes.
    pub fn volume(&self, path: &Path, format: &'static str, data: Data) -> Failure<Volume> {
        let Some([nz, ny, nx]) = self.sizes() else {
            let sizes: Vec<String> = self.shape.iter().map(usize::to_string).collect();
            let n = self.shape.len();
            return Err(format!(
                "shape ({}) has {n} axes; a label volume has 3, (z, y, x): {TAKE_ONE}",
                sizes.join(", ")
            ));
        };
        let mut volume = Volume::new(path, format, VolumeGrid::unspaced([nx, ny, nz]), self.element, data);
        if self.fortran {
            volume.stored = [2, 1, 0];
        }
        Ok(volume)
    }
}

/// Reads the header of a `.npy`.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] naming field and value.
pub fn read(path: &Path) -> Result<Volume> {
    let mut input = open(path)?;
    let fail = |message| Error::Format { path: path.into(), message };
    let header = header(&mut input).map_err(fail)?;
    let data = Data::Stream { file: path.into(), offset: header.length as u64, coding: Coding::Raw, skip: 0 };
    let volume = header.volume(path, "numpy array", data).map_err(fail)?;
    volume.check()?;
    Ok(volume)
}

/// Reads a header up to the first value.
pub(super) fn header(input: &mut impl Read) -> Failure<Header> {
    let (text, length) = text(input)?;
    let element = element(value(&text, "descr")?)?;
    let fortran = match value(&text, "fortran_order")? {
        "True" => true,
        "False" => false,
        other => return Err(format!("fortran_order must be True or False; got {other}")),
    };
    let shape = shape(value(&text, "shape")?)?;
    Ok(Header { shape, length, element, fortran })
}

/// The values of an array of these sizes, of any type, behind its header; by rows, whatever their order.
///
/// # Errors
/// Sizes found and expected, the values that are missing, or one that is no finite number.
pub(super) fn numbers(header: &Header, shape: &[usize], input: &mut impl Read) -> Failure<Vec<f64>> {
    let sizes = |shape: &[usize]| shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    let (element, big_endian) = header.element;
    let expected = format!("expected the shape ({}) of integers or floats", sizes(shape));
    if header.shape != shape {
        return Err(format!("has the shape ({}) of {}; {expected}", sizes(&header.shape), element.name()));
    }
    let mut bytes = vec![0; element.size() * shape.iter().product::<usize>()];
    input.read_exact(&mut bytes).map_err(|e| format!("{e}; {expected}"))?;
    let mut values = Vec::new();
    if element.greys(&Voxels { bytes: &bytes, big_endian, scale: None, first: 0 }, &mut values).is_err() {
        return Err(format!("must hold finite numbers; number {} is none", values.len()));
    }
    Ok(match (shape, header.fortran) {
        (&[rows, columns], true) => (0..rows * columns).map(|k| values[k % columns * rows + k / columns]).collect(),
        _ => values,
    })
}

/// A text of at most `most` letters by itself; nothing of any other array.
pub(super) fn words(input: &mut impl Read, most: usize) -> Option<String> {
    let (header, _) = text(input).ok()?;
    let letters = value(&header, "descr").ok()?.trim_matches(['\'', '"']).strip_prefix("<U")?.parse().ok()?;
    if letters > most || !shape(value(&header, "shape").ok()?).ok()?.is_empty() {
        return None;
    }
    let mut letter = || {
        let mut bytes = [0; 4];
        input.read_exact(&mut bytes).ok().and_then(|()| char::from_u32(u32::from_le_bytes(bytes)))
    };
    let text: String = (0..letters).map(|_| letter()).collect::<Option<_>>()?;
    // numpy fills up with zeros.
    Some(text.trim_end_matches('\0').into())
}

/// The header's text, a Python dictionary, and where it ends.
fn text(input: &mut impl Read) -> Failure<(String, usize)> {
    let mut exactly = |n: usize| -> Failure<Vec<u8>> {
        let mut bytes = vec![0; n];
        input.read_exact(&mut bytes).map_err(|e| format!("header: {e}"))?;
        Ok(bytes)
    };
    let magic = exactly(8)?;
    if !magic.starts_with(b"\x93NUMPY") {
        return Err("does not begin with \\x93NUMPY".into());
    }
    let digits = match magic[6] {
        1 => 2,
        2 | 3 => 4,
        other => return Err(format!("format version must be 1 to 3; got {other}")),
    };
    let length = exactly(digits)?.iter().rev().fold(0usize, |n, b| n << 8 | usize::from(*b));
    if length > LONGEST {
        return Err(format!("header of {length} bytes; at most {LONGEST}"));
    }
    let text = String::from_utf8(exactly(length)?).map_err(|e| format!("header: {e}"))?;
    Ok((text, 8 + digits + length))
}

/// The value of a key: up to the comma after it, or up to the bracket that closes it.
fn value<'a>(header: &'a str, key: &str) -> Failure<&'a str> {
    let missing = || format!("header has no `{key}`");
    let at = [format!("'{key}'"), format!("\"{key}\"")].iter().find_map(|k| Some(header.find(k.as_str())? + k.len()));
    let rest = header[at.ok_or_else(missing)?..].trim_start().strip_prefix(':').ok_or_else(missing)?.trim_start();
    let end = match rest.chars().next() {
        Some('(') => rest.find(')').map(|k| k + 1),
        Some('[') => rest.find(']').map(|k| k + 1),
        _ => rest.find([',', '}']),
    };
    Ok(rest[..end.ok_or_else(missing)?].trim())
}

fn shape(text: &str) -> Failure<Vec<usize>> {
    let sizes = text.trim_matches(['(', ')']).split(',').map(str::trim).filter(|t| !t.is_empty());
    let wrong = || format!("shape {text} must be whole numbers");
    sizes.map(|t| t.parse().map_err(|_| wrong())).collect()
}

fn element(descr: &str) -> Failure<(Element, bool)> {
    let unknown = || format!("descr {descr} is no integer or bool of 1 to 8 bytes, nor f4 or f8");
    let kind = descr.trim_matches(['\'', '"']);
    let (order, kind) = kind.split_at_checked(1).ok_or_else(unknown)?;
    let int = |size, signed| Ok(Element::Int { size, signed });
    let element = match kind {
        "b1" | "u1" => int(1, false),
        "i1" => int(1, true),
        "u2" => int(2, false),
        "i2" => int(2, true),
        "u4" => int(4, false),
        "i4" => int(4, true),
        "u8" => int(8, false),
        "i8" => int(8, true),
        "f4" => Ok(Element::Float),
        "f8" => Ok(Element::Double),
        _ => Err(unknown()),
    }?;
    match order {
        "<" | "|" | "=" => Ok((element, false)),
        ">" => Ok((element, true)),
        _ => Err(unknown()),
    }
}
