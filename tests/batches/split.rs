//! One reconstruction in parts, as a user meets it: plan, run, merge, and what they say to wrong input.

use std::fs;
use std::path::{Path, PathBuf};

use crate::files::*;
use serde_json::Value;
use tempfile::TempDir;

/// All formats whose bytes say nothing of the run itself.
const OUTPUTS: [&str; 7] = ["v.nrrd", "v.nii.gz", "m.stl", "m.ply", "m.obj", "p.png", "h.dem.tif"];
/// Options that leave no default in its place; a contour's own height is just missed, and is the contour's all the same.
const OPTIONS: [&str; 6] =
    ["--end-top=half-slice", "--end-bottom=extrapolate", "--mask", "--contours", "--fair=0.7", "--dz=1.3"];

/// Discs that wander and swell, at uneven heights, as `stack/stack.json`.
fn stack(slices: usize, size: u32) -> TempDir {
    let place = folder();
    let folder = place.path().join("stack");
    fs::create_dir(&folder).expect("a folder can be made");
    let mut z = 0.1;
    let entries: Vec<String> = (0..slices)
        .map(|k| {
            let s = k as f64;
            let (cx, cy) =
                (f64::from(size) * (0.5 + 0.12 * (0.4 * s).sin()), f64::from(size) * (0.5 + 0.1 * (0.3 * s).cos()));
            let r = f64::from(size) * (0.22 + 0.05 * (0.7 * s).sin());
            let image = image::GrayImage::from_fn(size, size, |x, y| {
                image::Luma([if (f64::from(x) - cx).hypot(f64::from(y) - cy) < r { 255 } else { 0 }])
            });
            image.save(folder.join(format!("s{k}.png"))).expect("a PNG can be written");
            z += [2.0, 3.5, 2.7][k % 3];
            format!("{{\"file\": \"s{k}.png\", \"z\": {z}}}")
        })
        .collect();
    write_stack(&folder, &format!("{{\"spacing_xy\": [0.9, 1.1], \"slices\": [{}]}}", entries.join(",\n")));
    place
}

fn path(place: &Path, name: &str) -> String {
    place.join(name).display().to_string()
}

/// Runs on the reference path and expects success.
fn done(arguments: &[&str]) -> String {
    let result = interslice(arguments);
    assert_eq!(result.status.code(), Some(0), "{arguments:?}: {}", stderr(&result));
    String::from_utf8_lossy(&result.stdout).into_owned()
}

/// Runs and expects exit code 2 and all of `said` in words.
fn refused(arguments: &[&str], said: &[&str]) {
    let result = interslice(arguments);
    let words = stderr(&result);
    assert_eq!(result.status.code(), Some(2), "{arguments:?}: {words}");
    assert!(!words.contains("panicked"), "{words}");
    said.iter().for_each(|s| assert!(words.contains(s), "{arguments:?}: `{s}` is missing from: {words}"));
}

fn part(place: &Path, part: &str, name: &str, more: &[&str]) -> String {
    let target = path(place, name);
    let input = path(place, "stack");
    done(&[&["run", &input, "--part", part, "-o", &target, "--backend=cpu", "-q"], more].concat());
    target
}

/// All outputs and a report of `command` in the folder `name`, by whatever arguments come before.
fn outputs(place: &Path, name: &str, arguments: &[&str]) -> PathBuf {
    let out = place.join(name);
    fs::create_dir(&out).expect("a folder can be made");
    let targets: Vec<String> = OUTPUTS.iter().chain(&["r.json"]).map(|o| path(&out, o)).collect();
    let named: Vec<&str> = targets.iter().flat_map(|t| ["-o", t]).collect();
    done(&[arguments, &named].concat());
    out
}

/// A report without what differs from run to run.
fn report(out: &Path) -> Value {
    let mut report: Value =
        serde_json::from_slice(&fs::read(out.join("r.json")).expect("it was written")).expect("JSON");
    let fields = report.as_object_mut().expect("an object");
    ["stages", "backend", "backend_reason", "provenance"].iter().for_each(|f| drop(fields.remove(*f)));
    report
}

fn same_outputs(a: &Path, b: &Path) {
    for name in OUTPUTS {
        let [a, b] = [a, b].map(|out| fs::read(out.join(name)).expect("it was written"));
        assert!(a == b, "{name}: {} and {} bytes differ", a.len(), b.len());
    }
    assert_eq!(report(a), report(b));
}

