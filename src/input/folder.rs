//! A folder with `stack.json` and one grey image (8 or 16 bit PNG or TIFF) per slice; or slices drawn as polygons in the file itself.

use std::path::{Path, PathBuf};

use glam::DVec3;
use rayon::prelude::*;
use serde::Deserialize;

use crate::error::{Error, Result};
use crate::estimate::memory;
use crate::input::Input;
use crate::input::contents::{Contents, images_of, other_images_of};
use crate::input::grey_image::Grey;
use crate::input::grey_rule::{Range, Rule};
use crate::input::numbers::Numbers;
use crate::input::slice_names::{repeats, series, skips};
use crate::input::volume::grid::sides;
use crate::polygons::{self, PlaneDrawing, Planes, Polygon};
use crate::stack::axis::check_axes;
use crate::stack::{ContourStack, Geometry, HeightGrid, ReadOptions, Slice};
use crate::storage::{json, regular, room};

/// Bytes of an image's values, as decoded and as grey values, and of the depths made of them.
const BYTES_PER_PIXEL: f64 = (2 * size_of::<u16>() + size_of::<f32>()) as f64;

/// Schema of `stack.json`; any other field is an error.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StackFile {
    /// Needed for images; for polygons the pixels they are laid on.
    spacing_xy: Option<Numbers<2>>,
    /// World directions (LPS) of x, y and z, for polygons.
    axes: Option<[Numbers<3>; 3]>,
    #[serde(default = "millimetres")]
    unit: String,
    slices: Vec<SliceEntry>,
    z_out: Option<HeightGrid>,
    #[serde(default)]
    #[expect(dead_code, reason = "only one value exists; serde refuses the others")]
    outside: Outside,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SliceEntry {
    /// An image,
    file: Option<String>,
    /// or closed lines, combined by even-odd.
    polygons: Option<Vec<Vec<Numbers<2>>>>,
    z: f64,
    #[serde(default)]
    extra: bool,
}

/// Value around the contours.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Outside {
    #[default]
    Black,
}

fn millimetres() -> String {
    "mm".into()
}

/// Images that a message names.
const NAMED: usize = 2;

/// Whether this is a folder without `stack.json`.
pub(super) fn is_bare(path: &Path) -> bool {
    path.is_dir() && !path.join("stack.json").exists()
}

/// Whether a folder has images and no `stack.json`.
pub(super) fn is_of_images(path: &Path) -> bool {
    is_bare(path) && images_of(path).is_ok_and(|names| !names.is_empty())
}

/// What a person should know of files beside the images of a folder without `stack.json`.
pub(super) fn beside(folder: &Path) -> Result<Vec<String>> {
    let contents = Contents::of(folder).map_err(|source| Error::Read { path: folder.into(), source })?;
    contents.beside_slices().map_err(|message| Error::Format { path: folder.into(), message })
}

/// An error of an image, where no `stack.json` says which images are slices.
fn taken(error: Error) -> Error {
    match error {
        Error::Slice { index, name, message } => {
            let message = format!("{message} (every image in a folder without stack.json is taken for a slice)");
            Error::Slice { index, name, message }
        }
        other => other,
    }
}

/// The slices of a folder of images without `stack.json`, `spacing` apart.
fn spaced(folder: &Path, spacing: Option<&[f64]>) -> Result<StackFile> {
    let names = images_of(folder)?;
    let fail = |message: String| Err(Error::Format { path: folder.into(), message });
    if names.is_empty() {
        let others = other_images_of(folder)
            .map_or(String::new(), |others| format!("; it has {others}: save them as PNG or TIFF, which are read"));
        return fail(format!("has neither stack.json nor images, masks or DICOM files{others}"));
    }
    let Some(spacing) = spacing else {
        let slice = |(k, name): (usize, &String)| format!("{{\"file\": {name:?}, \"z\": {k}}}");
        let slices: Vec<String> = names.iter().enumerate().take(NAMED).map(slice).collect();
        let more = if names.len() > NAMED { ", ..." } else { "" };
        return fail(format!(
            "has {} images, but no stack.json that says how far apart they are: say --spacing DX,DY,DZ (mm), or write a stack.json such as \
             {{\"spacing_xy\": [1, 1], \"slices\": [{}{more}]}}",
            names.len(),
            slices.join(", ")
        ));
    };
    let [dx, dy, dz] = sides(spacing)?;
    let slice = |(k, name)| SliceEntry { file: Some(name), polygons: None, z: dz * k as f64, extra: false };
    Ok(StackFile {
        spacing_xy: Some(Numbers([dx, dy])),
        axes: None,
        unit: millimetres(),
        slices: names.into_iter().enumerate().map(slice).collect(),
        z_out: None,
        outside: Outside::Black,
    })
}

