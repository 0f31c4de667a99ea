//! What is told before anything is computed: `inspect` and `--dry-run`.

use std::fs;

use serde_json::Value;

use crate::files::*;

#[test]
fn inspect_reads_like_a_summary() {
    let place = folder();
    sound_stack(place.path());
    disc(&place.path().join("s1.png"), 32, 0.0);
    let result = interslice(&["inspect", &place.path().display().to_string()]);
    let text = String::from_utf8_lossy(&result.stdout).into_owned();
    assert_eq!(result.status.code(), Some(0));
    for part in [
        "3 slices (masks), 32 x 32 px of 1 x 1 mm",
        "heights 0 to 8 mm, 4 apart",
        "MiB of memory",
        "of this CPU, less than a second",
        "slice 1 (`s1.png`) at 4: empty",
        "1 part, 0 holes",
        "no partner above, ends before it unless its motion leads to one: 1 of `s0.png`",
    ] {
        assert!(text.contains(part), "`{part}` is missing from:\n{text}");
    }
}

/// A grey volume that is nothing but noise, three slices of it, in `folder`.
fn noise(folder: &std::path::Path) -> String {
    let (n, mut state) = (96, 1u32);
    let value = |_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let voxels: Vec<u8> = (0..n * n * 3).map(value).collect();
    let path = folder.join("noise.nrrd");
    fs::write(&path, nrrd("spacings: 1 1 3\nencoding: raw", "uint8", [n, n, 3], &voxels))
        .expect("a file can be written");
    path.display().to_string()
}

#[test]
fn of_what_meets_nothing_and_of_warnings_alike_the_first_are_told_and_how_many_more() {
    let place = folder();
    let input = noise(place.path());
    let inspected = interslice(&["inspect", &input, "--axis", "z", "--level", "150"]);
    assert_eq!(inspected.status.code(), Some(0), "{}", stderr(&inspected));
    let text = String::from_utf8_lossy(&inspected.stdout).into_owned();
    assert_eq!(text.matches("perhaps {").count(), 2 * 24, "{text}");
    let more = |of: &str| text.lines().filter(|line| line.contains(of) && line.contains(" more")).count();
    assert_eq!(more("parts that overlap") + more("no partner above") + more("no partner below"), 6, "{text}");
    assert_eq!(more("pairs that might be linked"), 2, "{text}");
    assert!(text.len() < 16_000, "{} bytes", text.len());
    let report = place.path().join("r.json").display().to_string();
    // Smaller parts: of each kind many sweeps vanish.
    let made = ["reconstruct", &input, "--axis", "z", "--level", "190", "--backend", "cpu", "--report", &report];
    let made = interslice(&made);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let told: Vec<String> =
        stderr(&made).lines().filter(|line| line.contains(" vanished at t = ")).map(Into::into).collect();
    // Of each of three kinds six are told by themselves.
    assert!((1..=18).contains(&told.len()) && told.iter().any(|line| line.contains(" times: both ")), "{told:?}");
    let report: Value = serde_json::from_slice(&fs::read(&report).expect("it was written")).expect("it is JSON");
    let kept = report["warnings"].as_array().expect("warnings").iter().filter_map(Value::as_str);
    assert!(kept.filter(|w| w.contains(" vanished at t = ")).eq(told.iter().map(|w| &w["warning: ".len()..])));
}

#[test]
fn a_dry_run_says_what_a_run_does_and_does_nothing() {
    let place = folder();
    sound_stack(place.path());
    let at = |name: &str| place.path().join(name).display().to_string();
    fs::write(at("b.stl"), "mine").expect("a file can be written");
    let (volume, mesh) = (at("b.nrrd"), at("b.stl"));
    let input = place.path().display().to_string();
    let arguments = ["reconstruct", &input, "-o", &volume, "-o", &mesh, "--dz", "0.5", "--backend", "cpu"];
    let before = listing(place.path());
    let foretold = interslice(&[&arguments[..], &["--dry-run"]].concat());
    assert_eq!(foretold.status.code(), Some(0), "{}", stderr(&foretold));
    assert_eq!(listing(place.path()), before);
    assert_eq!(fs::read(&mesh).expect("it is still there"), b"mine");
    let text = String::from_utf8_lossy(&foretold.stdout).into_owned();
    let needs = "of this CPU, less than a second";
    for part in
        ["would read: 3 slices (masks), 32 x 32 px of 1 x 1 mm", "would read: heights 0 to 8 mm, 4 apart", needs]
    {
        assert!(text.contains(part), "`{part}` is missing from:\n{text}");
    }
    let done = interslice(&arguments);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let header = fs::read(&volume).expect("it was written");
    let header = String::from_utf8_lossy(&header[..400]).into_owned();
    let sizes = header.lines().find_map(|line| line.strip_prefix("sizes: ")).expect("an NRRD header");
    let holds = format!("would write: {volume}, {} voxels", sizes.replace(' ', " x "));
    assert!(text.contains(&holds), "`{holds}` is missing from:\n{text}");
    let triangles = (fs::metadata(&mesh).expect("it was written").len() - 84) / 50;
    let said = format!("would write: {mesh} in place of the one that is there, at most ");
    let most = text.lines().find_map(|line| line.strip_prefix(&said)?.strip_suffix(" triangles")?.parse::<u64>().ok());
    assert!(most.is_some_and(|most| (triangles..3 * triangles).contains(&most)), "{triangles} triangles:\n{text}");
    // What stops a run stops it too.
    let refused = interslice(&[&arguments[..], &["--dry-run", "--memory", "10M"]].concat());
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
}

