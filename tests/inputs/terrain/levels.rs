//! What follows from the lines of all levels together: which side of a line is higher, how fine pixels are, how far layers lie apart.

use interslice::stack::ReadOptions;
use serde_json::Value;

use super::maps::*;

#[test]
fn summits_and_pits_are_told_by_the_other_levels() {
    let (west, east) = ([-200.0, 0.0], [200.0, 0.0]);
    let lines = [
        feature(100, &circle([0.0, 0.0], 450.0)),
        feature("150", &circle(west, 150.0)),
        feature(150.0, &circle(east, 150.0)),
        // A pit on the western summit: no line lies in it.
        feature(150, &circle(west, 50.0)),
    ];
    let terrain = read(&lines, &pixels(10.0));
    assert!(inside(&terrain, 0, west) && inside(&terrain, 0, east));
    assert!(inside(&terrain, 1, east) && !inside(&terrain, 1, [0.0, 0.0]));
    assert!(!inside(&terrain, 1, west) && inside(&terrain, 1, [-200.0, 100.0]));
    // The same lines with all heights turned round are a hollow: what lies beyond all lines is the highest.
    let hollow = [feature(-100, &lines_of(&lines[0])), feature(-150, &lines_of(&lines[1]))];
    let terrain = read(&hollow, &pixels(10.0));
    assert_eq!(terrain.stack.slices[1].z, -100.0);
    assert!(!inside(&terrain, 1, west) && inside(&terrain, 1, [448.0, 448.0]));
    assert!(!inside(&terrain, 0, west) && inside(&terrain, 0, east));
}

/// Lines with points more or less dense along them.
#[test]
fn default_pixels_are_as_fine_as_points_and_the_distance_of_lines_tell() {
    let pixel = |step: f64| {
        let line = |k: usize| -> Line {
            let points = (1000.0 / step).round() as usize;
            (0..=points).map(|j| [EAST + 125.0 * k as f64, NORTH + step * j as f64]).collect()
        };
        // 8 lines and 875 across.
        let lines: Vec<Value> = (0..8).map(|k| feature(10 * k as i64, &line(k))).collect();
        let stack = read(&lines, &ReadOptions { crs: Some("EPSG:32611".into()), ..ReadOptions::default() }).stack;
        stack.spacing[0]
    };
    let apart = 875.0 * 1000.0 / 8000.0;
    for (step, wanted) in [(1.0, apart / 8.0), (20.0, 20.0), (250.0, apart / 4.0)] {
        let found = pixel(step);
        assert!((found - wanted).abs() < 1e-6, "points {step} apart: {found}, not {wanted}");
    }
}

#[test]
fn levels_that_lack_lines_are_told() {
    let hill = |levels: &[f64]| {
        let line = |&z: &f64| feature(z, &circle([50.0, 50.0], 45.0 - 0.3 * (z.max(0.0) - 100.0)));
        read(&levels.iter().map(line).collect::<Vec<_>>(), &pixels(2.0)).notes.join("\n")
    };
    let even: Vec<f64> = (0..12).map(|k| 100.0 + 10.0 * f64::from(k)).collect();
    assert!(!hill(&even).contains("apart"), "{}", hill(&even));
    let without: Vec<f64> = even.iter().copied().filter(|z| !(130.0..190.0).contains(z)).collect();
    let told = hill(&without);
    assert!(told.contains("levels lie 10.000 apart, but none between 120.000 and 190.000"), "{told}");
    let mark: Vec<f64> = std::iter::once(-9999.0).chain(even).collect();
    let told = hill(&mark);
    assert!(told.contains("none between -9999.000 and 100.000") && told.contains("no data"), "{told}");
}

#[test]
fn heights_are_an_eighth_of_the_usual_distance_between_levels_apart() {
    let map = |levels: &[f64]| {
        let radius = |k: usize| 100.0 * (levels.len() - k) as f64;
        let lines: Vec<_> =
            levels.iter().enumerate().map(|(k, &z)| feature(z, &circle([0.0, 0.0], radius(k)))).collect();
        read(&lines, &pixels(20.0)).step()
    };
    // Half of the height lies in gaps of up to 100, or of 29: pairs of lines close together are no finer map.
    assert_eq!(map(&[100.0, 110.0, 150.0, 250.0]), Some(12.5));
    assert_eq!(map(&[0.0, 1.0, 30.0, 31.0, 60.0, 61.0]), Some(29.0 / 8.0));
    assert_eq!(map(&[20.0, 40.0, 60.0, 80.0]), Some(2.5));
}
