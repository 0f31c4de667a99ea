//! NRRD label volumes (teem's nrrd format 0001 to 0005): header attached or detached, raw, gzip or bzip2.

use std::collections::BTreeMap;
use std::io::{BufRead, Read, Seek};
use std::path::Path;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::input::segments;
use crate::input::volume::data::{Coding, Data};
use crate::input::volume::element::Element;
use crate::input::volume::grid::{Failure, TAKE_ONE, VolumeGrid};
use crate::input::volume::{Volume, open};
use crate::stack::space::WorldSpace;
use crate::storage::regular;

/// Longest header line and most lines: a file that is no NRRD must not be read to its end.
const LONGEST_LINE: u64 = 1 << 16;
const MOST_LINES: usize = 4096;

/// Reads the header of a `.nrrd` or `.nhdr`.
///
/// # Errors
/// [`Error::Read`] where the file cannot be read, [`Error::Format`] naming field and value.
pub fn read(path: &Path) -> Result<Volume> {
    let mut input = open(path)?;
    let fail = |message| Error::Format { path: path.into(), message };
    let header = header(&mut input).map_err(fail)?;
    let end = input.stream_position().map_err(|source| Error::Read { path: path.into(), source })?;
    let volume = volume(path, &header, end).map_err(fail)?;
    volume.check()?;
    Ok(volume)
}

#[derive(Default)]
struct Fields {
    /// `name: value`.
    fields: BTreeMap<String, String>,
    /// `key:=value`, of programs.
    pairs: BTreeMap<String, String>,
}

fn volume(path: &Path, header: &Fields, end: u64) -> Failure<Volume> {
    let field = |name: &str| header.fields.get(name).map(String::as_str);
    let need = |name: &str| field(name).ok_or_else(|| format!("header has no field `{name}`"));
    let dimension: usize = number("dimension", need("dimension")?)?;
    let sizes = numbers::<usize>("sizes", need("sizes")?)?;
    if sizes.len() != dimension {
        return Err(format!("sizes must be {dimension} numbers; got {}", sizes.len()));
    }
    let mut kinds: Vec<&str> = field("kinds").unwrap_or_default().split_whitespace().collect();
    let (dims, layers) = match sizes[..] {
        [nx, ny, nz] => ([nx, ny, nz], None),
        // 3D Slicer's segments that overlap: the layers of a voxel one behind the other.
        [count, nx, ny, nz] if kinds.first() == Some(&"list") && segments::any(&header.pairs) => {
            kinds.remove(0);
            ([nx, ny, nz], Some(segments::layers(&header.pairs, count)?))
        }
        _ => {
            return Err(format!(
                "dimension is {dimension}; a label volume has 3, or 4 with 3D Slicer's segments in a list; of \
                 several times or channels {TAKE_ONE}"
            ));
        }
    };
    let known = ["domain", "space", "none", "???"];
    if let Some(kind) = kinds.into_iter().find(|k| !known.contains(k)) {
        return Err(format!("kinds holds `{kind}`; the axes of a label volume are of kind domain or space"));
    }
    let element = element(need("type")?)?;
    let big_endian = match field("endian") {
        Some("big") => true,
        Some("little") => false,
        None if element.size() == 1 => false,
        other => return Err(format!("endian must be little or big; got {}", other.unwrap_or("nothing"))),
    };
    let coding = match need("encoding")? {
        "raw" => Coding::Raw,
        "gzip" | "gz" => Coding::Gzip,
        "bzip2" | "bz2" => Coding::Bzip2,
        other => return Err(format!("encoding must be raw, gzip or bzip2; got {other}")),
    };
    let (origin, steps, spaced) = placement(&field, layers.is_some())?;
    let mut units = field("space units").unwrap_or_default().split('"').skip(1).step_by(2).filter(|u| !u.is_empty());
    let unit = units.next().unwrap_or(if spaced { "mm" } else { "px" });
    if let Some(other) = units.find(|other| *other != unit) {
        return Err(format!("space units are {unit} and {other}: all axes must have the same"));
    }
    let grid = VolumeGrid { dims, origin, steps, unit: unit.into(), spaced, space: WorldSpace::default() };
    let (file, offset) = match field("data file").or(field("datafile")) {
        None => (path.to_path_buf(), end),
        Some(list) if list.starts_with("LIST") || list.contains('%') => {
            return Err(format!("data lie in many files (`data file: {list}`); save them as one"));
        }
        Some(name) => (path.parent().unwrap_or(Path::new("")).join(name), 0),
    };
    let data = Data::Stream { file, offset, coding, skip: 0 };
    let segments = match layers {
        Some(_) => segments::in_order(&header.pairs),
        None => segments::read(&header.pairs),
    };
    let mut volume = Volume { segments, layers, ..Volume::new(path, "NRRD", grid, (element, big_endian), data) };
    skip(&mut volume, &field)?;
    Ok(volume)
}

