//! The metamorphosis: contours morphed into each other, courses fitted, sweeps composed.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

use super::links::in_frame;
use super::{CHUNK_BYTES, Run, Sink, time};
use crate::backend::MorphOptions;
use crate::compose::{Canvas, HALF_WAY, IntervalCaps, mend, unite_cap};
use crate::contours::Contour;
use crate::ends::End;
use crate::error::{Error, Result};
use crate::field::Field;
use crate::fit::{Fitted, course, fit};
use crate::heights::{Height, Heights};
use crate::jobs::{Direction, Filled, PartJob, SweepJob, SweepPair, Traced};
use crate::matching::{Interval, IntervalPlan};
use crate::motion::Frame;
use crate::moving_field::{Cells, LoneParts, MovingField};
use crate::report::IntervalReport;
use crate::settings::Motion;
use crate::surface::Layer;
use crate::surface::stream::LayerSink;
use crate::topology::Decided;
use crate::tracks::{Side, Sides, sides, trace_job};
use crate::trust::Trust;
use crate::warp::{Warp, Way};

/// Parts that are kept apart close at this share of the way to the layer nearest half way.
const EARLY: f64 = 0.8;

/// The two contours of an interval in its frame.
type Seen<'c> = [Cow<'c, Contour>; 2];

/// The moving frame, and what the field method needs where the morph knows nothing.
struct Beside<'c> {
    moving: &'c MovingField,
    slopes: Vec<Field>,
    lone: Vec<LoneParts>,
}

/// What the stages before the sweeps have made.
struct Made<'c> {
    contours: &'c [Contour],
    beside: Option<Beside<'c>>,
    seen: Vec<Seen<'c>>,
    /// Pairs that are kept apart, as the mid frame numbers them.
    parted: Vec<Vec<(u32, u32)>>,
    intervals: Vec<Interval>,
    sides: Vec<Sides>,
    fitted: Vec<Fitted>,
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

impl Made<'_> {
    /// How far the morphs of interval `i` can be trusted, in its frame.
    fn trust(&self, moving: &MovingField, i: usize) -> Trust {
        let ends = [self.sides[i].up.as_ref(), self.sides[i + 1].down.as_ref()];
        // The field joins whatever overlaps: of parts that are kept apart the morph knows more.
        let apart = [0, 1].map(|end| {
            let mut parts = vec![false; self.seen[i][end].solids.count + 1];
            self.parted[i].iter().for_each(|pair| parts[[pair.0, pair.1][end] as usize] = true);
            parts
        });
        let particles = self.seen[i].iter().zip(ends).zip(&apart).flat_map(|((contour, side), apart)| {
            let tracks = side.map_or(&[][..], |s| &s.tracks);
            let known = |inside: usize| apart[contour.solids.labels[inside] as usize];
            contour.seeds.iter().zip(tracks).map(move |(seed, track)| (seed.x, track.arrived || known(seed.inside)))
        });
        Trust::new(moving, i, particles)
    }
}

