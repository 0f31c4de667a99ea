//! What is written layer by layer is what the collected body gives, in every format.

use std::fs;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use crate::files::folder;
use flate2::read::{GzDecoder, ZlibDecoder};
use glam::DVec3;
use interslice::evaluate::demo::demo;
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::{JobOptions, Loaded};
use interslice::progress::Silent;
use interslice::report::Report;
use interslice::stack::appearance::Appearance;
use interslice::stack::{ContourStack, Geometry, HeightGrid};
use interslice::surface::glb::About;
use interslice::surface::groups::write_group;
use interslice::surface::heightmap::ArrivalHeights;
use interslice::surface::marching::Builder;
use interslice::surface::mesh::{MeshSource, closed_surface};
use interslice::surface::mesh_files::{StlWriter, write_obj, write_ply};
use interslice::surface::render::{RenderOptions, contour_lines, render};
use interslice::surface::spool::Spool;
use interslice::surface::stream::LayerSink;
use interslice::surface::three_mf::write_3mf;
use interslice::surface::vtk::write_vtp;
use tiff::decoder::{Decoder, DecodingResult};

use interslice::{Budget, Means, Reconstruction, Reference, Settings, reconstruct_with};

const KINDS: [&str; 15] = [
    "nrrd",
    "nii",
    "nii.gz",
    "mha",
    "npy",
    "tif",
    "vti",
    "stl",
    "ply",
    "obj",
    "groups.obj",
    "3mf",
    "vtp",
    "png",
    "dem.tif",
];
const VOLUMES: [&str; 7] = ["nrrd", "nii", "nii.gz", "mha", "npy", "tif", "vti"];
/// Axes of the input along which columns, rows and heights of slices across x, y, z run.
const ACROSS: [[usize; 3]; 3] = [[1, 2, 0], [0, 2, 1], [0, 1, 2]];

/// A frame that is oblique, slices across y of their input, and a frame that mirrors, slices across x.
fn placed(stack: &ContourStack) -> [ContourStack; 3] {
    let axes = [DVec3::new(0.8, 0.6, 0.0), DVec3::new(-0.6, 0.8, 0.0), DVec3::Z];
    let oblique = Geometry { origin: DVec3::new(10.0, -20.5, 300.0), axes, order: ACROSS[2], ..Geometry::default() };
    let across_y = Geometry { order: ACROSS[1], ..oblique };
    let mirrored = Geometry { axes: [DVec3::NEG_X, DVec3::Y, DVec3::Z], order: ACROSS[0], ..oblique };
    [oblique, across_y, mirrored].map(|geometry| ContourStack { geometry, ..stack.clone() })
}

/// Voxels of the output layers as bytes, in the order of the input's axes.
fn in_order(body: &Reconstruction, mask: bool) -> Vec<u8> {
    let layers: Vec<_> = body.output_layers().collect();
    let order = body.geometry.order;
    let mut sizes = [0; 3];
    order.iter().zip([body.dims[0], body.dims[1], layers.len()]).for_each(|(axis, n)| sizes[*axis] = n);
    let mut bytes = Vec::new();
    for n in 0..sizes.iter().product() {
        let xyz = [n % sizes[0], n / sizes[0] % sizes[1], n / (sizes[0] * sizes[1])];
        let [i, j, k] = order.map(|axis| xyz[axis]);
        let phi = layers[k].phi[j * body.dims[0] + i];
        if mask { bytes.push(u8::from(phi < 0.0)) } else { bytes.extend(phi.to_le_bytes()) }
    }
    bytes
}

fn named(place: &Path) -> Vec<PathBuf> {
    KINDS.iter().map(|kind| place.join(format!("out.{kind}"))).collect()
}

