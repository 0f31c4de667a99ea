//! What real GPUs do that software drivers do not: small limits, too little memory, an end to long work, numbers that are none. Bits stay what
//! they are.

use std::borrow::Cow;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;

use crate::shapes::*;
use interslice::backend::jobs::{SweepJob, SweepPair, TraceJob};
use interslice::backend::requests::{ContourRequest, SweepRequest, TraceRequest};
use interslice::backend::{ContourOptions, MorphOptions, PaddedSlice};
use interslice::contour::seeds::seeds;
use interslice::evaluate::demo::demo;
use interslice::gpu::atlas::Atlas;
use interslice::gpu::blocks::blocks;
use interslice::gpu::device::Made;
use interslice::gpu::layout::{Block, Params};
use interslice::gpu::{Gpu, GpuOptions, GpuOrReference};
use interslice::grid::field::Field;
use interslice::progress::Silent;
use interslice::settings::{AntiAlias, Method};
use interslice::{Backend, ContourStack, Error, Reconstruction, Result, Settings, height_grid, reconstruct_with};

fn made(made: Made) -> Gpu {
    Gpu::open(&GpuOptions { made, ..GpuOptions::default() }).expect("a Vulkan driver (tests/run installs lavapipe)")
}

fn run(backend: &dyn Backend, stack: &ContourStack, settings: &Settings, dz: Option<f64>) -> Result<Reconstruction> {
    let heights = height_grid(stack, settings, dz).heights().expect("a grid");
    reconstruct_with(stack, &heights, settings, backend, &Silent)
}

fn bits(body: Result<Reconstruction>) -> Vec<Vec<u32>> {
    let body = body.expect("it is done");
    body.layers.iter().map(|l| l.phi.iter().map(|v| v.to_bits()).collect()).collect()
}

