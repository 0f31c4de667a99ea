//! Layers of morphed intervals on the GPU, as many together as the device has room for.
//!
//! Where the sweeps of an interval do not fit the device together, its slices come back and are sent again, bit for bit.

use rayon::prelude::*;

use super::Gpu;
use super::atlas::in_batches;
use super::compose::SweptPairs;
use super::device::failure;
use super::morph_layer::{Begun, Composing, beside, fixed_share, layer_share, read_anchors};
use super::morph_slices::{Mended, Origin, Slices};
use super::packed_layers::unpacked;
use super::propagate;
use super::trace::morph_params;
use crate::backend::Backend;
use crate::backend::interval_morph::{IntervalMorph, Morphed};
use crate::backend::jobs::{Filled, SweepPair, Swept};
use crate::backend::requests::MorphRequest;
use crate::error::{Error, Result};
use crate::grid::sparse_image::SparseImage;
use crate::progress::Progress;
use crate::reference::Reference;
use crate::reference::morph_layer as twin;

/// Layers of all intervals, as many together as fit.
pub fn morph_layers(gpu: &Gpu, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
    // Images larger than an adapter's arrays are left to the reference path, as by the field method.
    if !request.intervals.iter().all(|of| gpu.holds_images(of.image.padded())) {
        return on_host(gpu, request, progress);
    }
    let shares: Vec<f64> = request.intervals.par_iter().map(|of| share(gpu, of, request)).collect();
    in_batches(gpu, shares.iter().copied(), |batch| {
        let alone = batch.len() == 1;
        let some = MorphRequest { intervals: &request.intervals[batch.clone()], ..*request };
        if alone && shares[batch.start] > 1.0 {
            return apart(gpu, &some, progress);
        }
        match together(gpu, &some, progress) {
            Err(Error::GpuMemory(_)) if alone => {
                gpu.release()?;
                apart(gpu, &some, progress)
            }
            done => done,
        }
    })
}

/// Layers that the reference path composes of the device's slices.
fn on_host(gpu: &Gpu, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
    let pairs: Vec<&SweepPair<'_>> = pairs(request.intervals).collect();
    let filled = propagate::propagate(gpu, &pairs, request.h, &request.options, progress)?;
    twin::layers(request, filled, &|requests| match requests
        .iter()
        .all(|of| gpu.holds_images(of.moving.fields[of.interval].dims))
    {
        true => super::moving_layer::layers(gpu, requests),
        false => Reference.moving_layers(requests),
    })
}

/// Layers of an interval whose sweeps do not fit the device together: its slices come back and are sent again.
pub fn apart(gpu: &Gpu, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
    let pairs: Vec<&SweepPair<'_>> = pairs(request.intervals).collect();
    let filled = propagate::propagate(gpu, &pairs, request.h, &request.options, progress)?;
    layers_of(gpu, request, &filled)
}

/// Layers of intervals from slices that the host has, pair by pair.
pub fn layers_of(gpu: &Gpu, request: &MorphRequest<'_>, slices: &[Filled]) -> Result<Vec<Morphed>> {
    composed(gpu, request, &Origin::Host(slices))
}

/// Layers of intervals whose sweeps fit the device together.
fn together(gpu: &Gpu, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
    let MorphRequest { intervals, h, options, .. } = request;
    let pairs: Vec<&SweepPair<'_>> = pairs(intervals).collect();
    if pairs.is_empty() {
        return composed(gpu, request, &Origin::Host(&[]));
    }
    let room = pairs.par_iter().map(|pair| propagate::share(gpu, pair, options).0).sum();
    let (swept, copies) = propagate::sweep(gpu, &pairs, *h, options, room)?;
    let params = morph_params(*h, options);
    let swept = SweptPairs { pairs: &pairs, swept, copies, params, sweep: options.sweep };
    let made = composed(gpu, request, &Origin::Device(&swept))?;
    progress.advance(2 * pairs.len());
    Ok(made)
}

fn pairs<'p, 'a>(intervals: &'p [IntervalMorph<'a>]) -> impl Iterator<Item = &'p SweepPair<'a>> {
    intervals.iter().flat_map(|of| of.pairs.iter().map(|(_, pair)| pair))
}

/// Share of the device that the sweeps of an interval take together.
fn share(gpu: &Gpu, of: &IntervalMorph<'_>, request: &MorphRequest<'_>) -> f64 {
    of.pairs.iter().map(|(_, pair)| propagate::share(gpu, pair, &request.options).1).sum()
}

