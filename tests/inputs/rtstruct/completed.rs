//! Structure sets out: the contours between those that were drawn.

use std::fs;
use std::path::Path;

use dicom_core::value::PrimitiveValue;
use dicom_core::{DataElement, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::open_file;

use super::checks::*;
use crate::files::{folder, sound_stack};
use crate::rtss::*;

#[test]
fn a_completed_set_keeps_what_was_drawn_and_marks_what_was_not() {
    let place = folder();
    let (path, out) = (place.path().join("a.dcm"), place.path().join("b.dcm"));
    // The body is drawn on every image, the tumour on every third.
    let body: Vec<f64> = (0..13).map(|k| f64::from(k) * 2.0).collect();
    write(&[("tumour", tube(10.0, &[6.0, 12.0, 18.0])), ("body", tube(40.0, &body))], &path);
    let arguments = ["reconstruct", &path.display().to_string(), "--roi", "tumour", "-o", &out.display().to_string()];
    said(&[&arguments[..], &["-q", "--backend", "cpu"]].concat(), 0);
    let (old, new) = (contours_of(&path), contours_of(&out));
    assert_eq!(new[1], old[1]);
    assert_eq!(new[0][..3], old[0][..]);
    let heights = |contours: &[(String, String)]| -> Vec<f64> {
        contours
            .iter()
            .map(|(_, data)| data.split('\\').nth(2).and_then(|z| z.trim().parse().ok()).expect("a height"))
            .collect()
    };
    assert_eq!(heights(&new[0][3..]), [8.0, 10.0, 14.0, 16.0]);
    for (kind, data) in &new[0][3..] {
        assert_eq!(kind, CLOSED);
        let values: Vec<f64> = data.split('\\').map(|t| t.trim().parse().expect("a number")).collect();
        let off = |p: &[f64; 3]| ((p[0] - 100.0).hypot(p[1] + 50.0) - 10.0).abs();
        let worst = values.as_chunks::<3>().0.iter().map(off).fold(0.0, f64::max);
        assert!(worst < 0.15, "{worst} mm off the tube");
    }
    let object = open_file(&out).expect("the file opens");
    let top = |tag| object.element(tag).expect("it is there").to_str().expect("text").into_owned();
    assert!(top(tags::SOP_INSTANCE_UID).starts_with("2.25.") && top(tags::SERIES_INSTANCE_UID).starts_with("2.25."));
    assert_ne!(top(tags::SOP_INSTANCE_UID), top(tags::SERIES_INSTANCE_UID));
    assert_eq!(object.meta().media_storage_sop_instance_uid(), top(tags::SOP_INSTANCE_UID));
    assert_eq!(top(tags::APPROVAL_STATUS), "UNAPPROVED");
    let rois = object.element(tags::STRUCTURE_SET_ROI_SEQUENCE).expect("it is there").items().expect("a sequence");
    let said_of = rois[0].element(tags::ROI_DESCRIPTION).expect("it is there").to_str().expect("text");
    assert_says(&said_of, &["contours on 4 planes are interpolated, at 8, 10, 14, 16"]);
    assert!(rois[1].get(tags::ROI_DESCRIPTION).is_none());
    // The same again, byte by byte; and it is an input.
    let bytes = fs::read(&out).expect("it was written");
    said(&[&arguments[..], &["-q", "--backend", "cpu"]].concat(), 0);
    assert_eq!(fs::read(&out).expect("it was written"), bytes);
    assert_eq!(stack(&out, &["tumour"]).slices.len(), 7);
}

#[test]
fn a_completed_set_needs_a_set_and_one_roi() {
    let place = folder();
    sound_stack(place.path());
    let (path, out) = (place.path().join("a.dcm"), place.path().join("b.dcm").display().to_string());
    write(&[("a", tube(10.0, &[0.0, 3.0])), ("b", tube(12.0, &[0.0, 3.0]))], &path);
    let (folder, input) = (place.path().display().to_string(), path.display().to_string());
    assert_says(&said(&["reconstruct", &folder, "-o", &out], 2), &["b.dcm", "needs an RTSTRUCT"]);
    assert_says(&said(&["reconstruct", &input, "--roi", "a", "--roi", "b", "-o", &out], 2), &["b.dcm", "merged"]);
    assert_says(&said(&["reconstruct", &input, "--roi", "a", "-o", &input], 2), &["is the input"]);
    said(&["reconstruct", &input, "--all-rois", "-o", &out, "-q", "--backend", "cpu"], 0);
    // Every ROI has got its middle plane.
    assert_eq!(contours_of(Path::new(&out)).iter().map(Vec::len).collect::<Vec<_>>(), [3, 3]);
}

/// Of `--keep 2` half of the kept gap is where the others are drawn.
#[test]
fn that_no_plane_is_added_is_told_with_why() {
    let place = folder();
    let of = |name: &str| place.path().join(name).display().to_string();
    let planes: Vec<f64> = (0..7).map(|k| 6.0 * f64::from(k)).collect();
    write(&[("a", tube(10.0, &planes))], &place.path().join("a.dcm"));
    let told = "no plane is added to ROI 1 (`a`): those of every 6 mm from the lowest contour on were drawn";
    let run = |more: &[&str], out: &str| {
        said(&[&["reconstruct", &of("a.dcm"), "-o", &of(out), "--backend", "cpu"], more].concat(), 0)
    };
    assert_says(&run(&["--keep", "2"], "kept.dcm"), &[told]);
    assert_says(&run(&["--keep", "2", "--all-rois"], "all.dcm"), &[told]);
    assert_says(&run(&["--keep", "2", "--dry-run"], "dry.dcm"), &[told]);
    assert_says(&run(&["--dz", "6"], "six.dcm"), &["no plane is added to ROI 1 (`a`): the heights of the layers"]);
    for (more, out) in [(&["--keep", "2"][..], "body.stl"), (&[], "a3.dcm"), (&["--keep", "2", "--dz", "2"], "a2.dcm")]
    {
        assert!(!run(more, out).contains("no plane is added"), "{more:?}");
    }
}

/// What says other things of the old contours, or of the program that wrote them, is not kept.
#[test]
fn a_completed_set_says_nothing_of_what_it_was() {
    let place = folder();
    let (path, out) = (place.path().join("a.dcm"), place.path().join("b.dcm"));
    for syntax in [uids::EXPLICIT_VR_LITTLE_ENDIAN, uids::IMPLICIT_VR_LITTLE_ENDIAN] {
        let mut set = structure_set(&[("a", tube(10.0, &[0.0, 6.0])), ("b", tube(10.0, &[0.0, 6.0]))]);
        let mut named = set.take(tags::STRUCTURE_SET_ROI_SEQUENCE).expect("there are ROIs");
        named.items_mut().into_iter().flatten().for_each(|roi| {
            roi.put(text(tags::ROI_VOLUME, VR::DS, "18.9"));
        });
        set.put(named);
        set.put(text(Tag(0x3007, 0x0010), VR::LO, "ACME"));
        set.put(DataElement::new(Tag(0x3007, 0x1001), VR::FD, PrimitiveValue::from(1.5)));
        write_as(set, syntax, &path);
        let [input, output] = [&path, &out].map(|path| path.display().to_string());
        said(&["reconstruct", &input, "--roi", "a", "-o", &output, "-q", "--backend", "cpu"], 0);
        let object = open_file(&out).expect("the file opens");
        let rois = object.element(tags::STRUCTURE_SET_ROI_SEQUENCE).expect("it is there").items().expect("a sequence");
        let volumes = rois.iter().map(|roi| roi.get(tags::ROI_VOLUME).is_some());
        assert_eq!(volumes.collect::<Vec<_>>(), [false, true]);
        let meta = object.meta();
        assert!(meta.implementation_class_uid().starts_with("2.25."), "{}", meta.implementation_class_uid());
        assert_ne!(
            meta.implementation_class_uid(),
            open_file(&path).expect("it opens").meta().implementation_class_uid()
        );
        let version = meta.implementation_version_name.as_deref().expect("a name").trim().to_string();
        assert!(version.starts_with("interslice ") && version.len() <= 16, "{version}");
        // Private attributes keep their kind where the file has kinds.
        assert_eq!(meta.transfer_syntax(), syntax);
        let private = object.element(Tag(0x3007, 0x1001)).expect("it is there");
        if syntax == uids::EXPLICIT_VR_LITTLE_ENDIAN {
            assert_eq!((private.vr(), private.to_float64().expect("a number")), (VR::FD, 1.5));
        }
        assert_eq!(private.to_bytes().expect("bytes")[..], 1.5f64.to_le_bytes());
    }
}

/// A contour of more than 65534 bytes has no place in a file that says kinds.
#[test]
fn a_long_contour_is_written_whole() {
    let place = folder();
    let (path, out) = (place.path().join("a.dcm"), place.path().join("b.dcm"));
    write(&[("a", tube(200.0, &[0.0, 6.0]))], &path);
    let [input, output] = [&path, &out].map(|path| path.display().to_string());
    said(&["reconstruct", &input, "--pixel", "0.3", "-o", &output, "-q", "--backend", "cpu"], 0);
    let longest = contours_of(&out).iter().flatten().map(|(_, data)| data.len()).max();
    assert!(longest.is_some_and(|longest| longest > 65534), "{longest:?}");
    assert_eq!(stack(&out, &["a"]).slices.len(), 3);
}

/// A ROI on whose planes another lies that has fewer is drawn on every image, and needs none between.
#[test]
fn of_all_rois_those_that_are_drawn_on_every_image_are_left_as_they_are() {
    let place = folder();
    let of = |name: &str| place.path().join(name).display().to_string();
    let body: Vec<f64> = (0..13).map(|k| f64::from(k) * 2.0).collect();
    write(&[("tumour", tube(10.0, &[6.0, 12.0, 18.0])), ("body", tube(40.0, &body))], &place.path().join("a.dcm"));
    let counts = |out: &str| contours_of(&place.path().join(out)).iter().map(Vec::len).collect::<Vec<_>>();
    let told = "no plane is added to ROI 2 (`body`): it is drawn on all the planes that others of the file have";
    let run = |more: &[&str], out: &str| {
        said(&[&["reconstruct", &of("a.dcm"), "-o", &of(out), "--backend", "cpu"], more].concat(), 0)
    };
    assert_says(&run(&["--all-rois"], "all.dcm"), &[told]);
    assert_eq!(counts("all.dcm"), [7, 13]);
    // Who asks for more gets it.
    for (more, body) in [(&["--all-rois", "--dz", "1"][..], 25), (&["--roi", "body"], 25)] {
        assert!(!run(more, "more.dcm").contains("no plane is added"), "{more:?}");
        assert_eq!(counts("more.dcm")[1], body, "{more:?}");
    }
}
