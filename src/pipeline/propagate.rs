//! The second half of the metamorphosis: every interval swept from both sides, and its layers composed.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::context::{Context, Sink, time};
use super::ends::{above, below};
use super::sweep_inputs::{FieldFallback, SweepInputs};
use crate::backend::MorphOptions;
use crate::backend::jobs::{Filled, SweepJob, SweepPair};
use crate::backend::requests::{LayerRequest, SweepRequest};
use crate::contour::Contour;
use crate::contour::caps::Cap;
use crate::contour::direction::Direction;
use crate::error::{Error, Result};
use crate::grid::tile::Tile;
use crate::pipeline::compose::{Canvas, IntervalCaps, unite_cap};
use crate::pipeline::fit::{Fitted, course};
use crate::pipeline::matching::Interval;
use crate::pipeline::tracks::SideTracks;
use crate::registration::motion_field::{Cells, MotionField};
use crate::registration::particle_weight::Trust;
use crate::registration::warp::{Warp, Way};
use crate::report::Report;
use crate::settings::Settings;
use crate::stack::heights::BESIDE;
use crate::stack::heights::{Height, Heights};
use crate::storage::spill::SpillVec;
use crate::surface::Layer;

/// Bytes of the slices that are swept together.
pub(crate) const CHUNK_BYTES: usize = 256 << 20;

/// Share of an interval at which parts that are kept apart close: well before a third of it. Layers two or more between two contours have
/// one in the middle third, which neither part then reaches; a bound that looked for it would make layers depend on each other.
const APART: f64 = 0.8 / 3.0;

/// Largest difference of a time from that of the layer beside a contour.
const ROUNDING: f64 = 1e-6;

/// Change of distance from a contour to the layer beside, px, above which the two do not belong to one surface.
const GONE: f32 = 0.5;

/// Means that bring some layers of an interval from its frame to their places.
struct InFrame<'w> {
    warp: &'w Warp<'w>,
    trust: &'w Trust,
    ways: Vec<Way>,
    /// Cells in which the field method's layers, `others`, count.
    doubts: Vec<Cells>,
    others: Vec<Vec<f32>>,
}

impl SweepInputs<'_, '_> {
    /// Trust in the morphs of interval `i`, in its frame `moving`.
    fn trust(&self, moving: &MotionField, i: usize, h: [f64; 2], relief: f64) -> Result<Trust> {
        let seen = self.seen.some(i, Contour::SEEDS_AND_PARTS)?;
        let sides = self.sides.get(i)?;
        let ends = [sides.up.as_ref(), sides.down.as_ref()];
        // The field joins whatever overlaps: of parts that are kept apart the morph knows more.
        let apart = [0, 1].map(|end| {
            let mut parts = vec![false; seen[end].solids.count + 1];
            self.parted[i].iter().for_each(|pair| parts[[pair.0, pair.1][end] as usize] = true);
            parts
        });
        let particles = seen.iter().zip(ends).zip(&apart).flat_map(|((contour, side), apart)| {
            let tracks = side.map_or(&[][..], |s| &s.tracks);
            let known = |inside: usize| apart[contour.solids.labels[inside] as usize];
            contour
                .seeds
                .iter()
                .zip(tracks)
                .map(move |(seed, track)| (seed.x, if known(seed.inside) { 1.0 } else { track.kept }))
        });
        Ok(Trust::new(moving, 0, h, relief, particles))
    }
}

