//! A campaign over random stacks, or over runs of the program, that goes on from any seed: what falls is a line in its log.
//!
//! ```text
//! cargo bench --bench campaign -- --from 0 --count 20000                  every seed draws one of the properties of tests/random
//! cargo bench --bench campaign -- --property lying --count 500 [--gpu]    one property, on a GPU
//! cargo bench --bench campaign -- --program --count 5000                  the built program: options, inputs, outputs, wrong input
//! cargo bench --bench campaign -- --property lying --show 17              one seed, shown
//! ```
//!
//! `--log FILE` (else `target/campaign/NAME.log`) says what is done, in blocks of seeds, and what fell: `fault PROPERTY SEED FIGURE BOUND WHAT`.
//! A campaign that was stopped goes on where its log ends; a new one needs a new log. The table at the end is made of the whole log, which is then
//! shortened: `tally VERSION PROPERTY HELD SILENT LARGEST` for the seeds that held, with the `--version` they were run with.
//! Seeds worth keeping go into `tests/promises/fallen_seeds.txt`, which the test suite replays.

#[path = "campaign/inputs.rs"]
mod inputs;
#[path = "../tests/random/mod.rs"]
mod random;
#[path = "campaign/runs.rs"]
mod runs;
#[path = "../tests/support/mod.rs"]
mod support;

use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use clap::Parser;
use interslice::{Backend, Reference};
use random::case::Case;
use random::properties::{Checked, Fault, PROPERTIES, Property, of_seed, property};
use random::source::{Program, Source};
use rayon::ThreadPoolBuilder;
use serde_json::{Map, Value};

/// Seeds that are logged as done together.
const BLOCK: u64 = 20;

#[derive(Parser)]
struct Arguments {
    /// First seed
    #[arg(long, default_value_t = 0)]
    from: u64,
    /// Number of seeds
    #[arg(long, default_value_t = 100)]
    count: u64,
    /// One property only
    #[arg(long)]
    property: Option<String>,
    /// On a GPU instead of the reference path
    #[arg(long)]
    gpu: bool,
    /// Runs of the built program instead of properties
    #[arg(long)]
    program: bool,
    /// Show the case of this seed and what is measured on it
    #[arg(long)]
    show: Option<u64>,
    /// Settings instead of those drawn, as JSON, to see which stage is to blame: '{"fair": 0, "motion": "none"}'
    #[arg(long)]
    settings: Option<String>,
    /// Seeds at once, each on one thread
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Begin no block of seeds after so many minutes
    #[arg(long)]
    minutes: Option<f64>,
    #[arg(long)]
    log: Option<PathBuf>,
    /// Name of the program's version, for the log
    #[arg(long, default_value = "-")]
    version: String,
    /// Given by cargo
    #[arg(long, hide = true)]
    bench: bool,
}

/// What a seed has shown: of which property, and what.
type Seen = (&'static str, Checked);

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match campaign(&arguments) {
        Ok(faults) => ExitCode::from(u8::from(faults > 0)),
        Err(message) => {
            eprintln!("{message}");
            ExitCode::from(2)
        }
    }
}

/// The property of a seed.
fn chosen(arguments: &Arguments, seed: u64) -> Result<&'static Property, String> {
    match &arguments.property {
        Some(name) => {
            let names = || PROPERTIES.map(|p| p.name).join(", ");
            property(name).ok_or_else(|| format!("no property is called {name}; there are {}", names()))
        }
        None => Ok(of_seed(seed)),
    }
}

