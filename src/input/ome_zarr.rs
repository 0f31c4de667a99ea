//! OME-Zarr label images and images (0.4 and 0.5, and those before without axes), of which the first level is read; and arrays of Zarr by themselves.
//!
//! An image whose group holds a label image stands for that: labels are what is reconstructed. Which array it is, and where its voxels lie, is read here;
//! the array's own metadata and its chunks are read by zarrs (`volume/zarr_slabs.rs`).

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde_json::Value;

use super::volume::Volume;
use super::volume::data::Data;
use super::volume::grid::{Failure, TAKE_ONE, VolumeGrid};
use super::volume::zarr_slabs::Shape;
use crate::error::{Error, Result};
use crate::stack::appearance::Appearance;
use crate::storage::regular;
use crate::surface::zarr::unit_of;

/// Most bytes of a file of metadata.
const MOST: u64 = 1 << 26;
/// Axes of images that do not name them, as all before 0.4 have them.
const AXES: [&str; 5] = ["t", "c", "z", "y", "x"];
/// Label images that a message names.
const NAMED: usize = 12;

/// An array, and what the image says that it belongs to.
struct Found {
    array: PathBuf,
    /// The image: one of the group's multiscales.
    image: Option<Value>,
    /// The dataset of it.
    dataset: Value,
    /// Attributes of the group.
    attributes: Value,
}

/// Reads what a folder says of its array.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] naming group, field and value.
pub fn read(path: &Path) -> Result<Volume> {
    std::fs::metadata(path).map_err(|source| Error::Read { path: path.into(), source })?;
    let volume = found(path).and_then(|found| volume(path, &found));
    let volume = volume.map_err(|message| Error::Format { path: path.into(), message })?;
    volume.check()?;
    Ok(volume)
}

/// The attributes of a group or array; nothing where a folder is neither.
fn attributes(folder: &Path) -> Failure<Option<Value>> {
    if let Some(mut whole) = json(&folder.join("zarr.json"))? {
        return Ok(Some(whole.get_mut("attributes").map(Value::take).unwrap_or_default()));
    }
    let known = [".zgroup", ".zarray", ".zattrs"].iter().any(|name| folder.join(name).is_file());
    Ok(json(&folder.join(".zattrs"))?.or_else(|| known.then_some(Value::Null)))
}

fn json(file: &Path) -> Failure<Option<Value>> {
    let name = || file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    match regular::begin(file, MOST) {
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
        Err(e) => Err(format!("{}: {e}", name())),
        Ok(bytes) => serde_json::from_slice(&bytes).map(Some).map_err(|e| format!("{}: {e}", name())),
    }
}

/// What stands below `ome` since 0.5, and beside the others before.
fn ome(attributes: &Value) -> &Value {
    attributes.get("ome").unwrap_or(attributes)
}

fn is_array(folder: &Path) -> bool {
    folder.join(".zarray").is_file()
        || json(&folder.join("zarr.json")).ok().flatten().is_some_and(|whole| whole["node_type"] == "array")
}

