//! Differences and corrections of nodes on the GPU.

use super::atlas::batches;
use super::fairing::{GpuFairing, Resident};
use super::fairing_paths::Ways;
use super::fairing_transform::per_square;
use super::kernels::shader;
use super::layout::{DIFFERENCE, FairingMean, FairingShape, FairingTerm, NONE, TABLE};
use super::recorder::Recorder;
use crate::backend::fairing::{CorrectionRequest, NodeMean};
use crate::error::Result;
use crate::grid::spline::smoothstep;
use crate::grid::tiled::Packed;

shader! {
    fairing_correct = "common/job.wgsl" + "common/fairing.wgsl" + "common/packed.wgsl"
        + twin "src/reference/fairing_correct.rs";

    /// `K v - v`.
    Difference for difference, "fairing_difference" {
        shape: Uniform FairingShape,
        averages: Read [FairingMean],
        terms: Read [FairingTerm],
        tasks: Read [[u32; 2]],
        places: Read [u32],
        values: Write [f32],
        marks: Read [u32],
        offsets: Read [[f32; 2]],
    }

    /// Corrections of nodes between contours.
    Correct for correct, "fairing_correct" {
        shape: Uniform FairingShape,
        averages: Read [FairingMean],
        tasks: Read [[u32; 2]],
        places: Read [u32],
        values: Write [f32],
        marks: Read [u32],
        offsets: Read [[f32; 2]],
    }
}

/// A mean, and of a node between contours its time and its strength.
type Asked<'r> = (&'r NodeMean, Option<(f64, f64)>);

/// Makes the corrections of the nodes of an interval.
pub fn correct(state: &mut GpuFairing<'_>, request: &CorrectionRequest) -> Result<()> {
    // The next interval begins with the upper contour, whose difference is known then.
    let ends = request.ends.iter().filter(|mean| state.made(mean.node).is_some_and(|made| !made.different));
    let between = request.between.iter().filter(|(mean, ..)| state.made(mean.node).is_some());
    let all: Vec<Asked<'_>> =
        ends.map(|mean| (mean, None)).chain(between.map(|(mean, t, alpha)| (mean, Some((*t, *alpha))))).collect();
    // Everything is sent before any kernel is bound: the arenas may grow.
    let contours = request.ends.iter().map(|mean| mean.node).chain(request.beyond.into_iter().flatten());
    for k in contours.chain(all.iter().map(|(mean, _)| mean.node)) {
        state.layer(k)?;
    }
    let shares = match &request.shares {
        Some(shares) => Some(state.send(&Packed::of(state.frame.dims, shares))?),
        None => None,
    };
    let share = |(mean, _): &Asked<'_>| {
        let squares = state.made(mean.node).map_or(0, |made| made.squares.len());
        let bytes = 8 * TABLE * squares * (mean.weights.len() + 4);
        state.gpu.share(bytes, bytes)
    };
    for batch in batches(all.iter().map(share)) {
        some_nodes(state, request, &all[batch], shares)?;
    }
    if let Some(shares) = shares {
        state.drop_layer(shares);
    }
    Ok(())
}

/// Makes the differences of some nodes, and the corrections of those between contours.
fn some_nodes(
    state: &mut GpuFairing<'_>,
    request: &CorrectionRequest,
    some: &[Asked<'_>],
    shares: Option<Resident>,
) -> Result<()> {
    let gpu = state.gpu;
    let device = &gpu.device;
    let contours = [request.ends[0].node, request.ends[1].node];
    let (mut ways, mut means, mut terms) = (Ways::default(), Vec::new(), Vec::new());
    let (mut tasks, mut between) = (Vec::new(), Vec::new());
    for (mean, of) in some {
        let weights: Vec<(usize, f64)> =
            mean.weights.iter().copied().filter(|(k, _)| state.made(*k).is_some()).collect();
        let mut to: Vec<Option<usize>> = weights.iter().map(|(k, _)| Some(*k)).collect();
        if of.is_some() {
            to.extend([Some(contours[0]), Some(contours[1]), request.beyond[0], request.beyond[1]]);
        }
        let (origin, pairs) = ways.add(state, mean.node, &to);
        let Some(made) = state.made(mean.node) else { continue };
        let own_tasks = (0..made.squares.len() as u32).map(|place| [means.len() as u32, place]);
        between.extend(own_tasks.clone().filter(|_| of.is_some()));
        tasks.extend(own_tasks);
        let first_term = terms.len() as u32;
        for ((k, w), pair) in weights.iter().zip(&pairs) {
            let layer = state.made(*k).map_or([NONE; 2], |made| made.own.pair());
            terms.push(FairingTerm { layer, pair: *pair, weight: *w as f32 });
        }
        let mut own = FairingMean {
            own: made.own.pair(),
            plane: made.plane(),
            squares: made.list.begin(),
            marks: made.marks.begin(),
            first_term,
            last_term: terms.len() as u32,
            offsets: origin.offsets,
            pair_count: origin.pair_count,
            at_contour: u32::from(made.at_contour),
            beyond: [NONE; 4],
            pairs: [NONE; 4],
            share: shares.map_or([NONE; 2], |shares| shares.pair()),
            ..FairingMean::default()
        };
        let phi = |state: &mut GpuFairing<'_>, k: Option<usize>| k.map_or(Ok([NONE; 2]), |k| state.layer(k));
        if let Some((t, alpha)) = of {
            let of_contour = |state: &mut GpuFairing<'_>, k: usize| {
                let [places, values] = state.made(k).map_or([NONE; 2], |made| made.plane_pair(DIFFERENCE));
                let [phi_places, phi_values] = state.layer(k)?;
                Ok::<_, crate::error::Error>([places, values, phi_places, phi_values])
            };
            (own.low, own.high) = (of_contour(state, contours[0])?, of_contour(state, contours[1])?);
            let [[a, b], [c, d]] = [phi(state, request.beyond[0])?, phi(state, request.beyond[1])?];
            own.beyond = [a, b, c, d];
            own.pairs.copy_from_slice(&pairs[pairs.len() - 4..]);
            (own.alpha, own.weight) = (*alpha as f32, smoothstep(*t) as f32);
        }
        own.phi = state.layer(mean.node)?;
        means.push(own);
    }
    if tasks.is_empty() {
        return Ok(());
    }
    let shape = &device.uniform("fairing shape", state.shape);
    let averages = &device.upload("fairing means", &means)?;
    // A binding must not be empty.
    let terms = if terms.is_empty() { vec![FairingTerm::default()] } else { terms };
    let terms = &device.upload("fairing terms", &terms)?;
    let count = tasks.len();
    let tasks = &device.upload("fairing tasks", &tasks)?;
    let mut recorder = Recorder::new(device, &gpu.profiler);
    let offsets = &ways.offsets(state, tasks, count, &mut recorder)?;
    let (places, values) = (state.places.buffer(gpu)?, state.values.buffer(gpu)?);
    let marks = state.marks.buffer(gpu)?;
    let difference = Difference { shape, averages, terms, tasks, places, values, marks, offsets }.bind(gpu);
    recorder.run(&difference, per_square(count));
    if !between.is_empty() {
        let tasks = &device.upload("fairing nodes between", &between)?;
        let correct = Correct { shape, averages, tasks, places, values, marks, offsets }.bind(gpu);
        recorder.run(&correct, per_square(between.len()));
    }
    recorder.submit()?;
    for (mean, of) in some {
        if let Some(made) = state.made_mut(mean.node) {
            made.different = true;
            made.corrected = of.is_some();
        }
    }
    Ok(())
}
