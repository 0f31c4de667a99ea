//! What is painted wrongly is said before the work (P14).

use std::fs;
use std::path::{Path, PathBuf};

use crate::files::*;
use interslice::input::Input;
use interslice::stack::ReadOptions;
use tempfile::TempDir;

const SIZES: [usize; 3] = [40, 36, 32];

fn node([i, j, k]: [usize; 3]) -> usize {
    i + SIZES[0] * (j + SIZES[1] * k)
}

pub fn in_ball([i, j, k]: [usize; 3], radius: f64) -> bool {
    let [x, y, z] = [i as f64 - 20.0, j as f64 - 18.0, k as f64 - 16.0];
    (x * x + y * y + z * z).sqrt() < radius
}

pub fn volume(value: impl Fn([usize; 3]) -> u16) -> Vec<u16> {
    let [nx, ny, nz] = SIZES;
    (0..nx * ny * nz).map(|n| value([n % nx, n / nx % ny, n / (nx * ny)])).collect()
}

/// A ball that is painted on every fifth slice.
fn ball() -> Vec<u16> {
    volume(|at| u16::from(at[2] % 5 == 1 && in_ball(at, 13.0)))
}

pub struct Case {
    pub place: TempDir,
    pub input: PathBuf,
}

impl Case {
    pub fn new(voxels: &[u16], spacings: &str) -> Self {
        let place = folder();
        let input = place.path().join("in.nrrd");
        let bytes: Vec<u8> = voxels.iter().flat_map(|v| v.to_le_bytes()).collect();
        let header = format!("spacings: {spacings}\nencoding: raw\nendian: little");
        fs::write(&input, nrrd(&header, "ushort", SIZES, &bytes)).expect("a file can be written");
        Case { place, input }
    }

    fn path(&self) -> &str {
        self.input.to_str().expect("temporary paths are UTF-8")
    }

    /// What `inspect`, `evaluate` and `reconstruct` say, and their exit codes.
    pub fn said(&self, options: &[&str]) -> [(Option<i32>, String); 3] {
        let out = self.place.path().join("out.nrrd").display().to_string();
        let run = |command: &str, more: &[&str]| {
            let output = interslice(&[&[command, self.path()], options, more].concat());
            (output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output))
        };
        let cpu = ["--backend", "cpu"];
        [run("inspect", &[]), run("evaluate", &cpu), run("reconstruct", &[&cpu[..], &["-o", &out]].concat())]
    }

    pub fn all_say(&self, options: &[&str], code: i32, message: &str) {
        for (is, said) in self.said(options) {
            assert_eq!(is, Some(code), "{said}");
            assert_eq!(said.matches(message).count(), 1, "`{message}`: {said}");
        }
    }

    pub fn none_doubts(&self, options: &[&str]) {
        for (code, said) in self.said(options) {
            assert_eq!(code, Some(0), "{said}");
            // What the work finds is another matter.
            let of_the_work = |line: &str| {
                ["sweep of a group", "does not hold", "left out, is drawn on 1"]
                    .iter()
                    .any(|known| line.contains(known))
            };
            let mut warnings = said.lines().filter(|line| line.starts_with("warning") && !of_the_work(line));
            assert_eq!(warnings.next(), None, "{said}");
        }
    }
}

#[test]
fn p14_paint_in_two_orientations_is_an_error() {
    let mut voxels = ball();
    for n in (0..SIZES[1]).flat_map(|j| (0..SIZES[2]).map(move |k| [20, j, k])).filter(|at| in_ball(*at, 13.0)) {
        voxels[node(n)] = 1;
    }
    let case = Case::new(&voxels, "1 1 1");
    case.all_say(&[], 2, "is painted on slices in several directions: across x on 20, across z on 6,11,16,21,26");
    for (code, said) in case.said(&["--axis", "z", "--slices", "6,11,16,21,26"]) {
        assert_eq!(code, Some(0), "{said}");
    }
}

#[test]
fn p14_a_stray_voxel_is_doubted() {
    let mut voxels = ball();
    voxels[node([22, 19, 13])] = 1;
    Case::new(&voxels, "1 1 1").all_say(&[], 0, "slice `k=13` has 1 px (beside");
    let mut off = ball();
    off[node([3, 3, 30])] = 1;
    Case::new(&off, "1 1 1").all_say(&[], 0, "slice `k=30` has 1 px (beside");
    // Once, however many labels there are.
    let mut two = off;
    two[node([33, 3, 0])] = 2;
    two[node([33, 3, 1])] = 2;
    let case = Case::new(&two, "1 1 1");
    let out = case.place.path().join("out.nrrd").display().to_string();
    let labels = interslice(&["reconstruct", case.path(), "--labels", "all", "--backend", "cpu", "-o", &out]);
    assert_eq!(stderr(&labels).matches("has 1 px (beside").count(), 1, "{}", stderr(&labels));
}

