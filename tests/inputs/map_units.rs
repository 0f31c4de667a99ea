//! Contour maps in feet: heights become the unit that x and y have, and outputs say which that is.

use std::fs;
use std::path::Path;

use crate::files::{folder, interslice, stderr};
use serde_json::{Value, json};

/// US survey feet of a metre.
const FEET: f64 = 3937.0 / 1200.0;
/// Tennessee in US survey feet, and UTM 16 N.
const IN_FEET: &str = "EPSG:2274";
const IN_METRES: &str = "EPSG:32616";

/// Circles around a summit, four levels ten apart.
fn map(path: &Path, crs: &str) {
    let circle = |r: f64| {
        let at = |k: usize| {
            let angle = (k % 60) as f64 / 60.0 * std::f64::consts::TAU;
            [1_805_000.0 + r * angle.cos(), 605_000.0 + r * angle.sin()]
        };
        (0..=60).map(at).collect::<Vec<_>>()
    };
    let feature = |k: usize| {
        let line = circle(4000.0 - 1000.0 * k as f64);
        json!({"type": "Feature", "properties": {"elev": 100 + 10 * k}, "geometry": {"type": "LineString", "coordinates": line}})
    };
    let name = if crs.contains('+') { crs.into() } else { format!("urn:ogc:def:crs:{}", crs.replace(':', "::")) };
    let features: Vec<Value> = (0..4).map(feature).collect();
    let all = json!({"type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": name}}, "features": features});
    fs::write(path, all.to_string()).expect("a file can be written");
}

/// Heights of the lowest and highest contour, the unit, and what was told.
fn run(map: &Path, options: &[&str]) -> ([f64; 2], String, String) {
    let report = map.with_extension("json").display().to_string();
    let input = map.display().to_string();
    let result = interslice(&[&["reconstruct", &input, "--report", &report, "--backend", "cpu"], options].concat());
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    let text = fs::read(&report).expect("the report was written");
    let report: Value = serde_json::from_slice(&text).expect("it is JSON");
    let contours = report["contours"].as_array().expect("there are contours");
    let height = |contour: &Value| contour["z"].as_f64().expect("a height");
    let [low, high] = [contours.first(), contours.last()].map(|c| height(c.expect("there are some")));
    ([low, high], report["unit"].as_str().unwrap_or_default().into(), stderr(&result))
}

#[test]
fn heights_become_the_unit_of_x_and_y_and_outputs_name_it() {
    let place = folder();
    let feet = place.path().join("feet.geojson");
    map(&feet, IN_FEET);
    let cases: [(&[&str], f64, &str); 5] = [
        (&[], 1.0, "us-ft"),
        (&["--z-unit", "m"], FEET, "us-ft"),
        (&["--z-unit", "us-ft"], 1.0, "us-ft"),
        (&["--crs-out", IN_METRES], 1.0 / FEET, "m"),
        (&["--crs-out", IN_METRES, "--z-unit", "m"], 1.0, "m"),
    ];
    for (options, factor, unit) in cases {
        let ([low, high], named, told) = run(&feet, options);
        let off = (low - 100.0 * factor).abs().max((high - 130.0 * factor).abs());
        assert!(off < 1e-6 && named == unit, "{options:?}: {low} to {high} {named}");
        let guessed = told.contains("heights are taken to be in the same unit");
        assert_eq!(guessed, !options.contains(&"--z-unit"), "{options:?}: {told}");
    }
}

/// Heights in feet beside x and y in metres, and the other way round, said by a system of heights or by the attribute's name.
#[test]
fn heights_have_the_unit_that_their_system_or_name_says() {
    let place = folder();
    let input = place.path().join("map.geojson");
    let ft = 0.3048;
    /// System, attribute, options, factor of heights, and what is told.
    type UnitCase<'c> = (&'c str, &'c str, &'c [&'c str], f64, Option<&'c str>);
    let cases: [UnitCase<'_>; 10] = [
        ("EPSG:32616", "elev", &[], 1.0, None),
        ("EPSG:32616", "ELEV_FT", &[], ft, Some("in units of 0.3048 m, as the name of the attribute `ELEV_FT` says")),
        ("EPSG:32616", "elevFeet", &[], ft, Some("`elevFeet` says")),
        ("EPSG:32616", "ELEV_FT", &["--z-unit", "m"], 1.0, None),
        ("EPSG:32616", "elev_m", &[], 1.0, None),
        (IN_FEET, "elev_m", &[], FEET, Some("in units of 1 m, as the name of the attribute `elev_m` says")),
        (IN_FEET, "ELEV_FT", &[], 1.0, Some("heights are taken to be in the same unit")),
        ("EPSG:32616+8228", "elev", &[], ft, Some("in units of 0.3048 m, as their coordinate system says")),
        ("EPSG:2274+5703", "elev", &[], FEET, Some("in units of 1 m, as their coordinate system says")),
        ("EPSG:32616", "elev", &["--crs", "EPSG:32616+6360"], 1.0 / FEET, Some("as their coordinate system says")),
    ];
    for (crs, name, options, factor, says) in cases {
        map(&input, crs);
        let text = fs::read_to_string(&input).expect("it was written").replace("\"elev\"", &format!("\"{name}\""));
        fs::write(&input, text).expect("a file can be written");
        let ([low, high], _, told) = run(&input, options);
        let off = (low - 100.0 * factor).abs().max((high - 130.0 * factor).abs());
        assert!(off < 1e-6, "{crs} {name} {options:?}: {low} to {high}");
        match says {
            Some(words) => assert!(told.contains(words), "{crs} {name} {options:?}: {told}"),
            None => assert!(!told.contains("heights are taken"), "{crs} {name} {options:?}: {told}"),
        }
    }
}

#[test]
fn the_foot_that_a_3mf_has_is_told() {
    let place = folder();
    let feet = place.path().join("feet.geojson");
    map(&feet, IN_FEET);
    let mesh = place.path().join("a.3mf").display().to_string();
    let (_, _, told) = run(&feet, &["-o", &mesh]);
    assert!(told.contains("3MF does not know the unit us-ft: it is written as foot"), "{told}");
}
