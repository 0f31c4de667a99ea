//! What is read of a structure set, and what the program says of it.

use std::f64::consts::TAU;
use std::path::Path;

use dicom_dictionary_std::tags;
use dicom_object::{InMemDicomObject, open_file};
use interslice::ContourStack;
use interslice::input::read;
use interslice::stack::ReadOptions;

use crate::files::{interslice, stderr};

pub fn stack(path: &Path, roi: &[&str]) -> ContourStack {
    let roi = roi.iter().map(|r| (*r).into()).collect();
    read(path, &ReadOptions { roi, pixel: Some(0.5), ..ReadOptions::default() }).expect("the file is sound")
}

/// Area inside on slice `k`.
pub fn area(stack: &ContourStack, k: usize) -> f64 {
    let content = &stack.slices[k].content;
    (0..content.len()).filter(|n| content.inside(*n)).count() as f64 * stack.spacing[0] * stack.spacing[1]
}

pub fn disc(radius: f64) -> f64 {
    // A polygon of 90 corners.
    45.0 * (TAU / 90.0).sin() * radius * radius
}

pub fn assert_near(value: f64, wanted: f64, tolerance: f64) {
    assert!((value - wanted).abs() <= tolerance, "{value}, not {wanted}");
}

/// Type and Contour Data of every contour, by ROI.
pub fn contours_of(path: &Path) -> Vec<Vec<(String, String)>> {
    let object = open_file(path).expect("the file opens");
    let rois = object.element(tags::ROI_CONTOUR_SEQUENCE).expect("it is there").items().expect("a sequence");
    let of = |c: &InMemDicomObject, tag| c.element(tag).expect("it is there").to_str().expect("text").into_owned();
    rois.iter()
        .map(|roi| {
            let contours = roi.element(tags::CONTOUR_SEQUENCE).expect("it is there").items().expect("a sequence");
            contours.iter().map(|c| (of(c, tags::CONTOUR_GEOMETRIC_TYPE), of(c, tags::CONTOUR_DATA))).collect()
        })
        .collect()
}

pub fn said(arguments: &[&str], code: i32) -> String {
    let output = interslice(arguments);
    assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
    format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output))
}

pub fn assert_says(text: &str, wanted: &[&str]) {
    wanted.iter().for_each(|w| assert!(text.contains(w), "{text}\nlacks: {w}"));
}
