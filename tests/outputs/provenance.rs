//! What a report says of its making: files and their digests, options, date, machine.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::files::{folder, nrrd, stderr};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

/// Label 3 and 8 on every fourth slice, 3 with a name.
fn input(place: &Path) {
    let label = |n: usize| match (n / 400 % 4, n % 20) {
        (0, 3..=8) => 3,
        (0, 12..=16) => 8,
        _ => 0,
    };
    let header = "encoding: raw\nspacings: 1 1 2\nSegment0_LabelValue:=3\nSegment0_Name:=Liver";
    let voxels: Vec<u8> = (0..9 * 400).map(label).collect();
    fs::write(place.join("in.nrrd"), nrrd(header, "uint8", [20, 20, 9], &voxels)).expect("a file can be written");
}

fn run(place: &Path, arguments: &[&str], epoch: Option<&str>) -> std::process::Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_interslice"));
    command.args(arguments).current_dir(place);
    match epoch {
        Some(epoch) => command.env("SOURCE_DATE_EPOCH", epoch),
        None => command.env_remove("SOURCE_DATE_EPOCH"),
    };
    command.output().expect("the program starts")
}

fn provenance(place: &Path, arguments: &[&str], epoch: Option<&str>) -> Value {
    let output = run(place, &[arguments, &["-q", "--backend", "cpu"]].concat(), epoch);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", stderr(&output));
    let text = fs::read(place.join("r.json")).expect("there is a report");
    serde_json::from_slice::<Value>(&text).expect("JSON")["provenance"].take()
}

fn digest(path: &Path) -> String {
    let digest = Sha256::digest(fs::read(path).expect("a file"));
    digest.iter().map(|b| format!("{b:02x}")).collect()
}

#[test]
fn a_report_says_of_what_and_how_it_was_made() {
    let place = folder();
    let place = place.path();
    input(place);
    let bytes = fs::metadata(place.join("in.nrrd")).expect("a file").len();
    let file = json!({"file": "in.nrrd", "bytes": bytes, "sha256": digest(&place.join("in.nrrd"))});
    let one = ["reconstruct", "in.nrrd", "--label", "Liver", "--fair", "0.5", "--dz", "1", "--report", "r.json"];
    let made = provenance(place, &one, Some("86400"));
    assert_eq!(made["date"], "1970-01-02T00:00:00Z");
    assert_eq!(made["inputs"], json!([file]));
    assert_eq!(made["bodies"], json!(["Liver"]));
    assert_eq!(made["options"], json!({"label": "Liver", "fair": 0.5, "dz": 1.0}));
    assert!(made["machine"]["threads"].as_u64().is_some_and(|n| n > 0), "{made}");

    let many = ["reconstruct", "in.nrrd", "--labels", "3,8", "-o", "r.json"];
    let made = provenance(place, &many, None);
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("a time").as_secs();
    let year = made["date"].as_str().and_then(|d| d[..4].parse::<u64>().ok()).expect("a date");
    assert!(year.abs_diff(1970 + now / 31_556_952) <= 1, "{}", made["date"]);
    assert_eq!((&made["inputs"], &made["bodies"]), (&json!([file]), &json!(["Liver", "8"])));
    assert_eq!(made["options"], json!({"labels": "3,8", "keep_overlaps": false}));

    fs::write(place.join("links.json"), r#"{"links": []}"#).expect("a file");
    let linked = ["reconstruct", "in.nrrd", "--label", "3", "--links", "links.json", "-o", "r.json"];
    let made = provenance(place, &linked, Some("0"));
    assert_eq!(made["inputs"][1]["sha256"], digest(&place.join("links.json")));
    assert_eq!(made["options"]["links"], "links.json");

    let wrong = run(place, &linked, Some("yesterday"));
    assert_eq!(wrong.status.code(), Some(2), "{}", stderr(&wrong));
    assert!(stderr(&wrong).contains("`SOURCE_DATE_EPOCH` must be whole seconds since 1970"), "{}", stderr(&wrong));
}

#[test]
fn only_reports_have_a_date() {
    let place = folder();
    let place = place.path();
    input(place);
    let names = ["a.nrrd", "a.stl", "a.glb", "a.npz", "a.tif", "a.ome.tif", "a.seg.nrrd"];
    let bytes = |epoch| {
        let mut arguments = vec!["reconstruct", "in.nrrd", "--label", "3", "-q", "--backend", "cpu"];
        names.iter().for_each(|name| arguments.extend(["-o", name]));
        assert!(run(place, &arguments, Some(epoch)).status.success());
        names.map(|name| fs::read(place.join(name)).expect("written"))
    };
    assert!(bytes("0") == bytes("1000000000"), "files without a report are the same on any day");
    let job = json!({"id": "a", "input": "in.nrrd", "outputs": ["b.json"], "options": {"label": 3}});
    fs::write(place.join("jobs.jsonl"), format!("{job}\n")).expect("a file");
    let of_batch = |epoch| {
        fs::remove_file(place.join("results.jsonl")).ok();
        assert!(run(place, &["batch", "jobs.jsonl", "-q", "--backend", "cpu"], Some(epoch)).status.success());
        fs::read(place.join("b.json")).expect("written")
    };
    assert!(of_batch("0") == of_batch("1000000000"), "a batch is made again when it changes");
}
