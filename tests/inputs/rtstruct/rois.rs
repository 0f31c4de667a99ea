//! ROIs that are chosen, merged, taken by a batch, or drawn on one plane alone.

use std::fs;

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;

use super::checks::*;
use crate::files::folder;
use crate::rtss::*;

#[test]
fn rois_are_chosen_by_name_or_number_and_merged_as_a_union() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let planes = [-3.0, 0.0, 3.0];
    write(&[("Small", tube(10.0, &planes)), ("Big One", tube(20.0, &planes))], &path);
    for (roi, radius) in [("Small", 10.0), ("1", 10.0), ("Big One", 20.0), ("2", 20.0)] {
        let stack = stack(&path, &[roi]);
        assert_eq!(stack.slices.iter().map(|s| s.z).collect::<Vec<_>>(), planes);
        assert_near(area(&stack, 1), disc(radius), 0.01 * disc(radius));
    }
    // Merged by even-odd this would be a ring.
    assert_near(area(&stack(&path, &["Small", "Big One"]), 1), disc(20.0), 0.01 * disc(20.0));
    let path = path.display().to_string();
    let refused = said(&["reconstruct", &path, "-o", "x.stl"], 2);
    assert_says(&refused, &["`roi` is needed", "2 ROIs", "1 `Small`", "2 `Big One`"]);
    assert_says(&said(&["inspect", &path, "--roi", "Heart"], 2), &["`roi`", "Heart", "1 `Small`"]);
    assert_says(&said(&["inspect", &path, "--roi", "1", "--roi", "Small"], 2), &["twice"]);
    assert_says(&said(&["inspect", &path, "--roi", "1", "--label", "1"], 2), &["`label`"]);
}

/// ROIs with planes of their own are interpolated to those of others before the union, which is without them in holes.
#[test]
fn rois_that_lack_planes_of_others_are_told_and_interpolated() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let all: Vec<f64> = (0..9).map(|k| 3.0 * f64::from(k)).collect();
    let shifted: Vec<f64> = all[..8].iter().map(|z| z + 1.5).collect();
    let second: Vec<f64> = all.iter().copied().step_by(2).collect();
    let few = [&all[..3], &all[5..]].concat();
    let beside = |radius: f64, planes: &[f64]| {
        let mut roi = tube(radius, planes);
        roi.iter_mut().flat_map(|(_, points)| points).for_each(|p| p[0] += 30.0);
        roi
    };
    write(
        &[
            ("All", tube(10.0, &all)),
            ("Few", beside(8.0, &few)),
            ("End", beside(8.0, &all[2..])),
            ("Off", beside(8.0, &shifted)),
            ("Second", beside(8.0, &second)),
        ],
        &path,
    );
    let (input, out) = (path.display().to_string(), place.path().join("a.json").display().to_string());
    let few = "ROI 2 (`Few`) is not drawn on 2 of the 9 planes from its first to its last one, on which others are: there the union is without";
    let off = "ROI 1 (`All`) is not drawn on 8 of the 17 planes from its first to its last one, on which others are; so is 1 more: there it is interpolated";
    let second = "ROI 5 (`Second`) is not drawn on 4 of the 9 planes from its first to its last one, on which others are: there it is interpolated";
    let whole = disc(10.0) * 24.0;
    for (others, told, volume) in [
        ("Few", Some(few), whole + disc(8.0) * (6.0 + 1.5 + 9.0 + 1.5)),
        ("Off", Some(off), whole + disc(8.0) * (21.0 + 0.75 + 0.75)),
        ("Second", Some(second), whole + disc(8.0) * 24.0),
        ("End", None, whole + disc(8.0) * (18.0 + 1.5)),
    ] {
        let rois = ["--roi", "All", "--roi", others];
        let makes = ["reconstruct", &input, "-o", &out, "--backend", "cpu"];
        for command in [&["inspect", &input][..], &makes[..]] {
            let said = said(&[command, &rois[..]].concat(), 0);
            match told {
                Some(told) => assert_says(&said, &[told, "`all_rois` makes each by itself"]),
                None => assert!(!said.contains("is not drawn on"), "{said}"),
            }
            let is_interpolated = told.is_some_and(|told| told.ends_with("interpolated"));
            assert!(!is_interpolated || !said.contains("left unpainted"), "{said}");
        }
        let report: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&out).expect("it was written")).expect("it is JSON");
        let made = report["volume"].as_f64().expect("a closed body has a volume");
        assert_near(made, volume, 0.02 * volume);
    }
}

