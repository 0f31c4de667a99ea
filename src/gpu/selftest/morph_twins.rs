//! Layers of whole intervals on the GPU beside their twin: groups on tiles of their own, holes and parts that end, overlaps that the blend loses,
//! a frame that moves, particles that did not arrive, an empty slice, and no frame at all.

use std::borrow::Cow;
use std::sync::Arc;

use glam::DVec2;

use super::cases::Cases;
use super::comparison::Comparison;
use super::moving_twins::Stack;
use crate::backend::Backend;
use crate::backend::interval_morph::{FrameSource, IntervalMorph, LayerImage, MorphFrame, Morphed};
use crate::backend::jobs::{SweepJob, SweepPair, Swept};
use crate::backend::requests::{MorphRequest, SweepRequest};
use crate::contour::caps::{Cap, CapProfile};
use crate::contour::direction::Direction;
use crate::contour::seeds::seeds;
use crate::error::Result;
use crate::gpu::{Gpu, morph_batches};
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::progress::Silent;
use crate::reference::Reference;
use crate::reference::morph_layer as twin;
use crate::registration::lone_parts::LoneParts;
use crate::registration::motion_field::MotionField;
use crate::registration::particle_weight::Trust;
use crate::stack::heights::BESIDE;

/// Distances near contours: what the composition and the field method may differ by, added up.
const NEAR: f64 = 5e-4;
/// Distances are near up to here, px.
const NEARBY: f64 = 3.0;
/// Share of the pixels farther off that may differ by more: a tile all of whose probes are at the limit but for rounding is whole on one path only.
const AT_LIMIT: f64 = 0.01;
/// Distances count up to here, px.
const LIMIT: f64 = 8.0;
/// Padding of the image.
const PAD: [usize; 2] = [5, 3];

/// Layers of intervals of a stack whose slices are in the frame `moving`.
///
/// # Errors
/// [`crate::Error::Gpu`] when the GPU cannot do the stage at all.
pub fn compare(gpu: &Gpu, stack: &Stack, moving: &MotionField) -> Result<Vec<Comparison>> {
    let times = vec![BESIDE, 0.31, 0.5, 0.77, 1.0 - BESIDE];
    let of = |i: usize, frame: bool| morph(stack, moving, i, &times, frame);
    let intervals = vec![of(0, true), of(1, true), of(2, true), of(3, true), of(1, false), nothing(stack, &times)];
    let request = MorphRequest { intervals: &intervals, h: stack.h, options: Cases::options(), at_once: 3 };
    // Sweeps have twins of their own, and rounding grows in them: what is composed has one set of slices.
    let pairs: Vec<SweepPair<'_>> =
        intervals.iter().flat_map(|of| of.pairs.iter().map(|(_, pair)| pair.clone())).collect();
    let sweeps = SweepRequest { pairs: &pairs, h: stack.h, options: Cases::options() };
    let slices = Reference.propagate(&sweeps, &Silent)?;
    let ours = morph_batches::layers_of(gpu, &request, &slices)?;
    let twins = twin::layers(&request, slices, &|requests| Reference.moving_layers(requests))?;
    let (mut near, mut far) =
        (Comparison::new("composed layers", NEAR), Comparison::new("composed layers far from contours", AT_LIMIT));
    for (q, a, b) in near.pairs(&"intervals", &ours, &twins) {
        let (mut apart, mut all) = (0, 0);
        for (n, a, b) in pixels(&mut near, q, a, b) {
            if a.abs().min(b.abs()) < NEARBY {
                near.value(|| format!("interval {q}, pixel {n}"), a, b);
            } else {
                apart += usize::from((a - b).abs() > NEAR);
                all += 1;
            }
        }
        far.value(|| format!("interval {q}, share of {all} pixels"), apart as f64 / all.max(1) as f64, 0.0);
    }
    // The device's own slices go no way over the host, which changes no bit.
    let mut own = Comparison::new("layers of own slices", 0.0);
    let (ours, sent) = (gpu.morph_layers(&request, &Silent)?, morph_batches::apart(gpu, &request, &Silent)?);
    for (q, a, b) in own.pairs(&"intervals", &ours, &sent) {
        for (n, a, b) in pixels(&mut own, q, a, b) {
            own.value(|| format!("interval {q}, pixel {n}"), a, b);
        }
        for (n, a, b) in own.pairs(&format_args!("pairs of interval {q}"), &a.swept, &b.swept) {
            let steps = |swept: &[Swept; 2]| (swept[0].steps + swept[1].steps) as f64;
            own.value(|| format!("interval {q}, steps of pair {n}"), steps(a), steps(b));
        }
    }
    Ok(vec![near, far, own])
}

/// Values of both at all pixels of the layers of interval `q`, one layer after the other.
fn pixels(out: &mut Comparison, q: usize, a: &Morphed, b: &Morphed) -> Vec<(usize, f64, f64)> {
    let mut all = Vec::new();
    for (k, a, b) in out.pairs(&format_args!("layers of interval {q}"), &a.layers, &b.layers) {
        let [a, b] = [a, b].map(SparseImage::unpack);
        for (_, a, b) in out.pairs(&format_args!("pixels of layer {k} of interval {q}"), &a, &b) {
            all.push((all.len(), f64::from(*a), f64::from(*b)));
        }
    }
    all
}