/// `line skip` and `byte skip`: lines before the packed bytes, and unpacked bytes before the voxels (-1: the voxels are the file's end).
fn skip<'a>(volume: &mut Volume, field: &impl Fn(&str) -> Option<&'a str>) -> Failure<()> {
    let lines: usize = field("line skip").or(field("lineskip")).map_or(Ok(0), |text| number("line skip", text))?;
    let bytes: i64 = field("byte skip").or(field("byteskip")).map_or(Ok(0), |text| number("byte skip", text))?;
    if lines == 0 && bytes == 0 {
        return Ok(());
    }
    let needed = volume.grid.dims.iter().try_fold(volume.voxel_bytes(), |n, &d| n.checked_mul(d)).unwrap_or(0) as u64;
    let Data::Stream { file, offset, coding, skip } = &mut volume.data else { return Ok(()) };
    let unreadable = |e: std::io::Error| format!("data in {}: {e}", file.display());
    match (bytes, *coding) {
        (0.., Coding::Raw) => *offset += bytes as u64,
        (0.., _) => *skip = bytes as u64,
        (-1, Coding::Raw) => {
            // Never in the header, where the file is cut short.
            let length = std::fs::metadata(&*file).map_err(unreadable)?.len();
            *offset = length.saturating_sub(needed).max(*offset);
            return Ok(());
        }
        _ => return Err(format!("byte skip must be 0 or more, or -1 for raw data; got {bytes}")),
    }
    if lines > 0 {
        let mut input = std::io::BufReader::new(regular::open(file).map_err(unreadable)?);
        let start = *offset - if *coding == Coding::Raw { bytes as u64 } else { 0 };
        input.seek(std::io::SeekFrom::Start(start)).map_err(unreadable)?;
        for _ in 0..lines.min(MOST_LINES) {
            let n = input.skip_until(b'\n').map_err(unreadable)?;
            *offset += n as u64;
        }
    }
    Ok(())
}

fn header(input: &mut impl BufRead) -> Failure<Fields> {
    let mut read_line = |number: usize| -> Failure<Option<String>> {
        let mut line = String::new();
        let n = input.take(LONGEST_LINE).read_line(&mut line).map_err(|e| format!("header line {number}: {e}"))?;
        Ok((n > 0).then(|| line.trim_end_matches(['\n', '\r']).to_string()))
    };
    if !read_line(1)?.is_some_and(|magic| magic.starts_with("NRRD000")) {
        return Err("does not begin with NRRD000".into());
    }
    let Fields { mut fields, mut pairs } = Fields::default();
    for number in 2..MOST_LINES {
        let line = match read_line(number)? {
            Some(line) => line,
            // A header of its own may end without an empty line.
            None if fields.contains_key("data file") || fields.contains_key("datafile") => {
                return Ok(Fields { fields, pairs });
            }
            None => return Err(format!("ends in the header, at line {number}")),
        };
        if line.is_empty() {
            return Ok(Fields { fields, pairs });
        }
        if line.starts_with('#') {
            continue;
        }
        if let Some((key, value)) = line.split_once(":=") {
            pairs.insert(key.into(), value.into());
            continue;
        }
        let (name, value) =
            line.split_once(": ").ok_or_else(|| format!("header line {number} is no field: `{line:.60}`"))?;
        fields.insert(name.to_lowercase(), value.trim().to_string());
    }
    Err(format!("header has more than {MOST_LINES} lines"))
}

fn number<T: std::str::FromStr>(name: &str, text: &str) -> Failure<T> {
    text.parse().map_err(|_| format!("{name}: `{text}` is not a number of the kind it must be"))
}

fn numbers<T: std::str::FromStr>(name: &str, text: &str) -> Failure<Vec<T>> {
    text.split_whitespace().map(|t| number(name, t)).collect()
}

fn element(name: &str) -> Failure<Element> {
    let int = |size, signed| Ok(Element::Int { size, signed });
    match name {
        "signed char" | "int8" | "int8_t" => int(1, true),
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => int(1, false),
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => int(2, true),
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => int(2, false),
        "int" | "signed int" | "int32" | "int32_t" => int(4, true),
        "uint" | "unsigned int" | "uint32" | "uint32_t" => int(4, false),
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => int(8, true),
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => int(8, false),
        "float" => Ok(Element::Float),
        "double" => Ok(Element::Double),
        other => Err(format!("type `{other}` is not known")),
    }
}

