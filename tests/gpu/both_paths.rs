//! Whole reconstructions on the GPU and on the reference path; what must not change a GPU's bits; and what happens when a GPU fails.

use std::path::Path;
use std::sync::{Arc, Mutex};

use crate::shapes::zoo::{N, zoo};
use crate::shapes::*;
use interslice::backend::requests::{LayerRequest, SlopeRequest};
use interslice::evaluate::demo::demo;
use interslice::gpu::device::Made;
use interslice::gpu::{Gpu, GpuOptions, GpuOrReference};
use interslice::grid::components::{label4, label8};
use interslice::grid::field::Field;
use interslice::input::read;
use interslice::preset::Preset;
use interslice::progress::Silent;
use interslice::reference::displacement::ROUNDS;
use interslice::registration::displacement::{Displacement, DisplacementJob};
use interslice::registration::lone_parts::LoneParts;
use interslice::registration::motion_field::MotionField;
use interslice::settings::Method;
use interslice::stack::ReadOptions;
use interslice::{Backend, ContourStack, Error, Reconstruction, Reference, Settings, height_grid, reconstruct_with};

/// Pixels that may lie on the other side, of all pixels.
const SIDES: f64 = 5e-4;
/// Largest |phi_gpu - phi_cpu|, px, for all but [`EXCEPTIONS`] of the pixels with |phi| < 3 px.
const NEAR: f32 = 0.02;
const EXCEPTIONS: f64 = 1e-3;
/// The same by the field method, without exception: what the slices' own fields differ by.
const NEAR_BY_FIELD: f32 = 1e-3;

fn open(options: &GpuOptions) -> Gpu {
    Gpu::open(options).expect("a Vulkan driver (tests/run installs lavapipe)")
}

fn run(backend: &dyn Backend, stack: &ContourStack, settings: &Settings, dz: Option<f64>) -> Reconstruction {
    let heights = height_grid(stack, settings, dz).heights().expect("a grid");
    reconstruct_with(stack, &heights, settings, backend, &Silent).expect("the stack is valid")
}

/// Parts and holes of a layer.
fn topology(phi: &[f32], dims: [usize; 2]) -> [usize; 2] {
    let inside: Vec<bool> = phi.iter().map(|v| *v < 0.0).collect();
    let outside: Vec<bool> = inside.iter().map(|m| !m).collect();
    [label4(&inside, dims).count, label8(&outside, dims).count]
}

fn agree(name: &str, gpu: &Reconstruction, cpu: &Reconstruction) {
    agree_to(NEAR, EXCEPTIONS, name, gpu, cpu);
}

fn agree_to(bound: f32, exceptions: f64, name: &str, gpu: &Reconstruction, cpu: &Reconstruction) {
    let px = cpu.spacing[0].max(cpu.spacing[1]) as f32;
    let (mut all, mut sides, mut near, mut off, mut worst) = (0usize, 0usize, 0usize, 0usize, 0.0f32);
    assert_eq!(gpu.layers.len(), cpu.layers.len(), "{name}");
    for (g, c) in gpu.layers.iter().zip(&cpu.layers) {
        assert!((g.z - c.z).abs() <= 1e-6 * c.z.abs().max(1.0), "{name}: heights {} and {}", g.z, c.z);
        // Pixels off by more than the bound that lie on the other side too: each can be a part or a hole of its own.
        let mut crossed = 0;
        for (a, b) in g.phi.iter().zip(c.phi.iter()) {
            all += 1;
            let crosses = (*a < 0.0) != (*b < 0.0);
            sides += usize::from(crosses);
            let d = (a - b).abs() / px;
            crossed += usize::from(crosses && d > bound);
            if b.abs() < 3.0 * px {
                near += 1;
                off += usize::from(d.is_nan() || d > bound);
                worst = worst.max(d);
            }
        }
        let [of_gpu, of_cpu] = [topology(&g.dense(), gpu.dims), topology(&c.dense(), cpu.dims)];
        let same = of_gpu.iter().zip(of_cpu).all(|(a, b)| a.abs_diff(b) <= crossed);
        assert!(same, "{name}: topology {of_gpu:?} and {of_cpu:?} at {}, {crossed} px off on the other side", c.z);
    }
    println!(
        "{name}: {sides} of {all} px on the other side, {off} of {near} off by more than {bound}, worst {worst:.1e} px"
    );
    assert!(sides as f64 <= SIDES * all as f64, "{name}: {sides} of {all} px lie on the other side");
    assert!(off as f64 <= exceptions * near as f64, "{name}: {off} of {near} px are off by more than {bound} px");
    for (a, b) in gpu.report.intervals.iter().zip(&cpu.report.intervals) {
        assert_eq!(a.events, b.events, "{name}");
        assert_eq!(a.particles.seeded, b.particles.seeded, "{name}: seeds");
    }
    for c in &gpu.report.contours {
        assert_eq!(c.differing_pixels, 0, "{name}: contour {}", c.name);
    }
}

