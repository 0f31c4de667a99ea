//! Label volumes in and volumes out: which slices are taken, and geometry carried through.

use std::fs;
use std::io::Write;
use std::path::Path;

use crate::files::*;
use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use interslice::input::read;
use interslice::input::volume::grid::VolumeGrid;
use interslice::input::{read_surveyed, survey};
use interslice::stack::axis::Axis;
use interslice::stack::{ContourStack, ReadOptions, SliceContent};

const SIZES: [usize; 3] = [24, 20, 13];
/// Rotated about z by asin 0.6 and tilted in no way: an oblique but rectangular grid, in LPS.
const DIRECTIONS: &str = "(0.8,0.6,0) (-1.2,1.6,0) (0,0,2.5)";
const ORIGIN: &str = "(10,-20.5,300)";

/// A disc of label 3 on every third slice, one pixel of label 7 on slice 4.
fn labels() -> Vec<i16> {
    let [nx, ny, nz] = SIZES;
    (0..nx * ny * nz)
        .map(|n| {
            let (i, j, k) = (n % nx, n / nx % ny, n / (nx * ny));
            let r = 5.0 + k as f64 / 4.0;
            let in_disc = (i as f64 - 11.0).hypot(j as f64 - 9.0) < r;
            match k {
                4 if (i, j) == (2, 2) => 7,
                _ if k % 3 == 0 && in_disc => 3,
                _ => 0,
            }
        })
        .collect()
}

fn write_labels(path: &Path) {
    let data: Vec<u8> = labels().iter().flat_map(|v| v.to_be_bytes()).collect();
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(&data).expect("memory can be written");
    let header = format!(
        "space: left-posterior-superior\nspace directions: {DIRECTIONS}\nspace origin: {ORIGIN}\nendian: big\nencoding: gzip\nspace units: \"mm\" \"mm\" \"mm\""
    );
    let bytes = nrrd(&header, "int16", SIZES, &gzip.finish().expect("memory can be written"));
    fs::write(path, bytes).expect("a file can be written");
}

#[test]
fn bzip2_is_read_as_gzip_is() {
    let place = folder();
    let [gzip, bzip2] = ["gzip.nrrd", "bzip2.nrrd"].map(|name| place.path().join(name));
    write_labels(&gzip);
    let data: Vec<u8> = labels().iter().flat_map(|v| v.to_be_bytes()).collect();
    // Two streams, as parallel writers make them, behind two bytes to be skipped.
    let (low, high) = data.split_at(data.len() / 3);
    let packed = [&[&[0, 0], low].concat(), high].map(|part| {
        let mut packed = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
        packed.write_all(part).and_then(|()| packed.finish()).expect("memory can be written")
    });
    let header = format!(
        "space: left-posterior-superior\nspace directions: {DIRECTIONS}\nspace origin: {ORIGIN}\nendian: big\nencoding: bzip2\nbyte skip: 2"
    );
    let bytes = nrrd(&header, "int16", SIZES, &packed.concat());
    fs::write(&bzip2, &bytes).expect("a file can be written");
    let [gzip, read_bzip2] = [&gzip, &bzip2].map(|path| stack(path, ReadOptions::default()));
    assert_eq!(gzip.slices.len(), read_bzip2.slices.len());
    for (a, b) in gzip.slices.iter().zip(&read_bzip2.slices) {
        assert_eq!(a.z, b.z);
        assert!((0..a.content.len()).all(|n| a.content.inside(n) == b.content.inside(n)), "{}", a.name);
    }
    fs::write(&bzip2, &bytes[..bytes.len() - 20]).expect("a file can be written");
    let cut = read(&bzip2, &ReadOptions::default()).expect_err("it is cut short").to_string();
    assert!(cut.contains("bzip2.nrrd") && cut.contains("data"), "{cut}");
}

fn stack(path: &Path, options: ReadOptions) -> ContourStack {
    read(path, &options).expect("the volume is sound")
}

