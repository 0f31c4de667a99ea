//! A folder of label images is the label volume of their pixels: whatever they are saved as, and whatever is asked of them.

use std::fs;
use std::path::Path;

use crate::files::*;
use image::{ImageBuffer, Luma};
use interslice::input::labels::{Wanted, read_labels, read_whole_labels};
use interslice::input::read;
use interslice::labels::LabelStack;
use interslice::stack::ReadOptions;
use interslice::stack::options::LabelName;
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;
use tiff::encoder::{TiffEncoder, colortype};

/// What the images are saved as.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Saved {
    Png8,
    Png16,
    Tiff32,
}

/// Labels of slices, row by row.
#[derive(Debug, Clone)]
struct Drawn {
    dims: [usize; 2],
    slices: Vec<Vec<u32>>,
    saved: Saved,
}

impl Drawn {
    /// The images, named as people count: the names of ten and more stand before those of two where letters are compared.
    fn write(&self, folder: &Path) {
        for (k, labels) in self.slices.iter().enumerate() {
            self.write_one(
                &folder.join(format!("s{k}.{}", if self.saved == Saved::Tiff32 { "tif" } else { "png" })),
                labels,
            );
        }
    }

    fn write_one(&self, path: &Path, labels: &[u32]) {
        let [nx, ny] = self.dims.map(|n| n as u32);
        match self.saved {
            Saved::Png8 => {
                let values = labels.iter().map(|v| *v as u8).collect();
                let image: ImageBuffer<Luma<u8>, Vec<u8>> = ImageBuffer::from_raw(nx, ny, values).expect("its size");
                image.save(path).expect("a file can be written");
            }
            Saved::Png16 => {
                let values = labels.iter().map(|v| *v as u16).collect();
                let image: ImageBuffer<Luma<u16>, Vec<u16>> = ImageBuffer::from_raw(nx, ny, values).expect("its size");
                image.save(path).expect("a file can be written");
            }
            Saved::Tiff32 => {
                let file = fs::File::create(path).expect("a file can be written");
                let mut encoder = TiffEncoder::new(file).expect("it begins");
                encoder.write_image::<colortype::Gray32>(nx, ny, labels).expect("a page");
            }
        }
    }

    /// The same as one volume.
    fn volume(&self, path: &Path, spacing: [f64; 3]) {
        let [x, y, z] = spacing;
        let bytes: Vec<u8> = self.slices.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let header = format!(
            "spacings: {x} {y} {z}\nspace units: \"mm\" \"mm\" \"mm\"\nspace dimension: 3\nendian: little\nencoding: raw"
        );
        let sizes = [self.dims[0], self.dims[1], self.slices.len()];
        fs::write(path, nrrd(&header, "uint32", sizes, &bytes)).expect("a file can be written");
    }
}

/// Discs of labels that drift, each on slices of its own.
fn drawn() -> impl Strategy<Value = Drawn> {
    let disc = (1u32..5, 4.0..20.0f64, 4.0..14.0f64, -0.8..0.8f64, 2.0..5.0f64, 0usize..6, 2usize..9, 1usize..3);
    let saved = prop_oneof![Just(Saved::Png8), Just(Saved::Png16), Just(Saved::Tiff32)];
    (24usize..32, 18usize..26, 11usize..14, prop::collection::vec(disc, 2..5), 0u32..200, saved).prop_map(
        |(nx, ny, nz, discs, above, saved)| {
            let mut slices = vec![vec![0; nx * ny]; nz];
            for (label, x, y, drift, r, first, count, every) in discs {
                for (k, slice) in slices.iter_mut().enumerate().skip(first).step_by(every).take(count) {
                    let at = |n: usize| ((n % nx) as f64 - x - drift * k as f64, (n / nx) as f64 - y);
                    let inside = (0..nx * ny).filter(|n| at(*n).0.hypot(at(*n).1) < r);
                    // Numbers from 1 to 204 of 8 bits; of 16 and 32 larger ones.
                    let wide = if saved == Saved::Png8 { 0 } else { 60_000 };
                    inside.for_each(|n| slice[n] = label + above + wide);
                }
            }
            Drawn { dims: [nx, ny], slices, saved }
        },
    )
}

