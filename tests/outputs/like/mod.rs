//! `--like`: outputs on the grid of another volume.

#[cfg(feature = "dicom")]
mod series;

use std::fs;
use std::path::Path;

use crate::files::{folder, interslice, nrrd, stderr};
use glam::DVec3;
use interslice::input::read_surveyed;
use interslice::input::volume::Volume;
use interslice::stack::ReadOptions;

fn run(arguments: &[&str]) -> std::process::Output {
    interslice(&[&["reconstruct", "--backend", "cpu", "-q"], arguments].concat())
}

fn done(arguments: &[&str]) {
    let output = run(arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", stderr(&output));
}

fn refused(arguments: &[&str], says: &str) {
    let output = run(arguments);
    assert!(output.status.code() == Some(2) && stderr(&output).contains(says), "{arguments:?}: {}", stderr(&output));
}

/// A volume as the program reads it: itself, and its voxels, x fastest.
fn read(path: &Path) -> (Volume, Vec<i64>) {
    let options = ReadOptions { keep: Some(1), ..ReadOptions::default() };
    let volume = read_surveyed(path, &options).unwrap_or_else(|e| panic!("{e}")).1.expect("a volume").volume;
    let (dims, mut voxels) = (volume.grid.dims, vec![0; volume.voxels()]);
    let each = volume.labels(|run| {
        let mut at = run.first;
        for value in run.values {
            voxels[at[0] + dims[0] * (at[1] + dims[1] * at[2])] = *value;
            at[run.along] += 1;
        }
    });
    each.expect("it can be decoded");
    (volume, voxels)
}

const SIZES: [usize; 3] = [24, 20, 13];
const HEADER: &str =
    "space: LPS\nspace directions: (0.8,0.6,0) (-1.2,1.6,0) (0,0,2.5)\nspace origin: (10,-20.5,300)\nencoding: raw";

/// Whether a place in the world is in a tube around voxels (11, 9, k).
fn tube(place: DVec3, slack: f64) -> bool {
    let at = place - DVec3::new(10.0, -20.5, 300.0);
    let (i, j) = (at.dot(DVec3::new(0.8, 0.6, 0.0)), at.dot(DVec3::new(-0.6, 0.8, 0.0)));
    (i - 11.0).hypot(j - 18.0) < 8.0 + slack && (0.0..=30.0).contains(&at.z)
}

/// The tube as label 4 on every third slice.
fn input(place: &Path) -> String {
    let [nx, ny, nz] = SIZES;
    let label = |n: usize| {
        let [i, j, k] = [n % nx, n / nx % ny, n / (nx * ny)].map(|n| n as f64);
        let at = DVec3::new(10.0 + 0.8 * i - 1.2 * j, -20.5 + 0.6 * i + 1.6 * j, 300.0 + 2.5 * k);
        u8::from(k % 3.0 == 0.0 && tube(at, 0.0)) * 4
    };
    let path = place.join("in.nrrd");
    fs::write(&path, nrrd(HEADER, "uint8", SIZES, &(0..nx * ny * nz).map(label).collect::<Vec<_>>())).expect("a file");
    path.display().to_string()
}

#[test]
fn a_volume_lies_on_the_grid_of_another() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let given = input(place.path());
    // Finer, wider, from the top, its columns and rows swapped, its first axis backwards, aligned with the world.
    let frames = [
        ("turned", "(0,0,-1) (0,0.7,0) (-0.9,0,0)", "(30,-25,335)", [40, 60, 50]),
        ("world", "(0.5,0,0) (0,0.5,0) (0,0,2)", "(-20,-25,296)", [100, 120, 20]),
    ];
    for (name, directions, origin, sizes) in frames {
        let like = at(&format!("{name}.nrrd"));
        let header = format!("space: LPS\nspace directions: {directions}\nspace origin: {origin}\nencoding: raw");
        fs::write(&like, nrrd(&header, "uint8", sizes, &vec![1; sizes.iter().product()])).expect("a file");
        for format in ["nrrd", "nii.gz", "mha"] {
            let out = at(&format!("{name}-out.{format}"));
            let foretold =
                interslice(&["reconstruct", &given, "--like", &like, "-o", &out, "--backend", "cpu", "--dry-run"]);
            let [nx, ny, nz] = sizes;
            let said = format!("would write: {out}, {nx} x {ny} x {nz} voxels\n");
            let text = String::from_utf8_lossy(&foretold.stdout);
            assert!(text.contains(&said), "{said}{text}{}", stderr(&foretold));
            done(&[&given, "--like", &like, "-o", &out]);
            let (wanted, _) = read(Path::new(&like));
            let (volume, voxels) = read(Path::new(&out));
            assert_eq!(volume.grid.dims, sizes, "{name}, {format}");
            assert!(volume.grid.origin.abs_diff_eq(wanted.grid.origin, 1e-4), "{name}, {format}");
            assert!((0..3).all(|a| volume.grid.steps[a].abs_diff_eq(wanted.grid.steps[a], 1e-6)), "{name}, {format}");
            let [mut inside, mut wrong] = [0, 0];
            for (n, label) in voxels.iter().enumerate() {
                let ijk = [n % sizes[0], n / sizes[0] % sizes[1], n / (sizes[0] * sizes[1])];
                let at = (0..3).fold(wanted.grid.origin, |at, a| at + ijk[a] as f64 * wanted.grid.steps[a]);
                // Half a pixel, and the ends of the body, are the slices' own affair.
                let sure =
                    tube(at, 1.2) == tube(at, -1.2) && (at.z - 300.0).abs() > 1e-6 && (at.z - 330.0).abs() > 1e-6;
                inside += usize::from(*label == 4);
                wrong += usize::from(sure && (*label == 4) != tube(at, 0.0));
            }
            assert!(inside > 1000 && wrong == 0, "{name}, {format}: {inside} inside, {wrong} wrong");
        }
    }
}

