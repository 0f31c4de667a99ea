//! Simpler meshes: closed and near, the same in every file and with any number of threads.

use std::fs;

use crate::files::folder;
use crate::support::{edge_defects, merged};
use crate::written::{collected, cone, drawn, write};
use glam::DVec3;
use interslice::Settings;
use interslice::evaluate::demo::demo;
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::report::Report;
use interslice::surface::mesh::{Mesh, closed_surface};
use interslice::surface::simplify::{TriangleTree, simplified};
use interslice::surface::stream::LayerSink;

/// Largest distance of random points of `from` to `to`.
fn farthest(from: &Mesh, to: &Mesh) -> f64 {
    let to = TriangleTree::new(to);
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    };
    let corners: Vec<_> = from.corners().collect();
    let points = corners.iter().flat_map(|[a, b, c]| {
        let [u, v] = [random(), random()];
        let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
        [a + u * (b - a) + v * (c - a), *a, a.midpoint(*b)]
    });
    points.map(|p| to.from(p)).fold(0.0, f64::max)
}

/// Vertices less edges plus triangles, of a closed mesh.
fn euler(mesh: &Mesh) -> i64 {
    mesh.positions.len() as i64 - mesh.triangles.len() as i64 / 2
}

#[test]
fn simpler_meshes_are_closed_and_near() {
    // Errors, and parts of the triangles that may be left; fig9 and fig10 have caps, creases and needles.
    let rounds = [
        ("fig5", 0.05, 0.4),
        ("fig6", 0.5, 0.1),
        ("fig9", 0.05, 0.25),
        ("fig9", 0.3, 0.05),
        ("fig10", 0.02, 0.6),
        ("fig10", 1.0, 0.04),
    ];
    for (name, error, share) in rounds {
        let demo = demo(name).expect("a demo");
        let mesh = closed_surface(&collected(&demo.stack, &demo.settings));
        let simpler = simplified(&mesh, error).expect("there is a simpler one");
        let far = [farthest(&mesh, &simpler), farthest(&simpler, &mesh)];
        println!(
            "{name}, {error}: {} of {} triangles, {:.3} and {:.3} away, volume {:+.4} %",
            simpler.triangles.len(),
            mesh.triangles.len(),
            far[0],
            far[1],
            100.0 * (simpler.volume() / mesh.volume() - 1.0)
        );
        assert_eq!(edge_defects(&simpler.triangles), 0, "{name}");
        assert_eq!(edge_defects(&merged(&simpler)), 0, "{name}: after merging equal positions");
        assert_eq!(euler(&simpler), euler(&mesh), "{name}");
        assert!(far[0] <= error && far[1] <= error, "{name}: {far:?} beyond {error}");
        assert!((simpler.triangles.len() as f64) < share * mesh.triangles.len() as f64, "{name}, {error}");
    }
}

#[test]
fn round_bodies_keep_their_volume_and_what_they_lose_is_told() {
    // Errors, parts of the triangles that may be left, and of the volume that may be lost. By vertices that stay where they
    // are 0.6, 2.7 and 14 % are.
    let heights: Vec<f64> = (0..14).map(|k| 4.0 * f64::from(k) - 26.0).collect();
    let ellipsoid = |x: f64, y: f64, z: f64| DVec3::new((x - 35.3) / 30.0, (y - 24.6) / 18.0, z / 26.5).length() < 1.0;
    let stack = drawn([71, 50], &heights, ellipsoid);
    let whole = closed_surface(&collected(&stack, &Settings::default()));
    for (error, share, lost) in [(0.3, 0.1, 0.0045), (1.0, 0.03, 0.015), (4.0, 0.01, 0.09)] {
        let simpler = simplified(&whole, error).expect("there is a simpler one");
        let (gain, left) = (simpler.volume() / whole.volume() - 1.0, simpler.triangles.len());
        println!("{error}: {left} of {} triangles, volume {:+.2} %", whole.triangles.len(), 100.0 * gain);
        assert!((left as f64) < share * whole.triangles.len() as f64 && gain.abs() < lost, "{error}: {left}, {gain}");
        let place = folder();
        let output = OutputOptions { simplify: Some(error), ..OutputOptions::default() };
        let report = write(place.path(), &stack, &Settings::default(), output, &["a.stl", "a.ply"]);
        let told = format!("simplify: {left} triangles enclose {:.1} % less volume than the full mesh", -100.0 * gain);
        let times = report.warnings.iter().filter(|w| w.contains("simplify")).count();
        assert_eq!(times, usize::from(gain < -0.01), "{:?}", report.warnings);
        assert!(times == 0 || report.warnings.contains(&told), "{:?} for {told}", report.warnings);
    }
}

