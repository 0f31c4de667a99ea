//! A stack of masks, made here, becomes a mesh: `cargo run --release --example masks_to_mesh body.stl`.

use std::path::PathBuf;

use interslice::{ContourStack, Geometry, Result, Settings, Slice, SliceContent, reconstruct, write};

/// Pixels along either side of a slice, and their size, mm.
const SIDE: usize = 96;
const PIXEL: f64 = 0.5;

/// A trunk that forks: two discs that part with the height.
fn fork(k: usize) -> SliceContent {
    let apart = 5.0 * k as f64;
    let centre = (SIDE - 1) as f64 / 2.0;
    let inside = |node: usize| {
        let (x, y) = ((node % SIDE) as f64 - centre, (node / SIDE) as f64 - centre);
        (x - apart).hypot(y) < 12.0 || (x + apart).hypot(y) < 12.0
    };
    SliceContent::Mask((0..SIDE * SIDE).map(inside).collect())
}

/// Reconstructs the fork and writes it into `path`; the volume of the mesh, mm3.
pub fn run(path: PathBuf) -> Result<f64> {
    let slice = |k: usize| Slice { name: format!("slice {k}"), z: 3.0 * k as f64, extra: false, content: fork(k) };
    let stack = ContourStack {
        dims: [SIDE; 2],
        spacing: [PIXEL; 2],
        unit: "mm".into(),
        slices: (0..6).map(slice).collect(),
        z_out: None,
        geometry: Geometry::default(),
        known: None,
    };
    let body = reconstruct(&stack, &Settings::default())?;
    for interval in &body.report.intervals {
        interval.events.iter().for_each(|event| println!("{} to {} mm: {event:?}", interval.z_low, interval.z_high));
    }
    write(&body, &[path])?;
    Ok(body.mesh().volume())
}

#[allow(dead_code, reason = "a test calls `run`")]
fn main() -> Result<()> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "fork.stl".into());
    let volume = run(path.clone().into())?;
    println!("{path}: {volume:.1} mm3");
    Ok(())
}