#[test]
fn merged_parts_are_the_single_run() {
    let place = stack(24, 40);
    let place = place.path();
    let input = path(place, "stack");
    for (name, options) in [("default", &[][..]), ("options", &OPTIONS[..])] {
        let single = outputs(
            place,
            &format!("single-{name}"),
            &[&["reconstruct", &input, "--backend=cpu", "-q"], options].concat(),
        );
        let parts: Vec<String> =
            (1..=3).rev().map(|k| part(place, &format!("{k}/3"), &format!("{name}{k}.section"), options)).collect();
        // In any order, and with no options: the parts know.
        let arguments: Vec<&str> = ["merge", "-q"].into_iter().chain(parts.iter().map(String::as_str)).collect();
        let merged = outputs(place, &format!("merged-{name}"), &arguments);
        same_outputs(&single, &merged);
    }
    let volumes =
        ["single-default", "single-options"].map(|n| fs::read(place.join(n).join("v.nrrd")).expect("written"));
    assert!(String::from_utf8_lossy(&volumes[0]).contains("type: float"));
    assert!(String::from_utf8_lossy(&volumes[1]).contains("type: uint8"), "--mask was told to `run` only");
    let left: Vec<_> = listing(place).into_iter().filter(|p| p.extension().is_some_and(|e| e == "tmp")).collect();
    assert!(left.is_empty(), "left behind: {left:?}");
}

#[test]
fn plan_names_every_interval_once() {
    let place = stack(24, 24);
    let input = path(place.path(), "stack");
    let plan: Value = serde_json::from_str(&done(&["plan", &input, "--parts", "5", "--json"])).expect("JSON");
    let plan = plan.as_array().expect("a list");
    assert_eq!(plan.len(), 5);
    let mut next = 0;
    for (k, p) in plan.iter().enumerate() {
        assert_eq!(p["part"], format!("{}/5", k + 1));
        assert_eq!(p["intervals"][0], next);
        next = p["intervals"][1].as_u64().expect("a number");
        let slices = [0, 1].map(|k| p["slices"][k].as_u64().expect("a number"));
        assert!(slices[0] <= p["intervals"][0].as_u64().expect("a number") && slices[1] > next && slices[1] <= 24);
        assert!(p["memory_mib"].as_u64() > Some(0));
    }
    assert_eq!(next, 23, "all intervals");
    let words = done(&["plan", &input, "--parts", "5"]);
    assert!(words.contains("part 5/5: ") && words.contains("interslice merge"), "{words}");
    // More threads work on more at once.
    let memory = |threads: &str| {
        let told = done(&["plan", &input, "--parts", "1", "--json", "--threads", threads]);
        serde_json::from_str::<Value>(&told).expect("JSON")[0]["memory_mib"].as_u64().expect("a number")
    };
    assert!(memory("1") <= memory("12"));
}

#[test]
fn wrong_parts_are_refused_before_any_work() {
    let place = stack(5, 24);
    let (input, target) = (path(place.path(), "stack"), path(place.path(), "x.section"));
    let run = |part: &str, output: &str, said: &[&str]| {
        refused(&["run", &input, "--part", part, "-o", output, "--backend=cpu"], said);
    };
    for wrong in ["3", "a/b", "1/", "/2", "-1/2", "1/2/3", "1.5/2"] {
        refused(&["run", &input, &format!("--part={wrong}"), "-o", &target], &["--part", wrong]);
    }
    run("0/2", &target, &["`part`", "[1, 2]", "0/2"]);
    run("3/2", &target, &["`part`", "[1, 2]", "3/2"]);
    run("1/5", &target, &["`parts`", "[1, 4]", "got 5"]);
    run("1/0", &target, &["`parts`", "[1, 4]", "got 0"]);
    run("1/2", &path(place.path(), "x.stl"), &["x.stl", ".section"]);
    run("1/2", &path(place.path(), "none/x.section"), &["x.section", "none"]);
    fs::create_dir(&target).expect("a folder can be made");
    run("1/2", &target, &["x.section", "is a folder"]);
    refused(&["run", &path(place.path(), "none"), "--part=1/2", "-o", &target], &["none", "cannot read"]);
    for wrong in ["0", "5", "99999999999"] {
        refused(&["plan", &input, "--parts", wrong], &["`parts`", "[1, 4]", wrong]);
    }
    refused(&["plan", &input, "--parts", "many"], &["--parts", "many"]);
    assert_eq!(listing(place.path()).len(), 2, "nothing was written");
}

