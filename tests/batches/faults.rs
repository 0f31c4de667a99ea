//! Batches under faults: killed, interrupted, out of disk, inputs corrupted or removed, the device lost. Nothing finished is lost or changed,
//! what failed is named, and the resumed result is that of an uninterrupted run, byte for byte.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::AtomicBool;
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::cases::*;
use crate::files::*;
use interslice::batch::{Job, Machine, Manifest, Options, Outcome, Watch, machine::Work, run};
use interslice::{Reconstruction, Reference, Result};

/// A run that nothing interrupts: its outputs, and how long it took at least of three.
fn undisturbed(place: &Path) -> (BTreeMap<String, Vec<u8>>, Duration) {
    let seconds = (0..3).map(|_| {
        let _ = fs::remove_dir_all(place.join("out"));
        let _ = fs::remove_file(place.join("results.jsonl"));
        let begin = Instant::now();
        let result = batch(place, &[]);
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        begin.elapsed()
    });
    let fastest = seconds.min().expect("three");
    (outputs(place), fastest)
}

/// Number of jobs in `files`, all of whose outputs are there.
fn complete(files: &BTreeMap<String, Vec<u8>>) -> usize {
    files.len() / OUTPUTS.len()
}

/// Uniform in [0, 1), the same sequence in every run.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 40) as f64 / (1u64 << 24) as f64
}

/// How often a fault is tried here, and by `tests/campaign faults`.
fn trials(here: usize, campaign: usize) -> usize {
    if std::env::var_os("INTERSLICE_FAULTS").is_some() { campaign } else { here }
}

/// What so many blows met: a running batch, which ended by a signal or with failed jobs; one with some jobs done; how many left temporary files.
#[derive(Debug, Default)]
struct Met {
    alive: usize,
    by_signal: usize,
    in_the_middle: usize,
    leftovers: usize,
}

/// Strikes a batch of 12 jobs at random moments, so that it ends. Under their own names there are whole files only; a run after each makes what
/// is missing, touches nothing that was finished, and in the end all is as after an undisturbed one.
fn struck(trials: usize, strike: impl Fn(&mut Child)) -> Met {
    let place = folder();
    let ids = cases(place.path(), 12);
    let (whole, mut took) = undisturbed(place.path());
    let (mut met, mut seed) = (Met::default(), 25u64);
    for trial in 0..trials {
        fs::remove_dir_all(place.path().join("out")).expect("it is there");
        fs::remove_file(place.path().join("results.jsonl")).expect("it is there");
        // Where memory is out, Rust's own backtrace waits for itself.
        let mut quiet = command(place.path(), &["-q"]);
        let mut child = quiet.env_remove("RUST_BACKTRACE").spawn().expect("the program starts");
        sleep(took.mul_f64(random(&mut seed)));
        let was_alive = child.try_wait().expect("it can be asked").is_none();
        strike(&mut child);
        let ended = child.wait_with_output().expect("it ends");
        let before = done(place.path());
        let left = outputs(place.path());
        met.alive += usize::from(was_alive && ended.status.code() != Some(0));
        met.by_signal += usize::from(ended.status.signal().is_some());
        if !was_alive {
            // The machine is faster than it was at first.
            took = took.mul_f64(0.85);
        }
        met.in_the_middle += usize::from(was_alive && !before.is_empty() && before.len() < ids.len());
        met.leftovers += usize::from(left.keys().any(|name| name.ends_with(".tmp")));
        for (name, bytes) in finished_outputs(place.path()) {
            assert!(whole[&name] == bytes, "trial {trial}: {name} is not what it must become");
        }
        let stamps = |ids: &[String]| -> Vec<_> {
            let paths = ids.iter().flat_map(|id| OUTPUTS.map(|e| place.path().join(format!("out/{id}.{e}"))));
            paths.map(|p| fs::metadata(&p).and_then(|m| m.modified()).expect("it is finished")).collect()
        };
        let finished = stamps(&before);
        fs::create_dir_all(place.path().join("out")).expect("a folder can be made");
        let resumed = batch(place.path(), &[]);
        assert_eq!(resumed.status.code(), Some(0), "trial {trial}: {}", stderr(&resumed));
        let counts = format!("{} done, {} finished before", ids.len() - before.len(), before.len());
        assert!(stderr(&resumed).contains(&counts), "trial {trial}: not `{counts}`: {}", stderr(&resumed));
        assert_eq!(stamps(&before), finished, "trial {trial}: what was finished is not touched");
        same(&whole, &outputs(place.path()));
        let mut all = done(place.path());
        all.sort();
        assert_eq!(all, ids, "trial {trial}: one line each");
    }
    println!("of {trials}: {met:?}");
    met
}

