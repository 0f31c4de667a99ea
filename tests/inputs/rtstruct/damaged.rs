//! Structure sets with wrong or missing fields, cut off, with flipped bits, with lengths and nesting beyond the file.

use std::fs;

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use interslice::input::read;
use interslice::stack::ReadOptions;

use super::checks::*;
use crate::files::folder;
use crate::rtss::*;

#[test]
fn missing_and_wrong_fields_are_named() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let input = path.display().to_string();
    let sound = || structure_set(&[("a", tube(10.0, &[0.0, 3.0]))]);
    let refused = |object: InMemDicomObject, wanted: &[&str]| {
        for syntax in [uids::EXPLICIT_VR_LITTLE_ENDIAN, uids::IMPLICIT_VR_LITTLE_ENDIAN] {
            write_as(object.clone(), syntax, &path);
            assert_says(&said(&["inspect", &input], 2), &[&["a.dcm"], wanted].concat());
        }
    };
    let without = |tag| {
        let mut object = sound();
        object.remove_element(tag);
        object
    };
    refused(without(tags::STRUCTURE_SET_ROI_SEQUENCE), &["Structure Set ROI Sequence (3006,0020) is missing"]);
    refused(without(tags::ROI_CONTOUR_SEQUENCE), &["ROI Contour Sequence (3006,0039) is missing"]);
    refused(without(tags::SOP_CLASS_UID), &["SOP Class UID"]);
    let segmentation =
        "a DICOM segmentation, which is not read: 3D Slicer, or segimage2itkimage of dcmqi, saves it as NRRD";
    for class in [uids::SEGMENTATION_STORAGE, uids::LABEL_MAP_SEGMENTATION_STORAGE] {
        let mut object = sound();
        object.put(text(tags::SOP_CLASS_UID, VR::UI, class));
        refused(object, &[segmentation]);
    }
    let with = |item: InMemDicomObject| {
        let mut object = sound();
        let roi = InMemDicomObject::from_element_iter([
            text(tags::REFERENCED_ROI_NUMBER, VR::IS, "1"),
            sequence(tags::CONTOUR_SEQUENCE, vec![item]),
        ]);
        object.put(sequence(tags::ROI_CONTOUR_SEQUENCE, vec![roi]));
        object
    };
    let at = "ROI 1 (`a`), contour 1";
    refused(with(contour(CLOSED, 3, r"0\0\0\1\NaN\0\2\2\0")), &[at, "Contour Data: value 5 is `NaN`"]);
    refused(with(contour(CLOSED, 3, r"0\0\0\1\inf\0\2\2\0")), &[at, "value 5 is `inf`"]);
    refused(with(contour(CLOSED, 3, r"0\0\0\1\a\0\2\2\0")), &[at, "value 5 is `a`"]);
    refused(with(contour(CLOSED, 3, r"0\0\0\1\1\0\2\2")), &[at, "8 values"]);
    refused(with(contour(CLOSED, 4, r"0\0\0\1\1\0\2\2\0")), &[at, "Number of Contour Points is 4"]);
    let mut bare = contour(CLOSED, 3, r"0\0\0\1\1\0\2\2\0");
    bare.remove_element(tags::CONTOUR_GEOMETRIC_TYPE);
    refused(with(bare), &[at, "Contour Geometric Type (3006,0042) is missing"]);
    let huge = circle(1e200, 0.0);
    write(&[("a", vec![(CLOSED, huge), (CLOSED, circle(10.0, 3.0))])], &path);
    said(&["inspect", &input, "--pixel", "1"], 2);
    fs::write(&path, "no DICOM at all").expect("a file can be written");
    assert_says(&said(&["inspect", &input], 2), &["is no DICOM file"]);
}

