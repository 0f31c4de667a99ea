//! Layers of morphed intervals on the GPU, as many together as the device has room for.
//!
//! Where the sweeps of an interval do not fit the device together, its slices come back and are sent again, bit for bit.

use rayon::prelude::*;

use super::Gpu;
use super::answers::Answers;
use super::atlas::{in_batches, in_ranges};
use super::band::crossings;
use super::compose::SweptPairs;
use super::device::failure;
use super::distance::{Rounds, settled};
use super::layer_steps::{Step, batches, steps};
use super::morph_layer::{Begun, Composing, read_anchors};
use super::morph_slices::{Mended, Origin, Slices};
use super::packed_layers::{expected, unpacked};
use super::propagate::{self, PairSize};
use super::recorder::Recorder;
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

/// Intervals whose work is sent off together.
const SENT_TOGETHER: usize = 4;

/// Layers of all intervals, as many together as fit.
pub fn morph_layers(gpu: &Gpu, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
    // Images larger than an adapter's arrays are left to the reference path, as by the field method.
    if !request.intervals.iter().all(|of| gpu.holds_images(of.image.padded())) {
        return on_host(gpu, request, progress);
    }
    let pair_sizes = |of: &IntervalMorph<'_>| -> Vec<PairSize> {
        of.pairs.iter().map(|(_, pair)| propagate::size(gpu, pair, &request.options)).collect()
    };
    let sizes: Vec<Vec<PairSize>> = request.intervals.par_iter().map(pair_sizes).collect();
    // Share of the device that the sweeps of an interval take together.
    let share = |sizes: &Vec<PairSize>| sizes.iter().map(|size| size.share).sum::<f64>();
    in_batches(gpu, sizes.iter().map(share), |batch| {
        let alone = batch.len() == 1;
        let sizes = &sizes[batch.clone()];
        let some = MorphRequest { intervals: &request.intervals[batch], ..*request };
        if alone && share(&sizes[0]) > 1.0 {
            return apart(gpu, &some, progress);
        }
        match together(gpu, &some, sizes, progress) {
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
    let edges = |of: &IntervalMorph<'_>| {
        let of_pair = |(_, pair): &(_, SweepPair<'_>)| crossings(&pair.up.source).max(crossings(&pair.up.goal));
        of.pairs.iter().map(of_pair).sum()
    };
    let edges: Vec<usize> = request.intervals.par_iter().map(edges).collect();
    composed(gpu, request, &Origin::Host(slices), &edges)
}

/// Layers of intervals whose sweeps, of these sizes, fit the device together.
fn together(
    gpu: &Gpu,
    request: &MorphRequest<'_>,
    sizes: &[Vec<PairSize>],
    progress: &dyn Progress,
) -> Result<Vec<Morphed>> {
    let MorphRequest { intervals, h, options, .. } = request;
    let pairs: Vec<&SweepPair<'_>> = pairs(intervals).collect();
    if pairs.is_empty() {
        return layers_of(gpu, request, &[]);
    }
    let room = sizes.iter().flatten().map(|size| size.room).sum();
    let (swept, copies) = propagate::sweep(gpu, &pairs, *h, options, room)?;
    let params = morph_params(*h, options);
    let swept = SweptPairs { pairs: &pairs, swept, copies, params, sweep: options.sweep };
    let edges: Vec<usize> = sizes.iter().map(|sizes| sizes.iter().map(|size| size.edges).sum()).collect();
    let made = composed(gpu, request, &Origin::Device(&swept), &edges)?;
    progress.advance(2 * pairs.len());
    Ok(made)
}

fn pairs<'p, 'a>(intervals: &'p [IntervalMorph<'a>]) -> impl Iterator<Item = &'p SweepPair<'a>> {
    intervals.iter().flat_map(|of| of.pairs.iter().map(|(_, pair)| pair))
}

/// Layers of intervals, whose contours cross so many edges between pixels, from the slices of their pairs.
fn composed(gpu: &Gpu, request: &MorphRequest<'_>, origin: &Origin<'_>, edges: &[usize]) -> Result<Vec<Morphed>> {
    let MorphRequest { intervals, h, .. } = request;
    let mut courses: Box<dyn Iterator<Item = [Swept; 2]>> = match origin {
        Origin::Device(swept) => Box::new(swept.swept.chunks_exact(2).map(|s| [s[0].clone(), s[1].clone()])),
        Origin::Host(filled) => Box::new(filled.iter().map(|f| [f.up.clone(), f.down.clone()])),
    };
    let mut out: Vec<Morphed> = Vec::with_capacity(intervals.len());
    let mut composing: Vec<Composing<'_, '_>> = Vec::with_capacity(intervals.len());
    let mut first_pair = 0;
    for (of, edges) in intervals.iter().zip(edges) {
        let swept = courses.by_ref().take(of.pairs.len()).collect();
        out.push(Morphed { layers: vec![SparseImage::default(); of.times.len()], swept });
        composing.push(Composing { of, first_pair, h: *h, squares: expected(of, *edges), ground: None });
        first_pair += of.pairs.len();
    }
    let steps = steps(intervals);
    let fronts = match origin {
        Origin::Device(swept) => swept.copies.bytes(),
        Origin::Host(_) => 0,
    };
    let made = in_ranges(gpu, batches(gpu, intervals, &steps, fronts), |batch| {
        let steps = &steps[batch];
        let mut made = |mended: Option<Mended<'_>>| {
            settled(|rounds| Attempt { gpu, origin, steps, mended, rounds }.layers(&mut composing))
        };
        let lost = match made(None)? {
            Made::Layers(layers) => return Ok(layers),
            Made::Lost(lost) => lost,
        };
        let Origin::Device(swept) = origin else { return Err(failure("a slice of the host's has lost an overlap")) };
        let (atlas, values) = &swept.mended(gpu, &lost)?;
        match made(Some(Mended { wanted: &lost, atlas, values }))? {
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
    steps: &'s [Step],
    mended: Option<Mended<'s>>,
    rounds: Rounds,
}

impl Attempt<'_, '_> {
    /// Makes the layers of all steps; nothing where the distances have not settled.
    fn layers(&self, composing: &mut [Composing<'_, '_>]) -> Result<Option<Made>> {
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
        let (mut recorder, slices) = Slices::new(gpu, self.origin, wanted, (self.mended, self.rounds))?;
        let anchors = match (self.mended, self.origin) {
            (None, Origin::Device(swept)) => read_anchors(gpu, &mut recorder, swept, &slices)?,
            _ => None,
        };
        let last = together.last().map_or(0, |(i, _)| *i);
        let (mut answers, mut packed, mut ground, mut slot) = (Vec::new(), Vec::new(), None, 0);
        // Fields of as many frames as there are threads are on the host at once.
        for some in together.chunks(rayon::current_num_threads()) {
            let begun: Vec<Option<Begun>> = some.par_iter().map(begun).collect::<Result<_>>()?;
            for ((i, layers), begun) in some.iter().zip(begun) {
                let own = &composing[*i];
                let (done, new) = own.record(gpu, &mut recorder, self.origin, layers, (&slices, slot), begun)?;
                packed.push((answers.len(), done));
                // Only the last interval may go on with the next steps.
                ground = new.filter(|_| *i == last);
                slot += layers.len() * own.of.pairs.len();
                // What is sent off gives its buffers to what comes after.
                if packed.len().is_multiple_of(SENT_TOGETHER) && packed.len() < together.len() {
                    answers.push(std::mem::replace(&mut recorder, Recorder::new(&gpu.device, &gpu.profiler)).submit()?);
                }
            }
        }
        answers.push(recorder.submit()?);
        let landed = Answers::wait_for_all(answers)?;
        if !slices.settled(&landed[0])? {
            return Ok(None);
        }
        if let (Some(anchors), Origin::Device(swept)) = (&anchors, self.origin) {
            let lost = slices.lost(swept, &landed[0].values(anchors)?);
            if !lost.is_empty() {
                return Ok(Some(Made::Lost(lost)));
            }
        }
        let mut images = unpacked(gpu, &landed, &packed)?.into_iter();
        if ground.is_some() {
            composing[last].ground = ground;
        }
        // Steps come interval by interval: what the last one of these shares may still be needed.
        composing[..last].iter_mut().for_each(|done| done.ground = None);
        let mut of_step = |(_, layers): &Step| images.by_ref().take(layers.len()).collect();
        Ok(Some(Made::Layers(self.steps.iter().map(&mut of_step).collect())))
    }
}
