//! The pixels on which polygons are laid where nobody says them, and what is told of what they do not show.

use std::f64::consts::TAU;

use crate::files::*;
use crate::polygons::{circle, place, square};
use glam::DVec2;
use interslice::input::Input;
use interslice::polygons::grid::too_large;
use interslice::polygons::pixel::pixel_side;
use interslice::polygons::{PlaneDrawing, Planes, Polygon};
use interslice::stack::{Geometry, ReadOptions};

#[test]
fn pixels_are_half_the_distance_of_points_and_finer_for_thin_bodies() {
    let drawing =
        |polygon: Polygon| PlaneDrawing { name: "a".into(), z: 0.0, extra: false, regions: vec![vec![polygon]] };
    // 2 mm between points, 60 mm wide: half the distance.
    let round = drawing(circle(DVec2::ZERO, 30.0, 94));
    assert!((pixel_side(&[round]) - 1.0).abs() < 0.01);
    // A strip of 2 mm with points 2 mm apart: 2 A / P is 1.95, an eighth of that.
    let along = |ends: [f64; 2], y: f64| {
        (0..41).map(move |k| DVec2::new(ends[0] + (ends[1] - ends[0]) * f64::from(k) / 40.0, y))
    };
    let strip = drawing(along([0.0, 80.0], 0.0).chain(along([80.0, 0.0], 2.0)).collect());
    assert!((pixel_side(&[strip]) - 1.95 / 8.0).abs() < 0.01);
    // A square drawn by its corners: 2 A / P is 20, and a 32nd of that keeps them; of 16 points a 16th.
    assert_eq!(pixel_side(&[drawing(square(0.0, 40.0))]), 20.0 / 32.0);
    assert!((pixel_side(&[drawing(circle(DVec2::ZERO, 30.0, 16))]) - 30.0 / 16.0).abs() < 0.05);
    // Many points cost no more than 1024 pixels.
    let fine = drawing(circle(DVec2::ZERO, 512.0, 100_000));
    assert_eq!(pixel_side(&[fine]), 1.0);
}

/// A disc, and a small one beside it or a hole in it, whose points decide nothing together.
fn disc_and(small: Polygon) -> PlaneDrawing {
    let region = vec![circle(DVec2::ZERO, 35.0, 60), small];
    PlaneDrawing { name: "a".into(), z: 0.0, extra: false, regions: vec![region] }
}

#[test]
fn a_small_part_or_hole_beside_a_large_one_has_its_area() {
    for (radius, points) in [(1.0, 8), (1.5, 12), (2.0, 16), (2.0, 60), (3.0, 20)] {
        for middle in [50.3, 12.1].map(|x| DVec2::new(x, 0.4)) {
            let small = circle(middle, radius, points);
            let drawing = disc_and(small.clone());
            let planes = Planes { unit: "mm".into(), axes: Geometry::default().axes, z_out: None };
            let drawings = [drawing.clone(), PlaneDrawing { z: 4.0, ..drawing.clone() }];
            let stack = interslice::polygons::stack(&drawings, &planes, None).expect("the drawing is sound");
            let is_hole = middle.x < 35.0;
            let sides = stack.slices[0].content.sides();
            let own = |n: usize| place(&stack, n).distance(middle) < radius + 2.0;
            let pixels = sides.iter().enumerate().filter(|(n, inside)| own(*n) && **inside != is_hole).count();
            let area = pixels as f64 * stack.spacing[0] * stack.spacing[1];
            let true_area = 0.5 * f64::from(points as u32) * radius * radius * (TAU / points as f64).sin();
            assert!(
                (area / true_area - 1.0).abs() < 0.15,
                "{radius}, {points} points, hole: {is_hole}: {area} of {true_area}"
            );
            assert_eq!(too_large(&drawings, None, stack.spacing), None);
        }
    }
    // For a small one alone no more than 256 pixels; then it is told.
    let far = [disc_and(circle(DVec2::new(300.0, 0.0), 0.5, 12))];
    assert!((pixel_side(&far) - 335.5 / 256.0).abs() < 0.01, "{}", pixel_side(&far));
    let told = too_large(&far, None, [pixel_side(&far); 2]).expect("it is lost");
    assert!(told.starts_with("what 1 of 2 polygons bound is less than 1.5 pixels wide"), "{told}");
    assert!(told.contains("`a` at 0") && told.contains("below 0.12"), "{told}");
    // The tips of a body, one line of ten, change nothing.
    let tips: Vec<PlaneDrawing> = (0..20)
        .map(|k| {
            let radius = if k == 0 { 1.0 } else { 30.0 };
            PlaneDrawing { regions: vec![vec![circle(DVec2::ZERO, radius, 94)]], z: f64::from(k), ..far[0].clone() }
        })
        .collect();
    assert!((pixel_side(&tips) - 1.0).abs() < 0.02, "{}", pixel_side(&tips));
}

