//! The topology zoo: every way in which contours can relate, each exact at its inputs, free of NaN, the same upside down, and connected
//! where its contours overlap.

mod shapes;
mod support;

use interslice::components::label4;
use interslice::progress::Silent;
use interslice::report::Event;
use interslice::settings::{EndRule, SlopeRule};
use interslice::stack::{ContourStack, SliceContent};
use interslice::surface::mesh::closed_surface;
use interslice::{Reconstruction, Reference, Settings, reconstruct_with};
use shapes::*;
use support::{edge_defects, merged};

const N: usize = 90;
/// |phi| of a stack and of the same stack upside down differ by rounding of heights to times and of f64 to f32 only.
const REVERSAL_TOLERANCE: f32 = 2e-3;

fn disc(y: f64, x: f64, r: f64) -> Shape {
    circle(x, y, r)
}

/// A bar of width `w` and length 50 through the middle.
fn bar(w: f64, angle: f64) -> Shape {
    let (c, s) = (angle.cos(), angle.sin());
    Box::new(move |x, y| {
        let (u, v) = ((y - 45.0) * c + (x - 45.0) * s, (x - 45.0) * c - (y - 45.0) * s);
        (u.abs() - 0.5 * w).max(v.abs() - 25.0)
    })
}

fn ring() -> Shape {
    without(disc(45.0, 45.0, 25.0), disc(45.0, 45.0, 12.0))
}

/// The ring, open to the right.
fn letter_c() -> Shape {
    without(ring(), Box::new(|x, y| ((y - 45.0).abs() - 6.0).max(45.0 - x)))
}

fn zoo() -> Vec<(&'static str, Vec<Shape>)> {
    let four = || {
        union(union(disc(30.0, 30.0, 9.0), disc(30.0, 60.0, 9.0)), union(disc(60.0, 30.0, 9.0), disc(60.0, 60.0, 9.0)))
    };
    let cross = |angle: f64| union(bar(8.0, angle), bar(8.0, angle + std::f64::consts::FRAC_PI_2));
    vec![
        ("one_to_one", vec![disc(45.0, 45.0, 20.0), disc(47.0, 44.0, 14.0)]),
        ("hole_born_and_dead", vec![disc(45.0, 45.0, 25.0), ring(), disc(45.0, 45.0, 25.0)]),
        ("hole_appears", vec![disc(45.0, 45.0, 22.0), ring(), ring()]),
        (
            "tiny_hole_off_centre",
            vec![
                disc(45.0, 45.0, 25.0),
                without(disc(45.0, 45.0, 25.0), disc(40.0, 52.0, 2.0)),
                disc(45.0, 45.0, 25.0),
            ],
        ),
        ("island_in_hole", vec![union(ring(), disc(45.0, 45.0, 5.0)), disc(45.0, 45.0, 27.0), ring()]),
        ("island_dies_in_hole", vec![union(ring(), disc(45.0, 45.0, 5.0)), ring(), ring()]),
        ("disjoint", vec![disc(30.0, 30.0, 9.0), disc(62.0, 62.0, 9.0), disc(30.0, 62.0, 9.0)]),
        (
            "appearing",
            vec![disc(45.0, 30.0, 12.0), union(disc(45.0, 30.0, 12.0), disc(45.0, 68.0, 8.0)), disc(45.0, 30.0, 12.0)],
        ),
        (
            "one_to_two",
            vec![
                disc(45.0, 45.0, 16.0),
                union(disc(45.0, 30.0, 10.0), disc(45.0, 60.0, 10.0)),
                union(disc(45.0, 25.0, 8.0), disc(45.0, 65.0, 8.0)),
            ],
        ),
        (
            "two_to_one",
            vec![union(disc(45.0, 28.0, 14.0), disc(50.0, 66.0, 5.0)), disc(46.0, 40.0, 26.0), disc(45.0, 45.0, 10.0)],
        ),
        ("one_to_four", vec![disc(45.0, 45.0, 20.0), four()]),
        ("four_to_four", vec![four(), union(bar(8.0, 0.0), bar(8.0, 1.57)), four()]),
        ("empty_middle", vec![disc(45.0, 45.0, 20.0), nothing(), disc(45.0, 45.0, 16.0)]),
        ("empty_ends", vec![nothing(), disc(45.0, 45.0, 20.0), nothing()]),
        ("identical", vec![ring(), ring(), ring()]),
        ("thin_line", vec![bar(1.0, 0.0), bar(1.0, 0.15), bar(1.0, 0.3)]),
        ("thin_diagonal", vec![bar(2.2, 0.8), bar(2.2, 0.9), bar(2.2, 1.2)]),
        ("single_pixel", vec![disc(45.0, 45.0, 0.8), disc(45.0, 46.0, 0.8), disc(45.0, 45.0, 12.0)]),
        (
            "square_to_circle",
            vec![square(45.0, 45.0, 24.0, 0.0), disc(45.0, 45.0, 24.0), square(45.0, 45.0, 24.0, 0.7)],
        ),
        ("small_in_big", vec![disc(45.0, 45.0, 28.0), disc(30.0, 50.0, 3.0), disc(45.0, 45.0, 28.0)]),
        ("cross_to_blob", vec![cross(0.0), disc(50.0, 40.0, 10.0), cross(0.78)]),
        ("letters_c_to_o", vec![letter_c(), ring(), disc(45.0, 45.0, 20.0)]),
        (
            "at_the_border",
            vec![disc(0.0, 40.0, 20.0), disc(10.0, 45.0, 20.0), union(disc(89.0, 89.0, 6.0), disc(5.0, 45.0, 30.0))],
        ),
        ("barely_overlapping", vec![disc(45.0, 30.0, 10.0), disc(45.0, 48.9, 10.0), disc(62.0, 55.0, 11.5)]),
        ("full_image", vec![disc(45.0, 45.0, 200.0), disc(45.0, 45.0, 20.0)]),
    ]
}

