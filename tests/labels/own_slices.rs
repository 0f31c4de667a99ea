//! Many labels, each painted on slices of its own (P12).

use std::fs;
use std::path::Path;

use crate::files::*;
use interslice::input::labels::{Wanted, read_labels};
use interslice::input::read;
use interslice::labels::{Plan, decide, reconstruct};
use interslice::stack::ReadOptions;
use interslice::surface::Layer;
use interslice::{Budget, Means, Reference, Settings, progress};

pub const SIZES: [usize; 3] = [64, 48, 31];

/// A disc of a label on some slices.
#[derive(Clone, Copy)]
pub struct Disc<'s> {
    pub label: u8,
    pub at: [f64; 2],
    pub radius: f64,
    pub slices: &'s [usize],
}

pub fn volume(discs: &[Disc<'_>]) -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let mut voxels = vec![0; nx * ny * nz];
    for disc in discs {
        for (k, n) in disc.slices.iter().flat_map(|&k| (0..nx * ny).map(move |n| (k, n))) {
            if ((n % nx) as f64 - disc.at[0]).hypot((n / nx) as f64 - disc.at[1]) < disc.radius {
                voxels[k * nx * ny + n] = disc.label;
            }
        }
    }
    voxels
}

pub fn write(path: &Path, voxels: &[u8]) {
    let header = "spacings: 1 1 1\nencoding: raw";
    fs::write(path, nrrd(header, "uint8", SIZES, voxels)).expect("a file can be written");
}

/// The numbers of all voxels at every height, `fine` of them to a slice, with what was said of the input.
pub fn decided(voxels: &[u8], options: &ReadOptions, fine: usize) -> (Vec<Layer>, Vec<String>, Option<String>) {
    let place = folder();
    let path = place.path().join("labels.nrrd");
    write(&path, voxels);
    let stack = read_labels(&path, options, &Wanted::All).expect("it is sound");
    let heights: Vec<f64> = (0..=(SIZES[2] - 1) * fine).map(|k| k as f64 / fine as f64).collect();
    let settings = Settings::default();
    let folder = std::env::temp_dir();
    let plan = Plan { heights: &heights, settings: &settings, folder: &folder, beside: 0, memory: None };
    let budget = Budget::unlimited();
    let means = Means { backend: &Reference, progress: &progress::Silent, budget: &budget };
    let bodies = reconstruct(&stack, true, &plan, &means).expect("they can be computed");
    let mut layers = Vec::new();
    let mut keep = |layer: Layer| {
        layers.push(layer);
        Ok(())
    };
    decide(&stack, bodies, &plan, &mut keep).expect("they can be decided");
    (layers, stack.notes, stack.reading)
}

pub fn areas(layers: &[Layer], label: u8) -> Vec<usize> {
    layers.iter().map(|layer| layer.phi.iter().filter(|l| **l == f32::from(label)).count()).collect()
}

pub const TENS: [usize; 4] = [0, 10, 20, 30];
const BETWEEN: [usize; 3] = [5, 15, 25];

/// Two cylinders whose slices alternate; `apart` is the distance of their axes.
pub fn alternating(apart: f64) -> Vec<u8> {
    let one = Disc { label: 1, at: [20.0, 24.0], radius: 8.0, slices: &TENS };
    volume(&[one, Disc { label: 2, at: [20.0 + apart, 24.0], radius: 9.0, slices: &BETWEEN }])
}

#[test]
fn p12_a_label_is_interpolated_between_its_own_slices() {
    let voxels = alternating(22.0);
    let (layers, notes, reading) = decided(&voxels, &ReadOptions::default(), 1);
    let (first, second) = (areas(&layers, 1), areas(&layers, 2));
    let painted =
        [0, 5].map(|k| voxels[k * SIZES[0] * SIZES[1]..].iter().take(SIZES[0] * SIZES[1]).filter(|l| **l > 0).count());
    assert!(painted.iter().all(|n| *n > 190), "{painted:?}");
    assert!(first.iter().all(|a| a.abs_diff(painted[0]) <= 2), "{first:?}");
    assert!(second[5..=25].iter().all(|a| a.abs_diff(painted[1]) <= 2), "{second:?}");
    assert!(second[..5].iter().chain(&second[26..]).all(|a| *a == 0), "{second:?}");
    assert!(
        reading.is_some_and(|r| r.contains("labels 1, 2: interpolated across slices")) && notes.is_empty(),
        "{notes:?}"
    );
}

#[test]
fn p12_complete_slices_end_the_labels_that_are_not_on_them() {
    let options = ReadOptions { complete_slices: true, ..ReadOptions::default() };
    let (layers, notes, reading) = decided(&alternating(22.0), &options, 1);
    let first = areas(&layers, 1);
    assert!(BETWEEN.iter().all(|k| first[*k] == 0) && TENS.iter().all(|k| first[*k] > 190), "{first:?}");
    assert!(notes.is_empty() && reading.is_none(), "{notes:?}, {reading:?}");
}

#[test]
fn p12_complete_slices_are_as_if_they_had_been_chosen() {
    let discs = [
        Disc { label: 1, at: [15.0, 24.0], radius: 8.0, slices: &[0, 6, 12, 18, 24, 30] },
        Disc { label: 2, at: [45.0, 24.0], radius: 9.0, slices: &[12, 18] },
    ];
    let voxels = volume(&discs);
    let complete = ReadOptions { complete_slices: true, ..ReadOptions::default() };
    let chosen = ReadOptions { slices: Some(discs[0].slices.to_vec()), ..ReadOptions::default() };
    let [complete, chosen] = [complete, chosen].map(|options| decided(&voxels, &options, 1).0);
    let [of_complete, of_chosen] = [&complete, &chosen].map(|layers| areas(layers, 2));
    assert_eq!(of_complete, of_chosen);
    // It ends towards the slices without it, and not before.
    assert!(of_complete[6] == 0 && of_complete[24] == 0, "{of_complete:?}");
    assert!((1..of_complete[12]).contains(&of_complete[11]), "{of_complete:?}");
    assert!((1..of_complete[18]).contains(&of_complete[19]), "{of_complete:?}");
}

#[test]
fn p12_a_label_that_meets_no_other_is_what_it_is_alone() {
    let voxels = alternating(22.0);
    let place = folder();
    let path = place.path().join("labels.nrrd");
    write(&path, &voxels);
    let (layers, ..) = decided(&voxels, &ReadOptions::default(), 1);
    for label in [1, 2] {
        let stack =
            read(&path, &ReadOptions { label: Some(label.into()), ..ReadOptions::default() }).expect("it is sound");
        let alone = interslice::reconstruct(&stack, &Settings::default()).expect("it can be computed");
        let alone: Vec<_> = alone.output_layers().collect();
        assert_eq!(alone.len(), layers.len());
        for (a, b) in layers.iter().zip(alone) {
            assert!(
                a.phi.iter().zip(b.phi.iter()).all(|(l, phi)| (*l == label as f32) == (*phi < 0.0)),
                "height {}",
                a.z
            );
        }
    }
}

/// Checks that what is painted stays what it is.
fn painted_stays(layers: &[Layer], voxels: &[u8], fine: usize) {
    let [nx, ny, nz] = SIZES;
    for k in 0..nz {
        let (layer, drawn) = (&layers[k * fine].phi, &voxels[k * nx * ny..][..nx * ny]);
        let differ = layer.iter().zip(drawn).filter(|(l, d)| **d > 0 && **l != f32::from(**d)).count();
        assert_eq!(differ, 0, "painted pixels of slice {k}");
    }
}

#[test]
fn p12_painted_pixels_stay_though_others_are_interpolated_across() {
    // The discs overlap by 7 px: 64 px have two labels alone. Between the ends of the second each goes over by and by, a step of 1/40 at a time.
    let voxels = alternating(10.0);
    let (layers, ..) = decided(&voxels, &ReadOptions::default(), 8);
    painted_stays(&layers, &voxels, 8);
    let mut gone = 0;
    for (a, b) in layers[5 * 8..=25 * 8].iter().zip(&layers[5 * 8 + 1..=25 * 8]) {
        let flipped = a.phi.iter().zip(b.phi.iter()).filter(|(l, m)| l != m && **l > 0.0 && **m > 0.0).count();
        assert!(flipped <= 12, "{flipped} px go from one label to the other between {} and {}", a.z, b.z);
        gone += flipped;
    }
    assert!(gone > 4 * 50, "{gone} px have gone from one label to the other and back");
}

#[test]
fn p12_random_discs_on_slices_of_their_own() {
    let mut seed = 7u64;
    let mut next = |n: usize| {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 33) as usize % n
    };
    let mut runs = 0;
    for _ in 0..12 {
        let slices: Vec<Vec<usize>> = (0..3)
            .map(|_| {
                let mut own: Vec<usize> = (0..2 + next(4)).map(|_| next(SIZES[2])).collect();
                own.extend([next(8), 20 + next(8)]);
                own
            })
            .collect();
        let disc = |label: usize| Disc {
            label: label as u8 + 1,
            at: [18.0 + next(28) as f64, 16.0 + next(16) as f64],
            radius: 5.0 + next(8) as f64,
            slices: &slices[label],
        };
        let discs: Vec<Disc<'_>> = (0..3).map(disc).collect();
        let voxels = volume(&discs);
        if (1..=3).all(|l| (0..SIZES[2]).filter(|k| voxels[k * 64 * 48..][..64 * 48].contains(&l)).count() > 1) {
            painted_stays(&decided(&voxels, &ReadOptions::default(), 1).0, &voxels, 1);
            runs += 1;
        }
    }
    assert!(runs > 8, "{runs} runs");
}