#[test]
fn killed_at_random_moments() {
    let trials = trials(25, 100);
    let met = struck(trials, |child| child.kill().expect("it can be killed"));
    assert!(100 * met.alive >= 72 * trials, "{met:?}");
    assert!(100 * met.in_the_middle >= 32 * trials && 100 * met.leftovers >= 12 * trials, "{met:?}");
}

/// From a random moment on it gets no more memory: it aborts. Late in a batch it has what it needs.
#[cfg(target_os = "linux")]
#[test]
fn out_of_memory_at_random_moments() {
    let trials = trials(6, 25);
    let met = struck(trials, |child| {
        // It may have ended, and nothing is left to be bounded.
        let _ = Command::new("prlimit").args(["--data=1", "--pid", &child.id().to_string()]).output();
    });
    assert!(3 * met.by_signal >= trials, "{met:?}");
}

#[test]
fn an_interrupt_ends_the_batch_in_good_order() {
    let place = folder();
    let ids = cases(place.path(), 30);
    let child = command(place.path(), &["--jobs", "1"]).spawn().expect("the program starts");
    wait_for(|| !done(place.path()).is_empty());
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill starts");
    assert!(sent.success());
    let ended = child.wait_with_output().expect("it ends");
    assert_eq!(ended.status.code(), Some(1), "{}", stderr(&ended));
    assert!(stderr(&ended).contains("0 jobs failed") && stderr(&ended).contains("not run"), "{}", stderr(&ended));
    let before = done(place.path());
    assert!(before.len() < ids.len(), "it was interrupted in time");
    assert_eq!(complete(&outputs(place.path())), before.len(), "what was begun is finished, nothing else is left");
    let resumed = batch(place.path(), &[]);
    assert!(stderr(&resumed).contains(&format!("{} finished before", before.len())), "{}", stderr(&resumed));
    assert_eq!(complete(&outputs(place.path())), ids.len());
}

/// Waits for something that happens within seconds.
fn wait_for(happened: impl Fn() -> bool) {
    let begin = Instant::now();
    while !happened() {
        assert!(begin.elapsed() < Duration::from_secs(60), "it did not happen");
        sleep(Duration::from_millis(2));
    }
}

#[test]
fn an_input_removed_and_one_corrupted_while_running() {
    let place = folder();
    let ids = cases(place.path(), 24);
    let (whole, _) = undisturbed(place.path());
    fs::remove_dir_all(place.path().join("out")).expect("it is there");
    fs::remove_file(place.path().join("results.jsonl")).expect("it is there");
    let child = command(place.path(), &["--jobs", "1"]).spawn().expect("the program starts");
    wait_for(|| !done(place.path()).is_empty());
    let removed = place.path().join("cases").join(&ids[23]);
    fs::rename(&removed, place.path().join("away")).expect("a folder can be renamed");
    let corrupt = slice(place.path(), &ids[22]);
    let sound = fs::read(&corrupt).expect("it is there");
    fs::write(&corrupt, &sound[..40]).expect("a file can be written");
    let ended = child.wait_with_output().expect("it ends");
    let said = stderr(&ended);
    assert_eq!(ended.status.code(), Some(1), "{said}");
    let last: Vec<&str> = said.lines().rev().take(2).map(str::trim_start).collect();
    assert!(last[0].starts_with("case23: ") && last[0].contains("cannot read"), "{said}");
    assert!(last[1].starts_with("case22: slice 1 (`s1.png`)"), "{said}");
    let made = outputs(place.path());
    assert_eq!(complete(&made), 22);
    assert!(made.iter().all(|(name, bytes)| whole[name] == *bytes));
    fs::rename(place.path().join("away"), &removed).expect("a folder can be renamed");
    fs::write(&corrupt, sound).expect("a file can be written");
    let resumed = batch(place.path(), &[]);
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    same(&whole, &outputs(place.path()));
}