#[test]
fn slices_are_chosen_by_label_keep_or_number() {
    let place = folder();
    let path = place.path().join("labels.nrrd");
    write_labels(&path);
    let heights = |options| stack(&path, options).slices.iter().map(|s| s.z / 2.5).collect::<Vec<_>>();
    assert_eq!(heights(ReadOptions::default()), [0.0, 3.0, 4.0, 6.0, 9.0, 12.0]);
    assert_eq!(heights(ReadOptions { label: Some(3.into()), ..Default::default() }), [0.0, 3.0, 6.0, 9.0, 12.0]);
    assert_eq!(heights(ReadOptions { keep: Some(6), ..Default::default() }), [0.0, 6.0, 12.0]);
    assert_eq!(heights(ReadOptions { slices: Some(vec![9, 0, 5, 9]), ..Default::default() }), [0.0, 5.0, 9.0]);
    let all = stack(&path, ReadOptions::default());
    assert_eq!(all.slices[2].name, "k=4");
    let SliceContent::Mask(mask) = &all.slices[2].content else { panic!("labels are masks") };
    assert_eq!(mask.iter().position(|m| m), Some(2 * 24 + 2));
    assert_eq!(mask.iter().filter(|m| *m).count(), 1);
    assert_eq!(all.spacing.map(|s| (s * 1e9).round() / 1e9), [1.0, 2.0]);
    assert_eq!(all.z_out.map(|g| (g.start, g.step, g.count)), Some((0.0, 2.5, 13)));
    assert!(read(&path, &ReadOptions { label: Some(5.into()), ..Default::default() }).is_err());
    assert!(read(&path, &ReadOptions { slices: Some(vec![0, 13]), ..Default::default() }).is_err());
    assert!(read(&path, &ReadOptions { keep: Some(0), ..Default::default() }).is_err());
}

/// What the program writes as a mask is read back with the same geometry and the same contours.
fn round_trip(output: &str) {
    let place = folder();
    let (input, target) = (place.path().join("labels.nrrd"), place.path().join(output));
    write_labels(&input);
    let arguments = [
        "reconstruct",
        &input.display().to_string(),
        "--label",
        "3",
        "--mask",
        "-q",
        "-o",
        &target.display().to_string(),
    ];
    let result = interslice(&arguments);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    assert!(result.stderr.is_empty() && result.stdout.is_empty(), "-q says nothing");
    let given = stack(&input, ReadOptions { label: Some(3.into()), ..Default::default() });
    let back = stack(&target, ReadOptions { keep: Some(1), ..Default::default() });
    assert_eq!(back.dims, given.dims);
    assert_eq!(back.slices.len(), SIZES[2], "the volume's own grid");
    for axis in 0..3 {
        assert!((back.geometry.origin[axis] - given.geometry.origin[axis]).abs() < 1e-4);
        for k in 0..3 {
            assert!((back.geometry.axes[axis][k] - given.geometry.axes[axis][k]).abs() < 1e-6);
        }
    }
    for slice in &given.slices {
        let same = back.slices.iter().find(|s| (s.z - slice.z).abs() < 1e-4).expect("a slice at the contour's height");
        for n in 0..slice.content.len() {
            assert_eq!(same.content.inside(n), slice.content.inside(n), "{}: pixel {n}", slice.name);
        }
    }
    let between: usize = (0..SIZES[0] * SIZES[1]).filter(|&n| back.slices[1].content.inside(n)).count();
    assert!(between > 60, "the gap is filled: {between} px");
}

/// Type of the voxels of a volume, and its labels besides 0.
fn found(path: &Path) -> (String, Vec<i64>) {
    let volume = read_surveyed(path, &ReadOptions { keep: Some(1), ..Default::default() });
    let surveyed = volume.expect("the volume is sound").1.expect("it is a volume");
    assert_eq!(surveyed.volume.grid.dims, SIZES, "every voxel of the input's grid");
    (surveyed.volume.element.name(), surveyed.survey.labels.into_keys().collect())
}

