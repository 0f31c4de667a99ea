//! Several bodies of an input, each by itself: in `evaluate`, `inspect`, `plan`, and as lines of a manifest.

use std::fs;
use std::path::Path;

use crate::files::*;
use serde_json::Value;

/// Two bodies that are drawn on every second slice, and one that is on a single slice; named as 3D Slicer names them.
fn labels(path: &Path) {
    let value = |n: usize| {
        let (k, j, i) = (n / 600, n / 30 % 20, n % 30);
        let near = |x: f64, r: f64| (i as f64 - x).hypot(j as f64 - 9.5) < r;
        match k % 2 {
            0 if near(8.0, 5.0 - 0.2 * k as f64) => 1,
            0 if near(21.0, 3.0 + 0.2 * k as f64) => 2,
            0 if k == 4 && i == 29 => 7,
            _ => 0,
        }
    };
    let bytes: Vec<u8> = (0..9 * 600).map(value).collect();
    let segment =
        |k: usize, label: usize, name: &str| format!("Segment{k}_LabelValue:={label}\nSegment{k}_Name:={name}");
    let header =
        format!("spacings: 1 1 1.5\nencoding: raw\n{}\n{}", segment(0, 1, "liver"), segment(1, 2, "left kidney"));
    fs::write(path, nrrd(&header, "uchar", [30, 20, 9], &bytes)).expect("a file can be written");
}

#[track_caller]
fn said(arguments: &[&str], code: i32) -> String {
    let output = interslice(arguments);
    let text = format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
    assert_eq!(output.status.code(), Some(code), "{text}");
    text
}

#[track_caller]
fn assert_says(text: &str, wanted: &[&str]) {
    wanted.iter().for_each(|w| assert!(text.contains(w), "{text}\nlacks: {w}"));
}

#[test]
fn labels_are_evaluated_described_and_planned_one_by_one() {
    let place = folder();
    let [input, out] = ["in.nrrd", "scores.json"].map(|name| place.path().join(name).display().to_string());
    labels(Path::new(&input));
    let told = said(&["evaluate", &input, "--labels", "all", "--backend", "cpu", "-o", &out], 0);
    assert_says(
        &told,
        &["label 1 (`liver`)", "label 2 (`left kidney`)", "label 7: left out", "slices left out, one in 2: Dice 0."],
    );
    let scores: Value = serde_json::from_slice(&fs::read(&out).expect("it was written")).expect("JSON");
    let names: Vec<&str> =
        scores.as_array().expect("a list").iter().map(|s| s["name"].as_str().expect("a name")).collect();
    assert_eq!(names, ["label 1 (`liver`)", "label 2 (`left kidney`)"]);
    for (member, label) in ["liver", "2"].into_iter().enumerate() {
        let alone = said(&["evaluate", &input, "--label", label, "--backend", "cpu", "--json"], 0);
        let alone: Value =
            serde_json::from_str(&alone[alone.find('{').expect("JSON")..alone.rfind('}').expect("JSON") + 1])
                .expect("JSON");
        let (scores, alone) = (&scores[member]["slices"], &alone["slices"]);
        assert!(alone[0]["dice"].as_f64().is_some_and(|dice| dice > 0.8) && scores == alone, "{scores} or {alone}");
    }
    assert_says(
        &said(&["evaluate", &input, "--labels", "spleen"], 2),
        &["`labels` must name one", "1 `liver`, 2 `left kidney`"],
    );
    assert_says(
        &said(&["evaluate", &input, "--labels", "1", "--links", "l.json"], 2),
        &["`links` are not for several bodies"],
    );
    let told = said(&["inspect", &input, "--labels", "left kidney,1"], 0);
    assert_says(&told, &["label 1 (`liver`)\n", "label 2 (`left kidney`)\n", "slice 4 (`k=8`)"]);
    assert_eq!(told.matches("slices lie along z").count(), 1, "{told}");
    let told = said(&["plan", &input, "--parts", "2", "--labels", "all"], 0);
    assert_says(
        &told,
        &[
            "label 2 (`left kidney`)\npart 1/2: ",
            &format!("each: interslice run {input} --label 2 --part K/2 -o K.section"),
        ],
    );
    let json = said(&["plan", &input, "--parts", "2", "--labels", "1,2", "--json"], 0);
    let plan: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!((plan[1]["option"].as_str(), plan[1]["parts"].as_array().map(Vec::len)), (Some("--label 2"), Some(2)));
}

