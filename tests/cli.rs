//! The program as a user meets it: outputs, settings file, report, inspect, demo, pictures.

#[path = "support/files.rs"]
mod files;

use std::collections::HashMap;
use std::fs;
use std::process::{Command, Stdio};

use files::*;
use serde_json::Value;

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
fn a_reader_that_goes_away_is_no_failure() {
    let place = folder();
    sound_stack(place.path());
    let input = place.path().display().to_string();
    for arguments in [vec!["inspect", &input], vec!["devices"]] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_interslice"))
            .args(&arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        drop(child.stdout.take());
        let result = child.wait_with_output().expect("it ends");
        assert_eq!(result.status.code(), Some(0), "{arguments:?}: {}", stderr(&result));
    }
}

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
fn help_names_every_setting_with_its_default() {
    let result = interslice(&["reconstruct", "--help"]);
    let text = String::from_utf8_lossy(&result.stdout).into_owned();
    for part in ["--cfl <NUMBER>", "[default: 0.5]", "--slope", "[default: hyman]", "--end-top", "[default: flat]"] {
        assert!(text.contains(part), "`{part}` is missing");
    }
}

/// Headings of a help text, each with the long options under it.
fn groups(text: &str) -> Vec<(String, Vec<String>)> {
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    for line in text.lines() {
        if let Some(heading) = line.strip_suffix(':').filter(|l| !l.starts_with(' ')) {
            groups.push((heading.into(), Vec::new()));
        }
        let flag = Some(line.trim_start()).filter(|l| l.starts_with('-'));
        let option = flag.and_then(|l| l.split_once("--")).and_then(|(_, name)| name.split_whitespace().next());
        if let (Some(option), Some((_, options))) = (option, groups.last_mut()) {
            options.push(option.into());
        }
    }
    groups
}

#[test]
fn help_is_grouped_and_begins_with_the_output() {
    let help = |command: &str| {
        let result = interslice(&[command, "-h"]);
        assert_eq!(result.status.code(), Some(0), "{command}");
        groups(&String::from_utf8_lossy(&result.stdout))
    };
    let headings = |command: &str| help(command).into_iter().map(|(heading, _)| heading).collect::<Vec<_>>();
    let all = ["Arguments", "Options", "Input", "Output", "Method", "Ends", "Machine"];
    for (command, expected) in [
        ("reconstruct", all.to_vec()),
        ("plan", all.to_vec()),
        ("run", all.to_vec()),
        ("evaluate", all.into_iter().filter(|h| *h != "Output").collect()),
        ("inspect", vec!["Arguments", "Options", "Input"]),
        ("merge", vec!["Arguments", "Options", "Output"]),
        ("batch", vec!["Arguments", "Options", "Template", "Machine"]),
    ] {
        assert_eq!(headings(command), expected, "{command}");
    }
    for command in ["reconstruct", "run", "merge"] {
        let (_, options) = &help(command)[1];
        assert_eq!(options.first().map(String::as_str), Some("output"), "{command}: {options:?}");
        assert!(options.contains(&"quiet".to_string()), "{command}: {options:?}");
    }
    let reconstruct = help("reconstruct");
    for (heading, options) in [
        ("Input", &["level", "label", "labels", "links"][..]),
        ("Output", &["dz", "mask", "keep-overlaps"]),
        ("Method", &["method", "fair", "slope", "cfl"]),
        ("Ends", &["end-bottom", "end-top", "cap-gaps", "clamp-bottom", "clamp-top"]),
        ("Machine", &["backend", "memory", "threads"]),
    ] {
        let (_, found) = reconstruct.iter().find(|(h, _)| h == heading).expect("the heading is there");
        let missing: Vec<_> = options.iter().filter(|o| !found.iter().any(|f| f == *o)).collect();
        assert!(missing.is_empty(), "{heading}: {missing:?} of {found:?}");
    }
    let ends = &reconstruct.iter().find(|(h, _)| h == "Ends").expect("the heading is there").1;
    assert_eq!(ends.len(), 5, "{ends:?}");
    assert_eq!(ends[0], "end-bottom", "rules stand before slopes");
}