#[test]
fn labels_come_back_in_their_type_and_with_their_numbers() {
    let place = folder();
    let input = place.path().join("labels.nrrd");
    write_labels(&input);
    for output in ["out.nrrd", "out.nii.gz", "out.mha"] {
        let target = place.path().join(output);
        let run = |options: &[&str]| {
            let (from, to) = (input.display().to_string(), target.display().to_string());
            let result = interslice(&[&["reconstruct", &from, "-q", "-o", &to], options].concat());
            assert_eq!(result.status.code(), Some(0), "{options:?}: {}", stderr(&result));
        };
        let cases: [(&[&str], &str, &[i64]); 4] = [
            (&["--label", "3"], "int16", &[3]),
            // Two labels become one body that has neither's number.
            (&["--slices", "0,3,4,6"], "int16", &[1]),
            (&["--label", "3", "--mask"], "uint8", &[1]),
            (&["--labels", "3"], "int16", &[3]),
        ];
        for (options, element, labels) in cases {
            run(options);
            assert_eq!(found(&target), (element.into(), labels.to_vec()), "{output}, {options:?}");
        }
        run(&["--label", "3", "--distance"]);
        let grey = ReadOptions { level: Some(0.0), ..Default::default() };
        let surveyed = read_surveyed(&target, &grey).expect("distances are grey values").1.expect("a volume");
        let [low, high] = surveyed.survey.greys.expect("values");
        assert!(surveyed.volume.element.name() == "float32" && low < -4.0 && high > 4.0, "{output}: {low}, {high}");
    }
    let both = interslice(&["reconstruct", &input.display().to_string(), "--mask", "--distance", "-o", "x.nrrd"]);
    assert!(both.status.code() == Some(2) && stderr(&both).contains("cannot be used with"), "{}", stderr(&both));
}

#[test]
fn every_type_comes_back_as_it_was() {
    let place = folder();
    let target = place.path().join("out.mha");
    macro_rules! round_trips {
        ($($name:literal, $kind:ty, $label:expr);*) => {$({
            let input = place.path().join(concat!($name, ".mha"));
            let header = format!(
                "ObjectType = Image\nNDims = 3\nElementSpacing = 1 1 3\nDimSize = 24 20 13\nElementType = {}\nElementDataFile = LOCAL\n", $name
            );
            let voxels = labels().into_iter().flat_map(|v| (if v == 3 { $label } else { 0 as $kind }).to_le_bytes());
            fs::write(&input, [header.into_bytes(), voxels.collect()].concat()).expect("a file can be written");
            let run = ["reconstruct", &input.display().to_string(), "-q", "-o", &target.display().to_string()];
            let result = interslice(&run);
            assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
            let header = String::from_utf8_lossy(&fs::read(&target).expect("written")[..600]).into_owned();
            assert!(header.contains(concat!("ElementType = ", $name, "\n")), "{header}");
            assert_eq!(found(&target).1, [$label as i64], $name);
        })*};
    }
    round_trips!(
        "MET_CHAR", i8, -3; "MET_UCHAR", u8, 255; "MET_SHORT", i16, -300; "MET_USHORT", u16, 60_000; "MET_INT", i32, -70_000;
        "MET_UINT", u32, 4_000_000_000; "MET_LONG_LONG", i64, -1_099_511_627_776; "MET_ULONG_LONG", u64, 1_099_511_627_776; "MET_FLOAT", f32, 7.0;
        "MET_DOUBLE", f64, 1e9
    );
}

#[test]
fn nrrd_round_trip() {
    round_trip("out.nrrd");
}

#[test]
fn nifti_round_trips() {
    round_trip("out.nii");
    round_trip("out.nii.gz");
}

#[test]
fn npz_round_trip() {
    round_trip("out.npz");
}

