//! v of nodes and their gradient on the GPU, and their places in the moving frame.

use super::device::Buffer;
use super::fairing::{GpuFairing, Made, Resident};
use super::fairing_paths;
use super::kernels::{WORKGROUP, shader};
use super::layout::{Axis, BLOCKS, FairingNode, FairingShape, NONE};
use super::recorder::{Recorder, Size};
use crate::backend::fairing::TransformRequest;
use crate::error::Result;
use crate::grid::tiled::AREA;
use crate::reference::fairing_flatness::REACH;
use crate::registration::displacement::{BLOCK, weights};

shader! {
    fairing_transform = "common/job.wgsl" + "common/fairing.wgsl" + "common/packed.wgsl"
        + twin "src/reference/fairing_transform.rs";

    /// v, n of each pixel by itself, and how far the surface goes sideways.
    Transform for transform, "fairing_transform" {
        shape: Uniform FairingShape,
        nodes: Read [FairingNode],
        tasks: Read [[u32; 2]],
        places: Read [u32],
        values: Write [f32],
        marks: Write [u32],
    }

    /// What is upright around each block.
    SumUp for sum_up, "fairing_sum_up" {
        shape: Uniform FairingShape,
        nodes: Read [FairingNode],
        tasks: Read [[u32; 2]],
        places: Read [u32],
        values: Write [f32],
        sums: Write [[f32; 2]],
    }

    /// Means over blocks along an axis.
    Average for average, "fairing_average" {
        shape: Uniform FairingShape,
        nodes: Read [FairingNode],
        tasks: Read [[u32; 2]],
        sums: Write [[f32; 2]],
        means: Write [[f32; 2]],
        weights: Read [f32],
        axis: Uniform Axis,
    }

    /// n where the surface stands upright.
    Stand for stand, "fairing_stand" {
        shape: Uniform FairingShape,
        nodes: Read [FairingNode],
        tasks: Read [[u32; 2]],
        places: Read [u32],
        values: Write [f32],
        sums: Write [[f32; 2]],
    }
}

/// Values of which squares share a square that stands for them.
const SHARED: usize = 16;

/// An invocation per pixel of four of each task's square.
pub fn per_square(tasks: usize) -> Size<'static> {
    Size::List(WORKGROUP as usize * tasks)
}

/// Makes v and the gradient of some nodes, and their places in the moving frame.
pub fn transform(state: &mut GpuFairing<'_>, requests: &[TransformRequest]) -> Result<()> {
    let gpu = state.gpu;
    let device = &gpu.device;
    let blocks = (state.shape.block_columns * state.shape.block_rows) as usize;
    let reach = state.frame.spacing.map(|s| REACH * state.frame.side() / s / BLOCK as f64).map(weights);
    let (mut nodes, mut tasks, mut block_tasks) = (Vec::new(), Vec::new(), Vec::new());
    for request in requests {
        let Some(node) = state.node(request.node) else { continue };
        let beside = request.beside.map(|k| state.node(k).unwrap_or(node).wholes.as_slice());
        let (table, squares, alone) = own_squares([beside[0], &node.wholes, beside[1]], &state.shape);
        let phi = state.layer(request.node)?;
        let [below, above] = request.beside.map(|k| if state.node(k).is_some() { k } else { request.node });
        let [below, above] = [state.layer(below)?, state.layer(above)?];
        let own = Resident {
            places: state.places.put(gpu, &table)?,
            values: state.values.take(gpu, 4 * AREA * squares.len())?,
        };
        let list = state.places.put(gpu, &squares)?;
        let marks = state.marks.put(gpu, &vec![0; squares.len()])?;
        let number = nodes.len();
        nodes.push(FairingNode {
            phi,
            below,
            above,
            own: own.pair(),
            plane: (AREA * squares.len()) as u32,
            squares: list.begin(),
            marks: marks.begin(),
            blocks: (number * blocks) as u32,
            rise: request.rise as f32,
            ..FairingNode::default()
        });
        tasks.extend((0..squares.len() as u32).map(|place| [number as u32, place]));
        let around = blocks_around(&squares[..alone], &state.shape, reach[1].len() / 2);
        block_tasks.extend(around.into_iter().map(|square| [number as u32, square]));
        let at_contour = request.at_contour;
        let made =
            Made { own, squares, alone, list, marks, at_contour, place: None, different: false, corrected: false };
        if let Some(node) = state.node_mut(request.node) {
            node.made = Some(made);
        }
    }
    if nodes.is_empty() {
        return Ok(());
    }
    // Whole workgroups of blocks.
    let per_group = WORKGROUP as usize / (BLOCKS * BLOCKS);
    block_tasks.resize(block_tasks.len().next_multiple_of(per_group).max(per_group), [NONE, 0]);
    let shape = &device.uniform("fairing shape", state.shape);
    let count = nodes.len();
    let nodes = &device.upload("fairing nodes", &nodes)?;
    let (own, around) = (&device.upload("fairing tasks", &tasks)?, &device.upload("fairing blocks", &block_tasks)?);
    let [sums, means]: [&Buffer<[[f32; 2]]>; 2] =
        [&device.storage("fairing sums", count * blocks)?, &device.storage("fairing means", count * blocks)?];
    let window: Vec<f32> = reach.iter().flatten().map(|w| *w as f32).collect();
    let window = &device.upload("fairing window", &window)?;
    let axis = |vertical: usize| {
        let first = if vertical == 0 { 0 } else { reach[0].len() as u32 };
        let reach = (reach[vertical].len() / 2) as u32;
        device.uniform("fairing axis", Axis { vertical: vertical as u32, first, reach, width: 0 })
    };
    let axes = [axis(0), axis(1)];
    let places = state.places.buffer(gpu)?;
    let values = state.values.buffer(gpu)?;
    let marks = state.marks.buffer(gpu)?;
    let transform = Transform { shape, nodes, tasks: own, places, values, marks }.bind(gpu);
    let sum_up = SumUp { shape, nodes, tasks: around, places, values, sums }.bind(gpu);
    let stand = Stand { shape, nodes, tasks: own, places, values, sums }.bind(gpu);
    let average =
        |sums, means, axis| Average { shape, nodes, tasks: around, sums, means, weights: window, axis }.bind(gpu);
    let [across, along] = [average(sums, means, &axes[0]), average(means, sums, &axes[1])];
    let per_block = Size::List(BLOCKS * BLOCKS * block_tasks.len());
    let mut recorder = Recorder::new(device, &gpu.profiler);
    recorder.run(&transform, per_square(tasks.len()));
    recorder.clear(sums);
    recorder.clear(means);
    recorder.run(&sum_up, per_block);
    recorder.run(&across, per_block);
    recorder.run(&along, per_block);
    recorder.run(&stand, per_square(tasks.len()));
    fairing_paths::place(state, requests, &mut recorder)?;
    recorder.submit()
}