#[test]
fn completions_know_commands_and_options() {
    for (shell, said) in [
        ("bash", "complete -F _interslice"),
        ("zsh", "#compdef interslice"),
        ("fish", "complete -c interslice"),
        ("elvish", "edit:completion:arg-completer[interslice]"),
        ("powershell", "Register-ArgumentCompleter"),
    ] {
        let result = interslice(&["completions", shell]);
        let text = String::from_utf8_lossy(&result.stdout).into_owned();
        assert_eq!(result.status.code(), Some(0), "{shell}: {}", stderr(&result));
        for part in [said, "reconstruct", "end-top", "completions"] {
            assert!(text.contains(part), "{shell}: `{part}` is missing");
        }
    }
    let unknown = interslice(&["completions", "csh"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("bash"), "{}", stderr(&unknown));
}

#[test]
fn every_command_has_a_man_page() {
    let page = |arguments: &[&str]| {
        let result = interslice(&[&["man"], arguments].concat());
        assert_eq!(result.status.code(), Some(0), "{arguments:?}: {}", stderr(&result));
        String::from_utf8_lossy(&result.stdout).replace('\\', "")
    };
    let root = page(&[]);
    assert!(root.contains(".TH interslice 1") && root.contains(".SH SUBCOMMANDS"), "{root}");
    let named = root.lines().filter_map(|l| l.strip_prefix("interslice-")?.strip_suffix("(1)"));
    let commands: Vec<&str> = named.filter(|c| *c != "help").collect();
    assert!(commands.contains(&"reconstruct") && commands.contains(&"man") && commands.len() >= 10, "{commands:?}");
    for command in commands {
        let text = page(&[command]);
        let title = format!(".TH interslice-{command} 1  \"interslice {}\"", env!("CARGO_PKG_VERSION"));
        assert!(text.contains(&title), "{command}: {}", &text[..text.len().min(200)]);
    }
    let reconstruct = page(&["reconstruct"]);
    for part in [".SH INPUT", ".SH METHOD", ".SH ENDS", ".SH MACHINE", "--end-top", "[default: 0.5]"] {
        assert!(reconstruct.contains(part), "`{part}` is missing");
    }
    let unknown = interslice(&["man", "nosuch"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("reconstruct") && stderr(&unknown).contains("nosuch"), "{}", stderr(&unknown));
}

#[cfg(feature = "gpu")]
#[test]
fn backends_are_chosen_told_and_reported() {
    let place = folder();
    sound_stack(place.path());
    let input = place.path().display().to_string();
    let report = place.path().join("r.json").display().to_string();
    let run = |more: &[&str]| {
        // The driver's self-test is remembered here and nowhere else.
        let cache = place.path().join("cache");
        let mut program = Command::new(env!("CARGO_BIN_EXE_interslice"));
        program.env("XDG_CACHE_HOME", cache).args([&["reconstruct", &input, "--report", &report], more].concat());
        let result = program.output().expect("the program starts");
        let text = fs::read(&report).unwrap_or_default();
        let _ = fs::remove_file(&report);
        (result, serde_json::from_slice::<Value>(&text).unwrap_or_default())
    };
    let (cpu, told) = run(&["--backend", "cpu"]);
    assert_eq!(cpu.status.code(), Some(0), "{}", stderr(&cpu));
    assert!(told["backend"].as_str().is_some_and(|b| b.starts_with("reference")), "{told}");
    assert!(told["backend_reason"].as_str().is_some_and(|r| r.contains("asked for")), "{told}");
    let (gpu, told) = run(&["--backend", "gpu", "--profile"]);
    assert_eq!(gpu.status.code(), Some(0), "{}", stderr(&gpu));
    assert!(told["backend"].as_str().is_some_and(|b| b.starts_with("GPU ")), "{told}");
    let steps = &told["profile"]["kernels"]["hj_step"];
    assert!(steps["dispatches"].as_u64().is_some_and(|n| n > 30) && steps["pixels"].as_u64() > Some(1000), "{steps}");
    assert!(stderr(&gpu).contains("hj_step") && stderr(&gpu).contains("GPU ms"), "{}", stderr(&gpu));
    assert!(stderr(&gpu).contains("host CPU s") && stderr(&gpu).contains("propagate"), "{}", stderr(&gpu));
    let (plain, told) = run(&["--backend", "gpu"]);
    assert!(!stderr(&plain).contains("host CPU s"), "only where it is asked: {}", stderr(&plain));
    assert!(told["profile"]["stages"][0]["device"]["waits"].as_u64() > Some(0), "{}", told["profile"]);
    for (wrong, said) in
        [("--memory=lots", "512M"), ("--memory=1K", "at least 1M"), ("--backend=tpu", "auto, gpu, cpu")]
    {
        let (result, _) = run(&[wrong]);
        assert_eq!(result.status.code(), Some(2), "{wrong}");
        assert!(stderr(&result).contains(said), "{wrong}: {}", stderr(&result));
    }
    let (missing, _) = run(&["--backend", "gpu", "--adapter", "none such"]);
    assert_eq!(missing.status.code(), Some(2));
    assert!(stderr(&missing).contains("none such"), "{}", stderr(&missing));
}

#[cfg(feature = "gpu")]
#[test]
fn a_gpu_without_memory_fails_or_is_replaced() {
    let place = folder();
    let demos = place.path().display().to_string();
    let made = interslice(&["demo", "fig9", "-o", &demos, "--backend", "cpu"]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let input = place.path().join("fig9").display().to_string();
    let report = place.path().join("r.json").display().to_string();
    let run = |more: &[&str]| {
        let result = interslice(&[&["reconstruct", &input, "--report", &report], more].concat());
        let text = fs::read(&report).unwrap_or_default();
        (result, serde_json::from_slice::<Value>(&text).unwrap_or_default())
    };
    // A budget that nothing fits into: an explicit GPU fails and leaves nothing, an automatic choice goes on.
    let (short, told) = run(&["--backend", "gpu", "--gpu-memory", "1M"]);
    assert_eq!(short.status.code(), Some(1), "{}", stderr(&short));
    assert!(stderr(&short).contains("budget of 1048576 bytes") && told.is_null(), "{}", stderr(&short));
    // With this little memory the driver's self-test may not fit either: it is run before, and remembered.
    let (seen, _) = run(&["--adapter", "0"]);
    assert!(stderr(&seen).contains("running on: GPU"), "{}", stderr(&seen));
    let (auto, told) = run(&["--adapter", "0", "--gpu-memory", "1M"]);
    assert_eq!(auto.status.code(), Some(0), "{}", stderr(&auto));
    assert!(stderr(&auto).contains("rest of the job runs on the CPU"), "{}", stderr(&auto));
    assert!(told["warnings"][0].as_str().is_some_and(|w| w.contains("changed on the way")), "{told}");
}

#[cfg(feature = "gpu")]
#[test]
fn devices_and_doctor_speak_in_words() {
    let listed = interslice(&["devices"]);
    let text = String::from_utf8_lossy(&listed.stdout).into_owned();
    assert!(text.starts_with("0: ") && text.contains("--backend auto takes"), "{text}");
    let examined = interslice(&["doctor"]);
    let text = String::from_utf8_lossy(&examined.stdout).into_owned();
    assert_eq!(examined.status.code(), Some(0), "{text}");
    assert!(text.contains("loops: ") && text.contains("NaN: ") && text.contains("can be trusted."), "{text}");
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

/// Messages for values that begin with a minus sign.
#[test]
fn negative_numbers_are_values() {
    let place = folder();
    sound_stack(place.path());
    let (input, out) = (place.path().display().to_string(), place.path().join("a.stl").display().to_string());
    for (options, said) in [
        (&["--dz", "-1"][..], "`dz` must be a positive number; got -1"),
        (&["--dz", "-1e-3"], "`dz` must be a positive number; got -0.001"),
        (&["--simplify", "-0.2"], "`simplify` must be a positive number; got -0.2"),
        (&["--fair", "-0.5"], "`fair` must lie in"),
        (&["--pixel", "-2"], "`pixel` must be a positive number; got -2"),
        (&["--border", "-1,2,-3,4"], "`border` is not for anything but contour maps"),
        (&["--spacing", "-1,2,3"], "`spacing` is not for anything but a label volume"),
        (&["--labels", "-1,-2"], "`labels` is not for a folder of slices"),
        (&["--label", "-3"], "`label` must be a value of the pixels (0, 255); got -3"),
        (&["--axis", "-z"], "invalid value '-z' for '--axis <AXIS>'\n  [possible values: auto, x, y, z]"),
        (&["--backend", "-cpu"], "invalid value '-cpu' for '--backend"),
        (&["--slices", "-1,2"], "invalid value '-1' for '--slices <I,J,..>': expected a whole number, 0 or more"),
        (&["--keep", "-2"], "invalid value '-2' for '--keep <K>': expected a whole number, 0 or more"),
        (&["--threads", "-2"], "invalid value '-2' for '--threads <N>': expected a whole number, 0 or more"),
        (
            &["--border", "-1,two"],
            "invalid value '-1,two' for '--border <box|hull|X0,Y0,X1,Y1>': expected box, hull or four",
        ),
        (&["--label", "liver"], "`label` is the value of the pixels in a folder of images, a number"),
        (&["--dz", "--mask"], "--dz lacks its value: --mask, which follows it, is an option"),
        (&["--label", "--mask"], "--label lacks its value: --mask, which follows it, is an option"),
        (&["--axis", "-q"], "--axis lacks its value: -q, which follows it, is an option"),
        (&["--dz", "--masks"], "invalid value '--masks' for '--dz <HEIGHT>': expected a number"),
    ] {
        let result = interslice(&[&["reconstruct", &input, "-o", &out], options].concat());
        assert_eq!(result.status.code(), Some(2), "{options:?}: {}", stderr(&result));
        assert!(stderr(&result).contains(said), "{options:?}: `{said}` is missing from: {}", stderr(&result));
    }
    let slopes = ["--end-top", "extrapolate", "--clamp-top", "-0.5"];
    let result = interslice(&[&["reconstruct", &input, "-o", &out, "-q"], &slopes[..]].concat());
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
}

/// Every command that writes, while it works under temporary names.
#[cfg(unix)]
#[test]
fn an_interrupt_leaves_no_temporary_files() {
    use std::time::{Duration, Instant};
    let place = folder();
    sound_stack(place.path());
    for name in ["s0.png", "s1.png", "s2.png"] {
        disc(&place.path().join(name), 700, 300.0);
    }
    let temporary = |path: &std::path::Path| path.to_string_lossy().contains(".interslice-");
    let stack = |command: &[&'static str]| [command, &[".", "--backend", "cpu", "-q", "--dz", "0.01"]].concat();
    for signal in ["-INT", "-TERM", "-HUP"] {
        for arguments in [
            [stack(&["reconstruct"]), vec!["-o", "a.zarr", "-o", "a.stl", "-o", "a.nrrd"]].concat(),
            [stack(&["run", "--part", "1/2"]), vec!["-o", "a.section"]].concat(),
        ] {
            let before = listing(place.path());
            let mut child = Command::new(env!("CARGO_BIN_EXE_interslice"))
                .args(&arguments)
                .current_dir(place.path())
                .stderr(Stdio::piped())
                .spawn()
                .expect("the program starts");
            let begin = Instant::now();
            while !listing(place.path()).iter().any(|p| temporary(p)) {
                let ended = child.try_wait().expect("it can be asked");
                assert!(ended.is_none() && begin.elapsed() < Duration::from_secs(60), "{arguments:?}: {ended:?}");
                std::thread::sleep(Duration::from_millis(5));
            }
            let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill starts");
            assert!(sent.success(), "{arguments:?}");
            let ended = child.wait_with_output().expect("it ends");
            let message = stderr(&ended);
            assert_eq!(ended.status.code(), Some(130), "{signal}, {arguments:?}: {message}");
            assert!(message.contains("interrupted; unfinished outputs are removed"), "{arguments:?}: {message}");
            assert_eq!(listing(place.path()), before, "{signal}, {arguments:?}");
        }
    }
}

/// A write beyond `ulimit -f` fails as any other does.
#[cfg(unix)]
#[test]
fn a_file_beyond_the_limit_is_an_error_and_leaves_nothing() {
    let place = folder();
    sound_stack(place.path());
    let before = listing(place.path());
    let script =
        format!("ulimit -f 4; exec '{}' reconstruct . -o a.stl -o a.npy -q --dz 0.1", env!("CARGO_BIN_EXE_interslice"));
    let result = Command::new("bash").args(["-c", &script]).current_dir(place.path()).output().expect("bash starts");
    let message = stderr(&result);
    assert_eq!(result.status.code(), Some(1), "{message}");
    assert!(message.contains("a.stl") || message.contains("a.npy"), "{message}");
    assert_eq!(listing(place.path()), before);
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
