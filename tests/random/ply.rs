//! A reader of binary PLY that knows nothing of its writer: properties by name, f32 or f64.

use glam::DVec3;

/// Vertices and triangles.
pub type Read = (Vec<DVec3>, Vec<[u32; 3]>);

/// Reads what a binary little-endian PLY says.
///
/// # Errors
/// What is missing.
pub fn read(bytes: &[u8]) -> Result<Read, String> {
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|w| w == end).ok_or("no header")?;
    let header = std::str::from_utf8(&bytes[..at]).map_err(|e| e.to_string())?;
    let mut data = &bytes[at + end.len()..];
    let mut take = |n: usize| -> Result<&[u8], String> {
        let (head, tail) = data.split_at_checked(n).ok_or("it ends early")?;
        data = tail;
        Ok(head)
    };
    let (mut counts, mut properties, mut element) = ([0usize; 2], Vec::new(), "");
    for line in header.lines() {
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["format", format, _] if format != "binary_little_endian" => return Err(format!("format {format}")),
            ["element", name, count] => {
                element = if name == "vertex" { "vertex" } else { "face" };
                counts[usize::from(name != "vertex")] = count.parse().map_err(|_| "a count is no number")?;
            }
            ["property", kind, name] if element == "vertex" => properties.push((kind, name)),
            _ => {}
        }
    }
    let size = |kind: &str| match kind {
        "double" | "float64" => Ok(8),
        "float" | "float32" | "int" | "uint" => Ok(4),
        "uchar" | "uint8" => Ok(1),
        other => Err(format!("property of type {other}")),
    };
    let mut positions = Vec::with_capacity(counts[0]);
    for _ in 0..counts[0] {
        let mut p = DVec3::NAN;
        for (kind, name) in &properties {
            let raw = take(size(kind)?)?;
            let value = match raw.len() {
                8 => f64::from_le_bytes(raw.try_into().map_err(|_| "eight bytes")?),
                4 => f64::from(f32::from_le_bytes(raw.try_into().map_err(|_| "four bytes")?)),
                _ => continue,
            };
            if let Some(a) = ["x", "y", "z"].iter().position(|n| n == name) {
                p[a] = value;
            }
        }
        positions.push(p);
    }
    let mut triangles = Vec::with_capacity(counts[1]);
    for _ in 0..counts[1] {
        if take(1)? != [3] {
            return Err("a face is no triangle".into());
        }
        let raw = take(12)?;
        let corner = |k: usize| u32::from_le_bytes([raw[4 * k], raw[4 * k + 1], raw[4 * k + 2], raw[4 * k + 3]]);
        triangles.push([corner(0), corner(1), corner(2)]);
    }
    Ok((positions, triangles))
}
