//! GeoPackage: a layer of lines or polygons in an SQLite database. SQLite reads the tables; the geometries, which the standard packs into blobs (a header
//! and well-known binary), are taken apart here, every count held against what is left of its blob.

use std::path::{Path, PathBuf};

use glam::DVec2;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode, OpenFlags};
use serde_json::Value;

use super::{Feature, MapPart};
use crate::error::{Error, Result};
use crate::surface::map::{Crs, MapCrs};

type Check<T> = std::result::Result<T, String>;

/// Steps of SQLite's machine between looks at how many there were, and most of them: some, and some per byte. Tables may be views that never end.
const LOOK: i32 = 10_000;
const MOST_STEPS: u64 = 1 << 24;
const MOST_PER_BYTE: u64 = 64;
/// Most bytes of a value, which lies in the file: some, and those of the file. Most of all values that are read: some, and some per byte, as views
/// may show what they join many times.
const MOST_IN_VALUE: u64 = 1 << 20;
const MOST_IN_ALL: u64 = 1 << 26;
const MOST_IN_ALL_PER_BYTE: u64 = 64;
/// Bytes that a value takes here beside its own.
const VALUE: u64 = 64;
/// Layers that a message names.
const NAMED: usize = 12;
/// Bytes of the envelope by its code in a geometry's header.
const ENVELOPES: [usize; 5] = [0, 32, 48, 48, 64];

/// A table of features.
struct Layer {
    table: String,
    column: String,
    kind: String,
    srs: i64,
}

/// What may still be read of a file: what tables hold lies in it, but views may show what does not.
struct Allowance {
    file: u64,
    most: u64,
    left: u64,
}

impl Allowance {
    fn of(file: u64) -> Self {
        let most = MOST_IN_ALL.saturating_add(file.saturating_mul(MOST_IN_ALL_PER_BYTE));
        Allowance { file, most, left: most }
    }

    /// Takes a value's share.
    fn take<'v>(&mut self, value: ValueRef<'v>) -> Check<ValueRef<'v>> {
        let own = if let ValueRef::Text(bytes) | ValueRef::Blob(bytes) = value { bytes.len() as u64 } else { 0 };
        let left = self.left.checked_sub(VALUE.saturating_add(own));
        self.left = left.ok_or_else(|| {
            format!("its values are more than {} bytes, which is too much for a file of {} bytes", self.most, self.file)
        })?;
        Ok(value)
    }
}

/// The features of the layer that is asked for, else of the only one, or the only one of lines; and its coordinate system.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] with layer, feature and value.
pub fn read(path: &Path, asked: Option<&str>) -> Result<(Vec<Feature>, MapCrs)> {
    let metadata = std::fs::metadata(path).map_err(|source| Error::Read { path: path.into(), source })?;
    let wrong = |message: String| Error::Format { path: path.into(), message };
    let file = metadata.len().saturating_add(std::fs::metadata(log(path)).map_or(0, |m| m.len()));
    let database = open(path, file).map_err(|e| wrong(words(&e)))?;
    let mut allowance = Allowance::of(file);
    let layers = layers(&database, &mut allowance);
    let layers = layers.map_err(|m| wrong(format!("has no layers that can be read: {m}")))?;
    let layer = choose(&layers, asked).map_err(wrong)?;
    let crs = crs(&database, layer.srs).map_err(wrong)?;
    let features =
        features(&database, layer, &mut allowance).map_err(|m| wrong(format!("layer `{}`: {m}", layer.table)))?;
    Ok((features, crs))
}

/// The log that another program may have left, and which holds what belongs to the database.
fn log(path: &Path) -> PathBuf {
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    log.into()
}

