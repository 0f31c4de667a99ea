//! Parser: bytes become ROIs and their contours.

use std::collections::HashMap;

use dicom_dictionary_std::{tags, uids};
use dicom_object::{DefaultDicomObject, InMemDicomObject, OpenFileOptions, Tag};
use glam::DVec3;

use super::{Contour, Roi, escapes, guard};

type Parse<T> = std::result::Result<T, String>;

/// What a file holds.
pub struct Parsed {
    /// All of it.
    pub object: DefaultDicomObject,
    /// Its ROIs.
    pub rois: Vec<Roi>,
    /// Words on contours that are left out because they are no ROI's.
    pub left_out: Vec<String>,
}

/// The file, and its ROIs. Contours of a ROI that the file does not name, or that was drawn before, are left out with a word.
///
/// # Errors
/// A message with field, ROI, contour and value.
pub fn parse(bytes: &[u8]) -> Parse<Parsed> {
    let bytes = guard::sound(bytes)?;
    let object = OpenFileOptions::new().from_reader(&bytes[..]).map_err(|e| with_causes(&e))?;
    let class = text(&object, tags::SOP_CLASS_UID)?.unwrap_or_default();
    if class != uids::RT_STRUCTURE_SET_STORAGE {
        return Err(other(&class));
    }
    let set = text(&object, tags::SPECIFIC_CHARACTER_SET)?.unwrap_or_default();
    let mut rois = Vec::new();
    let named = items(&object, tags::STRUCTURE_SET_ROI_SEQUENCE)?
        .ok_or("Structure Set ROI Sequence (3006,0020) is missing: the file names no ROI")?;
    let mut place = HashMap::new();
    for (k, item) in named.iter().enumerate() {
        let at = format!("item {} of Structure Set ROI Sequence", k + 1);
        let number = number(item, tags::ROI_NUMBER, &at)?;
        let name = escapes::read(&text(item, tags::ROI_NAME)?.unwrap_or_default(), &set);
        if place.insert(number, k).is_some() {
            return Err(format!("{at}: ROI Number {number} is there twice"));
        }
        rois.push(Roi { number, name, colour: None, contours: Vec::new(), fault: None, notes: Vec::new() });
    }
    let drawn = items(&object, tags::ROI_CONTOUR_SEQUENCE)?
        .ok_or("ROI Contour Sequence (3006,0039) is missing: nothing is drawn")?;
    let (mut left_out, mut drawn_by) = (Vec::new(), HashMap::new());
    for (k, item) in drawn.iter().enumerate() {
        let at = format!("item {} of ROI Contour Sequence", k + 1);
        let number = number(item, tags::REFERENCED_ROI_NUMBER, &at)?;
        let Some(roi) = place.get(&number).map(|k| &mut rois[*k]) else {
            left_out.push(format!("{at}: left out, its Referenced ROI Number {number} is none of the file's ROIs"));
            continue;
        };
        let first = *drawn_by.entry(number).or_insert(k);
        if first != k {
            roi.notes.push(format!("{at}: left out, item {} has the contours of {} already", first + 1, roi.label()));
            continue;
        }
        roi.colour = colour(item);
        match contours(item) {
            Ok(contours) => roi.contours = contours,
            Err(message) => roi.fault = Some(format!("{}{message}", roi.label())),
        }
    }
    Ok(Parsed { object, rois, left_out })
}

/// Way out where there is a DICOM segmentation.
pub const SEGMENTATION: &str =
    "a DICOM segmentation, which is not read: 3D Slicer, or segimage2itkimage of dcmqi, saves it as NRRD or NIfTI";

/// Whether a SOP class is that of segmentations.
pub fn is_segmentation(class: &str) -> bool {
    let class = class.trim_end_matches(['\0', ' ']);
    [uids::SEGMENTATION_STORAGE, uids::LABEL_MAP_SEGMENTATION_STORAGE].contains(&class)
}

/// Message on a file of another SOP class.
fn other(class: &str) -> String {
    if is_segmentation(class) {
        return format!("is {SEGMENTATION}");
    }
    format!("SOP Class UID is `{class}`; an RT structure set has {}", uids::RT_STRUCTURE_SET_STORAGE)
}

/// What tells one structure set from another.
pub struct Identity {
    /// Series Instance UID.
    pub series: String,
    /// SOP Instance UID.
    pub instance: String,
    /// Series Number.
    pub number: Option<i64>,
    /// Structure Set Label.
    pub label: String,
    /// SOP Instance UID of the one that it was made of.
    pub predecessor: Option<String>,
}

