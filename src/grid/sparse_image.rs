//! Sparse images: squares that have one value everywhere take no memory, as distances far from a contour and motion where nothing moves.
//!
//! A layer of the body is one: the squares near its surface have values, those farther away are whole, inside or outside. Work that goes over it square
//! by square follows the contours' length. Values that are read have the very bits that were stored.

use std::ops::{Index, IndexMut, Range};

use bytemuck::Pod;
use glam::DVec2;
use rayon::prelude::*;

use crate::grid::field::{Field, bilinear, cell};

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

/// The squares of one row of them.
struct Strip<T> {
    /// The one value of each square, or nothing.
    whole: Vec<Option<T>>,
    /// Values of the others.
    values: Vec<T>,
}

impl<T: Pod + Send + Sync> SparseImage<T> {
    /// Several on an image of `dims` pixels, of which `fill` gives some rows from the first that it is told.
    pub fn of_rows<const N: usize>(dims: [usize; 2], fill: impl Fn(usize, [&mut [T]; N]) + Sync) -> [Self; N] {
        let [nx, ny] = dims;
        let strip = |rows: &mut [Vec<T>; N], first: usize| {
            for rows in rows.iter_mut() {
                rows.clear();
                rows.resize(SQUARE.min(ny - first) * nx, T::zeroed());
            }
            fill(first, rows.each_mut().map(|rows| rows.as_mut_slice()));
            rows.each_ref().map(|rows| Strip::new(rows, nx))
        };
        let firsts: Vec<usize> = (0..ny).step_by(SQUARE).collect();
        let none = || [const { Vec::new() }; N];
        let made: Vec<[Strip<T>; N]> = firsts.into_par_iter().map_init(none, strip).collect();
        let mut strips: [Vec<Strip<T>>; N] = [const { Vec::new() }; N];
        for strip in made {
            strips.iter_mut().zip(strip).for_each(|(strips, strip)| strips.push(strip));
        }
        strips.map(|strips| SparseImage::of_strips(dims, strips))
    }

    /// Several on an image of `dims` pixels. `fill` gives, for the square in that column and row of squares, the one value it has everywhere, or
    /// writes its values, row-major; what it writes beyond the image's edge does not count.
    pub fn of_squares<const N: usize>(
        dims: [usize; 2],
        fill: impl Fn([usize; 2], [&mut [T; AREA]; N]) -> [Option<T>; N] + Sync,
    ) -> [Self; N] {
        let columns = dims[0].div_ceil(SQUARE);
        let strip = |row: usize| {
            let mut strips = [const { Strip { whole: Vec::new(), values: Vec::new() } }; N];
            let mut squares = [[T::zeroed(); AREA]; N];
            for column in 0..columns {
                let whole = fill([column, row], squares.each_mut());
                for ((strip, whole), square) in strips.iter_mut().zip(whole).zip(&squares) {
                    strip.push(whole, square, [column, row], dims);
                }
            }
            strips
        };
        let made: Vec<[Strip<T>; N]> = (0..dims[1].div_ceil(SQUARE)).into_par_iter().map(strip).collect();
        let mut strips: [Vec<Strip<T>>; N] = [const { Vec::new() }; N];
        for strip in made {
            strips.iter_mut().zip(strip).for_each(|(strips, strip)| strips.push(strip));
        }
        strips.map(|strips| SparseImage::of_strips(dims, strips))
    }

