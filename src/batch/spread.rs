//! Lines of a manifest that ask for all ROIs, or for several labels as they are alone: a job for each, with files of its own.

use std::path::Path;

use serde_json::{Map, Value};
use toml::Table;

use super::line::ManifestLine;
use crate::files::member_names::with_word;
use crate::files::named::Named;
use crate::input::labels::{Wanted, read_whole_labels};
use crate::stack::ReadOptions;

/// What a line asks for.
#[derive(Debug, Default)]
pub struct Spread {
    /// A line for each body.
    pub lines: Vec<ManifestLine>,
    /// Bodies of `all` that cannot be reconstructed, and why.
    pub left_out: Vec<String>,
}

type Lines = std::result::Result<Spread, String>;

/// Options that make of a line others.
pub const SPREADING: [&str; 3] = ["all_rois", "keep_overlaps", "labels"];

/// The line itself, or one for each body that it asks for.
///
/// # Errors
/// A message with the option, or what is wrong with the input.
pub fn spread(mut line: ManifestLine, folder: &Path) -> Lines {
    let flag = |options: &mut Map<String, Value>, name: &str| match options.remove(name) {
        None => Ok(false),
        Some(Value::Bool(on)) => Ok(on),
        Some(other) => Err(format!("options: `{name}` must be true or false; got {other}")),
    };
    let all_rois = flag(&mut line.options, "all_rois")?;
    let alone = flag(&mut line.options, "keep_overlaps")?;
    let labels = line.options.remove("labels");
    for (asked, options) in
        [(all_rois, ["roi", "slices", "labels"]), (labels.is_some(), ["label", "links", "all_rois"])]
    {
        let name = if all_rois { "all_rois" } else { "labels" };
        if let Some(other) = options.iter().find(|option| asked && (line.options.contains_key(**option))) {
            return Err(format!("options: `{name}` and `{other}` cannot be used together"));
        }
    }
    match (all_rois, labels, alone) {
        (false, None, false) => Ok(Spread { lines: vec![line], ..Spread::default() }),
        (false, None, true) => Err("options: `keep_overlaps` is for `labels`".into()),
        (true, Some(_), _) => Err("options: `all_rois` and `labels` cannot be used together".into()),
        (true, None, false) => rois(&line, folder),
        (true, None, true) => Err("options: `keep_overlaps` is for `labels`".into()),
        (false, Some(_), false) => Err(
            "options: `labels` makes a job for each label as it is alone: add `keep_overlaps` = true. One volume in which labels share their borders \
             is made by `interslice reconstruct --labels`"
                .into(),
        ),
        (false, Some(labels), true) => each_label(&line, folder, &labels),
    }
}

/// Options of reading, as far as they are sound: what is not is told when the job's line is checked.
fn reading(line: &ManifestLine) -> ReadOptions {
    let mut table = Table::new();
    for (key, value) in &line.options {
        if let Ok(value) = toml::Value::try_from(value) {
            table.insert(key.clone(), value);
        }
    }
    Named::new(table).claim(ReadOptions::default(), |_| false).0
}

fn each_label(line: &ManifestLine, folder: &Path, labels: &Value) -> Lines {
    let text = |value: &Value| match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    let wanted = match labels {
        // A name in a list may have a comma.
        Value::Array(list) => Wanted::these(list.iter().map(text).collect::<Vec<_>>().iter().map(String::as_str)),
        one => text(one).parse(),
    };
    let wanted = wanted.map_err(|e| format!("options: `labels`: {e}"))?;
    let read =
        read_whole_labels(&folder.join(&line.input), &reading(line), &wanted).map_err(|e| format!("input: {e}"))?;
    Ok(Spread {
        lines: read.labels.iter().map(|label| member(line, &label.to_string(), "label", *label)).collect(),
        left_out: read.left_out.iter().map(ToString::to_string).collect(),
    })
}

#[cfg(feature = "dicom")]
fn rois(line: &ManifestLine, folder: &Path) -> Lines {
    use crate::files::member_names::words;
    use crate::rtstruct::StructureSet;

    let (input, read) = (folder.join(&line.input), reading(line));
    let wrong = |e: crate::Error| format!("input: {e}");
    crate::input::check(&input, &read).map_err(wrong)?;
    if !crate::input::is_structure_set(&input) {
        return Err("options: `all_rois` is not for anything but an RTSTRUCT".into());
    }
    let set = StructureSet::choose_file(&input, read.series.as_deref()).map_err(wrong)?;
    let mut left_out = Vec::new();
    let rois = set.usable(&read, &mut |why| left_out.push(why));
    if rois.is_empty() {
        return Err(format!("input: {}: none of its ROIs can be reconstructed", input.display()));
    }
    let words = words(rois.iter().map(|roi| (roi.name.as_str(), roi.number)));
    let lines = words.iter().zip(&rois).map(|(word, roi)| member(line, word, "roi", roi.number)).collect();
    Ok(Spread { lines, left_out })
}

#[cfg(not(feature = "dicom"))]
fn rois(_: &ManifestLine, _: &Path) -> Lines {
    Err("options: `all_rois` is for DICOM, which this program was built without (feature `dicom`)".into())
}

/// The line of one body: its word in the id and before the extension of each output.
fn member(line: &ManifestLine, word: &str, option: &str, number: i64) -> ManifestLine {
    let mut options = line.options.clone();
    options.insert(option.into(), number.into());
    ManifestLine {
        id: format!("{}-{word}", line.id),
        input: line.input.clone(),
        outputs: line.outputs.iter().map(|o| with_word(Path::new(o), word).to_string_lossy().into_owned()).collect(),
        options,
    }
}
