//! Arrays of numpy, and archives of them.

use std::fs;
use std::io::Cursor;

use interslice::input::read;
use interslice::stack::ReadOptions;

use super::sources::*;
use crate::files::folder;

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
    with("{'descr': '|u1', 'fortran_order': False, 'shape': (1, 1, 5, 120), }", &["shape (1, 1, 5, 120) has 4 axes"]);
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
fn axes_of_length_1_are_passed_over() {
    let place = folder();
    let path = place.path().join("a.npy");
    let voxels: Vec<u8> = (0..600).map(|n| u8::from(n % 12 > 3 && n / 12 % 10 > n / 120 + 2)).collect();
    let volume = |shape: &str, fortran: &str| {
        let header = format!("{{'descr': '|u1', 'fortran_order': {fortran}, 'shape': {shape}, }}");
        fs::write(&path, npy(&header, &voxels)).expect("a file can be written");
        read(&path, &ReadOptions::default())
            .map(|stack| stack.slices.iter().map(|slice| slice.content.mask().clone()).collect::<Vec<_>>())
    };
    for fortran in ["False", "True"] {
        let wanted = volume("(5, 10, 12)", fortran).expect("three axes");
        for shape in ["(1, 5, 10, 12)", "(5, 10, 12, 1)", "(1, 1, 5, 10, 1, 12)"] {
            assert_eq!(volume(shape, fortran).expect(shape), wanted, "{shape}");
        }
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
    // An array of three axes is meant before one that has more.
    let four = npy("{'descr': '|u1', 'fortran_order': False, 'shape': (1, 3, 10, 20), }", &[1; 600]);
    fs::write(&path, archive(&[("image.npy", four), ("labels.npy", sound.clone())])).expect("a file can be written");
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
