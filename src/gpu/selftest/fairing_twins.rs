//! Fairing on the GPU beside its f64 twin: discs that drift, grow and end, in a frame that moves and without one, at uneven gaps.

use std::sync::Arc;

use crate::backend::Backend;
use crate::backend::fairing::{
    CorrectionRequest, FairingFrame, FairingState, LayerMove, MoveRequest, NodeMean, TransformRequest,
};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::selftest::comparison::Comparison;
use crate::gpu::selftest::moving_twins::waves;
use crate::grid::tiled::Packed;
use crate::reference::Reference;
use crate::registration::motion_field::even_gaps;
use crate::registration::motion_stack::MotionStack;
use crate::stack::heights::{NODE_TIMES, NODES, at_time};
use crate::storage::spill::{Budget, SpillVec};

/// Distances of up to 8 px, read where trajectories of tens of px in single precision lead, and means of nine of them, px.
const BOUND: f64 = 2e-4;
/// Distances count up to here.
const FARTHEST: f64 = 8.0;
/// Heights of the contours, and layers between nodes as shares of the way to the next one.
const CONTOURS: [f64; 5] = [10.0, 11.0, 13.5, 14.1, 15.5];
const BETWEEN: [f64; 2] = [0.3, 0.8];
/// Weights of nodes of a mean, by how far away they are.
const WEIGHTS: [f64; 6] = [0.27, 0.21, 0.11, 0.03, 0.01, 0.005];
/// Padding of the moving frame's image, px.
const PAD: [usize; 2] = [8, 5];

/// Layers at all heights.
struct Body {
    dims: [usize; 2],
    spacing: [f64; 2],
    scale: f64,
}

impl Body {
    /// The layer at height `z`: a disc that drifts and grows, one that ends, one that is on the upper contours alone, beside a straight wall.
    fn layer(&self, z: f64) -> Packed<f32> {
        let rise = z - CONTOURS[0];
        let disc = |x: f64, y: f64, r: f64| (x, y, r);
        let discs = [
            disc(30.0 + 3.0 * rise, 30.0 + (2.0 * rise).sin(), 12.0 + 2.0 * (1.7 * rise).sin()),
            disc(75.0, 55.0, 9.0 - 3.0 * rise),
            disc(70.0, 20.0, -4.0 + 3.0 * rise),
        ];
        let value = |n: usize| {
            let (x, y) = ((n % self.dims[0]) as f64 * self.spacing[0], (n / self.dims[0]) as f64 * self.spacing[1]);
            let of = |(cx, cy, r): (f64, f64, f64)| (x - cx * self.scale).hypot(y - cy * self.scale) - r * self.scale;
            let wall = y - (4.0 + 0.8 * rise) * self.scale;
            discs.map(of).into_iter().fold(wall, f64::min).clamp(-FARTHEST, FARTHEST) as f32
        };
        Packed::of(self.dims, &(0..self.dims[0] * self.dims[1]).map(value).collect::<Vec<f32>>())
    }
}

fn height(k: usize) -> f64 {
    let ends = |i: usize| [CONTOURS[i], CONTOURS[i + 1]];
    match (k / NODES, k % NODES) {
        (i, 0) => CONTOURS[i],
        (i, n) => at_time(ends(i), NODE_TIMES[n - 1]),
    }
}

