//! Sparse images: squares that have one value everywhere take no memory, as distances far from a contour and motion where nothing moves.
//!
//! A layer of the body is one: the squares near its surface have values, those farther away are whole, inside or outside. Work that goes over it square
//! by square follows the contours' length. Values that are read have the very bits that were stored.

mod construction;

use std::ops::{Index, IndexMut, Range};

use bytemuck::Pod;
use glam::DVec2;
use rayon::prelude::*;

use crate::grid::field::{bilinear, cell};

/// Side of a square, px, and its binary logarithm.
pub const SQUARE: usize = 1 << SHIFT;
const SHIFT: usize = 4;
/// Values of a square.
pub const AREA: usize = SQUARE * SQUARE;
/// Values of which whole squares are kept once; what other values whole squares have is kept for each.
const SHARED: usize = 16;

/// Sparse image: values on pixels, row-major, in squares of 16 x 16 px, of which those with one value everywhere are kept once.
#[derive(Debug, Clone, Default)]
pub struct SparseImage<T> {
    dims: [usize; 2],
    columns: usize,
    /// Place of the values of each square, in squares.
    places: Vec<u32>,
    /// Whether a square is whole: it has one and the same value everywhere.
    whole: Vec<bool>,
    /// Square after square, row-major.
    values: Vec<T>,
    /// Values of whole squares that are kept once, and their places.
    shared: Vec<(T, u32)>,
}

impl<T: Pod + Send + Sync> SparseImage<T> {
    /// Pixels of the image.
    pub fn dims(&self) -> [usize; 2] {
        self.dims
    }

    /// Columns and rows of squares.
    pub fn squares(&self) -> [usize; 2] {
        [self.columns, self.dims[1].div_ceil(SQUARE)]
    }

    /// The one value that the square in that column and row of squares has everywhere, if it is whole.
    #[inline]
    pub fn whole(&self, [column, row]: [usize; 2]) -> Option<T> {
        let square = row * self.columns + column;
        self.whole[square].then(|| self.values[self.places[square] as usize * AREA])
    }

    /// The values of a square, row-major; beyond the image's edge they mean nothing.
    #[inline]
    pub fn square(&self, [column, row]: [usize; 2]) -> &[T; AREA] {
        let (squares, _) = self.values.as_chunks::<AREA>();
        &squares[self.places[row * self.columns + column] as usize]
    }

    /// Columns and rows of all squares, row by row.
    pub fn each_square(&self) -> impl Iterator<Item = [usize; 2]> + use<T> {
        let [columns, rows] = self.squares();
        (0..rows).flat_map(move |row| (0..columns).map(move |column| [column, row]))
    }

    /// The rows of a square as far as the image goes.
    pub fn of_square(&self, square: [usize; 2]) -> impl Iterator<Item = &[T]> {
        let [width, height] = self.size_of_square(square);
        self.square(square).chunks_exact(SQUARE).take(height).map(move |row| &row[..width])
    }

    /// Columns and rows of pixels that a square has on the image.
    pub fn size_of_square(&self, square: [usize; 2]) -> [usize; 2] {
        [0, 1].map(|a| SQUARE.min(self.dims[a] - square[a] * SQUARE))
    }

    /// The one value of all pixels in these columns and rows, where the squares they lie in say so.
    pub fn whole_within(&self, columns: &Range<usize>, rows: &Range<usize>) -> Option<T> {
        let squares = |range: &Range<usize>| range.start / SQUARE..range.end.div_ceil(SQUARE);
        let mut found = squares(rows).flat_map(|row| squares(columns).map(move |column| self.whole([column, row])));
        let first = found.next()??;
        found.all(|other| other.is_some_and(|v| same(&v, &first))).then_some(first)
    }

    /// Gives a square one value.
    pub fn set_whole(&mut self, [column, row]: [usize; 2], value: T) {
        let square = row * self.columns + column;
        self.places[square] = self.place_of(value);
        self.whole[square] = true;
    }

