//! NRRD label volumes with an attached header (teem's nrrd format 0001 to 0005), raw or gzip.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;

use super::volume::{LabelVolume, whole};
use crate::error::{Error, Result};

/// Longest header line and most lines: a file that is no NRRD must not be read to its end.
const LONGEST_LINE: u64 = 1 << 16;
const MOST_LINES: usize = 4096;
/// Most voxels this reader takes.
const MOST_VOXELS: usize = 1 << 33;

/// Reads a `.nrrd`.
///
/// # Errors
/// [`Error::Read`] where the file cannot be read, [`Error::Format`] naming field and value.
pub fn read(path: &Path) -> Result<LabelVolume> {
    let file = File::open(path).map_err(|source| Error::Read { path: path.into(), source })?;
    read_from(BufReader::new(file)).map_err(|message| Error::Format { path: path.into(), message })
}

type Failure<T> = std::result::Result<T, String>;

/// The same from any reader, with messages that the caller puts the file's name to.
///
/// # Errors
/// A message with field and value.
pub fn read_from(mut input: impl BufRead) -> Failure<LabelVolume> {
    let fields = header(&mut input)?;
    let field = |name: &str| fields.get(name).map(String::as_str);
    let need = |name: &str| field(name).ok_or_else(|| format!("header has no field `{name}`"));
    let dimension: usize = number("dimension", need("dimension")?)?;
    if dimension != 3 {
        return Err(format!("dimension is {dimension}; a label volume has 3"));
    }
    let sizes = numbers::<usize>("sizes", need("sizes")?)?;
    let &[nx, ny, nz] = &sizes[..] else { return Err(format!("sizes must be 3 numbers; got {}", sizes.len())) };
    let count = nx.checked_mul(ny).and_then(|n| n.checked_mul(nz)).filter(|n| (1..=MOST_VOXELS).contains(n));
    let count = count.ok_or_else(|| format!("sizes {nx} {ny} {nz} are no volume of 1 to {MOST_VOXELS} voxels"))?;
    if let Some(detached) = field("data file").or(field("datafile")) {
        return Err(format!("data lie in another file (`{detached}`); save with an attached header"));
    }
    let kind = Kind::parse(need("type")?)?;
    let big = match field("endian") {
        Some("big") => true,
        Some("little") => false,
        None if kind.size() == 1 => false,
        other => return Err(format!("endian must be little or big; got {}", other.unwrap_or("nothing"))),
    };
    let bytes = match need("encoding")? {
        "raw" => take(input, count * kind.size())?,
        "gzip" | "gz" => take(MultiGzDecoder::new(input), count * kind.size())?,
        other => return Err(format!("encoding must be raw or gzip; got {other}")),
    };
    let labels = bytes
        .chunks_exact(kind.size())
        .enumerate()
        .map(|(k, b)| kind.value(b, big).and_then(|v| v.map_or_else(|f| whole(f, k), Ok)))
        .collect::<Failure<Vec<i64>>>()?;
    let (origin, steps) = placement(&field)?;
    let unit = field("space units").and_then(|u| u.split('"').nth(1)).filter(|u| !u.is_empty()).unwrap_or("mm");
    Ok(LabelVolume { dims: [nx, ny, nz], origin, steps, unit: unit.into(), labels })
}

