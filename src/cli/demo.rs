//! `interslice demo`.

use std::fs;
use std::path::{Path, PathBuf};

use interslice::evaluate::demo::{Demo, NAMES, demo};
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::{JobOptions, Loaded};
use interslice::stack::SliceContent;
use interslice::{Error, Result};
use serde_json::json;

use super::devices::DeviceOptions;
use super::session::{Telling, reconstruct};

#[derive(Debug, clap::Args)]
pub struct DemoArguments {
    /// Stack to make: the figure of the paper it stands for (the bodies of 1, 7, 8 and 9 are ours)
    #[arg(default_value = "all", value_parser = ["fig1", "fig5", "fig6", "fig7", "fig8", "fig9", "fig10", "all"])]
    name: String,

    /// Folder to write to; each stack gets a folder of its own in it
    #[arg(short, long = "output", value_name = "FOLDER")]
    output: PathBuf,

    #[command(flatten)]
    device: DeviceOptions,
}

pub fn run(arguments: &DemoArguments) -> Result<()> {
    for name in NAMES.iter().filter(|n| arguments.name == "all" || arguments.name == **n) {
        let Some(demo) = demo(name) else { continue };
        let folder = arguments.output.join(name);
        tell!("{}: {}", demo.name, demo.shows);
        write_stack(&folder, &demo)?;
        let files = ["surface.stl", "volume.nrrd", "picture.png"].map(|f| folder.join(f));
        let mut places = Places::default();
        let outputs = Outputs::open(&files, Some(&folder.join("report.json")), Temporary::Random, &mut places)?;
        let output = OutputOptions { contours: true, ..OutputOptions::default() };
        let options = JobOptions { settings: demo.settings, output, ..JobOptions::default() };
        reconstruct(&Loaded::new(demo.stack, options)?, outputs, &arguments.device, Telling::Normal)?;
    }
    Ok(())
}

/// The stack as a user would have it: stack.json and a PNG per slice.
fn write_stack(folder: &Path, demo: &Demo) -> Result<()> {
    let output = |path: &Path, message: String| Error::Output { path: path.into(), message };
    fs::create_dir_all(folder).map_err(|e| output(folder, e.to_string()))?;
    let stack = &demo.stack;
    for slice in &stack.slices {
        let SliceContent::Mask(mask) = &slice.content else { continue };
        let [nx, ny] = stack.dims.map(|n| n as u32);
        let image = image::GrayImage::from_fn(nx, ny, |x, y| {
            image::Luma([if mask.at((y * nx + x) as usize) { 255 } else { 0 }])
        });
        let path = folder.join(&slice.name);
        image.save(&path).map_err(|e| output(&path, e.to_string()))?;
    }
    let slices: Vec<_> = stack.slices.iter().map(|s| json!({"file": s.name, "z": s.z})).collect();
    let text = json!({
        "spacing_xy": stack.spacing,
        "unit": stack.unit,
        "slices": slices,
        "z_out": stack.z_out,
        "outside": "black",
    });
    let path = folder.join("stack.json");
    fs::write(&path, format!("{text:#}\n")).map_err(|e| output(&path, e.to_string()))
}