const SPACING: [f64; 3] = [0.5, 0.75, 2.5];

/// All that a reconstruction takes of labels.
fn parts(stack: &LabelStack) -> String {
    let LabelStack { stack, labels, drawn, given, covered, singles, left_out, .. } = stack;
    let slices: Vec<_> = stack.slices.iter().map(|s| (s.z, &s.content)).collect();
    format!(
        "{labels:?} {drawn:?} {given:?} {covered:?} {singles:?} {left_out:?} {slices:?} {:?} {}",
        stack.spacing, stack.unit
    )
}

fn alike(drawn: &Drawn) -> TestCaseResult {
    let place = folder();
    let (images, volume) = (place.path().join("images"), place.path().join("volume.nrrd"));
    fs::create_dir(&images).expect("a folder can be made");
    drawn.write(&images);
    drawn.volume(&volume, SPACING);
    let spaced = ReadOptions { spacing: Some(SPACING.to_vec()), ..ReadOptions::default() };
    let of_volume = read_labels(&volume, &ReadOptions::default(), &Wanted::All);
    let of_images = read_labels(&images, &spaced, &Wanted::All);
    let labels = match (&of_volume, &of_images) {
        (Ok(a), Ok(b)) => {
            prop_assert_eq!(parts(a), parts(b));
            a.labels.clone()
        }
        // Labels that are on one slice, each of them.
        (Err(_), Err(_)) => Vec::new(),
        _ => {
            return Err(TestCaseError::fail(format!(
                "{:?} of the volume, {:?} of images",
                of_volume.is_ok(),
                of_images.is_ok()
            )));
        }
    };
    for label in labels {
        let one = Some(LabelName::Number(label));
        let a = read(&volume, &ReadOptions { label: one.clone(), ..ReadOptions::default() });
        let b = read(&images, &ReadOptions { label: one, ..spaced.clone() });
        let contents = |stack: interslice::stack::ContourStack| {
            stack.slices.into_iter().map(|s| (s.z.to_bits(), format!("{:?}", s.content))).collect::<Vec<_>>()
        };
        prop_assert_eq!(a.map(contents).map_err(|_| ()), b.map(contents).map_err(|_| ()));
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn images_of_labels_are_their_volume(drawn in drawn()) {
        alike(&drawn)?;
    }
}

/// Two discs of labels 3 and 7 on `count` slices.
fn two_discs(saved: Saved, count: usize) -> Drawn {
    let at = |n: usize| {
        let (i, j) = ((n % 40) as f64, (n / 40) as f64);
        if (i - 11.0).hypot(j - 12.0) < 8.0 { 3 } else { 7 * u32::from((i - 28.0).hypot(j - 12.0) < 6.0) }
    };
    Drawn { dims: [40, 25], slices: vec![(0..1000).map(at).collect(); count], saved }
}

#[test]
fn the_command_takes_all_labels_of_images_one_or_each() {
    let place = folder();
    let images = place.path().join("images");
    fs::create_dir(&images).expect("a folder can be made");
    two_discs(Saved::Png8, 12).write(&images);
    let input = images.display().to_string();
    let out = |name: &str| place.path().join(name).display().to_string();
    let run = |arguments: &[&str]| {
        let done = interslice(&[&["reconstruct", &input, "--spacing", "1,1,3"], arguments].concat());
        assert!(done.status.success(), "{arguments:?}: {}", stderr(&done));
    };
    run(&["--labels", "all", "-o", &out("all.npy"), "-q"]);
    run(&["--label", "7", "-o", &out("seven.npy"), "-q"]);
    let numbers = |name: &str| {
        let volume = interslice::input::open_volume(Path::new(&out(name))).expect("it was written");
        let mut counts = std::collections::BTreeMap::new();
        volume
            .labels(|run| run.values.iter().for_each(|v| *counts.entry(*v).or_insert(0usize) += 1))
            .expect("it is read");
        counts
    };
    let (all, seven) = (numbers("all.npy"), numbers("seven.npy"));
    assert_eq!(all.keys().copied().collect::<Vec<_>>(), [0, 3, 7]);
    assert_eq!(seven.keys().copied().collect::<Vec<_>>(), [0, 7]);
    assert_eq!(all[&7], seven[&7]);
    let each = interslice(&["inspect", &input, "--spacing", "1,1,3", "--labels", "all"]);
    let said = String::from_utf8_lossy(&each.stdout).into_owned();
    assert!(said.contains("label 3") && said.contains("label 7") && said.contains("folder of images"), "{said}");
    let spaced = ReadOptions { spacing: Some(vec![1.0, 1.0, 3.0]), ..ReadOptions::default() };
    let whole = read_whole_labels(&images, &spaced, &Wanted::All).expect("both");
    assert_eq!(whole.labels, [3, 7]);
}

/// How a sound folder is spoilt, options, and what is said.
type Case<'c> = (&'c dyn Fn(), &'c [&'c str], &'c str);

