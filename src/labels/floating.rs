//! Pieces of a label that float only since voxels were decided: they go to the labels around them.
//!
//! Alone a label hangs together with its slices ([`crate::connectivity::grounded`]). Where others take what holds a corner of it, the corner is left
//! in the air: a part of a layer that hangs together with none of the label's slices, though it did alone. It gets the label that most of its
//! pixels' edges in the layer lead to, so that all labels together stay what they are, and none where it touches no other.
//!
//! A slice stays as it is for the labels that are known on it. Others are interpolated across it, and float on it as anywhere.
//!
//! The nodes of all slices say first what crumbs float, so that a layer does not depend on which others are asked for: a part of one between two of them is
//! held where it meets a part of theirs that is. Only what still floats among the layers that there are, and beyond the outermost slices, where there are
//! no nodes, goes by these: by those that writers get where they are dense, else by the nodes among them, too.

use super::decide::Rank;
use super::kept::{KeptBody, LayerPatch};
use crate::connectivity::grounded::{CRUMB, held_by};
use crate::connectivity::runs::{DisjointSets, Runs, Side};
use crate::error::Result;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;

/// Layers are dense between two slices of a label where no two are farther apart than such a share of these.
const DENSE: f64 = 1.0 / 3.0;

/// Share of what a label has on its largest layer up to which a part of it is a crumb, where that is more than [`CRUMB`] pixels: nodes may miss what hangs
/// together in a thin wall that leans, of which a part is much of a layer.
const CRUMBS: usize = 10;

/// What a piece is given to may float itself: that is looked at again, so many times.
const ROUNDS: usize = 8;

/// A step of [`super::decide`], as far as it counts here.
pub(super) struct DecidedStep {
    /// Height.
    pub z: f64,
    /// Whether it is a node of all slices, or one of these.
    pub node: bool,
    /// Whether writers get it.
    pub shown: bool,
    /// For each label whether it is known here, on a drawn slice: nothing of it comes or goes.
    pub known: Vec<bool>,
}

/// Labels whose layers were decided, step by step.
pub(super) struct FloatingPieces<'c> {
    pub dims: [usize; 2],
    pub steps: &'c [DecidedStep],
    /// Heights within this are one.
    pub same: f64,
    pub ranks: &'c [Rank],
}

/// What was found of the pieces in the air.
pub(super) struct GivenAway {
    /// Pixels that went to other labels, or to none.
    pub pixels: u64,
    /// For each label that was looked at how many pieces of it touch no slice of it in the end.
    pub floating: Vec<Option<usize>>,
}

/// Layers that say what hangs together.
#[derive(Clone, Copy, PartialEq)]
enum Holding {
    /// Nodes, whatever the other layers are, and crumbs alone.
    Nodes,
    /// Those that there are, and all that floats.
    Layers,
}

/// What floats of a label.
struct InTheAir {
    /// Parts of its layers that did not float alone: the step, and the pixels.
    parts: Vec<(usize, Vec<[usize; 2]>)>,
    /// Pieces of the body, these and those that floated from the start.
    pieces: usize,
}

