//! What a run needs of memory, beside what was said before it and what it is allowed, and that the number of layers does not matter.
#![cfg(target_os = "linux")]

#[path = "support/files.rs"]
mod files;

use std::fs;
use std::path::Path;
use std::process::Command;
use std::thread::sleep;
use std::time::Duration;

use files::folder;
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::{JobOptions, Loaded};
use interslice::progress::Silent;
use interslice::settings::Method;
use interslice::stack::{ContourStack, Geometry, Slice, SliceContent};
use interslice::{Budget, Means, Reference, Settings};

/// Where the run of [`one_run`] writes, and its distance between layers, fairing and method.
const ASKED: &str = "INTERSLICE_MEMORY_TEST";
const SIDE: usize = 400;
/// Arrays from this size on go back to the system as soon as they are freed, bytes.
const GIVEN_BACK: &str = "1048576";
const KINDS: [&str; 6] = ["nrrd", "nii.gz", "stl", "ply", "dem.tif", "json"];

/// Largest resident set of a process so far, bytes; nothing where it has ended.
fn peak_of(process: &str) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next().and_then(|n| n.parse::<u64>().ok()).map(|kib| kib << 10)
}

/// That of this process.
fn peak() -> u64 {
    peak_of("self").expect("Linux tells")
}

/// Four discs that drift.
fn stack() -> ContourStack {
    let content = |k: usize| {
        let (c, r) = (0.45 * SIDE as f64 + 12.0 * k as f64, 0.3 * SIDE as f64 - 9.0 * k as f64);
        let inside = |n: usize| ((n % SIDE) as f64 - c).hypot((n / SIDE) as f64 - c) < r;
        SliceContent::Mask((0..SIDE * SIDE).map(inside).collect())
    };
    let slice = |k: usize| Slice { name: format!("s{k}"), z: 4.0 * k as f64, extra: false, content: content(k) };
    ContourStack {
        dims: [SIDE, SIDE],
        spacing: [1.0, 1.0],
        unit: "px".into(),
        slices: (0..4).map(slice).collect(),
        z_out: None,
        geometry: Geometry::default(),
        known: None,
    }
}

/// Discs of which every thirtieth pixel is turned over.
fn noisy() -> ContourStack {
    const N: usize = 200;
    let content = |k: usize| {
        let turned = |n: usize| ((n + 7 * N * N * k) as u32).wrapping_mul(2654435761) >> 8 & 0x3fff < 546;
        let inside = |n: usize| (((n % N) as f64 - 100.0).hypot((n / N) as f64 - 100.0) < 70.0) != turned(n);
        SliceContent::Mask((0..N * N).map(inside).collect())
    };
    let slice = |k: usize| Slice { name: format!("s{k}"), z: 4.0 * k as f64, extra: false, content: content(k) };
    ContourStack { dims: [N, N], slices: (0..12).map(slice).collect(), ..stack() }
}

/// A run in a process of its own: bytes it needed, bytes that were said, layers.
fn measured(dz: f64, fair: f64, method: &str) -> [u64; 3] {
    measured_simpler(dz, fair, method, None)
}

/// The same, with meshes simpler by at most an error.
fn measured_simpler(dz: f64, fair: f64, method: &str, simplify: Option<f64>) -> [u64; 3] {
    let place = folder();
    let result = Command::new(std::env::current_exe().expect("this test"))
        .args(["--exact", "is_what_was_said_at_most", "--nocapture"])
        .env(ASKED, format!("{};{dz};{fair};{method};{}", place.path().display(), simplify.unwrap_or(0.0)))
        .env("RAYON_NUM_THREADS", "2")
        // Freed memory goes back at once, as the program asks for (src/cli/allocator.rs).
        .env("MALLOC_MMAP_THRESHOLD_", GIVEN_BACK)
        .env("MALLOC_TRIM_THRESHOLD_", GIVEN_BACK)
        .output()
        .expect("it starts");
    let said = String::from_utf8_lossy(&result.stdout).into_owned();
    let line = said.lines().find_map(|l| l.split_once("measured ")).unwrap_or_else(|| panic!("{said}")).1;
    let numbers: Vec<u64> = line.split_whitespace().map(|n| n.parse().expect("a number")).collect();
    println!(
        "dz {dz}, fair {fair}, {method}, simplify {simplify:?}: {} MiB of {} MiB, {} layers",
        numbers[0] >> 20,
        numbers[1] >> 20,
        numbers[2]
    );
    numbers.try_into().expect("three numbers")
}