#[test]
fn wrong_label_images_are_named() {
    let place = folder();
    let images = place.path().join("images");
    let (input, out) = (images.display().to_string(), place.path().join("out.nrrd").display().to_string());
    let cases: [Case<'_>; 6] = [
        (
            &|| two_discs(Saved::Png16, 1).write_one(&images.join("s4.png"), &two_discs(Saved::Png8, 1).slices[0]),
            &[],
            "slice 4 (`s4.png`): 40x25 px of uint16, but slice 0 has 40x25 px of uint8",
        ),
        (
            &|| disc(&images.join("s5.png"), 30, 9.0),
            &[],
            "slice 5 (`s5.png`): 30x30 px of uint8, but slice 0 has 40x25 px of uint8",
        ),
        (&|| fs::write(images.join("s2.png"), "no image").expect("a file can be written"), &[], "slice 2 (`s2.png`): "),
        (
            &|| (),
            &["no spacing"],
            "has 12 images, and nothing says how far apart they are: say --spacing DX,DY,DZ (mm)",
        ),
        (&|| (), &["--labels", "4"], "images: has no label 4; labels are 3, 7"),
        (
            &|| {
                write_stack(
                    &images,
                    r#"{"spacing_xy": [1, 1], "slices": [{"file": "s0.png", "z": 0}, {"file": "s1.png", "z": 1}]}"#,
                )
            },
            &["no spacing"],
            "`labels` is not for a folder of slices with stack.json",
        ),
    ];
    for (spoil, arguments, expected) in cases {
        let _ = fs::remove_dir_all(&images);
        fs::create_dir(&images).expect("a folder can be made");
        two_discs(Saved::Png8, 12).write(&images);
        spoil();
        let mut all = vec!["reconstruct", &input, "-o", &out];
        match arguments {
            ["no spacing"] => all.extend(["--labels", "all"]),
            [] => all.extend(["--labels", "all", "--spacing", "1,1,3"]),
            more => all.extend([&["--spacing", "1,1,3"][..], more].concat()),
        }
        let wrong = interslice(&all);
        assert_eq!(wrong.status.code(), Some(2), "{all:?}: {}", stderr(&wrong));
        assert!(stderr(&wrong).contains(expected), "{all:?}: {}", stderr(&wrong));
        assert!(!Path::new(&out).exists(), "{all:?}");
    }
}