/// Centre of the first sample by `axis mins`, which is where its cell begins, or with `centers: node` its centre; a file with `space` has no such field.
fn least<'a>(field: &impl Fn(&str) -> Option<&'a str>, listed: bool, sides: [f64; 3]) -> Failure<Option<DVec3>> {
    let Some(text) = field("axis mins").or(field("axismins")).filter(|_| field("space").is_none()) else {
        return Ok(None);
    };
    let mins = numbers::<f64>("axis mins", text)?;
    let mins = if listed { mins.get(1..).unwrap_or_default() } else { &mins };
    let &[x, y, z] = mins else { return Err(format!("axis mins must be 3 numbers; got {}", mins.len())) };
    if let Some(bad) = mins.iter().find(|v| !v.is_finite()) {
        return Err(format!("axis mins holds {bad}"));
    }
    let centers: Vec<&str> = field("centers").or(field("centerings")).unwrap_or_default().split_whitespace().collect();
    let half =
        |axis: usize| if centers.get(axis + usize::from(listed)) == Some(&"node") { 0.0 } else { 0.5 * sides[axis] };
    Ok(Some(DVec3::new(x + half(0), y + half(1), z + half(2))))
}

/// Origin and steps in LPS, and whether the header gives steps.
fn placement<'a>(field: &impl Fn(&str) -> Option<&'a str>, listed: bool) -> Failure<(DVec3, [DVec3; 3], bool)> {
    let flip = match field("space").map(str::to_lowercase).as_deref() {
        None | Some("left-posterior-superior" | "lps" | "scanner-xyz" | "3d-right-handed") => DVec3::ONE,
        Some("right-anterior-superior" | "ras") => DVec3::new(-1.0, -1.0, 1.0),
        Some("left-anterior-superior" | "las") => DVec3::new(1.0, -1.0, 1.0),
        Some(_) if field("space directions").is_none() => DVec3::ONE,
        Some(other) => return Err(format!("space `{other}` is not known; expected LPS, RAS or LAS")),
    };
    let vector = |name: &str, text: &str| -> Failure<DVec3> {
        let parts: Vec<&str> = text.trim().trim_start_matches('(').trim_end_matches(')').split(',').collect();
        let &[x, y, z] = &parts[..] else { return Err(format!("{name}: `{text}` is no vector of three")) };
        let v = [number::<f64>(name, x.trim())?, number(name, y.trim())?, number(name, z.trim())?];
        match v.iter().find(|c| !c.is_finite()) {
            Some(bad) => Err(format!("{name} holds {bad}")),
            None => Ok(DVec3::from(v) * flip),
        }
    };
    // What is not known is NaN, by the format's own words.
    let known = |name: &str| field(name).filter(|text| !is_all_nan(text));
    let mut origin = field("space origin").map_or(Ok(DVec3::ZERO), |text| vector("space origin", text))?;
    let steps = match known("space directions") {
        Some(text) => {
            // The axis of a list has no direction.
            let text = if listed { text.trim_start().trim_start_matches("none") } else { text };
            let vectors: Vec<&str> = text.split_inclusive(')').filter(|t| !t.trim().is_empty()).collect();
            let &[x, y, z] = &vectors[..] else {
                return Err(format!("space directions must be 3 vectors; got `{text}`"));
            };
            [vector("space directions", x)?, vector("space directions", y)?, vector("space directions", z)?]
        }
        None => {
            let s = known("spacings")
                .map_or(Ok(vec![1.0; if listed { 4 } else { 3 }]), |text| numbers::<f64>("spacings", text))?;
            let s = if listed { s.get(1..).unwrap_or_default() } else { &s };
            let &[x, y, z] = s else { return Err(format!("spacings must be 3 numbers; got {}", s.len())) };
            if let Some((axis, h)) = s.iter().enumerate().find(|(_, h)| !(h.is_finite() && **h > 0.0)) {
                return Err(format!("spacings: voxel spacing along axis {axis} must be a positive number; got {h}"));
            }
            if let Some(least) = least(field, listed, [x, y, z])? {
                origin = least;
            }
            [x * DVec3::X, y * DVec3::Y, z * DVec3::Z]
        }
    };
    Ok((origin, steps, known("space directions").or(known("spacings")).is_some()))
}

/// Whether all numbers of a field are NaN, or none of an axis without a direction.
fn is_all_nan(text: &str) -> bool {
    let mut words =
        text.split([' ', '\t', ',', '(', ')']).filter(|word| !word.is_empty() && *word != "none").peekable();
    words.peek().is_some() && words.all(|word| word.eq_ignore_ascii_case("nan"))
}
