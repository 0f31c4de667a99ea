//! Contours that are holes, too short or open.

use interslice::ContourStack;

use crate::checks::*;
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
        &["3 ROIs", "2 contours are holes", "4 contours (XOR) on 2 planes (axial)", "1 gap of 4 mm", "no holes"],
    );
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
