//! Meshes of thin oblique parts: what they lack of their layers is told, and how to have it.

use std::fs;

use crate::files::*;
use serde_json::Value;

const SIZES: [usize; 3] = [90, 40, 13];

/// A tube that moves by so many pixels per layer, on every fourth of them: mesh and layers' volume, and what was told of it.
fn reconstructed(radius: f64, motion: f64, more: &[&str]) -> (f64, f64, Vec<String>) {
    let [nx, ny, nz] = SIZES;
    let inside = |n: usize| {
        let (i, j, k) = (n % nx, n / nx % ny, n / (nx * ny));
        k % 4 == 0 && (i as f64 - 15.2 - motion * k as f64).hypot(j as f64 - 20.3) <= radius
    };
    let voxels: Vec<u8> = (0..nx * ny * nz).map(|n| u8::from(inside(n))).collect();
    let place = folder();
    let [input, mesh, report] = ["in.nrrd", "out.stl", "out.json"].map(|name| place.path().join(name));
    fs::write(&input, nrrd("spacings: 1 1 2\nencoding: raw", "uint8", SIZES, &voxels)).expect("a file can be written");
    let [input, mesh, to] = [&input, &mesh, &report].map(|path| path.to_str().expect("temporary paths are UTF-8"));
    let run = ["reconstruct", input, "-o", mesh, "-o", to, "--backend", "cpu"];
    let done = interslice(&[&run[..], more].concat());
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let report: Value = serde_json::from_slice(&fs::read(&report).expect("there is a report")).expect("JSON");
    let warnings = report["warnings"].as_array().expect("warnings").iter();
    let told: Vec<String> =
        warnings.filter_map(Value::as_str).filter(|w| w.starts_with("the mesh holds")).map(Into::into).collect();
    assert!(told.iter().all(|warning| stderr(&done).contains(warning)), "{}", stderr(&done));
    let number = |value: &Value| value.as_f64().expect("a number");
    (number(&report["volume"]), number(&report["areas"]["between_contours"]), told)
}

#[test]
fn a_mesh_thinner_than_its_layers_is_told() {
    let (mesh, layers, told) = reconstructed(2.5, 4.0, &[]);
    assert!(mesh < 0.75 * layers, "{mesh} of {layers}");
    let [warning] = &told[..] else { panic!("{told:?}") };
    let share = format!("the mesh holds {:.0} % of the volume of its layers", 100.0 * mesh / layers);
    assert!(warning.starts_with(&share), "{warning}");
    // With the step that it names the mesh has what it lacked, and nothing is told.
    let dz = warning.split("`--dz ").nth(1).and_then(|rest| rest.split('`').next()).expect("a step");
    let (finer, layers, told) = reconstructed(2.5, 4.0, &["--dz", dz]);
    assert!(finer > 0.94 * layers && finer > 1.3 * mesh, "{finer} of {layers}");
    assert!(told.is_empty(), "{told:?}");
    // One as thick moves as far, one as thin not at all.
    for (radius, motion) in [(8.0, 4.0), (2.5, 0.0), (1.0, 0.0)] {
        let (mesh, layers, told) = reconstructed(radius, motion, &[]);
        assert!(told.is_empty(), "{radius} {motion}: {mesh} of {layers}, {told:?}");
    }
}