#[test]
fn the_papers_figures() {
    let gpu = open(&GpuOptions::default());
    for name in ["fig5", "fig6", "fig10"] {
        let demo = demo(name).expect("a demo");
        for settings in [Settings { slope: demo.settings.slope, ..plain() }, demo.settings] {
            let of = |backend: &dyn Backend| run(backend, &demo.stack, &settings, None);
            agree(name, &of(&gpu), &of(&Reference));
        }
    }
}

/// New morphs on the way of the sweeps: before every step, as the paper does, and every few.
#[test]
fn the_papers_re_estimation() {
    let gpu = open(&GpuOptions { poison: true, ..GpuOptions::default() });
    for (name, every) in [("fig5", 1), ("fig6", 1), ("fig10", 1), ("fig9", 5)] {
        let demo = demo(name).expect("a demo");
        let settings = Settings { redistance: every, ..Preset::Paper.settings() };
        let of = |backend: &dyn Backend| run(backend, &demo.stack, &settings, None);
        let found = of(&gpu);
        agree(name, &found, &of(&Reference));
        let without = run(&gpu, &demo.stack, &Settings { redistance: 0, ..settings }, None);
        assert!(bits(&found) != bits(&without), "{name}: new morphs change nothing");
    }
}

/// The same bits whether the sweeps and their morphs fit together or not.
#[test]
fn the_papers_re_estimation_in_batches() {
    let demo = demo("fig9").expect("a demo");
    let settings = Settings { redistance: 7, ..Preset::Paper.settings() };
    let of = |memory| {
        let gpu = open(&GpuOptions { memory, poison: true, ..GpuOptions::default() });
        let body = run(&gpu, &demo.stack, &settings, None);
        (bits(&body), gpu.profile().submissions)
    };
    let (whole, tight) = (of(None), of(Some(6 << 20)));
    println!("submissions {} with all memory, {} with 6 MiB", whole.1, tight.1);
    assert!(tight.1 > whole.1, "there were several batches");
    assert!(whole.0 == tight.0);
}

/// Slices interpolated along the moving field, no morph.
fn by_field(settings: Settings) -> Settings {
    Settings { method: Method::Field, ..settings }
}

#[test]
fn the_papers_figures_by_the_field_method() {
    let gpu = open(&GpuOptions { poison: true, ..GpuOptions::default() });
    for name in ["fig5", "fig6", "fig9", "fig10"] {
        let demo = demo(name).expect("a demo");
        for settings in [Settings { fair: 0.0, ..by_field(demo.settings.clone()) }, by_field(demo.settings.clone())] {
            let of = |backend: &dyn Backend| run(backend, &demo.stack, &settings, None);
            agree_to(NEAR_BY_FIELD, 0.0, name, &of(&gpu), &of(&Reference));
        }
    }
}

