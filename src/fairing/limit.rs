//! Corrections that stay between their contours, and where there is one contour alone.

use crate::grid::spline::smoothstep;

/// Distance by which a correction may leave the range of its contours, px of the larger side.
const SLACK: f32 = 0.05;
/// Share of the way to the contour that a correction may take a pixel whose side does not change.
const MOST_OF: f32 = 0.9;

/// A correction c of a distance u that leaves the ranges of both contours' distances by no more than SLACK: with the room
/// `max(0, max(a, b) - u) + SLACK` above u, mirrored below, the narrower of the ranges along the trajectory and straight along z,
/// `c / (1 + (|c| / room)^8)^(1/8)`. What both contours have on one side along the trajectory stays there. `side` is the length of a pixel's larger side.
#[inline]
pub fn limited(c: f32, u: f32, [along, straight]: [[f32; 2]; 2], side: f32) -> f32 {
    let room = room(c, u, along, side).min(room(c, u, straight, side)).min(room_on_its_side(c, u, along));
    let ratio = (c / room).powi(2);
    let eighth = ratio.powi(4);
    // Beyond this the eighth root is the ratio itself, in single precision.
    if ratio > 100.0 { room.copysign(c) } else { c / (1.0 + eighth).sqrt().sqrt().sqrt() }
}

/// Correction cut off where the room ends: a curve through corrections that are [`limited`] may swing beyond them, the more the less the gaps on both
/// sides of a contour are alike, and is left alone where it does not.
#[inline]
pub fn cut(c: f32, u: f32, range: [f32; 2], side: f32) -> f32 {
    let room = room(c, u, range, side);
    c.clamp(-room, room)
}

/// Room of a distance u to move towards the side of c.
#[inline]
fn room(c: f32, u: f32, [a, b]: [f32; 2], side: f32) -> f32 {
    let own = if c > 0.0 { a.max(b) - u } else { u - a.min(b) };
    own.max(0.0) + SLACK * side
}

/// Room of a distance u to move towards the side of c without a change of sides, where it is on the side of both contours: pixels of specks lie nearer to
/// their contour than the slack, since none of them may change its side, and between two equal slices there would be others.
#[inline]
fn room_on_its_side(c: f32, u: f32, [a, b]: [f32; 2]) -> f32 {
    let [a, b, u] = [a, b, u].map(|v| v * c.signum());
    if a < 0.0 && b < 0.0 && u < 0.0 { MOST_OF * -u } else { f32::INFINITY }
}

/// A contour this much of the farthest distance that counts away leads nowhere.
const ALONE: [f64; 2] = [0.8, 0.98];

/// Share to which the surface goes on from one contour to another whose distances there are these, at most `farthest`: 1 where both have a surface, 0
/// where one has none.
#[inline]
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
    fn what_both_contours_have_on_one_side_along_the_trajectory_stays_there() {
        let others = [-5.0, 5.0];
        for (c, u, along) in [(-0.3, 0.01, [0.01, 0.02]), (-9.0, 0.03, [0.4, 0.01]), (-1e30, 0.01, [0.01; 2])] {
            for sign in [1.0, -1.0] {
                let (c, u, along) = (sign * c, sign * u, along.map(|v: f32| sign * v));
                assert!(u * (u + limited(c, u, [along, others], 1.0)) > 0.0, "{c} {u} {along:?}");
                // Straight along z a body may have come in between.
                assert!(u * (u + limited(c, u, [others, along], 1.0)) < 0.0, "{c} {u} {along:?}");
            }
        }
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
