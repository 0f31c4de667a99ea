//! The first half of the metamorphosis: contours morphed into each other and courses fitted.

use std::borrow::Cow;

use rayon::prelude::*;

use super::context::{Context, stage};
use super::ends::{end_matter, make_ends, passing};
use super::events::{holes, named};
use super::finish::{Takers, faired};
use super::links::see_links;
use super::links::{IntervalLinks, in_frame};
use super::moving::{Side, close, lone_parts, moving_frame, slice_slopes};
use super::propagate::propagate;
use super::sweep_inputs::{FieldFallback, Pairs, SeenStack, SweepInputs};
use crate::backend::MorphOptions;
use crate::backend::jobs::PartJob;
use crate::backend::requests::{PartRequest, TraceRequest};
use crate::contour::Contour;
use crate::contour::direction::Direction;
use crate::contour::overlap::DecidedPairs;
use crate::error::{Error, Result};
use crate::pipeline::fit::{Measured, fit};
use crate::pipeline::matching::{ASKED_BYTES, Interval, IntervalPlan, asked_bytes};
use crate::pipeline::tracks;
use crate::pipeline::tracks::{Sides, trace_job};
use crate::registration::mid_frame::Frame;
use crate::registration::motion_stack::MotionStack;
use crate::report::{Event, IntervalReport, Report};
use crate::settings::Motion;
use crate::storage::spill::SpillVec;

/// All stages after the distance; the heights at which the body ends.
pub(super) fn morph<'a>(
    run: &Context<'a>,
    links: &mut [IntervalLinks],
    contours: &SpillVec<'a, Contour>,
    heights: &[f64],
    report: &mut Report,
    takers: Takers<'_>,
) -> Result<[f64; 2]> {
    let count = contours.len() - 1;
    let moving = match run.settings.motion {
        Motion::Field | Motion::Rigid => Some(moving_frame(run, links, contours, report)?),
        Motion::None => None,
    };
    see_links(run, links, contours, moving.as_ref())?;
    let (seen, parted) = in_frames(run, links, contours, moving.as_ref())?;
    let intervals = stage(run, report, "match", count, |report| {
        let (intervals, reports) = matching(run, &seen, &parted, moving.as_ref())?;
        report.intervals = reports;
        Ok(intervals)
    })?;
    let jobs = (0..count).map(|i| 2 * intervals.light(i).groups.len()).sum();
    let sides = stage(run, report, "trace", jobs, |report| {
        trace(run, &seen, &intervals, moving.as_ref(), &mut report.intervals)
    })?;
    let matter = end_matter(run, contours, moving.as_ref())?;
    let fitted = stage(run, report, "fit", 1, |_| {
        let measured = Measured { contours, sides: &sides, h: run.h, px: run.px, doubt: run.span.doubt };
        fit(&measured, run.settings, run.budget, |i, fitted| {
            // A slope that the user gives is the whole slope.
            let given = match i {
                0 => run.settings.clamp_bottom,
                _ if i == count => run.settings.clamp_top,
                _ => None,
            };
            match (&moving, given) {
                (Some(moving), Some(_)) => Ok(fitted.with_motion(&*contours.get(i)?, &*moving.rate(i)?, run.h, -1.0)),
                _ => passing(run, contours, moving.as_ref(), &matter, i, fitted),
            }
        })
    })?;
    let ends = make_ends(run, contours, &matter, [&*fitted.get(0)?, &*fitted.get(count)?], moving.as_ref(), report)?;
    let extent = ends.each_ref().map(|end| end.extent);
    let heights = run.heights(heights, extent)?;
    takers.sink.begin(&run.header(&heights, extent))?;
    let beside = match &moving {
        None => None,
        Some(moving) => {
            let slopes = slice_slopes(run, contours, moving, &matter, report)?;
            let lone = lone_parts(run, links, contours, moving, &slopes)?;
            Some(FieldFallback { moving, slopes, lone })
        }
    };
    let made = SweepInputs { contours, beside, seen, parted, intervals, sides, fitted, ends };
    stage(run, report, "propagate", jobs, |report| {
        faired(run, links, contours, moving.as_ref(), takers, |sink| propagate(run, &made, &heights, report, sink))
    })?;
    Ok(extent)
}

