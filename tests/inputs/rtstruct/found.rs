//! Structure sets that are known by their content, and found or chosen in a folder.

use std::fs;
use std::path::Path;

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use dicom_object::{InMemDicomObject, open_file};
use interslice::input::read;
use interslice::stack::ReadOptions;

use super::checks::*;
use crate::files::{folder, sound_stack};
use crate::rtss::*;

/// Offset of the data set: behind preamble, magic, and the meta group with its length.
fn data_set_at(bytes: &[u8]) -> usize {
    144 + u32::from_le_bytes(bytes[140..144].try_into().expect("four bytes")) as usize
}

/// Files as archives and old programs leave them: without preamble, without the meta group's length, the data set alone.
#[test]
fn dicom_is_known_by_its_content() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let rois = [("Tube", tube(10.0, &[0.0, 3.0, 6.0]))];
    for syntax in [uids::EXPLICIT_VR_LITTLE_ENDIAN, uids::IMPLICIT_VR_LITTLE_ENDIAN] {
        write_as(structure_set(&rois), syntax, &path);
        let whole = fs::read(&path).expect("it was written");
        let wanted = stack(&path, &[]);
        let without_length = [&whole[..132], &whole[144..]].concat();
        for (name, bytes) in [
            ("IM_0001", whole.clone()),
            ("no_preamble.bin", whole[128..].to_vec()),
            ("no_magic", whole[132..].to_vec()),
            ("no_length", without_length.clone()),
            ("1.2.3.4", without_length[132..].to_vec()),
            ("data_set", whole[data_set_at(&whole)..].to_vec()),
        ] {
            let path = place.path().join(name);
            fs::write(&path, bytes).expect("a file can be written");
            let read = stack(&path, &[]);
            assert_eq!(read.slices.len(), 3, "{name}");
            assert!((0..3).all(|k| area(&read, k) == area(&wanted, k)), "{name}");
            let (input, out) = (path.display().to_string(), place.path().join("done.dcm").display().to_string());
            said(&["reconstruct", &input, "-o", &out, "-q"], 0);
            let done = open_file(&out).expect("the completed file is whole");
            assert_eq!(done.meta().media_storage_sop_class_uid(), uids::RT_STRUCTURE_SET_STORAGE, "{name}");
            for required in [tags::STRUCTURE_SET_DATE, tags::STRUCTURE_SET_TIME] {
                assert!(done.element(required).is_ok_and(|e| e.value().multiplicity() == 0), "{name}: {required}");
            }
        }
    }
    let big = fs::read(&path).expect("it was written");
    let at = big.windows(17).position(|w| w == uids::IMPLICIT_VR_LITTLE_ENDIAN.as_bytes()).expect("the syntax");
    let mut big = big;
    big[at + 16] = b'9';
    fs::write(&path, &big).expect("a file can be written");
    assert_says(
        &said(&["inspect", &path.display().to_string()], 2),
        &["a.dcm", "Transfer Syntax UID is 1.2.840.10008.1.9"],
    );
}

/// A file of an image: nothing but what says so.
fn image_file(path: &Path) {
    let object = InMemDicomObject::from_element_iter([
        text(tags::SOP_CLASS_UID, VR::UI, uids::CT_IMAGE_STORAGE),
        text(tags::SOP_INSTANCE_UID, VR::UI, "1.2.9"),
    ]);
    write_as(object, uids::EXPLICIT_VR_LITTLE_ENDIAN, path);
}

#[test]
fn a_template_leaves_images_out_that_lie_beside_their_structure_set() {
    let place = folder();
    let images = place.path().join("ct");
    fs::create_dir(&images).expect("a folder can be made");
    (0..3).for_each(|k| image_file(&images.join(format!("IM{k}"))));
    let [cases, manifest] = [place.path(), &images.join("m.jsonl")].map(|path| path.display().to_string());
    let template = ["batch", "--template", &cases, &manifest];
    let nothing = ["has no ROI and no label that can be reconstructed", "ct: has 3 DICOM files", "left out"];
    assert_says(&said(&template, 2), &nothing);
    write(&[("Tube", tube(10.0, &[0.0, 3.0, 6.0]))], &place.path().join("rt.dcm"));
    let written = ["ct: has 3 DICOM files, but no RTSTRUCT among them: left out", "wrote 1 jobs"];
    assert_says(&said(&template, 0), &written);
    assert!(fs::read_to_string(manifest).expect("it was written").contains("rt-1"));
}

