//! Bridges: a piece of matter too large for a crumb that floats among the layers at hand is joined to what does not.
//!
//! A thin part that moves by more than its own width from layer to layer is one body that its layers do not show as one: the shortest way from the
//! piece, in a layer of its own and through at most [`CRUMB`] pixels, to what hangs together with a contour becomes part of the body. A piece from
//! which there is no such way belongs to nothing and goes, whatever its size.

use std::collections::VecDeque;
use std::ops::Range;

use crate::connectivity::grounded::{CRUMB, GROUND, pieces};
use crate::connectivity::runs::{Runs, Side};
use crate::grid::sparse_image::SparseImage;

/// What a pixel of a layer is: of no piece, or of the piece of that number.
type Pieces = Vec<Option<usize>>;

/// Joins what floats in the layers of an interval, from contour to contour, to what does not, by ways on these columns and rows, or takes it out.
/// Parts that do not `stay` count as outside.
pub fn join(
    layers: &mut [&mut SparseImage<f32>],
    all: &[Runs],
    stays: &[Vec<bool>],
    [columns, rows]: &[Range<usize>; 2],
) {
    let Some(dims) = layers.first().map(|layer| layer.dims()) else { return };
    let numbers = pieces(all, Some(stays), dims[0], Side::Inside);
    let mut floating: Vec<usize> = numbers.iter().flatten().flatten().copied().filter(|n| *n != GROUND).collect();
    floating.sort_unstable();
    floating.dedup();
    if floating.is_empty() {
        return;
    }
    let of = |(runs, numbers): (&Runs, &Vec<Option<usize>>)| {
        let mut piece: Pieces = vec![None; dims[0] * dims[1]];
        runs.all().for_each(|(j, run, part)| piece[j * dims[0]..][run].fill(numbers[part]));
        piece
    };
    let mut all: Vec<Pieces> = all.iter().zip(&numbers).map(of).collect();
    let seen = |n: usize| columns.contains(&(n % dims[0])) && rows.contains(&(n / dims[0]));
    // What was joined may be the ground of another piece.
    loop {
        let before = floating.len();
        floating.retain(|&piece| {
            let own = |k: &usize| all[*k].contains(&Some(piece));
            let ways = (1..all.len() - 1).filter(own).filter_map(|k| Some((k, way(&all, k, piece, dims, seen)?)));
            let Some((k, way)) = ways.min_by_key(|(_, way)| way.len()) else { return true };
            for n in way {
                layers[k][n] = -layers[k].at(n % dims[0], n / dims[0]);
                all[k][n] = Some(piece);
            }
            let now = |at: &mut Option<usize>| *at = if *at == Some(piece) { Some(GROUND) } else { *at };
            all.iter_mut().flatten().for_each(now);
            false
        });
        if floating.len() == before {
            break;
        }
    }
    for (layer, piece) in layers.iter_mut().zip(&all) {
        let gone = |at: &Option<usize>| at.is_some_and(|at| floating.binary_search(&at).is_ok());
        for n in (0..piece.len()).filter(|&n| gone(&piece[n])) {
            layer[n] = -layer.at(n % dims[0], n / dims[0]);
        }
    }
}

