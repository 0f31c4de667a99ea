//! Sparse images made of values: rows, squares, or one value everywhere.

use bytemuck::Pod;
use rayon::prelude::*;

use super::{AREA, SHARED, SQUARE, SparseImage, same};
use crate::grid::field::Field;

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
        SparseImage::of_stretches(dims, |_| None, |[_, first], _, rows| fill(first, rows))
    }

    /// Several on an image of `dims` pixels. `whole` gives the one value that each has everywhere in the square in that column and row of squares;
    /// where it knows none `fill` gives them: stretches of neighbouring squares, row-major, by their first pixel and their width.
    pub fn of_stretches<const N: usize>(
        dims: [usize; 2],
        whole: impl Fn([usize; 2]) -> Option<[T; N]> + Sync,
        fill: impl Fn([usize; 2], usize, [&mut [T]; N]) + Sync,
    ) -> [Self; N] {
        let [nx, ny] = dims;
        let columns = nx.div_ceil(SQUARE);
        let strip = |buffers: &mut [Vec<T>; N], row: usize| {
            let mut strips = [const { Strip { whole: Vec::new(), values: Vec::new() } }; N];
            let first = row * SQUARE;
            let mut column = 0;
            while column < columns {
                if let Some(values) = whole([column, row]) {
                    strips.iter_mut().zip(values).for_each(|(strip, value)| strip.whole.push(Some(value)));
                    column += 1;
                    continue;
                }
                let more = (column + 1..columns).take_while(|&next| whole([next, row]).is_none()).count();
                let left = column * SQUARE;
                column += 1 + more;
                let width = (column * SQUARE).min(nx) - left;
                for buffer in buffers.iter_mut() {
                    buffer.clear();
                    buffer.resize(SQUARE.min(ny - first) * width, T::zeroed());
                }
                fill([left, first], width, buffers.each_mut().map(|rows| rows.as_mut_slice()));
                strips.iter_mut().zip(buffers.iter()).for_each(|(strip, rows)| strip.pack(rows, width));
            }
            strips
        };
        let none = || [const { Vec::new() }; N];
        let made: Vec<[Strip<T>; N]> = (0..ny.div_ceil(SQUARE)).into_par_iter().map_init(none, strip).collect();
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

    /// The sparse image of values that are there, row-major.
    pub fn of(dims: [usize; 2], values: &[T]) -> Self {
        let [packed] = SparseImage::of_rows(dims, |first, [rows]| {
            rows.copy_from_slice(&values[first * dims[0]..][..rows.len()]);
        });
        packed
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

    /// Adds the squares of some rows of `width` pixels.
    fn pack(&mut self, rows: &[T], width: usize) {
        for left in (0..width).step_by(SQUARE) {
            let across = SQUARE.min(width - left);
            let square = || rows.chunks_exact(width).map(|row| &row[left..left + across]);
            let first = rows[left];
            if square().flatten().all(|v| same(v, &first)) {
                self.whole.push(Some(first));
                continue;
            }
            self.whole.push(None);
            let start = self.values.len();
            self.values.resize(start + AREA, first);
            for (to, row) in self.values[start..].chunks_exact_mut(SQUARE).zip(square()) {
                to[..across].copy_from_slice(row);
            }
        }
    }
}
