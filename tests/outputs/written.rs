//! A cone, and files that are made of it.

use std::path::{Path, PathBuf};

use interslice::evaluate::demo::demo;
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::{JobOptions, Loaded};
use interslice::progress::Silent;
use interslice::report::Report;
use interslice::stack::ContourStack;
use interslice::{Budget, Means, Reconstruction, Reference, Settings, reconstruct_with};

/// Writes `names` of a stack into `place`; gives the report.
pub fn write(place: &Path, stack: &ContourStack, settings: &Settings, output: OutputOptions, names: &[&str]) -> Report {
    let options = JobOptions { settings: settings.clone(), output, ..JobOptions::default() };
    let loaded = Loaded::new(stack.clone(), options).expect("the stack is sound");
    let paths: Vec<PathBuf> = names.iter().map(|n| place.join(n)).collect();
    let mut outputs =
        Outputs::open(&paths, None, Temporary::Random, &mut Places::default()).expect("the folder is there");
    let budget = Budget::unlimited();
    let means = Means { backend: &Reference, progress: &Silent, budget: &budget };
    let mut body = loaded.compute(&means, &mut outputs).expect("it can be computed");
    outputs.complete(&mut body.report).expect("it can be written");
    outputs.rename().expect("it can be renamed");
    body.report
}

pub fn collected(stack: &ContourStack, settings: &Settings) -> Reconstruction {
    let heights = interslice::height_grid(stack, settings, None).heights().expect("a few");
    reconstruct_with(stack, &heights, settings, &Reference, &Silent).expect("it can be computed")
}

/// A disc that shrinks by a pixel a slice.
pub fn cone() -> ContourStack {
    drawn([64, 60], &[0.0, 3.0, 6.0, 9.0], |x, y, z| (x - 31.3).hypot(y - 29.6) < 24.0 - z)
}

/// What lies `inside`, on slices at these heights.
pub fn drawn([nx, ny]: [usize; 2], heights: &[f64], inside: impl Fn(f64, f64, f64) -> bool) -> ContourStack {
    let mut stack = demo("fig10").expect("a demo").stack;
    let mut slice = stack.slices[0].clone();
    stack.dims = [nx, ny];
    stack.spacing = [1.0, 1.0];
    stack.z_out = None;
    let place = |k: usize| [(k % nx) as f64, (k / nx) as f64];
    stack.slices = heights
        .iter()
        .map(|&z| {
            let mask = (0..nx * ny).map(place).map(|[x, y]| inside(x, y, z)).collect();
            slice.content = interslice::stack::SliceContent::Mask(mask);
            slice.name = format!("z{z}");
            slice.z = z;
            slice.clone()
        })
        .collect();
    stack
}
