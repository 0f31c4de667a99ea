//! Small cases and manifests for tests of batches.
#![allow(dead_code)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::{Value, json};

use crate::files::{disc, interslice, sound_stack};

/// Extensions of the outputs of [`cases`].
pub const OUTPUTS: [&str; 3] = ["nrrd", "stl", "json"];

/// Writes `count` cases that differ and `manifest.jsonl` for them; gives their ids.
pub fn cases(place: &Path, count: usize) -> Vec<String> {
    let ids: Vec<String> = (0..count).map(|k| format!("case{k:02}")).collect();
    let lines = ids.iter().enumerate().map(|(k, id)| {
        let folder = place.join("cases").join(id);
        fs::create_dir_all(&folder).expect("a folder can be made");
        sound_stack(&folder);
        disc(&folder.join("s1.png"), 32, 6.0 + 0.25 * k as f64);
        json!({"id": id, "input": format!("cases/{id}"), "outputs": OUTPUTS.map(|e| format!("out/{id}.{e}"))})
    });
    write_manifest(place, &lines.collect::<Vec<_>>());
    ids
}

/// Writes `manifest.jsonl`.
pub fn write_manifest(place: &Path, lines: &[Value]) {
    let text: String = lines.iter().map(|l| format!("{l}\n")).collect();
    fs::write(place.join("manifest.jsonl"), text).expect("a file can be written");
}

/// `interslice batch manifest.jsonl` on the reference path, ready to run.
pub fn command(place: &Path, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_interslice"));
    command.args(["batch", &place.join("manifest.jsonl").display().to_string(), "--backend", "cpu"]).args(more);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// The same, run to its end.
pub fn batch(place: &Path, more: &[&str]) -> Output {
    command(place, more).output().expect("the program starts")
}

/// What is in `out`, by name.
pub fn outputs(place: &Path) -> BTreeMap<String, Vec<u8>> {
    let Ok(entries) = fs::read_dir(place.join("out")) else { return BTreeMap::new() };
    entries
        .map(|e| e.expect("an entry").path())
        .map(|p| (p.file_name().expect("a name").to_string_lossy().into_owned(), fs::read(&p).expect("a file")))
        .collect()
}

/// The same without temporary files and locks.
pub fn finished_outputs(place: &Path) -> BTreeMap<String, Vec<u8>> {
    outputs(place).into_iter().filter(|(name, _)| !name.ends_with(".tmp") && !name.ends_with(".lock")).collect()
}

/// Asserts that both hold the same files with the same bytes.
pub fn same(a: &BTreeMap<String, Vec<u8>>, b: &BTreeMap<String, Vec<u8>>) {
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for (name, bytes) in a {
        assert!(*bytes == b[name], "{name}: {} and {} bytes differ", bytes.len(), b[name].len());
    }
}

/// Lines of `results.jsonl` that are whole.
pub fn results(place: &Path) -> Vec<Value> {
    let text = fs::read_to_string(place.join("results.jsonl")).unwrap_or_default();
    text.split_inclusive('\n').filter(|l| l.ends_with('\n')).filter_map(|l| serde_json::from_str(l).ok()).collect()
}

/// Ids of the jobs that `results.jsonl` calls done, in its order.
pub fn done(place: &Path) -> Vec<String> {
    let of = |line: Value| (line["status"] == "done").then(|| line["id"].as_str().expect("a name").to_string());
    results(place).into_iter().filter_map(of).collect()
}

/// The file of a job's slice.
pub fn slice(place: &Path, id: &str) -> PathBuf {
    place.join("cases").join(id).join("s1.png")
}

/// What `reconstruct` alone makes of a case, as STL.
pub fn alone(place: &Path, id: &str, more: &[&str]) -> Vec<u8> {
    let target = place.join("alone.stl");
    let (input, name) = (place.join("cases").join(id).display().to_string(), target.display().to_string());
    let result = interslice(&[&["reconstruct", &input, "-o", &name, "--backend", "cpu", "-q"], more].concat());
    assert_eq!(result.status.code(), Some(0));
    let bytes = fs::read(&target).expect("it was written");
    fs::remove_file(target).expect("it is there");
    bytes
}
