//! Bridges: a piece of matter too large for a crumb that floats among some layers is joined to what does not.
//!
//! A thin part that moves by more than its own width from layer to layer is one body that its layers do not show as one: the shortest way from the
//! piece, in a layer of its own, to what hangs together with a contour becomes part of the body. By the nodes a piece from which there is no way through
//! at most [`CRUMB`] pixels belongs to nothing and goes, whatever its size. What has stayed there stays: among all layers that are made ways are as long as
//! they must be, for whether a piece of a layer is there may not depend on the others. Of several pieces that with the shortest way comes first, and
//! what was joined is ground for the others. Between contours of which links keep parts apart neither is done.

use std::cmp::Ordering;
use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;

use crate::connectivity::grounded::{CRUMB, GROUND, pieces, turn};
use crate::connectivity::runs::{Runs, Side};
use crate::grid::sparse_image::SparseImage;

/// How many times as far ways are looked for where there is none.
const FARTHER: usize = 4;

/// Joins what floats in some layers, from contour to contour, to what does not, by ways on these columns and rows through at most so many pixels, if there
/// is a limit, or takes it out. Parts that do not `stay` count as outside.
pub fn join(
    layers: &mut [&mut SparseImage<f32>],
    all: &[Runs],
    stays: &[Vec<bool>],
    image: &[Range<usize>; 2],
    limit: Option<usize>,
) {
    let Some([nx, ny]) = layers.first().map(|layer| layer.dims()) else { return };
    let most = limit.unwrap_or(nx * ny);
    let mut reach = CRUMB;
    let mut numbers = pieces(all, Some(stays), nx, Side::Inside);
    let boxes = boxes(all, &numbers);
    let mut bridges: Vec<Vec<[usize; 2]>> = vec![Vec::new(); all.len()];
    let way = |piece: usize,
               layers: &[&mut SparseImage<f32>],
               numbers: &[Numbers],
               bridges: &[Vec<[usize; 2]>],
               reach: usize| {
        let columns_and_rows = around(&boxes[&piece], reach, [nx, ny]);
        let view = View::new(all, numbers, bridges, piece, columns_and_rows);
        let ways = (1..all.len() - 1).filter_map(|layer| Some((layer, view.way(layer, image, reach)?)));
        ways.map(|(layer, pixels)| Way::new(layer, pixels, &*layers[layer])).min_by(Way::cmp)
    };
    let mut floating: BTreeMap<usize, Option<Way>> =
        boxes.keys().map(|piece| (*piece, way(*piece, layers, &numbers, &bridges, reach))).collect();
    // The shortest first, as it would be upside down; what was joined may be the ground of another piece.
    loop {
        let ways = floating.iter().filter_map(|(piece, way)| Some((*piece, way.as_ref()?)));
        let Some((piece, _)) = ways.min_by(|a, b| a.1.cmp(b.1)) else {
            if floating.is_empty() || reach >= most.min(nx + ny) {
                break;
            }
            reach = (FARTHER * reach).min(most);
            for (piece, found) in &mut floating {
                *found = way(*piece, layers, &numbers, &bridges, reach);
            }
            continue;
        };
        let Some(Some(found)) = floating.remove(&piece) else { break };
        let mut changed = boxes[&piece];
        for &[i, j] in &found.pixels {
            let node = j * nx + i;
            layers[found.layer][node] = -layers[found.layer].at(i, j);
            extend(&mut changed, [i, j]);
        }
        bridges[found.layer].extend(found.pixels);
        let joined = |at: &mut Option<usize>| *at = if *at == Some(piece) { Some(GROUND) } else { *at };
        numbers.iter_mut().flatten().for_each(joined);
        for (other, found) in &mut floating {
            if meet(&around(&boxes[other], reach, [nx, ny]), &changed) {
                *found = way(*other, layers, &numbers, &bridges, reach);
            }
        }
    }
    for ((layer, runs), numbers) in layers.iter_mut().zip(all).zip(&numbers) {
        let stays: Vec<bool> = numbers.iter().map(|at| at.is_none_or(|piece| !floating.contains_key(&piece))).collect();
        turn(layer, runs, &stays);
    }
}

