//! Bodies that the image's border cuts through their plane of symmetry: they report half of what the whole ones do, and end as those do.

use crate::shapes::*;
use interslice::backend::Backend;
use interslice::progress::Silent;
use interslice::report::EndReport;
use interslice::settings::{EndRule, Method};
use interslice::{ContourStack, Reconstruction, Reference, Settings, reconstruct_with};

/// Pixels of the image along either axis, and the middle of a whole body.
const N: usize = 96;
const MIDDLE: f64 = 47.5;
/// The middle of one that the border cuts through its middle.
const AT_BORDER: f64 = -0.5;
/// Distance from the border at which bodies are compared, px.
const BAND: usize = 8;

/// Discs of these radii; nothing where there is none. `middle` is on a border or in the middle of the image.
fn discs(middle: [f64; 2], heights: &[f64], radius: impl Fn(f64) -> f64) -> ContourStack {
    let disc = |z: &f64| match radius(*z) {
        r if r > 0.0 => circle(middle[0], middle[1], r),
        _ => nothing(),
    };
    masks(N, heights, &heights.iter().map(disc).collect::<Vec<_>>())
}

fn run_on(backend: &dyn Backend, stack: &ContourStack, settings: &Settings) -> Reconstruction {
    let heights: Vec<f64> = (-20..=70).map(f64::from).collect();
    reconstruct_with(stack, &heights, settings, backend, &Silent).expect("a valid stack")
}

fn run(stack: &ContourStack, settings: &Settings) -> Reconstruction {
    run_on(&Reference, stack, settings)
}

/// Whether this is `share` of that, to this share of itself.
fn is_share(found: f64, whole: f64, share: f64, tolerance: f64) -> bool {
    (found - share * whole).abs() <= tolerance * share * whole
}