#[test]
fn the_structure_set_of_a_folder_is_found_or_chosen() {
    let place = folder();
    let study = place.path().join("study");
    fs::create_dir_all(study.join("rt")).expect("a folder can be made");
    let input = study.display().to_string();
    (0..3).for_each(|k| image_file(&study.join(format!("IM{k}"))));
    fs::write(study.join("readme.txt"), "notes").expect("a file can be written");
    assert_says(&said(&["inspect", &input], 2), &["study", "has 3 DICOM files, but no RTSTRUCT among them"]);
    let seg = InMemDicomObject::from_element_iter([
        text(tags::SOP_CLASS_UID, VR::UI, uids::SEGMENTATION_STORAGE),
        text(tags::SOP_INSTANCE_UID, VR::UI, "1.2.10"),
    ]);
    write_as(seg, uids::EXPLICIT_VR_LITTLE_ENDIAN, &study.join("SEG"));
    let says = "has 4 DICOM files, but no RTSTRUCT among them; there is a DICOM segmentation, which is not read";
    assert_says(&said(&["inspect", &input], 2), &[says]);
    let set = |name: &str, radius: f64, series: &str, instance: &str, number: &str| {
        let mut object = structure_set(&[("Tube", tube(radius, &[0.0, 3.0, 6.0]))]);
        object.put(text(tags::SERIES_INSTANCE_UID, VR::UI, series));
        object.put(text(tags::SOP_INSTANCE_UID, VR::UI, instance));
        object.put(text(tags::SERIES_NUMBER, VR::IS, number));
        object.put(text(tags::STRUCTURE_SET_LABEL, VR::SH, name));
        write_as(object, uids::EXPLICIT_VR_LITTLE_ENDIAN, &study.join("rt").join(name));
    };
    set("first", 10.0, "1.2.3", "1.2.3.1", "7");
    assert_near(area(&stack(&study, &[]), 1), disc(10.0), 8.0);
    assert_says(&said(&["inspect", &input], 0), &["ROI 1 (`Tube`): 3 contours on 3 planes"]);
    set("second", 20.0, "1.2.4", "1.2.4.1", "8");
    let several = said(&["inspect", &input], 2);
    assert_says(
        &several,
        &[
            "`series` is needed",
            "has 2 RTSTRUCTs",
            "1.2.3 (number 7, `first`, instance 1.2.3.1",
            "1.2.4 (number 8, `second`",
        ],
    );
    for (wanted, radius) in [("1.2.3", 10.0), ("1.2.4", 20.0), ("7", 10.0), ("8", 20.0), ("1.2.4.1", 20.0)] {
        let options = ReadOptions { series: Some(wanted.into()), pixel: Some(0.5), ..ReadOptions::default() };
        assert_near(area(&read(&study, &options).expect(wanted), 1), disc(radius), 8.0);
    }
    let out = place.path().join("a.stl").display().to_string();
    said(&["reconstruct", &input, "--series", "8", "-o", &out, "-q"], 0);
    said(&["reconstruct", &input, "--series", "8", "--all-rois", "-o", &out, "-q"], 0);
    set("third", 15.0, "1.2.4", "1.2.4.2", "8");
    for (wanted, says) in [
        ("9", "`series` must name an RTSTRUCT of"),
        ("8", "`series` 8 stands for several RTSTRUCTs; name one by its instance"),
        ("1.2.4", "`series` 1.2.4 stands for several"),
    ] {
        assert_says(&said(&["inspect", &input, "--series", wanted], 2), &[says, "instance 1.2.4.2"]);
    }
    let file = study.join("rt/first").display().to_string();
    assert_says(&said(&["inspect", &file, "--series", "7"], 2), &["`series` is not for a single file"]);
    fs::write(study.join("rt/broken"), &fs::read(&file).expect("it is there")[..600]).expect("a file can be written");
    assert_says(&said(&["inspect", &input], 2), &["broken", "is said to be 3444 bytes long"]);
    let stacks = folder();
    sound_stack(stacks.path());
    let slices = stacks.path().display().to_string();
    assert_says(
        &said(&["inspect", &slices, "--series", "7"], 2),
        &["`series` is not for anything but a folder of DICOM"],
    );
}

/// Beside the images is where viewers look for it; there it is none of the next run's inputs.
#[test]
fn a_completed_set_may_lie_in_the_folder_of_its_input() {
    let place = folder();
    let study = place.path().join("study");
    fs::create_dir(&study).expect("a folder can be made");
    (0..3).for_each(|k| image_file(&study.join(format!("IM{k}"))));
    let mut object = structure_set(&[("Tube", tube(10.0, &[0.0, 3.0, 6.0])), ("Wide", tube(20.0, &[0.0, 3.0, 6.0]))]);
    object.put(text(tags::SERIES_NUMBER, VR::IS, "7"));
    write_as(object, uids::EXPLICIT_VR_LITTLE_ENDIAN, &study.join("rt.dcm"));
    let [input, one, two, mesh] =
        [study.clone(), study.join("one.dcm"), study.join("two.dcm"), place.path().join("a.stl")]
            .map(|path| path.display().to_string());
    let run = |roi: &str, out: &str, more: &[&str], code: i32| {
        said(&[&["reconstruct", &input, "--roi", roi, "-o", out, "--backend", "cpu"], more].concat(), code)
    };
    run("Tube", &one, &[], 0);
    let bytes = fs::read(&one).expect("it was written");
    // Again, by its series, which is the number of both, and another ROI beside it.
    for more in [&[][..], &["--series", "7"], &["--series", "1.2.3.5"]] {
        let told = run("Tube", &one, more, 0);
        assert_eq!(told.contains("one.dcm is not read: interslice has made it of "), more.get(1) != Some(&"1.2.3.5"));
        assert_eq!(fs::read(&one).expect("it was written"), bytes, "{more:?}");
    }
    run("Wide", &two, &[], 0);
    assert_eq!(contours_of(Path::new(&two)).iter().map(Vec::len).collect::<Vec<_>>(), [3, 5]);
    // It is read where it is named, and then no output.
    let object = open_file(&one).expect("the completed file is whole");
    let instance = object.element(tags::SOP_INSTANCE_UID).expect("it has one").to_str().expect("text").into_owned();
    assert_says(&run("Tube", &one, &["--series", &instance], 2), &["one.dcm", "is the input"]);
    run("Tube", &mesh, &["--series", &instance], 0);
    // Without the one that it was made of it is one as any other.
    fs::remove_file(study.join("rt.dcm")).expect("it can be removed");
    fs::remove_file(&two).expect("it can be removed");
    assert!(!run("Tube", &mesh, &[], 0).contains("is not read"));
}
