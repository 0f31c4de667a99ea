//! Label volumes as numpy saves them (`.npy`, format 1 to 3), axes (z, y, x), in C or Fortran order.
//!
//! The crates for this read the header with a recursive parser of Python literals; a hostile header would overflow the stack.

use std::io::{Read, Seek};
use std::path::Path;

use crate::error::{Error, Result};
use crate::input::volume::data::{Coding, Data};
use crate::input::volume::element::Element;
use crate::input::volume::grid::{Failure, VolumeGrid};
use crate::input::volume::{Volume, open};

/// Longest header.
const LONGEST: usize = 1 << 16;

/// Reads the header of a `.npy`.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] naming field and value.
pub fn read(path: &Path) -> Result<Volume> {
    let mut input = open(path)?;
    let fail = |message| Error::Format { path: path.into(), message };
    let header = header(&mut input).map_err(fail)?;
    let end = input.stream_position().map_err(|source| Error::Read { path: path.into(), source })?;
    let element = element(value(&header, "descr").map_err(fail)?).map_err(fail)?;
    let fortran = match value(&header, "fortran_order").map_err(fail)? {
        "True" => true,
        "False" => false,
        other => return Err(fail(format!("fortran_order must be True or False; got {other}"))),
    };
    let [nz, ny, nx] = shape(value(&header, "shape").map_err(fail)?).map_err(fail)?;
    let data = Data::Stream { file: path.into(), offset: end, coding: Coding::Raw, skip: 0 };
    let mut volume = Volume::new(path, "numpy array", VolumeGrid::unspaced([nx, ny, nz]), element, data);
    if fortran {
        volume.stored = [2, 1, 0];
    }
    volume.check()?;
    Ok(volume)
}

/// The header's text, a Python dictionary.
fn header(input: &mut impl Read) -> Failure<String> {
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
    String::from_utf8(exactly(length)?).map_err(|e| format!("header: {e}"))
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

fn shape(text: &str) -> Failure<[usize; 3]> {
    let sizes: Vec<&str> = text.trim_matches(['(', ')']).split(',').map(str::trim).filter(|t| !t.is_empty()).collect();
    let numbers: Vec<usize> = sizes.iter().map_while(|t| t.parse().ok()).collect();
    match (&numbers[..], sizes.len()) {
        (&[z, y, x], 3) => Ok([z, y, x]),
        (_, n) => Err(format!("shape {text} has {n} axes; a label volume has 3, (z, y, x)")),
    }
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