/// The run that is asked for, in this process.
fn one_run(asked: &str) {
    let [place, dz, fair, method, simplify] = asked.split(';').collect::<Vec<_>>().try_into().expect("five words");
    let number = |word: &str| word.parse::<f64>().expect("a number");
    let (method, of) = (if method == "field" { Method::Field } else { Method::Morph }, method);
    let settings = Settings { fair: number(fair), method, ..Settings::default() };
    let simplify = Some(number(simplify)).filter(|error| *error > 0.0);
    let output = OutputOptions { dz: Some(number(dz)), simplify, ..OutputOptions::default() };
    let before = peak();
    let stack = if of == "noise" { noisy() } else { stack() };
    let loaded = Loaded::new(stack, JobOptions { settings, output, ..JobOptions::default() }).expect("it is sound");
    let targets: Vec<_> = KINDS.iter().map(|kind| Path::new(place).join(format!("out.{kind}"))).collect();
    let mut outputs =
        Outputs::open(&targets, None, Temporary::Random, &mut Places::default()).expect("the folder is there");
    let said = loaded.needs().all
        + outputs.bytes(loaded.stack.dims, &loaded.stack.geometry, loaded.stack.lid())
        + loaded.needs_to_simplify(outputs.has_mesh());
    let budget = Budget::unlimited();
    let means = Means { backend: &Reference, progress: &Silent, budget: &budget };
    let mut body = loaded.compute(&means, &mut outputs).expect("it can be computed");
    outputs.complete(&mut body.report).expect("it can be written");
    outputs.rename().expect("it can be renamed");
    println!("measured {} {said} {}", peak() - before, loaded.heights.len());
}

#[test]
fn is_what_was_said_at_most() {
    // In a process of its own it is one run.
    if let Ok(asked) = std::env::var(ASKED) {
        return one_run(&asked);
    }
    let field = [(1.0, 1.0), (0.25, 1.0), (0.25, 0.0)].map(|(dz, fair)| (dz, fair, "field"));
    for (dz, fair, method) in field.into_iter().chain([(1.0, 1.0, "morph"), (1.0, 1.0, "noise")]) {
        let [needed, said, _] = measured(dz, fair, method);
        assert!(needed <= said, "{needed} bytes were needed, {said} said");
        assert!(6 * needed >= said, "{needed} bytes were needed, {said} said: too many");
    }
}

#[cfg(feature = "simplify")]
#[test]
fn of_simplifying_is_what_was_said_at_most() {
    let [plain, said, _] = measured(0.5, 0.0, "field");
    // At an error so small that less can be left out, and at a usual one.
    for error in [0.01, 0.3] {
        let [needed, more, _] = measured_simpler(0.5, 0.0, "field", Some(error));
        assert!(needed > plain + (10 << 20) && more > said, "{needed} bytes were needed, {plain} without");
        assert!(needed <= more, "{needed} bytes were needed, {more} said");
        assert!(6 * needed >= more, "{needed} bytes were needed, {more} said: too many");
    }
}

#[test]
fn of_a_mesh_are_its_triangles_which_contours_tell() {
    let mut stacks: Vec<(ContourStack, Settings)> = interslice::evaluate::demo::NAMES
        .into_iter()
        .filter_map(interslice::evaluate::demo::demo)
        .map(|d| (d.stack, d.settings))
        .collect();
    stacks.push((stack(), Settings::default()));
    for (stack, settings) in stacks {
        let heights = interslice::height_grid(&stack, &settings, None).heights().expect("a few");
        let body = interslice::reconstruct_with(&stack, &heights, &settings, &Reference, &Silent).expect("it can be");
        let triangles = interslice::surface::mesh::closed_surface(&body).triangles.len() as u64;
        let said = interslice::estimate::memory::triangles(&stack, &heights);
        println!("{triangles} triangles, {said} said");
        assert!(triangles <= said && said <= 3 * triangles, "{triangles} triangles, {said} said");
    }
}

#[test]
fn does_not_grow_with_the_layers() {
    let [few, _, layers] = measured(0.25, 0.0, "field");
    let [many, _, more] = measured(0.05, 0.0, "field");
    let voxels = (more - layers) * (SIDE * SIDE * 4) as u64;
    assert!(voxels > 100 << 20, "{voxels} bytes of layers more");
    // The layers of an interval wait for each other, near the contours alone.
    assert!(many < few + voxels / 3, "{few} bytes for {layers} layers, {many} for {more}");
}

