//! Volumes of grey values, cut at a level.

use std::fs;
use std::path::Path;

use crate::files::*;
use interslice::input::read;
use interslice::stack::axis::Axis;
use interslice::stack::{ContourStack, LevelSlice, ReadOptions, SliceContent};

const SIZES: [usize; 3] = [41, 37, 13];
const RADIUS: f64 = 14.3;

/// 1000 - 10 times the distance from the middle, in voxels of 1 x 1 x 3: 857 at the sphere.
fn value(i: usize, j: usize, k: usize) -> f64 {
    let [x, y, z] = [i as f64 - 20.2, j as f64 - 18.4, 3.0 * (k as f64 - 6.1)];
    1000.0 - 10.0 * (x * x + y * y + z * z).sqrt()
}

const LEVEL: f64 = 1000.0 - 10.0 * RADIUS;

fn values() -> impl Iterator<Item = f64> {
    let [nx, ny, nz] = SIZES;
    (0..nx * ny * nz).map(move |n| value(n % nx, n / nx % ny, n / (nx * ny)))
}

fn write(path: &Path, kind: &str, bytes: &[u8]) {
    let header = "spacings: 1 1 3\nencoding: raw\nendian: little";
    fs::write(path, nrrd(header, kind, SIZES, bytes)).expect("a file can be written");
}

fn write_floats(path: &Path) {
    write(path, "float", &values().flat_map(|v| (v as f32).to_le_bytes()).collect::<Vec<u8>>());
}

fn cut(path: &Path, more: ReadOptions) -> ContourStack {
    read(path, &ReadOptions { level: Some(LEVEL), ..more }).expect("the volume is sound")
}

fn levels(stack: &ContourStack, slice: usize) -> &LevelSlice {
    match &stack.slices[slice].content {
        SliceContent::Level(u) => u,
        SliceContent::Mask(_) => panic!("grey values make level sets"),
    }
}

#[test]
fn every_slice_is_a_level_set_of_its_values() {
    let place = folder();
    let path = place.path().join("grey.nrrd");
    write_floats(&path);
    let stack = cut(&path, ReadOptions::default());
    assert_eq!(stack.slices.len(), SIZES[2], "an empty slice says something too");
    for k in 0..SIZES[2] {
        assert_eq!(stack.slices[k].z, 3.0 * k as f64);
        let depth = |n: usize| LEVEL - f64::from(value(n % SIZES[0], n / SIZES[0], k) as f32);
        let sides = (0..SIZES[0] * SIZES[1]).map(|n| depth(n) < 0.0);
        assert!(levels(&stack, k).sides().iter().eq(sides), "slice {k}");
        for &(n, u) in levels(&stack, k).near() {
            assert!((f64::from(u) - depth(n)).abs() < 1e-4, "pixel {n} of slice {k}: {u}, not {}", depth(n));
        }
    }
    assert_eq!(cut(&path, ReadOptions { keep: Some(4), ..Default::default() }).slices.len(), 4);
    let across = cut(&path, ReadOptions { axis: Axis::X, ..Default::default() });
    assert_eq!((across.dims, across.slices.len()), ([SIZES[1], SIZES[2]], SIZES[0]));
    let near = levels(&across, 30).near();
    assert!(near.len() > 20, "{}", near.len());
    for (n, u) in near {
        let (y, z) = (n % SIZES[1], n / SIZES[1]);
        assert!((f64::from(*u) - (LEVEL - value(30, y, z))).abs() < 1e-3, "({y}, {z}): {u}");
    }
}

#[test]
fn every_type_of_voxel_and_a_scale_give_their_values() {
    let place = folder();
    let of = |name: &str, kind: &str, bytes: Vec<u8>| {
        let path = place.path().join(name);
        write(&path, kind, &bytes);
        cut(&path, ReadOptions::default())
    };
    let rounded = || values().map(f64::round);
    let stacks = [
        of("i16.nrrd", "short", rounded().flat_map(|v| (v as i16).to_le_bytes()).collect()),
        of("u16.nrrd", "ushort", rounded().flat_map(|v| (v as u16).to_le_bytes()).collect()),
        of("i32.nrrd", "int", rounded().flat_map(|v| (v as i32).to_le_bytes()).collect()),
        of("u32.nrrd", "uint", rounded().flat_map(|v| (v as u32).to_le_bytes()).collect()),
        of("i64.nrrd", "longlong", rounded().flat_map(|v| (v as i64).to_le_bytes()).collect()),
        of("u64.nrrd", "ulonglong", rounded().flat_map(|v| (v as u64).to_le_bytes()).collect()),
        of("f64.nrrd", "double", rounded().flat_map(f64::to_le_bytes).collect()),
    ];
    for stack in &stacks {
        for k in 0..SIZES[2] {
            assert_eq!(levels(stack, k), levels(&stacks[0], k));
        }
    }
    for (n, u) in levels(&stacks[0], 6).near() {
        assert_eq!(f64::from(*u), LEVEL - value(n % SIZES[0], n / SIZES[0], 6).round());
    }
}

