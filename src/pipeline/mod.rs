//! The order of the stages, written once, for any backend.
//!
//! ```text
//! distance -> motion -> match -> trace -> fit -> propagate    (method morph)
//! distance -> motion -> slopes -> layers                      (method field)
//! ```

pub mod certificate;
pub(crate) mod compose;
mod connect;
pub(crate) mod ends;
mod events;
mod field;
pub(crate) mod fit;
mod links;
pub(crate) mod matching;
mod morph;
mod moving;
mod propagate;
pub(crate) mod rigid_frames;
pub mod section;
mod span;
pub(crate) mod tracks;

use std::time::Instant;

use rayon::prelude::*;

use self::certificate::Examined;
use self::links::IntervalLinks;
use self::span::Span;
use crate::backend::{Backend, ContourOptions, Means, PaddedSlice};
use crate::contour::Contour;
use crate::error::{Error, Result};
use crate::fairing::{self, Fairing};
use crate::grid::tile::samples;
use crate::pipeline::compose::{Canvas, differing_pixels};
pub use crate::pipeline::connect::Bonds;
use crate::pipeline::section::Section;
use crate::progress::Progress;
use crate::registration::motion_field;
use crate::registration::motion_field::STEPS;
use crate::registration::motion_stack::MotionStack;
use crate::report::{BodyEnd, ContourReport, Report, StageReport};
use crate::settings::{Method, Settings, SlopeRule};
use crate::stack::ContourStack;
use crate::stack::heights::{Height, Heights, check};
use crate::stack::links as user_links;
use crate::stack::window::Window;
use crate::storage::spill::{Budget, SpillVec};
use crate::surface::header::Header;
use crate::surface::stream::LayerSink;
use crate::surface::{Layer, Reconstruction};

/// Extra margin for rules whose curves overshoot their contours, px.
const OVERSHOOT: usize = 8;
/// Bytes of the slices that are swept together.
pub(crate) const CHUNK_BYTES: usize = 256 << 20;

/// Everything a run carries from stage to stage.
struct Run<'a> {
    /// What it makes of the whole stack, through the window.
    stack: &'a ContourStack,
    /// Pixels of the image.
    image: [usize; 2],
    settings: &'a Settings,
    backend: &'a dyn Backend,
    progress: &'a dyn Progress,
    budget: &'a Budget,
    /// What of the stack is made here.
    span: Span,
    /// Pixel size in units of its larger side.
    h: [f64; 2],
    /// Length of a pixel's larger side in the stack's unit.
    px: f64,
    /// Padding of the image, pixels along either axis.
    pad: [usize; 2],
    /// Margin of tiles, the same.
    margin: [usize; 2],
    /// Links of every interval.
    links: Vec<IntervalLinks>,
    /// What holds the body together.
    bonds: Bonds,
    report: Report,
}

/// Whether a rule's curves may leave the range of their contours.
fn overshoots(slope: SlopeRule) -> bool {
    matches!(slope, SlopeRule::Natural | SlopeRule::Catmull)
}

/// Takes finished layers, lowest first.
type Sink<'a> = dyn FnMut(Layer) -> Result<()> + 'a;

/// Hands on the layers that are kept, on the image again, and counts the pixels of contours that differ from the input.
struct Certified<'a> {
    /// On the image.
    stack: &'a ContourStack,
    window: Window,
    /// What lies around it.
    outside: f32,
    /// Heights from the first on and below the second are kept.
    kept: [f64; 2],
    /// Heights of the first and the last contour: layers between that nobody has asked for go no further.
    ends: [f64; 2],
    /// Number of the run's first slice.
    first: usize,
    differing: Vec<usize>,
    examined: Examined,
    sink: &'a mut dyn LayerSink,
}

impl LayerSink for Certified<'_> {
    fn begin(&mut self, header: &Header) -> Result<()> {
        self.sink.begin(header)
    }

    fn layer(&mut self, mut layer: Layer) -> Result<()> {
        let within = layer.z > self.ends[0] && layer.z < self.ends[1];
        let handed = layer.output || layer.contour.is_some() || !within;
        // A section knows its last interval's upper contour, too.
        if layer.z >= self.kept[0] && layer.z <= self.kept[1] {
            self.examined.layer(&layer, handed);
        }
        if !handed || layer.z < self.kept[0] || layer.z >= self.kept[1] {
            return Ok(());
        }
        layer.phi = self.window.image(&layer.phi, self.stack.dims, self.outside);
        if let Some(i) = layer.contour {
            let content = &self.stack.slices[i].content;
            self.differing[i] = differing_pixels(&layer.phi, content);
            layer.contour = Some(self.first + i);
        }
        self.sink.layer(layer)
    }
}

