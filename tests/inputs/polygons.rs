//! Polygons as slices: how exactly, and how they are combined.

use std::f64::consts::TAU;
use std::fs;

use crate::files::*;
use glam::DVec2;
use interslice::contour::seeds::trace_loops;
use interslice::grid::field::Field;
use interslice::input::{Input, read};
use interslice::polygons::edges::contour_edges;
use interslice::polygons::{CLAMP, PlaneDrawing, Planes, Polygon, stack};
use interslice::stack::{ContourStack, Geometry, ReadOptions, SliceContent};
use proptest::prelude::*;

pub fn circle(center: DVec2, radius: f64, points: usize) -> Polygon {
    (0..points).map(|k| center + radius * DVec2::from_angle(TAU * k as f64 / points as f64)).collect()
}

pub fn square(low: f64, high: f64) -> Polygon {
    [[low, low], [high, low], [high, high], [low, high]].map(DVec2::from).to_vec()
}

/// Both slices hold the same regions.
fn stack_of(regions: Vec<Vec<Polygon>>, pixel: f64) -> ContourStack {
    let slice = |z: f64| PlaneDrawing { name: format!("z={z}"), z, extra: false, regions: regions.clone() };
    let planes = Planes { unit: "mm".into(), axes: Geometry::default().axes, z_out: None };
    stack(&[slice(0.0), slice(3.0)], &planes, Some([pixel; 2])).expect("the drawings are sound")
}

fn level(stack: &ContourStack) -> Vec<f32> {
    match &stack.slices[0].content {
        SliceContent::Level(u) => u.values(),
        SliceContent::Mask(_) => panic!("polygons become level sets"),
    }
}

/// Centre of a pixel in the world.
pub fn place(stack: &ContourStack, node: usize) -> DVec2 {
    let ij = DVec2::new((node % stack.dims[0]) as f64, (node / stack.dims[0]) as f64);
    stack.geometry.origin.truncate() + ij * DVec2::from(stack.spacing)
}

fn assert_close(stack: &ContourStack, signed: impl Fn(DVec2) -> f64) {
    let (clamp, mut kept) = (CLAMP * stack.spacing[0], 0);
    for (node, v) in level(stack).iter().enumerate() {
        let x = place(stack, node);
        let wanted = signed(x).clamp(-clamp, clamp);
        // No value is kept of pixels that lie among others of their side.
        let is_kept = f64::from(v.abs()) < clamp - 1e-5;
        let right = if is_kept { (f64::from(*v) - wanted).abs() < 1e-5 } else { (*v < 0.0) == (wanted < 0.0) };
        assert!(right, "at {x:?}: {v}, not {wanted}");
        kept += usize::from(is_kept);
    }
    assert!(kept > 30, "values of {kept} pixels");
}

/// Distance to the line between two points.
fn to_line(p: DVec2, q: DVec2, x: DVec2) -> f64 {
    let (along, to) = (q - p, x - p);
    let t = along.dot(to) / along.length_squared().max(f64::MIN_POSITIVE);
    to.distance(t.clamp(0.0, 1.0) * along)
}

/// Signed distance to a square, exact.
fn to_square(x: DVec2, low: f64, high: f64) -> f64 {
    let d = (x - (low + high) / 2.0).abs() - (high - low) / 2.0;
    d.max(DVec2::ZERO).length() + d.max_element().min(0.0)
}

#[test]
fn distances_to_a_square_are_exact() {
    let drawn = stack_of(vec![vec![square(-3.37, 14.21)]], 0.7);
    assert_close(&drawn, |x| to_square(x, -3.37, 14.21));
}