/// Sweeps and composes, some intervals at a time, so that only their tiles are in memory.
pub(super) fn propagate<'a>(
    run: &Context<'a>,
    made: &SweepInputs<'_, 'a>,
    heights: &Heights,
    report: &mut Report,
    sink: &mut Sink<'_>,
) -> Result<()> {
    let SweepInputs { contours, fitted, ends, .. } = made;
    below(run, contours, ends, heights, sink)?;
    for chunk in chunks(run, &made.intervals, heights) {
        let intervals = chunk.clone().map(|i| made.intervals.get(i)).collect::<Result<Vec<_>>>()?;
        let z = |i: usize| contours.light(i).z;
        let caps = |(i, interval): (usize, &Arc<Interval>)| {
            let latest = if made.parted[i].is_empty() { 1.0 } else { APART };
            let [low, high] = [fitted.get(i)?, fitted.get(i + 1)?];
            let farthest = run.settings.margin() as f64;
            Ok(IntervalCaps::new(interval, [&low, &high], z(i + 1) - z(i), latest, farthest))
        };
        let caps: Vec<IntervalCaps> = chunk.clone().zip(&intervals).map(caps).collect::<Result<_>>()?;
        let mut filled = sweep_chunk(run, chunk.clone(), made, &intervals, &caps, heights, report)?.into_iter();
        for ((i, caps), interval) in chunk.zip(&caps).zip(&intervals) {
            sink(run.contour_layer(&heights.contours[i], &*contours.some(i, Contour::FIELD)?, i))?;
            let filled: Vec<Filled> = filled.by_ref().take(interval.groups.len()).collect();
            layers_between(run, made, i, interval, caps, &filled, heights.between(i), sink)?;
        }
    }
    above(run, contours, ends, heights, sink)
}

/// The layers of interval `i`, some at a time.
#[expect(clippy::too_many_arguments, reason = "one stage reads what all stages before it have made")]
fn layers_between<'a>(
    run: &Context<'a>,
    made: &SweepInputs<'_, 'a>,
    i: usize,
    interval: &Interval,
    caps: &IntervalCaps,
    filled: &[Filled],
    heights: &[Height],
    sink: &mut Sink<'_>,
) -> Result<()> {
    let limit = run.settings.margin() as f64;
    let [low, high] = [i, i + 1].map(|k| made.contours.light(k).z);
    let between: Vec<(Height, f64)> = heights.iter().map(|x| (*x, time(x.z, low, high))).collect();
    let part = made.beside.as_ref().map(|b| b.moving.part(i..i + 2)).transpose()?;
    let beside = match (&made.beside, &part) {
        (Some(FieldFallback { slopes, lone, .. }), Some(part)) => {
            let trust = made.trust(part, i, run.h, relief(run))?;
            let warp = warp(run, made, part, i, begun(run, interval, caps, filled, &between));
            Some((part, [slopes.get(i)?, slopes.get(i + 1)?], lone.get(i)?, warp, trust))
        }
        _ => None,
    };
    // Of a layer its values in the mid frame, the other method's, and itrun.
    let at_once = run.budget.at_once(rayon::current_num_threads(), 2 * run.field_bytes());
    for (k, some) in between.chunks(at_once).enumerate() {
        let times: Vec<f64> = some.iter().map(|(_, t)| *t).collect();
        let frame = match &beside {
            None => None,
            Some((part, slopes, lone, warp, trust)) => {
                let ways: Vec<Way> = times.par_iter().map(|t| warp.way(*t)).collect();
                let doubts: Vec<Cells> = ways.par_iter().map(|way| way.doubts(run.padded(), trust)).collect();
                let (slopes, wanted) = ([&*slopes[0], &*slopes[1]], Some(doubts.as_slice()));
                let others = run.backend.moving_layers(&LayerRequest {
                    moving: part,
                    interval: 0,
                    slopes,
                    lone,
                    times: &times,
                    limit,
                    h: run.h,
                    wanted,
                })?;
                Some(InFrame { warp, trust, ways, doubts, others })
            }
        };
        let layers = compose(run, interval, caps, frame.as_ref(), some, k * at_once, filled);
        drop(frame);
        layers.into_iter().try_for_each(&mut *sink)?;
    }
    Ok(())
}

/// Share by which the field's slopes of relief replace the morph's: whoever asks for other slopes than the default ones gets them.
fn relief<'a>(run: &Context<'a>) -> f64 {
    let Settings { slope, clamp_bottom, clamp_top, .. } = run.settings;
    let asked = *slope != Settings::default().slope || clamp_bottom.is_some() || clamp_top.is_some();
    if asked { 0.0 } else { run.span.change.relief }
}

/// Warp from the mid frame of interval `i`, which is `part`, to its layers.
fn warp<'a, 'p>(
    run: &Context<'a>,
    made: &SweepInputs<'_, 'a>,
    part: &'p MotionField,
    i: usize,
    begun: [Vec<f32>; 2],
) -> Warp<'p> {
    // The frame's own field of a slice that is not empty is the slice's.
    let own = |side: usize| (made.contours.light(i + side).solids.count > 0).then(|| &*part.fields[side]);
    let slices = [0, 1].map(|side| (own(side), begun[side].as_slice()));
    Warp::new(part, 0, slices, run.settings.margin() as f64)
}

