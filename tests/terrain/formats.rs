//! GeoJSON and shapefiles, sound and wrong ones.

use std::fs;

use interslice::stack::ReadOptions;
use interslice::surface::map::Crs;
use interslice::terrain::Terrain;
use serde_json::{Value, json};

use crate::files::folder;
use crate::maps::*;

#[test]
fn degrees_and_wrong_files_are_refused() {
    let place = folder();
    let path = place.path().join("in.geojson");
    let degrees = |r: f64| -> Line { circle([0.0, 0.0], r).iter().map(|p| [p[0] - EAST, p[1] - NORTH]).collect() };
    let features = [feature(100, &degrees(0.4)), feature(150, &degrees(0.3))];
    let text = |crs: Value| json!({"type": "FeatureCollection", "features": features, "crs": crs}).to_string();
    let named = |name: &str| json!({"type": "name", "properties": {"name": name}});
    for (crs, words) in [(named("mine"), "`crs` is `mine`"), (Value::Null, "properties.name")] {
        fs::write(&path, text(crs)).expect("a file can be written");
        assert_says(&refused_file(&path, &[]), &["in.geojson", words]);
    }
    let bare = json!({"type": "FeatureCollection", "features": features}).to_string();
    fs::write(&path, &bare).expect("a file can be written");
    let local = ReadOptions { crs: Some("local".into()), ..pixels(0.02) };
    assert_eq!(Terrain::read(&path, &local).expect("lengths of one's own").map.crs, Crs::Local);
    assert_says(&refused_file(&path, &["--crs", "metres"]), &["`crs` must be EPSG:N"]);
    assert_says(&refused_file(&path, &["--label", "3"]), &["`label` is not for a contour map"]);

    fs::write(&path, &bare[..bare.len() / 2]).expect("a file can be written");
    assert_says(&refused_file(&path, &[]), &["in.geojson: is not GeoJSON"]);
    fs::write(&path, r#"{"type": "Point", "coordinates": [1, 2]}"#).expect("a file can be written");
    assert_says(&refused_file(&path, &[]), &["FeatureCollection"]);
    let point =
        json!({"type": "Feature", "properties": {"elev": 1}, "geometry": {"type": "Point", "coordinates": [1, 2]}});
    assert_says(&refused(&[point], &[]), &["feature 1", "is a Point"]);
}

#[test]
fn a_byte_order_mark_is_no_part_of_geojson() {
    let place = folder();
    let rings = [feature(100, &circle([0.0; 2], 400.0)), feature(150, &circle([0.0; 2], 200.0))];
    for name in ["map.geojson", "map.json"] {
        let path = place.path().join(name);
        fs::write(&path, format!("\u{feff}{}", collection(Some("EPSG:32611"), &rings))).expect("a file can be written");
        let stack = interslice::input::read(&path, &pixels(20.0)).expect("a map");
        assert_eq!(stack.slices.len(), 2, "{name}");
    }
}

#[test]
fn shapefiles_are_read_and_damaged_ones_refused() {
    let place = folder();
    let path = place.path().join("cone.shp");
    shapefile(&path, None);
    let wkt = r#"PROJCS["WGS_1984_UTM_Zone_11N",GEOGCS["GCS_WGS_1984"],UNIT["Meter",1.0]]"#;
    fs::write(path.with_extension("prj"), wkt).expect("a file can be written");
    let [ours, theirs] = [Terrain::read(&path, &pixels(20.0)).expect("a shapefile"), read(&cone(), &pixels(20.0))];
    assert_eq!(ours.map, theirs.map);
    for (a, b) in ours.stack.slices.iter().zip(&theirs.stack.slices) {
        assert_eq!(a.z, b.z);
        assert!((0..a.content.len()).all(|n| a.content.inside(n) == b.content.inside(n)));
    }
    let degrees = r#"GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984"]]"#;
    fs::write(path.with_extension("prj"), degrees).expect("a file can be written");
    let far = "feature 1: (500400, 4000000) cannot be turned from EPSG:4326 into EPSG:32616: longitude and latitude must lie in";
    assert_says(&refused_file(&path, &["--crs-out", "EPSG:32616"]), &["cone.shp", far]);
    assert_says(
        &refused_file(&path, &[]),
        &["degrees wide, more than the 12 that a UTM zone can hold; --crs-out EPSG:N"],
    );
    fs::write(path.with_extension("prj"), wkt).expect("a file can be written");

    for file in ["shp", "dbf"] {
        let damaged = path.with_extension(file);
        let whole = fs::read(&damaged).expect("it was written");
        for part in [0, 10, 60, 110, whole.len() / 2, whole.len() - 9] {
            fs::write(&damaged, &whole[..part.min(whole.len() - 9)]).expect("a file can be written");
            assert_says(&refused_file(&path, &[]), &["cone."]);
        }
        fs::write(&damaged, &whole).expect("a file can be written");
    }
    shapefile(&path, Some(2));
    assert_says(&refused_file(&path, &[]), &["feature 3", "`CONTOUR` is null"]);
    fs::remove_file(path.with_extension("dbf")).expect("it is there");
    assert_says(&refused_file(&path, &[]), &["cone.dbf: cannot read"]);
}
