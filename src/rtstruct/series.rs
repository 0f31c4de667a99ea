//! Series of images in a folder of DICOM files: where their planes lie, and how contours refer to them. Pixels are not looked at.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use dicom_dictionary_std::tags;
use dicom_object::Tag;
use glam::DVec3;

use super::guard;
use crate::error::{Error, Result};
use crate::polygons::plane::TOLERANCE;
use crate::storage::folders::files_below;
use crate::storage::regular;

/// Bytes at a file's begin among which its header is looked for.
const BEGIN: u64 = 1 << 22;
/// Largest difference of direction cosines of a series' images.
const TURNED: f64 = 1e-4;

/// A series of parallel images.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageSeries {
    /// Series Instance UID, and those of its study and frame of reference; empty where the images do not say them.
    pub uid: String,
    /// Study Instance UID.
    pub study: String,
    /// Frame of Reference UID.
    pub frame: String,
    /// Columns and rows.
    pub dims: [usize; 2],
    /// Directions of increasing columns and rows, LPS.
    pub axes: [DVec3; 2],
    /// Distance of columns and of rows, mm.
    pub sides: [f64; 2],
    /// Its images, by their height along the normal.
    pub images: Vec<SeriesImage>,
}

/// An image of a series.
#[derive(Debug, Clone, PartialEq)]
pub struct SeriesImage {
    /// SOP Class UID.
    pub class: String,
    /// SOP Instance UID.
    pub instance: String,
    /// Centre of its first pixel, mm, LPS.
    pub position: DVec3,
}

/// An image's header.
struct Found {
    path: PathBuf,
    series: ImageSeries,
}