/// A folder of floats, as SciPy's distances are saved, is the volume of them.
#[test]
fn images_of_floats_are_the_volume_of_their_numbers() {
    let place = folder();
    let (dims, slices) = ([24, 20], 5);
    let value = |n: usize, k: usize| {
        let (x, y) = ((n % dims[0]) as f32 - 11.3, (n / dims[0]) as f32 - 9.4);
        5.0 + 0.4 * k as f32 - x.hypot(y)
    };
    let images = place.path().join("images");
    fs::create_dir(&images).expect("a folder can be made");
    let mut bytes = Vec::new();
    for k in 0..slices {
        let values: Vec<f32> = (0..dims[0] * dims[1]).map(|n| value(n, k)).collect();
        let file = fs::File::create(images.join(format!("s{k}.tif"))).expect("a file can be written");
        let mut encoder = TiffEncoder::new(file).expect("it begins");
        encoder.write_image::<colortype::Gray32Float>(dims[0] as u32, dims[1] as u32, &values).expect("a page");
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    }
    let volume = place.path().join("volume.nrrd");
    let header =
        "spacings: 1 1 3\nspace units: \"mm\" \"mm\" \"mm\"\nspace dimension: 3\nendian: little\nencoding: raw";
    fs::write(&volume, nrrd(header, "float", [dims[0], dims[1], slices], &bytes)).expect("a file can be written");
    let level = Some(0.0);
    let spacing = Some(vec![1.0, 1.0, 3.0]);
    let [ours, theirs] = [
        read(&images, &ReadOptions { level, spacing: spacing.clone(), ..ReadOptions::default() }).expect("it is sound"),
        read(&volume, &ReadOptions { level, ..ReadOptions::default() }).expect("it is sound"),
    ];
    assert_eq!((ours.dims, ours.spacing, ours.slices.len()), (theirs.dims, theirs.spacing, theirs.slices.len()));
    for (a, b) in ours.slices.iter().zip(&theirs.slices) {
        assert!(a.z == b.z && a.content.sides() == b.content.sides(), "{} and {}", a.name, b.name);
    }
    let said = read(&images, &ReadOptions { spacing, ..ReadOptions::default() }).expect_err("no level").to_string();
    assert!(said.contains("level"), "{said}");
}

/// Writes labels as numbers of these colours.
fn write_indexed(path: &Path, labels: &[u8], [nx, ny]: [u32; 2], colours: &[[u8; 3]]) {
    let file = fs::File::create(path).expect("a file can be written");
    let mut encoder = png::Encoder::new(file, nx, ny);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette(colours.concat());
    encoder.write_header().and_then(|mut writer| writer.write_image_data(labels)).expect("it is written");
}

#[test]
fn labels_of_images_with_a_palette_are_its_numbers() {
    let place = folder();
    let options = ReadOptions { spacing: Some(vec![1.0, 1.0, 4.0]), ..ReadOptions::default() };
    let label = |n: usize| match [n % 24, n / 24] {
        [3..9, 4..12] => 1,
        [14..21, 5..13] => 2,
        _ => 0,
    };
    let labels: Vec<u8> = (0..24 * 18).map(label).collect();
    let colours = [[0, 0, 0], [128, 0, 0], [0, 128, 0], [224, 224, 192]];
    // A palette may say no more than the image needs.
    for (k, colours) in [&colours[..], &colours[..3], &colours[..]].into_iter().enumerate() {
        write_indexed(&place.path().join(format!("s{k}.png")), &labels, [24, 18], colours);
    }
    let stack = read_labels(place.path(), &options, &Wanted::All).expect("a label volume");
    let drawn: Vec<u32> = labels.iter().map(|l| u32::from(*l)).collect();
    assert_eq!((&stack.labels[..], &stack.drawn[..]), (&[1, 2][..], &vec![drawn; 3][..]));
    write_indexed(&place.path().join("s2.png"), &labels, [24, 18], &[[0, 0, 0], [0, 128, 0], [128, 0, 0]]);
    let e = read_labels(place.path(), &options, &Wanted::All).expect_err("its numbers mean something else").to_string();
    assert!(e.contains("s2.png") && e.contains("number 1 of its palette is the colour [0, 128, 0]"), "{e}");
}
