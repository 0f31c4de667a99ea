//! The two paths agree, within the bounds that `tests/gpu/both_paths.rs` states.

use interslice::settings::Method;
use interslice::surface::Layer;
use interslice::{Reconstruction, Reference};

use super::{Case, Checked, Property, any, made, within};
use crate::random::measure::px;
use crate::random::settings::any_heights;
use crate::random::source::{Program, Source};

/// Pixels that may lie on the other side, of all pixels.
const SIDES: f64 = 5e-4;
/// Largest difference for all but some of the pixels within 3 px of the surface, px, and how many these may be: by the morph and by the field
/// method.
const NEAR: [(f64, f64); 2] = [(0.02, 1e-3), (1e-3, 0.0)];
/// Layers in every interval.
const PARTS: usize = 4;

pub const PROPERTY: Property = Property { name: "paths", draw: any, check, damage: None };

fn check(case: &Case, source: &dyn Source) -> Checked {
    if !source.is_single() {
        return Ok(None);
    }
    let stack = &case.stack;
    let heights = any_heights(case, PARTS);
    let double = Program { backend: &Reference, single: false };
    let a = made(source.layers(stack, &heights, &case.settings))?;
    let b = made(double.layers(stack, &heights, &case.settings))?;
    let (figure, what) = disagreement(&a, &b, px(stack), case.settings.method);
    within(figure, 1.0, || what)
}

/// The worst of all differences in units of its bound.
pub fn disagreement(a: &Reconstruction, b: &Reconstruction, px: f64, method: Method) -> (f64, String) {
    let (bound, exceptions) = NEAR[usize::from(method == Method::Field)];
    let pairs: Vec<_> = a.layers.iter().zip(&b.layers).collect();
    // The plane of an end that is found in single precision.
    let same = |(a, b): &(&Layer, &Layer)| (a.z - b.z).abs() <= 1e-6 * b.z.abs().max(px);
    if a.layers.len() != b.layers.len() || !pairs.iter().all(same) {
        let heights = |body: &Reconstruction| body.layers.iter().map(|l| l.z).collect::<Vec<_>>();
        return (f64::INFINITY, format!("other layers, {:?} and {:?}", heights(a), heights(b)));
    }
    let (mut all, mut sides, mut near, mut off, mut worst) = (0usize, 0usize, 0usize, 0usize, 0.0f64);
    for (a, b) in pairs.iter().flat_map(|(a, b)| a.phi.iter().zip(b.phi.iter())) {
        all += 1;
        sides += usize::from((*a < 0.0) != (*b < 0.0));
        if f64::from(b.abs()) < 3.0 * px {
            near += 1;
            let d = f64::from((a - b).abs()) / px;
            off += usize::from(d.is_nan() || d > bound);
            worst = worst.max(d);
        }
    }
    let seeds = |body: &Reconstruction| body.report.intervals.iter().map(|i| i.particles.seeded).collect::<Vec<_>>();
    let events = |body: &Reconstruction| body.report.intervals.iter().map(|i| i.events.clone()).collect::<Vec<_>>();
    let mut what = format!(
        "{sides} of {all} px on the other side, {off} of {near} off by more than {bound}, worst {worst:.1e} px"
    );
    let mut figure = sides as f64 / (SIDES * all as f64);
    let off_by = if exceptions > 0.0 { off as f64 / (exceptions * near.max(1) as f64) } else { worst / bound };
    figure = figure.max(off_by);
    for (name, same) in [("seeds", seeds(a) == seeds(b)), ("events", events(a) == events(b))] {
        if !same {
            figure = figure.max(2.0);
            what = format!("other {name}; {what}");
        }
    }
    (figure, what)
}
