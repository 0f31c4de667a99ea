//! The programs of `examples/`, as a user would run them.

#[path = "../../examples/labels_to_labels.rs"]
mod labels_to_labels;
#[path = "../../examples/masks_to_mesh.rs"]
mod masks_to_mesh;
#[path = "../../examples/streaming_layers.rs"]
mod streaming_layers;

use std::fs;
use std::path::Path;

use interslice::{Error, ReadOptions};

#[test]
fn masks_become_a_mesh() {
    let place = crate::files::folder();
    let path = place.path().join("fork.stl");
    let volume = masks_to_mesh::run(path.clone()).expect("it can be reconstructed");
    // By the trapezoidal rule: one disc below, two that overlap less and less above; the end rule adds half a slice or so at either end.
    let disc = std::f64::consts::PI * 36.0;
    assert!((1.5 * disc * 15.0..2.2 * disc * 18.0).contains(&volume), "{volume} mm3");
    let facets =
        u64::from_le_bytes([&fs::read(&path).expect("it is there")[80..84], &[0; 4]].concat().try_into().expect("8"));
    assert_eq!(fs::metadata(&path).expect("it is there").len(), 84 + 50 * facets, "a whole STL");
}

#[test]
fn labels_are_filled_in_between() {
    let place = crate::files::folder();
    let (input, output) = (place.path().join("in.nrrd"), place.path().join("out.nrrd"));
    // Label 7 is painted on every fourth of 9 slices.
    let voxel = |n: usize| {
        u8::from((n / 400).is_multiple_of(4) && (n % 20).abs_diff(10) < 6 && (n / 20 % 20).abs_diff(10) < 5) * 7
    };
    let data: Vec<u8> = (0..9 * 400).map(voxel).collect();
    fs::write(&input, crate::files::nrrd("encoding: raw\nspacings: 1 1 2", "uint8", [20, 20, 9], &data))
        .expect("a file can be written");
    let report = labels_to_labels::run(&input, output.clone()).expect("it can be filled");
    assert_eq!(report.labels.iter().map(|l| l.label).collect::<Vec<_>>(), [7]);
    assert_eq!(report.labels[0].voxels, Some(9 * 11 * 9), "the same rectangle on every slice");
    let both = labels_to_labels::run(&input, input.clone());
    assert!(matches!(both, Err(Error::Output { .. })), "the input stays: {both:?}");
}

#[test]
fn layers_are_streamed() {
    let areas = streaming_layers::run(Path::new("examples/jacksboro")).expect("it can be reconstructed");
    let stack = interslice::read(Path::new("examples/jacksboro"), &ReadOptions::default()).expect("it can be read");
    assert!(areas.len() > stack.slices.len(), "{} layers", areas.len());
    assert!(areas.windows(2).all(|pair| pair[0].0 < pair[1].0), "from bottom to top");
    assert!(areas.iter().any(|(_, area)| *area > 0.0));
}
