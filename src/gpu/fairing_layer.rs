//! Layers moved on the GPU: those of an interval at once, read back in one go.

use super::atlas::batches;
use super::fairing::{GpuFairing, Resident};
use super::fairing_transform::per_square;
use super::kernels::shader;
use super::layout::{CORRECTION, FairingLayer, FairingShape, FairingTerm, NONE};
use super::recorder::Recorder;
use crate::backend::fairing::{LayerMove, MoveRequest};
use crate::error::Result;
use crate::grid::tiled::{AREA, Packed};

shader! {
    fairing_layer = "common/job.wgsl" + "common/fairing.wgsl" + "common/packed.wgsl"
        + twin "src/reference/fairing_layer.rs";

    /// Layers, moved, square by square.
    MoveLayers for move_layers, "fairing_layer" {
        shape: Uniform FairingShape,
        layers: Read [FairingLayer],
        terms: Read [FairingTerm],
        tasks: Read [[u32; 2]],
        places: Read [u32],
        values: Read [f32],
        faired: Write [f32],
    }
}

/// The layers, moved.
pub fn moved(state: &mut GpuFairing<'_>, request: &MoveRequest) -> Result<Vec<Packed<f32>>> {
    let squares: Vec<Vec<u32>> = request.layers.iter().map(|layer| squares(state, layer)).collect();
    // Squares lie there twice while they are read back.
    let share = |squares: &Vec<u32>| {
        let bytes = 4 * AREA * squares.len();
        state.gpu.share(3 * bytes, bytes)
    };
    let mut out = Vec::with_capacity(squares.len());
    for batch in batches(squares.iter().map(share)).into_iter().collect::<Vec<_>>() {
        out.extend(some_layers(state, request.ends, &request.layers[batch.clone()], &squares[batch])?);
    }
    Ok(out)
}

/// Squares of a layer that may change: nodes that are corrected have own squares there.
fn squares(state: &GpuFairing<'_>, layer: &LayerMove) -> Vec<u32> {
    let mut some = vec![false; layer.phi.places().len()];
    let nodes = layer.curve.iter().filter_map(|(k, _)| state.made(*k).filter(|made| made.corrected));
    for made in nodes {
        made.squares[..made.alone].iter().for_each(|square| some[*square as usize] = true);
    }
    (0..).zip(some).filter(|(_, some)| *some).map(|(square, _)| square).collect()
}

fn some_layers(
    state: &mut GpuFairing<'_>,
    ends: [usize; 2],
    layers: &[LayerMove],
    squares: &[Vec<u32>],
) -> Result<Vec<Packed<f32>>> {
    let gpu = state.gpu;
    let device = &gpu.device;
    let count: usize = squares.iter().map(Vec::len).sum();
    if count == 0 {
        return Ok(layers.iter().map(|layer| (*layer.phi).clone()).collect());
    }
    let [low, high] = [state.layer(ends[0])?, state.layer(ends[1])?];
    let (mut table, mut terms, mut tasks) = (Vec::new(), Vec::new(), Vec::with_capacity(count));
    let mut sent: Vec<Resident> = Vec::new();
    for (layer, squares) in (0..).zip(squares) {
        tasks.extend(squares.iter().map(|square| [layer, *square]));
    }
    for layer in layers {
        let known = match layer.node {
            Some(node) => Some(state.layer(node)?).filter(|pair| pair[0] != NONE),
            None => None,
        };
        let phi = match known {
            Some(pair) => pair,
            None => {
                sent.push(state.send(&layer.phi)?);
                sent[sent.len() - 1].pair()
            }
        };
        let first_term = terms.len() as u32;
        for (k, w) in &layer.curve {
            if let Some(made) = state.made(*k).filter(|made| made.corrected) {
                terms.push(FairingTerm { layer: made.plane_pair(CORRECTION), pair: NONE, weight: *w as f32 });
            }
        }
        table.push(FairingLayer { phi, low, high, first_term, last_term: terms.len() as u32 });
    }
    let shape = &device.uniform("fairing shape", state.shape);
    let table = &device.upload("fairing layers", &table)?;
    let (terms, tasks) = (&device.upload("fairing terms", &terms)?, &device.upload("fairing tasks", &tasks)?);
    let faired = &device.storage("faired", AREA * count)?;
    let (places, values) = (state.places.buffer(gpu)?, state.values.buffer(gpu)?);
    let moving = MoveLayers { shape, layers: table, terms, tasks, places, values, faired }.bind(gpu);
    let mut recorder = Recorder::new(device, &gpu.profiler);
    recorder.run(&moving, per_square(count));
    recorder.submit()?;
    let read = device.read(faired, 0, AREA * count)?;
    sent.into_iter().for_each(|layer| state.drop_layer(layer));
    let mut first = 0;
    let of = |(layer, squares): (&LayerMove, &Vec<u32>)| {
        let values = &read[AREA * first..][..AREA * squares.len()];
        first += squares.len();
        layer.phi.replaced(squares, values)
    };
    Ok(layers.iter().zip(squares).map(of).collect())
}
