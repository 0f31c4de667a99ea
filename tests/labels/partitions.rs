//! Many labels in one run: partitions without gap or overlap, whatever the labels' numbers, and labels alone as they are alone.

use std::fs;
use std::path::Path;

use crate::files::*;
use interslice::input::labels::{Wanted, read_labels};
use interslice::input::read;
use interslice::labels::{Bodies, DecidedLabels, LabelStack, Plan, decide, reconstruct};
use interslice::stack::ReadOptions;
use interslice::surface::Layer;
use interslice::{Budget, Means, Reference, Settings, progress};

const SIZES: [usize; 3] = [200, 64, 17];
/// Every so many slices is drawn.
const DRAWN: usize = 4;
const RADIUS: f64 = 18.0;

/// Where the disc of three sectors is on slice `k`, and how far it has turned.
fn centre(k: usize) -> ([f64; 2], f64) {
    let t = k as f64;
    ([28.0 + 0.35 * t, 31.0 - 0.2 * t], 0.045 * t)
}

/// Three sectors that meet at a point and drift and turn (labels 1, 2, 3), far off a disc that moves (4); `numbers` are what they are called.
pub fn volume(numbers: [u8; 4]) -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let at = |n: usize| {
        let (i, j, k) = ((n % nx) as f64, (n / nx % ny) as f64, n / (nx * ny));
        let ([x, y], turned) = centre(k);
        let angle = ((j - y).atan2(i - x) + turned + 3.0).rem_euclid(std::f64::consts::TAU);
        match () {
            _ if k % DRAWN > 0 => 0,
            _ if (i - x).hypot(j - y) < RADIUS => numbers[(angle / std::f64::consts::TAU * 3.0) as usize % 3],
            _ if (i - 165.0 - 0.5 * k as f64).hypot(j - 30.0) < 9.0 + 0.3 * k as f64 => numbers[3],
            _ => 0,
        }
    };
    (0..nx * ny * nz).map(at).collect()
}

pub fn write(path: &Path, voxels: &[u8]) {
    let header =
        "space directions: (1,0,0) (0,1,0) (0,0,1.5)\nspace: left-posterior-superior\nendian: little\nencoding: raw";
    fs::write(path, nrrd(header, "uint8", SIZES, voxels)).expect("a file can be written");
}

/// The labels of the volume, and a layer of label numbers per slice.
struct Run {
    stack: LabelStack,
    decided: DecidedLabels,
    layers: Vec<Layer>,
}

fn means(budget: &Budget) -> Means<'_> {
    Means { backend: &Reference, progress: &progress::Silent, budget }
}