/// The wall of a vessel beside a large organ: no line of it is narrow by itself.
#[test]
fn a_thin_wall_beside_a_large_body_has_its_area_or_is_told() {
    let planes = Planes { unit: "mm".into(), axes: Geometry::default().axes, z_out: None };
    let organ_and = |wall: f64| {
        let middle = DVec2::new(80.3, 0.4);
        let region = vec![circle(DVec2::ZERO, 50.0, 128), circle(middle, 20.0, 64), circle(middle, 20.0 - wall, 64)];
        let drawing = PlaneDrawing { name: "a".into(), z: 0.0, extra: false, regions: vec![region] };
        [drawing.clone(), PlaneDrawing { z: 4.0, ..drawing }]
    };
    for wall in [1.0, 1.5, 3.0] {
        let drawings = organ_and(wall);
        let stack = interslice::polygons::stack(&drawings, &planes, None).expect("the drawing is sound");
        let inside = stack.slices[0].content.sides();
        let pixels = inside.iter().enumerate().filter(|(n, inside)| **inside && place(&stack, *n).x > 55.0).count();
        let area = pixels as f64 * stack.spacing[0] * stack.spacing[1];
        let expected = std::f64::consts::PI * wall * (40.0 - wall);
        assert!((area / expected - 1.0).abs() < 0.15, "{wall}: {area} of {expected}");
        assert_eq!(too_large(&drawings, None, stack.spacing), None);
    }
    let thin = organ_and(0.3);
    let told = too_large(&thin, None, [pixel_side(&thin); 2]).expect("it is lost");
    assert!(told.starts_with("what 2 of 6 polygons bound"), "{told}");
}

#[test]
fn small_things_far_apart_are_told() {
    let two = |radius: f64, apart: f64| {
        let region = [0.0, apart].map(|x| circle(DVec2::new(x, 0.0), radius, 60)).to_vec();
        PlaneDrawing { name: "a".into(), z: 0.0, extra: false, regions: vec![region] }
    };
    // The mean width of discs is their radius: 2 px, 4.1 px, and many points on a large body, whose distances are no matter.
    let said = |drawing: PlaneDrawing| {
        let side = pixel_side(std::slice::from_ref(&drawing));
        too_large(&[drawing], None, [side; 2])
    };
    assert!(said(two(2.0, 1000.0)).is_some_and(|note| note.contains("2 wide in the mean") && note.contains("--pixel")));
    assert_eq!(said(two(2.0, 490.0)), None);
    // One above the other they are as wide.
    let upright = |drawing: PlaneDrawing| {
        let turned = drawing.regions[0].iter().map(|line| line.iter().map(|p| DVec2::new(p.y, p.x)).collect());
        PlaneDrawing { regions: vec![turned.collect()], ..drawing.clone() }
    };
    assert!(said(upright(two(2.0, 1000.0))).is_some_and(|note| note.contains("2 wide in the mean")));
    assert_eq!(said(upright(two(2.0, 490.0))), None);
    let fine = PlaneDrawing { regions: vec![vec![circle(DVec2::ZERO, 150.0, 20_000)]], ..two(1.0, 1.0) };
    assert_eq!(said(fine), None);
}

#[test]
fn a_body_below_four_pixels_is_told_whoever_chose_them() {
    let place = folder();
    let lines: Vec<[f64; 2]> = circle(DVec2::ZERO, 10.0, 64).iter().map(DVec2::to_array).collect();
    let text = serde_json::json!({"slices": [{"z": 0, "polygons": [lines]}, {"z": 5, "polygons": [lines]}]});
    write_stack(place.path(), &text.to_string());
    for (pixel, told) in [(2.4, false), (2.6, true), (10.0, true)] {
        let options = ReadOptions { pixel: Some(pixel), ..ReadOptions::default() };
        let input = Input::read(place.path(), &options).expect("the file is sound");
        let says = input.notes.iter().any(|note| note.contains("a --pixel below 2.5 shows it"));
        assert_eq!(says, told, "{pixel}: {:?}", input.notes);
    }
}

#[test]
fn a_slice_that_falls_between_the_pixels_is_told() {
    let place = folder();
    let text = r#"{"unit": "mm", "slices": [{"z": 0, "polygons": [[[0, 0], [90, 0], [90, 90], [0, 90]]]},
        {"z": 5, "polygons": [[[41, 41], [43, 41], [43, 43], [41, 43]]]}, {"z": 10, "polygons": []}]}"#;
    write_stack(place.path(), text);
    let options = ReadOptions { pixel: Some(5.0), ..ReadOptions::default() };
    let input = Input::read(place.path(), &options).expect("the file is sound");
    let told: Vec<&String> = input.notes.iter().filter(|note| note.contains("no pixel of 5 x 5 mm")).collect();
    assert!(matches!(told[..], [note] if note.starts_with("`polygons 1` at 5")), "{:?}", input.notes);
}
