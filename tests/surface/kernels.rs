//! Each reference kernel against mathematics: distances of known shapes, orders of convergence, a second transcription, signs.

use std::borrow::Cow;

use crate::shapes::{Shape, circle, square, union};
use glam::DVec2;
use interslice::backend::jobs::{PartJob, TraceJob};
use interslice::backend::{ContourOptions, MorphOptions};
use interslice::contour::seeds::{Seed, seeds, trace_loops};
use interslice::grid::field::{Field, position};
use interslice::grid::stencil::{Eikonal, godunov, weno5};
use interslice::reference::band::Band;
use interslice::reference::contour_field::{field_of_level, field_of_mask};
use interslice::reference::distance::distance_of;
use interslice::reference::exact::exact_distance;
use interslice::reference::extend::Upwind;
use interslice::reference::hj_step::{Scratch, Speed, Tube, hj_step};
use interslice::reference::part::part_field;
use interslice::reference::reinit::reinit;
use interslice::reference::scatter::scatter;
use interslice::reference::trace::{arrival, trace};
use interslice::settings::{AntiAlias, Settings};
use proptest::prelude::*;

const SQUARE: [f64; 2] = [1.0, 1.0];

fn field(dims: [usize; 2], h: [f64; 2], f: &Shape) -> Field {
    Field::from_fn(dims, |i, j| f(i as f64 * h[0], j as f64 * h[1]))
}

/// Largest and mean of `f` over the pixels where `near` holds.
fn stats(phi: &Field, near: impl Fn(usize, f64) -> bool, f: impl Fn(usize, f64) -> f64) -> (f64, f64) {
    let values: Vec<f64> =
        phi.data.iter().enumerate().filter(|(k, v)| near(*k, **v)).map(|(k, v)| f(k, *v).abs()).collect();
    assert!(values.len() > 20, "something is compared");
    (values.iter().copied().fold(0.0, f64::max), values.iter().sum::<f64>() / values.len() as f64)
}

#[test]
fn sweeping_gives_distances_of_first_order() {
    // The same circle on finer and finer grids: the error in units of the circle halves with the pixel.
    let errors = [1.0, 0.5, 0.25].map(|pixel: f64| {
        let n = (60.0 / pixel) as usize;
        let shape = circle(30.2 / pixel, 29.7 / pixel, 15.0 / pixel);
        // Not a distance to begin with: the square of one.
        let u = field([n, n], SQUARE, &shape);
        let bent = Field { dims: u.dims, data: u.data.iter().map(|v| v * (1.0 + 0.02 * pixel * v.abs())).collect() };
        let d = distance_of(&bent, SQUARE);
        pixel * stats(&d, |_, v| v.abs() < 10.0 / pixel, |k, v| v - u.data[k]).0
    });
    println!("largest errors {errors:.4?}");
    assert!(errors[1] < 0.65 * errors[0] && errors[2] < 0.65 * errors[1], "{errors:?}");
    assert!(errors[0] < 0.4);
}

/// Largest error on a line through the middle, turned by `degrees`, within `near` px of it and away from the field's edge.
fn line_error(degrees: f64, h: [f64; 2], near: f64, distance: impl Fn(&Field) -> Field) -> f64 {
    let (s, c) = degrees.to_radians().sin_cos();
    let line: Shape = Box::new(move |x, y| (x - 39.6 * h[0]) * c + (y - 39.3 * h[1]) * s);
    let u = field([80, 80], h, &line);
    let d = distance(&u);
    let inner = |k: usize| (25..55).contains(&(k % 80)) && (25..55).contains(&(k / 80));
    stats(&d, |k, v| inner(k) && v.abs() < near, |k, v| v - u.data[k]).0
}

#[test]
fn sweeping_is_exact_along_axes_and_conditioning_mends_rotated_lines() {
    let options = ContourOptions { anti_alias: AntiAlias::None, sigma: 1.0, half_width: 6.0 };
    for h in [SQUARE, [0.45, 1.0], [1.0, 0.6]] {
        for degrees in [0.0, 90.0] {
            assert!(line_error(degrees, h, 6.0, |u| distance_of(u, h)) < 1e-9, "{degrees} degrees, h = {h:?}");
        }
        for degrees in [17.0, 30.0, 40.0, 45.0, 50.0, 71.0] {
            // A pixel with a crossing along one axis only takes that as its distance: up to half a pixel too far.
            let swept = line_error(degrees, h, 6.0, |u| distance_of(u, h));
            let conditioned = line_error(degrees, h, 2.0, |u| field_of_level(u, h, options));
            println!("{degrees} degrees, h = {h:?}: swept {swept:.3}, conditioned {conditioned:.4}");
            assert!(swept < 0.51 && conditioned < 0.05, "{degrees} degrees, h = {h:?}: {swept} {conditioned}");
        }
    }
}