/// The program on many slices with these arguments: its largest resident set, bytes, and what it wrote.
fn program(place: &Path, arguments: &[&str]) -> (u64, Vec<Vec<u8>>) {
    let outputs = ["out.nrrd", "out.stl"].map(|name| place.join(name));
    let mut child = Command::new(env!("CARGO_BIN_EXE_interslice"))
        .arg("reconstruct")
        .arg(place.join("in.nrrd"))
        .args(["--threads", "2", "--dz", "2", "-q", "-o"])
        .args([&outputs[0], Path::new("-o"), &outputs[1]])
        .args(arguments)
        .spawn()
        .expect("it starts");
    let process = child.id().to_string();
    let mut peak = 0;
    let status = loop {
        peak = peak.max(peak_of(&process).unwrap_or(0));
        match child.try_wait().expect("it can be waited for") {
            Some(status) => break status,
            None => sleep(Duration::from_millis(2)),
        }
    };
    assert!(status.success(), "{arguments:?}: {status}");
    (peak, outputs.iter().map(|path| fs::read(path).expect("it was written")).collect())
}

/// Slices 4 apart in images of `side` px squared, as `in.nrrd`: where `inside` says so of slice, x and y.
fn write_slices(place: &Path, side: usize, slices: usize, inside: impl Fn(f64, f64, f64) -> bool) {
    let header = format!(
        "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: {side} {side} {slices}\n\
         space directions: (1,0,0) (0,1,0) (0,0,4)\nencoding: raw\nspace origin: (0,0,0)\n\n"
    );
    let voxel = |n: usize| {
        let (k, n) = (n / (side * side), n % (side * side));
        u8::from(inside(k as f64, (n % side) as f64, (n / side) as f64))
    };
    let voxels = (0..side * side * slices).map(voxel);
    let path = place.join("in.nrrd");
    fs::write(path, header.into_bytes().into_iter().chain(voxels).collect::<Vec<u8>>()).expect("it can be written");
}

/// A disc that wanders and swells, as `in.nrrd`.
fn many_slices(place: &Path) {
    let inside = |k: f64, x: f64, y: f64| (x - 150.0 - 4.0 * k).hypot(y - 190.0) < 70.0 + 15.0 * (0.5 * k).sin();
    write_slices(place, SIDE, 24, inside);
}

#[test]
fn a_run_stays_within_what_it_is_allowed_and_writes_the_same() {
    let place = folder();
    many_slices(place.path());
    let (free, whole) = program(place.path(), &["--backend", "cpu"]);
    let (bounded, same) = program(place.path(), &["--backend", "cpu", "--memory", "80M"]);
    println!("{} MiB, {} MiB of 80 allowed", free >> 20, bounded >> 20);
    assert!(bounded <= 80 << 20, "{bounded} bytes were needed, 80 MiB allowed");
    assert!(2 * free > 3 * bounded, "{free} bytes are needed without bound: too little to tell");
    assert!(whole == same, "the bound changes what is written");
}

/// Of a hollow tube that leans slices are kept with their holes filled, and fields of both.
#[test]
fn a_hollow_body_stays_within_what_it_is_allowed_too() {
    let place = folder();
    let inside = |k: f64, x: f64, y: f64| {
        let (x, y) = (x - 80.0 - 40.0 * k, y - 240.0);
        (40.0..60.0).contains(&x.hypot(y))
    };
    write_slices(place.path(), 480, 9, inside);
    let least = |bytes: &str| {
        let run = Command::new(env!("CARGO_BIN_EXE_interslice"))
            .arg("reconstruct")
            .arg(place.path().join("in.nrrd"))
            .args(["--backend", "cpu", "--threads", "2", "--dz", "2", "--dry-run", "--memory", bytes, "-o"])
            .args([place.path().join("out.nrrd"), "-o".into(), place.path().join("out.stl")])
            .output()
            .expect("it starts");
        run.status.success()
    };
    let bound = (40..400).find(|mib| least(&format!("{mib}M"))).expect("400 MiB are enough");
    let (peak, _) = program(place.path(), &["--backend", "cpu", "--memory", &format!("{bound}M")]);
    println!("{} MiB of {bound} allowed", peak >> 20);
    assert!(peak <= bound << 20, "{peak} bytes were needed, {bound} MiB allowed");
}

