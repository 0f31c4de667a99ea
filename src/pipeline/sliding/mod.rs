//! Sections that slide along themselves.
//!
//! A tube that lies nearly in the slices is cut in long sections. From one slice to the next such a section loses a [tail] at one end and gains one at
//! the other. No displacement says so, as between its ends the contour stays where it is; the particles of the tails die; and the
//! field takes a tail from its sides, thin as it is, so that in the middle of a gap hardly more is left than what both sections have in common.
//! So layers are united with what two neighbouring slices have of a part beyond each other, each tail as it goes back along itself, where a part loses one,
//! the part above it gains one about as long, and both consist of little else than it and what they have in common.
//!
//! Measured: Dice between the slices, without and with it, of tubes of radius 5 px in coils of radius 28 px: pitch 16, every 4th to 6th slice, .915, .876, .786 and
//! .965, .948, .925; pitch 24, every 5th, .940 and .966; pitch 36, every 6th, .942 and .962; pitch 60, every 6th, .978 both.
//!
//! Where such a tube begins or ends a section gains a tail and loses none. It slides, too, if it does so beyond: if in the next gap the part gains another
//! tail where this one ends, about as long for the height, and slides there or, likewise, in the gap after that. Measured on such coils of three turns
//! with both ends in the stack: pitch 16, every 4th to 6th slice, .965, .948, .925 without that and .968, .959, .933 with it; pitch 12, every 4th, .881 and
//! .893; pitch 24, every 5th, .966 and .968; a worm of radius 5 px every 3rd and 5th, .970, .931 and .972, .939.

mod candidates;
mod hollow;
mod tail;

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use glam::DVec2;

use self::candidates::Candidates;
use self::hollow::{FilledSlices, SlidingTubes, Tubes};
use self::tail::{Tail, read};
use super::context::Context;
use super::hollow::slice::HollowSlices;
use super::links::IntervalLinks;
use super::section::NEIGHBOURS;
use crate::contour::Contour;
use crate::error::Result;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::grid::union::{take_out, unite};
use crate::registration::displacement::Displacement;
use crate::registration::motion_field::{MotionField, Paths, time};
use crate::registration::motion_stack::MotionStack;
use crate::storage::spill::SpillVec;
use crate::surface::Layer;

/// Gaps beyond an interval that may say that a tail slides there: as many as sections of a stack know as the whole stack does.
const FOLLOWED: usize = NEIGHBOURS;

/// What slides in a stack, drawn into layers that come in order of height.
pub(super) struct Slides<'r, 'b> {
    contours: &'r SpillVec<'b, Contour>,
    moving: &'r MotionStack<'b>,
    /// Pairs of parts of every interval that are kept apart.
    parted: Vec<Vec<(u32, u32)>>,
    h: [f64; 2],
    pad: [usize; 2],
    px: f64,
    /// Distances are clamped to this, px.
    limit: f64,
    /// What slides in the interval of the layers that come, and the way through it.
    current: Option<(Sliding, MotionField)>,
    /// Tails of the intervals around it.
    known: BTreeMap<usize, Arc<Tails>>,
    filled: FilledSlices,
}

impl<'r, 'b> Slides<'r, 'b> {
    pub fn new(
        run: &Context<'b>,
        links: &[IntervalLinks],
        contours: &'r SpillVec<'b, Contour>,
        moving: &'r MotionStack<'b>,
    ) -> Self {
        let parted = links.iter().map(IntervalLinks::parted).collect();
        let limit = run.settings.margin() as f64;
        Slides {
            contours,
            moving,
            parted,
            h: run.h,
            pad: run.pad,
            px: run.px,
            limit,
            current: None,
            known: BTreeMap::new(),
            filled: FilledSlices::new(run.budget.is_bounded()),
        }
    }

    /// Draws into the next layer what slides there.
    pub fn draw(&mut self, layer: &mut Layer, hollow: &mut HollowSlices<'_, '_>) -> Result<()> {
        if let Some(i) = layer.contour {
            self.current = self.interval(i, hollow)?;
        } else if let Some((sliding, moving)) = &self.current {
            let t = time(layer.z, moving.heights[0], moving.heights[1]);
            sliding.draw(&mut layer.phi, self.pad, &moving.paths(0, t), t, |v| {
                let v = (v.max(-self.limit) * self.px) as f32;
                if v == 0.0 { f32::MIN_POSITIVE } else { v }
            });
        }
        Ok(())
    }