#[test]
fn the_eikonal_update_solves_its_equation() {
    for (a, b, h) in [(0.0, 0.0, SQUARE), (1.0, 1.4, SQUARE), (2.0, 2.3, [0.5, 1.0]), (2.3, 2.0, [0.5, 1.0])] {
        let v = Eikonal::new(h).solve(a, b);
        let residual = ((v - a).max(0.0) / h[0]).powi(2) + ((v - b).max(0.0) / h[1]).powi(2) - 1.0;
        assert!(residual.abs() < 1e-12 && v > a.min(b), "{a} {b} {h:?}: {v}");
    }
    assert_eq!(Eikonal::new(SQUARE).solve(0.0, 1e30), 1.0, "a neighbour that is not there says nothing");
}

#[test]
fn exact_distance_equals_the_search_over_all_pixels() {
    let h = [0.6, 1.0];
    let shape = union(circle(9.0, 8.0, 5.0), circle(20.0, 12.0, 3.0));
    let dims = [30, 22];
    let mask: Vec<bool> = field(dims, SQUARE, &shape).data.iter().map(|v| *v < 0.0).collect();
    let exact = exact_distance(&mask, dims, h);
    for k in 0..mask.len() {
        let nearest = (0..mask.len())
            .filter(|n| mask[*n] != mask[k])
            .map(|n| ((n % 30).abs_diff(k % 30) as f64, (n / 30).abs_diff(k / 30) as f64))
            .min_by(|a, b| (a.0 * h[0]).hypot(a.1 * h[1]).total_cmp(&(b.0 * h[0]).hypot(b.1 * h[1])))
            .expect("both sides exist");
        let d = (nearest.0 * h[0]).hypot(nearest.1 * h[1]);
        // Pixels at equal distance in different directions may lie a different share of a pixel away.
        assert!((exact.data[k].abs() - d).abs() <= 0.5 + 1e-12, "pixel {k}");
        assert!((exact.data[k].abs() - d * (1.0 - 0.5 / nearest.0.hypot(nearest.1))).abs() < 0.3, "pixel {k}");
        assert_eq!(exact.data[k] < 0.0, mask[k]);
    }
    assert!(exact_distance(&[false; 9], [3, 3], SQUARE).data.iter().all(|v| *v == f64::INFINITY));
}

/// WENO5 once more, from Jiang and Peng's text: three third-order derivatives with nonlinear weights.
fn weno5_plainly(v: [f64; 5]) -> f64 {
    let candidates = [
        (2.0 * v[0] - 7.0 * v[1] + 11.0 * v[2]) / 6.0,
        (-v[1] + 5.0 * v[2] + 2.0 * v[3]) / 6.0,
        (2.0 * v[2] + 5.0 * v[3] - v[4]) / 6.0,
    ];
    let smoothness = [
        13.0 / 12.0 * (v[0] - 2.0 * v[1] + v[2]).powi(2) + (v[0] - 4.0 * v[1] + 3.0 * v[2]).powi(2) / 4.0,
        13.0 / 12.0 * (v[1] - 2.0 * v[2] + v[3]).powi(2) + (v[1] - v[3]).powi(2) / 4.0,
        13.0 / 12.0 * (v[2] - 2.0 * v[3] + v[4]).powi(2) + (3.0 * v[2] - 4.0 * v[3] + v[4]).powi(2) / 4.0,
    ];
    let raw: Vec<f64> = [0.1, 0.6, 0.3].iter().zip(smoothness).map(|(c, s)| c / ((1e-6 + s) * (1e-6 + s))).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().zip(candidates).map(|(w, c)| w / sum * c).sum()
}

proptest! {
    #[test]
    fn weno5_agrees_with_a_second_transcription(v in prop::array::uniform5(-14.0f64..14.0)) {
        let (a, b) = (weno5(v[0], v[1], v[2], v[3], v[4]), weno5_plainly(v));
        prop_assert!((a - b).abs() <= 1e-9 * (1.0 + b.abs()), "{a} {b}");
    }
}

