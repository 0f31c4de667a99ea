//! Whole runs of `reconstruct`, `demo` and `evaluate`, from files to files.

use std::collections::HashMap;
use std::fs;

use serde_json::Value;

use crate::files::*;

#[test]
fn every_output_is_written_and_the_report_certifies() {
    let place = folder();
    sound_stack(place.path());
    let out = folder();
    let names = ["v.nrrd", "v.nii.gz", "m.stl", "m.ply", "m.obj", "p.png", "h.dem.tif"];
    let paths: Vec<String> = names.iter().map(|n| out.path().join(n).display().to_string()).collect();
    let report = out.path().join("report.json").display().to_string();
    let input = place.path().display().to_string();
    let mut arguments = vec!["reconstruct", &input, "--report", &report, "--contours", "-v"];
    paths.iter().for_each(|p| arguments.extend(["-o", p]));
    let result = interslice(&arguments);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    assert!(stderr(&result).contains("running on: "), "says what it runs on: {}", stderr(&result));
    assert_eq!(listing(out.path()).len(), names.len() + 1, "nothing else is left");
    let report: Value = serde_json::from_slice(&fs::read(&report).expect("it was written")).expect("it is JSON");
    for contour in report["contours"].as_array().expect("a list") {
        assert_eq!(contour["differing_pixels"], 0);
    }
    assert_eq!(report["settings"]["slope"], "hyman");
    assert!(report["intervals"][0]["particles"]["arrived"].as_u64().expect("a count") > 50);
    // Cone frusta of radii 8, 10, 7 px: the volume lies between inner and outer bounds.
    let volume = report["volume"].as_f64().expect("a number");
    assert!((1700.0..2500.0).contains(&volume), "{volume}");
    let picture = image::open(&paths[5]).expect("a picture").to_rgb8();
    let colours: HashMap<[u8; 3], usize> = picture.pixels().fold(HashMap::new(), |mut m, p| {
        *m.entry(p.0).or_default() += 1;
        m
    });
    assert!(colours.len() > 1000, "shaded: {} colours", colours.len());
    let red = picture.pixels().filter(|p| p[0] > 140 && p[1] < 60 && p[2] < 60).count();
    assert!(red > 300, "contours are drawn: {red} px");
    let stl = fs::read(&paths[2]).expect("it was written");
    let count = u32::from_le_bytes(stl[80..84].try_into().expect("four bytes")) as usize;
    assert_eq!(stl.len(), 84 + 50 * count);
    let obj = fs::read_to_string(&paths[4]).expect("it was written");
    assert_eq!(obj.lines().filter(|l| l.starts_with("f ")).count(), count);
    let heights = fs::read(&paths[6]).expect("it was written");
    assert!(heights.starts_with(b"II") || heights.starts_with(b"MM"), "a TIFF");
}

#[test]
fn grey_slices_are_cut_at_their_level() {
    let place = folder();
    sound_stack(place.path());
    for k in 0..3 {
        let image = image::ImageBuffer::<image::Luma<u16>, _>::from_fn(32, 32, |x, y| {
            let r = (f64::from(x) - 15.5).hypot(f64::from(y) - 15.5);
            image::Luma([(3000.0 + 500.0 * (9.0 - r)).clamp(0.0, 6000.0) as u16])
        });
        image.save(place.path().join(format!("s{k}.png"))).expect("a PNG can be written");
    }
    let input = place.path().display().to_string();
    let area = |level: &str| {
        let report = place.path().join("r.json").display().to_string();
        let result = interslice(&["reconstruct", &input, "--level", level, "--report", &report, "-q"]);
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        let report: Value = serde_json::from_slice(&fs::read(&report).expect("written")).expect("JSON");
        report["volume"].as_f64().expect("a number") / 8.0
    };
    for (level, r) in [("3000", 9.0f64), ("3750", 7.5), ("4500", 6.0)] {
        let exact = std::f64::consts::PI * r * r;
        // Chords and conditioning move the contour inward by a few hundredths of a pixel.
        assert!((area(level) / exact - 1.0).abs() < 0.02, "level {level}: {} against {exact}", area(level));
    }
}

#[test]
fn demos_can_be_reconstructed_again_from_what_they_wrote() {
    let place = folder();
    let out = place.path().display().to_string();
    let result = interslice(&["demo", "fig10", "-o", &out]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    let input = place.path().join("fig10").display().to_string();
    let again = place.path().join("again.stl");
    let result = interslice(&["reconstruct", &input, "-q", "-o", &again.display().to_string()]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    let first = fs::read(place.path().join("fig10/surface.stl")).expect("the demo wrote it");
    assert!(first == fs::read(again).expect("it was written"), "the same bytes");
}

#[test]
fn evaluate_leaves_slices_out_and_scores_them() {
    let place = folder();
    let demos = place.path().display().to_string();
    let made = interslice(&["demo", "fig9", "-o", &demos, "--backend", "cpu"]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let input = place.path().join("fig9").display().to_string();
    let result = interslice(&["evaluate", &input, "--json", "--backend", "cpu"]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    let single = interslice(&["evaluate", &input, "--json", "--backend", "cpu", "--threads", "1"]);
    assert!(single.stdout == result.stdout, "threads change nothing: {}", stderr(&single));
    let none = interslice(&["evaluate", &input, "--json", "--backend", "cpu", "--threads", "0"]);
    assert_eq!(none.status.code(), Some(2), "{}", stderr(&none));
    let score: Value = serde_json::from_slice(&result.stdout).expect("it is JSON");
    let dice = score["dice"].as_f64().expect("a number");
    assert!((0.5..1.0).contains(&dice), "{score}");
    let slices = score["slices"].as_array().expect("a list");
    assert!(!slices.is_empty());
    for slice in slices {
        let [a, b] = [0, 1].map(|k| slice["pixels"][k].as_f64().expect("a count"));
        let error = slice["area_error_percent"].as_f64().expect("a number");
        assert!((error - 100.0 * (b - a) / a).abs() < 1e-9, "{slice}");
    }
    let [first, second, wrong] =
        ["a.json", "b.json", "c.csv"].map(|name| place.path().join(name).display().to_string());
    let words = interslice(&["evaluate", &input, "--backend", "cpu", "-o", &first, "-o", &second]);
    for path in [&first, &second] {
        assert!(fs::read(path).expect("it was written") == result.stdout, "{path}");
    }
    let own = place.path().join("fig9/stack.json").display().to_string();
    for (path, said) in [(&wrong, "scores are written as JSON"), (&own, "is the input")] {
        let refused = interslice(&["evaluate", &input, "--backend", "cpu", "-o", &second, "-o", path]);
        assert_eq!(refused.status.code(), Some(2), "{path}");
        assert!(stderr(&refused).contains(said) && !stderr(&refused).contains("running on"), "{}", stderr(&refused));
    }
    assert!(String::from_utf8_lossy(&words.stdout).contains("slices left out, one in 2: Dice"));
    for (wrong, said) in [("--leave=1", "at least 2"), ("--leave=40", "leave nothing out")] {
        let result = interslice(&["evaluate", &input, wrong]);
        assert_eq!(result.status.code(), Some(2), "{wrong}");
        assert!(stderr(&result).contains(said), "{wrong}: {}", stderr(&result));
    }
}
