//! Nothing floats: what touches neither contour of its interval is not part of the body, be it matter or a void.
//!
//! An interval's nodes ([`NODE_TIMES`](crate::stack::heights::NODE_TIMES)) say which of their parts hang together, from layer to layer, with a contour (a
//! void: with what is outside there, or with the image's edge). A part of a layer between two of them stays if it touches a part of either that does.
//! Any other changes sides if it is a crumb, of at most [`CRUMB`] pixels; a larger one of matter is joined to what stays, a node's to the other nodes and a
//! part between nodes to these ([`super::bridges`]), or goes: a thin part that moves by more than its own width in a quarter of a gap meets itself nowhere
//! and yet is one. So far a layer depends on the stack alone. What still floats once all layers that are made are looked at together, and beyond the ends,
//! where there are no nodes, changes sides if no part of it is more than a crumb; other pieces of matter are joined to what stays, however far that is.

use std::collections::BTreeSet;

use crate::connectivity::runs::{DisjointSets, Runs, Side};
use crate::grid::sparse_image::SparseImage;

/// Most pixels of a crumb: twice the largest that was seen, 6 px of a skull.
pub const CRUMB: usize = 12;

/// Whether each part of a layer is more than a crumb.
pub fn whole(runs: &Runs) -> Vec<bool> {
    runs.sizes().into_iter().map(|size| size > CRUMB).collect()
}

/// Whether parts of each of an interval's layers, from contour to contour, hang together with one of both contours, over parts that are `there` (all
/// where nothing is said).
pub fn grounded(layers: &[Runs], there: Option<&[Vec<bool>]>, nx: usize, side: Side) -> Vec<Vec<bool>> {
    let pieces = pieces(layers, there, nx, side);
    let ground = |piece: Vec<Option<usize>>| piece.into_iter().map(|piece| piece == Some(GROUND)).collect();
    pieces.into_iter().map(ground).collect()
}

/// Number of the piece that consists of what hangs together with a contour.
pub const GROUND: usize = 0;

/// Numbers of the pieces to which the parts of an interval's layers, from contour to contour, belong, over parts that are `there` (all where nothing
/// is said); none for the others.
pub fn pieces(layers: &[Runs], there: Option<&[Vec<bool>]>, nx: usize, side: Side) -> Vec<Vec<Option<usize>>> {
    let there = |k: usize, part: usize| there.is_none_or(|there| there[k][part]);
    let mut first = Vec::with_capacity(layers.len());
    // The first thing is the ground; the lowest of those that are joined stands for them.
    let mut count = GROUND + 1;
    for runs in layers {
        first.push(count);
        count += runs.count;
    }
    let mut joined = DisjointSets::new(count);
    for (k, runs) in layers.iter().enumerate() {
        if k == 0 || k + 1 == layers.len() {
            (0..runs.count).for_each(|part| joined.join(first[k] + part, GROUND));
        } else if side == Side::Outside {
            runs.at_edge(nx).for_each(|part| joined.join(first[k] + part, GROUND));
        }
        if let Some(above) = layers.get(k + 1) {
            runs.meeting(above, |a, b| {
                if there(k, a) && there(k + 1, b) {
                    joined.join(first[k] + a, first[k + 1] + b);
                }
            });
        }
    }
    let of = |(k, runs): (usize, &Runs)| {
        (0..runs.count).map(|part| there(k, part).then(|| joined.root(first[k] + part))).collect()
    };
    layers.iter().enumerate().map(of).collect()
}

/// Parts of an interval's layers that hang together with one of both contours, or belong to a piece of which a part is more than a crumb.
pub fn without_crumbs(layers: &[Runs], nx: usize) -> Vec<Vec<bool>> {
    let pieces = pieces(layers, None, nx, Side::Inside);
    let mut large = BTreeSet::from([GROUND]);
    for (pieces, runs) in pieces.iter().zip(layers).filter(|(pieces, _)| pieces.iter().any(|p| *p != Some(GROUND))) {
        large.extend(pieces.iter().zip(whole(runs)).filter(|(_, whole)| *whole).filter_map(|(piece, _)| *piece));
    }
    let stays = |piece: Option<usize>| piece.is_some_and(|piece| large.contains(&piece));
    pieces.into_iter().map(|pieces| pieces.into_iter().map(stays).collect()).collect()
}