/// The table of a node's own squares, their numbers by their places, and how many stand for themselves; from the one value of each square of the
/// layer below, the node's own and the one above. A square that has one value, far from the surface, as the squares around it have it, below and
/// above, too, is the same throughout whatever is made of it.
fn own_squares([below, here, above]: [&[Option<f32>]; 3], shape: &FairingShape) -> (Vec<u32>, Vec<u32>, usize) {
    let columns = shape.columns as usize;
    let rows = here.len() / columns;
    let alike = |n: usize, v: f32, of: &[Option<f32>]| of[n].is_some_and(|w| w.to_bits() == v.to_bits());
    let settled = |n: usize| {
        let v = here[n].filter(|v| v.abs() >= shape.bound)?;
        let (i, j) = (n % columns, n / columns);
        let around = (i == 0 || alike(n - 1, v, here))
            && (i + 1 == columns || alike(n + 1, v, here))
            && (j == 0 || alike(n - columns, v, here))
            && (j + 1 == rows || alike(n + columns, v, here));
        (around && alike(n, v, below) && alike(n, v, above)).then_some(v)
    };
    let settled: Vec<Option<f32>> = (0..here.len()).map(settled).collect();
    let mut table = vec![0; here.len()];
    let mut squares = Vec::new();
    for n in (0..here.len()).filter(|n| settled[*n].is_none()) {
        table[n] = squares.len() as u32;
        squares.push(n as u32);
    }
    let alone = squares.len();
    let mut shared: Vec<(u32, u32)> = Vec::new();
    for (n, v) in settled.iter().enumerate().filter_map(|(n, v)| Some((n, v.as_ref()?.to_bits()))) {
        let known = shared.iter().find(|(w, _)| *w == v).map(|(_, place)| *place);
        table[n] = known.unwrap_or(squares.len() as u32);
        if known.is_none() {
            if shared.len() < SHARED {
                shared.push((v, squares.len() as u32));
            }
            squares.push(n as u32);
        }
    }
    (table, squares, alone)
}

/// Squares of 4 x 4 blocks that means are taken over around these squares of pixels, where they reach so many blocks up and down.
fn blocks_around(squares: &[u32], shape: &FairingShape, reach: usize) -> Vec<u32> {
    let [columns, rows] = [shape.block_columns, shape.block_rows].map(|n| (n as usize).div_ceil(BLOCKS));
    // Pixels of a square read blocks of the next one, too.
    let along = (reach + 2).div_ceil(BLOCKS);
    let mut marked = vec![false; columns * rows];
    for square in squares {
        let [i, j] = [square % shape.columns, square / shape.columns].map(|n| n as usize);
        for row in j.saturating_sub(along)..(j + along + 1).min(rows) {
            marked[row * columns..][i.saturating_sub(1)..(i + 2).min(columns)].fill(true);
        }
    }
    (0..).zip(marked).filter(|(_, marked)| *marked).map(|(n, _)| n).collect()
}
