//! Lines that are drawn with more points than their shape needs: pixels are no finer for those.

use std::f64::consts::TAU;
use std::slice::from_ref;

use crate::files::*;
use glam::DVec2;
use interslice::polygons::pixel::pixel_side;
use interslice::polygons::{PlaneDrawing, Planes, Polygon, stack};
use interslice::stack::Geometry;

/// A line of a round form with so many points, radius by angle.
fn round(center: [f64; 2], points: usize, radius: impl Fn(f64) -> f64) -> Polygon {
    let angle = |k: usize| TAU * k as f64 / points as f64;
    (0..points).map(|k| DVec2::from(center) + radius(angle(k)) * DVec2::from_angle(angle(k))).collect()
}

fn circle(radius: f64, points: usize) -> Polygon {
    round([3.0, -7.0], points, |_| radius)
}

/// Corners, with points along the sides so far apart.
fn along(corners: &[[f64; 2]], step: f64) -> Polygon {
    let ends = corners.iter().zip(corners.iter().cycle().skip(1));
    let side = |(&p, &q): (&[f64; 2], &[f64; 2])| {
        let (p, q) = (DVec2::from(p), DVec2::from(q));
        let parts = (p.distance(q) / step).ceil();
        (0..parts as usize).map(move |k| p.lerp(q, k as f64 / parts)).collect::<Vec<_>>()
    };
    ends.flat_map(side).collect()
}

/// The lines on planes that lie so far apart.
fn drawn(gaps: &[f64], lines: &[Polygon]) -> Vec<PlaneDrawing> {
    let mut z = -4.0;
    let plane = |z: f64| PlaneDrawing { name: format!("{z}"), z, extra: false, regions: vec![lines.to_vec()] };
    let above = gaps.iter().map(|gap| {
        z += gap;
        plane(z)
    });
    std::iter::once(plane(-4.0)).chain(above).collect()
}

fn pixel(gap: f64, lines: &[Polygon]) -> f64 {
    pixel_side(&drawn(&[gap; 4], lines))
}

#[track_caller]
fn assert_near(found: f64, wanted: f64, share: f64) {
    assert!((found / wanted - 1.0).abs() < share, "{found}, not {wanted}");
}

#[test]
fn points_that_say_nothing_make_no_finer_pixels_than_an_eighth_of_the_gap() {
    for points in [200, 400, 1000, 4000] {
        assert_near(pixel(4.0, &[circle(17.0, points)]), 0.5, 1e-9);
    }
    // As rounded in a file, and with points on a part of the line only.
    let rounded: Polygon = circle(17.0, 2000).into_iter().map(|p| (p * 100.0).round() / 100.0).collect();
    let arc = |k: usize| 17.0 * DVec2::from_angle(if k < 60 { k as f64 / 10.0 } else { 6.0 + k as f64 / 4000.0 });
    let triangle = along(&[[0.0, 0.0], [40.0, 0.0], [20.0, 60.0]], 0.1);
    for line in [rounded, (0..360).map(arc).collect(), triangle] {
        assert_near(pixel(3.0, &[line]), 0.375, 1e-9);
    }
    // The usual gap: slices close together are none.
    assert_near(pixel_side(&drawn(&[4.0, 0.1, 4.0, 0.1, 4.0, 0.1], &[circle(17.0, 1000)])), 0.5, 1e-9);
    // Where there is one plane there is no gap.
    assert_near(pixel_side(&drawn(&[], &[circle(17.0, 1000)])), TAU * 17.0 / 2000.0, 1e-3);
}

/// A circle with forty waves.
fn waves(points: usize) -> Polygon {
    round([0.0; 2], points, |a| 17.0 + 0.5 * (40.0 * a).cos())
}

#[test]
fn points_that_are_needed_have_their_pixels() {
    // As coarse as ever: points say all there is.
    assert_near(pixel(4.0, &[circle(17.0, 40)]), TAU * 17.0 / 80.0, 0.01);
    // Wide gaps: 64 pixels along the longer side cost nothing, and drawings of few points are coarser all the same.
    assert_near(pixel(60.0, &[circle(17.0, 2000)]), 34.0 / 64.0, 1e-3);
    // A star of 60 spikes, and one with as many points as a circle has.
    let spikes: Polygon =
        (0..120).map(|k| (if k % 2 == 0 { 20.0 } else { 12.0 }) * DVec2::from_angle(TAU * k as f64 / 120.0)).collect();
    let alone = pixel_side(&drawn(&[], from_ref(&spikes)));
    assert_near(pixel(200.0, &[spikes]), alone, 1e-9);
    // A circle of which chords of two pixels lie a twentieth of a pixel from it has a radius of ten of them: waves have less.
    assert!(pixel(60.0, &[waves(4000)]) < 0.4, "{}", pixel(60.0, &[waves(4000)]));
    // Corners are rounded by no more than those of a square that is drawn by its corners alone.
    let corners = [[0.0, 0.0], [40.0, 0.0], [40.0, 40.0], [0.0, 40.0]];
    let by_corners = pixel(60.0, &[corners.map(DVec2::from).to_vec()]);
    assert_near(pixel(60.0, &[along(&corners, 0.05)]), by_corners, 0.05);
}