#[test]
fn distances_are_written_in_physical_units() {
    let place = folder();
    sound_stack(place.path());
    let text = fs::read_to_string(place.path().join("stack.json")).expect("it was written");
    write_stack(place.path(), &text.replace("[1.0, 1.0]", "[2.0, 2.0]"));
    let target = place.path().join("out.nii");
    let arguments = ["reconstruct", &place.path().display().to_string(), "-q", "-o", &target.display().to_string()];
    assert_eq!(interslice(&arguments).status.code(), Some(0));
    let bytes = fs::read(&target).expect("the volume was written");
    let voxel = |i: usize, j: usize, k: usize| {
        let at = 352 + 4 * (i + 32 * (j + 32 * k));
        f32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
    };
    assert_eq!(bytes.len(), 352 + 4 * 32 * 32 * 9);
    // The disc of radius 8 px about (15.5, 15.5), 2 mm per pixel: 5 px off the centre it is 3 px to the contour.
    assert!((voxel(15, 20, 0) + 2.0 * 3.5).abs() < 0.4, "{}", voxel(15, 20, 0));
    assert!((voxel(15, 27, 0) - 2.0 * 3.5).abs() < 0.4, "{}", voxel(15, 27, 0));
}

/// A bar of label 2 on every third slice across `axis`, unequal sizes and spacing, axes neither aligned nor right-handed.
fn across(axis: usize) -> (Vec<u8>, [usize; 3], Vec<u8>) {
    let mut sizes = [9, 8, 7];
    sizes[axis] = 10;
    let [nx, ny, nz] = sizes;
    let labels = (0..nx * ny * nz)
        .map(|n| {
            let ijk = [n % nx, n / nx % ny, n / (nx * ny)];
            let within = (0..3).all(|a| a == axis || (2..5 + a % 2).contains(&ijk[a]));
            if within && ijk[axis] % 3 == 0 { 2 } else { 0 }
        })
        .collect::<Vec<u8>>();
    // Right-handed as the file has it; across y and x as x, z and y, z the frame of the stack is another.
    let header = "encoding: raw\nspace: LPS\nspace directions: (0,0,-1.5) (0,2,0) (2.5,0,0)\nspace origin: (5,6,7)";
    (nrrd(header, "uchar", sizes, &labels), sizes, labels)
}

#[test]
fn slices_lie_along_the_axis_on_which_they_stand_alone() {
    let place = folder();
    for axis in 0..3 {
        let path = place.path().join(format!("{axis}.nrrd"));
        let (bytes, sizes, labels) = across(axis);
        fs::write(&path, bytes).expect("a file can be written");
        let (given, surveyed) = read_surveyed(&path, &ReadOptions::default()).expect("the volume is sound");
        let surveyed = surveyed.expect("it is a volume");
        assert_eq!(surveyed.axis.axis, axis, "{}", surveyed.axis.why);
        assert_eq!(
            surveyed.survey.labels.into_iter().collect::<Vec<_>>(),
            [(2, labels.iter().filter(|l| **l > 0).count() as u64)]
        );
        let [u, v] = [[1, 2], [0, 2], [0, 1]][axis];
        let h = [1.5, 2.0, 2.5];
        assert_eq!((given.dims, given.spacing), ([sizes[u], sizes[v]], [h[u], h[v]]));
        assert_eq!(given.geometry.order, [u, v, axis]);
        let world = [DVec3::NEG_Z, DVec3::Y, DVec3::X];
        assert_eq!(given.geometry.axes, [world[u], world[v], world[axis]]);
        assert_eq!(given.slices.iter().map(|s| (s.z / h[axis]).round() as usize).collect::<Vec<_>>(), [0, 3, 6, 9]);
        for (slice, k) in given.slices.iter().zip([0, 3, 6, 9]) {
            for n in 0..slice.content.len() {
                let mut ijk = [0; 3];
                (ijk[u], ijk[v], ijk[axis]) = (n % sizes[u], n / sizes[u], k);
                let label = labels[ijk[0] + sizes[0] * (ijk[1] + sizes[1] * ijk[2])];
                assert_eq!(slice.content.inside(n), label > 0, "axis {axis}, slice {k}, pixel {n}");
            }
        }
        let asked = stack(&path, ReadOptions { axis: [Axis::Y, Axis::Z, Axis::X][axis], ..Default::default() });
        assert_eq!(asked.geometry.order[2], (axis + 1) % 3);
    }
}

