//! What a layer between contours may depend on: not on the layers that are asked for beside it, little on the Courant number, and not on how
//! the body lies; and that nothing jumps beside a contour.

use crate::shapes::zoo::{bar, disc};
use crate::shapes::*;
use interslice::grid::sparse_image::SparseImage;
use interslice::progress::Silent;
use interslice::settings::{Method, Motion};
use interslice::stack::SliceContent;
use interslice::surface::Layer;
use interslice::{Backend, ContourStack, Reference, Settings, reconstruct_with};

const N: usize = 90;
/// Distance between contours, px.
const GAP: f64 = 8.0;

/// Layers are compared where either is this close to its surface, px.
const NEAR: f32 = 1.5;
/// Largest jump of slope within an interval, px per layer at 32 layers a gap. Measured 0.026; where fronts between two steps are read from
/// straight lines it is 0.048.
const CREASE: f32 = 0.028;

/// Stacks in which parts divide or join.
const BRANCHING: [&str; 2] = ["branching", "three to one"];

fn stacks() -> Vec<(&'static str, ContourStack)> {
    let of = |shapes: &[Shape]| masks(N, &(0..shapes.len()).map(|k| GAP * k as f64).collect::<Vec<_>>(), shapes);
    vec![
        ("concentric", of(&[disc(45.0, 45.0, 9.0), disc(45.0, 45.0, 17.0), disc(45.0, 45.0, 12.0)])),
        ("slanted", of(&[disc(40.0, 33.0, 13.0), disc(42.0, 42.0, 14.0), disc(44.0, 54.0, 12.0)])),
        ("stars", of(&[star(45.0, 44.0, 16.0, 0.2, 0.3), star(44.0, 45.0, 20.0, 0.1, 1.0), disc(45.0, 45.0, 13.0)])),
        (
            "hole",
            of(&[
                disc(45.0, 45.0, 25.0),
                without(disc(45.0, 45.0, 26.0), disc(41.0, 48.0, 9.0)),
                disc(45.0, 45.0, 23.0),
            ]),
        ),
        (
            "branching",
            of(&[
                disc(45.0, 45.0, 16.0),
                union(disc(43.0, 29.0, 10.0), disc(48.0, 60.0, 11.0)),
                union(disc(40.0, 25.0, 8.0), disc(47.0, 65.0, 8.0)),
            ]),
        ),
        (
            "three to one",
            of(&[
                union(union(disc(30.0, 31.0, 9.0), disc(33.0, 60.0, 10.0)), disc(60.0, 45.0, 9.0)),
                disc(43.0, 46.0, 19.0),
            ]),
        ),
    ]
}

fn of(stack: &ContourStack, heights: &[f64], settings: &Settings, backend: &dyn Backend) -> Vec<Layer> {
    let body = reconstruct_with(stack, heights, settings, backend, &Silent).expect("the stack is valid");
    body.layers.into_iter().filter(|l| l.output).collect()
}

/// Heights from `low` to `high`, `dz` apart.
fn grid(low: f64, high: f64, dz: f64) -> Vec<f64> {
    (0..=((high - low) / dz).round() as usize).map(|k| low + dz * k as f64).collect()
}

fn top(stack: &ContourStack) -> f64 {
    stack.slices[stack.slices.len() - 1].z
}

/// Largest difference near the surface, and pixels on the other side.
fn difference(a: &[f32], b: &[f32]) -> (f32, usize) {
    assert_eq!(a.len(), b.len());
    let near = a.iter().zip(b).filter(|(a, b)| a.abs().min(b.abs()) < NEAR);
    let worst = near.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    (worst, a.iter().zip(b).filter(|(a, b)| (**a < 0.0) != (**b < 0.0)).count())
}

/// The same over all layers at common heights, of which there must be some.
fn differences(a: &[Layer], b: &[Layer]) -> (f32, usize) {
    let mut common = 0;
    let mut out = (0.0f32, 0);
    for layer in a {
        for other in b.iter().filter(|other| other.z == layer.z) {
            let (worst, sides) = difference(&layer.dense(), &other.dense());
            (out.0, out.1, common) = (out.0.max(worst), out.1 + sides, common + 1);
        }
    }
    assert!(common > 0, "no height is common");
    out
}

fn ways() -> Vec<(&'static str, Settings)> {
    vec![
        ("plain", plain()),
        ("moving", Settings { motion: Motion::Field, ..plain() }),
        ("field", Settings { method: Method::Field, motion: Motion::Field, ..plain() }),
    ]
}

/// P3: at common heights a layer is the same, whatever other layers are asked for.
fn layers_stand_alone(backend: &dyn Backend, bound: f32) {
    for (name, stack) in stacks() {
        for (way, settings) in ways() {
            let coarse = of(&stack, &grid(0.0, top(&stack), 1.0), &settings, backend);
            let others = [
                ("dz .5", grid(0.0, top(&stack), 0.5)),
                ("dz .125", grid(0.0, top(&stack), 0.125)),
                ("three layers", vec![2.0, 3.0, 4.0]),
                ("one layer", vec![5.0]),
            ];
            for (which, heights) in others {
                let (worst, sides) = differences(&coarse, &of(&stack, &heights, &settings, backend));
                println!("{name}, {way}, {which}: {worst:.1e} px, {sides} on the other side");
                assert!(worst <= bound, "{name}, {way}, {which}: {worst} px");
            }
        }
    }
}

