//! Outputs on the planes of a series of images, and completed RTSTRUCTs that refer to it.

use dicom_core::{DataElement, VR, value::PrimitiveValue};
use dicom_dictionary_std::{tags, uids};
use dicom_object::{FileMetaTableBuilder, InMemDicomObject, open_file};
use interslice::rtstruct::ImageSeries;

use super::*;
use crate::rtss::{text, tube, write};

/// Images of 40 x 50 px of 2 x 3 mm, on these planes.
fn images(folder: &Path, planes: &[f64]) {
    fs::create_dir_all(folder).expect("a folder can be made");
    for (k, z) in planes.iter().enumerate() {
        let number = |tag, n: u16| DataElement::new(tag, VR::US, PrimitiveValue::from(n));
        let object = InMemDicomObject::from_element_iter([
            text(tags::SOP_CLASS_UID, VR::UI, uids::CT_IMAGE_STORAGE),
            text(tags::SOP_INSTANCE_UID, VR::UI, &format!("1.2.9.{k}")),
            text(tags::STUDY_INSTANCE_UID, VR::UI, "1.2.7"),
            text(tags::SERIES_INSTANCE_UID, VR::UI, "1.2.8"),
            text(tags::FRAME_OF_REFERENCE_UID, VR::UI, "1.2.6"),
            text(tags::IMAGE_POSITION_PATIENT, VR::DS, &format!("60\\-120\\{z}")),
            text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "1\\0\\0\\0\\1\\0"),
            text(tags::PIXEL_SPACING, VR::DS, "3\\2"),
            number(tags::ROWS, 50),
            number(tags::COLUMNS, 40),
            DataElement::new(tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(vec![0; 2000].into())),
        ]);
        let meta = FileMetaTableBuilder::new()
            .transfer_syntax(uids::EXPLICIT_VR_LITTLE_ENDIAN)
            .media_storage_sop_class_uid(uids::CT_IMAGE_STORAGE)
            .media_storage_sop_instance_uid(format!("1.2.9.{k}"));
        // The names say nothing of the order.
        let name = format!("{}.dcm", 100 - k);
        object.with_meta(meta).expect("a meta group").write_to_file(folder.join(name)).expect("a file");
    }
}

#[test]
fn contours_lie_on_the_planes_of_the_series_and_refer_to_its_images() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    // Uneven: between the drawn planes there are 1, 4, 4.5, 7.5.
    let planes = [-4.0, -2.0, 0.0, 1.0, 3.0, 4.0, 4.5, 6.0, 7.5, 9.0, 12.0];
    images(&place.path().join("ct"), &planes);
    write(&[("Tumour", tube(20.0, &[0.0, 3.0, 6.0, 9.0]))], &place.path().join("rtss.dcm"));
    done(&[&at("rtss.dcm"), "--like", &at("ct"), "-o", &at("out.dcm")]);
    let object = open_file(at("out.dcm")).expect("a DICOM file");
    let items = |o: &InMemDicomObject, tag| o.get(tag).and_then(|e| e.items()).unwrap_or_default().to_vec();
    let uid =
        |o: &InMemDicomObject, tag| o.get(tag).expect("a UID").to_str().expect("text").trim_matches('\0').to_string();
    let roi = &items(&object, tags::ROI_CONTOUR_SEQUENCE)[0];
    let added = items(roi, tags::CONTOUR_SEQUENCE).split_off(4);
    let found: Vec<(f64, String)> = added
        .iter()
        .map(|contour| {
            let data = contour.get(tags::CONTOUR_DATA).expect("data").to_multi_float64().expect("numbers");
            let image = &items(contour, tags::CONTOUR_IMAGE_SEQUENCE)[0];
            assert_eq!(uid(image, tags::REFERENCED_SOP_CLASS_UID), uids::CT_IMAGE_STORAGE);
            (data[2], uid(image, tags::REFERENCED_SOP_INSTANCE_UID))
        })
        .collect();
    let wanted: Vec<(f64, String)> = [3usize, 5, 6, 8].iter().map(|&k| (planes[k], format!("1.2.9.{k}"))).collect();
    assert_eq!(found, wanted);
    let frame = &items(&object, tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE)[0];
    assert_eq!(uid(frame, tags::FRAME_OF_REFERENCE_UID), "1.2.6");
    let study = &items(frame, tags::RT_REFERENCED_STUDY_SEQUENCE)[0];
    let of_series = &items(study, tags::RT_REFERENCED_SERIES_SEQUENCE)[0];
    assert_eq!(uid(of_series, tags::SERIES_INSTANCE_UID), "1.2.8");
    assert_eq!(items(of_series, tags::CONTOUR_IMAGE_SEQUENCE).len(), planes.len());
    refused(&[&at("rtss.dcm"), "--like", &at("ct"), "-o", &at("out.nrrd")], "a volume needs even ones");
}