#[test]
fn the_zero_line_runs_along_the_polygon_within_a_hundredth_of_a_pixel() {
    let (radius, pixel) = (20.3, 1.1);
    let drawn = stack_of(vec![vec![circle(DVec2::new(101.3, -57.7), radius, 720)]], pixel);
    let u = Field { dims: drawn.dims, data: level(&drawn).iter().map(|v| f64::from(*v)).collect() };
    let paths = trace_loops(&u);
    assert_eq!(paths.len(), 1);
    let off = |x: DVec2| {
        let at = drawn.geometry.origin.truncate() + x * pixel;
        (at.distance(DVec2::new(101.3, -57.7)) - radius).abs() / pixel
    };
    let worst = paths[0].iter().map(|c| off(c.x)).fold(0.0, f64::max);
    assert!(worst < 0.01, "{worst} px");
}

#[test]
fn winding_does_not_count_and_inner_lines_are_holes() {
    let (outer, mut inner) = (square(0.0, 30.0), square(10.0, 20.0));
    let ring = |x| to_square(x, 0.0, 30.0).max(-to_square(x, 10.0, 20.0));
    assert_close(&stack_of(vec![vec![outer.clone(), inner.clone()]], 0.9), ring);
    inner.reverse();
    assert_close(&stack_of(vec![vec![outer.clone(), inner.clone()]], 0.9), ring);
    assert_close(&stack_of(vec![vec![inner, outer]], 0.9), ring);
}

#[test]
fn the_union_of_regions_has_no_holes_where_they_overlap() {
    let regions = vec![vec![square(0.0, 20.0)], vec![square(10.0, 30.0)]];
    let drawn = stack_of(regions.clone(), 0.9);
    for (node, v) in level(&drawn).iter().enumerate() {
        let x = place(&drawn, node);
        let wanted = to_square(x, 0.0, 20.0).min(to_square(x, 10.0, 30.0));
        // On a line rounding decides.
        assert!(wanted.abs() < 1e-9 || (*v < 0.0) == (wanted < 0.0), "at {x:?}");
    }
    // As one region the overlap is outside: the other rule is another body.
    let one = stack_of(vec![regions.concat()], 0.9);
    assert_ne!(level(&one), level(&drawn));
}

/// A ring as one line: around, over the bridge, around the hole, and back over the bridge in steps of its own.
fn keyhole(bridge_there: &[f64], bridge_back: &[f64]) -> Polygon {
    let mut line = vec![[30.0, 12.4], [30.0, 30.0], [0.0, 30.0], [0.0, 0.0], [30.0, 0.0], [30.0, 12.4]];
    line.extend(bridge_there.iter().map(|x| [*x, 12.4]));
    line.extend([[20.0, 12.4], [20.0, 10.0], [10.0, 10.0], [10.0, 20.0], [20.0, 20.0], [20.0, 12.4]]);
    line.extend(bridge_back.iter().map(|x| [*x, 12.4]));
    line.into_iter().map(DVec2::from).collect()
}

#[test]
fn keyholes_are_cut_open_however_their_bridge_is_divided() {
    let ring = |x| to_square(x, 0.0, 30.0).max(-to_square(x, 10.0, 20.0));
    // A bridge along a row of pixel centres (12.4 = 31 * 0.4) would be the worst.
    for pixel in [0.9, 0.4] {
        assert_close(&stack_of(vec![vec![keyhole(&[], &[])]], pixel), ring);
        assert_close(&stack_of(vec![vec![keyhole(&[27.0, 23.5], &[21.1, 25.0, 28.2])]], pixel), ring);
    }
    // The check can fail: with its two sides a pixel apart the bridge is a gap.
    let mut open = keyhole(&[], &[]);
    let last = open.len() - 1;
    open[last][1] = 13.4;
    open[0][1] = 13.4;
    let gap = stack_of(vec![vec![open]], 0.4);
    let node = (0..level(&gap).len()).find(|n| {
        let off = (place(&gap, *n) - DVec2::new(25.2, 12.8)).abs();
        off.max_element() < 0.1
    });
    assert!(level(&gap)[node.expect("a pixel lies there")] > 0.0);
}

