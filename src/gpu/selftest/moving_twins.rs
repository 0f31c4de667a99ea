//! The stages of the moving field on the GPU beside their f64 twins: parts that drift, turn, split, appear alone and vanish, an empty slice,
//! uneven gaps.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec2;

use crate::backend::Backend;
use crate::backend::requests::{LayerRequest, SlopeRequest};
use crate::contour::caps::{Cap, CapProfile};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::selftest::cases::{blob, joined};
use crate::gpu::selftest::comparison::Comparison;
use crate::gpu::selftest::morph_twins;
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::progress::Silent;
use crate::reference::Reference;
use crate::reference::displacement::{ROUNDS, displacements};
use crate::reference::distance::distance_of;
use crate::registration::cells::{CELL, Cells};
use crate::registration::displacement::{Displacement, DisplacementJob};
use crate::registration::lone_parts::LoneParts;
use crate::registration::motion_field::MotionField;

/// A round from the same vectors: moments of up to 32 px times 1e-7, divided by a ridge of 0.07, px.
const ROUND: f64 = 1e-4;
/// All rounds: each passes on less than the error it was given, and adds its own.
const ALL_ROUNDS: f64 = 2e-4;
/// Vectors of tens of px, a few roundings each; the fixed point passes on less than it is given.
const PATHS: f64 = 5e-5;
/// Distances of up to 300 px in single precision, read where vectors off by as much as they may be point to; px per gap.
const SLOPES: f64 = 3e-4;
/// Same values, whatever they are clamped to.
const LAYERS: f64 = 2e-4;
/// Distances count up to here, px.
const LIMIT: f64 = 8.0;
/// Pixels around lone parts, and times the scale around those that no slice has: what they would change beyond does not count.
const MARGINS: [usize; 2] = [9, 30];
/// All distances.
const EVERYWHERE: f64 = 1e4;

const GAPS: [f64; 5] = [1.0, 2.5, 0.6, 1.4, 2.2];
/// Gaps of which some are narrow beside the next, at an end, above and below a slice, partly and wholly.
const NARROW_GAPS: [f64; 5] = [0.1, 1.5, 0.25, 0.9, 0.15];
/// What contours may be off by, px.
const DOUBT: f64 = 0.35;
/// Height of a pixel.
const PX: f64 = 0.25;
/// Share of relief in the stack: all terms of slopes and layers count.
const RELIEF: f64 = 0.4;
const TIMES: [f64; 4] = [0.03, 0.4, 0.5, 0.92];

/// A stack with its lone parts; single precision exactly.
pub(super) struct Stack {
    pub(super) h: [f64; 2],
    pub(super) fields: Vec<Arc<Field>>,
    pub(super) lone: Vec<LoneParts>,
}

fn single(field: &Field) -> Field {
    Field { dims: field.dims, data: field.data.iter().map(|v| f64::from(*v as f32)).collect() }
}

/// A displacement that varies, up to `size` px.
fn waves(dims: [usize; 2], size: f64, phase: f64) -> Displacement {
    let wave = |x: f64, y: f64| f64::from((size * (0.07 * x + 0.05 * y + phase).sin()) as f32);
    Displacement::zero(dims)
        .map(|_, DVec2 { x, y }, _| DVec2::new(wave(x, y), 0.7 * wave(y, -x)))
        .map(|_, _, v| v.as_vec2().as_dvec2())
}