impl ImageSeries {
    /// The only series of images of a folder and the folders below; or that of an image that is named.
    ///
    /// # Errors
    /// [`Error::Read`]; [`Error::Format`] where there is none, there are several, or their images are no stack.
    pub fn read(path: &Path) -> Result<Self> {
        let fail = |message: String| Err(Error::Format { path: path.into(), message });
        let (folder, wanted) = if path.is_dir() {
            (path, None)
        } else {
            let Some(image) = image(path)? else { return fail("is no DICOM image with a place in the patient".into()) };
            (path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")), Some(image.series.uid))
        };
        let files = files_below(folder).map_err(|source| Error::Read { path: folder.into(), source })?;
        let mut all: BTreeMap<String, Vec<Found>> = BTreeMap::new();
        for file in files {
            if let Some(found) = image(&file)?.filter(|f| wanted.as_ref().is_none_or(|w| *w == f.series.uid)) {
                all.entry(found.series.uid.clone()).or_default().push(found);
            }
        }
        let listed: String = all.iter().map(|(uid, found)| format!("\n  {uid} ({} images)", found.len())).collect();
        let mut all = all.into_values();
        match (all.next(), all.next()) {
            (Some(images), None) => stacked(images),
            (None, _) => fail("has no DICOM images with a place in the patient".into()),
            _ => fail(format!("has images of several series; name an image of the one that is meant:{listed}")),
        }
    }

    /// The images' normal.
    pub fn normal(&self) -> DVec3 {
        self.axes[0].cross(self.axes[1])
    }

    /// Heights of the images along their normal, increasing.
    pub fn heights(&self) -> Vec<f64> {
        self.images.iter().map(|image| image.position.dot(self.normal())).collect()
    }
}

/// The images of a series, sorted.
fn stacked(found: Vec<Found>) -> Result<ImageSeries> {
    let mut files = found.into_iter();
    let Some(Found { path: first, series: mut all }) = files.next() else {
        return Err(Error::Stack("a series has no images".into()));
    };
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    for Found { path, series } in files {
        let turned = (0..2).any(|a| (series.axes[a] - all.axes[a]).abs().max_element() > TURNED);
        let sides = (0..2).any(|a| (series.sides[a] / all.sides[a] - 1.0).abs() > TURNED);
        if series.dims != all.dims || turned || sides {
            let ([nx, ny], [mx, my]) = (series.dims, all.dims);
            let what = if turned { "directions" } else { "pixels" };
            let message =
                format!("has other {what} than {} ({nx}x{ny} px, {mx}x{my} px); a series has one grid", name(&first));
            return Err(Error::Format { path, message });
        }
        all.images.extend(series.images);
    }
    let normal = all.normal();
    all.images.sort_by(|a, b| a.position.dot(normal).total_cmp(&b.position.dot(normal)));
    let heights = all.heights();
    let mean_gap = (heights[heights.len() - 1] - heights[0]) / (heights.len() - 1).max(1) as f64;
    // Of a specimen all may be as near as images of one place are in a patient.
    let same = heights.windows(2).position(|w| w[1] - w[0] <= TOLERANCE.min(0.5 * mean_gap));
    if let Some(k) = same {
        let message = format!(
            "has two images at height {:.3} of its series ({} and {}); name a folder of one phase",
            heights[k],
            all.images[k].instance,
            all.images[k + 1].instance
        );
        return Err(Error::Format { path: first.parent().unwrap_or(&first).into(), message });
    }
    Ok(all)
}

/// What a file says of its image; nothing where it is none, or has no place in the patient.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] for a value that cannot be.
fn image(path: &Path) -> Result<Option<Found>> {
    let bytes = regular::begin(path, BEGIN).map_err(|source| Error::Read { path: path.into(), source })?;
    let mut values: BTreeMap<Tag, Vec<u8>> = BTreeMap::new();
    // What is no DICOM is none of the series' images; what is cut off says what it says.
    if guard::elements(&bytes, tags::PIXEL_DATA, &mut |tag, value| drop(values.insert(tag, value.to_vec()))).is_err()
        && values.is_empty()
    {
        return Ok(None);
    }
    let fail = |message: String| Error::Format { path: path.into(), message };
    let text = |tag: Tag| {
        let bytes = values.get(&tag).map_or(&[][..], |v| v);
        String::from_utf8_lossy(bytes).trim_matches(['\0', ' ']).to_string()
    };
    let numbers = |tag: Tag, name: &str, count: usize| -> Result<Option<Vec<f64>>> {
        let text = text(tag);
        if text.is_empty() {
            return Ok(None);
        }
        let numbers: Option<Vec<f64>> =
            text.split('\\').map(|t| t.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let wrong = || fail(format!("{name} must be {count} numbers; got `{text:.80}`"));
        numbers.filter(|n| n.len() == count).map(Some).ok_or_else(wrong)
    };
    let size = |tag: Tag| values.get(&tag).and_then(|v| Some(u16::from_le_bytes(v.as_slice().try_into().ok()?)));
    let (Some(columns), Some(rows)) = (size(tags::COLUMNS), size(tags::ROWS)) else { return Ok(None) };
    let position = numbers(tags::IMAGE_POSITION_PATIENT, "Image Position (Patient)", 3)?;
    let directions = numbers(tags::IMAGE_ORIENTATION_PATIENT, "Image Orientation (Patient)", 6)?;
    let spacing = numbers(tags::PIXEL_SPACING, "Pixel Spacing", 2)?;
    let (Some(position), Some(directions), Some(spacing)) = (position, directions, spacing) else { return Ok(None) };
    let axes = [DVec3::from_slice(&directions[..3]), DVec3::from_slice(&directions[3..])];
    let square = axes.iter().all(|a| (a.length() - 1.0).abs() < 1e-3) && axes[0].dot(axes[1]).abs() < 1e-3;
    if !square || columns == 0 || rows == 0 || spacing.iter().any(|h| *h <= 0.0) {
        return Err(fail(
            "Image Orientation must be two perpendicular directions of length 1, Pixel Spacing positive".into(),
        ));
    }
    let second = (axes[1] - axes[0].normalize() * axes[1].dot(axes[0].normalize())).normalize();
    let image = SeriesImage {
        class: text(tags::SOP_CLASS_UID),
        instance: text(tags::SOP_INSTANCE_UID),
        position: DVec3::from_slice(&position),
    };
    let series = ImageSeries {
        uid: text(tags::SERIES_INSTANCE_UID),
        study: text(tags::STUDY_INSTANCE_UID),
        frame: text(tags::FRAME_OF_REFERENCE_UID),
        dims: [columns.into(), rows.into()],
        axes: [axes[0].normalize(), second],
        // Pixel Spacing names the distance of rows first.
        sides: [spacing[1], spacing[0]],
        images: vec![image],
    };
    Ok(Some(Found { path: path.into(), series }))
}