/// What is said of the file is not what is said of its first label.
#[test]
fn painted_slices_of_a_file_are_those_of_all_its_labels() {
    let place = folder();
    let input = place.path().join("in.nrrd").display().to_string();
    let value = |n: usize| {
        let (k, j, i) = (n / 600, n / 30 % 20, n % 30);
        let near = |x: f64| (i as f64 - x).hypot(j as f64 - 9.5) < 4.0;
        match k {
            0 | 2 | 4 if near(8.0) => 1,
            4 | 6 | 8 if near(21.0) => 2,
            _ => 0,
        }
    };
    let bytes: Vec<u8> = (0..9 * 600).map(value).collect();
    fs::write(&input, nrrd("spacings: 1 1 1.5\nencoding: raw", "uchar", [30, 20, 9], &bytes)).expect("it is written");
    for wanted in ["all", "2", "1,2"] {
        let told = said(&["inspect", &input, "--labels", wanted], 0);
        let (file, labels) = told.split_once("\n\n").expect("a header");
        assert!(file.contains("painted: 5 of 9 slices: 0, 2, 4, 6, 8"), "{wanted}: {told}");
        let slices = 3 * if wanted == "2" { 1 } else { 2 };
        assert_eq!(labels.matches("1 part, 0 holes").count(), slices, "{wanted}: {told}");
    }
}

