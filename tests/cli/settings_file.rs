//! A settings file, and what the command line makes of it.

use std::fs;

use serde_json::Value;

use crate::files::*;

#[test]
fn a_settings_file_says_memory_as_the_command_line_does() {
    let place = folder();
    sound_stack(place.path());
    let (file, out) = (place.path().join("s.toml"), place.path().join("a.stl").display().to_string());
    let run = |memory: &str| {
        fs::write(&file, format!("memory = {memory}\n")).expect("a file can be written");
        let input = place.path().display().to_string();
        interslice(&[
            "reconstruct",
            &input,
            "--settings",
            &file.display().to_string(),
            "-o",
            &out,
            "-q",
            "--backend",
            "cpu",
        ])
    };
    for memory in ["\"512M\"", "536870912"] {
        let result = run(memory);
        assert_eq!(result.status.code(), Some(0), "{memory}: {}", stderr(&result));
    }
    for memory in ["\"a lot\"", "512", "true", "-1"] {
        let (result, said) = (run(memory), "a number of bytes");
        let message = stderr(&result);
        assert_eq!(result.status.code(), Some(2), "{memory}: {message}");
        assert!(
            message.contains("s.toml") && message.contains("memory") && message.contains(said),
            "{memory}: {message}"
        );
    }
}

#[test]
fn a_value_beyond_its_range_is_told_with_the_file_that_has_it() {
    let place = folder();
    sound_stack(place.path());
    let file = place.path().join("s.toml");
    let (input, settings) = (place.path().display().to_string(), file.display().to_string());
    let out = place.path().join("a.stl").display().to_string();
    let base = ["reconstruct", &input, "--settings", &settings, "-o", &out];
    for (text, own, said) in [
        ("fair = 7\n", &[][..], "`fair` must lie in [0, 1.5]; got 7"),
        ("dz = -1\n", &[], "`dz` must be a positive number; got -1"),
        ("cfl = 0.25\n", &["--fair", "9"], "`fair` must lie in [0, 1.5]; got 9"),
        ("fair = 1\n", &["--fair", "9"], "`fair` must lie in [0, 1.5]; got 9"),
    ] {
        fs::write(&file, text).expect("a file can be written");
        let result = interslice(&[&base[..], own].concat());
        let message = stderr(&result);
        assert_eq!(result.status.code(), Some(2), "{text}: {message}");
        assert!(message.contains(said), "{text}: {message}");
        assert_eq!(message.contains("s.toml"), own.is_empty(), "{text}: {message}");
    }
}

#[test]
fn the_command_line_wins_over_the_settings_file() {
    let place = folder();
    sound_stack(place.path());
    let file = place.path().join("s.toml");
    fs::write(&file, "slope = \"pchip\"\ncfl = 0.25\nend_top = \"half-slice\"\nmask = true\ndz = 2\n")
        .expect("a file can be written");
    let report = place.path().join("r.json").display().to_string();
    let (input, file) = (place.path().display().to_string(), file.display().to_string());
    let result =
        interslice(&["reconstruct", &input, "--settings", &file, "--slope", "natural", "--report", &report, "-q"]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    let report: Value = serde_json::from_slice(&fs::read(&report).expect("it was written")).expect("it is JSON");
    assert_eq!(report["settings"]["slope"], "natural");
    assert_eq!(report["settings"]["cfl"], 0.25);
    assert_eq!(report["settings"]["end_top"], "half-slice");
}

#[test]
fn a_settings_file_may_name_a_preset() {
    let place = folder();
    sound_stack(place.path());
    let [input, file, report] = ["", "s.toml", "r.json"].map(|name| place.path().join(name).display().to_string());
    let run = |text: &str, more: &[&str]| {
        fs::write(&file, text).expect("a file can be written");
        let always = ["reconstruct", &input, "--settings", &file, "--report", &report, "-q", "--backend", "cpu"];
        interslice(&[&always[..], more].concat())
    };
    let settings = |text: &str, more: &[&str]| {
        let _ = fs::remove_file(&report);
        let result = run(text, more);
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        let report: Value = serde_json::from_slice(&fs::read(&report).expect("it was written")).expect("it is JSON");
        report["settings"].clone()
    };
    let fast = settings("preset = \"fast\"\nfair = 0.25\n", &[]);
    assert_eq!((&fast["method"], &fast["fair"]), (&"field".into(), &0.25.into()));
    let paper = settings("preset = \"fast\"\nfair = 0.25\n", &["--preset", "paper", "--sweep", "both"]);
    assert_eq!((&paper["method"], &paper["fair"]), (&"morph".into(), &0.25.into()));
    assert_eq!((&paper["slope"], &paper["sweep"]), (&"natural".into(), &"both".into()));
    let wrong = run("preset = \"quick\"\n", &[]);
    assert_eq!(wrong.status.code(), Some(2), "{wrong:?}");
    let said = stderr(&wrong);
    assert!(said.contains("s.toml") && said.contains("quick") && said.contains("paper or fast"), "{said}");
    for (text, words) in [
        ("method = 1", "`method` = 1: expected morph or field"),
        ("fair = \"much\"", "`fair` = \"much\": invalid type: string \"much\", expected a number"),
        ("redistance = -1", "expected a whole number from 0"),
        ("mask = 1", "`mask` = 1: expected true or false"),
    ] {
        let said = stderr(&run(text, &[]));
        assert!(said.contains(words), "{text}: {said}");
    }
}

#[test]
fn an_option_drops_those_of_the_settings_file_that_it_excludes() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let [nx, ny, nz] = [12, 10, 9];
    let painted = |n: usize| {
        u8::from((n / (nx * ny)).is_multiple_of(2) && (3..8).contains(&(n % nx)) && (3..7).contains(&(n / nx % ny)))
    };
    let voxels: Vec<u8> = (0..nx * ny * nz).map(painted).collect();
    fs::write(at("in.nrrd"), nrrd("encoding: raw", "uint8", [nx, ny, nz], &voxels)).expect("a file can be written");
    let cases: [(&str, &[&str]); 8] = [
        ("keep = 3", &["--slices", "0,2,4"]),
        ("slices = [0, 2]", &["--keep", "2"]),
        ("dz = 3.0", &["--isotropic"]),
        ("isotropic = true", &["--dz", "2"]),
        ("mask = true", &["--distance"]),
        ("like = \"nothing.nrrd\"", &["--dz", "2"]),
        ("label = 7", &["--labels", "all"]),
        ("label = 7", &["--level", "0.5"]),
    ];
    for (file, options) in cases {
        fs::write(at("s.toml"), file).expect("a file can be written");
        let (input, settings, out) = (at("in.nrrd"), at("s.toml"), at("out.nrrd"));
        let common = ["reconstruct", &input, "-o", &out, "--backend", "cpu", "-q", "--settings", &settings];
        let result = interslice(&[&common[..], options].concat());
        assert_eq!(result.status.code(), Some(0), "{file}, {options:?}: {}", stderr(&result));
    }
    // In the file alone they still exclude each other.
    fs::write(at("s.toml"), "keep = 3\nslices = [0, 2]").expect("a file can be written");
    let result = interslice(&["reconstruct", &at("in.nrrd"), "-o", &at("out.nrrd"), "-q", "--settings", &at("s.toml")]);
    assert!(stderr(&result).contains("`keep` is not for"), "{}", stderr(&result));
}
