//! Sections of a stack, put together, are the body that a single run makes, bit by bit.

use crate::shapes::*;
use interslice::progress::Silent;
use interslice::settings::Link;
use interslice::settings::{EndRule, Method, Motion};
use interslice::surface::Layer;
use interslice::{Budget, ContourStack, Error, Means, Reference, Report, Section, Settings};
use interslice::{height_grid, reconstruct_section};

/// A tube that wanders, swells, splits and joins again over 60 slices at uneven heights; some are empty.
fn tube() -> ContourStack {
    let slice = |k: usize| -> Shape {
        let s = k as f64;
        let (x, y, r) = (30.0 + 8.0 * (0.3 * s).sin(), 28.0 + 5.0 * (0.21 * s).cos(), 10.0 + 3.0 * (0.5 * s).sin());
        match k {
            12..16 | 40..52 => {
                let (a, b) = (circle(x - 12.0, y, 0.7 * r), circle(x + 11.0, y + 2.0, 0.6 * r));
                Box::new(move |x, y| a(x, y).min(b(x, y)))
            }
            24 | 31 | 32 => Box::new(|_, _| 5.0),
            _ => circle(x, y, r),
        }
    };
    let shapes: Vec<Shape> = (0..60).map(slice).collect();
    let mut z = 0.0;
    let heights: Vec<f64> = (0..60)
        .map(|k| {
            z += [2.0, 3.5, 1.25, 2.5][k % 4];
            z
        })
        .collect();
    levels(65, &heights, &shapes)
}

fn run(stack: &ContourStack, section: &Section, heights: &[f64], settings: &Settings) -> (Vec<Layer>, Report) {
    let mut layers = Vec::new();
    let mut keep = |layer: Layer| {
        layers.push(layer);
        Ok(())
    };
    let means = Means { backend: &Reference, progress: &Silent, budget: &Budget::unlimited() };
    let body = reconstruct_section(stack, section, heights, settings, &means, &mut keep).expect("a valid stack");
    (layers, body.report)
}

fn check(name: &str, settings: &Settings, parts: usize) {
    check_of(&tube(), name, settings, parts);
}

fn check_of(stack: &ContourStack, name: &str, settings: &Settings, parts: usize) {
    let heights = height_grid(stack, settings, Some(0.8)).heights().expect("a grid");
    let (whole, report) = run(stack, &Section::whole(stack), &heights, settings);
    let mut layers = whole.iter();
    let (mut intervals, mut ends) = (report.intervals.iter(), report.ends.iter());
    for k in 1..=parts {
        let section = Section::part(stack, settings, k, parts).expect("a part");
        println!("{name}: part {k} keeps intervals {:?}, reads slices {:?}", section.kept, section.slices);
        let (part, part_report) = run(stack, &section, &heights, settings);
        assert!(!part.is_empty(), "{name}: part {k} has layers");
        for own in part {
            let other = layers.next().expect("no more layers than the whole has");
            assert!(own.z == other.z && own.output == other.output && own.contour == other.contour, "{name}: part {k}");
            let differing = own.phi.iter().zip(other.phi.iter()).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
            assert_eq!(differing, 0, "{name}: part {k}, pixels of the layer at {}", own.z);
        }
        for own in &part_report.intervals {
            assert_eq!(format!("{own:?}"), format!("{:?}", intervals.next().expect("an interval")), "{name}: part {k}");
        }
        for own in &part_report.ends {
            assert_eq!(own, ends.next().expect("no more ends than the whole has"), "{name}: part {k}");
        }
    }
    assert!(
        layers.next().is_none() && intervals.next().is_none() && ends.next().is_none(),
        "{name}: nothing is missing"
    );
}

#[test]
fn sections_are_the_whole() {
    let all = Settings { end_top: EndRule::Extrapolate, end_bottom: EndRule::HalfSlice, ..Settings::default() };
    check("default", &all, 3);
    check("no fairing", &Settings { fair: 0.0, ..all.clone() }, 2);
    check("motion none", &Settings { motion: Motion::None, ..all.clone() }, 2);
    check("method field", &Settings { method: Method::Field, ..all.clone() }, 5);
    let apart = Link { slice: 41, from: 1, to: 2, join: false };
    check("kept apart", &Settings { links: vec![apart], ..all.clone() }, 2);
    // How the body ends is told by contours beyond the slices that lie close together there.
    let mut close = tube();
    let top = close.slices[56].z;
    (1..4).for_each(|k| close.slices[56 + k].z = top + 0.1 * k as f64);
    check_of(&close, "close together", &Settings { method: Method::Field, fair: 0.0, ..all }, 12);
}

#[test]
fn a_section_reads_no_more_than_it_needs() {
    let stack = tube();
    let section =
        Section::part(&stack, &Settings { method: Method::Field, ..Settings::default() }, 1, 6).expect("a part");
    assert_eq!((section.kept.clone(), section.slices.start), (0..9, 0));
    assert!(section.slices.end < 30, "{:?}", section.slices);
    for (k, n, said) in [(0, 3, "part"), (4, 3, "part"), (1, 0, "parts"), (1, 60, "parts")] {
        let error = Section::part(&stack, &Settings::default(), k, n).expect_err("there is no such part");
        assert!(matches!(&error, Error::Setting { name, .. } if name == said), "{error}");
    }
}

#[test]
fn a_section_that_would_end_with_an_empty_slice_reads_on_to_the_next_contour() {
    let heights: Vec<f64> = (0..16).map(f64::from).collect();
    let settings = Settings { fair: 0.0, motion: Motion::None, ..Settings::default() };
    let part = |empty: &[usize]| {
        let shape = |k| if empty.contains(&k) { nothing() } else { circle(12.0, 12.0, 6.0) };
        let stack = masks(24, &heights, &(0..16).map(shape).collect::<Vec<_>>());
        Section::part(&stack, &settings, 1, 7).expect("a part")
    };
    // Two intervals, and those that chains of correspondences reach.
    assert_eq!((part(&[]).kept, part(&[]).slices), (0..2, 0..15));
    assert_eq!(part(&[13]).slices, 0..15);
    assert_eq!(part(&[14]).slices, 0..16);
    assert_eq!(part(&[14, 15]).slices, 0..16);
}
