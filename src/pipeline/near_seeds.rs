//! The seeds of a contour that are nearest to a position.
//!
//! They lie in the cells of a grid, about a quarter of a seed in each, and cells are looked at ring by ring around the position. Seeds that are equally far
//! come in the order in which a tree finds them, which is asked only then: the order decides which of them count.

use std::sync::OnceLock;

use glam::DVec2;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use crate::contour::seeds::Seed;

/// Cells a seed.
const CELLS: f64 = 4.0;
/// Shortest side of a cell, px.
const SHORTEST: f64 = 1.0;
/// What a seed may lie beyond the edge of its cell by rounding, px: far more than that.
const ROUNDING: f64 = 1e-6;

type Tree = RTree<GeomWithData<[f64; 2], u32>>;

/// The seeds of a contour, to be found by where they are.
pub(super) struct NearSeeds {
    /// Places, px of the larger side, and numbers, cell by cell.
    seeds: Vec<(DVec2, u32)>,
    /// Number of the first of each cell, and behind the last of all.
    starts: Vec<u32>,
    cells: [usize; 2],
    origin: DVec2,
    side: f64,
    tree: OnceLock<Tree>,
}

impl NearSeeds {
    /// Those of a contour, `h` the sides of a pixel.
    pub fn new(seeds: &[Seed], h: [f64; 2]) -> Self {
        let places: Vec<DVec2> = seeds.iter().map(|seed| seed.x * DVec2::from(h)).collect();
        let origin = places.iter().copied().reduce(DVec2::min).unwrap_or_default();
        let size = places.iter().copied().reduce(DVec2::max).unwrap_or_default() - origin;
        let side = (size.x.max(SHORTEST) * size.y.max(SHORTEST) / (CELLS * places.len().max(1) as f64)).sqrt();
        let side = side.max(SHORTEST);
        let cells = [size.x, size.y].map(|length| (length / side) as usize + 1);
        let mut near = NearSeeds { seeds: Vec::new(), starts: Vec::new(), cells, origin, side, tree: OnceLock::new() };
        let cell = |x: DVec2| {
            let [i, j] = near.cell(x);
            j * cells[0] + i
        };
        let mut starts = vec![0u32; cells[0] * cells[1] + 1];
        places.iter().for_each(|x| starts[cell(*x) + 1] += 1);
        (1..starts.len()).for_each(|k| starts[k] += starts[k - 1]);
        let mut sorted = vec![(DVec2::ZERO, 0); places.len()];
        let mut next = starts.clone();
        for (x, number) in places.iter().zip(0..) {
            let place = &mut next[cell(*x)];
            sorted[*place as usize] = (*x, number);
            *place += 1;
        }
        (near.seeds, near.starts) = (sorted, starts);
        near
    }

    /// Number of seeds.
    pub fn len(&self) -> usize {
        self.seeds.len()
    }

    /// The cell of a position, the nearest one beyond the grid.
    fn cell(&self, x: DVec2) -> [usize; 2] {
        let at = (x - self.origin) / self.side;
        [0, 1].map(|a| (at[a].max(0.0) as usize).min(self.cells[a] - 1))
    }

    /// Numbers of the `N` nearest seeds to `x`, or of all if there are fewer, and the squares of their distances, the nearest first.
    pub fn nearest<const N: usize>(&self, x: DVec2) -> Vec<(u32, f64)> {
        let mut found = Found { seeds: Vec::with_capacity(N + 2), wanted: N + 1 };
        let [i, j] = self.cell(x).map(|n| n as isize);
        let [columns, rows] = self.cells.map(|n| n as isize);
        for ring in 0..columns.max(rows) {
            let across = i - ring..=i + ring;
            for row in (j - ring).max(0)..=(j + ring).min(rows - 1) {
                if row == j - ring || row == j + ring {
                    self.look((*across.start()).max(0)..=(*across.end()).min(columns - 1), row, x, &mut found);
                } else {
                    let ends = [*across.start(), *across.end()].into_iter().filter(|end| (0..columns).contains(end));
                    ends.for_each(|end| self.look(end..=end, row, x, &mut found));
                }
            }
            // What has not been looked at lies beyond the ring's edges.
            let place = (x - self.origin) / self.side;
            let edge = |at: f64, cell: isize| (at - (cell - ring) as f64).min((cell + ring + 1) as f64 - at);
            let within = edge(place.x, i).min(edge(place.y, j)) * self.side - ROUNDING;
            if within > 0.0 && found.farthest().is_some_and(|farthest| farthest < within * within) {
                break;
            }
        }
        let mut seeds = found.seeds;
        let alike = seeds.windows(2).any(|pair| pair[0].1 == pair[1].1);
        if alike || seeds.len() < self.len().min(N + 1) {
            let tree = self.tree.get_or_init(|| {
                let mut seeds = self.seeds.clone();
                seeds.sort_unstable_by_key(|(_, number)| *number);
                RTree::bulk_load(seeds.into_iter().map(|(x, k)| GeomWithData::new(x.into(), k)).collect())
            });
            return tree.nearest_neighbor_iter_with_distance_2(x.into()).take(N).map(|(p, d2)| (p.data, d2)).collect();
        }
        seeds.truncate(N);
        seeds
    }

