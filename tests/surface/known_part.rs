//! Stacks of which a part is known, as within the border of a contour map: what closes a body beyond it has no part in how it ends.

use crate::shapes::*;
use interslice::backend::Backend;
use interslice::grid::tile::Tile;
use interslice::progress::Silent;
use interslice::settings::{EndRule, Method};
use interslice::{
    ContourStack, Known, LevelSlice, Reconstruction, Reference, Settings, Slice, SliceContent, reconstruct_with,
};

const N: usize = 96;
/// First column that is known, and pixels before it in which a body goes on as it comes, before it is closed.
const FIRST: usize = 40;
const BEYOND: usize = 8;
const KNOWN: Known = Known { part: Tile { origin: [FIRST, 0], dims: [N - FIRST, N] }, onward: BEYOND - 2 };
const HEIGHTS: [f64; 5] = [10.0, 14.0, 18.0, 22.0, 26.0];

/// Two bodies that end before the last slice, or at the first: a ball about the middle of the known part's edge, and half a spindle above it.
fn bodies(closed: bool) -> Vec<Shape> {
    let edge = FIRST as f64 - 0.5;
    let body = |z: f64| {
        let ball = circle(edge, 30.0, (20.0f64.powi(2) - (z - 26.0).powi(2)).sqrt());
        match 21.0 - 0.5 * (z - 10.0) {
            r if z < 20.0 => union(ball, circle(edge, 72.0, r)),
            _ => ball,
        }
    };
    // Whole, or closed so many pixels beyond.
    let wall = edge - BEYOND as f64;
    let cut = |shape: Shape| -> Shape { Box::new(move |x, y| shape(x, y).max(wall - x)) };
    HEIGHTS.iter().map(|z| if closed { cut(body(*z)) } else { body(*z) }).collect()
}

fn stack(closed: bool, known: Option<Known>) -> ContourStack {
    ContourStack { known, ..levels(N, &HEIGHTS, &bodies(closed)) }
}

fn run_on(backend: &dyn Backend, stack: &ContourStack, method: Method) -> Reconstruction {
    let settings = Settings { end_bottom: EndRule::Extrapolate, method, ..Settings::default() };
    let heights: Vec<f64> = (0..=26).map(f64::from).collect();
    reconstruct_with(stack, &heights, &settings, backend, &Silent).expect("a valid stack")
}

/// Pixels of the known part on which two bodies differ, and those of the first, on layers at these heights.
fn differing(a: &Reconstruction, b: &Reconstruction, heights: impl Fn(f64) -> bool) -> [usize; 2] {
    let (mut differing, mut inside) = (0, 0);
    for (a, b) in a.output_layers().zip(b.output_layers()).filter(|(a, _)| heights(a.z)) {
        for (i, j) in (0..N).flat_map(|j| (FIRST..N).map(move |i| (i, j))) {
            let sides = [a.phi.at(i, j) < 0.0, b.phi.at(i, j) < 0.0];
            differing += usize::from(sides[0] != sides[1]);
            inside += usize::from(sides[0]);
        }
    }
    [differing, inside]
}

#[test]
fn half_a_body_ends_as_the_whole_one_does() {
    for method in [Method::Morph, Method::Field] {
        let whole = run_on(&Reference, &stack(false, None), method);
        // The ball below its first slice, and the spindle between the slices where it ends.
        for heights in [0.0..10.0, 18.0..22.0] {
            let off = |known| {
                let [apart, of] =
                    differing(&whole, &run_on(&Reference, &stack(true, known), method), |z| heights.contains(&z));
                assert!(of > 300, "{of}");
                apart as f64 / of as f64
            };
            let [found, closed] = [off(Some(KNOWN)), off(None)];
            // Seen: nothing and 0.0025; where what closes them counts 0.39 and 0.018.
            assert!(found < 0.005 && closed > 0.012, "{method:?}, {heights:?}: {found}; all known {closed}");
        }
    }
}

#[test]
fn where_all_is_known_nothing_changes() {
    let all = Known { part: Tile { origin: [0; 2], dims: [N; 2] }, onward: 6 };
    for method in [Method::Morph, Method::Field] {
        let [known, plain] = [Some(all), None].map(|known| run_on(&Reference, &stack(false, known), method));
        for (a, b) in known.layers.iter().zip(&plain.layers) {
            assert!(a.phi.iter().zip(b.phi.iter()).all(|(a, b)| a == b), "{method:?}: height {}", a.z);
        }
    }
}

/// The stack with x and y exchanged.
fn transposed(stack: &ContourStack) -> ContourStack {
    let slice = |slice: &Slice| {
        let SliceContent::Level(level) = &slice.content else { panic!("level sets") };
        let values = level.values();
        let turned: Vec<f32> = (0..N * N).map(|n| values[n % N * N + n / N]).collect();
        Slice { content: SliceContent::Level(LevelSlice::new(&turned, N)), ..slice.clone() }
    };
    let flip = |[a, b]: [usize; 2]| [b, a];
    let known = stack.known.map(|Known { part, onward }| {
        let part = Tile { origin: flip(part.origin), dims: flip(part.dims) };
        Known { part, onward }
    });
    ContourStack { slices: stack.slices.iter().map(slice).collect(), known, ..stack.clone() }
}

#[test]
fn columns_are_as_rows() {
    let stack = stack(true, Some(KNOWN));
    for method in [Method::Morph, Method::Field] {
        let [own, turned] = [stack.clone(), transposed(&stack)].map(|stack| run_on(&Reference, &stack, method));
        let apart = own.layers.iter().zip(&turned.layers).map(|(a, b)| {
            let pixels = (0..N).flat_map(|j| (0..N).map(move |i| (i, j)));
            pixels.filter(|&(i, j)| (a.phi.at(i, j) < 0.0) != (b.phi.at(j, i) < 0.0)).count()
        });
        assert_eq!((own.layers.len(), apart.sum::<usize>()), (turned.layers.len(), 0), "{method:?}");
    }
}

#[cfg(feature = "gpu")]
#[test]
fn both_backends_end_it_alike() {
    use interslice::gpu::{Gpu, GpuOptions};
    let gpu = Gpu::open(&GpuOptions::default()).expect("a Vulkan driver (tests/run installs lavapipe)");
    let stack = stack(true, Some(KNOWN));
    for method in [Method::Morph, Method::Field] {
        let [gpu, cpu] = [&gpu as &dyn Backend, &Reference].map(|backend| run_on(backend, &stack, method));
        let near = |v: f32| v.abs() < 2.0;
        let pairs = gpu.layers.iter().zip(&cpu.layers).flat_map(|(a, b)| a.phi.iter().zip(b.phi.iter()));
        let apart = pairs.filter(|(_, b)| near(**b)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(gpu.layers.len() == cpu.layers.len() && apart < 2e-2, "{method:?}: {apart} px");
    }
}
