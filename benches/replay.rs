//! What the host does of a run, stage by stage: every answer of the device is recorded once and then given at no cost.
//!
//! `cargo bench --bench replay [-- cpu] [FOLDER ...]`: the stacks of these folders, or of `INTERSLICE_STACKS` (separated by colons), or else the
//! example; by the default, without fairing and by the field method, on 2 and on 16 threads. With `cpu` the reference path is recorded, not a GPU.

mod stacks;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use interslice::backend::replay::{Recorder, Replay};
use interslice::input::read;
use interslice::progress::Silent;
use interslice::report::StageCost;
use interslice::settings::Method;
use interslice::stack::{ContourStack, ReadOptions};
use interslice::{Backend, Reconstruction, Reference, Result, Settings, height_grid, reconstruct_with};
use stacks::named_stacks;

/// Replays of each run; the fastest counts, as what disturbs a run only adds to it.
const ROUNDS: usize = 3;

/// Says to rayon how many threads there are.
const THREADS: &str = "RAYON_NUM_THREADS";

fn main() {
    // A process for each number of threads, so that the pool's threads do not run the pipeline too.
    if std::env::var_os(THREADS).is_none() {
        for threads in ["2", "16"] {
            let itself = std::env::current_exe().and_then(|program| {
                Command::new(program).args(std::env::args_os().skip(1)).env(THREADS, threads).status()
            });
            match itself {
                Ok(end) if end.success() => {}
                other => println!("failed: {other:?}"),
            }
        }
        return;
    }
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let on_cpu = arguments.iter().any(|a| a == "cpu");
    let folders: Vec<PathBuf> = arguments.iter().filter(|a| *a != "cpu").map(PathBuf::from).collect();
    let folders = if folders.is_empty() { named_stacks() } else { folders };
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/jacksboro");
    let folders = if folders.is_empty() { vec![example] } else { folders };
    let done = backend(on_cpu).and_then(|backend| {
        println!("\n{} threads, answers of {}", rayon::current_num_threads(), backend.name());
        folders.iter().try_for_each(|folder| stack(&*backend, folder))
    });
    if let Err(e) = done {
        println!("failed: {e}");
    }
}

#[cfg(feature = "gpu")]
fn backend(on_cpu: bool) -> Result<Box<dyn Backend>> {
    use interslice::gpu::{Gpu, GpuOptions};
    let adapter = std::env::var("INTERSLICE_ADAPTER").ok();
    Ok(match on_cpu {
        true => Box::new(Reference),
        false => Box::new(Gpu::open(&GpuOptions { adapter, ..GpuOptions::default() })?),
    })
}

#[cfg(not(feature = "gpu"))]
fn backend(_on_cpu: bool) -> Result<Box<dyn Backend>> {
    Ok(Box::new(Reference))
}

/// All ways for a stack.
fn stack(backend: &dyn Backend, folder: &Path) -> Result<()> {
    let stack = read(folder, &ReadOptions::default())?;
    let [nx, ny] = stack.dims;
    println!("\n{}: {nx} x {ny} px, {} slices", folder.display(), stack.slices.len());
    let all = Settings::default();
    let ways = [
        ("default", all.clone()),
        ("--fair 0", Settings { fair: 0.0, ..all.clone() }),
        ("--method field", Settings { method: Method::Field, ..all }),
    ];
    ways.iter().try_for_each(|(name, settings)| replayed(backend, &stack, settings, name))
}

fn run(backend: &dyn Backend, stack: &ContourStack, settings: &Settings) -> Result<Reconstruction> {
    let heights = height_grid(stack, settings, None).heights()?;
    reconstruct_with(stack, &heights, settings, backend, &Silent)
}

fn replayed(backend: &dyn Backend, stack: &ContourStack, settings: &Settings, name: &str) -> Result<()> {
    let recorder = Recorder::new(backend);
    drop(run(&recorder, stack, settings)?);
    let recording = recorder.recording();
    let mut fastest: Option<(f64, Vec<StageCost>)> = None;
    for _ in 0..ROUNDS {
        let replay = Replay::new(recording.clone());
        let begin = Instant::now();
        let body = run(&replay, stack, settings)?;
        let seconds = begin.elapsed().as_secs_f64();
        let stages = body.report.profile.map(|profile| profile.stages).unwrap_or_default();
        if fastest.as_ref().is_none_or(|(known, _)| seconds < *known) {
            fastest = Some((seconds, stages));
        }
    }
    let Some((seconds, stages)) = fastest else { return Ok(()) };
    let words = |s: Option<f64>| s.map_or("-".into(), |s| format!("{s:.3}"));
    println!("{name}: {seconds:.3} s");
    println!("{:>20} {:>10} {:>8}", "stage", "host CPU s", "serial s");
    for stage in &stages {
        println!("{:>20} {:>10} {:>8}", stage.name, words(stage.host_seconds), words(stage.serial_seconds));
    }
    let sum = |of: fn(&StageCost) -> Option<f64>| words(stages.iter().map(of).sum::<Option<f64>>());
    println!("{:>20} {:>10} {:>8}", "all", sum(|stage| stage.host_seconds), sum(|stage| stage.serial_seconds));
    Ok(())
}