/// Both methods on a stack of the paper.
fn both() -> [(&'static str, ContourStack, Settings); 2] {
    let of = |name, method| {
        let demo = demo("fig9").expect("a demo");
        (name, demo.stack, Settings { method, ..demo.settings })
    };
    [of("morph", Method::Morph), of("field", Method::Field)]
}

/// More slices, layers and pixels than rows of workgroups that a device is made to have: 64 along an axis, so that lists of more than 262,144
/// take layers of rows, and more than 64 jobs or fronts of a step take layers, too. On a device that is made small, wgpu leaves out what is
/// beyond the limit, be it indirect.
#[test]
fn dispatches_beyond_a_limit_are_split_and_change_no_bit() {
    let usual = made(Made::default());
    let small = made(Made { groups: Some(64), ..Made::default() });
    assert_eq!((usual.device.grid(), small.device.grid(), small.device.most_groups()), (4096, 64, 64));
    let wander = |k: usize| circle(20.0 + (0.5 * k as f64).sin(), 20.0, 9.0 + (0.3 * k as f64).cos());
    let many: Vec<f64> = (0..70).map(|k| 2.0 * f64::from(k)).collect();
    let many = masks(40, &many, &(0..70).map(|k| -> Shape { Box::new(wander(k)) }).collect::<Vec<_>>());
    let large: Vec<Shape> =
        (0..3).map(|k| -> Shape { Box::new(circle(150.0 + 4.0 * f64::from(k), 150.0, 70.0)) }).collect();
    let large = masks(300, &[0.0, 20.0, 44.0], &large);
    for (name, stack, dz) in [("many slices", &many, 1.0), ("large slices", &large, 1.0)] {
        for (method, anti_alias) in [(Method::Morph, AntiAlias::Kernel), (Method::Field, AntiAlias::Eq6)] {
            let settings = Settings { method, anti_alias, fair: 0.0, ..Settings::default() };
            let of = |gpu: &Gpu| bits(run(gpu, stack, &settings, Some(dz)));
            assert!(of(&usual) == of(&small), "{name}, {method:?}: small dispatches change the result");
        }
    }
}

/// Values that all threads make where the device reads them: none, few, and more than a chunk holds, whatever is left over at its end.
#[test]
fn values_made_by_all_threads_arrive_where_they_belong() {
    let gpu = made(Made::default());
    for count in [0usize, 1, 262_143, 262_145, 4_194_304, 9_000_001] {
        let value = |k: usize| (k as u32).wrapping_mul(2_654_435_761);
        let make = |first: usize, out: &mut [u32]| (first..).zip(out).for_each(|(k, to)| *to = value(k));
        let buffer = gpu.device.upload_made("made", count, make).expect("room");
        let read = gpu.device.read(&buffer, 0, count).expect("an answer");
        let wrong = (0..count).find(|&k| read[k] != value(k));
        assert_eq!((read.len(), wrong), (count, None), "of {count}");
    }
}

/// A fault that is put in: buffers are refused beyond what nobody has planned with.
#[test]
fn too_little_memory_halves_batches_and_changes_no_bit() {
    for (name, stack, settings) in both() {
        let usual = made(Made::default());
        let whole = bits(run(&usual, &stack, &settings, None));
        let short = made(Made { grants: Some(6 << 20), ..Made::default() });
        let told = Mutex::new(Vec::new());
        let notice = |m: &str| told.lock().expect("no panic").push(m.to_string());
        let backend = GpuOrReference::new(short, &notice);
        let halved = bits(run(&backend, &stack, &settings, None));
        assert_eq!(*told.lock().expect("no panic"), Vec::<String>::new(), "{name}: nothing went to the CPU");
        let [all, halves] = [usual.profile().submissions, backend.gpu.profile().submissions];
        println!("{name}: {all} submissions with all memory, {halves} with 6 MiB that are granted");
        assert!(halves > all, "{name}: there were several batches");
        assert!(whole == halved, "{name}: halving changes the result");
    }
    let (_, stack, settings) = &both()[0];
    match run(&made(Made { grants: Some(1 << 20), ..Made::default() }), stack, settings, None) {
        Err(Error::GpuMemory(message)) => assert!(message.contains("1048576"), "{message}"),
        other => panic!("1 MiB for a job alone gave {:?}", other.map(|body| body.layers.len())),
    }
}

/// Fields that the device has made or was sent stay there; where its memory has no room for them they are sent again.
#[test]
fn fields_that_cannot_stay_are_sent_again_and_change_no_bit() {
    for (name, stack, settings) in both() {
        let of = |memory: Option<u64>| {
            let gpu = Gpu::open(&GpuOptions { memory, ..GpuOptions::default() }).expect("a driver");
            (bits(run(&gpu, &stack, &settings, None)), gpu.profile().bytes_up)
        };
        let ((whole, once), (scarce, again)) = (of(None), of(Some(SCARCE)));
        println!("{name}: {once} bytes sent, {again} where little stays");
        assert!(again > once + once / 10, "{name}: {once} bytes sent, then {again}");
        assert!(whole == scarce, "{name}: what stays changes the result");
    }
}

/// Bytes of buffers with which a stack of the paper is done, a tenth of which its fields are more than.
const SCARCE: u64 = 8 << 20;

/// Tiles without pixels, and such as end within a block, in one table.
#[test]
fn every_block_knows_its_tile() {
    let gpu = made(Made::default());
    for dims in
        [vec![[7usize, 9]], vec![[64, 1], [0, 5], [1, 65], [300, 200], [0, 0], [8, 8], [63, 1]], vec![[9, 9]; 200]]
    {
        let atlas = Atlas::new(dims.iter().copied());
        let [job_count, block_count] = [atlas.jobs.len(), atlas.block_count()].map(|n| n as u32);
        let params = gpu.device.uniform("params", Params { job_count, block_count, ..Params::default() });
        let jobs = gpu.device.upload("jobs", &atlas.jobs).expect("room");
        let table = blocks(&gpu, &atlas, &params, &jobs).expect("room");
        let table = gpu.device.read(&table, 0, atlas.block_count()).expect("an answer");
        let tiles = (0u32..).zip(&dims).flat_map(|(q, d)| vec![q; (d[0] * d[1]).div_ceil(64)]);
        let expected: Vec<Block> = tiles.map(|job| Block { job, ..Block::default() }).collect();
        assert_eq!(table, expected, "{dims:?}");
    }
}

#[test]
fn bounded_work_changes_no_bit() {
    for (name, stack, settings) in both() {
        let [usual, slow] = [None, Some(1 << 20)].map(|work| made(Made { work, ..Made::default() }));
        let [whole, parts] = [&usual, &slow].map(|gpu| bits(run(gpu, &stack, &settings, None)));
        let [all, split] = [&usual, &slow].map(|gpu| gpu.profile().submissions);
        println!("{name}: {all} submissions, {split} where a dispatch has 2^20 values at most");
        assert!(split > all, "{name}: there were several batches");
        assert!(whole == parts, "{name}: the bound changes the result");
    }
}

/// Level sets that hold no numbers end, in an error or not; nothing hangs.
#[test]
fn no_number_hangs_a_stage() {
    let gpu = made(Made::default());
    let (dims, h) = ([61, 57], [1.0, 1.0]);
    let disc = |r: f64| Field::from_fn(dims, |i, j| (i as f64 - 30.0).hypot(j as f64 - 28.0) - r);
    let options = MorphOptions::from(&Settings::default());
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for everywhere in [false, true] {
            let spoiled = |r: f64| {
                let mut field = disc(r);
                let spoils = |n: usize| everywhere || (n % dims[0]).abs_diff(40) < 3;
                field.data.iter_mut().enumerate().filter(|(n, _)| spoils(*n)).for_each(|(_, v)| *v = wrong);
                field
            };
            for (source, goal) in [(spoiled(12.0), disc(9.0)), (disc(12.0), spoiled(9.0))] {
                let start = seeds(&disc(12.0), h, 0.5);
                let xs: Vec<_> = start.iter().map(|s| s.x).collect();
                let job = TraceJob { source: Cow::Borrowed(&source), goal: Cow::Borrowed(&goal), seeds: start };
                let traced = gpu.trace(&TraceRequest { jobs: &[job], h, options }, &Silent);
                let sweep = |source, goal| SweepJob {
                    source: Cow::Borrowed(source),
                    goal: Cow::Borrowed(goal),
                    courses: vec![[-3.0, -3.0, -3.0, 1.0]; xs.len()],
                    seeds: xs.clone(),
                    times: vec![0.5],
                };
                let pair = SweepPair {
                    up: sweep(&source, &goal),
                    down: sweep(&goal, &source),
                    anchors: Vec::new(),
                    holes: Cow::Borrowed(&[]),
                };
                let swept = gpu.propagate(&SweepRequest { pairs: &[pair], h, options }, &Silent);
                let slices = [PaddedSlice::Level(source.clone())];
                let options = ContourOptions { anti_alias: AntiAlias::None, sigma: 1.0, half_width: 6.0 };
                let fields = gpu.contour_fields(&ContourRequest { slices: &slices, dims, h, options }, &Silent);
                let steps = traced.iter().flatten().map(|t| t.steps).max();
                assert!(steps.is_none_or(|steps| steps < 1000), "{wrong}, everywhere {everywhere}: {steps:?} steps");
                println!("{wrong}, everywhere {everywhere}: {:?} {:?} {:?}", traced.err(), swept.err(), fields.err());
            }
        }
    }
    assert!(gpu.device.check().is_ok(), "the device is as it was");
}

