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

mod tail;

use std::ops::Range;

use glam::DVec2;

use self::tail::{AROUND, Beside, RIM, Tail, read};
use super::context::Context;
use super::links::IntervalLinks;
use crate::contour::Contour;
use crate::error::Result;
use crate::grid::field::{cell, position};
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::{Tile, samples};
use crate::grid::union::unite;
use crate::registration::displacement::Displacement;
use crate::registration::motion_field::{MotionField, Paths, time};
use crate::registration::motion_stack::MotionStack;
use crate::storage::spill::SpillVec;
use crate::surface::Layer;

/// How many times as long as the other one of two tails may be. Coils of pitch 12 and 16, every 5th and 6th slice: Dice .922 and .913 with 1.5,
/// .931 and .925 with 2, .934 and .925 with 4.
const ALIKE: f64 = 2.0;
/// Share of a part that its tail and what is common have at least: with half of a part a gyroid that changes too fast for its slices loses .005.
const WHOLE: f64 = 0.8;

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
        Slides { contours, moving, parted, h: run.h, pad: run.pad, px: run.px, limit, current: None }
    }

    /// Draws into the next layer what slides there.
    pub fn draw(&mut self, layer: &mut Layer) -> Result<()> {
        if let Some(i) = layer.contour {
            self.current = self.interval(i)?;
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
    fn interval(&self, i: usize) -> Result<Option<(Sliding, MotionField)>> {
        let none = |k: usize| k == self.contours.len() || self.contours.light(k).solids.count == 0;
        if none(i) || none(i + 1) {
            return Ok(None);
        }
        let slices = [self.contours.get(i)?, self.contours.get(i + 1)?];
        let slices = slices.each_ref().map(|slice| &**slice);
        let sliding = Sliding::new(slices, &*self.moving.at_slices(i)?, &self.parted[i], self.h);
        if sliding.is_empty() { Ok(None) } else { Ok(Some((sliding, self.moving.frame(i..i + 2)?))) }
    }
}

/// The tails of an interval by which its sections slide: those of the lower slice, and those of the upper one.
#[derive(Debug, Clone, Default)]
struct Sliding {
    tails: [Vec<Tail>; 2],
}

/// A tail, and the parts of the lower and upper slice that have it in common.
struct Found {
    pair: [u32; 2],
    tail: Tail,
}

impl Sliding {
    /// The sections that slide between two slices, but of the pairs of parts that are kept `apart`; `at_slices` is the displacement read at both.
    fn new([low, high]: [&Contour; 2], at_slices: &[Displacement; 2], apart: &[(u32, u32)], h: [f64; 2]) -> Self {
        let lower = found(low, high, (&at_slices[0], 1.0), h);
        if lower.is_empty() {
            return Sliding::default();
        }
        let mut upper = found(high, low, (&at_slices[1], -1.0), h);
        upper.iter_mut().for_each(|found| found.pair.reverse());
        let slides = |one: &Found, others: &[Found]| {
            let alike = |other: &Found| {
                let [a, b] = [one, other].map(|found| found.tail.length);
                other.pair == one.pair && a.max(b) <= ALIKE * a.min(b)
            };
            !apart.contains(&one.pair.into()) && others.iter().any(alike)
        };
        let tails = |own: &[Found], others: &[Found]| -> Vec<Tail> {
            own.iter().filter(|one| slides(one, others)).map(|one| one.tail.clone()).collect()
        };
        Sliding { tails: [tails(&lower, &upper), tails(&upper, &lower)] }
    }

    fn is_empty(&self) -> bool {
        self.tails.iter().all(Vec::is_empty)
    }

    /// Unites the layer at time `t`, which shows the padded image from pixel `pad` on, with the tails, whose distances count as what `change` makes of
    /// them; `paths` lead through it.
    fn draw(&self, phi: &mut SparseImage<f32>, pad: [usize; 2], paths: &Paths, t: f64, change: impl Fn(f64) -> f32) {
        let ways = [(&paths.come, -1.0, t), (&paths.go, 1.0, 1.0 - t)];
        for (tails, (way, sign, t)) in self.tails.iter().zip(ways) {
            for tail in tails {
                let values = tail.at(t);
                unite(phi, seen(tail.tile, way, pad, phi.dims()), |[i, j], out| {
                    for (k, v) in out.iter_mut().enumerate() {
                        let x = DVec2::new((i + pad[0] + k) as f64, (j + pad[1]) as f64);
                        *v = change(read(&values, tail.tile.to_local(x + sign * way.at(x))));
                    }
                });
            }
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

/// Tails of the parts of a slice beside another one, to which motion brings it, with the numbers of its own part and of that over which it begins.
fn found(own: &Contour, other: &Contour, (to, sign): (&Displacement, f64), h: [f64; 2]) -> Vec<Found> {
    let nx = own.phi.dims[0];
    let there = |n: usize| {
        let x = position(n, nx);
        x + sign * to.at(x)
    };
    let mut far = vec![false; own.solids.count + 1];
    let reach = to.largest() * std::f64::consts::SQRT_2;
    for (n, part) in own.solids.labels.iter().enumerate().filter(|(_, part)| **part > 0) {
        if !far[*part as usize] && other.phi.data[n] > RIM - reach {
            far[*part as usize] = other.phi.sample(there(n)) > RIM;
        }
    }
    let margin = samples(AROUND, h).map(|n| n.max(AROUND) + 1);
    let parts = (1..=own.solids.count as u32).filter(|part| far[*part as usize]);
    let by_depth = |a: &usize, b: &usize| other.phi.data[*a].total_cmp(&other.phi.data[*b]);
    let of_part = |part: u32| {
        let tile = own.tile_of(&[part], margin);
        let other_at = |n: usize| other.phi.sample(there(n));
        let beside = Beside {
            tile,
            h,
            own: tile.cut(&own.phi),
            other: tile.nodes(nx).map(other_at).collect(),
            part: tile.nodes(nx).map(|n| own.solids.labels[n] == part).collect(),
        };
        let over = |tail: Tail| {
            // What is common lies inside, so that at least one of the pixels around it does.
            let ([i, j], _) = cell(other.phi.dims, there(tail.root[1] * nx + tail.root[0]), 0);
            let n = j * nx + i;
            let deepest = [n, n + 1, n + nx, n + nx + 1].into_iter().min_by(by_depth)?;
            Some(Found { pair: [part, other.solids.labels[deepest]], tail })
        };
        beside.tails(WHOLE).into_iter().filter_map(over).collect::<Vec<_>>()
    };
    parts.flat_map(of_part).collect()
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
        let still = Displacement::zero(DIMS);
        Sliding::new([&bar(low[0], low[1]), &bar(high[0], high[1])], &[still.clone(), still], apart, [1.0; 2])
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
            !Sliding::new([&low, &bar(29.5, 59.5)], &still, &[], [1.0; 2]).is_empty()
        };
        assert!(slides(1.0) && !slides(8.0));
    }
}