/// Two bodies of one label in a volume that is painted on every slice, and nothing else between them.
#[test]
fn p12_a_hole_in_what_is_painted_slice_by_slice_stays_where_others_are_painted() {
    let all: Vec<usize> = (0..SIZES[2]).collect();
    let ends: Vec<usize> = (2..8).chain(20..26).collect();
    let twice = Disc { label: 1, at: [20.0, 24.0], radius: 8.0, slices: &ends };
    let through = Disc { label: 2, at: [44.0, 24.0], radius: 6.0, slices: &all };
    let voxels = volume(&[twice, through]);
    let (layers, notes, reading) = decided(&voxels, &ReadOptions::default(), 1);
    for (k, layer) in layers.iter().enumerate() {
        let drawn = &voxels[k * SIZES[0] * SIZES[1]..][..SIZES[0] * SIZES[1]];
        assert!(layer.phi.iter().zip(drawn).all(|(l, d)| *l == f32::from(*d)), "slice {k}");
    }
    assert!(notes.is_empty() && reading.is_none(), "{notes:?}, {reading:?}");
    // Alone there is nothing that says where it ends.
    let twice = Disc { label: 1, at: [20.0, 24.0], radius: 8.0, slices: &ends };
    let (layers, notes, _) = decided(&volume(&[twice]), &ReadOptions::default(), 1);
    assert!(areas(&layers, 1)[2..26].iter().all(|a| *a > 100));
    assert!(notes.iter().any(|n| n.contains("not on 8 to 19: interpolated across")), "{notes:?}");
}

