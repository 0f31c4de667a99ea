//! Parts that miss each other, linked; parts that overlap, kept apart.

use crate::shapes::*;
use crate::support::{connected, edge_defects, merged};
use interslice::contour::parts::{candidates, overlaps, parts};
use interslice::grid::spline::harmonic;
use interslice::progress::Silent;
use interslice::report::{Event, LinkedBy};
use interslice::settings::Link;
use interslice::settings::{Linking, Method, Motion, SlopeRule};
use interslice::stack::links::check;
use interslice::stack::{ContourStack, SliceContent};
use interslice::surface::Layer;
use interslice::surface::mesh::closed_surface;
use interslice::{Error, Reconstruction, Reference, Settings, reconstruct_with};

pub const N: usize = 120;
/// How far a followed part may be from where it belongs, px: sub-pixel level sets of slices are interpolated twice on the way.
pub const FOLLOWED: f64 = 0.05;
/// The same where fairing has rounded the ends of a tilted tube.
const FAIRED: f64 = 0.25;
/// As in tests/surface/topology.rs.
const MOVING_TOLERANCE: f32 = 1e-2;

pub fn run(stack: &ContourStack, heights: &[f64], settings: &Settings) -> Reconstruction {
    reconstruct_with(stack, heights, settings, &Reference, &Silent).expect("the stack is valid")
}

fn link(slice: usize, from: u32, to: u32) -> Link {
    Link { slice, from, to, join: true }
}

fn apart(slice: usize, from: u32, to: u32) -> Link {
    Link { join: false, ..link(slice, from, to) }
}

/// A disc that moves by four times its width from slice to slice is in pieces, which is told with what joins them; linked it is whole.
#[test]
fn slices_of_which_no_part_meets_the_next_are_told() {
    let stack = |by: f64| {
        let discs: Vec<Shape> = (0..4).map(|k| circle(18.0 + by * f64::from(k), 60.0, 5.0)).collect();
        masks(N, &[0.0, 5.0, 10.0, 15.0], &discs)
    };
    let heights: Vec<f64> = (0..=30).map(|k| 0.5 * f64::from(k)).collect();
    for method in [Method::Morph, Method::Field] {
        let told = |by: f64, link: Linking, links: &[Link]| {
            let links = links.to_vec();
            let settings = Settings { method, link, links, link_reach: 8.0, ..Settings::default() };
            let report = run(&stack(by), &heights, &settings).report;
            let pieces: Vec<String> = report.warnings.into_iter().filter(|w| w.contains("in pieces")).collect();
            (report.body.apart, pieces)
        };
        let (gaps, pieces) = told(26.0, Linking::Off, &[]);
        assert_eq!(gaps, [0, 1, 2], "{method:?}");
        let [warning] = &pieces[..] else { panic!("{method:?}: {pieces:?}") };
        assert!(warning.contains("--link auto"), "{warning}");
        for (by, link) in [(26.0, Linking::Auto), (4.0, Linking::Off)] {
            assert_eq!(told(by, link, &[]), (Vec::new(), Vec::new()), "{method:?} {by}");
        }
        // What the user keeps apart, which the morph can, is no news.
        if method == Method::Morph {
            assert_eq!(told(4.0, Linking::Off, &[apart(1, 1, 1)]), (vec![1], Vec::new()));
        }
    }
}

/// Both methods in both moving frames, not faired and faired.
fn ways() -> Vec<Settings> {
    let mut out = Vec::new();
    for method in [Method::Morph, Method::Field] {
        for motion in [Motion::Field, Motion::Rigid] {
            for fair in [0.0, 1.0] {
                out.push(Settings { method, motion, fair, ..Settings::default() });
            }
        }
    }
    out
}

/// Largest difference between a layer and a signed distance, px, where the distance is less than 1.5.
pub fn misfit(layer: &Layer, n: usize, shape: &Shape) -> f64 {
    let near = layer.phi.iter().enumerate().map(|(k, v)| (f64::from(*v), shape((k % n) as f64, (k / n) as f64)));
    let near: Vec<(f64, f64)> = near.filter(|(_, d)| d.abs() < 1.5).collect();
    assert!(near.len() > 20, "the shape is in the image");
    near.iter().map(|(v, d)| (v - d).abs()).fold(0.0, f64::max)
}

