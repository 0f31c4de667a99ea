//! Shapefiles: .shp with its .dbf, and .prj and .cpg if there are.

use std::io::{BufReader, Cursor, ErrorKind, Read, Seek};
use std::path::Path;

use glam::DVec2;
use serde_json::Value;
use shapefile::dbase::{self, FieldError, FieldIterator, FieldValue, ReadableRecord};
use shapefile::{Shape, ShapeReader};

use super::{Feature, MapPart, code_page, guard};
use crate::error::{Error, Result};
use crate::storage::regular;
use crate::surface::map::MapCrs;

/// Value that stands for "no data" in a shapefile's z.
const NO_DATA: f64 = -1e38;
/// Most bytes that a table's header can have: it says their number in 16 bits.
const HEADER: u64 = 1 << 16;

/// The features of a shapefile, and the coordinate system of its .prj. Words for a person go to `notes`.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] with record and value.
pub fn read(path: &Path, notes: &mut Vec<String>) -> Result<(Vec<Feature>, MapCrs)> {
    let unreadable = |path: &Path, source| Error::Read { path: path.into(), source };
    let wrong = |path: &Path, message: String| Error::Format { path: path.into(), message };
    let there = |path: &Path| match regular::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(unreadable(path, e)),
    };
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("shx")) {
        return Err(wrong(path, "is the index of a shapefile; give the .shp".into()));
    }
    let bytes = regular::read(path).map_err(|e| unreadable(path, e))?;
    let table = path.with_extension("dbf");
    let table_file = regular::open(&table).map_err(|e| unreadable(&table, e))?;
    let index = path.with_extension("shx");
    let indexed = there(&index)?;
    if let Some(shx) = &indexed {
        guard::index(shx).map_err(|m| wrong(&index, m))?;
    }
    guard::shapes(&bytes, indexed.as_deref()).map_err(|m| wrong(path, m))?;
    let reader = match indexed {
        Some(shx) => ShapeReader::with_shx(Cursor::new(bytes), Cursor::new(shx)),
        None => ShapeReader::new(Cursor::new(bytes)),
    };
    let mut reader = reader.map_err(|e| wrong(path, format!("is no shapefile: {e}")))?;
    let mut features = Vec::new();
    for (k, shape) in reader.iter_shapes().enumerate() {
        let name = format!("feature {}", k + 1);
        let shape = shape.map_err(|e| wrong(path, format!("{name}: {e}")))?;
        let lines = parts(shape).map_err(|m| wrong(path, format!("{name}: {m}")))?;
        features.push(Feature { name, fields: Vec::new(), lines });
    }
    let no_table = |e| wrong(&table, format!("is no dBase table: {e}"));
    let head = regular::begin(&table, HEADER).map_err(|e| unreadable(&table, e))?;
    let page = there(&path.with_extension("cpg"))?;
    let page = page.as_ref().map(|bytes| String::from_utf8_lossy(bytes));
    let page = code_page::text_page(page.as_deref(), &head);
    notes.extend(page.doubt.iter().cloned());
    let records = dbase::ReaderBuilder::new().with_encoding(page.encoding.clone());
    let mut records = records.build(BufReader::new(table_file)).map_err(no_table)?;
    let mut count = 0;
    for (k, record) in records.iter_records_as::<Fields>().enumerate() {
        let Fields(fields) = record.map_err(|e| wrong(&table, format!("record {}: {e}", k + 1)))?;
        count += 1;
        if let Some(feature) = features.get_mut(k) {
            let text = |value| match value {
                Value::String(text) => Value::from(page.text(text)),
                other => other,
            };
            feature.fields = fields.into_iter().map(|(name, value)| (page.text(name), text(value))).collect();
        }
    }
    if count != features.len() {
        return Err(wrong(&table, format!("has {count} records, but the .shp has {} shapes", features.len())));
    }
    let projection = path.with_extension("prj");
    let wkt = there(&projection)?;
    let crs = wkt.map_or(MapCrs::default(), |bytes| MapCrs::of_wkt(&String::from_utf8_lossy(&bytes)));
    Ok((features, crs))
}

/// A record's attributes, but for memos: those lie in another file, and are no elevations.
struct Fields(Vec<(String, Value)>);

impl ReadableRecord for Fields {
    fn read_using<S, M>(record: &mut FieldIterator<'_, S, M>) -> std::result::Result<Self, FieldError>
    where
        S: Read + Seek,
        M: Read + Seek,
    {
        let mut fields = Vec::new();
        for field in record {
            match field {
                Ok(field) => fields.push((field.name.to_string(), json(field.value))),
                Err(e) if matches!(e.kind(), dbase::ErrorKind::MissingMemoFile) => {}
                Err(e) => return Err(e),
            }
        }
        Ok(Fields(fields))
    }
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

fn parts(shape: Shape) -> std::result::Result<Vec<MapPart>, String> {
    let plane = |points: Vec<DVec2>, ring| MapPart { points, z: Vec::new(), ring };
    Ok(match shape {
        Shape::NullShape => Vec::new(),
        Shape::Polyline(line) => {
            let parts = line.into_inner().into_iter();
            parts.map(|p| plane(p.iter().map(|p| DVec2::new(p.x, p.y)).collect(), false)).collect()
        }
        Shape::PolylineM(line) => {
            let parts = line.into_inner().into_iter();
            parts.map(|p| plane(p.iter().map(|p| DVec2::new(p.x, p.y)).collect(), false)).collect()
        }
        Shape::PolylineZ(line) => line.into_inner().iter().map(|p| spatial(p, false)).collect(),
        Shape::Polygon(polygon) => {
            let rings = polygon.into_inner().into_iter();
            rings.map(|r| plane(r.points().iter().map(|p| DVec2::new(p.x, p.y)).collect(), true)).collect()
        }
        Shape::PolygonM(polygon) => {
            let rings = polygon.into_inner().into_iter();
            rings.map(|r| plane(r.points().iter().map(|p| DVec2::new(p.x, p.y)).collect(), true)).collect()
        }
        Shape::PolygonZ(polygon) => polygon.into_inner().iter().map(|r| spatial(r.points(), true)).collect(),
        other => return Err(format!("is a {}; contours are polylines or polygons", other.shapetype())),
    })
}

fn spatial(points: &[shapefile::PointZ], ring: bool) -> MapPart {
    let z: Vec<f64> = points.iter().map(|p| p.z).collect();
    let known = z.iter().all(|z| *z > NO_DATA);
    MapPart {
        points: points.iter().map(|p| DVec2::new(p.x, p.y)).collect(),
        z: if known { z } else { Vec::new() },
        ring,
    }
}
