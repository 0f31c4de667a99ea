//! RT structure sets in and out: files that this test writes itself.
#![cfg(feature = "dicom")]

#[path = "support/files.rs"]
mod files;
#[path = "support/rtss.rs"]
mod rtss;

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use dicom_object::{InMemDicomObject, open_file};
use files::*;
use glam::DVec3;
use interslice::ContourStack;
use interslice::input::read;
use interslice::stack::ReadOptions;
use rtss::*;

fn stack(path: &Path, roi: &[&str]) -> ContourStack {
    let roi = roi.iter().map(|r| (*r).to_string()).collect();
    read(path, &ReadOptions { roi, pixel: Some(0.5), ..ReadOptions::default() }).expect("the file is sound")
}

/// Area inside on slice `k`.
fn area(stack: &ContourStack, k: usize) -> f64 {
    let content = &stack.slices[k].content;
    (0..content.len()).filter(|n| content.inside(*n)).count() as f64 * stack.spacing[0] * stack.spacing[1]
}

fn disc(radius: f64) -> f64 {
    // A polygon of 90 corners.
    45.0 * (TAU / 90.0).sin() * radius * radius
}

fn assert_near(value: f64, wanted: f64, tolerance: f64) {
    assert!((value - wanted).abs() <= tolerance, "{value}, not {wanted}");
}

fn said(arguments: &[&str], code: i32) -> String {
    let output = interslice(arguments);
    assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
    format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output))
}

fn assert_says(text: &str, wanted: &[&str]) {
    wanted.iter().for_each(|w| assert!(text.contains(w), "{text}\nlacks: {w}"));
}

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

#[test]
fn inner_contours_are_holes_as_planar_xor_and_keyhole() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let ring = |kind, z| [(kind, circle(20.0, z)), (kind, circle(8.0, z))];
    let keyhole = |z: f64| {
        let (mut line, mut inner) = (circle(20.0, z), circle(8.0, z));
        line.push(line[0]);
        inner.push(inner[0]);
        inner.reverse();
        line.extend(inner);
        (CLOSED, line)
    };
    let rois = [
        ("planar", [ring(CLOSED, 0.0), ring(CLOSED, 4.0)].concat()),
        ("xor", [ring("CLOSEDPLANAR_XOR", 0.0), ring("CLOSEDPLANAR_XOR", 4.0)].concat()),
        ("keyhole", vec![keyhole(0.0), keyhole(4.0)]),
    ];
    write(&rois, &path);
    let wanted = disc(20.0) - disc(8.0);
    let all = ["planar", "xor", "keyhole"].map(|roi| stack(&path, &[roi]));
    for ring in &all {
        assert_near(area(ring, 0), wanted, 0.01 * wanted);
        let sides = |s: &ContourStack| {
            (0..s.slices[0].content.len()).map(|n| s.slices[0].content.inside(n)).collect::<Vec<_>>()
        };
        assert_eq!(sides(ring), sides(&all[0]));
    }
    let listed = said(&["inspect", &path.display().to_string()], 0);
    assert_says(
        &listed,
        &["3 ROIs", "2 contours are holes", "4 contours (XOR) on 2 planes (axial)", "1 gap of 4 mm", "no holes"],
    );
}

