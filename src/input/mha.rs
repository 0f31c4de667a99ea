//! MetaImage label volumes, as ITK reads and writes them: `.mha`, and `.mhd` with its voxels in another file; raw or zlib. LPS.

use std::collections::BTreeMap;
use std::io::{BufRead, Read, Seek, SeekFrom};
use std::path::Path;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::input::volume::data::{Coding, Data};
use crate::input::volume::element::Element;
use crate::input::volume::grid::{Failure, TAKE_ONE, VolumeGrid, three_of};
use crate::input::volume::{Volume, open};
use crate::stack::space::WorldSpace;
use crate::storage::regular;

/// Longest header line and most lines: a file that is no MetaImage must not be read to its end.
const LONGEST_LINE: u64 = 1 << 14;
const MOST_LINES: usize = 1024;
/// Largest difference of the length of a row of the direction matrix from 1.
const LENGTH_SLACK: f64 = 1e-3;

/// Reads the header of a `.mha` or `.mhd`.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] naming field and value.
pub fn read(path: &Path) -> Result<Volume> {
    let mut input = open(path)?;
    let fail = |message| Error::Format { path: path.into(), message };
    let fields = Fields(header(&mut input).map_err(fail)?);
    let end = input.stream_position().map_err(|source| Error::Read { path: path.into(), source })?;
    let volume = volume(path, &fields, end).map_err(fail)?;
    volume.check()?;
    Ok(volume)
}

/// The fields of a header by name.
struct Fields(BTreeMap<String, String>);

