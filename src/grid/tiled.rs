//! Values on an image whose squares of one and the same value take no memory: distances far from a contour, motion where nothing moves.
//!
//! Values that are read have the very bits that were packed.

use bytemuck::Pod;
use rayon::prelude::*;

use crate::grid::field::{Field, bilinear, cell};

/// Side of a square, px, and its binary logarithm.
pub const SQUARE: usize = 1 << SHIFT;
const SHIFT: usize = 4;
/// Values of a square.
pub const AREA: usize = SQUARE * SQUARE;
/// Values of which whole squares are kept once; what other values whole squares have is kept for each.
const SHARED: usize = 16;

/// Values on an image.
#[derive(Debug, Clone, Default)]
pub struct Packed<T> {
    dims: [usize; 2],
    columns: usize,
    /// Beginning of the values of each square.
    places: Vec<u32>,
    /// Square after square, row-major.
    values: Vec<T>,
}

/// The squares of one row of them.
struct Strip<T> {
    /// The one value of each square, or nothing.
    whole: Vec<Option<T>>,
    /// Values of the others.
    values: Vec<T>,
}

impl<T: Pod + Send + Sync> Packed<T> {
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
        strips.map(|strips| Packed::of_strips(dims, strips))
    }

    fn of_strips(dims: [usize; 2], strips: Vec<Strip<T>>) -> Self {
        let columns = dims[0].div_ceil(SQUARE);
        let mut packed =
            Packed { dims, columns, places: Vec::with_capacity(columns * strips.len()), values: Vec::new() };
        let mut shared: Vec<(T, u32)> = Vec::new();
        packed.values.reserve_exact(strips.iter().map(|s| s.values.len()).sum::<usize>() + SHARED * AREA);
        for strip in strips {
            let mut squares = strip.values.chunks_exact(AREA);
            for whole in strip.whole {
                let place = packed.values.len() as u32 / AREA as u32;
                let known = whole.and_then(|v| shared.iter().find(|(w, _)| same(&v, w)));
                packed.places.push(known.map_or(place, |(_, place)| *place));
                match (whole, known) {
                    (_, Some(_)) => {}
                    (Some(value), None) => {
                        packed.values.extend([value; AREA]);
                        if shared.len() < SHARED {
                            shared.push((value, place));
                        }
                    }
                    (None, None) => packed.values.extend(squares.next().unwrap_or_default()),
                }
            }
        }
        packed.values.shrink_to_fit();
        packed
    }

    /// The packed field of values that are there, row-major.
    pub fn of(dims: [usize; 2], values: &[T]) -> Self {
        let [packed] = Packed::of_rows(dims, |first, [rows]| {
            rows.copy_from_slice(&values[first * dims[0]..][..rows.len()]);
        });
        packed
    }

    /// Pixels of the image.
    pub fn dims(&self) -> [usize; 2] {
        self.dims
    }

    /// The value at pixel `(i, j)`.
    #[inline(always)]
    pub fn at(&self, i: usize, j: usize) -> T {
        self.values[self.square(i, j) + (j % SQUARE) * SQUARE + i % SQUARE]
    }

    /// The values at `(i, j)` and to the right, up, and up and to the right of it; `right` and `up` are 1, or 0 where there are none.
    #[inline(always)]
    pub fn corners(&self, i: usize, j: usize, right: usize, up: usize) -> [T; 4] {
        if i % SQUARE + right < SQUARE && j % SQUARE + up < SQUARE {
            let square = &self.values[self.square(i, j)..][..AREA];
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

    /// All values that occur.
    pub fn values(&self) -> impl Iterator<Item = T> + '_ {
        self.values.iter().copied()
    }

    /// Table of the squares, row-major: where each lies among [`Packed::squares`], in squares.
    pub fn places(&self) -> &[u32] {
        &self.places
    }

    /// Squares one after the other, each row-major.
    pub fn squares(&self) -> &[T] {
        &self.values
    }

    /// The one value of each square, or nothing.
    pub fn wholes(&self) -> Vec<Option<T>> {
        let whole = |square: &[T]| square.iter().all(|v| same(v, &square[0])).then_some(square[0]);
        let stored: Vec<Option<T>> = self.values.chunks_exact(AREA).map(whole).collect();
        self.places.iter().map(|place| stored[*place as usize]).collect()
    }

    /// The same field but for some squares, by increasing number in the table, whose values are given one after the other.
    pub fn replaced(&self, squares: &[u32], values: &[T]) -> Self {
        let mut new = squares.iter().zip(values.chunks_exact(AREA)).peekable();
        let mut kept: Vec<Option<u32>> = vec![None; self.values.len() / AREA];
        let mut packed = Packed {
            dims: self.dims,
            columns: self.columns,
            places: Vec::with_capacity(self.places.len()),
            values: Vec::new(),
        };
        packed.values.reserve_exact(values.len() + SHARED * AREA);
        for (square, place) in (0..).zip(&self.places) {
            let next = (packed.values.len() / AREA) as u32;
            if let Some((_, values)) = new.next_if(|(number, _)| **number == square) {
                packed.values.extend_from_slice(values);
                packed.places.push(next);
                continue;
            }
            let place = *place as usize;
            let at = *kept[place].get_or_insert_with(|| {
                packed.values.extend_from_slice(&self.values[place * AREA..][..AREA]);
                next
            });
            packed.places.push(at);
        }
        packed.values.shrink_to_fit();
        packed
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.places) + size_of_val(&*self.values)
    }

    /// Row `j` of the image in a column of squares.
    #[inline(always)]
    fn row_of_square(&self, column: usize, j: usize) -> &[T; SQUARE] {
        let square = self.places[(j >> SHIFT) * self.columns + column] as usize * AREA;
        let (rows, _) = self.values[square..][..AREA].as_chunks::<SQUARE>();
        &rows[j % SQUARE]
    }

    /// Beginning of the square of a pixel.
    #[inline(always)]
    fn square(&self, i: usize, j: usize) -> usize {
        self.places[(j >> SHIFT) * self.columns + (i >> SHIFT)] as usize * AREA
    }
}