fn campaign(arguments: &Arguments) -> Result<usize, String> {
    let gpu = backend(arguments.gpu)?;
    let source = Program { backend: gpu.as_deref().unwrap_or(&Reference), single: arguments.gpu };
    chosen(arguments, 0)?;
    let with = match &arguments.settings {
        Some(text) => serde_json::from_str(text).map_err(|e| format!("--settings: {e}"))?,
        None => Map::new(),
    };
    if let Some(seed) = arguments.show {
        if arguments.program {
            print!("{}", runs::shown(seed)?);
            return Ok(0);
        }
        let property = chosen(arguments, seed)?;
        let case = drawn(property, seed, &with);
        println!("{case}{}: {:?}", property.name, (property.check)(&case, &source));
        return Ok(0);
    }
    let one = |seed: u64| -> Seen {
        if arguments.program {
            return ("program", runs::check(seed));
        }
        let property = chosen(arguments, seed).unwrap_or(&PROPERTIES[0]);
        (property.name, guarded(property, seed, &with, &source))
    };
    let log = Log::open(arguments)?;
    let begin = Instant::now();
    let next = AtomicU64::new(0);
    let blocks = arguments.count.div_ceil(BLOCK);
    let work = || {
        // What a seed computes runs on this thread alone.
        let pool = ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| e.to_string())?;
        loop {
            let block = next.fetch_add(1, Ordering::Relaxed);
            let over = arguments.minutes.is_some_and(|minutes| begin.elapsed().as_secs_f64() > 60.0 * minutes);
            if block >= blocks || over {
                return Ok(());
            }
            let first = arguments.from + block * BLOCK;
            let end = (first + BLOCK).min(arguments.from + arguments.count);
            if log.is_done(first, end) {
                continue;
            }
            let start = Instant::now();
            let seen: Vec<(u64, Seen)> = (first..end).map(|seed| (seed, pool.install(|| one(seed)))).collect();
            log.block(first, end, start.elapsed().as_secs_f64(), &seen)?;
        }
    };
    let results: Vec<Result<(), String>> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..arguments.threads.max(1)).map(|_| scope.spawn(work)).collect();
        threads.into_iter().map(|t| t.join().unwrap_or_else(|_| Err("a thread has panicked".into()))).collect()
    });
    results.into_iter().collect::<Result<(), String>>()?;
    println!("{:.0} s", begin.elapsed().as_secs_f64());
    log.shorten(&arguments.version)?;
    log.table()
}

/// The GPU, if it is wanted; no kernel may read what none has written.
#[cfg(feature = "gpu")]
fn backend(gpu: bool) -> Result<Option<Box<dyn Backend>>, String> {
    if !gpu {
        return Ok(None);
    }
    let options = interslice::gpu::GpuOptions { poison: true, ..Default::default() };
    let gpu = interslice::gpu::Gpu::open(&options).map_err(|e| e.to_string())?;
    Ok(Some(Box::new(gpu)))
}

#[cfg(not(feature = "gpu"))]
fn backend(gpu: bool) -> Result<Option<Box<dyn Backend>>, String> {
    if gpu { Err("built without a GPU backend".into()) } else { Ok(None) }
}

/// The case of a seed, some of its settings replaced.
fn drawn(property: &Property, seed: u64, with: &Map<String, Value>) -> Case {
    let mut case = (property.draw)(seed);
    if let Ok(Value::Object(mut settings)) = serde_json::to_value(&case.settings) {
        settings.extend(with.clone());
        match serde_json::from_value(Value::Object(settings)) {
            Ok(settings) => case.settings = settings,
            Err(e) => eprintln!("--settings: {e}"),
        }
    }
    case
}

/// A panic is a fault like others.
fn guarded(property: &Property, seed: u64, with: &Map<String, Value>, source: &dyn Source) -> Checked {
    let check = || (property.check)(&drawn(property, seed, with), source);
    let panicked = |_| Err(Fault { figure: f64::INFINITY, bound: 0.0, what: "a panic".into() });
    catch_unwind(AssertUnwindSafe(check)).unwrap_or_else(panicked)
}

/// What is done and what fell, as lines of a file.
struct Log {
    path: PathBuf,
    file: Mutex<fs::File>,
    done: Vec<[u64; 2]>,
}