#[test]
fn a_body_darker_than_the_level_is_doubted() {
    let value = |dark: bool| volume(|at| if in_ball(at, 14.0) == dark { 100 } else { 900 });
    Case::new(&value(true), "1 1 1").all_say(&["--level", "500"], 0, "nearly all of the images' border is inside: is");
    Case::new(&value(false), "1 1 1").none_doubts(&["--level", "500"]);
    // The option that it names, and what takes no such option.
    Case::new(&value(true), "1 1 1").none_doubts(&["--level", "500", "--invert"]);
    Case::new(&value(false), "1 1 1").all_say(&["--level", "500", "--invert"], 0, "Without --invert it is");
    Case::new(&value(true), "1 1 1").all_say(&["--invert"], 2, "invert");
}

/// A folder of images named by these, with `value` at column, row and slice; without `stack.json`.
pub fn images(names: &[&str], value: impl Fn(u32, u32, usize) -> u8) -> Case {
    let place = folder();
    for (k, name) in names.iter().enumerate() {
        let image = image::GrayImage::from_fn(32, 30, |x, y| image::Luma([value(x, y, k)]));
        image.save(place.path().join(name)).expect("an image can be written");
    }
    let input = place.path().to_path_buf();
    Case { place, input }
}

pub fn in_disc(x: u32, y: u32, k: usize) -> bool {
    (f64::from(x) - 15.5).hypot(f64::from(y) - 14.5) < 8.0 + k as f64
}

pub const SPACED: [&str; 2] = ["--spacing", "1,1,4"];

#[test]
fn p14_a_grey_image_is_no_label_volume() {
    let noise = |n: usize| ((n as u64).wrapping_mul(6364136223846793005) >> 40) as u16 % 60;
    let grey = volume(|at| if in_ball(at, 14.0) { 200 + 20 * at[0] as u16 + noise(node(at)) } else { 0 });
    let case = Case::new(&grey, "1 1 1");
    case.all_say(&[], 2, "few neighbours the same: grey values, not labels; cut them with `--level`");
    case.none_doubts(&["--level", "500"]);
    let [(code, said), ..] = case.said(&["--label", "500", "--keep", "1"]);
    assert_eq!(code, Some(0), "who names a label gets it: {said}");
}

#[test]
fn p14_pixels_that_are_square_but_for_rounding_do_not_choose_the_axis() {
    let dense = volume(|at| u16::from(in_ball(at, 13.0)));
    let said = |spacings: &str| Case::new(&dense, spacings).said(&[])[0].1.clone();
    assert!(said("2.3898 2.3852 2.0").contains("slices lie along z"), "{}", said("2.3898 2.3852 2.0"));
    assert!(said("2.5 2.3852 2.0").contains("slices lie along x"), "{}", said("2.5 2.3852 2.0"));
}

#[test]
fn slices_that_are_chosen_beside_the_painted_ones_are_doubted() {
    let of = |voxels: &[u16], keep: &str| {
        let [inspected, _, made] = Case::new(voxels, "1 1 1").said(&["--keep", keep]);
        [inspected, made].map(|(code, said)| {
            assert_eq!(code, Some(0), "{said}");
            said.matches("`keep` takes every slice whose number is a multiple of").count()
        })
    };
    // Painted are 6, 11, 16, 21 and 26.
    assert_eq!(of(&ball(), "3"), [1, 1]);
    // Every second of slices that are painted throughout, with a gap between two bodies: that is a choice among them.
    let two = volume(|at| u16::from(in_ball(at, 13.0) && !(14..18).contains(&at[2])));
    assert_eq!(of(&two, "2"), [0, 0]);
}

#[test]
fn labels_that_become_one_body_are_told() {
    let halves = volume(|at| u16::from(in_ball(at, 13.0)) * if at[0] < 15 { 1 } else { 7 });
    let case = Case::new(&halves, "1 1 1");
    case.all_say(&[], 0, "warning: its 2 labels become one body, their union; `labels` = all keeps them apart");
    case.none_doubts(&["--label", "7"]);
}

