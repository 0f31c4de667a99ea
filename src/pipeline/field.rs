//! The field method: no morph, the slices' own distances interpolated along the trajectories of a smooth moving frame.

use std::sync::Arc;

use super::context::{Context, Sink, stage, time};
use super::ends::{above, below, end_matter, make_ends};
use super::events::holes;
use super::finish::{Takers, faired};
use super::links::{IntervalLinks, see_links};
use super::moving::{lone_parts, moving_frame, slice_slopes};
use crate::backend::interval_morph::together;
use crate::backend::requests::LayerRequest;
use crate::contour::Contour;
use crate::contour::overlap::{DecidedPairs, match_components};
use crate::error::{Error, Result};
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::pipeline::ends::end_caps::End;
use crate::pipeline::fit::Fitted;
use crate::registration::lone_parts::LoneParts;
use crate::registration::motion_field::MotionField;
use crate::registration::motion_stack::MotionStack;
use crate::report::{IntervalReport, Report};
use crate::stack::heights::{Height, Heights};
use crate::storage::spill::SpillVec;
use crate::surface::Layer;

/// Results of the stages before the layers.
struct Made<'a> {
    moving: MotionStack<'a>,
    slopes: SpillVec<'a, Field>,
    lone: SpillVec<'a, LoneParts>,
    ends: [End; 2],
}

/// What lies between the slices of an interval.
struct Between {
    moving: MotionField,
    slopes: [Arc<Field>; 2],
    lone: Arc<LoneParts>,
}

impl Between {
    /// Asks for the layers at these times.
    fn request<'b>(&'b self, run: &Context<'_>, times: &'b [f64]) -> LayerRequest<'b> {
        LayerRequest {
            moving: &self.moving,
            interval: 0,
            slopes: self.slopes.each_ref(),
            lone: &self.lone,
            times,
            limit: run.settings.margin() as f64,
            h: run.h,
            wanted: None,
        }
    }
}

/// All stages after the distance; the heights at which the body ends.
pub(super) fn field<'a>(
    run: &Context<'a>,
    links: &mut [IntervalLinks],
    contours: &SpillVec<'a, Contour>,
    heights: &[f64],
    report: &mut Report,
    takers: Takers<'_>,
) -> Result<[f64; 2]> {
    report.intervals = events(run, links, contours)?;
    let moving = moving_frame(run, links, contours, report)?;
    let hollow = |i: &usize| contours.light(*i).holes + contours.light(i + 1).holes > 0;
    for i in (0..report.intervals.len()).filter(hollow) {
        let own = [contours.get(i)?, contours.get(i + 1)?];
        report.intervals[i].events.extend(holes(own.each_ref().map(|contour| &**contour), &moving.middle(i)?));
    }
    see_links(run, links, contours, Some(&moving))?;
    let matter = end_matter(run, contours, Some(&moving))?;
    let slopes = slice_slopes(run, contours, &moving, &matter, report)?;
    let last = contours.len() - 1;
    let fitted = |i: usize, end: usize| match run.span.ends[end] {
        true => Ok(Fitted::of_field(&*contours.get(i)?, &*slopes.get(i)?)),
        false => Ok(Fitted::default()),
    };
    let fitted: [Result<Fitted>; 2] = [fitted(0, 0), fitted(last, 1)];
    let [bottom, top] = fitted;
    let ends = make_ends(run, contours, &matter, [&bottom?, &top?], Some(&moving), report)?;
    let extent = ends.each_ref().map(|end| end.extent);
    let heights = run.heights(heights, extent)?;
    takers.sink.begin(&run.header(&heights, extent))?;
    let lone = lone_parts(run, links, contours, &moving, &slopes)?;
    let made = Made { moving, slopes, lone, ends };
    stage(run, report, "layers", heights.all.len(), |_| {
        faired(run, links, contours, Some(&made.moving), takers, |sink| layers(run, contours, &made, &heights, sink))
    })?;
    Ok(extent)
}

/// Events between neighbouring contours, as their parts overlap.
fn events(run: &Context<'_>, links: &[IntervalLinks], contours: &SpillVec<'_, Contour>) -> Result<Vec<IntervalReport>> {
    let of = |i: usize, [low, high]: [&Contour; 2]| {
        let linked = DecidedPairs::joining(&links[i].joined());
        let matching = match_components((&low.solids, &low.phi), (&high.solids, &high.phi), &linked);
        IntervalReport {
            z_low: low.z,
            z_high: high.z,
            groups: matching.groups.len(),
            events: matching.events(),
            ..IntervalReport::default()
        }
    };
    run.of_pairs(contours, of)
}

fn layers<'a>(
    run: &Context<'a>,
    contours: &SpillVec<'a, Contour>,
    made: &Made<'a>,
    heights: &Heights,
    sink: &mut Sink<'_>,
) -> Result<()> {
    let Made { moving, slopes, lone, ends } = made;
    below(run, contours, ends, heights, sink)?;
    let all = run.span.layers.clone();
    for some in together(all.clone().map(|i| heights.between(i).len()), run.layers_at_once()) {
        let together = all.start + some.start..all.start + some.end;
        let between = |i: usize| {
            let slopes = [slopes.get(i)?, slopes.get(i + 1)?];
            Ok(Between { moving: moving.part(i..i + 2)?, slopes, lone: lone.get(i)? })
        };
        let frames = together.clone().map(between).collect::<Result<Vec<Between>>>()?;
        let most = together.clone().map(|i| heights.between(i).len()).max().unwrap_or(0);
        let at_once = if together.len() > 1 { most.max(1) } else { run.layers_at_once() };
        for first in (0..most.max(1)).step_by(at_once) {
            let some = |i: usize| {
                let all = heights.between(i);
                &all[first.min(all.len())..(first + at_once).min(all.len())]
            };
            let times = |i: usize| {
                let (low, high) = (contours.light(i).z, contours.light(i + 1).z);
                some(i).iter().map(|x| time(x.z, low, high)).collect::<Vec<f64>>()
            };
            let times: Vec<Vec<f64>> = together.clone().map(times).collect();
            let requests = frames.iter().zip(&times).map(|(between, times)| between.request(run, times));
            let requests: Vec<LayerRequest<'_>> = requests.collect();
            let layers = run.backend.moving_layers(&requests)?;
            for (i, layers) in together.clone().zip(layers) {
                if first == 0 {
                    sink(run.contour_layer(&heights.contours[i], &*contours.get(i)?, i))?;
                }
                for (height, values) in some(i).iter().zip(layers) {
                    sink(whole_layer(run, height, &values)?)?;
                    run.progress.advance(1);
                }
            }
        }
    }
    above(run, contours, ends, heights, sink)
}

/// A layer of these values on the padded image.
fn whole_layer(run: &Context<'_>, height: &Height, values: &SparseImage<f32>) -> Result<Layer> {
    if values.values().any(f32::is_nan) {
        let message = format!("NaN at height {}", height.z);
        return Err(Error::Numerics { stage: "layers", message });
    }
    let mut canvas = run.canvas();
    let whole = Tile::all(run.padded());
    canvas.unite_packed(&whole, values);
    Ok(run.layer(height, canvas.phi))
}