fn heights_of(count: usize) -> Vec<f64> {
    // Closely around each contour, and evenly between.
    let mut z: Vec<f64> = (0..=10 * (count - 1)).map(|k| k as f64).collect();
    for k in 0..count {
        z.extend([10.0 * k as f64 - 0.2, 10.0 * k as f64 + 0.2]);
    }
    z.retain(|z| (0.0..=10.0 * (count - 1) as f64).contains(z));
    z.sort_by(f64::total_cmp);
    z
}

fn run(stack: &ContourStack, heights: &[f64], settings: &Settings) -> Reconstruction {
    reconstruct_with(stack, heights, settings, &Reference, &Silent).expect("the stack is valid")
}

fn upside_down(stack: &ContourStack, top: f64) -> ContourStack {
    let mut turned = stack.clone();
    turned.slices.reverse();
    turned.slices.iter_mut().for_each(|s| s.z = top - s.z);
    turned
}

fn knots(count: usize) -> Vec<f64> {
    (0..count).map(|k| 10.0 * k as f64).collect()
}

#[test]
fn every_case_is_closed_exact_at_its_inputs_and_finite() {
    for (name, shapes) in zoo() {
        let stack = masks(N, &knots(shapes.len()), &shapes);
        let result = run(&stack, &heights_of(shapes.len()), &Settings::default());
        for contour in &result.report.contours {
            assert_eq!(contour.differing_pixels, 0, "{name}: {}", contour.name);
        }
        // The same once more without the report's help.
        for layer in &result.layers {
            assert!(layer.phi.iter().all(|v| v.is_finite() && *v != 0.0), "{name}: z = {}", layer.z);
            if let Some(i) = layer.contour {
                let SliceContent::Mask(mask) = &stack.slices[i].content else { panic!("masks went in") };
                let different = mask.iter().zip(&layer.phi).filter(|(m, v)| **m != (**v < 0.0)).count();
                assert_eq!(different, 0, "{name}: contour {i}");
            }
        }
        let mesh = closed_surface(&result);
        assert_eq!(edge_defects(&mesh.triangles), 0, "{name}");
        assert_eq!(edge_defects(&merged(&mesh)), 0, "{name}: after merging equal positions");
        assert!(mesh.volume() > 0.0, "{name}");
    }
}

#[test]
fn upside_down_gives_the_same_upside_down() {
    for (name, shapes) in zoo() {
        let top = 10.0 * (shapes.len() - 1) as f64;
        let stack = masks(N, &knots(shapes.len()), &shapes);
        let heights = heights_of(shapes.len());
        let turned_heights: Vec<f64> = heights.iter().rev().map(|z| top - z).collect();
        let up = run(&stack, &heights, &Settings::default());
        let down = run(&upside_down(&stack, top), &turned_heights, &Settings::default());
        assert_eq!(up.layers.len(), down.layers.len(), "{name}");
        for (a, b) in up.layers.iter().zip(down.layers.iter().rev()) {
            let worst = a.phi.iter().zip(&b.phi).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst <= REVERSAL_TOLERANCE, "{name}: |phi| differs by {worst} at z = {}", a.z);
        }
    }
}