    /// One whose squares come one after the other, row by row, each as in [`SparseImage::of_squares`].
    ///
    /// # Errors
    /// The first of `next`; until then no more memory is taken than for the squares that have come.
    pub fn read_squares<E>(
        dims: [usize; 2],
        mut next: impl FnMut([usize; 2], &mut [T; AREA]) -> std::result::Result<Option<T>, E>,
    ) -> std::result::Result<Self, E> {
        let [columns, rows] = dims.map(|n| n.div_ceil(SQUARE));
        let mut packed = SparseImage {
            dims,
            columns,
            places: Vec::new(),
            whole: Vec::new(),
            values: Vec::new(),
            shared: Vec::new(),
        };
        let mut values = [T::zeroed(); AREA];
        for square in (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row])) {
            let whole = next(square, &mut values)?;
            let place = match whole {
                Some(value) => packed.place_of(value),
                None => packed.append(&values),
            };
            packed.places.push(place);
            packed.whole.push(whole.is_some());
        }
        Ok(packed)
    }

    /// One value everywhere.
    pub fn filled(dims: [usize; 2], value: T) -> Self {
        let [columns, rows] = dims.map(|n| n.div_ceil(SQUARE));
        SparseImage {
            dims,
            columns,
            places: vec![0; columns * rows],
            whole: vec![true; columns * rows],
            values: vec![value; AREA],
            shared: vec![(value, 0)],
        }
    }

    fn of_strips(dims: [usize; 2], strips: Vec<Strip<T>>) -> Self {
        let columns = dims[0].div_ceil(SQUARE);
        let (squares, values) = (columns * strips.len(), strips.iter().map(|s| s.values.len()).sum::<usize>());
        let mut packed = SparseImage {
            dims,
            columns,
            places: Vec::with_capacity(squares),
            whole: Vec::with_capacity(squares),
            values: Vec::with_capacity(values + SHARED * AREA),
            shared: Vec::new(),
        };
        for strip in strips {
            let mut squares = strip.values.chunks_exact(AREA);
            for whole in strip.whole {
                let place = match whole {
                    Some(value) => packed.place_of(value),
                    None => packed.append(squares.next().unwrap_or_default()),
                };
                packed.places.push(place);
                packed.whole.push(whole.is_some());
            }
        }
        packed.values.shrink_to_fit();
        packed
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

    /// The sparse image of values that are there, row-major.
    pub fn of(dims: [usize; 2], values: &[T]) -> Self {
        let [packed] = SparseImage::of_rows(dims, |first, [rows]| {
            rows.copy_from_slice(&values[first * dims[0]..][..rows.len()]);
        });
        packed
    }

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
            let square = &self.values[self.start(i, j)..][..AREA];
            let at = (j % SQUARE) * SQUARE + i % SQUARE;
            return [square[at], square[at + right], square[at + up * SQUARE], square[at + up * SQUARE + right]];
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
        let [nx, ny] = self.dims;
        let mut out = vec![T::zeroed(); nx * ny];
        out.par_chunks_mut(nx.max(1)).enumerate().for_each(|(j, row)| self.read(0, j, row));
        out
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
    /// A field in single precision.
    pub fn single(field: &Field) -> Self {
        let [packed] = SparseImage::of_rows(field.dims, |first, [rows]: [&mut [f32]; 1]| {
            let values = &field.data[first * field.dims[0]..];
            rows.iter_mut().zip(values).for_each(|(to, v)| *to = *v as f32);
        });
        packed
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

impl<T: Pod> Strip<T> {
    /// Adds a square, of which what lies on the image of `dims` pixels counts.
    fn push(&mut self, whole: Option<T>, square: &[T; AREA], place: [usize; 2], dims: [usize; 2]) {
        let [width, height] = [0, 1].map(|a| SQUARE.min(dims[a] - place[a] * SQUARE));
        let first = square[0];
        let mut rows = square.chunks_exact(SQUARE).take(height).map(|row| &row[..width]);
        let whole = whole.or_else(|| rows.all(|row| row.iter().all(|v| same(v, &first))).then_some(first));
        if whole.is_none() {
            self.values.extend_from_slice(square);
        }
        self.whole.push(whole);
    }

    fn new(rows: &[T], nx: usize) -> Self {
        let mut strip = Strip { whole: Vec::with_capacity(nx.div_ceil(SQUARE)), values: Vec::new() };
        for left in (0..nx).step_by(SQUARE) {
            let width = SQUARE.min(nx - left);
            let square = || rows.chunks_exact(nx).map(|row| &row[left..left + width]);
            let first = rows[left];
            if square().flatten().all(|v| same(v, &first)) {
                strip.whole.push(Some(first));
                continue;
            }
            strip.whole.push(None);
            let start = strip.values.len();
            strip.values.resize(start + AREA, first);
            for (to, row) in strip.values[start..].chunks_exact_mut(SQUARE).zip(square()) {
                to[..width].copy_from_slice(row);
            }
        }
        strip
    }
}

/// Whether two values have the same bits.
fn same<T: Pod>(a: &T, b: &T) -> bool {
    bytemuck::bytes_of(a) == bytemuck::bytes_of(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back_bit_by_bit_and_equal_squares_take_no_memory() {
        for dims in [[1, 1], [16, 16], [17, 33], [100, 70], [15, 40]] {
            let [nx, ny] = dims;
            // A disc, and zeros of both signs.
            let value = |n: usize| match (n % nx, n / nx) {
                (i, j) if (i as f32 - 40.0).hypot(j as f32 - 30.0) < 20.0 => n as f32 / 7.0,
                (i, _) if i > 80 => -0.0,
                _ => 0.0,
            };
            let values: Vec<f32> = (0..nx * ny).map(value).collect();
            let packed = SparseImage::of(dims, &values);
            let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&packed.unpack()), bits(&values));
            for n in 0..nx * ny {
                let (i, j) = (n % nx, n / nx);
                let (right, up) = (usize::from(i + 1 < nx), usize::from(j + 1 < ny));
                let around = [n, n + right, n + up * nx, n + up * nx + right].map(|n| values[n]);
                assert_eq!(bits(&packed.corners(i, j, right, up)), bits(&around));
                assert_eq!(packed.at(i, j).to_bits(), values[n].to_bits());
            }
        }
        let blank = SparseImage::of([1000, 1000], &vec![14.0f32; 1_000_000]);
        assert!(blank.bytes() < 24_000, "{}", blank.bytes());
    }

    /// A disc whose distances reach 14 px.
    fn disc(dims: [usize; 2]) -> Vec<f32> {
        let value = |n: usize| ((n % dims[0]) as f32 - 40.3).hypot((n / dims[0]) as f32 - 30.0) - 25.0;
        (0..dims[0] * dims[1]).map(|n| value(n).clamp(-14.0, 14.0)).collect()
    }

    #[test]
    fn squares_are_whole_where_all_their_pixels_are_alike() {
        for dims in [[100, 70], [96, 64], [81, 79], [7, 3]] {
            let values = disc(dims);
            let packed = SparseImage::of(dims, &values);
            let [again] = SparseImage::of_squares(dims, |square, [to]| {
                if let Some(value) = packed.whole(square) {
                    return [Some(value)];
                }
                to.copy_from_slice(packed.square(square));
                [None]
            });
            assert_eq!(again.unpack(), values);
            let [columns, rows] = packed.squares();
            for square in (0..rows).flat_map(|r| (0..columns).map(move |c| [c, r])) {
                let [is, js] = [0, 1].map(|a| square[a] * SQUARE..((square[a] + 1) * SQUARE).min(dims[a]));
                let first = values[js.start * dims[0] + is.start];
                let alike = js.clone().all(|j| is.clone().all(|i| values[j * dims[0] + i] == first));
                assert_eq!(packed.whole(square), alike.then_some(first), "{dims:?} {square:?}");
                assert_eq!(again.whole(square), packed.whole(square));
                assert_eq!(packed.whole_within(&is, &js), alike.then_some(first));
            }
            assert_eq!(packed.bytes(), again.bytes());
        }
    }

    #[test]
    fn a_window_shows_what_lies_there_and_the_outside_around_it() {
        let dims = [100, 70];
        let values = disc(dims);
        let packed = SparseImage::of(dims, &values);
        for (origin, size) in [([0isize, 0], dims), ([-16, -32], [150, 140]), ([8, 8], [80, 60]), ([-5, 61], [40, 33])]
        {
            let window = packed.window(origin, size, 9.0);
            let expected = |n: usize| {
                let at: [isize; 2] = [(n % size[0]) as isize + origin[0], (n / size[0]) as isize + origin[1]];
                let on = (0..2).all(|a| (0..dims[a] as isize).contains(&at[a]));
                if on { values[at[1] as usize * dims[0] + at[0] as usize] } else { 9.0 }
            };
            assert_eq!(window.unpack(), (0..size[0] * size[1]).map(expected).collect::<Vec<_>>(), "{origin:?}");
        }
        assert!(packed.window([200, 0], [50, 50], 9.0).unpack().iter().all(|v| *v == 9.0));
        let wide = packed.window([-400, -400], [900, 900], 14.0);
        assert!(wide.bytes() < packed.bytes() + 30_000, "{} {}", wide.bytes(), packed.bytes());
    }

    #[test]
    fn a_square_that_changes_leaves_those_of_the_same_value_alone() {
        let mut packed = SparseImage::filled([40, 40], 14.0f32);
        packed.square_mut([1, 1])[17] = 2.0;
        packed.set_whole([2, 0], -14.0);
        packed.square_mut([2, 0])[0] = 3.0;
        packed.set_whole([0, 2], -14.0);
        packed.map(|v| 2.0 * v);
        packed.set_whole([0, 0], 28.0);
        let value = |n: usize| match (n % 40, n / 40) {
            (17, 17) => 4.0,
            (32, 0) => 6.0,
            (i, j) if (i > 31 && j < 16) || (i < 16 && j > 31) => -28.0,
            _ => 28.0,
        };
        assert_eq!(packed.unpack(), (0..1600).map(value).collect::<Vec<f32>>());
        assert_eq!([packed.whole([1, 1]), packed.whole([0, 2]), packed.whole([1, 0])], [None, Some(-28.0), Some(28.0)]);
    }
}
