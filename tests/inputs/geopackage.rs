//! Contour maps as GeoPackage: sound ones are read as the same map in GeoJSON is, others refused in words.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use crate::files::*;
use interslice::stack::ReadOptions;
use interslice::surface::map::Crs;
use interslice::terrain::Terrain;
use rusqlite::Connection;
use serde_json::{Value, json};

type Line = Vec<[f64; 2]>;

fn circle(radius: f64) -> Line {
    let at = |k: usize| TAU * (k % 60) as f64 / 60.0;
    (0..=60).map(|k| [500_000.0 + radius * at(k).cos(), 4_000_000.0 + radius * at(k).sin()]).collect()
}

/// Levels of a cone.
const CONE: [(f64, f64); 3] = [(100.0, 400.0), (150.0, 250.0), (200.0, 100.0)];

/// Well-known binary of a line.
fn line(points: &Line, z: Option<f64>, big: bool) -> Vec<u8> {
    let word = |v: u32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let number = |v: f64| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let mut bytes = vec![u8::from(!big)];
    bytes.extend(word(if z.is_some() { 1002 } else { 2 }));
    bytes.extend(word(points.len() as u32));
    for [x, y] in points {
        [Some(*x), Some(*y), z].into_iter().flatten().for_each(|v| bytes.extend(number(v)));
    }
    bytes
}

/// Header of a geometry, with or without an envelope.
fn header(envelope: bool) -> Vec<u8> {
    let mut bytes = vec![b'G', b'P', 0, if envelope { 3 } else { 1 }];
    bytes.extend(32611i32.to_le_bytes());
    bytes.extend([0; 32].iter().take(if envelope { 32 } else { 0 }));
    bytes
}

fn many(parts: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = vec![1];
    bytes.extend(5u32.to_le_bytes());
    bytes.extend((parts.len() as u32).to_le_bytes());
    parts.iter().for_each(|part| bytes.extend(part));
    bytes
}

/// A database with the standard's tables, and `layers` of lines.
fn database(path: &Path, layers: &[(&str, &str)]) -> Connection {
    let _ = fs::remove_file(path);
    let database = Connection::open(path).expect("a database can be made");
    database
        .execute_batch(
            "CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT, srs_id INTEGER PRIMARY KEY, organization TEXT, organization_coordsys_id INTEGER,
             definition TEXT, description TEXT);
             CREATE TABLE gpkg_contents (table_name TEXT PRIMARY KEY, data_type TEXT);
             CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, geometry_type_name TEXT, srs_id INTEGER, z INTEGER, m INTEGER);
             INSERT INTO gpkg_spatial_ref_sys VALUES ('UTM', 32611, 'EPSG', 32611, 'PROJCS[]', NULL);",
        )
        .expect("tables");
    for (name, kind) in layers {
        let text = format!(
            "CREATE TABLE \"{name}\" (fid INTEGER PRIMARY KEY, geom BLOB, Elev REAL, name TEXT);
             INSERT INTO gpkg_contents VALUES ('{name}', 'features');
             INSERT INTO gpkg_geometry_columns VALUES ('{name}', 'geom', '{kind}', 32611, 0, 0);"
        );
        database.execute_batch(&text).expect("a layer");
    }
    database
}

fn insert(database: &Connection, layer: &str, blob: &[u8], elevation: Option<f64>) {
    let text = format!("INSERT INTO \"{layer}\" (geom, Elev, name) VALUES (?1, ?2, 'a')");
    database.execute(&text, (blob, elevation)).expect("a row");
}

fn cone(path: &Path) -> Connection {
    let database = database(path, &[("contours", "LINESTRING"), ("peaks", "POINT")]);
    for (k, (z, radius)) in CONE.into_iter().enumerate() {
        insert(&database, "contours", &[header(k == 1), line(&circle(radius), None, k == 2)].concat(), Some(z));
    }
    database
}

fn options() -> ReadOptions {
    ReadOptions { pixel: Some(10.0), ..ReadOptions::default() }
}

fn levels(terrain: &Terrain) -> Vec<(f64, Vec<bool>)> {
    terrain.stack.slices.iter().map(|s| (s.z, s.content.sides())).collect()
}

