//! Labels by name: 3D Slicer's segments in layers, that may overlap; folders of masks, one file per organ; and folders of images that say nothing
//! of themselves.

use std::fs;
use std::io::Write;
use std::path::Path;

use crate::files::*;
use flate2::Compression;
use flate2::write::GzEncoder;
use interslice::input::labels::{Wanted, read_labels, read_whole_labels};
use interslice::input::{Input, files as files_of, open_volume, read, survey};
use interslice::stack::{ContourStack, ReadOptions};

const SIZES: [usize; 3] = [30, 20, 9];

/// Whether a voxel is in the disc about `x` of this radius, which is drawn on every second slice.
fn disc(x: f64, radius: f64) -> Vec<bool> {
    let [nx, ny, nz] = SIZES;
    let at = |n: usize| (n % nx, n / nx % ny, n / (nx * ny));
    (0..nx * ny * nz).map(at).map(|(i, j, k)| k % 2 == 0 && (i as f64 - x).hypot(j as f64 - 9.0) < radius).collect()
}

/// Liver and spleen overlap, in layers of their own; the cyst is in the liver's layer.
fn organs() -> [Vec<bool>; 3] {
    [disc(9.0, 6.0), disc(26.0, 3.0), disc(15.0, 6.0)]
}

pub const HEADER: &str = "NRRD0004\ntype: uchar\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 30 20 9\n\
                      space directions: none (1,0,0) (0,1,0) (0,0,3)\nkinds: list domain domain domain\nencoding: raw\n\
                      space origin: (0,0,0)\nSegment0_Name:=Liver\nSegment0_Layer:=0\nSegment0_LabelValue:=1\n\
                      Segment0_Color:=0.8 0.4 0.2\nSegment1_Name:=Cyst\nSegment1_Layer:=0\nSegment1_LabelValue:=2\n\
                      Segment10_Name:=Spleen\nSegment10_Layer:=1\nSegment10_LabelValue:=1\n\n";

/// As 3D Slicer saves segments that overlap.
pub fn layered(header: &str) -> Vec<u8> {
    let [liver, cyst, spleen] = organs();
    let voxel = |n: usize| [u8::from(liver[n]) + 2 * u8::from(cyst[n]), u8::from(spleen[n])];
    [header.as_bytes(), &(0..liver.len()).flat_map(voxel).collect::<Vec<u8>>()].concat()
}

/// Header of a mask.
const PLACED: &str = "space directions: (1,0,0) (0,1,0) (0,0,3)\nspace: LPS\nencoding: raw";

/// A mask as a NRRD of its own.
fn mask(inside: &[bool]) -> Vec<u8> {
    let voxels: Vec<u8> = inside.iter().map(|m| 7 * u8::from(*m)).collect();
    nrrd(PLACED, "uchar", SIZES, &voxels)
}

pub fn write(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).expect("a file can be written");
}

/// Voxels inside of the whole stack.
fn count(stack: &ContourStack) -> usize {
    stack.slices.iter().map(|s| (0..s.content.len()).filter(|n| s.content.inside(*n)).count()).sum()
}

fn label(name: &str) -> ReadOptions {
    ReadOptions { label: Some(name.parse().expect("any text")), ..ReadOptions::default() }
}

/// The command fails with 2 and says this.
pub fn refused(arguments: &[&str], says: &[&str]) {
    let result = interslice(arguments);
    let message = stderr(&result);
    assert_eq!(result.status.code(), Some(2), "{arguments:?}: {message}");
    says.iter().for_each(|s| assert!(message.contains(s), "{arguments:?}: `{s}` is missing from: {message}"));
    assert!(!message.contains("panicked"), "{message}");
}

/// A volume of segments in layers, and a folder with the same as masks, which are sorted by name.
fn both(place: &Path) -> [std::path::PathBuf; 2] {
    let (file, folder) = (place.join("a.seg.nrrd"), place.join("organs"));
    write(&file, &layered(HEADER));
    fs::create_dir_all(&folder).expect("a folder can be made");
    for (name, mask_of) in ["Liver", "Cyst", "Spleen"].iter().zip(organs()) {
        write(&folder.join(format!("{name}.nrrd")), &mask(&mask_of));
    }
    write(&folder.join("readme.txt"), b"not a mask");
    [file, folder]
}