#[test]
fn volumes_come_back_in_the_order_of_their_input() {
    let place = folder();
    for (axis, output) in (0..3).flat_map(|axis| ["nrrd", "mha", "nii.gz"].map(|output| (axis, output))) {
        let (input, target) = (place.path().join("in.nrrd"), place.path().join(format!("out.{output}")));
        let (bytes, sizes, labels) = across(axis);
        fs::write(&input, bytes).expect("a file can be written");
        let (from, to) = (input.display().to_string(), target.display().to_string());
        let result = interslice(&["reconstruct", &from, "--mask", "-q", "-o", &to]);
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        let z = |path: &Path| read_surveyed(path, &ReadOptions { axis: Axis::Z, keep: Some(1), ..Default::default() });
        let (given, was) = z(&input).expect("the volume is sound");
        let (back, is) = z(&target).expect("the volume is sound");
        let (was, is) = (was.expect("a volume").volume.grid, is.expect("a volume").volume.grid);
        assert_eq!(is.dims, sizes, "axis {axis}, {output}");
        assert!(is.steps.iter().zip(was.steps).all(|(a, b)| a.abs_diff_eq(b, 1e-6)));
        assert!(is.origin.abs_diff_eq(was.origin, 1e-6));
        let mut filled = 0;
        for (k, slice) in back.slices.iter().enumerate() {
            for n in 0..slice.content.len() {
                let ijk = [n % sizes[0], n / sizes[0], k];
                let drawn = labels[n + k * sizes[0] * sizes[1]] > 0;
                match ijk[axis] % 3 {
                    0 => assert_eq!(slice.content.inside(n), drawn, "axis {axis}, {output}, voxel {ijk:?}"),
                    _ => filled += usize::from(slice.content.inside(n)),
                }
            }
        }
        assert_eq!(given.slices.len(), back.slices.len());
        assert!(filled > 30, "axis {axis}, {output}: {filled} voxels between the slices");
    }
}

#[test]
fn dz_and_isotropic_set_the_heights_of_a_volume() {
    let place = folder();
    let (input, target) = (place.path().join("in.nrrd"), place.path().join("out.mha"));
    fs::write(&input, across(0).0).expect("a file can be written");
    let sides = |options: &[&str]| {
        let (from, to) = (input.display().to_string(), target.display().to_string());
        let result = interslice(&[&["reconstruct", &from, "--mask", "-q", "-o", &to], options].concat());
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        read_surveyed(&target, &ReadOptions::default()).expect("it is sound").1.expect("a volume").volume.grid
    };
    let near =
        |grid: &VolumeGrid, spacing: [f64; 3]| grid.spacing().iter().zip(spacing).all(|(a, b)| (a - b).abs() < 1e-9);
    assert!(near(&sides(&[]), [1.5, 2.0, 2.5]));
    let fine = sides(&["--dz", "0.5"]);
    assert!(near(&fine, [0.5, 2.0, 2.5]) && fine.dims == [28, 8, 7], "{fine:?}");
    let even = sides(&["--isotropic"]);
    assert!(near(&even, [2.0, 2.0, 2.5]), "the smaller pixel side, {even:?}");
}