/// Bodies by their radius over the height, which shrink towards their first slice: name, radius, heights.
type Body = (&'static str, fn(f64) -> f64, [f64; 5]);

const BODIES: [Body; 3] = [
    ("cylinder", |_| 13.0, [10.0, 14.0, 18.0, 22.0, 26.0]),
    ("ball", |z| (26.0f64.powi(2) - (z - 26.0).powi(2)).sqrt(), [8.0, 12.0, 16.0, 20.0, 26.0]),
    ("paraboloid", |z| 6.0 * z.sqrt(), [6.0, 10.0, 14.0, 18.0, 22.0]),
];

/// Rules and methods by which bodies have caps.
const CAPPED: [(EndRule, Method); 3] = [
    (EndRule::Extrapolate, Method::Morph),
    (EndRule::Peak(-2.0), Method::Morph),
    (EndRule::Extrapolate, Method::Field),
];

/// Places of the middle of a body that the border cuts, and the share of it that is left.
const CUTS: [([f64; 2], f64); 4] = [
    ([AT_BORDER, MIDDLE], 0.5),
    ([N as f64 - 0.5, MIDDLE], 0.5),
    ([MIDDLE, AT_BORDER], 0.5),
    ([AT_BORDER, N as f64 - 0.5], 0.25),
];

#[test]
fn a_body_cut_through_its_middle_reports_half_of_what_the_whole_one_does_at_its_ends() {
    for (name, radius, heights) in BODIES {
        for rule in [EndRule::Flat, EndRule::HalfSlice, EndRule::Extrapolate, EndRule::Peak(-2.0)] {
            let settings = Settings { end_bottom: rule, ..Settings::default() };
            let end = |middle| run(&discs(middle, &heights, radius), &settings).report.ends[0].clone();
            let whole = end([MIDDLE; 2]);
            for (middle, share) in CUTS {
                let cut = end(middle);
                let numbers = |end: &EndReport| [end.area, end.used, end.half_slice, end.extrapolate];
                for (found, whole) in numbers(&cut).into_iter().zip(numbers(&whole)) {
                    assert!(is_share(found, whole, share, 0.03), "{name}, {rule:?}, {middle:?}: {found} of {whole}");
                }
                assert_eq!(cut.caps.len(), whole.caps.len(), "{name}, {rule:?}, {middle:?}");
                for (cut, whole) in cut.caps.iter().zip(&whole.caps) {
                    assert_eq!(cut.rule, whole.rule, "{name}, {rule:?}, {middle:?}");
                    let heights = (cut.height, whole.height);
                    assert!(is_share(heights.0, heights.1, 1.0, 0.05), "{name}, {rule:?}, {middle:?}: {heights:?}");
                }
            }
        }
    }
}

#[test]
fn half_a_cylinder_has_the_area_that_is_painted() {
    let (_, radius, heights) = BODIES[0];
    let stack = discs([AT_BORDER, MIDDLE], &heights, radius);
    let painted = stack.slices[0].content.sides().into_iter().filter(|inside| *inside).count() as f64;
    let settings = Settings { end_bottom: EndRule::HalfSlice, ..Settings::default() };
    let end = &run(&stack, &settings).report.ends[0];
    for (found, expected) in [(end.area, painted), (end.half_slice, 2.0 * painted), (end.used, 2.0 * painted)] {
        assert!((found - expected).abs() < 0.001 * expected, "{found}, not {expected}");
    }
}

#[test]
fn a_cap_of_a_cut_body_is_half_of_the_whole_ones() {
    for (name, radius, heights) in BODIES.into_iter().skip(1) {
        for (rule, method) in CAPPED {
            let settings = Settings { end_bottom: rule, method, ..Settings::default() };
            let pixels = |middle| {
                let body = run(&discs(middle, &heights, radius), &settings);
                let below = body.output_layers().filter(|layer| layer.z < heights[0]);
                below.map(|layer| layer.phi.iter().filter(|v| **v < 0.0).count()).sum::<usize>() as f64
            };
            let whole = pixels([MIDDLE; 2]);
            for (middle, share) in CUTS {
                let found = pixels(middle);
                assert!(is_share(found, whole, share, 0.04), "{name}, {rule:?}, {middle:?}: {found} of {whole}");
            }
        }
    }
}

/// Share of two bodies' pixels within `BAND` of the border in which they differ, on layers at these heights.
fn differing(cut: &Reconstruction, whole: &Reconstruction, heights: impl Fn(f64) -> bool) -> f64 {
    assert_eq!(cut.layers.len(), whole.layers.len());
    let (mut differing, mut inside) = (0usize, 0usize);
    let layers = cut.layers.iter().zip(&whole.layers);
    for (cut, whole) in layers.filter(|(cut, _)| cut.output && heights(cut.z)) {
        for (i, j) in (0..N).flat_map(|j| (0..BAND).map(move |i| (i, j))) {
            let sides = [cut.phi.at(i, j) < 0.0, whole.phi.at(i + N / 2, j) < 0.0];
            differing += usize::from(sides[0] != sides[1]);
            inside += sides.into_iter().filter(|side| *side).count();
        }
    }
    assert!(inside > 1000, "{inside}");
    differing as f64 / inside as f64
}

#[test]
fn a_cut_body_that_ends_before_an_empty_slice_is_the_half_of_the_whole_one() {
    // Radius, distance of the slices, and the share that may differ: measured 0.002, 0.001 and 0.001; where the part that ends is drawn in from what
    // closes it beyond the border, too, 0.003, 0.002 and 0.009.
    type Ending = (&'static str, fn(f64) -> f64, f64, f64);
    let ending: [Ending; 3] = [
        ("ball", |z| (13.3f64.powi(2) - (z - 24.0).powi(2)).max(0.0).sqrt(), 6.0, 0.0025),
        ("paraboloid", |z| 6.5 * (z - 12.0).max(0.0).sqrt(), 8.0, 0.0018),
        ("larger ball", |z| (20.0f64.powi(2) - (z - 24.0).powi(2)).max(0.0).sqrt(), 8.0, 0.002),
    ];
    for (name, radius, gap, most) in ending {
        let heights: Vec<f64> = (0..=(48.0 / gap) as usize).map(|k| gap * k as f64).collect();
        for method in [Method::Morph, Method::Field] {
            let settings = Settings { method, ..Settings::default() };
            let [cut, whole] = [AT_BORDER, MIDDLE].map(|x| run(&discs([x, MIDDLE], &heights, radius), &settings));
            let off = differing(&cut, &whole, |_| true);
            println!("{name}, {method:?}: {off:.4} differ");
            assert!(off < most, "{name}, {method:?}: {off}");
        }
    }
}

#[test]
fn a_cap_of_a_cut_body_has_the_shape_of_the_whole_one() {
    for (name, radius, heights) in BODIES.into_iter().skip(1) {
        for (rule, method) in CAPPED {
            let settings = Settings { end_bottom: rule, method, ..Settings::default() };
            let [cut, whole] = [AT_BORDER, MIDDLE].map(|x| run(&discs([x, MIDDLE], &heights, radius), &settings));
            let off = differing(&cut, &whole, |z| z < heights[0]);
            // Seen: 0.0046 at worst.
            assert!(off < 0.01, "{name}, {rule:?}, {method:?}: {off}");
        }
    }
}

#[cfg(feature = "gpu")]
#[test]
fn both_backends_make_the_same_ends_of_a_cut_body() {
    use interslice::gpu::{Gpu, GpuOptions};
    let gpu = Gpu::open(&GpuOptions::default()).expect("a Vulkan driver (tests/run installs lavapipe)");
    let (_, radius, heights) = BODIES[1];
    let stack = discs([AT_BORDER, MIDDLE], &heights, radius);
    let settings = Settings { end_bottom: EndRule::Extrapolate, ..Settings::default() };
    let [gpu, cpu] = [&gpu as &dyn Backend, &Reference].map(|backend| run_on(backend, &stack, &settings));
    let [on_gpu, on_cpu] = [&gpu, &cpu].map(|body| &body.report.ends[0]);
    assert!(is_share(on_gpu.used, on_cpu.used, 1.0, 1e-3), "{} and {}", on_gpu.used, on_cpu.used);
    let pairs = gpu.layers.iter().zip(&cpu.layers).flat_map(|(a, b)| a.phi.iter().zip(b.phi.iter()));
    let apart = pairs.filter(|(a, b)| (**a < 0.0) != (**b < 0.0)).count();
    assert!(gpu.layers.len() == cpu.layers.len() && apart <= 40, "{apart} pixels");
}
