//! What holds between slices as topology (P4): parts that overlap are connected within their interval, and nothing floats, whatever the stack, the
//! method, the motion, the fairing and the heights. Each property has a twin without the rule that makes it true, which must fall.

use std::collections::BTreeSet;

use crate::shapes::*;
use interslice::grid::components::label4;
use interslice::progress::Silent;
use interslice::settings::{EndRule, Linking, Method, Motion};
use interslice::stack::ContourStack;
use interslice::surface::Layer;
use interslice::{Bonds, Budget, Means, Reference, Report, Settings, reconstruct_loosely};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{RngSeed, TestRunner};

const N: usize = 36;
/// Stacks of a campaign that a rule's absence must show in.
const CAMPAIGN: usize = 40;

/// A disc, a disc cut out, a line about a pixel thin, or a single pixel.
#[derive(Debug, Clone)]
enum Mark {
    Disc(f64, f64, f64),
    Hole(f64, f64, f64),
    Line([f64; 2], [f64; 2]),
    Pixel(usize, usize),
}

fn mark() -> impl Strategy<Value = Mark> {
    let at = || 3.0..(N as f64 - 4.0);
    prop_oneof![
        4 => (at(), at(), 1.0..11.0f64).prop_map(|(x, y, r)| Mark::Disc(x, y, r)),
        1 => (at(), at(), 0.5..6.0f64).prop_map(|(x, y, r)| Mark::Hole(x, y, r)),
        2 => (at(), at(), at(), at()).prop_map(|(a, b, c, d)| Mark::Line([a, b], [c, d])),
        1 => (3..N - 3, 3..N - 3).prop_map(|(i, j)| Mark::Pixel(i, j)),
    ]
}

fn shape(marks: &[Mark]) -> Shape {
    let mut out = nothing();
    for mark in marks.iter().cloned() {
        out = match mark {
            Mark::Disc(x, y, r) => union(out, circle(x, y, r)),
            Mark::Hole(x, y, r) => without(out, circle(x, y, r)),
            Mark::Pixel(i, j) => union(out, circle(i as f64, j as f64, 0.5)),
            Mark::Line(a, b) => {
                let (d, length) = ([b[0] - a[0], b[1] - a[1]], (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-9));
                let line = move |x: f64, y: f64| {
                    let t = (((x - a[0]) * d[0] + (y - a[1]) * d[1]) / length.powi(2)).clamp(0.0, 1.0);
                    (x - a[0] - t * d[0]).hypot(y - a[1] - t * d[1]) - 0.75
                };
                union(out, Box::new(line))
            }
        };
    }
    out
}

/// Slices that resemble each other: what is drawn on one moves a little to the next, some of it ends, some begins.
fn slices() -> impl Strategy<Value = (Vec<Vec<Mark>>, Vec<f64>)> {
    let count = 2..6usize;
    count.prop_flat_map(|count| {
        let fresh = prop::collection::vec(prop::collection::vec(mark(), 0..4), count);
        let moved = prop::collection::vec((-5.0..5.0f64, -5.0..5.0f64, prop::bool::weighted(0.7)), count);
        let gaps = prop::collection::vec(prop_oneof![0.3..3.0f64, 3.0..15.0f64], count);
        (fresh, moved, gaps).prop_map(|(fresh, moved, gaps)| {
            let mut stack: Vec<Vec<Mark>> = Vec::new();
            for (own, (dx, dy, goes_on)) in fresh.into_iter().zip(moved) {
                let before = stack.last().filter(|_| goes_on).cloned().unwrap_or_default();
                let by = |p: [f64; 2]| [p[0] + dx, p[1] + dy];
                let before = before.into_iter().take(4).map(|m| match m {
                    Mark::Disc(x, y, r) => Mark::Disc(x + dx, y + dy, r),
                    Mark::Hole(x, y, r) => Mark::Hole(x + dx, y + dy, r),
                    Mark::Line(a, b) => Mark::Line(by(a), by(b)),
                    pixel => pixel,
                });
                stack.push(before.chain(own).collect());
            }
            (stack, gaps)
        })
    })
}

fn settings() -> impl Strategy<Value = Settings> {
    let method = prop_oneof![Just(Method::Morph), Just(Method::Field)];
    let motion = prop_oneof![2 => Just(Motion::Field), 1 => Just(Motion::Rigid), 1 => Just(Motion::None)];
    let end = || prop_oneof![Just(EndRule::Flat), Just(EndRule::HalfSlice), Just(EndRule::Extrapolate)];
    let link = prop_oneof![3 => Just(Linking::Off), 1 => Just(Linking::Auto)];
    let fair = prop_oneof![Just(0.0), Just(Settings::default().fair), Just(1.5)];
    (method, motion, fair, end(), end(), link).prop_map(|(method, motion, fair, end_bottom, end_top, link)| Settings {
        method,
        motion,
        fair,
        end_bottom,
        end_top,
        // Parts that miss each other meet in a moving frame only.
        link: if motion == Motion::None { Linking::Off } else { link },
        ..Settings::default()
    })
}

