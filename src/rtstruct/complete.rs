//! The structure set out: as it was read, with contours on the planes between those that were drawn.
//!
//! Drawn contours stay as they are, byte by byte in Contour Data. The file is a new instance in a new series that names its predecessor, is
//! unapproved, and says in each completed ROI's description which planes are interpolated. UIDs are hashes of the input and of what was
//! added: the same work gives the same file. It says the kinds of its values (Explicit VR Little Endian) where the input does, or nobody could know those of
//! private ones; but where a new contour is too long for that.

use std::collections::HashSet;
use std::io::{self, Write};

use dicom_core::value::{DataSetSequence, PrimitiveValue};
use dicom_core::{DataElement, Length, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use dicom_object::mem::InMemElement;
use glam::DVec3;

use super::StructureSet;
use super::added::{Added, decimal};
use super::parse::text;
use super::series::{ImageSeries, SeriesImage};
use crate::polygons::plane::TOLERANCE;

/// Most characters of a ROI Description (value representation ST).
const LONGEST_DESCRIPTION: usize = 1024;
const PROGRAM: &str = concat!("interslice ", env!("CARGO_PKG_VERSION"));
/// Most characters of an Implementation Version Name (value representation SH).
const LONGEST_VERSION: usize = 16;
/// Most bytes of Contour Data (value representation DS) that a file can hold which says the kinds of its values.
const LONGEST_EXPLICIT: usize = 0xfffe;

impl StructureSet {
    /// Frames of reference of the ROIs with these numbers.
    pub(super) fn frames(&self, rois: &[i64]) -> Vec<String> {
        let mut frames: Vec<String> = rois.iter().filter_map(|roi| frame_of(&self.object, *roi)).collect();
        frames.sort();
        frames.dedup();
        frames
    }

    /// Writes the completed file.
    ///
    /// # Errors
    /// The errors of `out`; [`io::ErrorKind::InvalidData`] for what the DICOM library cannot write.
    pub fn write_completed(&self, out: &mut dyn Write, added: &[Added]) -> io::Result<()> {
        let mut object = self.object.clone();
        let mut hasher = blake3::Hasher::new();
        hasher.update(PROGRAM.as_bytes()).update(self.digest.as_bytes());
        let mut longest = 0;
        for data in added.iter().flat_map(|a| &a.planes).flat_map(|(_, lines)| lines) {
            hasher.update(data.as_bytes());
            longest = longest.max(data.len());
        }
        let series = added.iter().find_map(|a| a.images.as_deref());
        if let Some(series) = series {
            for image in &series.images {
                hasher.update(image.instance.as_bytes());
            }
            refer_to(&mut object, series);
        }
        let [instance, series] =
            ["instance", "series"].map(|what| uid(hasher.clone().update(what.as_bytes()).finalize()));
        let old = object.get(tags::SOP_INSTANCE_UID).and_then(|e| e.to_str().ok().map(|s| s.into_owned()));
        for (tag, text) in [(tags::SOP_INSTANCE_UID, &instance), (tags::SERIES_INSTANCE_UID, &series)] {
            object.put(element(tag, VR::UI, text));
        }
        if let Some(old) = old {
            let predecessor = InMemDicomObject::from_element_iter([
                element(tags::REFERENCED_SOP_CLASS_UID, VR::UI, uids::RT_STRUCTURE_SET_STORAGE),
                element(tags::REFERENCED_SOP_INSTANCE_UID, VR::UI, &old),
            ]);
            object.put(sequence(tags::PREDECESSOR_STRUCTURE_SET_SEQUENCE, vec![predecessor]));
        }
        // Whoever approved the old one has not seen this one.
        object.put(element(tags::APPROVAL_STATUS, VR::CS, "UNAPPROVED"));
        for tag in [
            tags::REVIEW_DATE,
            tags::REVIEW_TIME,
            tags::REVIEWER_NAME,
            tags::INSTANCE_CREATION_DATE,
            tags::INSTANCE_CREATION_TIME,
        ] {
            object.remove_element(tag);
        }
        // Type 2: may be empty, and the time of writing would make two runs differ.
        object.put(DataElement::empty(tags::STRUCTURE_SET_DATE, VR::DA));
        object.put(DataElement::empty(tags::STRUCTURE_SET_TIME, VR::TM));
        for a in added {
            let by_plane = match &a.images {
                Some(series) => on_planes(series, a.normal),
                None => images(&object, a),
            };
            change_item(&mut object, tags::STRUCTURE_SET_ROI_SEQUENCE, tags::ROI_NUMBER, a.roi, |item| {
                describe(item, a)
            });
            change_item(&mut object, tags::ROI_CONTOUR_SEQUENCE, tags::REFERENCED_ROI_NUMBER, a.roi, |item| {
                add(item, a, &by_plane)
            });
        }
        object.update_meta(|meta| {
            if longest > LONGEST_EXPLICIT {
                meta.transfer_syntax = uids::IMPLICIT_VR_LITTLE_ENDIAN.into();
            }
            meta.implementation_class_uid = uid(blake3::hash(env!("CARGO_PKG_NAME").as_bytes()));
            meta.implementation_version_name = Some(PROGRAM.chars().take(LONGEST_VERSION).collect());
            meta.media_storage_sop_class_uid = uids::RT_STRUCTURE_SET_STORAGE.into();
            meta.media_storage_sop_instance_uid = instance;
        });
        object.write_all(out).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e.to_string()))
    }
}

