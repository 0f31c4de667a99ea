//! Fairing as a backend is asked for it: what a machine keeps of the nodes of a stack between requests, and the requests.
//!
//! Nodes are numbered from the lowest of the stack. They are handed over in order, transformed, then the corrections of an interval are made, then
//! its layers are moved. Numbers in a request are those of nodes that have been handed over and not dropped; of others there is nothing, and
//! they count nothing. Lengths are in the unit of the spacing.

use std::sync::Arc;

use crate::error::Result;
use crate::grid::tiled::Packed;
use crate::registration::motion_stack::MotionStack;

/// Facts about a stack that all requests share.
#[derive(Clone, Copy)]
pub struct FairingFrame<'m> {
    /// The frame in which layers follow each other, and the padding of its image.
    pub moving: Option<(&'m MotionStack<'m>, [usize; 2])>,
    /// Pixels of a layer.
    pub dims: [usize; 2],
    /// Pixel spacing.
    pub spacing: [f64; 2],
    /// B.
    pub bound: f64,
    /// Whether layers may not leave the range of their two contours.
    pub limited: bool,
    /// Distances count up to this.
    pub farthest: f64,
}

impl FairingFrame<'_> {
    /// Length of a pixel's larger side.
    pub fn side(&self) -> f64 {
        self.spacing[0].max(self.spacing[1])
    }
}

/// Request for v, the gradient and the flatness of a node.
#[derive(Debug, Clone)]
pub struct TransformRequest {
    /// The node.
    pub node: usize,
    /// Height.
    pub z: f64,
    /// Nodes between which the gradient along z is taken: the node itself at an end.
    pub beside: [usize; 2],
    /// Height between them as a length.
    pub rise: f64,
    /// Whether it is a contour.
    pub at_contour: bool,
}

/// Mean at a node.
#[derive(Debug, Clone)]
pub struct NodeMean {
    /// The node.
    pub node: usize,
    /// Weights of the nodes.
    pub weights: Vec<(usize, f64)>,
}

/// Request for the corrections of the nodes of an interval.
#[derive(Debug, Clone)]
pub struct CorrectionRequest {
    /// The means at its contours.
    pub ends: [NodeMean; 2],
    /// The contours on the other sides of those.
    pub beyond: [Option<usize>; 2],
    /// The nodes between, with their times and strengths.
    pub between: Vec<(NodeMean, f64, f64)>,
    /// The share of the strength at each pixel, where parts are kept apart.
    pub shares: Option<Arc<Vec<f32>>>,
}

/// Layer to be moved.
#[derive(Debug, Clone)]
pub struct LayerMove {
    /// Its distances.
    pub phi: Arc<Packed<f32>>,
    /// Its node, where it is one.
    pub node: Option<usize>,
    /// Weights of the nodes' corrections in its own.
    pub curve: Vec<(usize, f64)>,
}

/// Request for layers between two contours, moved.
#[derive(Debug, Clone)]
pub struct MoveRequest {
    /// The contours.
    pub ends: [usize; 2],
    /// The layers.
    pub layers: Vec<LayerMove>,
}

/// Nodes of a stack on a machine, and what it makes of them.
pub trait FairingState {
    /// Takes the distances of the next node.
    fn take(&mut self, node: usize, phi: Arc<Packed<f32>>);

    /// Makes v and the gradient of some nodes.
    ///
    /// # Errors
    /// A backend's own failures, and those of the moving frame's shelves.
    fn transform(&mut self, nodes: &[TransformRequest]) -> Result<()>;

    /// Makes the corrections of the nodes of an interval, whose contours and beyond are transformed.
    ///
    /// # Errors
    /// A backend's own failures.
    fn correct(&mut self, request: &CorrectionRequest) -> Result<()>;

    /// The layers, moved by the curve through the corrections.
    ///
    /// # Errors
    /// A backend's own failures.
    fn moved(&mut self, request: &MoveRequest) -> Result<Vec<Packed<f32>>>;

    /// Drops the nodes below this one.
    fn forget(&mut self, below: usize);
}
