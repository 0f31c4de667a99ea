//! The order of the stages, written once, for any backend.
//!
//! ```text
//! distance -> motion -> match -> trace -> fit -> propagate    (method morph)
//! distance -> motion -> slopes -> layers                      (method field)
//! ```

pub mod certificate;
pub(crate) mod compose;
mod connect;
mod context;
mod distance;
pub(crate) mod ends;
mod events;
mod far_motion;
mod field;
mod finish;
pub(crate) mod fit;
mod grazing;
mod hole_tiles;
mod hollow;
mod leaps;
mod links;
pub(crate) mod matching;
mod missed_motion;
mod morph;
mod moving;
mod near_seeds;
pub(crate) mod propagate;
pub(crate) mod rigid_frames;
pub mod section;
mod sliding;
mod slits;
mod span;
mod sweep_inputs;
pub(crate) mod tracks;

use std::sync::Mutex;

use rayon::prelude::*;

use self::certificate::Examined;
use self::context::{Context, Spent, stage};
use self::distance::distance;
use self::field::field;
use self::finish::Takers;
use self::links::{IntervalLinks, find_links};
use self::morph::morph;
use self::span::Span;
use crate::backend::{Lasting, Means};
use crate::error::{Error, Result};
use crate::grid::seen::Seen;
use crate::grid::tile::{Tile, samples};
use crate::pipeline::compose::differing_pixels;
pub use crate::pipeline::context::{Bonds, LAYER_BYTES_ON_A_GPU};
pub(crate) use crate::pipeline::finish::AHEAD;
use crate::pipeline::section::Section;
use crate::progress::Halting;
use crate::report::apart::{self, Apart};
use crate::report::clock::{Clocks, of_this_thread};
use crate::report::warnings::gathered;
use crate::report::{BodyEnd, DeviceUse, Report, StageCost};
use crate::settings::{Method, Settings};
use crate::stack::beyond;
use crate::stack::heights::{check, shown_nodes};
use crate::stack::links as user_links;
use crate::stack::window::Window;
use crate::stack::{ContourStack, Known};
use crate::surface::header::Header;
use crate::surface::stream::LayerSink;
use crate::surface::{Layer, Reconstruction};

/// Extra margin for rules whose curves overshoot their contours, px.
const OVERSHOOT: usize = 8;

/// Pixels around the parts of a tile along either axis, `h` the sides of a pixel in units of the larger.
pub(crate) fn tile_margin(settings: &Settings, h: [f64; 2]) -> [usize; 2] {
    samples(settings.margin() + if settings.slope.overshoots() { OVERSHOOT } else { 0 }, h)
}

/// Looks at layers, counts the pixels of contours that differ from the input, and brings those that are kept on the image again.
struct Certified<'a> {
    /// On the image.
    stack: &'a ContourStack,
    window: Window,
    /// Value around it.
    outside: f32,
    /// Heights from the first on and below the second are kept.
    kept: [f64; 2],
    /// Heights of the first and the last contour: layers between that nobody has asked for go no further,
    ends: [f64; 2],
    /// but for these, which surfaces need.
    shown: Vec<f64>,
    /// Number of the run's first slice.
    first: usize,
    differing: Vec<usize>,
    examined: Examined,
}

