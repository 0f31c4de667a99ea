//! A layer of many labels does not depend on which layers are asked for (P3): what floats between them is told by nodes of the slices.

use std::collections::BTreeMap;
use std::fs;

use crate::files::*;
use interslice::input::labels::{Wanted, read_labels};
use interslice::labels::{LabelStack, Plan, decide, reconstruct};
use interslice::settings::Method;
use interslice::stack::ReadOptions;
use interslice::surface::Layer;
use interslice::{Budget, Means, Reference, Settings, progress};

const SIZES: [usize; 3] = [44, 38, 17];
/// Stacks that are drawn.
const STACKS: u64 = 16;

/// Numbers drawn one after the other.
struct Draw(u64);

impl Draw {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % n
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.below(1 << 20) as f64 / f64::from(1 << 20)
    }
}

/// Cells of random points in an ellipsoid, each painted on every fourth slice, or each on slices of its own; random sides of the voxels.
fn cells(draw: &mut Draw) -> LabelStack {
    let [nx, ny, nz] = SIZES;
    let sides = [draw.within(0.3, 1.0), draw.within(0.3, 1.0), draw.within(0.5, 2.5)];
    let extent: [f64; 3] = std::array::from_fn(|a| SIZES[a] as f64 * sides[a]);
    let point = |draw: &mut Draw| -> [f64; 3] { std::array::from_fn(|a| draw.within(0.1, 0.9) * extent[a]) };
    let points: Vec<[f64; 3]> = (0..6 + draw.below(16)).map(|_| point(draw)).collect();
    let own = draw.below(3) == 0;
    let painted: Vec<[usize; 2]> =
        points.iter().map(|_| if own { [draw.below(3), 2 + draw.below(4)] } else { [0, 4] }).collect();
    let label = |n: usize| {
        let place = [n % nx, n / nx % ny, n / (nx * ny)];
        let at: [f64; 3] = std::array::from_fn(|a| place[a] as f64 * sides[a]);
        let share = |a: usize| ((at[a] - extent[a] / 2.0) / (extent[a] * [0.45, 0.45, 0.6][a])).powi(2);
        let off = |p: &[f64; 3]| (0..3).map(|a| (p[a] - at[a]).powi(2)).sum::<f64>();
        let nearest = (0..points.len()).min_by(|&a, &b| off(&points[a]).total_cmp(&off(&points[b]))).unwrap_or(0);
        let [from, every] = painted[nearest];
        let there = place[2] >= from && (place[2] - from).is_multiple_of(every);
        if there && (0..3).map(share).sum::<f64>() < 1.0 { nearest as u8 + 1 } else { 0 }
    };
    let voxels: Vec<u8> = (0..nx * ny * nz).map(label).collect();
    let place = folder();
    let path = place.path().join("labels.nrrd");
    let header = format!("spacings: {} {} {}\nencoding: raw", sides[0], sides[1], sides[2]);
    fs::write(&path, nrrd(&header, "uint8", SIZES, &voxels)).expect("a file can be written");
    read_labels(&path, &ReadOptions::default(), &Wanted::All).expect("it is sound")
}

/// The labels of the layers at these heights, by height in quarters of a slice; pixels that floated.
fn decided(stack: &LabelStack, settings: &Settings, quarters: &[usize]) -> (BTreeMap<usize, Vec<f32>>, u64) {
    let grid = stack.stack.z_out.expect("a volume has a grid");
    let heights: Vec<f64> = quarters.iter().map(|&q| grid.start + grid.step * q as f64 / 4.0).collect();
    let folder = std::env::temp_dir();
    let plan = Plan { heights: &heights, settings, folder: &folder, beside: 0, memory: None };
    let budget = Budget::unlimited();
    let means = Means { backend: &Reference, progress: &progress::Silent, budget: &budget };
    let bodies = reconstruct(stack, true, &plan, &means).expect("they can be computed");
    let mut layers = Vec::new();
    let mut keep = |layer: Layer| {
        layers.push(layer.dense());
        Ok(())
    };
    let decided = decide(stack, bodies, &plan, &mut keep).expect("they can be decided");
    assert_eq!(layers.len(), quarters.len(), "a layer for each height");
    (quarters.iter().copied().zip(layers).collect(), decided.borders.floating_pixels)
}

#[test]
fn p3_a_layer_of_labels_does_not_depend_on_the_others() {
    let mut draw = Draw(20261201);
    let mut floated = 0;
    for number in 0..STACKS {
        let stack = cells(&mut draw);
        let method = if number % 4 == 3 { Method::Field } else { Method::Morph };
        let settings = Settings { method, ..Settings::default() };
        let all: Vec<usize> = (0..=4 * (SIZES[2] - 1)).collect();
        let (fine, pixels) = decided(&stack, &settings, &all);
        floated += pixels;
        let single = 4 + draw.below(4 * (SIZES[2] - 3));
        let first = 8 + draw.below(30);
        let others = [
            all.iter().copied().step_by(4).collect(),
            all.iter().copied().filter(|q| q % 6 == 1).collect(),
            vec![first, first + 1, first + 2],
            vec![single],
        ];
        for asked in others {
            let (some, _) = decided(&stack, &settings, &asked);
            for (q, layer) in some {
                let differing = layer.iter().zip(&fine[&q]).filter(|(a, b)| a != b).count();
                assert_eq!(
                    differing,
                    0,
                    "stack {number}, layer at {q} quarters, of {} that are asked for",
                    asked.len()
                );
            }
        }
    }
    assert!(floated > 100, "{floated} px floated: nothing is tested");
}
