//! All labels alone and their unions, then all of them in step.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::path::Path;

use super::decide::{CRACK, LabelReach, Layers, NEAR, Rank};
use super::ended::{EndingLabels, GoesOn, HeightBetween, depth};
use super::floating::{DecidedStep, FloatingPieces};
use super::given::Given;
use super::kept::{KeptBody, LayerPatch};
use super::piece::{LabelPiece, asked, pieces, same_height, unions};
use super::report::Borders;
use super::stack::{LabelPair, LabelStack};
use crate::backend::Means;
use crate::error::{Error, Result};
use crate::grid::sparse_image::SparseImage;
use crate::reconstruct::reconstruct_into;
use crate::settings::Settings;
use crate::stack::ContourStack;
use crate::stack::heights::{SAME, nodes};
use crate::surface::Layer;
use crate::surface::header::Header;
use crate::surface::stream::LayerSink;

/// Plan of a run with labels.
#[derive(Clone, Copy)]
pub struct Plan<'p> {
    /// Output heights.
    pub heights: &'p [f64],
    /// Settings of each reconstruction.
    pub settings: &'p Settings,
    /// Folder of temporary files.
    pub folder: &'p Path,
    /// Memory beside the runs, and how much is allowed in all.
    pub beside: u64,
    /// Bytes of memory that are allowed, else what is free.
    pub memory: Option<u64>,
}

/// The labels alone, and the unions of those that touch.
#[derive(Debug)]
pub struct Bodies {
    /// Each label, as it is without the others.
    pub alone: Vec<KeptBody>,
    unions: Vec<(Vec<usize>, KeptBody)>,
}

/// The labels without overlaps and gaps.
#[derive(Debug)]
pub struct DecidedLabels {
    /// Each label.
    pub bodies: Vec<KeptBody>,
    /// Whether it is another body than alone.
    pub changed: Vec<bool>,
    /// Output voxels of each.
    pub voxels: Vec<u64>,
    /// Pixels of drawn slices that should have this label and have not, or the other way round.
    pub differing: Vec<u64>,
    /// Counts of what was decided.
    pub borders: Borders,
}

impl DecidedLabels {
    /// Nothing decided of so many labels.
    pub(crate) fn none(count: usize) -> Self {
        DecidedLabels {
            bodies: Vec::new(),
            changed: vec![false; count],
            voxels: vec![0; count],
            differing: vec![0; count],
            borders: Borders::default(),
        }
    }
}

/// Reconstructs each label alone and, to `unite` them, the unions of those that touch, each on its own part of the image. Labels that are not
/// united are computed on the whole image, and their distances are those of a single run to the last bit.
///
/// # Errors
/// The errors of [`reconstruct_into`], naming the label; [`Error::Write`] for temporary files.
pub fn reconstruct(stack: &LabelStack, unite: bool, plan: &Plan<'_>, means: &Means<'_>) -> Result<Bodies> {
    stack.validate()?;
    let far = plan.settings.margin() as f32 * pixel(&stack.stack);
    let asked = asked(stack, unite, plan.heights);
    let budget = |part: &LabelPiece| part.needs(&asked, plan.settings).budget(plan.beside, plan.memory);
    let groups = unions(stack, unite);
    // What does not fit is found before the work.
    pieces(stack, unite, &groups).try_for_each(|part| budget(&part).map(|_| ()))?;
    let keep = |members: &[usize]| {
        let part = LabelPiece::of(stack, members, unite);
        let mut kept = KeptBody::new(plan.folder, far, stack.stack.dims, part.origin)?;
        let budget = budget(&part)?;
        let means = Means { budget: &budget, ..*means };
        let named = |e: Error| match (e, members) {
            (Error::Stack(m), [a]) => Error::Stack(format!("label {}: {m}", stack.labels[*a])),
            (e, _) => e,
        };
        let body = reconstruct_into(&part.stack, &asked, plan.settings, &means, &mut kept).map_err(named)?;
        if unite {
            let z: Vec<f64> = part.stack.slices.iter().map(|slice| slice.z).collect();
            let within = SAME * z.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
            kept.hide_all_but(plan.heights, &part.shown(plan.heights), [z[0], z[z.len() - 1]], within);
        }
        kept.report = body.report;
        kept.report.dims = stack.stack.dims;
        Ok(kept)
    };
    let alone = (0..stack.labels.len()).map(|a| keep(&[a])).collect::<Result<_>>()?;
    let unions = groups.into_iter().map(|g| keep(&g).map(|kept| (g, kept))).collect::<Result<_>>()?;
    Ok(Bodies { alone, unions })
}

