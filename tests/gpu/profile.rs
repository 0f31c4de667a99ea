//! What a run on a GPU says of its cost.

use interslice::evaluate::demo::demo;
use interslice::gpu::{Gpu, GpuOptions};
use interslice::progress::Silent;
use interslice::report::{DeviceUse, StageCost};
use interslice::settings::Method;
use interslice::{Reconstruction, Reference, Settings, height_grid, reconstruct_with};

fn open(options: &GpuOptions) -> Gpu {
    Gpu::open(options).expect("a Vulkan driver (tests/run installs lavapipe)")
}

fn fig9(gpu: &Gpu, method: Method) -> Reconstruction {
    let demo = demo("fig9").expect("a demo");
    let settings = Settings { method, ..demo.settings };
    let heights = height_grid(&demo.stack, &settings, None).heights().expect("a grid");
    reconstruct_with(&demo.stack, &heights, &settings, gpu, &Silent).expect("the stack is valid")
}

fn stages(body: &Reconstruction) -> &[StageCost] {
    &body.report.profile.as_ref().expect("a profile").stages
}

fn all(body: &Reconstruction) -> DeviceUse {
    let mut all = DeviceUse::default();
    stages(body).iter().for_each(|stage| all.add(&stage.device));
    all
}

fn bits(body: &Reconstruction) -> Vec<Vec<u32>> {
    body.layers.iter().map(|l| l.phi.iter().map(|v| v.to_bits()).collect()).collect()
}

#[test]
fn every_stage_says_what_it_costs_and_their_sum_is_what_the_device_was_asked() {
    let gpu = open(&GpuOptions::default());
    let before = gpu.device.used();
    let body = fig9(&gpu, Method::Morph);
    let used = gpu.device.used().since(&before);
    let names: Vec<&str> = stages(&body).iter().map(|stage| &*stage.name).collect();
    assert_eq!(names, ["distance", "motion", "match", "trace", "fit", "slopes", "propagate", "rest", "output"]);
    let sum = all(&body);
    assert_eq!([sum.waits, sum.submits, sum.bytes_up, sum.bytes_down], {
        [used.waits, used.submits, used.bytes_up, used.bytes_down]
    });
    assert!(sum.waits > 0 && sum.buffers > 0 && sum.bytes_up > sum.buffers && sum.bytes_down > 0, "{sum:?}");
    assert_eq!(sum.threads.iter().sum::<u64>(), sum.dispatches, "every dispatch has its size: {sum:?}");
    let fit = stages(&body).iter().find(|stage| stage.name == "fit").expect("the stage");
    assert_eq!((fit.device.waits, fit.device.dispatches), (0, 0), "it is the host's");
    for stage in stages(&body) {
        let (Some(host), Some(serial)) = (stage.host_seconds, stage.serial_seconds) else {
            let has_clocks = cfg!(all(target_os = "linux", target_env = "gnu"));
            assert!(!has_clocks, "Linux has clocks of threads");
            continue;
        };
        assert!(0.0 <= serial && serial <= host + 1e-3, "{stage:?}");
    }
    if let Some(process) = process_seconds().filter(|_| gpu.device.summary.is_software()) {
        let host: f64 = stages(&body).iter().filter_map(|stage| stage.host_seconds).sum();
        assert!(host < 0.5 * process, "what a software driver computes is not the host's: {host} s of {process} s");
    }
}

/// CPU seconds of this process so far, its driver's threads among them; Linux says them in hundredths.
fn process_seconds() -> Option<f64> {
    let told = std::fs::read_to_string("/proc/self/stat").ok()?;
    // Behind the name, which may hold anything, come the state and ten numbers, then user and system time.
    let numbers: Vec<&str> = told.rsplit_once(')')?.1.split_whitespace().collect();
    Some(0.01 * (numbers.get(11)?.parse::<f64>().ok()? + numbers.get(12)?.parse::<f64>().ok()?))
}

#[test]
fn a_second_run_makes_no_buffer_and_has_the_same_bits() {
    for method in [Method::Morph, Method::Field] {
        let gpu = open(&GpuOptions { poison: true, ..GpuOptions::default() });
        let first = fig9(&gpu, method);
        let second = fig9(&gpu, method);
        let [cold, warm] = [&first, &second].map(|body| all(body).buffers);
        println!("{method:?}: {cold} buffers, then {warm}");
        assert!(cold > 0 && warm == 0, "{method:?}: {cold} buffers, then {warm}");
        assert!(bits(&first) == bits(&second), "{method:?}: what lay in a buffer before changes the result");
    }
}

#[test]
fn the_reference_path_has_no_device() {
    let demo = demo("fig5").expect("a demo");
    let heights = height_grid(&demo.stack, &demo.settings, None).heights().expect("a grid");
    let body = reconstruct_with(&demo.stack, &heights, &demo.settings, &Reference, &Silent).expect("valid");
    assert!(body.report.profile.is_none());
}
