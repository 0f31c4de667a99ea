//! Checks that a shapefile is what its counts say before anything is allocated by them.
//!
//! The shapefile library believes numbers of parts and points, and the length in an index, and allocates by them. Here every one of them is
//! compared with what is left of the record, of the index.

type Check<T> = Result<T, String>;

/// Bytes of the header of a .shp or .shx, of that of a record, of an entry of a .shx.
const HEADER: usize = 100;
const RECORD_HEADER: usize = 8;
const ENTRY: usize = 8;
/// Offsets at which a record's content has the numbers of a polyline or polygon, and where their parts begin; of a set of points.
const COUNTS: usize = 36;
const PARTS: usize = 44;
const POINTS: usize = 40;
/// Bytes of a point's x and y.
const POINT: usize = 16;

/// Checks an index: its header's length is that of the file.
///
/// # Errors
/// A message with both lengths.
pub fn index(shx: &[u8]) -> Check<()> {
    let said = words(shx, 24).ok_or("is cut off in its header of 100 bytes")?;
    if said > shx.len() {
        return Err(format!("is said to be {said} bytes long, but has {}", shx.len()));
    }
    Ok(())
}

/// Checks all records of a .shp: those that its index (already checked) names, or one behind the other where there is none.
///
/// # Errors
/// A message with record, value and limit.
pub fn shapes(shp: &[u8], shx: Option<&[u8]>) -> Check<()> {
    let said = words(shp, 24).ok_or("is cut off in its header of 100 bytes")?;
    if said > shp.len() {
        return Err(format!("is said to be {said} bytes long, but has {}", shp.len()));
    }
    let mut checked = 0;
    let mut record = |at: usize| -> Check<usize> {
        checked += 1;
        content(shp, at).map_err(|message| format!("feature {checked}, at byte {at}: {message}"))
    };
    match shx {
        Some(shx) => {
            for entry in shx.get(HEADER..).unwrap_or_default().chunks_exact(ENTRY) {
                record(words(entry, 0).unwrap_or(usize::MAX))?;
            }
        }
        None => {
            let mut at = HEADER;
            while at < said {
                at = record(at)?;
            }
        }
    }
    Ok(())
}

/// Checks the record at a byte; where it ends.
fn content(shp: &[u8], at: usize) -> Check<usize> {
    let header = shp.get(at..).and_then(|rest| rest.get(..RECORD_HEADER)).ok_or("lies beyond the end of the file")?;
    let length = words(header, 4).unwrap_or(0);
    let from = at + RECORD_HEADER;
    let left = shp.len() - from;
    let content = shp.get(from..).and_then(|rest| rest.get(..length));
    let content = content.ok_or_else(|| format!("is said to be {length} bytes long, but {left} are left"))?;
    let number = |at: usize| content.get(at..at + 4).map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let count = |name: &str, at: usize| {
        let number = number(at).ok_or_else(|| format!("is cut off before the number of its {name}"))?;
        usize::try_from(number).map_err(|_| format!("has {number} {name}"))
    };
    let holds = |from: usize, parts: usize, points: usize| {
        let most = length.saturating_sub(from);
        if 4 * parts + POINT * points > most {
            return Err(format!(
                "is said to have {parts} parts and {points} points, but {most} bytes are left for them"
            ));
        }
        Ok(())
    };
    match number(0).ok_or("is cut off before its type")? {
        // Polylines and polygons, of x and y, with z, with m; patches.
        3 | 5 | 13 | 15 | 23 | 25 | 31 => {
            let (parts, points) = (count("parts", COUNTS)?, count("points", COUNTS + 4)?);
            holds(PARTS, parts, points)?;
            let mut before = 0;
            for k in 0..parts {
                let first = count("points", PARTS + 4 * k)?;
                if first < before || first > points {
                    return Err(format!("part {} begins at point {first}; it must lie in [{before}, {points}]", k + 1));
                }
                before = first;
            }
        }
        // Sets of points.
        8 | 18 | 28 => holds(POINTS, 0, count("points", COUNTS)?)?,
        _ => {}
    }
    Ok(from + length)
}

/// A big-endian number of 16-bit words, in bytes.
fn words(bytes: &[u8], at: usize) -> Option<usize> {
    let number = bytes.get(at..at + 4).map(|b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]))?;
    Some(2 * number as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with one polyline of six points, whose parts begin at these.
    fn shp(parts: &[i32]) -> Vec<u8> {
        let mut content = 3i32.to_le_bytes().to_vec();
        content.extend([0; 32]);
        content.extend((parts.len() as i32).to_le_bytes());
        content.extend(6i32.to_le_bytes());
        parts.iter().for_each(|first| content.extend(first.to_le_bytes()));
        content.extend([0; 6 * POINT]);
        let words = |bytes: usize| (bytes as u32 / 2).to_be_bytes();
        let mut file = vec![0; HEADER];
        file[24..28].copy_from_slice(&words(HEADER + RECORD_HEADER + content.len()));
        file.extend(1u32.to_be_bytes());
        file.extend(words(content.len()));
        file.extend(content);
        file
    }

    #[test]
    fn parts_begin_one_behind_the_other() {
        for sound in [&[0][..], &[0, 2, 4], &[0, 0, 6], &[0, 1, 2, 3, 4, 5]] {
            assert_eq!(shapes(&shp(sound), None), Ok(()), "{sound:?}");
        }
        for (parts, says) in [
            (&[0, 3, 2][..], "part 3 begins at point 2; it must lie in [3, 6]"),
            (&[0, 7, 7], "part 2 begins at point 7"),
            (&[0, 1, 2, -3], "has -3 points"),
        ] {
            let message = shapes(&shp(parts), None).expect_err("parts out of order");
            assert!(message.contains(says) && message.contains("feature 1, at byte 100"), "{message}");
        }
    }
}