/// Two bodies in two frames of reference, of which the second has contours on planes between the first's, with images.
fn in_two_frames(path: &Path, frames: [&str; 2]) {
    let planes: Vec<f64> = (0..10).map(f64::from).collect();
    let rois = [("First", tube(20.0, &[0.0, 3.0, 6.0, 9.0])), ("Second", tube(20.0, &planes))];
    let mut object = crate::rtss::structure_set(&rois);
    let items = |mut element: dicom_object::mem::InMemElement, change: &dyn Fn(usize, &mut InMemDicomObject)| {
        element.items_mut().into_iter().flatten().enumerate().for_each(|(k, item)| change(k, item));
        element
    };
    let named = object.take(tags::STRUCTURE_SET_ROI_SEQUENCE).expect("there are ROIs");
    object.put(items(named, &|k, roi| {
        roi.put(text(tags::REFERENCED_FRAME_OF_REFERENCE_UID, VR::UI, frames[k]));
    }));
    let image = |name: &str| {
        InMemDicomObject::from_element_iter([
            text(tags::REFERENCED_SOP_CLASS_UID, VR::UI, uids::CT_IMAGE_STORAGE),
            text(tags::REFERENCED_SOP_INSTANCE_UID, VR::UI, name),
        ])
    };
    let drawn = object.take(tags::ROI_CONTOUR_SEQUENCE).expect("there are contours");
    object.put(items(drawn, &|k, roi| {
        let contours = roi.take(tags::CONTOUR_SEQUENCE).expect("it is drawn");
        roi.put(items(contours, &|n, contour| {
            let name = format!("1.3.{k}.{n}");
            contour.put(crate::rtss::sequence(tags::CONTOUR_IMAGE_SEQUENCE, vec![image(&name)]));
        }));
    }));
    let frame = |uid: &str| InMemDicomObject::from_element_iter([text(tags::FRAME_OF_REFERENCE_UID, VR::UI, uid)]);
    let all = frames.map(frame).to_vec();
    object.put(crate::rtss::sequence(tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE, all));
    crate::rtss::write_as(object, uids::EXPLICIT_VR_LITTLE_ENDIAN, path);
}

#[test]
fn bodies_in_other_frames_have_nothing_to_do_with_each_other() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    images(&place.path().join("ct"), &[-3.0, 0.0, 1.0, 3.0, 4.0, 6.0, 9.0, 12.0]);
    let items = |o: &InMemDicomObject, tag| o.get(tag).and_then(|e| e.items()).unwrap_or_default().to_vec();
    let (input, out) = (at("rtss.dcm"), at("out.dcm"));
    // By itself the first has a plane half way; where the second shares its frame, those of the second.
    for (frames, planes, shared) in [(["1.2.6", "1.2.66"], 3, 0), (["1.2.6", "1.2.6"], 6, 6)] {
        in_two_frames(Path::new(&input), frames);
        done(&[&input, "--roi", "First", "-o", &out]);
        let object = open_file(&out).expect("a DICOM file");
        let added = items(&items(&object, tags::ROI_CONTOUR_SEQUENCE)[0], tags::CONTOUR_SEQUENCE).split_off(4);
        let with_image = added.iter().filter(|contour| contour.get(tags::CONTOUR_IMAGE_SEQUENCE).is_some()).count();
        assert_eq!((added.len(), with_image), (planes, shared), "{frames:?}");
    }
    in_two_frames(Path::new(&input), ["1.2.6", "1.2.66"]);
    // On the very planes of the other, too.
    done(&[&input, "--roi", "First", "--dz", "1", "-o", &at("fine.dcm")]);
    let object = open_file(at("fine.dcm")).expect("a DICOM file");
    let added = items(&items(&object, tags::ROI_CONTOUR_SEQUENCE)[0], tags::CONTOUR_SEQUENCE).split_off(4);
    let planes = added.iter().map(|contour| {
        assert!(contour.get(tags::CONTOUR_IMAGE_SEQUENCE).is_none(), "an image of the other frame");
        contour.get(tags::CONTOUR_DATA).expect("data").to_multi_float64().expect("numbers")[2]
    });
    assert_eq!(planes.collect::<Vec<f64>>(), [1.0, 2.0, 4.0, 5.0, 7.0, 8.0]);
    refused(
        &[&input, "--roi", "Second", "--like", &at("ct"), "-o", &at("no.dcm")],
        "ROI's frame of reference, 1.2.66; got 1.2.6",
    );
    done(&[&input, "--roi", "First", "--like", &at("ct"), "-o", &at("first.dcm")]);
    let object = open_file(at("first.dcm")).expect("a DICOM file");
    let named = items(&object, tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE);
    let uid = |item: &InMemDicomObject| {
        let text = item.get(tags::FRAME_OF_REFERENCE_UID).expect("a UID").to_str().expect("text").into_owned();
        text.trim_end_matches('\0').to_string()
    };
    assert_eq!(named.iter().map(uid).collect::<Vec<_>>(), ["1.2.6", "1.2.66"]);
}