/// Piece of each part of a layer.
type Numbers = Vec<Option<usize>>;
/// First and last columns and rows of something.
type Corners = [[usize; 2]; 2];

/// A way from a piece to the ground.
struct Way {
    layer: usize,
    pixels: Vec<[usize; 2]>,
    /// Distances that it changes, px.
    depth: f32,
}

impl Way {
    fn new(layer: usize, pixels: Vec<[usize; 2]>, phi: &SparseImage<f32>) -> Self {
        let depth = pixels.iter().map(|[i, j]| phi.at(*i, *j).abs()).sum();
        Way { layer, pixels, depth }
    }

    /// The shorter one is less; of those as short as each other that through the least depth, for the first would be another one upside down.
    fn cmp(&self, other: &Self) -> Ordering {
        self.pixels.len().cmp(&other.pixels.len()).then(self.depth.total_cmp(&other.depth))
    }
}

/// First and last columns and rows of every piece but the ground.
fn boxes(all: &[Runs], numbers: &[Numbers]) -> BTreeMap<usize, Corners> {
    let mut boxes = BTreeMap::new();
    for (runs, numbers) in all.iter().zip(numbers) {
        for (j, run, part) in runs.all() {
            let Some(piece) = numbers[part].filter(|piece| *piece != GROUND) else { continue };
            let corners = boxes.entry(piece).or_insert([[usize::MAX; 2], [0; 2]]);
            extend(corners, [run.start, j]);
            extend(corners, [run.end - 1, j]);
        }
    }
    boxes
}

/// The corners with `at` between them.
fn extend([low, high]: &mut Corners, at: [usize; 2]) {
    *low = [0, 1].map(|a| low[a].min(at[a]));
    *high = [0, 1].map(|a| high[a].max(at[a]));
}

/// Columns and rows that ways of this `reach` from a piece may ask for: none goes farther, and its pixels are asked for their neighbours.
fn around([low, high]: &Corners, reach: usize, dims: [usize; 2]) -> [Range<usize>; 2] {
    [0, 1].map(|a| low[a].saturating_sub(reach + 1)..(high[a] + reach + 2).min(dims[a]))
}

/// Whether something may lie on these columns and rows.
fn meet(around: &[Range<usize>; 2], [low, high]: &Corners) -> bool {
    (0..2).all(|a| low[a] < around[a].end && around[a].start <= high[a])
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
    /// below or above, through at most `reach` pixels: its pixels that are outside, the last of which may.
    fn way(&self, k: usize, image: &[Range<usize>; 2], reach: usize) -> Option<Vec<[usize; 2]>> {
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
            if steps == reach {
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
        joined_by(layers, columns, Some(CRUMB))
    }

    fn joined_by(layers: &[Vec<[usize; 2]>], columns: Range<usize>, limit: Option<usize>) -> Vec<Vec<[usize; 2]>> {
        let mut layers: Vec<SparseImage<f32>> = layers.iter().map(|inside| layer(inside)).collect();
        let runs: Vec<Runs> = layers.iter().map(|l| Runs::new(l, Side::Inside)).collect();
        let stays: Vec<Vec<bool>> = runs.iter().map(|runs| vec![true; runs.count]).collect();
        join(&mut layers.iter_mut().collect::<Vec<_>>(), &runs, &stays, &[columns, 0..N], limit);
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
        let without_limit = joined_by(&layers, 0..N, None);
        assert_eq!(without_limit[2].len(), 3 * 20 + 17, "but for a way that may be as long as it must");
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

    #[test]
    fn the_shortest_way_comes_first_from_either_side() {
        // The piece below is far from the ground, but near the piece above it.
        let layers =
            [vec![2], vec![2, 12], vec![2, 8], vec![2]].map(|columns| columns.into_iter().flat_map(line).collect());
        let turned = [3, 2, 1, 0].map(|k: usize| Vec::clone(&layers[k]));
        let (made, mut back) = (joined(&layers, 0..N), joined(&turned, 0..N));
        back.reverse();
        assert_eq!(made, back);
        assert_eq!([1, 2].map(|k: usize| made[k].len()), [2 * 20 + 4, 2 * 20 + 5]);
    }
}