#[test]
fn the_zoo_by_the_field_method() {
    let gpu = open(&GpuOptions { poison: true, ..GpuOptions::default() });
    for (name, shapes) in zoo() {
        let heights: Vec<f64> = (0..shapes.len()).map(|k| 10.0 * k as f64 + if k == 1 { 3.0 } else { 0.0 }).collect();
        let stack = masks(N, &heights, &shapes);
        let of = |backend: &dyn Backend| run(backend, &stack, &by_field(Settings::default()), Some(1.0));
        agree_to(NEAR_BY_FIELD, 0.0, name, &of(&gpu), &of(&Reference));
    }
}

#[test]
fn the_zoo() {
    let gpu = open(&GpuOptions { poison: true, ..GpuOptions::default() });
    for (name, shapes) in zoo() {
        let heights: Vec<f64> = (0..shapes.len()).map(|k| 10.0 * k as f64).collect();
        let stack = masks(N, &heights, &shapes);
        agree(name, &run(&gpu, &stack, &plain(), Some(1.0)), &run(&Reference, &stack, &plain(), Some(1.0)));
    }
}

#[test]
fn the_example() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/jacksboro");
    let stack = read(&folder, &ReadOptions::default()).expect("the example");
    let dz = Some((stack.slices[1].z - stack.slices[0].z) / 4.0);
    let gpu = open(&GpuOptions::default());
    let of = |backend: &dyn Backend| run(backend, &stack, &plain(), dz);
    agree("jacksboro", &of(&gpu), &of(&Reference));
}

/// Real stacks named in `INTERSLICE_STACKS` (folders, separated by colons); none without it.
#[test]
fn stacks_of_your_own() {
    let named = std::env::var_os("INTERSLICE_STACKS").map(|v| std::env::split_paths(&v).collect::<Vec<_>>());
    let Some(named) = named else { return };
    let gpu = open(&GpuOptions::default());
    for path in named {
        let stack = read(&path, &ReadOptions::default()).expect("a stack");
        let of = |backend: &dyn Backend| run(backend, &stack, &plain(), None);
        agree(&path.display().to_string(), &of(&gpu), &of(&Reference));
    }
}

fn fig9() -> (ContourStack, Settings) {
    let demo = demo("fig9").expect("a demo");
    (demo.stack, demo.settings)
}

fn bits(body: &Reconstruction) -> Vec<Vec<u32>> {
    body.layers.iter().map(|l| l.phi.iter().map(|v| v.to_bits()).collect()).collect()
}

#[test]
fn neither_a_second_run_nor_small_batches_nor_lists_change_a_bit() {
    let (stack, morph) = fig9();
    let field = by_field(morph.clone());
    for (name, settings) in [("morph", morph), ("field", field)] {
        let gpu = open(&GpuOptions::default());
        let first = bits(&run(&gpu, &stack, &settings, None));
        let again = bits(&run(&gpu, &stack, &settings, None));
        assert!(first == again, "{name}: the second run differs");
        let whole = gpu.profile().submissions / 2;
        // So little that a batch holds a few jobs only.
        let tight = open(&GpuOptions { memory: Some(6 << 20), ..GpuOptions::default() });
        let in_batches = bits(&run(&tight, &stack, &settings, None));
        println!("{name}: {whole} submissions with all memory, {} with 6 MiB", tight.profile().submissions);
        assert!(tight.profile().submissions > whole, "{name}: there were several batches");
        assert!(first == in_batches, "{name}: batches change the result");
    }
}

/// Rounds of distances, steps of fronts, squares of layers.
#[test]
fn guesses_that_are_too_small_change_no_bit() {
    let (stack, morph) = fig9();
    let field = by_field(morph.clone());
    for (name, settings) in [("morph", morph), ("field", field)] {
        let of = |guess| {
            let made = Made { guess, ..Made::default() };
            let gpu = open(&GpuOptions { made, poison: true, ..GpuOptions::default() });
            let body = run(&gpu, &stack, &settings, None);
            (bits(&body), gpu.device.used().waits)
        };
        let (right, waits) = of(None);
        for guess in [0, 1, 3] {
            let (body, more) = of(Some(guess));
            println!("{name}: {waits} waits, {more} with a guess of {guess}");
            assert!(more > waits, "{name}: a guess of {guess} is enough");
            assert!(body == right, "{name}: a guess of {guess} changes the result");
        }
    }
}

