//! The stages that make the moving frame and what the fields say in it.

use std::ops::Range;
use std::sync::Arc;

use super::context::{Context, stage};
use super::ends::{EndMatter, passing_field};
use super::far_motion::far_motion;
use super::grazing::without_grazing;
use super::leaps::Surroundings;
use super::links::{IntervalLinks, frames};
use super::missed_motion::missed_motion;
use crate::backend::jobs::PartJob;
use crate::backend::requests::{PartRequest, SlopeRequest};
use crate::contour::Contour;
use crate::contour::caps::Cap;
use crate::contour::direction::Direction;
use crate::contour::termination::{Succession, closes};
use crate::contour::unmatched::{LonePart, without_partner};
use crate::error::Result;
use crate::grid::field::Field;
use crate::pipeline::compose::mean_slope;
use crate::pipeline::fit::Fitted;
use crate::pipeline::matching::LonePlan;
use crate::pipeline::section::NEIGHBOURS;
use crate::reference::displacement::ROUNDS;
use crate::registration::displacement::{Displacement, DisplacementJob};
use crate::registration::lone_parts::{Beside, LEAST_DEPTH, LoneParts, drawn_in, paraboloid};
use crate::registration::motion_stack::MotionStack;
use crate::report::Report;
use crate::settings::Motion;
use crate::storage::spill::SpillVec;

/// Bytes of the parts without partner whose distances are asked for together.
const LONE_BYTES: usize = 16 << 20;

/// The stack in its moving frame.
pub(super) fn moving_frame<'a>(
    run: &Context<'a>,
    links: &[IntervalLinks],
    contours: &SpillVec<'a, Contour>,
    report: &mut Report,
) -> Result<MotionStack<'a>> {
    stage(run, report, "motion", contours.len() - 1, |report| {
        let fields = filled_fields(run, contours, false)?;
        let z: Vec<f64> = (0..contours.len()).map(|i| contours.light(i).z).collect();
        let displacements = match run.settings.motion {
            Motion::Field => {
                let guess = frames(run, links, contours, report)?;
                field_displacements(run, links, contours, &fields, guess)?
            }
            Motion::Rigid => frames(run, links, contours, report)?,
            Motion::None => run.spilled((1..z.len()).map(|_| Displacement::zero(run.padded())))?,
        };
        run.progress.advance(z.len() - 1);
        let drawn: Vec<bool> = (0..z.len()).map(|i| contours.light(i).solids.count > 0).collect();
        let fields = if drawn.contains(&false) {
            drop(fields);
            filled_fields(run, contours, true)?
        } else {
            fields
        };
        MotionStack::new(
            z,
            run.span.gaps.clone(),
            run.px,
            run.span.change.relief,
            run.span.doubt,
            fields,
            displacements,
            &drawn,
            run.budget,
        )
    })
}

/// Distances of all slices; an empty one reads as its nearest contours drawn in.
fn filled_fields<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    falling: bool,
) -> Result<SpillVec<'a, Field>> {
    let mut fields = SpillVec::new(run.budget);
    let full = |i: &usize| contours.light(*i).solids.count > 0;
    for i in 0..contours.len() {
        fields.push(if full(&i) {
            contours.some(i, Contour::FIELD)?.phi.clone()
        } else {
            let nearest = [(0..i).rev().find(full), (i + 1..contours.len()).find(full)];
            let beside = |k: usize| {
                let contour = contours.some(k, Contour::FIELD)?;
                let before = if k < i { k.checked_sub(1) } else { Some(k + 1).filter(|b| *b < contours.len()) };
                let before = before.filter(|b| falling && full(b));
                let area = |contour: &Contour| contour.disc_area(&run.seen, run.h);
                let z = |k: usize| contours.light(k).z;
                let falls = match before {
                    Some(b) => paraboloid(
                        [area(&contour), area(&*contours.some(b, Contour::FIELD)?)],
                        [z(i) - z(k), z(k) - z(b)].map(f64::abs),
                    ),
                    None => 0.0,
                };
                Ok(Beside { contour, falls })
            };
            let nearest = nearest.into_iter().flatten().map(beside).collect::<Result<Vec<_>>>()?;
            drawn_in(&nearest, run.padded())
        })?;
    }
    Ok(fields)
}

/// The slices of an interval and those beyond them.
struct Around {
    contours: [Arc<Contour>; 2],
    beyond: [Option<Arc<Contour>>; 2],
    gaps: [f64; 2],
    h: [f64; 2],
}

