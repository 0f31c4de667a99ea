//! Random runs of the built program: any input in any container, any options, any outputs, some of them wrong.
//!
//! A run ends with 0 and every output that was asked for, or with 2, a message, and nothing written. No panic, no file left over, no input
//! touched, whatever was asked.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::inputs::{self, Holds};
use crate::random::case::{self, Kind};
use crate::random::numbers::Numbers;
use crate::random::properties::{Checked, Fault};
use crate::random::settings;
use interslice::Settings;
use interslice::settings::EndRule;

/// A run on some thousand pixels takes a fraction of a second: this long is a hang.
const LONGEST: Duration = Duration::from_secs(120);
/// Outputs of one body, by extension.
const OUTPUTS: [&str; 28] = [
    "nrrd",
    "nii",
    "nii.gz",
    "mha",
    "zarr",
    "tif",
    "ome.tif",
    "npy",
    "npz",
    "vti",
    "seg.nrrd",
    "stl",
    "ply",
    "obj",
    "glb",
    "groups.obj",
    "3mf",
    "vtp",
    "png",
    "dem.tif",
    "contours.json",
    "geojson",
    "json",
    "html",
    "origin.nrrd",
    "origin.nii.gz",
    "confidence.nrrd",
    "confidence.mha",
];
/// Those of many labels.
const OUTPUTS_OF_LABELS: [&str; 12] =
    ["nrrd", "seg.nrrd", "nii", "nii.gz", "mha", "zarr", "stl", "ply", "glb", "3mf", "groups.obj", "json"];

/// A run of the program: its input's files and its arguments, of which those that name a file have `{}` for the folder.
struct Run {
    files: Vec<(String, Vec<u8>)>,
    arguments: Vec<String>,
    outputs: Vec<String>,
    /// Whether something is wrong with it on purpose, or may be.
    spoilt: bool,
}

impl Run {
    /// Writes the input's files into a folder.
    fn write(&self, place: &Path) -> io::Result<()> {
        self.files.iter().try_for_each(|(name, bytes)| {
            let path = place.join(name);
            path.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::write(path, bytes))
        })
    }
}

/// What the run of a seed is, with its files in a folder of its own.
pub fn shown(seed: u64) -> Result<String, String> {
    let run = draw(seed);
    let place = PathBuf::from(format!("target/campaign/program-{seed}"));
    run.write(&place).map_err(|e| format!("{}: {e}", place.display()))?;
    let spoilt = if run.spoilt { ", spoilt" } else { "" };
    let arguments = run.arguments.join(" ").replace("{}", &place.display().to_string());
    Ok(format!("seed {seed}{spoilt}: interslice {arguments}\n"))
}

/// Runs the program of a seed in a folder of its own.
pub fn check(seed: u64) -> Checked {
    let run = draw(seed);
    let fault = |what: String| Fault {
        figure: 1.0,
        bound: 0.0,
        what: format!("{what}: interslice {}", run.arguments.join(" ")),
    };
    let place = tempfile::tempdir().map_err(|e| fault(e.to_string()))?;
    run.write(place.path()).map_err(|e| fault(e.to_string()))?;
    let before = listing(place.path());
    let folder = place.path().display().to_string();
    let arguments = run.arguments.iter().map(|a| a.replace("{}", &folder));
    let output = ended(arguments.collect()).map_err(fault)?;
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    let says = message.lines().rfind(|l| !l.trim().is_empty()).unwrap_or_default().to_string();
    if message.contains("panicked") {
        return Err(fault(format!("a panic, {says}")));
    }
    let after = listing(place.path());
    if let Some((name, _)) = before.iter().find(|(name, bytes)| after.get(*name) != Some(bytes)) {
        return Err(fault(format!("the input {} was changed", name.display())));
    }
    // `out0.stl` may become `out0.3.stl`, and `out0.zarr` is a folder.
    let made = |output: &str, name: &Path| {
        let stem = output.split('.').next().unwrap_or_default();
        name.components().next().is_some_and(|c| c.as_os_str().to_string_lossy().starts_with(&format!("{stem}.")))
    };
    let asked = |name: &Path| run.outputs.iter().any(|o| made(o, name));
    let new: Vec<&PathBuf> = after.keys().filter(|name| !before.contains_key(*name)).collect();
    match output.status.code() {
        Some(0) => {
            let missing = run.outputs.iter().find(|o| !new.iter().any(|name| made(o, name)));
            let left = new.iter().find(|name| !asked(name));
            match (missing, left) {
                (Some(name), _) => Err(fault(format!("{name} was not written"))),
                (_, Some(name)) => Err(fault(format!("{} is left over", name.display()))),
                _ => Ok(Some(0.0)),
            }
        }
        Some(2) if message.trim().is_empty() => Err(fault("refused without a word".into())),
        Some(2) if !new.is_empty() => Err(fault(format!("refused, but {} was written", new[0].display()))),
        Some(2) if !run.spoilt => Err(fault(format!("sound input is refused ({says})"))),
        // The exit code, so that the log says how many runs were refused.
        Some(2) => Ok(Some(2.0)),
        code => Err(fault(format!("exit code {code:?}, {says}"))),
    }
}

/// What the program says in the end, or that it does not end.
fn ended(arguments: Vec<String>) -> Result<Output, String> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_interslice"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|e| e.to_string())?;
    let begin = Instant::now();
    // Its few messages fit into the pipe.
    while child.try_wait().map_err(|e| e.to_string())?.is_none() {
        if begin.elapsed() > LONGEST {
            child.kill().map_err(|e| e.to_string())?;
            return Err(format!("no end in {} s", LONGEST.as_secs()));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.wait_with_output().map_err(|e| e.to_string())
}

/// Every file below a folder, by its name there.
fn listing(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut files, mut open) = (BTreeMap::new(), vec![folder.to_path_buf()]);
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(next).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
            } else if let (Ok(name), Ok(bytes)) = (path.strip_prefix(folder), fs::read(&path)) {
                files.insert(name.to_path_buf(), bytes);
            }
        }
    }
    files
}

