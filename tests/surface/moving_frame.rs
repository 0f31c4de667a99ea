//! What the moving frame promises: equal slices stay, the same body comes back however it lies and however its heights are measured, pixels may
//! be long.

use std::sync::Arc;

use crate::backends::on_backends;
use crate::shapes::*;
use glam::DVec2;
use interslice::grid::field::Field;
use interslice::progress::Silent;
use interslice::reference::displacement::ROUNDS;
use interslice::registration::displacement::{Displacement, DisplacementJob};
use interslice::settings::{Method, SlopeRule};
use interslice::stack::{ContourStack, Slice, SliceContent};
use interslice::{Backend, Settings, reconstruct_with};

fn unfaired(method: Method) -> Settings {
    Settings { method, fair: 0.0, ..Settings::default() }
}

/// Distances at some heights, px of the larger side.
fn layers(stack: &ContourStack, heights: &[f64], settings: &Settings, backend: &dyn Backend) -> Vec<Vec<f32>> {
    let body = reconstruct_with(stack, heights, settings, backend, &Silent).expect("a valid stack");
    let px = stack.spacing[0].max(stack.spacing[1]) as f32;
    let output = body.layers.iter().filter(|layer| layer.output);
    let layers: Vec<Vec<f32>> = output.map(|layer| layer.phi.iter().map(|v| v / px).collect()).collect();
    assert_eq!(layers.len(), heights.len());
    layers
}

/// Largest difference near the surface, px.
fn apart<'l>(pairs: impl IntoIterator<Item = (&'l f32, &'l f32)>) -> f32 {
    let near = pairs.into_iter().filter(|(a, b)| a.abs().min(b.abs()) < 3.0);
    near.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Radius of a disc by the area of its layer.
fn radius(phi: &[f32]) -> f64 {
    let area: f64 = phi.iter().map(|v| f64::from(0.5 - v).clamp(0.0, 1.0)).sum();
    (area / std::f64::consts::PI).sqrt()
}

#[test]
fn equal_neighbours_stay_equal() {
    // Pixels of a staircase are known to a few hundredths.
    const BOUND: f64 = 0.02;
    let radii = [20.0, 20.0, 30.0, 30.0];
    let discs: Vec<Shape> = radii.iter().map(|r| circle(47.3, 45.8, *r)).collect();
    let stack = masks(95, &[0.0, 8.0, 16.0, 24.0], &discs);
    on_backends(|backend| {
        for (method, slope) in
            [(Method::Field, SlopeRule::Hyman), (Method::Morph, SlopeRule::Hyman), (Method::Morph, SlopeRule::Pchip)]
        {
            let settings = Settings { slope, ..unfaired(method) };
            let found = layers(&stack, &[0.0, 4.0, 20.0, 24.0], &settings, backend);
            let radii: Vec<f64> = found.iter().map(|phi| radius(phi)).collect();
            println!("{method:?}, {slope:?}, {}: {radii:.4?}", backend.name());
            assert!((radii[1] - radii[0]).abs() < BOUND && (radii[2] - radii[3]).abs() < BOUND, "{radii:?}");
        }
    });
}

#[test]
fn beside_a_jump_equal_slices_do_not_move() {
    let dims = [70, 61];
    let field = |x: f64| Arc::new(Field::from_fn(dims, |i, j| (i as f64 - x).hypot(j as f64 - 30.0) - 12.0));
    let fields = [field(24.0), field(24.0), field(36.0), field(36.0)];
    let still = vec![Displacement::zero(dims); 3];
    let gaps = [5.0, 8.0, 3.0];
    let job = DisplacementJob {
        fields: &fields,
        gaps: &gaps,
        guess: &still,
        begin: &still,
        rounds: 0..ROUNDS.len(),
        h: [1.0; 2],
    };
    on_backends(|backend| {
        let found = backend.displacements(&job).expect("displacements");
        assert_eq!([&found[0], &found[2]], [&still[0], &still[2]], "{}", backend.name());
        // Those beside it say that it does not move, and count as much as it does itself: it goes half of the way.
        let middle = found[1].at(DVec2::splat(30.0));
        assert!((4.0..8.0).contains(&middle.x) && middle.y.abs() < 0.1, "{middle:?}");
    });
}