#[test]
fn weno5_is_fifth_order_on_smooth_data() {
    let error = |h: f64| {
        let f = |k: i32| ((1.0 + f64::from(k) * h).sin() - (1.0 + f64::from(k - 1) * h).sin()) / h;
        (weno5(f(-2), f(-1), f(0), f(1), f(2)) - 1f64.cos()).abs()
    };
    let order = (error(0.1) / error(0.05)).log2();
    assert!(order > 4.5, "order {order}");
}

#[test]
fn godunov_takes_the_upwind_side() {
    // A valley: moving outward (F > 0) nothing flows in, moving inward both sides do. The control case is the other sign.
    assert_eq!(godunov((-1.0, 1.0), (0.0, 0.0), 1.0), 0.0);
    assert_eq!(godunov((-1.0, 1.0), (0.0, 0.0), -1.0), 1.0);
    assert_eq!(godunov((3.0, 3.0), (4.0, 4.0), 1.0), 5.0);
    assert_eq!(godunov((3.0, 3.0), (4.0, 4.0), -1.0), 5.0);
}

/// Mean radius over the pixels next to the front, about (c, c).
fn radius(phi: &Field, c: f64) -> f64 {
    let nx = phi.dims[0];
    let near: Vec<f64> = phi
        .data
        .iter()
        .enumerate()
        .filter(|(_, v)| v.abs() < 1.0)
        .map(|(k, v)| ((k % nx) as f64 - c).hypot((k / nx) as f64 - c) - v)
        .collect();
    near.iter().sum::<f64>() / near.len() as f64
}

#[test]
fn positive_speed_moves_outward_by_speed_times_time() {
    let mut phi = field([80, 80], SQUARE, &circle(39.3, 39.3, 18.0));
    let mut band = Band::new(&mut phi, 6.0);
    let speed = Field::filled([80, 80], 1.0);
    let mut scratch = Scratch::default();
    for _ in 0..16 {
        hj_step(&mut phi, Speed::Given(&speed), &band, SQUARE, Tube { beta: 3.0, gamma: 6.0 }, 0.5, &mut scratch);
        reinit(&mut phi, &band, SQUARE, 1, &mut scratch);
        band.rebuild(&mut phi);
    }
    let r = radius(&phi, 39.3);
    assert!((r - 26.0).abs() < 0.02, "{r}");
}

#[test]
fn reinit_restores_distance_and_hardly_moves_the_contour() {
    let exact = field([90, 90], SQUARE, &circle(44.2, 44.9, 24.0));
    let steep = Field { dims: exact.dims, data: exact.data.iter().map(|v| 1.8 * v).collect() };
    let mut phi = steep.clone();
    let band = Band::new(&mut phi, 8.0);
    reinit(&mut phi, &band, SQUARE, 30, &mut Scratch::default());
    let gradient = |k: usize, _| {
        let g = phi.gradient(k, SQUARE);
        g[0].hypot(g[1]) - 1.0
    };
    let (max, mean) = stats(&phi, |_, v| v.abs() < 2.0, gradient);
    assert!(max < 0.02 && mean < 0.003, "gradient off by {max}, {mean}");
    let (moved, _) = stats(&phi, |_, v| v.abs() < 0.5, |k, v| v - exact.data[k]);
    assert!(moved < 0.04, "contour moved by {moved}");
    // The control: the field that came in was no distance.
    let (max, _) = stats(
        &steep,
        |_, v| v.abs() < 2.0,
        |k, _| {
            let g = steep.gradient(k, SQUARE);
            g[0].hypot(g[1]) - 1.0
        },
    );
    assert!(max > 0.5);
}

#[test]
fn the_band_holds_the_tube_and_its_ring_in_row_order() {
    let mut phi = field([70, 66], SQUARE, &square(33.0, 32.0, 14.0, 0.3));
    let before = phi.clone();
    let mut band = Band::new(&mut phi, 5.0);
    let brute = |phi: &Field, gamma: f64| -> Vec<usize> {
        let tube = |i: i64, j: i64| {
            (4..66).contains(&i) && (4..62).contains(&j) && phi.data[(j * 70 + i) as usize].abs() < gamma
        };
        let in_n = |k: &usize| {
            let (i, j) = ((k % 70) as i64, (k / 70) as i64);
            (-1..=1).any(|dj| (-1..=1).any(|di| tube(i + di, j + dj)))
        };
        (0..70 * 66).filter(in_n).collect()
    };
    assert_eq!(band.nodes().collect::<Vec<_>>(), brute(&before, 5.0));
    assert_eq!(band.count, band.nodes().count());
    // Move the front and follow it; the tube is the one that a look at the whole tile would find.
    let speed = Field::filled(phi.dims, -1.0);
    let mut scratch = Scratch::default();
    for _ in 0..8 {
        hj_step(&mut phi, Speed::Given(&speed), &band, SQUARE, Tube { beta: 2.0, gamma: 5.0 }, 0.5, &mut scratch);
        reinit(&mut phi, &band, SQUARE, 1, &mut scratch);
        band.rebuild(&mut phi);
        assert_eq!(band.nodes().collect::<Vec<_>>(), brute(&phi, 5.0));
        let inside: Vec<usize> = band.nodes().collect();
        assert!((0..phi.data.len()).all(|k| inside.binary_search(&k).is_ok() || phi.data[k].abs() == 5.5));
    }
}