pub fn at(body: &Reconstruction, z: f64) -> &Layer {
    body.layers.iter().find(|l| (l.z - z).abs() < 1e-9).expect("a layer lies there")
}

/// A stadium: distance to a segment less `r`.
pub fn stadium(x: f64, y: f64, r: f64) -> Shape {
    Box::new(move |px, py| {
        let (u, v) = (px - x, py - y);
        (u - u.clamp(-5.0, 5.0)).hypot(v) - r
    })
}

#[test]
fn linked_parts_make_a_straight_tube() {
    // 27 px apart: they do not touch.
    let places = [(22.0, 30.0), (49.0, 43.0), (76.0, 56.0)];
    let shapes: Vec<Shape> = places.iter().map(|&(x, y)| stadium(x, y, 6.0)).collect();
    let stack = levels(N, &[0.0, 10.0, 20.0], &shapes);
    let heights: Vec<f64> = (0..=40).map(|k| 0.5 * f64::from(k)).collect();
    for way in ways() {
        let settings = Settings { links: vec![link(0, 1, 1), link(1, 1, 1)], ..way };
        let body = run(&stack, &heights, &settings);
        for z in [2.5, 5.0, 7.5, 12.5, 15.0, 18.5] {
            let off = misfit(at(&body, z), N, &stadium(22.0 + 2.7 * z, 30.0 + 1.3 * z, 6.0));
            println!("{:?} {:?} fair {}: {off:.4} px at {z}", settings.method, settings.motion, settings.fair);
            let tolerance = if settings.fair == 0.0 { FOLLOWED } else { FAIRED };
            assert!(off <= tolerance, "{settings:?}: {off} px at {z}");
        }
        let layers: Vec<Vec<f32>> = body.layers.iter().map(Layer::dense).collect();
        let layers: Vec<&[f32]> = layers.iter().map(Vec::as_slice).collect();
        let ends = [30 * N + 22, 56 * N + 76];
        assert!(connected(&layers, [N, N], (0, ends[0]), (layers.len() - 1, ends[1])));
        for interval in &body.report.intervals {
            assert_eq!((interval.groups, &interval.events[..]), (1, &[][..]));
            assert!(interval.links.iter().all(|l| l.meet > 0.9 && l.join && l.by == LinkedBy::File));
            assert_eq!(interval.links.len(), 1);
        }
        assert!(body.report.warnings.is_empty(), "{:?}", body.report.warnings);
    }
}

#[test]
fn without_a_link_they_stay_apart() {
    let shapes: Vec<Shape> = vec![stadium(22.0, 30.0, 6.0), stadium(62.0, 60.0, 6.0)];
    let stack = levels(N, &[0.0, 10.0], &shapes);
    let heights: Vec<f64> = (0..=20).map(|k| 0.5 * f64::from(k)).collect();
    for way in ways() {
        let body = run(&stack, &heights, &way);
        let layers: Vec<Vec<f32>> = body.layers.iter().map(Layer::dense).collect();
        let layers: Vec<&[f32]> = layers.iter().map(Vec::as_slice).collect();
        assert!(!connected(&layers, [N, N], (0, 30 * N + 22), (layers.len() - 1, 60 * N + 62)), "{way:?}");
        assert!(body.report.intervals[0].links.is_empty());
    }
}

