//! OME-Zarr in, written here byte by byte: versions 0.4 and 0.5, label images, axes, scales; and what is wrong, in words.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::files::*;
use flate2::Compression;
use flate2::read::{GzEncoder, ZlibEncoder};
use glam::DVec3;
use interslice::input::{Input, open_volume, survey};
use interslice::stack::ReadOptions;
use interslice::stack::options::LabelName;
use serde_json::{Value, json};

/// Voxels along z, y, x; drawn slices 0, 3, 6.
const SIZES: [usize; 3] = [7, 10, 12];

/// Labels 2 and 5, z slowest.
fn voxels() -> Vec<u16> {
    let value = |n: usize| {
        let (k, j, i) = (n / 120, n / 12 % 10, n % 12);
        match (k % 3, (i as f64 - 5.0).hypot(j as f64 - 4.5) < 3.5, i < 6) {
            (0, true, true) => 2,
            (0, true, false) => 5,
            _ => 0,
        }
    };
    (0..SIZES.iter().product()).map(value).collect()
}

fn write(path: &Path, bytes: &[u8]) {
    fs::create_dir_all(path.parent().expect("a folder")).expect("a folder can be made");
    fs::write(path, bytes).expect("a file can be written");
}

fn put(path: &Path, value: &Value) {
    write(path, value.to_string().as_bytes());
}

/// Chunks of 3 x 10 x 8 voxels: the last ones stand out beyond the array.
const CHUNK: [usize; 3] = [3, 10, 8];

fn chunks(folder: &Path, name: impl Fn([usize; 3]) -> String) {
    let voxels = voxels();
    for at in [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 1], [1, 0, 1], [2, 0, 1]] {
        let mut bytes = Vec::new();
        for (k, j, i) in (0..3).flat_map(|k| (0..10).flat_map(move |j| (0..8).map(move |i| (k, j, i)))) {
            let [k, j, i] = [k + 3 * at[0], j, i + 8 * at[2]];
            let inside = k < SIZES[0] && i < SIZES[2];
            bytes.extend(if inside { voxels[(k * 10 + j) * 12 + i] } else { 0 }.to_le_bytes());
        }
        write(&folder.join(name(at)), &bytes);
    }
}

/// An array of Zarr 2 with two axes more.
fn array_2(folder: &Path) {
    let [z, y, x] = CHUNK;
    let array = json!({"zarr_format": 2, "shape": [1, 1, 7, 10, 12], "chunks": [1, 1, z, y, x], "dtype": "<u2", "compressor": null,
        "fill_value": 0, "order": "C", "filters": null, "dimension_separator": "/"});
    put(&folder.join(".zarray"), &array);
    chunks(folder, |[k, j, i]| format!("0/0/{k}/{j}/{i}"));
}

/// An array of Zarr 3.
fn array_3(folder: &Path) {
    let array = json!({"zarr_format": 3, "node_type": "array", "shape": SIZES, "data_type": "uint16", "fill_value": 0, "attributes": {},
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": CHUNK}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}]});
    put(&folder.join("zarr.json"), &array);
    chunks(folder, |[k, j, i]| format!("c/{k}/{j}/{i}"));
}

fn space(names: &[&str], unit: Option<&str>) -> Value {
    let axis = |name: &&str| match (*name, unit) {
        ("t", _) => json!({"name": "t", "type": "time"}),
        ("c", _) => json!({"name": "c", "type": "channel"}),
        (_, Some(unit)) => json!({"name": name, "type": "space", "unit": unit}),
        _ => json!({"name": name, "type": "space"}),
    };
    Value::Array(names.iter().map(axis).collect())
}

/// The attributes of a label image of version 0.4.
fn label_image() -> Value {
    json!({
        "image-label": {"version": "0.4", "colors": [{"label-value": 2, "rgba": [200, 100, 50, 255]}],
                        "properties": [{"label-value": 2, "name": "left"}, {"label-value": 5, "name": "right"}]},
        "multiscales": [{"version": "0.4", "axes": space(&["t", "c", "z", "y", "x"], Some("micrometer")),
            "datasets": [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 4, 0.5, 0.25]}]}],
            "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 0.5, 1, 2]},
                                          {"type": "translation", "translation": [0, 0, 10, 20, 30]}]}],
    })
}

/// An image with one label image, version 0.4.
fn image_2(folder: &Path) -> PathBuf {
    let group = json!({"zarr_format": 2});
    for path in ["", "labels", "labels/cells"] {
        put(&folder.join(path).join(".zgroup"), &group);
    }
    put(&folder.join("labels/.zattrs"), &json!({"labels": ["cells"]}));
    put(&folder.join("labels/cells/.zattrs"), &label_image());
    array_2(&folder.join("labels/cells/0"));
    folder.join("labels/cells")
}

