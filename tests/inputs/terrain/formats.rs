//! GeoJSON and shapefiles, sound and wrong ones.

use std::fs;

use interslice::stack::ReadOptions;
use interslice::surface::map::Crs;
use interslice::terrain::Terrain;
use serde_json::{Value, json};

use super::maps::*;
use crate::files::folder;

#[test]
fn degrees_and_wrong_files_are_refused() {
    let place = folder();
    let path = place.path().join("in.geojson");
    let degrees = |r: f64| -> Line { circle([0.0, 0.0], r).iter().map(|p| [p[0] - EAST, p[1] - NORTH]).collect() };
    let features = [feature(100, &degrees(0.4)), feature(150, &degrees(0.3))];
    let text = |crs: Value| json!({"type": "FeatureCollection", "features": features, "crs": crs}).to_string();
    let named = |name: &str| json!({"type": "name", "properties": {"name": name}});
    for (crs, words) in [(named("mine"), "`crs` is `mine`"), (json!({}), "properties.name")] {
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
    assert_says(&refused(&[point], &[]), &["has no lines: feature 1 is a point, no line; left out"]);
}

/// Maps have heights of summits beside their lines, and lines that nobody gave an elevation.
#[test]
fn points_and_lines_without_elevation_are_left_out_and_told() {
    let other = |geometry: Value, fields: Value| json!({"type": "Feature", "properties": fields, "geometry": geometry});
    let line = json!({"type": "LineString", "coordinates": circle([50.0, 0.0], 90.0)});
    let more = [
        other(json!({"type": "Point", "coordinates": [EAST, NORTH, 212.0]}), json!({"Elev": 212})),
        other(
            json!({"type": "MultiPoint", "coordinates": [[EAST, NORTH], [EAST + 9.0, NORTH]]}),
            json!({"name": "springs"}),
        ),
        other(line.clone(), json!({"Elev": null})),
        other(line.clone(), json!({"Elev": " "})),
        other(line, json!({"name": "path"})),
    ];
    let plain = read(&cone(), &pixels(20.0));
    let terrain = read(&[cone(), more.to_vec()].concat(), &pixels(20.0));
    assert_eq!(terrain.map, plain.map);
    for (a, b) in terrain.stack.slices.iter().zip(&plain.stack.slices) {
        assert!((0..a.content.len()).all(|n| a.content.inside(n) == b.content.inside(n)));
    }
    let first = cone().len() + 1;
    let told = |k: usize, why: &str| terrain.notes.contains(&format!("feature {} {why}; left out", first + k));
    assert!((0..2).all(|k| told(k, "is a point, no line")), "{:?}", terrain.notes);
    assert!((2..5).all(|k| told(k, "has no elevation (attribute `Elev` is empty)")), "{:?}", terrain.notes);
    // What is neither empty nor a number is a mistake.
    let wrong = other(json!({"type": "LineString", "coordinates": circle([0.0; 2], 9.0)}), json!({"Elev": "high"}));
    assert_says(&refused(&[wrong], &[]), &["feature 1: `Elev` is \"high\"; it must be a finite number"]);
}

#[test]
fn the_unit_behind_an_elevations_name_is_no_part_of_it() {
    for (name, metres) in [("altitude_m", 1.0), ("Height_ft", 0.3048), ("hgt", 1.0)] {
        let named = |f: Value| json!({"type": "Feature", "properties": {name: f["properties"]["Elev"], "id": 7}, "geometry": f["geometry"]});
        let terrain = read(&cone().into_iter().map(named).collect::<Vec<_>>(), &pixels(20.0));
        let plain = read(&cone(), &pixels(20.0));
        for (a, b) in terrain.stack.slices.iter().zip(&plain.stack.slices) {
            assert!((a.z - metres * b.z).abs() < 1e-9, "{name}: {} for {}", a.z, b.z);
        }
    }
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

/// The table of a shapefile may be in any code page, or say one that nobody knows: names that are ASCII are read, and others by .cpg, then byte 29.
#[test]
fn shapefiles_are_read_in_whatever_code_page_their_table_is() {
    let place = folder();
    let path = place.path().join("cone.shp");
    shapefile(&path, None);
    let table = path.with_extension("dbf");
    let plain = fs::read(&table).expect("it was written");
    let levels = |mark: u8, name: &[u8], cpg: Option<&str>, options: &ReadOptions| {
        let mut bytes = plain.clone();
        bytes[29] = mark;
        bytes[32..43].fill(0);
        bytes[32..32 + name.len()].copy_from_slice(name);
        fs::write(&table, bytes).expect("a file can be written");
        let beside = path.with_extension("cpg");
        match cpg {
            Some(cpg) => fs::write(&beside, cpg).expect("a file can be written"),
            None => drop(fs::remove_file(&beside)),
        }
        let terrain = Terrain::read(&path, options).unwrap_or_else(|e| panic!("{mark:02x}, {cpg:?}: {e}"));
        let heights: Vec<f64> = terrain.stack.slices.iter().map(|s| s.z).collect();
        assert_eq!(heights, [100.0, 150.0, 200.0, 250.0], "{mark:02x}, {cpg:?}");
        terrain
    };
    for mark in 0..=255 {
        levels(mark, b"CONTOUR", None, &pixels(20.0));
    }
    let named = ReadOptions { elevation: Some("H\u{f6}he \u{fc}".into()), ..pixels(20.0) };
    let (latin, dos, utf) = (&b"H\xf6he \xfc"[..], &b"H\x94he \x81"[..], "H\u{f6}he \u{fc}".as_bytes());
    for (mark, name, cpg) in [
        (0x57, latin, None),
        (0x03, latin, None),
        (0x00, latin, None),
        (0x00, latin, Some("ISO-8859-1")),
        (0x02, latin, Some("1252\n")),
        (0x00, latin, Some("UTF-8")),
        (0x01, dos, None),
        (0x03, dos, Some("OEM 850")),
        (0x00, utf, Some("UTF-8")),
        (0x57, utf, None),
    ] {
        let terrain = levels(mark, name, cpg, &named);
        assert!(terrain.description.iter().any(|line| line.contains("H\u{f6}he \u{fc}")), "{:?}", terrain.description);
    }
    // Pages that the library for tables reads by another one, of two bytes a letter, and of ISO 8859.
    for (mark, bytes, cpg, name) in [
        (0x6a, &b"\xe7\xaf\xa6\xaa"[..], None, "\u{3cd}\u{3c8}\u{3bf}\u{3c2}"),
        (0x00, b"y\x81kseklik", Some("857"), "y\u{fc}kseklik"),
        (0x13, b"\x95W\x8d\x82", None, "\u{6a19}\u{9ad8}"),
        (0x00, b"\xb8\xdf\xb3\xcc", Some("936"), "\u{9ad8}\u{7a0b}"),
        (0x79, b"\xb3\xf4\xc0\xcc", None, "\u{b192}\u{c774}"),
        (0x00, b"\xb0\xaa\xb5{", Some("BIG5"), "\u{9ad8}\u{7a0b}"),
        (0x57, b"v\xfd\xb9ka", Some("ISO-8859-2"), "v\u{fd}\u{161}ka"),
    ] {
        let named = ReadOptions { elevation: Some(name.into()), ..pixels(20.0) };
        let terrain = levels(mark, bytes, cpg, &named);
        assert!(terrain.description.iter().any(|line| line.contains(name)), "{name}: {:?}", terrain.description);
    }
    // One that is not known is named where it matters.
    let named = ReadOptions { elevation: Some("H\u{f6}he".into()), ..pixels(20.0) };
    let notes = |bytes: &[u8], options: &ReadOptions| levels(0, bytes, Some("KOI8-R"), options).notes;
    assert!(
        notes(b"H\xf6he", &named).iter().any(|note| note.contains("the code page `KOI8-R` of its table is not known"))
    );
    assert!(!notes(b"CONTOUR", &pixels(20.0)).iter().any(|note| note.contains("code page")));
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
    let notes = Terrain::read(&path, &pixels(20.0)).expect("the other lines are good").notes;
    assert!(notes.contains(&"feature 3 has no elevation (attribute `CONTOUR` is empty); left out".into()), "{notes:?}");
    fs::remove_file(path.with_extension("dbf")).expect("it is there");
    assert_says(&refused_file(&path, &[]), &["cone.dbf: cannot read"]);
}