/// Layers of intervals from the slices of their pairs.
fn composed(gpu: &Gpu, request: &MorphRequest<'_>, origin: &Origin<'_>) -> Result<Vec<Morphed>> {
    let MorphRequest { intervals, h, .. } = request;
    let mut courses: Box<dyn Iterator<Item = [Swept; 2]>> = match origin {
        Origin::Device(swept) => Box::new(swept.swept.chunks_exact(2).map(|s| [s[0].clone(), s[1].clone()])),
        Origin::Host(filled) => Box::new(filled.iter().map(|f| [f.up.clone(), f.down.clone()])),
    };
    let mut out: Vec<Morphed> = Vec::with_capacity(intervals.len());
    let mut composing: Vec<Composing<'_, '_>> = Vec::with_capacity(intervals.len());
    let mut first_pair = 0;
    for of in *intervals {
        let swept = courses.by_ref().take(of.pairs.len()).collect();
        out.push(Morphed { layers: vec![SparseImage::default(); of.times.len()], swept });
        composing.push(Composing { of, first_pair, h: *h, ground: None });
        first_pair += of.pairs.len();
    }
    let steps = steps(intervals);
    // What an interval keeps beside the layers that are being made.
    let fixed = intervals.iter().map(|of| fixed_share(gpu, of)).fold(0.0, f64::max);
    let share = |(i, layers): &(usize, Vec<usize>)| {
        let of = &intervals[*i];
        fixed_share(gpu, of) + layers.len() as f64 * layer_share(gpu, of) / (1.0 - fixed).max(0.1)
    };
    let made = in_batches(gpu, steps.iter().map(share), |batch| {
        let first = Attempt { gpu, origin, steps: &steps[batch], mended: None };
        let lost = match first.layers(&mut composing)? {
            Made::Layers(layers) => return Ok(layers),
            Made::Lost(lost) => lost,
        };
        let Origin::Device(swept) = origin else { return Err(failure("a slice of the host's has lost an overlap")) };
        let (atlas, values) = &swept.mended(gpu, &lost)?;
        let again = Attempt { mended: Some(Mended { wanted: &lost, atlas, values }), ..first };
        match again.layers(&mut composing)? {
            Made::Layers(layers) => Ok(layers),
            Made::Lost(_) => Err(failure("an overlap that was put back is lost")),
        }
    })?;
    for ((i, numbers), layers) in steps.iter().zip(made) {
        for (k, layer) in numbers.iter().zip(layers) {
            out[*i].layers[*k] = layer;
        }
    }
    Ok(out)
}

/// Layers of all intervals by their numbers, in the order in which they are made: those beside the contours first, as others need them.
fn steps(intervals: &[IntervalMorph<'_>]) -> Vec<(usize, Vec<usize>)> {
    let mut out = Vec::new();
    for (i, of) in intervals.iter().enumerate() {
        let mut first: Vec<usize> = Vec::new();
        if of.frame.is_some() {
            first.extend(beside(of).into_iter().flatten());
            first.sort_unstable();
            first.dedup();
            out.push((i, first.clone()));
        }
        out.extend((0..of.times.len()).filter(|k| !first.contains(k)).map(|k| (i, vec![k])));
    }
    out
}

/// Layers of each step, or slices that have lost an overlap, each a pair and the number of its time.
enum Made {
    Layers(Vec<Vec<SparseImage<f32>>>),
    Lost(Vec<(usize, usize)>),
}

/// Steps that are made together.
#[derive(Clone, Copy)]
struct Attempt<'g, 's> {
    gpu: &'g Gpu,
    origin: &'s Origin<'s>,
    steps: &'s [(usize, Vec<usize>)],
    mended: Option<Mended<'s>>,
}

impl Attempt<'_, '_> {
    /// Makes the layers of all steps.
    fn layers(&self, composing: &mut [Composing<'_, '_>]) -> Result<Made> {
        let gpu = self.gpu;
        // Steps of an interval follow each other.
        let together: Vec<(usize, Vec<usize>)> = self
            .steps
            .chunk_by(|a, b| a.0 == b.0)
            .map(|steps| (steps[0].0, steps.iter().flat_map(|(_, layers)| layers.iter().copied()).collect()))
            .collect();
        let begun = |(i, _): &(usize, Vec<usize>)| {
            let source = composing[*i].of.frame.as_ref().filter(|_| composing[*i].ground.is_none());
            source.map(|source| source.read().map(Begun::new)).transpose()
        };
        let mut wanted = Vec::new();
        for (i, layers) in &together {
            let pairs = composing[*i].pairs();
            wanted.extend(layers.iter().flat_map(|k| pairs.clone().map(|p| (p, *k))));
        }
        let (mut recorder, slices) = Slices::new(gpu, self.origin, wanted, self.mended)?;
        let anchors = match (self.mended, self.origin) {
            (None, Origin::Device(swept)) => read_anchors(gpu, &mut recorder, swept, &slices)?,
            _ => None,
        };
        let (mut packed, mut grounds, mut slot) = (Vec::new(), Vec::new(), 0);
        // Fields of as many frames as there are threads are on the host at once.
        for together in together.chunks(rayon::current_num_threads()) {
            let begun: Vec<Option<Begun>> = together.par_iter().map(begun).collect::<Result<_>>()?;
            for ((i, layers), begun) in together.iter().zip(begun) {
                let own = &composing[*i];
                let (done, ground) = own.record(gpu, &mut recorder, self.origin, layers, (&slices, slot), begun)?;
                packed.push(done);
                grounds.push(ground);
                slot += layers.len() * own.of.pairs.len();
            }
        }
        let landed = recorder.submit()?.wait()?;
        if let (Some(anchors), Origin::Device(swept)) = (&anchors, self.origin) {
            let lost = slices.lost(swept, &landed.values(anchors)?);
            if !lost.is_empty() {
                return Ok(Made::Lost(lost));
            }
        }
        let mut images = unpacked(gpu, &landed, &packed)?.into_iter();
        for ((i, _), ground) in together.iter().zip(grounds) {
            if ground.is_some() {
                composing[*i].ground = ground;
            }
        }
        // Steps come interval by interval: what the last one of these shares may still be needed.
        let last = together.last().map_or(0, |(i, _)| *i);
        composing[..last].iter_mut().for_each(|done| done.ground = None);
        Ok(Made::Layers(self.steps.iter().map(|(_, layers)| images.by_ref().take(layers.len()).collect()).collect()))
    }
}
