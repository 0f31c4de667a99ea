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
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::pipeline::compose::{Canvas, IntervalCaps, unite_cap};
use crate::pipeline::fit::{Fitted, course};
use crate::pipeline::matching::Interval;
use crate::pipeline::tracks::SideTracks;
use crate::registration::motion_field::{Cells, LoneParts, MotionField};
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
    others: Vec<SparseImage<f32>>,
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
        for together in run.intervals_together(chunk.clone(), heights) {
            let piece = |i: usize| {
                let (interval, caps) = (&*intervals[i - chunk.start], &caps[i - chunk.start]);
                let [low, high] = [i, i + 1].map(z);
                let layers = heights.between(i).iter().map(|x| (*x, time(x.z, low, high))).collect();
                Piece { i, interval, caps, filled: filled.by_ref().take(interval.groups.len()).collect(), layers }
            };
            let pieces = together.map(piece).collect();
            layers_between(run, made, pieces, heights, sink)?;
        }
    }
    above(run, contours, ends, heights, sink)
}

/// An interval whose layers are to be composed.
struct Piece<'p> {
    i: usize,
    interval: &'p Interval,
    caps: &'p IntervalCaps,
    filled: Vec<Filled>,
    layers: Vec<(Height, f64)>,
}

/// What the field method says between the slices of an interval, and what brings the morph's layers to their places.
struct Beside<'p> {
    part: &'p MotionField,
    slopes: [Arc<Field>; 2],
    lone: Arc<LoneParts>,
    warp: Warp<'p>,
    trust: Trust,
}

/// The layers of some intervals, each with its lower contour before it: those of an interval alone some at a time, those of several all at once.
fn layers_between<'a>(
    run: &Context<'a>,
    made: &SweepInputs<'_, 'a>,
    pieces: Vec<Piece<'_>>,
    heights: &Heights,
    sink: &mut Sink<'_>,
) -> Result<()> {
    let part = |piece: &Piece<'_>| made.beside.as_ref().map(|b| b.moving.part(piece.i..piece.i + 2)).transpose();
    let parts: Vec<Option<MotionField>> = pieces.iter().map(part).collect::<Result<_>>()?;
    let beside = |(piece, part)| beside(run, made, piece, part);
    let beside: Vec<Option<Beside<'_>>> = pieces.par_iter().zip(&parts).map(beside).collect::<Result<_>>()?;
    let most = pieces.iter().map(|piece| piece.layers.len()).max().unwrap_or(0);
    let at_once = if pieces.len() > 1 { most.max(1) } else { run.layers_at_once() };
    for first in (0..most.max(1)).step_by(at_once) {
        let some = |piece: &Piece<'_>| first.min(piece.layers.len())..(first + at_once).min(piece.layers.len());
        let mut frames = frames(run, &beside, pieces.iter().map(|piece| &piece.layers[some(piece)]))?.into_iter();
        for piece in &pieces {
            if first == 0 {
                let contour = made.contours.some(piece.i, Contour::FIELD)?;
                sink(run.contour_layer(&heights.contours[piece.i], &contour, piece.i))?;
            }
            let frame = frames.next().flatten();
            let layers = compose(run, piece, frame.as_ref(), some(piece));
            drop(frame);
            layers.into_iter().try_for_each(&mut *sink)?;
        }
    }
    Ok(())
}

/// What is beside the morph in an interval, which is `part`.
fn beside<'a, 'p>(
    run: &Context<'a>,
    made: &SweepInputs<'_, 'a>,
    piece: &Piece<'_>,
    part: &'p Option<MotionField>,
) -> Result<Option<Beside<'p>>> {
    let (Some(FieldFallback { slopes, lone, .. }), Some(part)) = (&made.beside, part) else { return Ok(None) };
    let i = piece.i;
    let trust = made.trust(part, i, run.h, relief(run))?;
    let warp = warp(run, made, part, i, begun(run, piece));
    Ok(Some(Beside { part, slopes: [slopes.get(i)?, slopes.get(i + 1)?], lone: lone.get(i)?, warp, trust }))
}