/// Reconstructs a section of `stack` at `heights` (increasing, unit of the stack) and hands every layer to `sink`; the result itself has none.
/// Its report has the section's contours, both ends included, and its intervals.
///
/// # Errors
/// Wrong input or settings before anything is computed; a backend's failure; [`Error::Numerics`] for a value that is not a number; what
/// `sink` says.
pub fn run(
    stack: &ContourStack,
    heights: &[f64],
    settings: &Settings,
    section: &Section,
    bonds: Bonds,
    means: &Means<'_>,
    sink: &mut dyn LayerSink,
) -> Result<Reconstruction> {
    let &Means { backend, progress, budget } = means;
    stack.validate()?;
    settings.validate()?;
    check(stack, heights, settings)?;
    user_links::check(stack, &settings.links).map_err(|message| Error::Setting { name: "links".into(), message })?;
    let span = Span::new(stack, section);
    let kept = [
        if section.kept.start == 0 { f64::NEG_INFINITY } else { stack.slices[section.kept.start].z },
        if section.kept.end + 1 == stack.slices.len() { f64::INFINITY } else { stack.slices[section.kept.end].z },
    ];
    let (whole, asked) = (stack, settings);
    let px = stack.spacing[0].max(stack.spacing[1]);
    let h = stack.spacing.map(|s| s / px);
    let window = Window::around(stack, samples(settings.margin(), h));
    let (on_image, settings, heights) =
        (&section.stack(stack), &section.settings(settings), &section.heights(stack, heights));
    let stack = &window.of(on_image);
    let margin = settings.margin() + if overshoots(settings.slope) { OVERSHOOT } else { 0 };
    let mut run = Run {
        stack,
        image: whole.dims,
        settings,
        backend,
        progress,
        budget,
        span,
        h,
        px,
        pad: samples(OVERSHOOT, h),
        margin: samples(margin, h),
        links: Vec::new(),
        bonds,
        report: Report {
            version: env!("CARGO_PKG_VERSION").into(),
            settings: asked.clone(),
            backend: backend.name(),
            dims: whole.dims,
            spacing: stack.spacing,
            unit: stack.unit.clone(),
            ..Report::default()
        },
    };
    if overshoots(settings.slope) {
        run.report.warnings.extend(whole.unlike_gaps());
    }
    let contours = run.stage("distance", stack.slices.len(), Run::distance)?;
    run.find_links(&contours)?;
    let first = run.span.first;
    let ends = [contours.light(0).z, contours.light(contours.len() - 1).z];
    let examined = Examined::new(certificate::CertificateSpec {
        dims: stack.dims,
        spacing: stack.spacing,
        z: stack.slices.iter().map(|s| s.z).collect(),
        first,
        parted: run.links.iter().map(IntervalLinks::parted).collect(),
    });
    let outside = settings.margin() as f32 * px as f32;
    let mut certified = Certified {
        stack: on_image,
        window,
        outside,
        kept,
        ends,
        first,
        differing: vec![0; stack.slices.len()],
        examined,
        sink,
    };
    let extent = match settings.method {
        Method::Morph => run.morph(&contours, heights, &mut certified)?,
        Method::Field => run.field(&contours, heights, &mut certified)?,
    };
    let (met, body) = certified.examined.finish();
    for ((c, differing), met) in run.report.contours.iter_mut().zip(certified.differing).zip(met) {
        c.differing_pixels = differing;
        (c.area, c.below, c.above) = (met.area, met.below, met.above);
    }
    run.report.body = body;
    let links = std::mem::take(&mut run.links);
    run.report.intervals.iter_mut().zip(links).for_each(|(interval, l)| interval.links = l.told);
    let done_by = backend.name();
    if done_by != run.report.backend {
        run.report.warnings.push(format!("the backend has changed on the way: {done_by}"));
        run.report.backend = done_by;
    }
    let kept = run.span.kept.clone();
    run.report.contours = run.report.contours.drain(kept.start..=kept.end).collect();
    run.report.intervals = run.report.intervals.drain(kept).collect();
    // Fairing makes a section compute an end that another one keeps.
    run.report.ends.retain(|end| match end.side {
        BodyEnd::Bottom => section.kept.start == 0,
        BodyEnd::Top => section.kept.end + 1 == whole.slices.len(),
    });
    run.report.judge();
    Ok(Reconstruction {
        dims: whole.dims,
        spacing: whole.spacing,
        unit: whole.unit.clone(),
        geometry: whole.geometry,
        extent,
        layers: Vec::new(),
        report: run.report,
    })
}

impl<'a> Run<'a> {
    /// Pixels of the padded image.
    fn padded(&self) -> [usize; 2] {
        std::array::from_fn(|a| self.stack.dims[a] + 2 * self.pad[a])
    }

    /// Bytes of a field on it.
    fn field_bytes(&self) -> usize {
        size_of::<f64>() * self.padded().iter().product::<usize>()
    }

    /// What is known before the first layer.
    fn header(&self, heights: &Heights, extent: [f64; 2]) -> Header {
        let ContourStack { spacing, unit, geometry, .. } = self.stack;
        let grid = Header::grid(&heights.output(), *spacing);
        Header { dims: self.image, spacing: *spacing, unit: unit.clone(), geometry: *geometry, extent, grid }
    }

