//! Layers below the first contour and above the last one.

pub(crate) mod end_caps;
pub mod end_law;
pub(crate) mod end_parts;
pub mod rounded;

use super::context::{Context, Sink};
use crate::contour::Contour;
use crate::contour::direction::Direction;
use crate::error::Result;
use crate::grid::field::{Field, covered};
use crate::grid::tile::Tile;
use crate::pipeline::ends::end_caps::{End, EndSpec, end};
use crate::pipeline::ends::end_parts::{EndPart, Levels, TOGETHER};
use crate::pipeline::fit::Fitted;
use crate::registration::motion_stack::MotionStack;
use crate::report::{BodyEnd, CapReport, EndReport, Report};
use crate::settings::EndRule;
use crate::stack::ending::{LOOKED_AT, ending, gap_of_ending, gap_to_next};
use crate::stack::heights::Heights;
use crate::storage::spill::SpillVec;

/// Material of an end.
#[derive(Default)]
pub(super) struct EndMatter {
    parts: Vec<EndPart>,
    /// Distances inward of the contours that have a say, the first 0.
    away: Vec<f64>,
    /// Distance to the contour next to the outermost.
    gap: f64,
    /// Largest height of an extrapolated cap.
    highest: f64,
}

/// Numbers of the contours at an end, the outermost first; none where the run does not reach it.
fn outermost<'a>(run: &Context<'a>, contours: &SpillVec<'a, Contour>, side: usize) -> Vec<usize> {
    let count = contours.len();
    let some = LOOKED_AT.min(count);
    match (run.span.ends[side], side) {
        (false, _) => Vec::new(),
        (true, 0) => (0..some).collect(),
        (true, _) => (count - some..count).rev().collect(),
    }
}

/// The parts of both end contours.
pub(super) fn end_matter<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    moving: Option<&MotionStack<'a>>,
) -> Result<[EndMatter; 2]> {
    let of = |side: usize| {
        let mut at = outermost(run, contours, side);
        let z: Vec<f64> = at.iter().map(|i| contours.light(*i).z).collect();
        let says = ending(&z, run.span.gap);
        let Some(innermost) = says.last() else { return Ok(EndMatter::default()) };
        at.truncate(innermost + 1);
        let way = |from: usize, to: usize| {
            let Some(moving) = moving else { return Ok(None) };
            let [low, high] = &*moving.at_slices(from.min(to))?;
            Ok(Some(if from < to { (low.clone(), 1.0) } else { (high.clone(), -1.0) }))
        };
        let levels = Levels {
            contours: at.iter().map(|i| contours.get(*i)).collect::<Result<_>>()?,
            ways: at.windows(2).map(|pair| way(pair[0], pair[1])).collect::<Result<_>>()?,
            says: (0..at.len()).map(|level| says.contains(&level)).collect(),
            h: run.h,
            margin: run.margin,
            known: &run.known,
            seen: &run.seen,
            backend: run.backend,
            together: if run.budget.is_bounded() { 0 } else { TOGETHER },
        };
        let gap = z.get(1).map_or(0.0, |inner| (inner - z[0]).abs());
        Ok(EndMatter {
            parts: levels.parts()?,
            away: says.iter().map(|level| (z[*level] - z[0]).abs()).collect(),
            gap,
            highest: run.settings.highest_cap(gap_to_next(&z, run.span.gap), gap_of_ending(&z, run.span.gap)),
        })
    };
    Ok([of(0)?, of(1)?])
}

fn end_spec<'a, 'm>(run: &Context<'a>, matter: &'m EndMatter, z: f64, side: usize) -> EndSpec<'m> {
    EndSpec {
        told_by_areas: 1.0 - run.span.change.relief,
        z,
        parts: &matter.parts,
        away: &matter.away,
        direction: [Direction::Down, Direction::Up][side],
        rule: [run.settings.end_bottom, run.settings.end_top][side],
        gap: matter.gap,
        highest: matter.highest,
        clamped: [run.settings.clamp_bottom, run.settings.clamp_top][side].is_some(),
    }
}

/// The slopes of contour `i`, passing smoothly into what lies beyond where it is the first or the last one.
pub(super) fn passing<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    moving: Option<&MotionStack<'a>>,
    matter: &[EndMatter; 2],
    i: usize,
    fitted: Fitted,
) -> Result<Fitted> {
    let side = usize::from(i > 0);
    if !run.span.ends[side] || (i > 0 && i + 1 < contours.len()) {
        return Ok(fitted);
    }
    let whole = whole(run, contours, moving, i, &fitted)?;
    Ok(end_caps::passing(&end_spec(run, &matter[side], contours.light(i).z, side), fitted, &whole))
}