/// Body between the contours of an interval at either of them, in the mid frame: its ends, but for what is gone in the layer beside. A
/// crumb that the frame does not show is a valley in them, and the distances of layers are those to their own surface.
fn begun<'a>(
    run: &Context<'a>,
    interval: &Interval,
    caps: &IntervalCaps,
    filled: &[Filled],
    heights: &[(Height, f64)],
) -> [Vec<f32>; 2] {
    [Direction::Up, Direction::Down].map(|from| {
        let [mut begun, mut next] = [0, 1].map(|_| Canvas::empty(run.padded(), [0; 2], run.settings.margin() as f64));
        let away = |t: f64| if from == Direction::Up { t } else { 1.0 - t };
        let beside = heights.iter().position(|(_, t)| (away(*t) - BESIDE).abs() <= ROUNDING);
        for ((group, holes), filled) in interval.groups.iter().zip(&caps.holes).zip(filled) {
            let end = if from == Direction::Up { &group.low } else { &group.high };
            let holes: Vec<&Cap> = holes.iter().filter(|(_, way)| *way == from).map(|(cap, _)| cap).collect();
            let without = |n: usize| holes.iter().fold(end.phi.data[n], |v, hole| v.max(-hole.field.data[n]));
            begun.unite(&group.tile, without);
            if let Some(k) = beside {
                next.unite_packed(&group.tile, &filled.slices[k]);
            }
        }
        for (cap, _) in caps.solids.iter().filter(|(_, way)| *way == from) {
            unite_cap(&mut begun, cap, 0.0);
            unite_cap(&mut next, cap, BESIDE);
        }
        let mut begun = begun.phi.unpack();
        if beside.is_some() {
            let gone = begun.iter_mut().zip(next.phi.unpack()).filter(|(v, next)| (**v - next).abs() > GONE);
            gone.for_each(|(v, next)| *v = next);
        }
        begun
    })
}

fn sweep_chunk<'a>(
    run: &Context<'a>,
    chunk: Range<usize>,
    made: &SweepInputs<'_, 'a>,
    intervals: &[Arc<Interval>],
    caps: &[IntervalCaps],
    heights: &Heights,
    report: &mut Report,
) -> Result<Vec<Filled>> {
    let SweepInputs { contours, seen, sides, fitted, .. } = made;
    let mut pairs = Vec::new();
    let mut owners = Vec::new();
    for ((i, caps), interval) in chunk.zip(caps).zip(intervals) {
        let [low, high] = [i, i + 1].map(|k| contours.light(k).z);
        let gap = high - low;
        let up: Vec<f64> = heights.between(i).iter().map(|x| time(x.z, low, high)).collect();
        let down: Vec<f64> = up.iter().rev().map(|t| 1.0 - t).collect();
        let sides = sides.get(i)?;
        let (Some(up_side), Some(down_side)) = (&sides.up, &sides.down) else { continue };
        let [low_fitted, high_fitted] = [fitted.get(i)?, fitted.get(i + 1)?];
        let seeds = seen.some(i, Contour::SEEDS)?;
        let image_nx = run.padded()[0];
        for (group, holes) in interval.groups.iter().zip(&caps.holes) {
            let rule = run.settings.slope;
            let courses = |end: &[u32], own: &Fitted, next: &Fitted, side: &SideTracks, direction| {
                let of = |&k: &u32| {
                    let track = &side.tracks[k as usize];
                    course(own, track, next, k as usize, direction, gap, rule)
                };
                end.iter().map(of).collect()
            };
            let positions = |end: &[u32], side: usize| {
                end.iter().map(|&k| group.tile.to_local(seeds[side].seeds[k as usize].x)).collect()
            };
            pairs.push(SweepPair {
                up: SweepJob {
                    source: Cow::Borrowed(&group.low.phi),
                    goal: Cow::Borrowed(&group.high.phi),
                    seeds: positions(&group.low.seeds, 0),
                    courses: courses(&group.low.seeds, &low_fitted, &high_fitted, up_side, Direction::Up),
                    times: up.clone(),
                },
                down: SweepJob {
                    source: Cow::Borrowed(&group.high.phi),
                    goal: Cow::Borrowed(&group.low.phi),
                    seeds: positions(&group.high.seeds, 1),
                    courses: courses(&group.high.seeds, &high_fitted, &low_fitted, down_side, Direction::Down),
                    times: down.clone(),
                },
                anchors: group.local_anchors(image_nx),
                holes: Cow::Borrowed(holes),
            });
            owners.push(i);
        }
    }
    let request = SweepRequest { pairs: &pairs, h: run.h, options: MorphOptions::from(run.settings) };
    let filled = run.backend.propagate(&request, run.progress)?;
    for (f, &i) in filled.iter().zip(&owners) {
        let between = || format!("between heights {} and {}", contours.light(i).z, contours.light(i + 1).z);
        if f.slices.iter().any(|slice| slice.values().any(f32::is_nan)) {
            return Err(Error::Numerics { stage: "propagate", message: format!("NaN {}", between()) });
        }
        for (swept, way) in [(&f.up, "upward"), (&f.down, "downward")] {
            if let Some(t) = swept.vanished {
                let message = format!("the {way} sweep of a group {} vanished at t = {t:.3}", between());
                report.warnings.push(message);
            }
            let interval = &mut report.intervals[i];
            interval.sweep_steps += swept.steps;
            interval.sweep_pixels += swept.pixels;
        }
        report.contours[i + 1].arrival_from_below.get_or_insert_default().absorb(&f.up.residual);
        report.contours[i].arrival_from_above.get_or_insert_default().absorb(&f.down.residual);
    }
    Ok(filled)
}