impl FloatingPieces<'_> {
    /// Gives away what floats of the labels that are `changed`, `alone` as they were before.
    pub fn give_away(
        &self,
        changed: &mut [bool],
        alone: &mut [KeptBody],
        decided: &mut [KeptBody],
    ) -> Result<GivenAway> {
        let mut given = GivenAway { pixels: 0, floating: vec![None; changed.len()] };
        for holding in [Holding::Nodes, Holding::Layers] {
            self.give_away_by(holding, changed, alone, decided, &mut given)?;
        }
        Ok(given)
    }

    fn give_away_by(
        &self,
        holding: Holding,
        changed: &mut [bool],
        alone: &mut [KeptBody],
        decided: &mut [KeptBody],
        given: &mut GivenAway,
    ) -> Result<()> {
        let mut open = changed.to_vec();
        // What one is given another may lose again: the order is that of the labels, whatever their numbers.
        let mut order: Vec<usize> = (0..changed.len()).collect();
        order.sort_by_key(|a| self.ranks[*a]);
        // After the last round what floats is only counted.
        for round in 0..=ROUNDS {
            let mut taken = vec![false; changed.len()];
            for &a in order.iter().filter(|a| open[**a]) {
                let InTheAir { parts, pieces } = self.floating(a, holding, &mut alone[a], &mut decided[a])?;
                given.floating[a] = Some(pieces);
                for (k, pixels) in parts.into_iter().filter(|_| round < ROUNDS) {
                    given.pixels += pixels.len() as u64;
                    taken[a] = true;
                    if let Some(b) = self.pass_on(a, k, &pixels, decided)? {
                        (taken[b], changed[b]) = (true, true);
                    }
                }
            }
            open = taken;
            if open.iter().all(|open| !open) {
                break;
            }
        }
        Ok(())
    }

    /// What floats of label `a`.
    fn floating(&self, a: usize, holding: Holding, alone: &mut KeptBody, decided: &mut KeptBody) -> Result<InTheAir> {
        let tiles = alone.tiles().chain(decided.tiles()).filter(|tile| !tile.is_empty());
        let tile = tiles.reduce(Tile::joined).unwrap_or(Tile { origin: [0; 2], dims: [1; 2] });
        let (mut before, mut after) = (Vec::new(), Vec::new());
        for (k, step) in self.steps.iter().enumerate() {
            before.push(runs(tile, &alone.at(step.z, self.same)?.unwrap_or_default()));
            after.push(runs(tile, &decided.patch(k)?));
        }
        let contour: Vec<bool> = (0..self.steps.len()).map(|k| decided.contour_of(k).is_some()).collect();
        let looked_at = self.looked_at(holding, &contour);
        let [(held, _), (holds, pieces)] =
            [&before, &after].map(|layers| held_among(layers, &looked_at, &contour, holding));
        let mut parts = Vec::new();
        for (k, runs) in after.iter().enumerate().filter(|(k, _)| !self.steps[*k].known[a]) {
            let mut stays = holds[k].clone();
            // What was in the air from the start was let be.
            runs.meeting(&before[k], |part, old| stays[part] |= !held[k][old]);
            for part in (0..runs.count).filter(|&part| !stays[part]) {
                let pixels = runs.all().filter(|run| run.2 == part);
                let [x, y] = tile.origin;
                parts.push((k, pixels.flat_map(|(j, run, _)| run.map(move |i| [x + i, y + j])).collect()));
            }
        }
        Ok(InTheAir { parts, pieces })
    }

    /// Which steps say what hangs together, of a label whose `contour`s these are.
    fn looked_at(&self, holding: Holding, contour: &[bool]) -> Vec<usize> {
        let steps = 0..self.steps.len();
        if holding == Holding::Nodes {
            return steps.filter(|k| self.steps[*k].node).collect();
        }
        let mut looked_at: Vec<bool> = self.steps.iter().map(|step| step.shown).collect();
        let contours: Vec<usize> = steps.clone().filter(|k| contour[*k]).collect();
        for pair in contours.windows(2) {
            let [low, high] = [pair[0], pair[1]].map(|k| self.steps[k].z);
            let shown: Vec<f64> =
                (pair[0]..=pair[1]).filter(|k| self.steps[*k].shown).map(|k| self.steps[k].z).collect();
            let is_dense = shown.windows(2).all(|pair| pair[1] - pair[0] <= DENSE * (high - low) + self.same);
            if !is_dense {
                looked_at[pair[0]..=pair[1]].fill(true);
            }
        }
        steps.filter(|k| looked_at[*k]).collect()
    }

    /// Gives pixels of label `a` on layer `k` to the label that most of their edges lead to; returns that label.
    fn pass_on(&self, a: usize, k: usize, pixels: &[[usize; 2]], decided: &mut [KeptBody]) -> Result<Option<usize>> {
        let mut patches = decided.iter_mut().map(|body| body.patch(k)).collect::<Result<Vec<LayerPatch>>>()?;
        let label = |patches: &[LayerPatch], at: [usize; 2]| {
            (0..patches.len()).find(|&b| patches[b].at(at).is_some_and(|phi| phi < 0.0))
        };
        // Edges that lead to each label.
        let mut edges = vec![0; patches.len()];
        for &[i, j] in pixels {
            let beside = [[i.wrapping_sub(1), j], [i + 1, j], [i, j.wrapping_sub(1)], [i, j + 1]];
            for at in beside.into_iter().filter(|at| at[0] < self.dims[0] && at[1] < self.dims[1]) {
                label(&patches, at).into_iter().for_each(|b| edges[b] += 1);
            }
        }
        let covers = |b: usize| pixels.iter().all(|&at| patches[b].at(at).is_some());
        let taker = (0..patches.len())
            .filter(|&b| b != a && edges[b] > 0 && covers(b) && !self.steps[k].known[b])
            .max_by(|&b, &c| edges[b].cmp(&edges[c]).then_with(|| self.ranks[c].cmp(&self.ranks[b])));
        for &at in pixels {
            let depth = patches[a].at(at).unwrap_or_default().abs().max(f32::MIN_POSITIVE);
            patches[a].set(at, depth);
            if let Some(b) = taker {
                patches[b].set(at, -depth);
            }
        }
        for b in [Some(a), taker].into_iter().flatten() {
            decided[b].replace(k, &patches[b])?;
        }
        Ok(taker)
    }
}