#[test]
fn every_type_and_byte_order_gives_the_same_labels() {
    let place = folder();
    let labels = [0i64, 1, 0, 100, 7, 0, 1, 100];
    let write = |name: &str, element: &str, extra: &str, data: Vec<u8>| {
        let header = format!(
            "ObjectType = Image\nNDims = 3\n{extra}DimSize = 2 2 2\nElementType = {element}\nElementDataFile = {name}.raw\n"
        );
        fs::write(place.path().join(format!("{name}.mhd")), header).expect("a file can be written");
        fs::write(place.path().join(format!("{name}.raw")), data).expect("a file can be written");
        place.path().join(format!("{name}.mhd"))
    };
    macro_rules! paths {
        ($($name:literal, $kind:ty);*) => {
            [$(
                write($name, $name, "", labels.iter().flat_map(|v| (*v as $kind).to_le_bytes()).collect()),
                write(
                    concat!($name, "_MSB"),
                    $name,
                    "BinaryDataByteOrderMSB = True\n",
                    labels.iter().flat_map(|v| (*v as $kind).to_be_bytes()).collect(),
                )
            ),*]
        };
    }
    let paths = paths!(
        "MET_CHAR", i8; "MET_UCHAR", u8; "MET_SHORT", i16; "MET_USHORT", u16; "MET_INT", i32; "MET_UINT", u32;
        "MET_LONG", i32; "MET_ULONG", u32; "MET_LONG_LONG", i64; "MET_ULONG_LONG", u64; "MET_FLOAT", f32; "MET_DOUBLE", f64
    );
    for path in paths {
        let survey = survey(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(survey.labels.into_iter().collect::<Vec<_>>(), [(1, 2), (7, 1), (100, 2)], "{}", path.display());
        assert_eq!(interslice::input::files(&path).expect("both"), [path.clone(), path.with_extension("raw")]);
    }
}

/// Slices a hundredth thicker or thinner than the pixels are as thick: then they lie along z.
#[test]
fn spacings_within_a_hundredth_are_equal() {
    let place = folder();
    let path = place.path().join("a.nrrd");
    for (spacings, axis) in
        [("1 1 1.009", 2), ("1.009 1 1", 2), ("1.009 1 1.005", 2), ("1.02 1 1", 0), ("1 1.02 1.009", 1)]
    {
        let header = format!("spacings: {spacings}\nencoding: raw");
        fs::write(&path, nrrd(&header, "uchar", [4, 4, 4], &[1; 64])).expect("a file can be written");
        let (_, surveyed) = read_surveyed(&path, &ReadOptions::default()).expect("the volume is sound");
        let choice = surveyed.expect("it is a volume").axis;
        assert_eq!(choice.axis, axis, "{spacings}: {}", choice.why);
    }
}

/// As of an array of numpy, of an NRRD nobody may know how large its voxels are: it has no spacing, or says that it is not known.
#[test]
fn voxels_of_no_size_are_told() {
    let place = folder();
    let (path, out) = (place.path().join("a.nrrd"), place.path().join("a.json").display().to_string());
    let voxels: Vec<u8> = labels().iter().map(|v| u8::from(*v == 3)).collect();
    let input = path.display().to_string();
    let says = "warning: nothing says how large voxels are: they count as cubes of 1 px";
    for (header, sized) in [
        ("", false),
        ("spacings: nan NaN NAN\n", false),
        ("space: LPS\nspace directions: (nan,nan,nan) (nan,nan,nan) (nan,nan,nan)\n", false),
        ("spacings: 1 1 2\n", true),
    ] {
        fs::write(&path, nrrd(&format!("{header}encoding: raw"), "uint8", SIZES, &voxels))
            .expect("a file can be written");
        for run in [&["inspect", &input][..], &["reconstruct", &input, "--backend", "cpu", "-o", &out]] {
            let done = interslice(run);
            let said = String::from_utf8_lossy(&done.stdout).into_owned() + &stderr(&done);
            assert_eq!((done.status.code(), said.contains(says)), (Some(0), !sized), "{header}: {said}");
        }
        let options = ReadOptions { spacing: Some(vec![1.0, 2.0, 3.0]), ..ReadOptions::default() };
        assert_eq!(read(&path, &options).map(|stack| stack.unit == "mm").ok(), (!sized).then_some(true), "{header}");
    }
    fs::write(&path, nrrd("spacings: 1 nan 2\nencoding: raw", "uint8", SIZES, &voxels)).expect("a file can be written");
    let said = stderr(&interslice(&["inspect", &input]));
    assert!(said.contains("spacings: voxel spacing along axis 1 must be a positive number; got NaN"), "{said}");
}
