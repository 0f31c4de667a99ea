//! `interslice inspect`.

use std::path::PathBuf;

use interslice::estimate::memory::MemoryNeeds;
use interslice::estimate::runtime::Effort;
use interslice::grid::components::{Components, label4, label8};
use interslice::input::labels::{Wanted, labels_of_volume, read_labels};
use interslice::input::{self, Input};
use interslice::labels::LabelStack;
#[cfg(feature = "dicom")]
use interslice::polygons::grid::too_large;
#[cfg(feature = "dicom")]
use interslice::polygons::pixel::chosen_pixel;
use interslice::settings::Link;
use interslice::stack::links::LinkOptions;
use interslice::stack::{ReadOptions, Slice};
use interslice::surface::contour_lines::AlongAxes;
use interslice::{ContourStack, Result, Settings, height_grid};

use super::forecast::{requirements, shape};
use super::links::between;
use super::members::of_labels as of_labels_alone;
use super::say::{length, say, short};
use super::volume;

#[derive(Debug, clap::Args)]
pub struct InspectArguments {
    #[arg(help = input::format::help())]
    input: PathBuf,

    /// RTSTRUCT: list all ROIs, as without --roi where there are several
    #[cfg(feature = "dicom")]
    #[arg(long, conflicts_with = "roi", help_heading = "Input")]
    all_rois: bool,

    /// Label volumes, and folders of label images: describe these labels, by number or name, or all, one behind the other
    #[arg(long, value_name = "all|N,NAME,..", allow_hyphen_values = true, conflicts_with_all = ["label", "links"], help_heading = "Input")]
    labels: Option<Wanted>,

    #[command(flatten)]
    read: ReadOptions,

    #[command(flatten)]
    links: LinkOptions,
}

pub fn run(arguments: &InspectArguments) -> Result<()> {
    say(&described(arguments)?)
}

/// The description of an input read with these options.
///
/// # Errors
/// Those of reading.
pub fn words(input: PathBuf, read: ReadOptions) -> Result<String> {
    described(&InspectArguments {
        input,
        #[cfg(feature = "dicom")]
        all_rois: false,
        labels: None,
        read,
        links: LinkOptions::default(),
    })
}

/// The description of a volume that was read with these options.
///
/// # Errors
/// As [`words`].
pub fn of_input(input: &Input, read: &ReadOptions) -> Result<String> {
    let labels = input
        .surveyed
        .as_ref()
        .map(|s| of_labels(read, input, || labels_of_volume(s.volume.clone(), read, &Wanted::All)));
    of_volume(input, read, labels.unwrap_or_default(), &[])
}

/// The description of a stack that no file holds.
///
/// # Errors
/// Too many output heights.
pub fn of_stack(stack: &ContourStack) -> Result<String> {
    Ok(told(stack.doubts()) + &describe(stack, &[], None)?)
}

fn described(arguments: &InspectArguments) -> Result<String> {
    #[cfg(feature = "dicom")]
    if interslice::input::is_structure_set(&arguments.input) {
        return structures(arguments);
    }
    #[cfg(feature = "terrain")]
    if interslice::input::is_map(&arguments.input) {
        return contour_map(arguments);
    }
    if let Some(wanted) = &arguments.labels {
        return each_label(arguments, wanted);
    }
    let input = Input::read(&arguments.input, &arguments.read)?;
    let labels = of_labels(&arguments.read, &input, || read_labels(&arguments.input, &arguments.read, &Wanted::All));
    let links = arguments.links.read(&input.stack)?;
    of_volume(&input, &arguments.read, labels, &links)
}

fn of_volume(input: &Input, read: &ReadOptions, of_labels: Vec<String>, links: &[Link]) -> Result<String> {
    let mut doubts = input.doubts(read);
    doubts.extend(of_labels.into_iter().filter(|doubt| !doubts.contains(doubt)).collect::<Vec<_>>());
    let doubts = told(doubts);
    let lines = input.surveyed.iter().flat_map(volume::describe).chain(input.chosen.clone());
    Ok(lines.fold(String::new(), |text, line| text + &line + "\n") + &doubts + &describe(&input.stack, links, None)?)
}