#[test]
fn planes_are_found_from_points_with_noise_and_uneven_gaps() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let noisy = |z: f64| {
        let points = circle(10.0, z).into_iter().enumerate();
        points.map(|(k, [x, y, z])| [x, y, z + 0.02 * (k as f64).sin()]).collect::<Points>()
    };
    let far = |z: f64| circle(5.0, z).into_iter().map(|[x, y, z]| [x + 40.0, y, z + 0.04]).collect::<Points>();
    let contours = vec![(CLOSED, noisy(9.5)), (CLOSED, noisy(0.0)), (CLOSED, far(0.0)), (CLOSED, noisy(2.5))];
    write(&[("a", contours)], &path);
    let stack = stack(&path, &[]);
    let heights: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
    assert_eq!(heights.len(), 3);
    [0.02, 2.5, 9.5].into_iter().zip(&heights).for_each(|(w, z)| assert_near(*z, w, 0.01));
    assert_near(area(&stack, 0), disc(10.0) + disc(5.0), 5.0);
    assert_says(&said(&["inspect", &path.display().to_string()], 0), &["3 planes", "1 gap of 2.4", "1 gap of 7"]);
    // Noise beyond the tolerance is told.
    let bent = circle(10.0, 5.0).into_iter().enumerate().map(|(k, [x, y, z])| [x, y, z + 0.01 * k as f64]).collect();
    write(&[("a", vec![(CLOSED, circle(9.0, 0.0)), (CLOSED, bent)])], &path);
    let refused = said(&["inspect", &path.display().to_string()], 2);
    assert_says(&refused, &["a.dcm", "ROI 1 (`a`), contour 2", "leaves its plane", "at most 0.1 mm"]);
}

#[test]
fn oblique_planes_have_their_own_frame_and_meshes_lie_in_the_patient() {
    let place = folder();
    let path = place.path().join("a.dcm");
    // A tube along n, drawn on planes across it, rounded to 0.01 mm as planning systems do.
    let n = DVec3::new(0.36, 0.48, 0.8);
    let (u, v) = (DVec3::new(0.8, -0.6, 0.0), DVec3::new(0.48, 0.64, -0.6));
    let start = DVec3::new(12.0, -230.0, 88.0);
    let ring = |h: f64| -> Points {
        (0..120)
            .map(|k| {
                let t = TAU * k as f64 / 120.0;
                let p = start + h * n + 15.0 * (t.cos() * u + t.sin() * v);
                ((p * 100.0).round() / 100.0).to_array()
            })
            .collect()
    };
    write(&[("tube", [0.0, 5.0, 10.0, 20.0].map(|h| (CLOSED, ring(h))).to_vec())], &path);
    let out = place.path().join("a.obj");
    let text = said(&["inspect", &path.display().to_string()], 0);
    assert_says(&text, &["oblique, normal (0.36", "4 planes"]);
    said(&["reconstruct", &path.display().to_string(), "-o", &out.display().to_string(), "-q", "--backend", "cpu"], 0);
    let mesh = fs::read_to_string(&out).expect("it was written");
    let vertices: Vec<DVec3> = mesh
        .lines()
        .filter_map(|l| l.strip_prefix("v "))
        .map(|l| {
            let v: Vec<f64> = l.split_whitespace().take(3).map(|t| t.parse().expect("a number")).collect();
            DVec3::from_slice(&v)
        })
        .collect();
    assert!(vertices.len() > 1000);
    for p in &vertices {
        let along = (p - start).dot(n);
        let from_axis = (p - start).reject_from_normalized(n).length();
        assert!((-0.05..20.05).contains(&along), "{p:?} lies at {along}");
        // Lids lie inside.
        let lid = !(0.05..=19.95).contains(&along);
        assert!(from_axis < 15.15 && (lid || from_axis > 14.85), "{p:?} is {from_axis} from the axis");
    }
}

