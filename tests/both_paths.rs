//! Whole reconstructions on the GPU and on the reference path, compared.
#![cfg(feature = "gpu")]

use interslice::demo::{NAMES, demo};
use interslice::gpu::{Gpu, GpuOptions};
use interslice::progress::Silent;
use interslice::{ContourStack, Reconstruction, Reference, Settings, height_grid, reconstruct_with};

fn both(stack: &ContourStack, settings: &Settings) -> [Reconstruction; 2] {
    let gpu = Gpu::open(&GpuOptions::default()).expect("an adapter");
    let heights = height_grid(stack, settings, None).heights().expect("a grid");
    let a = std::time::Instant::now();
    let on_gpu = reconstruct_with(stack, &heights, settings, &gpu, &Silent).expect("GPU");
    println!("gpu {:?}", a.elapsed());
    let a = std::time::Instant::now();
    let on_cpu = reconstruct_with(stack, &heights, settings, &Reference, &Silent).expect("reference");
    println!("cpu {:?}", a.elapsed());
    println!("{:?}\n{:?}", on_gpu.report.stages, on_cpu.report.stages);
    println!("{:#?}", gpu.profile());
    [on_gpu, on_cpu]
}

#[test]
fn demos() {
    for name in NAMES {
        let d = demo(name).expect("demo");
        let [a, b] = both(&d.stack, &d.settings);
        let mut differ = 0usize;
        let mut near = 0usize;
        let mut off = 0usize;
        let mut worst = 0.0f32;
        for (x, y) in a.layers.iter().zip(&b.layers) {
            for (p, q) in x.phi.iter().zip(&y.phi) {
                differ += usize::from((*p < 0.0) != (*q < 0.0));
                if q.abs() < 3.0 {
                    near += 1;
                    off += usize::from((p - q).abs() > 0.02);
                    worst = worst.max((p - q).abs());
                }
            }
        }
        println!("{name}: {differ} differ, {off} of {near} off, worst {worst}");
    }
}
