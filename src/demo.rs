//! The paper's synthetic stacks (Nilsson, Breen and Museth), made here.

use crate::settings::{EndRule, Settings, SlopeRule};
use crate::stack::{ContourStack, Geometry, HeightGrid, Slice, SliceContent};

/// A synthetic stack and the settings that show what it is for.
#[derive(Debug, Clone)]
pub struct Demo {
    /// Name: "fig5" and so on.
    pub name: &'static str,
    /// What it shows.
    pub shows: &'static str,
    /// The contours.
    pub stack: ContourStack,
    /// How to reconstruct it.
    pub settings: Settings,
}

/// Names of all demos.
pub const NAMES: [&str; 4] = ["fig5", "fig6", "fig9", "fig10"];

/// The demo of that name.
pub fn demo(name: &str) -> Option<Demo> {
    let natural = Settings { slope: SlopeRule::Natural, ..Settings::default() };
    let circle = |c: f64, r: f64| move |x: f64, y: f64| (x - c).hypot(y - c) < r;
    match name {
        "fig5" => {
            let radii = [30.0, 14.0, 30.0];
            let contour = |k: usize, x, y| circle(44.5, radii[k])(x, y);
            let stack = stack([90, 90], &[0.0, 16.0, 32.0], grid(0.0, 33), contour);
            Some(Demo { name: "fig5", shows: "large, small, large: a smooth waist", stack, settings: natural })
        }
        "fig6" => {
            let radii = [14.0, 30.0, 30.0];
            let contour = |k: usize, x, y| circle(44.5, radii[k])(x, y);
            let stack = stack([90, 90], &[0.0, 16.0, 32.0], grid(0.0, 33), contour);
            Some(Demo {
                name: "fig6",
                shows: "small, large, large: the natural spline overshoots",
                stack,
                settings: natural,
            })
        }
        "fig9" => {
            let heights: Vec<f64> = (0..8).map(|k| 6.0 + f64::from(k) * 85.0 / 7.0).collect();
            let stack = stack([122, 187], &heights, grid(0.0, 98), |k, x, y| bent_body(x, y, heights[k]));
            let settings =
                Settings { end_bottom: EndRule::Extrapolate, end_top: EndRule::Extrapolate, ..Settings::default() };
            Some(Demo { name: "fig9", shows: "8 slices to 98, both ends extrapolated", stack, settings })
        }
        "fig10" => {
            let contour = |k: usize, x: f64, y: f64| match k {
                0 => (x - 33.0).hypot(y - 55.0) < 12.0 || (x - 77.0).hypot(y - 55.0) < 12.0,
                1 => (x - 55.0).abs() < 28.0 && (y - 55.0).abs() < 28.0,
                _ => circle(55.0, 38.0)(x, y),
            };
            let stack = stack([110, 110], &[0.0, 14.0, 28.0], grid(0.0, 29), contour);
            Some(Demo { name: "fig10", shows: "two circles, a square, a circle", stack, settings: Settings::default() })
        }
        _ => None,
    }
}

/// A closed body between heights 0 and 97: an ellipsoid, bent, with a waist.
fn bent_body(x: f64, y: f64, z: f64) -> bool {
    let s = (z - 48.5) / 48.5;
    let waist = 1.0 - 0.35 * (-(s / 0.35).powi(2)).exp();
    let size = (1.0 - s * s).max(0.0).sqrt() * waist;
    let (u, v) = (x - 61.0 - 9.0 * (2.5 * s).sin(), y - 93.0 - 14.0 * s);
    (u / 42.0).hypot(v / 66.0) < size
}

fn grid(start: f64, count: usize) -> HeightGrid {
    HeightGrid { start, step: 1.0, count }
}

fn stack(
    dims: [usize; 2],
    heights: &[f64],
    z_out: HeightGrid,
    inside: impl Fn(usize, f64, f64) -> bool,
) -> ContourStack {
    let slices = heights
        .iter()
        .enumerate()
        .map(|(k, &z)| Slice {
            name: format!("slice_{k:04}.png"),
            z,
            extra: false,
            content: SliceContent::Mask(
                (0..dims[0] * dims[1]).map(|n| inside(k, (n % dims[0]) as f64, (n / dims[0]) as f64)).collect(),
            ),
        })
        .collect();
    ContourStack {
        dims,
        spacing: [1.0, 1.0],
        unit: "px".into(),
        slices,
        z_out: Some(z_out),
        geometry: Geometry::default(),
    }
}