fn with_bodies<T>(stack: &LabelStack, f: impl FnOnce(Bodies, &Plan<'_>) -> T) -> T {
    let (settings, heights) = (Settings::default(), stack.stack.z_out.expect("a volume has a grid").heights());
    let heights = heights.expect("the grid is small");
    let folder = std::env::temp_dir();
    let plan = Plan { heights: &heights, settings: &settings, folder: &folder, beside: 0, memory: None };
    let bodies = reconstruct(stack, true, &plan, &means(&Budget::unlimited())).expect("they can be computed");
    f(bodies, &plan)
}

fn run(voxels: &[u8]) -> Run {
    run_reading(voxels, &ReadOptions::default())
}

fn run_reading(voxels: &[u8], options: &ReadOptions) -> Run {
    let place = folder();
    let path = place.path().join("labels.nrrd");
    write(&path, voxels);
    let stack = read_labels(&path, options, &Wanted::All).expect("it is sound");
    let mut layers = Vec::new();
    let mut keep = |layer: Layer| {
        layers.push(layer);
        Ok(())
    };
    let decided =
        with_bodies(&stack, |bodies, plan| decide(&stack, bodies, plan, &mut keep)).expect("it can be decided");
    Run { stack, decided, layers }
}

fn layers_of(body: &mut interslice::labels::KeptBody) -> Vec<Layer> {
    let mut layers = Vec::new();
    let mut keep = |layer: Layer| {
        layers.push(layer);
        Ok(())
    };
    body.replay(&mut keep).expect("its layers can be read");
    layers.retain(|l| l.output);
    layers
}

/// Pixels deeper than `depth` in the disc of the sectors on slice `k`.
fn in_disc(k: usize, depth: f64) -> impl Iterator<Item = usize> {
    let [nx, ny, _] = SIZES;
    let ([x, y], _) = centre(k);
    (0..nx * ny).filter(move |n| ((n % nx) as f64 - x).hypot((n / nx) as f64 - y) < RADIUS - depth)
}

#[test]
fn touching_labels_part_their_union() {
    let voxels = volume([1, 2, 3, 4]);
    let [nx, ny, nz] = SIZES;
    let Run { stack, mut decided, layers } = run(&voxels);
    assert_eq!(stack.labels, [1, 2, 3, 4]);
    assert_eq!(layers.len(), nz);
    let fields: Vec<Vec<Layer>> = decided.bodies.iter_mut().map(layers_of).collect();
    let (mut gaps, mut apart, mut edges) = (0, 0.0f32, 0);
    for (k, layer) in layers.iter().enumerate() {
        for (n, label) in layer.phi.iter().enumerate() {
            let inside: Vec<usize> = (0..4).filter(|&a| fields[a][k].phi[n] < 0.0).map(|a| a + 1).collect();
            assert!(inside.len() <= 1, "pixel {n} of slice {k} has labels {inside:?}");
            assert_eq!(inside.first().map_or(0, |l| *l) as f32, *label);
            if k % DRAWN == 0 {
                assert_eq!(*label, f32::from(voxels[k * nx * ny + n]), "pixel {n} of drawn slice {k}");
            }
        }
        // The disc's own rim is uncertain by a pixel; within it every pixel must have a label.
        gaps += in_disc(k, 1.5).filter(|&n| layer.phi[n] == 0.0).count();
        // Where two labels are side by side, both surfaces cross between the pixels at the same place.
        // Not so where a third label is near.
        let near: Vec<usize> = in_disc(k, RADIUS - 5.0).collect();
        for n in in_disc(k, 4.0).filter(|n| layer.phi[*n] != layer.phi[n + 1] && !near.contains(n)) {
            let crossing = |label: f32| {
                let phi = &fields[label as usize - 1][k].phi;
                phi[n] / (phi[n] - phi[n + 1])
            };
            apart = apart.max((crossing(layer.phi[n]) - crossing(layer.phi[n + 1])).abs());
            edges += 1;
        }
    }
    assert_eq!(gaps, 0, "pixels between touching labels have none");
    assert!(edges > 200, "{edges} borders were looked at");
    println!("crossings of {edges} borders lie at most {apart} px apart");
    assert!(apart < 0.1, "the two surfaces of a border lie {apart} px apart");
    assert_eq!(decided.changed, [true, true, true, false]);
    assert_eq!(decided.differing, [0; 4]);
    assert_eq!(decided.borders.unions, [[1, 2, 3]]);
}

/// The control: what is decided is there to be decided.
#[test]
fn labels_alone_overlap_and_leave_gaps() {
    let voxels = volume([1, 2, 3, 4]);
    let place = folder();
    let path = place.path().join("labels.nrrd");
    write(&path, &voxels);
    let stack = read_labels(&path, &ReadOptions::default(), &Wanted::All).expect("it is sound");
    let (overlaps, gaps) = with_bodies(&stack, |mut bodies, _| {
        let fields: Vec<Vec<Layer>> = bodies.alone.iter_mut().map(layers_of).collect();
        let having = |k: usize, n: usize| fields.iter().filter(|f| f[k].phi[n] < 0.0).count();
        let count = |wanted: fn(usize) -> bool| {
            (0..SIZES[2]).map(|k| in_disc(k, 1.5).filter(|&n| wanted(having(k, n))).count()).sum::<usize>()
        };
        (count(|n| n > 1), count(|n| n == 0))
    });
    assert!(overlaps > 0 && gaps > 0, "{overlaps} overlaps and {gaps} gaps");
}

#[test]
fn numbers_of_labels_decide_nothing() {
    let first = run(&volume([1, 2, 3, 4]));
    let numbers = [7, 4, 9, 2];
    let shuffled = run(&volume(numbers));
    for (a, b) in first.layers.iter().zip(&shuffled.layers) {
        let renamed = a.phi.iter().map(|&l| if l == 0.0 { 0.0 } else { f32::from(numbers[l as usize - 1]) });
        assert!(renamed.eq(b.phi.iter().copied()), "height {}", a.z);
    }
    assert_eq!(first.layers.len(), shuffled.layers.len());
    assert_eq!(first.decided.borders.gap_voxels, shuffled.decided.borders.gap_voxels);
    assert_eq!(first.decided.borders.overlap_voxels, shuffled.decided.borders.overlap_voxels);
}

/// Alone on its part of the image and alone on the whole image: the very bits, but where distances reach the clamp (14 px): there the
/// smaller coordinates of the part round differently (largest difference seen: 0.0023 px).
#[test]
fn a_label_that_touches_no_other_is_what_it_is_alone() {
    let voxels = volume([1, 2, 3, 4]);
    let place = folder();
    let path = place.path().join("labels.nrrd");
    write(&path, &voxels);
    let stack = read(&path, &ReadOptions { label: Some(4.into()), ..ReadOptions::default() }).expect("it is sound");
    let whole = interslice::reconstruct(&stack, &Settings::default()).expect("it can be computed");
    let mut decided = run(&voxels).decided;
    let layers = layers_of(&mut decided.bodies[3]);
    assert_eq!(layers.len(), SIZES[2]);
    for (a, b) in layers.iter().zip(whole.output_layers()) {
        assert_eq!(a.z, b.z);
        assert_eq!(a.phi.len(), b.phi.len());
        for (n, (v, w)) in a.phi.iter().zip(b.phi.iter()).enumerate() {
            let clamped = v.abs().min(w.abs()) > 13.99 && (v - w).abs() < 0.01;
            assert!(v.to_bits() == w.to_bits() || clamped, "pixel {n} at height {}: {v} and {w}", a.z);
        }
    }
}

/// Cells of nine points that wander, in a disc: what lies between two slices is parted among several.
fn cells(seed: usize) -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let point = |l: usize, k: usize| {
        let way =
            |q: usize| (1.7 * (seed * 37 + 9 * q + l) as f64 + 0.11 * (1 + (l + q + seed) % 3) as f64 * k as f64).sin();
        [40.0 + 26.0 * way(1), 32.0 + 26.0 * way(2)]
    };
    let mut voxels = vec![0; nx * ny * nz];
    for k in (0..nz).step_by(DRAWN) {
        let points: Vec<[f64; 2]> = (0..9).map(|l| point(l, k)).collect();
        for (n, voxel) in voxels[k * nx * ny..][..nx * ny].iter_mut().enumerate() {
            let [i, j] = [(n % nx) as f64, (n / nx) as f64];
            let off = |p: &[f64; 2]| (i - p[0]).hypot(j - p[1]);
            let nearest = (0..9).min_by(|&a, &b| off(&points[a]).total_cmp(&off(&points[b])));
            if (i - 40.0).hypot(j - 32.0) < 28.0 {
                *voxel = nearest.expect("there are nine") as u8 + 1;
            }
        }
    }
    voxels
}