#[test]
fn linked_parts_follow_a_curve() {
    let (places, z) = ([[25.0, 60.0], [48.0, 48.0], [75.0, 50.0], [94.0, 70.0]], [0.0, 8.0, 18.0, 28.0]);
    let shapes: Vec<Shape> = places.iter().map(|&[x, y]| circle(x, y, 7.0)).collect();
    let stack = levels(N, &z, &shapes);
    // Cubic Hermite curves through the centres with the harmonic mean of the rates as slope, the end intervals' own rate at the ends.
    let rate = |i: usize, c: usize| (places[i + 1][c] - places[i][c]) / (z[i + 1] - z[i]);
    let slope = |i: usize, c: usize| match i {
        0 => rate(0, c),
        3 => rate(2, c),
        _ => harmonic(rate(i - 1, c), rate(i, c), z[i] - z[i - 1], z[i + 1] - z[i]),
    };
    let centre = |i: usize, t: f64| -> [f64; 2] {
        let gap = z[i + 1] - z[i];
        std::array::from_fn(|c| {
            let s = places[i + 1][c] - places[i][c];
            interslice::grid::spline::hermite(&[s, gap * slope(i, c), gap * slope(i + 1, c), 1.0], t) + places[i][c]
        })
    };
    let times = [0.25, 0.5, 0.75];
    let heights: Vec<f64> = (0..3).flat_map(|i| times.map(|t| z[i] + t * (z[i + 1] - z[i]))).collect();
    for method in [Method::Morph, Method::Field] {
        for motion in [Motion::Field, Motion::Rigid] {
            let links = (0..3).map(|k| link(k, 1, 1)).collect();
            let body = run(&stack, &heights, &Settings { method, motion, fair: 0.0, links, ..Settings::default() });
            for i in 0..3 {
                for t in times {
                    let [x, y] = centre(i, t);
                    let off = misfit(at(&body, z[i] + t * (z[i + 1] - z[i])), N, &circle(x, y, 7.0));
                    println!("{method:?} {motion:?}: {off:.4} px in interval {i} at {t}");
                    assert!(off <= FOLLOWED, "{method:?} {motion:?}: {off} px in interval {i} at {t}");
                }
            }
        }
    }
}

/// Two small discs that change places with two others.
fn crossing() -> ContourStack {
    let low = union(circle(25.0, 30.0, 7.0), circle(85.0, 90.0, 8.0));
    let high = union(circle(90.0, 30.0, 8.0), circle(30.0, 90.0, 7.0));
    masks(N, &[0.0, 12.0], &[low, high])
}

#[test]
fn links_say_which_goes_where() {
    let stack = crossing();
    let heights: Vec<f64> = (0..=24).map(|k| 0.5 * f64::from(k)).collect();
    let low = [30 * N + 25, 90 * N + 85];
    let high = [30 * N + 90, 90 * N + 30];
    for way in ways() {
        for (from, to) in [(1, 1), (1, 2), (2, 1), (2, 2)] {
            let body = run(&stack, &heights, &Settings { links: vec![link(0, from, to)], ..way.clone() });
            let layers: Vec<Vec<f32>> = body.layers.iter().map(Layer::dense).collect();
            let layers: Vec<&[f32]> = layers.iter().map(Vec::as_slice).collect();
            for (a, b) in [(1, 1), (1, 2), (2, 1), (2, 2)] {
                let joined = connected(&layers, [N, N], (0, low[a - 1]), (layers.len() - 1, high[b - 1]));
                assert_eq!(joined, (a, b) == (from as usize, to as usize), "{from}-{to}: {a}-{b}, {way:?}");
            }
            let events = &body.report.intervals[0].events;
            let birth = Event::Birth { component: 3 - to as usize };
            let death = Event::Death { component: 3 - from as usize };
            assert_eq!(events[..], [birth, death]);
        }
    }
}

#[test]
fn auto_links_what_is_near_and_alike() {
    let heights = [3.0, 6.0, 9.0];
    let links = |low: Shape, high: Shape, reach: f64| {
        let settings = Settings { link: Linking::Auto, link_reach: reach, ..Settings::default() };
        let body = run(&masks(N, &[0.0, 12.0], &[low, high]), &heights, &settings);
        let told = &body.report.intervals[0].links;
        told.iter().map(|l| (l.from, l.to, l.by)).collect::<Vec<_>>()
    };
    let pair = || union(circle(25.0, 30.0, 8.0), circle(85.0, 85.0, 8.0));
    let both = vec![(1, 1, LinkedBy::Auto), (2, 2, LinkedBy::Auto)];
    assert_eq!(links(pair(), union(circle(50.0, 30.0, 8.0), circle(60.0, 85.0, 9.0)), 4.0), both);
    // 25 px are 3.1 radii of 8 px, 2.8 of 9.
    assert_eq!(links(pair(), union(circle(50.0, 30.0, 8.0), circle(60.0, 85.0, 9.0)), 3.0), both[1..]);
    // Twice the radius is four times the area.
    assert_eq!(links(pair(), union(circle(60.0, 30.0, 16.0), circle(60.0, 85.0, 8.0)), 4.0), both[1..]);
    // As large, but another shape.
    let long: Shape = Box::new(|x, y| ((x - 50.0).abs() - 2.5).max((y - 30.0).abs() - 20.0));
    assert_eq!(links(circle(25.0, 30.0, 8.0), long, 4.0), []);
    // What overlaps has a partner.
    assert_eq!(links(circle(25.0, 30.0, 8.0), union(circle(30.0, 30.0, 8.0), circle(50.0, 30.0, 8.0)), 4.0), []);
    // Two for one: only the nearer is the other's nearest.
    let two = || union(circle(50.0, 25.0, 8.0), circle(51.0, 50.0, 8.0));
    assert_eq!(links(circle(25.0, 30.0, 8.0), two(), 4.0), both[..1]);
}

