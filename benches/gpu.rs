//! The GPU path beside the reference path, measured in one run on whatever adapter is best (or `INTERSLICE_ADAPTER`).
//!
//! `cargo bench --bench gpu`: kernels in px/s from timestamp queries, what a dispatch costs, the distance on large slices, Fig. 10 in
//! wider images, and the stacks named in `INTERSLICE_STACKS` (folders, separated by colons), by both methods.

#[cfg(not(feature = "gpu"))]
fn main() {
    println!("built without the `gpu` feature: nothing to measure");
}

#[cfg(feature = "gpu")]
fn main() {
    match gpu::all() {
        Ok(()) => {}
        Err(e) => println!("failed: {e}"),
    }
}

#[cfg(feature = "gpu")]
mod stacks;

#[cfg(feature = "gpu")]
mod gpu {
    use std::time::Instant;

    use interslice::evaluate::demo::demo;
    use interslice::gpu::selftest::single_kernels::DistanceReach;
    use interslice::gpu::{Gpu, GpuOptions};
    use interslice::grid::field::Field;
    use interslice::input::read;
    use interslice::progress::Silent;
    use interslice::report::{KernelCost, Profile};
    use interslice::settings::Method;
    use interslice::stack::{ContourStack, ReadOptions};
    use interslice::{Backend, Reconstruction, Reference, Result, Settings, height_grid, reconstruct_with};

    use crate::stacks::{named_stacks, widened};

    fn open(timed: bool) -> Result<Gpu> {
        let adapter = std::env::var("INTERSLICE_ADAPTER").ok();
        Gpu::open(&GpuOptions { adapter, timed, ..GpuOptions::default() })
    }

    pub fn all() -> Result<()> {
        let gpu = open(false)?;
        println!("{}\n{}", gpu.name(), Reference.name());
        if let Some(demo) = demo("fig9") {
            kernels("fig9", &demo.stack, &demo.settings)?;
            kernels("fig9 by the field method", &demo.stack, &by_field(&demo.settings))?;
        }
        copies(&gpu)?;
        distances(&gpu)?;
        wider_images(&gpu)?;
        stacks(&gpu)
    }

    fn run(backend: &dyn Backend, stack: &ContourStack, settings: &Settings) -> Result<(f64, Reconstruction)> {
        let heights = height_grid(stack, settings, None).heights()?;
        let begin = Instant::now();
        let body = reconstruct_with(stack, &heights, settings, backend, &Silent)?;
        Ok((begin.elapsed().as_secs_f64(), body))
    }

    /// The field method alone: what fairing costs is not the GPU's.
    fn by_field(settings: &Settings) -> Settings {
        Settings { method: Method::Field, fair: 0.0, ..settings.clone() }
    }

    /// Every kernel on a stack, the second of two runs, so that nothing is compiled in it.
    fn kernels(name: &str, stack: &ContourStack, settings: &Settings) -> Result<()> {
        let gpu = open(true)?;
        run(&gpu, stack, settings)?;
        let before = gpu.profile();
        let (seconds, body) = run(&gpu, stack, settings)?;
        let after = gpu.profile();
        let cost = |p: &Profile, name: &str| p.kernels.get(name).copied().unwrap_or_default();
        println!("\nkernels, {name} (timed: every dispatch in a pass of its own)");
        let (mut total, mut dispatches) = (0.0, 0);
        for kernel in after.kernels.keys() {
            let (a, b) = (cost(&before, kernel), cost(&after, kernel));
            let k = KernelCost {
                dispatches: b.dispatches - a.dispatches,
                seconds: b.seconds - a.seconds,
                pixels: b.pixels - a.pixels,
            };
            total += k.seconds;
            dispatches += k.dispatches;
            let each = 1e6 * k.seconds / k.dispatches.max(1) as f64;
            let rate = if k.pixels > 0 { format!("{:8.1}", k.pixels as f64 / k.seconds * 1e-6) } else { "-".into() };
            println!(
                "{kernel:>20} {:8.2} ms, {:5} dispatches, {each:8.1} us each, {rate:>8} Mpx/s",
                1e3 * k.seconds,
                k.dispatches
            );
        }
        let steps: usize = body.report.intervals.iter().map(|i| i.trace_steps + i.sweep_steps).sum();
        let pixels: usize = body.report.intervals.iter().map(|i| i.trace_pixels + i.sweep_pixels).sum();
        println!("{:.1} ms on the device of {:.1} ms, {dispatches} dispatches", 1e3 * total, 1e3 * seconds);
        if pixels > 0 {
            println!("{steps} steps of jobs, {:.1} ns per band pixel and step", 1e9 * total / pixels as f64);
        }
        let plain = open(false)?;
        run(&plain, stack, settings)?;
        let (on_gpu, gpu_body) = run(&plain, stack, settings)?;
        let (on_cpu, cpu_body) = run(&Reference, stack, settings)?;
        println!("{name} untimed: GPU {on_gpu:.3} s, reference {on_cpu:.3} s, ratio {:.2}", on_gpu / on_cpu);
        for (a, b) in gpu_body.report.stages.iter().zip(&cpu_body.report.stages) {
            println!(
                "{:>20} GPU {:.3} s, reference {:.3} s, ratio {:.2}",
                a.name,
                a.seconds,
                b.seconds,
                a.seconds / b.seconds
            );
        }
        Ok(())
    }