#[test]
fn labels_that_become_one_body_though_painted_on_unlike_slices_are_told() {
    let painted = |of_first: [usize; 2], of_second: [usize; 2]| {
        let on = |[every, first]: [usize; 2], k: usize| k % every == first;
        let voxels = volume(|at| match in_ball(at, 13.0) {
            true if at[0] < 15 && on(of_first, at[2]) => 1,
            true if at[0] >= 15 && on(of_second, at[2]) => 7,
            _ => 0,
        });
        Case::new(&voxels, "1 1 1")
    };
    let lacking = " slices from its first to its last one, on which others are";
    for (of_first, of_second, more) in
        [([4, 0], [4, 2], "; so is 1 more: there it is"), ([4, 0], [2, 0], ": there it is")]
    {
        let told = format!("{lacking}{more} interpolated by itself before the union");
        painted(of_first, of_second).all_say(&["--axis", "z"], 0, &told);
    }
    for (of_first, of_second, options) in
        [([4, 0], [4, 0], &["--axis", "z"][..]), ([4, 0], [2, 0], &["--axis", "z", "--keep", "4"])]
    {
        let [inspected, ..] = painted(of_first, of_second).said(options);
        assert!(inspected.0 == Some(0) && !inspected.1.contains(lacking), "{}", inspected.1);
    }
}

/// Labels with slices of their own are interpolated to those of others before they become one body with them.
#[test]
fn the_union_of_labels_on_unlike_slices_is_that_of_what_they_are_alone() {
    let of = |of_first: [usize; 2], of_second: [usize; 2]| {
        let on = |[every, first]: [usize; 2], k: usize| k % every == first;
        let voxels = volume(|at| match in_ball(at, 13.0) {
            true if at[0] < 20 && on(of_first, at[2]) => 1,
            true if at[0] >= 20 && on(of_second, at[2]) => 7,
            _ => 0,
        });
        let case = Case::new(&voxels, "1 1 1");
        let report = case.place.path().join("r.json");
        let out = report.display().to_string();
        let made = interslice(&["reconstruct", case.path(), "--axis", "z", "--backend", "cpu", "-o", &out]);
        assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
        let report: serde_json::Value =
            serde_json::from_slice(&fs::read(report).expect("it was written")).expect("it is JSON");
        report["volume"].as_f64().expect("a closed body has a volume")
    };
    let together = of([2, 0], [2, 0]);
    for (of_first, of_second) in [([4, 0], [4, 2]), ([4, 0], [2, 0]), ([2, 0], [4, 2])] {
        let apart = of(of_first, of_second);
        assert!((apart / together - 1.0).abs() < 0.04, "{of_first:?}, {of_second:?}: {apart} for {together}");
    }
}

#[test]
fn p14_ordinary_volumes_are_not_doubted() {
    Case::new(&ball(), "1 1 1").none_doubts(&[]);
    // Painted throughout, with a tip; a hollow ball.
    Case::new(&volume(|at| u16::from(in_ball(at, 13.01))), "1 1 2").none_doubts(&[]);
    Case::new(&volume(|at| u16::from(in_ball(at, 13.0) && !in_ball(at, 12.0))), "1 1 1").none_doubts(&[]);
}

/// A NIfTI of a ball whose qform lies `apart` mm from its sform.
fn nifti(path: &Path, apart: f32) {
    let mut header = vec![0u8; 352];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    for (k, n) in [3, SIZES[0], SIZES[1], SIZES[2], 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * k, &(n as i16).to_le_bytes());
    }
    put(70, &512i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    (0..8).for_each(|k| put(76 + 4 * k, &1f32.to_le_bytes()));
    put(108, &352f32.to_le_bytes());
    put(123, &[2]);
    put(252, &1i16.to_le_bytes());
    put(254, &1i16.to_le_bytes());
    put(268, &apart.to_le_bytes());
    for row in 0..3 {
        put(280 + 16 * row + 4 * row, &1f32.to_le_bytes());
    }
    put(344, b"n+1\0");
    header.extend(ball().iter().flat_map(|v| v.to_le_bytes()));
    fs::write(path, header).expect("a file can be written");
}

#[test]
fn p14_forms_of_a_nifti_that_differ_are_said() {
    let place = folder();
    let input = place.path().join("in.nii");
    let case = Case { place, input };
    nifti(&case.input, 3.0);
    case.all_say(
        &[],
        0,
        "sform and qform of the header place the volume differently, by up to 3.000 mm; the sform is used",
    );
    let input = Input::read(&case.input, &ReadOptions::default()).expect("it is sound");
    let origin = input.surveyed.expect("it is a volume").volume.grid.origin;
    assert_eq!(origin.to_array(), [0.0; 3], "that of the sform");
    nifti(&case.input, 0.01);
    case.none_doubts(&[]);
}