/// The `stack.json` of a folder (or that file itself): its content, its path, its folder.
fn parse(path: &Path, spacing: Option<&[f64]>) -> Result<(StackFile, PathBuf, PathBuf)> {
    if is_bare(path) {
        return Ok((spaced(path, spacing)?, path.into(), path.into()));
    }
    let file = if path.is_dir() { path.join("stack.json") } else { path.to_path_buf() };
    let text = regular::read_to_string(&file).map_err(|source| Error::Read { path: file.clone(), source })?;
    let parsed = json::parse(&text).map_err(|message| Error::Format { path: file.clone(), message })?;
    let folder = file.parent().map(Path::to_path_buf).unwrap_or_default();
    Ok((parsed, file, folder))
}

/// The `stack.json` of a folder and its slices.
///
/// # Errors
/// The errors of [`crate::input::files`].
pub fn files(path: &Path) -> Result<Vec<PathBuf>> {
    if is_of_images(path) {
        return Ok(images_of(path)?.into_iter().map(|name| path.join(name)).collect());
    }
    let (parsed, file, folder) = parse(path, None)?;
    let images = parsed.slices.iter().filter_map(|s| s.file.as_ref()).map(|f| folder.join(f));
    Ok(std::iter::once(file).chain(images).collect())
}

/// Reads a folder, or the `stack.json` in it.
///
/// # Errors
/// The errors of [`crate::input::read`].
pub fn read(path: &Path, options: &ReadOptions) -> Result<Input> {
    let alone = is_of_images(path);
    let beside = if alone { beside(path)? } else { Vec::new() };
    let told = |e| match e {
        Error::Format { path, message } if !beside.is_empty() => {
            Error::Format { path, message: format!("{message} ({})", beside.join("; ")) }
        }
        e => e,
    };
    let (parsed, file, folder) = parse(path, options.spacing.as_deref()).map_err(told)?;
    if let Some(z_out) = parsed.z_out {
        z_out.validate()?;
    }
    let fail = |message: String| Err(Error::Format { path: file.clone(), message });
    for (k, entry) in parsed.slices.iter().enumerate() {
        match (&entry.file, &entry.polygons) {
            (Some(_), Some(_)) => return fail(format!("slice {k} has both `file` and `polygons`; it must have one")),
            (None, None) => return fail(format!("slice {k} has neither `file` nor `polygons`; it must have one")),
            _ => {}
        }
    }
    let names: Vec<&str> = parsed.slices.iter().filter_map(|s| s.file.as_deref()).collect();
    let skips = if alone { series(&names).or_else(|| repeats(&names)).or_else(|| skips(&names)) } else { None };
    let drawn = parsed.slices.iter().filter(|s| s.polygons.is_some()).count();
    if drawn == 0 {
        let (stack, level) = images(parsed, &file, &folder, options).map_err(|e| if alone { taken(e) } else { e })?;
        Ok(Input { notes: beside.into_iter().chain(skips).chain(level).collect(), ..Input::of(stack) })
    } else if drawn == parsed.slices.len() {
        drawings(parsed, &file, options)
    } else {
        fail(format!("{drawn} of {} slices are `polygons`; all or none must be", parsed.slices.len()))
    }
}

/// The stack of a file whose slices are polygons, and what a person should know of them.
fn drawings(parsed: StackFile, file: &Path, options: &ReadOptions) -> Result<Input> {
    if options.level.is_some() {
        let message = "is not for polygons; it cuts grey slices".into();
        return Err(Error::Setting { name: "level".into(), message });
    }
    if options.invert {
        let message = "is not for polygons; it is for images".into();
        return Err(Error::Setting { name: "invert".into(), message });
    }
    if options.label.is_some() {
        let message = "is not for polygons; it chooses from a label volume, or a value of images".into();
        return Err(Error::Setting { name: "label".into(), message });
    }
    let axes = parsed.axes.map_or(DVec3::AXES, |axes| axes.map(|Numbers(axis)| axis.into()));
    check_axes(&axes).map_err(|m| Error::Format { path: file.into(), message: format!("`axes`: {m}") })?;
    let points = |polygon: Vec<Numbers<2>>| polygon.into_iter().map(|Numbers(point)| point.into()).collect::<Polygon>();
    let drawing = |(k, entry): (usize, SliceEntry)| PlaneDrawing {
        name: format!("polygons {k}"),
        z: entry.z,
        extra: entry.extra,
        regions: entry.polygons.into_iter().map(|polygons| polygons.into_iter().map(points).collect()).collect(),
    };
    let mut drawings: Vec<PlaneDrawing> = parsed.slices.into_iter().enumerate().map(drawing).collect();
    let planes = Planes { unit: parsed.unit, axes, z_out: parsed.z_out };
    let pixel = options.pixel.map(|p| [p; 2]).or(parsed.spacing_xy.map(|Numbers(sides)| sides));
    let mut notes = polygons::clean(&mut drawings, pixel);
    let stack = polygons::stack(&drawings, &planes, pixel).map_err(|error| match error {
        // The sides that are wrong are the file's own.
        Error::Setting { name, message } if name == "pixel" && options.pixel.is_none() && pixel.is_some() => {
            Error::Format { path: file.into(), message: format!("`spacing_xy` {message}") }
        }
        other => other,
    })?;
    notes.extend(polygons::doubts(&drawings, &stack, pixel));
    let chosen = pixel.is_none().then(|| polygons::pixel::chosen_pixel(&drawings).to_string());
    Ok(Input { notes, chosen, ..Input::of(stack) })
}