#[test]
fn segments_that_overlap_are_taken_whole_by_name() {
    let place = folder();
    let [liver, cyst, spleen] = organs().map(|organ| organ.iter().filter(|m| **m).count());
    let [file, folder] = both(place.path());
    for (path, numbers) in [(&file, [1, 2, 3]), (&folder, [2, 1, 3])] {
        for ((name, number), voxels) in ["Liver", "cyst", "SPLEEN"].iter().zip(numbers).zip([liver, cyst, spleen]) {
            assert_eq!(count(&read(path, &label(name)).expect(name)), voxels, "{name}");
            assert_eq!(count(&read(path, &label(&number.to_string())).expect(name)), voxels, "{number}");
        }
        let [a, b, c] = organs();
        let union = (0..a.len()).filter(|n| a[*n] || b[*n] || c[*n]).count();
        assert_eq!(count(&read(path, &ReadOptions::default()).expect("all of them")), union);
        let input = path.display().to_string();
        refused(
            &["inspect", &input, "--label", "Kidney"],
            &["`label` must name one of the file's labels; got `Kidney`; there are 1 `", "`Liver`", "3 `Spleen`"],
        );
        refused(
            &["inspect", &input, "--label", "4"],
            &["`label` must name one of the file's labels; got 4; there are"],
        );
        refused(
            &["inspect", &input, "--level", "0.5"],
            &["`level` is not for segments, which ", " holds; it cuts grey values"],
        );
    }
    let masks = ["Cyst", "Liver", "Spleen"].map(|name| folder.join(format!("{name}.nrrd")));
    assert_eq!(files_of(&folder).expect("the masks"), masks);
    let said = String::from_utf8_lossy(&interslice(&["inspect", &folder.display().to_string()]).stdout).into_owned();
    assert!(said.contains("folder of masks") && said.contains("2 `Liver`"), "{said}");
}

#[test]
fn each_layer_of_segments_is_had_by_itself() {
    let place = folder();
    let [file, _] = both(place.path());
    let volume = open_volume(&file).expect("the volume is sound");
    let of = |layer: usize| {
        let mut voxels = Vec::new();
        volume.labels_of_layer(layer, |run| voxels.extend_from_slice(run.values)).expect("it can be read");
        voxels
    };
    assert_eq!(volume.layers(), 2);
    let [liver, cyst, spleen] = organs().map(|organ| organ.into_iter().map(i64::from).collect::<Vec<_>>());
    assert_eq!(of(0), liver.iter().zip(&cyst).map(|(liver, cyst)| liver + 2 * cyst).collect::<Vec<_>>());
    assert_eq!(of(1), spleen.iter().map(|spleen| 3 * spleen).collect::<Vec<_>>());
}

#[test]
fn many_segments_in_one_run_have_names_and_colours() {
    let place = folder();
    let [liver, _, spleen] = organs();
    let shared = (0..liver.len()).filter(|n| liver[*n] && spleen[*n]).count();
    for path in both(place.path()) {
        let names = "Liver,Spleen".parse::<Wanted>().expect("names");
        let stack = read_labels(&path, &ReadOptions::default(), &names).expect("two segments");
        let named: Vec<_> = stack.appearances.iter().map(|a| a.name.clone().unwrap_or_default()).collect();
        assert_eq!(named, ["Liver", "Spleen"]);
        let says = format!("{shared} voxels are in several segments; the last of these has them here");
        assert!(stack.notes.iter().any(|note| note.starts_with(&says)), "{:?}", stack.notes);
        let input = path.display().to_string();
        refused(
            &["reconstruct", &input, "--labels", "Liver,Kidney", "-o", "a.stl"],
            &["`labels` must name one of the file's labels; got `Kidney`"],
        );
        refused(
            &["reconstruct", &input, "--labels", "Liver,,1", "-o", "a.stl"],
            &["expected `all`, or numbers or names"],
        );
        let out = place.path().join("out.glb").display().to_string();
        let result = interslice(&["reconstruct", &input, "--labels", "all", "-o", &out]);
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        assert!(stderr(&result).contains("voxels are in several segments"), "{}", stderr(&result));
    }
    let stack = read_labels(&place.path().join("a.seg.nrrd"), &ReadOptions::default(), &Wanted::All).expect("all");
    assert_eq!(stack.appearances[0].colour, Some([204, 102, 51]));
    assert_eq!(survey(&place.path().join("a.seg.nrrd")).expect("all").labels.len(), 3);
}