    /// What slides between contour `i` and the next, if anything does.
    fn interval(&mut self, i: usize, hollow: &mut HollowSlices<'_, '_>) -> Result<Option<(Sliding, MotionField)>> {
        self.known.retain(|k, _| k + FOLLOWED >= i);
        if i + 1 == self.contours.len() || self.tails(i, hollow)?.is_empty() {
            return Ok(None);
        }
        let last = self.contours.len() - 2;
        let around = i.saturating_sub(FOLLOWED)..=(i + FOLLOWED).min(last);
        let around = around.map(|k| Ok((k, self.tails(k, hollow)?))).collect::<Result<BTreeMap<_, _>>>()?;
        let sliding = Sliding::new(&around, i);
        if sliding.is_empty() { Ok(None) } else { Ok(Some((sliding, self.moving.frame(i..i + 2)?))) }
    }

    /// The tails that may slide between contour `i` and the next.
    fn tails(&mut self, i: usize, hollow: &mut HollowSlices<'_, '_>) -> Result<Arc<Tails>> {
        if let Some(known) = self.known.get(&i) {
            return Ok(known.clone());
        }
        let drawn = |k: usize| self.contours.light(k).solids.count > 0;
        let made = if drawn(i) && drawn(i + 1) {
            let slices = [self.contours.get(i)?, self.contours.get(i + 1)?];
            let (slices, gap) = (slices.each_ref().map(|slice| &**slice), self.moving.gap(i));
            let (at_slices, parted) = (self.moving.at_slices(i)?, &self.parted[i]);
            let solid = Candidates::new(slices, &at_slices, gap, parted, self.h);
            let hollow = if slices.iter().all(|contour| contour.holes > 0) {
                let hollow = [hollow.get(i)?, hollow.get(i + 1)?];
                let hollow = hollow.each_ref().map(|slice| &**slice);
                Tubes::new(i, slices, hollow, &mut self.filled, &at_slices, gap, parted, self.h)
            } else {
                None
            };
            Tails { solid, hollow }
        } else {
            Tails::default()
        };
        Ok(self.known.entry(i).or_insert(Arc::new(made)).clone())
    }
}

/// Tails of an interval's parts, and of those of them that are hollow.
#[derive(Default)]
struct Tails {
    solid: Candidates,
    hollow: Option<Tubes>,
}

impl Tails {
    fn is_empty(&self) -> bool {
        self.solid.is_empty() && self.hollow.is_none()
    }
}

/// The tails of an interval by which its sections slide: those of the lower slice, and those of the upper one.
#[derive(Debug, Clone, Default)]
struct Sliding {
    tails: [Vec<Tail>; 2],
    hollow: SlidingTubes,
}

impl Sliding {
    /// What slides in interval `i`, as the tails of the intervals `around` it say.
    fn new(around: &BTreeMap<usize, Arc<Tails>>, i: usize) -> Self {
        let Some(own) = around.get(&i) else { return Sliding::default() };
        let beyond: [Vec<&Tails>; 2] = [
            around.range(..i).rev().map(|(_, tails)| &**tails).collect(),
            around.range(i + 1..).map(|(_, tails)| &**tails).collect(),
        ];
        let hollow = own.hollow.as_ref().map_or_else(SlidingTubes::default, |tubes| {
            let beyond =
                beyond.each_ref().map(|tails| tails.iter().map_while(|t| t.hollow.as_ref()).collect::<Vec<_>>());
            tubes.sliding([&beyond[0], &beyond[1]])
        });
        let tails = |side: usize| -> Vec<Tail> {
            let beyond: Vec<&Candidates> = beyond[side].iter().map(|tails| &tails.solid).collect();
            let solid = own.solid.sliding(side, &beyond).into_iter().filter(|one| !hollow.pairs.contains(&one.pair));
            solid.map(|one| one.tail.clone()).collect()
        };
        Sliding { tails: [tails(0), tails(1)], hollow }
    }

    fn is_empty(&self) -> bool {
        self.tails.iter().all(Vec::is_empty) && self.hollow.pairs.is_empty()
    }

