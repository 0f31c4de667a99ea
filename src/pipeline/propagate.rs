//! The second half of the metamorphosis: every interval swept from both sides, and its layers composed.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use glam::DVec2;
use rayon::prelude::*;

use super::context::{Context, Sink, time};
use super::ends::{above, below};
use super::sweep_inputs::{FieldFallback, SweepInputs};
use crate::backend::MorphOptions;
use crate::backend::interval_morph::{FrameSource, IntervalMorph, LayerImage, MorphFrame, Morphed};
use crate::backend::jobs::{SweepJob, SweepPair, Swept, Track};
use crate::backend::requests::MorphRequest;
use crate::contour::Contour;
use crate::contour::direction::Direction;
use crate::contour::seeds::Seed;
use crate::error::{Error, Result};
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::pipeline::compose::IntervalCaps;
use crate::pipeline::fit::{Fitted, course};
use crate::pipeline::matching::Interval;
use crate::pipeline::tracks::SideTracks;
use crate::registration::motion_field::MotionField;
use crate::registration::particle_weight::Trust;
use crate::report::Report;
use crate::settings::Settings;
use crate::stack::heights::Heights;
use crate::storage::spill::SpillVec;

/// Bytes of the slices that are swept together.
pub(crate) const CHUNK_BYTES: usize = 256 << 20;

/// Share of an interval at which parts that are kept apart close: well before a third of it. Layers two or more between two contours have
/// one in the middle third, which neither part then reaches; a bound that looked for it would make layers depend on each other.
const APART: f64 = 0.8 / 3.0;

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
            particles(contour, tracks, apart)
        });
        Ok(Trust::new(moving, 0, h, relief, particles))
    }
}

/// Places of a contour's seeds, and to what share the particle of each arrived: all of it in parts that are kept `apart`.
fn particles<'t>(
    contour: &'t Contour,
    tracks: &'t [Track],
    apart: &'t [bool],
) -> impl Iterator<Item = (DVec2, f64)> + use<'t> {
    let known = |inside: usize| apart[contour.solids.labels[inside] as usize];
    let share = move |seed: &Seed, track: &Track| if known(seed.inside) { 1.0 } else { track.kept };
    contour.seeds.iter().zip(tracks).map(move |(seed, track)| (seed.x, share(seed, track)))
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
        let layers = morph_chunk(run, chunk.clone(), made, &intervals, &caps, heights, report)?;
        for (i, layers) in chunk.zip(layers) {
            let contour = contours.some(i, Contour::FIELD)?;
            sink(run.contour_layer(&heights.contours[i], &contour, i))?;
            let layers = heights.between(i).iter().zip(layers).map(|(height, phi)| run.layer(height, phi));
            layers.into_iter().try_for_each(&mut *sink)?;
        }
    }
    above(run, contours, ends, heights, sink)
}

/// The mid frame of interval `i`, and what the field method says there.
fn frame<'f, 'a>(run: &'f Context<'a>, made: &'f SweepInputs<'_, 'a>, i: usize) -> Option<FrameSource<'f>> {
    let FieldFallback { moving, slopes, lone } = made.beside.as_ref()?;
    let read = move || {
        let moving = moving.part(i..i + 2)?;
        let trust = Arc::new(made.trust(&moving, i, run.h, relief(run.settings, run.span.change.relief))?);
        let empty = [i, i + 1].map(|k| made.contours.light(k).solids.count == 0);
        Ok(MorphFrame { moving, empty, slopes: [slopes.get(i)?, slopes.get(i + 1)?], lone: lone.get(i)?, trust })
    };
    Some(FrameSource::new(lone.light(i), read))
}

/// Share by which the field's slopes of relief replace the morph's where the stack is relief to the degree `seen`: whoever asks for other slopes than
/// the default ones gets them.
fn relief(settings: &Settings, seen: f64) -> f64 {
    let Settings { slope, clamp_bottom, clamp_top, .. } = settings;
    let asked = *slope != Settings::default().slope || clamp_bottom.is_some() || clamp_top.is_some();
    if asked { 0.0 } else { seen }
}

/// The layers of some intervals.
fn morph_chunk<'a>(
    run: &Context<'a>,
    chunk: Range<usize>,
    made: &SweepInputs<'_, 'a>,
    intervals: &[Arc<Interval>],
    caps: &[IntervalCaps],
    heights: &Heights,
    report: &mut Report,
) -> Result<Vec<Vec<SparseImage<f32>>>> {
    let contours = made.contours;
    let image = LayerImage { dims: run.stack.dims, pad: run.pad, limit: run.settings.margin() as f64 };
    let of_interval = |i: usize| {
        let (caps, interval) = (&caps[i - chunk.start], &intervals[i - chunk.start]);
        let [low, high] = [i, i + 1].map(|k| contours.light(k).z);
        let times: Vec<f64> = heights.between(i).iter().map(|x| time(x.z, low, high)).collect();
        let pairs = pairs(run, made, i, (interval, caps), &times)?;
        let frame = frame(run, made, i);
        Ok(IntervalMorph { image, times, pairs, solids: Cow::Borrowed(&caps.solids), frame })
    };
    let morphs: Vec<IntervalMorph<'_>> = run.of_all(chunk.clone(), of_interval)?;
    let (options, at_once) = (MorphOptions::from(run.settings), run.layers_at_once());
    let request = MorphRequest { intervals: &morphs, h: run.h, options, at_once };
    let morphed = run.backend.morph_layers(&request, run.progress)?;
    drop(morphs);
    let mut out = Vec::with_capacity(morphed.len());
    for (Morphed { layers, swept }, i) in morphed.into_iter().zip(chunk) {
        let between = || format!("between heights {} and {}", contours.light(i).z, contours.light(i + 1).z);
        if layers.par_iter().any(SparseImage::has_nan) {
            return Err(Error::Numerics { stage: "propagate", message: format!("NaN {}", between()) });
        }
        for [up, down] in &swept {
            report.warnings.extend(vanished(up, down, &between()));
            for swept in [up, down] {
                let interval = &mut report.intervals[i];
                interval.sweep_steps += swept.steps;
                interval.sweep_pixels += swept.pixels;
            }
            report.contours[i + 1].arrival_from_below.get_or_insert_default().absorb(&up.residual);
            report.contours[i].arrival_from_above.get_or_insert_default().absorb(&down.residual);
        }
        out.push(layers);
    }
    Ok(out)
}

