//! RT structure sets that tests write themselves.
#![allow(dead_code)]

use std::f64::consts::TAU;
use std::path::Path;

use dicom_core::value::{DataSetSequence, PrimitiveValue};
use dicom_core::{DataElement, Length, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::mem::InMemElement;
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};

pub type Points = Vec<[f64; 3]>;

pub fn text(tag: Tag, vr: VR, value: &str) -> InMemElement {
    DataElement::new(tag, vr, PrimitiveValue::from(value))
}

pub fn sequence(tag: Tag, items: Vec<InMemDicomObject>) -> InMemElement {
    DataElement::new(tag, VR::SQ, DataSetSequence::new(items, Length::UNDEFINED))
}

pub fn data(points: &[[f64; 3]]) -> String {
    points.iter().flatten().map(|v| format!("{v}")).collect::<Vec<_>>().join("\\")
}

pub fn contour(kind: &str, count: usize, data: &str) -> InMemDicomObject {
    InMemDicomObject::from_element_iter([
        text(tags::CONTOUR_GEOMETRIC_TYPE, VR::CS, kind),
        text(tags::NUMBER_OF_CONTOUR_POINTS, VR::IS, &count.to_string()),
        text(tags::CONTOUR_DATA, VR::DS, data),
    ])
}

/// A ROI: name, and the type and points of each contour.
pub type Drawn<'a> = (&'a str, Vec<(&'a str, Points)>);

/// ROI Display Color of the ROI with this number.
pub fn colour(number: usize) -> [u8; 3] {
    [200, 10 * number as u8, 30]
}

/// A structure set without its file meta group; ROIs are numbered from 1, and have colours.
pub fn structure_set(rois: &[Drawn<'_>]) -> InMemDicomObject {
    let named = rois.iter().enumerate().map(|(k, (name, _))| {
        InMemDicomObject::from_element_iter([
            text(tags::ROI_NUMBER, VR::IS, &(k + 1).to_string()),
            text(tags::ROI_NAME, VR::LO, name),
            text(tags::ROI_GENERATION_ALGORITHM, VR::CS, "MANUAL"),
        ])
    });
    let drawn = rois.iter().enumerate().map(|(k, (_, contours))| {
        let items = contours.iter().map(|(kind, points)| contour(kind, points.len(), &data(points))).collect();
        InMemDicomObject::from_element_iter([
            text(tags::ROI_DISPLAY_COLOR, VR::IS, &colour(k + 1).map(|c| c.to_string()).join("\\")),
            text(tags::REFERENCED_ROI_NUMBER, VR::IS, &(k + 1).to_string()),
            sequence(tags::CONTOUR_SEQUENCE, items),
        ])
    });
    InMemDicomObject::from_element_iter([
        text(tags::SOP_CLASS_UID, VR::UI, uids::RT_STRUCTURE_SET_STORAGE),
        text(tags::SOP_INSTANCE_UID, VR::UI, "1.2.3.4"),
        text(tags::SERIES_INSTANCE_UID, VR::UI, "1.2.3.5"),
        text(tags::APPROVAL_STATUS, VR::CS, "APPROVED"),
        sequence(tags::STRUCTURE_SET_ROI_SEQUENCE, named.collect()),
        sequence(tags::ROI_CONTOUR_SEQUENCE, drawn.collect()),
    ])
}

pub fn write_as(object: InMemDicomObject, syntax: &str, path: &Path) {
    let meta = FileMetaTableBuilder::new()
        .transfer_syntax(syntax)
        .media_storage_sop_class_uid(uids::RT_STRUCTURE_SET_STORAGE)
        .media_storage_sop_instance_uid("1.2.3.4");
    object.with_meta(meta).expect("the meta group is whole").write_to_file(path).expect("a file can be written");
}

pub fn write(rois: &[Drawn<'_>], path: &Path) {
    write_as(structure_set(rois), uids::EXPLICIT_VR_LITTLE_ENDIAN, path);
}

/// A circle of 90 points about (100, -50) on the plane at `z`.
pub fn circle(radius: f64, z: f64) -> Points {
    let at = |k: usize| TAU * k as f64 / 90.0;
    (0..90).map(|k| [100.0 + radius * at(k).cos(), -50.0 + radius * at(k).sin(), z]).collect()
}

pub const CLOSED: &str = "CLOSED_PLANAR";

pub fn tube(radius: f64, planes: &[f64]) -> Vec<(&'static str, Points)> {
    planes.iter().map(|z| (CLOSED, circle(radius, *z))).collect()
}