    /// Unites the layer at time `t`, which shows the padded image from pixel `pad` on, with the tails, whose distances count as what `change` makes of
    /// them; `paths` lead through it.
    fn draw(&self, phi: &mut SparseImage<f32>, pad: [usize; 2], paths: &Paths, t: f64, change: impl Fn(f64) -> f32) {
        let ways = [(&paths.come, -1.0, t), (&paths.go, 1.0, 1.0 - t)];
        let at = |[i, j]: [usize; 2], k: usize| DVec2::new((i + pad[0] + k) as f64, (j + pad[1]) as f64);
        let dims = phi.dims();
        let mut each = |sides: &[Vec<Tail>; 2], taken: bool| {
            for (tails, (way, sign, t)) in sides.iter().zip(ways) {
                for tail in tails {
                    let values = tail.at(t);
                    let of_row = |from: [usize; 2], out: &mut [f32]| {
                        for (k, v) in out.iter_mut().enumerate() {
                            let x = at(from, k);
                            *v = change(read(&values, tail.tile.to_local(x + sign * way.at(x))));
                        }
                    };
                    let covered = seen(tail.tile, way, pad, dims);
                    if taken { take_out(phi, covered, of_row) } else { unite(phi, covered, of_row) }
                }
            }
        };
        each(&self.tails, false);
        each(&self.hollow.filled, false);
        each(&self.hollow.holes, true);
        for held in &self.hollow.held {
            take_out(phi, seen(held.tile(0), &paths.come, pad, dims), |from, out| {
                for (k, v) in out.iter_mut().enumerate() {
                    let x = at(from, k);
                    *v = change(held.at([x - paths.come.at(x), x + paths.go.at(x)]));
                }
            });
        }
    }
}