#[test]
fn parts_that_do_not_belong_together_are_refused() {
    let place = stack(6, 24);
    let place = place.path();
    let [a, b] = ["1/2", "2/2"].map(|k| part(place, k, &format!("{}.section", &k[..1]), &[]));
    let other = part(place, "2/2", "other.section", &["--fair=0.5"]);
    let third = part(place, "2/3", "third.section", &[]);
    let target = path(place, "out.stl");
    fs::write(&target, "what was there").expect("a file can be written");
    let merge = |parts: &[&str], said: &[&str]| {
        refused(&[&["merge", "-o", &target], parts].concat(), said);
        assert_eq!(fs::read_to_string(&target).expect("it is there"), "what was there");
    };
    merge(&[&a], &["1.section", "2 parts", "missing: 2"]);
    merge(&[&b], &["2.section", "missing: 1"]);
    merge(&[&a, &b, &b], &["2.section", "is part 2 again"]);
    merge(&[&a, &other], &["other.section", "part 2 of 2", "1.section"]);
    merge(&[&a, &third], &["third.section", "part 2 of 3", "number of parts"]);
    merge(&[&a, &path(place, "none.section")], &["none.section", "cannot read"]);
    merge(&[&a, &path(place, "stack")], &["stack", "cannot read"]);
    merge(&[&a, &path(place, "stack/s0.png")], &["s0.png", "is not a part"]);
    // Another input of the same shape.
    disc(&place.join("stack/s3.png"), 24, 9.0);
    let changed = part(place, "2/2", "changed.section", &[]);
    merge(&[&a, &changed], &["changed.section", "another body"]);
    refused(&["merge", &a, &b, "-o", &path(place, "out.xyz")], &["out.xyz", "unknown extension"]);
    refused(&["merge", &a, &b, "-o", &path(place, "stack")], &["stack", "unknown extension"]);
    fs::create_dir(place.join("folder.stl")).expect("a folder can be made");
    refused(&["merge", &a, &b, "-o", &path(place, "folder.stl")], &["folder.stl", "is a folder"]);
    refused(&["merge", &a, &b], &["--output"]);
    refused(&["merge", "-o", &target], &["PARTS"]);
    let names: Vec<PathBuf> =
        listing(place).into_iter().filter(|p| p.extension().is_some_and(|e| e == "tmp")).collect();
    assert!(names.is_empty(), "left behind: {names:?}");
}

#[test]
fn damage_is_seen_wherever_it_is() {
    let place = stack(4, 24);
    let place = place.path();
    let [a, b] = ["1/2", "2/2"].map(|k| part(place, k, &format!("{}.section", &k[..1]), &[]));
    let sound = fs::read(&b).expect("it was written");
    let target = path(place, "out.nrrd");
    fs::write(&target, "what was there").expect("a file can be written");
    let damaged = |bytes: &[u8], what: &str| {
        fs::write(&b, bytes).expect("a file can be written");
        let result = interslice(&["merge", &a, &b, "-o", &target]);
        let words = stderr(&result);
        assert_eq!(result.status.code(), Some(2), "{what}: {words}");
        assert!(words.contains("2.section") && !words.contains("panicked"), "{what}: {words}");
        assert_eq!(fs::read_to_string(&target).expect("it is there"), "what was there", "{what}");
    };
    for part in 0..16 {
        damaged(&sound[..sound.len() * part / 16], &format!("{part} of 16 parts of it"));
    }
    damaged(&sound[..sound.len() - 1], "all but a byte");
    // From the fourth byte on: those before it are gzip's own, and its flags, time and system after them are not checked.
    for k in 0..24 {
        let at = 10 + (sound.len() - 11) * k / 23;
        let mut bytes = sound.clone();
        bytes[at] ^= 1 << (k % 8);
        damaged(&bytes, &format!("byte {at} of {}", sound.len()));
    }
    fs::write(&b, &sound).expect("a file can be written");
    done(&["merge", "-q", &a, &b, "-o", &target]);
    assert!(fs::read(&target).expect("it is there").starts_with(b"NRRD"));
}

/// Parts made on the reference path and on a GPU differ by hundredths of a pixel: whoever joins them is told.
#[cfg(feature = "gpu")]
#[test]
fn parts_of_different_machines_are_told_apart() {
    let place = stack(6, 40);
    let place = place.path();
    let parts = [("1/2", "cpu"), ("2/2", "gpu"), ("2/2", "cpu")].map(|(number, backend)| {
        let name = format!("{backend}{}.section", &number[..1]);
        let target = path(place, &name);
        done(&["run", &path(place, "stack"), "--part", number, "-o", &target, &format!("--backend={backend}"), "-q"]);
        target
    });
    let said = |second: &str, name: &str| {
        let out = path(place, name);
        let result = interslice(&["merge", &parts[0], second, "-o", &out]);
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        stderr(&result).contains("different machines")
            && fs::read_to_string(&out).expect("JSON").contains("different machines")
    };
    assert!(said(&parts[1], "mixed.json"));
    assert!(!said(&parts[2], "alike.json"));
}