/// An image of version 0.5.
fn image_3(folder: &Path, change: impl FnOnce(&mut Value)) {
    let mut image = json!({"axes": space(&["z", "y", "x"], Some("millimeter")),
        "datasets": [{"path": "s0", "coordinateTransformations": [{"type": "scale", "scale": [2, 0.5, 0.5]}]}]});
    change(&mut image);
    let ome = json!({"version": "0.5", "multiscales": [image]});
    put(&folder.join("zarr.json"), &json!({"zarr_format": 3, "node_type": "group", "attributes": {"ome": ome}}));
    array_3(&folder.join("s0"));
}

#[test]
fn label_images_are_read_with_axes_scale_names_and_colours() {
    let place = folder();
    // No extension: known by content.
    let image = place.path().join("image");
    let labels = image_2(&image);
    for path in [&image, &image.join("labels"), &labels] {
        let input = Input::read(path, &ReadOptions::default()).expect("the image is sound");
        let surveyed = input.surveyed.expect("it is a volume");
        let (grid, volume) = (&surveyed.volume.grid, &surveyed.volume);
        assert_eq!((volume.format, grid.dims, grid.unit.as_str()), ("OME-Zarr", [12, 10, 7], "um"));
        assert_eq!((grid.spacing(), grid.origin), ([0.5, 0.5, 2.0], DVec3::new(30.0, 20.0, 10.0)));
        let drawn: Vec<(String, f64)> = input.stack.slices.iter().map(|s| (s.name.clone(), s.z)).collect();
        assert_eq!(drawn.iter().map(|(_, z)| *z).collect::<Vec<_>>(), [0.0, 6.0, 12.0], "{drawn:?}");
        let given = voxels();
        for (slice, k) in input.stack.slices.iter().zip([0, 3, 6]) {
            assert!((0..120).all(|n| slice.content.inside(n) == (given[120 * k + n] > 0)), "slice {k}");
        }
        assert_eq!(volume.appearance(2).colour, Some([200, 100, 50]));
        assert_eq!(volume.appearance(5).name.as_deref(), Some("right"));
    }
    let right = ReadOptions { label: Some(LabelName::Name("right".into())), ..ReadOptions::default() };
    let stack = Input::read(&image, &right).expect("a label by its name").stack;
    assert!((0..120).all(|n| stack.slices[1].content.inside(n) == (voxels()[360 + n] == 5)));
}

/// As numcodecs packs them.
#[test]
fn chunks_that_gzip_or_zlib_packed_are_read() {
    let place = folder();
    let input = place.path().join("a.zarr");
    let given = voxels();
    let pack = |id: &str, bytes: &[u8]| -> Vec<u8> {
        let (mut packed, level) = (Vec::new(), Compression::fast());
        let read = match id {
            "zlib" => ZlibEncoder::new(bytes, level).read_to_end(&mut packed),
            _ => GzEncoder::new(bytes, level).read_to_end(&mut packed),
        };
        read.expect("memory can be read");
        packed
    };
    for id in ["gzip", "zlib"] {
        array_2(&input);
        let text = fs::read_to_string(input.join(".zarray")).expect("it was written");
        let mut array: Value = serde_json::from_str(&text).expect("it is JSON");
        array["compressor"] = json!({"id": id, "level": 1});
        put(&input.join(".zarray"), &array);
        for name in (0..3).flat_map(|k| [0, 1].map(|i| format!("0/0/{k}/0/{i}"))) {
            let bytes = fs::read(input.join(&name)).expect("a chunk");
            write(&input.join(&name), &pack(id, &bytes));
        }
        let options = ReadOptions { spacing: Some(vec![1.0; 3]), ..ReadOptions::default() };
        let stack = Input::read(&input, &options).unwrap_or_else(|e| panic!("{id}: {e}")).stack;
        for (slice, k) in stack.slices.iter().zip([0, 3, 6]) {
            assert!((0..120).all(|n| slice.content.inside(n) == (given[120 * k + n] > 0)), "{id}: slice {k}");
        }
    }
}

#[test]
fn a_report_has_the_digest_of_a_folder() {
    let place = folder();
    let input = place.path().join("a.zarr");
    image_3(&input, |_| {});
    let report = |name: &str| {
        let path = place.path().join(name);
        let (input, path) = (input.display().to_string(), path.display().to_string());
        let result = interslice(&["reconstruct", &input, "--label", "2", "--report", &path, "--backend", "cpu", "-q"]);
        assert_eq!(result.status.code(), Some(0), "{}", String::from_utf8_lossy(&result.stderr));
        let report: Value = serde_json::from_slice(&fs::read(&path).expect("it was written")).expect("it is JSON");
        report["provenance"]["inputs"][0].clone()
    };
    let first = report("a.json");
    assert!(first["bytes"].as_u64() > Some(500) && first["sha256"].as_str().map(str::len) == Some(64), "{first}");
    assert_eq!(first, report("b.json"));
    fs::write(input.join("note"), "more").expect("a file can be written");
    assert_ne!(first["sha256"], report("c.json")["sha256"]);
}