/// Decides every voxel. The label volume goes to `volume`: a layer has the labels' numbers instead of distances.
///
/// # Errors
/// The errors of `volume`; [`Error::Write`] for temporary files; [`Error::Numerics`] where a drawn slice has not come back or a voxel has two
/// labels.
pub fn decide(
    stack: &LabelStack,
    mut bodies: Bodies,
    plan: &Plan<'_>,
    volume: &mut dyn LayerSink,
) -> Result<DecidedLabels> {
    let ContourStack { dims, spacing, ref unit, geometry, ref slices, .. } = stack.stack;
    let (count, px) = (stack.labels.len(), pixel(&stack.stack));
    let far = plan.settings.margin() as f32 * px;
    let reach = LabelReach { far, fill: far - px, near: NEAR * px, crack: CRACK * px };
    let same = same_height(stack);
    let groups: Vec<Vec<usize>> = bodies.unions.iter().map(|(members, _)| members.clone()).collect();
    let ending = EndingLabels::of(stack, &groups);
    let steps = Steps::new(stack, plan.heights, &bodies, same);
    let ranks: Vec<Rank> = (0..count).map(|a| stack.drawn_pixels(a)).map(|(n, first)| (Reverse(n), first)).collect();
    let drawn_at: Vec<f64> = slices.iter().map(|s| s.z).collect();
    let painted = stack.painted();
    let mut drawn_depths: Vec<DrawnDepths> = Vec::with_capacity(count);
    for (a, body) in bodies.alone.iter_mut().enumerate() {
        let of = |k: usize| Ok((drawn_at[k], body.at(drawn_at[k], same)?.map_or(far, |contour| depth(&contour))));
        let on = (0..slices.len()).filter(|k| painted[*k][a]);
        drawn_depths.push(DrawnDepths(on.map(of).collect::<Result<_>>()?));
    }
    let mut decided = DecidedLabels::none(count);
    for alone in &bodies.alone {
        let mut kept = KeptBody::new(plan.folder, far, dims, [0; 2])?;
        kept.report = alone.report.clone();
        kept.header = alone.header.clone();
        decided.bodies.push(kept);
    }
    let extent = [plan.heights[0], plan.heights[plan.heights.len() - 1]];
    let grid = Header::grid(plan.heights, spacing);
    volume.begin(&Header { dims, spacing, unit: unit.clone(), geometry, extent, grid })?;
    for step in &steps.all {
        let z = step.z;
        let mut unions = Vec::new();
        for (members, body) in &mut bodies.unions {
            let there = step.slice.is_none_or(|k| members.iter().any(|&a| !stack.given[a].shuts(k)));
            let settled = step.slice.is_none_or(|k| stack.settled(members, k));
            unions.push((&*members, settled, if there { body.at(z, same)? } else { None }));
        }
        let mut alone = Vec::with_capacity(count);
        for (body, given) in bodies.alone.iter_mut().zip(&stack.given) {
            // An end must not reach into a slice on which its label is known not to be.
            let there = step.slice.is_none_or(|k| !given.shuts(k));
            alone.push(if there { body.at(z, same)?.unwrap_or_default() } else { LayerPatch::default() });
        }
        let depths: Vec<f32> = drawn_depths.iter().map(|drawn| drawn.around(z)).collect();
        let mut touching = step.touching.clone();
        let mut off: Vec<f32> = stack.given.iter().map(|given| given.distance(z, &drawn_at) as f32).collect();
        let mut goes_on = Vec::new();
        for ending in &ending {
            let around = ending.slices.map(|k| slices[k].z);
            if z <= around[0] + same || z >= around[1] - same {
                continue;
            }
            touching.extend(&ending.across);
            // Of a label in several that which it shares with one that it faces.
            let union = |a: usize, faces: &dyn Fn(usize) -> bool| {
                let shared = |members: &&Vec<usize>| members.contains(&a) && members.iter().any(|&b| faces(b));
                unions.iter().find(|(members, ..)| shared(members)).and_then(|(.., patch)| patch.as_ref())
            };
            let at = HeightBetween { z, slices: around, same, far, px };
            for on in ending.goes_on(&at, &mut bodies.alone, &alone, union)? {
                // It is known on both slices: on one it is painted, on the other it is not.
                off[on.label] = around.iter().map(|slice| (slice - z).abs() as f32).fold(off[on.label], f32::min);
                goes_on.push(on);
            }
        }
        goes_on.iter_mut().for_each(|on| std::mem::swap(&mut alone[on.label], &mut on.patch));
        let of = |a: usize| {
            // What is painted is not joined to a union that is interpolated here.
            let known = step.slice.is_some_and(|k| stack.given[a].knows(k));
            let own = unions.iter().filter(|(members, settled, _)| members.contains(&a) && (*settled || !known));
            own.filter_map(|(.., patch)| patch.as_ref()).collect()
        };
        let unions_of = (0..count).map(of).collect();
        // However far a label has drawn back, up to its last contour it has been there.
        let mut been: Vec<&LayerPatch> = alone.iter().collect();
        goes_on.iter().for_each(|on| been[on.label] = &on.contour);
        let layers = Layers {
            dims,
            alone: &alone,
            been,
            unions: unions_of,
            touching: &touching,
            parting: &step.parting,
            ranks: &ranks,
            reach,
            off: &off,
            alike: are_known_alike(stack, z, same),
            depths: &depths,
        };
        let parted = layers.part();
        // What a label has beyond its last slice was a gap where no other had it.
        let mut gap = parted.gap;
        for GoesOn { label: a, .. } in &goes_on {
            let before = |b: usize| goes_on.iter().find(|on| on.label == b).map_or(&alone[b], |on| &on.patch);
            let rows = alone[*a].rows(dims[0]);
            let inside = rows.flat_map(|(start, row)| (start..).zip(row)).filter(|(_, phi)| **phi < 0.0);
            for (n, _) in inside.filter(|(n, _)| parted.labels[*n] as usize == a + 1) {
                let had = |b: usize| before(b).at([n % dims[0], n / dims[0]]).is_some_and(|phi| phi < 0.0);
                if !had(*a) {
                    decided.changed[*a] = true;
                    gap += u64::from(!(0..count).any(had));
                }
            }
        }
        if parted.twice > 0 {
            let message = format!("{} voxels have two labels at height {z}", parted.twice);
            return Err(Error::Numerics { stage: "labels", message });
        }
        if let Some(k) = step.slice {
            let differs = |(is, drawn): &(&u32, &u32)| is != drawn;
            for (&is, &drawn) in parted.labels.iter().zip(&stack.drawn[k]).filter(differs) {
                // A label may be where nothing is painted on a slice that says nothing of it.
                let known = |l: u32| drawn > 0 || stack.given[l as usize - 1].knows(k);
                [is, drawn]
                    .into_iter()
                    .filter(|l| *l > 0 && known(*l))
                    .for_each(|l| decided.differing[l as usize - 1] += 1);
            }
        }
        for (a, body) in decided.bodies.iter_mut().enumerate() {
            decided.changed[a] |= parted.changed[a];
            let contour = bodies.alone[a].contour(z, same);
            let layer = Layer { z, phi: SparseImage::default(), output: step.output, contour };
            body.push(&layer, !step.shown, &parted.fields[a])?;
        }
        if step.output {
            decided.borders.overlap_voxels += parted.overlap;
            decided.borders.gap_voxels += gap;
        }
    }
    if let Some(a) = decided.differing.iter().position(|n| *n > 0) {
        let message = format!("label {}: {} drawn pixels differ", stack.labels[a], decided.differing[a]);
        return Err(Error::Numerics { stage: "labels", message });
    }
    let known = |step: &Step| stack.given.iter().map(|given| step.slice.is_some_and(|k| given.knows(k))).collect();
    let of = |step: &Step| DecidedStep { z: step.z, node: step.node, shown: step.shown, known: known(step) };
    let decided_steps: Vec<DecidedStep> = steps.all.iter().map(of).collect();
    let floating = FloatingPieces { dims, steps: &decided_steps, same, ranks: &ranks };
    let given = floating.give_away(&mut decided.changed, &mut bodies.alone, &mut decided.bodies)?;
    decided.borders.floating_pixels = given.pixels;
    for (body, pieces) in decided.bodies.iter_mut().zip(given.floating) {
        if let Some(pieces) = pieces {
            body.report.body.floating = pieces;
            body.report.judge();
        }
    }
    for (k, step) in steps.all.iter().enumerate().filter(|(_, step)| step.output) {
        let mut labels = vec![0.0; dims[0] * dims[1]];
        for single in stack.singles.iter().filter(|single| step.slice == Some(single.slice)) {
            single.pixels.iter().for_each(|n| labels[*n] = single.label as f32);
        }
        for (a, body) in decided.bodies.iter_mut().enumerate() {
            let patch = body.patch(k)?;
            for (start, row) in patch.rows(dims[0]) {
                let inside = labels[start..].iter_mut().zip(row).filter(|(label, phi)| **phi < 0.0 && **label == 0.0);
                inside.for_each(|(label, _)| {
                    *label = stack.labels[a] as f32;
                    decided.voxels[a] += 1;
                });
            }
        }
        let phi = SparseImage::of(dims, &labels);
        volume.layer(Layer { z: step.z, phi, output: true, contour: step.slice })?;
    }
    // A label that no other has changed stays what it was, layer by layer; another may go on beyond its own ends.
    for (a, alone) in bodies.alone.into_iter().enumerate() {
        if decided.changed[a] {
            decided.bodies[a].end_where_it_is()?;
        } else {
            decided.bodies[a] = alone;
        }
    }
    decided.borders.changed_labels = decided.changed.iter().filter(|c| **c).count();
    decided.borders.unions = bodies.unions.iter().map(|(m, _)| m.iter().map(|&a| stack.labels[a]).collect()).collect();
    Ok(decided)
}

