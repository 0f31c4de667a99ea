//! GeoJSON: lines and polygons with properties.

use std::path::Path;

use geojson::{FeatureCollection, GeoJson, GeometryValue, Position};
use glam::DVec2;
use serde_json::Value;

use super::{Check, Feature, MapPart};
use crate::error::{Error, Result};
use crate::storage::regular;
use crate::surface::map::MapCrs;

/// The features of a file, and the coordinate system its `crs` member names (of before RFC 7946, still what programs write), or what is wrong with
/// that member.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] with feature and value.
pub fn read(path: &Path) -> Result<(Vec<Feature>, Check<MapCrs>)> {
    let wrong = |message: String| Error::Format { path: path.into(), message };
    let text = regular::read_to_string(path).map_err(|source| Error::Read { path: path.into(), source })?;
    let parsed: GeoJson = text.parse().map_err(|e| wrong(format!("is not GeoJSON: {e}")))?;
    let GeoJson::FeatureCollection(collection) = parsed else {
        return Err(wrong("must be a FeatureCollection: each contour a feature with its elevation".into()));
    };
    let crs = coordinate_system(&collection);
    let features = collection.features.into_iter().enumerate().map(|(k, feature)| {
        let name = match &feature.id {
            Some(geojson::feature::Id::String(id)) => format!("feature {} (id {id})", k + 1),
            Some(geojson::feature::Id::Number(id)) => format!("feature {} (id {id})", k + 1),
            None => format!("feature {}", k + 1),
        };
        let lines = match feature.geometry {
            Some(geometry) => parts(geometry.value).map_err(|m| wrong(format!("{name}: {m}")))?,
            None => Vec::new(),
        };
        Ok(Feature { name, fields: feature.properties.into_iter().flatten().collect(), lines })
    });
    Ok((features.collect::<Result<_>>()?, crs))
}

fn coordinate_system(collection: &FeatureCollection) -> Check<MapCrs> {
    let member = collection.foreign_members.as_ref().and_then(|members| members.get("crs"));
    let name = match member {
        None | Some(Value::Null) => return Ok(MapCrs::default()),
        Some(Value::String(name)) => name,
        Some(crs) => crs["properties"]["name"].as_str().ok_or("`crs` has no properties.name")?,
    };
    MapCrs::named(name).ok_or_else(|| match name.to_uppercase().contains("EPSG") {
        true => format!("`crs` is `{name}`, whose code is none of the EPSG registry's (1024 to 32766)"),
        false => format!("`crs` is `{name}`; only EPSG codes are known"),
    })
}

fn parts(value: GeometryValue) -> std::result::Result<Vec<MapPart>, String> {
    let line = |points: &Vec<Position>, ring: bool| part(points, ring);
    match value {
        GeometryValue::Point { coordinates } => Ok(vec![part(&[coordinates], false)?]),
        GeometryValue::MultiPoint { coordinates } => {
            coordinates.into_iter().map(|point| part(&[point], false)).collect()
        }
        GeometryValue::LineString { coordinates } => Ok(vec![line(&coordinates, false)?]),
        GeometryValue::MultiLineString { coordinates } => coordinates.iter().map(|l| line(l, false)).collect(),
        GeometryValue::Polygon { coordinates } => coordinates.iter().map(|l| line(l, true)).collect(),
        GeometryValue::MultiPolygon { coordinates } => coordinates.iter().flatten().map(|l| line(l, true)).collect(),
        other => Err(format!("is a {}; contours are (Multi)LineStrings or (Multi)Polygons", other.type_name())),
    }
}

fn part(positions: &[Position], ring: bool) -> std::result::Result<MapPart, String> {
    let mut part = MapPart { points: Vec::with_capacity(positions.len()), z: Vec::new(), ring };
    for (k, position) in positions.iter().enumerate() {
        match position.as_slice() {
            [x, y, more @ ..] => {
                part.points.push(DVec2::new(*x, *y));
                part.z.extend(more.first());
            }
            other => return Err(format!("point {} has {} coordinates; at least 2 are needed", k + 1, other.len())),
        }
    }
    if !part.z.is_empty() && part.z.len() < part.points.len() {
        return Err(format!("{} of its {} points have z; all or none must", part.z.len(), part.points.len()));
    }
    Ok(part)
}