impl Stack {
    fn new(h: [f64; 2], scale: usize) -> Self {
        let s = scale as f64;
        let wide = |n: usize, side: f64| ((n * scale) as f64 / side) as usize | 1;
        let dims = [wide(97, h[0]), wide(75, h[1])];
        let shape = |x: f64, y: f64, r: f64, lobes: f64, depth: f64| blob(dims, h, [x * s, y * s], r * s, lobes, depth);
        let disc = |x: f64, y: f64, r: f64| shape(x, y, r, 1.0, 0.0);
        let distance = |u: &Field| single(&distance_of(u, h));
        let beyond = |f: &Field, depth: f64| Field { dims, data: f.data.iter().map(|v| v + 2.0 * depth * s).collect() };
        // Three discs that only one slice has, two of them with tiles that overlap; and two that no slice has.
        let alone = [(80.0, 57.0, 6.0), (79.0, 41.0, 5.0), (77.0, 16.0, 5.5), (60.0, 38.0, 2.0), (16.0, 38.0, 2.0)];
        let discs = alone.map(|(x, y, r)| disc(x, y, r));
        let star = distance(&joined(&shape(36.0, 35.0, 14.0, 5.0, 0.2), &discs[2]));
        let oval = distance(&shape(38.0, 38.0, 12.0, 2.0, 0.35));
        let fields = vec![
            distance(&disc(27.0, 30.0, 13.0)),
            distance(&joined(&disc(31.0, 33.0, 14.0), &joined(&discs[0], &discs[1]))),
            star.clone(),
            single(&joined(&beyond(&star, 12.0), &beyond(&oval, 8.0))),
            oval,
            // Deep inside the larger one both slices are far from their contours, on either side.
            distance(&joined(&disc(31.0, 40.0, 9.0), &disc(72.0, 37.0, 21.0))),
        ];
        let height = [0.5, 0.75, 0.2, 0.6, 0.4];
        let profile = [0.0, 0.4, 1.0, 1.7, 0.8].map(CapProfile::new);
        let part = |k: usize| {
            let (x, y, r) = alone[k];
            let corner = |sign: f64| [0, 1].map(|a| ((([x, y][a] + sign * r) * s / h[a]) as usize).min(dims[a] - 1));
            let margin = if k < 3 { MARGINS[0] } else { MARGINS[1] * scale };
            let tile = Tile::spanning(dims, [margin; 2], corner(-1.0), corner(1.0));
            let field = single(&tile.cut(&distance(&discs[k])));
            let (depth, height, profile) = (r * s, height[k], profile[k]);
            Cap { tile, field, hole: k == 2 || k == 4, open: k % 3 == 1, depth, height, farthest: 14.0, profile }
        };
        let parts = |low: &[usize], high: &[usize]| LoneParts {
            low: low.iter().map(|&k| part(k)).collect(),
            high: high.iter().map(|&k| part(k)).collect(),
            empty: false,
        };
        // Those that no slice has would count on the other side, too: it shows if they do.
        let mut lone =
            vec![parts(&[], &[0, 1]), parts(&[0, 1], &[2]), parts(&[2], &[]), parts(&[3], &[4]), parts(&[], &[])];
        lone[2].empty = true;
        Stack { h, fields: fields.into_iter().map(Arc::new).collect(), lone }
    }

    pub(super) fn dims(&self) -> [usize; 2] {
        self.fields[0].dims
    }

    fn still(&self) -> Vec<Displacement> {
        vec![Displacement::zero(self.dims()); GAPS.len()]
    }

    /// The first intervals' displacements are asked for.
    fn job<'a>(
        &'a self,
        guess: &'a [Displacement],
        begin: &'a [Displacement],
        rounds: Range<usize>,
    ) -> DisplacementJob<'a> {
        let fields = &self.fields[..=guess.len()];
        DisplacementJob { fields, gaps: &GAPS[..guess.len()], guess, begin, rounds, h: self.h }
    }

    /// The stack's first slices in their moving frame.
    fn moving(&self, slices: usize) -> MotionField {
        let gaps = &GAPS[..slices - 1];
        let still = &self.still()[..slices - 1];
        let single = |v: Displacement| v.map(|_, _, v| v.map(|c| f64::from(c as f32)));
        let found = displacements(&self.job(still, still, 0..ROUNDS.len()));
        let heights = gaps.iter().scan(10.0, |z, gap| {
            *z += gap;
            Some(*z)
        });
        let heights = std::iter::once(10.0).chain(heights).collect();
        let found = found.into_iter().map(single).collect();
        MotionField { relief: RELIEF, ..MotionField::new(heights, PX, self.fields[..slices].to_vec(), found) }
    }
}

