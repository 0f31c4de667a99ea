//! Input files for tests of the program.
#![allow(dead_code)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use image::GrayImage;
use tempfile::TempDir;

/// A folder of its own for one test.
pub fn folder() -> TempDir {
    tempfile::tempdir().expect("the system has a place for temporary files")
}

/// Writes a disc of radius `r` as a black and white PNG.
pub fn disc(path: &Path, size: u32, r: f64) {
    let c = f64::from(size - 1) / 2.0;
    let image = GrayImage::from_fn(size, size, |x, y| {
        image::Luma([if (f64::from(x) - c).hypot(f64::from(y) - c) < r { 255 } else { 0 }])
    });
    image.save(path).expect("a PNG can be written");
}

/// A sound stack of three discs in `folder`, and its stack.json as text to be spoilt.
pub fn sound_stack(folder: &Path) -> String {
    for (k, r) in [8.0, 10.0, 7.0].into_iter().enumerate() {
        disc(&folder.join(format!("s{k}.png")), 32, r);
    }
    let text = r#"{
  "spacing_xy": [1.0, 1.0],
  "slices": [
    {"file": "s0.png", "z": 0.0},
    {"file": "s1.png", "z": 4.0},
    {"file": "s2.png", "z": 8.0}
  ],
  "z_out": {"start": 0.0, "step": 1.0, "count": 9}
}"#;
    write_stack(folder, text);
    text.into()
}

pub fn write_stack(folder: &Path, text: &str) {
    fs::write(folder.join("stack.json"), text).expect("stack.json can be written");
}

/// Runs the program.
pub fn interslice(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_interslice")).args(arguments).output().expect("the program starts")
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Names of everything in a folder, sorted.
pub fn listing(folder: &Path) -> Vec<PathBuf> {
    let mut names: Vec<PathBuf> =
        fs::read_dir(folder).expect("the folder exists").map(|e| e.expect("an entry").path()).collect();
    names.sort();
    names
}

/// A NRRD with an attached header: raw bytes of `kind`, x fastest.
pub fn nrrd(header_extra: &str, kind: &str, sizes: [usize; 3], data: &[u8]) -> Vec<u8> {
    let [nx, ny, nz] = sizes;
    let mut out = format!("NRRD0004\n# a comment\ntype: {kind}\ndimension: 3\nsizes: {nx} {ny} {nz}\n{header_extra}\n")
        .into_bytes();
    out.push(b'\n');
    out.extend_from_slice(data);
    out
}
