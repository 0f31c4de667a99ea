//! Where the height of a line stands: in an attribute of many names and units, or in its points.

use interslice::stack::ReadOptions;
use interslice::surface::map::Crs;
use serde_json::{Value, json};

use super::maps::*;

#[test]
fn elevations_have_many_names_and_units() {
    let [outer, inner] = [400.0, 300.0].map(|r| circle([0.0, 0.0], r));
    for name in ["level", "LEVEL", "Hoehe", "quota", "cota", "ELEV", "contour"] {
        let map = [(&outer, 100.0), (&inner, 150.0)].map(|(line, z)| with_fields(line, json!({name: z, "id": 4})));
        assert_eq!(read(&map, &pixels(20.0)).stack.slices[1].z, 150.0, "{name}");
    }
    // A better name wins.
    let both = [(&outer, 100.0), (&inner, 150.0)].map(|(line, z)| with_fields(line, json!({"level": 1, "elev": z})));
    assert_eq!(read(&both, &pixels(20.0)).stack.slices[1].z, 150.0);
    let map = [feature(100, &outer), feature(1000, &inner)];
    for (unit, metres) in [("m", 1000.0), ("ft", 304.8), ("us-ft", 1000.0 * 1200.0 / 3937.0)] {
        let z_unit = Some(serde_json::from_value(json!(unit)).expect("a unit"));
        let z = read(&map, &ReadOptions { z_unit, ..pixels(20.0) }).stack.slices[1].z;
        assert!((z - metres).abs() < 1e-9, "{unit}: {z}");
    }
    assert_says(&refused(&map, &["--z-unit", "yard"]), &["invalid value 'yard' for '--z-unit <UNIT>'", "m, ft, us-ft"]);
}

#[test]
fn heights_may_be_in_the_points_and_polygons_be_lines() {
    let ring = |r: f64, z: f64| -> Vec<[f64; 3]> { circle([0.0, 0.0], r).iter().map(|p| [p[0], p[1], z]).collect() };
    let polygon = |r: f64, z: f64| {
        json!({"type": "Feature", "properties": {"name": "hill"},
               "geometry": {"type": "MultiPolygon", "coordinates": [[ring(r, z)]]}})
    };
    let terrain = read(&[polygon(300.0, 20.0), polygon(200.0, 30.0)], &pixels(10.0));
    assert_eq!([terrain.stack.slices[0].z, terrain.stack.slices[1].z], [20.0, 30.0]);
    assert!(inside(&terrain, 1, [0.0, 0.0]) && !inside(&terrain, 1, [250.0, 0.0]) && inside(&terrain, 0, [250.0, 0.0]));
    assert_eq!(terrain.map.crs, Crs::Epsg(32611));
}

#[test]
fn elevations_that_cannot_be_found_are_named() {
    let [outer, inner] = [400.0, 300.0].map(|r| circle([0.0, 0.0], r));
    let nameless = [with_fields(&outer, json!({"colour": 1})), with_fields(&inner, json!({"colour": 2}))];
    assert_says(&refused(&nameless, &[]), &["in.geojson", "no attribute", "--elevation", "`colour`"]);
    let two = |z: f64| json!({"ELEV_MIN": z, "ELEV_MAX": z + 50.0});
    let ambiguous = [with_fields(&outer, two(100.0)), with_fields(&inner, two(150.0))];
    assert_says(&refused(&ambiguous, &[]), &["several attributes", "`ELEV_MAX`, `ELEV_MIN`"]);
    assert_says(&refused(&ambiguous, &["--elevation", "H"]), &["got `H`", "`ELEV_MAX`"]);
    let terrain = read(&ambiguous, &ReadOptions { elevation: Some("elev_min".into()), ..pixels(20.0) });
    assert_eq!(terrain.stack.slices[0].z, 100.0);
    assert_says(
        &refused(&[feature(Value::Null, &outer), feature(Value::Null, &inner)], &[]),
        &["has no lines: feature 1 has no elevation (attribute `Elev` is empty); left out"],
    );
    assert_says(&refused(&[feature(100, &outer), feature("NaN", &inner)], &[]), &["feature 2", "NaN", "finite"]);
    assert_says(
        &refused(&[feature(100, &outer)], &[]),
        &["all of its lines lie at 100; contour lines of at least two"],
    );
    let band = |ring: &Line, z: f64| json!({"type": "Feature", "properties": two(z), "geometry": {"type": "Polygon", "coordinates": [ring]}});
    assert_says(
        &refused(&[band(&outer, 100.0), band(&inner, 150.0)], &[]),
        &["in.geojson", "its polygons lie between two elevations (`ELEV_MAX`, `ELEV_MIN`); contour lines are needed"],
    );
}