fn header(input: &mut impl BufRead) -> Failure<BTreeMap<String, String>> {
    let mut line = String::new();
    let mut read_line = |input: &mut dyn BufRead, number: usize| -> Failure<String> {
        line.clear();
        let n = input.take(LONGEST_LINE).read_line(&mut line).map_err(|e| format!("header line {number}: {e}"))?;
        if n == 0 {
            return Err(format!("ends in the header, at line {number}"));
        }
        Ok(line.trim_end_matches(['\n', '\r']).to_string())
    };
    let magic = read_line(input, 1)?;
    if !magic.starts_with("NRRD000") {
        return Err("does not begin with NRRD000".into());
    }
    let mut fields = BTreeMap::new();
    for number in 2..MOST_LINES {
        let line = read_line(input, number)?;
        if line.is_empty() {
            return Ok(fields);
        }
        if line.starts_with('#') || line.contains(":=") {
            continue;
        }
        let (name, value) =
            line.split_once(": ").ok_or_else(|| format!("header line {number} is no field: `{line}`"))?;
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

fn take(input: impl Read, bytes: usize) -> Failure<Vec<u8>> {
    // Grows with what is really there: a short file never costs what its header claims.
    let mut out = Vec::new();
    input.take(bytes as u64).read_to_end(&mut out).map_err(|e| format!("data: {e}"))?;
    if out.len() < bytes {
        return Err(format!("data end after {} of {bytes} bytes", out.len()));
    }
    Ok(out)
}

#[derive(Debug, Clone, Copy)]
enum Kind {
    Int { size: usize, signed: bool },
    Float,
    Double,
}

impl Kind {
    fn parse(name: &str) -> Failure<Self> {
        let int = |size, signed| Ok(Kind::Int { size, signed });
        match name {
            "signed char" | "int8" | "int8_t" => int(1, true),
            "uchar" | "unsigned char" | "uint8" | "uint8_t" => int(1, false),
            "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => int(2, true),
            "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => int(2, false),
            "int" | "signed int" | "int32" | "int32_t" => int(4, true),
            "uint" | "unsigned int" | "uint32" | "uint32_t" => int(4, false),
            "longlong" | "long long" | "long long int" | "int64" | "int64_t" => int(8, true),
            "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => int(8, false),
            "float" => Ok(Kind::Float),
            "double" => Ok(Kind::Double),
            other => Err(format!("type `{other}` is not known")),
        }
    }

    fn size(self) -> usize {
        match self {
            Kind::Int { size, .. } => size,
            Kind::Float => 4,
            Kind::Double => 8,
        }
    }

    /// An integer, or a float that has yet to prove whole.
    fn value(self, bytes: &[u8], big: bool) -> Failure<std::result::Result<i64, f64>> {
        let mut wide = [0u8; 8];
        for (k, b) in bytes.iter().enumerate() {
            wide[if big { bytes.len() - 1 - k } else { k }] = *b;
        }
        let raw = u64::from_le_bytes(wide);
        Ok(match self {
            Kind::Int { size, signed: true } => {
                let unused = 64 - 8 * size as u32;
                Ok(((raw << unused) as i64) >> unused)
            }
            Kind::Int { signed: false, .. } => {
                Ok(i64::try_from(raw).map_err(|_| format!("label {raw} is larger than {}", i64::MAX))?)
            }
            Kind::Float => Err(f64::from(f32::from_bits(raw as u32))),
            Kind::Double => Err(f64::from_bits(raw)),
        })
    }
}

/// Origin and steps in LPS.
fn placement<'a>(field: &impl Fn(&str) -> Option<&'a str>) -> Failure<([f64; 3], [[f64; 3]; 3])> {
    let flip = match field("space").map(str::to_lowercase).as_deref() {
        None | Some("left-posterior-superior" | "lps" | "scanner-xyz" | "3d-right-handed") => [1.0, 1.0, 1.0],
        Some("right-anterior-superior" | "ras") => [-1.0, -1.0, 1.0],
        Some("left-anterior-superior" | "las") => [1.0, -1.0, 1.0],
        Some(_) if field("space directions").is_none() => [1.0, 1.0, 1.0],
        Some(other) => return Err(format!("space `{other}` is not known; expected LPS, RAS or LAS")),
    };
    let vector = |name: &str, text: &str| -> Failure<[f64; 3]> {
        let parts: Vec<&str> = text.trim().trim_start_matches('(').trim_end_matches(')').split(',').collect();
        let &[x, y, z] = &parts[..] else { return Err(format!("{name}: `{text}` is no vector of three")) };
        let v = [number::<f64>(name, x.trim())?, number(name, y.trim())?, number(name, z.trim())?];
        match v.iter().find(|c| !c.is_finite()) {
            Some(bad) => Err(format!("{name} holds {bad}")),
            None => Ok(std::array::from_fn(|a| v[a] * flip[a])),
        }
    };
    let origin = field("space origin").map_or(Ok([0.0; 3]), |text| vector("space origin", text))?;
    let steps = match field("space directions") {
        Some(text) => {
            let vectors: Vec<&str> = text.split_inclusive(')').filter(|t| !t.trim().is_empty()).collect();
            let &[x, y, z] = &vectors[..] else {
                return Err(format!("space directions must be 3 vectors; got `{text}`"));
            };
            [vector("space directions", x)?, vector("space directions", y)?, vector("space directions", z)?]
        }
        None => {
            let s = field("spacings").map_or(Ok(vec![1.0; 3]), |text| numbers::<f64>("spacings", text))?;
            let &[x, y, z] = &s[..] else { return Err(format!("spacings must be 3 numbers; got {}", s.len())) };
            [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]]
        }
    };
    Ok((origin, steps))
}