impl Packed<f32> {
    /// A field in single precision.
    pub fn single(field: &Field) -> Self {
        let [packed] = Packed::of_rows(field.dims, |first, [rows]: [&mut [f32]; 1]| {
            let values = &field.data[first * field.dims[0]..];
            rows.iter_mut().zip(values).for_each(|(to, v)| *to = *v as f32);
        });
        packed
    }
}

impl Packed<f64> {
    /// Bilinear value at `x`; positions beyond the image read its edge.
    #[inline(always)]
    pub fn sample(&self, x: [f64; 2]) -> f64 {
        let ([i, j], place) = cell(self.dims, x, 0);
        bilinear(self.corners(i, j, 1, 1), place)
    }
}

impl<T: Pod> Strip<T> {
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
    fn squares_are_replaced() {
        let dims = [40, 20];
        let old = Packed::of(dims, &(0..800).map(|n| if n % 40 < 20 { 3.0 } else { n as f32 }).collect::<Vec<f32>>());
        let wholes = old.wholes();
        assert_eq!(wholes, [Some(3.0), None, None, Some(3.0), None, None]);
        let new: Vec<f32> = (0..2 * AREA).map(|n| -(n as f32)).collect();
        let both = old.replaced(&[0, 4], &new);
        for (i, j) in (0..20).flat_map(|j| (0..40).map(move |i| (i, j))) {
            let within = j % SQUARE * SQUARE + i % SQUARE;
            let expected = match i / SQUARE + j / SQUARE * 3 {
                0 => new[within],
                4 => new[AREA + within],
                _ => old.at(i, j),
            };
            assert_eq!(both.at(i, j), expected, "{i} {j}");
        }
    }

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
            let packed = Packed::of(dims, &values);
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
        let blank = Packed::of([1000, 1000], &vec![14.0f32; 1_000_000]);
        assert!(blank.bytes() < 20_000, "{}", blank.bytes());
    }
}
