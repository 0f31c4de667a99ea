//! Random runs of the built program: any input in any container, any options, any outputs, some of them wrong.
//!
//! A run ends with 0 and every output that was asked for, or with 2, a message, and nothing written. No panic, no file left over, no input
//! touched, whatever was asked.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use image::GrayImage;
use serde_json::{Value, json};

use crate::random::case::{self, Kind};
use crate::random::numbers::Numbers;
use crate::random::properties::{Checked, Fault};
use crate::random::settings;
use interslice::Settings;
use interslice::settings::EndRule;
use interslice::stack::{ContourStack, SliceContent};

/// A run on some thousand pixels takes a fraction of a second: this long is a hang.
const LONGEST: Duration = Duration::from_secs(120);
/// Outputs by extension.
const OUTPUTS: [&str; 16] = [
    "nrrd",
    "nii",
    "nii.gz",
    "mha",
    "zarr",
    "stl",
    "ply",
    "obj",
    "glb",
    "png",
    "dem.tif",
    "contours.json",
    "geojson",
    "json",
    "html",
    "origin.nrrd",
];

/// A run of the program: its input's files and its arguments, of which those that name a file have `{}` for the folder.
struct Run {
    files: Vec<(String, Vec<u8>)>,
    arguments: Vec<String>,
    outputs: Vec<String>,
    /// Whether something is wrong with it on purpose.
    spoilt: bool,
}

/// What the run of a seed is.
pub fn shown(seed: u64) -> String {
    let run = draw(seed);
    let files: Vec<String> = run.files.iter().map(|(name, bytes)| format!("{name} ({} bytes)", bytes.len())).collect();
    let spoilt = if run.spoilt { ", spoilt" } else { "" };
    format!("seed {seed}{spoilt}: interslice {}\nfiles: {}\n", run.arguments.join(" "), files.join(", "))
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
    let write = |(name, bytes): &(String, Vec<u8>)| {
        let path = place.path().join(name);
        path.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::write(path, bytes))
    };
    run.files.iter().try_for_each(write).map_err(|e| fault(e.to_string()))?;
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
    let (input, mut files) = loop {
        if let Some(drawn) = input(&mut n, &stack) {
            break drawn;
        }
        stack = case::stack(&mut n, Kind::Any);
    };
    let mut arguments = vec![
        "reconstruct".to_string(),
        format!("{{}}/{input}"),
        "--backend".into(),
        "cpu".into(),
        "--threads".into(),
        "1".into(),
    ];
    let mut settings = settings::settings(&mut n, &stack);
    // A volume has heights of its own.
    for end in [&mut settings.end_bottom, &mut settings.end_top] {
        *end = if let EndRule::Peak(_) = end { EndRule::Extrapolate } else { *end };
    }
    arguments.extend(options(&settings));
    let step = (stack.slices[stack.slices.len() - 1].z - stack.slices[0].z) / n.between(3.0, 30.0);
    arguments.extend(["--dz".to_string(), format!("{step}")]);
    if n.chance(0.2) {
        arguments.push(n.of(&["--mask", "--contours"]).into());
    }
    let mut outputs: Vec<String> = Vec::new();
    for _ in 0..n.whole(1, 3) {
        let name = format!("out{}.{}", outputs.len(), n.of(&OUTPUTS));
        arguments.extend(["-o".into(), format!("{{}}/{name}")]);
        outputs.push(name);
    }
    let spoilt = n.chance(0.4);
    if spoilt {
        spoil(&mut n, &mut files, &mut arguments, &input);
    }
    Run { files, arguments, outputs, spoilt }
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

/// An input's name and its files.
type Files = (String, Vec<(String, Vec<u8>)>);

/// The stack in a container that can hold it.
fn input(n: &mut Numbers, stack: &ContourStack) -> Option<Files> {
    let [nx, ny] = stack.dims;
    if n.chance(0.4) {
        return Some(("stack".into(), folder(stack)));
    }
    // Slices of a label volume are its layers; those between are empty.
    if stack.slices.iter().any(|s| s.content.is_empty()) {
        return None;
    }
    let every = n.whole(1, 4);
    let count = every * (stack.slices.len() - 1) + 1 + n.whole(0, 3);
    let label = n.whole(1, 9) as u8;
    let mut voxels = vec![0u8; nx * ny * count];
    for (k, slice) in stack.slices.iter().enumerate() {
        let sides = slice.content.sides();
        sides.iter().enumerate().filter(|(_, m)| **m).for_each(|(p, _)| voxels[k * every * nx * ny + p] = label);
    }
    let dz = (stack.slices[1].z - stack.slices[0].z) / every as f64;
    let [dx, dy] = stack.spacing;
    let bytes = match n.whole(0, 2) {
        0 => (
            "volume.nrrd",
            [format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: {nx} {ny} {count}\nencoding: raw\nspacings: {dx} {dy} {dz}\n\n").into_bytes(), voxels]
                .concat(),
        ),
        1 => (
            "volume.mha",
            [
                format!(
                    "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nDimSize = {nx} {ny} {count}\n\
                     ElementSpacing = {dx} {dy} {dz}\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
                )
                .into_bytes(),
                voxels,
            ]
            .concat(),
        ),
        _ => ("volume.npy", npy([count, ny, nx], &voxels)),
    };
    Some((bytes.0.into(), vec![(bytes.0.into(), bytes.1)]))
}

/// A NumPy array of bytes, last axis fastest.
fn npy([nz, ny, nx]: [usize; 3], data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({nz}, {ny}, {nx}), }}");
    // Magic, version and length take ten bytes; the header ends on a multiple of 64.
    header += &" ".repeat((64 - (10 + header.len() + 1) % 64) % 64);
    header.push('\n');
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
}

/// A folder with stack.json and PNGs: masks, or grey levels.
fn folder(stack: &ContourStack) -> Vec<(String, Vec<u8>)> {
    let [nx, ny] = stack.dims;
    let mut files = Vec::new();
    let mut slices = Vec::new();
    for (k, slice) in stack.slices.iter().enumerate() {
        let grey = |p: usize| match &slice.content {
            SliceContent::Mask(mask) => 255 * u8::from(mask.at(p)),
            SliceContent::Level(level) => 255 * u8::from(level.sides().at(p)),
        };
        let image = GrayImage::from_fn(nx as u32, ny as u32, |x, y| image::Luma([grey(y as usize * nx + x as usize)]));
        let mut png = std::io::Cursor::new(Vec::new());
        if image.write_to(&mut png, image::ImageFormat::Png).is_ok() {
            files.push((format!("stack/s{k:03}.png"), png.into_inner()));
        }
        slices.push(json!({"file": format!("s{k:03}.png"), "z": slice.z}));
    }
    let text = json!({"spacing_xy": stack.spacing, "unit": "mm", "slices": slices});
    files.push(("stack/stack.json".into(), text.to_string().into_bytes()));
    files
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