/// The command line, from a grey volume to a volume and what is said of it.
#[test]
fn a_sphere_comes_out_as_large_as_it_is() {
    let place = folder();
    let [input, report] = ["grey.nrrd", "report.json"].map(|name| place.path().join(name));
    write_floats(&input);
    let [input, report] = [input, report].map(|path| path.display().to_string());
    let mesh = place.path().join("sphere.stl").display().to_string();
    let level = LEVEL.to_string();
    let made =
        ["reconstruct", &input, "--level", &level, "--backend", "cpu", "--dz", "1", "-o", &mesh, "--report", &report];
    let output = interslice(&made);
    assert!(output.status.success(), "{}", stderr(&output));
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(report).expect("a report")).expect("the report is JSON");
    let volume = report["volume"]["value"].as_f64().or_else(|| report["volume"].as_f64()).expect("a volume");
    let exact = 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3);
    assert!((volume / exact - 1.0).abs() < 0.02, "{volume} of {exact}");
    let output = interslice(&["inspect", &input, "--level", &level]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && said.contains("grey values from "), "{said}");
}

#[test]
fn what_cannot_be_cut_is_refused() {
    let place = folder();
    let path = place.path().join("grey.nrrd");
    write_floats(&path);
    let input = path.display().to_string();
    let refused = |more: &[&str], words: &[&str]| {
        let output = interslice(&[&["reconstruct", &input, "-o", "never.stl"], more].concat());
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        words.iter().for_each(|word| assert!(said.contains(word), "{said} lacks {word}"));
    };
    refused(&[], &["grey.nrrd", "voxel x = 0, y = 0, z = 0 ", "whole numbers", "level"]);
    refused(&["--level", "2000"], &["level", "2000", "range"]);
    refused(&["--level", "nan"], &["level", "NaN"]);
    refused(&["--level", &LEVEL.to_string(), "--label", "1"], &["--level", "cannot be used with", "--label"]);
    refused(&["--level", &LEVEL.to_string(), "--labels", "all"], &["labels", "grey"]);
    refused(&["--level", &LEVEL.to_string(), "--slices", "0,1"], &["grey.nrrd", "2 chosen slices", "above the level"]);
    let bytes: Vec<u8> = values().flat_map(|v| (v as f32).to_le_bytes()).collect();
    let place = |[i, j, k]: [usize; 3]| 4 * (i + SIZES[0] * (j + SIZES[1] * k));
    for (at, value, words) in [
        ([18, 2, 0], f32::INFINITY, "voxel x = 18, y = 2, z = 0 is inf"),
        ([7, 30, 11], f32::NAN, "voxel x = 7, y = 30, z = 11 is NaN"),
    ] {
        let mut bytes = bytes.clone();
        bytes[place(at)..place(at) + 4].copy_from_slice(&value.to_le_bytes());
        write(&path, "float", &bytes);
        refused(&["--level", &LEVEL.to_string()], &["grey.nrrd", words, "on the other side of the level"]);
    }
}

/// What lies below a level is what lies above it of the values negated, and what is black of images what is white of their negatives.
#[test]
fn what_lies_below_is_what_lies_above_of_the_negated_values() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    let floats = |sign: f32| values().flat_map(|v| (sign * v as f32).to_le_bytes()).collect::<Vec<u8>>();
    write(&path("own.nrrd"), "float", &floats(1.0));
    write(&path("negated.nrrd"), "float", &floats(-1.0));
    let read = |name: &str, level: f64, invert: bool| {
        read(&path(name), &ReadOptions { level: Some(level), invert, ..Default::default() })
    };
    let [above, below] = [("own.nrrd", LEVEL, false), ("negated.nrrd", -LEVEL, true)]
        .map(|(name, level, invert)| read(name, level, invert).expect("the volume is sound"));
    for k in 0..SIZES[2] {
        let [a, b] = [&above, &below].map(|stack| levels(stack, k));
        assert!(a.sides() == b.sides() && a.near() == b.near(), "slice {k}");
    }
    // The other side is another body.
    let other = read("own.nrrd", LEVEL, true).expect("the volume is sound");
    assert!(levels(&other, 6).sides() != levels(&above, 6).sides());
    let most = f64::from(values().fold(0.0, f64::max) as f32);
    let refused = read("own.nrrd", most + 1.0, true).expect_err("nothing lies above").to_string();
    assert!(refused.contains(&format!(", {most}], the range of the volume's values")), "{refused}");

    // Of two values they are masks, of more grey slices.
    for level in [None, Some(105.0)] {
        let ends = if level.is_some() { [10, 200] } else { [0, 255] };
        let images = |name: &str, invert: bool| {
            let folder = path(&format!("{name} {}", ends[0]));
            fs::create_dir(&folder).expect("a folder can be made");
            for k in 0..3 {
                let value = |x: u32, y: u32| match (f64::from(x) - 9.5).hypot(f64::from(y) - 8.0) < 4.0 + f64::from(k) {
                    true => ends[1],
                    false if level.is_some() && x < 2 => 77,
                    false => ends[0],
                };
                let shown = |v: u8| if invert { ends[0] + ends[1] - v } else { v };
                let image = image::GrayImage::from_fn(20, 18, |x, y| image::Luma([shown(value(x, y))]));
                image.save(folder.join(format!("s{k}.png"))).expect("an image can be written");
            }
            let options = ReadOptions { level, spacing: Some(vec![1.0, 1.0, 2.0]), invert, ..Default::default() };
            interslice::input::read(&folder, &options).expect("the images are sound")
        };
        let [plain, inverted] = [("plain", false), ("inverted", true)].map(|(name, invert)| images(name, invert));
        assert!(plain.slices[2].content.sides().iter().filter(|inside| **inside).count() > 80);
        for (a, b) in plain.slices.iter().zip(&inverted.slices) {
            assert_eq!(a.content.sides(), b.content.sides(), "{level:?}, {}", a.name);
        }
    }
}