/// Voxels are told as the file has them, also where slices lie across its first axis.
#[test]
fn a_dry_run_says_the_voxels_in_the_files_order() {
    let place = folder();
    let [nx, ny, nz] = [9, 24, 20];
    let voxel = |n: usize| {
        let [i, j, k] = [n % nx, n / nx % ny, n / (nx * ny)];
        u8::from(i % 4 == 0 && (j as f64 - 11.0).hypot(k as f64 - 9.0) < 7.0)
    };
    let input = place.path().join("a.nrrd");
    let header = "spacings: 1 1 1\nencoding: raw";
    fs::write(&input, nrrd(header, "uint8", [nx, ny, nz], &(0..nx * ny * nz).map(voxel).collect::<Vec<_>>()))
        .expect("a file can be written");
    for out in ["b.nii.gz", "b.nrrd"] {
        let out = place.path().join(out).display().to_string();
        let input = input.display().to_string();
        let foretold = interslice(&[
            "reconstruct",
            &input,
            "--axis",
            "x",
            "--dz",
            "0.5",
            "-o",
            &out,
            "--backend",
            "cpu",
            "--dry-run",
        ]);
        assert_eq!(foretold.status.code(), Some(0), "{}", stderr(&foretold));
        let text = String::from_utf8_lossy(&foretold.stdout).into_owned();
        assert!(text.contains(&format!("would write: {out}, 17 x {ny} x {nz} voxels")), "{text}");
    }
}

#[test]
fn a_dry_run_foretells_the_memory_of_outputs() {
    let (place, outputs) = (folder(), folder());
    let image = image::GrayImage::from_fn(600, 600, |x, y| {
        image::Luma([if (f64::from(x) - 300.0).hypot(f64::from(y) - 300.0) < 200.0 { 255 } else { 0 }])
    });
    (0..3).for_each(|k| image.save(place.path().join(format!("s{k}.png"))).expect("a PNG can be written"));
    let input = place.path().display().to_string();
    let run = |out: &str, more: &[&str]| {
        let out = outputs.path().join(out).display().to_string();
        interslice(
            &[&["reconstruct", &input, "--spacing", "1,1,4", "-o", &out, "--backend", "cpu", "--dry-run"], more]
                .concat(),
        )
    };
    let foretold = |out: &str, more: &[&str]| {
        let output = run(out, more);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let told = text.lines().find_map(|line| line.strip_prefix("would need: about ")).expect("what it needs");
        let number = |text: &str| text.split(' ').next().and_then(|n| n.parse::<u64>().ok()).expect("MiB");
        let least = told.split_once("(or ").map_or(number(told), |(_, least)| number(least));
        [number(told), least]
    };
    let [volume, picture] = ["a.nrrd", "a.png"].map(|out| foretold(out, &[]));
    assert!((0..2).all(|k| picture[k] > volume[k]), "{volume:?} and {picture:?} MiB");
    // What is foretold is what is allowed.
    let with = |mib: u64| run("a.png", &["--memory", &format!("{mib}M")]).status.code();
    assert_eq!([with(picture[1] + 1), with(picture[1] - 2)], [Some(0), Some(2)], "{picture:?} MiB");
}

#[test]
fn inspect_proposes_links_that_reconstruct_takes() {
    let place = folder();
    sound_stack(place.path());
    let circle = |file: &str, centre: f64| {
        let image = image::GrayImage::from_fn(64, 64, |x, y| {
            image::Luma([if (f64::from(x) - centre).hypot(f64::from(y) - 32.0) < 8.0 { 255 } else { 0 }])
        });
        image.save(place.path().join(file)).expect("a PNG can be written");
    };
    [("s0.png", 14.0), ("s1.png", 44.0), ("s2.png", 46.0)].into_iter().for_each(|(file, x)| circle(file, x));
    let input = place.path().display().to_string();
    let inspect = |more: &[&str]| {
        let result = interslice(&[&["inspect", &input], more].concat());
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        String::from_utf8_lossy(&result.stdout).into_owned()
    };
    let text = inspect(&[]);
    let says = "3.8 radii apart, area x 1.00, overlap 1.00 when shifted; enough for `--link auto`";
    let line = text.lines().find(|l| l.contains(says)).expect("the pair is proposed");
    let entry = &line[line.find('{').expect("an entry")..=line.find('}').expect("its end")];
    assert_eq!(text.matches("perhaps").count(), 1, "the others overlap:\n{text}");
    let links = place.path().join("links.json").display().to_string();
    fs::write(&links, format!("{{\"links\": [{entry}]}}")).expect("a file can be written");
    assert!(inspect(&["--links", &links]).contains("    linked: 1-1"));
    assert!(!inspect(&["--links", &links]).contains("no partner"));
    let report = place.path().join("r.json").display().to_string();
    let mut told = Vec::new();
    for options in [&["--links", &links][..], &["--link", "auto"], &[]] {
        let result = interslice(&[&["reconstruct", &input, "--report", &report], options].concat());
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        let report: Value = serde_json::from_slice(&fs::read(&report).expect("it was written")).expect("it is JSON");
        told.push(report["intervals"][0]["links"].clone());
        assert_eq!(report["intervals"][1]["links"], serde_json::json!([]));
    }
    let link = |by: &str| serde_json::json!([{"from": 1, "to": 1, "join": true, "by": by, "meet": 1.0}]);
    assert_eq!(told, [link("file"), link("auto"), serde_json::json!([])]);
    // A settings file may name the links too.
    let settings = place.path().join("settings.toml");
    fs::write(&settings, format!("links = {links:?}\nlink_reach = 5.0")).expect("a file can be written");
    let result =
        interslice(&["reconstruct", &input, "--report", &report, "--settings", &settings.display().to_string()]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    let report: Value = serde_json::from_slice(&fs::read(&report).expect("it was written")).expect("it is JSON");
    assert_eq!(report["intervals"][0]["links"], link("file"));
}