/// The database, to be read only: no file is made beside it.
fn open(path: &Path, bytes: u64) -> rusqlite::Result<Connection> {
    // Where there is a log, SQLite may have to make a file beside it.
    let logged = std::fs::metadata(log(path)).is_ok_and(|m| m.len() > 0);
    let text = path.to_string_lossy().replace('%', "%25").replace('?', "%3f").replace('#', "%23");
    let name = format!("file:{text}?mode=ro{}", if logged { "" } else { "&immutable=1" });
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_URI;
    let mut database = Connection::open_with_flags(name, flags)?;
    let longest = i32::try_from(bytes.saturating_add(MOST_IN_VALUE)).unwrap_or(i32::MAX);
    database.set_limit(Limit::SQLITE_LIMIT_LENGTH, longest)?;
    let most = MOST_STEPS.saturating_add(bytes.saturating_mul(MOST_PER_BYTE));
    let mut steps = 0;
    database.progress_handler(
        LOOK,
        Some(move || {
            steps += LOOK as u64;
            steps > most
        }),
    )?;
    // What a schema says is not trusted, nor that cells have the sizes that pages say.
    database.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON; PRAGMA query_only = ON;")?;
    Ok(database)
}

fn words(e: &rusqlite::Error) -> String {
    match e.sqlite_error_code() {
        Some(ErrorCode::OperationInterrupted) => {
            "its tables take more steps to read than a file of its size should".into()
        }
        Some(ErrorCode::TooBig) => "a value is too big for a file of its size".into(),
        Some(ErrorCode::NotADatabase | ErrorCode::DatabaseCorrupt) => format!("is damaged, or no GeoPackage: {e}"),
        _ => e.to_string(),
    }
}

/// The layers of features, by name.
fn layers(database: &Connection, allowance: &mut Allowance) -> Check<Vec<Layer>> {
    let said = |e: rusqlite::Error| words(&e);
    let mut query = database
        .prepare(
            "SELECT c.table_name, g.column_name, g.geometry_type_name, g.srs_id FROM gpkg_contents c JOIN gpkg_geometry_columns g \
             ON c.table_name = g.table_name WHERE c.data_type = 'features' ORDER BY c.table_name",
        )
        .map_err(said)?;
    let mut rows = query.query([]).map_err(said)?;
    let mut layers = Vec::new();
    while let Some(row) = rows.next().map_err(said)? {
        for k in 0..3 {
            allowance.take(row.get_ref(k).map_err(said)?)?;
        }
        let text = |k: usize| row.get(k).map_err(said);
        layers.push(Layer { table: text(0)?, column: text(1)?, kind: text(2)?, srs: row.get(3).map_err(said)? });
    }
    Ok(layers)
}

fn choose<'l>(layers: &'l [Layer], asked: Option<&str>) -> Check<&'l Layer> {
    let listed = || {
        let named = |layer: &Layer| format!("`{}` ({})", layer.table, layer.kind.to_lowercase());
        let more = if layers.len() > NAMED { ", ..." } else { "" };
        layers.iter().take(NAMED).map(named).collect::<Vec<_>>().join(", ") + more
    };
    if let Some(asked) = asked {
        let exact = layers.iter().find(|layer| layer.table == asked);
        let found = exact.or_else(|| layers.iter().find(|layer| layer.table.eq_ignore_ascii_case(asked)));
        return found
            .ok_or_else(|| format!("`layer` must name a layer of the file; got `{asked}`, there are {}", listed()));
    }
    let lines = |layer: &&Layer| !layer.kind.to_uppercase().contains("POINT");
    let mut found = layers.iter().filter(lines);
    match (found.next(), found.next()) {
        (Some(only), None) => Ok(only),
        (Some(_), Some(_)) => Err(format!("has several layers: --layer NAME chooses one of {}", listed())),
        (None, _) if layers.is_empty() => Err("has no layer of features".into()),
        (None, _) => Err(format!("has no layer of lines or polygons, but {}", listed())),
    }
}

