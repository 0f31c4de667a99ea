//! The bodies of an input that holds several, one by one: labels of a volume, ROIs of an RTSTRUCT.

use std::path::Path;

use interslice::Result;
use interslice::input::labels::{Wanted, read_whole_labels};
#[cfg(feature = "dicom")]
use interslice::rtstruct::{Roi, StructureSet};
use interslice::stack::ReadOptions;
use interslice::stack::options::LabelName;
#[cfg(feature = "dicom")]
use interslice::stack::options::RoiName;

/// Options that ask for several bodies, each by itself.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Input")]
pub struct MemberOptions {
    /// Label volumes, and folders of label images: these labels, by number or name, or all, each by itself
    #[arg(long, value_name = "all|N,NAME,..", allow_hyphen_values = true, conflicts_with = "label")]
    labels: Option<Wanted>,

    /// RTSTRUCT: every closed ROI, each by itself
    #[cfg(feature = "dicom")]
    #[arg(long, conflicts_with_all = ["roi", "slices", "labels"])]
    all_rois: bool,
}

/// One body.
pub struct Member {
    /// "label 5 (`liver`)", "ROI 3 (`Heart`)".
    pub name: String,
    /// The option that reads it alone, as it is typed.
    pub option: String,
    /// Options that read it alone.
    pub read: ReadOptions,
}

impl MemberOptions {
    /// The bodies that are asked for, and what is said of those that are left out; nothing where one body is.
    ///
    /// # Errors
    /// The errors of reading the input.
    pub fn of(&self, input: &Path, read: &ReadOptions, tell: &dyn Fn(&str)) -> Result<Option<Vec<Member>>> {
        #[cfg(feature = "dicom")]
        if self.all_rois {
            interslice::input::check(input, read)?;
            let set = StructureSet::choose_file(input, read.series.as_deref())?;
            let rois = usable_rois(&set, input, read, tell)?;
            let member = |roi: &&Roi| Member {
                name: roi.label(),
                option: format!("--roi {}{}", if likewise_named(&set, roi) { "number=" } else { "" }, roi.number),
                read: ReadOptions { roi: vec![RoiName::Number(roi.number)], ..read.clone() },
            };
            return Ok(Some(rois.iter().map(member).collect()));
        }
        let Some(wanted) = &self.labels else { return Ok(None) };
        of_labels(input, read, wanted, tell).map(Some)
    }
}

/// Whether another ROI has the number of `roi` as its name.
#[cfg(feature = "dicom")]
fn likewise_named(set: &StructureSet, roi: &Roi) -> bool {
    let number = roi.number.to_string();
    set.rois.iter().any(|other| other.number != roi.number && other.name.trim() == number)
}

/// The labels that are wanted.
///
/// # Errors
/// The errors of [`read_whole_labels`].
pub fn of_labels(input: &Path, read: &ReadOptions, wanted: &Wanted, tell: &dyn Fn(&str)) -> Result<Vec<Member>> {
    let stack = read_whole_labels(input, read, wanted)?;
    stack.left_out.iter().for_each(|label| tell(&label.to_string()));
    let member = |(label, appearance): (&i64, &interslice::stack::appearance::Appearance)| Member {
        name: appearance.name.as_ref().map_or(format!("label {label}"), |name| format!("label {label} (`{name}`)")),
        option: format!("--label {label}"),
        read: ReadOptions { label: Some(LabelName::Number(*label)), complete_slices: false, ..read.clone() },
    };
    Ok(stack.labels.iter().zip(&stack.appearances).map(member).collect())
}

/// The ROIs of a structure set that can be reconstructed; the others are told of.
///
/// # Errors
/// [`interslice::Error::Format`] where there is none.
#[cfg(feature = "dicom")]
pub fn usable_rois<'s>(
    set: &'s StructureSet,
    input: &Path,
    read: &ReadOptions,
    tell: &dyn Fn(&str),
) -> Result<Vec<&'s Roi>> {
    let rois = set.usable(read, &mut |why| tell(&why));
    if rois.is_empty() {
        let message = "none of its ROIs can be reconstructed".into();
        return Err(interslice::Error::Format { path: input.into(), message });
    }
    Ok(rois)
}