impl Fields {
    /// The first of `names` that is there, with its value.
    fn get(&self, names: &[&'static str]) -> Option<(&'static str, &str)> {
        names.iter().find_map(|name| Some((*name, self.0.get(*name)?.as_str())))
    }

    fn flag(&self, names: &[&'static str]) -> Failure<Option<bool>> {
        match self.get(names) {
            None => Ok(None),
            Some((_, "True" | "true" | "1")) => Ok(Some(true)),
            Some((_, "False" | "false" | "0")) => Ok(Some(false)),
            Some((name, other)) => Err(format!("{name} must be True or False; got {other}")),
        }
    }

    /// So many finite numbers.
    fn numbers(&self, names: &[&'static str], count: usize) -> Failure<Option<Vec<f64>>> {
        let Some((name, text)) = self.get(names) else { return Ok(None) };
        let words: Vec<&str> = text.split_whitespace().collect();
        if words.len() != count {
            return Err(format!("{name} must be {count} numbers; got {}", words.len()));
        }
        let number = |word: &str| word.parse().ok().filter(|v: &f64| v.is_finite());
        words
            .into_iter()
            .map(|word| number(word).ok_or_else(|| format!("{name} holds `{word}`")))
            .collect::<Failure<_>>()
            .map(Some)
    }
}

fn header(input: &mut impl BufRead) -> Failure<BTreeMap<String, String>> {
    let mut fields = BTreeMap::new();
    for number in 1..MOST_LINES {
        let mut line = String::new();
        let read = input.take(LONGEST_LINE).read_line(&mut line);
        let n = read.map_err(|e| format!("header line {number}: {e}"))?;
        if n == 0 {
            return Err("header has no field `ElementDataFile`".into());
        }
        let line = line.trim();
        if line.is_empty() {
            continue;
        }
        let Some((name, value)) = line.split_once('=') else {
            return Err(format!("header line {number} is no field of a MetaImage: `{line:.60}`"));
        };
        fields.insert(name.trim().to_string(), value.trim().to_string());
        // The header's last field; voxels may follow.
        if name.trim() == "ElementDataFile" {
            return Ok(fields);
        }
    }
    Err(format!("header has more than {MOST_LINES} lines"))
}

fn volume(path: &Path, fields: &Fields, end: u64) -> Failure<Volume> {
    let need = |name| fields.get(&[name]).map(|(_, v)| v).ok_or_else(|| format!("header has no field `{name}`"));
    if let Some((_, other)) = fields.get(&["ObjectType"]).filter(|(_, kind)| *kind != "Image") {
        return Err(format!("ObjectType must be Image; got {other}"));
    }
    let count = need("NDims")?;
    let text = need("DimSize")?;
    let sizes: Vec<usize> = text.split_whitespace().map_while(|t| t.parse().ok()).collect();
    let told = sizes.len().to_string() == count && text.split_whitespace().count() == sizes.len();
    let axes = match count {
        "3" if !told => return Err(format!("DimSize must be 3 numbers; got `{text}`")),
        _ => axes(count, if told { &sizes } else { &[] })?,
    };
    if let Some((_, channels)) = fields.get(&["ElementNumberOfChannels"]).filter(|(_, n)| *n != "1") {
        return Err(format!("ElementNumberOfChannels must be 1; got {channels}"));
    }
    if fields.flag(&["BinaryData"])? == Some(false) {
        return Err("BinaryData is False; voxels as text are not read".into());
    }
    let big_endian = fields.flag(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"])?.unwrap_or(false);
    let element = element(need("ElementType")?)?;
    let (grid, file) = (grid(&sizes, axes, fields)?, need("ElementDataFile")?);
    let data = Data::Stream { file: path.into(), offset: end, coding: Coding::Raw, skip: 0 };
    let mut volume = Volume::new(path, "MetaImage", grid, (element, big_endian), data);
    if file == "LIST" || file.starts_with("LIST ") || file.contains('%') {
        return Err(format!("voxels lie in many files (ElementDataFile = {file}); save them as one"));
    }
    let Data::Stream { file: data_file, offset, coding, .. } = &mut volume.data else { return Ok(volume) };
    if !matches!(file, "LOCAL" | "Local" | "local") {
        (*data_file, *offset) = (path.parent().unwrap_or(Path::new("")).join(file), 0);
    }
    let header_size: i64 = match fields.get(&["HeaderSize"]) {
        None => 0,
        Some((_, text)) => text.parse().map_err(|_| format!("HeaderSize must be a whole number; got {text}"))?,
    };
    let unreadable = |e: std::io::Error| format!("ElementDataFile {}: {e}", data_file.display());
    let length = std::fs::metadata(&*data_file).map_err(unreadable)?.len();
    match header_size {
        0.. => *offset += header_size as u64,
        -1 => {
            let needed = volume.grid.dims.iter().try_fold(element.size(), |n, &d| n.checked_mul(d)).unwrap_or(0);
            *offset = length.saturating_sub(needed as u64).max(*offset);
        }
        _ => return Err(format!("HeaderSize must be -1 or more; got {header_size}")),
    }
    if fields.flag(&["CompressedData"])? == Some(true) {
        // zlib says CompressedData; some programs write gzip.
        let mut start = [0; 2];
        let mut input = regular::open(data_file).map_err(unreadable)?;
        input.seek(SeekFrom::Start(*offset)).map_err(unreadable)?;
        let n = input.read(&mut start).map_err(unreadable)?;
        *coding = if start[..n] == [0x1f, 0x8b] { Coding::Gzip } else { Coding::Zlib };
    }
    Ok(volume)
}

/// The axes of the volume: an axis of length 1 beside three others is passed over, as of a picture over time that is a single one.
fn axes(count: &str, sizes: &[usize]) -> Failure<[usize; 3]> {
    three_of(sizes, |_| true).ok_or_else(|| {
        let short = sizes.iter().filter(|size| **size == 1).count();
        if sizes.len() < 3 + short && sizes.len() > 3 {
            let sizes: Vec<String> = sizes.iter().map(usize::to_string).collect();
            return format!(
                "DimSize is {}: {short} axes have a length of 1, and which of them are none of the volume's nobody says; save it with 3 axes",
                sizes.join(" ")
            );
        }
        format!("NDims is {count}; a label volume has 3, or more of which all but 3 have a length of 1: {TAKE_ONE}")
    })
}

/// Place of the voxels of an image of these sizes, by these three of its axes.
fn grid(sizes: &[usize], axes: [usize; 3], fields: &Fields) -> Failure<VolumeGrid> {
    let count = sizes.len();
    let three = |numbers: Vec<f64>| axes.map(|axis| numbers[axis]);
    let own = fields.numbers(&["ElementSpacing", "ElementSize"], count)?.map(three);
    let spacing = own.unwrap_or([1.0; 3]);
    if let Some((axis, h)) = spacing.iter().enumerate().find(|(_, h)| **h <= 0.0) {
        return Err(format!("ElementSpacing: voxel spacing along axis {axis} must be a positive number; got {h}"));
    }
    let matrix = fields.numbers(&["TransformMatrix", "Rotation", "Orientation"], count * count)?;
    if let Some(axis) = matrix.as_ref().and_then(|matrix| turned(matrix, axes, count)) {
        return Err(format!(
            "TransformMatrix turns axis {axis}, of length 1, into those of the volume; save it with 3 axes"
        ));
    }
    let directions =
        matrix.map_or(DVec3::AXES, |matrix| axes.map(|axis| DVec3::from(axes.map(|of| matrix[count * axis + of]))));
    for (axis, direction) in directions.into_iter().enumerate() {
        let length = direction.length();
        if (length - 1.0).abs() > LENGTH_SLACK {
            return Err(format!("TransformMatrix: the direction of axis {axis} must have length 1; got {length}"));
        }
    }
    Ok(VolumeGrid {
        dims: axes.map(|axis| sizes[axis]),
        origin: fields.numbers(&["Offset", "Position", "Origin"], count)?.map(three).unwrap_or_default().into(),
        steps: std::array::from_fn(|a| directions[a] * spacing[a]),
        unit: match fields.get(&["DistanceUnits"]) {
            Some((_, unit)) if !unit.is_empty() && unit != "?" => unit.into(),
            _ => "mm".into(),
        },
        spaced: own.is_some(),
        space: WorldSpace::default(),
    })
}

/// The first axis beside these three of `count` whose direction is not its own alone.
fn turned(matrix: &[f64], axes: [usize; 3], count: usize) -> Option<usize> {
    let mut others = (0..count).filter(|axis| !axes.contains(axis));
    others.find(|&axis| axes.iter().any(|of| matrix[count * axis + of] != 0.0 || matrix[count * of + axis] != 0.0))
}

/// Types by the sizes that MetaIO gives them: MET_LONG has 4 bytes.
fn element(name: &str) -> Failure<Element> {
    let int = |size, signed| Ok(Element::Int { size, signed });
    match name {
        "MET_CHAR" | "MET_ASCII_CHAR" => int(1, true),
        "MET_UCHAR" => int(1, false),
        "MET_SHORT" => int(2, true),
        "MET_USHORT" => int(2, false),
        "MET_INT" | "MET_LONG" => int(4, true),
        "MET_UINT" | "MET_ULONG" => int(4, false),
        "MET_LONG_LONG" => int(8, true),
        "MET_ULONG_LONG" => int(8, false),
        "MET_FLOAT" => Ok(Element::Float),
        "MET_DOUBLE" => Ok(Element::Double),
        other => Err(format!("ElementType `{other}` is not known")),
    }
}