/// What a file calls itself; its ROIs are not looked at.
///
/// # Errors
/// A message with tag, value and place.
pub fn identity(bytes: &[u8]) -> Parse<Identity> {
    let bytes = guard::sound(bytes)?;
    let options = OpenFileOptions::new().read_until(tags::STRUCTURE_SET_ROI_SEQUENCE);
    let object = options.from_reader(&bytes[..]).map_err(|e| with_causes(&e))?;
    let said = |tag| text(&object, tag).map(Option::unwrap_or_default);
    let before = items(&object, tags::PREDECESSOR_STRUCTURE_SET_SEQUENCE)?.and_then(<[_]>::first);
    let predecessor = before.map(|item| text(item, tags::REFERENCED_SOP_INSTANCE_UID)).transpose()?.flatten();
    Ok(Identity {
        predecessor,
        series: said(tags::SERIES_INSTANCE_UID)?,
        instance: said(tags::SOP_INSTANCE_UID)?,
        number: said(tags::SERIES_NUMBER)?.parse().ok(),
        label: said(tags::STRUCTURE_SET_LABEL)?,
    })
}

/// The contours of a ROI; the file's other ROIs are none the worse for one that cannot be read.
fn contours(roi: &InMemDicomObject) -> Parse<Vec<Contour>> {
    let all = items(roi, tags::CONTOUR_SEQUENCE).map_err(|m| format!(": {m}"))?.unwrap_or_default();
    let numbered = all.iter().enumerate();
    numbered.map(|(c, item)| contour(item).map_err(|m| format!(", contour {}: {m}", c + 1))).collect()
}

fn contour(item: &InMemDicomObject) -> Parse<Contour> {
    let kind = text(item, tags::CONTOUR_GEOMETRIC_TYPE)?.ok_or("Contour Geometric Type (3006,0042) is missing")?;
    let element = item.get(tags::CONTOUR_DATA).ok_or("Contour Data (3006,0050) is missing")?;
    let bytes = element.to_bytes().map_err(|e| format!("Contour Data: {e}"))?;
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim_matches(['\0', ' ']);
    let values = text.split('\\').filter(|_| !text.is_empty()).enumerate().map(|(k, t)| {
        let wrong = || format!("Contour Data: value {} is `{}`; it must be a finite number", k + 1, t.trim());
        t.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(wrong)
    });
    let values = values.collect::<Parse<Vec<f64>>>()?;
    let (points, rest) = values.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(format!("Contour Data has {} values; points have 3 each", values.len()));
    }
    if let Some(said) = item.get(tags::NUMBER_OF_CONTOUR_POINTS) {
        let said: i64 = said.to_int().map_err(|e| format!("Number of Contour Points: {e}"))?;
        if usize::try_from(said) != Ok(points.len()) {
            return Err(format!("Number of Contour Points is {said}, but Contour Data has {}", points.len()));
        }
    }
    Ok(Contour { kind, points: points.iter().copied().map(DVec3::from).collect() })
}

/// Items of a sequence; nothing where the element is missing.
fn items(object: &InMemDicomObject, tag: Tag) -> Parse<Option<&[InMemDicomObject]>> {
    match object.get(tag) {
        None => Ok(None),
        Some(element) if element.value().primitive().is_some_and(|p| p.multiplicity() == 0) => Ok(Some(&[])),
        Some(element) => element.items().map(Some).ok_or_else(|| format!("{tag} is no sequence")),
    }
}

pub(super) fn text(object: &InMemDicomObject, tag: Tag) -> Parse<Option<String>> {
    let Some(element) = object.get(tag) else { return Ok(None) };
    let text = element.to_str().map_err(|e| format!("{tag}: {e}"))?;
    Ok(Some(text.trim_matches(['\0', ' ']).to_string()))
}

/// ROI Display Color; one that is none counts as missing.
fn colour(item: &InMemDicomObject) -> Option<[u8; 3]> {
    let values = item.get(tags::ROI_DISPLAY_COLOR)?.to_multi_int::<u8>().ok()?;
    values.try_into().ok()
}

fn number(object: &InMemDicomObject, tag: Tag, at: &str) -> Parse<i64> {
    let element = object.get(tag).ok_or_else(|| format!("{at}: {tag} is missing"))?;
    element.to_int().map_err(|e| format!("{at}: {tag}: {e}"))
}

/// An error and what caused it, in one line.
fn with_causes(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(error.source(), |e| e.source());
    causes.fold(error.to_string(), |text, cause| format!("{text}: {cause}"))
}