/// Steps of the output grid per mean gap.
fn fineness() -> impl Strategy<Value = f64> {
    prop_oneof![Just(1.0), 2.0..5.0f64, 5.0..14.0f64]
}

type Case = ((Vec<Vec<Mark>>, Vec<f64>), Settings, f64);

fn case() -> impl Strategy<Value = Case> {
    (slices(), settings(), fineness())
}

fn stack_of((slices, gaps): &(Vec<Vec<Mark>>, Vec<f64>)) -> Option<ContourStack> {
    let z: Vec<f64> = (0..slices.len()).map(|k| gaps[..k].iter().sum()).collect();
    let shapes: Vec<Shape> = slices.iter().map(|s| shape(s)).collect();
    Some(masks(N, &z, &shapes)).filter(|stack| stack.slices.iter().any(|s| !s.content.is_empty()))
}

fn made(stack: &ContourStack, settings: &Settings, fineness: f64, bonds: Bonds) -> (Vec<Layer>, Report) {
    let [low, high] = [stack.slices[0].z, stack.slices[stack.slices.len() - 1].z];
    let step = (high - low) / (stack.slices.len() - 1) as f64 / fineness;
    let count = ((high - low) / step) as usize;
    // Off the contours' heights, and beyond both ends.
    let heights: Vec<f64> = (-2..count as i64 + 4).map(|k| low + (k as f64 + 0.37) * step).collect();
    let mut layers = Vec::new();
    let mut keep = |layer: Layer| {
        layers.push(layer);
        Ok(())
    };
    let means = Means { backend: &Reference, progress: &Silent, budget: &Budget::unlimited() };
    let body = reconstruct_loosely(stack, &heights, settings, bonds, &means, &mut keep).expect("the stack is valid");
    (layers, body.report)
}

/// What is wrong with the layers, found by flooding them pixel by pixel: pieces and voids that touch no contour, pairs of parts not connected.
#[derive(Debug, Default, PartialEq)]
struct Found {
    floating: usize,
    voids: usize,
    pairs: usize,
    torn: usize,
}

fn found(stack: &ContourStack, layers: &[Layer]) -> Found {
    let (area, nz) = (N * N, layers.len());
    let inside: Vec<bool> = layers.iter().flat_map(|l| l.phi.iter().map(|v| *v < 0.0)).collect();
    let contour_at = |n: usize| layers[n / area].contour.is_some();
    // Neighbours through faces, and of what is outside through the faces' diagonals.
    let around = |n: usize, diagonal: bool| {
        let [i, j, k] = [n % N, n % area / N, n / area].map(|v| v as i64);
        let steps = (0..27).map(|s| [s % 3 - 1, s / 3 % 3 - 1, s / 9 - 1]);
        let steps = steps.filter(move |s| {
            let length: i64 = s.iter().map(|v: &i64| v.abs()).sum();
            length == 1 || (diagonal && length == 2)
        });
        steps.filter_map(move |s| {
            let [i, j, k] = [i + s[0], j + s[1], k + s[2]];
            let within = (0..N as i64).contains(&i) && (0..N as i64).contains(&j) && (0..nz as i64).contains(&k);
            within.then_some((k as usize) * area + (j as usize) * N + i as usize)
        })
    };
    let mut seen = vec![false; inside.len()];
    let flood = |from: Vec<usize>, seen: &mut Vec<bool>, within: &dyn Fn(usize) -> bool| {
        let mut open = from;
        let mut reached = Vec::new();
        while let Some(n) = open.pop() {
            if within(n) && !std::mem::replace(&mut seen[n], true) {
                reached.push(n);
                open.extend(around(n, !inside[n]).filter(|&m| inside[m] == inside[n]));
            }
        }
        reached
    };
    let edge = |n: usize| {
        let [i, j, k] = [n % N, n % area / N, n / area];
        i == 0 || j == 0 || i + 1 == N || j + 1 == N || k == 0 || k + 1 == nz
    };
    let ground = (0..inside.len()).filter(|&n| contour_at(n) || (!inside[n] && edge(n))).collect();
    flood(ground, &mut seen, &|_| true);
    let mut found = Found::default();
    for n in 0..inside.len() {
        if !seen[n] {
            if inside[n] {
                found.floating += 1
            } else {
                found.voids += 1
            }
            flood(vec![n], &mut seen, &|_| true);
        }
    }
    let at: Vec<usize> = (0..nz).filter(|&k| layers[k].contour.is_some()).collect();
    for (w, slices) in at.windows(2).zip(stack.slices.windows(2)) {
        let labels = [0, 1].map(|k| {
            let mask = slices[k].content.sides();
            label4(&mask, [N, N])
        });
        let both = labels[0].labels.iter().zip(&labels[1].labels).filter(|(a, b)| **a > 0 && **b > 0);
        let pairs: BTreeSet<(u32, u32)> = both.map(|(a, b)| (*a, *b)).collect();
        for (a, b) in pairs {
            found.pairs += 1;
            let from = (0..area).filter(|&n| labels[0].labels[n] == a).map(|n| w[0] * area + n).collect();
            let mut seen = vec![false; inside.len()];
            let piece = flood(from, &mut seen, &|n| (w[0]..=w[1]).contains(&(n / area)));
            let reached = piece.iter().any(|&n| n / area == w[1] && labels[1].labels[n % area] == b);
            found.torn += usize::from(!reached);
        }
    }
    found
}