/// Words about sweeps of a group `between` two heights that vanished: where both did before they met, only cores are left between.
fn vanished(up: &Swept, down: &Swept, between: &str) -> Vec<String> {
    if let (Some(end), Some(start)) = (up.vanished, down.vanished.map(|t| 1.0 - t))
        && end < start
    {
        return vec![format!(
            "both sweeps of a group {between} vanished at t = {end:.3} and {start:.3}: between, there is only what joins overlapping parts"
        )];
    }
    let of = |(swept, way): (&Swept, &str)| {
        Some(format!("the {way} sweep of a group {between} vanished at t = {:.3}", swept.vanished?))
    };
    [(up, "upward"), (down, "downward")].into_iter().filter_map(of).collect()
}

/// Sweeps of the groups of interval `i`, and their tiles.
fn pairs<'a, 'p>(
    run: &Context<'a>,
    made: &SweepInputs<'_, 'a>,
    i: usize,
    (interval, caps): (&'p Interval, &'p IntervalCaps),
    times: &[f64],
) -> Result<Vec<(Tile, SweepPair<'p>)>> {
    let SweepInputs { contours, seen, sides, fitted, .. } = made;
    let gap = contours.light(i + 1).z - contours.light(i).z;
    let down: Vec<f64> = times.iter().rev().map(|t| 1.0 - t).collect();
    let sides = sides.get(i)?;
    let (Some(up_side), Some(down_side)) = (&sides.up, &sides.down) else { return Ok(Vec::new()) };
    let [low_fitted, high_fitted] = [fitted.get(i)?, fitted.get(i + 1)?];
    let seeds = seen.some(i, Contour::SEEDS)?;
    let image_nx = run.padded()[0];
    let mut pairs = Vec::with_capacity(interval.groups.len());
    for (group, holes) in interval.groups.iter().zip(&caps.holes) {
        let rule = run.settings.slope;
        let courses = |end: &[u32], own: &Fitted, next: &Fitted, side: &SideTracks, direction| {
            let of = |&k: &u32| course(own, &side.tracks[k as usize], next, k as usize, direction, gap, rule);
            end.iter().map(of).collect()
        };
        let positions = |end: &[u32], side: usize| {
            end.iter().map(|&k| group.tile.to_local(seeds[side].seeds[k as usize].x)).collect()
        };
        let pair = SweepPair {
            up: SweepJob {
                source: Cow::Borrowed(&group.low.phi),
                goal: Cow::Borrowed(&group.high.phi),
                seeds: positions(&group.low.seeds, 0),
                courses: courses(&group.low.seeds, &low_fitted, &high_fitted, up_side, Direction::Up),
                times: times.to_vec(),
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
        };
        pairs.push((group.tile, pair));
    }
    Ok(pairs)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;
    use crate::settings::SlopeRule;

    #[test]
    fn whoever_asks_for_slopes_gets_them_on_relief_too() {
        let relief = |settings: Settings| relief(&settings, 0.75);
        assert_eq!(relief(Settings::default()), 0.75);
        assert_eq!(relief(Settings { slope: SlopeRule::Natural, ..Settings::default() }), 0.0);
        assert_eq!(relief(Settings { clamp_bottom: Some(0.0), ..Settings::default() }), 0.0);
        assert_eq!(relief(Settings { clamp_top: Some(0.0), ..Settings::default() }), 0.0);
    }

    #[test]
    fn particles_of_parts_that_are_kept_apart_count_as_arrived() {
        let value = |i: usize, j: usize| {
            let away = |x: f64| libm::hypot(i as f64 - x, j as f64 - 12.0) - 6.5;
            away(12.0).min(away(36.0))
        };
        let contour = Contour::new(0.0, Field::from_fn([48, 24], value), [1.0; 2], 1.0);
        let track = Track { distance: 0.0, arc: 0.0, landing: DVec2::ZERO, kept: 0.25 };
        let tracks = vec![track; contour.seeds.len()];
        let found: Vec<(DVec2, f64)> = particles(&contour, &tracks, &[false, false, true]).collect();
        assert!(found.len() > 16 && found.len() == contour.seeds.len());
        for (x, share) in found {
            assert_eq!(share, if x.x < 24.0 { 0.25 } else { 1.0 }, "at {x}");
        }
    }
}
