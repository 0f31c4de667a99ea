//! Stacks of the sizes of the paper's figures (Nilsson, Breen and Museth), made here. Figures 5, 6 and 10 are drawn as it describes them; the
//! bodies of the others are ours, and stand for what the figure shows.

mod bodies;

use bodies::{TRUNK_HEIGHTS, bent_body, girdle, mountain, trunk};

use crate::settings::{EndRule, Settings, SlopeRule};
use crate::stack::{ContourStack, Geometry, HeightGrid, Slice, SliceContent};

/// A synthetic stack and the settings that show what it is for.
#[derive(Debug, Clone)]
pub struct Demo {
    /// Name: "fig5" and so on.
    pub name: &'static str,
    /// Sentence on what it shows.
    pub shows: &'static str,
    /// The contours.
    pub stack: ContourStack,
    /// Settings to reconstruct it with.
    pub settings: Settings,
}

/// Names of all demos.
pub const NAMES: [&str; 7] = ["fig1", "fig5", "fig6", "fig7", "fig8", "fig9", "fig10"];

/// The demo of that name.
pub fn demo(name: &str) -> Option<Demo> {
    let natural = Settings { slope: SlopeRule::Natural, ..Settings::default() };
    let circle = |c: f64, r: f64| move |x: f64, y: f64| (x - c).hypot(y - c) < r;
    match name {
        "fig1" => {
            let heights: Vec<f64> = (0..35).map(|k| 4.0 * f64::from(k)).collect();
            let stack = stack([420, 300], &heights, grid(0.0, 137), |k, x, y| girdle(x, y, heights[k] / 136.0));
            let shows = "35 slices of 420 x 300 px: a body of ours with the parts of a pelvis";
            Some(Demo { name: "fig1", shows, stack, settings: Settings::default() })
        }
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
        "fig7" => {
            let levels = [0.0, 200.0, 400.0, 600.0, 800.0];
            let contour = |k: usize, x, y| mountain(x, y) > levels[k];
            let heights = HeightGrid { start: 0.0, step: 10.0, count: 81 };
            let stack =
                ContourStack { spacing: [30.0; 2], unit: "m".into(), ..stack([276, 276], &levels, heights, contour) };
            let shows = "5 contour lines of a mountain of ours, 276 x 276 px";
            Some(Demo { name: "fig7", shows, stack, settings: Settings::default() })
        }
        "fig8" => {
            let contour = |k: usize, x, y| trunk(x, y, TRUNK_HEIGHTS[k]);
            let heights = HeightGrid { start: 0.0, step: 1.5, count: 81 };
            let stack = stack([155, 522], &TRUNK_HEIGHTS, heights, contour);
            let stack = ContourStack { spacing: [0.958, 2.194], unit: "mm".into(), ..stack };
            let shows = "12 unevenly spaced slices of 155 x 522 oblong px: a trunk with arms, of ours";
            Some(Demo { name: "fig8", shows, stack, settings: Settings::default() })
        }
        "fig9" => {
            let heights: Vec<f64> = (0..8).map(|k| 6.0 + f64::from(k) * 85.0 / 7.0).collect();
            let stack = stack([122, 187], &heights, grid(0.0, 98), |k, x, y| bent_body(x, y, heights[k]));
            let settings =
                Settings { end_bottom: EndRule::Extrapolate, end_top: EndRule::Extrapolate, ..Settings::default() };
            Some(Demo {
                name: "fig9",
                shows: "8 slices to 98 of a body of ours, both ends extrapolated",
                stack,
                settings,
            })
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
        known: None,
    }
}