    /// Bytes that the adapter's memory brings at most: what kernels read and write can be held against it.
    fn copies(gpu: &Gpu) -> Result<()> {
        let (bytes, count) = (128u64 << 20, 20);
        let seconds = gpu.copies(bytes, count)?;
        let moved = (2 * bytes * count as u64) as f64;
        println!("\ncopies of {} MiB: {:.0} GB/s read and written", bytes >> 20, 1e-9 * moved / seconds);
        Ok(())
    }

    /// Signed distance to a star on n x n pixels: near its contour, and everywhere.
    fn distances(gpu: &Gpu) -> Result<()> {
        println!("\ndistance (patches of 16 x 16 px, a workgroup each, two colours in turn, to the fixed point)");
        for n in [1024usize, 2048, 4096] {
            let star = Field::from_fn([n, n], |i, j| {
                let (x, y) = (i as f64 - 0.5 * n as f64, j as f64 - 0.5 * n as f64);
                x.hypot(y) - 0.3 * n as f64 * (1.0 + 0.2 * (5.0 * y.atan2(x)).cos())
            });
            let star = [star];
            let seconds = |reach| -> Result<f64> {
                let begin = Instant::now();
                gpu.distances(&star, [1.0, 1.0], reach)?;
                Ok(begin.elapsed().as_secs_f64())
            };
            let (near, far) = (seconds(DistanceReach::Within(32.0))?, seconds(DistanceReach::Everywhere)?);
            let begin = Instant::now();
            interslice::reference::distance::distance_of(&star[0], [1.0, 1.0]);
            let twin = begin.elapsed().as_secs_f64();
            println!(
                "{n}^2: within 32 px {near:.2} s, everywhere {far:.2} s; reference, one thread, everywhere {twin:.2} s"
            );
        }
        Ok(())
    }

    /// Fig. 10 in an image this many times as wide and high: after the distance stage the cost must be the same.
    fn wider_images(gpu: &Gpu) -> Result<()> {
        let Some(demo) = demo("fig10") else { return Ok(()) };
        println!("\nfig10 in wider images, seconds after the distance stage (median of 5)");
        for times in [1, 2, 4] {
            let stack = widened(&demo.stack, times);
            let mut seconds = Vec::new();
            for _ in 0..5 {
                let (_, body) = run(gpu, &stack, &demo.settings)?;
                seconds
                    .push(body.report.stages.iter().filter(|s| s.name != "distance").map(|s| s.seconds).sum::<f64>());
            }
            seconds.sort_by(f64::total_cmp);
            println!("{times}x: {:.3} s", seconds[2]);
        }
        Ok(())
    }

    /// Masks in memory to the last layer in memory, pipelines warm.
    fn stacks(gpu: &Gpu) -> Result<()> {
        for path in named_stacks() {
            let stack = read(&path, &ReadOptions::default())?;
            let settings = Settings::default();
            let (first, _) = run(gpu, &stack, &settings)?;
            let (again, _) = run(gpu, &stack, &settings)?;
            let (on_cpu, _) = run(&Reference, &stack, &settings)?;
            println!("\n{}: GPU {first:.3} s cold, {again:.3} s warm; reference {on_cpu:.3} s", path.display());
            kernels("the same by the field method", &stack, &by_field(&settings))?;
        }
        Ok(())
    }
}
