//! Large synthetic stacks, streamed: every layer is reduced to a checksum and an 8-bit mask and forgotten.
//!
//! `cargo bench --bench scale -- SIDE SLICES LAYERS gpu|cpu [MEMORY_MIB]`, e.g. `2048 16 256 gpu`. Prints one line per run: seconds by stage,
//! on a GPU the host's CPU seconds, largest resident set, checksum. Without numbers it runs a small one.

use std::hash::{DefaultHasher, Hasher};
use std::time::Instant;

use interslice::progress::Silent;
use interslice::stack::{ContourStack, Geometry, Slice, SliceContent};
use interslice::{Backend, Budget, Means, Reference, Settings, reconstruct_into};

/// Discs with five lobes that drift, turn, meet and part.
fn stack(side: usize, slices: usize) -> ContourStack {
    let cells = 4;
    let pitch = side as f64 / cells as f64;
    let contents = (0..slices).map(|k| {
        let turn = 0.35 * k as f64;
        let mut mask = vec![false; side * side];
        for cell in 0..cells * cells {
            let (cx, cy) = ((cell % cells) as f64 + 0.5, (cell / cells) as f64 + 0.5);
            let phase = turn + cell as f64;
            let (cx, cy) = (pitch * (cx + 0.05 * phase.cos()), pitch * (cy + 0.05 * phase.sin()));
            let radius = pitch * (0.32 + 0.1 * (0.6 * phase).sin());
            let rows = ((cy - 0.5 * pitch) as usize)..((cy + 0.5 * pitch) as usize).min(side);
            for j in rows {
                for i in ((cx - 0.5 * pitch) as usize)..((cx + 0.5 * pitch) as usize).min(side) {
                    let (x, y) = (i as f64 - cx, j as f64 - cy);
                    let r = radius * (1.0 + 0.15 * (5.0 * y.atan2(x) + phase).cos());
                    mask[j * side + i] |= x.hypot(y) < r;
                }
            }
        }
        mask
    });
    let slices = contents
        .enumerate()
        .map(|(k, mask)| Slice {
            name: format!("slice {k}"),
            z: k as f64 * 8.0,
            extra: false,
            content: SliceContent::Mask(mask.into_iter().collect()),
        })
        .collect();
    ContourStack {
        dims: [side, side],
        spacing: [1.0, 1.0],
        unit: "px".into(),
        slices,
        z_out: None,
        geometry: Geometry::default(),
        known: None,
    }
}

/// Largest resident set so far, MiB, as the operating system counts it.
fn peak_mib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) >> 10
}

fn run(stack: &ContourStack, layers: usize, backend: &dyn Backend) {
    let top = stack.slices.last().map_or(0.0, |s| s.z);
    let heights: Vec<f64> = (0..layers).map(|k| top * k as f64 / (layers - 1) as f64).collect();
    let mut hasher = DefaultHasher::new();
    let (mut count, mut inside) = (0usize, 0usize);
    let mut mask = Vec::new();
    let begin = Instant::now();
    let result = reconstruct_into(
        stack,
        &heights,
        &Settings::default(),
        &Means { backend, progress: &Silent, budget: &Budget::unlimited() },
        &mut |layer: interslice::surface::Layer| {
            if layer.output {
                mask.clear();
                mask.extend(layer.phi.iter().map(|v| u8::from(*v < 0.0)));
                inside += mask.iter().map(|m| usize::from(*m)).sum::<usize>();
                layer.phi.iter().for_each(|v| hasher.write_u32(v.to_bits()));
                count += 1;
            }
            Ok(())
        },
    );
    match result {
        Ok(body) => {
            let stages: Vec<String> =
                body.report.stages.iter().map(|s| format!("{} {:.2}", s.name, s.seconds)).collect();
            let pixels: usize = body.report.intervals.iter().map(|i| i.trace_pixels + i.sweep_pixels).sum();
            // Without what takes the layers, which looks at every pixel.
            let costs = body.report.profile.iter().flat_map(|p| &p.stages).filter(|s| s.name != "output");
            let costs: Vec<(&str, f64)> = costs.filter_map(|s| Some((&*s.name, s.host_seconds?))).collect();
            let host: f64 = costs.iter().map(|(_, seconds)| seconds).sum();
            let costs: Vec<String> = costs.iter().map(|(name, seconds)| format!("{name} {seconds:.2}")).collect();
            println!(
                "{} px, {} slices to {count} layers on {}: {:.2} s ({}), host CPU {host:.2} s without the layers' taker ({}), {:.1} M band pixels updated, {} MiB at most, {inside} px inside, checksum {:016x}",
                stack.dims[0],
                stack.slices.len(),
                backend.name(),
                begin.elapsed().as_secs_f64(),
                stages.join(", "),
                costs.join(", "),
                pixels as f64 * 1e-6,
                peak_mib(),
                hasher.finish()
            );
        }
        Err(e) => println!("failed: {e}"),
    }
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let number = |k: usize, default: usize| words.get(k).and_then(|w| w.parse().ok()).unwrap_or(default);
    let stack = stack(number(0, 512), number(1, 6));
    let layers = number(2, 41);
    match words.get(3).map(String::as_str) {
        #[cfg(feature = "gpu")]
        Some("gpu") => {
            let memory = words.get(4).and_then(|w| w.parse::<u64>().ok()).map(|m| m << 20);
            let options = interslice::gpu::GpuOptions { memory, ..Default::default() };
            match interslice::gpu::Gpu::open(&options) {
                Ok(gpu) => run(&stack, layers, &gpu),
                Err(e) => println!("failed: {e}"),
            }
        }
        _ => run(&stack, layers, &Reference),
    }
}
