//! The field method: no morph, the slices' own distances interpolated along the trajectories of a smooth moving frame.

use super::{Run, Sink, time};
use crate::contour::Contour;
use crate::contour::overlap::{DecidedPairs, match_components};
use crate::error::{Error, Result};
use crate::grid::field::Field;
use crate::grid::tile::Tile;
use crate::pipeline::ends::end_caps::End;
use crate::pipeline::fit::Fitted;
use crate::registration::motion_field::LoneParts;
use crate::registration::motion_stack::MotionStack;
use crate::report::IntervalReport;
use crate::stack::heights::Heights;
use crate::storage::spill::SpillVec;
use crate::surface::stream::LayerSink;

/// What the stages before the layers have made.
struct Made<'a> {
    moving: MotionStack<'a>,
    slopes: SpillVec<'a, Field>,
    lone: SpillVec<'a, LoneParts>,
    ends: [End; 2],
}

impl<'a> Run<'a> {
    /// All stages after the distance; the heights at which the body ends.
    pub(super) fn field(
        &mut self,
        contours: &SpillVec<'a, Contour>,
        heights: &[f64],
        sink: &mut dyn LayerSink,
    ) -> Result<[f64; 2]> {
        self.tell_events(contours)?;
        let moving = self.moving(contours)?;
        self.see_links(contours, Some(&moving))?;
        let matter = self.end_matter(contours, Some(&moving))?;
        let slopes = self.slopes(contours, &moving, &matter)?;
        let last = contours.len() - 1;
        let fitted = |i: usize, end: usize| match self.span.ends[end] {
            true => Ok(Fitted::of_field(&*contours.get(i)?, &*slopes.get(i)?)),
            false => Ok(Fitted::default()),
        };
        let fitted: [Result<Fitted>; 2] = [fitted(0, 0), fitted(last, 1)];
        let [bottom, top] = fitted;
        let ends = self.ends(contours, &matter, [&bottom?, &top?], Some(&moving))?;
        let extent = ends.each_ref().map(|end| end.extent);
        let heights = self.heights(heights, extent)?;
        sink.begin(&self.header(&heights, extent))?;
        let sink: &mut Sink<'_> = &mut |layer| sink.layer(layer);
        let lone = self.lone_parts(contours, &moving, &slopes)?;
        let made = Made { moving, slopes, lone, ends };
        self.stage("layers", heights.all.len(), |run| {
            run.faired(contours, Some(&made.moving), sink, |run, sink| run.layers(contours, &made, &heights, sink))
        })?;
        Ok(extent)
    }

    fn tell_events(&mut self, contours: &SpillVec<'a, Contour>) -> Result<()> {
        let of = |i: usize, [low, high]: [&Contour; 2]| {
            let linked = DecidedPairs::joining(&self.links[i].joined());
            let matching = match_components((&low.solids, &low.phi), (&high.solids, &high.phi), &linked);
            IntervalReport {
                z_low: low.z,
                z_high: high.z,
                groups: matching.groups.len(),
                events: matching.events(),
                ..IntervalReport::default()
            }
        };
        self.report.intervals = self.of_pairs(contours, of)?;
        Ok(())
    }

    fn layers(
        &mut self,
        contours: &SpillVec<'a, Contour>,
        made: &Made<'a>,
        heights: &Heights,
        sink: &mut Sink<'_>,
    ) -> Result<()> {
        let Made { moving, slopes, lone, ends } = made;
        let limit = self.settings.margin() as f64;
        self.below(contours, ends, heights, sink)?;
        let at_once = 2 * rayon::current_num_threads();
        for i in self.span.layers.clone() {
            sink(self.contour_layer(&heights.contours[i], &*contours.get(i)?, i))?;
            let (low, high) = (contours.light(i).z, contours.light(i + 1).z);
            let (frame, lone) = (moving.part(i..i + 2)?, lone.get(i)?);
            let slopes = [slopes.get(i)?, slopes.get(i + 1)?];
            for some in heights.between(i).chunks(at_once) {
                let times: Vec<f64> = some.iter().map(|x| time(x.z, low, high)).collect();
                let slopes = [&*slopes[0], &*slopes[1]];
                let layers = self.backend.moving_layers(&frame, slopes, &lone, 0, &times, limit, self.h, None)?;
                for (height, values) in some.iter().zip(layers) {
                    if values.iter().any(|v| v.is_nan()) {
                        let message = format!("NaN at height {}", height.z);
                        return Err(Error::Numerics { stage: "layers", message });
                    }
                    let mut canvas = self.canvas();
                    let whole = Tile { origin: [0, 0], dims: self.padded() };
                    canvas.unite(&whole, |n| f64::from(values[n]));
                    sink(self.layer(height, canvas))?;
                    self.progress.advance(1);
                }
            }
        }
        self.above(contours, ends, heights, sink)
    }
}
