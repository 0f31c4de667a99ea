//! Fairing on the GPU: the nodes' layers and what is made of them stay on the device, packed, in arenas; only finished layers come back.
//!
//! The host knows of a layer which of its squares have one value. From these alone it tells the squares of a node in which anything can differ from
//! its surroundings: the node's own, which kernels take one a workgroup. All other squares of one value share a square that stands for them.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::arena::{Arena, Segment};
use super::layout::{FairingShape, NONE};
use super::{Gpu, fairing_correct, fairing_layer, fairing_transform};
use crate::backend::fairing::{CorrectionRequest, FairingFrame, FairingState, MoveRequest, TransformRequest};
use crate::error::Result;
use crate::grid::tiled::{Packed, SQUARE};
use crate::registration::displacement::Displacement;

/// Share of the budget that what stays on the device between stages may take; of what is more the host keeps a copy meanwhile.
const RESIDENT: f64 = 0.25;

/// A layer on the device.
#[derive(Debug, Clone, Copy)]
pub struct Resident {
    /// Its table.
    pub places: Segment,
    /// Its squares.
    pub values: Segment,
}

impl Resident {
    /// Where its table and its values begin.
    pub fn pair(&self) -> [u32; 2] {
        [self.places.begin(), self.values.begin()]
    }
}

/// A node.
#[derive(Debug)]
pub struct GpuNode {
    phi: Arc<Packed<f32>>,
    /// The one value of each square of its layer, or nothing.
    pub wholes: Vec<Option<f32>>,
    layer: Option<Resident>,
    /// What is made of it.
    pub made: Option<Made>,
}

/// What is made of a node, in squares of its own.
#[derive(Debug)]
pub struct Made {
    /// The table of its squares, and four planes of values: v, n, the difference, the correction.
    pub own: Resident,
    /// The squares by their places, those that stand for others last.
    pub squares: Vec<u32>,
    /// How many stand for themselves.
    pub alone: usize,
    /// The list of them on the device.
    pub list: Segment,
    /// Whether the surface is near, square by square.
    pub marks: Segment,
    /// Whether it is a contour.
    pub at_contour: bool,
    /// Its place in the moving frame.
    pub place: Option<GpuPlace>,
    /// Whether the difference and the correction are made.
    pub different: bool,
    /// See `different`.
    pub corrected: bool,
}

impl Made {
    /// Values of a plane.
    pub fn plane(&self) -> u32 {
        (self.own.values.len / 4) as u32
    }

    /// A plane as a layer.
    pub fn plane_pair(&self, plane: u32) -> [u32; 2] {
        let [places, values] = self.own.pair();
        [places, values + plane * self.plane()]
    }
}

/// A node's place in the moving frame.
#[derive(Debug, Clone, Copy)]
pub struct GpuPlace {
    /// Its interval.
    pub interval: usize,
    /// Time in it.
    pub t: f64,
    /// Displacements to it and from it.
    pub vectors: Segment,
}

/// What the host keeps while other stages have the device.
struct Parked {
    values: Vec<f32>,
    places: Vec<u32>,
    marks: Vec<u32>,
    vectors: Vec<[f32; 2]>,
}

/// A fairing on the GPU.
pub struct GpuFairing<'g> {
    pub(super) gpu: &'g Gpu,
    pub(super) frame: FairingFrame<'g>,
    pub(super) shape: FairingShape,
    pub(super) values: Arena<f32>,
    pub(super) places: Arena<u32>,
    pub(super) marks: Arena<u32>,
    pub(super) vectors: Arena<[f32; 2]>,
    /// Displacements of intervals.
    pub(super) intervals: BTreeMap<usize, Segment>,
    nodes: VecDeque<GpuNode>,
    /// Number of the first of them.
    first: usize,
    parked: Option<Parked>,
    /// Bytes that other stages are told to leave.
    resident: u64,
    /// Told when the arrays are too long for this device.
    too_long: Arc<AtomicBool>,
}

impl<'g> GpuFairing<'g> {
    /// Nothing yet. `too_long` is told when the arrays are too long for this device.
    pub fn new(gpu: &'g Gpu, frame: FairingFrame<'g>, too_long: Arc<AtomicBool>) -> Self {
        let [nx, ny] = frame.dims;
        let blocks = Displacement::zero(frame.dims);
        let pad = frame.moving.map_or([0; 2], |(_, pad)| pad);
        let shape = FairingShape {
            nx: nx as u32,
            ny: ny as u32,
            columns: nx.div_ceil(SQUARE) as u32,
            block_columns: blocks.grid[0] as u32,
            block_rows: blocks.grid[1] as u32,
            limited: u32::from(frame.limited),
            pad_x: pad[0] as u32,
            pad_y: pad[1] as u32,
            first_x: blocks.origin[0] as f32,
            first_y: blocks.origin[1] as f32,
            dx: frame.spacing[0] as f32,
            dy: frame.spacing[1] as f32,
            bound: frame.bound as f32,
            side: frame.side() as f32,
            farthest: frame.farthest as f32,
            padding: 0.0,
        };
        GpuFairing {
            gpu,
            frame,
            shape,
            values: Arena::new("fairing values"),
            places: Arena::new("fairing places"),
            marks: Arena::new("fairing marks"),
            vectors: Arena::new("fairing vectors"),
            intervals: BTreeMap::new(),
            nodes: VecDeque::new(),
            first: 0,
            parked: None,
            resident: 0,
            too_long,
        }
    }