#[test]
fn where_no_temporary_file_can_be_made_a_bounded_run_is_refused() {
    let place = folder();
    many_slices(place.path());
    let (gone, out) = (place.path().join("gone"), place.path().join("out.nrrd"));
    let run = Command::new(env!("CARGO_BIN_EXE_interslice"))
        .arg("reconstruct")
        .arg(place.path().join("in.nrrd"))
        .args(["--backend", "cpu", "--memory", "80M", "-q", "-o"])
        .arg(&out)
        .env("TMPDIR", &gone)
        .output()
        .expect("it starts");
    let told = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(2), "{told}");
    assert!(told.contains(&format!("{}: cannot write: no temporary file (", gone.display())), "{told}");
    assert!(told.contains("set TMPDIR") && !out.exists(), "{told}");
}

/// A bound from outside, of the address space, is kept, or the run is refused before it starts; the outputs are those without a bound.
#[cfg(target_os = "linux")]
#[test]
fn what_ulimit_leaves_is_a_bound() {
    let place = folder();
    many_slices(place.path());
    let whole = program(place.path(), &["--backend", "cpu"]).1;
    let [mut made, mut refused] = [0, 0];
    for mib in (60..300).step_by(30) {
        let script = "ulimit -v $1; cd \"$2\"; exec \"$3\" reconstruct in.nrrd --threads 2 --dz 2 --backend cpu -o u.nrrd -o u.stl";
        let bounded = Command::new("sh")
            .args(["-c", script, "sh", &(mib << 10).to_string()])
            .arg(place.path())
            .arg(env!("CARGO_BIN_EXE_interslice"))
            .env_remove("RUST_BACKTRACE")
            .output()
            .expect("a shell starts");
        let said = String::from_utf8_lossy(&bounded.stderr);
        let [volume, mesh] = ["u.nrrd", "u.stl"].map(|name| place.path().join(name));
        match bounded.status.code() {
            Some(0) => {
                assert_eq!(whole, [&volume, &mesh].map(|path| fs::read(path).expect("it was written")));
                [volume, mesh].iter().for_each(|path| fs::remove_file(path).expect("it was there"));
                made += 1;
            }
            Some(2) => {
                assert!(said.contains("MiB of memory") && made == 0, "{mib} MiB: {said}");
                assert!(!volume.exists() && !mesh.exists(), "{mib} MiB: something was written");
                refused += 1;
            }
            _ => panic!("{mib} MiB: {}, {said}", bounded.status),
        }
    }
    assert!(made >= 4 && refused >= 1, "{made} made, {refused} refused");
}

#[cfg(feature = "gpu")]
#[test]
fn a_run_on_a_gpu_stays_within_what_it_is_allowed_too() {
    let place = folder();
    many_slices(place.path());
    let (free, whole) = program(place.path(), &["--backend", "gpu"]);
    for allowed in [240, 300] {
        let (bounded, same) = program(place.path(), &["--backend", "gpu", "--memory", &format!("{allowed}M")]);
        println!("{} MiB, {} MiB of {allowed} allowed", free >> 20, bounded >> 20);
        assert!(bounded <= allowed << 20, "{bounded} bytes were needed, {allowed} MiB allowed");
        assert!(whole == same, "the bound changes what is written");
    }
    // Where a GPU leaves too little, an automatic choice goes without. Its self-test is behind it then: no bound holds for that.
    program(place.path(), &["--adapter", "0"]);
    let (without, slices) = program(place.path(), &["--adapter", "0", "--memory", "175M"]);
    assert!(without <= 175 << 20, "{without} bytes were needed, 175 MiB allowed");
    assert!(slices == program(place.path(), &["--backend", "cpu"]).1, "it ran on the GPU");
}

#[test]
fn a_flat_end_as_large_as_the_image_takes_hardly_more() {
    // A vertex and two triangles for each of a million pixels are 90 MiB.
    let place = folder();
    write_slices(place.path(), 1024, 2, |_, x, y| (x - 512.0).hypot(y - 512.0) < 505.0);
    let (bounded, _) = program(place.path(), &["--backend", "cpu", "--memory", "260M"]);
    println!("{} MiB of 260 allowed", bounded >> 20);
    assert!(bounded <= 260 << 20, "{bounded} bytes were needed, 260 MiB allowed");
}
