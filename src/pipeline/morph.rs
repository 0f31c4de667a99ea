//! The metamorphosis: contours morphed into each other, courses fitted, sweeps composed.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::links::{IntervalLinks, in_frame};
use super::{CHUNK_BYTES, Run, Sink, time};
use crate::backend::MorphOptions;
use crate::compose::{Canvas, HALF_WAY, IntervalCaps, unite_cap};
use crate::contours::Contour;
use crate::ends::End;
use crate::error::{Error, Result};
use crate::field::Field;
use crate::fit::{Fitted, Measured, course, fit};
use crate::heights::{Height, Heights};
use crate::jobs::{Direction, Filled, PartJob, SweepJob, SweepPair};
use crate::matching::{Interval, IntervalPlan};
use crate::moving_field::{Cells, LoneParts, MovingField};
use crate::moving_stack::MovingStack;
use crate::report::IntervalReport;
use crate::settings::Motion;
use crate::shelf::Shelf;
use crate::surface::Layer;
use crate::surface::stream::LayerSink;
use crate::tile::Tile;
use crate::topology::Decided;
use crate::tracks::{self, Side, Sides, trace_job};
use crate::trust::Trust;
use crate::warp::{Warp, Way};

/// Parts that are kept apart close at this share of the way to the layer nearest half way.
const EARLY: f64 = 0.8;

/// Pairs of parts by their numbers.
type Pairs = Vec<(u32, u32)>;
/// The two contours of an interval in its frame.
type Seen = [Arc<Contour>; 2];

/// The moving frame, and what the field method needs where the morph knows nothing.
struct Beside<'c, 'b> {
    moving: &'c MovingStack<'b>,
    slopes: Shelf<'b, Field>,
    lone: Shelf<'b, LoneParts>,
}

/// The contours of all intervals in their frames.
struct SeenStack<'c, 'b> {
    contours: &'c Shelf<'b, Contour>,
    /// Lower and upper contour of each interval; `None` where contours stay in the image's own frame.
    moved: Option<Shelf<'b, Contour>>,
}

impl SeenStack<'_, '_> {
    fn get(&self, i: usize) -> Result<Seen> {
        match &self.moved {
            Some(moved) => Ok([moved.get(2 * i)?, moved.get(2 * i + 1)?]),
            None => Ok([self.contours.get(i)?, self.contours.get(i + 1)?]),
        }
    }

    /// The same with some of their arrays.
    fn some(&self, i: usize, wanted: &[usize]) -> Result<Seen> {
        let of = |end: usize| match &self.moved {
            Some(moved) => moved.some(2 * i + end, wanted),
            None => self.contours.some(i + end, wanted),
        };
        Ok([of(0)?, of(1)?])
    }
}

/// What the stages before the sweeps have made.
struct Made<'c, 'b> {
    contours: &'c Shelf<'b, Contour>,
    beside: Option<Beside<'c, 'b>>,
    seen: SeenStack<'c, 'b>,
    /// Pairs that are kept apart, as the mid frame numbers them.
    parted: Vec<Pairs>,
    intervals: Shelf<'b, Interval>,
    sides: Shelf<'b, Sides>,
    fitted: Shelf<'b, Fitted>,
    ends: [End; 2],
}

/// What brings some layers of an interval from its frame to where they belong.
struct InFrame<'w> {
    warp: &'w Warp<'w>,
    trust: &'w Trust,
    ways: Vec<Way>,
    /// Where the field method's layers, `others`, have a say.
    doubts: Vec<Cells>,
    others: Vec<Vec<f32>>,
}

impl Made<'_, '_> {
    /// How far the morphs of interval `i` can be trusted, in its frame, where it is `moving`.
    fn trust(&self, moving: &MovingField, i: usize) -> Result<Trust> {
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
            contour.seeds.iter().zip(tracks).map(move |(seed, track)| (seed.x, track.arrived || known(seed.inside)))
        });
        Ok(Trust::new(moving, 0, particles))
    }
}

