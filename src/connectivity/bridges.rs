//! Bridges: a piece of matter too large for a crumb that floats among the layers at hand is joined to what does not.
//!
//! A thin part that moves by more than its own width from layer to layer is one body that its layers do not show as one: the shortest way from the
//! piece, in a layer of its own and through at most [`CRUMB`] pixels, to what hangs together with a contour becomes part of the body. A piece from
//! which there is no such way belongs to nothing and goes, whatever its size. Between contours of which links keep parts apart neither is done.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;

use crate::connectivity::grounded::{CRUMB, GROUND, pieces, turn};
use crate::connectivity::runs::{Runs, Side};
use crate::grid::sparse_image::SparseImage;

/// Joins what floats in the layers of an interval, from contour to contour, to what does not, by ways on these columns and rows, or takes it out.
/// Parts that do not `stay` count as outside.
pub fn join(layers: &mut [&mut SparseImage<f32>], all: &[Runs], stays: &[Vec<bool>], image: &[Range<usize>; 2]) {
    let Some([nx, ny]) = layers.first().map(|layer| layer.dims()) else { return };
    let mut numbers = pieces(all, Some(stays), nx, Side::Inside);
    let boxes = boxes(all, &numbers);
    let mut floating: BTreeSet<usize> = boxes.keys().copied().collect();
    let mut bridges: Vec<Vec<[usize; 2]>> = vec![Vec::new(); all.len()];
    // What was joined may be the ground of another piece.
    loop {
        let before = floating.len();
        floating.retain(|piece| {
            // No way goes farther, and its pixels are asked for their neighbours.
            let around = |a: usize, end: usize| {
                let [low, high] = boxes[piece].map(|corner| corner[a]);
                low.saturating_sub(CRUMB + 1)..(high + CRUMB + 2).min(end)
            };
            let view = View::new(all, &numbers, &bridges, *piece, [around(0, nx), around(1, ny)]);
            let ways = (1..all.len() - 1).filter_map(|k| Some((k, view.way(k, image)?)));
            // Of ways as short as each other that through the least depth: the first would be another upside down.
            let depth = |k: usize, way: &[[usize; 2]]| way.iter().map(|[i, j]| layers[k].at(*i, *j).abs()).sum::<f32>();
            let ways = ways.map(|(k, way)| (way.len(), depth(k, &way), k, way));
            let Some((.., k, way)) = ways.min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))) else { return true };
            for &[i, j] in &way {
                layers[k][j * nx + i] = -layers[k].at(i, j);
            }
            bridges[k].extend(way);
            let joined = |at: &mut Option<usize>| *at = if *at == Some(*piece) { Some(GROUND) } else { *at };
            numbers.iter_mut().flatten().for_each(joined);
            false
        });
        if floating.len() == before {
            break;
        }
    }
    for ((layer, runs), numbers) in layers.iter_mut().zip(all).zip(&numbers) {
        let stays: Vec<bool> = numbers.iter().map(|at| at.is_none_or(|piece| !floating.contains(&piece))).collect();
        turn(layer, runs, &stays);
    }
}

/// First and last column and row of every piece but the ground.
fn boxes(all: &[Runs], numbers: &[Vec<Option<usize>>]) -> BTreeMap<usize, [[usize; 2]; 2]> {
    let mut boxes = BTreeMap::new();
    for (runs, numbers) in all.iter().zip(numbers) {
        for (j, run, part) in runs.all() {
            let Some(piece) = numbers[part].filter(|piece| *piece != GROUND) else { continue };
            let [low, high] = boxes.entry(piece).or_insert([[usize::MAX; 2], [0; 2]]);
            *low = [low[0].min(run.start), low[1].min(j)];
            *high = [high[0].max(run.end - 1), high[1].max(j)];
        }
    }
    boxes
}

/// What a pixel is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pixel {
    Outside,
    /// Of the piece that is looked at.
    Own,
    /// Of what hangs together with a contour.
    Ground,
    /// Of another piece.
    Other,
}

/// The layers around a piece.
struct View {
    columns: Range<usize>,
    rows: Range<usize>,
    layers: Vec<Vec<Pixel>>,
}

impl View {
    fn new(
        all: &[Runs],
        numbers: &[Vec<Option<usize>>],
        bridges: &[Vec<[usize; 2]>],
        piece: usize,
        [columns, rows]: [Range<usize>; 2],
    ) -> Self {
        let width = columns.len();
        let layer = |k: usize| {
            let mut pixels = vec![Pixel::Outside; width * rows.len()];
            for (j, run, part) in all[k].all().filter(|(j, ..)| rows.contains(j)) {
                let [first, end] = [run.start, run.end].map(|i| i.clamp(columns.start, columns.end) - columns.start);
                let pixel = match numbers[k][part] {
                    None => continue,
                    Some(GROUND) => Pixel::Ground,
                    Some(number) if number == piece => Pixel::Own,
                    Some(_) => Pixel::Other,
                };
                pixels[(j - rows.start) * width..][first..end].fill(pixel);
            }
            for [i, j] in bridges[k].iter().filter(|[i, j]| columns.contains(i) && rows.contains(j)) {
                pixels[(j - rows.start) * width + i - columns.start] = Pixel::Ground;
            }
            pixels
        };
        let layers = (0..all.len()).map(layer).collect();
        View { columns, rows, layers }
    }

    /// The shortest way in layer `k`, over the edges of pixels of the `image`, from the piece to a pixel that touches the ground there or in the layer
    /// below or above: its pixels that are outside, the last of which may.
    fn way(&self, k: usize, image: &[Range<usize>; 2]) -> Option<Vec<[usize; 2]>> {
        let [nx, ny] = [self.columns.len(), self.rows.len()];
        let place = |n: usize| [n % nx + self.columns.start, n / nx + self.rows.start];
        let seen = |n: usize| place(n).iter().zip(image).all(|(at, range)| range.contains(at));
        let grounded = |n: usize| (k - 1..=k + 1).any(|k| self.layers[k][n] == Pixel::Ground);
        // The pixel before each on its way; the piece's own come from themselves.
        let mut before: Vec<Option<usize>> = vec![None; nx * ny];
        let mut open: VecDeque<(usize, usize)> = VecDeque::new();
        for n in (0..nx * ny).filter(|&n| self.layers[k][n] == Pixel::Own) {
            before[n] = Some(n);
            open.push_back((n, 0));
        }
        while let Some((at, steps)) = open.pop_front() {
            if grounded(at) {
                let mut way = Vec::new();
                let mut n = at;
                while let Some(from) = before[n].filter(|from| *from != n) {
                    way.extend((self.layers[k][n] == Pixel::Outside).then(|| place(n)));
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
