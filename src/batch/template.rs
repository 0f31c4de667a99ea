//! A manifest from a folder of cases.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Map;

use super::line::ManifestLine;
use crate::error::{Error, Result};
use crate::files::format::check_extension;
use crate::input;
use crate::input::format::{InputFormat, expected};
use crate::labels::given::listed;
#[cfg(feature = "dicom")]
use crate::rtstruct::StructureSet;
#[cfg(feature = "dicom")]
use crate::stack::ReadOptions;

/// Choices for a template.
#[derive(Debug, Clone)]
pub struct Template {
    /// Extensions of the outputs, without dot.
    pub extensions: Vec<String>,
    /// Folder of the outputs, as the manifest will name it.
    pub output: String,
    /// A line for each label of a label volume.
    pub each_label: bool,
}

/// A manifest's lines, and what is none of its cases.
#[derive(Debug, Default)]
pub struct Templated {
    /// Lines.
    pub lines: Vec<ManifestLine>,
    /// Cases that cannot be read, and ROIs and labels that cannot be reconstructed, and why.
    pub left_out: Vec<String>,
}

/// A line per case in `folder`, in the order of their names: a sub-folder with stack.json, a volume, or a label or ROI that can be
/// reconstructed. Inputs are named from `base` where they lie in it. Cases whose labels or ROIs cannot be read are left
/// out: among them folders of images, which may lie beside the structure set that was drawn on them.
///
/// # Errors
/// [`Error::Setting`] for an extension that no output has; [`Error::Read`]; [`Error::Format`] for a folder without cases.
pub fn template(folder: &Path, base: &Path, template: &Template) -> Result<Templated> {
    for extension in &template.extensions {
        check_extension(extension).map_err(|message| Error::Setting {
            name: "ext".into(),
            message: format!("has `{extension}`: {message}"),
        })?;
    }
    let unreadable = |source| Error::Read { path: folder.into(), source };
    let entries: std::io::Result<Vec<PathBuf>> =
        fs::read_dir(folder).map_err(unreadable)?.map(|entry| Ok(entry?.path())).collect();
    let mut cases = entries.map_err(unreadable)?;
    cases.retain(|path| stem(path).is_some());
    cases.sort();
    if cases.is_empty() {
        let message = format!("has no cases: expected {}", expected());
        return Err(Error::Format { path: folder.into(), message });
    }
    let mut used = HashSet::new();
    let Templated { mut lines, mut left_out } = Templated::default();
    for path in cases {
        let full = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let short = stem(&path).unwrap_or_default();
        // `a` and `a.nrrd` side by side.
        let name = if used.insert(short.clone()) { short } else { full };
        let line = |id: String, options| ManifestLine {
            outputs: template.extensions.iter().map(|e| format!("{}/{id}.{e}", template.output)).collect(),
            id,
            input: from(&path, base),
            options,
        };
        let (option, numbers) = if input::is_structure_set(&path) {
            let mut leave_out = |why: String| left_out.push(format!("{name}: {why}"));
            ("roi", rois(&path, &mut leave_out))
        } else if template.each_label && path.is_file() && !input::is_map(&path) {
            (
                "label",
                labels(&path).map(|(numbers, why)| {
                    left_out.extend(why.map(|why| format!("{name}: {why}: left out")));
                    numbers
                }),
            )
        } else {
            lines.push(line(name, Map::new()));
            continue;
        };
        let numbers = match numbers {
            Ok(numbers) => numbers,
            Err(e) => {
                left_out.push(format!("{e}: left out"));
                continue;
            }
        };
        let each = |n: i64| line(format!("{name}-{n}"), [(option.into(), n.into())].into_iter().collect());
        lines.extend(numbers.into_iter().map(each));
    }
    if lines.is_empty() {
        let mut message = "has no ROI and no label that can be reconstructed".to_string();
        left_out.iter().for_each(|why| message += &format!("; {why}"));
        return Err(Error::Format { path: folder.into(), message });
    }
    Ok(Templated { lines, left_out })
}

/// Name of a case; nothing for what is none.
fn stem(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_string_lossy().into_owned();
    if path.is_dir() {
        return (path.join("stack.json").is_file() || input::is_structure_set(path)).then_some(name);
    }
    let (_, at) = InputFormat::of_name(&name).filter(|(format, _)| format.name != "folder")?;
    Some(name[..at].to_string()).filter(|s| !s.is_empty())
}

/// The labels that can be reconstructed, and words on those that cannot.
fn labels(path: &Path) -> Result<(Vec<i64>, Option<String>)> {
    let [several, one] = input::labels(path)?;
    let why = match (&several[..], &one[..]) {
        (_, [_, ..]) => Some(format!("{} drawn on one slice", listed(&one))),
        ([], []) => Some("has no label".into()),
        _ => None,
    };
    Ok((several, why))
}

/// Numbers of the ROIs that can be reconstructed; `leave_out` hears of each other one, and why.
#[cfg(feature = "dicom")]
fn rois(path: &Path, leave_out: &mut dyn FnMut(String)) -> Result<Vec<i64>> {
    let set = StructureSet::choose_file(path, None)?;
    Ok(set.usable(&ReadOptions::default(), leave_out).into_iter().map(|roi| roi.number).collect())
}

#[cfg(not(feature = "dicom"))]
fn rois(path: &Path, _leave_out: &mut dyn FnMut(String)) -> Result<Vec<i64>> {
    let message = "is DICOM, which this program was built without (feature `dicom`)".into();
    Err(Error::Format { path: path.into(), message })
}

/// `path` as named from `base`, with `/`.
fn from(path: &Path, base: &Path) -> String {
    let absolute = |p: &Path| p.canonicalize().unwrap_or_else(|_| p.into());
    let (path, base) = (absolute(path), absolute(base));
    let parts = |p: &Path| -> Vec<String> { p.iter().map(|c| c.to_string_lossy().into_owned()).collect() };
    match path.strip_prefix(&base) {
        Ok(inside) => parts(inside).join("/"),
        Err(_) => path.display().to_string(),
    }
}
