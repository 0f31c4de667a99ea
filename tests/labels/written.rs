//! What the program writes of many labels, and what it refuses before anything runs.

use std::fs;
use std::path::Path;

use crate::files::*;
use crate::partitions::{volume, write};

fn text(path: &Path) -> &str {
    path.to_str().expect("temporary paths are UTF-8")
}

#[test]
fn a_run_writes_a_volume_and_a_mesh_per_label() {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    write(&at("in.nrrd"), &volume([1, 2, 3, 200]));
    let run = |arguments: &[&str]| {
        let done = interslice(&[&["reconstruct", text(&at("in.nrrd")), "--backend", "cpu"], arguments].concat());
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    };
    let (volume, mesh, report) = (at("out.nrrd"), at("out.stl"), at("out.json"));
    let all = ["--labels", "1,2,200", "-o", text(&volume), "-o", text(&mesh), "-o", text(&report)];
    let foretold = interslice(&[&["reconstruct", text(&at("in.nrrd")), "--dry-run"], &all[..]].concat());
    let foretold = String::from_utf8_lossy(&foretold.stdout).into_owned();
    assert_eq!(listing(place.path()), [at("in.nrrd")]);
    for name in ["out.1.stl", "out.2.stl", "out.200.stl", "out.json", "out.nrrd"] {
        let line = format!("would write: {}", text(&at(name)));
        assert!(foretold.lines().any(|said| said == line), "`{line}` is missing from:\n{foretold}");
    }
    assert!(foretold.contains("would make: label 200, of "), "{foretold}");
    run(&all);
    let names = ["in.nrrd", "out.1.stl", "out.2.stl", "out.200.stl", "out.json", "out.nrrd"].map(at);
    assert_eq!(listing(place.path()), names);
    let survey = interslice::input::survey(&volume).expect("the label volume can be read");
    assert_eq!(survey.labels.keys().copied().collect::<Vec<_>>(), [1, 2, 200]);
    let json: serde_json::Value = serde_json::from_slice(&fs::read(&report).expect("there is a report")).expect("JSON");
    for (k, label) in [1, 2, 200].into_iter().enumerate() {
        let entry = &json["labels"][k];
        assert_eq!(entry["label"], label);
        assert_eq!(entry["differing_pixels"], 0);
        assert_eq!(entry["voxels"].as_u64(), survey.labels.get(&i64::from(label)).copied());
        assert_eq!(entry["changed"], label != 200);
        assert!(entry["volume"].as_f64().is_some_and(|v| v > 100.0), "{entry}");
    }
    assert!(json["borders"]["gap_voxels"].as_u64().is_some_and(|n| n > 0), "{}", json["borders"]);

    // Alone, a label is what `--label` makes, and so it is where overlaps are kept.
    let (one, kept) = (at("one.stl"), at("kept.stl"));
    let (one_volume, kept_volume) = (at("one.nrrd"), at("kept.nrrd"));
    run(&["--label", "200", "--distance", "-o", text(&one), "-o", text(&one_volume)]);
    run(&["--labels", "1,200", "--keep-overlaps", "--distance", "-o", text(&kept), "-o", text(&kept_volume)]);
    let bytes = |path: &Path| fs::read(path).expect("it was written");
    assert!(bytes(&one) == bytes(&at("out.200.stl")));
    assert!(bytes(&one) == bytes(&at("kept.200.stl")));
    assert!(bytes(&one_volume) == bytes(&at("kept.200.nrrd")));
    run(&["--label", "1", "--distance", "-o", text(&one_volume)]);
    assert!(bytes(&one_volume) == bytes(&at("kept.1.nrrd")));
    run(&["--label", "200", "-o", text(&one_volume)]);
    run(&["--labels", "1,200", "--keep-overlaps", "-o", text(&kept_volume)]);
    assert!(bytes(&one_volume) == bytes(&at("kept.200.nrrd")));
    let alone = interslice::input::survey(&one_volume).expect("a mask can be read");
    assert_eq!(alone.labels.keys().copied().collect::<Vec<_>>(), [200]);
}