/// Everything about a stack: streamed into files, with its report, and the body as it was collected.
fn both(place: &Path, stack: &ContourStack, settings: &Settings, mask: bool) -> (Report, Reconstruction) {
    let output = OutputOptions { mask, contours: true, ..OutputOptions::default() };
    let options = JobOptions { settings: settings.clone(), output, ..JobOptions::default() };
    let loaded = Loaded::new(stack.clone(), options).expect("the stack is sound");
    let mut outputs =
        Outputs::open(&named(place), None, Temporary::Random, &mut Places::default()).expect("the folder is there");
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
fn of_mesh(body: &Reconstruction) -> [Vec<u8>; 7] {
    let mesh = closed_surface(body);
    let mut stl = StlWriter::new(Cursor::new(Vec::new()), DVec3::ZERO).expect("memory can be written");
    stl.facets(mesh.corners()).and_then(|()| stl.close()).expect("memory can be written");
    let (mut ply, mut obj, mut png) = (Vec::new(), Vec::new(), Cursor::new(Vec::new()));
    write_ply(&mut ply, &mut &mesh).expect("memory can be written");
    write_obj(&mut obj, &mut &mesh).expect("memory can be written");
    let appearance = Appearance { name: Some("out".into()), ..Appearance::default() };
    let about = About { appearance, unit: body.unit.clone(), origin: DVec3::ZERO, ..About::default() };
    let (mut groups, mut packed, mut vtp) = (Vec::new(), Cursor::new(Vec::new()), Vec::new());
    write_group(&mut groups, &mut &mesh, &about).expect("memory can be written");
    write_3mf(&mut packed, &mut &mesh, &about).expect("memory can be written");
    write_vtp(&mut vtp, &mut &mesh, &about).expect("memory can be written");
    let contours = body.layers.iter().filter(|l| l.contour.is_some());
    let lines: Vec<_> = contours.flat_map(|l| contour_lines(&body.header(), l)).collect();
    let options = RenderOptions { contours: true, ..RenderOptions::default() };
    let picture = render(&body.geometry, &mut &mesh, &lines, options).expect("memory can be read");
    picture.write_to(&mut png, image::ImageFormat::Png).expect("memory can be written");
    [stl.into_inner().into_inner(), ply, obj, groups, packed.into_inner(), vtp, png.into_inner()]
}

/// The voxels of a volume file.
fn voxels(bytes: &[u8], kind: &str) -> Vec<u8> {
    let read = |mut from: Box<dyn Read + '_>| {
        let mut out = Vec::new();
        from.read_to_end(&mut out).expect("a whole stream");
        out
    };
    let after =
        |end: &[u8]| &bytes[bytes.windows(end.len()).position(|w| w == end).expect("a header ends") + end.len()..];
    match kind {
        "nii" => bytes[352..].to_vec(),
        "npy" => bytes[10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]))..].to_vec(),
        "tif" => {
            let mut pages = Decoder::new(Cursor::new(bytes)).expect("a TIFF");
            let mut voxels = Vec::new();
            loop {
                match pages.read_image().expect("a page") {
                    DecodingResult::U8(page) => voxels.extend(page),
                    DecodingResult::F32(page) => page.iter().for_each(|v| voxels.extend(v.to_le_bytes())),
                    _ => panic!("masks of 8 bits, distances of 32"),
                }
                if !pages.more_images() {
                    return voxels;
                }
                pages.next_image().expect("another page");
            }
        }
        "vti" => {
            let data = after(b"<AppendedData encoding=\"raw\">\n_");
            let (length, data) = data.split_at(8);
            let length = u64::from_le_bytes(length.try_into().expect("eight bytes")) as usize;
            assert_eq!(&data[length..], b"\n</AppendedData>\n</VTKFile>\n");
            data[..length].to_vec()
        }
        "nii.gz" => read(Box::new(GzDecoder::new(bytes)))[352..].to_vec(),
        "mha" => {
            let data = after(b"ElementDataFile = LOCAL\n");
            let header = String::from_utf8_lossy(&bytes[..bytes.len() - data.len()]);
            let size = header.lines().find_map(|l| l.strip_prefix("CompressedDataSize = ")).expect("it is said");
            assert_eq!(size.trim().parse::<usize>().expect("a number"), data.len());
            read(Box::new(ZlibDecoder::new(data)))
        }
        _ => read(Box::new(GzDecoder::new(after(b"\n\n")))),
    }
}