/// Heights of the slices on which a label is painted, and how deep it is there.
struct DrawnDepths(Vec<(f64, f32)>);

impl DrawnDepths {
    /// The depth on the nearest of them below and above a height, of that where it is deeper.
    fn around(&self, z: f64) -> f32 {
        let above = self.0.partition_point(|(slice, _)| *slice < z);
        let near = self.0.iter().take(above + 1).skip(above.saturating_sub(1));
        near.map(|(_, depth)| *depth).reduce(f32::max).unwrap_or(f32::INFINITY)
    }
}

/// Whether all labels that are known on slices below and above a height are so on the same: a union is known on those of all of its labels.
fn are_known_alike(stack: &LabelStack, z: f64, same: f64) -> bool {
    let around = |given: &Given| {
        let above = given.slices.partition_point(|k| stack.stack.slices[*k].z < z - same);
        Some([*given.slices.get(above.checked_sub(1)?)?, *given.slices.get(above)?])
    };
    let mut around = stack.given.iter().filter_map(around);
    let first = around.next();
    around.all(|other| Some(other) == first)
}

/// Length of a pixel's larger side.
fn pixel(stack: &ContourStack) -> f32 {
    stack.spacing[0].max(stack.spacing[1]) as f32
}

/// A height at which all labels are decided.
#[derive(Debug)]
struct Step {
    z: f64,
    output: bool,
    /// Whether it is a node of all slices, or one of these.
    node: bool,
    /// Whether writers get it, of a label that others change.
    shown: bool,
    /// The drawn slice at this height.
    slice: Option<usize>,
    touching: BTreeSet<LabelPair>,
    /// Labels that touch on one of the slices around.
    parting: BTreeSet<LabelPair>,
}