#[test]
fn candidates_tell_what_they_are_judged_by() {
    let mask = |shape: Shape| {
        let inside: Vec<bool> = (0..N * N).map(|k| shape((k % N) as f64, (k / N) as f64) < 0.0).collect();
        interslice::grid::components::label4(&inside, [N, N])
    };
    // Pixels twice as wide as high: 20 px along x are 20, along y 10.
    let h = [1.0, 0.5];
    let low = mask(circle(30.0, 40.0, 6.4));
    let high = mask(union(circle(50.0, 40.0, 6.4), circle(30.0, 62.0, 6.4)));
    assert!(overlaps(&low, &high).is_empty());
    let of = |c| parts(c, [N, N], h);
    let found = candidates(&of(&low), &of(&high), &[].into(), &[].into(), [N, N], h);
    assert_eq!(found.iter().map(|c| (c.from, c.to, c.mutual)).collect::<Vec<_>>(), [(1, 1, false), (1, 2, true)]);
    let radius = of(&low)[0].radius;
    assert!((radius - 6.4 * 0.5f64.sqrt()).abs() < 0.1, "{radius}");
    for (c, distance) in found.iter().zip([20.0, 11.0]) {
        assert!((c.distance - distance / radius).abs() < 1e-9, "{c:?}");
        assert_eq!((c.iou, c.area_ratio), (1.0, 1.0));
    }
    let known = candidates(&of(&low), &of(&high), &[(1, 2)].into(), &[].into(), [N, N], h);
    assert_eq!(known.iter().map(|c| (c.from, c.to)).collect::<Vec<_>>(), [(1, 1)]);
}

#[test]
fn a_file_goes_before_auto() {
    let stack =
        masks(N, &[0.0, 12.0], &[circle(25.0, 30.0, 8.0), union(circle(50.0, 30.0, 8.0), circle(25.0, 62.0, 8.0))]);
    let links = |links: Vec<Link>| {
        let settings = Settings { link: Linking::Auto, link_reach: 5.0, links, ..Settings::default() };
        let told = &run(&stack, &[6.0], &settings).report.intervals[0].links;
        told.iter().map(|l| (l.from, l.to, l.join, l.by)).collect::<Vec<_>>()
    };
    assert_eq!(links(vec![]), [(1, 1, true, LinkedBy::Auto)]);
    assert_eq!(links(vec![link(0, 1, 2)]), [(1, 2, true, LinkedBy::File)]);
    assert_eq!(links(vec![link(0, 1, 1)]), [(1, 1, true, LinkedBy::File)]);
    assert_eq!(links(vec![apart(0, 1, 1)]), [(1, 1, false, LinkedBy::File), (1, 2, true, LinkedBy::Auto)]);
}