#[test]
fn versions_and_plain_arrays_are_the_same_volume() {
    let place = folder();
    let new = place.path().join("new.zarr");
    image_3(&new, |_| {});
    let counted = survey(&new).expect("the image is sound").labels;
    let wanted = [2, 5].map(|label| (i64::from(label), voxels().iter().filter(|v| **v == label).count() as u64));
    assert_eq!(counted.into_iter().collect::<Vec<_>>(), wanted);
    // A level named by itself has the image's scale; an array without an image has none.
    let sides = |path: &Path, options: &ReadOptions| {
        Input::read(path, options).expect("it is sound").surveyed.expect("a volume").volume.grid.spacing()
    };
    assert_eq!(sides(&new.join("s0"), &ReadOptions::default()), [0.5, 0.5, 2.0]);
    let bare = place.path().join("bare");
    array_3(&bare);
    let spaced = ReadOptions { spacing: Some(vec![0.5, 0.5, 2.0]), ..ReadOptions::default() };
    assert_eq!(sides(&bare, &spaced), [0.5, 0.5, 2.0]);
    let sides = |path: &Path, options: &ReadOptions| -> Vec<Vec<bool>> {
        let stack = Input::read(path, options).expect("it is sound").stack;
        stack.slices.iter().map(|s| s.content.sides()).collect()
    };
    assert_eq!(sides(&bare, &spaced), sides(&new, &ReadOptions::default()));
    // Axes in another order are x, y and z all the same.
    let turned = place.path().join("turned.zarr");
    image_3(&turned, |image| image["axes"] = space(&["x", "y", "z"], None));
    let grid =
        Input::read(&turned, &ReadOptions::default()).expect("it is sound").surveyed.expect("a volume").volume.grid;
    assert_eq!((grid.dims, grid.spacing()), ([7, 10, 12], [2.0, 0.5, 0.5]));
}

/// What this program writes it reads, where it lay.
#[test]
fn what_is_written_is_read_where_it_lay() {
    let place = folder();
    let [input, out, again] = ["in.nrrd", "out.zarr", "again.nrrd"].map(|name| place.path().join(name));
    let bytes: Vec<u8> = voxels().iter().flat_map(|v| v.to_le_bytes()).collect();
    let header = "space: left-posterior-superior\nspace directions: (0,0.5,0) (0.5,0,0) (0,0,-2)\nspace origin: (3,-4,5)\nencoding: raw\nendian: little";
    fs::write(&input, nrrd(header, "ushort", [12, 10, 7], &bytes)).expect("a file can be written");
    let run = |from: &Path, to: &Path, more: &[&str]| {
        let [from, to] = [from, to].map(|p| p.to_str().expect("temporary paths are UTF-8"));
        let run = interslice(&[&["reconstruct", from, "-o", to, "--mask", "--backend", "cpu", "-q"], more].concat());
        assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
    };
    run(&input, &out, &[]);
    run(&out, &again, &["--keep", "1"]);
    let grid = |path: &Path| {
        Input::read(path, &ReadOptions::default()).expect("it is sound").surveyed.expect("a volume").volume.grid
    };
    assert_eq!(grid(&out), grid(&again));
    assert_eq!(grid(&out).origin.x, 3.0);
}

/// Labels are a label image: names and colours come back.
#[test]
fn labels_that_are_written_have_their_names_and_colours() {
    let place = folder();
    let [input, out] = ["in.nrrd", "out.zarr"].map(|name| place.path().join(name));
    let bytes: Vec<u8> = voxels().iter().flat_map(|v| v.to_le_bytes()).collect();
    let header = "encoding: raw\nendian: little\nspace: LPS\nspace directions: (0.5,0,0) (0,0.5,0) (0,0,2)\n\
                  Segment0_LabelValue:=2\nSegment0_Name:=nucleus\nSegment0_Color:=0.2 0.4 1";
    fs::write(&input, nrrd(header, "ushort", [12, 10, 7], &bytes)).expect("a file can be written");
    let segments = |more: &[&str]| {
        let [from, to] = [&input, &out].map(|p| p.to_str().expect("temporary paths are UTF-8"));
        let run = interslice(&[&["reconstruct", from, "-o", to, "--backend", "cpu", "-q"], more].concat());
        assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
        open_volume(&out).expect("it is sound").segments
    };
    let of_two = segments(&["--labels", "2,5"]);
    assert_eq!(of_two.keys().copied().collect::<Vec<_>>(), [2, 5]);
    assert_eq!((of_two[&2].name.as_deref(), of_two[&2].colour), (Some("nucleus"), Some([51, 102, 255])));
    assert_eq!(of_two[&5].name, None);
    let of_one = segments(&["--label", "2", "--mask"]);
    assert_eq!(of_one.keys().copied().collect::<Vec<_>>(), [1], "a mask is 1 inside");
    assert_eq!(of_one[&1].name.as_deref(), Some("nucleus"));
    // Distances are no labels.
    assert!(segments(&["--label", "2", "--distance"]).is_empty());
}

