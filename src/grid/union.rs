//! Union and difference of bodies by their signed distances, square by square: the smaller one counts, or the larger of one and the other's negative.

use std::ops::Range;

use super::sparse_image::{SQUARE, SparseImage};

/// Unites a layer with a body that covers these columns and rows of it; `of_row` writes the body's distances in row j from a column on.
pub fn unite(phi: &mut SparseImage<f32>, covered: [Range<usize>; 2], of_row: impl Fn([usize; 2], &mut [f32])) {
    for (square, part) in squares(covered) {
        change_square(phi, square, &part, &of_row, f32::min);
    }
}

/// Takes such a body out of a layer.
pub fn take_out(phi: &mut SparseImage<f32>, covered: [Range<usize>; 2], of_row: impl Fn([usize; 2], &mut [f32])) {
    for (square, part) in squares(covered) {
        change_square(phi, square, &part, &of_row, |v, body| v.max(-body));
    }
}

/// [`unite`] with a body that is there, whose pixel at `offset` lies on the layer's first; a distance counts as what `change` makes of it.
pub fn unite_packed(
    phi: &mut SparseImage<f32>,
    covered: [Range<usize>; 2],
    offset: [isize; 2],
    body: &SparseImage<f32>,
    change: impl Fn(f32) -> f32,
) {
    let own = |at: usize, a: usize| (at as isize + offset[a]) as usize;
    for (square, part) in squares(covered) {
        let [columns, rows] = [0, 1].map(|a| own(part[a].start, a)..own(part[a].end, a));
        match body.whole_within(&columns, &rows).map(&change) {
            Some(v) if phi.whole(square).is_some_and(|here| here <= v) => {}
            Some(v) => change_square(phi, square, &part, &|_, out: &mut [f32]| out.fill(v), f32::min),
            None => {
                let of_row = |[i, j]: [usize; 2], out: &mut [f32]| {
                    body.read(own(i, 0), own(j, 1), out);
                    out.iter_mut().for_each(|v| *v = change(*v));
                };
                change_square(phi, square, &part, &of_row, f32::min);
            }
        }
    }
}

/// Squares that lie in these columns and rows, and what of them does.
fn squares([columns, rows]: [Range<usize>; 2]) -> impl Iterator<Item = ([usize; 2], [Range<usize>; 2])> {
    let cut = |range: Range<usize>| {
        let squares = if range.is_empty() { 0..0 } else { range.start / SQUARE..range.end.div_ceil(SQUARE) };
        squares.map(move |k| (k, (k * SQUARE).max(range.start)..((k + 1) * SQUARE).min(range.end)))
    };
    cut(rows).flat_map(move |(row, js)| cut(columns.clone()).map(move |(column, is)| ([column, row], [is, js.clone()])))
}

/// Gives a part of one square the value that `both` makes of its own and the body's; where it is everywhere its own nothing changes.
fn change_square(
    phi: &mut SparseImage<f32>,
    square: [usize; 2],
    [columns, rows]: &[Range<usize>; 2],
    of_row: &impl Fn([usize; 2], &mut [f32]),
    both: impl Fn(f32, f32) -> f32,
) {
    let mut values = *phi.square(square);
    let (mut least, mut most, mut changed) = (f32::INFINITY, f32::NEG_INFINITY, false);
    let mut row = [0.0; SQUARE];
    for j in rows.clone() {
        let row = &mut row[..columns.len()];
        of_row([columns.start, j], row);
        for (v, new) in values[j % SQUARE * SQUARE + columns.start % SQUARE..].iter_mut().zip(&*row) {
            let now = both(*v, *new);
            changed |= now != *v;
            *v = now;
            (least, most) = (least.min(*v), most.max(*v));
        }
    }
    if !changed {
        return;
    }
    let full = |a: usize, part: &Range<usize>| part.len() == SQUARE.min(phi.dims()[a] - square[a] * SQUARE);
    if least == most && full(0, columns) && full(1, rows) {
        phi.set_whole(square, least);
    } else {
        *phi.square_mut(square) = values;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(dims: [usize; 2], middle: [f32; 2], radius: f32) -> Vec<f32> {
        let value = |n: usize| ((n % dims[0]) as f32 - middle[0]).hypot((n / dims[0]) as f32 - middle[1]) - radius;
        (0..dims[0] * dims[1]).map(|n| value(n).clamp(-14.0, 14.0)).collect()
    }

    #[test]
    fn the_smaller_distance_counts_wherever_the_body_lies() {
        let (dims, size) = ([100, 90], [77, 61]);
        let (below, body) = (disc(dims, [30.0, 40.0], 25.0), disc(size, [38.0, 30.0], 22.0));
        for offset in [[0isize, 0], [-16, -16], [-13, -29], [9, 20]] {
            let covered: [Range<usize>; 2] = [0, 1]
                .map(|a| (-offset[a]).max(0) as usize..(dims[a] as isize).min(size[a] as isize - offset[a]) as usize);
            let at =
                |i: usize, j: usize| (j as isize + offset[1]) as usize * size[0] + (i as isize + offset[0]) as usize;
            let mut expected = below.clone();
            for j in covered[1].clone() {
                for i in covered[0].clone() {
                    expected[j * dims[0] + i] = expected[j * dims[0] + i].min(0.5 * body[at(i, j)]);
                }
            }
            let mut packed = SparseImage::of(dims, &below);
            unite_packed(&mut packed, covered.clone(), offset, &SparseImage::of(size, &body), |v| 0.5 * v);
            assert_eq!(packed.unpack(), expected, "{offset:?}");
            let mut values = SparseImage::of(dims, &below);
            unite(&mut values, covered, |[i, j], out| {
                out.iter_mut().zip(i..).for_each(|(v, i)| *v = 0.5 * body[at(i, j)]);
            });
            assert_eq!(values.unpack(), expected, "{offset:?}");
        }
    }

    #[test]
    fn what_lies_farther_takes_no_memory() {
        let dims = [200, 200];
        let mut canvas = SparseImage::filled(dims, 14.0f32);
        let before = canvas.bytes();
        unite(&mut canvas, [0..200, 0..200], |_, out| out.fill(20.0));
        unite_packed(&mut canvas, [5..180, 3..90], [0, 0], &SparseImage::filled(dims, 14.0), |v| v);
        assert_eq!(canvas.bytes(), before);
        unite(&mut canvas, [0..200, 0..200], |_, out| out.fill(-14.0));
        assert_eq!(canvas.bytes(), before + 16 * 16 * 4);
    }
}