    /// The values of a square to be changed, row-major.
    pub fn square_mut(&mut self, [column, row]: [usize; 2]) -> &mut [T; AREA] {
        let square = row * self.columns + column;
        if std::mem::take(&mut self.whole[square]) {
            let copy = *self.square([column, row]);
            self.places[square] = self.append(&copy);
        }
        let (squares, _) = self.values.as_chunks_mut::<AREA>();
        &mut squares[self.places[square] as usize]
    }

    /// Gives back the memory that is kept for squares to come.
    pub fn shrink_to_fit(&mut self) {
        self.values.shrink_to_fit();
    }

    /// Changes every value to what `change` makes of it.
    pub fn map(&mut self, change: impl Fn(T) -> T) {
        self.values.iter_mut().for_each(|v| *v = change(*v));
        self.shared.iter_mut().for_each(|(v, _)| *v = change(*v));
    }

    /// The part of the image that begins at pixel `origin` and has `dims` pixels; `outside` where it lies beyond the image.
    pub fn window(&self, origin: [isize; 2], dims: [usize; 2], outside: T) -> Self {
        let shared: [Range<isize>; 2] = std::array::from_fn(|a| {
            let end = (self.dims[a] as isize - origin[a]).min(dims[a] as isize);
            (-origin[a]).max(0)..end
        });
        let [window] = SparseImage::of_squares(dims, |square, [values]| {
            let [columns, rows]: [Range<isize>; 2] = std::array::from_fn(|a| {
                let first = (square[a] * SQUARE) as isize;
                let end = (first + SQUARE as isize).min(dims[a] as isize);
                first.max(shared[a].start)..end.min(shared[a].end)
            });
            if columns.is_empty() || rows.is_empty() {
                return [Some(outside)];
            }
            let place =
                |range: &Range<isize>, a: usize| (range.start + origin[a]) as usize..(range.end + origin[a]) as usize;
            let covered = |range: &Range<isize>, a: usize| range.len() == SQUARE.min(dims[a] - square[a] * SQUARE);
            if covered(&columns, 0)
                && covered(&rows, 1)
                && let Some(value) = self.whole_within(&place(&columns, 0), &place(&rows, 1))
            {
                return [Some(value)];
            }
            values.fill(outside);
            let from = place(&columns, 0).start;
            let to = columns.start as usize % SQUARE;
            for j in rows {
                let row = &mut values[j as usize % SQUARE * SQUARE..][to..to + columns.len()];
                self.read(from, (j + origin[1]) as usize, row);
            }
            [None]
        });
        window
    }

    /// The value at pixel `(i, j)`.
    #[inline(always)]
    pub fn at(&self, i: usize, j: usize) -> T {
        self.values[self.start(i, j) + (j % SQUARE) * SQUARE + i % SQUARE]
    }

    /// The values at `(i, j)` and to the right, up, and up and to the right of it; `right` and `up` are 1, or 0 where there are none.
    #[inline(always)]
    pub fn corners(&self, i: usize, j: usize, right: usize, up: usize) -> [T; 4] {
        if i % SQUARE + right < SQUARE && j % SQUARE + up < SQUARE {
            let square = self.square([i / SQUARE, j / SQUARE]);
            let at = (j % SQUARE) * SQUARE + i % SQUARE;
            // All four lie in the square: the remainder changes nothing, and spares asking whether they do.
            let above = at + up * SQUARE;
            return [square[at], square[(at + right) % AREA], square[above % AREA], square[(above + right) % AREA]];
        }
        [self.at(i, j), self.at(i + right, j), self.at(i, j + up), self.at(i + right, j + up)]
    }

    /// Values of row `j` from column `first` on.
    pub fn read(&self, first: usize, j: usize, mut out: &mut [T]) {
        let mut i = first;
        while !out.is_empty() {
            let count = (SQUARE - i % SQUARE).min(out.len());
            let (some, rest) = std::mem::take(&mut out).split_at_mut(count);
            let row = self.row_of_square(i / SQUARE, j);
            // A whole row of a square is copied without a call.
            match some.first_chunk_mut::<SQUARE>() {
                Some(to) => *to = *row,
                None => some.copy_from_slice(&row[i % SQUARE..][..count]),
            }
            out = rest;
            i += count;
        }
    }

