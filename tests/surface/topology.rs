//! The topology zoo: every way in which contours can relate, each exact at its inputs, free of NaN, the same upside down, and connected
//! where its contours overlap.

use crate::shapes::zoo::{N, zoo};
use crate::shapes::*;
use crate::support::{connected, edge_defects, merged};
use interslice::grid::components::label4;
use interslice::progress::Silent;
use interslice::report::Event;
use interslice::settings::{EndRule, Linking, Method, Motion, SlopeRule};
use interslice::stack::{ContourStack, SliceContent};
use interslice::surface::mesh::closed_surface;
use interslice::{Reconstruction, Reference, Settings, reconstruct_with};

/// |phi| of a stack and of the same stack upside down differ by rounding of heights to times and of f64 to f32 only.
const REVERSAL_TOLERANCE: f32 = 2e-3;
/// In a moving frame trajectories are found to a thousandth of a pixel, and fairing reads steep places along them.
const MOVING_TOLERANCE: f32 = 1e-2;
/// Parts that are thinner may be lost on the way to another frame, inradius in px.
const LEAST_DEPTH: f32 = 1.0;

/// Both methods, plain and with everything on.
fn ways() -> Vec<(&'static str, Settings)> {
    vec![
        ("morph", plain()),
        ("morph, natural slopes", Settings { slope: SlopeRule::Natural, ..plain() }),
        (
            "morph, moving, faired",
            Settings { method: Method::Morph, motion: Motion::Field, fair: 1.25, ..Settings::default() },
        ),
        ("field", Settings { method: Method::Field, motion: Motion::None, fair: 0.0, ..Settings::default() }),
        (
            "field, moving, faired",
            Settings { method: Method::Field, motion: Motion::Field, fair: 1.25, ..Settings::default() },
        ),
        ("morph, linked", Settings { link: Linking::Auto, link_reach: 20.0, ..Settings::default() }),
        (
            "field, rigid, linked",
            Settings {
                method: Method::Field,
                motion: Motion::Rigid,
                link: Linking::Auto,
                link_reach: 20.0,
                ..Settings::default()
            },
        ),
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

fn knots(count: usize) -> Vec<f64> {
    (0..count).map(|k| 10.0 * k as f64).collect()
}

#[test]
fn every_case_is_closed_exact_at_its_inputs_and_finite() {
    for ((way, settings), (name, shapes)) in
        ways().into_iter().flat_map(|w| zoo().into_iter().map(move |z| (w.clone(), z)))
    {
        let stack = masks(N, &knots(shapes.len()), &shapes);
        let result = run(&stack, &heights_of(shapes.len()), &settings);
        for contour in &result.report.contours {
            assert_eq!(contour.differing_pixels, 0, "{way}, {name}: {}", contour.name);
        }
        // The same once more without the report's help.
        for layer in &result.layers {
            assert!(layer.phi.iter().all(|v| v.is_finite() && *v != 0.0), "{way}, {name}: z = {}", layer.z);
            if let Some(i) = layer.contour {
                let SliceContent::Mask(mask) = &stack.slices[i].content else { panic!("masks went in") };
                let different = mask.iter().zip(layer.phi.iter()).filter(|(m, v)| *m != (**v < 0.0)).count();
                assert_eq!(different, 0, "{way}, {name}: contour {i}");
            }
        }
        let mesh = closed_surface(&result);
        assert_eq!(edge_defects(&mesh.triangles), 0, "{way}, {name}");
        assert_eq!(edge_defects(&merged(&mesh)), 0, "{way}, {name}: after merging equal positions");
        assert!(mesh.volume() > 0.0, "{way}, {name}");
    }
}

#[test]
fn upside_down_gives_the_same_upside_down() {
    for ((way, settings), (name, shapes)) in
        ways().into_iter().flat_map(|w| zoo().into_iter().map(move |z| (w.clone(), z)))
    {
        let top = 10.0 * (shapes.len() - 1) as f64;
        let stack = masks(N, &knots(shapes.len()), &shapes);
        let heights = heights_of(shapes.len());
        let turned_heights: Vec<f64> = heights.iter().rev().map(|z| top - z).collect();
        let up = run(&stack, &heights, &settings);
        let down = run(&upside_down(&stack, top), &turned_heights, &settings);
        assert_eq!(up.layers.len(), down.layers.len(), "{way}, {name}");
        let tolerance = if settings.motion == Motion::None { REVERSAL_TOLERANCE } else { MOVING_TOLERANCE };
        for (a, b) in up.layers.iter().zip(down.layers.iter().rev()) {
            let worst = a.phi.iter().zip(b.phi.iter()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst <= tolerance, "{way}, {name}: |phi| differs by {worst} at z = {}", a.z);
        }
    }
}

#[test]
fn parts_that_overlap_are_connected() {
    for (way, settings) in ways() {
        for (name, shapes) in zoo() {
            let stack = masks(N, &knots(shapes.len()), &shapes);
            let result = run(&stack, &heights_of(shapes.len()), &settings);
            let at: Vec<usize> = (0..result.layers.len()).filter(|&k| result.layers[k].contour.is_some()).collect();
            let masks: Vec<Vec<bool>> =
                at.iter().map(|&k| result.layers[k].phi.iter().map(|v| *v < 0.0).collect()).collect();
            for i in 0..at.len() - 1 {
                let (low, high) = (label4(&masks[i], [N, N]), label4(&masks[i + 1], [N, N]));
                let mut pairs = std::collections::BTreeMap::new();
                let depths = [(&low, at[i]), (&high, at[i + 1])].map(|(parts, k)| {
                    let mut depths = vec![0.0f32; parts.count + 1];
                    for (label, v) in parts.labels.iter().zip(result.layers[k].phi.iter()) {
                        depths[*label as usize] = depths[*label as usize].max(-v);
                    }
                    depths
                });
                let thick = |node: usize| {
                    let least = if settings.motion == Motion::None { 0.0 } else { LEAST_DEPTH };
                    depths[0][low.labels[node] as usize] > least && depths[1][high.labels[node] as usize] > least
                };
                for node in 0..N * N {
                    if low.labels[node] > 0 && high.labels[node] > 0 && thick(node) {
                        pairs.entry((low.labels[node], high.labels[node])).or_insert(node);
                    }
                }
                let layers: Vec<Vec<f32>> = result.layers[at[i]..=at[i + 1]].iter().map(|l| l.dense()).collect();
                let layers: Vec<&[f32]> = layers.iter().map(Vec::as_slice).collect();
                for (pair, node) in pairs {
                    let joined = connected(&layers, [N, N], (0, node), (layers.len() - 1, node));
                    assert!(joined, "{way}, {name}: parts {pair:?} of interval {i}");
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
        let result = run(&stack, &[0.0], &plain());
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
fn holes_have_the_pixels_that_were_drawn_by_every_method_and_motion() {
    for name in ["hole_born_and_dead", "tiny_hole_off_centre"] {
        let (_, shapes) = zoo().into_iter().find(|(n, _)| *n == name).expect("a case of the zoo");
        let stack = masks(N, &knots(shapes.len()), &shapes);
        // Both holes lie near the middle of their discs.
        let near = |n: usize| (n % N).abs_diff(45).max((n / N).abs_diff(45)) < 15;
        let sides = stack.slices[1].content.sides();
        let pixels = sides.iter().enumerate().filter(|(n, inside)| near(*n) && !**inside).count();
        assert!(pixels > 0);
        for (way, settings) in ways() {
            let found: Vec<Vec<Event>> = run(&stack, &[0.0], &settings)
                .report
                .intervals
                .into_iter()
                .map(|interval| interval.events)
                .map(|all| all.into_iter().filter(|e| matches!(e, Event::HoleBirth { .. } | Event::HoleDeath { .. })))
                .map(Iterator::collect)
                .collect();
            let told = [vec![Event::HoleBirth { pixels }], vec![Event::HoleDeath { pixels }]];
            assert_eq!(found, told, "{name}, {way}");
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (_, shapes) = zoo().into_iter().find(|(n, _)| *n == "cross_to_blob").expect("a case of the zoo");
    let stack = masks(N, &knots(3), &shapes);
    for (way, settings) in ways() {
        let settings = Settings { end_top: EndRule::Extrapolate, ..settings };
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
            pool.install(|| run(&stack, &heights_of(3), &settings))
        };
        let (one, five) = (with(1), with(5));
        assert_eq!(one.layers.len(), five.layers.len());
        for (a, b) in one.layers.iter().zip(&five.layers) {
            assert!(a.phi.iter().zip(b.phi.iter()).all(|(a, b)| a.to_bits() == b.to_bits()), "{way}: z = {}", a.z);
        }
    }
}

#[test]
fn a_line_of_pixels_that_touch_at_corners_does_not_fall_apart() {
    // One pixel wide, at an angle of which every pixel or every second is at a corner of the last; as on every slice.
    for step in [1, 2] {
        let line: fn(usize, f64, f64) -> f64 = |step, x, y| {
            let on = (10.0..50.0).contains(&x) && y == 10.0 + ((x - 10.0) / step as f64).floor();
            if on { -0.5 } else { 0.5 }
        };
        let shapes: [Shape; 3] = std::array::from_fn(|_| Box::new(move |x, y| line(step, x, y)) as Shape);
        let stack = masks(60, &[0.0, 5.0, 10.0], &shapes);
        let heights: Vec<f64> = (0..=10).map(f64::from).collect();
        // What a morph loses means along z give back in part.
        for (method, fair) in [(Method::Morph, 0.0), (Method::Morph, 1.5), (Method::Field, 0.0), (Method::Field, 1.5)] {
            let settings = Settings { method, fair, ..Settings::default() };
            let body = reconstruct_with(&stack, &heights, &settings, &Reference, &Silent).expect("the stack is valid");
            let share = closed_surface(&body).volume() / (40.0 * 10.0);
            println!("steps of {step}: {share:.2} of what is painted by {method:?}, faired by {fair}");
            assert!((0.8..1.25).contains(&share), "steps of {step}: {share} by {method:?}, faired by {fair}");
        }
    }
}