#[test]
fn a_bridge_that_does_not_close_exactly_moves_no_side_and_hardly_the_line() {
    // Both sides of the bridge 0.01 mm apart, as rounded coordinates make them.
    let mut line = keyhole(&[], &[]);
    let last = line.len() - 1;
    line[0][1] += 0.01;
    line[last][1] += 0.01;
    let drawn = stack_of(vec![vec![line]], 0.9);
    let whole = stack_of(vec![vec![square(0.0, 30.0), square(10.0, 20.0)]], 0.9);
    let sides = |s: &ContourStack| level(s).iter().map(|v| *v < 0.0).collect::<Vec<_>>();
    assert_eq!(sides(&drawn), sides(&whole));
}

#[test]
fn coincident_sides_cancel_in_pairs() {
    let twice = vec![square(0.0, 10.0), square(0.0, 10.0)];
    assert_eq!(contour_edges(&twice, 1e-6), Vec::<[DVec2; 2]>::new());
    let thrice = [twice, vec![square(0.0, 10.0)]].concat();
    assert_eq!(contour_edges(&thrice, 1e-6).len(), 4);
    // Two squares side by side: the common side goes, also where one of them has a point on it.
    let right = [[10.0, 0.0], [20.0, 0.0], [20.0, 10.0], [10.0, 10.0], [10.0, 4.0]].map(DVec2::from).to_vec();
    let both = contour_edges(&[square(0.0, 10.0), right], 1e-6);
    assert!(both.iter().all(|[p, q]| p.x != 10.0 || q.x != 10.0), "{both:?}");
    assert_eq!(both.len(), 6);
}

#[test]
fn polygons_without_area_are_left_out_by_slice_and_number() {
    let place = folder();
    let square = "[[0, 0], [9, 0], [9, 9], [0, 9]]";
    let sound = format!("{{\"z\": 0, \"polygons\": [{square}]}}");
    for (polygon, points) in [
        ("[]", "0 points bound"),
        ("[[1, 1]]", "1 point bounds"),
        ("[[1, 1], [2, 3]]", "2 points bound"),
        ("[[1.1, 1.1], [2.3, 2.3], [5.7, 5.7], [3.1, 3.1]]", "4 points bound"),
    ] {
        let text = format!("{{\"slices\": [{sound}, {{\"z\": 5, \"polygons\": [{square}, {polygon}]}}]}}");
        write_stack(place.path(), &text);
        let input = Input::read(place.path(), &ReadOptions::default()).expect("the file is sound");
        let wanted = format!("`polygons 1` at 5: polygon 2 left out, its {points} no area");
        assert!(input.notes.contains(&wanted), "{polygon}: {:?}", input.notes);
        assert!(!input.stack.slices[1].content.is_empty(), "{polygon}");
    }
}

#[test]
fn stack_json_may_hold_polygons() {
    let place = folder();
    let text = r#"{"unit": "m", "spacing_xy": [0.5, 0.25], "slices": [
        {"z": 0, "polygons": [[[0.1, 0.1], [10.1, 0.1], [10.1, 10.1], [0.1, 10.1]], [[4.1, 4.1], [6.1, 4.1], [6.1, 6.1], [4.1, 6.1]]]},
        {"z": 2, "polygons": [[[0.1, 0.1], [10.1, 0.1], [10.1, 10.1], [0.1, 10.1]]]}, {"z": 3, "polygons": []}]}"#;
    write_stack(place.path(), text);
    let options = ReadOptions::default();
    let stack = read(place.path(), &options).expect("the file is sound");
    assert_eq!((stack.spacing, stack.unit.as_str(), stack.slices.len()), ([0.5, 0.25], "m", 3));
    assert!(stack.slices[2].content.is_empty());
    let area = |k: usize| (0..level(&stack).len()).filter(|n| stack.slices[k].content.inside(*n)).count() as f64 / 8.0;
    assert_eq!((area(0), area(1)), (96.0, 100.0));
    let fine = read(place.path(), &ReadOptions { pixel: Some(0.1), ..options }).expect("the file is sound");
    assert_eq!(fine.spacing, [0.1; 2]);
}