#[test]
fn runs_at_once_on_one_gpu_have_the_bits_of_runs_alone() {
    let gpu = open(&GpuOptions::default());
    let stack = |(_, shapes): (_, Vec<Shape>)| {
        let heights: Vec<f64> = (0..shapes.len()).map(|k| 10.0 * k as f64).collect();
        masks(N, &heights, &shapes)
    };
    let stacks: Vec<ContourStack> = zoo().into_iter().take(6).map(stack).collect();
    let settings = Settings::default();
    let run = |stack| bits(&run(&gpu, stack, &settings, Some(1.0)));
    let alone: Vec<_> = stacks.iter().map(run).collect();
    let before = gpu.profile().submissions;
    let together: Vec<_> = std::thread::scope(|scope| {
        let runs: Vec<_> = stacks.iter().map(|stack| scope.spawn(move || run(stack))).collect();
        runs.into_iter().map(|run| run.join().expect("no panic")).collect()
    });
    assert!(alone == together, "what is computed beside a run changes it");
    let [apart, joined] = [before, gpu.profile().submissions - before];
    println!("{apart} submissions one after the other, {joined} at once");
    assert!(joined < apart, "calls that waited were answered together: {joined} of {apart} submissions");
}

#[test]
fn a_timed_device_says_how_much_of_its_time_it_works() {
    let (stack, settings) = fig9();
    let [timed, untimed] = [true, false].map(|timed| open(&GpuOptions { timed, ..GpuOptions::default() }));
    let [a, b] = [&timed, &untimed].map(|gpu| bits(&run(gpu, &stack, &settings, Some(1.0))));
    assert!(a == b, "timing changes no bit");
    assert!(untimed.profile().busy.is_none());
    let profile = timed.profile();
    let busy = profile.busy.expect("kernels have run");
    let kernels: f64 = profile.kernels.values().map(|k| k.seconds).sum();
    println!("{kernels:.3} s of kernels, {:.3} s with work of {:.3} s", busy.seconds, busy.of_seconds);
    assert!(profile.kernels.values().all(|k| k.dispatches > 0 && k.seconds > 0.0));
    // Kernels of one submission do not overlap on this driver.
    assert!(0.0 < kernels && kernels <= 1.001 * busy.seconds && busy.seconds <= busy.of_seconds);
}

#[test]
fn a_grid_without_layers_between_contours() {
    let (stack, settings) = fig9();
    let gap = stack.slices[1].z - stack.slices[0].z;
    let [gpu, cpu]: [Reconstruction; 2] = [&open(&GpuOptions::default()) as &dyn Backend, &Reference]
        .map(|backend| run(backend, &stack, &settings, Some(gap)));
    assert!(gpu.layers.iter().filter(|l| l.contour.is_some()).count() == stack.slices.len(), "every contour is there");
    agree("contours alone", &gpu, &cpu);
}

