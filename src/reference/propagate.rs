//! The sweep that makes the surface: each piece of contour moves by its course, is steered onto the next contour, and the level set is
//! copied out on the way (Eq. 1, with fields carried instead of particles).

use std::borrow::Cow;

use super::band::Band;
use super::extend::Upwind;
use super::hj_step::{Scratch, Speed, Tube, hj_step};
use super::reinit::reinit_share;
use super::scatter::scatter;
use super::trace::{arrival, trace};
use crate::backend::MorphOptions;
use crate::backend::jobs::{SweepJob, Swept, TraceJob};
use crate::contour::seeds::seeds;
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::grid::spline::{HermiteArc, bend, hermite, hermite_rate, smoothstep};
use crate::grid::stencil::{FRONT_REACH, cut_off, step_share};

/// Jacobi passes of the extension per step: 8 and 16 give the same.
pub const PASSES: usize = 4;
/// Jacobi passes of the extension at the start.
pub const FIRST_PASSES: usize = 8;
/// Largest time step, of a whole one.
pub const STEP_LIMIT: f64 = 0.1;
/// A step that reaches this share of what is left reaches the whole: rounding must not decide between one step and two.
pub const ALMOST: f64 = 1.0 - 1e-4;
/// Pieces whose particle died are steered from this time on, and wholly [`LATE_RAMP`] later.
pub const LATE: f64 = 0.6;
/// Time over which their steering grows.
pub const LATE_RAMP: f64 = 0.3;
/// Largest error that the feedback answers to at once, px.
pub const ERROR_LIMIT: f64 = 2.0;
/// The feedback's gain is `GAIN / (1 - t)`, at most `GAIN / LEAST_TIME`, and never more than one whole correction per step.
pub const GAIN: f64 = 2.0;
/// The time left that the gain counts with at least.
pub const LEAST_TIME: f64 = 0.02;

/// Distances re-estimated by a new morph on the way.
struct Remeasured {
    /// `[remaining distance, validity]` per pixel.
    field: Vec<[f64; 2]>,
}

/// Runs one sweep from t = 0 to t = 1: how it went, and the level set at each of the job's times, clamped to the tube.
pub fn propagate(job: &SweepJob<'_>, h: [f64; 2], options: &MorphOptions) -> (Swept, Vec<SparseImage<f32>>) {
    let mut phi = job.source.clone().into_owned();
    let mut band = Band::new(&mut phi, options.half_width);
    let tube = Tube { beta: options.cut_off, gamma: options.half_width };
    let mut scratch = Scratch::default();
    let (mut upwind, mut passes4, mut passes2, mut passes1) = (Upwind::default(), Vec::new(), Vec::new(), Vec::new());
    let mut courses: Vec<HermiteArc> = scatter(&phi, &band, h, &job.seeds, &job.courses);
    upwind.find(&phi, &band, h);
    upwind.extend(&mut courses, &band, FIRST_PASSES, &mut passes4);
    let mut speed = Field::filled(phi.dims, 0.0);
    let mut line: Vec<[f64; 1]> = vec![[0.0]; phi.data.len()];
    let mut errors: Vec<(usize, f64)> = Vec::new();
    let mut remeasured: Option<Remeasured> = None;
    let mut out = Swept::default();
    let mut fields = Vec::with_capacity(job.times.len());
    let mut before = Vec::new();
    let mut t = 0.0;
    while t < 1.0 {
        if !band.nodes().any(|n| phi.data[n] < 0.0) {
            out.vanished = Some(t);
            break;
        }
        if out.steps > 0 {
            upwind.find(&phi, &band, h);
            upwind.extend(&mut courses, &band, PASSES, &mut passes4);
            if let Some(r) = &mut remeasured {
                upwind.extend(&mut r.field, &band, PASSES, &mut passes2);
            }
        }
        if options.redistance > 0 && out.steps > 0 && out.steps.is_multiple_of(options.redistance) {
            remeasured = Some(remeasure(&phi, &job.goal, &band, &upwind, h, options));
        }
        measure(&mut errors, &phi, &job.goal, &band, &courses, remeasured.as_ref(), t, h);
        let weight = if remeasured.is_some() { 1.0 } else { smoothstep(t) };
        let gain = weight * GAIN / (1.0 - t).max(LEAST_TIME);
        let dt = step_length(&phi, &band, &courses, &errors, gain, t, h, options.cfl);
        for node in band.nodes() {
            let c = &courses[node];
            line[node] = [(hermite(c, t + dt) - hermite(c, t)) / dt];
        }
        for &(node, e) in &errors {
            line[node][0] += gain.min(weight / dt) * e;
        }
        upwind.extend(&mut line, &band, PASSES, &mut passes1);
        for node in band.nodes() {
            speed.data[node] = line[node][0];
        }
        if let Some(r) = &mut remeasured {
            band.nodes().for_each(|n| r.field[n][0] -= dt * speed.data[n]);
        }
        let next = if 1.0 - (t + dt) < 1e-9 { 1.0 } else { t + dt };
        let read = job.times[fields.len()..].iter().take_while(|&&time| time <= next).count();
        if read > 0 {
            before.clear();
            before.extend(band.nodes().map(|n| Before::new(phi.data[n], &courses[n], t, dt, tube)));
        }
        hj_step(&mut phi, Speed::Given(&speed), &band, h, tube, dt, &mut scratch);
        reinit_share(step_share(options.cfl), &mut phi, &band, h, &mut scratch);
        for k in fields.len()..fields.len() + read {
            let share = ((job.times[k] - t) / (next - t)).clamp(0.0, 1.0);
            fields.push(front_between(&before, &phi, &band, share));
        }
        out.pixels += band.count;
        out.steps += 1;
        band.rebuild(&mut phi);
        t = next;
    }
    let outside = Field::filled(phi.dims, options.half_width + 0.5);
    fields.resize_with(job.times.len(), || packed(&outside, options.half_width));
    if out.vanished.is_none() {
        out.residual = arrival(&phi, &job.goal, &band).unwrap_or_default();
    }
    (out, fields)
}