/// Descriptions of labels, each by itself.
fn each_label(arguments: &InspectArguments, wanted: &Wanted) -> Result<String> {
    let left_out = |message: &str| tell!("warning: {message}");
    let labels = of_labels_alone(&arguments.input, &arguments.read, wanted, &left_out)?;
    // What is said of the file is said of all that is painted in it, whatever is wanted.
    let file = Input::of_labels(&arguments.input, &ReadOptions { complete_slices: false, ..arguments.read.clone() })?;
    let mut text: String = file.surveyed.iter().flat_map(volume::describe).map(|line| line + "\n").collect();
    for member in &labels {
        let input = Input::read(&arguments.input, &member.read)?;
        let doubts = told(input.doubts(&member.read));
        text += &format!("\n{}\n{doubts}{}", member.name, describe(&input.stack, &[], None)?);
    }
    Ok(text)
}

/// Notes on the labels, where there are several.
fn of_labels(options: &ReadOptions, input: &Input, read: impl FnOnce() -> Result<LabelStack>) -> Vec<String> {
    let several = input.surveyed.as_ref().is_some_and(|s| s.survey.labels.len() > 1 || s.volume.layers() > 1);
    if !several || options.label.is_some() || options.level.is_some() {
        return Vec::new();
    }
    // What stops all labels does not stop the one body that is described here.
    match read() {
        Ok(labels) => {
            labels.left_out.iter().map(|label| format!("--labels all: {label}")).chain(labels.notes).collect()
        }
        Err(e) => vec![format!("--labels all: {e}")],
    }
}

/// Notes for a person before anything is made of the input.
fn told(doubts: impl IntoIterator<Item = String>) -> String {
    doubts.into_iter().map(|doubt| format!("warning: {doubt}\n")).collect()
}

/// Description of an RTSTRUCT: all ROIs, or the one (or merged ones) that is chosen.
#[cfg(feature = "dicom")]
fn structures(arguments: &InspectArguments) -> Result<String> {
    interslice::input::check(&arguments.input, &arguments.read)?;
    let series = arguments.read.series.as_deref();
    let set = interslice::rtstruct::StructureSet::choose_file(&arguments.input, series)?;
    let left_out = told(set.left_out.iter().cloned());
    let several = set.rois.len() > 1 && arguments.read.roi.is_empty();
    if arguments.all_rois || several {
        return Ok(left_out + &set.describe().join("\n") + "\n");
    }
    let chosen = match set.choose(&arguments.read) {
        Ok(chosen) => chosen,
        // A ROI that cannot be reconstructed can be told of.
        Err(e) => match set.describe_flat(&arguments.read)? {
            Some(lines) => return Ok(left_out + &lines.join("\n") + "\n"),
            None => return Err(e),
        },
    };
    let stack = chosen.stack(&arguments.read)?;
    let links = arguments.links.read(&stack)?;
    let text = describe(&stack, &links, chosen.steps(&stack).map(|s| (s.heights, AS_PIXELS)))?;
    let drawings = chosen.drawings(&arguments.read)?;
    let large = too_large(&drawings, arguments.read.pixel.map(|px| [px; 2]), stack.spacing);
    let unlike = chosen.on_planes_of_others(&arguments.read)?;
    let of_stack = chosen.doubts(&stack, &arguments.read)?;
    let doubts = large.into_iter().chain(chosen.crossing(&drawings)).chain(unlike).chain(of_stack);
    let mut lines = chosen.describe();
    lines.extend(arguments.read.pixel.is_none().then(|| chosen_pixel(&drawings).to_string()));
    Ok(left_out + &lines.join("\n") + "\n" + &told(doubts) + &text)
}