/// Parts of a volume joined through faces: whether the pixels `from` on layer `a` and `to` on layer `b` belong to one.
fn connected(layers: &[&[f32]], dims: [usize; 2], from: (usize, usize), to: (usize, usize)) -> bool {
    let n = dims[0] * dims[1];
    let inside = |k: usize| layers[k / n][k % n] < 0.0;
    let mut seen = vec![false; n * layers.len()];
    let mut open = vec![from.0 * n + from.1];
    while let Some(k) = open.pop() {
        if !inside(k) || std::mem::replace(&mut seen[k], true) {
            continue;
        }
        let (i, j) = (k % n % dims[0], k % n / dims[0]);
        open.extend((i > 0).then(|| k - 1));
        open.extend((i + 1 < dims[0]).then_some(k + 1));
        open.extend((j > 0).then(|| k - dims[0]));
        open.extend((j + 1 < dims[1]).then_some(k + dims[0]));
        open.extend((k >= n).then(|| k - n));
        open.extend((k + n < seen.len()).then_some(k + n));
    }
    seen[to.0 * n + to.1]
}

#[test]
fn parts_that_overlap_are_connected() {
    for rule in [SlopeRule::Pchip, SlopeRule::Natural] {
        for (name, shapes) in zoo() {
            let stack = masks(N, &knots(shapes.len()), &shapes);
            let result = run(&stack, &heights_of(shapes.len()), &Settings { slope: rule, ..Settings::default() });
            let at: Vec<usize> = (0..result.layers.len()).filter(|&k| result.layers[k].contour.is_some()).collect();
            let masks: Vec<Vec<bool>> =
                at.iter().map(|&k| result.layers[k].phi.iter().map(|v| *v < 0.0).collect()).collect();
            for i in 0..at.len() - 1 {
                let (low, high) = (label4(&masks[i], [N, N]), label4(&masks[i + 1], [N, N]));
                let mut pairs = std::collections::BTreeMap::new();
                for node in 0..N * N {
                    if low.labels[node] > 0 && high.labels[node] > 0 {
                        pairs.entry((low.labels[node], high.labels[node])).or_insert(node);
                    }
                }
                let layers: Vec<&[f32]> = result.layers[at[i]..=at[i + 1]].iter().map(|l| l.phi.as_slice()).collect();
                for (pair, node) in pairs {
                    let joined = connected(&layers, [N, N], (0, node), (layers.len() - 1, node));
                    assert!(joined, "{name}, {rule:?}: parts {pair:?} of interval {i}");
                }
            }
        }
    }
}

#[test]
fn events_tell_what_happens() {
    let events = |name: &str| {
        let (_, shapes) = zoo().into_iter().find(|(n, _)| *n == name).expect("a case of the zoo");
        let stack = masks(N, &knots(shapes.len()), &shapes);
        let result = run(&stack, &[0.0], &Settings::default());
        result.report.intervals.into_iter().map(|i| i.events).collect::<Vec<_>>()
    };
    assert_eq!(events("one_to_one"), [vec![]]);
    assert_eq!(events("one_to_four"), [vec![Event::Split { from: vec![1], to: vec![1, 2, 3, 4] }]]);
    assert_eq!(events("two_to_one")[0], [Event::Merge { from: vec![1, 2], to: vec![1] }]);
    assert_eq!(events("appearing"), [vec![Event::Birth { component: 2 }], vec![Event::Death { component: 2 }]]);
    assert_eq!(events("disjoint")[0], [Event::Birth { component: 1 }, Event::Death { component: 1 }]);
    assert!(matches!(events("hole_born_and_dead")[..], [ref a, ref b]
        if matches!(a[..], [Event::HoleBirth { pixels: 430..450 }]) && matches!(b[..], [Event::HoleDeath { pixels: 430..450 }])));
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (_, shapes) = zoo().into_iter().find(|(n, _)| *n == "cross_to_blob").expect("a case of the zoo");
    let stack = masks(N, &knots(3), &shapes);
    let settings = Settings { end_top: EndRule::Extrapolate, ..Settings::default() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        pool.install(|| run(&stack, &heights_of(3), &settings))
    };
    let (one, five) = (with(1), with(5));
    assert_eq!(one.layers.len(), five.layers.len());
    for (a, b) in one.layers.iter().zip(&five.layers) {
        assert!(a.phi.iter().zip(&b.phi).all(|(a, b)| a.to_bits() == b.to_bits()), "z = {}", a.z);
    }
}