/// Layers of all intervals after fairing.
fn faired(mut state: Box<dyn FairingState + '_>, body: &Body, shares: bool) -> Result<Vec<Packed<f32>>> {
    let last = NODES * (CONTOURS.len() - 1);
    let layers: Vec<Arc<Packed<f32>>> = (0..=last).map(|k| Arc::new(body.layer(height(k)))).collect();
    layers.iter().enumerate().for_each(|(k, phi)| state.take(k, phi.clone()));
    let asked = |k: usize| {
        let beside = [k.saturating_sub(1), (k + 1).min(last)];
        TransformRequest {
            node: k,
            z: height(k),
            beside,
            rise: 4.0 * (height(beside[1]) - height(beside[0])),
            at_contour: k.is_multiple_of(NODES),
        }
    };
    let asked: Vec<TransformRequest> = (0..=last).map(asked).collect();
    // Not all at once: what is there stays.
    asked.chunks(7).try_for_each(|some| state.transform(some))?;
    let mean = |k: usize| {
        let away = (0..=last).filter(|l| l.abs_diff(k) < WEIGHTS.len());
        let weights: Vec<(usize, f64)> = away.map(|l| (l, WEIGHTS[l.abs_diff(k)])).collect();
        let sum: f64 = weights.iter().map(|(_, w)| w).sum();
        NodeMean { node: k, weights: weights.into_iter().map(|(l, w)| (l, w / sum)).collect() }
    };
    let share = |n: usize| if n % body.dims[0] < 40 { 1.0 } else { 0.5 };
    let shares = shares.then(|| Arc::new((0..body.dims[0] * body.dims[1]).map(share).collect::<Vec<f32>>()));
    for low in (0..last).step_by(NODES) {
        let high = low + NODES;
        state.correct(&CorrectionRequest {
            ends: [mean(low), mean(high)],
            beyond: [low.checked_sub(NODES), Some(high + NODES).filter(|k| *k <= last)],
            between: (low + 1..high).map(|k| (mean(k), (k - low) as f64 / NODES as f64, 1.5)).collect(),
            shares: shares.clone().filter(|_| low == NODES),
        })?;
    }
    let mut out = Vec::new();
    for low in (0..last).step_by(NODES) {
        let nodes =
            (low + 1..low + NODES).map(|k| LayerMove { phi: layers[k].clone(), node: Some(k), curve: vec![(k, 1.0)] });
        let between = (low..low + NODES).flat_map(|k| BETWEEN.map(|f| (k, f))).map(|(k, f)| LayerMove {
            phi: Arc::new(body.layer((1.0 - f) * height(k) + f * height(k + 1))),
            node: None,
            curve: vec![(k, 1.0 - f), (k + 1, f)],
        });
        let request = MoveRequest { ends: [low, low + NODES], layers: nodes.chain(between).collect() };
        out.extend(state.moved(&request)?);
        state.forget(low.saturating_sub(1));
    }
    Ok(out)
}

/// Fairing at this pixel size and scale.
///
/// # Errors
/// [`crate::Error::Gpu`] when the GPU cannot do it at all.
pub fn compare(gpu: &Gpu, h: [f64; 2], scale: usize) -> Result<Vec<Comparison>> {
    let wide = |n: usize, side: f64| ((n * scale) as f64 / side) as usize | 1;
    let body = Body { dims: [wide(97, h[0]), wide(75, h[1])], spacing: h, scale: scale as f64 };
    let budget = Budget::unlimited();
    let padded = [0, 1].map(|a| body.dims[a] + 2 * PAD[a]);
    let mut displacements = SpillVec::new(&budget);
    for i in 0..CONTOURS.len() - 1 {
        displacements.push(waves(padded, 3.0, 0.8 * i as f64))?;
    }
    let gaps = even_gaps(&CONTOURS);
    let moving = MotionStack::new(CONTOURS.to_vec(), gaps, 1.0, 0.0, SpillVec::new(&budget), displacements, &budget)?;
    let still: Option<(&MotionStack<'_>, [usize; 2])> = None;
    let cases = [
        ("fairing without motion", still, false, false),
        ("fairing along trajectories", Some((&moving, PAD)), true, false),
        ("fairing of parts kept apart", Some((&moving, PAD)), true, true),
    ];
    let mut out = Vec::new();
    for (stage, moving, limited, shares) in cases {
        let (dims, spacing) = (body.dims, body.spacing);
        let frame = FairingFrame { moving, dims, spacing, bound: 3.0, limited, farthest: FARTHEST };
        let ours = faired(gpu.fairing(frame)?, &body, shares)?;
        let twins = faired(Reference.fairing(frame)?, &body, shares)?;
        let mut found = Comparison::new(stage, BOUND);
        for (k, ours, twin) in found.pairs(&"layers", &ours, &twins) {
            for (n, a, b) in found.pairs(&format_args!("pixels of layer {k}"), &ours.unpack(), &twin.unpack()) {
                found.value(
                    || format!("layer {k}, pixel ({}, {})", n % dims[0], n / dims[0]),
                    f64::from(*a),
                    f64::from(*b),
                );
            }
        }
        out.push(found);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bodies_of_the_self_test_are_faired() {
        let body = Body { dims: [97, 75], spacing: [1.0; 2], scale: 1.0 };
        let frame = FairingFrame {
            moving: None,
            dims: body.dims,
            spacing: body.spacing,
            bound: 3.0,
            limited: false,
            farthest: FARTHEST,
        };
        let layers = faired(Reference.fairing(frame).expect("a fairing"), &body, false).expect("no failure");
        let moved = layers[1]
            .unpack()
            .iter()
            .zip(body.layer(height(2)).unpack())
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!((0.05..2.0).contains(&moved), "{moved}");
    }
}
