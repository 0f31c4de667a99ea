//! The field method: no morph, the slices' own distances interpolated along the trajectories of a smooth moving frame.

use rayon::prelude::*;

use super::links::IntervalLinks;
use super::{Run, Sink, time};
use crate::contours::Contour;
use crate::ends::End;
use crate::error::{Error, Result};
use crate::field::Field;
use crate::fit::Fitted;
use crate::heights::Heights;
use crate::jobs::{Direction, Tile};
use crate::matching::lone_solids;
use crate::moving_field::{LEAST_DEPTH, LoneParts, MovingField};
use crate::report::IntervalReport;
use crate::surface::stream::LayerSink;
use crate::topology::{Decided, match_components};

/// What the stages before the layers have made.
struct Made {
    contours: Vec<Contour>,
    moving: MovingField,
    slopes: Vec<Field>,
    lone: Vec<LoneParts>,
    ends: [End; 2],
}

impl Run<'_> {
    /// All stages after the distance; the heights at which the body ends.
    pub(super) fn field(
        &mut self,
        contours: Vec<Contour>,
        heights: &[f64],
        sink: &mut dyn LayerSink,
    ) -> Result<[f64; 2]> {
        self.tell_events(&contours);
        let moving = self.moving(&contours)?;
        self.see_links(&contours, Some(&moving));
        let slopes = self.stage("slopes", contours.len(), |run| run.backend.moving_slopes(&moving, run.progress))?;
        let last = contours.len() - 1;
        let fitted = [0, last].map(|i| Fitted::of_field(&contours[i], &slopes[i]));
        let ends = self.ends(&contours, [&fitted[0], &fitted[1]], Some(&moving))?;
        let extent = ends.each_ref().map(|end| end.extent);
        let heights = Heights::new(self.stack, heights, extent)?;
        sink.begin(&self.header(&heights, extent))?;
        let sink: &mut Sink<'_> = &mut |layer| sink.layer(layer);
        let lone = self.lone_parts(&contours, &moving)?;
        let made = Made { contours, moving, slopes, lone, ends };
        self.stage("layers", heights.all.len(), |run| {
            run.faired(&made.contours, Some(&made.moving), &heights, sink, |run, sink| {
                run.layers(&made, &heights, sink)
            })
        })?;
        Ok(extent)
    }

    fn tell_events(&mut self, contours: &[Contour]) {
        let of = |(pair, links): (&[Contour], &IntervalLinks)| {
            let linked = Decided::joining(&links.joined());
            let matching = match_components((&pair[0].solids, &pair[0].phi), (&pair[1].solids, &pair[1].phi), &linked);
            IntervalReport {
                z_low: pair[0].z,
                z_high: pair[1].z,
                groups: matching.groups.len(),
                events: matching.events(),
                ..IntervalReport::default()
            }
        };
        self.report.intervals = contours.par_windows(2).zip(&self.links).map(of).collect();
    }

    /// Parts that meet nothing in the other slice along their trajectories.
    pub(super) fn lone_parts(&self, contours: &[Contour], moving: &MovingField) -> Result<Vec<LoneParts>> {
        let mut out = Vec::with_capacity(contours.len() - 1);
        for (i, pair) in contours.windows(2).enumerate() {
            let [low, high] = [Direction::Up, Direction::Down].map(|direction| {
                let (own, other, way) = match direction {
                    Direction::Up => (&pair[0], &moving.fields[i + 1], 1.0),
                    Direction::Down => (&pair[1], &moving.fields[i], -1.0),
                };
                let u = &moving.at_slices[i][usize::from(direction == Direction::Down)];
                let parts = without_partner(own, |x| {
                    let v = u.at(x);
                    other.sample([x[0] + way * v[0], x[1] + way * v[1]]) < 0.0
                });
                lone_solids(own, &parts, self.h, self.margin, direction, self.backend)
            });
            out.push(LoneParts { low: low?, high: high? });
        }
        Ok(out)
    }

    fn layers(&mut self, made: &Made, heights: &Heights, sink: &mut Sink<'_>) -> Result<()> {
        let Made { contours, moving, slopes, lone, ends } = made;
        let last = contours.len() - 1;
        let limit = self.settings.margin() as f64;
        for height in heights.all.iter().filter(|x| x.z < contours[0].z) {
            sink(self.layer(height, ends[0].layer(height.z, &contours[0], self.canvas())))?;
        }
        let at_once = 2 * rayon::current_num_threads();
        for i in 0..last {
            sink(self.contour_layer(&heights.contours[i], &contours[i], i))?;
            let (low, high) = (contours[i].z, contours[i + 1].z);
            for some in heights.between(i).chunks(at_once) {
                let times: Vec<f64> = some.iter().map(|x| time(x.z, low, high)).collect();
                let layers = self.backend.moving_layers(moving, slopes, &lone[i], i, &times, limit, self.h, None)?;
                for (height, values) in some.iter().zip(layers) {
                    if values.iter().any(|v| v.is_nan()) {
                        let message = format!("NaN at height {}", height.z);
                        return Err(Error::Numerics { stage: "layers", message });
                    }
                    let mut canvas = self.canvas();
                    let whole = Tile { origin: [0, 0], dims: contours[i].phi.dims };
                    canvas.unite(&whole, |n| f64::from(values[n]));
                    sink(self.layer(height, canvas))?;
                    self.progress.advance(1);
                }
            }
        }
        sink(self.contour_layer(&heights.contours[last], &contours[last], last))?;
        for height in heights.all.iter().filter(|x| x.z > contours[last].z) {
            sink(self.layer(height, ends[1].layer(height.z, &contours[last], self.canvas())))?;
        }
        Ok(())
    }
}

/// Numbers of the parts, at least [`LEAST_DEPTH`] deep, no pixel of which meets anything.
fn without_partner(contour: &Contour, meets: impl Fn([f64; 2]) -> bool) -> Vec<u32> {
    let mut lone: Vec<bool> = contour.solid_depth.iter().map(|d| *d >= LEAST_DEPTH).collect();
    lone[0] = false;
    let nx = contour.phi.dims[0];
    for (node, &label) in contour.solids.labels.iter().enumerate() {
        if lone[label as usize] && meets([(node % nx) as f64, (node / nx) as f64]) {
            lone[label as usize] = false;
        }
    }
    (0..).zip(lone).filter(|(_, lone)| *lone).map(|(part, _)| part).collect()
}
