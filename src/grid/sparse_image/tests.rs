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
    for (origin, size) in [([0isize, 0], dims), ([-16, -32], [150, 140]), ([8, 8], [80, 60]), ([-5, 61], [40, 33])] {
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