/// The first slices of a demo, and few layers.
fn beginning(stack: ContourStack) -> ContourStack {
    let slices: Vec<_> = stack.slices.into_iter().take(6).collect();
    let [start, top] = [0, slices.len() - 1].map(|k| slices[k].z);
    let grid = HeightGrid { start, step: (top - start) / 20.0, count: 21 };
    ContourStack { slices, z_out: Some(grid), ..stack }
}

#[test]
fn every_format_is_that_of_the_collected_body() {
    for (n, name) in ["fig5", "fig6", "fig8", "fig9", "fig10"].into_iter().enumerate() {
        let demo = demo(name).expect("a demo");
        let stack = beginning(demo.stack);
        // A small one in each frame, the others in one frame each.
        for (k, stack) in placed(&stack).iter().enumerate().filter(|(k, _)| n == 0 || n % ACROSS.len() == *k) {
            let place = folder();
            let mask = k == 2;
            let (report, body) = both(place.path(), stack, &demo.settings, mask);
            let file = |kind: &str| fs::read(place.path().join(format!("out.{kind}"))).expect("it was written");
            let given = in_order(&body, mask);
            for kind in VOLUMES {
                assert!(voxels(&file(kind), kind) == given, "{name} {k}: {kind}");
            }
            for (kind, bytes) in ["stl", "ply", "obj", "groups.obj", "3mf", "vtp", "png"].iter().zip(of_mesh(&body)) {
                assert!(file(kind) == bytes, "{name} {k}: {kind}");
            }
            let mesh = closed_surface(&body);
            assert_eq!((report.volume, report.area), (Some(mesh.volume()), Some(mesh.area())), "{name} {k}");
        }
    }
}

/// Smooth values that no two voxels near each other share.
fn wavy(dims: [usize; 2], layers: usize, order: [usize; 3]) -> Reconstruction {
    let heights: Vec<f64> = (0..layers).map(|k| k as f64).collect();
    let mut body = crate::support::body(dims, &heights, |x, y, z| 3.0 + 0.001 * x + (0.01 * y).sin() - 0.0037 * z);
    body.geometry.order = order;
    body
}

#[test]
fn layers_across_every_axis_come_in_the_order_of_their_input() {
    let place = folder();
    let orders = ACROSS.iter().copied().chain([[1, 0, 2], [2, 1, 0], [2, 0, 1]]);
    for (order, mask) in orders.flat_map(|order| [(order, false), (order, true)]) {
        let mut body = wavy([9, 7], 8, order);
        // One layer is none of the output.
        body.layers[5].output = false;
        body.layers.iter_mut().for_each(|l| l.phi.map(|v| v - 3.0));
        let given = in_order(&body, mask);
        for kind in VOLUMES {
            let path = place.path().join(format!("out.{kind}"));
            crate::support::write(&path, &body, mask);
            assert!(voxels(&fs::read(&path).expect("written"), kind) == given, "{order:?}, {kind}");
        }
    }
    assert_eq!(crate::files::listing(place.path()).len(), VOLUMES.len(), "no file of layers that wait is left");
}

/// 42 MB in blocks of whole planes, 72 MB whose planes are too large for a block.
#[test]
fn layers_that_wait_are_read_back_in_blocks() {
    let place = folder();
    let path = place.path().join("out.nii");
    for (dims, layers) in [([500, 600], 35), ([3100, 2], 2900)] {
        for order in &ACROSS[..2] {
            let body = wavy(dims, layers, *order);
            crate::support::write(&path, &body, false);
            assert!(voxels(&fs::read(&path).expect("written"), "nii") == in_order(&body, false), "{dims:?}, {order:?}");
        }
    }
}