#[test]
fn an_error_larger_than_the_body_leaves_a_body() {
    let whole = closed_surface(&collected(&cone(), &Settings::default()));
    for error in [30.0, 1e3, 1e6] {
        let simpler = simplified(&whole, error).expect("there is a simpler one");
        println!("{error}: {} of {} triangles", simpler.triangles.len(), whole.triangles.len());
        assert!((4..=400).contains(&simpler.triangles.len()), "{error}: {}", simpler.triangles.len());
        assert!(edge_defects(&simpler.triangles) == 0 && euler(&simpler) == 2 && simpler.volume() > 0.0, "{error}");
    }
}

#[test]
fn the_simpler_mesh_does_not_depend_on_the_threads() {
    let demo = demo("fig10").expect("a demo");
    let mesh = closed_surface(&collected(&demo.stack, &demo.settings));
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| simplified(&mesh, 0.2)).expect("there is a simpler one")
    });
    assert!(one == three);
}

#[test]
fn an_open_mesh_is_not_made_simpler() {
    let demo = demo("fig10").expect("a demo");
    let mut mesh = closed_surface(&collected(&demo.stack, &demo.settings));
    mesh.triangles.swap_remove(1000);
    assert!(simplified(&mesh, 0.5).is_none());
}

#[test]
fn where_nothing_is_simpler_the_whole_mesh_is_written_and_the_report_says_so() {
    let place = folder();
    let heights: Vec<f64> = (0..7).map(f64::from).collect();
    // Rough everywhere, and nothing of it flat: outside along the border and on the first and last layer.
    let rough = |x: f64, y: f64, z: f64| {
        let on_border = [x, y].iter().any(|v| *v == 0.0 || *v == 9.0) || z == 0.0 || z == 6.0;
        let noise = ((12.9898 * x + 78.233 * y + 37.719 * z).sin() * 43758.5453).fract();
        if on_border { 0.6 + 0.3 * noise } else { noise }
    };
    let body = crate::support::body([10, 10], &heights, rough);
    let whole = closed_surface(&body);
    assert!(whole.triangles.len() > 500);
    assert!(simplified(&whole, 1e-9).is_none());
    let targets = ["a.json", "a.stl", "a.ply"].map(|name| place.path().join(name));
    let mut outputs =
        Outputs::open(&targets, None, Temporary::Random, &mut Places::default()).expect("the folder is there");
    let options = OutputOptions { simplify: Some(1e-9), ..OutputOptions::default() };
    let mut sink = outputs.sink(&options);
    sink.begin(&body.header()).expect("it can be written");
    body.layers.iter().try_for_each(|l| sink.layer(l.clone())).expect("it can be written");
    drop(sink);
    let mut report = Report::default();
    outputs.complete(&mut report).expect("it can be written");
    outputs.rename().expect("it can be renamed");
    let stl = fs::read(&targets[1]).expect("written");
    assert_eq!(stl.len(), 84 + 50 * whole.triangles.len());
    let told: Report = serde_json::from_slice(&fs::read(&targets[0]).expect("written")).expect("a report");
    assert_eq!(told.warnings.len(), 1, "{:?}", told.warnings);
    assert!(told.warnings[0].contains("simplify: no closed surface with fewer triangles"), "{:?}", told.warnings);
    assert_eq!(told.warnings, report.warnings);
}

#[test]
fn all_mesh_files_hold_the_same_simpler_mesh() {
    let place = folder();
    let stack = cone();
    let settings = Settings::default();
    let output = OutputOptions { simplify: Some(0.3), ..OutputOptions::default() };
    let report = write(place.path(), &stack, &settings, output, &["a.stl", "a.ply", "a.obj"]);
    let whole = closed_surface(&collected(&stack, &settings));
    assert_eq!(report.volume, Some(whole.volume()), "the report tells of the full one");
    let simpler = simplified(&whole, 0.3).expect("there is a simpler one");
    let stl = fs::read(place.path().join("a.stl")).expect("written");
    assert_eq!(stl.len(), 84 + 50 * simpler.triangles.len());
    let obj = fs::read_to_string(place.path().join("a.obj")).expect("written");
    assert_eq!(obj.lines().filter(|l| l.starts_with("f ")).count(), simpler.triangles.len());
    let ply = fs::read(place.path().join("a.ply")).expect("written");
    let header = String::from_utf8_lossy(&ply[..400]).into_owned();
    assert!(header.contains(&format!("element vertex {}\n", simpler.positions.len())), "{header}");
}
