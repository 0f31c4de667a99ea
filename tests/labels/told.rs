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