#[test]
fn a_map_is_that_of_the_same_geojson() {
    let place = folder();
    let [geojson, gpkg, other] = ["a.geojson", "a.gpkg", "map"].map(|name| place.path().join(name));
    let feature = |(z, r): (f64, f64)| json!({"type": "Feature", "properties": {"Elev": z}, "geometry": {"type": "LineString", "coordinates": circle(r)}});
    let crs = json!({"type": "name", "properties": {"name": "EPSG:32611"}});
    let map: Value = json!({"type": "FeatureCollection", "crs": crs, "features": CONE.map(feature)});
    fs::write(&geojson, map.to_string()).expect("a file can be written");
    drop(cone(&gpkg));
    let [wanted, read] = [&geojson, &gpkg].map(|path| Terrain::read(path, &options()).expect("the map is sound"));
    assert_eq!((&read.map.crs, levels(&read)), (&Crs::Epsg(32611), levels(&wanted)));
    // By content, under another name; heights in the points; lines in parts.
    fs::copy(&gpkg, &other).expect("a file can be copied");
    let database = Connection::open(&other).expect("a database");
    database.execute("DELETE FROM contours", []).expect("rows go");
    for (z, radius) in CONE {
        let whole = circle(radius);
        let parts = [line(&whole[..31].to_vec(), Some(z), true), line(&whole[30..].to_vec(), Some(z), false)];
        insert(&database, "contours", &[header(true), many(&parts)].concat(), None);
    }
    database.execute("ALTER TABLE contours DROP COLUMN Elev", []).expect("a column goes");
    drop(database);
    assert_eq!(levels(&Terrain::read(&other, &options()).expect("the map is sound")), levels(&wanted));
    let before = listing(place.path());
    let out = place.path().join("a.dem.tif");
    let [from, to] = [&other, &out].map(|p| p.to_str().expect("temporary paths are UTF-8"));
    let run = interslice(&["reconstruct", from, "-o", to, "--pixel", "10", "--backend", "cpu"]);
    assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
    let after = listing(place.path());
    assert_eq!(after.len(), before.len() + 1, "nothing lies beside the map: {after:?}");
}

