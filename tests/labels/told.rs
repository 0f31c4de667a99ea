//! What a run of many labels says.

use std::fs;
use std::path::Path;

use crate::files::*;

fn text(path: &Path) -> &str {
    path.to_str().expect("a name in UTF-8")
}

/// Labels that keep apart have nothing to decide, whatever their distances do.
#[test]
fn what_was_decided_between_labels_is_told_without_contradiction() {
    let place = folder();
    let (path, out) = (place.path().join("in.nrrd"), place.path().join("out.nrrd"));
    let wide = 44;
    for (apart, told) in
        [(24, "2 labels: no overlaps and no gaps between them to decide\n"), (11, "2 labels, 2 changed by others: ")]
    {
        let label = |n: usize| -> u8 {
            let [i, j, k] = [n % wide, n / wide % 24, n / (24 * wide)].map(|n| n as f64);
            let disc = |x: f64| (i - x).hypot(j - 12.0) < 5.0 + 0.1 * k;
            match k as usize % 4 {
                0 if disc(10.0) => 1,
                0 if disc(10.0 + f64::from(apart) - 0.3 * k) => 2,
                _ => 0,
            }
        };
        let voxels: Vec<u8> = (0..wide * 24 * 9).map(label).collect();
        let bytes = crate::files::nrrd("spacings: 1 1 1\nencoding: raw", "uint8", [wide, 24, 9], &voxels);
        fs::write(&path, bytes).expect("a file can be written");
        let done = interslice(&["reconstruct", text(&path), "--labels", "all", "--backend", "cpu", "-o", text(&out)]);
        let said = stderr(&done);
        assert!(done.status.success() && said.contains(told), "{apart} px apart: {said}");
    }
}

/// The least that is foretold is enough, and a MiB less is refused.
#[test]
fn a_dry_run_foretells_what_labels_need() {
    let place = folder();
    let (path, out) = (place.path().join("in.nrrd"), place.path().join("out.nrrd"));
    // A large disc with a small one beside it, which touch on every fourth slice.
    let label = |n: usize| -> u8 {
        let [i, j, k] = [n % 200, n / 200 % 150, n / (200 * 150)].map(|n| n as f64);
        match k as usize % 4 {
            0 if (i - 70.0).hypot(j - 75.0) < 60.0 => 7,
            0 if (i - 140.0).hypot(j - 75.0) < 15.0 => 9,
            _ => 0,
        }
    };
    let voxels: Vec<u8> = (0..200 * 150 * 13).map(label).collect();
    let bytes = crate::files::nrrd("spacings: 1 1 1\nencoding: raw", "uint8", [200, 150, 13], &voxels);
    fs::write(&path, bytes).expect("a file can be written");
    let run = ["reconstruct", text(&path), "--labels", "all", "--axis", "z", "-o", text(&out)];
    let run = |more: &[&str]| interslice(&[&run[..], &["--backend", "cpu", "--threads", "2"], more].concat());
    let foretold = run(&["--dry-run"]);
    let said = String::from_utf8_lossy(&foretold.stdout).into_owned();
    assert!(said.contains("on 2 cores of this CPU, "), "{said}");
    let least = said.split_once("(or ").and_then(|(_, rest)| rest.split_once(" MiB")?.0.parse::<u64>().ok());
    let least = least.unwrap_or_else(|| panic!("no memory: {said}"));
    for (memory, code) in [(least, 0), (least - 1, 2)] {
        let done = run(&["--memory", &format!("{memory}M")]);
        assert_eq!(done.status.code(), Some(code), "{memory} MiB: {}", stderr(&done));
        assert_eq!(out.exists(), code == 0, "{memory} MiB");
        let _ = fs::remove_file(&out);
    }
}

#[test]
fn labels_of_parts_that_pixels_do_not_resolve_are_told() {
    let place = folder();
    let (path, out) = (place.path().join("in.nrrd"), place.path().join("out.nrrd"));
    // A disc, and beside it single pixels of eleven labels.
    let label = |n: usize| -> u8 {
        let [i, j, k] = [n % 44, n / 44 % 24, n / (44 * 24)];
        match (i as f64 - 10.0).hypot(j as f64 - 12.0) < 6.0 {
            _ if k % 4 > 0 => 0,
            true => 1,
            false if i > 20 && i % 2 == 0 && j == 12 => ((i - 20) / 2 + 1) as u8,
            false => 0,
        }
    };
    let voxels: Vec<u8> = (0..44 * 24 * 9).map(label).collect();
    let bytes = crate::files::nrrd("spacings: 1 1 1\nencoding: raw", "uint8", [44, 24, 9], &voxels);
    fs::write(&path, bytes).expect("a file can be written");
    let labels = ["--labels", "all", "--axis", "z", "--backend", "cpu"];
    let done = interslice(&[&["reconstruct", text(&path), "-o", text(&out)], &labels[..]].concat());
    let said = stderr(&done);
    assert!(done.status.success(), "{said}");
    let told: Vec<&str> = said.lines().filter(|line| line.contains("at most 3 px")).collect();
    assert!(told.len() == 8 && told[0].starts_with("warning: label 2: 3 parts of slices have at most 3 px"), "{said}");
    assert!(said.contains("3 more labels have many parts of so few pixels"), "{said}");
}

/// What a run of one body says of its slices, a run of many says of each.
#[test]
fn what_slices_of_labels_lack_is_told() {
    use crate::own_slices::{Disc, SIZES, decided, volume};
    let slices = [0, 2, 4, 6, 8, 20, 22, 24];
    let disc = |label, x, slices| Disc { label, at: [x, 24.0], radius: 6.0, slices };
    let lacking: Vec<usize> = slices.into_iter().filter(|k| *k != 4).collect();
    let mut voxels = volume(&[disc(1, 10.0, &slices), disc(2, 28.0, &slices), disc(2, 48.0, &lacking)]);
    let hole = 10 + (24 + 22 * SIZES[1]) * SIZES[0];
    voxels[hole..hole + 2].fill(0);
    let notes = decided(&voxels, &interslice::stack::ReadOptions::default(), 1).1;
    let told = |words: &str| notes.iter().filter(|note| note.contains(words)).count();
    assert_eq!(told("slices lie 2.000 apart, but none between 8.000 and 20.000"), 2, "{notes:?}");
    assert_eq!(told("label 2: a part that the slices below and above have"), 1, "{notes:?}");
    assert_eq!(told("label 1: 1 hole of at most 2 px lies in the midst"), 1, "{notes:?}");
    assert_eq!(notes.len(), 4, "{notes:?}");
}
