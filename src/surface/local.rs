//! The origin of positions that a format holds as f32.
//!
//! f32 has 24 bits: below `2^m` its numbers are at most `2^(m - 24)` apart. Marching cubes keeps vertices a share `OFF_CORNER` of a cell's
//! side from the cell's corners. So two vertices near one corner differ by that much of the side along an axis of the stack, and where the axes
//! lie aslant in the world by `sqrt(2/3)` of it along some axis of the world (they are `sqrt(2)` of it apart, and the largest of three
//! coordinates is at least `1 / sqrt(3)` of a length). Below the first `m` for which numbers are closer than that, no two vertices
//! fall together and a reader that joins equal positions finds the surface as it is: 8192 to 16384 cells either side of the origin.
//! A body that lies farther away gets an origin of its own, along those axes of the world where it must, and the file says which.

use glam::DVec3;

use super::header::Header;
use super::slab::OFF_CORNER;

/// Bits of an f32's mantissa.
const BITS: i32 = f32::MANTISSA_DIGITS as i32;
/// Least part of a step along an axis of the stack that counts as a step along an axis of the world: less is rounding of directions.
const ASLANT: f64 = 1e-6;

/// Origin that is subtracted from all positions of a body before they become f32: 0 where they need no other origin. Numbers as round as they can be,
/// and f32 themselves, so that every reader adds exactly what was subtracted.
///
/// # Errors
/// In words, where the body is too large for f32 wherever its origin is.
pub fn origin(header: &Header) -> Result<DVec3, String> {
    let Header { dims, spacing, extent, ref geometry, ref grid, .. } = *header;
    let sides = [spacing[0], spacing[1], grid.step];
    // The surface lies within a ring of outside around the image.
    let x = [-sides[0], dims[0] as f64 * sides[0]];
    let y = [-sides[1], dims[1] as f64 * sides[1]];
    let corners = (0..8).map(|k| geometry.to_world(DVec3::new(x[k & 1], y[k >> 1 & 1], extent[k >> 2])));
    let around = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = corners.fold(around, |(low, high), p| (low.min(p), high.max(p)));
    let mut origin = DVec3::ZERO;
    for (a, origin) in origin.as_mut().iter_mut().enumerate() {
        let along: Vec<f64> = (0..3).filter(|&k| geometry.axes[k][a].abs() > ASLANT).map(|k| sides[k]).collect();
        let least = along.iter().fold(f64::INFINITY, |least, side| least.min(*side));
        let share = if along.len() > 1 { (2.0f64 / 3.0).sqrt() } else { 1.0 };
        // The largest power of two below which numbers are closer.
        // Sides of nothing, as a file may have, make a power of nothing.
        let power = libm::log2(share * OFF_CORNER * least).ceil() as i32;
        let reach = 2f64.powi(power.saturating_add(BITS - 1));
        if low[a].abs().max(high[a].abs()) <= reach {
            continue;
        }
        let (middle, half) = (0.5 * (low[a] + high[a]), 0.5 * (high[a] - low[a]));
        let fits = |at: &f64| (at - middle).abs() + half <= reach;
        *origin = roundest(middle, fits).ok_or_else(|| {
            // Digits beyond the sixteenth tell nothing.
            let told = |v: f64| if v < 1e15 { v.round().to_string() } else { format!("{v:.0e}") };
            let [cells, most] = [2.0 * half / least, 2.0 * reach / least].map(told);
            format!("the surface is {cells} cells wide, and 32-bit positions tell vertices apart within {most}")
        })?;
    }
    Ok(origin)
}

/// The multiple of the largest power of ten, as f32, that fits and is nearest to `middle`; `middle` itself as f32 at last.
fn roundest(middle: f64, fits: impl Fn(&f64) -> bool) -> Option<f64> {
    let digits = libm::log10(middle.abs().max(f64::MIN_POSITIVE)).floor() as i32 + 1;
    // f32 has less than ten decimal digits.
    let multiple = |power: i32| {
        if power < 0 {
            (middle * 10f64.powi(-power)).round() / 10f64.powi(-power)
        } else {
            (middle / 10f64.powi(power)).round() * 10f64.powi(power)
        }
    };
    let rounded = (digits - 10..=digits).rev().map(multiple).chain([middle]);
    rounded.map(|at| f64::from(at as f32)).find(fits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::{Geometry, HeightGrid};

    fn header(origin: DVec3, nx: usize, side: f64) -> Header {
        let geometry = Geometry { origin, ..Geometry::default() };
        let grid = HeightGrid { start: 0.0, step: side, count: 11 };
        let extent = [0.0, 10.0 * side];
        Header { dims: [nx, 200], spacing: [side; 2], unit: "m".into(), geometry, extent, grid }
    }

    #[test]
    fn origins_are_round_and_only_where_they_must() {
        let of = |place: [f64; 3], nx, side| origin(&header(place.into(), nx, side)).map(|o| o.to_array());
        assert_eq!(of([0.0; 3], 500, 1.0), Ok([0.0; 3]));
        assert_eq!(of([-250.0, -250.0, -1200.0], 512, 0.5), Ok([0.0; 3]));
        assert_eq!(of([500_000.0, 5_400_000.0, 300.0], 300, 0.25), Ok([500_000.0, 5_400_000.0, 0.0]));
        assert_eq!(of([0.0, 0.0, 1e9], 300, 1.0), Ok([0.0, 0.0, 1e9]));
        assert_eq!(of([1e7, -1e7, 0.0], 300, 1.0), Ok([1e7, -1e7, 0.0]));
        assert!(of([0.0; 3], 16_000, 1.0).is_ok_and(|o| o == [0.0; 3]));
        assert!(of([0.0; 3], 20_000, 1.0).is_ok_and(|o| o[0] == 10_000.0 && o[1] == 0.0));
        assert!(of([0.0; 3], 40_000, 1.0).is_err_and(|e| e.contains("40001 cells wide") && e.contains("within 32768")));
    }

    #[test]
    fn what_is_left_is_held_and_no_more_is_promised() {
        for side in [0.25, 0.7, 1.0, 3e-4] {
            for far in [1e4, 3.21e5, 1e7, 1.234_567e9, 1e11] {
                let at = far * side;
                let x = origin(&header(at * DVec3::X, 1000, side)).expect("it can be held").x;
                assert_eq!(x, f64::from(x as f32), "{side} {far}");
                for end in [at - side, at + 1000.0 * side] {
                    let position = (end - x) as f32;
                    let next = f32::from_bits(position.abs().to_bits() + 1) - position.abs();
                    assert!(f64::from(next) < OFF_CORNER * side, "{side} {far}: {next} from {x}");
                }
            }
        }
    }
}
