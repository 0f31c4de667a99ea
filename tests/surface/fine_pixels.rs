//! A body is the same on finer pixels: contours that lie many pixels apart are no other method's.

use crate::backends::on_backends;
use crate::shapes::*;
use interslice::progress::Silent;
use interslice::{Settings, reconstruct_with};

/// Pixels a unit, and units a gap.
const FINE: f64 = 4.0;
const GAP: f64 = 5.0;
const N: usize = 217;
const C: f64 = 108.2;

#[test]
fn radii_are_right_where_contours_are_many_pixels_apart() {
    type Radius = fn(f64) -> f64;
    let bodies: [(&str, Radius); 2] = [
        ("ball", |z| (24f64.powi(2) - (z - 20.0).powi(2)).sqrt()),
        ("neck", |z| (9.0 + 0.8 * (z - 20.0).powi(2)).sqrt()),
    ];
    let heights: Vec<f64> = (0..9).map(|k| f64::from(k) * GAP).collect();
    let all: Vec<f64> = (0..=40).map(f64::from).collect();
    on_backends(|backend| {
        for (name, radius) in bodies {
            let shapes: Vec<Shape> = heights.iter().map(|z| circle(C, C, FINE * radius(*z))).collect();
            let stack = masks(N, &heights, &shapes);
            let body = reconstruct_with(&stack, &all, &Settings::default(), backend, &Silent).expect("it is valid");
            let off = |z: f64, pixels: usize| (pixels as f64 / std::f64::consts::PI).sqrt() / FINE - radius(z);
            let (mut sum, mut worst, mut count) = (0.0, 0.0f64, 0.0);
            for layer in body.layers.iter().filter(|layer| layer.output && layer.z % GAP != 0.0) {
                let off = off(layer.z, layer.phi.iter().filter(|v| **v < 0.0).count()) / GAP;
                (sum, worst, count) = (sum + off * off, worst.max(off.abs()), count + 1.0);
            }
            let rms = 100.0 * f64::sqrt(sum / count);
            println!("{name}, {}: {rms:.2} % of a gap, at most {:.2}", backend.name(), 100.0 * worst);
            assert!(count == 32.0 && rms < 1.0 && worst < 0.025, "{name}, {}: {rms} %, {worst}", backend.name());
        }
    });
}
