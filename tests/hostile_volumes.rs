//! Wrong volumes: each format cut short, with flipped bits, with sizes its file cannot hold; a clear error with exit code 2, no panic.

#[path = "support/files.rs"]
mod files;
#[path = "support/mod.rs"]
mod support;

use std::fs;
use std::io::Cursor;
use std::path::Path;

use files::*;
use interslice::input::format::InputFormat;
use interslice::input::read;
use interslice::stack::ReadOptions;
use proptest::prelude::*;
use tiff::encoder::{TiffEncoder, colortype::Gray8};
use tiff::tags::Tag;

/// A sound volume of 12 x 10 x 5 voxels in every format, by the name of its file.
fn sound(name: &str) -> Vec<u8> {
    let disc = support::body([12, 10], &[0.0, 1.0, 2.0, 3.0, 4.0], |x, y, _| (x - 5.0).hypot(y - 4.0) - 3.2);
    match name {
        "a.npy" => npy("{'descr': '|u1', 'fortran_order': False, 'shape': (5, 10, 12), }", &voxels(&disc)),
        "a.tif" => {
            let mut out = Cursor::new(Vec::new());
            let mut encoder = TiffEncoder::new(&mut out).expect("memory can be written");
            for page in voxels(&disc).chunks(120) {
                let mut image = encoder.new_image::<Gray8>(12, 10).expect("a page");
                let tag = image.encoder().write_tag(Tag::ImageDescription, OME);
                tag.expect("a description");
                image.write_data(page).expect("memory can be written");
            }
            out.into_inner()
        }
        volume => {
            let place = folder();
            let path = place.path().join(volume);
            support::write(&path, &disc, true);
            fs::read(path).expect("it was written")
        }
    }
}

const OME: &str = r#"<?xml version="1.0"?><OME><Image><Pixels DimensionOrder="XYZCT" SizeX="12" SizeY="10" SizeZ="5" SizeC="1" SizeT="1" PhysicalSizeX="0.5" PhysicalSizeY="0.5" PhysicalSizeZ="2" Type="uint8"><TiffData IFD="0" PlaneCount="5"/></Pixels></Image></OME>"#;

fn voxels(body: &interslice::Reconstruction) -> Vec<u8> {
    body.layers.iter().flat_map(|l| l.phi.iter().map(|v| u8::from(*v < 0.0))).collect()
}

fn npy(header: &str, data: &[u8]) -> Vec<u8> {
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.as_bytes());
    out.extend(data);
    out
}

const NAMES: [&str; 6] = ["a.nrrd", "a.nii", "a.nii.gz", "a.mha", "a.npy", "a.tif"];

/// Runs `reconstruct` on the bytes as a file `name`; checks exit code, message and that no output is there.
fn refused(name: &str, bytes: &[u8], options: &[&str], says: &[&str]) {
    let place = folder();
    let path = place.path().join(name);
    fs::write(&path, bytes).expect("a file can be written");
    refused_in(place.path(), name, options, says);
}