#[test]
fn p3_a_layer_does_not_depend_on_the_layers_asked_for() {
    layers_stand_alone(&Reference, 1e-4);
}

#[cfg(feature = "gpu")]
#[test]
fn p3_a_layer_does_not_depend_on_the_layers_asked_for_on_a_gpu() {
    layers_stand_alone(&gpu(), 2e-3);
}

#[cfg(feature = "gpu")]
fn gpu() -> interslice::gpu::Gpu {
    interslice::gpu::Gpu::open(&interslice::gpu::GpuOptions::default())
        .expect("a Vulkan driver (tests/run installs lavapipe)")
}

/// Slopes along z change evenly within an interval: steps of the sweeps leave no creases between layers 32 to a gap.
#[test]
fn steps_leave_no_creases() {
    for (name, stack) in stacks().into_iter().filter(|(name, _)| ["concentric", "slanted", "stars"].contains(name)) {
        let layers = of(&stack, &grid(0.0, GAP, GAP / 32.0), &plain(), &Reference);
        let mut worst = 0.0f32;
        for three in layers.windows(3) {
            for ((a, b), c) in three[0].phi.iter().zip(three[1].phi.iter()).zip(three[2].phi.iter()) {
                if b.abs() < 0.75 {
                    worst = worst.max((a - 2.0 * b + c).abs());
                }
            }
        }
        println!("{name}: slope changes by up to {worst:.4} px per layer");
        assert!(worst <= CREASE, "{name}: {worst} px per layer");
    }
}

/// Beside a contour the body is the contour (P7: also where a sweep vanishes).
fn beside_contours(backend: &dyn Backend, bound: f32) {
    let lines = masks(N, &[0.0, GAP], &[bar(1.0, 0.0), bar(1.0, std::f64::consts::FRAC_PI_2)]);
    for (name, stack) in stacks().into_iter().chain([("crossing lines", lines)]) {
        let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
        let small = 5e-4 * GAP;
        let beside = z.iter().flat_map(|z| [z - small, *z, z + small]).filter(|x| *x >= 0.0 && *x <= top(&stack));
        let layers = of(&stack, &beside.collect::<Vec<_>>(), &plain(), backend);
        for pair in layers.windows(2).filter(|pair| pair[1].z - pair[0].z < 2.0 * small) {
            let (worst, _) = difference(&pair[0].dense(), &pair[1].dense());
            println!("{name}: {worst:.1e} px between {} and {}", pair[0].z, pair[1].z);
            assert!(worst <= bound, "{name}: {worst} px between {} and {}", pair[0].z, pair[1].z);
        }
    }
}

#[test]
fn p7_beside_a_contour_lies_the_contour() {
    beside_contours(&Reference, 0.02);
}

#[cfg(feature = "gpu")]
#[test]
fn p7_beside_a_contour_lies_the_contour_on_a_gpu() {
    beside_contours(&gpu(), 0.02);
}

/// P8: half the Courant number changes little. (Where parts divide or join it may change more.)
#[test]
fn p8_half_the_courant_number_changes_little() {
    for (name, stack) in stacks().into_iter().filter(|(name, _)| !BRANCHING.contains(name)) {
        let heights = grid(0.0, top(&stack), 0.5);
        let with = |cfl: f64| of(&stack, &heights, &Settings { cfl, ..plain() }, &Reference);
        let (worst, sides) = differences(&with(0.5), &with(0.25));
        println!("{name}: {worst:.3} px, {sides} on the other side");
        assert!(worst <= 0.05, "{name}: {worst} px");
    }
}

/// A change of the image's axes.
type Turn = fn([usize; 2]) -> [usize; 2];

fn turned(stack: &ContourStack, turn: Turn) -> ContourStack {
    let mut out = stack.clone();
    for slice in &mut out.slices {
        let mut inside = vec![false; N * N];
        slice.content.read(0, &mut inside);
        let moved: Vec<bool> = (0..N * N).map(|n| turn([n % N, n / N])).map(|[i, j]| inside[j * N + i]).collect();
        slice.content = SliceContent::Mask(moved.into_iter().collect());
    }
    out
}

/// P6: the same body however it lies.
#[test]
fn p6_turned_mirrored_or_transposed_it_is_the_same_body() {
    let turns: [(&str, Turn); 4] = [
        ("mirrored in x", |[i, j]| [N - 1 - i, j]),
        ("mirrored in y", |[i, j]| [i, N - 1 - j]),
        ("transposed", |[i, j]| [j, i]),
        ("turned", |[i, j]| [N - 1 - j, i]),
    ];
    for (name, stack) in stacks() {
        let heights = grid(0.0, top(&stack), 1.0);
        let straight = of(&stack, &heights, &plain(), &Reference);
        for (which, turn) in turns {
            let other = of(&turned(&stack, turn), &heights, &plain(), &Reference);
            let back: Vec<Layer> = straight
                .iter()
                .map(|l| {
                    let phi = (0..N * N).map(|n| turn([n % N, n / N])).map(|[i, j]| l.phi.at(i, j));
                    Layer { phi: SparseImage::of([N; 2], &phi.collect::<Vec<_>>()), ..l.clone() }
                })
                .collect();
            let (worst, sides) = differences(&other, &back);
            println!("{name}, {which}: {worst:.1e} px, {sides} on the other side");
            let bound = if BRANCHING.contains(&name) { 0.1 } else { 0.02 };
            assert!(worst <= bound, "{name}, {which}: {worst} px");
        }
    }
}