#[test]
fn stages_of_the_moving_field_are_the_same_in_batches() {
    let (dims, h) = ([151, 133], [1.0, 0.8]);
    let circle = |k: usize| circle(60.0 + 3.0 * k as f64, 50.0 - k as f64, 30.0 - 2.0 * k as f64);
    let field = |k| Field::from_fn(dims, |i, j| circle(k)(i as f64 * h[0], j as f64 * h[1]));
    let fields: Vec<Arc<Field>> = (0..10).map(|k| Arc::new(field(k))).collect();
    let gaps: Vec<f64> = (0..9).map(|k| [1.0, 2.5, 0.7][k % 3]).collect();
    let heights = (0..10).map(|k| gaps[..k].iter().sum()).collect();
    let times: Vec<f64> = (1..40).map(|k| f64::from(k) / 40.0).collect();
    let stages = |memory: Option<u64>| {
        let gpu = open(&GpuOptions { memory, poison: true, ..GpuOptions::default() });
        let still = vec![Displacement::zero(dims); gaps.len()];
        let job =
            DisplacementJob { fields: &fields, gaps: &gaps, guess: &still, begin: &still, rounds: 0..ROUNDS.len(), h };
        let found = gpu.displacements(&job).expect("displacements");
        let moving = MotionField::new(Vec::clone(&heights), 1.0, fields.clone(), found);
        let slopes = gpu.moving_slopes(&SlopeRequest { moving: &moving, wanted: 0..10 }, &Silent).expect("slopes");
        let before = gpu.profile().submissions;
        let lone = LoneParts::default();
        let beside = [4, 5].map(|k| Arc::new(slopes[k].clone()));
        let slopes_beside = beside.each_ref();
        let request = LayerRequest {
            moving: &moving,
            interval: 4,
            slopes: slopes_beside,
            lone: &lone,
            times: &times,
            limit: 14.0,
            h,
            wanted: None,
        };
        let layers = gpu.moving_layers(&[request]).expect("layers");
        (moving.displacements, slopes, layers, [before, gpu.profile().submissions - before])
    };
    let (whole, tight) = (stages(None), stages(Some(2 << 20)));
    println!("submissions {:?} with all memory, {:?} with 2 MiB", whole.3, tight.3);
    assert!((0..2).all(|k| 2 * tight.3[k] > 3 * whole.3[k]), "there were several batches");
    assert!(whole.0 == tight.0, "displacements");
    assert!(whole.1 == tight.1, "slopes");
    assert!(whole.2 == tight.2, "layers");
}

#[test]
fn a_failing_gpu_is_told_and_replaced_only_where_that_was_asked() {
    let (stack, settings) = fig9();
    let heights = height_grid(&stack, &settings, None).heights().expect("a grid");
    let of = |backend: &dyn Backend| reconstruct_with(&stack, &heights, &settings, backend, &Silent);
    let right = bits(&of(&Reference).expect("the stack is valid"));

    let lost = open(&GpuOptions::default());
    lost.device.destroy();
    match of(&lost) {
        Err(Error::Gpu(message)) => assert!(message.contains("destroyed"), "{message}"),
        other => panic!("a lost device gave {:?}", other.map(|r| r.layers.len())),
    }

    let short = open(&GpuOptions { memory: Some(1 << 20), ..GpuOptions::default() });
    match of(&short) {
        Err(Error::GpuMemory(message)) => {
            assert!(message.contains("memory") && message.contains("1048576"), "{message}")
        }
        other => panic!("a budget of 1 MiB gave {:?}", other.map(|r| r.layers.len())),
    }

    let told = Mutex::new(Vec::new());
    let notice = |m: &str| told.lock().expect("one thread").push(m.to_string());
    let lost = open(&GpuOptions::default());
    lost.device.destroy();
    let body = of(&GpuOrReference::new(lost, &notice)).expect("the reference path takes over");
    assert!(right == bits(&body), "the reference path's own result");
    assert!(body.report.backend.contains("until it failed"), "{}", body.report.backend);
    assert!(body.report.warnings.iter().any(|w| w.contains("changed on the way")));
    assert_eq!(told.lock().expect("one thread").len(), 1, "told once");
}

#[test]
fn an_adapter_that_is_not_there_is_named() {
    match Gpu::open(&GpuOptions { adapter: Some("no such gpu".into()), ..GpuOptions::default() }) {
        Err(Error::Setting { message, .. }) => {
            assert!(
                message.contains("adapters, or part of its name (0: ") && message.ends_with("got `no such gpu`"),
                "{message}"
            )
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_driver_passes_the_self_test() {
    let findings = interslice::gpu::selftest::doctor::examine(&open(&GpuOptions::default())).expect("the GPU works");
    assert!(findings.trusted(), "{:#?}", findings.in_words());
    assert!(findings.trips[0] >= 65_000, "loops of {} trips", findings.trips[0]);
}
