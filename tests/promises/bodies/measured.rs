//! Radii and volumes that mathematics gives: the natural cubic's, those of spheres.

use std::f64::consts::PI;

use glam::DVec2;
use interslice::evaluate::demo::demo;
use interslice::polygons::{self, PlaneDrawing, Planes};
use interslice::settings::{AntiAlias, EndRule, SlopeRule};
use interslice::stack::Geometry;
use interslice::{Settings, height_grid};

use super::{run, steps};
use crate::random::measure::{area, layer_at};
use crate::random::numbers::Numbers;
use crate::shapes::plain;

/// Values of the natural cubic through `y` at `x`, equally spaced, three knots: `(values at either end, the middle's slope)`.
fn natural_cubic(y: [f64; 3], gap: f64, z: f64) -> f64 {
    // One inner knot: its second derivative is all there is.
    let m = 1.5 * (y[0] - 2.0 * y[1] + y[2]) / (gap * gap);
    let (k, m) = if z < gap { (0, [0.0, m]) } else { (1, [m, 0.0]) };
    let (a, b) = (gap * (k + 1) as f64 - z, z - gap * k as f64);
    (m[0] * a.powi(3) + m[1] * b.powi(3)) / (6.0 * gap)
        + (y[k] / gap - m[0] * gap / 6.0) * a
        + (y[k + 1] / gap - m[1] * gap / 6.0) * b
}

#[test]
fn p09_natural_is_the_natural_cubic() {
    for name in ["fig5", "fig6"] {
        let demo = demo(name).expect("a demo");
        let settings = Settings { slope: SlopeRule::Natural, anti_alias: AntiAlias::Kernel, ..plain() };
        let body = run(&demo.stack, &steps(33, 1.0), &settings);
        let radius = |z: f64| (area(layer_at(&body, z).expect("a layer"), 1.0) / PI).sqrt();
        let knots = [0.0, 16.0, 32.0].map(radius);
        let off = |k: usize| (radius(k as f64) - natural_cubic(knots, 16.0, k as f64)).abs();
        let worst = (0..33).map(off).fold(0.0, f64::max);
        assert!(worst <= 0.05, "{name}: {worst:.2} px from the natural cubic");
    }
}

/// Mean and worst relative error of the volume of spheres drawn as polygons, by an end rule.
fn spheres(rule: EndRule) -> (f64, f64) {
    let mut errors = Vec::new();
    let mut n = Numbers::new(10);
    for radius in [3.0f64, 5.0, 8.0, 12.0, 20.0] {
        for gap in [1.0, 2.0] {
            for place in 0..4 {
                let [x, y] = [n.between(0.0, 1.0), n.between(0.0, 1.0)];
                // Places of the first slice spread evenly: a mean over few drawn ones is off by more than what is promised.
                let first = gap * (f64::from(place) + n.between(0.0, 1.0)) / 4.0;
                let planes = (0..).map(|k| gap * f64::from(k) + first - radius).take_while(|z| *z < radius);
                let of_plane = |z: f64| {
                    let r = (radius * radius - z * z).sqrt();
                    let at = |k: usize| PI * k as f64 / 36.0;
                    let circle = (0..72).map(|k| DVec2::new(x, y) + r * DVec2::from_angle(at(k))).collect();
                    PlaneDrawing { name: format!("{z}"), z, extra: false, regions: vec![vec![circle]] }
                };
                let drawings: Vec<PlaneDrawing> = planes.map(of_plane).collect();
                if drawings.len() < 3 {
                    continue;
                }
                let planes = Planes { unit: "mm".into(), axes: Geometry::default().axes, z_out: None };
                let stack = polygons::stack(&drawings, &planes, Some([0.5; 2])).expect("it is sound");
                let settings = Settings { end_bottom: rule, end_top: rule, ..Settings::default() };
                let heights = height_grid(&stack, &settings, Some(0.125 * gap)).heights().expect("a grid");
                let volume = interslice::surface::mesh::closed_surface(&run(&stack, &heights, &settings)).volume();
                errors.push(volume / (4.0 / 3.0 * PI * radius.powi(3)) - 1.0);
            }
        }
    }
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (mean, errors.into_iter().map(f64::abs).fold(0.0, f64::max))
}

#[test]
fn p10_ends_give_volumes_one_can_trust() {
    let (mean, worst) = spheres(EndRule::Extrapolate);
    assert!(mean.abs() <= 0.01 && worst <= 0.08, "extrapolated: mean {mean:.3}, worst {worst:.3}");
    let (mean, _) = spheres(EndRule::HalfSlice);
    assert!(mean.abs() <= 0.01, "half-slice: mean {mean:.3}");
}