/// Runs `script` with a shell in which `$1` is the program and `$2` the place; gives exit code and what it said.
fn shell(script: &str, place: &Path) -> (Option<i32>, String) {
    let output = Command::new("sh")
        .args(["-c", script, "sh", env!("CARGO_BIN_EXE_interslice")])
        .arg(place)
        .stdin(Stdio::null())
        .output()
        .expect("a shell starts");
    (output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output))
}

/// Some jobs have room, some not; what has is right, and the rest is made when there is room again.
fn out_of_room(place: &Path, whole: &BTreeMap<String, Vec<u8>>, code: Option<i32>, said: &str, why: &str) {
    assert_eq!(code, Some(1), "{said}");
    let ids = done(place);
    assert!(!ids.is_empty() && 3 * ids.len() < whole.len(), "some have room, some not: {ids:?}\n{said}");
    let failed: Vec<&str> = said.lines().rev().take_while(|l| l.starts_with("  case")).collect();
    assert_eq!(failed.len(), whole.len() / 3 - ids.len(), "all others are named: {said}");
    assert!(failed.iter().all(|l| l.contains(why)), "{said}");
    let made = outputs(place);
    assert!(made.keys().all(|name| !name.ends_with(".tmp")), "no temporary file is left: {:?}", made.keys());
    for id in &ids {
        OUTPUTS.iter().for_each(|e| assert!(made[&format!("{id}.{e}")] == whole[&format!("{id}.{e}")], "{id}.{e}"));
    }
    assert!(made.iter().all(|(name, bytes)| whole[name] == *bytes), "nothing half-written has its own name");
    let resumed = batch(place, &[]);
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    assert!(stderr(&resumed).contains(&format!("{} finished before", ids.len())), "{}", stderr(&resumed));
    same(whole, &outputs(place));
}

/// Writes beyond a length fail (RLIMIT_FSIZE): large outputs have no room, small ones do.
#[test]
fn files_that_may_not_grow() {
    let place = folder();
    cases(place.path(), 6);
    let (whole, _) = undisturbed(place.path());
    fs::remove_dir_all(place.path().join("out")).expect("it is there");
    fs::remove_file(place.path().join("results.jsonl")).expect("it is there");
    let mut largest: Vec<usize> = whole.iter().filter(|(n, _)| n.ends_with(".stl")).map(|(_, b)| b.len()).collect();
    largest.sort();
    // In blocks of 512 bytes, between the smallest and the largest mesh.
    let blocks = (largest[1] + largest[4]) / 2 / 512;
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$1\" batch \"$2/manifest.jsonl\" --backend cpu");
    let (code, said) = shell(&script, place.path());
    out_of_room(place.path(), &whole, code, &said, "File too large");
}

/// A disk that is full: a tmpfs over `out`, in a mount namespace of its own. Needs root or user namespaces; says so where there is neither.
#[test]
fn a_full_disk() {
    let place = folder();
    cases(place.path(), 6);
    let (whole, _) = undisturbed(place.path());
    let (out, kept) = (place.path().join("out"), place.path().join("kept"));
    let all = whole.values().map(Vec::len).sum::<usize>();
    let mut seed = 6;
    for trial in 0..trials(1, 20) {
        // Room for some and not for all: half at first.
        let share = if trial == 0 { 0.5 } else { 0.25 + 0.6 * random(&mut seed) };
        let room = (all as f64 * share) as usize;
        fs::remove_dir_all(&out).expect("it is there");
        fs::remove_file(place.path().join("results.jsonl")).expect("it is there");
        fs::create_dir(&out).expect("a folder can be made");
        let script = format!(
            "cd \"$2\" && mount -t tmpfs -o size={room} none out || exit 77; \
             \"$1\" batch \"$2/manifest.jsonl\" --backend cpu --jobs 1; code=$?; cp -a out kept; exit $code"
        );
        let script = format!("unshare --map-root-user --mount sh -c '{script}' sh \"$1\" \"$2\" || exit $?");
        let (code, said) = shell(&script, place.path());
        assert_ne!(code, Some(77), "no tmpfs can be mounted here, not even in a namespace: {said}");
        fs::remove_dir(&out).expect("nothing came past the mount");
        fs::rename(&kept, &out).expect("a folder can be renamed");
        out_of_room(place.path(), &whole, code, &said, "No space left on device");
    }
}