impl Around {
    fn new<'a>(run: &Context<'a>, contours: &SpillVec<'a, Contour>, i: usize) -> Result<Self> {
        let beyond = |k: usize| contours.some(k, Contour::SEEDS_AND_PARTS);
        let below = i.checked_sub(1).map(beyond).transpose()?;
        let above = (i + 2 < contours.len()).then(|| beyond(i + 2)).transpose()?;
        let gap = |k: Option<usize>| k.and_then(|k| run.span.gaps.get(k)).map_or(1.0, |gap| gap / run.span.gaps[i]);
        Ok(Around {
            contours: [contours.get(i)?, contours.get(i + 1)?],
            beyond: [below, above],
            gaps: [gap(i.checked_sub(1)), gap(Some(i + 1))],
            h: run.h,
        })
    }

    fn surroundings(&self) -> Surroundings<'_> {
        let contours = self.contours.each_ref().map(|contour| &**contour);
        let beyond = self.beyond.each_ref().map(Option::as_deref);
        Surroundings::new(contours, beyond, self.gaps, self.h)
    }
}

/// Displacements of all intervals, less what would join parts by chance.
fn field_displacements<'a>(
    run: &Context<'a>,
    links: &[IntervalLinks],
    contours: &SpillVec<'a, Contour>,
    fields: &SpillVec<'a, Field>,
    guess: SpillVec<'a, Displacement>,
) -> Result<SpillVec<'a, Displacement>> {
    let begin = beginnings(run, contours, &guess)?;
    let found = displacements(run, fields, &begin)?;
    let mut kept = SpillVec::new(run.budget);
    for (i, links) in links.iter().enumerate() {
        let slices = Around::new(run, contours, i)?;
        let found = found.get(i)?;
        let both = slices.contours.each_ref().map(|contour| &**contour);
        let missed = missed_motion(both, &links.joined(), &found, run.backend, run.h)?;
        let v = missed.unwrap_or_else(|| found.as_ref().clone());
        kept.push(without_grazing(v, &*guess.get(i)?, &slices.surroundings(), &links.joined()))?;
    }
    Ok(kept)
}

/// Displacements of all intervals that the search for them begins with and is drawn to.
fn beginnings<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    guess: &SpillVec<'a, Displacement>,
) -> Result<SpillVec<'a, Displacement>> {
    let mut out = SpillVec::new(run.budget);
    for i in 0..run.span.gaps.len() {
        let drawn = [i, i + 1].iter().all(|k| contours.light(*k).solids.count > 0);
        let guess = guess.get(i)?;
        out.push(if drawn {
            let slices = [contours.get(i)?, contours.get(i + 1)?];
            far_motion(slices.each_ref().map(|contour| &**contour), &guess, run.backend, run.h)?
        } else {
            guess.as_ref().clone()
        })?;
    }
    Ok(out)
}

/// Displacements of all intervals: all rounds together where the fields fit into memory, else round by round a few intervals at a time,
/// with one to either side that takes part.
fn displacements<'a>(
    run: &Context<'a>,
    fields: &SpillVec<'a, Field>,
    guess: &SpillVec<'a, Displacement>,
) -> Result<SpillVec<'a, Displacement>> {
    let gaps = &run.span.gaps;
    let count = gaps.len();
    // A field, and what is known of its blocks.
    let at_once = run.budget.at_once(count, 2 * run.field_bytes());
    if at_once == count {
        let found = some_displacements(run, fields, [guess; 2], 0..count, 0..ROUNDS.len(), 0..count)?;
        return run.spilled(found);
    }
    let own = at_once.saturating_sub(2).max(1);
    let mut current = SpillVec::new(run.budget);
    for round in 0..ROUNDS.len() {
        let mut better = SpillVec::new(run.budget);
        for first in (0..count).step_by(own) {
            let wanted = first..(first + own).min(count);
            let around = first.saturating_sub(1)..(wanted.end + 1).min(count);
            let begin = [guess, if round == 0 { guess } else { &current }];
            for found in some_displacements(run, fields, begin, around, round..round + 1, wanted)? {
                better.push(found)?;
            }
        }
        current = better;
    }
    Ok(current)
}