/// The slopes of contour `i`'s field, passing smoothly into what lies beyond.
pub(super) fn passing_field<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    moving: &MotionStack<'a>,
    matter: &[EndMatter; 2],
    i: usize,
    slopes: &mut Field,
) -> Result<()> {
    let side = usize::from(i > 0);
    if !run.span.ends[side] || (i > 0 && i + 1 < contours.len()) || !run.settings.steered_ends()[side] {
        return Ok(());
    }
    let contour = contours.get(i)?;
    let whole = whole(run, contours, Some(moving), i, &Fitted::of_field(&contour, slopes))?;
    end_caps::passing_field(&end_spec(run, &matter[side], contour.z, side), slopes, &whole);
    Ok(())
}

/// Slopes of contour `i` with what the frame's motion explains.
fn whole<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    moving: Option<&MotionStack<'a>>,
    i: usize,
    fitted: &Fitted,
) -> Result<Fitted> {
    let Some(moving) = moving else { return Ok(fitted.clone()) };
    Ok(fitted.with_motion(&*contours.get(i)?, &*moving.rate(i)?, run.h, 1.0))
}

/// Both ends of the body, from their parts and what was fitted at the first and last contour.
pub(super) fn make_ends<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    matter: &[EndMatter; 2],
    fitted: [&Fitted; 2],
    moving: Option<&MotionStack<'a>>,
    report: &mut Report,
) -> Result<[End; 2]> {
    let (mut warnings, mut told) = (Vec::new(), Vec::new());
    let mut make = |side: usize| {
        let at = side * (contours.len() - 1);
        let z = contours.light(at).z;
        if !run.span.ends[side] {
            return Ok(End::cut(z));
        }
        let spec = end_spec(run, &matter[side], z, side);
        let whole = whole(run, contours, moving, at, fitted[side])?;
        let made = end(&spec, &whole, &mut warnings);
        told.push(end_report(run, &spec, &whole, &made, &*contours.get(at)?));
        Ok(made)
    };
    let ends = [make(0)?, make(1)?];
    report.warnings.append(&mut warnings);
    report.ends = told;
    Ok(ends)
}

/// Report of what `made` and other rules add to the body.
fn end_report<'a>(run: &Context<'a>, spec: &EndSpec<'_>, fitted: &Fitted, made: &End, contour: &Contour) -> EndReport {
    let caps = match spec.rule {
        EndRule::Extrapolate => None,
        // What it warns of concerns a rule that is not in use.
        _ => Some(end(&EndSpec { rule: EndRule::Extrapolate, ..*spec }, fitted, &mut Vec::new())),
    };
    let mut area = 0.0;
    let whole = Tile::all(contour.phi.dims);
    run.canvas().visit(&whole, |n| {
        if run.known.has(n, contour.phi.dims[0]) {
            area += covered(contour.phi.data[n]);
        }
    });
    let pixel = run.stack.spacing[0] * run.stack.spacing[1];
    let volume = |end: &End| pixel * end.volume(area);
    let cap = |told: &crate::pipeline::ends::end_caps::Told| CapReport {
        part: told.part,
        rule: told.rule,
        height: told.height,
    };
    EndReport {
        side: if spec.direction == Direction::Up { BodyEnd::Top } else { BodyEnd::Bottom },
        z: spec.z,
        area: pixel * area,
        used: volume(made),
        half_slice: 0.5 * spec.gap * pixel * area,
        extrapolate: volume(caps.as_ref().unwrap_or(made)),
        caps: made.told.iter().map(cap).collect(),
    }
}

/// The layers below the first contour.
pub(super) fn below<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    ends: &[End; 2],
    heights: &Heights,
    sink: &mut Sink<'_>,
) -> Result<()> {
    if !run.span.ends[0] {
        return Ok(());
    }
    let first = contours.get(0)?;
    let mut below = heights.all.iter().filter(|x| x.z < first.z);
    below.try_for_each(|x| sink(run.layer(x, ends[0].layer(x.z, &first, run.canvas()).phi)))
}

/// The last contour's layer and those above it.
pub(super) fn above<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    ends: &[End; 2],
    heights: &Heights,
    sink: &mut Sink<'_>,
) -> Result<()> {
    let number = run.span.layers.end;
    let last = contours.get(number)?;
    sink(run.contour_layer(&heights.contours[number], &last, number))?;
    if !run.span.ends[1] {
        return Ok(());
    }
    let mut above = heights.all.iter().filter(|x| x.z > last.z);
    above.try_for_each(|x| sink(run.layer(x, ends[1].layer(x.z, &last, run.canvas()).phi)))
}