pub fn text(path: &Path) -> &str {
    path.to_str().expect("temporary paths are UTF-8")
}

/// Labels painted on slices across the file's rows have no neighbour along them, and are no grey values.
#[test]
fn many_labels_on_slices_across_any_axis_are_labels() {
    let [nx, ny, nz] = SIZES;
    for axis in 0..3 {
        let mut voxels = vec![0; nx * ny * nz];
        for (n, voxel) in voxels.iter_mut().enumerate() {
            let at = [n % nx, n / nx % ny, n / (nx * ny)];
            let [u, v] = [[1, 2], [0, 2], [0, 1]][axis];
            // Squares of three pixels and a gap of one.
            if at[axis] % 4 == 0 && at[u] % 4 < 3 && at[v] % 4 < 3 {
                *voxel = (1 + (at[u] / 4 + 10 * (at[v] / 4)) % 100) as u8;
            }
        }
        let place = folder();
        let path = place.path().join("labels.nrrd");
        write(&path, &voxels);
        let stack = read_labels(&path, &ReadOptions::default(), &Wanted::All).expect("labels");
        assert!(stack.labels.len() >= 64, "{axis}: {}", stack.labels.len());
        assert_eq!(stack.stack.slices.len(), SIZES[axis].div_ceil(4), "{axis}");
    }
}

