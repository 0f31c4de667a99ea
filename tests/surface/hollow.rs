//! Hollow tubes that lean so far that their walls miss each other from slice to slice, where neither what they enclose does.

use crate::backends::on_backends;
use crate::shapes::*;
use crate::sliding::apart;
use interslice::grid::sparse_image::SparseImage;
use interslice::progress::Silent;
use interslice::settings::Method;
use interslice::stack::ContourStack;
use interslice::{Backend, Reconstruction, Reference, Settings, reconstruct_with};

const N: usize = 112;
const MIDDLE: f64 = 55.7;

/// A hollow tube whose axis leans; lengths in px, heights along z.
#[derive(Debug, Clone, Copy)]
struct Tube {
    /// Angle between its axis and the z axis, degrees.
    lean: f64,
    /// Direction in which it leans, degrees.
    towards: f64,
    radius: f64,
    wall: f64,
    gap: f64,
    /// Its slices.
    slices: usize,
    /// Pixel side along x.
    wide: f64,
    /// Heights are this much larger.
    times: f64,
}

const TUBE: Tube =
    Tube { lean: 76.0, towards: 20.0, radius: 7.5, wall: 2.4, gap: 5.0, slices: 4, wide: 1.0, times: 1.0 };

impl Tube {
    /// How far a pixel at height z lies from the wall, and negative in it.
    fn at(&self, [i, j]: [f64; 2], z: f64) -> f64 {
        let (lean, towards) = (self.lean.to_radians(), self.towards.to_radians());
        let axis = [lean.sin() * towards.cos(), lean.sin() * towards.sin(), lean.cos()];
        let x = [(i - MIDDLE) * self.wide, j - MIDDLE, z - 0.5 * self.gap * (self.slices - 1) as f64];
        let along: f64 = x.iter().zip(axis).map(|(x, a)| x * a).sum();
        let from = x.iter().zip(axis).map(|(x, a)| (x - along * a).powi(2)).sum::<f64>().sqrt();
        (from - self.radius).max(self.radius - self.wall - from)
    }

    fn stack(self) -> ContourStack {
        let heights: Vec<f64> = (0..self.slices).map(|k| self.times * self.gap * k as f64).collect();
        let shapes: Vec<Shape> = heights
            .iter()
            .map(|z| z / self.times)
            .map(|z| -> Shape { Box::new(move |x, y| self.at([x, y], z)) })
            .collect();
        ContourStack { spacing: [self.wide, 1.0], ..masks(N, &heights, &shapes) }
    }

    fn heights(&self) -> Vec<f64> {
        (0..=(self.gap * (self.slices - 1) as f64) as usize).map(|z| self.times * z as f64).collect()
    }

    fn made(self, settings: &Settings, backend: &dyn Backend) -> Reconstruction {
        reconstruct_with(&self.stack(), &self.heights(), settings, backend, &Silent).expect("it is valid")
    }

    /// Dice between the slices, and of how many layers there the hole is closed all around.
    fn measured(&self, body: &Reconstruction) -> (f64, usize, usize) {
        let (mut both, mut all, mut closed, mut layers) = (0usize, 0usize, 0usize, 0usize);
        for layer in body.layers.iter().filter(|layer| layer.output && layer.contour.is_none()) {
            let z = layer.z / self.times;
            let inside: Vec<bool> = layer.phi.iter().map(|v| *v < 0.0).collect();
            for (n, found) in inside.iter().enumerate() {
                let true_ = self.at([n % N, n / N].map(|k| k as f64), z) < 0.0;
                both += usize::from(*found && true_);
                all += usize::from(*found) + usize::from(true_);
            }
            // The axis lies here.
            let off = (z - 0.5 * self.gap * (self.slices - 1) as f64) * self.lean.to_radians().tan();
            let (s, c) = self.towards.to_radians().sin_cos();
            let at = [MIDDLE + off * c / self.wide, MIDDLE + off * s].map(|x| x.round() as usize);
            layers += 1;
            closed += usize::from(!reaches_border(&inside, at));
        }
        (2.0 * both as f64 / all as f64, closed, layers)
    }
}

/// Whether background at a pixel goes on to the image's border.
fn reaches_border(inside: &[bool], at: [usize; 2]) -> bool {
    let mut seen = inside.to_vec();
    let mut next = vec![at];
    while let Some([i, j]) = next.pop() {
        if i == 0 || j == 0 || i + 1 == N || j + 1 == N {
            return true;
        }
        if !std::mem::replace(&mut seen[j * N + i], true) {
            next.extend([[i - 1, j], [i + 1, j], [i, j - 1], [i, j + 1]]);
        }
    }
    false
}

