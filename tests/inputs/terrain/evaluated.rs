//! Scores of contour maps of which lines are left out.

use serde_json::Value;

use super::border::across;
use super::maps::*;
use crate::files::{folder, interslice, stderr};

/// Scores of the lines in this file, and what was told.
fn scores(features: &[Value], options: &[&str]) -> (Value, String) {
    let place = folder();
    let input = place.path().join("in.geojson");
    write(&input, features);
    let path = input.display().to_string();
    let run = ["evaluate", &path, "--json", "--backend", "cpu"];
    let done = interslice(&[&run[..], options].concat());
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    (serde_json::from_slice(&done.stdout).expect("scores are JSON"), stderr(&done))
}

/// The stack of a map goes on beyond its border; what lies there does not count.
#[test]
fn pixels_within_the_border_count() {
    // Uphill to the east: half of the map lies above its line at 500.
    let lines: Vec<Value> = (1..10).map(|k| feature(100 * k, &across(1.0, 0.0, 100.0 * f64::from(k)))).collect();
    let border = format!("{EAST},{NORTH},{},{}", EAST + 1000.0, NORTH + 800.0);
    let (score, _) = scores(&lines, &["--leave", "5", "--border", &border, "--pixel", "10"]);
    let slices = score["slices"].as_array().expect("slices");
    assert_eq!((slices.len(), &slices[0]["z"]), (1, &Value::from(500.0)));
    // Pixels lie at multiples of 10, both borders included; those of the line itself may be on either side.
    let pixels = slices[0]["pixels"][0].as_u64().expect("a number");
    assert!((50 * 81..=51 * 81).contains(&pixels), "{pixels}");
}

/// Heights along a line left out are 2 % of the distance of those beside it off on a plane, and on a hill by what these do not say.
#[test]
fn errors_of_heights_are_told() {
    let plane: Vec<Value> = (1..10).map(|k| feature(100 * k, &across(0.8, 0.6, 100.0 * f64::from(k) + 90.0))).collect();
    let (score, _) = scores(&plane, &["--pixel", "10"]);
    let [own, linear] =
        [&score["height_error"], &score["linear"]["height_error"]].map(|e| e.as_f64().expect("a number"));
    assert!(own < 8.0 && linear < 8.0, "{own} {linear}");
    for slice in score["slices"].as_array().expect("slices") {
        assert!(slice["height_error"].as_f64().is_some_and(|e| e < 12.0), "{slice}");
    }
    // Of three circles the middle one lies nearer to the outer than heights between both say: by a quarter of the way instead of a half.
    let hill = [(100, 400.0), (200, 350.0), (300, 200.0)].map(|(z, r)| feature(z, &circle([500.0, 400.0], r)));
    let border = format!("{EAST},{},{},{}", NORTH + 50.0, EAST + 1000.0, NORTH + 800.0);
    let (score, told) = scores(&hill, &["--pixel", "5", "--border", &border]);
    for error in [&score["height_error"], &score["linear"]["height_error"]] {
        assert!(error.as_f64().is_some_and(|e| (e - 50.0).abs() < 10.0), "{score}");
    }
    // What is told of the map by every run.
    assert!(told.contains("warning: 1 lines go beyond the border and are cut there"), "{told}");
}

/// A hill ends above its highest line as in a reconstruction of the same lines: by a share of the distance of levels that is a map's own.
#[test]
fn p19_maps_are_scored_with_the_settings_of_their_reconstruction() {
    let lines = [(100, 400.0), (200, 350.0), (300, 300.0), (400, 250.0), (500, 200.0)];
    let hill = lines.map(|(z, r)| feature(z, &circle([500.0, 400.0], r)));
    let of = |options: &[&str]| scores(&hill, &[&["--pixel", "5", "--end-top", "extrapolate"], options].concat()).0;
    let [own, said, other] = [of(&[]), of(&["--cap-gaps", "1"]), of(&["--cap-gaps", "1.5"])];
    assert_eq!(own["ends"], said["ends"]);
    assert_ne!(own["ends"], other["ends"]);
}
