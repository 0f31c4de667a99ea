//! What is written layer by layer is what the collected body gives, in every format.

#[path = "support/files.rs"]
mod files;
mod support;

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use files::folder;
use interslice::demo::{NAMES, demo};
use interslice::files::outputs::{OutputOptions, Outputs};
use interslice::files::pending::Temporary;
use interslice::files::{JobOptions, Loaded};
use interslice::progress::Silent;
use interslice::report::Report;
use interslice::stack::{ContourStack, Geometry};
use interslice::surface::heightmap::ArrivalHeights;
use interslice::surface::marching::Builder;
use interslice::surface::mesh::{MeshSource, closed_surface};
use interslice::surface::mesh_files::{StlWriter, write_obj, write_ply};
use interslice::surface::render::{RenderOptions, contour_lines, render};
use interslice::surface::spool::Spool;
use interslice::surface::stream::LayerSink;
use interslice::{Budget, Means, Reconstruction, Reference, Settings, reconstruct_with};

const KINDS: [&str; 8] = ["nrrd", "nii", "nii.gz", "stl", "ply", "obj", "png", "tif"];

/// A frame that is oblique, and one that mirrors.
fn placed(stack: &ContourStack) -> [ContourStack; 2] {
    let oblique = Geometry { origin: [10.0, -20.5, 300.0], axes: [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]] };
    let mirrored = Geometry { axes: [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], ..oblique };
    [oblique, mirrored].map(|geometry| ContourStack { geometry, ..stack.clone() })
}

fn named(place: &Path) -> Vec<PathBuf> {
    KINDS.iter().map(|kind| place.join(format!("out.{kind}"))).collect()
}

/// Everything about a stack: streamed into files, with its report, and the body as it was collected.
fn both(place: &Path, stack: &ContourStack, settings: &Settings, mask: bool) -> (Report, Reconstruction) {
    let output = OutputOptions { mask, contours: true, ..OutputOptions::default() };
    let options = JobOptions { settings: settings.clone(), output, ..JobOptions::default() };
    let loaded = Loaded::new(stack.clone(), options).expect("the stack is sound");
    let mut outputs = Outputs::open(&named(place), None, Temporary::Random).expect("the folder is there");
    let budget = Budget::unlimited();
    let means = Means { backend: &Reference, progress: &Silent, budget: &budget };
    let mut streamed = loaded.compute(&means, &mut outputs).expect("it can be computed");
    assert!(streamed.layers.is_empty(), "no layer is kept");
    outputs.complete(&mut streamed.report).expect("it can be written");
    assert_eq!(outputs.rename().expect("it can be renamed"), named(place));
    let collected =
        reconstruct_with(stack, &loaded.heights, settings, &Reference, &Silent).expect("it can be computed");
    (streamed.report, collected)
}

/// The bytes of all formats that hold a surface, made from the mesh in memory.
fn of_mesh(body: &Reconstruction) -> [Vec<u8>; 4] {
    let mesh = closed_surface(body);
    let mut stl = StlWriter::new(Cursor::new(Vec::new())).expect("memory can be written");
    stl.facets(mesh.corners()).and_then(|()| stl.close()).expect("memory can be written");
    let (mut ply, mut obj, mut png) = (Vec::new(), Vec::new(), Cursor::new(Vec::new()));
    write_ply(&mut ply, &mut &mesh).expect("memory can be written");
    write_obj(&mut obj, &mut &mesh).expect("memory can be written");
    let contours = body.layers.iter().filter(|l| l.contour.is_some());
    let lines: Vec<_> = contours.flat_map(|l| contour_lines(&body.header(), l)).collect();
    let options = RenderOptions { contours: true, ..RenderOptions::default() };
    let picture = render(&body.geometry, &mut &mesh, &lines, options).expect("memory can be read");
    picture.write_to(&mut png, image::ImageFormat::Png).expect("memory can be written");
    [stl.into_inner().into_inner(), ply, obj, png.into_inner()]
}

/// The voxels of a volume file.
fn voxels(bytes: &[u8], kind: &str) -> Vec<u8> {
    let unzipped = |bytes: &[u8]| {
        let mut out = Vec::new();
        std::io::copy(&mut flate2::read::GzDecoder::new(bytes), &mut out).expect("a gzip stream");
        out
    };
    match kind {
        "nii" => bytes[352..].to_vec(),
        "nii.gz" => unzipped(bytes)[352..].to_vec(),
        _ => unzipped(&bytes[bytes.windows(2).position(|w| w == b"\n\n").expect("a header ends") + 2..]),
    }
}

