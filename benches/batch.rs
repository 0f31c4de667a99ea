//! Many small structures: one batch against one process per job.
//!
//! `cargo bench --bench batch -- COUNT cpu|gpu [ROUNDS]`, e.g. `60 cpu 3`. Makes `COUNT` label volumes of 100 x 100 x 12 voxels, 1 x 1 x 3 mm, and
//! reconstructs each at 1 mm into a volume and a mesh: by `interslice batch`, by `interslice reconstruct` one after another, and by as many of
//! these at once as there are cores. Every round does all three; the ratios are those of the medians. Fails unless all make the same bytes.

use std::fs;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

use serde_json::json;

const SIDE: usize = 100;
const SLICES: usize = 12;

/// A lobed tube whose size, place and lobes vary with `k`.
fn volume(k: usize) -> Vec<u8> {
    let phase = k as f64;
    let mut labels = vec![0u8; SIDE * SIDE * SLICES];
    for (n, label) in labels.iter_mut().enumerate() {
        let (i, j, s) = (n % SIDE, n / SIDE % SIDE, (n / SIDE / SIDE) as f64);
        let (cx, cy) = (49.5 + 8.0 * (0.3 * s + phase).sin(), 49.5 + 8.0 * (0.2 * s + 2.0 * phase).cos());
        let (x, y) = (i as f64 - cx, j as f64 - cy);
        let r = (20.0 + 6.0 * (0.5 * s + phase).sin()) * (1.0 + 0.2 * (3.0 * y.atan2(x) + 0.2 * s).cos());
        *label = u8::from(x.hypot(y) < r);
    }
    let mut nrrd = format!(
        "NRRD0004\ntype: uchar\ndimension: 3\nsizes: {SIDE} {SIDE} {SLICES}\nspacings: 1 1 3\nencoding: raw\n\n"
    )
    .into_bytes();
    nrrd.extend(labels);
    nrrd
}

fn outputs(folder: &str, k: usize) -> [String; 2] {
    [format!("{folder}/{k:03}.nrrd"), format!("{folder}/{k:03}.stl")]
}

fn program(arguments: &[&str], place: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_interslice"));
    command.args(arguments).current_dir(place).stdout(Stdio::null());
    command
}

fn batch(place: &Path, backend: &str) -> std::io::Result<bool> {
    Ok(program(&["batch", "manifest.jsonl", "--backend", backend, "-q"], place).status()?.success())
}

/// Jobs `first`, `first + step`, ... each by a process of its own.
fn processes(place: &Path, backend: &str, count: usize, first: usize, step: usize) -> std::io::Result<bool> {
    let mut all = true;
    for k in (first..count).step_by(step) {
        let [nrrd, stl] = outputs("alone", k);
        let input = format!("cases/{k:03}.nrrd");
        let arguments =
            ["reconstruct", &input, "--dz", "1", "-o", &nrrd, "-o", &stl, "--backend", backend, "-q"].map(String::from);
        all &= program(&arguments.each_ref().map(String::as_str), place).status()?.success();
    }
    Ok(all)
}

fn several(place: &Path, backend: &str, count: usize, at_once: usize) -> std::io::Result<bool> {
    std::thread::scope(|scope| {
        let threads: Vec<_> =
            (0..at_once).map(|first| scope.spawn(move || processes(place, backend, count, first, at_once))).collect();
        let results = threads.into_iter().map(|t| t.join().unwrap_or_else(|_| Err(std::io::Error::other("panicked"))));
        results.collect::<std::io::Result<Vec<bool>>>().map(|all| all.into_iter().all(|ok| ok))
    })
}

fn run(count: usize, backend: &str, rounds: usize) -> std::io::Result<bool> {
    let place = tempfile::tempdir()?;
    let place = place.path();
    fs::create_dir(place.join("cases"))?;
    let mut manifest = String::new();
    for k in 0..count {
        fs::write(place.join(format!("cases/{k:03}.nrrd")), volume(k))?;
        let job = json!({
            "id": k.to_string(), "input": format!("cases/{k:03}.nrrd"), "outputs": outputs("out", k), "options": {"dz": 1}
        });
        manifest += &format!("{job}\n");
    }
    fs::write(place.join("manifest.jsonl"), manifest)?;
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let mut seconds = [vec![], vec![], vec![]];
    for _ in 0..rounds {
        for (way, taken) in seconds.iter_mut().enumerate() {
            for name in ["out", "alone"] {
                let _ = fs::remove_dir_all(place.join(name));
            }
            let _ = fs::remove_file(place.join("results.jsonl"));
            fs::create_dir(place.join("alone"))?;
            let begin = Instant::now();
            let all = match way {
                0 => batch(place, backend)?,
                1 => processes(place, backend, count, 0, 1)?,
                _ => several(place, backend, count, cores)?,
            };
            taken.push(begin.elapsed().as_secs_f64());
            if !all {
                return Ok(false);
            }
        }
        // The last way has left its outputs; the batch's are made again beside them.
        if !batch(place, backend)? {
            return Ok(false);
        }
        for k in 0..count {
            for (a, b) in outputs("out", k).iter().zip(outputs("alone", k)) {
                if fs::read(place.join(a))? != fs::read(place.join(&b))? {
                    println!("{a} and {b} differ");
                    return Ok(false);
                }
            }
        }
    }
    let median = |mut v: Vec<f64>| {
        v.sort_by(f64::total_cmp);
        v[v.len() / 2]
    };
    let [batch, one, at_once] = seconds.map(median);
    let rate = |s: f64| 3600.0 * count as f64 / s;
    println!("{count} jobs on {backend}, {cores} cores, median of {rounds}:");
    println!("  batch                        {batch:7.2} s, {:6.0} jobs per hour", rate(batch));
    println!(
        "  a process per job            {one:7.2} s, {:6.0} jobs per hour: batch is {:.2} times as fast",
        rate(one),
        one / batch
    );
    println!(
        "  the same, {cores} at once           {at_once:7.2} s, {:6.0} jobs per hour: {:.2} times",
        rate(at_once),
        at_once / batch
    );
    Ok(true)
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let number = |k: usize, default: usize| words.get(k).and_then(|w| w.parse().ok()).unwrap_or(default).max(1);
    let backend = words.get(1).map_or("cpu", String::as_str);
    match run(number(0, 8), backend, number(2, 1)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(e) => {
            println!("{e}");
            ExitCode::FAILURE
        }
    }
}
