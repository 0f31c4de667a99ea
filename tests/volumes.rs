//! Label volumes in and volumes out: which slices are taken, and geometry carried through.

#[path = "support/files.rs"]
mod files;

use std::fs;
use std::io::Write;
use std::path::Path;

use files::*;
use flate2::Compression;
use flate2::write::GzEncoder;
use interslice::stack::{ContourStack, ReadOptions, SliceContent, read};

const SIZES: [usize; 3] = [24, 20, 13];
/// Rotated about z by asin 0.6 and tilted in no way: an oblique but rectangular grid, in LPS.
const DIRECTIONS: &str = "(0.8,0.6,0) (-1.2,1.6,0) (0,0,2.5)";
const ORIGIN: &str = "(10,-20.5,300)";

/// A disc of label 3 on every third slice, one pixel of label 7 on slice 4.
fn labels() -> Vec<i16> {
    let [nx, ny, nz] = SIZES;
    (0..nx * ny * nz)
        .map(|n| {
            let (i, j, k) = (n % nx, n / nx % ny, n / (nx * ny));
            let r = 5.0 + k as f64 / 4.0;
            let in_disc = (i as f64 - 11.0).hypot(j as f64 - 9.0) < r;
            match k {
                4 if (i, j) == (2, 2) => 7,
                _ if k % 3 == 0 && in_disc => 3,
                _ => 0,
            }
        })
        .collect()
}

fn write_labels(path: &Path) {
    let data: Vec<u8> = labels().iter().flat_map(|v| v.to_be_bytes()).collect();
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(&data).expect("memory can be written");
    let header = format!(
        "space: left-posterior-superior\nspace directions: {DIRECTIONS}\nspace origin: {ORIGIN}\nendian: big\nencoding: gzip\nspace units: \"mm\" \"mm\" \"mm\""
    );
    let bytes = nrrd(&header, "int16", SIZES, &gzip.finish().expect("memory can be written"));
    fs::write(path, bytes).expect("a file can be written");
}

fn stack(path: &Path, options: ReadOptions) -> ContourStack {
    read(path, &options).expect("the volume is sound")
}

#[test]
fn slices_are_chosen_by_label_keep_or_number() {
    let place = folder();
    let path = place.path().join("labels.nrrd");
    write_labels(&path);
    let heights = |options| stack(&path, options).slices.iter().map(|s| s.z / 2.5).collect::<Vec<_>>();
    assert_eq!(heights(ReadOptions::default()), [0.0, 3.0, 4.0, 6.0, 9.0, 12.0]);
    assert_eq!(heights(ReadOptions { label: Some(3), ..Default::default() }), [0.0, 3.0, 6.0, 9.0, 12.0]);
    assert_eq!(heights(ReadOptions { keep: Some(6), ..Default::default() }), [0.0, 6.0, 12.0]);
    assert_eq!(heights(ReadOptions { slices: Some(vec![9, 0, 5, 9]), ..Default::default() }), [0.0, 5.0, 9.0]);
    let all = stack(&path, ReadOptions::default());
    assert_eq!(all.slices[2].name, "k=4");
    let SliceContent::Mask(mask) = &all.slices[2].content else { panic!("labels are masks") };
    assert_eq!(mask.iter().position(|m| *m), Some(2 * 24 + 2));
    assert_eq!(mask.iter().filter(|m| **m).count(), 1);
    assert_eq!(all.spacing.map(|s| (s * 1e9).round() / 1e9), [1.0, 2.0]);
    assert_eq!(all.z_out.map(|g| (g.start, g.step, g.count)), Some((0.0, 2.5, 13)));
    assert!(read(&path, &ReadOptions { label: Some(5), ..Default::default() }).is_err());
    assert!(read(&path, &ReadOptions { slices: Some(vec![0, 13]), ..Default::default() }).is_err());
    assert!(read(&path, &ReadOptions { keep: Some(0), ..Default::default() }).is_err());
    assert!(read(&path, &ReadOptions { level: Some(1.0), ..Default::default() }).is_err());
}

/// What the program writes as a mask is read back with the same geometry and the same contours.
fn round_trip(output: &str) {
    let place = folder();
    let (input, target) = (place.path().join("labels.nrrd"), place.path().join(output));
    write_labels(&input);
    let arguments = [
        "reconstruct",
        &input.display().to_string(),
        "--label",
        "3",
        "--mask",
        "-q",
        "-o",
        &target.display().to_string(),
    ];
    let result = interslice(&arguments);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    assert!(result.stderr.is_empty() && result.stdout.is_empty(), "-q says nothing");
    let given = stack(&input, ReadOptions { label: Some(3), ..Default::default() });
    let back = stack(&target, ReadOptions { keep: Some(1), ..Default::default() });
    assert_eq!(back.dims, given.dims);
    assert_eq!(back.slices.len(), SIZES[2], "the volume's own grid");
    for axis in 0..3 {
        assert!((back.geometry.origin[axis] - given.geometry.origin[axis]).abs() < 1e-4);
        for k in 0..3 {
            assert!((back.geometry.axes[axis][k] - given.geometry.axes[axis][k]).abs() < 1e-6);
        }
    }
    for slice in &given.slices {
        let same = back.slices.iter().find(|s| (s.z - slice.z).abs() < 1e-4).expect("a slice at the contour's height");
        for n in 0..slice.content.len() {
            assert_eq!(same.content.inside(n), slice.content.inside(n), "{}: pixel {n}", slice.name);
        }
    }
    let between: usize = (0..SIZES[0] * SIZES[1]).filter(|&n| back.slices[1].content.inside(n)).count();
    assert!(between > 60, "the gap is filled: {between} px");
}

#[test]
fn nrrd_round_trip() {
    round_trip("out.nrrd");
}

#[test]
fn nifti_round_trips() {
    round_trip("out.nii");
    round_trip("out.nii.gz");
}

#[test]
fn distances_are_written_in_physical_units() {
    let place = folder();
    sound_stack(place.path());
    let text = fs::read_to_string(place.path().join("stack.json")).expect("it was written");
    write_stack(place.path(), &text.replace("[1.0, 1.0]", "[2.0, 2.0]"));
    let target = place.path().join("out.nii");
    let arguments = ["reconstruct", &place.path().display().to_string(), "-q", "-o", &target.display().to_string()];
    assert_eq!(interslice(&arguments).status.code(), Some(0));
    let bytes = fs::read(&target).expect("the volume was written");
    let voxel = |i: usize, j: usize, k: usize| {
        let at = 352 + 4 * (i + 32 * (j + 32 * k));
        f32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
    };
    assert_eq!(bytes.len(), 352 + 4 * 32 * 32 * 9);
    // The disc of radius 8 px about (15.5, 15.5), 2 mm per pixel: 5 px off the centre it is 3 px to the contour.
    assert!((voxel(15, 20, 0) + 2.0 * 3.5).abs() < 0.4, "{}", voxel(15, 20, 0));
    assert!((voxel(15, 27, 0) - 2.0 * 3.5).abs() < 0.4, "{}", voxel(15, 27, 0));
}