    /// All heights of the run.
    fn heights(&self, output: &[f64], extent: [f64; 2]) -> Result<Heights> {
        if self.span.ends == [true; 2] {
            return Heights::new(self.stack, output, extent);
        }
        let z: Vec<f64> = self.stack.slices.iter().map(|s| s.z).collect();
        Ok(Heights::merged(&z, output, extent))
    }

    /// Runs one stage, telling listeners and taking its time.
    fn stage<T>(&mut self, name: &'static str, total: usize, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        self.progress.begin(name, total);
        let start = Instant::now();
        let result = work(self);
        self.report.stages.push(StageReport { name: name.into(), seconds: start.elapsed().as_secs_f64() });
        self.progress.end();
        result
    }

    fn distance(&mut self) -> Result<SpillVec<'a, Contour>> {
        let (h, spacing, dims) = (self.h, self.settings.seed_spacing, self.padded());
        let options = ContourOptions::from(self.settings);
        let slices = &self.stack.slices;
        let mut contours = SpillVec::new(self.budget);
        // A slice, its field with what is made on the way, its labels.
        for some in slices.chunks(self.budget.at_once(slices.len(), 4 * self.field_bytes())) {
            let padded: Vec<PaddedSlice> =
                some.par_iter().map(|s| PaddedSlice::new(&s.content, self.stack.dims, self.pad)).collect();
            let fields = self.backend.contour_fields(&padded, dims, h, options, self.progress)?;
            drop(padded);
            let made: Vec<Contour> =
                fields.into_par_iter().zip(some).map(|(phi, s)| Contour::new(s.z, phi, h, spacing)).collect();
            self.report.contours.extend(made.iter().zip(some).map(|(c, s)| ContourReport {
                name: s.name.clone(),
                z: s.z,
                extra: s.extra,
                components: c.solids.count,
                holes: c.holes,
                pixels: c.solids.labels.iter().filter(|l| **l > 0).count(),
                ..ContourReport::default()
            }));
            made.into_iter().try_for_each(|contour| contours.push(contour))?;
        }
        Ok(contours)
    }

    /// What `make` makes of the two contours of every interval.
    fn of_pairs<T: Send>(
        &self,
        contours: &SpillVec<'_, Contour>,
        make: impl Fn(usize, [&Contour; 2]) -> T + Sync,
    ) -> Result<Vec<T>> {
        let mut out = Vec::with_capacity(contours.len() - 1);
        self.for_pairs(contours, make, |made| {
            out.push(made);
            Ok(())
        })?;
        Ok(out)
    }

    /// The same, taken one by one in order.
    fn for_pairs<T: Send>(
        &self,
        contours: &SpillVec<'_, Contour>,
        make: impl Fn(usize, [&Contour; 2]) -> T + Sync,
        mut take: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let count = contours.len() - 1;
        let at_once = self.budget.at_once(count, 4 * self.field_bytes());
        for first in (0..count).step_by(at_once) {
            let end = (first + at_once).min(count);
            let some = (first..=end).map(|i| contours.get(i)).collect::<Result<Vec<_>>>()?;
            let pair = |i: usize| make(first + i, [&*some[i], &*some[i + 1]]);
            let made: Vec<T> = (0..end - first).into_par_iter().map(pair).collect();
            made.into_iter().try_for_each(&mut take)?;
        }
        Ok(())
    }

    /// Runs `make`, whose layers reach `sink` faired if that is wanted, connected where their contours overlap, with nothing that floats.
    fn faired(
        &mut self,
        contours: &SpillVec<'a, Contour>,
        moving: Option<&MotionStack<'a>>,
        sink: &mut Sink<'_>,
        make: impl FnOnce(&mut Self, &mut Sink<'_>) -> Result<()>,
    ) -> Result<()> {
        let mut together = self.together(contours);
        if self.settings.fair == 0.0 {
            make(self, &mut |layer| together.push(layer, sink))?;
            return together.finish(sink);
        }
        let mut fairing = Fairing::new(fairing::FairingSpec {
            moving: moving.map(|moving| (moving, self.pad)),
            contours: self.stack.slices.iter().map(|s| s.z).collect(),
            dims: self.stack.dims,
            spacing: self.stack.spacing,
            layers: self.span.layers.clone(),
            gap: self.span.gap,
            alpha: self.settings.fair,
            limited: !overshoots(self.settings.slope),
            farthest: self.settings.margin() as f64 * self.px,
            steered: self.settings.steered_ends(),
            shares: self.fairing_shares(contours)?,
        });
        make(self, &mut |layer| fairing.push(layer, &mut |layer| together.push(layer, sink)))?;
        fairing.finish(&mut |layer| together.push(layer, sink))?;
        together.finish(sink)
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
    motion_field::time(z, low, high).clamp(1.0 / STEPS, 1.0 - 1.0 / STEPS)
}