#[test]
fn a_small_part_goes_into_a_large_one_no_farther_than_it_must() {
    // Two discs beside the large one that they belong to.
    let low = union(circle(20.0, 60.0, 8.0), circle(100.0, 60.0, 8.0));
    let stack = masks(N, &[0.0, 12.0, 24.0], &[low, circle(60.0, 60.0, 27.0), circle(60.0, 60.0, 24.0)]);
    let heights: Vec<f64> = (0..=24).map(f64::from).collect();
    for way in ways() {
        let body = run(&stack, &heights, &Settings { links: vec![link(0, 1, 1), link(0, 2, 1)], ..way.clone() });
        let merge = [Event::Merge { from: vec![1, 2], to: vec![1] }];
        assert_eq!(body.report.intervals[0].events[..], merge, "{way:?}");
        let layers: Vec<Vec<f32>> = body.layers.iter().map(Layer::dense).collect();
        let layers: Vec<&[f32]> = layers.iter().map(Vec::as_slice).collect();
        for x in [20, 100] {
            assert!(connected(&layers, [N, N], (0, 60 * N + x), (12, 60 * N + 60)), "{way:?}: {x}");
        }
        // No shreds: every layer is the two that come, or one body.
        for layer in &body.layers {
            let inside: Vec<bool> = layer.phi.iter().map(|v| *v < 0.0).collect();
            let parts = interslice::grid::components::label4(&inside, [N, N]).count;
            assert!(parts <= if layer.z < 12.0 { 3 } else { 1 }, "{way:?}: {parts} parts at {}", layer.z);
        }
    }
}

#[test]
fn what_is_in_the_way_is_told() {
    let slice = |x: f64| union(circle(x, 60.0, 7.0), circle(60.0, 60.0, 10.0));
    let told = |settings: Settings| {
        let report = run(&masks(N, &[0.0, 12.0], &[slice(30.0), slice(90.0)]), &[3.0, 6.0, 9.0], &settings).report;
        (report.intervals[0].links.len(), report.warnings)
    };
    let (count, warnings) = told(Settings { link: Linking::Auto, link_reach: 10.0, ..Settings::default() });
    assert_eq!((count, warnings.len()), (0, 0), "auto leaves it out: {warnings:?}");
    let (count, warnings) = told(Settings { links: vec![link(0, 2, 2)], ..Settings::default() });
    assert_eq!(count, 1);
    let says = "part 2 of `slice 0` and part 2 of `slice 1` are linked, but something else is in the way";
    assert!(warnings.len() == 1 && warnings[0].contains(says), "{warnings:?}");
}

/// Whether the discs at `x` on the first and last layer are one body.
fn joined_at(body: &Reconstruction, x: usize) -> bool {
    let layers: Vec<Vec<f32>> = body.layers.iter().map(Layer::dense).collect();
    let layers: Vec<&[f32]> = layers.iter().map(Vec::as_slice).collect();
    connected(&layers, [N, N], (0, 60 * N + x), (layers.len() - 1, 60 * N + x))
}

#[test]
fn parts_kept_apart_are_apart() {
    let pair = |r: f64| union(circle(30.0, 60.0, r), circle(85.0, 60.0, r));
    let stack = masks(N, &[0.0, 12.0], &[pair(14.0), pair(15.0)]);
    for (motion, fair) in [(Motion::None, 0.0), (Motion::None, 1.5), (Motion::Field, 1.5), (Motion::Rigid, 1.0)] {
        for slope in [SlopeRule::Hyman, SlopeRule::Natural] {
            // Layers at half way, or the same on either side of it.
            for count in [2, 3, 12, 24] {
                let heights: Vec<f64> = (0..=count).map(|k| 12.0 * f64::from(k) / f64::from(count)).collect();
                let settings = Settings { motion, fair, slope, ..Settings::default() };
                let body = run(&stack, &heights, &settings);
                assert!(joined_at(&body, 30) && joined_at(&body, 85), "{motion:?} {fair} {count}");
                let settings = Settings { links: vec![apart(0, 2, 2)], ..settings };
                let body = run(&stack, &heights, &settings);
                assert!(joined_at(&body, 30), "{motion:?} {fair} {slope:?} {count}: the others are joined");
                assert!(!joined_at(&body, 85), "{motion:?} {fair} {slope:?} {count}");
                let events = [Event::Birth { component: 2 }, Event::Death { component: 2 }];
                assert_eq!(body.report.intervals[0].events, events);
                assert!(body.report.contours.iter().all(|c| c.differing_pixels == 0));
                let mesh = closed_surface(&body);
                assert_eq!(edge_defects(&mesh.triangles) + edge_defects(&merged(&mesh)), 0);
            }
        }
    }
}

