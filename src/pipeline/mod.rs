//! The order of the stages, written once, for any backend.
//!
//! ```text
//! distance -> motion -> match -> trace -> fit -> propagate    (method morph)
//! distance -> motion -> slopes -> layers                      (method field)
//! ```

mod field;
mod links;
mod morph;

use std::time::Instant;

use rayon::prelude::*;

use self::links::IntervalLinks;
use crate::backend::{Backend, ContourOptions, PaddedSlice};
use crate::compose::{Canvas, differing_pixels};
use crate::contours::Contour;
use crate::displacement::Displacement;
use crate::ends::{End, EndSpec, end};
use crate::error::{Error, Result};
use crate::fairing::{self, Fairing};
use crate::fit::Fitted;
use crate::heights::{Height, Heights, check};
use crate::jobs::Direction;
use crate::links as user_links;
use crate::moving_field::{self, MovingField, STEPS, even_gaps, filled_fields};
use crate::progress::Progress;
use crate::report::{ContourReport, Report, StageReport};
use crate::settings::{Method, Motion, Settings, SlopeRule};
use crate::stack::ContourStack;
use crate::surface::stream::{Header, LayerSink};
use crate::surface::{Layer, Reconstruction};

/// Extra margin for rules whose curves overshoot their contours, px.
const OVERSHOOT: usize = 8;
/// Bytes of the slices that are swept together.
pub(crate) const CHUNK_BYTES: usize = 256 << 20;

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
    /// Links of every interval.
    links: Vec<IntervalLinks>,
    report: Report,
}

/// Takes finished layers, lowest first.
type Sink<'a> = dyn FnMut(Layer) -> Result<()> + 'a;

/// Counts the pixels of contours that differ from the input, layer by layer on the way to the sink.
struct Certified<'a> {
    stack: &'a ContourStack,
    differing: Vec<usize>,
    sink: &'a mut dyn LayerSink,
}

impl LayerSink for Certified<'_> {
    fn begin(&mut self, header: &Header) -> Result<()> {
        self.sink.begin(header)
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
        if let Some(i) = layer.contour {
            let content = &self.stack.slices[i].content;
            self.differing[i] = differing_pixels(&layer.phi, |n| content.inside(n));
        }
        self.sink.layer(layer)
    }
}

/// Reconstructs `stack` at `heights` (increasing, unit of the stack) and hands every layer to `sink`; the result itself has none.
///
/// # Errors
/// Wrong input or settings before anything is computed; a backend's failure; [`Error::Numerics`] for a value that is not a number; what
/// `sink` says.
pub fn run(
    stack: &ContourStack,
    heights: &[f64],
    settings: &Settings,
    backend: &dyn Backend,
    progress: &dyn Progress,
    sink: &mut dyn LayerSink,
) -> Result<Reconstruction> {
    stack.validate()?;
    settings.validate()?;
    check(stack, heights, settings)?;
    user_links::check(stack, &settings.links).map_err(|message| Error::Setting { name: "links".into(), message })?;
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
        links: Vec::new(),
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
    run.find_links(&contours)?;
    let mut certified = Certified { stack, differing: vec![0; stack.slices.len()], sink };
    let extent = match settings.method {
        Method::Morph => run.morph(contours, heights, &mut certified)?,
        Method::Field => run.field(contours, heights, &mut certified)?,
    };
    run.report.contours.iter_mut().zip(certified.differing).for_each(|(c, n)| c.differing_pixels = n);
    let links = std::mem::take(&mut run.links);
    run.report.intervals.iter_mut().zip(links).for_each(|(interval, l)| interval.links = l.told);
    let done_by = backend.name();
    if done_by != run.report.backend {
        run.report.warnings.push(format!("the backend has changed on the way: {done_by}"));
        run.report.backend = done_by;
    }
    Ok(Reconstruction {
        dims: stack.dims,
        spacing: stack.spacing,
        unit: stack.unit.clone(),
        geometry: stack.geometry,
        extent,
        layers: Vec::new(),
        report: run.report,
    })
}