/// The `wanted` displacements of intervals `around` after some rounds from what is the second of `from`, their guess being the first.
fn some_displacements<'a>(
    run: &Context<'a>,
    fields: &SpillVec<'a, Field>,
    [guess, begin]: [&SpillVec<'a, Displacement>; 2],
    around: Range<usize>,
    rounds: Range<usize>,
    wanted: Range<usize>,
) -> Result<impl Iterator<Item = Displacement>> {
    let load = |spilled: &SpillVec<'a, Displacement>| {
        around.clone().map(|i| Ok(spilled.get(i)?.as_ref().clone())).collect::<Result<Vec<_>>>()
    };
    let found = run.backend.displacements(&DisplacementJob {
        fields: &(around.start..=around.end).map(|i| fields.get(i)).collect::<Result<Vec<_>>>()?,
        gaps: &run.span.gaps[around.clone()],
        guess: &load(guess)?,
        begin: &load(begin)?,
        rounds,
        h: run.h,
    })?;
    Ok(found.into_iter().skip(wanted.start - around.start).take(wanted.len()))
}

/// Slopes of the fields of all slices beside layers, passing smoothly into what lies beyond the ends.
pub(super) fn slice_slopes<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    moving: &MotionStack<'a>,
    matter: &[EndMatter; 2],
    report: &mut Report,
) -> Result<SpillVec<'a, Field>> {
    let count = moving.slices();
    stage(run, report, "slopes", count, |_| {
        let mut slopes = SpillVec::new(run.budget);
        // A field and the slopes.
        let own = run.budget.at_once(count, 2 * run.field_bytes());
        let wanted = run.span.layers.start..run.span.layers.end + 1;
        (0..wanted.start).try_for_each(|_| slopes.push(Field::default()))?;
        for first in wanted.clone().step_by(own) {
            let end = (first + own).min(wanted.end);
            let around = first.saturating_sub(NEIGHBOURS)..(end + NEIGHBOURS).min(count);
            let own = first - around.start..end - around.start;
            let found = run
                .backend
                .moving_slopes(&SlopeRequest { moving: &moving.part(around)?, wanted: own }, run.progress)?;
            for (i, mut field) in (first..).zip(found) {
                passing_field(run, contours, moving, matter, i, &mut field)?;
                slopes.push(field)?;
            }
        }
        Ok(slopes)
    })
}

/// Parts of a contour or its holes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Solid,
    Hole,
}

impl Side {
    const BOTH: [Side; 2] = [Side::Solid, Side::Hole];

    /// Contour `k` with what is on this side as its parts.
    fn of<'a>(self, contours: &SpillVec<'a, Contour>, k: usize) -> Result<Arc<Contour>> {
        let contour = contours.get(k)?;
        Ok(if self == Side::Hole { Arc::new(contour.turned()) } else { contour })
    }
}

/// Parts and holes that meet none in the other slice along their trajectories, interval by interval, and how they close by the field's slopes. The
/// backend is asked for those of several intervals together.
pub(super) fn lone_parts<'a>(
    run: &Context<'a>,
    links: &[IntervalLinks],
    contours: &SpillVec<'a, Contour>,
    moving: &MotionStack<'a>,
    slopes: &SpillVec<'a, Field>,
) -> Result<SpillVec<'a, LoneParts>> {
    let mut out = SpillVec::new(run.budget);
    (0..run.span.layers.start).try_for_each(|_| out.push(LoneParts::default()))?;
    let most = run.budget.spare(LONE_BYTES);
    let (mut plans, mut jobs, mut bytes) = (Vec::new(), Vec::new(), 0);
    for i in run.span.layers.clone() {
        let ending = Around::new(run, contours, i)?.surroundings().ending(&links[i].joined());
        let plan = |direction| -> Result<[LonePlan; 2]> {
            let ending = &ending[usize::from(direction == Direction::Down)];
            let [solid, hole] = [(Side::Solid, &ending[..]), (Side::Hole, &[])]
                .map(|(side, ending)| plan_lone(run, contours, moving, i, direction, side, ending));
            Ok([solid?, hole?])
        };
        let mut both = [plan(Direction::Up)?, plan(Direction::Down)?];
        let more: Vec<PartJob> = both.iter_mut().flatten().flat_map(LonePlan::take_jobs).collect();
        bytes += more.iter().map(|job| job.inside.len() * (size_of::<f64>() + 1)).sum::<usize>();
        jobs.extend(more);
        plans.push((i, both));
        if bytes > most || i + 1 == run.span.layers.end {
            let asked = PartRequest { jobs: &std::mem::take(&mut jobs), h: run.h };
            let mut fields = run.backend.part_fields(&asked)?.into_iter();
            for (i, both) in plans.drain(..) {
                let [low, high] = both.map(|sides| sides.map(|plan| plan.finish(&mut fields)));
                let close = |lone: [Vec<LonePart>; 2], direction| -> Result<Vec<Cap>> {
                    let sides = lone.into_iter().zip(Side::BOTH);
                    let caps = sides.map(|(lone, side)| closing_caps(run, contours, slopes, i, direction, side, lone));
                    Ok(caps.collect::<Result<Vec<_>>>()?.concat())
                };
                let empty = [i, i + 1].iter().any(|k| contours.light(*k).solids.count == 0);
                out.push(LoneParts { low: close(low, Direction::Up)?, high: close(high, Direction::Down)?, empty })?;
            }
            bytes = 0;
        }
    }
    Ok(out)
}

