//! Contours that are holes, too short or open.

use interslice::ContourStack;
use interslice::input::read;
use interslice::stack::ReadOptions;

use super::checks::*;
use crate::files::{folder, listing};
use crate::rtss::*;

#[test]
fn inner_contours_are_holes_as_planar_xor_and_keyhole() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let ring = |kind, z| [(kind, circle(20.0, z)), (kind, circle(8.0, z))];
    let keyhole = |z: f64| {
        let (mut line, mut inner) = (circle(20.0, z), circle(8.0, z));
        line.push(line[0]);
        inner.push(inner[0]);
        inner.reverse();
        line.extend(inner);
        (CLOSED, line)
    };
    let rois = [
        ("planar", [ring(CLOSED, 0.0), ring(CLOSED, 4.0)].concat()),
        ("xor", [ring("CLOSEDPLANAR_XOR", 0.0), ring("CLOSEDPLANAR_XOR", 4.0)].concat()),
        ("keyhole", vec![keyhole(0.0), keyhole(4.0)]),
    ];
    write(&rois, &path);
    let wanted = disc(20.0) - disc(8.0);
    let all = ["planar", "xor", "keyhole"].map(|roi| stack(&path, &[roi]));
    for ring in &all {
        assert_near(area(ring, 0), wanted, 0.01 * wanted);
        let sides = |s: &ContourStack| {
            (0..s.slices[0].content.len()).map(|n| s.slices[0].content.inside(n)).collect::<Vec<_>>()
        };
        assert_eq!(sides(ring), sides(&all[0]));
    }
    let listed = said(&["inspect", &path.display().to_string()], 0);
    assert_says(
        &listed,
        &[
            "3 ROIs",
            "2 contours are holes",
            "4 contours (XOR) on 2 planes (axial)",
            "1 gap of 4 mm; 2 contours are keyholes, with a hole in the same line",
        ],
    );
}

/// Two discs that begin at the point they have in common are two discs.
#[test]
fn contours_that_touch_are_no_holes() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let input = path.display().to_string();
    let right = |z: f64| circle(10.0, z);
    // The mirror image about the point of `right` with the largest x, which comes first in both.
    let left = |z: f64| circle(10.0, z).into_iter().map(|[x, y, z]| [220.0 - x, y, z]).collect::<Vec<_>>();
    let pair = |z: f64| [(CLOSED, right(z)), (CLOSED, left(z))];
    let apart = |z: f64| [(CLOSED, right(z)), (CLOSED, left(z).into_iter().map(|[x, y, z]| [x + 1.0, y, z]).collect())];
    let of = |pair: &dyn Fn(f64) -> [(&'static str, Points); 2]| {
        write(&[("a", [0.0, 4.0].map(pair).concat())], &path);
        let pixel = read(&path, &ReadOptions::default()).expect("the file is sound").spacing[0];
        (said(&["inspect", &input], 0), pixel)
    };
    let ((touching, pixel), (_, other)) = (of(&pair), of(&apart));
    assert_says(&touching, &["4 contours on 2 planes", "1 gap of 4 mm; no contour is a hole"]);
    assert!(!touching.contains("pixels wide"), "{touching}");
    assert_near(pixel, other, 0.01 * other);
}

#[test]
fn contours_that_cross_are_told_but_where_even_odd_is_said() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let beside = |z: f64| circle(12.0, z).into_iter().map(|[x, y, z]| [x + 15.0, y, z]).collect::<Vec<_>>();
    let two = |kind, z| [(kind, circle(20.0, z)), (kind, beside(z))];
    let rois = [
        ("cross", [two(CLOSED, 0.0), two(CLOSED, 4.0)].concat()),
        ("xor", [two("CLOSEDPLANAR_XOR", 0.0), two("CLOSEDPLANAR_XOR", 4.0)].concat()),
        ("ring", [0.0, 4.0].map(|z| [(CLOSED, circle(20.0, z)), (CLOSED, circle(8.0, z))]).concat()),
    ];
    write(&rois, &path);
    let (input, out) = (path.display().to_string(), place.path().join("a.json").display().to_string());
    let told = "lines cross on `k=0` at 0, `k=1` at 4: what lies inside two of them is outside (even-odd)";
    for (roi, count) in [("cross", 1), ("xor", 0), ("ring", 0)] {
        let run = ["reconstruct", &input, "--roi", roi, "-o", &out, "--backend", "cpu"];
        for said in [said(&["inspect", &input, "--roi", roi], 0), said(&run, 0)] {
            assert_eq!(said.matches(told).count(), count, "{roi}: {said}");
        }
    }
    // Any program's polygons, too.
    let line = |radius: f64, x: f64| circle(radius, 0.0).into_iter().map(|[a, b, _]| [a + x, b]).collect::<Vec<_>>();
    let slice = |z: f64| serde_json::json!({"z": z, "polygons": [line(20.0, 0.0), line(12.0, 15.0)]});
    let stack = serde_json::json!({"unit": "mm", "slices": [slice(0.0), slice(4.0)]});
    let file = place.path().join("stack.json");
    std::fs::write(&file, stack.to_string()).expect("a file can be written");
    assert_says(
        &said(&["inspect", &file.display().to_string()], 0),
        &["lines cross on `polygons 0` at 0, `polygons 1` at 4"],
    );
}