#[test]
fn a_height_map_is_where_each_pixel_leaves_the_body() {
    let heights = [0.0, 1.0, 1.5, 4.0, 6.0];
    let body = crate::support::body([9, 8], &heights, |x, y, z| (x - 4.0).hypot(y - 3.5) - 5.0 + z);
    let header = body.header();
    let mut map = ArrivalHeights::new(header.dims, header.extent);
    body.layers.iter().for_each(|l| map.layer(l));
    for (n, h) in map.finish().iter().enumerate() {
        let r = ((n % 9) as f64 - 4.0).hypot((n / 9) as f64 - 3.5);
        match r < 5.0 {
            true => assert!((*h - (5.0 - r)).abs() < 1e-5, "pixel {n}: {h} for {}", 5.0 - r),
            false => assert!(h.is_nan(), "pixel {n}: {h}"),
        }
    }
}

#[test]
fn a_spool_beyond_its_memory_gives_the_same_mesh() {
    // Some million vertices and triangles: more than a spool keeps in memory.
    let heights: Vec<f64> = (0..40).map(f64::from).collect();
    let wave = |x: f64, y: f64, z: f64| (2.3 * x).sin() + (2.7 * y).sin() + (2.1 * z).sin();
    let body = crate::support::body([180, 170], &heights, wave);
    let mut builder = Builder::new(&body.header());
    let place = folder();
    let mut spool = Spool::new(place.path());
    for layer in &body.layers {
        builder.layer(layer);
        builder.pieces(|piece| spool.push(piece).expect("the disk has room"));
    }
    builder.finish();
    builder.pieces(|piece| spool.push(piece).expect("the disk has room"));
    spool.finish().expect("the disk has room");
    let mesh = closed_surface(&body);
    assert_eq!(spool.counts(), (&mesh).counts());
    let bytes = 48 * spool.counts()[0] + 12 * spool.counts()[1];
    assert!(bytes > 64 << 20 && spool.is_on_disk(), "{bytes} bytes");
    assert_eq!(crate::files::listing(place.path()).len(), 0, "its file has no name");
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
        let mut outputs =
            Outputs::open(&names, None, Temporary::Fixed, &mut Places::default()).expect("the folder is there");
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
    assert_eq!(crate::files::listing(places[1].path()).len(), once.len(), "no temporary file is left");
}

#[cfg(feature = "zarr")]
mod zarr {
    use std::sync::Arc;

    use zarrs::array::Array;
    use zarrs::filesystem::FilesystemStore;

    use super::*;
    use crate::files::{interslice, sound_stack, stderr};

    fn open(path: &Path) -> Array<FilesystemStore> {
        let store = Arc::new(FilesystemStore::new(path).expect("it is a folder"));
        Array::open(store, "/0").expect("it is an array")
    }

    /// A wide body of 70 layers, so that chunks end within it along every axis.
    fn wide() -> Reconstruction {
        let heights: Vec<f64> = (0..70).map(|k| 0.5 * f64::from(k)).collect();
        let mut body = crate::support::body([300, 260], &heights, |x, y, z| (x - 150.0).hypot(y - 130.0) - 100.0 - z);
        // One layer is none of the output.
        body.layers[3].output = false;
        body
    }

    #[test]
    fn is_read_back_by_zarrs() {
        let (place, body) = (folder(), wide());
        let path = place.path().join("out.zarr");
        let given: Vec<f32> = body.output_layers().flat_map(|l| l.dense()).collect();
        crate::support::write(&path, &body, false);
        let array = open(&path);
        assert_eq!(array.shape(), [69, 260, 300]);
        let back: Vec<f32> = array.retrieve_array_subset(&array.subset_all()).expect("it is whole");
        assert!(back == given);
        let chunks = |path: &Path| files_in(path).len();
        assert_eq!(chunks(&path), 2 + 2 * 2 * 2, "two metadata files and all chunks");
        // The same name again, now as a mask: the old one is replaced as a whole.
        crate::support::write(&path, &body, true);
        let array = open(&path);
        let back: Vec<u8> = array.retrieve_array_subset(&array.subset_all()).expect("it is whole");
        assert!(back.iter().zip(&given).all(|(m, phi)| *m == u8::from(*phi < 0.0)) && back.len() == given.len());
        assert_eq!(crate::files::listing(place.path()), [path], "nothing else is left");
    }