/// The shortest way in layer `k`, over the edges of pixels that are `seen`, from a piece to one that touches the ground there or in the layer below or
/// above: the pixels that are of no piece, the last of which may.
fn way(
    all: &[Pieces],
    k: usize,
    piece: usize,
    [nx, ny]: [usize; 2],
    seen: impl Fn(usize) -> bool,
) -> Option<Vec<usize>> {
    let grounded = |n: usize| (k - 1..=k + 1).any(|k| all[k][n] == Some(GROUND));
    // The pixel before each on its way; the piece's own come from themselves.
    let mut before: Vec<Option<usize>> = vec![None; nx * ny];
    let mut open: VecDeque<(usize, usize)> = VecDeque::new();
    for n in (0..nx * ny).filter(|&n| all[k][n] == Some(piece)) {
        before[n] = Some(n);
        open.push_back((n, 0));
    }
    while let Some((at, steps)) = open.pop_front() {
        if grounded(at) {
            let mut way = Vec::new();
            let mut n = at;
            while let Some(from) = before[n].filter(|from| *from != n) {
                way.extend(all[k][n].is_none().then_some(n));
                n = from;
            }
            return Some(way);
        }
        if steps == CRUMB {
            continue;
        }
        let (i, j) = (at % nx, at / nx);
        let west = (i > 0).then(|| at - 1);
        let south = (j > 0).then(|| at - nx);
        let beside = [west, (i + 1 < nx).then_some(at + 1), south, (j + 1 < ny).then_some(at + nx)];
        for n in beside.into_iter().flatten().filter(|&n| seen(n)) {
            if before[n].is_none() {
                before[n] = Some(at);
                open.push_back((n, steps + 1));
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 40;

    fn layer(inside: &[[usize; 2]]) -> SparseImage<f32> {
        let phi = (0..N * N).map(|n| if inside.contains(&[n % N, n / N]) { -0.5 } else { 1.5 });
        SparseImage::of([N; 2], &phi.collect::<Vec<_>>())
    }

    /// A line of 20 pixels.
    fn line(column: usize) -> Vec<[usize; 2]> {
        (10..30).map(|j| [column, j]).collect()
    }

    fn joined(layers: &[Vec<[usize; 2]>], columns: Range<usize>) -> Vec<Vec<[usize; 2]>> {
        let mut layers: Vec<SparseImage<f32>> = layers.iter().map(|inside| layer(inside)).collect();
        let runs: Vec<Runs> = layers.iter().map(|l| Runs::new(l, Side::Inside)).collect();
        let stays: Vec<Vec<bool>> = runs.iter().map(|runs| vec![true; runs.count]).collect();
        join(&mut layers.iter_mut().collect::<Vec<_>>(), &runs, &stays, &[columns, 0..N]);
        let inside = |l: &SparseImage<f32>| {
            let mut inside: Vec<[usize; 2]> = (0..N * N).map(|n| [n % N, n / N]).collect();
            inside.retain(|[i, j]| l.at(*i, *j) < 0.0);
            inside
        };
        layers.iter().map(inside).collect()
    }

    #[test]
    fn a_line_that_moves_by_more_than_its_width_becomes_one() {
        // Of the three between two contours the middle one meets none of both.
        let layers = [5, 5, 8, 11, 11].map(line);
        let mut wanted = layers.clone();
        wanted[2].extend([[6, 10], [7, 10], [5, 10]]);
        let sorted = |mut layer: Vec<[usize; 2]>| {
            layer.sort_by_key(|[i, j]| (*j, *i));
            layer
        };
        assert_eq!(joined(&layers, 0..N), wanted.map(sorted));
    }

    #[test]
    fn what_is_far_from_everything_goes_whatever_its_size() {
        let layers = [line(2), line(2), [line(2), line(20), line(21)].concat(), line(2), line(2)];
        assert_eq!(joined(&layers, 0..N), [0; 5].map(|_| line(2)));
        // Near enough, but for ways that nobody sees.
        let near = [line(2), line(2), [line(2), line(6)].concat(), line(2), line(2)];
        assert_eq!(joined(&near, 0..N)[2].len(), 20 + 20 + 3);
        assert_eq!(joined(&near, 6..N), [0; 5].map(|_| line(2)));
    }

    #[test]
    fn what_was_joined_is_ground_for_others() {
        // Three lines in a row, the last too far from the first.
        let layers = [line(2), line(2), [line(2), line(10), line(18)].concat(), line(2), line(2)];
        let made = joined(&layers, 0..N);
        assert_eq!(made[2].len(), 3 * 20 + 7 + 7);
        assert_eq!(made[1], line(2));
    }
}