/// Every stage of the moving field at this pixel size and scale.
///
/// # Errors
/// [`crate::Error::Gpu`] when the GPU cannot do a stage at all.
pub fn compare(gpu: &Gpu, h: [f64; 2], scale: usize) -> Result<Vec<Comparison>> {
    let stack = Stack::new(h, scale);
    let moving = stack.moving(stack.fields.len());
    let mut out = vec![
        round(gpu, &stack, "displacements, a wide round", 0..1)?,
        round(gpu, &stack, "displacements, a narrow round", ROUNDS.len() - 1..ROUNDS.len())?,
        rounds(gpu, &stack)?,
        paths(gpu, &stack, &moving)?,
    ];
    // Two slices have secants, three have one interior slope.
    for (slices, stage) in [(2, "slopes of two slices"), (3, "slopes of three slices")] {
        out.push(slopes(gpu, stage, &stack.moving(slices))?);
    }
    out.push(slopes(gpu, "slopes along trajectories", &moving)?);
    let narrow = MotionField { gaps: NARROW_GAPS.to_vec(), doubt: DOUBT, ..moving.clone() };
    out.push(slopes(gpu, "slopes beside narrow gaps", &narrow)?);
    out.push(layers(gpu, &stack, &moving)?);
    out.extend(morph_twins::compare(gpu, &stack, &moving)?);
    Ok(out)
}

/// Compares displacements of `what`, px.
fn vectors(out: &mut Comparison, what: &str, gpu: &[Displacement], twin: &[Displacement], h: [f64; 2]) {
    for (q, a, b) in out.pairs(&what, gpu, twin) {
        for (n, a, b) in out.pairs(&format_args!("vectors of {what} {q}"), &a.vectors, &b.vectors) {
            for axis in 0..2 {
                out.value(|| format!("{what} {q}, block {n}, axis {axis}"), a[axis] * h[axis], b[axis] * h[axis]);
            }
        }
    }
}

fn round(gpu: &Gpu, stack: &Stack, stage: &'static str, round: Range<usize>) -> Result<Comparison> {
    let waves = |size: f64| -> Vec<Displacement> {
        (0..GAPS.len()).map(|i| waves(stack.dims(), size, 0.8 * i as f64)).collect()
    };
    let (current, guess) = (waves(3.0), waves(1.5));
    let job = stack.job(&guess, &current, round);
    let mut out = Comparison::new(stage, ROUND);
    vectors(&mut out, "intervals", &gpu.displacements(&job)?, &Reference.displacements(&job)?, stack.h);
    Ok(out)
}

fn rounds(gpu: &Gpu, stack: &Stack) -> Result<Comparison> {
    let still = stack.still();
    let job = stack.job(&still, &still, 0..ROUNDS.len());
    let [ours, twin] = [gpu.displacements(&job)?, Reference.displacements(&job)?];
    let mut out = Comparison::new("displacements", ALL_ROUNDS);
    vectors(&mut out, "intervals", &ours, &twin, stack.h);
    Ok(out)
}

fn paths(gpu: &Gpu, stack: &Stack, moving: &MotionField) -> Result<Comparison> {
    let mut out = Comparison::new("trajectories", PATHS);
    for i in 0..GAPS.len() {
        let ours = gpu.paths(moving, i, &TIMES, stack.h)?;
        for (_, ours, &t) in out.pairs(&"times", &ours, &TIMES) {
            let twin = moving.paths(i, t);
            vectors(&mut out, "ways", &[ours.come.clone(), ours.go.clone()], &[twin.come, twin.go], stack.h);
        }
    }
    Ok(out)
}

fn slopes(gpu: &Gpu, stage: &'static str, moving: &MotionField) -> Result<Comparison> {
    let ours = gpu.moving_slopes(&all_slopes(moving), &Silent)?;
    let twin = Reference.moving_slopes(&all_slopes(moving), &Silent)?;
    let mut out = Comparison::new(stage, SLOPES);
    for (i, a, b) in out.pairs(&"slices", &ours, &twin) {
        let gap = moving.gap(i.saturating_sub(1)).min(moving.gap(i.min(moving.gaps.len() - 1)));
        for (n, a, b) in out.pairs(&format_args!("nodes of slice {i}"), &a.data, &b.data) {
            out.value(|| format!("slice {i}, node {n}"), gap * a, gap * b);
        }
    }
    Ok(out)
}