#[test]
fn short_contours_are_left_out_by_name_and_open_ones_refused() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let mut contours = tube(10.0, &[0.0, 3.0]);
    contours.push((CLOSED, vec![[1.0, 2.0, 6.0]]));
    contours.push((CLOSED, vec![[1.0, 2.0, 6.0], [2.0, 2.0, 6.0]]));
    let points = vec![("POINT", vec![[0.0, 0.0, 0.0]])];
    let open = [tube(10.0, &[0.0, 3.0]), vec![("OPEN_PLANAR", circle(4.0, 6.0))]].concat();
    write(&[("a", contours), ("marker", points), ("line", open), ("flat", tube(5.0, &[1.0])), ("none", vec![])], &path);
    let input = path.display().to_string();
    let listed = said(&["inspect", &input], 0);
    assert_says(
        &listed,
        &["ROI 1 (`a`), contour 3: left out, 1 point", "contour 4: left out, 2 points", "on 2 planes"],
    );
    assert_says(
        &listed,
        &["ROI 2 (`marker`)", "is POINT", "contour 3 is OPEN_PLANAR", "drawn on 1 plane; at", "not drawn"],
    );
    let out = place.path().join("a.stl").display().to_string();
    let told = said(&["reconstruct", &input, "--roi", "a", "-o", &out, "--backend", "cpu"], 0);
    assert_says(&told, &["warning: ROI 1 (`a`), contour 3: left out, 1 point"]);
    assert_says(
        &said(&["reconstruct", &input, "--roi", "marker", "-o", &out], 2),
        &["ROI 2 (`marker`), contour 1 is POINT"],
    );
    assert_says(&said(&["reconstruct", &input, "--roi", "line", "-o", &out], 2), &["contour 3 is OPEN_PLANAR"]);
    assert_says(&said(&["reconstruct", &input, "--roi", "none", "-o", &out], 2), &["0 planes; at least 2"]);
    // All at once: what cannot be done is told, the rest is done.
    let before = listing(place.path());
    let foretold = said(&["reconstruct", &input, "--all-rois", "-o", &out, "--backend", "cpu", "--dry-run"], 0);
    assert_eq!(listing(place.path()), before);
    let told = said(&["reconstruct", &input, "--all-rois", "-o", &out, "--backend", "cpu"], 0);
    for written in listing(place.path()).iter().filter(|path| !before.contains(path)) {
        assert_says(&foretold, &[&format!("would write: {}", written.display())]);
    }
    assert_says(&told, &["ROI 2 (`marker`): left out", "ROI 3 (`line`): left out", "a.a.stl"]);
    assert!(place.path().join("a.a.stl").is_file() && !place.path().join("a.line.stl").exists());
}

/// Type and Contour Data of every contour, by ROI.
fn contours_of(path: &Path) -> Vec<Vec<(String, String)>> {
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

#[test]
fn planes_can_be_chosen() {
    let place = folder();
    let path = place.path().join("a.dcm");
    write(&[("a", tube(10.0, &[0.0, 3.0, 6.0, 9.0, 12.0]))], &path);
    let heights =
        |options: ReadOptions| read(&path, &options).map(|s| s.slices.iter().map(|s| s.z).collect::<Vec<_>>());
    let of = |slices: &[usize]| ReadOptions { slices: Some(slices.to_vec()), ..ReadOptions::default() };
    assert_eq!(heights(of(&[4, 0, 2])).expect("they are there"), [0.0, 6.0, 12.0]);
    assert_eq!(heights(ReadOptions { keep: Some(3), ..ReadOptions::default() }).expect("they are there"), [0.0, 9.0]);
    assert!(heights(of(&[0, 5])).expect_err("there is no plane 5").to_string().contains("planes 0 to 4; got 5"));
    assert!(heights(of(&[1])).expect_err("one is too few").to_string().contains("at least 2"));
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

    said(&["batch", "--template", &of("in"), &of("t.jsonl"), "--ext", "json,dcm"], 0);
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
    let mut stray = sound();
    let roi = InMemDicomObject::from_element_iter([text(tags::REFERENCED_ROI_NUMBER, VR::IS, "7")]);
    stray.put(sequence(tags::ROI_CONTOUR_SEQUENCE, vec![roi]));
    refused(stray, &["Referenced ROI Number 7"]);
    let huge = circle(1e200, 0.0);
    write(&[("a", vec![(CLOSED, huge), (CLOSED, circle(10.0, 3.0))])], &path);
    said(&["inspect", &input, "--pixel", "1"], 2);
    fs::write(&path, "no DICOM at all").expect("a file can be written");
    assert_says(&said(&["inspect", &input], 2), &["is no DICOM file"]);
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