impl<'a> Run<'a> {
    /// All stages after the distance; the heights at which the body ends.
    pub(super) fn morph(
        &mut self,
        contours: &Shelf<'a, Contour>,
        heights: &[f64],
        sink: &mut dyn LayerSink,
    ) -> Result<[f64; 2]> {
        let count = contours.len() - 1;
        let moving = match self.settings.motion {
            Motion::Field | Motion::Rigid => Some(self.moving(contours)?),
            Motion::None => None,
        };
        self.see_links(contours, moving.as_ref())?;
        let (seen, parted) = self.seen(contours, moving.as_ref())?;
        let intervals = self.stage("match", count, |run| run.matching(&seen, &parted))?;
        let jobs = (0..count).map(|i| 2 * intervals.light(i).groups.len()).sum();
        let sides = self.stage("trace", jobs, |run| run.trace(&seen, &intervals, moving.as_ref()))?;
        let fitted = self.stage("fit", 1, |run| {
            let measured = Measured { contours, sides: &sides, h: run.h, px: run.px };
            fit(&measured, run.settings, run.budget, |i, fitted| {
                // A slope that the user gives is the whole slope.
                let given = match i {
                    0 => run.settings.clamp_bottom,
                    _ if i == count => run.settings.clamp_top,
                    _ => None,
                };
                match (&moving, given) {
                    (Some(moving), Some(_)) => {
                        Ok(fitted.with_motion(&*contours.get(i)?, &*moving.rate(i)?, run.h, -1.0))
                    }
                    _ => Ok(fitted),
                }
            })
        })?;
        let ends = self.ends(contours, [&*fitted.get(0)?, &*fitted.get(count)?], moving.as_ref())?;
        let extent = ends.each_ref().map(|end| end.extent);
        let heights = self.heights(heights, extent)?;
        sink.begin(&self.header(&heights, extent))?;
        let sink: &mut Sink<'_> = &mut |layer| sink.layer(layer);
        let beside = match &moving {
            None => None,
            Some(moving) => {
                let slopes = self.slopes(moving)?;
                Some(Beside { moving, slopes, lone: self.lone_parts(contours, moving)? })
            }
        };
        let made = Made { contours, beside, seen, parted, intervals, sides, fitted, ends };
        self.stage("propagate", jobs, |run| {
            run.faired(contours, moving.as_ref(), sink, |run, sink| run.propagate(&made, &heights, sink))
        })?;
        Ok(extent)
    }