/// A segment wholly in one that comes after it is told of wherever many are asked for, and one that is not asked for covers nothing.
#[test]
fn a_segment_under_another_is_told_of() {
    let place = folder();
    let (inner, outer) = (disc(15.0, 3.0), disc(15.0, 6.0));
    let voxels: Vec<u8> = (0..inner.len()).flat_map(|n| [u8::from(inner[n]), u8::from(outer[n])]).collect();
    let header = HEADER.replace("Segment1_Name:=Cyst\nSegment1_Layer:=0\nSegment1_LabelValue:=2\n", "");
    let file = place.path().join("a.seg.nrrd");
    write(&file, &[header.as_bytes(), &voxels].concat());
    let count_of = |mask: &[bool]| mask.iter().filter(|m| **m).count();
    let says = format!(
        "label 1 `Liver`: left out, all of its {} voxels are in segments that come after it, which have them here; `--label 1` takes it whole",
        count_of(&inner)
    );
    let input = file.display().to_string();
    let out = place.path().join("out.glb").display().to_string();
    for arguments in [vec!["inspect", &input], vec!["reconstruct", &input, "--labels", "all", "-o", &out]] {
        let result = interslice(&arguments);
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        let said = stderr(&result) + &String::from_utf8_lossy(&result.stdout);
        assert!(said.contains(&says), "{arguments:?}: {said}");
    }
    refused(
        &["reconstruct", &input, "--labels", "Liver,Spleen", "-o", &out],
        &["`labels` cannot have label 1 `Liver`: all of its ", "`--label 1` takes it whole"],
    );
    let alone =
        read_labels(&file, &ReadOptions::default(), &"Liver".parse().expect("a name")).expect("it is not covered");
    let drawn = alone.drawn.iter().flatten().filter(|l| **l > 0).count();
    assert_eq!(drawn, count_of(&inner));
    assert!(!alone.notes.iter().any(|note| note.contains("several segments")), "{:?}", alone.notes);
    // Where overlaps are kept each is whole, and nobody is told otherwise.
    let whole = read_whole_labels(&file, &ReadOptions::default(), &Wanted::All).expect("both");
    assert_eq!((whole.labels.len(), whole.left_out.len()), (2, 0));
    assert!(!whole.notes.iter().any(|note| note.contains("several segments")), "{:?}", whole.notes);
    for (a, mask) in [(0, &inner), (1, &outer)] {
        let stack = whole.alone(a);
        let mut drawn = 0;
        for slice in &stack.slices {
            let mut inside = vec![false; stack.dims[0] * stack.dims[1]];
            slice.content.read(0, &mut inside);
            drawn += count_of(&inside);
        }
        assert_eq!(drawn, count_of(mask), "label {a}");
    }
    let both = place.path().join("both.stl").display().to_string();
    let result = interslice(&["reconstruct", &input, "--labels", "all", "--keep-overlaps", "-o", &both]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    let alone = place.path().join("alone.stl").display().to_string();
    assert_eq!(interslice(&["reconstruct", &input, "--label", "Liver", "-o", &alone]).status.code(), Some(0));
    let read = |name: &str| std::fs::read(place.path().join(name)).expect("it was written");
    assert!(read("both.1.stl") == read("alone.stl"), "the same body as by itself");
}

#[test]
fn names_of_a_volume_of_labels() {
    let place = folder();
    let path = place.path().join("a.nrrd");
    let [liver, cyst, _] = organs();
    let voxels: Vec<u8> = liver.iter().zip(&cyst).map(|(l, c)| 5 * u8::from(*l) + 8 * u8::from(*c)).collect();
    let named =
        "encoding: raw\nSegment0_LabelValue:=5\nSegment0_Name:=Liver\nSegment1_LabelValue:=8\nSegment1_Name:=Liver";
    write(&path, &nrrd(named, "uchar", SIZES, &voxels));
    let input = path.display().to_string();
    refused(
        &["inspect", &input, "--label", "Liver"],
        &["`label` `Liver` is the name of several labels: name it by its"],
    );
    write(&path, &nrrd(&named.replace("Name:=Liver", "Name:=8").replacen('8', "Liver", 0), "uchar", SIZES, &voxels));
    assert_eq!(count(&read(&path, &label("8")).expect("a number")), cyst.iter().filter(|m| **m).count());
    write(&path, &nrrd("encoding: raw", "uchar", SIZES, &voxels));
    refused(&["inspect", &input, "--label", "Liver"], &["got `Liver`; the file has no names"]);
}

#[test]
fn wrong_layers() {
    let place = folder();
    let path = place.path().join("a.seg.nrrd");
    let with = |from: &str, to: &str, says: &[&str]| {
        assert!(HEADER.contains(from), "{from}");
        write(&path, &layered(&HEADER.replacen(from, to, 1)));
        refused(&["inspect", &path.display().to_string()], says);
    };
    with(
        "kinds: list",
        "kinds: vector",
        &["dimension is 4; a label volume has 3, or 4 with 3D Slicer's segments in a list"],
    );
    with("sizes: 2 30", "sizes: 30", &["sizes must be 4 numbers; got 3"]);
    with("sizes: 2 30", "sizes: 0 30", &["sizes begins with 0 layers of segments; there must be 1 to 4096"]);
    with("sizes: 2 30", "sizes: 99999999999 30", &["sizes begins with 99999999999 layers"]);
    with("sizes: 2 30", "sizes: 4096 30", &["data end after 10800 of 22118400 bytes"]);
    with("Segment10_Layer:=1", "Segment10_Layer:=2", &["Segment10_Layer is 2, but there are 2 layers"]);
    with("Segment10_Layer:=1", "Segment10_Layer:=-1", &["Segment10_Layer is -1, but there are 2 layers"]);
    with("Segment10_Layer:=1", "Segment10_Tag:=1", &["Segment10_Layer must be a whole number; got ``"]);
    with(
        "Segment1_LabelValue:=2",
        "Segment1_LabelValue:=x",
        &["a.seg.nrrd: Segment1_LabelValue must be a whole number; got `x`"],
    );
    with("Segment1_LabelValue:=2", "Segment1_LabelValue:=0", &["Segment1_LabelValue is 0, the background"]);
    with("none (1,0,0)", "none none (1,0,0)", &["space directions"]);
    let whole = layered(HEADER);
    for cut in [0, 40, 300, whole.len() - 5000, whole.len() - 1] {
        write(&path, &whole[..cut]);
        refused(&["inspect", &path.display().to_string()], &["a.seg.nrrd"]);
    }
}

#[test]
fn what_is_not_painted_is_told_of() {
    let place = folder();
    let [_, masks] = both(place.path());
    write(&masks.join("Gone.nrrd"), &mask(&vec![false; SIZES.iter().product()]));
    let file = place.path().join("b.seg.nrrd");
    let named = HEADER
        .replace("Segment1_Name", "Segment7_Name:=Gone\nSegment7_Layer:=0\nSegment7_LabelValue:=5\nSegment1_Name");
    write(&file, &layered(&named));
    for input in [masks, file] {
        let stack = read_labels(&input, &ReadOptions::default(), &Wanted::All).expect("three are painted");
        let said: Vec<String> = stack.left_out.iter().map(ToString::to_string).collect();
        assert_eq!((stack.labels.len(), said.len()), (3, 1), "{said:?}");
        assert!(said[0].ends_with("`Gone`: left out, nothing is painted"), "{said:?}");
    }
}

#[test]
fn masks_of_a_folder_have_one_grid() {
    let place = folder();
    let [_, masks] = both(place.path());
    let input = masks.display().to_string();
    let [liver, ..] = organs();
    let other = String::from_utf8_lossy(&mask(&liver)).replace("(0,0,3)", "(0,0,2)");
    write(&masks.join("Tumour.nrrd"), other.as_bytes());
    refused(
        &["inspect", &input],
        &["Tumour.nrrd: lies elsewhere than Cyst.nrrd, by up to 9.0000 mm; masks of a folder"],
    );
    write(&masks.join("Tumour.nrrd"), &nrrd("encoding: raw", "uchar", [10, 20, 9], &[0; 1800]));
    refused(&["inspect", &input], &["Tumour.nrrd: has 10 x 20 x 9 voxels, but Cyst.nrrd has 30 x 20 x 9"]);
    write(&masks.join("Tumour.nrrd"), &mask(&liver)[..4000]);
    refused(&["inspect", &input], &["Tumour.nrrd: data end after"]);
    // Packed data that end beyond the first stretch of voxels that is read at a time.
    let mut packed = GzEncoder::new(Vec::new(), Compression::default());
    packed.write_all(&[7; 5000]).expect("memory takes it");
    let packed = packed.finish().expect("memory takes it");
    write(&masks.join("Tumour.nrrd"), &nrrd(&PLACED.replace("raw", "gzip"), "uchar", SIZES, &packed));
    refused(&["inspect", &input], &["Tumour.nrrd: data end after 5000 of 5400 bytes"]);
    // A grey volume, or one of many labels, is no mask.
    let mut several = mask(&liver);
    let at = several.iter().rposition(|byte| *byte == 7).expect("it is painted");
    several[at] = 5;
    write(&masks.join("Tumour.nrrd"), &several);
    refused(
        &["inspect", &input],
        &["Tumour.nrrd: has the values 7 and 5; a mask in a folder of masks has one besides 0"],
    );
    write(&masks.join("Tumour.nrrd"), b"no mask");
    refused(&["inspect", &input], &["Tumour.nrrd: does not begin with NRRD000"]);
}

#[test]
fn slices_and_volumes_in_one_folder_are_told_apart_and_never_left_out_silently() {
    let place = folder();
    let input = place.path().display().to_string();
    let at = |name: &str| place.path().join(name);
    for k in 1..=5 {
        disc_image(&at(&format!("s{k}.png")), 4.0 + f64::from(k));
    }
    let [liver, ..] = organs();
    write(&at("out.nrrd"), &mask(&liver));
    let spaced = ReadOptions { spacing: Some(vec![1.0, 1.0, 4.0]), ..ReadOptions::default() };
    let slices = Input::read(place.path(), &spaced).expect("five slices");
    assert_eq!(slices.stack.slices.len(), 5);
    assert_eq!(slices.notes, ["the folder is read as slices, of which it has 5; left out as volumes: `out.nrrd`"]);
    refused(
        &["inspect", &input],
        &["has 5 images, but no stack.json", "(the folder is read as slices, of which it has 5; left out"],
    );
    // Images of formats that are not read are told, and other files are nobody's slices.
    ["6.jpg", "7.JPEG", "notes.txt", "about.json", "read.md"].iter().for_each(|name| write(&at(name), b"none"));
    let done = interslice(&["inspect", &input, "--spacing", "1,1,4"]);
    let told = stderr(&done) + &String::from_utf8_lossy(&done.stdout);
    let wanted = "left out as images that are not read, save them as PNG or TIFF: `6.jpg`, `7.JPEG`\n";
    assert!(told.contains(wanted), "{told}");
    // A page too many among images, and images of another size.
    let page = image::GrayImage::new(32, 32);
    let mut encoder = tiff::encoder::TiffEncoder::new(fs::File::create(at("s6.tif")).expect("a file can be made"));
    for _ in 0..2 {
        let encoder = encoder.as_mut().expect("it begins");
        encoder.write_image::<tiff::encoder::colortype::Gray8>(32, 32, &page).expect("it can be written");
    }
    let read = &["inspect", &input, "--spacing", "1,1,4"];
    refused(read, &["`s6.tif` has 2 pages, and 5 images beside it one each"]);
    fs::remove_file(at("s6.tif")).expect("it is there");
    crate::files::disc(&at("picture.png"), 40, 9.0);
    refused(read, &["slice 1 (`s1.png`): 32x32 px, but slice 0 is 40x40 (`picture.png`)", "every image in a folder"]);
    // One picture beside masks is none of them.
    let masks = folder();
    disc_image(&masks.path().join("picture.png"), 9.0);
    write(&masks.path().join("Liver.nrrd"), &mask(&liver));
    let volume = open_volume(masks.path()).expect("a mask");
    assert_eq!(
        volume.notes,
        ["the folder is read as masks, of which it has 1; left out as images of one slice: `picture.png`"]
    );
}

#[test]
fn a_folder_of_images_needs_a_spacing() {
    let place = folder();
    let input = place.path().display().to_string();
    refused(&["inspect", &input], &["has neither stack.json nor images, masks or DICOM files"]);
    // Their names would be sorted s1, s10, s2 by letters.
    for k in 1..=10 {
        disc_image(&place.path().join(format!("s{k}.png")), f64::from(k));
    }
    refused(
        &["inspect", &input],
        &[
            "has 10 images, but no stack.json that says how far apart they are: say --spacing DX,DY,DZ (mm), or write a",
            "{\"spacing_xy\": [1, 1], \"slices\": [{\"file\": \"s1.png\", \"z\": 0}, {\"file\": \"s2.png\", \"z\": 1}, ...]}",
        ],
    );
    refused(&["inspect", &input, "--spacing", "1,2"], &["`spacing` must be three numbers DX,DY,DZ; got 2"]);
    refused(&["inspect", &input, "--spacing", "1,2,-3"], &["`spacing` must be three positive numbers; got -3"]);
    let spaced = ReadOptions { spacing: Some(vec![0.5, 0.5, 4.0]), ..ReadOptions::default() };
    let stack = read(place.path(), &spaced).expect("ten slices");
    let heights: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
    assert_eq!(heights, (0..10).map(|k| 4.0 * f64::from(k)).collect::<Vec<_>>());
    assert_eq!((stack.spacing, stack.slices[9].name.as_str()), ([0.5; 2], "s10.png"));
    assert_eq!(files_of(place.path()).expect("ten images").len(), 10);
    let out = folder();
    let stl = out.path().join("a.stl").display().to_string();
    let result = interslice(&["reconstruct", &input, "--spacing", "0.5,0.5,4", "-o", &stl, "-q"]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
}

fn disc_image(path: &Path, radius: f64) {
    crate::files::disc(path, 32, radius);
}
