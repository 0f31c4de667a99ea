//! The whole method on analytic stacks.

mod shapes;

use interslice::progress::Silent;
use interslice::settings::{SlopeRule, SplineEnd};
use interslice::spline::slope;
use interslice::stack::ContourStack;
use interslice::surface::Layer;
use interslice::{Reconstruction, Reference, Settings, reconstruct_with};
use shapes::*;

fn run(stack: &ContourStack, heights: &[f64], settings: &Settings) -> Reconstruction {
    reconstruct_with(stack, heights, settings, &Reference, &Silent).expect("the stack is valid")
}

/// Mean and spread (largest deviation) of the radius `|x - c| - phi` over the pixels within 1 px of the layer's contour.
fn radius(layer: &Layer, dims: [usize; 2], center: f64) -> (f64, f64) {
    let near = layer.phi.iter().enumerate().filter(|(_, v)| v.abs() < 1.0);
    let radii: Vec<f64> = near
        .map(|(k, v)| ((k % dims[0]) as f64 - center).hypot((k / dims[0]) as f64 - center) - f64::from(*v))
        .collect();
    let mean = radii.iter().sum::<f64>() / radii.len() as f64;
    (mean, radii.iter().map(|r| (r - mean).abs()).fold(0.0, f64::max))
}

/// The radius that the slope rule's own 1D spline gives at height `z`.
fn expected(z: f64, knots: &[f64], radii: &[f64], settings: &Settings) -> f64 {
    let i = (0..knots.len() - 2).find(|&i| z < knots[i + 1]).unwrap_or(knots.len() - 2);
    let (gap, s) = (knots[i + 1] - knots[i], radii[i + 1] - radii[i]);
    let m = |k: usize| match settings.slope {
        SlopeRule::Linear => s / gap,
        rule => slope(knots, radii, k, rule, settings.spline_end),
    };
    radii[i] + interslice::spline::hermite(&[s, m(i) * gap, m(i + 1) * gap, 1.0], (z - knots[i]) / gap)
}

#[test]
fn circle_stacks_follow_the_one_dimensional_spline() {
    let knots = [0.0, 10.0, 25.0, 33.0, 45.0];
    for radii in [[30.0, 22.0, 14.0, 20.0, 28.0], [14.0, 18.0, 24.0, 30.0, 30.5]] {
        let shapes: Vec<Shape> = radii.iter().map(|&r| circle(60.0, 60.0, r)).collect();
        let stack = levels(121, &knots, &shapes);
        let heights: Vec<f64> = (0..=90).map(|k| 0.5 * f64::from(k)).collect();
        for rule in [SlopeRule::Linear, SlopeRule::Natural, SlopeRule::Hyman, SlopeRule::Pchip, SlopeRule::Catmull] {
            let settings = Settings { slope: rule, spline_end: SplineEnd::Natural, ..Settings::default() };
            let result = run(&stack, &heights, &settings);
            let worst = result
                .layers
                .iter()
                .map(|l| (l.z, radius(l, result.dims, 60.0)))
                .map(|(z, (r, spread))| (z, r - expected(z, &knots, &radii, &settings), spread))
                .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
                .expect("there are layers");
            println!("{rule:?} {radii:?}: off by {:.4} px at z = {}, spread {:.3}", worst.1, worst.0, worst.2);
            assert!(worst.1.abs() <= 0.02, "{rule:?}: {:.4} px at z = {}", worst.1, worst.0);
        }
    }
}