/// Collects what becomes of the jobs.
struct Quiet;

impl Watch for Quiet {
    fn ended(&self, _job: &Job, _outcome: &Outcome) {}
}

fn run_on(place: &Path, machine: &dyn Machine, name: &str) -> Vec<Outcome> {
    let manifest = Manifest::read(&place.join("manifest.jsonl")).expect("it is right");
    let options = Options { jobs: 2, memory: u64::MAX, fail_fast: false, pictures: false, machine: name.into() };
    let stop = AtomicBool::new(false);
    run(&manifest, &place.join("results.jsonl"), machine, &options, &Quiet, &stop).expect("the place can be used")
}

/// The reference path with a defect in the job that has this many pixels in its middle slice.
struct Defective(usize);

impl Machine for Defective {
    fn compute(&self, work: &Work<'_>) -> Result<Reconstruction> {
        let body = work(&Reference)?;
        assert!(body.report.contours[1].pixels != self.0, "on purpose");
        Ok(body)
    }
}

#[test]
fn a_job_that_panics_has_failed_and_the_others_are_done() {
    let place = folder();
    cases(place.path(), 4);
    assert!(run_on(place.path(), &Reference, "cpu").iter().all(|o| *o == Outcome::Done));
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(place.path().join("out/case02.json")).expect("written")).expect("JSON");
    let pixels = report["contours"][1]["pixels"].as_u64().expect("a count") as usize;
    fs::remove_dir_all(place.path().join("out")).expect("it is there");
    let outcomes = run_on(place.path(), &Defective(pixels), "cpu");
    for (k, outcome) in outcomes.iter().enumerate() {
        match outcome {
            Outcome::Failed(why) if k == 2 => assert!(why.contains("on purpose"), "{why}"),
            other => assert!(k != 2 && *other == Outcome::Done, "{k}: {other:?}"),
        }
    }
}

#[cfg(feature = "gpu")]
mod device {
    use std::sync::Mutex;

    use interslice::batch::shared_gpu::SharedGpu;
    use interslice::gpu::{Gpu, GpuOptions};

    use super::*;

