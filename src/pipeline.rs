//! The order of the stages, written once, for any backend.
//!
//! ```text
//! distance -> motion -> match -> trace -> fit -> propagate -> compose
//! ```

use std::time::Instant;

use rayon::prelude::*;

use crate::backend::{Backend, ContourOptions, MorphOptions, PaddedSlice};
use crate::compose::{Canvas, IntervalCaps, blend, differing_pixels, unite_cap};
use crate::contours::Contour;
use crate::ends::{End, EndSpec, end};
use crate::error::{Error, Result};
use crate::field::Field;
use crate::fit::{Fitted, course, fit};
use crate::heights::{Height, Heights, check};
use crate::jobs::{Direction, SweepJob, Swept, Traced};
use crate::matching::{Interval, match_interval};
use crate::motion::frames;
use crate::progress::Progress;
use crate::report::{ContourReport, IntervalReport, Report, StageReport};
use crate::settings::{Settings, SlopeRule};
use crate::stack::ContourStack;
use crate::surface::{Layer, Reconstruction};
use crate::tracks::{Side, Sides, sides, trace_job};

/// Extra margin for rules whose curves overshoot their contours, px.
const OVERSHOOT: usize = 8;

/// Everything a run carries from stage to stage.
struct Run<'a> {
    stack: &'a ContourStack,
    settings: &'a Settings,
    backend: &'a dyn Backend,
    progress: &'a dyn Progress,
    /// Pixel size in units of its larger side.
    h: [f64; 2],
    /// Length of a pixel's larger side in the stack's unit.
    px: f64,
    /// Padding of the image.
    pad: usize,
    /// Margin of tiles.
    margin: usize,
    report: Report,
}

/// Reconstructs `stack` at `heights` (increasing, unit of the stack).
///
/// # Errors
/// Wrong input or settings before anything is computed; a backend's failure; [`Error::Numerics`] for a value that is not a number.
pub fn run(
    stack: &ContourStack,
    heights: &[f64],
    settings: &Settings,
    backend: &dyn Backend,
    progress: &dyn Progress,
) -> Result<Reconstruction> {
    stack.validate()?;
    settings.validate()?;
    check(stack, heights, settings)?;
    let px = stack.spacing[0].max(stack.spacing[1]);
    let overshoots = matches!(settings.slope, SlopeRule::Natural | SlopeRule::Catmull);
    let margin = settings.margin() + if overshoots { OVERSHOOT } else { 0 };
    let mut run = Run {
        stack,
        settings,
        backend,
        progress,
        h: stack.spacing.map(|s| s / px),
        px,
        pad: settings.margin() + OVERSHOOT,
        margin,
        report: Report {
            version: env!("CARGO_PKG_VERSION").into(),
            settings: settings.clone(),
            backend: backend.name(),
            dims: stack.dims,
            spacing: stack.spacing,
            unit: stack.unit.clone(),
            ..Report::default()
        },
    };
    let contours = run.stage("distance", stack.slices.len(), Run::distance)?;
    let frames = frames(contours.len() - 1);
    let intervals = run.stage("match", contours.len() - 1, |run| run.matching(&contours))?;
    let jobs = intervals.iter().map(|i| 2 * i.groups.len()).sum();
    let traced = run.stage("trace", jobs, |run| run.trace(&contours, &intervals))?;
    let sides = sides(&contours, &intervals, &frames, &traced);
    let fitted = run.stage("fit", 1, |run| Ok(fit(&contours, &sides, run.h, run.px, run.settings)))?;
    let ends = run.ends(&contours, &fitted)?;
    let heights = Heights::new(stack, heights, [ends[0].extent, ends[1].extent])?;
    let layers =
        run.stage("propagate", jobs, |run| run.propagate(&contours, &intervals, &sides, &fitted, &ends, &heights))?;
    Ok(Reconstruction {
        dims: stack.dims,
        spacing: stack.spacing,
        unit: stack.unit.clone(),
        geometry: stack.geometry,
        extent: [ends[0].extent, ends[1].extent],
        layers,
        report: run.report,
    })
}