/// The stack of a file whose slices are images, and what a person should know of its level.
fn images(
    parsed: StackFile,
    file: &Path,
    folder: &Path,
    options: &ReadOptions,
) -> Result<(ContourStack, Option<String>)> {
    let fail = |message: &str| Err(Error::Format { path: file.into(), message: message.into() });
    if options.pixel.is_some() {
        let message = "is not for images; it is the pixel size for polygons".into();
        return Err(Error::Setting { name: "pixel".into(), message });
    }
    let Some(Numbers(spacing)) = parsed.spacing_xy else { return fail("missing field `spacing_xy`, the pixel sides") };
    if parsed.axes.is_some() {
        return fail("`axes` is for polygons; images lie along x and y");
    }
    let entries: Vec<(String, f64, bool)> =
        parsed.slices.into_iter().map(|s| (s.file.unwrap_or_default(), s.z, s.extra)).collect();
    let names: Vec<(PathBuf, &str)> = entries.iter().map(|(name, ..)| (folder.join(name), name.as_str())).collect();
    let ranges = ranges(file, &names)?;
    let rule = Rule::new(&ranges, options)?;
    if let Some(doubt) = rule.doubt(&ranges, options.level).or_else(|| rule.misses(&ranges, options.level)) {
        return fail(&doubt);
    }
    let contents = each(&names, |index, (path, name)| {
        let image = read_image(path, index, name)?;
        if Range::of(&image) != ranges[index] {
            let message = "has changed while it was read".into();
            return Err(Error::Slice { index, name: name.to_string(), message });
        }
        Ok(rule.content(&image))
    })?;
    let slice = |((name, z, extra), content)| Slice { name, z, extra, content };
    let stack = ContourStack {
        dims: ranges.first().map_or([0, 0], |r| r.dims),
        spacing,
        unit: parsed.unit,
        slices: entries.into_iter().zip(contents).map(slice).collect(),
        z_out: parsed.z_out,
        geometry: Geometry::default(),
        known: None,
    };
    Ok((stack, rule.told(&ranges, options.level)))
}

/// Goes through the slices, as many at a time as there are threads; the first error in their order.
fn each<T: Send>(names: &[(PathBuf, &str)], f: impl Fn(usize, &(PathBuf, &str)) -> Result<T> + Sync) -> Result<Vec<T>> {
    let all: Vec<Result<T>> = names.par_iter().enumerate().map(|(index, name)| f(index, name)).collect();
    all.into_iter().collect()
}

/// Properties that the images have in common, and the values that each has. No more of them is kept: what is made of them depends on all.
fn ranges(file: &Path, names: &[(PathBuf, &str)]) -> Result<Vec<Range>> {
    let Some((path, name)) = names.first() else { return Ok(Vec::new()) };
    let first = Range::of(&read_image(path, 0, name)?);
    let ([w, h], count) = (first.dims, names.len());
    let at_once = count.min(rayon::current_num_threads());
    let pixels = (w * h) as f64;
    let wrong = |count: usize, m: String| Error::Format {
        path: file.into(),
        message: format!("{count} slices of {w}x{h} px {m}"),
    };
    room::check_room(BYTES_PER_PIXEL * pixels * at_once as f64).map_err(|m| wrong(at_once, m))?;
    memory::check_slices(pixels, count).map_err(|m| wrong(count, m))?;
    each(names, |index, (path, name)| {
        let this = Range::of(&read_image(path, index, name)?);
        let fail = |message| Err(Error::Slice { index, name: name.to_string(), message });
        if this.dims != first.dims {
            let [width, height] = this.dims;
            return fail(format!("{width}x{height} px, but slice 0 is {w}x{h} (`{}`)", names[0].1));
        }
        if this.bits != first.bits {
            return fail(format!("{} bits per pixel, but slice 0 has {}", this.bits, first.bits));
        }
        Ok(this)
    })
}

fn read_image(path: &Path, index: usize, name: &str) -> Result<Grey> {
    let fail = |message: String| Error::Slice { index, name: name.into(), message };
    Grey::read(path).map_err(|message| fail(format!("{}: {message}", path.display())))
}