/// An identifier in an item, where it is there.
fn uid_in(item: &InMemDicomObject, tag: Tag) -> Option<String> {
    text(item, tag).ok()?.filter(|uid| !uid.is_empty())
}

/// Frame of reference of the ROI with a number.
fn frame_of(object: &InMemDicomObject, roi: i64) -> Option<String> {
    let rois = object.get(tags::STRUCTURE_SET_ROI_SEQUENCE)?.items()?;
    let own = rois.iter().find(|item| item.get(tags::ROI_NUMBER).and_then(|e| e.to_int().ok()) == Some(roi))?;
    uid_in(own, tags::REFERENCED_FRAME_OF_REFERENCE_UID)
}

/// Applies `change` to the first item of a sequence that has a number: contours of a second one are not read.
fn change_item(
    object: &mut InMemDicomObject,
    in_sequence: Tag,
    by: Tag,
    number: i64,
    change: impl Fn(&mut InMemDicomObject),
) {
    let Some(mut element) = object.take(in_sequence) else { return };
    let mut items = element.items_mut().into_iter().flatten();
    items.find(|i| i.get(by).and_then(|e| e.to_int::<i64>().ok()) == Some(number)).into_iter().for_each(change);
    object.put(element);
}

/// Says what was added, after what was said already.
fn describe(item: &mut InMemDicomObject, added: &Added) {
    let heights: Vec<f64> = added.planes.iter().map(|(z, _)| *z).collect();
    let said = item.get(tags::ROI_DESCRIPTION).and_then(|e| e.to_str().ok().map(|s| s.trim().to_string()));
    let said = said.filter(|s| !s.is_empty()).map(|s| s + "; ").unwrap_or_default();
    let text = match heights.len() {
        0 => format!("{said}{PROGRAM}: no plane added"),
        n => format!("{said}{PROGRAM}: contours on {n} planes are interpolated, at {}", runs(&heights)),
    };
    let short: String = text.chars().take(LONGEST_DESCRIPTION).collect();
    item.put(element(tags::ROI_DESCRIPTION, VR::ST, &short));
    if heights.is_empty() {
        return;
    }
    // That of what was drawn.
    item.remove_element(tags::ROI_VOLUME);
    let algorithm = item.get(tags::ROI_GENERATION_ALGORITHM).and_then(|e| e.to_str().ok());
    if algorithm.is_none_or(|s| s.trim() != "AUTOMATIC") {
        item.put(element(tags::ROI_GENERATION_ALGORITHM, VR::CS, "SEMIAUTOMATIC"));
    }
}

