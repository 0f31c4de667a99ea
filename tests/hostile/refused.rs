//! Wrong input: a clear error that names file, slice, value and limit, before anything is computed; exit code 2; nothing written,
//! nothing the user had is lost.

use std::fs;
use std::path::Path;

use crate::files::*;

/// Runs `reconstruct` on `input` with an old output in place; checks exit code, message and that nothing changed.
fn refused(input: &Path, options: &[&str], says: &[&str]) {
    let out = folder();
    let target = out.path().join("out.nrrd");
    fs::write(&target, "what the user had").expect("a file can be written");
    let (input, target_name) = (input.display().to_string(), target.display().to_string());
    let mut arguments = vec!["reconstruct", &input, "-o", &target_name];
    arguments.extend(options);
    let result = interslice(&arguments);
    let message = stderr(&result);
    assert_eq!(result.status.code(), Some(2), "{arguments:?}: {message}");
    for part in says {
        assert!(message.contains(part), "`{part}` is missing from: {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
    assert_eq!(fs::read_to_string(&target).expect("the old output is there"), "what the user had");
    assert_eq!(listing(out.path()), [target], "no half-written output");
}

/// The sound stack with `from` replaced by `to` in its stack.json.
fn spoilt(from: &str, to: &str, says: &[&str]) {
    let input = folder();
    let text = sound_stack(input.path());
    assert!(text.contains(from), "the test must change something: {from}");
    write_stack(input.path(), &text.replacen(from, to, 1));
    refused(input.path(), &[], says);
}

#[test]
fn the_sound_stack_is_taken() {
    let input = folder();
    sound_stack(input.path());
    let target = input.path().join("out.stl").display().to_string();
    let result = interslice(&["reconstruct", &input.path().display().to_string(), "-o", &target]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
}

/// Windows editors begin a text with the mark of its encoding.
#[test]
fn a_byte_order_mark_is_no_part_of_a_text() {
    let input = folder();
    let text = sound_stack(input.path());
    let at = |name: &str| input.path().join(name).display().to_string();
    let marked =
        |name: &str, text: &str| fs::write(at(name), format!("\u{feff}{text}")).expect("a file can be written");
    marked("stack.json", &text);
    marked("settings.toml", "fair = 0.5\n");
    marked("links.json", "{\"links\": []}");
    let (settings, links, target) = (at("settings.toml"), at("links.json"), at("out.stl"));
    let folder = input.path().display().to_string();
    let result = interslice(&["reconstruct", &folder, "--settings", &settings, "--links", &links, "-o", &target]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
}

#[test]
fn no_such_input() {
    refused(Path::new("no/such/folder"), &[], &["no/such/folder", "cannot read"]);
    let empty = folder();
    refused(empty.path(), &[], &["has neither stack.json nor images, masks or DICOM files"]);
    let other = empty.path().join("notes.txt");
    fs::write(&other, "hello").expect("a file can be written");
    refused(&other, &[], &["notes.txt", "expected a folder with stack.json"]);
}

#[test]
fn broken_json_is_told_with_its_line() {
    spoilt("\"slices\": [", "\"slices\": [,", &["stack.json", "line 3"]);
    spoilt("\"z\": 4.0", "\"z\": \"four\"", &["stack.json: slices[1].z: ", "line 5", "string \"four\""]);
    spoilt("\"z\": 4.0", "\"z\": NaN", &["stack.json: slices[1].z: ", "line 5"]);
    spoilt("\"z\": 4.0", "\"z\": null", &["stack.json: slices[1].z: ", "line 5", "null"]);
}

#[test]
fn unknown_and_missing_fields() {
    spoilt("\"slices\"", "\"colour\": 1, \"slices\"", &["stack.json", "unknown field `colour`", "line 3"]);
    spoilt("\"z\": 4.0", "\"z\": 4.0, \"hidden\": true", &["unknown field `hidden`"]);
    spoilt("\"spacing_xy\": [1.0, 1.0],", "", &["missing field `spacing_xy`"]);
    spoilt("\"slices\"", "\"outside\": \"white\", \"slices\"", &["unknown variant `white`", "black"]);
}

#[test]
fn missing_truncated_and_wrong_sized_slices() {
    spoilt("s1.png", "s9.png", &["slice 1 (`s9.png`)", "cannot read"]);
    let input = folder();
    sound_stack(input.path());
    let path = input.path().join("s1.png");
    let whole = fs::read(&path).expect("the slice is there");
    fs::write(&path, &whole[..whole.len() / 2]).expect("a file can be written");
    refused(input.path(), &[], &["slice 1 (`s1.png`)"]);
    disc(&path, 40, 9.0);
    refused(input.path(), &[], &["slice 1 (`s1.png`)", "40x40 px, but slice 0 is 32x32"]);
    fs::write(&path, "not an image").expect("a file can be written");
    refused(input.path(), &[], &["slice 1 (`s1.png`)"]);
    image::RgbImage::from_fn(32, 32, |x, _| image::Rgb([x as u8, 0, 200])).save(&path).expect("a PNG can be written");
    refused(input.path(), &[], &["slice 1 (`s1.png`)", "pixel (0, 0) is coloured"]);
}

#[test]
fn heights_must_increase() {
    spoilt("\"z\": 4.0", "\"z\": 9.0", &["slice 2 (`s2.png`)", "height 8 must lie above", "`s1.png`: 9"]);
    spoilt("\"z\": 4.0", "\"z\": 8.0", &["slice 2 (`s2.png`)", "height 8 must lie above"]);
    spoilt("\"z\": 4.0", "\"z\": 1e999", &["stack.json", "line 5", "out of range"]);
}

#[test]
fn spacing_must_be_positive() {
    spoilt("[1.0, 1.0]", "[0.0, 1.0]", &["pixel spacing dx must be a positive number; got 0"]);
    for [wrong, words] in [["1e-200", "got 1e-200"], ["1e-40", "got 1e-40"], ["1e300", "got 1e300"]] {
        let pair = format!("[{wrong}, {wrong}]");
        spoilt("[1.0, 1.0]", &pair, &["pixel spacing dx must lie between 1e-15 and 1e15", words]);
    }
    spoilt("[1.0, 1.0]", "[1.0, -2.0]", &["pixel spacing dy must be a positive number; got -2"]);
    spoilt("[1.0, 1.0]", "[1.0]", &["stack.json: spacing_xy: invalid length 1, expected 2 numbers at line 2"]);
    spoilt(
        "[1.0, 1.0]",
        "[1.0, 1.0, 4.0]",
        &["stack.json: spacing_xy: invalid length 3, expected 2 numbers at line 2"],
    );
    let points = "\"z\": 4, \"polygons\": [[[0, 0, 4], [9, 0, 4], [9, 9, 4]]]}, {\"file\": \"s1.png\"";
    spoilt(
        "\"file\": \"s1.png\"",
        points,
        &["stack.json: slices[1].polygons[0][0]: invalid length 3, expected 2 numbers at line 5"],
    );
    spoilt("[1.0, 1.0]", "[1.0, \"1\"]", &["stack.json: spacing_xy[1]: invalid type: string \"1\"", "line 2"]);
}

#[test]
fn too_few_slices_and_none_with_anything() {
    let input = folder();
    sound_stack(input.path());
    write_stack(input.path(), r#"{"spacing_xy": [1, 1], "slices": [{"file": "s0.png", "z": 0}]}"#);
    refused(input.path(), &[], &["at least 2 slices are needed; got 1"]);
    write_stack(input.path(), r#"{"spacing_xy": [1, 1], "slices": []}"#);
    refused(input.path(), &[], &["at least 2 slices are needed; got 0"]);
    sound_stack(input.path());
    for k in 0..3 {
        disc(&input.path().join(format!("s{k}.png")), 32, 0.0);
    }
    refused(input.path(), &[], &["all slices are empty"]);
}

#[test]
fn output_heights_must_meet_the_body() {
    spoilt("\"start\": 0.0", "\"start\": 20.0", &["output heights 20 to 28 meet no part of the body", "0 to 8"]);
    spoilt("\"step\": 1.0", "\"step\": 0.0", &["z_out.step must be a positive number; got 0"]);
    spoilt("\"count\": 9", "\"count\": 0", &["z_out.count must be at least 1; got 0"]);
    spoilt("\"count\": 9", "\"count\": -1", &["stack.json", "line 8"]);
}

#[test]
fn more_memory_than_the_machine_has() {
    spoilt(
        "\"step\": 1.0, \"count\": 9",
        "\"step\": 1e-6, \"count\": 9000000000",
        &["at most 10000000 output heights"],
    );
    let input = folder();
    sound_stack(input.path());
    for k in 0..3 {
        disc(&input.path().join(format!("s{k}.png")), 2000, 10.0 + f64::from(k));
    }
    refused(input.path(), &["--dz", "1e-300"], &["at most 10000000 output heights; a step of 1e-300 makes"]);
    refused(input.path(), &["--dz", "0.000002"], &["this job needs about", "MiB of memory", "are available"]);
}

#[test]
fn outputs_are_checked_before_the_work() {
    let input = folder();
    sound_stack(input.path());
    refused(input.path(), &["-o", "no/such/folder/x.stl"], &["no/such/folder/x.stl: cannot write"]);
    refused(input.path(), &["-o", "x.docx"], &["x.docx", "unknown extension", ".nrrd"]);
    refused(
        input.path(),
        &["--report", "x.nrrd"],
        &["x.nrrd", "is a name for another output (volume); a report is .json or .html"],
    );
    refused(
        input.path(),
        &["--report", "x.dcm"],
        &["x.dcm", "another output (the RTSTRUCT, completed); a report is .json"],
    );
    let taken = folder();
    let name = taken.path().join("folder.stl");
    fs::create_dir(&name).expect("a folder can be made");
    refused(input.path(), &["-o", &name.display().to_string()], &["is a folder"]);
    let twice = taken.path().join("a.stl").display().to_string();
    refused(input.path(), &["-o", &twice, "-o", &twice], &["is named twice"]);
    let nothing = interslice(&["reconstruct", &input.path().display().to_string()]);
    assert_eq!(nothing.status.code(), Some(2));
}

#[test]
fn settings_are_checked() {
    let input = folder();
    sound_stack(input.path());
    refused(input.path(), &["--cfl", "1.2"], &["`cfl` must lie in [0.05, 0.9]; got 1.2"]);
    refused(input.path(), &["--sigma", "NaN"], &["`sigma` must lie in (0, 5]; got NaN"]);
    refused(input.path(), &["--half-width", "6", "--cut-off", "5.5"], &["`cut_off` must lie in [1, 5]; got 5.5"]);
    refused(input.path(), &["--end-top", "peak=3"], &["`end_top` peak must lie above the last contour at 8; got 3"]);
    refused(
        input.path(),
        &["--end-top", "peak=3", "--dry-run"],
        &["`end_top` peak must lie above the last contour at 8"],
    );
    refused(input.path(), &["--end-top", "pointed"], &["pointed", "peak=HEIGHT"]);
    refused(input.path(), &["--dz", "0"], &["`dz` must be a positive number; got 0"]);
    refused(input.path(), &["--threads", "0"], &["`threads` must lie in [1, 1024]; got 0"]);
    refused(input.path(), &["--label", "3"], &["`label` must be a value of the pixels", "got 3"]);
    refused(input.path(), &["--level", "255"], &["`level` must lie in [0, 255)", "got 255"]);
    refused(input.path(), &["--slope", "steep"], &["steep", "pchip"]);
}

#[test]
fn settings_files_are_checked() {
    let input = folder();
    sound_stack(input.path());
    let file = input.path().join("settings.toml");
    let name = file.display().to_string();
    let with = |text: &str, says: &[&str]| {
        fs::write(&file, text).expect("a file can be written");
        refused(input.path(), &["--settings", &name], says);
    };
    with("colour = 1", &["settings.toml", "unknown key `colour`"]);
    with("end-top = \"flat\"", &["unknown key `end-top`; write `end_top`"]);
    with("cfl = \"fast\"", &["settings.toml", "`cfl`", "fast"]);
    with("cfl = 2", &["`cfl` must lie in [0.05, 0.9]; got 2"]);
    with("cfl = ", &["settings.toml", "line 1"]);
    with("end_top = \"round\"", &["settings.toml", "`end_top`", "round"]);
    refused(input.path(), &["--settings", "no/such.toml"], &["no/such.toml", "cannot read"]);
}

#[test]
fn links_files_are_checked() {
    let input = folder();
    sound_stack(input.path());
    disc(&input.path().join("s2.png"), 32, 0.0);
    let file = input.path().join("links.json");
    let name = file.display().to_string();
    let with = |entries: &str, options: &[&str], says: &[&str]| {
        fs::write(&file, format!("{{\"links\": [{entries}]}}")).expect("a file can be written");
        refused(input.path(), &[&["--links", &name], options].concat(), says);
    };
    let sound = r#"{"slice": 0, "from": 1, "to": 1}"#;
    let other = r#"{"slice": 0, "from": 1, "to": 1, "join": false}"#;
    with(r#"{"slice": 2, "from": 1, "to": 1}"#, &[], &["links.json: link 1: `slice` must lie in [0, 1]", "got 2"]);
    with(
        r#"{"slice": 0, "from": 3, "to": 1}"#,
        &[],
        &["`from` must lie in [1, 1], the parts of slice 0 (`s0.png`); got 3"],
    );
    let second = format!("{sound},{}", r#"{"slice": 0, "from": 1, "to": 0}"#);
    with(&second, &[], &["link 2: `to` must lie in [1, 1], the parts of slice 1 (`s1.png`); got 0"]);
    with(r#"{"slice": 1, "from": 1, "to": 1}"#, &[], &["`to` is 1, but slice 2 (`s2.png`) is empty"]);
    with(&format!("{sound},{sound}"), &[], &["link 2: the pair of parts 1 and 1 above slice 0 is there already"]);
    with(&format!("{sound},{other}"), &[], &["link 2", "is joined and kept apart"]);
    with(r#"{"slice": 0, "from": -1, "to": 1}"#, &[], &["links.json", "-1", "line 1"]);
    with(r#"{"slice": 0, "from": 1}"#, &[], &["links.json", "missing field `to`"]);
    with(r#"{"slice": 0, "from": 1, "to": 1, "colour": 3}"#, &[], &["links.json", "unknown field `colour`"]);
    with(sound, &["--motion", "none"], &["`links` needs `motion` field or rigid"]);
    with(other, &["--method", "field"], &["`links` with `join` false need `method` morph"]);
    fs::write(&file, "[1, 2").expect("a file can be written");
    refused(input.path(), &["--links", &name], &["links.json", "line 1"]);
    refused(input.path(), &["--links", "no/such.json"], &["no/such.json", "cannot read"]);
    refused(input.path(), &["--link", "perhaps"], &["perhaps", "off, auto"]);
    refused(input.path(), &["--link-reach", "21"], &["`link_reach` must lie in (0, 20]; got 21"]);
    refused(input.path(), &["--link", "auto", "--motion", "none"], &["`link` needs `motion` field or rigid"]);
}

#[test]
fn broken_nrrd_files() {
    let place = folder();
    let path = place.path().join("labels.nrrd");
    let data = [0u8, 1, 1, 0].repeat(3);
    let with = |bytes: &[u8], says: &[&str]| {
        fs::write(&path, bytes).expect("a file can be written");
        refused(&path, &[], says);
    };
    with(b"PNG", &["labels.nrrd", "NRRD000"]);
    with(&nrrd("encoding: raw", "uchar", [2, 2, 3], &data[..7]), &["labels.nrrd", "data end after 7 of 12 bytes"]);
    with(&nrrd("encoding: raw\nbyte skip: -1", "uchar", [2, 2, 3], &data[..7]), &["data end after 7 of 12 bytes"]);
    with(&nrrd("encoding: raw", "uchar", [2, 2, 0], &data), &["sizes 2 2 0"]);
    with(&nrrd("encoding: raw", "uchar", [usize::MAX, 2, 3], &data), &["sizes"]);
    with(&nrrd("encoding: hex", "uchar", [2, 2, 3], &data), &["encoding must be raw, gzip or bzip2; got hex"]);
    with(&nrrd("encoding: gzip", "uchar", [2, 2, 3], &data), &["labels.nrrd", "data"]);
    with(&nrrd("encoding: bzip2", "uchar", [2, 2, 3], &data), &["labels.nrrd", "data"]);
    with(&nrrd("encoding: bzip2", "uchar", [9000, 9000, 9000], &data), &["compressed bytes can hold"]);
    with(&nrrd("encoding: raw", "blob", [2, 2, 3], &data), &["type `blob` is not known"]);
    with(&nrrd("encoding: raw", "short", [2, 1, 3], &data), &["endian must be little or big; got nothing"]);
    with(&nrrd("encoding: raw\nspacings: 1 1 NaN", "uchar", [2, 2, 3], &data), &["voxel spacing along axis 2", "NaN"]);
    with(
        &nrrd("encoding: raw\nspace: LPS\nspace directions: (1,0,0) (0,1,0) (0.3,0,1)", "uchar", [2, 2, 3], &data),
        &["axes 0 and 2 are not perpendicular"],
    );
    with(&nrrd("encoding: raw", "uchar", [2, 2, 3], &[0; 12]), &["has no label: all voxels are 0"]);
    with(
        &nrrd("encoding: raw\nendian: little", "float", [1, 1, 3], &0.5f32.to_le_bytes().repeat(3)),
        &["voxel x = 0, y = 0, z = 0 is 0.5"],
    );
}

#[test]
fn broken_nifti_files() {
    let place = folder();
    let path = place.path().join("labels.nii");
    let with = |bytes: &[u8], says: &[&str]| {
        fs::write(&path, bytes).expect("a file can be written");
        refused(&path, &[], says);
    };
    with(b"too short", &["labels.nii", "NIfTI"]);
    with(&[0u8; 400], &["labels.nii", "NIfTI"]);
}