/// Pixels of an image in another order: from the new pixel to the old one.
struct Turn {
    name: &'static str,
    swapped: bool,
    mirrored: [bool; 2],
}

const TURNS: [Turn; 4] = [
    Turn { name: "mirrored", swapped: false, mirrored: [true, false] },
    Turn { name: "upright", swapped: false, mirrored: [false, true] },
    Turn { name: "transposed", swapped: true, mirrored: [false, false] },
    Turn { name: "turned", swapped: true, mirrored: [true, false] },
];

impl Turn {
    fn dims(&self, dims: [usize; 2]) -> [usize; 2] {
        if self.swapped { [dims[1], dims[0]] } else { dims }
    }

    /// For each pixel of the turned image that of the image.
    fn pixels(&self, dims: [usize; 2]) -> Vec<usize> {
        let [nx, ny] = self.dims(dims);
        let old = |n: usize| {
            let x = [n % nx, n / nx];
            let x: [usize; 2] = std::array::from_fn(|a| if self.mirrored[a] { [nx, ny][a] - 1 - x[a] } else { x[a] });
            let [i, j] = if self.swapped { [x[1], x[0]] } else { x };
            j * dims[0] + i
        };
        (0..nx * ny).map(old).collect()
    }

    fn stack(&self, stack: &ContourStack) -> ContourStack {
        let pixels = self.pixels(stack.dims);
        let turned = |slice: &Slice| {
            let mask = pixels.iter().map(|&n| slice.content.inside(n)).collect();
            Slice { content: SliceContent::Mask(mask), name: slice.name.clone(), ..*slice }
        };
        let slices = stack.slices.iter().map(turned).collect();
        let [dx, dy] = stack.spacing;
        let spacing = if self.swapped { [dy, dx] } else { [dx, dy] };
        ContourStack { dims: self.dims(stack.dims), spacing, slices, unit: stack.unit.clone(), ..*stack }
    }
}

/// A stack of masks on any image.
fn drawn(
    dims: [usize; 2],
    spacing: [f64; 2],
    heights: &[f64],
    inside: impl Fn(usize, f64, f64) -> bool,
) -> ContourStack {
    let mut stack = masks(1, heights, &heights.iter().map(|_| nothing()).collect::<Vec<_>>());
    (stack.dims, stack.spacing) = (dims, spacing);
    for (k, slice) in stack.slices.iter_mut().enumerate() {
        let pixel = |n: usize| inside(k, (n % dims[0]) as f64 * spacing[0], (n / dims[0]) as f64 * spacing[1]);
        slice.content = SliceContent::Mask((0..dims[0] * dims[1]).map(pixel).collect());
    }
    stack
}

/// A trunk that wanders and divides, on an image of neither even nor equal sides.
fn branching() -> ContourStack {
    drawn([76, 61], [1.0; 2], &[0.0, 6.0, 11.0, 20.0], |k, x, y| {
        let s = k as f64;
        let disc = |cx: f64, cy: f64, r: f64| (x - cx).hypot(y - cy) < r;
        match k {
            0 | 1 => disc(34.0 + 4.0 * s, 29.0 - 2.0 * s, 13.0 + s),
            _ => disc(24.0 - s, 28.0, 8.0) || disc(46.0 + 2.0 * s, 25.0 + s, 9.0),
        }
    })
}

#[test]
fn a_body_that_is_turned_is_the_same_body() {
    const BOUND: f32 = 0.01;
    let (stack, heights) = (branching(), [2.0, 3.0, 8.0, 13.0, 15.5]);
    on_backends(|backend| {
        let own = layers(&stack, &heights, &unfaired(Method::Field), backend);
        for turn in TURNS {
            let turned = layers(&turn.stack(&stack), &heights, &unfaired(Method::Field), backend);
            let pixels = turn.pixels(stack.dims);
            let pairs = own.iter().zip(&turned).flat_map(|(a, b)| pixels.iter().zip(b).map(|(&n, b)| (&a[n], b)));
            let apart = apart(pairs);
            println!("{}, {}: {apart:.1e} px", turn.name, backend.name());
            assert!(apart < BOUND, "{}: {apart}", turn.name);
        }
    });
}