/// Cells that fill a block, each painted on every fourth slice, on others than its neighbours: with other numbers they are the same.
#[test]
fn nothing_depends_on_the_numbers_of_labels() {
    const CELLS: usize = 30;
    let [nx, ny, nz] = SIZES;
    for seed in 0..3u64 {
        let mut state = 77 + seed;
        let mut random = |below: f64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64 * below
        };
        let seeds: Vec<[f64; 3]> = (0..CELLS).map(|_| [nx, ny, nz].map(|n| random(n as f64 - 1.0))).collect();
        let cell = |at: [usize; 3]| {
            let off = |s: &[f64; 3]| s.iter().zip(at).map(|(s, p)| (s - p as f64).powi(2)).sum::<f64>();
            let (cell, off) = seeds.iter().map(off).enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
            (off < 14.0 * 14.0 && at[2] % 4 == cell % 4).then_some(cell)
        };
        let cells: Vec<Option<usize>> = (0..nx * ny * nz).map(|n| cell([n % nx, n / nx % ny, n / (nx * ny)])).collect();
        let numbers = |number: &dyn Fn(usize) -> u8| -> Vec<f32> {
            let voxels: Vec<u8> = cells.iter().map(|cell| cell.map_or(0, number)).collect();
            let back: Vec<f32> =
                (0..=255).map(|n| (0..CELLS).find(|c| number(*c) == n).map_or(0.0, |c| c as f32 + 1.0)).collect();
            let (layers, ..) = decided(&voxels, &ReadOptions::default(), 1);
            layers.iter().flat_map(|layer| layer.phi.iter().map(|l| back[*l as usize]).collect::<Vec<_>>()).collect()
        };
        let rising = numbers(&|cell| cell as u8 + 1);
        for (name, other) in [
            ("falling", numbers(&|cell| (CELLS - cell) as u8)),
            ("shuffled", numbers(&|cell| (7 * cell % 31 + 3) as u8)),
        ] {
            let differ = rising.iter().zip(&other).filter(|(a, b)| a != b).count();
            assert_eq!(differ, 0, "{name}, seed {seed}");
        }
    }
}

#[test]
fn a_label_on_one_slice_stays_as_it_is_painted() {
    // Across the border of a cylinder that is interpolated there.
    let cylinder = Disc { label: 1, at: [20.0, 24.0], radius: 8.0, slices: &TENS };
    let spot = Disc { label: 9, at: [27.0, 24.0], radius: 3.0, slices: &[12] };
    let (without, ..) = decided(&volume(&[cylinder]), &ReadOptions::default(), 2);
    let (with, ..) = decided(&volume(&[cylinder, spot]), &ReadOptions::default(), 2);
    for (k, (with, without)) in with.iter().zip(&without).enumerate() {
        let wanted = |(n, label): (usize, &f32)| {
            let near = ((n % SIZES[0]) as f64 - 27.0).hypot((n / SIZES[0]) as f64 - 24.0) < 3.0;
            if k == 24 && near { 9.0 } else { *label }
        };
        assert!(with.phi.iter().copied().eq(without.phi.iter().enumerate().map(wanted)), "height {}", with.z);
    }
    assert!(areas(&with, 9)[24] > 20 && areas(&with, 1)[24] < areas(&without, 1)[24]);
}