#[test]
fn every_format_is_that_of_the_collected_body() {
    for name in NAMES {
        let demo = demo(name).expect("a demo");
        for (k, stack) in placed(&demo.stack).iter().enumerate() {
            let place = folder();
            let mask = k == 1;
            let (report, body) = both(place.path(), stack, &demo.settings, mask);
            let file = |kind: &str| fs::read(place.path().join(format!("out.{kind}"))).expect("it was written");
            let mut given = Vec::new();
            for layer in body.output_layers() {
                match mask {
                    true => given.extend(layer.phi.iter().map(|v| u8::from(*v < 0.0))),
                    false => given.extend(layer.phi.iter().flat_map(|v| v.to_le_bytes())),
                }
            }
            for kind in ["nrrd", "nii", "nii.gz"] {
                assert!(voxels(&file(kind), kind) == given, "{name} {k}: {kind}");
            }
            for (kind, bytes) in ["stl", "ply", "obj", "png"].iter().zip(of_mesh(&body)) {
                assert!(file(kind) == bytes, "{name} {k}: {kind}");
            }
            let mesh = closed_surface(&body);
            assert_eq!((report.volume, report.area), (Some(mesh.volume()), Some(mesh.area())), "{name} {k}");
        }
    }
}

#[test]
fn a_height_map_is_where_each_pixel_leaves_the_body() {
    let heights = [0.0, 1.0, 1.5, 4.0, 6.0];
    let body = support::body([9, 8], &heights, |x, y, z| (x - 4.0).hypot(y - 3.5) - 5.0 + z);
    let mut map = ArrivalHeights::new(&body.header());
    body.layers.iter().for_each(|l| map.layer(l));
    for (n, h) in map.finish().iter().enumerate() {
        let r = ((n % 9) as f64 - 4.0).hypot((n / 9) as f64 - 3.5);
        match r < 5.0 {
            true => assert!((f64::from(*h) - (5.0 - r)).abs() < 1e-5, "pixel {n}: {h} for {}", 5.0 - r),
            false => assert!(h.is_nan(), "pixel {n}: {h}"),
        }
    }
}

#[test]
fn a_spool_beyond_its_memory_gives_the_same_mesh() {
    // Some million vertices and triangles: more than a spool keeps in memory.
    let heights: Vec<f64> = (0..40).map(f64::from).collect();
    let wave = |x: f64, y: f64, z: f64| (2.3 * x).sin() + (2.7 * y).sin() + (2.1 * z).sin();
    let body = support::body([180, 170], &heights, wave);
    let mut builder = Builder::new(&body.header());
    let place = folder();
    let mut spool = Spool::new(place.path());
    for layer in &body.layers {
        spool.push(builder.layer(layer).expect("it is within the extent")).expect("the disk has room");
    }
    spool.push(builder.finish().expect("there were layers")).expect("the disk has room");
    spool.finish().expect("the disk has room");
    let mesh = closed_surface(&body);
    assert_eq!(spool.counts(), (&mesh).counts());
    let bytes = 48 * spool.counts()[0] + 12 * spool.counts()[1];
    assert!(bytes > 64 << 20 && spool.is_on_disk(), "{bytes} bytes");
    assert_eq!(files::listing(place.path()).len(), 0, "its file has no name");
    let (mut from_spool, mut from_memory) = (Vec::new(), Vec::new());
    write_ply(&mut from_spool, &mut spool).expect("memory can be written");
    write_ply(&mut from_memory, &mut &mesh).expect("memory can be written");
    assert!(from_spool == from_memory);
}

