//! Volumes in every format, read back by the program's own readers: voxels, spacing, place, names and colours.

use std::fs;
use std::path::{Path, PathBuf};

use crate::files::{folder, interslice, nrrd, sound_stack, stderr};
use interslice::input::read_surveyed;
use interslice::input::volume::Volume;
use interslice::stack::ReadOptions;
use interslice::stack::appearance::{Appearance, Segment};

const SIZES: [usize; 3] = [14, 11, 9];
const NAMED: &str = "Segment0_ID:=a\nSegment0_Tags:=Segmentation.Status:completed|\nSegment0_Name:=left lung\nSegment0_LabelValue:=5\nSegment0_Color:=0.2 0.4 1\nSegment0_Layer:=0\n\
                     Segment1_ID:=b\nSegment1_Name:=R\u{fc}ckgrat\nSegment1_LabelValue:=300\nSegment1_Color:=1 0 0\nSegment1_Layer:=0";

/// Two blocks, of label 5 and 300, on every fourth slice.
fn painted() -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let label = |n: usize| -> u16 {
        let [i, j, k] = [n % nx, n / nx % ny, n / (nx * ny)];
        match (k % 4, i) {
            (0, 2..=5) if (3..8).contains(&j) => 5,
            (0, 7..=11) if (2..7).contains(&j) => 300,
            _ => 0,
        }
    };
    (0..nx * ny * nz).flat_map(|n| label(n).to_le_bytes()).collect()
}

fn input(place: &Path, name: &str) -> PathBuf {
    let path = place.join(name);
    let header = format!(
        "space: LPS\nspace directions: (0.75,0,0) (0,1.25,0) (0,0,2.5)\nspace origin: (10,-20.5,300)\nendian: little\nencoding: raw\n{NAMED}"
    );
    fs::write(&path, nrrd(&header, "uint16", SIZES, &painted())).expect("a file can be written");
    path
}

fn done(arguments: &[&str]) {
    let result = interslice(arguments);
    assert_eq!(result.status.code(), Some(0), "{arguments:?}: {}", stderr(&result));
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a name in UTF-8")
}

/// A volume as the program reads it: itself, and its voxels.
fn read(path: &Path) -> (Volume, Vec<i64>) {
    let options = ReadOptions { keep: Some(1), ..ReadOptions::default() };
    let volume = read_surveyed(path, &options).unwrap_or_else(|e| panic!("{e}")).1.expect("a volume").volume;
    let mut voxels = vec![0; volume.voxels()];
    let dims = volume.grid.dims;
    volume
        .labels(|run| {
            let mut at = run.first;
            for value in run.values {
                voxels[at[0] + dims[0] * (at[1] + dims[1] * at[2])] = *value;
                at[run.along] += 1;
            }
        })
        .expect("it can be decoded");
    (volume, voxels)
}

#[test]
fn labels_come_back_the_same_in_every_format() {
    let place = folder();
    let given = input(place.path(), "in.seg.nrrd");
    let formats = ["nrrd", "seg.nrrd", "nii", "nii.gz", "mha", "tif", "ome.tif", "npy", "npz"];
    let outputs: Vec<PathBuf> = formats.iter().map(|e| place.path().join(format!("out.{e}"))).collect();
    let mut arguments = vec!["reconstruct", text(&given), "--labels", "all", "-q"];
    outputs.iter().for_each(|path| arguments.extend(["-o", text(path)]));
    done(&arguments);
    let (_, wanted) = read(&outputs[0]);
    let [nx, ny, _] = SIZES;
    assert_eq!(wanted[3 + nx * (4 + 2 * ny)], 5, "between the slices");
    for (format, path) in formats.into_iter().zip(&outputs) {
        let (volume, voxels) = read(path);
        assert!(voxels == wanted, "{format}");
        assert_eq!((volume.grid.dims, volume.element.name()), (SIZES, "uint16".into()), "{format}");
        let placed = !["tif", "ome.tif", "npy"].contains(&format);
        let spaced = format != "npy";
        for (side, wanted) in volume.grid.spacing().into_iter().zip([0.75, 1.25, 2.5]) {
            assert!(!spaced || (side - wanted).abs() < 1e-6, "{format}: {side}");
        }
        assert!(!spaced || volume.grid.unit == "mm", "{format}: {}", volume.grid.unit);
        let off = volume.grid.origin - glam::DVec3::new(10.0, -20.5, 300.0);
        assert!(!placed || off.length() < 1e-4, "{format}: {off}");
        let named = |n| volume.segments.get(&n).cloned();
        let known = |id: &str, tags: Option<&str>| Some(Segment { id: Some(id.into()), tags: tags.map(String::from) });
        let label = |number, name: &str, colour, segment| Appearance {
            name: Some(name.into()),
            number: Some(number),
            colour: Some(colour),
            segment,
        };
        let lung = label(5, "left lung", [51, 102, 255], known("a", Some("Segmentation.Status:completed|")));
        let spine = label(300, "R\u{fc}ckgrat", [255, 0, 0], known("b", None));
        let wanted = if format.ends_with("nrrd") { [Some(lung), Some(spine)] } else { [None, None] };
        assert_eq!([named(5), named(300)], wanted, "{format}");
    }
}

