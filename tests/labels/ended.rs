//! Labels that end on the way: beyond their last slice in a row of slices, and beside others that go on.

use interslice::stack::ReadOptions;

use crate::own_slices::{Disc, SIZES, areas, decided, volume};

/// Every fifth slice.
const ROW: [usize; 7] = [0, 5, 10, 15, 20, 25, 30];

/// A label on three slices of a row that another one goes along was looked for on the next one, and ends on the way there. Where that is not of the
/// row, nothing is known of it.
#[test]
fn a_label_of_a_row_of_slices_ends_on_the_way_to_the_next() {
    let along = |slices| Disc { label: 1, at: [50.0, 24.0], radius: 9.0, slices };
    let body = Disc { label: 2, at: [20.0, 24.0], radius: 8.0, slices: &[10, 15, 20] };
    let of = |discs: &[Disc<'_>]| areas(&decided(&volume(discs), &ReadOptions::default(), 1).0, 2);
    let in_row = of(&[along(&ROW), body]);
    for (on, way) in [(20usize, 1isize), (10, -1)] {
        let at = |k: isize| in_row[on.wrapping_add_signed(way * k)];
        assert!(at(1) > at(0) / 2 && at(1) <= at(0) && at(2) <= at(1) && at(5) == 0, "{in_row:?}");
    }
    for others in [&[0, 12, 22, 30][..], &[0, 2, 8, 30], &[0, 15, 30]] {
        let alone = of(&[along(others), body]);
        assert!(alone[..10].iter().chain(&alone[21..]).all(|n| *n == 0), "{others:?}: {alone:?}");
    }
}

/// A thread that leans out of a ball, of which a few pixels lie over its last slice: the ball is not the thread's from there on.
#[test]
fn a_label_that_goes_on_takes_nothing_from_a_larger_one_that_ends() {
    let [nx, ny, nz] = SIZES;
    let inside = |n: usize| {
        let [x, y, z] = [n % nx, n / nx % ny, n / (nx * ny)].map(|k| k as f64);
        let lean = if z < 15.0 { 0.0 } else { 0.7 * (z - 15.0) };
        [(x - 30.0 - lean).hypot(y - 24.0) < 3.4, (x - 30.0).hypot(y - 24.0).hypot(1.2 * (z - 6.0)) < 19.0]
    };
    let truth: Vec<[bool; 2]> = (0..nx * ny * nz).map(inside).collect();
    let label = |(n, [thread, ball]): (usize, &[bool; 2])| match n / (nx * ny) % 5 {
        0 if *thread => 2,
        0 if *ball => 1,
        _ => 0,
    };
    let voxels: Vec<u8> = truth.iter().enumerate().map(label).collect();
    let lies_over = (0..nx * ny).filter(|n| voxels[n + 20 * nx * ny] == 1 && voxels[n + 25 * nx * ny] == 2).count();
    assert!((1..20).contains(&lies_over), "{lies_over} pixels");
    let thread = areas(&decided(&voxels, &ReadOptions::default(), 1).0, 2);
    let drawn = thread[0];
    assert!(thread.iter().all(|n| n.abs_diff(drawn) <= drawn / 3), "{thread:?}");
}

/// The volume whose voxels on these slices have the label that `label` says.
fn painted(slices: &[usize], label: impl Fn([f64; 3]) -> u8) -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let at = |n: usize| [n % nx, n / nx % ny, n / (nx * ny)];
    let voxel = |n: usize| if slices.contains(&at(n)[2]) { label(at(n).map(|k| k as f64)) } else { 0 };
    (0..nx * ny * nz).map(voxel).collect()
}

/// A wall around a cavity that ends below it: at the next slice the wall is a disc that covers two fifths of the cavity's last contour.
#[test]
fn a_cavity_that_ends_below_a_dome_leaves_no_ring_around_it() {
    let away = |[x, y, z]: [f64; 3]| (x - 32.0).hypot((y - 24.0) / 1.1).hypot(z - 18.0);
    let voxels = painted(&[0, 8, 16, 24], |at| if away(at) < 17.0 { 2 } else { u8::from(away(at) < 20.0) });
    let [nx, ny, _] = SIZES;
    let lies = |k: usize| voxels[k * nx * ny..][..nx * ny].iter().filter(|v| **v > 0).count();
    let cavity = voxels[8 * nx * ny..][..nx * ny].iter().filter(|v| **v == 2).count();
    assert!((0.3..0.45).contains(&(lies(0) as f64 / cavity as f64)), "{} of {cavity}", lies(0));
    let layers = decided(&voxels, &ReadOptions::default(), 1).0;
    for (z, layer) in layers.iter().enumerate().take(25) {
        let within = |n: usize| away([(n % nx) as f64, (n / nx) as f64, z as f64]) < 16.5;
        let holes = (0..nx * ny).filter(|n| within(*n) && layer.phi.at(n % nx, n / nx) == 0.0).count();
        assert_eq!(holes, 0, "at {z}");
    }
}

/// Two labels side by side, of which one ends in a dome before the next slice.
#[test]
fn no_crack_opens_along_the_border_to_a_label_that_ends() {
    let label = |[x, y, z]: [f64; 3]| {
        let [one, other] = [([26.0, 20.0, 33.0], 25.0), ([20.0, 16.0, 16.0], 10.0)].map(|([a, b, c], middle)| {
            ((x - 32.0) / a).powi(2) + ((y - 24.0) / b).powi(2) + ((z - middle) / c).powi(2) < 1.0
        });
        if x < 32.0 { u8::from(one) } else { 2 * u8::from(other) }
    };
    let layers = decided(&painted(&[3, 11, 19, 27], label), &ReadOptions::default(), 1).0;
    let [nx, ny, _] = SIZES;
    for (z, layer) in layers.iter().enumerate().take(22).skip(19) {
        let has = |i: usize, j: usize, label: f32| layer.phi.at(i, j) == label;
        let open = |i: usize, j: usize| {
            has(i, j, 0.0) && (1..3).any(|s| has(i - s, j, 1.0)) && (1..3).any(|s| has(i + s, j, 2.0))
        };
        let cracks = (0..ny).flat_map(|j| (2..nx - 2).map(move |i| (i, j))).filter(|(i, j)| open(*i, *j)).count();
        assert_eq!(cracks, 0, "at {z}");
    }
}

/// What is around a label says nothing of how it ends: a ball in a block is the ball that ends towards slices without it.
#[test]
fn a_label_amid_another_ends_as_it_does_where_slices_are_complete() {
    let complete = ReadOptions { complete_slices: true, ..ReadOptions::default() };
    for middle in [13.0, 14.0, 15.0, 16.0, 17.0] {
        let away = |[x, y, z]: [f64; 3]| (x - 32.0).hypot(y - 24.0).hypot(z - middle);
        let voxels = painted(&ROW, |at| if away(at) < 10.0 { 2 } else { 1 });
        let [own, whole] = [ReadOptions::default(), complete.clone()].map(|o| areas(&decided(&voxels, &o, 1).0, 2));
        assert_eq!(own, whole, "about {middle}");
        assert!(own.iter().sum::<usize>() > 3500, "{own:?}");
    }
}