#[test]
fn extension_keeps_values_constant_along_normals() {
    let mut phi = field([90, 90], SQUARE, &circle(44.3, 44.6, 25.0));
    let band = Band::new(&mut phi, 6.0);
    let angle = |k: usize| ((k / 90) as f64 - 44.6).atan2((k % 90) as f64 - 44.3);
    let mut values: Vec<[f64; 1]> =
        (0..phi.data.len()).map(|k| if phi.at_contour_or_edge(k) { [angle(k).sin()] } else { [0.0] }).collect();
    let mut upwind = Upwind::default();
    upwind.find(&phi, &band, SQUARE);
    upwind.extend(&mut values, &band, 12, &mut Vec::new());
    let (max, mean) = stats(&phi, |_, v| v.abs() < 5.5, |k, _| values[k][0] - angle(k).sin());
    assert!(max < 0.05 && mean < 0.01, "{max} {mean}");
}

/// `Field::at_contour` reads four neighbours; a test walks over the whole field.
trait AtContour {
    fn at_contour_or_edge(&self, node: usize) -> bool;
}

impl AtContour for Field {
    fn at_contour_or_edge(&self, node: usize) -> bool {
        let [nx, ny] = self.dims;
        let (i, j) = (node % nx, node / nx);
        i > 0 && j > 0 && i + 1 < nx && j + 1 < ny && self.at_contour(node)
    }
}

#[test]
fn scatter_gives_seed_values_to_the_contour_whatever_their_order() {
    let mut phi = field([70, 70], SQUARE, &circle(34.3, 34.6, 20.0));
    let band = Band::new(&mut phi, 6.0);
    let places: Vec<DVec2> = seeds(&phi, SQUARE, 0.5).iter().map(|s| s.x).collect();
    let value = |x: DVec2| [(x.y - 34.6).atan2(x.x - 34.3).cos()];
    let values: Vec<[f64; 1]> = places.iter().map(|x| value(*x)).collect();
    let out = scatter(&phi, &band, SQUARE, &places, &values);
    let at = |k: usize| value(position(k, 70))[0];
    let (max, _) = stats(&phi, |k, _| phi.at_contour_or_edge(k), |k, _| out[k][0] - at(k));
    assert!(max < 0.01, "{max}");
    // Pixels that no seed reaches are filled from their neighbours.
    let some: Vec<usize> = (0..places.len()).filter(|k| k % 20 < 3).collect();
    let (few, few_values): (Vec<_>, Vec<_>) = some.iter().map(|&k| (places[k], values[k])).unzip();
    let out = scatter(&phi, &band, SQUARE, &few, &few_values);
    let (max, _) = stats(&phi, |k, _| phi.at_contour_or_edge(k), |k, _| out[k][0] - at(k));
    assert!(max < 0.3, "{max}");
}

#[test]
fn seeds_lie_evenly_on_the_contour() {
    for h in [SQUARE, [0.5, 1.0]] {
        let phi = field([140, 70], h, &circle(30.3, 31.7, 20.0));
        let found = seeds(&phi, h, 0.5);
        let length = std::f64::consts::TAU * 20.0;
        assert!((found.len() as f64 - length / 0.5).abs() < 0.02 * length / 0.5, "{} seeds", found.len());
        for s in &found {
            let r = (s.x * DVec2::from(h)).distance(DVec2::new(30.3, 31.7));
            assert!((r - 20.0).abs() < 0.02, "radius {r}");
            assert!(phi.data[s.inside] < 0.0 && phi.data[s.outside] >= 0.0);
        }
    }
}