impl Run<'_> {
    /// What is known before the first layer.
    fn header(&self, heights: &Heights, extent: [f64; 2]) -> Header {
        let ContourStack { dims, spacing, unit, geometry, .. } = self.stack;
        let output: Vec<f64> = heights.all.iter().filter(|x| x.output).map(|x| x.z).collect();
        let grid = Header::grid(&output, *spacing);
        Header { dims: *dims, spacing: *spacing, unit: unit.clone(), geometry: *geometry, extent, grid }
    }

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

    /// The stack in its moving frame.
    fn moving(&mut self, contours: &[Contour]) -> Result<MovingField> {
        self.stage("motion", contours.len() - 1, |run| {
            let fields = filled_fields(contours);
            let z: Vec<f64> = contours.iter().map(|c| c.z).collect();
            let gaps = even_gaps(&z);
            let displacements = match run.settings.motion {
                Motion::Field => {
                    let guess = run.frames(contours);
                    run.backend.displacements(&fields, &gaps, &guess, run.h, run.progress)?
                }
                Motion::Rigid => run.frames(contours),
                Motion::None => vec![Displacement::zero(fields[0].dims); gaps.len()],
            };
            Ok(MovingField::new(z, run.px, fields, displacements))
        })
    }

    /// Runs `make`, whose layers reach `sink` faired if that is wanted.
    fn faired(
        &mut self,
        contours: &[Contour],
        moving: Option<&MovingField>,
        heights: &Heights,
        sink: &mut Sink<'_>,
        make: impl FnOnce(&mut Self, &mut Sink<'_>) -> Result<()>,
    ) -> Result<()> {
        if self.settings.fair == 0.0 {
            return make(self, sink);
        }
        let mut steps: Vec<f64> = heights.all.windows(2).map(|w| w[1].z - w[0].z).collect();
        steps.sort_by(f64::total_cmp);
        let mut fairing = Fairing::new(fairing::Spec {
            moving: moving.map(|moving| (moving, self.pad)),
            contours: self.stack.slices.iter().map(|s| s.z).collect(),
            dims: self.stack.dims,
            spacing: self.stack.spacing,
            dz: steps.get(steps.len() / 2).copied().unwrap_or(0.0),
            alpha: self.settings.fair,
            clamped: [self.settings.clamp_bottom, self.settings.clamp_top].map(|m| m.is_some()),
            shares: self.fairing_shares(contours),
        });
        make(self, &mut |layer| fairing.push(layer, sink))?;
        fairing.finish(sink)
    }

    /// Both ends of the body, from what was fitted at the first and last contour.
    fn ends(&mut self, contours: &[Contour], fitted: [&Fitted; 2], moving: Option<&MovingField>) -> Result<[End; 2]> {
        let last = contours.len() - 1;
        let whole = |i: usize, fitted: &Fitted| match moving {
            Some(moving) => fitted.with_motion(&contours[i], &moving.rates[i], self.h, 1.0),
            None => fitted.clone(),
        };
        let fitted = [whole(0, fitted[0]), whole(last, fitted[1])];
        let mut warnings = Vec::new();
        let mut make = |at: usize, next: usize, direction, rule| {
            let gap = (contours[at].z - contours[next].z).abs();
            let spec = EndSpec {
                contour: &contours[at],
                fitted: &fitted[usize::from(at > 0)],
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

    fn canvas(&self) -> Canvas {
        Canvas::empty(self.stack.dims, self.pad, self.settings.margin() as f64)
    }

    fn contour_layer(&self, height: &Height, contour: &Contour, i: usize) -> Layer {
        let limit = self.settings.margin() as f64;
        let layer = self.layer(height, Canvas::of_contour(self.stack.dims, self.pad, limit, &contour.phi));
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

/// Height between two contours as time of their interval, never quite 0 or 1: a stack and the same upside down then sweep with the very same
/// times, whichever way their heights were rounded.
fn time(z: f64, low: f64, high: f64) -> f64 {
    moving_field::time(z, low, high).clamp(1.0 / STEPS, 1.0 - 1.0 / STEPS)
}
