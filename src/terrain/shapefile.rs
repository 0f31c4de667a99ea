//! Shapefiles: .shp with its .dbf, and .prj if there is one.

use std::path::Path;

use serde_json::Value;
use shapefile::dbase::{self, FieldValue};
use shapefile::{Shape, ShapeReader};

use super::{Feature, Part};
use crate::error::{Error, Result};
use crate::map::Crs;

/// What stands for "no data" in a shapefile's z.
const NO_DATA: f64 = -1e38;

/// The features of a shapefile, and the coordinate system of its .prj.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] with record and value.
pub fn read(path: &Path) -> Result<(Vec<Feature>, Crs)> {
    let unreadable = |path: &Path, source| Error::Read { path: path.into(), source };
    let wrong = |path: &Path, message: String| Error::Format { path: path.into(), message };
    std::fs::File::open(path).map_err(|e| unreadable(path, e))?;
    let table = path.with_extension("dbf");
    std::fs::File::open(&table).map_err(|e| unreadable(&table, e))?;
    let mut reader = ShapeReader::from_path(path).map_err(|e| wrong(path, format!("is no shapefile: {e}")))?;
    let mut features = Vec::new();
    for (k, shape) in reader.iter_shapes().enumerate() {
        let name = format!("feature {}", k + 1);
        let shape = shape.map_err(|e| wrong(path, format!("{name}: {e}")))?;
        let lines = parts(shape).map_err(|m| wrong(path, format!("{name}: {m}")))?;
        features.push(Feature { name, fields: Vec::new(), lines });
    }
    let mut records = dbase::Reader::from_path(&table).map_err(|e| wrong(&table, format!("is no dBase table: {e}")))?;
    let mut count = 0;
    for (k, record) in records.iter_records().enumerate() {
        let record = record.map_err(|e| wrong(&table, format!("record {}: {e}", k + 1)))?;
        count += 1;
        if let Some(feature) = features.get_mut(k) {
            feature.fields = record.into_iter().map(|(name, value)| (name, json(value))).collect();
        }
    }
    if count != features.len() {
        return Err(wrong(&table, format!("has {count} records, but the .shp has {} shapes", features.len())));
    }
    let projection = path.with_extension("prj");
    let crs = match std::fs::read(&projection) {
        Ok(bytes) => Crs::of_wkt(&String::from_utf8_lossy(&bytes)),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Crs::Unknown,
        Err(e) => return Err(unreadable(&projection, e)),
    };
    Ok((features, crs))
}

fn json(value: FieldValue) -> Value {
    let number = |v: f64| if v.is_finite() { Value::from(v) } else { Value::from(v.to_string()) };
    match value {
        FieldValue::Numeric(v) => v.map_or(Value::Null, number),
        FieldValue::Float(v) => v.map_or(Value::Null, |v| number(f64::from(v))),
        FieldValue::Double(v) | FieldValue::Currency(v) => number(v),
        FieldValue::Integer(v) => Value::from(v),
        FieldValue::Character(v) => v.map_or(Value::Null, Value::from),
        _ => Value::Null,
    }
}

fn parts(shape: Shape) -> std::result::Result<Vec<Part>, String> {
    let plane = |points: Vec<[f64; 2]>, ring| Part { points, z: Vec::new(), ring };
    Ok(match shape {
        Shape::NullShape => Vec::new(),
        Shape::Polyline(line) => {
            let parts = line.into_inner().into_iter();
            parts.map(|p| plane(p.iter().map(|p| [p.x, p.y]).collect(), false)).collect()
        }
        Shape::PolylineM(line) => {
            let parts = line.into_inner().into_iter();
            parts.map(|p| plane(p.iter().map(|p| [p.x, p.y]).collect(), false)).collect()
        }
        Shape::PolylineZ(line) => line.into_inner().iter().map(|p| spatial(p, false)).collect(),
        Shape::Polygon(polygon) => {
            let rings = polygon.into_inner().into_iter();
            rings.map(|r| plane(r.points().iter().map(|p| [p.x, p.y]).collect(), true)).collect()
        }
        Shape::PolygonM(polygon) => {
            let rings = polygon.into_inner().into_iter();
            rings.map(|r| plane(r.points().iter().map(|p| [p.x, p.y]).collect(), true)).collect()
        }
        Shape::PolygonZ(polygon) => polygon.into_inner().iter().map(|r| spatial(r.points(), true)).collect(),
        other => return Err(format!("is a {}; contours are polylines or polygons", other.shapetype())),
    })
}

fn spatial(points: &[shapefile::PointZ], ring: bool) -> Part {
    let z: Vec<f64> = points.iter().map(|p| p.z).collect();
    let known = z.iter().all(|z| *z > NO_DATA);
    Part { points: points.iter().map(|p| [p.x, p.y]).collect(), z: if known { z } else { Vec::new() }, ring }
}