/// Interval `i` of the stack: its slices' own contours on a tile, in the moving frame or as they are.
fn morph(stack: &Stack, moving: &MotionField, i: usize, times: &[f64], in_frame: bool) -> IntervalMorph<'static> {
    let padded = stack.dims();
    let tile = Tile { origin: [2, 1], dims: [padded[0] - 5, padded[1] - 3] };
    let [low, high] = [0, 1].map(|end| tile.cut(&stack.fields[i + end]));
    let job = |source: &Field, goal: &Field, times: Vec<f64>| {
        let positions: Vec<DVec2> = seeds(source, stack.h, 0.5).iter().map(|s| s.x).collect();
        // As far as the goal is, but for half a pixel that steering makes good: where courses cross each other rounding decides which goes on.
        let course = |x: &DVec2| {
            let s = f64::from((-goal.sample(*x) - 0.5) as f32);
            [s, s, s, 1.0]
        };
        let courses = positions.iter().map(course).collect();
        SweepJob {
            source: Cow::Owned(source.clone()),
            goal: Cow::Owned(goal.clone()),
            seeds: positions,
            courses,
            times,
        }
    };
    let down = times.iter().rev().map(|t| 1.0 - t).collect();
    // The deepest place of the overlap, and one at its edge that the sweeps leave.
    let overlap: Vec<f64> = low.data.iter().zip(&high.data).map(|(a, b)| a.max(*b)).collect();
    let least = |key: fn(f64) -> f64| (0..overlap.len()).min_by(|a, b| key(overlap[*a]).total_cmp(&key(overlap[*b])));
    let anchors = [least(|v| v), least(|v| if v < -0.1 { -v } else { f64::INFINITY })];
    let anchors = anchors.into_iter().flatten().filter(|n| overlap[*n] < 0.0).collect();
    let at = |x: f64, y: f64, r: f64| {
        let middle = [x * tile.dims[0] as f64 * stack.h[0], y * tile.dims[1] as f64 * stack.h[1]];
        Field::from_fn(tile.dims, |i, j| {
            let away = (i as f64 * stack.h[0] - middle[0]).hypot(j as f64 * stack.h[1] - middle[1]);
            f64::from((away - r) as f32)
        })
    };
    let cap = |x: f64, y: f64, height: f64, direction| {
        let profile = CapProfile::new(0.4);
        (
            Cap { tile, field: at(x, y, 4.0), hole: false, open: false, depth: 4.0, height, farthest: 14.0, profile },
            direction,
        )
    };
    // A hole lies on a tile in the pair's.
    let own = Tile { origin: [3, 2], dims: [tile.dims[0] - 9, tile.dims[1] - 7] };
    let hole = |(cap, direction): (Cap, Direction)| (Cap { tile: own, field: own.cut(&cap.field), ..cap }, direction);
    let holes = if i == 1 { vec![hole(cap(0.35, 0.45, 0.6, Direction::Up))] } else { Vec::new() };
    let solids = vec![cap(0.9, 0.8, 0.7, Direction::Up), cap(0.85, 0.15, 0.4, Direction::Down)];
    let pair = SweepPair {
        up: job(&low, &high, times.to_vec()),
        down: job(&high, &low, down),
        anchors,
        holes: Cow::Owned(holes),
    };
    IntervalMorph {
        image: image(padded),
        times: times.to_vec(),
        pairs: vec![(tile, pair)],
        solids: Cow::Owned(solids),
        frame: in_frame.then(|| {
            let frame = frame(stack, moving, i);
            FrameSource::new(&frame.lone.clone(), move || Ok(frame.clone()))
        }),
    }
}

/// An interval in which nothing is.
fn nothing(stack: &Stack, times: &[f64]) -> IntervalMorph<'static> {
    let solids = Cow::Borrowed(&[][..]);
    IntervalMorph { image: image(stack.dims()), times: times.to_vec(), pairs: Vec::new(), solids, frame: None }
}

fn image(padded: [usize; 2]) -> LayerImage {
    LayerImage { dims: [0, 1].map(|a| padded[a] - 2 * PAD[a]), pad: PAD, limit: LIMIT }
}

/// The frame of interval `i`; of interval 2 one slice is empty. Particles did not arrive on one side.
fn frame(stack: &Stack, moving: &MotionField, i: usize) -> MorphFrame {
    let moving = MotionField {
        heights: moving.heights[i..i + 2].to_vec(),
        gaps: vec![moving.gaps[i]],
        px: moving.px,
        relief: moving.relief,
        doubt: moving.doubt,
        fields: moving.fields[i..i + 2].to_vec(),
        displacements: vec![moving.displacements[i].clone()],
        at_slices: vec![moving.at_slices[i].clone()],
        rates: moving.rates[i..i + 2].to_vec(),
        through_middle: vec![moving.through_middle[i].clone()],
    };
    let arrived = |x: DVec2| if x.x * stack.h[0] < 30.0 { 1.0 } else { 0.8 };
    // Everywhere: beyond the last particle the weight changes from nothing to all within a pixel, which no rounding bears.
    let dims = stack.dims();
    let lattice = (0..dims[1]).step_by(6).flat_map(|y| (0..dims[0]).step_by(6).map(move |x| [x as f64, y as f64]));
    let particles: Vec<(DVec2, f64)> = lattice.map(|x| (x.into(), arrived(x.into()))).collect();
    let trust = Trust::new(&moving, 0, stack.h, 0.0, particles.into_iter());
    let slope = |k: usize| {
        let wave = |n: usize| f64::from((0.11 * (n % 97) as f64 + k as f64).sin() as f32);
        Arc::new(Field { dims, data: (0..dims[0] * dims[1]).map(wave).collect() })
    };
    let lone = LoneParts { empty: false, ..stack.lone[i].clone() };
    MorphFrame {
        moving,
        empty: [false, i == 2],
        slopes: [slope(0), slope(1)],
        lone: Arc::new(lone),
        trust: Arc::new(trust),
    }
}