/// A run that begins again, as a batch does after a device was lost, writes what one run writes.
#[test]
fn a_run_that_begins_again_leaves_nothing_of_the_first() {
    let demo = demo("fig10").expect("a demo");
    let stack = &demo.stack;
    let heights = interslice::height_grid(stack, &demo.settings, None).heights().expect("a few");
    let body = reconstruct_with(stack, &heights, &demo.settings, &Reference, &Silent).expect("it can be computed");
    let written = |place: &Path, first: usize| {
        let mut names = named(place);
        names.extend(cfg!(feature = "zarr").then(|| place.join("out.zarr")));
        let mut outputs = Outputs::open(&names, None, Temporary::Fixed).expect("the folder is there");
        let options = OutputOptions { contours: true, ..OutputOptions::default() };
        let mut sink = outputs.sink(&options);
        for count in [first, body.layers.len()] {
            sink.begin(&body.header()).expect("it can be written");
            body.layers[..count].iter().try_for_each(|l| sink.layer(l.clone())).expect("it can be written");
        }
        drop(sink);
        outputs.complete(&mut Report::default()).expect("it can be written");
        outputs.rename().expect("it can be renamed");
        names
    };
    let places = [folder(), folder()];
    let [once, again] = [written(places[0].path(), 0), written(places[1].path(), 17)];
    for (a, b) in once.iter().zip(&again).take(KINDS.len()) {
        assert!(fs::read(a).expect("written") == fs::read(b).expect("written"), "{}", a.display());
    }
    assert_eq!(files::listing(places[1].path()).len(), once.len(), "no temporary file is left");
}

#[cfg(feature = "zarr")]
mod zarr {
    use std::sync::Arc;

    use zarrs::array::Array;
    use zarrs::filesystem::FilesystemStore;

    use super::*;

    fn open(path: &Path) -> Array<FilesystemStore> {
        let store = Arc::new(FilesystemStore::new(path).expect("it is a folder"));
        Array::open(store, "/0").expect("it is an array")
    }

    /// A wide body of 70 layers, so that chunks end within it along every axis.
    fn wide() -> Reconstruction {
        let heights: Vec<f64> = (0..70).map(|k| 0.5 * f64::from(k)).collect();
        let mut body = support::body([300, 260], &heights, |x, y, z| (x - 150.0).hypot(y - 130.0) - 100.0 - z);
        // One layer is none of the output.
        body.layers[3].output = false;
        body
    }

    fn write(path: &Path, body: &Reconstruction, mask: bool) {
        let mut outputs = Outputs::open(&[path.into()], None, Temporary::Random).expect("it can be made");
        let options = OutputOptions { mask, ..OutputOptions::default() };
        let mut sink = outputs.sink(&options);
        sink.begin(&body.header()).expect("it can be written");
        body.layers.iter().try_for_each(|l| sink.layer(l.clone())).expect("it can be written");
        drop(sink);
        outputs.complete(&mut Report::default()).expect("it can be written");
        outputs.rename().expect("it can be renamed");
    }

    #[test]
    fn is_read_back_by_zarrs() {
        let (place, body) = (folder(), wide());
        let path = place.path().join("out.zarr");
        let given: Vec<f32> = body.output_layers().flat_map(|l| l.phi.clone()).collect();
        write(&path, &body, false);
        let array = open(&path);
        assert_eq!(array.shape(), [69, 260, 300]);
        let back: Vec<f32> = array.retrieve_array_subset(&array.subset_all()).expect("it is whole");
        assert!(back == given);
        let chunks = |path: &Path| files_in(path).len();
        assert_eq!(chunks(&path), 2 + 2 * 2 * 2, "two metadata files and all chunks");
        // The same name again, now as a mask: the old one is replaced as a whole.
        write(&path, &body, true);
        let array = open(&path);
        let back: Vec<u8> = array.retrieve_array_subset(&array.subset_all()).expect("it is whole");
        assert!(back.iter().zip(&given).all(|(m, phi)| *m == u8::from(*phi < 0.0)) && back.len() == given.len());
        assert_eq!(files::listing(place.path()), [path], "nothing else is left");
    }

    fn files_in(path: &Path) -> Vec<PathBuf> {
        interslice::files::pending::files_below(path).expect("a folder")
    }

    #[test]
    fn a_folder_of_something_else_stays() {
        let place = folder();
        let path = place.path().join("mine.zarr");
        fs::create_dir(&path).expect("a folder can be made");
        fs::write(path.join("notes.txt"), "mine").expect("a file can be written");
        let said = Outputs::open(&[path.clone()], None, Temporary::Random).map(drop).expect_err("it must stay");
        assert!(said.to_string().contains("none of Zarr"), "{said}");
        assert_eq!(files_in(&path).len(), 1);
    }
}