    /// All values, row-major.
    pub fn unpack(&self) -> Vec<T> {
        let mut out = Vec::new();
        self.unpack_to(&mut out);
        out
    }

    /// The same in an array that is used again and again.
    pub fn unpack_to(&self, out: &mut Vec<T>) {
        let [nx, ny] = self.dims;
        out.resize(nx * ny, T::zeroed());
        out.par_chunks_mut(nx.max(1)).enumerate().for_each(|(j, row)| self.read(0, j, row));
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.dims[0] * self.dims[1]
    }

    /// Whether there is no pixel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The values of all pixels, row-major.
    pub fn iter(&self) -> impl Iterator<Item = &T> + Clone {
        (0..self.dims[1]).flat_map(move |j| {
            let row = (0..self.columns).flat_map(move |column| self.row_of_square(column, j));
            row.take(self.dims[0])
        })
    }

    /// All values that occur.
    pub fn values(&self) -> impl Iterator<Item = T> + '_ {
        self.values.iter().copied()
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.places) + size_of_val(&*self.whole) + size_of_val(&*self.values)
    }

    /// Place of a whole square of that value.
    fn place_of(&mut self, value: T) -> u32 {
        if let Some((_, place)) = self.shared.iter().find(|(known, _)| same(&value, known)) {
            return *place;
        }
        let place = self.append(&[value; AREA]);
        if self.shared.len() < SHARED {
            self.shared.push((value, place));
        }
        place
    }

    /// Adds the values of a square; their place.
    fn append(&mut self, square: &[T]) -> u32 {
        self.values.extend_from_slice(square);
        (self.values.len() / AREA) as u32 - 1
    }

    /// Row `j` of the image in a column of squares.
    #[inline(always)]
    pub fn row_of_square(&self, column: usize, j: usize) -> &[T; SQUARE] {
        let square = self.places[(j >> SHIFT) * self.columns + column] as usize * AREA;
        let (rows, _) = self.values[square..][..AREA].as_chunks::<SQUARE>();
        &rows[j % SQUARE]
    }

    /// Beginning of the square of a pixel.
    #[inline(always)]
    fn start(&self, i: usize, j: usize) -> usize {
        self.places[(j >> SHIFT) * self.columns + (i >> SHIFT)] as usize * AREA
    }
}

/// The value at a pixel, numbered row-major.
impl<T: Pod + Send + Sync> Index<usize> for SparseImage<T> {
    type Output = T;

    fn index(&self, pixel: usize) -> &T {
        let [i, j] = [pixel % self.dims[0], pixel / self.dims[0]];
        &self.row_of_square(i / SQUARE, j)[i % SQUARE]
    }
}

impl<T: Pod + Send + Sync> IndexMut<usize> for SparseImage<T> {
    fn index_mut(&mut self, pixel: usize) -> &mut T {
        let [i, j] = [pixel % self.dims[0], pixel / self.dims[0]];
        &mut self.square_mut([i / SQUARE, j / SQUARE])[j % SQUARE * SQUARE + i % SQUARE]
    }
}

impl<T: Pod + Send + Sync + PartialEq> PartialEq for SparseImage<T> {
    fn eq(&self, other: &Self) -> bool {
        self.dims == other.dims && self.iter().eq(other.iter())
    }
}

impl SparseImage<f32> {
    /// Whether any value is not a number.
    pub fn has_nan(&self) -> bool {
        // A square at a time, all of whose values are looked at together.
        self.values.chunks(AREA).any(|square| square.iter().fold(false, |nan, v| nan | v.is_nan()))
    }
}

impl SparseImage<f64> {
    /// Bilinear value at `x`; positions beyond the image read its edge.
    #[inline(always)]
    pub fn sample(&self, x: DVec2) -> f64 {
        let ([i, j], place) = cell(self.dims, x, 0);
        bilinear(self.corners(i, j, 1, 1), place)
    }
}

/// Whether two values have the same bits.
fn same<T: Pod>(a: &T, b: &T) -> bool {
    bytemuck::bytes_of(a) == bytemuck::bytes_of(b)
}

#[cfg(test)]
mod tests;
