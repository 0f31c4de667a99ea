//! Corrections that stay between their contours, and where there is one contour alone.

use crate::grid::spline::smoothstep;

/// Distance by which a correction may leave the range of its contours, px of the larger side.
const SLACK: f32 = 0.05;

/// A correction c of a distance u that leaves the ranges of both contours' distances by no more than SLACK: with the room
/// `max(0, max(a, b) - u) + SLACK` above u, mirrored below, the narrower of two ranges, `c / (1 + (|c| / room)^8)^(1/8)`. `side` is the length
/// of a pixel's larger side.
#[inline(always)]
pub fn limited(c: f32, u: f32, [one, other]: [[f32; 2]; 2], side: f32) -> f32 {
    let room = room(c, u, one, side).min(room(c, u, other, side));
    let share = c / room;
    let ratio = share * share;
    let eighth = (ratio * ratio) * (ratio * ratio);
    // Beyond this the eighth root is the ratio itself, in single precision.
    if ratio > 100.0 { room.copysign(c) } else { c / (1.0 + eighth).sqrt().sqrt().sqrt() }
}

/// Correction cut off where the room ends: a curve through corrections that are [`limited`] may swing beyond them, the more the less the gaps on both
/// sides of a contour are alike, and is left alone where it does not.
#[inline(always)]
pub fn cut(c: f32, u: f32, range: [f32; 2], side: f32) -> f32 {
    bounded(c, room(c, u, range, side))
}

/// A value no farther from 0 than `most`: `clamp` asks at each pixel whether its bounds are in order.
#[inline(always)]
pub fn bounded(v: f32, most: f32) -> f32 {
    if v < -most {
        -most
    } else if v > most {
        most
    } else {
        v
    }
}

/// Room of a distance u to move towards the side of c.
#[inline(always)]
fn room(c: f32, u: f32, [a, b]: [f32; 2], side: f32) -> f32 {
    let own = if c > 0.0 { a.max(b) - u } else { u - a.min(b) };
    own.max(0.0) + SLACK * side
}

/// A contour this much of the farthest distance that counts away leads nowhere.
const ALONE: [f64; 2] = [0.8, 0.98];

/// Share to which the surface goes on from one contour to another whose distances there are these, at most `farthest`: 1 where both have a surface, 0
/// where one has none.
#[inline(always)]
pub fn goes_on(distances: [f32; 2], farthest: f64) -> f32 {
    let farther = f64::from(distances[0].abs().max(distances[1].abs())) / farthest;
    smoothstep((ALONE[1] - farther) / (ALONE[1] - ALONE[0])) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_correction_stays_within_the_narrower_range() {
        let wide = [-5.0, 5.0];
        for (c, u, range, room) in [
            (2.0, 0.0, [-1.0, 0.5], 0.55),
            (-2.0, 0.0, [-1.0, 0.5], 1.05),
            (2.0, 0.7, [-1.0, 0.5], 0.05),
            (1e30, 0.0, [0.0, 0.0], 0.05),
        ] {
            for ranges in [[wide, range], [range, wide]] {
                let found = limited(c, u, ranges, 1.0);
                assert!(found.abs() <= room && found.signum() == c.signum(), "{c} {u} {range:?}: {found}");
            }
        }
        assert!((limited(0.1, 0.0, [[-1.0, 1.0]; 2], 1.0) - 0.1).abs() < 1e-6, "with room enough nothing changes");
        assert_eq!(limited(0.0, 0.0, [[0.0; 2]; 2], 1.0), 0.0);
    }

    #[test]
    fn what_is_limited_is_not_cut_and_what_swings_beyond_is() {
        let range = [-1.0, 0.5];
        for (c, u) in [(2.0, 0.0), (-2.0, 0.0), (0.3, 0.4), (-9.0, 0.7), (1e30, 0.2)] {
            let found = limited(c, u, [range; 2], 1.0);
            assert!((cut(found, u, range, 1.0) - found).abs() < 1e-6, "{c} {u}: {found}");
        }
        assert_eq!(
            [cut(0.9, 0.0, range, 1.0), cut(-9.0, 0.0, range, 1.0), cut(0.2, 0.9, range, 1.0)],
            [0.55, -1.05, 0.05]
        );
    }

    #[test]
    fn from_a_contour_to_nothing_nothing_goes_on() {
        assert_eq!(
            [[0.5, 14.0], [-14.0, 1.0], [1.0, -3.0], [9.0, 0.0]].map(|d| goes_on(d, 14.0)),
            [0.0, 0.0, 1.0, 1.0]
        );
        assert!((0.4..0.6).contains(&goes_on([0.0, 0.89], 1.0)));
    }

    #[test]
    fn lengths_scale() {
        let [one, ten] = [1.0f32, 10.0].map(|s| limited(0.4 * s, 0.0, [[-0.3 * s, 0.2 * s]; 2], s) / s);
        assert!((one - ten).abs() < 1e-6, "{one} {ten}");
    }
}