impl Certified<'_> {
    /// The layers that are handed on, of some that follow each other.
    fn look(&mut self, layers: Vec<Layer>) -> Vec<Layer> {
        let with_handed = |layer: Layer| {
            let within = layer.z > self.ends[0] && layer.z < self.ends[1];
            let shown = self.shown.binary_search_by(|z| z.total_cmp(&layer.z)).is_ok();
            let handed = layer.output || layer.contour.is_some() || !within || shown;
            (layer, handed)
        };
        let layers: Vec<(Layer, bool)> = layers.into_iter().map(with_handed).collect();
        // A section knows its last interval's upper contour, too.
        let known = layers.iter().filter(|(layer, _)| layer.z >= self.kept[0] && layer.z <= self.kept[1]);
        self.examined.layers(&known.map(|(layer, handed)| (layer, *handed)).collect::<Vec<_>>());
        let on_image = |(mut layer, handed): (Layer, bool)| {
            if !handed || layer.z < self.kept[0] || layer.z >= self.kept[1] {
                return None;
            }
            layer.phi = self.window.image(&layer.phi, self.stack.dims, self.outside);
            let differing = layer.contour.map(|i| (i, differing_pixels(&layer.phi, &self.stack.slices[i].content)));
            layer.contour = layer.contour.map(|i| self.first + i);
            Some((layer, differing))
        };
        let on_image: Vec<Option<_>> = layers.into_par_iter().map(on_image).collect();
        let (layers, differing): (Vec<Layer>, Vec<_>) = on_image.into_iter().flatten().unzip();
        differing.into_iter().flatten().for_each(|(i, count): (usize, usize)| self.differing[i] = count);
        layers
    }
}

/// A sink, and what it costs.
struct Timed<'a> {
    sink: &'a mut dyn LayerSink,
    /// CPU seconds of this thread, where costs are wanted: meanwhile others make layers.
    spent: Option<f64>,
}

impl LayerSink for Timed<'_> {
    fn begin(&mut self, header: &Header) -> Result<()> {
        self.sink.begin(header)
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
        let before = self.spent.and_then(|_| of_this_thread());
        let taken = self.sink.layer(layer);
        if let (Some(spent), Some(before), Some(now)) = (&mut self.spent, before, of_this_thread()) {
            *spent += now - before;
        }
        taken
    }
}

/// Name of what takes the layers, among the stages.
const OUTPUT: &str = "output";

/// Puts what lies between the stages beside them, and takes what the sink did out of the last one, which hands layers over.
fn complete_costs(report: &mut Report, whole: Option<StageCost>, output: Option<StageCost>) {
    let (Some(mut rest), Some(profile)) = (whole, &mut report.profile) else { return };
    profile.stages.iter().for_each(|stage| rest.take_out(stage));
    if let (Some(last), Some(output)) = (profile.stages.last_mut(), &output) {
        last.take_out(output);
    }
    profile.stages.push(rest);
    profile.stages.extend(output);
}