/// Items that name the images of a series of study 1.2.7.
fn named(uid: &str, images: &[String]) -> InMemDicomObject {
    let image = |name: &String| {
        InMemDicomObject::from_element_iter([
            text(tags::REFERENCED_SOP_CLASS_UID, VR::UI, uids::CT_IMAGE_STORAGE),
            text(tags::REFERENCED_SOP_INSTANCE_UID, VR::UI, name),
        ])
    };
    let images = images.iter().map(image).collect();
    let series = InMemDicomObject::from_element_iter([
        text(tags::SERIES_INSTANCE_UID, VR::UI, uid),
        crate::rtss::sequence(tags::CONTOUR_IMAGE_SEQUENCE, images),
    ]);
    let study = InMemDicomObject::from_element_iter([
        text(tags::REFERENCED_SOP_INSTANCE_UID, VR::UI, "1.2.7"),
        crate::rtss::sequence(tags::RT_REFERENCED_SERIES_SEQUENCE, vec![series]),
    ]);
    InMemDicomObject::from_element_iter([
        text(tags::FRAME_OF_REFERENCE_UID, VR::UI, "1.2.6"),
        crate::rtss::sequence(tags::RT_REFERENCED_STUDY_SEQUENCE, vec![study]),
    ])
}

/// Contours that were drawn on images of one series refer to these, also where those between them lie on another's.
#[test]
fn the_series_that_was_drawn_on_stays_named() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    images(&place.path().join("ct"), &[0.0, 1.5, 3.0, 4.5]);
    let items = |o: &InMemDicomObject, tag| o.get(tag).and_then(|e| e.items()).unwrap_or_default().to_vec();
    let uid =
        |o: &InMemDicomObject, tag| o.get(tag).expect("a UID").to_str().expect("text").trim_matches('\0').to_string();
    // Another series; and the same one, of which an image is not in the folder.
    let drawn_on = ["1.2.9.0", "1.2.9.77"].map(String::from);
    for (of_series, wanted) in [("1.2.88", vec![("1.2.88", 2), ("1.2.8", 4)]), ("1.2.8", vec![("1.2.8", 5)])] {
        let mut object = crate::rtss::structure_set(&[("Tumour", tube(20.0, &[0.0, 3.0]))]);
        let frames = vec![named(of_series, &drawn_on)];
        object.put(crate::rtss::sequence(tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE, frames));
        crate::rtss::write_as(object, uids::EXPLICIT_VR_LITTLE_ENDIAN, &place.path().join("rtss.dcm"));
        done(&[&at("rtss.dcm"), "--like", &at("ct"), "-o", &at("out.dcm")]);
        let object = open_file(at("out.dcm")).expect("a DICOM file");
        let frames = items(&object, tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE);
        assert_eq!(frames.iter().map(|f| uid(f, tags::FRAME_OF_REFERENCE_UID)).collect::<Vec<_>>(), ["1.2.6"]);
        let studies = items(&frames[0], tags::RT_REFERENCED_STUDY_SEQUENCE);
        assert_eq!(studies.len(), 1, "both series are of one study");
        let series = items(&studies[0], tags::RT_REFERENCED_SERIES_SEQUENCE);
        let listed = |s: &InMemDicomObject| {
            let named = items(s, tags::CONTOUR_IMAGE_SEQUENCE);
            let all: std::collections::BTreeSet<_> =
                named.iter().map(|image| uid(image, tags::REFERENCED_SOP_INSTANCE_UID)).collect();
            assert_eq!(all.len(), named.len(), "no image is named twice");
            (uid(s, tags::SERIES_INSTANCE_UID), all.len())
        };
        let found: Vec<_> = series.iter().map(listed).collect();
        assert_eq!(found.iter().map(|(uid, n)| (uid.as_str(), *n)).collect::<Vec<_>>(), wanted);
    }
}

