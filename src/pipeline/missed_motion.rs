//! Motions that the search for a displacement misses: it sees how contours lie where it begins, and a wall that has moved by more than its width lies
//! beside the wrong side of itself. Where a rigid motion of a part brings both slices together far better than what was found, the search between these two
//! is made once more, begins with that motion, and is drawn to it.
//!
//! Measured: tubes of radius 14 and 20 px with a wall of 4 px that lean by 1.2 to 2.1 radii a gap of 24 and 40 px had 0.15 to 0.62 of Dice between slices,
//! where the wall of one slice meets the other side of the next one's, and have 0.95 to 0.99; a C, a frame, a Y and an L that move by 22 to 25 px had 0.39 to
//! 0.58 and have 0.96 to 0.98. What is compact is left to the search, also where it lies apart: of 101 bodies of the evaluation a torus and a tube would lose
//! 0.009, and three others gain 0.001 to 0.004. Where every part that lies apart began with its rigid motion, which what bends does not follow, the torus
//! lost 0.014.

use std::sync::Arc;

use super::rigid_frames::{Apart, apart};
use crate::backend::Backend;
use crate::contour::Contour;
use crate::error::Result;
use crate::grid::field::{Field, position};
use crate::reference::displacement::ROUNDS;
use crate::registration::displacement::{Displacement, DisplacementJob};

/// Share of the area of the parts that lie apart by which fewer pixels have to differ. 36 scenes of rings and tubes that lean, bend, turn, grow, or pass others
/// have 0.9680 of Dice with half of it, 0.9678, and 0.9673 with twice as much; 51 bodies of the evaluation are the same.
const FAR_BETTER: f64 = 0.25;

/// The displacement of two slices where `found` misses it; parts are linked as `links` say, `h` are the pixels' sides.
///
/// # Errors
/// The errors of the backend.
pub(super) fn missed_motion(
    slices: [&Contour; 2],
    links: &[(u32, u32)],
    found: &Displacement,
    backend: &dyn Backend,
    h: [f64; 2],
) -> Result<Option<Displacement>> {
    let Some(Apart { displacement, area }) = apart(slices[0], slices[1], links, h) else { return Ok(None) };
    let differ = |v: &Displacement| differing(slices.map(|contour| &contour.phi), v) as f64;
    if differ(found) - differ(&displacement) <= FAR_BETTER * area {
        return Ok(None);
    }
    let fields = slices.map(|contour| Arc::new(contour.phi.clone()));
    let from = [displacement];
    let job = DisplacementJob { fields: &fields, gaps: &[1.0], guess: &from, begin: &from, rounds: 0..ROUNDS.len(), h };
    Ok(backend.displacements(&job)?.into_iter().next())
}

/// Pixels of the mid frame at which one slice is inside and the other is not.
fn differing([low, high]: [&Field; 2], v: &Displacement) -> usize {
    let inside = |n: &usize| {
        let x = position(*n, low.dims[0]);
        let half = 0.5 * v.at(x);
        (low.sample(x - half) < 0.0) != (high.sample(x + half) < 0.0)
    };
    (0..low.data.len()).filter(inside).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Reference;
    use glam::DVec2;

    const DIMS: [usize; 2] = [120, 70];

    /// A ring of these radii about (x, 35).
    fn ring(x: f64, [inner, outer]: [f64; 2]) -> Contour {
        let value = |i: usize, j: usize| {
            let away = libm::hypot(i as f64 - x, j as f64 - 35.0);
            (away - outer).max(inner - away)
        };
        Contour::new(0.0, Field::from_fn(DIMS, value), [1.0; 2], 1.0)
    }

    /// The displacement of rings that move `by` so much where the search from nowhere misses it.
    fn missed(by: f64, radii: [f64; 2]) -> Option<DVec2> {
        let slices = [50.0 - 0.5 * by, 50.0 + 0.5 * by].map(|x| ring(x, radii));
        let fields = slices.each_ref().map(|contour| Arc::new(contour.phi.clone()));
        let (h, from) = ([1.0; 2], [Displacement::zero(DIMS)]);
        let rounds = 0..ROUNDS.len();
        let job = DisplacementJob { fields: &fields, gaps: &[1.0], guess: &from, begin: &from, rounds, h };
        let found = Reference.displacements(&job).expect("nothing fails");
        let missed = missed_motion(slices.each_ref(), &[], &found[0], &Reference, h).expect("nothing fails");
        missed.map(|v| v.at(DVec2::new(50.0, 35.0)))
    }

    #[test]
    fn a_wall_that_lies_beside_its_other_side_is_found() {
        let v = missed(20.0, [11.0, 16.0]).expect("the search misses it");
        assert!((v - DVec2::new(20.0, 0.0)).length() < 0.5, "{v}");
    }

    #[test]
    fn what_the_search_finds_is_left_to_it() {
        assert_eq!(missed(2.0, [11.0, 16.0]), None, "the walls lie together");
        let slices = [40.0, 60.0].map(|x| ring(x, [11.0, 16.0]));
        let found = Displacement::zero(DIMS).map(|_, _, _| DVec2::new(19.0, 0.0));
        let again = missed_motion(slices.each_ref(), &[], &found, &Reference, [1.0; 2]).expect("nothing fails");
        assert!(again.is_none(), "they lie apart, but it was found nearly");
        assert_eq!(missed(22.0, [-16.0, 16.0]), None, "a disc");
    }
}
