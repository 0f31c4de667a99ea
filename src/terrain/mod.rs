//! Contour maps: lines of equal elevation become a stack of the regions that are at least so high.
//!
//! ```text
//! geojson, geopackage, shapefile -> Feature -> elevation -> lines -> join (chains per level) -> border (closed lines) -> levels (uphill side, stack)
//! ```
//!
//! Crossing a line of a level always leads from its one side, at least as high, to the other. So one bit decides for all lines of a level
//! which side is uphill, and the lines of all other levels vote: higher ones lie uphill, lower ones downhill. A closed line between
//! the levels 100 and 110 is thus a pit if it is of 100, a summit if it is of 110.

mod arch;
mod below;
mod border;
mod code_page;
mod crossing;
mod elevation;
mod geojson;
#[cfg(feature = "geopackage")]
mod geopackage;
mod guard;
mod hull;
mod join;
mod levels;
mod lines;
mod loose;
mod onward;
mod project;
mod shapefile;

use std::path::{Path, PathBuf};

use glam::DVec2;
use join::Edges;

use crate::error::{Error, Result};
use crate::stack::heights::middle_gap;
use crate::stack::{ContourStack, ReadOptions};
use crate::storage::regular;
use crate::surface::map::{Crs, Map, MapCrs};

/// What is found, or a message without the file's name.
type Check<T> = std::result::Result<T, String>;

/// Parts of the usual distance between levels that are the distance between output heights, where none is asked for.
const STEPS_PER_LEVEL: f64 = 8.0;

/// Metres by which units differ that are not the same, and feet that are not of the same kind.
const SAME_UNIT: f64 = 1e-9;
const SAME_FOOT: f64 = 1e-5;

/// A feature of the file.
#[derive(Debug)]
struct Feature {
    /// "feature 3": counted from 1, with its id if it has one.
    name: String,
    /// Attributes.
    fields: Vec<(String, serde_json::Value)>,
    /// Its lines: x, y, and z where the file has it.
    lines: Vec<MapPart>,
}

/// A line of a feature.
#[derive(Debug)]
struct MapPart {
    points: Vec<DVec2>,
    /// Elevation of all points, or none.
    z: Vec<f64>,
    /// Ring of a polygon.
    ring: bool,
}

/// A contour map that was read.
#[derive(Debug)]
pub struct Terrain {
    /// Level sets: the region that is at least so high, slice by slice. They go on beyond the border.
    pub stack: ContourStack,
    /// Coordinate system and the pixels of the map.
    pub map: Map,
    /// Notes for a person.
    pub notes: Vec<String>,
    /// Description of the file, in a few lines.
    pub description: Vec<String>,
}

impl Terrain {
    /// Reads contour lines or polygons with elevations from GeoJSON, a shapefile or a GeoPackage.
    ///
    /// # Errors
    /// [`Error::Read`]; [`Error::Format`] with feature, coordinates and limit; [`Error::Setting`] for options that do not fit.
    pub fn read(path: &Path, options: &ReadOptions) -> Result<Self> {
        let wrong = |message: String| Error::Format { path: path.into(), message };
        let format = MapFormat::of(path)?;
        let layer = options.layer.as_deref();
        if layer.is_some() && format != MapFormat::GeoPackage {
            let message = "is not for anything but a GeoPackage, which may have several".into();
            return Err(Error::Setting { name: "layer".into(), message });
        }
        let mut notes = Vec::new();
        let (features, named) = match format {
            MapFormat::GeoJson => geojson::read(path)?,
            MapFormat::Shapefile => shapefile::read(path, &mut notes).map(|(features, crs)| (features, Ok(crs)))?,
            #[cfg(feature = "geopackage")]
            MapFormat::GeoPackage => geopackage::read(path, layer).map(|(features, crs)| (features, Ok(crs)))?,
            #[cfg(not(feature = "geopackage"))]
            MapFormat::GeoPackage => {
                return Err(wrong(
                    "is a GeoPackage, which this program was built without (feature `geopackage`)".into(),
                ));
            }
        };
        let shape = format == MapFormat::Shapefile;
        let (mut lines, field) = lines::lines(&features, options.elevation.as_deref(), &mut notes).map_err(wrong)?;
        let MapCrs { crs, height_metres } =
            coordinate_system(named, options, &lines, shape, &mut notes).map_err(wrong)?;
        let own = project::metres(&crs);
        let (crs, reprojected) = project::project(&mut lines, crs, options.crs_out.as_deref()).map_err(wrong)?;
        notes.extend(reprojected);
        notes.extend(project::stretched(&lines, &crs));
        let edges = Edges::of(options.border.as_ref())?;
        let mut lines = lines::distinct(lines, &mut notes);
        let pixel = lines::pixel(&lines, options.pixel).map_err(|e| e.in_file(path))?;
        if crs == Crs::Unknown {
            notes.push("no coordinate system is named; --crs EPSG:N sets it".into());
        }
        // Heights become those of the unit that x and y have now. Where nobody says theirs it is that of x and y in the file, or, beside degrees, now.
        let side = project::metres(&crs).unwrap_or(1.0);
        let said = height_metres.map(|metres| (metres, "their coordinate system".to_string()));
        let said =
            said.or_else(|| elevation::metres_of(&field).map(|metres| (metres, format!("the name of the {field}"))));
        let metres = match options.z_unit {
            Some(unit) => Some(unit.metres()),
            None => {
                // Feet are those of x and y, whichever they are.
                let other = said.filter(|(metres, _)| (metres - own.unwrap_or(side)).abs() > SAME_FOOT);
                notes.extend(other.as_ref().map(|(metres, by)| {
                    format!("heights are taken to be in units of {metres} m, as {by} says; --z-unit names another unit")
                }));
                other.map(|(metres, _)| metres)
            }
        };
        let factor = metres.or(own).map_or(1.0, |metres| metres / side);
        lines.iter_mut().for_each(|line| line.z *= factor);
        if let Some(metres) = own.or(Some(side)).filter(|m| metres.is_none() && (m - 1.0).abs() > SAME_UNIT) {
            notes.push(format!("x and y are in units of {metres} m; heights are taken to be in the same unit"));
        }
        let joined = join::join(lines, &edges, pixel, &mut notes).map_err(wrong)?;
        let (stack, map) = levels::stack(&joined, pixel, crs, options.below).map_err(|e| match e {
            levels::Wrong::Lines(message) => wrong(message),
            levels::Wrong::Other(error) => error.in_file(path),
        })?;
        stack.validate().map_err(|e| e.in_file(path))?;
        notes.extend(levels::too_small(&joined, pixel));
        notes.extend(stack.missing_levels());
        notes.extend(crossing::crossings(&joined));
        let mut description = joined.describe(&field, features.len());
        description.push(match &map.crs {
            Crs::Epsg(code) => format!("coordinate system EPSG:{code}"),
            Crs::Wkt(wkt) => format!("coordinate system {}", wkt.split(',').next().unwrap_or(wkt)),
            Crs::Local => "plane coordinates in no known system".into(),
            Crs::Unknown => "coordinate system not named".into(),
        });
        Ok(Terrain { stack, map, notes, description })
    }