/// Columns and rows of a layer that may show a tile of a slice, as far off as `way` leads at most.
fn seen(tile: Tile, way: &Displacement, pad: [usize; 2], dims: [usize; 2]) -> [Range<usize>; 2] {
    let reach = way.largest().ceil() as usize;
    [0, 1].map(|a| {
        let from = tile.origin[a].saturating_sub(reach + pad[a]).min(dims[a]);
        from..(tile.origin[a] + tile.dims[a] + reach).saturating_sub(pad[a]).clamp(from, dims[a])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;

    const DIMS: [usize; 2] = [70, 30];

    /// A bar between these columns, 8 px wide.
    fn bar(from: f64, to: f64) -> Contour {
        let value = |i: usize, j: usize| {
            let [x, y] = [(i as f64 - 0.5 * (from + to)).abs() - 0.5 * (to - from), (j as f64 - 14.5).abs() - 4.0];
            libm::hypot(x.max(0.0), y.max(0.0)) + x.max(y).min(0.0)
        };
        Contour::new(0.0, Field::from_fn(DIMS, value), [1.0; 2], 1.0)
    }

    /// What slides from one bar to the other where nothing else moves.
    fn sliding(low: [f64; 2], high: [f64; 2], apart: &[(u32, u32)]) -> Sliding {
        sliding_of(&[low, high], 0, apart)
    }

    /// What slides between bar `i` of some a height apart and the next.
    fn sliding_of(bars: &[[f64; 2]], i: usize, apart: &[(u32, u32)]) -> Sliding {
        let still = [Displacement::zero(DIMS), Displacement::zero(DIMS)];
        let bars: Vec<Contour> = bars.iter().map(|[from, to]| bar(*from, *to)).collect();
        let of = |k: usize| {
            Arc::new(Tails {
                solid: Candidates::new([&bars[k], &bars[k + 1]], &still, 1.0, apart, [1.0; 2]),
                hollow: None,
            })
        };
        Sliding::new(&(0..bars.len() - 1).map(|k| (k, of(k))).collect(), i)
    }

    #[test]
    fn a_bar_that_gains_at_one_end_what_it_loses_at_the_other_slides() {
        let sliding = sliding([9.5, 39.5], [29.5, 59.5], &[]);
        let lengths = sliding.tails.each_ref().map(|tails| tails.iter().map(|tail| tail.length).collect::<Vec<_>>());
        assert!(lengths.iter().all(|l| l.len() == 1 && (l[0] - 19.5).abs() < 0.6), "{lengths:?}");
        let still = Paths { come: Displacement::zero(DIMS), go: Displacement::zero(DIMS) };
        for (t, ends) in [(0.0, [10, 39]), (0.25, [15, 44]), (0.5, [20, 49]), (1.0, [30, 59])] {
            let both: Vec<f32> = bar(29.5, 39.5).phi.data.iter().map(|v| *v as f32).collect();
            let mut layer = SparseImage::of(DIMS, &both);
            sliding.draw(&mut layer, [0; 2], &still, t, |v| v as f32);
            let inside: Vec<usize> = (0..DIMS[0]).filter(|i| layer.at(*i, 14) < 0.0).collect();
            let found = [inside[0], inside[inside.len() - 1]];
            assert!(
                found.iter().zip(ends).all(|(found, end)| found.abs_diff(end) <= 1),
                "{t}: {found:?}, not {ends:?}"
            );
            assert_eq!(inside.len(), found[1] - found[0] + 1, "in one piece");
        }
    }

    #[test]
    fn nothing_slides_that_only_shrinks_or_is_short_or_is_kept_apart() {
        assert!(sliding([9.5, 59.5], [29.5, 59.5], &[]).is_empty(), "it loses a tail and gains none");
        assert!(sliding([9.5, 39.5], [18.5, 48.5], &[]).is_empty(), "tails as long as wide");
        assert!(sliding([9.5, 39.5], [29.5, 59.5], &[(1, 1)]).is_empty());
        assert!(sliding([9.5, 59.5], [29.5, 69.5], &[(1, 1)]).is_empty());
        assert!(sliding([4.5, 24.5], [39.5, 59.5], &[]).is_empty(), "nothing in common");
    }

    #[test]
    fn a_bar_that_only_gains_slides_as_it_goes_on_beyond() {
        let counts = |bars: &[[f64; 2]], i: usize| sliding_of(bars, i, &[]).tails.map(|tails| tails.len());
        let one = [[9.5, 23.5], [9.5, 37.5], [23.5, 51.5], [37.5, 65.5]];
        assert_eq!(counts(&one[..2], 0), [0, 0], "nothing says that it slides");
        assert_eq!([0, 1].map(|i| counts(&one, i)), [[0, 1], [1, 1]]);
        let down: Vec<[f64; 2]> = one.into_iter().rev().collect();
        assert_eq!([1, 2].map(|i| counts(&down, i)), [[1, 1], [1, 0]]);
        let gains_twice = [[4.5, 17.5], [4.5, 30.5], [4.5, 43.5], [17.5, 56.5]];
        assert_eq!(counts(&gains_twice, 0), [0, 1], "two gaps beyond");
        assert_eq!(counts(&gains_twice[..3], 0), [0, 0]);
        assert_eq!(counts(&[[23.5, 37.5], [9.5, 37.5], [23.5, 51.5]], 0), [0, 0], "at the end that it loses beyond");
        assert_eq!(counts(&[[5.5, 13.5], [5.5, 49.5], [20.5, 64.5]], 0), [0, 0], "faster than beyond");
    }

    #[test]
    fn a_part_of_which_much_is_neither_common_nor_a_tail_is_no_section() {
        // A T, of which the bar slides.
        let with_arm = |contour: Contour, wide: f64| {
            let arm = |n: usize| {
                let [i, j] = [n % DIMS[0], n / DIMS[0]].map(|k| k as f64);
                ((i - 34.5).abs() - 0.5 * wide).max((j - 14.5).abs() - 13.0)
            };
            let data = contour.phi.data.iter().enumerate().map(|(n, v)| v.min(arm(n))).collect();
            Contour::new(0.0, Field { dims: DIMS, data }, [1.0; 2], 1.0)
        };
        let still = [Displacement::zero(DIMS), Displacement::zero(DIMS)];
        let slides = |wide: f64| {
            let low = with_arm(bar(9.5, 39.5), wide);
            let solid = Candidates::new([&low, &bar(29.5, 59.5)], &still, 1.0, &[], [1.0; 2]);
            let tails = Tails { solid, hollow: None };
            !Sliding::new(&BTreeMap::from([(0, Arc::new(tails))]), 0).is_empty()
        };
        assert!(slides(1.0) && !slides(8.0));
    }
}