#[test]
fn contour_lines_of_a_result_are_an_input_again() {
    let place = folder();
    let text = r#"{"axes": [[0, 1, 0], [0, 0, 1], [1, 0, 0]], "slices": [
        {"z": -7, "polygons": [[[100, 50], [120, 50], [120, 70], [100, 70]], [[106, 56], [114, 56], [114, 64], [106, 64]]]},
        {"z": -3, "polygons": [[[100, 50], [120, 50], [120, 70], [100, 70]], [[106, 56], [114, 56], [114, 64], [106, 64]]]}]}"#;
    write_stack(place.path(), text);
    let of = |name: &str| place.path().join(name).display().to_string();
    let run = |input: &str, outputs: &[&str]| {
        let mut arguments =
            vec!["reconstruct".to_string(), input.into(), "-q".into(), "--backend".into(), "cpu".into()];
        outputs.iter().for_each(|o| arguments.extend(["-o".into(), of(o)]));
        arguments.extend(["--pixel".into(), "0.5".into(), "--dz".into(), "1".into()]);
        let output = interslice(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(output.status.success(), "{}", stderr(&output));
    };
    run(&place.path().display().to_string(), &["a.contours.json", "a.json"]);
    run(&of("a.contours.json"), &["b.contours.json", "b.json"]);
    let json = |name: &str| -> serde_json::Value {
        serde_json::from_str(&fs::read_to_string(of(name)).expect("it was written")).expect("it is JSON")
    };
    let a = json("a.contours.json");
    assert_eq!(a["axes"], serde_json::json!([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]));
    let slices = a["slices"].as_array().expect("a list");
    assert_eq!(slices.iter().map(|s| s["z"].as_f64()).collect::<Vec<_>>(), [-7.0, -6.0, -5.0, -4.0, -3.0].map(Some));
    for s in slices {
        let polygons: Vec<Polygon> = serde_json::from_value(s["polygons"].clone()).expect("polygons");
        assert_eq!(polygons.len(), 2, "a ring has two lines");
        let twice = |p: &Polygon| p.iter().zip(p.iter().cycle().skip(1)).map(|(a, b)| a.perp_dot(*b)).sum::<f64>();
        let mut areas: Vec<f64> = polygons.iter().map(|p| twice(p) / 2.0).collect();
        areas.sort_by(f64::total_cmp);
        // Outer lines counter-clockwise, holes clockwise; square corners are rounded a little.
        assert!((areas[0] + 64.0).abs() < 1.2 && (areas[1] - 400.0).abs() < 1.2, "{areas:?}");
    }
    let volume = |name: &str| json(name)["volume"].as_f64().expect("the report has it");
    let (first, second) = (volume("a.json"), volume("b.json"));
    assert!((first - 336.0 * 4.0).abs() < 0.01 * first, "{first}");
    assert!((first - second).abs() < 0.003 * first, "{first} and again {second}");
}