/// Heights in words, equal steps together: `-105.94 to -3.94 by 3, 1.5`.
fn runs(heights: &[f64]) -> String {
    let mut parts = Vec::new();
    let mut rest = heights;
    while let Some((first, after)) = rest.split_first() {
        let step = after.first().map_or(0.0, |next| next - first);
        let same = rest.windows(2).take_while(|w| (w[1] - w[0] - step).abs() <= 1e-3).count();
        if same < 2 {
            parts.push(decimal(*first));
            rest = after;
        } else {
            parts.push(format!("{} to {} by {}", decimal(*first), decimal(rest[same]), decimal(step)));
            rest = &rest[same + 1..];
        }
    }
    parts.join(", ")
}

/// Adds the contours to a ROI's own.
fn add(item: &mut InMemDicomObject, added: &Added, images: &[(f64, InMemElement)]) {
    let mut all = taken(item, tags::CONTOUR_SEQUENCE);
    for (z, data) in added.planes.iter().flat_map(|(z, lines)| lines.iter().map(move |data| (z, data))) {
        let count = data.split('\\').count() / 3;
        let mut contour = InMemDicomObject::from_element_iter([
            element(tags::CONTOUR_GEOMETRIC_TYPE, VR::CS, added.kind),
            element(tags::NUMBER_OF_CONTOUR_POINTS, VR::IS, &count.to_string()),
            element(tags::CONTOUR_DATA, VR::DS, data),
        ]);
        let off = |image: &&(f64, InMemElement)| (image.0 - z).abs();
        let nearest = images.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        if let Some((_, image)) = nearest.filter(|image| off(image) <= TOLERANCE) {
            contour.put(image.clone());
        }
        all.push(contour);
    }
    item.put(sequence(tags::CONTOUR_SEQUENCE, all));
}

/// The images that contours of the file refer to (Contour Image Sequence), by their heights along `normal`: where another ROI is drawn on an
/// interpolated plane, its image is that plane's, if both ROIs are in one frame of reference.
fn images(object: &InMemDicomObject, added: &Added) -> Vec<(f64, InMemElement)> {
    let (normal, frame) = (added.normal, frame_of(object, added.roi));
    let number = |roi: &InMemDicomObject| roi.get(tags::REFERENCED_ROI_NUMBER).and_then(|e| e.to_int::<i64>().ok());

    let items = |o: &InMemDicomObject, tag| o.get(tag).and_then(|e| e.items()).unwrap_or_default().to_vec();
    let rois = items(object, tags::ROI_CONTOUR_SEQUENCE);
    let alike = rois.iter().filter(|roi| frame.is_none() || number(roi).and_then(|n| frame_of(object, n)) == frame);
    let contours = alike.flat_map(|roi| items(roi, tags::CONTOUR_SEQUENCE));
    let placed = contours.filter_map(|contour| {
        let image = contour.get(tags::CONTOUR_IMAGE_SEQUENCE)?.clone();
        let data = contour.get(tags::CONTOUR_DATA)?.to_multi_float64().ok()?;
        let heights = data.as_chunks::<3>().0.iter().map(|p| DVec3::from(*p).dot(normal));
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| (a.min(h), b.max(h)));
        (high - low <= TOLERANCE).then_some((low, image))
    });
    let mut placed: Vec<_> = placed.collect();
    placed.sort_by(|a, b| a.0.total_cmp(&b.0));
    placed.dedup_by(|a, b| (a.0 - b.0).abs() <= 1e-6);
    placed
}

/// Names frame, study and series of the images, and each of them, beside what is named: contours that were drawn refer to that.
fn refer_to(object: &mut InMemDicomObject, series: &ImageSeries) {
    let (frames, studies) = (tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE, tags::RT_REFERENCED_STUDY_SEQUENCE);
    with_item(object, frames, (tags::FRAME_OF_REFERENCE_UID, &series.frame), |frame| {
        with_item(frame, studies, (tags::REFERENCED_SOP_INSTANCE_UID, &series.study), |study| {
            if study.get(tags::REFERENCED_SOP_CLASS_UID).is_none() {
                // Retired, and what is expected there: Detached Study Management.
                study.put(element(tags::REFERENCED_SOP_CLASS_UID, VR::UI, "1.2.840.10008.3.1.2.3.1"));
            }
            let all = tags::RT_REFERENCED_SERIES_SEQUENCE;
            with_item(study, all, (tags::SERIES_INSTANCE_UID, &series.uid), |named| {
                let mut images = taken(named, tags::CONTOUR_IMAGE_SEQUENCE);
                let there: HashSet<String> =
                    images.iter().filter_map(|image| uid_in(image, tags::REFERENCED_SOP_INSTANCE_UID)).collect();
                images.extend(series.images.iter().filter(|i| !there.contains(&i.instance)).map(reference));
                named.put(sequence(tags::CONTOUR_IMAGE_SEQUENCE, images));
            });
        });
    });
}