/// A line that is drawn on beyond its beginning, farther out.
#[test]
fn a_contour_that_goes_twice_round_is_told() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let beyond = |z: f64| {
        let [line, more] = [20.0, 22.0].map(|radius| circle(radius, z));
        (CLOSED, line.into_iter().chain(more.into_iter().take(30)).collect::<Vec<_>>())
    };
    write(&[("twice", vec![beyond(0.0), beyond(4.0)]), ("once", tube(10.0, &[0.0, 4.0]))], &path);
    let (input, out) = (path.display().to_string(), place.path().join("a.json").display().to_string());
    let told = "a line crosses itself on `k=0` at 0, `k=1` at 4: what it goes round twice is outside (even-odd)";
    for (roi, count) in [("twice", 1), ("once", 0)] {
        let run = ["reconstruct", &input, "--roi", roi, "-o", &out, "--backend", "cpu"];
        for said in [said(&["inspect", &input, "--roi", roi], 0), said(&run, 0)] {
            assert_eq!(said.matches(told).count(), count, "{roi}: {said}");
        }
    }
}

/// Where that is so on every plane, nothing is left, and the error says why.
#[test]
fn contours_that_all_go_twice_round_are_told_as_what_leaves_nothing() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let again = |z: f64| (CLOSED, [circle(20.0, z), circle(20.0, z)].concat());
    write(&[("twice", vec![again(0.0), again(4.0)])], &path);
    let told = [
        "all slices are empty: a line crosses itself on `k=0` at 0, `k=1` at 4",
        "what it goes round twice is outside (even-odd); end it where it began",
    ];
    assert_says(&said(&["reconstruct", &path.display().to_string(), "-o", "a.stl"], 2), &told);
    let line = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]].repeat(2);
    let slices = [0.0, 4.0].map(|z| serde_json::json!({"z": z, "polygons": [line]}));
    let file = place.path().join("stack.json");
    std::fs::write(&file, serde_json::json!({"unit": "mm", "slices": slices}).to_string()).expect("it is written");
    let told = "all slices are empty: a line crosses itself on `polygons 0` at 0, `polygons 1` at 4";
    assert_says(&said(&["reconstruct", &file.display().to_string(), "-o", "a.stl"], 2), &[told]);
}

#[test]
fn short_contours_are_left_out_by_name_and_open_ones_refused() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let mut contours = tube(10.0, &[0.0, 3.0]);
    contours.push((CLOSED, vec![[1.0, 2.0, 6.0]]));
    contours.push((CLOSED, vec![[1.0, 2.0, 6.0], [2.0, 2.0, 6.0]]));
    let points = vec![("POINT", vec![[0.0, 0.0, 0.0]])];
    let open = [tube(10.0, &[0.0, 3.0]), vec![("OPEN_PLANAR", circle(4.0, 6.0))]].concat();
    write(&[("a", contours), ("marker", points), ("line", open), ("flat", tube(5.0, &[1.0])), ("none", vec![])], &path);
    let input = path.display().to_string();
    let listed = said(&["inspect", &input], 0);
    assert_says(
        &listed,
        &["ROI 1 (`a`), contour 3: left out, 1 point", "contour 4: left out, 2 points", "on 2 planes"],
    );
    assert_says(
        &listed,
        &["ROI 2 (`marker`)", "is POINT", "contour 3 is OPEN_PLANAR", "drawn on 1 plane; at", "not drawn"],
    );
    let out = place.path().join("a.stl").display().to_string();
    let told = said(&["reconstruct", &input, "--roi", "a", "-o", &out, "--backend", "cpu"], 0);
    assert_says(&told, &["warning: ROI 1 (`a`), contour 3: left out, 1 point"]);
    assert_says(
        &said(&["reconstruct", &input, "--roi", "marker", "-o", &out], 2),
        &["ROI 2 (`marker`), contour 1 is POINT"],
    );
    assert_says(&said(&["reconstruct", &input, "--roi", "line", "-o", &out], 2), &["contour 3 is OPEN_PLANAR"]);
    assert_says(&said(&["reconstruct", &input, "--roi", "none", "-o", &out], 2), &["0 planes; at least 2"]);
    // All at once: what cannot be done is told, the rest is done.
    let before = listing(place.path());
    let foretold = said(&["reconstruct", &input, "--all-rois", "-o", &out, "--backend", "cpu", "--dry-run"], 0);
    assert_eq!(listing(place.path()), before);
    let told = said(&["reconstruct", &input, "--all-rois", "-o", &out, "--backend", "cpu"], 0);
    for written in listing(place.path()).iter().filter(|path| !before.contains(path)) {
        assert_says(&foretold, &[&format!("would write: {}", written.display())]);
    }
    assert_says(&told, &["ROI 2 (`marker`): left out", "ROI 3 (`line`): left out", "a.a.stl"]);
    assert!(place.path().join("a.a.stl").is_file() && !place.path().join("a.line.stl").exists());
}

/// A vessel's wall beside a large organ: no contour of it is narrow, but what they bound is.
#[test]
fn a_wall_that_pixels_may_lose_is_told() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let beside =
        |radius: f64, z: f64| circle(radius, z).into_iter().map(|[x, y, z]| [x + 90.0, y, z]).collect::<Vec<_>>();
    let with = |wall: f64| {
        let of = |z: f64| [(CLOSED, circle(60.0, z)), (CLOSED, beside(20.0, z)), (CLOSED, beside(20.0 - wall, z))];
        [of(0.0), of(4.0)].concat()
    };
    write(&[("thin", with(0.2)), ("thick", with(4.0))], &path);
    let (input, out) = (path.display().to_string(), place.path().join("a.json").display().to_string());
    let told = "what 2 of 6 polygons bound is less than 1.5 pixels wide";
    for (roi, count) in [("thin", 1), ("thick", 0)] {
        let run = ["reconstruct", &input, "--roi", roi, "-o", &out, "--backend", "cpu"];
        for said in [said(&["inspect", &input, "--roi", roi], 0), said(&run, 0)] {
            assert_eq!(said.matches(told).count(), count, "{roi}: {said}");
        }
    }
}