impl Run<'_> {
    /// Runs one stage, telling listeners and taking its time.
    fn stage<T>(&mut self, name: &'static str, total: usize, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        self.progress.begin(name, total);
        let start = Instant::now();
        let result = work(self);
        self.report.stages.push(StageReport { name, seconds: start.elapsed().as_secs_f64() });
        self.progress.end();
        result
    }

    fn distance(&mut self) -> Result<Vec<Contour>> {
        let padded: Vec<PaddedSlice> =
            self.stack.slices.par_iter().map(|s| PaddedSlice::new(&s.content, self.stack.dims, self.pad)).collect();
        let dims = self.stack.dims.map(|n| n + 2 * self.pad);
        let options = ContourOptions::from(self.settings);
        let fields = self.backend.contour_fields(&padded, dims, self.h, options, self.progress)?;
        let (h, spacing) = (self.h, self.settings.seed_spacing);
        let contours: Vec<Contour> =
            fields.into_par_iter().zip(&self.stack.slices).map(|(phi, s)| Contour::new(s.z, phi, h, spacing)).collect();
        self.report.contours = contours
            .iter()
            .zip(&self.stack.slices)
            .map(|(c, s)| ContourReport {
                name: s.name.clone(),
                z: s.z,
                extra: s.extra,
                components: c.solids.count,
                holes: c.holes(),
                pixels: c.solids.labels.iter().filter(|l| **l > 0).count(),
                ..ContourReport::default()
            })
            .collect();
        Ok(contours)
    }

    fn matching(&mut self, contours: &[Contour]) -> Result<Vec<Interval>> {
        let (h, margin, backend, progress) = (self.h, self.margin, self.backend, self.progress);
        let intervals: Vec<Interval> = contours
            .par_windows(2)
            .map(|pair| {
                let interval = match_interval(&pair[0], &pair[1], h, margin, backend);
                progress.advance(1);
                interval
            })
            .collect::<Result<_>>()?;
        self.report.intervals = intervals
            .iter()
            .zip(contours.windows(2))
            .map(|(interval, pair)| IntervalReport {
                z_low: pair[0].z,
                z_high: pair[1].z,
                groups: interval.groups.len(),
                events: interval.events.clone(),
                ..IntervalReport::default()
            })
            .collect();
        Ok(intervals)
    }

    /// Both morphs of every group: up, down, group by group, interval by interval.
    fn trace(&mut self, contours: &[Contour], intervals: &[Interval]) -> Result<Vec<Traced>> {
        let mut jobs = Vec::new();
        let mut owners = Vec::new();
        for (i, interval) in intervals.iter().enumerate() {
            for group in &interval.groups {
                jobs.push(trace_job(group, &contours[i], Direction::Up));
                jobs.push(trace_job(group, &contours[i + 1], Direction::Down));
                owners.extend([i, i]);
            }
        }
        let traced = self.backend.trace(&jobs, self.h, &MorphOptions::from(self.settings), self.progress)?;
        for (t, &i) in traced.iter().zip(&owners) {
            if let Some(k) = t.tracks.iter().position(|k| !(k.distance.is_finite() && k.landing[0].is_finite())) {
                let message =
                    format!("particle {k} between heights {} and {} is lost", contours[i].z, contours[i + 1].z);
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

    fn ends(&mut self, contours: &[Contour], fitted: &[Fitted]) -> Result<[End; 2]> {
        let last = contours.len() - 1;
        let mut warnings = Vec::new();
        let mut make = |at: usize, next: usize, direction, rule| {
            let gap = (contours[at].z - contours[next].z).abs();
            let spec = EndSpec {
                contour: &contours[at],
                fitted: &fitted[at],
                direction,
                rule,
                gap,
                highest: self.settings.cap_gaps * gap,
                margin: self.margin,
            };
            end(&spec, self.h, self.backend, &mut warnings)
        };
        let ends = [
            make(0, 1, Direction::Down, self.settings.end_bottom)?,
            make(last, last - 1, Direction::Up, self.settings.end_top)?,
        ];
        self.report.warnings.append(&mut warnings);
        Ok(ends)
    }

    /// Sweeps and composes, some intervals at a time, so that only their tiles are in memory.
    fn propagate(
        &mut self,
        contours: &[Contour],
        intervals: &[Interval],
        sides: &[Sides],
        fitted: &[Fitted],
        ends: &[End; 2],
        heights: &Heights,
    ) -> Result<Vec<Layer>> {
        let mut layers: Vec<Layer> = Vec::with_capacity(heights.all.len());
        let below = heights.all.iter().filter(|x| x.z < contours[0].z);
        layers.extend(below.map(|x| self.layer(x, ends[0].layer(x.z, &contours[0], self.canvas()))));
        let at_once = 2 * rayon::current_num_threads();
        for first in (0..intervals.len()).step_by(at_once) {
            let chunk: Vec<usize> = (first..intervals.len().min(first + at_once)).collect();
            let swept = self.sweep_chunk(&chunk, contours, intervals, sides, fitted, heights)?;
            let mut swept = swept.into_iter();
            for &i in &chunk {
                let contour = &heights.contours[i];
                layers.push(self.contour_layer(contour, &contours[i], i));
                let of_interval: Vec<Swept> = swept.by_ref().take(2 * intervals[i].groups.len()).collect();
                layers.extend(self.compose_interval(i, contours, &intervals[i], fitted, heights, &of_interval)?);
            }
        }
        let last = contours.len() - 1;
        layers.push(self.contour_layer(&heights.contours[last], &contours[last], last));
        let above = heights.all.iter().filter(|x| x.z > contours[last].z);
        layers.extend(above.map(|x| self.layer(x, ends[1].layer(x.z, &contours[last], self.canvas()))));
        Ok(layers)
    }

    fn sweep_chunk(
        &mut self,
        chunk: &[usize],
        contours: &[Contour],
        intervals: &[Interval],
        sides: &[Sides],
        fitted: &[Fitted],
        heights: &Heights,
    ) -> Result<Vec<Swept>> {
        let mut jobs = Vec::new();
        let mut owners = Vec::new();
        for &i in chunk {
            let (low, high) = (contours[i].z, contours[i + 1].z);
            let gap = high - low;
            let up: Vec<f64> = heights.between(i).iter().map(|x| time(x.z, low, high)).collect();
            let down: Vec<f64> = up.iter().rev().map(|t| 1.0 - t).collect();
            let (Some(up_side), Some(down_side)) = (&sides[i].up, &sides[i + 1].down) else { continue };
            for group in &intervals[i].groups {
                let rule = self.settings.slope;
                let courses = |end: &[u32], at: usize, next: usize, side: &Side, direction| {
                    let of = |&k: &u32| {
                        let track = &side.tracks[k as usize];
                        course(&fitted[at], track, &fitted[next], k as usize, direction, gap, rule)
                    };
                    end.iter().map(of).collect()
                };
                let positions = |end: &[u32], at: usize| {
                    end.iter().map(|&k| group.tile.to_local(contours[at].seeds[k as usize].x)).collect()
                };
                jobs.push(SweepJob {
                    source: &group.low.phi,
                    target: &group.high.phi,
                    seeds: positions(&group.low.seeds, i),
                    courses: courses(&group.low.seeds, i, i + 1, up_side, Direction::Up),
                    times: up.clone(),
                });
                jobs.push(SweepJob {
                    source: &group.high.phi,
                    target: &group.low.phi,
                    seeds: positions(&group.high.seeds, i + 1),
                    courses: courses(&group.high.seeds, i + 1, i, down_side, Direction::Down),
                    times: down.clone(),
                });
                owners.extend([(i, Direction::Up), (i, Direction::Down)]);
            }
        }
        let swept = self.backend.propagate(&jobs, self.h, &MorphOptions::from(self.settings), self.progress)?;
        for (s, &(i, direction)) in swept.iter().zip(&owners) {
            let between = || format!("between heights {} and {}", contours[i].z, contours[i + 1].z);
            if s.fields.iter().flatten().any(|v| v.is_nan()) {
                return Err(Error::Numerics { stage: "propagate", message: format!("NaN {}", between()) });
            }
            if let Some(t) = s.vanished {
                let way = if direction == Direction::Up { "upward" } else { "downward" };
                self.report.warnings.push(format!("the {way} sweep of a group {} vanished at t = {t:.3}", between()));
            }
            let report = &mut self.report.intervals[i];
            report.sweep_steps += s.steps;
            report.sweep_pixels += s.pixels;
            let residual = match direction {
                Direction::Up => &mut self.report.contours[i + 1].arrival_from_below,
                Direction::Down => &mut self.report.contours[i].arrival_from_above,
            };
            residual.get_or_insert_default().absorb(&s.residual);
        }
        Ok(swept)
    }

    fn compose_interval(
        &self,
        i: usize,
        contours: &[Contour],
        interval: &Interval,
        fitted: &[Fitted],
        heights: &Heights,
        swept: &[Swept],
    ) -> Result<Vec<Layer>> {
        let (low, high) = (contours[i].z, contours[i + 1].z);
        let caps = IntervalCaps::new(interval, &fitted[i], &fitted[i + 1], high - low);
        let between = heights.between(i);
        let image_nx = contours[i].phi.dims[0];
        let limit = self.settings.margin() as f64;
        between
            .par_iter()
            .enumerate()
            .map(|(k, height)| {
                let t = time(height.z, low, high);
                let blended: Vec<Field> = interval
                    .groups
                    .iter()
                    .zip(swept.chunks_exact(2))
                    .zip(&caps.holes)
                    .map(|((group, pair), holes)| {
                        blend(group, (&pair[0], k), (&pair[1], between.len() - 1 - k), holes, t, image_nx)
                    })
                    .collect();
                let mut canvas = self.canvas();
                for (field, group) in self.backend.distances(blended, self.h, limit)?.iter().zip(&interval.groups) {
                    canvas.unite(&group.tile, |n| field.data[n]);
                }
                for (cap, direction) in &caps.solids {
                    unite_cap(&mut canvas, cap, if *direction == Direction::Up { t } else { 1.0 - t });
                }
                Ok(self.layer(height, canvas))
            })
            .collect()
    }

    fn canvas(&self) -> Canvas {
        Canvas::empty(self.stack.dims, self.pad, self.settings.margin() as f64)
    }

    fn contour_layer(&mut self, height: &Height, contour: &Contour, i: usize) -> Layer {
        let limit = self.settings.margin() as f64;
        let layer = self.layer(height, Canvas::of_contour(self.stack.dims, self.pad, limit, &contour.phi));
        let slice = &self.stack.slices[i].content;
        self.report.contours[i].differing_pixels = differing_pixels(&layer.phi, |n| slice.inside(n));
        Layer { contour: Some(i), ..layer }
    }

    /// A canvas in physical units.
    fn layer(&self, height: &Height, canvas: Canvas) -> Layer {
        let px = self.px as f32;
        let mut phi = canvas.phi;
        for v in &mut phi {
            *v *= px;
            if *v == 0.0 {
                *v = f32::MIN_POSITIVE;
            }
        }
        Layer { z: height.z, phi, output: height.output, contour: None }
    }
}

/// Height as time of its interval, in steps of 2^-30: a stack and the same upside down then sweep with the very same times, whichever way
/// their heights were rounded, and `1 - t` is exact.
fn time(z: f64, low: f64, high: f64) -> f64 {
    const STEPS: f64 = (1u64 << 30) as f64;
    ((z - low) / (high - low) * STEPS).round().clamp(1.0, STEPS - 1.0) / STEPS
}