fn draw(seed: u64) -> Run {
    let mut n = Numbers::new(seed ^ 0xca11);
    let mut stack = case::stack(&mut n, Kind::Any);
    let input = loop {
        if let Some(drawn) = inputs::input(&mut n, &stack) {
            break drawn;
        }
        stack = case::stack(&mut n, Kind::Any);
    };
    let mut settings = settings::settings(&mut n, &stack);
    // A volume has heights of its own.
    for end in [&mut settings.end_bottom, &mut settings.end_top] {
        *end = if let EndRule::Peak(_) = end { EndRule::Extrapolate } else { *end };
    }
    let command = if n.chance(0.8) { "reconstruct" } else { n.of(&["inspect", "plan", "evaluate"]) };
    let mut arguments = vec![command.to_string(), format!("{{}}/{}", input.name)];
    arguments.extend(input.arguments.iter().cloned());
    let mut outputs: Vec<String> = Vec::new();
    if command != "inspect" {
        arguments.extend(options(&settings));
    }
    if command == "plan" || command == "reconstruct" {
        arguments.push(format!("--dz={}", (input.ends[1] - input.ends[0]) / n.between(3.0, 30.0)));
    }
    if command == "plan" {
        // No more than there are intervals.
        let most = if input.holds == Holds::Labels { 1 } else { (stack.slices.len() - 1).min(2) };
        arguments.push(format!("--parts={}", n.whole(1, most)));
    }
    if command == "reconstruct" {
        arguments.extend(["--backend=cpu".into(), "--threads=1".into()]);
        let values =
            if input.holds == Holds::Labels { "" } else { n.of(&["", "", "--mask", "--distance", "--contours"]) };
        arguments.extend((!values.is_empty()).then(|| values.to_string()));
        let drawn: &[&str] = if input.holds == Holds::Labels { &OUTPUTS_OF_LABELS } else { &OUTPUTS };
        // A TIFF of a map is its height map, and segments have no distances.
        let none = |extension: &str| {
            input.holds == Holds::Map && ["tif", "ome.tif"].contains(&extension)
                || values == "--distance" && extension == "seg.nrrd"
        };
        for k in 0..n.whole(1, 3) {
            let extension = n.of(drawn);
            let name = format!("out{k}.{}", if none(extension) { "ply" } else { extension });
            arguments.extend(["-o".into(), format!("{{}}/{name}")]);
            outputs.push(name);
        }
    }
    let mut files = input.files;
    let spoilt = n.chance(0.4);
    if spoilt {
        spoil(&mut n, &mut files, &mut arguments, &input.name);
    }
    // A stack may be too short to leave slices out.
    Run { files, arguments, outputs, spoilt: spoilt || command == "evaluate" }
}

/// Settings that are not the default's, as options of the command line.
fn options(settings: &Settings) -> Vec<String> {
    let [Ok(Value::Object(own)), Ok(Value::Object(default))] =
        [settings, &Settings::default()].map(serde_json::to_value)
    else {
        return Vec::new();
    };
    let differ = own.into_iter().filter(|(name, value)| default.get(name) != Some(value) && name != "links");
    let option = |(name, value): (String, Value)| {
        let value = value.as_str().map_or_else(|| value.to_string(), str::to_string);
        format!("--{}={value}", name.replace('_', "-"))
    };
    differ.map(option).collect()
}

/// Makes something wrong: a file, an option, an output. What is left may be sound.
fn spoil(n: &mut Numbers, files: &mut [(String, Vec<u8>)], arguments: &mut Vec<String>, input: &str) {
    let any = n.whole(0, files.len() - 1);
    match n.whole(0, 7) {
        0 => {
            let bytes = &mut files[any].1;
            bytes.truncate((n.unit() * bytes.len() as f64) as usize);
        }
        1 => {
            let bytes = &mut files[any].1;
            for _ in 0..n.whole(1, 8) {
                let most = if n.chance(0.5) { bytes.len() } else { bytes.len().min(200) };
                let at = n.whole(0, most - 1);
                bytes[at] ^= 1 << n.whole(0, 7);
            }
        }
        2 => {
            let option = n.of(&[
                "fair",
                "cfl",
                "half-width",
                "cut-off",
                "tolerance",
                "sigma",
                "seed-spacing",
                "cap-gaps",
                "dz",
                "link-reach",
            ]);
            let value = n.of(&["-1", "0", "1e300", "nan", "inf", "x", "", "1e-300", "99"]);
            arguments.retain(|a| !a.starts_with(&format!("--{option}")));
            arguments.push(format!("--{option}={value}"));
        }
        3 => arguments.push(format!("--end-top=peak={}", n.of(&["-1e9", "1e9", "0", "x"]))),
        4 => arguments.extend(["--label".into(), n.of(&["300", "-1", "0", "x"]).into()]),
        5 => arguments.extend(["-o".into(), n.of(&["{}/no/such/folder/x.nrrd", "{}/x.xyz", "{}", "{}/out0"]).into()]),
        6 => arguments.extend([
            n.of(&["--axis", "--level", "--roi", "--slices", "--labels", "--keep", "--spacing", "--simplify"]).into(),
            n.of(&["x", "1", "0,0", "-3", "1e9", "all"]).into(),
        ]),
        // The input itself as output.
        _ => arguments.extend(["-o".into(), format!("{{}}/{input}")]),
    }
}