/// The array that a folder stands for.
fn found(path: &Path) -> Failure<Found> {
    if is_array(path) {
        // One level of an image, named by itself.
        let parent = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let attributes = attributes(&parent).ok().flatten().unwrap_or_default();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let image = image(&attributes);
        let datasets = image.as_ref().and_then(|image| image["datasets"].as_array().cloned()).unwrap_or_default();
        let dataset = datasets.into_iter().find(|dataset| dataset["path"] == name.as_str());
        let image = image.filter(|_| dataset.is_some());
        return Ok(Found { array: path.into(), image, dataset: dataset.unwrap_or_default(), attributes });
    }
    let own = attributes(path)?.ok_or("is no Zarr: it has neither zarr.json nor .zgroup nor .zarray")?;
    // The group of an image has one of its label images; that group may be named, too.
    for folder in [path.join("labels"), path.to_path_buf()] {
        let listed = attributes(&folder)?.unwrap_or_default();
        let names: Vec<&str> =
            ome(&listed)["labels"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        match names[..] {
            [] => {}
            [name] => return level(&below(&folder, name)?),
            _ => {
                let named: Vec<String> =
                    names.iter().take(NAMED).map(|name| folder.join(name).display().to_string()).collect();
                let more = if names.len() > NAMED { ", ..." } else { "" };
                return Err(format!("has {} label images; name one: {}{more}", names.len(), named.join(", ")));
            }
        }
    }
    if own.get("bioformats2raw.layout").is_some() || ome(&own).get("bioformats2raw.layout").is_some() {
        return found(&path.join("0"));
    }
    level(path)
}

/// A path within a group, as its metadata say it.
fn below(group: &Path, name: &str) -> Failure<PathBuf> {
    let inside = !name.is_empty() && Path::new(name).components().all(|c| matches!(c, std::path::Component::Normal(_)));
    if inside { Ok(group.join(name)) } else { Err(format!("names the path `{name}`, which does not lie in its group")) }
}

fn image(attributes: &Value) -> Option<Value> {
    ome(attributes).get("multiscales")?.as_array()?.first().cloned()
}

/// The first level of a group's image.
fn level(group: &Path) -> Failure<Found> {
    let attributes = attributes(group)?.ok_or_else(|| format!("has no group {}", group.display()))?;
    let image = image(&attributes).ok_or_else(|| {
        format!("{} has no image (`multiscales`); name an array in it, or the group of an image", group.display())
    })?;
    let dataset = image["datasets"].as_array().and_then(|all| all.first()).cloned().unwrap_or_default();
    let name = dataset["path"].as_str().ok_or("multiscales: the first of `datasets` has no `path`")?;
    let array = below(group, name)?;
    Ok(Found { array, image: Some(image), dataset, attributes })
}

fn volume(path: &Path, found: &Found) -> Failure<Volume> {
    let Shape { sizes, element } = Shape::of(&found.array)?;
    let axes = axes(found, sizes.len())?;
    for ((name, _), size) in axes.iter().zip(&sizes) {
        if !"zyx".contains(name.as_str()) && *size > 1 {
            return Err(format!("axis {name} has {size} places; a label volume has z, y and x alone: {TAKE_ONE}"));
        }
    }
    let of = |axis: &str| axes.iter().position(|(name, _)| name == axis);
    let places = ["x", "y", "z"].map(of);
    if places[0].is_none() || places[1].is_none() {
        let names: Vec<&str> = axes.iter().map(|(name, _)| name.as_str()).collect();
        return Err(format!("has the axes {}; a label volume has z, y and x", names.join(", ")));
    }
    let dims = places.map(|place| place.map_or(1, |k| sizes[k]));
    let mut grid = VolumeGrid::unspaced(dims);
    place(found, &axes, places, &mut grid)?;
    // The axis that runs fastest stands last; one that is missing has a single slice.
    let mut stored = [0, 1, 2];
    stored.sort_by_key(|a| places[*a].map_or(usize::MAX, |k| sizes.len() - k));
    let data = Data::Zarr { array: found.array.clone(), sizes, voxel: element.size() };
    let format = if found.image.is_some() { "OME-Zarr" } else { "Zarr" };
    // Chunks come in the machine's own byte order.
    let big_endian = cfg!(target_endian = "big");
    let segments = segments(&found.attributes);
    Ok(Volume { stored, segments, ..Volume::new(path, format, grid, (element, big_endian), data) })
}

/// Names and units of the array's axes.
fn axes(found: &Found, count: usize) -> Failure<Vec<(String, Option<String>)>> {
    let named = found.image.as_ref().and_then(|image| image["axes"].as_array());
    let Some(named) = named else {
        let last = AXES.get(AXES.len().wrapping_sub(count)..);
        let last = last.ok_or_else(|| format!("has {count} axes; a label volume has z, y and x: {TAKE_ONE}"))?;
        return Ok(last.iter().map(|name| ((*name).to_string(), None)).collect());
    };
    if named.len() != count {
        return Err(format!("multiscales: `axes` has {} of them, but the array {count}", named.len()));
    }
    let axis = |axis: &Value| {
        let name = axis.as_str().or_else(|| axis["name"].as_str()).ok_or("multiscales: an axis has no name")?;
        Ok((name.to_lowercase(), axis["unit"].as_str().map(String::from)))
    };
    named.iter().map(axis).collect()
}

/// Where the voxels lie: as this program writes it into its own files, else by scale and translation along x, y and z.
fn place(
    found: &Found,
    axes: &[(String, Option<String>)],
    places: [Option<usize>; 3],
    grid: &mut VolumeGrid,
) -> Failure<()> {
    if found.image.is_none() {
        return Ok(());
    }
    let own = &found.attributes["interslice"];
    let vector = |value: &Value| serde_json::from_value::<[f64; 3]>(value.clone()).ok().map(DVec3::from);
    let steps = ["x", "y", "z"].map(|axis| vector(&own["space directions"][axis]));
    if let ([Some(x), Some(y), Some(z)], Some(origin), Some(unit)) =
        (steps, vector(&own["space origin"]), own["space units"].as_str())
    {
        (grid.steps, grid.origin, grid.unit, grid.spaced) = ([x, y, z], origin, unit.into(), unit != "px");
        return Ok(());
    }
    // The level's own transformations, then those of all levels.
    let lists = [Some(&found.dataset), found.image.as_ref()].into_iter().flatten();
    let transformations = lists.filter_map(|of| of["coordinateTransformations"].as_array()).flatten();
    let (mut sides, mut origin) = ([1.0; 3], [0.0; 3]);
    for transformation in transformations {
        let kind = transformation["type"].as_str().unwrap_or_default();
        let numbers = match kind {
            "scale" | "translation" => &transformation[kind],
            "identity" => continue,
            other => return Err(format!("coordinateTransformations: `{other}` is neither scale nor translation")),
        };
        let numbers: Option<Vec<f64>> = numbers.as_array().map(|all| all.iter().filter_map(Value::as_f64).collect());
        let numbers = numbers.filter(|numbers| numbers.len() == axes.len());
        let numbers =
            numbers.ok_or_else(|| format!("coordinateTransformations: {kind} must be {} numbers", axes.len()))?;
        for (a, place) in places.into_iter().enumerate() {
            let Some(k) = place else { continue };
            if kind == "scale" {
                (sides[a], origin[a]) = (sides[a] * numbers[k], origin[a] * numbers[k]);
            } else {
                origin[a] += numbers[k];
            }
        }
        grid.spaced = true;
    }
    grid.steps = std::array::from_fn(|a| sides[a] * DVec3::AXES[a]);
    grid.origin = origin.into();
    let units: Vec<&str> = places.into_iter().flatten().filter_map(|k| axes[k].1.as_deref()).collect();
    match units[..] {
        [] => {}
        [first, ..] if units.iter().all(|unit| *unit == first) => grid.unit = unit_of(first).unwrap_or(first).into(),
        _ => return Err(format!("its axes have different units: {}", units.join(", "))),
    }
    Ok(())
}

/// Names and colours of a label image.
fn segments(attributes: &Value) -> std::collections::BTreeMap<i64, Appearance> {
    let label = &ome(attributes)["image-label"];
    let of = |list: &str| label[list].as_array().cloned().unwrap_or_default();
    let mut segments = std::collections::BTreeMap::new();
    for entry in of("colors").iter().chain(&of("properties")) {
        let Some(number) = entry["label-value"].as_i64().filter(|number| *number != 0) else { continue };
        let appearance: &mut Appearance = segments.entry(number).or_insert_with(|| Appearance::label(number));
        if let Ok([r, g, b, _]) = serde_json::from_value::<[u8; 4]>(entry["rgba"].clone()) {
            appearance.colour = Some([r, g, b]);
        }
        let name = ["name", "label", "class"].iter().find_map(|key| entry[*key].as_str());
        appearance.name = name.map(String::from).or(appearance.name.take());
    }
    segments
}
