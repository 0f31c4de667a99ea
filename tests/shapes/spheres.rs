//! Bodies of known volume as a person draws them: polygons on planes.
#![allow(dead_code)]

use std::f64::consts::{PI, TAU};

use glam::DVec2;
use interslice::polygons::{PlaneDrawing, Planes, stack};
use interslice::stack::{ContourStack, Geometry};
use interslice::surface::areas::Areas;
use interslice::surface::mesh::closed_surface;
use interslice::{Settings, reconstruct};

/// Points of a drawn circle.
const POINTS: usize = 64;

/// Numbers from 0 to 1 (Knuth's multiplier, upper bits).
pub fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 33) as f64 / (1u64 << 31) as f64
}

/// Ellipses of these half axes around `center` at these heights, with the ellipses' own areas; nothing where an axis is 0.
pub fn drawn(center: DVec2, heights: &[f64], axes: impl Fn(f64) -> DVec2) -> Option<ContourStack> {
    let inscribed = TAU / POINTS as f64;
    let outward = (inscribed / inscribed.sin()).sqrt();
    let drawings: Vec<PlaneDrawing> = heights
        .iter()
        .map(|&z| (z, axes(z)))
        .filter(|(_, axes)| axes.min_element() > 0.0)
        .map(|(z, axes)| {
            let point = |k: usize| center + outward * axes * DVec2::from_angle(TAU * k as f64 / POINTS as f64);
            PlaneDrawing {
                name: format!("z = {z}"),
                z,
                extra: false,
                regions: vec![vec![(0..POINTS).map(point).collect()]],
            }
        })
        .collect();
    let planes = Planes { unit: "mm".into(), axes: Geometry::default().axes, z_out: None };
    stack(&drawings, &planes, None).ok()
}

/// Spheres of this diameter drawn on slices this far apart, at random places; only what is drawn on three slices or more.
pub fn spheres(diameter: f64, gap: f64, count: usize) -> Vec<ContourStack> {
    let radius = |z: f64| (0.25 * diameter * diameter - z * z).max(0.0).sqrt();
    upright(radius, (1000.0 * diameter + gap) as u64, gap, count)
}

/// Bodies of circles around an upright axis, `radius` by height from the body's middle, drawn on slices this far apart at random places; only
/// what is drawn on three slices or more.
pub fn upright(radius: impl Fn(f64) -> f64, mut state: u64, gap: f64, count: usize) -> Vec<ContourStack> {
    let mut place = || {
        let [x, y, z] = [0.0; 3].map(|_: f64| random(&mut state));
        let heights: Vec<f64> = (-50..50).map(|k| gap * f64::from(k)).collect();
        drawn(40.0 * DVec2::new(x, y), &heights, |at| DVec2::splat(radius(at - gap * z)))
    };
    // Spheres hardly larger than two gaps meet three slices in few places.
    (0..100 * count).filter_map(|_| place()).filter(|s| s.slices.len() >= 3).take(count).collect()
}

/// A body of circles around an upright axis.
pub struct Upright {
    pub name: &'static str,
    /// Its volume, mm3.
    pub volume: f64,
    /// Its radius by height from its middle, mm; 0 beyond it.
    pub radius: fn(f64) -> f64,
}

/// The bodies of Nelms et al. 2015: a sphere 20 mm wide, a cylinder and a cone 24 mm wide and high.
pub const NELMS: [Upright; 3] = [
    Upright { name: "sphere", volume: 4188.79, radius: |z| (100.0 - z * z).max(0.0).sqrt() },
    Upright { name: "cylinder", volume: 10857.34, radius: |z| if z.abs() <= 12.0 { 12.0 } else { 0.0 } },
    Upright { name: "cone", volume: 3619.11, radius: |z| if z.abs() <= 12.0 { 0.5 * (12.0 - z) } else { 0.0 } },
];

/// Volume of a sphere.
pub fn sphere_volume(diameter: f64) -> f64 {
    PI / 6.0 * diameter.powi(3)
}

/// Volumes of the body between drawings by its mesh and by the areas of its layers, and what the report says of its two ends.
pub fn volumes(stack: &ContourStack, settings: &Settings) -> interslice::Result<[f64; 3]> {
    let body = reconstruct(stack, settings)?;
    let mut areas = Areas::new(&body.header());
    body.layers.iter().for_each(|layer| areas.layer(layer));
    let layers = areas.finish().layers;
    let by_areas = layers.windows(2).map(|w| 0.5 * (w[1][0] - w[0][0]) * (w[0][1] + w[1][1])).sum();
    Ok([closed_surface(&body).volume(), by_areas, body.report.ends.iter().map(|end| end.used).sum()])
}

/// Mean, least and largest.
pub fn spread(values: &[f64]) -> [f64; 3] {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    [mean, least, values.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
}
