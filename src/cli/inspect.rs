//! `interslice inspect`.

use std::path::PathBuf;

use interslice::components::{Components, label4, label8};
use interslice::stack::{self, ReadOptions, Slice};
use interslice::{ContourStack, Result, Settings, height_grid, memory};

#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Folder with stack.json, or a .nrrd, .nii, .nii.gz label volume
    input: PathBuf,

    #[command(flatten)]
    read: ReadOptions,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let stack = stack::read(&arguments.input, &arguments.read)?;
    print!("{}", describe(&stack)?);
    Ok(())
}

/// A number without the tail that binary fractions leave.
fn short(v: f64) -> f64 {
    format!("{v:.9}").parse().unwrap_or(v)
}

/// What a colleague would say about the stack.
fn describe(stack: &ContourStack) -> Result<String> {
    let unit = &stack.unit;
    let mut lines = Vec::new();
    let (first, last) = (&stack.slices[0], &stack.slices[stack.slices.len() - 1]);
    let extra = stack.slices.iter().filter(|s| s.extra).count();
    let kind = match first.content {
        stack::SliceContent::Mask(_) => "masks",
        stack::SliceContent::Level(_) => "grey slices, cut at their level",
    };
    lines.push(format!(
        "{} slices ({kind}{}), {} x {} px of {} x {} {unit}",
        stack.slices.len(),
        if extra > 0 { format!(", {extra} of them extra contours") } else { String::new() },
        stack.dims[0],
        stack.dims[1],
        short(stack.spacing[0]),
        short(stack.spacing[1])
    ));
    let gaps: Vec<f64> = stack.slices.windows(2).map(|w| w[1].z - w[0].z).collect();
    let (low, high) = gaps.iter().fold((f64::INFINITY, 0.0f64), |(a, b), g| (a.min(*g), b.max(*g)));
    let spread = if high - low <= 1e-6 * high {
        format!("{} apart", short(low))
    } else {
        format!("{} to {} apart", short(low), short(high))
    };
    lines.push(format!("heights {} to {} {unit}, {spread}", short(first.z), short(last.z)));
    let heights = height_grid(stack, &Settings::default(), None);
    let from = if stack.z_out.is_some() { "from the input" } else { "as fine as the pixels" };
    lines.push(format!(
        "output heights {} + k {}, {} of them ({from})",
        short(heights.start),
        short(heights.step),
        heights.count
    ));
    let needed = memory::estimate_bytes(stack, &heights.heights()?, &Settings::default(), rayon::current_num_threads());
    lines.push(format!("a reconstruction needs about {} MiB of memory", needed.div_ceil(1 << 20)));
    lines.push(String::new());
    let seen: Vec<Seen> = stack.slices.iter().map(|s| Seen::of(s, stack.dims)).collect();
    for (k, slice) in stack.slices.iter().enumerate() {
        lines.push(seen[k].line(k, slice, stack.dims));
        if let Some(next) = seen_next(&seen, k, &stack.slices) {
            lines.extend(next);
        }
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
        let inside: Vec<bool> = (0..nx * ny).map(|n| slice.content.inside(n)).collect();
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

fn counted(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// What overlaps what between slice `k` and the next, where it is more than one part on one part.
fn seen_next(seen: &[Seen], k: usize, slices: &[Slice]) -> Option<Vec<String>> {
    let (low, high) = (seen.get(k)?, seen.get(k + 1)?);
    let mut pairs: Vec<(u32, u32)> = low
        .solids
        .labels
        .iter()
        .zip(&high.solids.labels)
        .filter(|(a, b)| **a > 0 && **b > 0)
        .map(|(a, b)| (*a, *b))
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    if low.solids.count == 1 && high.solids.count == 1 && pairs.len() == 1 {
        return None;
    }
    let mut lines = Vec::new();
    if !pairs.is_empty() {
        let text: Vec<String> = pairs.iter().map(|(a, b)| format!("{a}-{b}")).collect();
        lines.push(format!("    parts that overlap: {}", text.join(" ")));
    }
    let alone = |count: usize, has: &dyn Fn(u32) -> bool| -> Vec<String> {
        (1..=count as u32).filter(|p| !has(*p)).map(|p| p.to_string()).collect()
    };
    for (parts, place, name) in [
        (alone(low.solids.count, &|p| pairs.iter().any(|(a, _)| *a == p)), "above", &slices[k].name),
        (alone(high.solids.count, &|p| pairs.iter().any(|(_, b)| *b == p)), "below", &slices[k + 1].name),
    ] {
        if !parts.is_empty() {
            lines.push(format!("    no partner {place}, closes half way: {} of `{name}`", parts.join(" ")));
        }
    }
    Some(lines)
}
