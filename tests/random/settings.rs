//! Random settings, valid ones.

use interslice::grid::components::label4;
use interslice::settings::Link;
use interslice::settings::{AntiAlias, EndRule, Linking, Method, Motion, SlopeRule, SplineEnd};
use interslice::stack::ContourStack;
use interslice::{Settings, height_grid};

use super::case::Case;
use super::numbers::Numbers;

/// The default, or anything.
pub fn settings(n: &mut Numbers, stack: &ContourStack) -> Settings {
    if n.chance(0.4) {
        return Settings::default();
    }
    let motion = n.of(&[Motion::Field, Motion::Field, Motion::Field, Motion::Rigid, Motion::None]);
    let mut settings = Settings {
        method: n.of(&[Method::Morph, Method::Morph, Method::Field]),
        motion,
        fair: n.of(&[0.0, 1.5, n.clone().between(0.0, 1.5)]),
        link: if motion != Motion::None && n.chance(0.06) { Linking::Auto } else { Linking::Off },
        slope: n.of(&[
            SlopeRule::Hyman,
            SlopeRule::Hyman,
            SlopeRule::Pchip,
            SlopeRule::Natural,
            SlopeRule::Linear,
            SlopeRule::Catmull,
        ]),
        spline_end: Some(n.of(&[SplineEnd::Parabolic, SplineEnd::Natural, SplineEnd::NotAKnot])),
        anti_alias: n.of(&[AntiAlias::Kernel, AntiAlias::Kernel, AntiAlias::None, AntiAlias::Eq6]),
        ..Settings::default()
    };
    settings.end_bottom = end(n, stack, false);
    settings.end_top = end(n, stack, true);
    if n.chance(0.05) {
        settings.links = link(n, stack, &settings).into_iter().collect();
    }
    if n.chance(0.25) {
        settings.sigma = n.between(0.3, 2.5);
    }
    if n.chance(0.25) {
        settings.tolerance = n.ratio(0.01, 0.5);
    }
    if n.chance(0.25) {
        settings.cfl = n.between(0.15, 0.9);
    }
    if n.chance(0.15) {
        settings.seed_spacing = n.ratio(0.1, 2.0);
    }
    if n.chance(0.15) {
        settings.half_width = n.between(4.0, 8.0);
        settings.cut_off = n.between(1.0, settings.half_width - 1.0);
    }
    if n.chance(0.15) {
        settings.cap_gaps = Some(n.between(0.3, 4.0));
    }
    settings
}

/// Any two parts of neighbouring slices, joined or kept apart where the settings can.
fn link(n: &mut Numbers, stack: &ContourStack, settings: &Settings) -> Option<Link> {
    let slice = n.whole(0, stack.slices.len() - 2);
    let parts = [slice, slice + 1].map(|k| label4(&stack.slices[k].content.sides(), stack.dims).count);
    let join = n.chance(0.5);
    let possible = if join { settings.motion != Motion::None } else { settings.method == Method::Morph };
    if !possible || parts.contains(&0) {
        return None;
    }
    let [from, to] = parts.map(|count| n.whole(1, count) as u32);
    Some(Link { slice, from, to, join })
}

fn end(n: &mut Numbers, stack: &ContourStack, top: bool) -> EndRule {
    let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
    let last = z.len() - 1;
    let (from, gap) = if top { (z[last], z[last] - z[last - 1]) } else { (z[0], z[0] - z[1]) };
    match n.whole(0, 9) {
        0..=4 => EndRule::Flat,
        5 | 6 => EndRule::HalfSlice,
        7 | 8 => EndRule::Extrapolate,
        _ => EndRule::Peak(from + gap * n.between(0.2, 1.5)),
    }
}

/// Heights of the first and last contour.
pub fn ends(stack: &ContourStack) -> [f64; 2] {
    [stack.slices[0].z, stack.slices[stack.slices.len() - 1].z]
}

/// Mean distance of slices.
pub fn mean_gap(stack: &ContourStack) -> f64 {
    let [low, high] = ends(stack);
    (high - low) / (stack.slices.len() - 1) as f64
}

/// `count + 1` heights, equally spaced, from the first contour to the last.
pub fn inner_heights(stack: &ContourStack, count: usize) -> Vec<f64> {
    let [low, high] = ends(stack);
    (0..=count).map(|k| if k == count { high } else { low + (high - low) * k as f64 / count as f64 }).collect()
}

/// Every contour, `parts - 1` heights between neighbours, and as many in reach of the ends' rules.
pub fn fine_heights(stack: &ContourStack, settings: &Settings, parts: usize) -> Vec<f64> {
    let [low, high] = ends(stack);
    let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
    let grid =
        height_grid(&ContourStack { z_out: None, ..stack.clone() }, settings, Some(mean_gap(stack) / parts as f64));
    let reach = [grid.start, grid.start + grid.step * (grid.count - 1) as f64];
    let step = |from: f64, to: f64, k: usize| from + (to - from) * k as f64 / parts as f64;
    let mut heights: Vec<f64> =
        z.windows(2).flat_map(|w| (0..parts).map(|k| step(w[0], w[1], k)).collect::<Vec<_>>()).collect();
    heights.push(high);
    let beyond = |from: f64, to: f64| (1..=parts).map(|k| step(from, to, k)).collect::<Vec<_>>();
    let slack = 1e-3 * mean_gap(stack);
    if reach[0] < low - slack {
        heights.extend(beyond(low, reach[0]));
    }
    if reach[1] > high + slack {
        heights.extend(beyond(high, reach[1]));
    }
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    heights
}

/// The same, going on beyond both ends for every other seed, as the grid of a label volume does.
pub fn any_heights(case: &Case, parts: usize) -> Vec<f64> {
    let inner = fine_heights(&case.stack, &case.settings, parts);
    if case.seed.is_multiple_of(2) {
        return inner;
    }
    let step = mean_gap(&case.stack) / parts as f64;
    let below = (1..=3).rev().map(|k| inner[0] - f64::from(k) * step);
    let above = (1..=3).map(|k| inner[inner.len() - 1] + f64::from(k) * step);
    below.chain(inner.iter().copied()).chain(above).collect()
}