fn refused_in(place: &Path, name: &str, options: &[&str], says: &[&str]) {
    let (input, target) = (place.join(name), place.join("out.stl"));
    let (input, output) = (input.display().to_string(), target.display().to_string());
    let mut arguments = vec!["reconstruct", &input, "-o", &output];
    arguments.extend(options);
    let result = interslice(&arguments);
    let message = stderr(&result);
    assert_eq!(result.status.code(), Some(2), "{name}: {message}");
    for part in says {
        assert!(message.contains(part), "{name}: `{part}` is missing from: {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
    assert!(!target.exists());
}

#[test]
fn sound_volumes_are_taken() {
    let place = folder();
    for name in NAMES {
        let path = place.path().join(name);
        fs::write(&path, sound(name)).expect("a file can be written");
        let stack = read(&path, &ReadOptions::default()).expect(name);
        assert_eq!(stack.dims, [12, 10], "{name}");
        assert_eq!(stack.slices.len(), 5, "{name}");
        let inside = |k: usize| (0..120).filter(|&n| stack.slices[k].content.inside(n)).count();
        assert_eq!((0..5).map(inside).collect::<Vec<_>>(), [inside(0); 5], "{name}");
        assert!(stack.slices[2].content.inside(4 * 12 + 5) && !stack.slices[2].content.inside(0), "{name}");
    }
}

/// Files whose names say nothing, or something else.
#[test]
fn formats_are_known_by_content() {
    let place = folder();
    for (name, other) in [
        ("a.nrrd", "a"),
        ("a.nii", "b"),
        ("a.nii.gz", "c.nii"),
        ("a.nii.gz", "c"),
        ("a.mha", "d.nrrd"),
        ("a.nii.gz", "e.dat"),
        ("a.npy", "f"),
        ("a.tif", "g.bin"),
    ] {
        let path = place.path().join(other);
        fs::write(&path, sound(name)).expect("a file can be written");
        let stack = read(&path, &ReadOptions::default()).expect(other);
        assert_eq!((stack.dims, stack.slices.len()), ([12, 10], 5), "{other}");
    }
    let plain = place.path().join("notes");
    fs::write(&plain, "some notes").expect("a file can be written");
    let result = interslice(&["inspect", &plain.display().to_string()]);
    assert_eq!(result.status.code(), Some(2));
    let says =
        "notes: not a known input: expected a folder with stack.json, of images, or of masks, a label volume (.nrrd";
    assert!(stderr(&result).contains(says), "{}", stderr(&result));
}

#[test]
fn cut_short() {
    for name in NAMES {
        let bytes = sound(name);
        refused(name, &[], &[], &[name]);
        refused(name, &bytes[..20], &[], &[name]);
        // Deep in the voxels, but for TIFF, whose directory lies at the end.
        refused(name, &bytes[..bytes.len() - 30], &[], &[name]);
    }
    refused("a.npy", &sound("a.npy")[..300], &[], &["a.npy", "data end after", "of 600 bytes"]);
    refused("a.nii", &sound("a.nii")[..652], &[], &["a.nii", "data end after 300 of 600 bytes"]);
    // All voxels are there, but not the checksum, or another.
    for name in ["a.nrrd", "a.nii.gz", "a.mha"] {
        let mut bytes = sound(name);
        let end = bytes.len();
        refused(name, &bytes[..end - 2], &[], &[name, "data, behind the last voxel"]);
        // Of gzip it stands before the length.
        bytes[end - if name == "a.mha" { 1 } else { 5 }] ^= 1;
        refused(name, &bytes, &[], &[name, "data", "corrupt"]);
    }
}

#[test]
fn sizes_that_the_file_cannot_hold() {
    let with = |name: &str, from: &str, to: &str, says: &[&str]| {
        let bytes = sound(name);
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("the field is there");
        let spoilt = [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat();
        refused(name, &spoilt, &[], says);
    };
    let cannot = "compressed bytes can hold";
    with("a.nrrd", "sizes: 12 10 5", "sizes: 9000 9000 9000", &["a.nrrd", "729000000000 bytes of voxels", cannot]);
    with("a.nrrd", "sizes: 12 10 5", "sizes: 18446744073709551615 2 2", &["sizes 18446744073709551615 2 2"]);
    with("a.mha", "DimSize = 12 10 5", "DimSize = 9000 9000 9000", &["a.mha", cannot]);
    with("a.mha", "DimSize = 12 10 5", "DimSize = -12 10 5", &["DimSize must be 3 numbers; got `-12 10 5`"]);
    let array = |shape: &str| npy(&format!("{{'descr': '|u1', 'fortran_order': True, 'shape': {shape}, }}"), &[1; 600]);
    refused("a.npy", &array("(9000, 9000, 9000)"), &[], &["a.npy", "data end after 600 of 729000000000 bytes"]);
    refused("a.npy", &array("(4294967296, 4294967296, 4294967296)"), &[], &["are no volume of 1 to"]);
    let mut nifti = sound("a.nii");
    (0..3).for_each(|k| nifti[42 + 2 * k..44 + 2 * k].copy_from_slice(&9000i16.to_le_bytes()));
    refused("a.nii", &nifti, &[], &["a.nii", "data end after 600 of 729000000000 bytes"]);
}

#[test]
fn fields_of_a_metaimage() {
    let with = |from: &str, to: &str, says: &[&str]| {
        let bytes = sound("a.mha");
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("the field is there");
        let spoilt = [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat();
        refused("a.mha", &spoilt, &[], says);
    };
    with("ObjectType = Image", "ObjectType = Tube", &["ObjectType must be Image; got Tube"]);
    with("NDims = 3", "NDims = 4", &["NDims is 4; a label volume has 3"]);
    with("MET_UCHAR", "MET_STRING", &["ElementType `MET_STRING` is not known"]);
    with(
        "ElementSpacing = 1 1 1",
        "ElementSpacing = 1 1 -1",
        &["spacing along axis 2 must be a positive number; got -1"],
    );
    with("ElementSpacing = 1 1 1", "ElementSpacing = 1 NaN 1", &["ElementSpacing holds `NaN`"]);
    with("ElementSpacing = 1 1 1", "ElementSpacing = 1 1", &["ElementSpacing must be 3 numbers; got 2"]);
    with(
        "TransformMatrix = 1 0 0",
        "TransformMatrix = 2 0 0",
        &["TransformMatrix", "axis 0 must have length 1; got 2"],
    );
    with("TransformMatrix = 1 0 0 0 1 0", "TransformMatrix = 1 0 0 1 0 0", &["axes 0 and 1 are not perpendicular"]);
    with("Offset = 0 0 0", "Offset = 0 inf 0", &["Offset holds `inf`"]);
    with("CompressedData = True", "CompressedData = Yes", &["CompressedData must be True or False; got Yes"]);
    with("CompressedData = True", "CompressedData = False", &["data end after", "of 600 bytes"]);
    with("ElementDataFile = LOCAL", "ElementDataFile = LIST", &["ElementDataFile = LIST", "many files"]);
    with("ElementDataFile = LOCAL", "ElementDataFile = none.raw", &["ElementDataFile", "none.raw"]);
    with("BinaryData = True", "BinaryData = False", &["BinaryData is False"]);
    with("ElementType", "ElementNumberOfChannels = 3\nElementType", &["ElementNumberOfChannels must be 1; got 3"]);
}

#[test]
fn fields_of_a_numpy_array() {
    let with = |header: &str, says: &[&str]| refused("a.npy", &npy(header, &[1; 600]), &[], says);
    with("{'descr': '<c8', 'fortran_order': False, 'shape': (5, 10, 12), }", &["descr '<c8'"]);
    with("{'descr': [('a', '<u1')], 'fortran_order': False, 'shape': (5, 10, 12), }", &["descr [('a', '<u1')]"]);
    with(
        "{'descr': '|u1', 'fortran_order': 3, 'shape': (5, 10, 12), }",
        &["fortran_order must be True or False; got 3"],
    );
    with("{'descr': '|u1', 'fortran_order': False, 'shape': (2, 5, 10, 12), }", &["shape (2, 5, 10, 12) has 4 axes"]);
    with("{'descr': '|u1', 'fortran_order': False}", &["header has no `shape`"]);
    with(&"(".repeat(60000), &["header has no `descr`"]);
    let sound = sound("a.npy");
    refused("a.npy", &sound, &["--spacing", "1,2"], &["`spacing` must be three numbers DX,DY,DZ; got 2"]);
    refused("a.npy", &sound, &["--spacing", "1,2,-3"], &["`spacing` must be three positive numbers; got -3"]);
    refused("a.npy", &sound, &["--spacing", "1,2,nan"], &["`spacing` must be three positive numbers; got NaN"]);
    refused("a.npy", &sound, &["--axis", "w"], &["w", "auto, x, y, z"]);
    refused("a.npy", &sound, &["--dz", "1", "--isotropic"], &["--isotropic", "--dz"]);
}

#[test]
fn spacing_is_refused_where_the_file_has_its_own() {
    for name in NAMES.into_iter().filter(|name| InputFormat::of_name(name).is_some_and(|(format, _)| format.sized)) {
        refused(name, &sound(name), &["--spacing", "1,2,3"], &["`spacing` is only for a file without its own", name]);
    }
    let input = folder();
    sound_stack(input.path());
    refused_in(
        input.path(),
        "stack.json",
        &["--spacing", "1,2,3"],
        &["`spacing` is not for anything but a label volume"],
    );
    refused_in(input.path(), "stack.json", &["--axis", "x"], &["`axis` is not for"]);
}

#[test]
fn descriptions_of_a_tiff() {
    let with = |from: &str, to: &str, says: &[&str]| {
        // Of the same length, so that the file stays sound.
        assert_eq!(from.len(), to.len());
        let mut bytes = sound("a.tif");
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("the field is there");
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        refused("a.tif", &bytes, &[], says);
    };
    with("SizeT=\"1\"", "SizeT=\"2\"", &["OME-XML: SizeT is 2; a label volume has no time axis"]);
    with("SizeC=\"1\"", "SizeC=\"3\"", &["OME-XML: SizeC is 3; a label volume has no channel axis"]);
    with("SizeZ=\"5\"", "SizeZ=\"6\"", &["SizeZ is 6, but the file's pages make 5"]);
    with("PhysicalSizeX=\"0.5\"", "PhysicalSizeX=\"NaN\"", &["PhysicalSizeX must be a positive number; got NaN"]);
    with("PhysicalSizeZ=\"2\"", "PhysicalSizeQ=\"2\"", &["must all be there, or none"]);
    with("IFD=\"0\"", "IFD=\"1\"", &["pages are not in the order of z"]);
    with("</Pixels>", "</Pixelz>", &["a.tif", "OME-XML"]);
}

#[test]
fn four_axes_and_other_things_of_nifti() {
    let with = |at: usize, bytes: &[u8], says: &[&str]| {
        let mut spoilt = sound("a.nii");
        spoilt[at..at + bytes.len()].copy_from_slice(bytes);
        refused("a.nii", &spoilt, &[], says);
    };
    with(
        40,
        &[4, 0, 12, 0, 10, 0, 5, 0, 2, 0],
        &["dim[4] is 2: 2 volumes one behind the other (4D); a label volume has three axes: save the one"],
    );
    with(70, &128i16.to_le_bytes(), &["datatype 128"]);
    with(108, &f32::NAN.to_le_bytes(), &["vox_offset", "NaN"]);
    with(112, &f32::INFINITY.to_le_bytes(), &["scl_slope", "inf"]);
    with(280, &f32::NAN.to_le_bytes(), &["the orientation holds NaN"]);
    let mut bytes = sound("a.nii");
    bytes[254] = 0; // no sform
    bytes[84..88].copy_from_slice(&(-1f32).to_le_bytes());
    refused("a.nii", &bytes, &[], &["pixdim[2], a voxel spacing, must be a positive number; got -1"]);
    with(344, b"ni1\0", &["magic is \"ni1\""]);
    with(0, &540i32.to_le_bytes(), &["NIfTI-2 header: magic is"]);
}

/// The parts of a seed of several files.
fn seed(name: &str) -> Vec<Vec<u8>> {
    let bytes = fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(name)).expect(name);
    let between = b"\n%%%%\n";
    match bytes.windows(between.len()).position(|w| w == between) {
        Some(at) => vec![bytes[..at].to_vec(), bytes[at + between.len()..].to_vec()],
        None => vec![bytes],
    }
}

/// Files by numpy, nibabel and tifffile: 12 x 10 x 3 voxels of 0.5 x 0.5 x 2 mm, where they say so.
#[test]
fn files_of_the_fields_own_writers_are_read() {
    let place = folder();
    let wanted = {
        let path = place.path().join("a.npz");
        fs::write(&path, &seed("npz/plain")[0]).expect("a file can be written");
        read(&path, &ReadOptions { spacing: Some(vec![0.5, 0.5, 2.0]), ..Default::default() }).expect("it is sound")
    };
    assert_eq!((wanted.dims, wanted.slices.len(), wanted.spacing), ([12, 10], 3, [0.5; 2]));
    assert!(wanted.slices[1].content.inside(4 * 12 + 5) && !wanted.slices[1].content.inside(0));
    for (name, seeds, sized) in [
        ("b.npz", "npz/packed", false),
        ("b", "npz/packed", false),
        ("c.nii", "nifti/two", true),
        ("c", "nifti/two", true),
        ("d.hdr", "analyze/analyze", true),
        ("d.img", "analyze/analyze", true),
        ("e.hdr", "analyze/nifti", true),
        ("e.img", "analyze/nifti", true),
        #[cfg(feature = "zstd")]
        ("f.tif", "tiff/zstd", false),
    ] {
        let path = place.path().join(name);
        let files = seed(seeds);
        let names = if files.len() == 2 {
            vec![path.with_extension("hdr"), path.with_extension("img")]
        } else {
            vec![path.clone()]
        };
        names.iter().zip(&files).for_each(|(path, bytes)| fs::write(path, bytes).expect("a file can be written"));
        let spacing = (!sized).then(|| vec![0.5, 0.5, 2.0]);
        let stack = read(&path, &ReadOptions { spacing, ..Default::default() }).expect(name);
        assert_eq!((stack.dims, stack.slices.len(), stack.spacing), ([12, 10], 3, [0.5; 2]), "{name}");
        let same = |k: usize| (0..120).all(|n| stack.slices[k].content.inside(n) == wanted.slices[k].content.inside(n));
        assert!((0..3).all(same), "{name}");
        assert_eq!(interslice::input::files(&path).expect(name), names, "{name}");
    }
}

#[test]
fn archives_of_arrays() {
    let place = folder();
    let path = place.path().join("a.npz");
    let archive = |arrays: &[(&str, Vec<u8>)]| {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in arrays {
            let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
            zip.start_file(*name, options).expect("memory can be written");
            std::io::Write::write_all(&mut zip, bytes).expect("memory can be written");
        }
        zip.finish().expect("memory can be written").into_inner()
    };
    let sound = sound("a.npy");
    let row = npy("{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }", &[0; 16]);
    fs::write(&path, archive(&[("labels.npy", sound.clone()), ("row.npy", row.clone()), ("note.txt", b"x".into())]))
        .expect("a file can be written");
    assert_eq!(read(&path, &ReadOptions::default()).expect("one volume").slices.len(), 5);
    let with = |arrays: &[(&str, Vec<u8>)], says: &[&str]| refused("a.npz", &archive(arrays), &[], says);
    with(
        &[("a.npy", sound.clone()), ("b.npy", sound.clone())],
        &["a.npz", "has several volumes: `a`, `b`; save the one"],
    );
    with(&[("row.npy", row)], &["a.npz: has no array of three axes (z, y, x), but `row` of 2"]);
    with(&[("note.txt", b"x".into())], &["a.npz: has no arrays"]);
    with(&[("a.npy", b"nonsense".into())], &["a.npz: array `a`: does not begin with"]);
    with(&[("a.npy", sound[..300].into())], &["a.npz: array `a`: data end after 300 of"]);
    let numbers = |shape: &str, values: &[f64]| {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        npy(&format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}"), &bytes)
    };
    let placed = |name: &str, sides: [f64; 3], x: [f64; 3]| {
        let directions = [x, [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].concat();
        [
            ("spacing.npy", numbers("(3,)", &sides)),
            ("origin.npy", numbers("(3,)", &[4.0, 5.0, 6.0])),
            ("directions.npy", numbers("(3, 3)", &directions)),
            (if name == "volume" { "volume.npy" } else { "a.npy" }, sound.clone()),
        ]
    };
    let east = [1.0, 0.0, 0.0];
    for (name, spaced) in [("volume", true), ("a", false)] {
        fs::write(&path, archive(&placed(name, [0.5, 0.75, 2.0], east))).expect("a file can be written");
        let grid = interslice::input::open_volume(&path).expect("one volume").grid;
        let wanted = if spaced { ([0.5, 0.75, 2.0], "mm", 4.0) } else { ([1.0; 3], "px", 0.0) };
        assert_eq!(
            (grid.spacing(), grid.unit.as_str(), grid.origin.x, grid.spaced),
            (wanted.0, wanted.1, wanted.2, spaced)
        );
        let notes = interslice::input::open_volume(&path).expect("one volume").notes;
        assert_eq!(notes.iter().any(|note| note.contains("`spacing`, `origin`, `directions` not used")), !spaced);
    }
    for bad in ["0", "-0.75", "NaN", "inf"] {
        let side: f64 = bad.parse().expect("a number");
        let says = match side.is_finite() {
            true => format!("a.npz: array `spacing` must hold three positive numbers; got {bad}"),
            false => "a.npz: array `spacing` must hold finite numbers; number 1 is none".into(),
        };
        with(&placed("volume", [0.5, side, 2.0], east), &[&says]);
    }
    with(
        &placed("volume", [1.0; 3], [0.8, 0.0, 0.0]),
        &["a.npz: array `directions`: axis 0 is 0.8 long; it must be 1"],
    );
    with(
        &placed("volume", [1.0; 3], [0.6, 0.8, 0.0]),
        &["a.npz: array `directions`: axes 0 and 1 are not perpendicular"],
    );
    // Each by itself, of any type.
    let typed = |kind: &str, shape: &str, bytes: &[u8]| {
        npy(&format!("{{'descr': '{kind}', 'fortran_order': True, 'shape': {shape}, }}"), bytes)
    };
    let alone = |name: &str, array: Vec<u8>| {
        let bytes = archive(&[(name, array), ("volume.npy", sound.clone())]);
        fs::write(&path, bytes).expect("a file can be written");
        interslice::input::open_volume(&path).expect("one volume").grid
    };
    let grid = alone("spacing.npy", typed("|u1", "(3,)", &[1, 2, 3]));
    assert_eq!((grid.spacing(), grid.unit.as_str(), grid.spaced), ([1.0, 2.0, 3.0], "mm", true));
    let floats: Vec<u8> = [4.5f32, 5.0, 6.0].iter().flat_map(|v| v.to_be_bytes()).collect();
    let grid = alone("origin.npy", typed(">f4", "(3,)", &floats));
    assert_eq!((grid.origin.x, grid.spacing(), grid.spaced), (4.5, [1.0; 3], false));
    let grid = alone("directions.npy", typed("|i1", "(3, 3)", &[0, 255, 0, 1, 0, 0, 0, 0, 1]));
    assert_eq!(grid.steps[0].to_array(), [0.0, 1.0, 0.0], "columns lie behind each other");
    for (name, array, says) in [
        ("spacing", typed("<i8", "(2,)", &[0; 16]), "`spacing` has the shape (2) of int64; expected the shape (3) of"),
        ("origin", typed("<f8", "()", &[0; 8]), "`origin` has the shape () of float64; expected the shape (3) of"),
        (
            "directions",
            typed("<f8", "(9,)", &[0; 72]),
            "`directions` has the shape (9) of float64; expected the shape (3, 3)",
        ),
    ] {
        with(&[(&format!("{name}.npy"), array), ("volume.npy", sound.clone())], &[says]);
    }
    let sized = archive(&placed("volume", [0.5, 0.75, 2.0], east));
    refused(
        "a.npz",
        &sized,
        &["--spacing", "1,2,3"],
        &["`spacing` is only for a file without its own", "0.5 x 0.75 x 2 mm"],
    );
    let huge = "{'descr': '|u1', 'fortran_order': False, 'shape': (9000, 9000, 9000), }";
    with(&[("a.npy", npy(huge, &[1; 600]))], &["a.npz: array `a`: data end after"]);
    let endless = "{'descr': '|u1', 'fortran_order': False, 'shape': (4294967296, 4294967296, 4294967296), }";
    with(&[("a.npy", npy(endless, &[1; 600]))], &["a.npz: array `a` is too large"]);
    refused("a.npz", b"PK\x03\x04 nothing more", &[], &["a.npz: is no ZIP of arrays"]);
    refused("a.npz", &seed("npz/packed")[0][..200], &[], &["a.npz: is no ZIP of arrays"]);
}

#[test]
fn headers_of_pairs_and_of_nifti_2() {
    let place = folder();
    let [header, voxels] = &seed("analyze/analyze")[..] else { panic!("two files") };
    let refused_pair = |header: &[u8], voxels: Option<&[u8]>, says: &[&str]| {
        let _ = fs::remove_file(place.path().join("a.img"));
        fs::write(place.path().join("a.hdr"), header).expect("a file can be written");
        if let Some(voxels) = voxels {
            fs::write(place.path().join("a.img"), voxels).expect("a file can be written");
        }
        refused_in(place.path(), "a.hdr", &[], says);
    };
    let missing = "voxels must lie beside the header, in ";
    refused_pair(header, None, &["a.hdr: Analyze: ", missing, "a.img", "a.img.gz, which are not there"]);
    refused_pair(&seed("analyze/nifti")[0], None, &["a.hdr: magic is \"ni1\": ", missing]);
    refused_pair(header, Some(&voxels[..100]), &["a.hdr: data end after 100 of 360 bytes"]);
    refused_pair(&header[..200], Some(voxels), &["a.hdr: NIfTI header"]);
    let spoilt = |at: usize, bytes: &[u8]| {
        let mut header = header.clone();
        header[at..at + bytes.len()].copy_from_slice(bytes);
        header
    };
    refused_pair(&spoilt(40, &[3, 0, 12, 0, 10, 0, 255, 127]), Some(voxels), &["data end after 360 of 3932040 bytes"]);
    refused_pair(
        &spoilt(80, &f32::NAN.to_le_bytes()),
        Some(voxels),
        &["pixdim[1], a voxel spacing, must be a positive"],
    );
    let result = {
        fs::write(place.path().join("a.hdr"), header).expect("a file can be written");
        fs::write(place.path().join("a.img"), voxels).expect("a file can be written");
        interslice(&["inspect", &place.path().join("a.hdr").display().to_string()])
    };
    let said = String::from_utf8_lossy(&result.stdout).into_owned();
    assert!(said.contains("Analyze does not say how a volume lies: x is taken to run to the left"), "{said}");
    let two = &seed("nifti/two")[0];
    refused("a.nii", &two[..500], &[], &["a.nii: NIfTI-2 header: ends after 500 of 540 bytes"]);
    let with = |at: usize, bytes: &[u8], says: &[&str]| {
        let mut spoilt = two.clone();
        spoilt[at..at + bytes.len()].copy_from_slice(bytes);
        refused("a.nii", &spoilt, &[], says);
    };
    with(16, &9i64.to_le_bytes(), &["dim[0] must be 2 to 7; got 9"]);
    with(24, &(-12i64).to_le_bytes(), &["dim[1] must be a number of voxels; got -12"]);
    with(24, &i64::MAX.to_le_bytes(), &["are no volume of 1 to"]);
    with(40, &9000i64.to_le_bytes(), &["data end after"]);
    with(168, &100i64.to_le_bytes(), &["vox_offset must be a whole number from 540 on; got 100"]);
    with(400, &f64::NAN.to_le_bytes(), &["the orientation holds NaN"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    /// Whatever comes back of a damaged file, it comes back, and what is wrong is the input's fault.
    #[test]
    fn damaged_volumes_never_panic(
        kind in 0usize..NAMES.len(),
        cut in prop::option::weighted(0.3, 0.0f64..1.0),
        flips in prop::collection::vec((0.0f64..1.0, any::<u8>(), any::<bool>()), 1..5),
    ) {
        let name = NAMES[kind];
        let mut bytes = sound(name);
        for (at, value, early) in flips {
            // Half of them in what is mostly header.
            let n = if early { bytes.len().min(400) } else { bytes.len() };
            bytes[(at * n as f64) as usize] ^= value;
        }
        bytes.truncate((cut.unwrap_or(1.0) * bytes.len() as f64) as usize);
        let place = folder();
        let path = place.path().join(name);
        fs::write(&path, bytes).expect("a file can be written");
        match read(&path, &ReadOptions::default()) {
            Ok(stack) => prop_assert!(stack.slices.iter().all(|s| s.content.len() == stack.dims[0] * stack.dims[1])),
            Err(e) => prop_assert_eq!(e.exit_code(), 2, "{}", e),
        }
    }
}