#[test]
fn a_leaning_hollow_tube_keeps_its_wall_and_its_hole() {
    let field = Settings { method: Method::Field, ..Settings::default() };
    on_backends(|backend| {
        for (name, tube, settings) in [
            ("a tube", TUBE, Settings::default()),
            ("the field method", TUBE, field.clone()),
            ("long pixels", Tube { wide: 1.5, ..TUBE }, Settings::default()),
            ("other heights", Tube { times: 10.0, ..TUBE }, Settings::default()),
            ("thinner", Tube { wall: 1.8, towards: 130.0, ..TUBE }, Settings::default()),
        ] {
            let (dice, closed, layers) = tube.measured(&tube.made(&settings, backend));
            println!("{name}, {}: Dice {dice:.4}, {closed} of {layers} closed", backend.name());
            assert!(dice > 0.84 && closed == layers, "{name}, {}: {dice}, {closed}", backend.name());
        }
    });
}

#[test]
fn walls_of_any_tube_that_misses_itself_hold_together() {
    let mut random = 7u64;
    let mut number = |low: f64, high: f64| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * (random >> 11) as f64 / (1u64 << 53) as f64
    };
    const CASES: usize = 16;
    let (mut dices, mut closed, mut layers) = (0.0, 0, 0);
    for _ in 0..CASES {
        let (radius, gap) = (number(6.5, 9.0), number(4.0, 7.0).floor());
        let tube = Tube {
            // From slice to slice it moves by a little more than it is wide.
            lean: (number(2.1, 2.6) * radius / gap).atan().to_degrees(),
            towards: number(0.0, 360.0),
            wall: number(2.0, 3.0),
            radius,
            gap,
            ..TUBE
        };
        let (dice, own, all) = tube.measured(&tube.made(&Settings::default(), &Reference));
        println!("{tube:?}: Dice {dice:.4}, {own} of {all} closed");
        (dices, closed, layers) = (dices + dice, closed + own, layers + all);
    }
    let mean = dices / CASES as f64;
    println!("mean Dice {mean:.4}, {closed} of {layers} closed");
    // By the walls alone 0.877, and 0.85 of them closed.
    assert!(mean > 0.9 && closed as f64 > 0.92 * layers as f64, "{mean}, {closed} of {layers}");
}

#[test]
fn the_layers_of_a_hollow_tube_do_not_depend_on_those_asked_for_nor_on_how_it_lies() {
    let settings = Settings::default();
    let body = TUBE.made(&settings, &Reference);
    let (stack, top) = (TUBE.stack(), TUBE.gap * (TUBE.slices - 1) as f64);
    let made = |stack: &ContourStack, heights: &[f64]| {
        reconstruct_with(stack, heights, &settings, &Reference, &Silent).expect("it is valid")
    };
    let fine: Vec<f64> = (0..=4 * top as usize).map(|k| 0.25 * k as f64).collect();
    assert!(apart(&body, &made(&stack, &fine), TUBE.slices, SparseImage::unpack) < 1e-4);

    let mut turned = made(&upside_down(&stack, top), &TUBE.heights());
    turned.layers.iter_mut().for_each(|layer| layer.z = top - layer.z);
    let upside_down = apart(&body, &turned, TUBE.slices, SparseImage::unpack);

    let transposed_shape = |z: f64| -> Shape { Box::new(move |x, y| TUBE.at([y, x], z)) };
    let heights: Vec<f64> = stack.slices.iter().map(|slice| slice.z).collect();
    let shapes: Vec<Shape> = heights.iter().map(|z| transposed_shape(*z)).collect();
    let transposed = |phi: &SparseImage<f32>| (0..N * N).map(|n| phi.at(n / N, n % N)).collect();
    let transposed = apart(&body, &made(&masks(N, &heights, &shapes), &TUBE.heights()), TUBE.slices, transposed);

    // What lies just beside a slice is the slice.
    let step = 1e-3 * TUBE.gap;
    let beside: Vec<f64> = heights[1..heights.len() - 1].iter().flat_map(|z| [z - step, *z, z + step]).collect();
    let layers = made(&stack, &beside).layers;
    let layers: Vec<_> = layers.iter().filter(|layer| layer.output).collect();
    let jump = layers.chunks_exact(3).flat_map(|at| {
        let own = at[1].phi.unpack();
        [&at[0].phi, &at[2].phi].map(|phi| {
            let near = phi.iter().zip(&own).filter(|(_, own)| own.abs() < 1.0);
            near.map(|(v, own)| f64::from((v - own).abs())).fold(0.0, f64::max)
        })
    });
    let jump = jump.fold(0.0, f64::max);
    println!("upside down {upside_down:.4}, transposed {transposed:.4}, beside a slice {jump:.4} px");
    assert!(upside_down < 0.02 && transposed < 0.02 && jump < 0.1, "{upside_down}, {transposed}, {jump}");
}