#[test]
fn a_nifti_file_stays_in_its_space() {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    let given = at("in.nii");
    done(&["reconstruct", text(&input(place.path(), "in.nrrd")), "--labels", "all", "-q", "-o", text(&given)]);
    let codes = |path: &Path| {
        let header = fs::read(path).expect("a file");
        [252, 254].map(|k| i16::from_le_bytes([header[k], header[k + 1]]))
    };
    assert_eq!(codes(&given), [0, 1]);
    let (label, all, merged) = (at("label.nii"), at("all.nii"), at("merged.nii"));
    let parts = [at("a.section"), at("b.section")];
    // Codes of the quaternion form and of the affine one, which counts first; MNI 152, an aligned file, Talairach, unknown.
    for (written, space) in [([1, 4], 4), ([3, 2], 2), ([3, 0], 3), ([0, 9], 1)] {
        let mut bytes = fs::read(&given).expect("a file");
        written
            .into_iter()
            .zip([252, 254])
            .for_each(|(code, k)| bytes[k..k + 2].copy_from_slice(&i16::to_le_bytes(code)));
        fs::write(&given, bytes).expect("a file can be written");
        let ours = ["reconstruct", text(&given), "--backend", "cpu", "-q"];
        done(&[&ours[..], &["--labels", "all", "-o", text(&all)]].concat());
        done(&[&ours[..], &["--label", "5", "-o", text(&label)]].concat());
        for (part, path) in ["1/2", "2/2"].iter().zip(&parts) {
            done(&["run", text(&given), "--backend", "cpu", "-q", "--label", "5", "--part", part, "-o", text(path)]);
        }
        done(&["merge", text(&parts[0]), text(&parts[1]), "-q", "-o", text(&merged)]);
        for path in [&all, &label, &merged] {
            assert_eq!(codes(path), [0, space], "{written:?}: {}", path.display());
        }
    }
}

#[test]
fn one_body_is_one_segment() {
    let place = folder();
    let given = input(place.path(), "in.seg.nrrd");
    let target = place.path().join("Liver.seg.nrrd");
    done(&["reconstruct", text(&given), "--label", "left lung", "-q", "-o", text(&target)]);
    let (volume, voxels) = read(&target);
    assert_eq!(volume.segments.len(), 1);
    assert_eq!(volume.segments[&5].name.as_deref(), Some("left lung"));
    assert!(voxels.iter().all(|v| [0, 5].contains(v)) && voxels.contains(&5));
    // What has no name is called as its file.
    let stack = place.path().join("stack");
    fs::create_dir(&stack).expect("a folder can be made");
    sound_stack(&stack);
    done(&["reconstruct", text(&stack), "-q", "-o", text(&target)]);
    let (volume, voxels) = read(&target);
    assert_eq!(volume.segments[&1].name.as_deref(), Some("Liver"));
    assert!(volume.segments[&1].colour.is_some() && voxels.contains(&1));
    let header = String::from_utf8_lossy(&fs::read(&target).expect("written")).into_owned();
    for line in [
        "Segmentation_ReferenceImageExtentOffset:=0 0 0",
        "Segment0_Extent:=0 31 0 31 0 8",
        "Segment0_NameAutoGenerated:=1",
    ] {
        assert!(header.lines().any(|said| said == line), "`{line}` is missing from:\n{header}");
    }
}

#[test]
fn origin_and_confidence_are_there_in_every_format() {
    let place = folder();
    let given = input(place.path(), "in.nrrd");
    for format in ["nii.gz", "tif", "ome.tif", "npy", "npz"] {
        let path = place.path().join(format!("a.origin.{format}"));
        done(&["reconstruct", text(&given), "-q", "-o", text(&path)]);
        let (volume, voxels) = read(&path);
        assert_eq!(volume.element.name(), "uint8", "{format}");
        assert!(voxels.contains(&1) && voxels.contains(&2) && voxels.iter().all(|v| (0..3).contains(v)), "{format}");
    }
}