#[test]
fn wrong_labels_are_told_before_anything_runs() {
    let place = folder();
    let input = place.path().join("in.nrrd");
    let mut voxels = volume([1, 2, 3, 4]);
    voxels[0] = 5;
    write(&input, &voxels);
    let slices = place.path().join("slices");
    fs::create_dir(&slices).expect("a folder can be made");
    sound_stack(&slices);
    let empty = place.path().join("empty.nrrd");
    write(&empty, &vec![0; voxels.len()]);
    let before = listing(place.path());
    let out = place.path().join("out.nrrd");
    let picture = place.path().join("out.png");
    let cases: [(&Path, &[&str], &str); 18] = [
        (&input, &["--labels", "1,9"], "no label 9; labels are 1, 2, 3, 4, 5\n"),
        (&input, &["--labels", "1,5"], "label 5 is drawn on 1 of the slices"),
        (&input, &["--labels", "1,0"], "0 is the background"),
        (&input, &["--label", "0"], "`label` 0 is the background and no label"),
        (&slices, &["--label", "0"], "0 is the background and no label"),
        (&input, &["--label", "9"], "in.nrrd: has no label 9; labels are 1, 2, 3, 4, 5\n"),
        (&input, &["--label", "9", "--keep", "2"], "chosen slices has label 9; labels are 1, 2, 3, 4, 5\n"),
        (&empty, &[], "empty.nrrd: has no label: all voxels are 0"),
        (&empty, &["--label", "2"], "empty.nrrd: has no label 2: all voxels are 0"),
        (&empty, &["--labels", "2"], "empty.nrrd: has no label"),
        (
            &input,
            &["--labels", "1-3"],
            "must name one of the file's labels; got `1-3`; the file has no names; labels are 1, 2, 3, 4, 5\n",
        ),
        (&input, &["--labels", "1,2", "--label", "1"], "cannot be used with"),
        (&input, &["--keep-overlaps"], "--labels"),
        (&input, &["--label", "1", "--keep-overlaps"], "'--label <N|NAME>' cannot be used with '--keep-overlaps'"),
        (&input, &["--labels", "1,2", "--mask"], "`mask` is not for many labels"),
        (&input, &["--labels", "1,2", "--distance"], "`distance` is not for many labels"),
        (&input, &["--labels", "1,2", "-o", text(&picture)], "are of one body"),
        (&slices, &["--labels", "1"], "`labels` is not for a folder of slices"),
    ];
    for (path, arguments, expected) in cases {
        let wrong = interslice(&[&["reconstruct", text(path), "-o", text(&out)], arguments].concat());
        assert_eq!(wrong.status.code(), Some(2), "{arguments:?}: {}", stderr(&wrong));
        assert!(stderr(&wrong).contains(expected), "{arguments:?}: {}", stderr(&wrong));
        assert_eq!(listing(place.path()), before, "{arguments:?}");
    }
}

#[test]
fn a_folder_of_temporary_files_that_is_missing_is_named() {
    let place = folder();
    write(&place.path().join("in.nrrd"), &volume([1, 2, 3, 4]));
    let at = |name: &str| place.path().join(name).display().to_string();
    let result = std::process::Command::new(env!("CARGO_BIN_EXE_interslice"))
        .args(["reconstruct", &at("in.nrrd"), "--labels", "all", "-q", "--backend", "cpu", "-o", &at("out.nrrd")])
        .env("TMPDIR", at("gone"))
        .output()
        .expect("the program starts");
    assert_eq!(result.status.code(), Some(2), "{}", stderr(&result));
    let told = format!("{}: cannot write: no temporary file (", at("gone"));
    assert!(stderr(&result).contains(&told) && stderr(&result).contains("TMPDIR"), "{}", stderr(&result));
}