    pub(super) fn node(&self, k: usize) -> Option<&GpuNode> {
        self.nodes.get(k.checked_sub(self.first)?)
    }

    pub(super) fn made(&self, k: usize) -> Option<&Made> {
        self.node(k)?.made.as_ref()
    }

    pub(super) fn made_mut(&mut self, k: usize) -> Option<&mut Made> {
        self.node_mut(k)?.made.as_mut()
    }

    pub(super) fn node_mut(&mut self, k: usize) -> Option<&mut GpuNode> {
        self.nodes.get_mut(k.checked_sub(self.first)?)
    }

    /// A layer, sent to the device.
    pub(super) fn send(&mut self, layer: &Packed<f32>) -> Result<Resident> {
        let places = self.places.put(self.gpu, layer.places())?;
        Ok(Resident { places, values: self.values.put(self.gpu, layer.squares())? })
    }

    /// The layer of a node on the device; `NONE` where there is no such node.
    pub(super) fn layer(&mut self, k: usize) -> Result<[u32; 2]> {
        let Some(node) = self.node(k) else { return Ok([NONE; 2]) };
        if let Some(layer) = node.layer {
            return Ok(layer.pair());
        }
        let phi = node.phi.clone();
        let layer = self.send(&phi)?;
        if let Some(node) = self.node_mut(k) {
            node.layer = Some(layer);
        }
        Ok(layer.pair())
    }

    /// Gives the room of a layer back.
    pub(super) fn drop_layer(&mut self, layer: Resident) {
        self.places.free(layer.places);
        self.values.free(layer.values);
    }

    /// Tells other stages how much of the budget is taken.
    fn account(&mut self) {
        let bytes = self.values.bytes() + self.places.bytes() + self.marks.bytes() + self.vectors.bytes();
        let before = std::mem::replace(&mut self.resident, bytes);
        self.gpu.resident.fetch_add(bytes, Ordering::Relaxed);
        self.gpu.resident.fetch_sub(before, Ordering::Relaxed);
    }

    /// Does some work with the device, on which everything is there.
    fn with_device<R>(&mut self, work: impl FnOnce(&mut Self) -> Result<R>) -> Result<R> {
        let gpu = self.gpu;
        let _turn = gpu.turns.take();
        if let Some(Parked { values, places, marks, vectors }) = self.parked.take() {
            self.values.unpark(gpu, &values)?;
            self.places.unpark(gpu, &places)?;
            self.marks.unpark(gpu, &marks)?;
            self.vectors.unpark(gpu, &vectors)?;
        }
        self.account();
        let result = work(self);
        if self.values.too_long || self.places.too_long || self.marks.too_long || self.vectors.too_long {
            self.too_long.store(true, Ordering::Relaxed);
        }
        let result = result?;
        self.account();
        if gpu.resident.load(Ordering::Relaxed) as f64 > RESIDENT * gpu.device.budget() as f64 {
            self.parked = Some(Parked {
                values: self.values.park(gpu)?,
                places: self.places.park(gpu)?,
                marks: self.marks.park(gpu)?,
                vectors: self.vectors.park(gpu)?,
            });
            self.account();
        }
        Ok(result)
    }
}

impl Drop for GpuFairing<'_> {
    fn drop(&mut self) {
        self.gpu.resident.fetch_sub(self.resident, Ordering::Relaxed);
    }
}

impl FairingState for GpuFairing<'_> {
    fn take(&mut self, node: usize, phi: Arc<Packed<f32>>) {
        if self.nodes.is_empty() {
            self.first = node;
        }
        let wholes = phi.wholes();
        self.nodes.push_back(GpuNode { phi, wholes, layer: None, made: None });
    }

    fn transform(&mut self, nodes: &[TransformRequest]) -> Result<()> {
        self.with_device(|state| fairing_transform::transform(state, nodes))
    }

    fn correct(&mut self, request: &CorrectionRequest) -> Result<()> {
        self.with_device(|state| fairing_correct::correct(state, request))
    }

    fn moved(&mut self, request: &MoveRequest) -> Result<Vec<Packed<f32>>> {
        self.with_device(|state| fairing_layer::moved(state, request))
    }

    fn forget(&mut self, below: usize) {
        while self.first < below {
            let Some(node) = self.nodes.pop_front() else { break };
            self.first += 1;
            if let Some(layer) = node.layer {
                self.drop_layer(layer);
            }
            if let Some(made) = node.made {
                self.drop_layer(made.own);
                self.places.free(made.list);
                self.marks.free(made.marks);
                if let Some(place) = made.place {
                    self.vectors.free(place.vectors);
                }
            }
        }
        // Of the intervals below the lowest node's nothing is read any more.
        let lowest = self.nodes.iter().find_map(|node| Some(node.made.as_ref()?.place?.interval));
        if let Some(lowest) = lowest {
            let kept = self.intervals.split_off(&lowest);
            let dropped = std::mem::replace(&mut self.intervals, kept);
            dropped.into_values().for_each(|segment| self.vectors.free(segment));
        }
    }
}