/// Parts of a contour of interval `i`, or its holes, that meet none in the other one, and those that end all the same.
fn plan_lone<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    moving: &MotionStack<'a>,
    i: usize,
    direction: Direction,
    side: Side,
    ending: &[u32],
) -> Result<LonePlan> {
    let (number, other, way) = match direction {
        Direction::Up => (i, i + 1, 1.0),
        Direction::Down => (i + 1, i, -1.0),
    };
    let drawn = contours.light(other).solids.count > 0;
    if side == Side::Hole && (contours.light(number).holes == 0 || !drawn) {
        return Ok(LonePlan::default());
    }
    let least = if drawn { LEAST_DEPTH } else { 0.0 };
    let (own, other) = (side.of(contours, number)?, moving.field(other)?);
    let at_slices = moving.at_slices(i)?;
    let u = &at_slices[usize::from(direction == Direction::Down)];
    let mut parts = without_partner(&own, least, |x| {
        let inside = other.sample(x + way * u.at(x)) < 0.0;
        inside == (side == Side::Solid)
    });
    parts.extend(ending);
    parts.sort_unstable();
    parts.dedup();
    Ok(LonePlan::new(&own, &parts, run.margin, direction, &run.known))
}

/// Parts of a contour of interval `i`, or its holes, as they close.
fn closing_caps<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    slopes: &SpillVec<'a, Field>,
    i: usize,
    direction: Direction,
    side: Side,
    mut lone: Vec<LonePart>,
) -> Result<Vec<Cap>> {
    if lone.is_empty() {
        return Ok(Vec::new());
    }
    let (number, way) = match direction {
        Direction::Up => (i, 1.0),
        Direction::Down => (i + 1, -1.0),
    };
    close(run, contours, i, direction, side, lone.iter_mut())?;
    let fitted = Fitted::of_field(&*contours.get(number)?, &*slopes.get(number)?);
    // On a first or last slice nothing but the gap itself says how a part goes on, in which it ends.
    let told = match direction {
        Direction::Up => i > 0,
        Direction::Down => i + 2 < contours.len(),
    };
    let way = if side == Side::Hole { -way } else { way };
    let slope = |part: &LonePart| if told { way * run.span.gaps[i] * mean_slope(&fitted, part.counted()) } else { 0.0 };
    let farthest = run.settings.margin() as f64;
    let hole = side == Side::Hole;
    Ok(lone.iter().map(|part| Cap { hole, ..Cap::new(part, slope(part), part.closes, farthest) }).collect())
}

/// Says where parts or holes without partner in interval `i` end, which go on from its lower contour or, `Direction::Down`, from its upper one.
pub(super) fn close<'a, 'l>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    i: usize,
    direction: Direction,
    side: Side,
    lone: impl Iterator<Item = &'l mut LonePart>,
) -> Result<()> {
    let mut lone = lone.filter(|part| part.direction == direction).peekable();
    if lone.peek().is_none() {
        return Ok(());
    }
    if let Ok(mut closing) = run.closing.lock() {
        closing.insert(run.span.first + i);
    }
    let gap = |k: usize| run.span.gap_as_width(k) / run.px;
    let (own, inner) = match direction {
        Direction::Up => (i, i.checked_sub(1).map(|k| (k, gap(k)))),
        Direction::Down => (i + 1, (i + 2 < contours.len()).then(|| (i + 2, gap(i + 1)))),
    };
    let own = match side {
        Side::Solid => contours.some(own, Contour::SEEDS_AND_PARTS)?,
        Side::Hole => side.of(contours, own)?,
    };
    let inner = inner.map(|(k, gap)| side.of(contours, k).map(|c| (c, gap))).transpose()?;
    let inner = inner.as_ref().map(|(inner, gap)| (Succession::new(&own, inner, &run.known), *gap));
    let inner = inner.as_ref().map(|(inner, gap)| (inner, *gap));
    for part in lone {
        part.closes = closes(part, gap(i), inner);
    }
    Ok(())
}