    fn files_in(path: &Path) -> Vec<PathBuf> {
        interslice::storage::folders::files_below(path).expect("a folder")
    }

    #[test]
    fn layers_across_every_axis_come_in_the_order_of_their_input() {
        for order in ACROSS {
            let (place, mut body) = (folder(), wide());
            body.geometry.order = order;
            let path = place.path().join("out.zarr");
            crate::support::write(&path, &body, false);
            let array = open(&path);
            let back: Vec<f32> = array.retrieve_array_subset(&array.subset_all()).expect("it is whole");
            let bytes: Vec<u8> = back.iter().flat_map(|v| v.to_le_bytes()).collect();
            assert!(bytes == in_order(&body, false), "{order:?}");
            let mut sizes = [0; 3];
            order.iter().zip([300, 260, 69]).for_each(|(axis, n)| sizes[2 - axis] = n);
            assert_eq!(array.shape(), sizes, "z, y, x");
        }
    }

    #[test]
    fn a_folder_of_something_else_stays() {
        let place = folder();
        let path = place.path().join("mine.zarr");
        fs::create_dir(&path).expect("a folder can be made");
        fs::write(path.join("notes.txt"), "mine").expect("a file can be written");
        let said = Outputs::open(std::slice::from_ref(&path), None, Temporary::Random, &mut Places::default())
            .map(drop)
            .expect_err("it must stay");
        assert!(said.to_string().contains("none of Zarr"), "{said}");
        assert_eq!(files_in(&path).len(), 1);
    }

    #[test]
    fn a_zarr_that_holds_anything_else_stays() {
        let (body, stack) = (wide(), folder());
        sound_stack(stack.path());
        type Spoil<'s> = &'s dyn Fn(&Path);
        let spoilt: [(&str, Spoil<'_>); 5] = [
            ("`labels`, `notes.txt`", &|path| {
                fs::create_dir_all(path.join("labels/a/0")).expect("a folder can be made");
                fs::write(path.join("notes.txt"), "mine").expect("a file can be written");
            }),
            ("`1`", &|path| fs::create_dir(path.join("1")).expect("a folder can be made")),
            ("`0/mine`", &|path| fs::write(path.join("0/mine"), "mine").expect("a file can be written")),
            ("`a`, `b`, `c`, `d`, `e` and 2 more", &|path| {
                ["a", "b", "c", "d", "e", "f", "g"].iter().for_each(|n| fs::write(path.join(n), n).expect("room"));
            }),
            ("another program", &|path| {
                fs::write(path.join("zarr.json"), r#"{"node_type": "group", "attributes": {"ome": {}}}"#)
                    .expect("room");
            }),
        ];
        for (words, spoil) in spoilt {
            let place = folder();
            let path = place.path().join("mine.zarr");
            crate::support::write(&path, &body, true);
            // Finder's own file is no work of anybody's.
            fs::write(path.join(".DS_Store"), "").expect("a file can be written");
            crate::support::write(&path, &body, true);
            spoil(&path);
            let had = files_in(&path);
            let [input, output] = [stack.path(), &path].map(|path| path.display().to_string());
            let done = interslice(&["reconstruct", &input, "-o", &output, "--backend", "cpu"]);
            let said = stderr(&done);
            assert_eq!(done.status.code(), Some(2), "{said}");
            assert!(said.contains("mine.zarr: cannot write") && said.contains(words), "{said}");
            assert!(!said.contains("running on"), "it is refused before the work: {said}");
            assert_eq!(files_in(&path), had, "{words}");
        }
    }
}