#[test]
fn heights_have_no_unit() {
    const BOUND: f32 = 0.02;
    // A body that wanders, and a hill of which every slice holds the next.
    let wandering = drawn([70, 64], [1.0; 2], &[0.0, 6.0, 11.0, 20.0, 24.0], |k, x, y| {
        let s = k as f64;
        (x - 24.0 - 5.0 * s).hypot(0.8 * (y - 30.0 + 2.0 * s * (s - 3.0))) < 12.0 + 4.0 * (1.7 * s).sin()
    });
    let hill = drawn([96, 90], [1.0; 2], &[0.0, 6.0, 11.0, 20.0, 24.0], |k, x, y| {
        (x - 44.0).hypot(y - 43.0) < [40.0, 37.0, 24.0, 21.0, 8.0][k] + 2.0 * (3.0 * (y - 43.0).atan2(x - 44.0)).cos()
    });
    on_backends(|backend| {
        for (name, stack) in [("wandering", &wandering), ("hill", &hill)] {
            for method in [Method::Field, Method::Morph] {
                let heights = [1.0, 3.0, 8.5, 14.0, 22.0];
                let own = layers(stack, &heights, &unfaired(method), backend);
                for scale in [0.1, 10.0] {
                    let mut stretched = stack.clone();
                    stretched.slices.iter_mut().for_each(|slice| slice.z *= scale);
                    let found = layers(&stretched, &heights.map(|z| scale * z), &unfaired(method), backend);
                    let apart = apart(own.iter().flatten().zip(found.iter().flatten()));
                    println!("{name}, {method:?}, times {scale}, {}: {apart:.1e} px", backend.name());
                    assert!(apart < BOUND, "{name}, {method:?}, times {scale}: {apart}");
                }
            }
        }
    });
}

/// A cylinder of radius 9 sheared by 8 a gap of 16, lengths in long pixels; pixels that are so many times as long as wide. Tubes end well within
/// the image, and the gap is wide enough for fairing to reach beyond them.
fn sheared(aspect: f64, along: usize) -> ContourStack {
    let spacing: [f64; 2] = std::array::from_fn(|a| if a == along { 1.0 } else { 1.0 / aspect });
    let dims = [0, 1].map(|a| ([76.0, 60.0][a] / spacing[a]) as usize);
    drawn(dims, spacing, &[0.0, 16.0, 32.0, 48.0], |k, x, y| (x - 26.0 - 8.0 * k as f64).hypot(y - 30.0) < 9.0)
}

/// How far from the body the farthest voxel is, and the mean error of the distances near the surface, long pixels.
fn errors(stack: &ContourStack, settings: &Settings, backend: &dyn Backend) -> [f64; 2] {
    let heights: Vec<f64> = (0..=24).map(|k| 2.0 * f64::from(k)).collect();
    let found = layers(stack, &heights, settings, backend);
    let (mut farthest, mut sum, mut count) = (f64::NEG_INFINITY, 0.0, 0.0);
    for (z, layer) in heights.iter().zip(&found) {
        for (n, v) in layer.iter().enumerate() {
            let [x, y] = [n % stack.dims[0], n / stack.dims[0]];
            let [x, y] = [x as f64 * stack.spacing[0], y as f64 * stack.spacing[1]];
            let truth = (x - 26.0 - 0.5 * z).hypot(y - 30.0) - 9.0;
            if *v < 0.0 {
                farthest = farthest.max(truth);
            }
            if truth.abs() < 2.0 {
                sum += (f64::from(*v) - truth).abs();
                count += 1.0;
            }
        }
    }
    [farthest, sum / count]
}

fn check_long_pixels(settings: &Settings, backend: &dyn Backend) {
    // Nothing farther off than two pixels, and distances as with square ones.
    const FARTHEST: f64 = 2.0;
    const MORE: f64 = 1.25;
    let square = errors(&sheared(1.0, 0), settings, backend)[1];
    for (aspect, along) in [2.5, 3.0, 4.0, 7.0, 8.0].into_iter().flat_map(|aspect| [(aspect, 0), (aspect, 1)]) {
        let [farthest, error] = errors(&sheared(aspect, along), settings, backend);
        let told = format!("{:?}, {}, aspect {aspect} along {along}", settings.method, backend.name());
        println!("{told}: {farthest:.2} px off, error {error:.3} px, {square:.3} with square pixels");
        assert!(farthest < FARTHEST, "{told}: a voxel is {farthest} px off");
        assert!(error < MORE * square, "{told}: error {error} px, {square} with square pixels");
    }
}

