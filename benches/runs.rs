//! Whole runs, masks in memory to the last layer in memory, on all threads: the example, the demos, the same contours in wider images,
//! and any folders named in `INTERSLICE_STACKS` (separated by colons).
//!
//! `cargo bench --bench runs`

mod stacks;

use std::path::Path;

use divan::Bencher;
use interslice::evaluate::demo::demo;
use interslice::input::read;
use interslice::stack::{ContourStack, ReadOptions};
use interslice::surface::mesh::closed_surface;
use interslice::{Settings, reconstruct};
use stacks::{named_stacks, widened};

fn main() {
    divan::main();
}

fn example() -> Option<ContourStack> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/jacksboro");
    read(&folder, &ReadOptions::default()).ok()
}

#[divan::bench(sample_count = 3)]
fn jacksboro(bencher: Bencher) {
    let Some(stack) = example() else { return };
    bencher.bench(|| reconstruct(&stack, &Settings::default()));
}

#[divan::bench(sample_count = 3)]
fn jacksboro_mesh_alone(bencher: Bencher) {
    let Some(body) = example().and_then(|s| reconstruct(&s, &Settings::default()).ok()) else { return };
    bencher.bench(|| closed_surface(&body));
}

#[divan::bench(args = interslice::evaluate::demo::NAMES, sample_count = 5)]
fn demos(bencher: Bencher, name: &str) {
    let Some(demo) = demo(name) else { return };
    bencher.bench(|| reconstruct(&demo.stack, &demo.settings));
}

/// Fig. 10 in an image this many times as wide and high: after the distance stage the cost must be the same.
#[divan::bench(args = [1, 2, 4], sample_count = 5)]
fn fig10_in_a_wider_image(bencher: Bencher, times: usize) {
    let Some(demo) = demo("fig10") else { return };
    let stack = widened(&demo.stack, times);
    let after_distance = |stack: &ContourStack| {
        reconstruct(stack, &demo.settings)
            .map(|r| r.report.stages.iter().filter(|s| s.name != "distance").map(|s| s.seconds).sum::<f64>())
    };
    if let Ok(seconds) = after_distance(&stack) {
        println!("{times}x: {seconds:.3} s after the distance stage");
    }
    bencher.bench(|| reconstruct(&stack, &demo.settings));
}

#[divan::bench(args = named_stacks().iter().map(|p| p.display().to_string()).collect::<Vec<_>>(), sample_count = 3)]
fn named(bencher: Bencher, folder: &String) {
    let Ok(stack) = read(Path::new(folder), &ReadOptions::default()) else { return };
    bencher.bench(|| reconstruct(&stack, &Settings::default()));
}