fn layers(gpu: &Gpu, stack: &Stack, moving: &MotionField) -> Result<Comparison> {
    let slopes = Reference.moving_slopes(&all_slopes(moving), &Silent)?;
    let slopes: Vec<Arc<Field>> = slopes.iter().map(|field| Arc::new(single(field))).collect();
    let beside = |i: usize| [&slopes[i], &slopes[i + 1]];
    let mut out = Comparison::new("layers", LAYERS);
    // Far from contours the edges of lone parts' tiles would show.
    let none = LoneParts::default();
    let near = stack.lone.iter().enumerate().map(|(i, lone)| (i, lone, LIMIT));
    let everywhere = (0..GAPS.len()).map(|i| (i, &none, EVERYWHERE));
    for (i, lone, limit) in near.chain(everywhere) {
        let slopes = beside(i);
        let request =
            LayerRequest { moving, interval: i, slopes, lone, times: &TIMES, limit, h: stack.h, wanted: None };
        let ours = gpu.moving_layers(&[request])?.concat();
        let twins = Reference.moving_layers(&[request])?.concat();
        for (k, ours, twin) in out.pairs(&"layers", &ours, &twins) {
            let [ours, twin] = [ours, twin].map(SparseImage::unpack);
            for (n, a, b) in out.pairs(&format_args!("nodes of layer {k}"), &ours, &twin) {
                out.value(|| format!("interval {i}, layer {k}, node {n}"), f64::from(*a), f64::from(*b));
            }
        }
    }
    for (i, lone) in stack.lone.iter().enumerate() {
        some_cells(
            gpu,
            &LayerRequest {
                moving,
                interval: i,
                slopes: beside(i),
                lone,
                times: &TIMES,
                limit: LIMIT,
                h: stack.h,
                wanted: None,
            },
            &mut out,
        )?;
    }
    Ok(out)
}

/// Share of the cells that nobody asks for which one path may say to be beyond the limit and the other not: those at the limit but for rounding.
const AT_LIMIT: f64 = 0.01;

/// The same where two of three cells are asked for.
fn some_cells(gpu: &Gpu, request: &LayerRequest<'_>, out: &mut Comparison) -> Result<()> {
    let dims = request.moving.fields[0].dims;
    let some = |shift: usize| Cells::new(dims, |[x, y], _| !(x / CELL + 2 * (y / CELL) + shift).is_multiple_of(3));
    let wanted: Vec<Cells> = (0..request.times.len()).map(some).collect();
    let request = [LayerRequest { wanted: Some(&wanted), ..*request }];
    let (ours, twins) = (gpu.moving_layers(&request)?.concat(), Reference.moving_layers(&request)?.concat());
    for ((k, ours, twin), cells) in out.pairs(&"layers", &ours, &twins).zip(&wanted) {
        let (mut apart, mut beyond) = (0, 0);
        for (x, y) in (0..dims[1]).flat_map(|y| (0..dims[0]).map(move |x| (x, y))) {
            let (a, b) = (f64::from(ours.at(x, y)), f64::from(twin.at(x, y)));
            if cells.at(x, y) {
                out.value(|| format!("layer {k} of some cells, node {x} {y}"), a, b);
            } else {
                apart += usize::from(a != b);
                beyond += usize::from(b != 0.0);
            }
        }
        if beyond == 0 || apart as f64 > AT_LIMIT * beyond as f64 {
            out.value(|| format!("layer {k}, pixels of cells not asked for, of {beyond}"), apart as f64, 0.0);
        }
    }
    Ok(())
}

/// Slopes of all slices.
fn all_slopes(moving: &MotionField) -> SlopeRequest<'_> {
    SlopeRequest { moving, wanted: 0..moving.fields.len() }
}