#[test]
fn a_name_that_is_another_rois_number_stands_for_neither() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let planes = [0.0, 3.0];
    write(&[("2", tube(10.0, &planes)), ("1", tube(20.0, &planes)), ("3", tube(30.0, &planes))], &path);
    let (input, out) = (path.display().to_string(), |name: &str| place.path().join(name).display().to_string());
    for (number, radius) in [(1, 10.0), (2, 20.0), (3, 30.0)] {
        let stack = stack(&path, &[&format!("number={number}")]);
        assert_near(area(&stack, 0), disc(radius), 0.01 * disc(radius));
    }
    assert_near(area(&stack(&path, &["3"]), 0), disc(30.0), 0.01 * disc(30.0));
    assert_says(
        &said(&["inspect", &input, "--roi", "1"], 2),
        &["`1` may be any of 2 ROIs", "`number=2` or `number=1`"],
    );
    assert_says(&said(&["inspect", &input, "--roi", "number=4"], 2), &["must name one of the file's ROIs; got 4"]);
    // Numbers are what `--all-rois` and JSON say.
    said(&["reconstruct", &input, "--all-rois", "-o", &out("a.json"), "--backend", "cpu", "-q"], 0);
    let line = serde_json::json!({"id": "b", "input": input, "outputs": [out("b.json")], "options": {"roi": 1}});
    fs::write(out("m.jsonl"), line.to_string()).expect("a file can be written");
    said(&["batch", &out("m.jsonl"), "--backend", "cpu"], 0);
    for (file, radius) in [("a.2.json", 10.0), ("a.1.json", 20.0), ("a.3.json", 30.0), ("b.json", 10.0)] {
        let text = fs::read_to_string(out(file)).expect("the report is there");
        let report: serde_json::Value = serde_json::from_str(&text).expect("the report is JSON");
        let volume = report["volume"].as_f64().expect("it has the volume");
        assert_near(volume, 3.0 * disc(radius), 0.12 * disc(radius));
    }
}

#[test]
fn a_roi_that_cannot_be_read_leaves_the_others_be() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let (input, out) = (path.display().to_string(), |name: &str| place.path().join(name).display().to_string());
    let mut set = structure_set(&[("Bad", Vec::new()), ("Good", tube(10.0, &[0.0, 3.0]))]);
    let drawn = set.element(tags::ROI_CONTOUR_SEQUENCE).expect("it is there").items().expect("a sequence");
    let bad = InMemDicomObject::from_element_iter([
        text(tags::REFERENCED_ROI_NUMBER, VR::IS, "1"),
        sequence(tags::CONTOUR_SEQUENCE, vec![contour(CLOSED, 3, r"0\0\0\1\NaN\0\2\2\0")]),
    ]);
    let items = vec![bad, drawn[1].clone()];
    set.put(sequence(tags::ROI_CONTOUR_SEQUENCE, items));
    write_as(set, uids::EXPLICIT_VR_LITTLE_ENDIAN, &path);
    let why = "ROI 1 (`Bad`), contour 1: Contour Data: value 5 is `NaN`";
    assert_says(&said(&["inspect", &input], 0), &["ROI 1 (`Bad`): cannot be read", why, "ROI 2 (`Good`): 2 contours"]);
    assert_says(&said(&["reconstruct", &input, "--roi", "Bad", "-o", &out("a.json")], 2), &["a.dcm", why]);
    assert_near(area(&stack(&path, &["Good"]), 0), disc(10.0), 0.01 * disc(10.0));
    let says = said(&["reconstruct", &input, "--all-rois", "-o", &out("a.json"), "--backend", "cpu"], 0);
    assert_says(&says, &["ROI 1 (`Bad`): left out", why]);
    assert!(place.path().join("a.Good.json").exists() && !place.path().join("a.Bad.json").exists());
}