#[test]
fn pixels_do_not_depend_on_how_and_where_lines_lie() {
    let forms = [
        round([30.0, -5.0], 1000, |a| 17.0 + 3.0 * (3.0 * a).sin() + 0.3 * (11.0 * a).cos()),
        along(&[[0.0, 0.0], [31.0, 2.0], [29.0, 9.0], [60.0, 44.0], [-4.0, 21.0]], 0.07),
        waves(4000),
        circle(17.0, 2000),
    ];
    for form in forms {
        for gap in [4.0, 80.0] {
            let own = pixel(gap, from_ref(&form));
            let mut turned_round = form.clone();
            turned_round.reverse();
            let mut begun_elsewhere = form.clone();
            begun_elsewhere.rotate_left(form.len() / 3 + 1);
            let closed = form.iter().chain(&form[..1]).copied().collect();
            let turned = |by: f64| form.iter().map(|p| DVec2::from_angle(by).rotate(*p)).collect();
            let upright = form.iter().map(|p| p.perp()).collect();
            let moved = form.iter().map(|p| p + DVec2::new(1234.5, -77.7)).collect();
            for other in [turned_round, begun_elsewhere, closed, upright, moved] {
                assert_near(pixel(gap, &[other]), own, 0.02);
            }
            // The longer side is one along x or y, where it has a say.
            assert_near(pixel(4.0, &[turned(1.0)]), pixel(4.0, from_ref(&form)), 0.02);
            for scale in [1e-3, 25.4] {
                let scaled: Polygon = form.iter().map(|p| scale * p).collect();
                assert_near(pixel(scale * gap, &[scaled]), scale * own, 1e-6);
            }
            let mut upside_down = drawn(&[gap; 4], from_ref(&form));
            upside_down.iter_mut().for_each(|plane| plane.z *= -1.0);
            assert_near(pixel_side(&upside_down), own, 1e-9);
        }
    }
}

#[test]
fn a_dot_on_one_slice_beside_a_dense_line_has_its_area() {
    let planes = Planes { unit: "mm".into(), axes: Geometry::default().axes, z_out: None };
    for (radius, points) in [(1.0, 8), (0.4, 12), (2.0, 8)] {
        let mut drawings = drawn(&[4.0; 20], &[circle(17.0, 1000)]);
        let dot = round([25.0, 0.3], points, |_| radius);
        drawings[7].regions[0].push(dot);
        let stack = stack(&drawings, &planes, None).expect("the drawing is sound");
        let x = |n: usize| stack.geometry.origin.x + (n % stack.dims[0]) as f64 * stack.spacing[0];
        let sides = stack.slices[7].content.sides();
        let area = sides.iter().enumerate().filter(|(n, inside)| **inside && x(*n) > 22.0).count() as f64
            * stack.spacing[0]
            * stack.spacing[1];
        let wanted = 0.5 * points as f64 * radius * radius * (TAU / points as f64).sin();
        assert_near(area, wanted, 0.15);
    }
}

#[test]
fn what_pixels_are_chosen_by_is_said() {
    let place = folder();
    let said = |points: usize, gap: f64, more: &[&str]| {
        let line: Vec<[f64; 2]> = circle(17.0, points).iter().map(DVec2::to_array).collect();
        let slices = [0.0, gap].map(|z| serde_json::json!({"z": z, "polygons": [line]}));
        write_stack(place.path(), &serde_json::json!({"slices": slices}).to_string());
        let output = interslice(&[&["inspect", &place.path().display().to_string()], more].concat());
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    for (points, gap, side, why) in [
        (40, 4.0, "1.33", "half the distance of neighbouring points"),
        (1000, 4.0, "0.5 x 0.5 mm", "an eighth of the usual gap between slices"),
        (1000, 40.0, "0.53", "1/64 of the longer side of all contours"),
    ] {
        let told = said(points, gap, &[]);
        assert!(told.contains(&format!("px of {side}")) && told.contains(&format!("by the polygons: {why}")), "{told}");
    }
    assert!(!said(1000, 4.0, &["--pixel", "0.7"]).contains("pixels are chosen"));
}