/// A ball in a ball: the inner label ends beneath the outer one.
fn ball_in_a_ball(seed: usize) -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let way = |q: usize| (1.7 * (seed * 41 + q) as f64).sin();
    let core = [40.0 + 8.0 * way(20), 32.0 + 8.0 * way(21), 4.0 + 3.0 * way(22)];
    let at = |v: usize| {
        let [i, j, k] = [(v % nx) as f64, (v / nx % ny) as f64, (v / (nx * ny)) as f64];
        match () {
            _ if !(k as usize).is_multiple_of(DRAWN) || (i - 40.0).hypot(j - 32.0) >= ball(k) => 0,
            _ if (i - core[0]).hypot(j - core[1]).hypot(1.5 * (k - core[2])) < 13.0 => 2,
            _ => 1,
        }
    };
    (0..nx * ny * nz).map(at).collect()
}

/// Radius of the outer ball on slice `k`.
fn ball(k: f64) -> f64 {
    28.0 - 0.1 * (k - 8.0).powi(2)
}

/// Pixels of layers, two pixels within the ball, that have no label.
fn pockets(layers: &[Layer]) -> usize {
    let [nx, _, _] = SIZES;
    let within = |n: usize, k: usize| ((n % nx) as f64 - 40.0).hypot((n / nx) as f64 - 32.0) < ball(k as f64) - 2.0;
    let of =
        |(k, layer): (usize, &Layer)| layer.phi.iter().enumerate().filter(|(n, v)| **v == 0.0 && within(*n, k)).count();
    layers.iter().enumerate().map(of).sum()
}