impl Log {
    fn open(arguments: &Arguments) -> Result<Self, String> {
        let name = match &arguments.property {
            _ if arguments.program => "program",
            Some(name) => name,
            None => "all",
        };
        let device = if arguments.gpu { "-gpu" } else { "" };
        let named = || PathBuf::from(format!("target/campaign/{name}{device}.log"));
        let path = arguments.log.clone().unwrap_or_else(named);
        let fail = |e: std::io::Error| format!("{}: {e}", path.display());
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(fail)?;
        }
        let text = fs::read_to_string(&path).unwrap_or_default();
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(fail)?;
        let done = text.lines().filter_map(|line| {
            let words: Vec<&str> = line.split(' ').collect();
            match words[..] {
                ["done", first, end, _] => Some([first.parse().ok()?, end.parse().ok()?]),
                _ => None,
            }
        });
        let done = done.collect();
        Ok(Log { file: Mutex::new(file), done, path })
    }

    fn is_done(&self, first: u64, end: u64) -> bool {
        self.done.iter().any(|[a, b]| *a <= first && end <= *b)
    }

    /// Writes what a block of seeds has shown, and at last that it is done.
    fn block(&self, first: u64, end: u64, seconds: f64, seen: &[(u64, Seen)]) -> Result<(), String> {
        let mut lines = String::new();
        for (seed, (name, checked)) in seen {
            lines += &match checked {
                Ok(Some(figure)) => format!("held {name} {seed} {figure:.4e}\n"),
                Ok(None) => format!("none {name} {seed}\n"),
                Err(fault) => {
                    let what = fault.what.lines().next().unwrap_or_default();
                    let line = format!("fault {name} {seed} {:.4e} {:.4e} {what}\n", fault.figure, fault.bound);
                    print!("{line}");
                    line
                }
            };
        }
        lines += &format!("done {first} {end} {seconds:.1}\n");
        let mut file = self.file.lock().map_err(|_| "a thread has panicked")?;
        file.write_all(lines.as_bytes()).map_err(|e| format!("{}: {e}", self.path.display()))
    }

    /// Replaces the lines of seeds that held by one a property, and those of blocks that follow each other by one.
    fn shorten(&self, version: &str) -> Result<(), String> {
        let fail = |e: std::io::Error| format!("{}: {e}", self.path.display());
        let text = fs::read_to_string(&self.path).map_err(fail)?;
        let mut tallies = BTreeMap::<&str, Tally>::new();
        let (mut done, mut lines) = (Vec::<(u64, u64, f64)>::new(), String::new());
        for line in text.lines() {
            let words: Vec<&str> = line.splitn(6, ' ').collect();
            match words[..] {
                ["held" | "none", name, ..] => tallies.entry(name).or_default().add(&words),
                ["done", first, end, seconds] => {
                    let numbers = (first.parse(), end.parse(), seconds.parse());
                    if let (Ok(first), Ok(end), Ok(seconds)) = numbers {
                        done.push((first, end, seconds));
                    }
                }
                _ => lines += &format!("{line}\n"),
            }
        }
        for (name, Tally { held, silent, largest, .. }) in &tallies {
            lines += &format!("tally {version} {name} {held} {silent} {largest:.4e}\n");
        }
        done.sort_by_key(|done| done.0);
        let merged = done.chunk_by(|a, b| a.1 == b.0);
        for some in merged {
            let seconds: f64 = some.iter().map(|done| done.2).sum();
            lines += &format!("done {} {} {seconds:.1}\n", some[0].0, some[some.len() - 1].1);
        }
        let short = self.path.with_extension("new");
        fs::write(&short, lines).and_then(|()| fs::rename(&short, &self.path)).map_err(fail)
    }

    /// Prints a line per property; gives the number of faults.
    fn table(&self) -> Result<usize, String> {
        let text = fs::read_to_string(&self.path).map_err(|e| format!("{}: {e}", self.path.display()))?;
        let (mut rows, mut seconds) = (BTreeMap::<&str, Tally>::new(), 0.0f64);
        for line in text.lines() {
            let words: Vec<&str> = line.splitn(6, ' ').collect();
            match words[..] {
                ["done", _, _, time] => seconds += time.parse().unwrap_or(0.0),
                ["tally", _, name, ..] | [_, name, ..] => rows.entry(name).or_default().add(&words),
                _ => {}
            }
        }
        println!("{:20} {:>7} {:>7} {:>7} {:>10}", "property", "stacks", "faults", "silent", "largest");
        for (name, row) in &rows {
            println!("{name:20} {:7} {:7} {:7} {:10.3e}", row.stacks(), row.faults, row.silent, row.largest);
        }
        let stacks: usize = rows.values().map(Tally::stacks).sum();
        println!(
            "{stacks} stacks, {:.2} a second and thread; {}",
            stacks as f64 / seconds.max(1e-9),
            self.path.display()
        );
        Ok(rows.values().map(|row| row.faults).sum())
    }
}

/// What the seeds of a property have shown.
#[derive(Default)]
struct Tally {
    held: usize,
    silent: usize,
    faults: usize,
    largest: f64,
}

impl Tally {
    /// Counts a line of the log.
    fn add(&mut self, words: &[&str]) {
        let figure = |text: &str| text.parse().unwrap_or(f64::INFINITY);
        let count = |text: &str| text.parse().unwrap_or(0);
        match *words {
            ["held", _, _, largest] => {
                self.held += 1;
                self.largest = self.largest.max(figure(largest));
            }
            ["none", ..] => self.silent += 1,
            ["fault", _, _, largest, ..] => {
                self.faults += 1;
                self.largest = self.largest.max(figure(largest));
            }
            ["tally", _, _, held, silent, largest] => {
                self.held += count(held);
                self.silent += count(silent);
                self.largest = self.largest.max(figure(largest));
            }
            _ => {}
        }
    }

    fn stacks(&self) -> usize {
        self.held + self.silent + self.faults
    }
}