    /// Distance between output heights where none is asked for: an eighth of the usual distance between levels, see [`middle_gap`]. Lines that are drawn
    /// beside levels make no finer map.
    pub fn step(&self) -> Option<f64> {
        let levels: Vec<f64> = self.stack.slices.iter().map(|level| level.z).collect();
        Some(middle_gap(&levels) / STEPS_PER_LEVEL).filter(|step| *step > 0.0)
    }
}

/// Format of a contour map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MapFormat {
    GeoJson,
    Shapefile,
    GeoPackage,
}

impl MapFormat {
    /// By how a file begins; what does not tell is GeoJSON, a text that may begin with anything.
    fn of(path: &Path) -> Result<Self> {
        let begin = regular::begin(path, BEGIN).map_err(|source| Error::Read { path: path.into(), source })?;
        Ok(match format(&begin) {
            Some(GEOPACKAGE) => MapFormat::GeoPackage,
            Some(_) => MapFormat::Shapefile,
            None if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("shp")) => MapFormat::Shapefile,
            None if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gpkg")) => MapFormat::GeoPackage,
            None => MapFormat::GeoJson,
        })
    }
}

/// Bytes that tell a format.
const BEGIN: u64 = 36;
/// Names of formats in the table of inputs.
const GEOPACKAGE: &str = "geopackage";
const SHAPEFILE: &str = "shapefile";

/// Name of the format of a file that begins so, where that tells.
pub(crate) fn format(begin: &[u8]) -> Option<&'static str> {
    if begin.starts_with(b"SQLite format 3\0") {
        return Some(GEOPACKAGE);
    }
    // The file's code, and its version behind five numbers that are not used and its length.
    let shape = begin.starts_with(&9994u32.to_be_bytes()) && begin.get(28..32) == Some(&1000u32.to_le_bytes()[..]);
    shape.then_some(SHAPEFILE)
}

/// The files of a contour map: a shapefile has several.
pub fn files(path: &Path) -> Vec<PathBuf> {
    let beside = ["cpg", "dbf", "prj", "shx"].map(|e| path.with_extension(e));
    let shape = MapFormat::of(path).is_ok_and(|format| format == MapFormat::Shapefile);
    let beside = beside.into_iter().filter(|p| shape && p.is_file());
    std::iter::once(path.to_path_buf()).chain(beside).collect()
}

/// That of the options, with a note where the file names another or none that is understood, else of the file. GeoJSON that names none and looks like degrees has them (RFC 7946).
fn coordinate_system(
    named: Check<MapCrs>,
    options: &ReadOptions,
    lines: &[lines::ContourLine],
    shape: bool,
    notes: &mut Vec<String>,
) -> Check<MapCrs> {
    let named = match (named, &options.crs) {
        (Ok(named), _) => named,
        (Err(why), Some(_)) => {
            notes.push(format!("{why}: coordinates are taken as --crs says"));
            MapCrs::default()
        }
        (Err(why), None) => return Err(format!("{why}; --crs EPSG:N names the system")),
    };
    let MapCrs { crs, height_metres } = match &options.crs {
        None => named,
        Some(name) => {
            let given = MapCrs::named(name)
                .ok_or_else(|| format!("`crs` must be EPSG:N with 1024 <= N < 32767, or local; got `{name}`"))?;
            notes.extend(project::contradiction(&named.crs, &given.crs));
            MapCrs { height_metres: given.height_metres.or(named.height_metres), ..given }
        }
    };
    match crs == Crs::Unknown && project::like_degrees(lines) {
        true if shape => Err(
            "coordinates look like degrees (no system is named, and all are such as longitudes and latitudes are); say --crs EPSG:4326 if they are \
             longitude and latitude, --crs EPSG:N for another system, or --crs local if these are lengths"
                .into(),
        ),
        true => Ok(MapCrs { crs: Crs::Epsg(project::WGS84), height_metres }),
        false => Ok(MapCrs { crs, height_metres }),
    }
}