/// The contours of every interval in its frame, and the pairs of parts that are kept apart there.
fn in_frames<'a, 'c>(
    run: &Context<'a>,
    links: &[IntervalLinks],
    contours: &'c SpillVec<'a, Contour>,
    moving: Option<&MotionStack<'a>>,
) -> Result<(SeenStack<'c, 'a>, Vec<Pairs>)> {
    let count = contours.len() - 1;
    let Some(moving) = moving else {
        let parted = links.iter().map(IntervalLinks::told_apart).collect();
        return Ok((SeenStack { contours, moved: None }, parted));
    };
    let (mut moved, mut all_parted) = (SpillVec::new(run.budget), Vec::with_capacity(count));
    // Two contours as they are and as the frame sees them.
    let at_once = run.budget.at_once(count, 8 * run.field_bytes());
    let traced = run.span.traced.clone();
    let none = |moved: &mut SpillVec<'a, Contour>| [(); 2].iter().try_for_each(|()| moved.push(Contour::default()));
    (0..traced.start).try_for_each(|_| none(&mut moved))?;
    all_parted.resize(traced.start, Pairs::new());
    for first in traced.clone().step_by(at_once) {
        let some = first..(first + at_once).min(traced.end);
        let of_interval = |i: usize| {
            let parted = links[i].told_apart();
            let own = |k: usize| match parted.is_empty() && contours.light(k).solids.count > 0 {
                true => contours.some(k, Contour::SEEDS_AND_FIELD),
                false => contours.get(k),
            };
            let own = [own(i)?, own(i + 1)?];
            let frame = moving.middle(i)?;
            let seen = frame.contours(&own[0], &own[1], run.h).map(Cow::into_owned);
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

fn matching<'a>(
    run: &Context<'a>,
    seen: &SeenStack<'_, 'a>,
    parted: &[Pairs],
    moving: Option<&MotionStack<'a>>,
) -> Result<(SpillVec<'a, Interval>, Vec<IntervalReport>)> {
    let (margin, count) = (run.margin, parted.len());
    let (mut intervals, mut reports) = (SpillVec::new(run.budget), Vec::with_capacity(count));
    // Both contours, both ends of all groups, cut and answered.
    let at_once = run.budget.at_once(count, 8 * run.field_bytes());
    let traced = run.span.traced.clone();
    let most = run.budget.spare(ASKED_BYTES);
    let asked = |i: usize| {
        let things: usize = [i, i + 1].map(|k| seen.contours.light(k)).iter().map(|c| c.solids.count + c.holes).sum();
        things * asked_bytes(margin)
    };
    let mut first = 0;
    while first < count {
        let mut bytes = asked(first);
        let more = (first + 1..count.min(first + at_once)).take_while(|i| {
            bytes += asked(*i);
            bytes <= most
        });
        let some = first..first + 1 + more.count();
        let plan = |i: usize| {
            if !traced.contains(&i) {
                return Ok((IntervalPlan::default(), [0.0; 2]));
            }
            let [low, high] = seen.get(i)?;
            let plan = IntervalPlan::new(&low, &high, &DecidedPairs::parting(parted[i].clone()), margin, &run.known);
            Ok((plan, [low.z, high.z]))
        };
        let mut plans = some.into_par_iter().map(plan).collect::<Result<Vec<_>>>()?;
        let jobs: Vec<PartJob> = plans.iter_mut().flat_map(|(plan, _)| plan.take_jobs()).collect();
        let mut fields = run.backend.part_fields(&PartRequest { jobs: &jobs, h: run.h })?.into_iter();
        drop(jobs);
        let finished = plans.into_iter().map(|(plan, ends)| (plan.finish(&mut fields), ends)).collect::<Vec<_>>();
        let told = |(n, (interval, _)): (usize, &(Interval, [f64; 2]))| match traced.contains(&(first + n)) {
            true => told(seen, moving, first + n, &interval.events),
            false => Ok(Vec::new()),
        };
        let told = finished.par_iter().enumerate().map(told).collect::<Result<Vec<_>>>()?;
        for (i, ((mut interval, [z_low, z_high]), events)) in (first..).zip(finished.into_iter().zip(told)) {
            let Interval { groups, lone, .. } = &mut interval;
            for direction in [Direction::Up, Direction::Down] {
                close(run, seen.contours, i, direction, Side::Solid, lone.iter_mut())?;
                close(
                    run,
                    seen.contours,
                    i,
                    direction,
                    Side::Hole,
                    groups.iter_mut().flat_map(|group| &mut group.holes),
                )?;
            }
            let groups = interval.groups.len();
            reports.push(IntervalReport { z_low, z_high, groups, events, ..IntervalReport::default() });
            intervals.push(interval)?;
            run.progress.advance(1);
        }
        first = intervals.len();
    }
    Ok((intervals, reports))
}

/// Events of interval `i`, of which those of its parts are told as they were `seen`, as events of its contours.
fn told(seen: &SeenStack<'_, '_>, moving: Option<&MotionStack<'_>>, i: usize, events: &[Event]) -> Result<Vec<Event>> {
    let own = [seen.contours.get(i)?, seen.contours.get(i + 1)?];
    let own = own.each_ref().map(|contour| &**contour);
    let Some(moving) = moving else { return Ok([events, &holes(own, &Frame::default())].concat()) };
    let ([low, high], frame) = (seen.get(i)?, moving.middle(i)?);
    Ok([named(events, [&low, &high], own, &frame), holes(own, &frame)].concat())
}

/// Both morphs of every group, up and down, and what they say of the contours' seeds.
fn trace<'a>(
    run: &Context<'a>,
    seen: &SeenStack<'_, 'a>,
    intervals: &SpillVec<'a, Interval>,
    moving: Option<&MotionStack<'a>>,
    reports: &mut [IntervalReport],
) -> Result<SpillVec<'a, Sides>> {
    let count = intervals.len();
    let mut sides = SpillVec::new(run.budget);
    (0..run.span.traced.start).try_for_each(|_| sides.push(Sides::default()))?;
    // Both ends of all groups, and what a morph of each keeps.
    let at_once = run.budget.at_once(count, 10 * run.field_bytes());
    for first in run.span.traced.clone().step_by(at_once) {
        let some = first..(first + at_once).min(run.span.traced.end);
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
        let request = TraceRequest { jobs: &jobs, h: run.h, options: MorphOptions::from(run.settings) };
        let traced = run.backend.trace(&request, run.progress)?;
        for (t, &i) in traced.iter().zip(&owners) {
            let report = &mut reports[i];
            if let Some(k) = t.tracks.iter().position(|k| !(k.distance.is_finite() && k.landing.x.is_finite())) {
                let message = format!("particle {k} between heights {} and {} is lost", report.z_low, report.z_high);
                return Err(Error::Numerics { stage: "trace", message });
            }
            report.trace_steps += t.steps;
            report.trace_pixels += t.pixels;
            let arrived = t.tracks.iter().filter(|k| k.arrived()).count();
            report.particles.seeded += t.tracks.len();
            report.particles.arrived += arrived;
            report.particles.died += t.tracks.len() - arrived;
        }
        let frame = |i: usize| Ok(moving.map(|m| m.middle(i)).transpose()?.unwrap_or_default());
        let frames: Vec<Frame> = run.of_all(some.clone(), frame)?;
        let mut traced = traced.into_iter();
        for ((i, interval), frame) in some.zip(&loaded).zip(frames) {
            let own = |i| seen.contours.some(i, Contour::SEEDS_AND_PARTS);
            let [low, high] = [own(i)?, own(i + 1)?];
            let [up, down] = tracks::sides([&low, &high], interval, &frame, &mut traced);
            sides.push(Sides { up: Some(up), down: Some(down) })?;
        }
    }
    (run.span.traced.end..count).try_for_each(|_| sides.push(Sides::default()))?;
    Ok(sides)
}