    /// The contours of every interval in its frame, and the pairs of parts that are kept apart there.
    fn seen<'c>(
        &self,
        contours: &'c Shelf<'a, Contour>,
        moving: Option<&MovingStack<'a>>,
    ) -> Result<(SeenStack<'c, 'a>, Vec<Pairs>)> {
        let count = contours.len() - 1;
        let Some(moving) = moving else {
            let parted = self.links.iter().map(IntervalLinks::parted).collect();
            return Ok((SeenStack { contours, moved: None }, parted));
        };
        let (mut moved, mut all_parted) = (Shelf::new(self.budget), Vec::with_capacity(count));
        // Two contours as they are and as the frame sees them.
        let at_once = self.budget.at_once(count, 8 * self.field_bytes());
        let traced = self.span.traced.clone();
        let none = |moved: &mut Shelf<'a, Contour>| [(); 2].iter().try_for_each(|()| moved.push(Contour::default()));
        (0..traced.start).try_for_each(|_| none(&mut moved))?;
        all_parted.resize(traced.start, Pairs::new());
        for first in traced.clone().step_by(at_once) {
            let some = first..(first + at_once).min(traced.end);
            let of_interval = |i: usize| {
                let parted = self.links[i].parted();
                let own = |k: usize| match parted.is_empty() && contours.light(k).solids.count > 0 {
                    true => contours.some(k, Contour::SEEDS_AND_FIELD),
                    false => contours.get(k),
                };
                let own = [own(i)?, own(i + 1)?];
                let frame = moving.middle(i)?;
                let seen = frame.contours(&own[0], &own[1]).map(Cow::into_owned);
                let parted = in_frame(&parted, [&own[0], &own[1]], seen.each_ref(), &frame);
                Ok((seen, parted))
            };
            for made in some.into_par_iter().map(of_interval).collect::<Result<Vec<_>>>()? {
                made.0.into_iter().try_for_each(|contour| moved.push(contour))?;
                all_parted.push(made.1);
            }
        }
        (traced.end..count).try_for_each(|_| none(&mut moved))?;
        all_parted.resize(count, Pairs::new());
        Ok((SeenStack { contours, moved: Some(moved) }, all_parted))
    }

    fn matching(&mut self, seen: &SeenStack<'_, 'a>, parted: &[Pairs]) -> Result<Shelf<'a, Interval>> {
        let (margin, count) = (self.margin, parted.len());
        let mut intervals = Shelf::new(self.budget);
        // Both contours, both ends of all groups, cut and answered.
        let at_once = self.budget.at_once(count, 8 * self.field_bytes());
        let traced = self.span.traced.clone();
        for first in (0..count).step_by(at_once) {
            let some = first..(first + at_once).min(count);
            let plan = |i: usize| {
                if !traced.contains(&i) {
                    return Ok((IntervalPlan::default(), [0.0; 2]));
                }
                let [low, high] = seen.get(i)?;
                let plan = IntervalPlan::new(&low, &high, &Decided::parting(parted[i].clone()), margin);
                Ok((plan, [low.z, high.z]))
            };
            let mut plans = some.into_par_iter().map(plan).collect::<Result<Vec<_>>>()?;
            let jobs: Vec<PartJob> = plans.iter_mut().flat_map(|(plan, _)| plan.take_jobs()).collect();
            let mut fields = self.backend.part_fields(&jobs, self.h)?.into_iter();
            drop(jobs);
            for (plan, [z_low, z_high]) in plans {
                let interval = plan.finish(&mut fields);
                self.report.intervals.push(IntervalReport {
                    z_low,
                    z_high,
                    groups: interval.groups.len(),
                    events: interval.events.clone(),
                    ..IntervalReport::default()
                });
                intervals.push(interval)?;
                self.progress.advance(1);
            }
        }
        Ok(intervals)
    }

    /// Both morphs of every group, up and down, and what they say of the contours' seeds.
    fn trace(
        &mut self,
        seen: &SeenStack<'_, 'a>,
        intervals: &Shelf<'a, Interval>,
        moving: Option<&MovingStack<'a>>,
    ) -> Result<Shelf<'a, Sides>> {
        let count = intervals.len();
        let mut sides = Shelf::new(self.budget);
        (0..self.span.traced.start).try_for_each(|_| sides.push(Sides::default()))?;
        // Both ends of all groups, and what a morph of each keeps.
        let at_once = self.budget.at_once(count, 10 * self.field_bytes());
        for first in self.span.traced.clone().step_by(at_once) {
            let some = first..(first + at_once).min(self.span.traced.end);
            let loaded = some.clone().map(|i| intervals.get(i)).collect::<Result<Vec<_>>>()?;
            let mut jobs = Vec::new();
            let mut owners = Vec::new();
            for (i, interval) in some.clone().zip(&loaded) {
                let [low, high] = seen.some(i, Contour::SEEDS)?;
                for group in &interval.groups {
                    jobs.push(trace_job(group, &low.seeds, Direction::Up));
                    jobs.push(trace_job(group, &high.seeds, Direction::Down));
                    owners.extend([i, i]);
                }
            }
            let traced = self.backend.trace(&jobs, self.h, &MorphOptions::from(self.settings), self.progress)?;
            for (t, &i) in traced.iter().zip(&owners) {
                let report = &mut self.report.intervals[i];
                if let Some(k) = t.tracks.iter().position(|k| !(k.distance.is_finite() && k.landing[0].is_finite())) {
                    let message =
                        format!("particle {k} between heights {} and {} is lost", report.z_low, report.z_high);
                    return Err(Error::Numerics { stage: "trace", message });
                }
                report.trace_steps += t.steps;
                report.trace_pixels += t.pixels;
                let arrived = t.tracks.iter().filter(|k| k.arrived).count();
                report.particles.seeded += t.tracks.len();
                report.particles.arrived += arrived;
                report.particles.died += t.tracks.len() - arrived;
            }
            let mut traced = traced.into_iter();
            for (i, interval) in some.zip(&loaded) {
                let own = |i| seen.contours.some(i, Contour::SEEDS_AND_PARTS);
                let [low, high] = [own(i)?, own(i + 1)?];
                let frame = moving.map(|m| m.middle(i)).transpose()?.unwrap_or_default();
                let [up, down] = tracks::sides([&low, &high], interval, &frame, &mut traced);
                sides.push(Sides { up: Some(up), down: Some(down) })?;
            }
        }
        (self.span.traced.end..count).try_for_each(|_| sides.push(Sides::default()))?;
        Ok(sides)
    }

    /// Sweeps and composes, some intervals at a time, so that only their tiles are in memory.
    fn propagate(&mut self, made: &Made<'_, 'a>, heights: &Heights, sink: &mut Sink<'_>) -> Result<()> {
        let Made { contours, fitted, ends, .. } = made;
        self.below(contours, ends, heights, sink)?;
        for chunk in self.chunks(&made.intervals, heights) {
            let intervals = chunk.clone().map(|i| made.intervals.get(i)).collect::<Result<Vec<_>>>()?;
            let z = |i: usize| contours.light(i).z;
            let caps = |(i, interval): (usize, &Arc<Interval>)| {
                let closes = if made.parted[i].is_empty() { HALF_WAY } else { self.middle_layer(heights, i) };
                let [low, high] = [fitted.get(i)?, fitted.get(i + 1)?];
                Ok(IntervalCaps::new(interval, &low, &high, z(i + 1) - z(i), closes))
            };
            let caps: Vec<IntervalCaps> = chunk.clone().zip(&intervals).map(caps).collect::<Result<_>>()?;
            let mut filled = self.sweep_chunk(chunk.clone(), made, &intervals, &caps, heights)?.into_iter();
            for ((i, caps), interval) in chunk.zip(&caps).zip(&intervals) {
                sink(self.contour_layer(&heights.contours[i], &*contours.some(i, Contour::FIELD)?, i))?;
                let filled: Vec<Filled> = filled.by_ref().take(interval.groups.len()).collect();
                self.layers_between(made, i, interval, caps, &filled, heights.between(i), sink)?;
            }
        }
        self.above(contours, ends, heights, sink)
    }

    /// The layers of interval `i`, some at a time.
    #[expect(clippy::too_many_arguments, reason = "one stage reads what all stages before it have made")]
    fn layers_between(
        &self,
        made: &Made<'_, 'a>,
        i: usize,
        interval: &Interval,
        caps: &IntervalCaps,
        filled: &[Filled],
        heights: &[Height],
        sink: &mut Sink<'_>,
    ) -> Result<()> {
        let limit = self.settings.margin() as f64;
        let [low, high] = [i, i + 1].map(|k| made.contours.light(k).z);
        let between: Vec<(Height, f64)> = heights.iter().map(|x| (*x, time(x.z, low, high))).collect();
        let part = made.beside.as_ref().map(|b| b.moving.part(i..i + 2)).transpose()?;
        let beside = match (&made.beside, &part) {
            (Some(Beside { slopes, lone, .. }), Some(part)) => {
                let trust = made.trust(part, i)?;
                let warp = self.warp(made, part, i)?;
                Some((part, [slopes.get(i)?, slopes.get(i + 1)?], lone.get(i)?, warp, trust))
            }
            _ => None,
        };
        // Of a layer its values in the mid frame, the other method's, and itself.
        let at_once = self.budget.at_once(rayon::current_num_threads(), 2 * self.field_bytes());
        for (k, some) in between.chunks(at_once).enumerate() {
            let times: Vec<f64> = some.iter().map(|(_, t)| *t).collect();
            let frame = match &beside {
                None => None,
                Some((part, slopes, lone, warp, trust)) => {
                    let ways: Vec<Way> = times.par_iter().map(|t| warp.way(*t)).collect();
                    let doubts: Vec<Cells> = ways.par_iter().map(|way| way.doubts(self.padded(), trust)).collect();
                    let (slopes, wanted) = ([&*slopes[0], &*slopes[1]], Some(doubts.as_slice()));
                    let others = self.backend.moving_layers(part, slopes, lone, 0, &times, limit, self.h, wanted)?;
                    Some(InFrame { warp, trust, ways, doubts, others })
                }
            };
            let layers = self.compose(interval, caps, frame.as_ref(), some, k * at_once, filled);
            drop(frame);
            layers.into_iter().try_for_each(&mut *sink)?;
        }
        Ok(())
    }

    /// From the mid frame of interval `i`, which is `part`, to its layers.
    fn warp<'p>(&self, made: &Made<'_, 'a>, part: &'p MovingField, i: usize) -> Result<Warp<'p>> {
        let seen = made.seen.some(i, Contour::FIELD)?;
        // The frame's own field of a slice that is not empty is the slice's.
        let own = |side: usize| (made.contours.light(i + side).solids.count > 0).then(|| &*part.fields[side]);
        let slices = [0, 1].map(|side| (own(side), &seen[side].phi));
        Ok(Warp::new(part, 0, slices, self.settings.margin() as f64))
    }

    /// Where in interval `i` parts that are kept apart close: well before the layer nearest half way, so that neither reaches it.
    fn middle_layer(&self, heights: &Heights, i: usize) -> f64 {
        let (low, high) = (self.stack.slices[i].z, self.stack.slices[i + 1].z);
        let times = heights.between(i).iter().map(|x| time(x.z, low, high));
        EARLY * times.map(|t| t.min(1.0 - t)).reduce(f64::max).unwrap_or(HALF_WAY)
    }

    fn sweep_chunk(
        &mut self,
        chunk: Range<usize>,
        made: &Made<'_, 'a>,
        intervals: &[Arc<Interval>],
        caps: &[IntervalCaps],
        heights: &Heights,
    ) -> Result<Vec<Filled>> {
        let Made { contours, seen, sides, fitted, .. } = made;
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
            let image_nx = self.padded()[0];
            for (group, holes) in interval.groups.iter().zip(&caps.holes) {
                let rule = self.settings.slope;
                let courses = |end: &[u32], own: &Fitted, next: &Fitted, side: &Side, direction| {
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
                        target: Cow::Borrowed(&group.high.phi),
                        seeds: positions(&group.low.seeds, 0),
                        courses: courses(&group.low.seeds, &low_fitted, &high_fitted, up_side, Direction::Up),
                        times: up.clone(),
                    },
                    down: SweepJob {
                        source: Cow::Borrowed(&group.high.phi),
                        target: Cow::Borrowed(&group.low.phi),
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
        let filled = self.backend.propagate(&pairs, self.h, &MorphOptions::from(self.settings), self.progress)?;
        for (f, &i) in filled.iter().zip(&owners) {
            let between = || format!("between heights {} and {}", contours.light(i).z, contours.light(i + 1).z);
            if f.slices.iter().any(|slice| slice.values().any(f32::is_nan)) {
                return Err(Error::Numerics { stage: "propagate", message: format!("NaN {}", between()) });
            }
            for (swept, way) in [(&f.up, "upward"), (&f.down, "downward")] {
                if let Some(t) = swept.vanished {
                    let message = format!("the {way} sweep of a group {} vanished at t = {t:.3}", between());
                    self.report.warnings.push(message);
                }
                let report = &mut self.report.intervals[i];
                report.sweep_steps += swept.steps;
                report.sweep_pixels += swept.pixels;
            }
            self.report.contours[i + 1].arrival_from_below.get_or_insert_default().absorb(&f.up.residual);
            self.report.contours[i].arrival_from_above.get_or_insert_default().absorb(&f.down.residual);
        }
        Ok(filled)
    }

    /// Layers of an interval at some of its heights, the first of which is number `skip`.
    fn compose(
        &self,
        interval: &Interval,
        caps: &IntervalCaps,
        frame: Option<&InFrame<'_>>,
        heights: &[(Height, f64)],
        skip: usize,
        filled: &[Filled],
    ) -> Vec<Layer> {
        let limit = self.settings.margin() as f64;
        let padded = self.padded();
        let layer = |(k, (height, t)): (usize, &(Height, f64))| {
            let mut canvas = if frame.is_some() { Canvas::empty(padded, 0, limit) } else { self.canvas() };
            for (f, group) in filled.iter().zip(&interval.groups) {
                canvas.unite_packed(&group.tile, &f.slices[skip + k]);
            }
            for (cap, direction) in &caps.solids {
                unite_cap(&mut canvas, cap, if *direction == Direction::Up { *t } else { 1.0 - t });
            }
            let Some(InFrame { warp, trust, ways, doubts, others }) = frame else { return self.layer(height, canvas) };
            let whole = warp.layer(&canvas.phi, &ways[k], trust, &doubts[k], &others[k]);
            drop(canvas);
            let mut canvas = self.canvas();
            canvas.unite(&Tile { origin: [0, 0], dims: padded }, |n| f64::from(whole[n]));
            self.layer(height, canvas)
        };
        heights.par_iter().enumerate().map(layer).collect()
    }

    /// Intervals that are swept together: enough for all threads and for a GPU, but no more slices than [`CHUNK_BYTES`] or the budget hold.
    fn chunks(&self, intervals: &Shelf<'a, Interval>, heights: &Heights) -> Vec<Range<usize>> {
        let least = self.budget.at_once(2 * rayon::current_num_threads(), 10 * self.field_bytes());
        let most = self.budget.spare(CHUNK_BYTES);
        let mut out: Vec<Range<usize>> = Vec::new();
        let mut filled = 0;
        for i in self.span.layers.clone() {
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
}