/// The coordinate system of a number in the file's own table.
fn crs(database: &Connection, srs: i64) -> Check<MapCrs> {
    // -1 and 0 stand for lengths and degrees in no known system.
    if srs <= 0 {
        return Ok(Crs::Unknown.into());
    }
    let query = "SELECT organization, organization_coordsys_id, definition FROM gpkg_spatial_ref_sys WHERE srs_id = ?1";
    let row = |row: &rusqlite::Row<'_>| Ok((row.get::<_, String>(0)?, row.get::<_, i64>(1)?, row.get::<_, String>(2)?));
    let (organisation, code, definition) = database
        .query_row(query, [srs], row)
        .map_err(|e| format!("its coordinate system {srs} cannot be read: {}", words(&e)))?;
    let named = if organisation.eq_ignore_ascii_case("EPSG") { MapCrs::named(&format!("EPSG:{code}")) } else { None };
    Ok(named.unwrap_or_else(|| MapCrs::of_wkt(&definition)))
}

/// Names of a table's columns, but for hidden ones. A query's own names rusqlite takes for UTF-8, and panics where they are not.
fn columns(database: &Connection, table: &str) -> Check<Vec<String>> {
    let said = |e: rusqlite::Error| format!("the names of its columns cannot be read: {}", words(&e));
    let mut query = database.prepare("SELECT name FROM pragma_table_xinfo(?1) WHERE hidden <> 1").map_err(said)?;
    let names = query.query_map([table], |row| row.get(0)).map_err(said)?;
    names.collect::<rusqlite::Result<_>>().map_err(said)
}

/// The features of a layer.
fn features(database: &Connection, layer: &Layer, allowance: &mut Allowance) -> Check<Vec<Feature>> {
    let said = |e: rusqlite::Error| words(&e);
    let table = layer.table.replace('"', "\"\"");
    let mut query = database.prepare(&format!("SELECT * FROM \"{table}\"")).map_err(said)?;
    let names = columns(database, &layer.table)?;
    if names.len() != query.column_count() {
        return Err(format!("has {} columns, of which {} have names", query.column_count(), names.len()));
    }
    let geometry = names.iter().position(|name| name.eq_ignore_ascii_case(&layer.column));
    let geometry =
        geometry.ok_or_else(|| format!("has no column `{}`, which should hold its geometries", layer.column))?;
    let mut rows = query.query([]).map_err(said)?;
    let mut features = Vec::new();
    while let Some(row) = rows.next().map_err(said)? {
        let name = format!("feature {}", features.len() + 1);
        let mut value = |k: usize| {
            let value = row.get_ref(k).map_err(|e| e.to_string()).and_then(|value| allowance.take(value));
            value.map_err(|m| format!("{name}: {m}"))
        };
        let lines = match value(geometry)? {
            ValueRef::Blob(bytes) => parts(bytes).map_err(|m| format!("{name}: {m}"))?,
            ValueRef::Null => Vec::new(),
            other => return Err(format!("{name}: its geometry is {}, not a blob", other.data_type())),
        };
        let mut fields = Vec::new();
        for (k, field) in names.iter().enumerate().filter(|(k, _)| *k != geometry) {
            fields.push((field.clone(), json(value(k)?)));
        }
        features.push(Feature { name, fields, lines });
    }
    Ok(features)
}

fn json(value: ValueRef<'_>) -> Value {
    match value {
        ValueRef::Integer(v) => Value::from(v),
        ValueRef::Real(v) if v.is_finite() => Value::from(v),
        ValueRef::Real(v) => Value::from(v.to_string()),
        ValueRef::Text(text) => Value::from(String::from_utf8_lossy(text).into_owned()),
        ValueRef::Blob(_) | ValueRef::Null => Value::Null,
    }
}