/// What brings these layers of some intervals to their places, with the field method's layers, which are asked for together.
fn frames<'f>(
    run: &Context<'_>,
    beside: &'f [Option<Beside<'_>>],
    layers: impl Iterator<Item = &'f [(Height, f64)]>,
) -> Result<Vec<Option<InFrame<'f>>>> {
    let placed = |(beside, layers): (&'f Option<Beside<'_>>, &[(Height, f64)])| {
        let Beside { warp, trust, .. } = beside.as_ref()?;
        let times: Vec<f64> = layers.iter().map(|(_, t)| *t).collect();
        let ways: Vec<Way> = times.par_iter().map(|t| warp.way(*t)).collect();
        let doubts: Vec<Cells> = ways.par_iter().map(|way| way.doubts(run.padded(), trust)).collect();
        Some((times, InFrame { warp, trust, ways, doubts, others: Vec::new() }))
    };
    let placed: Vec<Option<(Vec<f64>, InFrame<'f>)>> = beside.iter().zip(layers).map(placed).collect();
    let limit = run.settings.margin() as f64;
    let mut requests = Vec::new();
    for (beside, placed) in beside.iter().zip(&placed) {
        let (Some(Beside { part, slopes, lone, .. }), Some((times, frame))) = (beside, placed) else { continue };
        let (slopes, wanted) = (slopes.each_ref(), Some(frame.doubts.as_slice()));
        requests.push(LayerRequest { moving: part, interval: 0, slopes, lone, times, limit, h: run.h, wanted });
    }
    let mut others = match requests.is_empty() {
        true => Vec::new(),
        false => run.backend.moving_layers(&requests)?,
    }
    .into_iter();
    let mut whole =
        |(_, frame): (Vec<f64>, InFrame<'f>)| InFrame { others: others.next().unwrap_or_default(), ..frame };
    Ok(placed.into_iter().map(|placed| placed.map(&mut whole)).collect())
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
fn begun<'a>(run: &Context<'a>, &Piece { interval, caps, ref filled, ref layers, .. }: &Piece<'_>) -> [Vec<f32>; 2] {
    [Direction::Up, Direction::Down].map(|from| {
        let [mut begun, mut next] = [0, 1].map(|_| Canvas::empty(run.padded(), [0; 2], run.settings.margin() as f64));
        let away = |t: f64| if from == Direction::Up { t } else { 1.0 - t };
        let beside = layers.iter().position(|(_, t)| (away(*t) - BESIDE).abs() <= ROUNDING);
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

/// These layers of an interval.
fn compose<'a>(
    run: &Context<'a>,
    &Piece { interval, caps, ref filled, ref layers, .. }: &Piece<'_>,
    frame: Option<&InFrame<'_>>,
    some: Range<usize>,
) -> Vec<Layer> {
    let limit = run.settings.margin() as f64;
    let padded = run.padded();
    let layer = |seen: &mut Vec<f32>, (k, (height, t)): (usize, &(Height, f64))| {
        let mut canvas = if frame.is_some() { Canvas::empty(padded, [0; 2], limit) } else { run.canvas() };
        for (f, group) in filled.iter().zip(&interval.groups) {
            canvas.unite_packed(&group.tile, &f.slices[some.start + k]);
        }
        for (cap, direction) in &caps.solids {
            unite_cap(&mut canvas, cap, if *direction == Direction::Up { *t } else { 1.0 - t });
        }
        let Some(InFrame { warp, trust, ways, doubts, others }) = frame else { return run.layer(height, canvas) };
        canvas.phi.unpack_to(seen);
        drop(canvas);
        let whole = warp.layer(seen, &ways[k], trust, &doubts[k], &others[k]);
        let mut canvas = run.canvas();
        canvas.unite_packed(&Tile { origin: [0, 0], dims: padded }, &whole);
        run.layer(height, canvas)
    };
    layers[some.clone()].par_iter().enumerate().map_init(Vec::new, layer).collect()
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