#[test]
fn a_volume_lies_on_the_grid_of_the_series() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let planes: Vec<f64> = (0..9).map(|k| 1.5 * f64::from(k) - 1.5).collect();
    images(&place.path().join("ct"), &planes);
    write(&[("Tumour", tube(20.0, &[0.0, 3.0, 6.0, 9.0]))], &place.path().join("rtss.dcm"));
    // An image stands for its series.
    for like in [at("ct"), at("ct/97.dcm")] {
        done(&[&at("rtss.dcm"), "--like", &like, "--mask", "-o", &at("out.mha")]);
        let (volume, voxels) = read(Path::new(&at("out.mha")));
        assert_eq!(volume.grid.dims, [40, 50, 9]);
        assert_eq!(volume.grid.origin, DVec3::new(60.0, -120.0, -1.5));
        assert!(volume.grid.spacing().iter().zip([2.0, 3.0, 1.5]).all(|(a, b)| (a - b).abs() < 1e-9));
        let area = |k: usize| voxels[2000 * k..2000 * (k + 1)].iter().filter(|v| **v == 1).count() as f64 * 6.0;
        assert_eq!((area(0), area(8)), (0.0, 0.0), "beyond the body");
        for k in 1..8 {
            let share = area(k) / (std::f64::consts::PI * 400.0);
            assert!((share - 1.0).abs() < 0.05, "plane {k}: {share}");
        }
    }
    refused(&[&at("rtss.dcm"), "--like", &at("rtss.dcm"), "-o", &at("out.mha")], "is no DICOM image with a place");
}

/// Values of the elements by which an image is changed, and what is said of it.
#[test]
fn images_that_are_no_stack_are_told() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    write(&[("Tumour", tube(20.0, &[0.0, 3.0, 6.0, 9.0]))], &place.path().join("rtss.dcm"));
    let number = |tag, n: u16| DataElement::new(tag, VR::US, PrimitiveValue::from(n));
    let changes = [
        (text(tags::PIXEL_SPACING, VR::DS, "0\\2"), "98.dcm: Image Orientation must be"),
        (text(tags::PIXEL_SPACING, VR::DS, "3"), "98.dcm: Pixel Spacing must be 2 numbers; got `3`"),
        (text(tags::PIXEL_SPACING, VR::DS, "3\\1e999"), "98.dcm: Pixel Spacing must be 2 numbers; got `3\\1e999`"),
        (text(tags::PIXEL_SPACING, VR::DS, "3\\4"), "has other pixels than"),
        (text(tags::PIXEL_SPACING, VR::DS, "3\\1.9"), "has other pixels than"),
        (text(tags::IMAGE_POSITION_PATIENT, VR::DS, "a\\b\\c"), "98.dcm: Image Position (Patient) must be 3 numbers"),
        (text(tags::IMAGE_POSITION_PATIENT, VR::DS, "60\\-120\\3"), "has two images at height 3.000"),
        (
            text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "1\\0\\0\\1\\0\\0"),
            "98.dcm: Image Orientation must be two perp",
        ),
        (text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "0\\1\\0\\1\\0\\0"), "has other directions than"),
        (number(tags::ROWS, 0), "98.dcm: Image Orientation must be"),
        (number(tags::COLUMNS, 65535), "has other pixels than"),
        (text(tags::SERIES_INSTANCE_UID, VR::UI, "1.2.88"), "has images of several series"),
    ];
    for (element, says) in changes {
        images(&place.path().join("ct"), &[0.0, 1.5, 4.5, 3.0]);
        let path = at("ct/98.dcm");
        let mut object = open_file(&path).expect("a DICOM file");
        object.put(element);
        object.write_to_file(&path).expect("a file");
        refused(&[&at("rtss.dcm"), "--like", &at("ct"), "-o", &at("out.mha")], says);
        assert!(!place.path().join("out.mha").exists());
    }
}

/// What is cut off or damaged is read or refused in words, and never more is taken than the file has.
#[test]
fn damaged_images_are_read_or_refused() {
    let place = folder();
    images(place.path(), &[0.0]);
    let path = place.path().join("100.dcm");
    let sound = fs::read(&path).expect("a file");
    assert_eq!(ImageSeries::read(&path).expect("it is sound").dims, [40, 50]);
    let header = sound.len() - 4000;
    let mut refused = 0;
    let mut look = |bytes: &[u8], what: String| {
        fs::write(&path, bytes).expect("a file");
        if let Err(wrong) = ImageSeries::read(&path) {
            refused += 1;
            assert!(wrong.to_string().contains("100.dcm") && wrong.exit_code() == 2, "{what}: {wrong}");
        }
    };
    for cut in 0..header {
        look(&sound[..cut], format!("cut to {cut}"));
    }
    for n in 128..header {
        for change in [0x01, 0x80, 0xff] {
            let mut bytes = sound.clone();
            bytes[n] ^= change;
            look(&bytes, format!("byte {n} by {change:#x}"));
        }
    }
    assert!((header / 2..4 * header).contains(&refused), "{refused} of {} were refused", 4 * header);
}