/// A band pixel at the start of a step: phi, and how far its course bends off the straight line over the step.
struct Before {
    phi: f64,
    bend: [f64; 2],
}

impl Before {
    fn new(phi: f64, course: &HermiteArc, t: f64, dt: f64, tube: Tube) -> Self {
        let moving = cut_off(phi, tube.beta, tube.gamma);
        Before { phi, bend: bend(course, t, dt).map(|b| moving * b) }
    }
}

/// The front at this share of a step, `(1 - q) phi_n + q phi_{n+1} + q (1 - q) (b + c q)`: steps are the sweep's own, whatever times are asked
/// for. With the bends b and c of the courses pieces of contour go as their courses go, not along the chords of steps.
fn front_between(before: &[Before], after: &Field, band: &Band, share: f64) -> SparseImage<f32> {
    // Pixels at the tile's edge never belong to N: they may know of a contour beyond the tile, which is none of this front's.
    let outside = band.gamma() + 0.5;
    let mut phi = Field { dims: after.dims, data: after.data.iter().map(|v| outside.copysign(*v)).collect() };
    for (node, b) in band.nodes().zip(before) {
        let bent = share * (1.0 - share) * (b.bend[0] + share * b.bend[1]);
        phi.data[node] = (1.0 - share) * b.phi + share * after.data[node] + bent;
    }
    packed(&phi, band.gamma())
}

/// The level set clamped to the tube.
fn packed(phi: &Field, half_width: f64) -> SparseImage<f32> {
    let (out, nx) = ((half_width + 0.5) as f32, phi.dims[0]);
    let [packed] = SparseImage::of_rows(phi.dims, |first, [rows]: [&mut [f32]; 1]| {
        rows.iter_mut().zip(&phi.data[first * nx..]).for_each(|(to, v)| *to = (*v as f32).clamp(-out, out));
    });
    packed
}

/// Errors `e = clip(remaining - scheduled remaining)` at the contour's pixels. Remaining is `-goal` at the closest contour point, the
/// true distance near the goal, or what the last morph measured. Pieces whose particle died are steered only late.
#[expect(clippy::too_many_arguments, reason = "the state of one sweep, read by one caller")]
fn measure(
    errors: &mut Vec<(usize, f64)>,
    phi: &Field,
    goal: &Field,
    band: &Band,
    courses: &[HermiteArc],
    remeasured: Option<&Remeasured>,
    t: f64,
    h: [f64; 2],
) {
    errors.clear();
    let late = smoothstep((t - LATE) / LATE_RAMP);
    for node in band.nodes().filter(|&n| phi.at_contour(n)) {
        let course = &courses[node];
        let (remaining, valid) = match remeasured {
            Some(r) => (r.field[node][0], course[3].min(r.field[node][1])),
            None => (-goal.sample(phi.closest_point(node, h)), course[3]),
        };
        let trust = (2.0 * (valid.max(late) - 0.5)).clamp(0.0, 1.0);
        let scheduled = course[0] - hermite(course, t);
        errors.push((node, trust * (remaining - scheduled).clamp(-ERROR_LIMIT, ERROR_LIMIT)));
    }
}

/// `min(CFL / max |F|, 0.1, 1 - t)`, the last two steps made equal. Nothing but the job decides: times at which the front is wanted are read
/// from within steps.
#[expect(clippy::too_many_arguments, reason = "the state of one sweep, read by one caller")]
fn step_length(
    phi: &Field,
    band: &Band,
    courses: &[HermiteArc],
    errors: &[(usize, f64)],
    gain: f64,
    t: f64,
    h: [f64; 2],
    cfl: f64,
) -> f64 {
    let scheduled = band
        .nodes()
        .filter(|&n| phi.data[n].abs() < FRONT_REACH)
        .map(|n| hermite_rate(&courses[n], t).abs())
        .fold(1e-6, f64::max);
    let steered =
        errors.iter().map(|&(n, e)| (hermite_rate(&courses[n], t) + gain * e).abs()).fold(scheduled, f64::max);
    let dt = (cfl * h[0].min(h[1]) / steered).min(STEP_LIMIT * step_share(cfl));
    let left = 1.0 - t;
    if dt >= left * ALMOST {
        left
    } else if left < 2.0 * dt {
        0.5 * left
    } else {
        dt
    }
}

/// A new morph from the front as it is, as the paper does: remaining distances at its particles, brought to the pixels.
fn remeasure(
    phi: &Field,
    goal: &Field,
    band: &Band,
    upwind: &Upwind,
    h: [f64; 2],
    options: &MorphOptions,
) -> Remeasured {
    let seeds = seeds(phi, h, options.seed_spacing);
    let positions: Vec<_> = seeds.iter().map(|s| s.x).collect();
    let traced = trace(&TraceJob { source: Cow::Borrowed(phi), goal: Cow::Borrowed(goal), seeds }, h, options);
    let values: Vec<_> = traced.tracks.iter().map(|k| [k.distance, k.kept]).collect();
    let mut field = scatter(phi, band, h, &positions, &values);
    upwind.extend(&mut field, band, FIRST_PASSES, &mut Vec::new());
    Remeasured { field }
}
