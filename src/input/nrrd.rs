//! NRRD label volumes (teem's nrrd format 0001 to 0005): header attached or detached, raw, gzip or bzip2.

use std::collections::BTreeMap;
use std::io::{BufRead, Read, Seek};
use std::path::Path;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::input::segments;
use crate::input::volume::data::{Coding, Data};
use crate::input::volume::element::Element;
use crate::input::volume::grid::{Failure, TAKE_ONE, VolumeGrid, three_of};
use crate::input::volume::{Volume, open};
use crate::stack::space::WorldSpace;
use crate::storage::regular;

/// Longest header line and most lines: a file that is no NRRD must not be read to its end.
const LONGEST_LINE: u64 = 1 << 16;
const MOST_LINES: usize = 4096;
/// Kinds of axes of space, and those that say nothing.
const SPATIAL: [&str; 4] = ["domain", "space", "none", "???"];

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
    let kinds: Vec<&str> = field("kinds").unwrap_or_default().split_whitespace().collect();
    let (axes, layers) = match sizes[..] {
        // 3D Slicer's segments that overlap: the layers of a voxel one behind the other.
        [count, _, _, _] if kinds.first() == Some(&"list") && segments::any(&header.pairs) => {
            ([1, 2, 3], Some(segments::layers(&header.pairs, count)?))
        }
        _ => {
            let directions = field("space directions").map(vectors).unwrap_or_default();
            let of_space = |axis: usize| {
                kinds.get(axis).is_none_or(|kind| SPATIAL.contains(kind)) && directions.get(axis) != Some(&"none")
            };
            (axes(&sizes, of_space)?, None)
        }
    };
    let dims = axes.map(|axis| sizes[axis]);
    if let Some(kind) = axes.iter().filter_map(|axis| kinds.get(*axis)).find(|kind| !SPATIAL.contains(kind)) {
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
    let (origin, steps, spaced) = placement(&field, axes, dimension)?;
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

/// The axes of the volume: those of length 1 beside three others are passed over, and where these are too many those that are none of space.
fn axes(sizes: &[usize], of_space: impl Fn(usize) -> bool) -> Failure<[usize; 3]> {
    let count = sizes.len();
    let found = three_of(sizes, &of_space).filter(|axes| count == 3 || axes.iter().all(|axis| of_space(*axis)));
    found.ok_or_else(|| {
        let short = sizes.iter().filter(|size| **size == 1).count();
        if count > 3 && count - 3 < short {
            let sizes: Vec<String> = sizes.iter().map(usize::to_string).collect();
            return format!(
                "sizes are {}: {short} axes have a length of 1, and which of them are none of the volume's `kinds` or `space directions` must say; or \
                 save it with 3 axes",
                sizes.join(" ")
            );
        }
        format!(
            "dimension is {count}; a label volume has 3, or 4 with 3D Slicer's segments in a list, or more of which all but 3 have a length of 1; of \
             several times or channels {TAKE_ONE}"
        )
    })
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
fn least<'a>(
    field: &impl Fn(&str) -> Option<&'a str>,
    axes: [usize; 3],
    count: usize,
    sides: [f64; 3],
) -> Failure<Option<DVec3>> {
    let Some(text) = field("axis mins").or(field("axismins")).filter(|_| field("space").is_none()) else {
        return Ok(None);
    };
    let mins = numbers::<f64>("axis mins", text)?;
    if mins.len() != count {
        return Err(format!("axis mins must be {count} numbers; got {}", mins.len()));
    }
    let mins = axes.map(|axis| mins[axis]);
    if let Some(bad) = mins.iter().find(|v| !v.is_finite()) {
        return Err(format!("axis mins holds {bad}"));
    }
    let centers: Vec<&str> = field("centers").or(field("centerings")).unwrap_or_default().split_whitespace().collect();
    let half = |k: usize| if centers.get(axes[k]) == Some(&"node") { 0.0 } else { 0.5 * sides[k] };
    Ok(Some(DVec3::from_array(std::array::from_fn(|k| mins[k] + half(k)))))
}

/// The vectors of a text, one by one, with a word for each axis that has none.
fn vectors(text: &str) -> Vec<&str> {
    let mut rest = text.trim_start();
    let next = || {
        let end = if rest.starts_with('(') { rest.find(')').map(|k| k + 1) } else { rest.find([' ', '\t', '(']) };
        let (vector, behind) = rest.split_at(end.unwrap_or(rest.len()));
        rest = behind.trim_start();
        Some(vector.trim_end()).filter(|vector| !vector.is_empty())
    };
    std::iter::from_fn(next).collect()
}

/// Components of a vector.
fn components(text: &str) -> Vec<&str> {
    text.trim().trim_start_matches('(').trim_end_matches(')').split(',').map(str::trim).collect()
}

/// How many components vectors have, and the three in which these axes lie: of those beside them one may have a component of its own, as that of time.
fn world(vectors: &[&str], axes: [usize; 3]) -> Failure<(usize, [usize; 3])> {
    let parts: Vec<Vec<&str>> = vectors.iter().map(|vector| components(vector)).collect();
    let width = axes.iter().filter_map(|axis| parts.get(*axis)).map(Vec::len).max().unwrap_or(3);
    if width <= 3 || parts.len() <= 3 {
        return Ok((3, [0, 1, 2]));
    }
    let lacks = |axis: usize, k: usize| parts[axis].get(k).is_some_and(|text| text.parse() == Ok(0.0));
    let is_of_volume = |k: &usize| {
        let alone = |axis: usize| (0..width).all(|other| lacks(axis, other) != (other == *k));
        !axes.iter().all(|axis| lacks(*axis, *k)) || !(0..parts.len()).any(|axis| !axes.contains(&axis) && alone(axis))
    };
    let three = (0..width).filter(is_of_volume).collect::<Vec<_>>().try_into();
    three.map(|three| (width, three)).map_err(|_| {
        format!("space directions have {width} components, of which axes of length 1 have none of their own: save the volume with 3 axes")
    })
}

/// Origin and steps in LPS by these of `count` axes, and whether the header gives steps.
fn placement<'a>(
    field: &impl Fn(&str) -> Option<&'a str>,
    axes: [usize; 3],
    count: usize,
) -> Failure<(DVec3, [DVec3; 3], bool)> {
    // A fourth axis of the world is a time's.
    let space = field("space").map(str::to_lowercase);
    let space = space.as_deref().map(|name| match name {
        "lpst" | "rast" | "last" => &name[..3],
        _ => name.strip_suffix("-time").unwrap_or(name),
    });
    let flip = match space {
        None | Some("left-posterior-superior" | "lps" | "scanner-xyz" | "3d-right-handed") => DVec3::ONE,
        Some("right-anterior-superior" | "ras") => DVec3::new(-1.0, -1.0, 1.0),
        Some("left-anterior-superior" | "las") => DVec3::new(1.0, -1.0, 1.0),
        Some(_) if field("space directions").is_none() => DVec3::ONE,
        Some(other) => return Err(format!("space `{other}` is not known; expected LPS, RAS or LAS")),
    };
    // What is not known is NaN, by the format's own words.
    let known = |name: &str| field(name).filter(|text| !is_all_nan(text));
    let directions = known("space directions").map(vectors);
    if let Some(vectors) = directions.as_ref().filter(|vectors| vectors.len() != count) {
        return Err(format!("space directions must be {count} vectors; got `{}`", vectors.join(" ")));
    }
    let (width, of_volume) = directions.as_ref().map_or(Ok((3, [0, 1, 2])), |vectors| world(vectors, axes))?;
    let vector = |name: &str, text: &str| -> Failure<DVec3> {
        let parts = components(text);
        if parts.len() != width {
            let words = if width == 3 { "three".into() } else { width.to_string() };
            return Err(format!("{name}: `{text}` is no vector of {words}"));
        }
        let [x, y, z] = of_volume.map(|k| number::<f64>(name, parts[k]));
        let v = [x?, y?, z?];
        match v.iter().find(|c| !c.is_finite()) {
            Some(bad) => Err(format!("{name} holds {bad}")),
            None => Ok(DVec3::from(v) * flip),
        }
    };
    let mut origin = field("space origin").map_or(Ok(DVec3::ZERO), |text| vector("space origin", text))?;
    let steps = match directions {
        Some(vectors) => {
            let [x, y, z] = axes.map(|axis| vector("space directions", vectors[axis]));
            [x?, y?, z?]
        }
        None => {
            let s = known("spacings").map_or(Ok(vec![1.0; count]), |text| numbers::<f64>("spacings", text))?;
            if s.len() != count {
                return Err(format!("spacings must be {count} numbers; got {}", s.len()));
            }
            let s = axes.map(|axis| s[axis]);
            if let Some((axis, h)) = s.iter().enumerate().find(|(_, h)| !(h.is_finite() && **h > 0.0)) {
                return Err(format!("spacings: voxel spacing along axis {axis} must be a positive number; got {h}"));
            }
            if let Some(least) = least(field, axes, count, s)? {
                origin = least;
            }
            std::array::from_fn(|k| s[k] * DVec3::AXES[k])
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
