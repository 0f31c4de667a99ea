//! Labels drawn on some slices of a volume are filled in on all: `cargo run --release --example labels_to_labels in.nii.gz out.nii.gz`.

use std::path::{Path, PathBuf};

use interslice::{Budget, LabelsReport, Means, Reference, Result, Settings, Silent, Wanted, fill_labels};

/// Fills all labels of `input` into `output`.
pub fn run(input: &Path, output: PathBuf) -> Result<LabelsReport> {
    let means = Means { backend: &Reference, progress: &Silent, budget: &Budget::unlimited() };
    fill_labels(input, &[output], &Wanted::All, &Settings::default(), &means)
}

#[allow(dead_code, reason = "a test calls `run`")]
fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (Some(input), Some(output)) = (arguments.next(), arguments.next()) else {
        println!("usage: labels_to_labels INPUT OUTPUT");
        return Ok(());
    };
    let report = run(Path::new(&input), output.into())?;
    for label in &report.labels {
        println!("label {}: {} voxels", label.label, label.voxels.unwrap_or(0));
    }
    Ok(())
}