/// Applies `change` to the item of a sequence that an identifier names; to a new one, behind the others, where there is none.
fn with_item(
    object: &mut InMemDicomObject,
    in_sequence: Tag,
    (by, uid): (Tag, &str),
    change: impl FnOnce(&mut InMemDicomObject),
) {
    let mut items = taken(object, in_sequence);
    let known = items.iter().position(|item| uid_in(item, by).is_some_and(|known| known == uid));
    let mut new = InMemDicomObject::from_element_iter([element(by, VR::UI, uid)]);
    let item = known.map_or(&mut new, |k| &mut items[k]);
    change(item);
    if known.is_none() {
        items.push(new);
    }
    object.put(sequence(in_sequence, items));
}

/// The items of a sequence, taken out of it.
fn taken(object: &mut InMemDicomObject, tag: Tag) -> Vec<InMemDicomObject> {
    let items = object.take(tag).and_then(|element| element.into_value().into_items());
    items.into_iter().flatten().collect()
}

fn reference(image: &SeriesImage) -> InMemDicomObject {
    InMemDicomObject::from_element_iter([
        element(tags::REFERENCED_SOP_CLASS_UID, VR::UI, &image.class),
        element(tags::REFERENCED_SOP_INSTANCE_UID, VR::UI, &image.instance),
    ])
}

/// The images of a series, by their heights along `normal`.
fn on_planes(series: &ImageSeries, normal: DVec3) -> Vec<(f64, InMemElement)> {
    let image = |image: &SeriesImage| {
        (image.position.dot(normal), sequence(tags::CONTOUR_IMAGE_SEQUENCE, vec![reference(image)]))
    };
    series.images.iter().map(image).collect()
}

fn element(tag: Tag, vr: VR, text: &str) -> InMemElement {
    DataElement::new(tag, vr, PrimitiveValue::from(text))
}

fn sequence(tag: Tag, items: Vec<InMemDicomObject>) -> InMemElement {
    DataElement::new(tag, VR::SQ, DataSetSequence::new(items, Length::UNDEFINED))
}

/// A UID from a hash: 2.25 and a UUID of version 8.
fn uid(hash: blake3::Hash) -> String {
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&hash.as_bytes()[..16]);
    bytes[6] = bytes[6] & 0x0f | 0x80;
    bytes[8] = bytes[8] & 0x3f | 0x80;
    format!("2.25.{}", u128::from_be_bytes(bytes))
}

/// Whether a UID is one of those that [`uid`] makes.
pub(super) fn is_own(uid: &str) -> bool {
    let number: Option<u128> = uid.strip_prefix("2.25.").and_then(|number| number.parse().ok());
    number.map(u128::to_be_bytes).is_some_and(|bytes| bytes[6] >> 4 == 8 && bytes[8] >> 6 == 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uid_is_a_uuid_of_version_8() {
        for seed in 0..64u8 {
            let uid = uid(blake3::hash(&[seed]));
            let number: u128 = uid.strip_prefix("2.25.").and_then(|n| n.parse().ok()).expect("2.25 and a number");
            let bytes = number.to_be_bytes();
            assert_eq!((bytes[6] >> 4, bytes[8] >> 6), (8, 2), "version and variant of {uid}");
            assert!(uid.len() <= 64 && is_own(&uid), "{uid}");
            assert!(!is_own(&format!("2.25.{}", number ^ 1 << 78)) && !is_own(&uid[..uid.len() - 5]), "{uid}");
        }
    }
}