#[test]
fn loops_are_closed_and_keep_the_inside_on_one_side() {
    let ring: Shape = Box::new(|x, y| ((x - 20.0).hypot(y - 20.0) - 11.0).abs() - 4.0);
    let loops = trace_loops(&field([41, 41], SQUARE, &ring));
    assert_eq!(loops.len(), 2);
    let area = |path: &Vec<interslice::contour::seeds::Crossing>| -> f64 {
        let n = path.len();
        (0..n).map(|k| (path[k].x, path[(k + 1) % n].x)).map(|(a, b)| 0.5 * (a[0] * b[1] - a[1] * b[0])).sum()
    };
    let pi = std::f64::consts::PI;
    assert!((area(&loops[0]) - pi * 225.0).abs() < 3.0, "outer, counter-clockwise: {}", area(&loops[0]));
    assert!((area(&loops[1]) + pi * 49.0).abs() < 2.0, "inner, clockwise: {}", area(&loops[1]));
    // A saddle: two pixels that touch at a corner.
    let saddle = Field { dims: [4, 4], data: (0..16).map(|k| if k == 5 || k == 10 { -1.0 } else { 1.0 }).collect() };
    assert_eq!(trace_loops(&saddle).len(), 2, "the mean of the corners is 0: parted");
    let joined = Field { dims: [4, 4], data: (0..16).map(|k| if k == 5 || k == 10 { -2.0 } else { 1.0 }).collect() };
    assert_eq!(trace_loops(&joined).len(), 1);
}

fn morph(source: &Field, goal: &Field, h: [f64; 2]) -> interslice::backend::jobs::Traced {
    let job = TraceJob { source: Cow::Borrowed(source), goal: Cow::Borrowed(goal), seeds: seeds(source, h, 0.5) };
    trace(&job, h, &MorphOptions::from(&Settings::default()))
}

#[test]
fn particles_measure_the_signed_distance_between_circles() {
    for (a, b) in [(14.0, 30.0), (30.0, 14.0), (20.0, 20.0), (6.0, 11.0)] {
        for h in [SQUARE, [1.0, 0.5]] {
            let dims = [100, (100.0 / h[1]) as usize];
            let (source, goal) = (field(dims, h, &circle(49.7, 50.2, a)), field(dims, h, &circle(49.7, 50.2, b)));
            let traced = morph(&source, &goal, h);
            let worst = traced.tracks.iter().map(|t| (t.distance - (b - a)).abs()).fold(0.0, f64::max);
            let lost = traced.tracks.iter().filter(|t| !t.arrived()).count();
            println!("{a} -> {b}, h = {h:?}: S off by {worst:.4}, {} steps", traced.steps);
            assert!(worst <= 0.03, "{a} -> {b}, h = {h:?}: S off by {worst}");
            assert_eq!(lost, 0);
            for t in &traced.tracks {
                let r = (t.landing * DVec2::from(h)).distance(DVec2::new(49.7, 50.2));
                assert!((r - b).abs() < 0.06, "landed at radius {r}");
                assert!((t.arc - (b - a).abs()).abs() < 0.1, "arc {} for {}", t.arc, b - a);
            }
        }
    }
}

#[test]
fn particles_without_counterpart_die_and_say_so() {
    // A disc with an arm against the disc alone: what is on the arm has nowhere to go.
    let arm = square(60.0, 40.0, 3.0, 0.0);
    let long: Shape = Box::new(move |x, y| arm(x.clamp(20.0, 75.0).max(x - 12.0).min(60.0), y).max(x - 75.0));
    let disc = circle(40.0, 40.0, 14.0);
    let source = distance_of(&field([100, 80], SQUARE, &union(disc, long)), SQUARE);
    let goal = field([100, 80], SQUARE, &circle(40.0, 40.0, 14.0));
    let traced = morph(&source, &goal, SQUARE);
    let seeds: Vec<Seed> = seeds(&source, SQUARE, 0.5);
    let far_dead =
        seeds.iter().zip(&traced.tracks).filter(|(s, t)| s.x.x > 62.0 && s.x.x < 70.0 && !t.arrived()).count();
    let near_alive = seeds.iter().zip(&traced.tracks).filter(|(s, t)| s.x.x < 35.0 && t.arrived()).count();
    assert!(far_dead > 10, "{far_dead}");
    assert!(near_alive > 30, "{near_alive}");
    for (s, t) in seeds.iter().zip(&traced.tracks).filter(|(s, t)| s.x.x > 62.0 && s.x.x < 70.0 && !t.arrived()) {
        assert!(t.distance < -3.0, "at {:?} the arm is {} away from nothing", s.x, t.distance);
    }
}