#[test]
fn of_a_compound_system_a_map_has_the_planes_and_of_an_undefined_one_none() {
    let place = folder();
    let path = place.path().join("a.gpkg");
    let wanted = {
        drop(cone(&path));
        levels(&Terrain::read(&path, &options()).expect("the map is sound"))
    };
    let plane = r#"PROJCS["UTM",GEOGCS["WGS 84",UNIT["degree",0.0174]],UNIT["metre",1],AUTHORITY["EPSG","32633"]]"#;
    let heights = r#"VERT_CS["EGM96 height",VERT_DATUM["a",2005],UNIT["metre",1],AUTHORITY["EPSG","5773"]]"#;
    let compound = format!(r#"COMPD_CS["both",{plane},{heights}]"#);
    let undefined = r#"LOCAL_CS["Undefined SRS",LOCAL_DATUM["unknown",32767],UNIT["unknown",0],AXIS["Easting",EAST]]"#;
    for (organisation, code, definition, crs) in [
        ("EPSG", 5973, "", Crs::Epsg(25833)),
        ("GDAL", 100_000, &compound, Crs::Epsg(32633)),
        ("none", 99_999, undefined, Crs::Unknown),
        ("none", 99_999, "undefined", Crs::Unknown),
    ] {
        let database = cone(&path);
        let change =
            "UPDATE gpkg_spatial_ref_sys SET organization = ?1, organization_coordsys_id = ?2, definition = ?3";
        database.execute(change, (organisation, code, definition)).expect("a row");
        drop(database);
        let read = Terrain::read(&path, &options()).expect("the map is sound");
        assert_eq!((&read.map.crs, levels(&read)), (&crs, wanted.clone()), "{definition}");
    }
}

/// What `inspect` says of a file that must be refused.
fn refused(path: &Path, more: &[&str], says: &[&str]) {
    let path = path.to_str().expect("temporary paths are UTF-8");
    let run = interslice(&[&["inspect", path, "--pixel", "10"], more].concat());
    let said = stderr(&run);
    assert_eq!(run.status.code(), Some(2), "{said}");
    says.iter().for_each(|w| assert!(said.contains(w), "`{w}` is not in: {said}"));
}

#[test]
fn layers_are_chosen_by_name() {
    let place = folder();
    let path = place.path().join("a.gpkg");
    let file = cone(&path);
    refused(
        &path,
        &["--layer", "paths"],
        &["a.gpkg", "`layer` must name", "got `paths`", "`contours` (linestring), `peaks` (point)"],
    );
    let named = ReadOptions { layer: Some("Contours".into()), ..options() };
    Terrain::read(&path, &named).expect("a name in another case");
    file.execute("UPDATE gpkg_geometry_columns SET geometry_type_name = 'GEOMETRY'", []).expect("a row");
    refused(&path, &[], &["has several layers: --layer NAME chooses one of `contours` (geometry), `peaks` (geometry)"]);
    file.execute("UPDATE gpkg_geometry_columns SET geometry_type_name = 'POINT'", []).expect("a row");
    refused(&path, &[], &["has no layer of lines or polygons, but `contours` (point), `peaks` (point)"]);
    file.execute("DELETE FROM gpkg_contents", []).expect("rows go");
    refused(&path, &[], &["has no layer of features"]);
    drop(file);
    let geojson = place.path().join("a.geojson");
    fs::write(&geojson, "{\"type\": \"FeatureCollection\", \"features\": []}").expect("a file can be written");
    refused(&geojson, &["--layer", "a"], &["`layer` is not for anything but a GeoPackage"]);
    sound_stack(place.path());
    refused(place.path(), &["--layer", "a"], &["`layer` is not for anything but a GeoPackage"]);
}

#[test]
fn points_and_lines_without_elevation_are_left_out_and_told() {
    let place = folder();
    let path = place.path().join("a.gpkg");
    drop(cone(&path));
    let plain = Terrain::read(&path, &options()).expect("a cone");
    let file = cone(&path);
    let point = |z: Option<f64>| {
        let mut bytes = vec![1];
        bytes.extend((if z.is_some() { 1001u32 } else { 1 }).to_le_bytes());
        [Some(500_000.0), Some(4_000_000.0), z].into_iter().flatten().for_each(|v: f64| bytes.extend(v.to_le_bytes()));
        bytes
    };
    let mut points = many(&[point(None), point(None)]);
    points[1] = 4;
    for (geometry, z) in [(point(Some(212.0)), Some(212.0)), (points, None), (line(&circle(50.0), None, false), None)] {
        insert(&file, "contours", &[header(false), geometry].concat(), z);
    }
    drop(file);
    let terrain = Terrain::read(&path, &options()).expect("the lines are good");
    assert_eq!(levels(&terrain), levels(&plain));
    let told: Vec<&String> = terrain.notes.iter().filter(|note| note.ends_with("left out")).collect();
    let wanted = [
        "feature 4 is a point, no line; left out",
        "feature 5 is a point, no line; left out",
        "feature 5 is a point, no line; left out",
        "feature 6 has no elevation (attribute `Elev` is empty); left out",
    ];
    assert_eq!(told, wanted);
}

#[test]
fn geometries_that_lie_about_themselves_are_named() {
    let place = folder();
    let path = place.path().join("a.gpkg");
    let sound = [header(false), line(&circle(50.0), None, false)].concat();
    let with = |at: usize, bytes: &[u8]| {
        let mut spoilt = sound.clone();
        spoilt[at..at + bytes.len()].copy_from_slice(bytes);
        spoilt
    };
    for (blob, says) in [
        (with(0, b"gp"), "its geometry does not begin with GP"),
        (with(3, &[0x21]), "of a kind of the writer's own"),
        (with(3, &[0x0b]), "an envelope of no known kind"),
        (with(8, &[7]), "the byte order 7; it must be 0 or 1"),
        (with(9, &10u32.to_le_bytes()), "is a curve"),
        (with(9, &7u32.to_le_bytes()), "is a geometry of type 7"),
        (with(13, &u32::MAX.to_le_bytes()), "is said to have 4294967295 points, but there is room for 61"),
        (sound[..40].to_vec(), "is said to have 61 points, but there is room for 1"),
        (sound[..6].to_vec(), "is cut off in its header"),
        (sound[..12].to_vec(), "its geometry is cut off"),
        (with(17, &f64::NAN.to_le_bytes()), "feature 4 has the point (NaN"),
    ] {
        let file = cone(&path);
        insert(&file, "contours", &blob, Some(250.0));
        drop(file);
        refused(&path, &[], &["a.gpkg", "feature 4", says]);
    }
    let file = cone(&path);
    insert(&file, "contours", &[header(false), many(&vec![many(&[]); 2])].concat(), Some(250.0));
    drop(file);
    refused(&path, &[], &["feature 4: is a geometry of type 5"]);
    let file = cone(&path);
    file.execute("INSERT INTO contours (geom, Elev) VALUES ('text', 1)", []).expect("a row");
    drop(file);
    refused(&path, &[], &["feature 4: its geometry is Text, not a blob"]);
}

#[test]
fn databases_that_are_damaged_or_never_end_are_refused() {
    let place = folder();
    let path = place.path().join("a.gpkg");
    drop(cone(&path));
    let bytes = fs::read(&path).expect("it was written");
    for cut in [bytes.len() / 2, 4096, 120, 16] {
        fs::write(&path, &bytes[..cut]).expect("a file can be written");
        refused(&path, &[], &["a.gpkg"]);
    }
    fs::write(&path, "no database").expect("a file can be written");
    refused(&path, &[], &["a.gpkg", "is damaged, or no GeoPackage"]);
    let file = Connection::open(place.path().join("empty.gpkg")).expect("a database");
    file.execute_batch("CREATE TABLE a (b)").expect("a table");
    drop(file);
    refused(&place.path().join("empty.gpkg"), &[], &["has no layers that can be read", "gpkg_contents"]);
    let file = cone(&path);
    file.execute_batch(
        "ALTER TABLE contours RENAME TO hidden;
         CREATE VIEW contours AS WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) SELECT NULL AS geom, n AS Elev FROM c WHERE n < 0;",
    )
    .expect("a view");
    drop(file);
    refused(&path, &[], &["layer `contours`: its tables take more steps to read than a file of its size should"]);
    let file = cone(&path);
    file.execute("UPDATE gpkg_geometry_columns SET srs_id = 99", []).expect("a row");
    drop(file);
    refused(&path, &[], &["its coordinate system 99 cannot be read"]);
}
