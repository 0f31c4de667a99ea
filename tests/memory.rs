//! What a run needs of memory, beside what was said before it, and that the number of layers does not matter.
#![cfg(target_os = "linux")]

#[path = "support/files.rs"]
mod files;

use std::path::Path;
use std::process::Command;

use files::folder;
use interslice::files::outputs::{OutputOptions, Outputs};
use interslice::files::pending::Temporary;
use interslice::files::{JobOptions, Loaded};
use interslice::progress::Silent;
use interslice::settings::Method;
use interslice::stack::{ContourStack, Geometry, Slice, SliceContent};
use interslice::{Budget, Means, Reference, Settings};

/// Where the run of [`one_run`] writes, and its distance between layers, fairing and method.
const ASKED: &str = "INTERSLICE_MEMORY_TEST";
const SIDE: usize = 400;
const KINDS: [&str; 6] = ["nrrd", "nii.gz", "stl", "ply", "tif", "json"];

/// Largest resident set so far, bytes.
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux tells");
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).expect("Linux tells");
    line.split_whitespace().next().and_then(|n| n.parse::<u64>().ok()).expect("a number") << 10
}

/// Four discs that drift.
fn stack() -> ContourStack {
    let content = |k: usize| {
        let (c, r) = (0.45 * SIDE as f64 + 12.0 * k as f64, 0.3 * SIDE as f64 - 9.0 * k as f64);
        let inside = |n: usize| ((n % SIDE) as f64 - c).hypot((n / SIDE) as f64 - c) < r;
        SliceContent::Mask((0..SIDE * SIDE).map(inside).collect())
    };
    let slice = |k: usize| Slice { name: format!("s{k}"), z: 4.0 * k as f64, extra: false, content: content(k) };
    ContourStack {
        dims: [SIDE, SIDE],
        spacing: [1.0, 1.0],
        unit: "px".into(),
        slices: (0..4).map(slice).collect(),
        z_out: None,
        geometry: Geometry::default(),
    }
}

/// A run in a process of its own: bytes it needed, bytes that were said, layers.
fn measured(dz: f64, fair: f64, method: &str) -> [u64; 3] {
    let place = folder();
    let result = Command::new(std::env::current_exe().expect("this test"))
        .args(["--exact", "is_what_was_said_at_most", "--nocapture"])
        .env(ASKED, format!("{};{dz};{fair};{method}", place.path().display()))
        .env("RAYON_NUM_THREADS", "2")
        .output()
        .expect("it starts");
    let said = String::from_utf8_lossy(&result.stdout).into_owned();
    let line = said.lines().find_map(|l| l.split_once("measured ")).unwrap_or_else(|| panic!("{said}")).1;
    let numbers: Vec<u64> = line.split_whitespace().map(|n| n.parse().expect("a number")).collect();
    println!(
        "dz {dz}, fair {fair}, {method}: {} MiB of {} MiB, {} layers",
        numbers[0] >> 20,
        numbers[1] >> 20,
        numbers[2]
    );
    numbers.try_into().expect("three numbers")
}

/// The run that is asked for, in this process.
fn one_run(asked: &str) {
    let [place, dz, fair, method] = asked.split(';').collect::<Vec<_>>().try_into().expect("four words");
    let number = |word: &str| word.parse::<f64>().expect("a number");
    let method = if method == "field" { Method::Field } else { Method::Morph };
    let settings = Settings { fair: number(fair), method, ..Settings::default() };
    let output = OutputOptions { dz: Some(number(dz)), ..OutputOptions::default() };
    let before = peak();
    let loaded = Loaded::new(stack(), JobOptions { settings, output, ..JobOptions::default() }).expect("it is sound");
    let targets: Vec<_> = KINDS.iter().map(|kind| Path::new(place).join(format!("out.{kind}"))).collect();
    let mut outputs = Outputs::open(&targets, None, Temporary::Random).expect("the folder is there");
    let said = loaded.needs().all + outputs.bytes(loaded.stack.dims, &loaded.stack.geometry, loaded.stack.lid());
    let budget = Budget::unlimited();
    let means = Means { backend: &Reference, progress: &Silent, budget: &budget };
    let mut body = loaded.compute(&means, &mut outputs).expect("it can be computed");
    outputs.complete(&mut body.report).expect("it can be written");
    outputs.rename().expect("it can be renamed");
    println!("measured {} {said} {}", peak() - before, loaded.heights.len());
}

#[test]
fn is_what_was_said_at_most() {
    // In a process of its own it is one run.
    if let Ok(asked) = std::env::var(ASKED) {
        return one_run(&asked);
    }
    for (dz, fair, method) in [(1.0, 1.0, "field"), (0.25, 1.0, "field"), (0.25, 0.0, "field"), (1.0, 1.0, "morph")] {
        let [needed, said, _] = measured(dz, fair, method);
        assert!(needed <= said, "{needed} bytes were needed, {said} said");
        assert!(6 * needed >= said, "{needed} bytes were needed, {said} said: too many");
    }
}

#[test]
fn does_not_grow_with_the_layers() {
    let [few, _, layers] = measured(0.25, 0.0, "field");
    let [many, _, more] = measured(0.05, 0.0, "field");
    let voxels = (more - layers) * (SIDE * SIDE * 4) as u64;
    assert!(voxels > 100 << 20, "{voxels} bytes of layers more");
    assert!(many < few + voxels / 5, "{few} bytes for {layers} layers, {many} for {more}");
}