/// Description of a contour map.
#[cfg(feature = "terrain")]
fn contour_map(arguments: &InspectArguments) -> Result<String> {
    interslice::input::check(&arguments.input, &arguments.read)?;
    let terrain = interslice::terrain::Terrain::read(&arguments.input, &arguments.read)?;
    let links = arguments.links.read(&terrain.stack)?;
    let notes = terrain.notes.iter().map(|note| format!("note: {note}"));
    let lines: Vec<String> = terrain.description.iter().cloned().chain(notes).collect();
    let text = describe(
        &terrain.stack,
        &links,
        terrain.step().map(|step| (step, "an eighth of the usual distance of levels")),
    )?;
    let [beyond, _] = terrain.map.first;
    Ok(lines.join("\n") + &format!("\n(the stack goes on {beyond} px beyond the border)\n") + &text)
}

/// Where output heights come from that nobody has asked for.
const AS_PIXELS: &str = "as fine as the pixels";

/// Description of the stack, as a colleague would give it; `step` of its output heights, and where that comes from.
fn describe(stack: &ContourStack, links: &[Link], step: Option<(f64, &str)>) -> Result<String> {
    let mut lines = shape(stack);
    let heights = height_grid(stack, &Settings::default(), step.map(|(dz, _)| dz));
    let from = match (step, stack.z_out) {
        (Some((_, from)), _) => from,
        (None, Some(_)) => "from the input",
        (None, None) => AS_PIXELS,
    };
    lines.push(format!(
        "output heights {} + k {}, {} of them ({from})",
        short(heights.start),
        length(heights.step),
        heights.count
    ));
    let first = AlongAxes::new(&stack.geometry, stack.spacing).height(0.0);
    if first != 0.0 {
        lines.push(format!(
            "heights count from the first slice of the voxels, which lies at {} along its axis",
            short(first)
        ));
    }
    let all = heights.heights()?;
    let needs = MemoryNeeds::of(stack, &all, &Settings::default(), rayon::current_num_threads());
    lines.push(format!("a reconstruction needs {}", requirements(&Effort::of(stack, &all), &needs)));
    lines.push(String::new());
    // Two slices at a time: a stack may be larger than memory.
    let mut below: Option<Seen> = None;
    for (k, slice) in stack.slices.iter().enumerate() {
        let seen = Seen::of(slice, stack.dims);
        if let Some(below) = below {
            lines.extend(between(stack, k - 1, &below.solids, &seen.solids, links));
        }
        lines.push(seen.line(k, slice, stack.dims));
        below = Some(seen);
    }
    lines.push(String::new());
    Ok(lines.join("\n"))
}

/// One slice's parts.
struct Seen {
    solids: Components,
    holes: usize,
    pixels: usize,
    at_border: bool,
}

impl Seen {
    fn of(slice: &Slice, [nx, ny]: [usize; 2]) -> Self {
        let inside = slice.content.sides();
        let outside: Vec<bool> = inside.iter().map(|m| !m).collect();
        let background = label8(&outside, [nx, ny]);
        let border = (0..nx * ny).filter(|n| n % nx == 0 || n % nx == nx - 1 || n / nx == 0 || n / nx == ny - 1);
        let mut open = vec![false; background.count + 1];
        let mut at_border = false;
        for n in border {
            open[background.labels[n] as usize] = true;
            at_border |= inside[n];
        }
        Seen {
            solids: label4(&inside, [nx, ny]),
            holes: (1..=background.count).filter(|k| !open[*k]).count(),
            pixels: inside.iter().filter(|m| **m).count(),
            at_border,
        }
    }

    fn line(&self, k: usize, slice: &Slice, [nx, ny]: [usize; 2]) -> String {
        let mut text = format!("slice {k} (`{}`) at {}: ", slice.name, short(slice.z));
        if self.pixels == 0 {
            text += "empty";
        } else {
            text +=
                &format!("{}, {}, {} px", counted(self.solids.count, "part"), counted(self.holes, "hole"), self.pixels);
            if self.pixels == nx * ny {
                text += ", fills the image";
            } else if self.at_border {
                text += ", touches the image border (closed there)";
            }
        }
        if slice.extra {
            text += ", extra";
        }
        text
    }
}

/// A number of things.
pub(super) fn counted(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}