/// Links between slices that are both kept count; the others are told of.
#[test]
fn links_are_used_where_their_slices_are_kept() {
    let place = folder();
    for k in 0..7u32 {
        let disc = |x: u32, y: u32| (f64::from(x) - 8.0 - 5.0 * f64::from(k % 3 / 2)).hypot(f64::from(y) - 8.0) < 2.4;
        let image = image::GrayImage::from_fn(24, 16, |x, y| image::Luma([255 * u8::from(disc(x, y))]));
        image.save(place.path().join(format!("s{k}.png"))).expect("a PNG can be written");
    }
    let slices: Vec<String> = (0..7).map(|k| format!("{{\"file\": \"s{k}.png\", \"z\": {k}}}")).collect();
    write_stack(place.path(), &format!("{{\"spacing_xy\": [1, 1], \"slices\": [{}]}}", slices.join(", ")));
    let links = place.path().join("links.json");
    // Every third slice is left out: 2 and 5; of these pairs 3 and 4 are both kept.
    fs::write(&links, r#"{"links": [{"slice": 3, "from": 1, "to": 1}, {"slice": 1, "from": 1, "to": 1}]}"#)
        .expect("a file can be written");
    let [input, links] = [place.path(), &links].map(|p| p.display().to_string());
    let told = said(&["evaluate", &input, "--leave", "3", "--links", &links, "--backend", "cpu", "--json"], 0);
    assert_says(&told, &["1 of 2 links name a slice that is left out, and count for nothing", "\"links\": 1"]);
    fs::write(&links, r#"{"links": [{"slice": 3, "from": 2, "to": 1}]}"#).expect("a file can be written");
    assert_says(&said(&["evaluate", &input, "--links", &links], 2), &["link 1: `from` must lie in [1, 1]"]);
}

/// The lines that `batch --dry-run` says would run.
fn batch(manifest: &Path, more: &[&str], code: i32) -> String {
    said(&[&["batch", &manifest.display().to_string(), "--backend", "cpu"], more].concat(), code)
}

#[test]
fn a_line_may_ask_for_labels_and_cells_be_separated_by_semicolons() {
    let place = folder();
    labels(&place.path().join("in.nrrd"));
    let manifest = place.path().join("m.csv");
    let write = |text: &str| fs::write(&manifest, text).expect("a file can be written");
    write(
        "id;input;outputs;options\na;in.nrrd;\"out/a.stl;out/a.nii.gz\";\"labels=all;keep_overlaps;mask\"\nb;in.nrrd;out/b.stl;label=left kidney\n",
    );
    assert_says(&batch(&manifest, &[], 0), &["warning: in.nrrd: label 7: left out, is drawn on 1 of the slices"]);
    for name in ["a.1.stl", "a.1.nii.gz", "a.2.stl", "a.2.nii.gz", "b.stl"] {
        assert!(place.path().join("out").join(name).is_file(), "{name}: {:?}", listing(&place.path().join("out")));
    }
    let [one, other] =
        ["a.2.stl", "b.stl"].map(|name| fs::read(place.path().join("out").join(name)).expect("it is there"));
    assert!(one == other, "label 2 by its number and by its name");
    assert_says(&batch(&manifest, &["--dry-run"], 0), &["a-1", "a-2", "b"]);
    for (options, says) in [
        (
            "labels=all",
            "line 2: options: `labels` makes a job for each label as it is alone: add `keep_overlaps` = true",
        ),
        ("keep_overlaps", "line 2: options: `keep_overlaps` is for `labels`"),
        ("labels=spleen;keep_overlaps", "line 2: input: `labels` must name one of the file's labels; got `spleen`"),
        ("labels=1;keep_overlaps;label=1", "line 2: options: `labels` and `label` cannot be used together"),
        ("all_rois=3", "line 2: options: `all_rois` must be true or false; got 3"),
        ("labels=1;keep_overlaps;fair=x", "line 2: options: `fair`"),
    ] {
        write(&format!("id,input,outputs,options\na,in.nrrd,out/a.stl,{options}\n"));
        assert_says(&batch(&manifest, &["--dry-run"], 2), &[says]);
    }
}

#[cfg(feature = "dicom")]
#[test]
fn rois_are_evaluated_planned_and_made_one_by_one() {
    let place = folder();
    let input = place.path().join("in.dcm");
    let planes: Vec<f64> = (0..7).map(|k| 3.0 * f64::from(k)).collect();
    crate::rtss::write(
        &[
            ("Heart", crate::rtss::tube(9.0, &planes)),
            ("Left lung", crate::rtss::tube(14.0, &planes)),
            ("flat", crate::rtss::tube(5.0, &[3.0])),
        ],
        &input,
    );
    let path = input.display().to_string();
    let scores = place.path().join("scores.json");
    let out = scores.display().to_string();
    let told = said(&["evaluate", &path, "--all-rois", "--pixel", "1", "--backend", "cpu", "-o", &out], 0);
    let scores: Value = serde_json::from_slice(&fs::read(&scores).expect("it was written")).expect("JSON");
    let area = |roi: usize| scores[roi]["slices"][0]["pixels"][0].as_f64().expect("pixels of the truth");
    // The radii are 9 and 14.
    assert!((area(1) / area(0) - (14.0f64 / 9.0).powi(2)).abs() < 0.1, "{} and {}", area(1), area(0));
    assert_says(&told, &["ROI 1 (`Heart`)", "ROI 2 (`Left lung`)", "ROI 3 (`flat`): left out"]);
    let told = said(&["plan", &path, "--all-rois", "--parts", "1"], 0);
    assert_says(&told, &[&format!("each: interslice run {path} --roi 2 --part K/1")]);
    assert_says(&said(&["plan", &path, "--all-rois", "--roi", "1", "--parts", "1"], 2), &["cannot be used with"]);
    let manifest = place.path().join("m.jsonl");
    let line = r#"{"id": "a", "input": "in.dcm", "outputs": ["out/a.stl"], "options": {"all_rois": true, "pixel": 1}}"#;
    fs::write(&manifest, line).expect("a file can be written");
    assert_says(&batch(&manifest, &[], 0), &["warning: in.dcm: ROI 3 (`flat`): left out: "]);
    let names = ["a.Heart.stl", "a.Left_lung.stl"].map(|name| place.path().join("out").join(name));
    assert_eq!(listing(&place.path().join("out")), names);
    let folder_of = line.replace("in.dcm", "in.nrrd").replace(", \"pixel\": 1", "");
    labels(&place.path().join("in.nrrd"));
    fs::write(&manifest, folder_of).expect("a file can be written");
    assert_says(&batch(&manifest, &[], 2), &["line 1: options: `all_rois` is not for anything but an RTSTRUCT"]);
}