/// What there is at a height.
#[derive(Debug, Clone, Copy, PartialEq)]
enum StepOf {
    Node,
    Output,
    Label,
}

#[derive(Debug)]
struct Steps {
    all: Vec<Step>,
}

impl Steps {
    /// Every height at which there is an output layer, a drawn slice, a node of all slices or a layer of some label.
    fn new(stack: &LabelStack, output: &[f64], bodies: &Bodies, same: f64) -> Self {
        let slices: Vec<f64> = stack.stack.slices.iter().map(|s| s.z).collect();
        let mut heights: Vec<(f64, StepOf)> = nodes(&slices).into_iter().map(|z| (z, StepOf::Node)).collect();
        heights.extend(output.iter().map(|&z| (z, StepOf::Output)));
        heights.extend(bodies.alone.iter().flat_map(|body| body.shown().map(|z| (z, StepOf::Label))));
        heights.sort_by(|a, b| a.0.total_cmp(&b.0));
        let contacts = stack.contacts();
        let at = |group: &[(f64, StepOf)]| {
            let z = group[0].0;
            let above = slices.partition_point(|s| *s < z - same);
            let slice = slices.get(above).filter(|s| **s <= z + same).map(|_| above);
            let [touching, parting] = contacts.around(above, slice);
            let z = slice.map_or(z, |k| slices[k]);
            let has = |of: StepOf| group.iter().any(|(_, step)| *step == of);
            let shown = slice.is_some() || has(StepOf::Output) || has(StepOf::Label);
            Step { z, output: has(StepOf::Output), node: has(StepOf::Node), shown, slice, touching, parting }
        };
        let all = heights.chunk_by(|a, b| b.0 - a.0 <= same).map(at).collect();
        Steps { all }
    }
}