/// What `inspect` says of a folder that must be refused.
#[track_caller]
fn refused(path: &Path, says: &[&str]) {
    let run = interslice(&["inspect", path.to_str().expect("temporary paths are UTF-8")]);
    let said = stderr(&run);
    assert_eq!(run.status.code(), Some(2), "{said}");
    says.iter().for_each(|w| assert!(said.contains(w), "`{w}` is not in: {said}"));
}

#[test]
fn what_is_wrong_is_named() {
    let place = folder();
    let path = place.path().join("a.zarr");
    let with = |change: &dyn Fn(&mut Value), says: &[&str]| {
        let _ = fs::remove_dir_all(&path);
        image_3(&path, change);
        refused(&path, &[&["a.zarr"], says].concat());
    };
    with(&|image| image["datasets"] = json!([]), &["the first of `datasets` has no `path`"]);
    with(
        &|image| image["datasets"][0]["path"] = "../b".into(),
        &["names the path `../b`, which does not lie in its group"],
    );
    with(&|image| image["datasets"][0]["path"] = "s9".into(), &["array", "s9: is not there"]);
    with(
        &|image| image["axes"] = space(&["t", "y", "x"], None),
        &["axis t has 7 places", "save the one that is meant"],
    );
    with(&|image| image["axes"] = space(&["y", "x"], None), &["`axes` has 2 of them, but the array 3"]);
    with(&|image| image["axes"][1]["unit"] = "meter".into(), &["different units: millimeter, meter, millimeter"]);
    let transformed =
        |to: Value| move |image: &mut Value| image["datasets"][0]["coordinateTransformations"] = json!([to]);
    with(&transformed(json!({"type": "affine"})), &["`affine` is neither scale nor translation"]);
    with(&transformed(json!({"type": "scale", "scale": [1, 2]})), &["scale must be 3 numbers"]);
    with(
        &transformed(json!({"type": "scale", "scale": [0, 1, 1]})),
        &["voxel spacing along axis 2 must be a positive number"],
    );
    let _ = fs::remove_dir_all(&path);
    image_3(&path, |_| {});
    let array = path.join("s0/zarr.json");
    let sound: Value = serde_json::from_slice(&fs::read(&array).expect("it is there")).expect("JSON");
    let mut twice = sound.clone();
    twice["shape"][0] = json!(2);
    image_3(&path, |image| image["axes"] = space(&["t", "y", "x"], None));
    put(&array, &twice);
    refused(&path, &["axis t has 2 places"]);
    image_3(&path, |_| {});
    for (key, value, says) in [
        ("shape", json!([7_000_000, 10_000, 12]), "bytes of voxels are more than chunks of"),
        ("data_type", json!("float16"), "voxels of type"),
        ("codecs", json!([{"name": "mine"}]), "mine"),
        (
            "chunk_grid",
            json!({"name": "regular", "configuration": {"chunk_shape": [1 << 20, 1 << 20, 8]}}),
            "its chunks are said to be larger",
        ),
    ] {
        let mut spoilt = sound.clone();
        spoilt[key] = value;
        put(&array, &spoilt);
        refused(&path, &["a.zarr", says]);
    }
    put(&array, &sound);
    let chunk = path.join("s0/c/1/0/0");
    let bytes = fs::read(&chunk).expect("it is there");
    fs::write(&chunk, &bytes[..bytes.len() / 2]).expect("a file can be written");
    refused(&path, &["a.zarr", "layers from 3 on"]);
    // Chunks that are not there are empty.
    fs::remove_dir_all(path.join("s0/c/1")).expect("they are there");
    assert!(survey(&path).expect("it is sound").painted[2] == [true, false, false, false, false, false, true]);
    fs::remove_dir_all(path.join("s0/c")).expect("they are there");
    refused(&path, &["has no chunks"]);
    fs::write(path.join("zarr.json"), "{").expect("a file can be written");
    refused(&path, &["a.zarr", "zarr.json: EOF"]);
    let two = place.path().join("two");
    image_2(&two);
    put(&two.join("labels/.zattrs"), &json!({"labels": ["cells", "nuclei"]}));
    refused(&two, &["has 2 label images; name one: ", "two/labels/cells, "]);
}
