//! Maps that the tests write, and what is read of them or said of those that are refused.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use interslice::stack::ReadOptions;
use interslice::terrain::Terrain;
use serde_json::{Value, json};

use crate::files::{folder, interslice, stderr};

pub type Line = Vec<[f64; 2]>;

/// Far from degrees, as projected coordinates are.
pub const EAST: f64 = 500_000.0;
pub const NORTH: f64 = 4_000_000.0;

pub fn circle([x, y]: [f64; 2], radius: f64) -> Line {
    let at = |k: usize| TAU * (k % 120) as f64 / 120.0;
    (0..=120).map(|k| [EAST + x + radius * at(k).cos(), NORTH + y + radius * at(k).sin()]).collect()
}

pub fn feature(z: impl Into<Value>, line: &Line) -> Value {
    json!({"type": "Feature", "properties": {"Elev": z.into(), "id": 7},
           "geometry": {"type": "LineString", "coordinates": line}})
}

pub fn with_fields(line: &Line, fields: Value) -> Value {
    json!({"type": "Feature", "properties": fields, "geometry": {"type": "LineString", "coordinates": line}})
}

pub fn lines_of(feature: &Value) -> Line {
    serde_json::from_value(feature["geometry"]["coordinates"].clone()).expect("points")
}

/// Levels of the cone `z = 300 - r / 2`.
pub fn cone() -> Vec<Value> {
    [(100.0, 400.0), (150.0, 300.0), (200.0, 200.0), (250.0, 100.0)]
        .map(|(z, r)| feature(z, &circle([0.0, 0.0], r)))
        .to_vec()
}

pub fn collection(crs: Option<&str>, features: &[Value]) -> String {
    let mut text = json!({"type": "FeatureCollection", "features": features});
    if let Some(name) = crs {
        text["crs"] = json!({"type": "name", "properties": {"name": name}});
    }
    text.to_string()
}

pub fn write(path: &Path, features: &[Value]) {
    let crs = json!({"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32611"}});
    let text = json!({"type": "FeatureCollection", "crs": crs, "features": features}).to_string();
    fs::write(path, text).expect("a file can be written");
}

/// Writes the cone as a shapefile, with the height of ring `spoilt` as no number.
pub fn shapefile(path: &Path, spoilt: Option<usize>) {
    use shapefile::dbase::{FieldValue, Record, TableWriterBuilder};
    let name = "CONTOUR".try_into().expect("a field's name");
    let table = TableWriterBuilder::new().add_numeric_field(name, 12, 2);
    let mut writer = shapefile::Writer::from_path(path, table).expect("a file can be written");
    for (k, feature) in cone().iter().enumerate() {
        let points = lines_of(feature).iter().map(|p| shapefile::Point::new(p[0], p[1])).collect();
        let z = feature["properties"]["Elev"].as_f64().filter(|_| spoilt != Some(k));
        let mut record = Record::default();
        record.insert("CONTOUR".into(), FieldValue::Numeric(z));
        writer.write_shape_and_record(&shapefile::Polyline::new(points), &record).expect("it can be written");
    }
}

pub fn read(features: &[Value], options: &ReadOptions) -> Terrain {
    let place = folder();
    let path = place.path().join("map.geojson");
    write(&path, features);
    Terrain::read(&path, options).expect("the map is sound")
}

pub fn pixels(pixel: f64) -> ReadOptions {
    ReadOptions { pixel: Some(pixel), ..ReadOptions::default() }
}

/// Whether level `k` is inside at a point.
pub fn inside(terrain: &Terrain, k: usize, [x, y]: [f64; 2]) -> bool {
    let stack = &terrain.stack;
    let i = ((EAST + x - stack.geometry.origin[0]) / stack.spacing[0]).round() as usize;
    let j = ((NORTH + y - stack.geometry.origin[1]) / stack.spacing[1]).round() as usize;
    stack.slices[k].content.inside(j * stack.dims[0] + i)
}

/// What the program says of a map that it must refuse.
pub fn refused(features: &[Value], more: &[&str]) -> String {
    let place = folder();
    let path = place.path().join("in.geojson");
    write(&path, features);
    refused_file(&path, more)
}

pub fn refused_file(path: &Path, more: &[&str]) -> String {
    let out = path.with_extension("dem.tif");
    let (input, name) = (path.display().to_string(), out.display().to_string());
    let run = ["reconstruct", &input, "-o", &name, "--pixel", "20", "--backend", "cpu"];
    let output = interslice(&[&run[..], more].concat());
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(!out.exists());
    stderr(&output)
}

#[track_caller]
pub fn assert_says(said: &str, words: &[&str]) {
    words.iter().for_each(|w| assert!(said.contains(w), "`{w}` is not in: {said}"));
}