    fn shared(fallback: bool, notice: &(dyn Fn(&str) + Sync)) -> SharedGpu<'_> {
        let options = GpuOptions::default();
        let gpu = Gpu::open(&options).expect("a Vulkan driver (tests/run installs lavapipe)");
        SharedGpu::new(gpu, options, fallback, notice)
    }

    /// Loses the device in the midst of a batch: after the first result.
    fn lose(place: &Path, shared: &SharedGpu<'_>) -> Vec<Outcome> {
        std::thread::scope(|scope| {
            scope.spawn(|| {
                wait_for(|| !done(place).is_empty());
                shared.gpu().device.destroy();
            });
            run_on(place, shared, "gpu")
        })
    }

    #[test]
    fn a_lost_device_is_opened_anew() {
        for fallback in [false, true] {
            let place = folder();
            cases(place.path(), 8);
            let told = Mutex::new(Vec::new());
            let notice = |m: &str| told.lock().expect("no panic").push(m.to_string());
            let sound = shared(fallback, &notice);
            assert!(run_on(place.path(), &sound, "gpu").iter().all(|o| *o == Outcome::Done));
            let whole = outputs(place.path());
            assert!(told.lock().expect("no panic").is_empty());
            fs::remove_dir_all(place.path().join("out")).expect("it is there");
            fs::remove_file(place.path().join("results.jsonl")).expect("it is there");
            let outcomes = lose(place.path(), &sound);
            assert!(outcomes.iter().all(|o| *o == Outcome::Done), "{outcomes:?}");
            let told = told.lock().expect("no panic").join("\n");
            assert!(told.contains("destroyed") && told.contains("opened anew"), "{told}");
            same(&whole, &outputs(place.path()));
        }
    }

    #[test]
    fn a_device_lost_at_any_moment_changes_nothing() {
        let place = folder();
        cases(place.path(), 3);
        let told = Mutex::new(Vec::new());
        let notice = |m: &str| told.lock().expect("no panic").push(m.to_string());
        let gpu = shared(false, &notice);
        assert!(run_on(place.path(), &gpu, "gpu").iter().all(|o| *o == Outcome::Done));
        let whole = outputs(place.path());
        let again = || {
            fs::remove_dir_all(place.path().join("out")).expect("it is there");
            fs::remove_file(place.path().join("results.jsonl")).expect("it is there");
            let begin = Instant::now();
            (run_on(place.path(), &gpu, "gpu"), begin.elapsed())
        };
        let (_, took) = again();
        let (mut seed, mut met) = (7, 0);
        let trials = trials(12, 20);
        for trial in 0..trials {
            told.lock().expect("no panic").clear();
            let wait = took.mul_f64(random(&mut seed));
            let outcomes = std::thread::scope(|scope| {
                scope.spawn(|| {
                    sleep(wait);
                    gpu.gpu().device.destroy();
                });
                again().0
            });
            met += usize::from(told.lock().expect("no panic").iter().any(|m| m.contains("opened anew")));
            assert!(outcomes.iter().all(|o| *o == Outcome::Done), "trial {trial}: {outcomes:?}");
            same(&whole, &outputs(place.path()));
        }
        println!("of {trials} losses {met} were met by a job");
        assert!(3 * met >= 2 * trials, "{met}");
    }

    /// A GPU that cannot be opened anew: its options name one that is not there.
    #[test]
    fn a_device_lost_for_good_is_named_or_replaced() {
        let place = folder();
        cases(place.path(), 8);
        let silent = |_: &str| {};
        assert!(run_on(place.path(), &shared(false, &silent), "gpu").iter().all(|o| *o == Outcome::Done));
        let whole = outputs(place.path());
        let gone = GpuOptions { adapter: Some("no such gpu".into()), ..GpuOptions::default() };
        let for_good = |fallback| {
            SharedGpu::new(Gpu::open(&GpuOptions::default()).expect("it was opened"), gone.clone(), fallback, &silent)
        };
        fs::remove_dir_all(place.path().join("out")).expect("it is there");
        fs::remove_file(place.path().join("results.jsonl")).expect("it is there");
        let outcomes = lose(place.path(), &for_good(false));
        let failed = outcomes.iter().filter(|o| matches!(o, Outcome::Failed(why) if why.contains("destroyed"))).count();
        let finished = outcomes.iter().filter(|o| **o == Outcome::Done).count();
        assert!(failed > 0 && finished > 0 && failed + finished == 8, "{outcomes:?}");
        assert_eq!(done(place.path()).len(), finished);
        // What was finished is kept; the rest comes on a device that works, the same bytes.
        let resumed = run_on(place.path(), &shared(false, &silent), "gpu");
        assert_eq!(resumed.iter().filter(|o| **o == Outcome::Skipped).count(), finished);
        same(&whole, &outputs(place.path()));

        fs::remove_dir_all(place.path().join("out")).expect("it is there");
        fs::remove_file(place.path().join("results.jsonl")).expect("it is there");
        let outcomes = lose(place.path(), &for_good(true));
        assert!(outcomes.iter().all(|o| *o == Outcome::Done), "{outcomes:?}");
        let on_cpu =
            |l: &serde_json::Value| l["certificate"]["backend"].as_str().is_some_and(|b| b.starts_with("reference"));
        assert!(results(place.path()).iter().any(on_cpu), "the rest ran on the reference path, and its lines say so");
    }
}