/// What lies inside on a layer, on the tile that all layers of a label lie in.
fn runs(tile: Tile, patch: &LayerPatch) -> Runs {
    let mut phi = vec![1.0; tile.dims[0] * tile.dims[1]];
    for (j, row) in patch.phi.chunks_exact(patch.dims[0].max(1)).enumerate() {
        let start = (patch.origin[1] + j - tile.origin[1]) * tile.dims[0] + patch.origin[0] - tile.origin[0];
        phi[start..start + row.len()].copy_from_slice(row);
    }
    Runs::new(&SparseImage::of(tile.dims, &phi), Side::Inside)
}

/// Which parts of the layers hang together with one that is a `contour`, as those say that are `looked_at`, or are let be; how many pieces do not. Beyond
/// these all do, and where nodes say it what is more than a crumb, or hangs together with that.
fn held_among(layers: &[Runs], looked_at: &[usize], contour: &[bool], holding: Holding) -> (Vec<Vec<bool>>, usize) {
    let runs: Vec<&Runs> = looked_at.iter().map(|&k| &layers[k]).collect();
    let largest = runs.iter().map(|runs| runs.sizes().iter().sum::<usize>()).max();
    let crumb = CRUMB.max(largest.unwrap_or(0) / CRUMBS);
    let whole = |runs: &Runs| runs.sizes().into_iter().map(|size| size > crumb).collect::<Vec<bool>>();
    let by_nodes = holding == Holding::Nodes;
    let of = |&k: &usize| match (contour[k], by_nodes) {
        (true, _) => vec![true; layers[k].count],
        (false, true) => whole(&layers[k]),
        (false, false) => vec![false; layers[k].count],
    };
    let (of_looked_at, pieces) = held_of(&runs, &looked_at.iter().map(of).collect::<Vec<_>>());
    let mut held: Vec<Vec<bool>> = layers.iter().map(|runs| vec![true; runs.count]).collect();
    for (n, pair) in looked_at.windows(2).enumerate().filter(|_| by_nodes) {
        let around = [n, n + 1].map(|n| (runs[n], &of_looked_at[n][..]));
        for k in pair[0] + 1..pair[1] {
            let touching = held_by(&layers[k], around, 0, Side::Inside);
            held[k] = touching.into_iter().zip(whole(&layers[k])).map(|(held, whole)| held || whole).collect();
        }
    }
    looked_at.iter().zip(of_looked_at).for_each(|(&k, of_one)| held[k] = of_one);
    (held, pieces)
}

/// Which parts of layers hang together with one of those that are `ground`, and how many pieces do not.
fn held_of(layers: &[&Runs], ground: &[Vec<bool>]) -> (Vec<Vec<bool>>, usize) {
    let mut first = vec![0];
    layers.iter().for_each(|runs| first.push(first[first.len() - 1] + runs.count));
    // The last thing is the ground.
    let all = first[layers.len()];
    let mut joined = DisjointSets::new(all + 1);
    for (k, runs) in layers.iter().enumerate() {
        (0..runs.count).filter(|part| ground[k][*part]).for_each(|part| joined.join(first[k] + part, all));
        if let Some(above) = layers.get(k + 1) {
            runs.meeting(above, |a, b| joined.join(first[k] + a, first[k + 1] + b));
        }
    }
    let ground = joined.root(all);
    let pieces = (0..all).filter(|&part| joined.root(part) == part && part != ground).count();
    let of = |(k, runs): (usize, &&Runs)| (0..runs.count).map(|part| joined.root(first[k] + part) == ground).collect();
    (layers.iter().enumerate().map(of).collect(), pieces)
}

#[cfg(test)]
mod tests {
    use std::cmp::Reverse;

    use super::*;
    use crate::surface::Layer;

    const N: usize = 12;

    /// A body on three layers, of which the outer ones are contours: inside where `inside` says so.
    fn body(inside: impl Fn(usize, [usize; 2]) -> bool) -> Result<KeptBody> {
        let mut body = KeptBody::new(&std::env::temp_dir(), 9.0, [N; 2], [0; 2])?;
        for k in 0..3 {
            let phi = (0..N * N).map(|n| if inside(k, [n % N, n / N]) { -0.5 } else { 0.5 }).collect();
            let contour = (k != 1).then_some(k / 2);
            let layer = Layer { z: k as f64, phi: SparseImage::default(), output: true, contour };
            body.push(&layer, false, &LayerPatch { origin: [0; 2], dims: [N; 2], phi })?;
        }
        Ok(body)
    }

