//! Displacements read pixel by pixel, by rows, and bounded.

use std::sync::Arc;

use glam::DVec2;
use interslice::registration::displacement::{Displacement, Resting};
use interslice::registration::motion_field::{MotionField, Paths, Place, time};

/// A row weighs its axes in the other order: vectors of 7 px differ by their last bits.
const ROUNDING: f64 = 1e-14;

/// Vectors that differ from block to block, for images whose sides are and are not whole blocks.
fn examples() -> impl Iterator<Item = ([usize; 2], Displacement)> {
    [[5, 3], [32, 16], [43, 29]].into_iter().map(|dims| {
        let wave = |x: DVec2| DVec2::new((0.3 * x.x + x.y).sin() * 7.0, (x.x - 0.2 * x.y).cos() * 5.0);
        (dims, Displacement::zero(dims).map(|_, x, _| wave(x)))
    })
}

#[test]
fn a_row_reads_as_its_pixels_do() {
    for ([nx, ny], v) in examples() {
        for (j, first) in (0..ny).flat_map(|j| (0..nx).map(move |first| (j, first))) {
            let mut row = vec![DVec2::NAN; nx - first];
            v.read_row(j, first, &mut row);
            for (i, found) in (first..).zip(row) {
                let alone = v.at(DVec2::new(i as f64, j as f64));
                let same = (found - alone).abs().cmplt(DVec2::splat(ROUNDING)).all();
                assert!(same, "{found:?} and {alone:?} at {i}, {j} of {nx} x {ny}, read from {first}");
            }
        }
    }
}

#[test]
fn bounds_hold_every_pixel_between() {
    for ([nx, ny], v) in examples() {
        for (x, y) in (0..ny).flat_map(|y| (0..nx).map(move |x| (x, y))) {
            let last = [(x + 6).min(nx - 1), (y + 4).min(ny - 1)];
            let [least, largest] = v.range([x, y], last);
            for (i, j) in (y..=last[1]).flat_map(|j| (x..=last[0]).map(move |i| (i, j))) {
                let found = v.at(DVec2::new(i as f64, j as f64));
                let held = found.cmpge(least).all() && found.cmple(largest).all();
                assert!(held, "{found:?} at {i}, {j} is not in {least:?} to {largest:?}");
            }
        }
    }
}

#[test]
fn trajectories_are_the_same_upside_down() {
    let (dims, heights) = ([43, 29], [0.0, 5.0, 6.5, 14.0]);
    let top = heights[3];
    let bent = |k: f64| {
        let wave = move |x: DVec2| DVec2::new((0.3 * x.x + x.y + k).sin() * 3.0, (x.x - 0.2 * x.y - k).cos() * 2.0);
        Displacement::zero(dims).map(|_, x, _| wave(x))
    };
    let displacements: Vec<Displacement> = [0.0, 1.0, 2.0].map(bent).to_vec();
    let turned = displacements.iter().rev().map(|v| v.map(|_, _, v| -v)).collect();
    let up = MotionField::new(heights.to_vec(), 1.0, Vec::new(), displacements);
    let down = MotionField::new(heights.map(|z| top - z).into_iter().rev().collect(), 1.0, Vec::new(), turned);
    // Below and above the slices, on all of them, and between.
    let layers = [-1.0, 0.0, 2.0, 5.0, 6.0, 6.5, 9.0, 14.0, 15.0];
    let place = |moving: &MotionField, z: f64| {
        let i = moving.heights.partition_point(|h| *h <= z).clamp(1, 3) - 1;
        let at_slices = Arc::new(moving.at_slices[i].each_ref().map(Resting::from));
        Place::new(moving, i, i, time(z, moving.heights[i], moving.heights[i + 1]), at_slices)
    };
    let carry = |moving: &MotionField, x: DVec2, (from, paths): &(Place, Paths), (to, _): &(Place, Paths)| {
        let between = from.interval.min(to.interval) + 1..from.interval.max(to.interval);
        let between: Vec<[Resting; 2]> = between.map(|i| moving.at_slices[i].each_ref().map(Resting::from)).collect();
        from.carry(paths.to_slices(x), to, &between.iter().collect::<Vec<_>>())
    };
    let places = layers.map(|z| (z, place(&up, z), place(&down, top - z)));
    for (z, from, from_turned) in &places {
        for (end, to, to_turned) in places.iter().filter(|p| p.0 != *z) {
            for x in (0..7).flat_map(|j| (0..10).map(move |i| DVec2::new(4.3 * f64::from(i), 4.1 * f64::from(j)))) {
                let a = carry(&up, x, from, to);
                let b = carry(&down, x, from_turned, to_turned);
                let off = (a - b).abs().max_element();
                assert!(off < 1e-9, "{a:?} and {b:?} from {x:?} at {z} to {end}");
            }
        }
    }
}