#[test]
fn pixels_may_be_long() {
    on_backends(|backend| {
        check_long_pixels(&unfaired(Method::Field), backend);
        check_long_pixels(&Settings::default(), backend);
    });
}

/// A wall that leans by three times its width a gap keeps its area on pixels of any size: a third, an eighth and a thirtieth of its width.
#[test]
fn what_leans_is_whole_however_fine_the_pixels_are() {
    on_backends(|backend| {
        for width in [3.0, 8.0, 30.0] {
            let n = (12.0 * width) as usize;
            let wall = |k: usize| -> Shape {
                let x = (2.0 + 3.0 * k as f64) * width;
                Box::new(move |i, j| {
                    let [along, across] = [(i - x).abs() - 0.5 * width, (j - 6.0 * width).abs() - 4.0 * width];
                    let beside = libm::hypot(along.max(0.0), across.max(0.0));
                    beside + along.max(across).min(0.0)
                })
            };
            let stack = levels(n, &[0.0, 4.0, 8.0], &[wall(0), wall(1), wall(2)]);
            let heights: Vec<f64> = (0..=8).map(f64::from).collect();
            let body = reconstruct_with(&stack, &heights, &Settings::default(), backend, &Silent).expect("it is valid");
            for layer in body.layers.iter().filter(|layer| layer.output) {
                let inside: f64 = layer.phi.iter().map(|v| f64::from(0.5 - v).clamp(0.0, 1.0)).sum();
                let share = inside / (8.0 * width * width);
                assert!((0.9..1.1).contains(&share), "{width} px, {}: {share:.2} at {}", backend.name(), layer.z);
            }
        }
    });
}

/// A ring, a ring beside a disc that stands still, and an angle, of walls of 4 to 6 px, that move by some pixels a slice.
fn thin_section(kind: usize, at: f64, [x, y]: [f64; 2]) -> f64 {
    let [u, v] = [x - at, y - 44.3];
    let away = libm::hypot(u, v);
    let ring = (away - 14.0).max(10.0 - away);
    match kind {
        0 => ring,
        1 => ring.min(libm::hypot(x - 70.0, y - 72.0) - 8.0),
        _ => {
            let bar = |low: [f64; 2], high: [f64; 2]| (low[0] - u).max(u - high[0]).max((low[1] - v).max(v - high[1]));
            bar([-14.0, -14.0], [-8.0, 14.0]).min(bar([-14.0, 8.0], [14.0, 14.0]))
        }
    }
}

/// A wall that has moved beside the other side of itself is not taken for that: Dice between the slices was .3 to .7 where what moves so is the same.
#[test]
fn what_moves_by_more_than_its_wall_keeps_its_shape() {
    const N: usize = 140;
    on_backends(|backend| {
        for (kind, moves, method) in
            [(0, 20.0, Method::Morph), (0, 24.0, Method::Field), (1, 22.0, Method::Morph), (2, 22.0, Method::Morph)]
        {
            let at = move |z: f64| 32.0 + moves * z / 8.0;
            let shape = |z: f64| -> Shape { Box::new(move |i, j| thin_section(kind, at(z), [i, j])) };
            let heights = [0.0, 8.0, 16.0, 24.0];
            let stack = levels(N, &heights, &heights.map(shape));
            let asked: Vec<f64> = (0..=24).map(f64::from).collect();
            let settings = Settings { method, ..Settings::default() };
            let body = reconstruct_with(&stack, &asked, &settings, backend, &Silent).expect("it is valid");
            let (mut both, mut all) = (0, 0);
            for layer in body.layers.iter().filter(|layer| layer.output && layer.contour.is_none()) {
                for (n, v) in layer.phi.iter().enumerate() {
                    let truth = thin_section(kind, at(layer.z), [n % N, n / N].map(|k| k as f64)) < 0.0;
                    both += 2 * usize::from(*v < 0.0 && truth);
                    all += usize::from(*v < 0.0) + usize::from(truth);
                }
            }
            let dice = f64::from(both as u32) / f64::from(all as u32);
            let told = format!("section {kind}, {moves} px, {method:?}, {}", backend.name());
            println!("{told}: Dice {dice:.4}");
            assert!(dice > 0.95, "{told}: Dice {dice}");
        }
    });
}