    /// The outer ones of three steps are drawn slices of every label, all are nodes.
    fn steps() -> [DecidedStep; 3] {
        [0, 1, 2].map(|k| DecidedStep { z: f64::from(k), node: true, shown: true, known: vec![k != 1; 2] })
    }

    /// Pixels inside on the middle layer.
    fn middle(body: &mut KeptBody) -> Result<Vec<[usize; 2]>> {
        let patch = body.patch(1)?;
        let all = (0..N * N).map(|n| [n % N, n / N]);
        Ok(all.filter(|at| patch.at(*at).is_some_and(|phi| phi < 0.0)).collect())
    }

    #[test]
    fn a_piece_goes_to_the_label_that_it_touches_most() -> Result<()> {
        let column = |[i, j]: [usize; 2]| i < 3 && j < 3;
        let within = |[i, j]: [usize; 2]| i == 6 && (5..7).contains(&j);
        let lone = |at: [usize; 2]| at == [10, 2];
        // One edge of four leads to the block.
        let rim = |at: [usize; 2]| at == [9, 6];
        let block = |[i, j]: [usize; 2]| (4..9).contains(&i) && (4..9).contains(&j);
        // Alone all pieces hang on a bridge, which the decision has taken.
        let bridge = |[_, j]: [usize; 2]| j < 7;
        let mut alone = [body(|k, at| if k == 1 { bridge(at) } else { column(at) })?, body(|_, at| block(at))?];
        let mut decided = [
            body(|k, at| column(at) || k == 1 && (within(at) || lone(at) || rim(at)))?,
            body(|k, at| block(at) && !(k == 1 && within(at)))?,
        ];
        let steps = steps();
        let ranks = [(Reverse(9), 0), (Reverse(25), 52)];
        let pieces = FloatingPieces { dims: [N; 2], steps: &steps, same: 1e-6, ranks: &ranks };
        let mut changed = [true, false];
        let given = pieces.give_away(&mut changed, &mut alone, &mut decided)?;
        assert_eq!((given.pixels, &given.floating[..]), (4, &[Some(0); 2][..]));
        assert_eq!(changed, [true, true]);
        let all = || (0..N * N).map(|n| [n % N, n / N]);
        assert_eq!(middle(&mut decided[0])?, all().filter(|at| column(*at)).collect::<Vec<_>>());
        assert_eq!(middle(&mut decided[1])?, all().filter(|at| block(*at) || rim(*at)).collect::<Vec<_>>());
        Ok(())
    }

    #[test]
    fn what_was_in_the_air_alone_is_let_be() -> Result<()> {
        let column = |[i, j]: [usize; 2]| i < 3 && j < 3;
        let of = || body(|k, at| column(at) || k == 1 && at == [8, 8]);
        let (mut alone, mut decided) = ([of()?], [of()?]);
        let steps = steps();
        let pieces = FloatingPieces { dims: [N; 2], steps: &steps, same: 1e-6, ranks: &[(Reverse(9), 0)] };
        let given = pieces.give_away(&mut [true], &mut alone, &mut decided)?;
        assert_eq!((given.pixels, given.floating), (0, vec![Some(1)]), "and it is counted");
        assert!(middle(&mut decided[0])?.contains(&[8, 8]));
        Ok(())
    }

    #[test]
    fn a_piece_on_a_slice_of_others_floats_too_and_goes_to_none_that_is_known_there() -> Result<()> {
        let column = |[i, j]: [usize; 2]| i < 3 && j < 3;
        let beside = |at: [usize; 2]| at == [6, 6];
        // What is left of a bridge by two labels, of which one is painted on the middle layer.
        let bridge = |[_, j]: [usize; 2]| j < 7;
        let block = |[i, j]: [usize; 2]| (4..9).contains(&i) && (7..11).contains(&j);
        let of = |k: usize, at: [usize; 2]| column(at) || k == 1 && beside(at);
        for known in [true, false] {
            let mut alone = [body(|k, at| if k == 1 { bridge(at) } else { column(at) })?, body(|_, at| block(at))?];
            let mut decided = [body(of)?, body(|_, at| block(at))?];
            let mut steps = steps();
            steps[1].known = vec![false, known];
            let ranks = [(Reverse(9), 0), (Reverse(20), 88)];
            let pieces = FloatingPieces { dims: [N; 2], steps: &steps, same: 1e-6, ranks: &ranks };
            let given = pieces.give_away(&mut [true, false], &mut alone, &mut decided)?;
            assert_eq!((given.pixels, given.floating[0]), (1, Some(0)));
            assert!(!middle(&mut decided[0])?.contains(&[6, 6]));
            assert_eq!(middle(&mut decided[1])?.contains(&[6, 6]), !known, "{known}");
        }
        Ok(())
    }
}