/// The seed of five that is nearest, of which label `l + 1` is painted on every `every[l]`-th slice from `from[l]` on: labels that touch everywhere.
fn cells() -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let seeds = [[12.0, 10.0, 8.0], [30.0, 40.0, 20.0], [50.0, 12.0, 24.0], [34.0, 22.0, 4.0], [16.0, 30.0, 28.0]];
    let (from, every) = ([0, 1, 2, 0, 1], [4, 3, 6, 5, 4]);
    let of = |n: usize| {
        let at = [n % nx, n / nx % ny, n / (nx * ny)].map(|v| v as f64);
        // Borders wind.
        let at =
            [at[0] + 5.0 * (0.4 * at[1] + 0.3 * at[2]).sin(), at[1] + 5.0 * (0.5 * at[0] - 0.4 * at[2]).sin(), at[2]];
        let square = |seed: &[f64; 3]| (0..3).map(|k| (seed[k] - at[k]).powi(2) * [1.0, 1.0, 0.3][k]).sum::<f64>();
        let nearest = (0..5).min_by(|&a, &b| square(&seeds[a]).total_cmp(&square(&seeds[b]))).unwrap_or(0);
        let k = n / (nx * ny);
        if k >= from[nearest] && (k - from[nearest]).is_multiple_of(every[nearest]) { nearest as u8 + 1 } else { 0 }
    };
    (0..nx * ny * nz).map(of).collect()
}

/// Voxels of labels in pieces, also over edges and corners, that have no painted one.
fn floating(labels: &[u8], voxels: &[u8]) -> usize {
    let [nx, ny, nz] = SIZES;
    let mut held: Vec<bool> = labels.iter().zip(voxels).map(|(l, painted)| *painted > 0 && l == painted).collect();
    let mut open: Vec<usize> = (0..held.len()).filter(|&n| held[n]).collect();
    while let Some(n) = open.pop() {
        let [i, j, k] = [n % nx, n / nx % ny, n / (nx * ny)];
        for m in (0..27).map(|m| [i + m % 3, j + m / 3 % 3, k + m / 9]) {
            let [x, y, z] = m.map(|v| v.wrapping_sub(1));
            if x >= nx || y >= ny || z >= nz {
                continue;
            }
            let m = x + nx * (y + ny * z);
            if !held[m] && labels[m] == labels[n] {
                held[m] = true;
                open.push(m);
            }
        }
    }
    (0..held.len()).filter(|&n| labels[n] > 0 && !held[n]).count()
}

#[test]
fn p12_no_piece_of_a_label_floats_be_it_on_slices_of_others() {
    let place = folder();
    let [input, output, report] = ["in.nrrd", "out.npy", "r.json"].map(|name| place.path().join(name));
    let voxels = cells();
    write(&input, &voxels);
    let made = ["reconstruct", text(&input), "--labels", "all", "--axis", "z", "--backend", "cpu"];
    let made = interslice(&[&made[..], &["-o", text(&output), "-o", text(&report)]].concat());
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let file = fs::read(&output).expect("it was written");
    let labels = &file[file.len() - voxels.len()..];
    assert!(voxels.iter().zip(labels).all(|(painted, l)| *painted == 0 || painted == l), "what is painted stays");
    assert_eq!(floating(labels, &voxels), 0, "voxels that touch no slice of their label");
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(&report).expect("it was written")).expect("it is JSON");
    let pixels = report["borders"]["floating_pixels"].as_u64();
    assert!(pixels.is_some_and(|pixels| pixels > 0), "nothing is tested: {pixels:?}");
    let pieces = report["labels"].as_array().expect("labels").iter().map(|l| l["run"]["body"]["floating"].as_u64());
    assert!(pieces.eq([Some(0); 5]));
}