/// A run with `--backend auto` on an adapter that is asked for: what it says of the machine.
fn automatic(stack: &Path, cache: &Path) -> String {
    let out = stack.join("out.nrrd");
    let mut program = Command::new(env!("CARGO_BIN_EXE_interslice"));
    let home = if cfg!(windows) { "LOCALAPPDATA" } else { "HOME" };
    program.env_remove("XDG_CACHE_HOME").env(home, cache).arg("reconstruct").arg(stack).arg("-o").arg(out);
    let result = program.args(["--adapter", "0", "--method", "field"]).output().expect("the program starts");
    assert_eq!(result.status.code(), Some(0), "{}", crate::files::stderr(&result));
    let words = crate::files::stderr(&result);
    words.lines().find(|l| l.starts_with("running on:")).expect("it is said").to_string()
}

/// The file with outcomes below `folder`.
fn outcomes(folder: &Path) -> Option<std::path::PathBuf> {
    let entries = fs::read_dir(folder).ok()?.map(|entry| entry.expect("an entry").path());
    entries.into_iter().find_map(|path| if path.is_dir() { outcomes(&path) } else { Some(path) })
}

#[test]
fn a_gpu_is_trusted_after_a_self_test_that_is_remembered() {
    let place = crate::files::folder();
    let [stack, cache] = ["stack", "cache"].map(|name| place.path().join(name));
    fs::create_dir(&stack).and_then(|()| fs::create_dir(&cache)).expect("folders can be made");
    crate::files::sound_stack(&stack);
    assert!(automatic(&stack, &cache).contains("GPU"), "the driver passes");
    let file = outcomes(&cache).expect("it is remembered");
    let passed = fs::read_to_string(&file).expect("it can be read");
    assert!(passed.contains("\"wrong\": []"), "{passed}");
    // A failure that is remembered keeps the GPU out.
    fs::write(&file, passed.replace("\"wrong\": []", "\"wrong\": [\"morphs at node 7\"]")).expect("it can be written");
    let words = automatic(&stack, &cache);
    assert!(
        words.contains("reference") && words.contains("self-test") && words.contains("morphs at node 7"),
        "{words}"
    );
    // What cannot be read is tested again; what cannot be written fails no run.
    fs::write(&file, "no JSON").expect("it can be written");
    assert!(automatic(&stack, &cache).contains("GPU"));
    assert_eq!(fs::read_to_string(&file).expect("it can be read"), passed);
    fs::remove_dir_all(&cache).and_then(|()| fs::write(&cache, "")).expect("a file in its place");
    assert!(automatic(&stack, &cache).contains("GPU"));
}
