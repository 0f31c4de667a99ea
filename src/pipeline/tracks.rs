//! Jobs of the trace stage, made of contours, and their measurements, seed by seed of each contour.

use std::borrow::Cow;

use crate::backend::jobs::{TraceJob, Traced, Track};
use crate::contour::Contour;
use crate::contour::direction::Direction;
use crate::contour::seeds::Seed;
use crate::contour::unmatched::{HALF_WAY, LonePart};
use crate::pipeline::matching::{GroupFields, Interval};
use crate::registration::mid_frame::Frame;
use crate::storage::spill::{Array, Large};

/// Measurements of the morph towards one neighbour, for each seed of a contour.
#[derive(Debug, Clone)]
pub struct SideTracks {
    /// One per seed; landing in pixels of the padded image.
    pub tracks: Vec<Track>,
    /// The seed's part has no partner on this side.
    pub lone: Vec<bool>,
}

impl SideTracks {
    /// All seeds of a contour without any partner. A part of depth D that closes at the share e of the gap has S = -D / e.
    fn without_partner<'p>(contour: &Contour, parts: impl Iterator<Item = &'p LonePart>) -> Self {
        let still = |s: &Seed| Track { distance: 0.0, arc: 0.0, landing: s.x, kept: 0.0 };
        let mut tracks: Vec<Track> = contour.seeds.iter().map(still).collect();
        for part in parts {
            part.seeds.iter().for_each(|&k| tracks[k as usize].distance = -part.depth / part.closes);
        }
        SideTracks { tracks, lone: vec![true; contour.seeds.len()] }
    }

    /// The distance of a seed at a hole of this depth that closes, half way.
    fn closing_hole(depth: f64) -> f64 {
        depth / HALF_WAY
    }
}

/// Measurements in an interval; nothing where it was not traced.
#[derive(Debug, Clone, Default)]
pub struct Sides {
    /// Upward, of the contour below.
    pub up: Option<SideTracks>,
    /// Downward, of the contour above.
    pub down: Option<SideTracks>,
}

impl Large for Sides {
    fn arrays(&mut self) -> Vec<Array<'_>> {
        let both = [&mut self.up, &mut self.down].into_iter().flatten();
        both.flat_map(|side| [&mut side.tracks as Array<'_>, &mut side.lone]).collect()
    }
}

/// The morph of one end of a group onto the other, with those of the contour's seeds that take part.
pub fn trace_job<'a>(group: &'a GroupFields, seeds: &[Seed], direction: Direction) -> TraceJob<'a> {
    let (source, goal) = match direction {
        Direction::Up => (&group.low, &group.high),
        Direction::Down => (&group.high, &group.low),
    };
    let seeds = source
        .seeds
        .iter()
        .map(|&k| {
            let mut seed = seeds[k as usize];
            seed.x = group.tile.to_local(seed.x);
            seed
        })
        .collect();
    TraceJob { source: Cow::Borrowed(&source.phi), goal: Cow::Borrowed(&goal.phi), seeds }
}

/// The tracks of the morphs of an interval, brought to the seeds of its contours: upward of the lower one, downward of the upper one. Seeds
/// that no morph carried have no partner on that side. Takes two of `traced` for every group.
pub fn sides(
    [low, high]: [&Contour; 2],
    interval: &Interval,
    frame: &Frame,
    traced: &mut impl Iterator<Item = Traced>,
) -> [SideTracks; 2] {
    let lone = |direction| interval.lone.iter().filter(move |part| part.direction == direction);
    let mut sides = [
        SideTracks::without_partner(low, lone(Direction::Up)),
        SideTracks::without_partner(high, lone(Direction::Down)),
    ];
    for group in &interval.groups {
        let ends = [(0, &group.low, Direction::Up), (1, &group.high, Direction::Down)];
        for ((at, end, direction), result) in ends.into_iter().zip(traced.by_ref()) {
            let side = &mut sides[at];
            for (&k, track) in end.seeds.iter().zip(&result.tracks) {
                let x = group.tile.to_image(track.landing);
                let landing = if direction == Direction::Up { frame.up(x) } else { frame.down(x) };
                side.tracks[k as usize] = Track { landing, ..*track };
                side.lone[k as usize] = false;
            }
            for hole in group.holes.iter().filter(|h| h.direction == direction) {
                for &k in &hole.seeds {
                    side.tracks[k as usize].distance = SideTracks::closing_hole(hole.depth);
                }
            }
        }
    }
    sides
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;

    #[test]
    fn a_seed_without_partner_goes_inward_as_far_as_its_part_is_deep_where_that_ends() {
        let disc = |i: usize, j: usize| libm::hypot(i as f64 - 15.0, j as f64 - 15.0) - 6.0;
        let contour = Contour::new(0.0, Field::from_fn([31, 31], disc), [1.0; 2], 1.0);
        assert!(contour.seeds.len() > 8);
        let tile = contour.tile_of(&[1], [8; 2]);
        let field = tile.cut(&contour.phi);
        let part = LonePart { closes: 0.25, ..LonePart::new(tile, field, vec![0, 3], Direction::Up) };
        let side = SideTracks::without_partner(&contour, std::iter::once(&part));
        let distances: Vec<f64> = side.tracks.iter().map(|track| track.distance).take(5).collect();
        assert_eq!(distances, [-24.0, 0.0, 0.0, -24.0, 0.0], "6 px deep, gone after a quarter of the gap");
        assert!(side.lone.iter().all(|lone| *lone) && side.tracks.iter().all(|track| track.kept == 0.0));
    }
}