    /// Adds the seeds in some cells of a row of them.
    fn look(&self, columns: std::ops::RangeInclusive<isize>, row: isize, x: DVec2, found: &mut Found) {
        let of = |column: isize| row as usize * self.cells[0] + column as usize;
        if columns.is_empty() {
            return;
        }
        let seeds = self.starts[of(*columns.start())] as usize..self.starts[of(*columns.end()) + 1] as usize;
        for (place, number) in &self.seeds[seeds] {
            let way = *place - x;
            found.add(*number, way.x * way.x + way.y * way.y);
        }
    }
}

/// The nearest seeds so far, the nearest first.
struct Found {
    seeds: Vec<(u32, f64)>,
    wanted: usize,
}

impl Found {
    fn add(&mut self, number: u32, distance: f64) {
        if self.farthest().is_some_and(|farthest| distance >= farthest) {
            return;
        }
        let place = self.seeds.iter().rposition(|(_, nearer)| *nearer <= distance).map_or(0, |k| k + 1);
        self.seeds.insert(place, (number, distance));
        self.seeds.truncate(self.wanted);
    }

    /// The square of the distance of the last that is wanted.
    fn farthest(&self) -> Option<f64> {
        self.seeds.get(self.wanted - 1).map(|(_, distance)| *distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_seeds_are_those_that_a_tree_finds() {
        let mut state = 1u64;
        let mut random = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        for count in [0, 1, 4, 5, 6, 7, 60, 700] {
            // On a circle, which leaves most cells empty, anywhere, and on pixels, where many are equally far or the same.
            for kind in 0..3 {
                let mut at = |k: usize| match kind {
                    0 => DVec2::from_angle(k as f64 * 0.7).mul_add(DVec2::splat(80.0), DVec2::splat(100.0)),
                    1 => DVec2::new(random() * 200.0, random() * 30.0),
                    _ => DVec2::new((random() * 20.0).round(), (random() * 20.0).round()),
                };
                let seeds: Vec<Seed> = (0..count).map(|k| Seed { x: at(k), inside: 0, outside: 0 }).collect();
                let h = [1.0, 0.75];
                let points = seeds.iter().zip(0..).map(|(s, k)| GeomWithData::new((s.x * DVec2::from(h)).into(), k));
                let tree: Tree = RTree::bulk_load(points.collect());
                let near = NearSeeds::new(&seeds, h);
                for k in 0..200 {
                    let x = match k % 3 {
                        0 => DVec2::new(random() * 300.0 - 50.0, random() * 300.0 - 50.0),
                        1 => DVec2::new((random() * 20.0).round(), (random() * 20.0).round() * 0.75),
                        _ => seeds.get(k).map_or(DVec2::ZERO, |seed| seed.x * DVec2::from(h) + 0.3 * random()),
                    };
                    let expected = tree.nearest_neighbor_iter_with_distance_2(x.into()).take(5);
                    let expected: Vec<(u32, f64)> = expected.map(|(p, d2)| (p.data, d2)).collect();
                    assert_eq!(near.nearest::<5>(x), expected, "{count}, {kind}, {x}");
                }
            }
        }
    }
}