/// Contours that are no ROI's, or a ROI's second ones, are left out, and the others are read.
#[test]
fn contours_of_no_roi_or_of_one_drawn_before_are_left_out() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let input = path.display().to_string();
    let rois = [("a", tube(10.0, &[0.0, 3.0])), ("b", tube(6.0, &[0.0, 3.0, 6.0]))];
    let with = |number: &str| {
        let mut object = structure_set(&rois);
        let added = structure_set(&[("c", tube(4.0, &[0.0, 3.0]))]);
        let items = |object: &InMemDicomObject| {
            let element = object.element(tags::ROI_CONTOUR_SEQUENCE).expect("it is there");
            element.items().expect("a sequence").to_vec()
        };
        let (mut all, mut more) = (items(&object), items(&added));
        more[0].put(text(tags::REFERENCED_ROI_NUMBER, VR::IS, number));
        all.extend(more);
        object.put(sequence(tags::ROI_CONTOUR_SEQUENCE, all));
        write_as(object, uids::EXPLICIT_VR_LITTLE_ENDIAN, &path);
    };
    let out = place.path().join("a.json").display().to_string();
    let at = "item 3 of ROI Contour Sequence: left out, ";
    let reconstructed = |roi: &str| said(&["reconstruct", &input, "--roi", roi, "-o", &out, "--backend", "cpu"], 0);

    with("7");
    let none = &format!("warning: {at}its Referenced ROI Number 7 is none of the file's ROIs");
    assert_says(&said(&["inspect", &input], 0), &[none, "ROI 1 (`a`): 2 contours", "ROI 2 (`b`): 3 contours"]);
    assert_says(&said(&["inspect", &input, "--roi", "b"], 0), &[none, "ROI 2 (`b`): 3 contours", "3 slices"]);
    assert_says(&reconstructed("a"), &[none]);
    assert!(fs::read_to_string(&out).expect("it was written").contains("Referenced ROI Number 7"));
    assert_near(area(&stack(&path, &["b"]), 0), disc(6.0), 0.05 * disc(6.0));

    with("2");
    let again = &format!("{at}item 2 has the contours of ROI 2 (`b`) already");
    assert_says(&said(&["inspect", &input], 0), &[again, "ROI 1 (`a`): 2 contours", "ROI 2 (`b`): 3 contours"]);
    assert_says(&reconstructed("b"), &[&format!("warning: {again}")]);
    assert!(!reconstructed("a").contains("left out"), "it is another one's");
    // What is added is added once.
    let completed = place.path().join("b.dcm");
    let outputs = ["--all-rois", "-o", &completed.display().to_string(), "-q", "--backend", "cpu"];
    said(&[&["reconstruct", &input], &outputs[..]].concat(), 0);
    assert_eq!(contours_of(&completed).iter().map(Vec::len).collect::<Vec<_>>(), [3, 5, 2]);
    assert_near(area(&stack(&path, &["b"]), 0), disc(6.0), 0.05 * disc(6.0));
}

#[test]
fn files_cut_off_or_with_flipped_bits_never_crash() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let few = |z| (CLOSED, vec![[0.0, 0.0, z], [10.0, 0.0, z], [10.0, 8.0, z], [0.0, 8.0, z]]);
    for syntax in [uids::EXPLICIT_VR_LITTLE_ENDIAN, uids::IMPLICIT_VR_LITTLE_ENDIAN] {
        let mut object = structure_set(&[("a", vec![few(0.0), few(3.0)])]);
        // It comes after the contours, and without it the file is sound.
        object.remove_element(tags::APPROVAL_STATUS);
        write_as(object, syntax, &path);
        let sound = fs::read(&path).expect("it was written");
        let tried = |bytes: &[u8]| {
            fs::write(&path, bytes).expect("a file can be written");
            read(&path, &ReadOptions { pixel: Some(1.0), ..ReadOptions::default() })
                .map(drop)
                .map_err(|e| (e.exit_code(), e.to_string()))
        };
        assert!(tried(&sound).is_ok());
        for length in 0..sound.len() {
            let (code, message) = tried(&sound[..length]).expect_err("a part is no whole");
            assert!(code == 2 && message.contains("a.dcm"), "{length} bytes: {message}");
        }
        let mut refused = 0;
        for place in 128..sound.len() {
            for bit in [0, 3, 7] {
                let mut bytes = sound.clone();
                bytes[place] ^= 1 << bit;
                // Many flips leave a sound file (a coordinate, a name); none may crash, and refusals name their reason.
                if let Err((code, message)) = tried(&bytes) {
                    refused += 1;
                    assert!(code == 2 && message.len() > 10, "byte {place}: {message}");
                }
            }
        }
        assert!(refused > sound.len() / 2, "only {refused} refused");
    }
}

#[test]
fn lengths_and_nesting_are_believed_only_as_far_as_the_file_goes() {
    let place = folder();
    let path = place.path().join("a.dcm");
    write_as(structure_set(&[("a", tube(10.0, &[0.0, 3.0]))]), uids::IMPLICIT_VR_LITTLE_ENDIAN, &path);
    let sound = fs::read(&path).expect("it was written");
    let input = path.display().to_string();
    let refused = |tail: &[u8], wanted: &[&str]| {
        fs::write(&path, [&sound[..], tail].concat()).expect("a file can be written");
        assert_says(&said(&["inspect", &input], 2), wanted);
    };
    // 4 GiB of text in a file of some kB.
    refused(&[0x0e, 0x30, 0x08, 0x00, 0xf0, 0xff, 0xff, 0xff, 0x20], &["4294967280 bytes long, but 1 are left"]);
    // Sequences in sequences without end.
    let nest =
        [&[0x06, 0x30, 0xb0, 0x00, 0xff, 0xff, 0xff, 0xff][..], &[0xfe, 0xff, 0x00, 0xe0, 0xff, 0xff, 0xff, 0xff]]
            .concat();
    refused(&nest.repeat(100_000), &["nested more than 16"]);
}