#[test]
fn a_batch_takes_rois_and_pixels_and_a_template_names_every_roi_that_can_be_made() {
    let place = folder();
    let of = |name: &str| place.path().join(name).display().to_string();
    let open = vec![("OPEN_PLANAR", circle(5.0, 0.0)), ("OPEN_PLANAR", circle(5.0, 2.0))];
    let planes = [0.0, 2.0, 4.0];
    let set = [("wide", tube(12.0, &planes)), ("line", open), ("slim", tube(6.0, &planes)), ("none", Vec::new())];
    fs::create_dir(of("in")).expect("a folder can be made");
    write(&set, &place.path().join("in/set.dcm"));

    let told = said(&["batch", "--template", &of("in"), &of("t.jsonl"), "--ext", "json,dcm"], 0);
    assert_says(&told, &["set: ROI 2 (`line`): left out", "OPEN_PLANAR", "set: ROI 4 (`none`): left out, not drawn"]);
    let text = fs::read_to_string(of("t.jsonl")).expect("it is there");
    let lines: Vec<serde_json::Value> = text.lines().map(|l| serde_json::from_str(l).expect("JSON")).collect();
    let named: Vec<_> = lines.iter().map(|l| (l["id"].as_str(), l["options"]["roi"].as_i64())).collect();
    assert_eq!(named, [(Some("set-1"), Some(1)), (Some("set-3"), Some(3))]);
    said(&["batch", &of("t.jsonl"), "--backend", "cpu"], 0);
    let volume = |file: &str| -> f64 {
        let text = fs::read_to_string(of(file)).expect("the report is there");
        let report: serde_json::Value = serde_json::from_str(&text).expect("the report is JSON");
        report["volume"].as_f64().expect("it has the volume")
    };
    assert_near(volume("out/set-1.json"), 4.0 * disc(12.0), 0.04 * disc(12.0));
    assert_near(volume("out/set-3.json"), 4.0 * disc(6.0), 0.04 * disc(6.0));
    let before = contours_of(&place.path().join("in/set.dcm"));
    let after = contours_of(&place.path().join("out/set-3.dcm"));
    let counts = |rois: &[Vec<(String, String)>]| rois.iter().map(Vec::len).collect::<Vec<_>>();
    assert_eq!((counts(&before), counts(&after)), (vec![3, 2, 3, 0], vec![3, 2, 5, 0]));

    let json = r#"{"id": "a", "input": "in/set.dcm", "outputs": ["a.json", "a.contours.json"], "options": {"roi": "slim", "pixel": 0.5}}
{"id": "b", "input": "in/set.dcm", "outputs": ["b.json", "b.contours.json"], "options": {"roi": ["1", "slim"], "pixel": 1}}
"#;
    fs::write(of("m.jsonl"), json).expect("a file can be written");
    said(&["batch", &of("m.jsonl"), "--backend", "cpu"], 0);
    assert_near(volume("a.json"), 4.0 * disc(6.0), 0.04 * disc(6.0));
    assert_near(volume("b.json"), 4.0 * disc(12.0), 0.04 * disc(12.0));
    let first = fs::read(of("a.contours.json")).expect("it is there");
    let drawn = fs::read_to_string(of("a.contours.json")).expect("it is there");
    assert!(drawn.contains("\"spacing_xy\":[0.5,0.5]"), "{}", &drawn[..80]);

    let csv = "id,input,outputs,options\na,in/set.dcm,a.contours.json,roi=slim;pixel=0.5\n";
    fs::write(of("m.csv"), csv).expect("a file can be written");
    said(&["batch", &of("m.csv"), "--backend", "cpu"], 0);
    assert_eq!(fs::read(of("a.contours.json")).expect("it is there"), first, "CSV says the same");

    fs::write(of("bad.jsonl"), json.replace("0.5", "-1")).expect("a file can be written");
    assert_says(&said(&["batch", &of("bad.jsonl"), "--backend", "cpu"], 2), &["pixel", "-1"]);
}

#[test]
fn a_roi_on_one_plane_can_be_inspected() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let input = path.display().to_string();
    let one = ("Flat", tube(10.0, &[3.0]));
    write(std::slice::from_ref(&one), &path);
    let says = "ROI 1 (`Flat`): 1 contours, cannot be reconstructed";
    assert_says(&said(&["inspect", &input], 0), &[says, "drawn on 1 plane; at least 2 are needed"]);
    write(&[one, ("Tube", tube(10.0, &[0.0, 3.0]))], &path);
    assert_says(&said(&["inspect", &input], 0), &[says, "ROI 2 (`Tube`): 2 contours on 2 planes"]);
    assert_says(&said(&["inspect", &input, "--roi", "Flat"], 0), &[says]);
    assert_says(&said(&["reconstruct", &input, "--roi", "Flat", "-o", "a.stl"], 2), &["drawn on 1 plane"]);
}

/// Many programs write UTF-8 and do not say so.
#[test]
fn names_that_are_utf_8_are_read_so_where_no_character_set_is_said() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let utf_8 = "H\u{fc}ft-\u{143}".as_bytes();
    for (set, bytes, name) in [
        (None, utf_8, "H\u{fc}ft-\u{143}"),
        (Some("ISO_IR 6"), utf_8, "H\u{fc}ft-\u{143}"),
        (Some("ISO_IR 6"), &b"H\xfcft-K "[..], "H\u{fc}ft-K"),
        (Some("ISO_IR 100"), &b"H\xfcft-K "[..], "H\u{fc}ft-K"),
        // Said is said.
        (Some("ISO_IR 100"), &b"\xc3\xbcber"[..], "\u{c3}\u{bc}ber"),
    ] {
        let mut object = structure_set(&[(&"X".repeat(bytes.len()), tube(10.0, &[0.0, 3.0]))]);
        if let Some(set) = set {
            object.put(text(tags::SPECIFIC_CHARACTER_SET, VR::CS, set));
        }
        write_as(object, uids::EXPLICIT_VR_LITTLE_ENDIAN, &path);
        let file = fs::read(&path).expect("it was written");
        let at = file.windows(4).position(|w| w == b"XXXX").expect("the name");
        let named = [&file[..at], bytes, &file[at + bytes.len()..]].concat();
        fs::write(&path, named).expect("it is written");
        assert_says(&said(&["inspect", &path.display().to_string()], 0), &[&format!("ROI 1 (`{name}`)")]);
    }
}