/// A stack with links of all kinds, and its links.
fn linked() -> (ContourStack, Vec<Link>) {
    let mask =
        |list: &[(f64, f64, f64)]| list.iter().fold(nothing(), |shape, &(x, y, r)| union(shape, circle(x, y, r)));
    let stack = masks(
        N,
        &[0.0, 10.0, 17.0],
        &[
            mask(&[(20.0, 20.0, 8.0), (60.0, 60.0, 15.0), (95.0, 100.0, 9.0)]),
            mask(&[(48.0, 22.0, 8.5), (62.0, 61.0, 14.0), (22.0, 90.0, 6.0), (98.0, 98.0, 8.0)]),
            mask(&[(78.0, 18.0, 8.0), (60.0, 62.0, 15.0), (30.0, 108.0, 6.0)]),
        ],
    );
    (stack, vec![link(0, 1, 1), link(1, 1, 1), link(1, 3, 3), apart(0, 2, 2)])
}

#[test]
fn linked_stacks_are_closed_exact_and_the_same_upside_down() {
    let (stack, links) = linked();
    let heights: Vec<f64> = (0..=34).map(|k| 0.5 * f64::from(k)).collect();
    let turned_heights: Vec<f64> = heights.iter().rev().map(|z| 17.0 - z).collect();
    let turned_links: Vec<Link> =
        links.iter().map(|l| Link { slice: 1 - l.slice, from: l.to, to: l.from, ..*l }).collect();
    for way in ways().into_iter().filter(|w| w.method == Method::Morph) {
        let body = run(&stack, &heights, &Settings { links: links.clone(), ..way.clone() });
        for layer in &body.layers {
            assert!(layer.phi.iter().all(|v| v.is_finite() && *v != 0.0));
            if let Some(i) = layer.contour {
                let SliceContent::Mask(mask) = &stack.slices[i].content else { panic!("masks went in") };
                assert!(mask.iter().zip(layer.phi.iter()).all(|(m, v)| m == (*v < 0.0)), "contour {i}");
            }
        }
        let mesh = closed_surface(&body);
        assert_eq!(edge_defects(&mesh.triangles) + edge_defects(&merged(&mesh)), 0);
        let settings = Settings { links: turned_links.clone(), ..way.clone() };
        let back = run(&upside_down(&stack, 17.0), &turned_heights, &settings);
        assert_eq!(body.layers.len(), back.layers.len());
        for (a, b) in body.layers.iter().zip(back.layers.iter().rev()) {
            let worst = a.phi.iter().zip(b.phi.iter()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst <= MOVING_TOLERANCE, "{way:?}: |phi| differs by {worst} at z = {}", a.z);
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (stack, links) = linked();
    let settings = Settings { links, link: Linking::Auto, ..Settings::default() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        pool.install(|| run(&stack, &[2.0, 5.0, 13.0], &settings))
    };
    let (one, five) = (with(1), with(5));
    assert_eq!(one.layers.len(), five.layers.len());
    for (a, b) in one.layers.iter().zip(&five.layers) {
        assert!(a.phi.iter().zip(b.phi.iter()).all(|(a, b)| a.to_bits() == b.to_bits()), "z = {}", a.z);
    }
}

#[test]
fn the_library_refuses_what_it_cannot_do() {
    let (stack, links) = linked();
    let refused = |settings: Settings, says: &str| {
        let error = reconstruct_with(&stack, &[5.0], &settings, &Reference, &Silent).expect_err("it is refused");
        assert!(matches!(error, Error::Setting { .. }) && error.exit_code() == 2, "{error:?}");
        assert!(error.to_string().contains(says), "`{says}` is missing from: {error}");
    };
    let default = Settings::default;
    refused(Settings { motion: Motion::None, links: vec![link(0, 1, 1)], ..default() }, "`links` needs `motion`");
    refused(Settings { motion: Motion::None, link: Linking::Auto, ..default() }, "`link` needs `motion`");
    refused(Settings { method: Method::Field, links: links.clone(), ..default() }, "need `method` morph");
    refused(Settings { link_reach: 0.0, ..default() }, "`link_reach` must lie in (0, 20]; got 0");
    refused(Settings { links: vec![link(2, 1, 1)], ..default() }, "link 1: `slice` must lie in [0, 1]");
    assert_eq!(check(&stack, &links), Ok(()));
}