#[test]
fn labels_that_end_beneath_others_leave_no_pockets() {
    let [nx, ny, nz] = SIZES;
    let chosen = ReadOptions { keep: Some(DRAWN), ..ReadOptions::default() };
    let own = ReadOptions::default();
    for (seed, options) in [&chosen, &own].into_iter().cycle().take(6).enumerate() {
        let voxels = ball_in_a_ball(seed);
        let layers = run_reading(&voxels, options).layers;
        assert_eq!(pockets(&layers), 0, "balls {seed}");
        let turned: Vec<u8> = (0..nz).rev().flat_map(|k| voxels[k * nx * ny..][..nx * ny].to_vec()).collect();
        let upside_down = run_reading(&turned, options).layers;
        let differ = |(a, b): (&Layer, &Layer)| a.phi.iter().zip(b.phi.iter()).filter(|(a, b)| a != b).count();
        let differing: usize = layers.iter().zip(upside_down.iter().rev()).map(differ).sum();
        assert_eq!(differing, 0, "balls {seed} upside down");
    }
}

/// A wedge of label 1 and one of label 2 over it, in a cylinder: on slices the border lies at these columns.
fn wedges(border: impl Fn(usize) -> usize) -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let at = |v: usize| {
        let [i, j, k] = [v % nx, v / nx % ny, v / (nx * ny)];
        let inside = k.is_multiple_of(DRAWN) && (i as f64 - 40.0).hypot(j as f64 - 32.0) < 20.0;
        if inside { 1 + u8::from(i >= border(k)) } else { 0 }
    };
    (0..nx * ny * nz).map(at).collect()
}

/// A disc of two labels whose border turns and moves from slice to slice, by up to 56 px: the disc is the union of both in every layer.
#[test]
fn a_border_that_moves_far_leaves_no_gap() {
    const MIDDLE: [f64; 2] = [100.0, 31.5];
    let disc = |i: f64, j: f64| (i - MIDDLE[0]).hypot(j - MIDDLE[1]) < 27.0;
    let mut random = 3u64;
    let mut number = |low: f64, high: f64| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * (random >> 11) as f64 / (1u64 << 53) as f64
    };
    for case in 0..8 {
        let borders: Vec<[f64; 2]> = (0..5).map(|_| [number(-0.6, 0.6), number(-20.0, 20.0)]).collect();
        let [nx, ny, nz] = SIZES;
        let at = |n: usize| {
            let (i, j, k) = ((n % nx) as f64, (n / nx % ny) as f64, n / (nx * ny));
            let [turned, off] = borders[k / DRAWN];
            let along = (i - MIDDLE[0]) * turned.cos() + (j - MIDDLE[1]) * turned.sin();
            if k % DRAWN > 0 || !disc(i, j) { 0 } else { 1 + u8::from(along > off) }
        };
        let layers = run(&(0..nx * ny * nz).map(at).collect::<Vec<u8>>()).layers;
        let empty = |layer: &Layer| {
            let inside = (0..nx * ny).filter(|n| disc((n % nx) as f64, (n / nx) as f64));
            let phi = layer.phi.unpack();
            inside.filter(|n| phi[*n] == 0.0).count()
        };
        let empty: Vec<usize> = layers.iter().map(empty).collect();
        // Where the distances of two slices are interpolated a pixel of the rim goes here and there.
        println!("case {case}, {borders:.1?}: {empty:?} empty");
        assert!(empty.iter().all(|n| *n <= 4), "case {case}, {borders:?}: {empty:?}");
    }
}