/// Layers of an interval at some of its heights, the first of which is number `skip`.
fn compose<'a>(
    run: &Context<'a>,
    interval: &Interval,
    caps: &IntervalCaps,
    frame: Option<&InFrame<'_>>,
    heights: &[(Height, f64)],
    skip: usize,
    filled: &[Filled],
) -> Vec<Layer> {
    let limit = run.settings.margin() as f64;
    let padded = run.padded();
    let layer = |(k, (height, t)): (usize, &(Height, f64))| {
        let mut canvas = if frame.is_some() { Canvas::empty(padded, [0; 2], limit) } else { run.canvas() };
        for (f, group) in filled.iter().zip(&interval.groups) {
            canvas.unite_packed(&group.tile, &f.slices[skip + k]);
        }
        for (cap, direction) in &caps.solids {
            unite_cap(&mut canvas, cap, if *direction == Direction::Up { *t } else { 1.0 - t });
        }
        let Some(InFrame { warp, trust, ways, doubts, others }) = frame else { return run.layer(height, canvas) };
        let whole = warp.layer(&canvas.phi.unpack(), &ways[k], trust, &doubts[k], &others[k]);
        drop(canvas);
        let mut canvas = run.canvas();
        canvas.unite_packed(&Tile { origin: [0, 0], dims: padded }, &whole);
        run.layer(height, canvas)
    };
    heights.par_iter().enumerate().map(layer).collect()
}

/// Intervals that are swept together: enough for all threads and for a GPU, but no more slices than [`CHUNK_BYTES`] or the budget hold.
fn chunks<'a>(run: &Context<'a>, intervals: &SpillVec<'a, Interval>, heights: &Heights) -> Vec<Range<usize>> {
    let least = run.budget.at_once(2 * rayon::current_num_threads(), 10 * run.field_bytes());
    let most = run.budget.spare(CHUNK_BYTES);
    let mut out: Vec<Range<usize>> = Vec::new();
    let mut filled = 0;
    for i in run.span.layers.clone() {
        let nodes: usize = intervals.light(i).groups.iter().map(|g| g.tile.len()).sum();
        // Both ends of its groups, and the slices between.
        let bytes = nodes * (2 * size_of::<f64>() + size_of::<f32>() * heights.between(i).len());
        match out.last_mut() {
            Some(chunk) if chunk.len() < least || filled + bytes <= most => chunk.end = i + 1,
            _ => {
                out.push(i..i + 1);
                filled = 0;
            }
        }
        filled += bytes;
    }
    out
}