#[test]
fn distances_are_no_segments() {
    let place = folder();
    let given = input(place.path(), "in.nrrd");
    let target = place.path().join("out.seg.nrrd");
    let wrong = interslice(&["reconstruct", text(&given), "--distance", "-o", text(&target)]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(stderr(&wrong).contains("out.seg.nrrd: cannot write: holds segments, no distances"), "{}", stderr(&wrong));
    assert!(!target.exists());
}

#[test]
fn a_file_without_space_lies_where_its_axes_begin() {
    let place = folder();
    let at = |centers: &str| {
        let path = place.path().join("in.nrrd");
        let header = format!("spacings: 0.7 0.9 2.5\naxis mins: 5 6 7\n{centers}endian: little\nencoding: raw");
        fs::write(&path, nrrd(&header, "uint16", SIZES, &painted())).expect("a file can be written");
        read(&path).0.grid.origin.to_array()
    };
    // As ITK has it: a cell begins half a voxel before its centre.
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(near(at(""), [5.35, 6.45, 8.25]), "{:?}", at(""));
    assert!(near(at("centers: node node cell\n"), [5.0, 6.0, 8.25]), "{:?}", at("centers: node node cell\n"));
}

#[test]
fn axes_in_two_units_are_refused() {
    let place = folder();
    let (path, out) = (place.path().join("in.nrrd"), place.path().join("out.nrrd"));
    let header = "space: left-posterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,2.5)\nspace units: \"um\" \"um\" \"mm\"\n\
                  endian: little\nencoding: raw";
    fs::write(&path, nrrd(header, "uint16", SIZES, &painted())).expect("a file can be written");
    let wrong = interslice(&["reconstruct", text(&path), "--label", "1", "-o", text(&out)]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(stderr(&wrong).contains("space units are um and mm"), "{}", stderr(&wrong));
    assert!(!out.exists());
}

/// Reads what was written of two slices of pixels of side `px` in `unit`: voxel sides, their unit, and what was told.
fn written(place: &Path, unit: &str, px: f64, name: &str) -> (Volume, String) {
    let square = [[0.0, 0.0], [20.0 * px, 0.0], [20.0 * px, 20.0 * px], [0.0, 20.0 * px]];
    let slice = |z: f64| serde_json::json!({"z": z, "polygons": [square]});
    let stack = serde_json::json!({"unit": unit, "spacing_xy": [px, px], "slices": [slice(0.0), slice(3.0 * px)]});
    fs::write(place.join("stack.json"), stack.to_string()).expect("a file can be written");
    let out = place.join(name);
    let result = interslice(&["reconstruct", text(place), "-o", text(&out), "--mask", "--backend", "cpu"]);
    assert_eq!(result.status.code(), Some(0), "{unit}: {}", stderr(&result));
    (interslice::input::open_volume(&out).expect("it is read again"), stderr(&result))
}

#[test]
fn units_that_ome_has_come_back_and_others_are_told() {
    let place = folder();
    for (unit, back) in [("km", "km"), ("in", "inch"), ("inch", "inch"), ("ft", "ft"), ("um", "um"), ("nm", "nm")] {
        let (volume, told) = written(place.path(), unit, 0.5, "a.ome.tif");
        assert_eq!((volume.grid.spacing(), volume.grid.unit.as_str()), ([0.5; 3], back), "{unit}");
        assert!(!told.contains("does not know the unit"), "{told}");
    }
    let (volume, told) = written(place.path(), "us-ft", 0.5, "a.ome.tif");
    assert!(!volume.grid.spaced && told.contains("OME-TIFF does not know the unit us-ft"), "{told}");
}

#[test]
fn sides_that_a_tiff_cannot_hold_are_left_out_and_told() {
    let place = folder();
    for (px, held) in [(3e-10, true), (1e-10, false), (4e9, true), (5e9, false)] {
        let (volume, told) = written(place.path(), "mm", px, "a.tif");
        let side = volume.grid.spacing()[0];
        assert_eq!(volume.grid.spaced, held, "{px}: {side}");
        assert!(!held || (side / px - 1.0).abs() < 1e-6, "{px}: {side}");
        assert_eq!(told.contains("fraction of 32-bit numbers"), !held, "{px}: {told}");
    }
    written(place.path(), "mm", 1e-10, "a.npz");
    let result = interslice(&["inspect", text(&place.path().join("a.npz"))]);
    let said = String::from_utf8_lossy(&result.stdout);
    assert!(said.contains("voxels of 1e-10 x 1e-10 x 1e-10 mm"), "{said}");
}