#[test]
fn wrong_polygons_are_told_by_slice_and_value() {
    let place = folder();
    let bad = |slices: &str, extra: &str, wanted: &[&str]| {
        write_stack(place.path(), &format!("{{{extra}\"slices\": {slices}}}"));
        let output = interslice(&["inspect", &place.path().display().to_string()]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        wanted.iter().for_each(|w| assert!(said.contains(w), "{said}\nlacks {w}"));
    };
    let sound = r#"{"z": 0, "polygons": [[[0, 0], [9, 0], [9, 9]]]}"#;
    bad(&format!("[{sound}, {{\"z\": 1}}]"), "", &["slice 1", "neither `file` nor `polygons`"]);
    bad(&format!("[{sound}, {{\"z\": 1, \"file\": \"a.png\"}}]"), "", &["1 of 2 slices", "all or none"]);
    bad(&format!("[{sound}, {{\"z\": 1, \"polygons\": [], \"file\": \"a\"}}]"), "", &["both"]);
    bad(&format!("[{sound}]"), "", &["at least 2 slices"]);
    bad(r#"[{"z": 0, "polygons": []}, {"z": 1, "polygons": [[[1, 1], [2, 2]]]}]"#, "", &["nothing is drawn"]);
    bad(r#"[{"z": 0, "polygons": []}, {"z": 1, "polygons": []}]"#, "", &["nothing is drawn"]);
    bad(r#"[{"z": 0, "polygons": [[[0, 0], [1e300, 0], [9, 9]]]}, {"z": 1, "polygons": []}]"#, "", &["pixel"]);
    bad(&format!("[{sound}, {sound}]"), "", &["height 0 must lie above"]);
    let up = r#"{"z": 1, "polygons": []}"#;
    bad(
        &format!("[{sound}, {up}]"),
        "\"spacing_xy\": [0, 1], ",
        &["stack.json: `spacing_xy` must be a positive number; got 0"],
    );
    bad(&format!("[{sound}, {up}]"), "\"spacing_xy\": [1, -2], ", &["`spacing_xy` must be a positive number; got -2"]);
    bad(&format!("[{sound}, {up}]"), "\"spacing_xy\": [1e-6, 1e-6], ", &["`spacing_xy` must be larger"]);
    let small = r#"{"z": 0, "polygons": [[[1, 1], [9, 1], [9, 9]]]}"#;
    let lost = "must be smaller: no pixel of 500 x 500 mm lies inside a polygon, all slices are empty";
    bad(&format!("[{small}, {up}]"), "\"spacing_xy\": [500, 500], ", &[&format!("stack.json: `spacing_xy` {lost}")]);
    write_stack(place.path(), &format!("{{\"slices\": [{small}, {up}]}}"));
    let output = interslice(&["inspect", &place.path().display().to_string(), "--pixel", "500"]);
    assert!(stderr(&output).contains(&format!("`pixel` {lost}")), "{}", stderr(&output));
    bad(&format!("[{sound}, {up}]"), "\"axes\": [[1, 0, 0], [1, 0, 0], [0, 0, 1]], ", &["axes", "not perpendicular"]);
    bad(&format!("[{sound}, {up}]"), "\"axes\": [[2, 0, 0], [0, 1, 0], [0, 0, 1]], ", &["axis 0 is 2 long"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is drawn, also lines that cross themselves: each pixel's side is that of the even-odd rule, counted plainly.
    #[test]
    fn sides_are_those_of_even_odd(points in prop::collection::vec((0i32..40, 0i32..40), 3..24), pixel in 0.31f64..1.7) {
        let polygon: Polygon = points.iter().map(|(x, y)| DVec2::new(f64::from(*x), f64::from(*y))).collect();
        let spread = |a: usize| polygon.iter().any(|p| p[a] != polygon[0][a]);
        prop_assume!(spread(0) && spread(1));
        let drawn = stack_of(vec![vec![polygon.clone()]], pixel);
        for (node, v) in level(&drawn).iter().enumerate() {
            let at = place(&drawn, node);
            let DVec2 { x, y } = at;
            let next = polygon.iter().cycle().skip(1);
            let crossed = polygon.iter().zip(next).filter(|(p, q)| {
                (p.y <= y) != (q.y <= y) && p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x) > x
            });
            let inside = crossed.count() % 2 == 1;
            // On a line rounding decides.
            if polygon.iter().zip(polygon.iter().cycle().skip(1)).all(|(p, q)| to_line(*p, *q, at) > 1e-4) {
                prop_assert_eq!(*v < 0.0, inside, "at {}, {}", x, y);
            }
        }
    }
}