#[test]
fn labels_that_follow_each_other_part_what_lies_between_in_the_middle() {
    // They touch on the first slice and the last; from slice 4 to 8 the one ends and the other goes on in its place.
    let chosen = ReadOptions { keep: Some(DRAWN), ..ReadOptions::default() };
    let Run { decided, layers, .. } = run_reading(&wedges(|k| [30, 70, 10, 10, 50][k / DRAWN]), &chosen);
    let count = |k: usize, l: f32| layers[k].phi.iter().filter(|v| **v == l).count() as f64;
    let whole = count(0, 1.0) + count(0, 2.0);
    for k in 0..layers.len() {
        println!("layer {k}: {} and {}", count(k, 1.0), count(k, 2.0));
        assert!(count(k, 1.0) + count(k, 2.0) > 0.98 * whole, "layer {k} has a gap");
    }
    assert!(count(5, 1.0) > 0.9 * whole && count(7, 2.0) > 0.9 * whole);
    assert!(decided.borders.gap_voxels as f64 > whole, "{:?}", decided.borders);
}

#[test]
fn a_surface_ends_where_its_label_does_and_not_at_its_last_slice() {
    // Labels have slices of their own: of chosen ones the next would be an empty slice, and no surface ends before it.
    let own = ReadOptions::default();
    let mut volumes: Vec<Vec<u8>> = (0..3).map(ball_in_a_ball).collect();
    // One ends at slice 8, where the other begins beside it; above it they part what lies up to slice 12.
    volumes.push(wedges(|k| [70, 70, 50, 10, 10][k / DRAWN]));
    let mut beyond = 0;
    for (n, voxels) in volumes.iter().enumerate() {
        let Run { stack, mut decided, layers } = run_reading(voxels, &own);
        for (a, body) in decided.bodies.iter_mut().enumerate() {
            let area = |l: &Layer| l.phi.iter().filter(|v| **v == stack.labels[a] as f32).count() as f64;
            let between: f64 = layers.windows(2).map(|w| 0.5 * (w[1].z - w[0].z) * (area(&w[0]) + area(&w[1]))).sum();
            let mut report = std::mem::take(&mut body.report);
            body.measure(&mut report).expect("its layers can be read");
            let volume = report.volume.expect("it has been measured");
            println!("volume {n}, label {}: {volume} by the surface, {between} by pixels", stack.labels[a]);
            assert!((volume - between).abs() < 0.03 * between, "volume {n}, label {}", stack.labels[a]);
            let slices = voxels.chunks_exact(SIZES[0] * SIZES[1]);
            let painted: Vec<bool> = slices.map(|slice| slice.contains(&(stack.labels[a] as u8))).collect();
            let last = painted.iter().rposition(|painted| *painted).expect("it is painted");
            beyond += layers[last + 1..].iter().map(|l| area(l) as usize).sum::<usize>();
        }
    }
    assert!(beyond > 200, "labels go on beyond their last slices: {beyond} pixels");
}