/// The lines of a geometry: header, then well-known binary.
fn parts(blob: &[u8]) -> Check<Vec<MapPart>> {
    let &[b'G', b'P', _, flags, ..] = blob else { return Err("its geometry does not begin with GP".into()) };
    if flags & 0x20 != 0 {
        return Err("its geometry is of a kind of the writer's own".into());
    }
    let envelope = ENVELOPES.get(usize::from(flags >> 1 & 7)).ok_or("its geometry has an envelope of no known kind")?;
    if flags & 0x10 != 0 {
        return Ok(Vec::new());
    }
    let mut bytes =
        Bytes { left: blob.get(8 + envelope..).ok_or("its geometry is cut off in its header")?, big: false };
    let mut lines = Vec::new();
    geometry(&mut bytes, true, &mut lines)?;
    Ok(lines)
}

/// Well-known binary that is left to read.
struct Bytes<'b> {
    left: &'b [u8],
    big: bool,
}

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> Check<[u8; N]> {
        let (bytes, left) = self.left.split_first_chunk::<N>().ok_or("its geometry is cut off")?;
        self.left = left;
        let mut bytes = *bytes;
        if self.big {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// A number of things of at least so many bytes each.
    fn count(&mut self, what: &str, least: usize) -> Check<usize> {
        let count = u32::from_le_bytes(self.take()?) as usize;
        let most = self.left.len() / least;
        if count > most {
            return Err(format!("its geometry is said to have {count} {what}, but there is room for {most}"));
        }
        Ok(count)
    }

    /// Points of `axes` numbers, of which the third may be z, with their number before them.
    fn points(&mut self, axes: usize, has_z: bool, ring: bool) -> Check<MapPart> {
        let count = self.count("points", 8 * axes)?;
        self.some_points(count, axes, has_z, ring)
    }

    /// As many points.
    fn some_points(&mut self, count: usize, axes: usize, has_z: bool, ring: bool) -> Check<MapPart> {
        let (mut points, mut z) = (Vec::with_capacity(count), Vec::new());
        for _ in 0..count {
            let mut at = [0.0; 4];
            for v in at.iter_mut().take(axes) {
                *v = f64::from_le_bytes(self.take()?);
            }
            points.push(DVec2::new(at[0], at[1]));
            z.extend(has_z.then_some(at[2]));
        }
        Ok(MapPart { points, z, ring })
    }
}

/// A point, a line, a polygon, or, where they may be `many`, several.
fn geometry(bytes: &mut Bytes<'_>, many: bool, lines: &mut Vec<MapPart>) -> Check<()> {
    bytes.big = match bytes.take()? {
        [0] => true,
        [1] => false,
        [other] => return Err(format!("its geometry has the byte order {other}; it must be 0 or 1")),
    };
    let code = u32::from_le_bytes(bytes.take()?);
    // z and m by thousands (ISO), or by the uppermost bits, as PostGIS has them, with a system of its own.
    let (has_z, has_m) = match code & 0x1fff_ffff {
        c if c >= 1000 => (c / 1000 == 1 || c / 1000 == 3, c / 1000 >= 2),
        _ => (code & 0x8000_0000 != 0, code & 0x4000_0000 != 0),
    };
    if code & 0x2000_0000 != 0 {
        bytes.take::<4>()?;
    }
    let axes = 2 + usize::from(has_z) + usize::from(has_m);
    match (code & 0x1fff_ffff) % 1000 {
        1 => lines.push(bytes.some_points(1, axes, has_z, false)?),
        2 => lines.push(bytes.points(axes, has_z, false)?),
        3 => {
            for _ in 0..bytes.count("rings", 4)? {
                lines.push(bytes.points(axes, has_z, true)?);
            }
        }
        4..=6 if many => {
            // Each begins with its byte order, which those behind it do not share.
            for _ in 0..bytes.count("parts", 9)? {
                geometry(bytes, false, lines)?;
            }
        }
        8..=12 => return Err("is a curve; save it as straight lines (ogr2ogr -nlt CONVERT_TO_LINEAR)".into()),
        other => return Err(format!("is a geometry of type {other}; contours are lines or polygons")),
    }
    Ok(())
}
