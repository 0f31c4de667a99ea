//! Labels that cannot be reconstructed, or of which others leave nothing, are left out and told (P13).

use std::fs;
use std::path::Path;

use crate::files::*;
use crate::own_slices::{Disc, SIZES, TENS, alternating, text, volume, write};

/// A label in which no output layer lies is left out before anything is computed, and the others are as without it; where it is asked for by
/// name that is an error, and where none is left.
#[test]
fn p13_a_label_between_the_output_layers_is_left_out() {
    let long = Disc { label: 1, at: [20.0, 24.0], radius: 8.0, slices: &TENS };
    let thin = Disc { label: 2, at: [44.0, 24.0], radius: 9.0, slices: &[13, 14, 15] };
    let place = folder();
    let [both, alone] = ["both.nrrd", "alone.nrrd"].map(|name| place.path().join(name));
    write(&both, &volume(&[long, thin]));
    write(&alone, &volume(&[long]));
    let run = |input: &Path, labels: &str, out: &str, more: &[&str]| {
        let [input, out] = [input, &place.path().join(out)].map(|p| p.display().to_string());
        interslice(&[&["reconstruct", &input, "--labels", labels, "-o", &out, "--backend", "cpu"], more].concat())
    };
    let coarse = ["--dz", "10"];
    let done = run(&both, "all", "both.npy", &coarse);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let says = "label 2: left out, output heights 0 to 30 meet no part of the body, which lies in 13 to 15";
    assert!(stderr(&done).contains(says), "{}", stderr(&done));
    let done = run(&alone, "all", "alone.npy", &coarse);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let voxels = ["both.npy", "alone.npy"].map(|name| fs::read(place.path().join(name)).expect("it was written"));
    assert!(voxels[0] == voxels[1]);
    let done = run(&both, "1,2", "named.npy", &coarse);
    assert_eq!(done.status.code(), Some(2), "{}", stderr(&done));
    assert!(stderr(&done).contains("label 2: output heights 0 to 30 meet no part"), "{}", stderr(&done));
    write(&alone, &volume(&[thin]));
    // Its own slices are the first: a step of 10 meets the lowest of them, but not a grid that lies elsewhere.
    let done = run(&alone, "all", "thin.npy", &coarse);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    // A layer in it is enough.
    let done = run(&both, "all", "fine.npy", &["--dz", "7"]);
    assert!(done.status.success() && !stderr(&done).contains("left out"), "{}", stderr(&done));
}

#[test]
fn p13_of_all_labels_those_that_cannot_be_done_are_left_out() {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    let mut voxels = alternating(22.0);
    voxels[10 * SIZES[0] * SIZES[1] + 3] = 9;
    write(&at("in.nrrd"), &voxels);
    let (input, out, report) = (at("in.nrrd"), at("out.nrrd"), at("out.json"));
    let run = |labels: &str| {
        let paths = ["-o", text(&out), "-o", text(&report), "--backend", "cpu"];
        interslice(&[&["reconstruct", text(&input), "--labels", labels], &paths[..]].concat())
    };
    let done = run("all");
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let says =
        "label 9: left out, is drawn on 1 of the slices, at least 2 are needed; with `--complete-slices` it ends";
    assert!(stderr(&done).contains(says), "{}", stderr(&done));
    assert!(stderr(&done).contains("; a label volume has it there as it is painted"), "{}", stderr(&done));
    // What is painted stays.
    let survey = interslice::input::survey(&out).expect("the label volume can be read");
    assert_eq!(survey.labels.into_iter().collect::<Vec<_>>()[2], (9, 1));
    let json: serde_json::Value = serde_json::from_slice(&fs::read(&report).expect("there is a report")).expect("JSON");
    assert_eq!(json["left_out"][0]["label"], 9);
    assert_eq!(json["labels"].as_array().map(Vec::len), Some(2));
    // Where no layer lies it cannot.
    let between = interslice(&[
        "reconstruct",
        text(&input),
        "--labels",
        "all",
        "-o",
        text(&out),
        "--dz",
        "3",
        "--backend",
        "cpu",
    ]);
    assert!(stderr(&between).contains("; no output layer lies there, at 10"), "{}", stderr(&between));
    assert!(!interslice::input::survey(&out).expect("the label volume can be read").labels.contains_key(&9));
    // Nor does a template have a line for it, which it says; and of an empty volume.
    write(&at("none.nrrd"), &vec![0; SIZES.iter().product()]);
    let template = interslice(&["batch", "--template", text(place.path()), "--each-label"]);
    let lines = String::from_utf8_lossy(&template.stdout).into_owned();
    assert!(lines.contains("in-1") && lines.contains("in-2") && !lines.contains("in-9"), "{lines}");
    assert!(!lines.contains("none"), "{lines}");
    for told in ["warning: in: label 9 drawn on one slice: left out", "warning: none: has no label: left out"] {
        assert!(stderr(&template).contains(told), "{}", stderr(&template));
    }
    // As it says.
    let paths = ["-o", text(&out), "--backend", "cpu", "--complete-slices"];
    let complete = interslice(&[&["reconstruct", text(&input), "--labels", "all"], &paths[..]].concat());
    assert_eq!(complete.status.code(), Some(0), "{}", stderr(&complete));
    assert!(!stderr(&complete).contains("left out"), "{}", stderr(&complete));
    // Who names it is told.
    let named = run("1,9");
    assert_eq!(named.status.code(), Some(2));
    assert!(stderr(&named).contains("label 9 is drawn on 1 of the slices"), "{}", stderr(&named));
    // None is left.
    let only = Disc { label: 3, at: [20.0, 24.0], radius: 8.0, slices: &[4] };
    write(&input, &volume(&[only, Disc { label: 4, at: [20.0, 24.0], radius: 8.0, slices: &[9] }]));
    let none = run("all");
    assert_eq!(none.status.code(), Some(2));
    assert!(stderr(&none).contains("none of its labels can be reconstructed: label 3"), "{}", stderr(&none));
}

#[test]
fn a_label_of_which_others_leave_nothing_is_told() {
    let place = folder();
    let (all, some): (Vec<usize>, Vec<usize>) = ((0..31).collect(), (0..31).step_by(5).collect());
    for (x, told) in [(22.0, true), (52.0, false)] {
        let discs = [
            Disc { label: 2, at: [22.0, 24.0], radius: 15.0, slices: &all },
            Disc { label: 1, at: [x, 24.0], radius: 6.0, slices: &some },
        ];
        let [input, output] = ["in.nrrd", "out.nrrd"].map(|name| place.path().join(name));
        write(&input, &volume(&discs));
        let done = interslice(&["reconstruct", text(&input), "--labels", "all", "-o", text(&output)]);
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
        let said = stderr(&done);
        let of = |label: u8| said.contains(&format!("label {label}: others leave"));
        assert_eq!([of(1), of(2)], [told, false], "{said}");
    }
}