/// Pixels of layers that hang together with no drawn slice through pixels of their label.
fn in_the_air(layers: &[Layer]) -> usize {
    let [nx, ny, nz] = SIZES;
    let label = |v: usize| layers[v / (nx * ny)].phi[v % (nx * ny)];
    let mut seen: Vec<bool> = (0..nx * ny * nz).map(|v| label(v) == 0.0 || v / (nx * ny) % DRAWN == 0).collect();
    let mut front: Vec<usize> = (0..seen.len()).filter(|&v| seen[v] && label(v) > 0.0).collect();
    while let Some(v) = front.pop() {
        let [i, j, k] = [v % nx, v / nx % ny, v / (nx * ny)];
        let steps = [(i > 0, -1), (i + 1 < nx, 1), (j > 0, -(nx as isize)), (j + 1 < ny, nx as isize)];
        let along = [(k > 0, -((nx * ny) as isize)), (k + 1 < nz, (nx * ny) as isize)];
        for (_, step) in steps.into_iter().chain(along).filter(|(there, _)| *there) {
            let w = v.wrapping_add_signed(step);
            if !seen[w] && label(w) == label(v) {
                seen[w] = true;
                front.push(w);
            }
        }
    }
    seen.iter().filter(|seen| !**seen).count()
}

#[test]
fn what_others_leave_in_the_air_goes_to_what_is_around() {
    let mut turned = 0;
    for seed in 0..6 {
        let Run { mut decided, layers, .. } = run(&cells(seed));
        let floating = in_the_air(&layers);
        println!("cells {seed}: {} pixels were in the air", decided.borders.floating_pixels);
        turned += decided.borders.floating_pixels;
        assert_eq!(floating, 0, "cells {seed}");
        let written: usize = layers.iter().map(|l| l.phi.iter().filter(|v| **v > 0.0).count()).sum();
        assert_eq!(decided.voxels.iter().sum::<u64>(), written as u64);
        for (a, body) in decided.bodies.iter_mut().enumerate() {
            for (own, all) in layers_of(body).iter().zip(&layers) {
                assert!(own.phi.iter().zip(all.phi.iter()).all(|(phi, l)| (*phi < 0.0) == (*l == (a + 1) as f32)));
            }
        }
    }
    assert!(turned > 0, "there was something to mend");
}

/// Counts the stages that have begun.
#[derive(Default)]
struct Begun(std::sync::atomic::AtomicUsize);

impl progress::Progress for Begun {
    fn begin(&self, _stage: &'static str, _total: usize) {
        self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    }
    fn advance(&self, _units: usize) {}
    fn end(&self) {}
}

/// The union of the sectors needs more memory than any label, and is computed last.
#[test]
fn what_does_not_fit_into_memory_is_found_before_the_work() {
    let place = folder();
    let path = place.path().join("labels.nrrd");
    write(&path, &volume([1, 2, 3, 4]));
    let stack = read_labels(&path, &ReadOptions::default(), &Wanted::All).expect("it is sound");
    let heights = stack.stack.z_out.expect("a volume has a grid").heights().expect("the grid is small");
    let (settings, temporary) = (Settings::default(), std::env::temp_dir());
    let begun = |memory: u64| {
        let plan = Plan { heights: &heights, settings: &settings, folder: &temporary, beside: 0, memory: Some(memory) };
        let (listener, budget) = (Begun::default(), Budget::unlimited());
        let means = Means { backend: &Reference, progress: &listener, budget: &budget };
        let made = reconstruct(&stack, true, &plan, &means);
        let is_refused = matches!(made, Err(interslice::Error::Memory { .. }));
        assert_eq!(made.is_ok(), !is_refused);
        (is_refused, listener.0.into_inner())
    };
    // From far too little to what is enough, in steps finer than the labels differ.
    let enough = (0..400).map(|k| (8 << 20) + (k << 18)).find(|memory| {
        let (is_refused, stages) = begun(*memory);
        assert!(!is_refused || stages == 0, "{stages} stages had begun at {memory} bytes");
        !is_refused
    });
    println!("enough: {enough:?} bytes");
    assert!(enough.is_some_and(|memory| memory > 8 << 20));
}