impl Run<'_> {
    /// All stages after the distance; the heights at which the body ends.
    pub(super) fn morph(
        &mut self,
        contours: Vec<Contour>,
        heights: &[f64],
        sink: &mut dyn LayerSink,
    ) -> Result<[f64; 2]> {
        let count = contours.len() - 1;
        let moving = match self.settings.motion {
            Motion::Field | Motion::Rigid => Some(self.moving(&contours)?),
            Motion::None => None,
        };
        self.see_links(&contours, moving.as_ref());
        let frame = |i: usize| moving.as_ref().map_or(Frame::default(), |m| Frame::middle_of(m, i));
        let frames: Vec<Frame> = (0..count).map(frame).collect();
        let seen: Vec<Seen<'_>> =
            (0..count).into_par_iter().map(|i| frames[i].contours(&contours[i], &contours[i + 1])).collect();
        let of_interval = |i: usize| {
            let own = [&contours[i], &contours[i + 1]];
            in_frame(&self.links[i].parted(), own, seen[i].each_ref().map(|c| c.as_ref()), &frames[i])
        };
        let parted: Vec<Vec<(u32, u32)>> = (0..count).map(of_interval).collect();
        let intervals = self.stage("match", count, |run| run.matching(&seen, &parted))?;
        let jobs = intervals.iter().map(|i| 2 * i.groups.len()).sum();
        let traced = self.stage("trace", jobs, |run| run.trace(&seen, &intervals))?;
        let sides = sides(&contours, &intervals, &frames, &traced);
        let mut fitted = self.stage("fit", 1, |run| Ok(fit(&contours, &sides, run.h, run.px, run.settings)))?;
        if let Some(moving) = &moving {
            // A slope that the user gives is the whole slope.
            for (i, given) in [(0, self.settings.clamp_bottom), (count, self.settings.clamp_top)] {
                if given.is_some() {
                    fitted[i] = fitted[i].with_motion(&contours[i], &moving.rates[i], self.h, -1.0);
                }
            }
        }
        let ends = self.ends(&contours, [&fitted[0], &fitted[count]], moving.as_ref())?;
        let extent = ends.each_ref().map(|end| end.extent);
        let heights = Heights::new(self.stack, heights, extent)?;
        sink.begin(&self.header(&heights, extent))?;
        let sink: &mut Sink<'_> = &mut |layer| sink.layer(layer);
        let beside = match &moving {
            None => None,
            Some(moving) => Some(self.stage("slopes", contours.len(), |run| {
                let slopes = run.backend.moving_slopes(moving, run.progress)?;
                Ok(Beside { moving, slopes, lone: run.lone_parts(&contours, moving)? })
            })?),
        };
        let made = Made { contours: &contours, beside, seen, parted, intervals, sides, fitted, ends };
        self.stage("propagate", jobs, |run| {
            run.faired(&contours, moving.as_ref(), &heights, sink, |run, sink| run.propagate(&made, &heights, sink))
        })?;
        Ok(extent)
    }

    fn matching(&mut self, seen: &[Seen<'_>], parted: &[Vec<(u32, u32)>]) -> Result<Vec<Interval>> {
        let margin = self.margin;
        let plan = |([low, high], parted): (&Seen<'_>, &Vec<(u32, u32)>)| {
            IntervalPlan::new(low, high, &Decided::parting(parted.clone()), margin)
        };
        let mut plans: Vec<IntervalPlan> = seen.par_iter().zip(parted).map(plan).collect();
        let jobs: Vec<PartJob> = plans.iter_mut().flat_map(IntervalPlan::take_jobs).collect();
        let mut fields = self.backend.part_fields(&jobs, self.h)?.into_iter();
        let intervals: Vec<Interval> = plans.into_iter().map(|plan| plan.finish(&mut fields)).collect();
        self.progress.advance(intervals.len());
        self.report.intervals = intervals
            .iter()
            .zip(seen)
            .map(|(interval, [low, high])| IntervalReport {
                z_low: low.z,
                z_high: high.z,
                groups: interval.groups.len(),
                events: interval.events.clone(),
                ..IntervalReport::default()
            })
            .collect();
        Ok(intervals)
    }

    /// Both morphs of every group: up, down, group by group, interval by interval.
    fn trace(&mut self, seen: &[Seen<'_>], intervals: &[Interval]) -> Result<Vec<Traced>> {
        let mut jobs = Vec::new();
        let mut owners = Vec::new();
        for (i, interval) in intervals.iter().enumerate() {
            for group in &interval.groups {
                jobs.push(trace_job(group, &seen[i][0], Direction::Up));
                jobs.push(trace_job(group, &seen[i][1], Direction::Down));
                owners.extend([i, i]);
            }
        }
        let traced = self.backend.trace(&jobs, self.h, &MorphOptions::from(self.settings), self.progress)?;
        for (t, &i) in traced.iter().zip(&owners) {
            if let Some(k) = t.tracks.iter().position(|k| !(k.distance.is_finite() && k.landing[0].is_finite())) {
                let message = format!("particle {k} between heights {} and {} is lost", seen[i][0].z, seen[i][1].z);
                return Err(Error::Numerics { stage: "trace", message });
            }
            let report = &mut self.report.intervals[i];
            report.trace_steps += t.steps;
            report.trace_pixels += t.pixels;
            let arrived = t.tracks.iter().filter(|k| k.arrived).count();
            report.particles.seeded += t.tracks.len();
            report.particles.arrived += arrived;
            report.particles.died += t.tracks.len() - arrived;
        }
        Ok(traced)
    }

    /// Sweeps and composes, some intervals at a time, so that only their tiles are in memory.
    fn propagate(&mut self, made: &Made, heights: &Heights, sink: &mut Sink<'_>) -> Result<()> {
        let Made { contours, intervals, fitted, ends, .. } = made;
        let last = contours.len() - 1;
        for height in heights.all.iter().filter(|x| x.z < contours[0].z) {
            sink(self.layer(height, ends[0].layer(height.z, &contours[0], self.canvas())))?;
        }
        for chunk in chunks(intervals, heights) {
            let caps: Vec<IntervalCaps> = chunk
                .clone()
                .map(|i| {
                    let gap = contours[i + 1].z - contours[i].z;
                    let closes = if made.parted[i].is_empty() { HALF_WAY } else { self.middle_layer(heights, i) };
                    IntervalCaps::new(&intervals[i], &fitted[i], &fitted[i + 1], gap, closes)
                })
                .collect();
            let mut filled = self.sweep_chunk(chunk.clone(), made, &caps, heights)?.into_iter();
            for (i, caps) in chunk.zip(&caps) {
                sink(self.contour_layer(&heights.contours[i], &contours[i], i))?;
                let of_interval: Vec<Filled> = filled.by_ref().take(intervals[i].groups.len()).collect();
                let limit = self.settings.margin() as f64;
                let slices = [0, 1].map(|side| (&contours[i + side].phi, &made.seen[i][side].phi));
                let warp =
                    made.beside.as_ref().map(|b| (Warp::new(b.moving, i, slices, limit), made.trust(b.moving, i)));
                let at_once = rayon::current_num_threads();
                let timed = |x: &Height| (*x, time(x.z, contours[i].z, contours[i + 1].z));
                let between: Vec<(Height, f64)> = heights.between(i).iter().map(timed).collect();
                for (k, some) in between.chunks(at_once).enumerate() {
                    let times: Vec<f64> = some.iter().map(|(_, t)| *t).collect();
                    let frame = match (&made.beside, &warp) {
                        (Some(Beside { moving, slopes, lone }), Some((warp, trust))) => {
                            let ways: Vec<Way> = times.par_iter().map(|t| warp.way(*t)).collect();
                            let dims = contours[i].phi.dims;
                            let doubts: Vec<Cells> = ways.par_iter().map(|way| way.doubts(dims, trust)).collect();
                            let (lone, wanted) = (&lone[i], Some(doubts.as_slice()));
                            let others =
                                self.backend.moving_layers(moving, slopes, lone, i, &times, limit, self.h, wanted)?;
                            Some(InFrame { warp, trust, ways, doubts, others })
                        }
                        _ => None,
                    };
                    for layer in self.compose(&made.intervals[i], caps, frame.as_ref(), some, k * at_once, &of_interval)
                    {
                        sink(layer)?;
                    }
                }
            }
        }
        sink(self.contour_layer(&heights.contours[last], &contours[last], last))?;
        for height in heights.all.iter().filter(|x| x.z > contours[last].z) {
            sink(self.layer(height, ends[1].layer(height.z, &contours[last], self.canvas())))?;
        }
        Ok(())
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
        made: &Made,
        caps: &[IntervalCaps],
        heights: &Heights,
    ) -> Result<Vec<Filled>> {
        let Made { contours, seen, intervals, sides, fitted, .. } = made;
        let mut pairs = Vec::new();
        let mut owners = Vec::new();
        for (i, caps) in chunk.zip(caps) {
            let (low, high) = (contours[i].z, contours[i + 1].z);
            let gap = high - low;
            let up: Vec<f64> = heights.between(i).iter().map(|x| time(x.z, low, high)).collect();
            let down: Vec<f64> = up.iter().rev().map(|t| 1.0 - t).collect();
            let (Some(up_side), Some(down_side)) = (&sides[i].up, &sides[i + 1].down) else { continue };
            let image_nx = contours[i].phi.dims[0];
            for (group, holes) in intervals[i].groups.iter().zip(&caps.holes) {
                let rule = self.settings.slope;
                let courses = |end: &[u32], at: usize, next: usize, side: &Side, direction| {
                    let of = |&k: &u32| {
                        let track = &side.tracks[k as usize];
                        course(&fitted[at], track, &fitted[next], k as usize, direction, gap, rule)
                    };
                    end.iter().map(of).collect()
                };
                let positions = |end: &[u32], side: usize| {
                    end.iter().map(|&k| group.tile.to_local(seen[i][side].seeds[k as usize].x)).collect()
                };
                let times = up.clone();
                pairs.push(SweepPair {
                    up: SweepJob {
                        source: &group.low.phi,
                        target: &group.high.phi,
                        seeds: positions(&group.low.seeds, 0),
                        courses: courses(&group.low.seeds, i, i + 1, up_side, Direction::Up),
                        times: up.clone(),
                    },
                    down: SweepJob {
                        source: &group.high.phi,
                        target: &group.low.phi,
                        seeds: positions(&group.high.seeds, 1),
                        courses: courses(&group.high.seeds, i + 1, i, down_side, Direction::Down),
                        times: down.clone(),
                    },
                    mend: Box::new(move |k, phi| mend(phi, group, holes, times[k], image_nx)),
                });
                owners.push(i);
            }
        }
        let filled = self.backend.propagate(&pairs, self.h, &MorphOptions::from(self.settings), self.progress)?;
        for (f, &i) in filled.iter().zip(&owners) {
            let between = || format!("between heights {} and {}", contours[i].z, contours[i + 1].z);
            if f.slices.iter().flatten().any(|v| v.is_nan()) {
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
        let padded = self.stack.dims.map(|n| n + 2 * self.pad);
        let layer = |(k, (height, t)): (usize, &(Height, f64))| {
            let mut canvas = if frame.is_some() { Canvas::empty(padded, 0, limit) } else { self.canvas() };
            for (f, group) in filled.iter().zip(&interval.groups) {
                canvas.unite(&group.tile, |n| f64::from(f.slices[skip + k][n]));
            }
            for (cap, direction) in &caps.solids {
                unite_cap(&mut canvas, cap, if *direction == Direction::Up { *t } else { 1.0 - t });
            }
            let Some(InFrame { warp, trust, ways, doubts, others }) = frame else { return self.layer(height, canvas) };
            let seen = Field { dims: padded, data: canvas.phi.iter().map(|v| f64::from(*v)).collect() };
            let whole = warp.layer(&seen, &ways[k], trust, &doubts[k], &others[k]);
            self.layer(height, Canvas::of_contour(self.stack.dims, self.pad, limit, &whole))
        };
        heights.par_iter().enumerate().map(layer).collect()
    }
}

/// Intervals that are swept together: enough for all threads and for a GPU, but no more slices than [`CHUNK_BYTES`] hold.
fn chunks(intervals: &[Interval], heights: &Heights) -> Vec<Range<usize>> {
    let at_least = 2 * rayon::current_num_threads();
    let mut out: Vec<Range<usize>> = Vec::new();
    let mut filled = 0;
    for (i, interval) in intervals.iter().enumerate() {
        let nodes: usize = interval.groups.iter().map(|g| g.tile.len()).sum();
        let bytes = size_of::<f32>() * nodes * heights.between(i).len();
        match out.last_mut() {
            Some(chunk) if chunk.len() < at_least || filled + bytes <= CHUNK_BYTES => chunk.end = i + 1,
            _ => {
                out.push(i..i + 1);
                filled = 0;
            }
        }
        filled += bytes;
    }
    out
}