fn holds((slices, settings, fineness): &Case) -> Result<(), TestCaseError> {
    let Some(stack) = stack_of(slices) else { return Ok(()) };
    let (layers, report) = made(&stack, settings, *fineness, Bonds::ALL);
    let found = found(&stack, &layers);
    // Promised are none: what floats and is more than a crumb stays, as a thin part that moves fast meets itself nowhere, too.
    prop_assert!(found.torn == 0 && found.floating <= 2 && found.voids == 0, "{found:?}");
    // The certificate has seen the same.
    prop_assert_eq!(report.body.overlapping, found.pairs);
    prop_assert!(report.body.torn.is_empty() && report.contours.iter().all(|c| c.differing_pixels == 0));
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, rng_seed: RngSeed::Fixed(20), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn overlapping_parts_are_connected_and_nothing_floats(case in case()) {
        holds(&case)?;
    }
}

/// What is found over the same random stacks with these bonds, and by the certificate.
fn campaign(bonds: Bonds) -> (Found, Found) {
    let mut runner = TestRunner::deterministic();
    let mut all = [Found::default(), Found::default()];
    for _ in 0..CAMPAIGN {
        let (slices, settings, fineness) = case().new_tree(&mut runner).expect("a case").current();
        let Some(stack) = stack_of(&slices) else { continue };
        let (layers, report) = made(&stack, &settings, fineness, bonds);
        let own = found(&stack, &layers);
        let body = report.body;
        let told = Found { floating: body.floating, voids: body.voids, pairs: body.overlapping, torn: body.torn.len() };
        for (all, one) in all.iter_mut().zip([own, told]) {
            all.floating += one.floating;
            all.voids += one.voids;
            all.pairs += one.pairs;
            all.torn += one.torn;
        }
    }
    let [own, told] = all;
    println!("{bonds:?}: {own:?}");
    (own, told)
}

#[test]
fn without_cores_parts_are_torn_and_the_certificate_sees_it() {
    let (own, told) = campaign(Bonds { cores: false, ..Bonds::ALL });
    assert!(own.torn > 0, "{own:?}");
    assert_eq!(own, told);
    let (own, told) = campaign(Bonds::ALL);
    assert!(own.torn == 0 && own.pairs > 30, "{own:?}");
    assert_eq!(own, told);
}

#[test]
fn without_repair_pieces_float_and_the_certificate_sees_it() {
    let (own, told) = campaign(Bonds { grounded: false, ..Bonds::ALL });
    assert!(own.floating + own.voids > 0, "{own:?}");
    assert_eq!(own, told);
}

#[test]
fn a_pixel_beside_a_disc_stays_connected() {
    // Drawn in three slices beside a disc that moves.
    let slice = |k: usize| union(circle(12.0 + 4.0 * k as f64, 14.0, 7.0), circle(24.0, 29.0, 0.5));
    let stack = masks(N, &[0.0, 6.0, 12.0], &[slice(0), slice(1), slice(2)]);
    for method in [Method::Morph, Method::Field] {
        let (layers, report) = made(&stack, &Settings { method, ..Settings::default() }, 7.0, Bonds::ALL);
        assert_eq!(found(&stack, &layers), Found { pairs: 4, ..Found::default() }, "{method:?}");
        assert_eq!(report.broken, [""; 0], "{method:?}");
    }
}

#[test]
fn parts_that_a_link_keeps_apart_have_no_core() {
    let stack = masks(N, &[0.0, 8.0], &[circle(14.0, 18.0, 8.0), circle(18.0, 18.0, 8.0)]);
    let link = interslice::settings::Link { slice: 0, from: 1, to: 1, join: false };
    for (links, torn) in [(vec![], 0), (vec![link], 1)] {
        let settings = Settings { links, ..Settings::default() };
        let (layers, report) = made(&stack, &settings, 7.0, Bonds::ALL);
        assert_eq!(found(&stack, &layers).torn, torn);
        assert_eq!(report.body.overlapping, 1 - torn);
        assert!(report.body.torn.is_empty());
    }
}