#[test]
fn the_inputs_own_grid_changes_nothing() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let given = input(place.path());
    for options in [&["--distance"][..], &[], &["--labels", "all"]] {
        done(&[&[&given[..], "-o", &at("plain.nrrd")], options].concat());
        done(&[&[&given[..], "-o", &at("like.nrrd"), "--like", &given], options].concat());
        let [plain, like] = ["plain.nrrd", "like.nrrd"].map(|name| fs::read(at(name)).expect("written"));
        assert!(plain == like, "{options:?}");
    }
}

#[test]
fn what_cannot_be_is_told() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let given = input(place.path());
    let write =
        |name: &str, header: &str| fs::write(at(name), nrrd(header, "uint8", [4, 4, 4], &[1; 64])).expect("a file");
    write(
        "oblique.nrrd",
        "space: LPS\nspace directions: (1,0,0) (0,0.8,0.6) (0,-0.6,0.8)\nspace origin: (0,0,300)\nencoding: raw",
    );
    write("far.nrrd", "space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,900)\nencoding: raw");
    // The slices reach from (-12.8, -20.5) to (28.4, 23.7).
    for (name, place) in [("east", "(30,0,300)"), ("south", "(0,-26,300)")] {
        let header =
            format!("space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: {place}\nencoding: raw");
        write(&format!("{name}.nrrd"), &header);
        refused(
            &[&given, "-o", &at("out.nrrd"), "--like", &at(&format!("{name}.nrrd"))],
            "no place in common with the slices",
        );
    }
    write("plain.nrrd", "encoding: raw");
    let out = at("out.nrrd");
    refused(&[&given, "-o", &out, "--like", &at("oblique.nrrd")], "oblique to the slices by 36.87 degrees");
    refused(&[&given, "-o", &out, "--like", &at("far.nrrd")], "meet no part of the body");
    refused(&[&given, "-o", &out, "--like", &at("plain.nrrd")], "does not say how far apart its voxels are");
    refused(&[&given, "-o", &out, "--like", &at("none.nrrd")], "none.nrrd");
    refused(&[&given, "-o", &out, "--like", &given, "--dz", "1"], "cannot be used with");
    fs::copy(&given, at("same.nrrd")).expect("it can be copied");
    refused(&[&given, "-o", &at("same.nrrd"), "--like", &at("same.nrrd")], "is the input");
    assert!(!Path::new(&out).exists());
}

/// A volume in micrometres beside one in millimetres.
#[test]
fn what_a_grid_cuts_off_is_told() {
    let place = folder();
    let input = input(place.path());
    let [grid, out] = ["grid.nrrd", "out.nrrd"].map(|name| place.path().join(name).display().to_string());
    let told = |sizes: [usize; 3], header: &str| {
        std::fs::write(&grid, nrrd(header, "uint8", sizes, &vec![0; sizes.iter().product()]))
            .expect("it can be written");
        let run = interslice(&["reconstruct", "--backend", "cpu", &input, "--label", "4", "--like", &grid, "-o", &out]);
        assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
        stderr(&run).lines().find(|line| line.contains("`like`")).map(String::from)
    };
    let [nx, ny, nz] = SIZES;
    assert_eq!(told(SIZES, HEADER), None);
    // Its first twelve columns end in the middle of the tube, and its first planes below its upper slices.
    let columns = told([12, ny, nz], HEADER).expect("half of it is cut off");
    assert!(["45 %", "46 %", "47 %"].iter().any(|share| columns.contains(share)), "{columns}");
    let planes = told([nx, ny, 7], HEADER).expect("two slices of five are cut off");
    assert!(planes.contains("40 % of what is drawn lies beyond the grid"), "{planes}");
    // Coarser, and turned, and all of it is there.
    let turned =
        "space: LPS\nspace directions: (-1.2,1.6,0) (0.8,0.6,0) (0,0,2.5)\nspace origin: (10,-20.5,300)\nencoding: raw";
    assert_eq!(told([ny, nx, nz], turned), None);
}

#[test]
fn a_grid_in_another_unit_is_told() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let given = input(place.path());
    let bytes = fs::read(&given).expect("it is there");
    let end = bytes.windows(2).position(|w| w == b"\n\n").expect("a header");
    let grid = [&bytes[..end], b"\nspace units: \"um\" \"um\" \"um\"", &bytes[end..]].concat();
    fs::write(at("um.nrrd"), grid).expect("a file can be written");
    for (like, says) in [("um.nrrd", true), ("same.nrrd", false)] {
        fs::copy(&given, at("same.nrrd")).expect("it can be copied");
        let result =
            interslice(&["reconstruct", "--backend", "cpu", &given, "-o", &at("out.nrrd"), "--like", &at(like)]);
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        let told = stderr(&result).contains("`like` names a grid in um, and the slices are in mm");
        assert_eq!(told, says, "{}", stderr(&result));
    }
}