#[test]
fn a_gap_in_what_is_drawn_plane_by_plane_is_told() {
    let stack = |heights: &[f64]| {
        let place = folder();
        let slice = |z: &f64| format!(r#"{{"z": {z}, "polygons": [[[0, 0], [20, 0], [20, 20], [0, 20]]]}}"#);
        let slices: Vec<String> = heights.iter().map(slice).collect();
        write_stack(
            place.path(),
            &format!(r#"{{"unit": "mm", "spacing_xy": [1, 1], "slices": [{}]}}"#, slices.join(", ")),
        );
        let input = place.path().to_path_buf();
        Case { place, input }
    };
    let told = "slices lie 3.000 apart, but none between 12.000 and 42.000: interpolated across";
    stack(&[0.0, 3.0, 6.0, 9.0, 12.0, 42.0, 45.0, 48.0]).all_say(&[], 0, told);
    // `--slices` is not for a folder.
    let way = "reconstruct each stretch by itself (`slices` chooses it from a volume or an RTSTRUCT; of a folder, one with its slices alone)";
    stack(&[0.0, 3.0, 6.0, 9.0, 12.0, 42.0, 45.0, 48.0]).all_say(&[], 0, way);
    stack(&[0.0, 3.0, 6.0, 9.0, 12.0, 21.0, 24.0, 27.0]).none_doubts(&[]);
    // A volume says it in slices.
    let voxels = volume(|at| u16::from((at[2] < 8 || at[2] > 20) && in_ball([at[0], at[1], 16], 9.0)));
    let case = Case::new(&voxels, "1 1 1");
    case.all_say(&[], 0, "painted slice by slice, but not on 8 to 20");
    assert!(case.said(&[]).iter().all(|(_, said)| !said.contains("but none between")));
}

#[test]
fn a_rule_for_an_end_that_an_empty_slice_passes_over_is_told() {
    let case = Case::new(&volume(|at| u16::from(in_ball(at, 9.0))), "1 1 1");
    let out = case.place.path().join("out.nrrd").display().to_string();
    let told = |options: &[&str]| {
        let output = interslice(&[&["reconstruct", case.path(), "--backend", "cpu", "-o", &out], options].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let said = stderr(&output);
        said.lines().filter(|line| line.contains("changes nothing")).map(str::to_owned).collect::<Vec<_>>()
    };
    // Slices 0 to 30 are chosen, those from 8 to 24 are painted.
    let found = told(&["--keep", "3", "--end-top", "peak=40", "--end-bottom", "extrapolate"]);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].contains("`end_bottom` = extrapolate") && found[0].contains("at 0 "), "{found:?}");
    assert!(found[1].contains("`end_top` = peak=40") && found[1].contains("at 30 "), "{found:?}");
    // The painted ones alone, and flat ends.
    assert!(told(&["--end-top", "extrapolate"]).is_empty());
    assert!(told(&["--keep", "3"]).is_empty());
    assert!(told(&["--slices", "9,12,15,18,21,24", "--end-top", "extrapolate"]).is_empty());
}

#[test]
fn parts_that_pixels_do_not_resolve_are_told_where_they_are_much_of_the_body() {
    let dots = |at: [usize; 3]| at[2] % 5 == 1 && at[0] % 8 == 3 && at[1] % 8 == 3;
    let told = "175 parts of slices have at most 3 px, 100 % of what is painted (the first on slice `k=1`)";
    Case::new(&volume(|at| u16::from(dots(at))), "1 1 1").all_say(&[], 0, told);
    // Drawn on finer pixels they are resolved.
    let blocks = |at: [usize; 3]| at[2] % 5 == 1 && at[1] < 32 && [0, 1].iter().all(|&a| (3..6).contains(&(at[a] % 8)));
    Case::new(&volume(|at| u16::from(blocks(at))), "1 1 1").none_doubts(&[]);
}

#[test]
fn painted_slices_that_stand_alone_on_another_axis_than_the_coarsest_are_told() {
    let sagittal = volume(|at| u16::from(at[1] % 8 == 3 && (4..20).contains(&at[0]) && (5..15).contains(&at[2])));
    let told = "slices are taken to lie along y, along which 5 stretches of painted ones have empty ones between; those of the coarsest spacing lie along z, \
                which `axis` = z takes";
    let coarse = Case::new(&sagittal, "1 1 4");
    coarse.all_say(&[], 0, told);
    coarse.none_doubts(&["--axis", "y"]);
    let even = Case::new(&sagittal, "1 1 1");
    even.none_doubts(&[]);
    // Across the paint every slice has some, and nothing is left to be interpolated.
    let told = "slices are taken along z, as asked, and painted ones stand alone along y, in 5 stretches with empty ones between";
    even.all_say(&["--axis", "z"], 0, told);
}