/// The intervals that nothing crosses, of a report on slices of which the first has this number. Those are left out of which the user keeps parts
/// apart, and those of matched parts in which none of the `heights` lies: there the result is the slices.
fn apart_of<'s>(
    report: &Report,
    stack: &'s ContourStack,
    first: usize,
    links: &[IntervalLinks],
    heights: &[f64],
) -> Vec<Apart<'s>> {
    let of = |slice: &usize| {
        let k = slice.checked_sub(first)?;
        let [low, high] = [stack.slices.get(k)?, stack.slices.get(k + 1)?];
        let unmatched = report.intervals.get(k)?.groups == 0;
        let parted = links.get(k).is_some_and(|links| !links.told_apart().is_empty());
        let looked = unmatched || heights.iter().any(|z| low.z < *z && *z < high.z);
        (looked && !parted).then(|| Apart { slices: [&low.name, &high.name], unmatched })
    };
    report.body.apart.iter().filter_map(of).collect()
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
    let halting = &Halting::new(progress);
    let clocks = Clocks::new();
    let begun = Spent::now(&clocks, backend);
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
    let stack = &window.of(whole, section.slices.clone());
    let (pad, image) = (samples(OVERSHOOT, h), Tile::all(whole.dims));
    let run = Context {
        stack,
        image: whole.dims,
        window,
        seen: if window.beyond { Seen::image(window.padded_part(image, pad)) } else { Seen::ALL },
        known: match whole.known {
            Some(Known { part, onward }) => Seen::image(window.padded_part(part, pad)).going_on([onward; 2]),
            None if window.beyond => Seen::image(window.padded_part(image, pad)).going_on(beyond::course(h)),
            None => Seen::ALL,
        },
        settings,
        backend,
        progress: halting,
        halting,
        budget,
        span,
        h,
        px,
        pad,
        margin: tile_margin(settings, h),
        bonds,
        clocks: clocks.clone(),
        closing: Mutex::default(),
    };
    let mut report = Report {
        version: env!("CARGO_PKG_VERSION").into(),
        settings: asked.clone(),
        backend: backend.name(),
        dims: whole.dims,
        spacing: stack.spacing,
        unit: stack.unit.clone(),
        ..Report::default()
    };
    if settings.slope.overshoots() {
        report.warnings.extend(whole.unlike_gaps());
    }
    let _lasting = Lasting::on(backend);
    let contours = stage(&run, &mut report, "distance", stack.slices.len(), |report| {
        let (contours, reports) = distance(&run)?;
        report.contours = reports;
        Ok(contours)
    })?;
    let mut links = find_links(&run, &contours)?;
    let first = run.span.first;
    let ends = [contours.light(0).z, contours.light(contours.len() - 1).z];
    let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
    let examined =
        Examined::new(certificate::CertificateSpec { dims: stack.dims, spacing: stack.spacing, z: z.clone(), first });
    let outside = settings.margin() as f32 * px as f32;
    let mut certified = Certified {
        stack: on_image,
        window,
        outside,
        kept,
        ends,
        shown: shown_nodes(&z, heights, stack.spacing[0].min(stack.spacing[1])),
        first,
        differing: vec![0; stack.slices.len()],
        examined,
    };
    let spent = backend.device_use().and_then(|_| of_this_thread()).map(|_| 0.0);
    let mut timed = Timed { sink, spent };
    let takers = Takers { look: &mut |layers| certified.look(layers), sink: &mut timed };
    let extent = match settings.method {
        Method::Morph => morph(&run, &mut links, &contours, heights, &mut report, takers)?,
        Method::Field => field(&run, &mut links, &contours, heights, &mut report, takers)?,
    };
    let output = timed.spent.map(|seconds| StageCost {
        name: OUTPUT.into(),
        host_seconds: Some(seconds),
        serial_seconds: Some(seconds),
        device: DeviceUse::default(),
    });
    let (met, body) = certified.examined.finish(&links.iter().map(IntervalLinks::parted).collect::<Vec<_>>());
    for ((c, differing), met) in report.contours.iter_mut().zip(certified.differing).zip(met) {
        c.differing_pixels = differing;
        (c.area, c.below, c.above) = (met.area, met.below, met.above);
    }
    report.body = body;
    report.warnings.extend(apart::words(&apart_of(&report, stack, first, &links, heights)));
    report.intervals.iter_mut().zip(links).for_each(|(interval, l)| interval.links = l.told);
    let done_by = backend.name();
    if done_by != report.backend {
        report.warnings.push(format!("the backend has changed on the way: {done_by}"));
        report.backend = done_by;
    }
    let kept = run.span.kept.clone();
    report.contours = report.contours.drain(kept.start..=kept.end).collect();
    report.intervals = report.intervals.drain(kept).collect();
    // Fairing makes a section compute an end that another one keeps.
    report.ends.retain(|end| match end.side {
        BodyEnd::Bottom => section.kept.start == 0,
        BodyEnd::Top => section.kept.end + 1 == whole.slices.len(),
    });
    report.closing = run.closing.into_inner().unwrap_or_default().into_iter().collect();
    report.warnings = gathered(std::mem::take(&mut report.warnings));
    report.judge();
    complete_costs(&mut report, begun.and_then(|begun| begun.cost("rest", &clocks, backend)), output);
    Ok(Reconstruction {
        dims: whole.dims,
        spacing: whole.spacing,
        unit: whole.unit.clone(),
        geometry: whole.geometry,
        extent,
        layers: Vec::new(),
        report,
    })
}