/// Whether parts of a layer touch a part that stays of one of the layers around it.
pub fn held_by(runs: &Runs, around: [(&Runs, &[bool]); 2], nx: usize, side: Side) -> Vec<bool> {
    let mut held = vec![false; runs.count];
    for (other, stays) in around {
        runs.meeting(other, |own, there| held[own] |= stays[there]);
    }
    if side == Side::Outside {
        runs.at_edge(nx).for_each(|part| held[part] = true);
    }
    held
}

/// Puts the parts of a layer that do not stay on the other side; how many pixels that are.
pub fn turn(phi: &mut SparseImage<f32>, runs: &Runs, stays: &[bool]) -> usize {
    if stays.iter().all(|s| *s) {
        return 0;
    }
    let (mut turned, nx) = (0, phi.dims()[0]);
    for (j, columns, _) in runs.all().filter(|run| !stays[run.2]) {
        turned += columns.len();
        columns.for_each(|i| phi[j * nx + i] = -phi.at(i, j));
    }
    turned
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 9;

    fn layer(inside: &[[usize; 2]]) -> SparseImage<f32> {
        let phi = (0..N * N).map(|n| if inside.contains(&[n % N, n / N]) { -0.5 } else { 0.5 });
        SparseImage::of([N; 2], &phi.collect::<Vec<_>>())
    }

    #[test]
    fn what_hangs_on_a_contour_stays_and_what_floats_does_not() {
        // A stair from the lower contour, and a piece in the air.
        let layers = [layer(&[[1, 1]]), layer(&[[1, 1], [2, 1], [6, 6]]), layer(&[[2, 1], [6, 6]]), layer(&[])];
        let runs: Vec<Runs> = layers.iter().map(|l| Runs::new(l, Side::Inside)).collect();
        let stays = grounded(&runs, None, N, Side::Inside);
        assert_eq!(stays, [vec![true], vec![true, false], vec![true, false], vec![]]);
        let mut repaired = layers[1].clone();
        assert_eq!(turn(&mut repaired, &runs[1], &stays[1]), 1);
        assert_eq!(repaired, layer(&[[1, 1], [2, 1]]));
        // Between both, what touches neither stair goes.
        let between = Runs::new(&layer(&[[1, 1], [6, 6], [4, 4]]), Side::Inside);
        let around = [1, 2].map(|k| (&runs[k], stays[k].as_slice()));
        assert_eq!(held_by(&between, around, N, Side::Inside), [true, false, false]);
    }

    #[test]
    fn a_notch_in_the_images_edge_is_no_bubble() {
        let block: Vec<[usize; 2]> = (0..N * N).map(|n| [n % N, n / N]).collect();
        let without =
            |holes: &[[usize; 2]]| layer(&block.iter().filter(|p| !holes.contains(p)).copied().collect::<Vec<_>>());
        let layers = [without(&[]), without(&[[4, 0], [2, 2], [0, 5], [8, 7], [6, 8]]), without(&[])];
        let runs: Vec<Runs> = layers.iter().map(|l| Runs::new(l, Side::Outside)).collect();
        assert_eq!(grounded(&runs, None, N, Side::Outside)[1], [true, false, true, true, true]);
    }

    #[test]
    fn a_void_stays_where_it_opens_to_a_contour_or_to_the_edge() {
        let block: Vec<[usize; 2]> = (1..8).flat_map(|j| (1..8).map(move |i| [i, j])).collect();
        let without =
            |holes: &[[usize; 2]]| layer(&block.iter().filter(|p| !holes.contains(p)).copied().collect::<Vec<_>>());
        let layers = [without(&[[2, 2]]), without(&[[2, 3], [5, 5]]), without(&[])];
        let runs: Vec<Runs> = layers.iter().map(|l| Runs::new(l, Side::Outside)).collect();
        // Around the block; a hole that opens through a face's diagonal to that of the contour; a bubble.
        let stays = grounded(&runs, None, N, Side::Outside);
        assert_eq!(stays[1], [true, true, false]);
        let mut repaired = layers[1].clone();
        assert_eq!(turn(&mut repaired, &runs[1], &stays[1]), 1);
        assert_eq!(repaired, without(&[[2, 3]]));
    }
}