#[test]
fn anti_aliasing_never_flips_a_pixel_and_smooths() {
    let shape = circle(30.3, 29.6, 10.0);
    let exact = field([60, 60], SQUARE, &shape);
    let mask: Vec<bool> = exact.data.iter().map(|v| *v < 0.0).collect();
    let rms = |anti_alias| {
        let options = ContourOptions { anti_alias, sigma: 1.5, half_width: 6.0 };
        let phi = field_of_mask(&mask, [60, 60], SQUARE, options);
        assert!(phi.data.iter().zip(&mask).all(|(v, m)| (*v < 0.0) == *m && v.is_finite()));
        let near: Vec<f64> =
            phi.data.iter().zip(&exact.data).filter(|(v, _)| v.abs() < 1.0).map(|(v, e)| v - e).collect();
        (near.iter().map(|e| e * e).sum::<f64>() / near.len() as f64).sqrt()
    };
    let [none, eq6, kernel] = [AntiAlias::None, AntiAlias::Eq6, AntiAlias::Kernel].map(rms);
    println!("rms: none {none:.3}, eq6 {eq6:.3}, kernel {kernel:.3}");
    assert!(kernel < 0.85 * none && eq6 < 0.95 * none, "{none} {eq6} {kernel}");
    assert!(
        field_of_mask(
            &[false; 400],
            [20, 20],
            SQUARE,
            ContourOptions { anti_alias: AntiAlias::Kernel, sigma: 1.0, half_width: 6.0 }
        )
        .data
        .iter()
        .all(|v| *v == f64::INFINITY)
    );
}

#[test]
fn grey_slices_keep_their_sub_pixel_contour() {
    let exact = field([80, 80], SQUARE, &circle(40.3, 39.6, 20.0));
    let grey = Field { dims: exact.dims, data: exact.data.iter().map(|v| (3.0 * v).clamp(-6.0, 6.0)).collect() };
    let options = ContourOptions { anti_alias: AntiAlias::Kernel, sigma: 1.0, half_width: 6.0 };
    let phi = field_of_level(&grey, SQUARE, options);
    let (max, mean) = stats(&phi, |_, v| v.abs() < 1.0, |k, v| v - exact.data[k]);
    assert!(max < 0.04 && mean < 0.01, "{max} {mean}");
}

#[test]
fn a_part_keeps_the_field_where_it_is_nearest() {
    let whole =
        distance_of(&field([90, 60], SQUARE, &union(circle(25.0, 30.0, 12.0), circle(62.0, 30.0, 9.0))), SQUARE);
    let inside: Vec<bool> = (0..whole.data.len()).map(|k| whole.data[k] < 0.0 && k % 90 < 45).collect();
    let part = part_field(&PartJob { whole: whole.clone(), inside: inside.clone() }, SQUARE);
    let alone = field([90, 60], SQUARE, &circle(25.0, 30.0, 12.0));
    assert_eq!(part.data.len(), inside.len());
    for (k, is_inside) in inside.iter().enumerate() {
        assert_eq!(part.data[k] < 0.0, *is_inside);
        assert!((part.data[k] - alone.data[k]).abs() < 0.8, "pixel {k}: {} against {}", part.data[k], alone.data[k]);
        if k % 90 < 40 {
            assert_eq!(part.data[k].to_bits(), whole.data[k].to_bits(), "pixel {k}");
        }
    }
}

#[test]
fn what_is_missed_is_measured_on_the_contour() {
    let mut phi = field([40, 40], SQUARE, &circle(20.3, 19.6, 9.0));
    let band = Band::new(&mut phi, 6.0);
    let wider = arrival(&phi, &field([40, 40], SQUARE, &circle(20.3, 19.6, 11.0)), &band).expect("a contour");
    assert!((wider.mean - 2.0).abs() < 0.02 && (wider.max - 2.0).abs() < 0.05, "{wider:?}");
    // Beside its goal by 1 px: |cos| of the angle, whose mean over a circle is 2 / pi.
    let beside = arrival(&phi, &field([40, 40], SQUARE, &circle(21.3, 19.6, 9.0)), &band).expect("a contour");
    assert!((beside.mean - std::f64::consts::FRAC_2_PI).abs() < 0.05, "{beside:?}");
    assert!((beside.max - 1.0).abs() < 0.05, "{beside:?}");
    let mut empty = Field::filled([40, 40], 3.0);
    let band = Band::new(&mut empty, 6.0);
    assert!(arrival(&empty, &phi, &band).is_none());
}
