//! Which values of grey images are inside: the rule is one for all slices of a stack.

use std::collections::BTreeSet;

use super::grey_image::Grey;
use crate::error::{Error, Result};
use crate::stack::cut::Cut;
use crate::stack::options::{BACKGROUND, LabelName, ReadOptions};
use crate::stack::{LevelSlice, SliceContent};

/// An image without its pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Range {
    /// Pixels along x and y.
    pub dims: [usize; 2],
    /// Bits of a pixel.
    pub bits: u8,
    /// Least and largest value; 0 for both of an image without pixels.
    ends: [u16; 2],
    /// Whether it has others,
    more: bool,
    /// those, if they are few, and
    between: BTreeSet<u16>,
    /// how many pixels have them, and how many of these have the same to the right.
    plateau: [usize; 2],
    /// Neighbours of different values in a row, and those of them whose values are far from each other.
    steps: [usize; 2],
    /// Pixels by the upper eight bits of their values,
    bins: Vec<u32>,
    /// and those that have the least and the largest value.
    at_ends: [usize; 2],
}

/// Most values between the least and the largest that are told apart: a slice that was smoothed has more.
const FEW: usize = 16;
/// Share of the range of a slice's values by which neighbours differ from which on they are far from each other: beyond it a field is not smooth.
const FAR: u16 = 64;
/// Of so many pixels that do not have the value of an end at least one lies on the other side of a level that means something: smoothed masks have a tenth
/// and more there. A single hot pixel draws the range up, and half of it is nowhere near the body.
const RARE: usize = 1000;
/// Share of the pixels of a picture that have neither their slice's least nor its largest value.
const PICTURE: f64 = 0.5;
/// Bits of a value that its bin has.
const BIN_BITS: u8 = 8;

impl Range {
    /// Whether it has more values than are told apart.
    fn many(&self) -> bool {
        self.between.len() > FEW
    }

    /// The values of an image.
    pub fn of(image: &Grey) -> Self {
        let values = || image.values.iter().copied();
        let ends = [values().min(), values().max()].map(Option::unwrap_or_default);
        let (mut between, mut plateau, mut steps) = (BTreeSet::new(), [0; 2], [0; 2]);
        let far = (ends[1] - ends[0]) / FAR;
        for row in image.values.chunks(image.dims[0].max(1)) {
            for [a, b] in row.array_windows().filter(|[a, b]| a != b) {
                steps = [steps[0] + 1, steps[1] + usize::from(a.abs_diff(*b) > far)];
            }
            for (i, v) in row.iter().enumerate().filter(|(_, v)| !ends.contains(v)) {
                if between.len() <= FEW {
                    between.insert(*v);
                }
                plateau = [plateau[0] + 1, plateau[1] + usize::from(row.get(i + 1) == Some(v))];
            }
        }
        let mut bins = vec![0; 1 << BIN_BITS];
        values().for_each(|v| bins[bin(v, image.bits)] += 1);
        let at_ends = ends.map(|end| values().filter(|v| *v == end).count());
        Range {
            dims: image.dims,
            bits: image.bits,
            ends,
            more: !between.is_empty(),
            between,
            plateau,
            steps,
            bins,
            at_ends,
        }
    }

    /// Pixels whose bin is that of a level or one above it, or one below it.
    fn beside(&self, level: f64) -> [usize; 2] {
        let own = bin(level as u16, self.bits);
        let sum = |bins: &[u32]| bins.iter().map(|n| *n as usize).sum();
        [sum(&self.bins[own..]), sum(&self.bins[..=own])]
    }

    /// Pixels that do not have a value of the whole stack.
    fn without(&self, value: u16) -> usize {
        let have = self.ends.iter().position(|end| *end == value).map_or(0, |end| self.at_ends[end]);
        self.pixels() - have
    }

    fn pixels(&self) -> usize {
        self.dims[0] * self.dims[1]
    }
}

/// Bin of a value of so many bits.
fn bin(value: u16, bits: u8) -> usize {
    usize::from(value >> bits.saturating_sub(BIN_BITS)).min((1 << BIN_BITS) - 1)
}

/// Inside of a slice: of two values in the whole stack the larger one; of more, or with a given level, what is above it, to parts of a pixel; with
/// a given label what has its value. Inverted, the smaller one, or what is below.
pub enum Rule {
    /// This value and larger ones.
    Least(u16),
    /// Values smaller than this.
    Under(u16),
    /// This value.
    Only(u16),
    /// Values on one side of a level, with sub-pixel contours.
    Cut(Cut),
}

impl Rule {
    /// The rule for images of these values.
    ///
    /// # Errors
    /// [`Error::Stack`] without images; [`Error::Setting`] for a level or a label that they do not have.
    pub fn new(ranges: &[Range], options: &ReadOptions) -> Result<Self> {
        let invert = options.invert;
        let ends = || ranges.iter().flat_map(|r| r.ends);
        if let Some(label) = &options.label {
            return Self::only(ranges, label);
        }
        let (Some(low), Some(high)) = (ends().min(), ends().max()) else {
            return Err(Error::Stack(format!("at least 2 slices are needed; got {}", ranges.len())));
        };
        let range = [low, high].map(f64::from);
        let named = options.cut();
        named.map_or(Ok(()), |cut| cut.check(range, "the slices' values"))?;
        let two = ranges.iter().all(|r| !r.more) && ends().all(|v| v == low || v == high);
        Ok(match named {
            None if two && invert => Rule::Under(high.max(1)),
            None if two => Rule::Least(high.max(1)),
            _ => Rule::Cut(named.unwrap_or(Cut { level: (range[0] + range[1]) / 2.0, below: invert })),
        })
    }

    /// The value that a label has.
    fn only(ranges: &[Range], label: &LabelName) -> Result<Self> {
        let fail = |message: String| Err(Error::Setting { name: "label".into(), message });
        let LabelName::Number(number) = label else {
            return fail(
                "is the value of the pixels in a folder of images, a number: images have no names for it".into(),
            );
        };
        let has = |value: u16| ranges.iter().any(|r| r.ends.contains(&value) || r.between.contains(&value) || r.many());
        match u16::try_from(*number) {
            Ok(0) => fail(BACKGROUND.into()),
            Ok(value) if has(value) => Ok(Rule::Only(value)),
            _ => fail(format!("must be a value of the pixels ({}); got {number}", values(ranges))),
        }
    }

    /// Message where a level that nobody named cuts values that lie side by side, as labels do: a few, or many that leap from one to the next. Those that a
    /// smooth brush leaves along a contour differ from pixel to pixel, and those of a smooth field hardly.
    pub fn doubt(&self, ranges: &[Range], named: Option<f64>) -> Option<String> {
        let (Rule::Cut(Cut { level, below }), None) = (self, named) else { return None };
        let sum = |of: fn(&Range) -> [usize; 2]| ranges.iter().map(of).fold([0; 2], |[a, b], [c, d]| [a + c, b + d]);
        let ([pixels, alike], [steps, far]) = (sum(|r| r.plateau), sum(|r| r.steps));
        // A slice of one value has no others; where slices have different ones all are plateaus.
        let smooth = pixels > 0 && 2 * alike < pixels;
        let count = distinct(ranges).len();
        let many = count > FEW;
        if smooth || many && 2 * far < steps {
            return None;
        }
        let (has, which) = match many {
            true => (
                format!("more than {FEW} values"),
                "many neighbours the same, as of labels: which of them is the body, or all",
            ),
            false => (format!("{count} values"), "which of them is the body"),
        };
        let labels =
            "`--label N` takes those of one value, `--labels all` all, each by itself, of images without stack.json";
        let how = match below {
            true => format!(
                "`--level V` names the value below which they are inside ({level} is half way); without --invert {labels}"
            ),
            false => format!("{labels}, and `--level V` what is above a value ({level} is half way)"),
        };
        Some(format!("slices have {has}, {}: {which}? {how}", values(ranges)))
    }

    /// Message where hardly a pixel lies on one side of a level that nobody named: a few of extreme values have drawn the range there.
    pub fn misses(&self, ranges: &[Range], named: Option<f64>) -> Option<String> {
        let (Rule::Cut(Cut { level, .. }), None) = (self, named) else { return None };
        let ends = || ranges.iter().flat_map(|r| r.ends);
        let (low, high) = (ends().min()?, ends().max()?);
        let [above, below] = ranges.iter().map(|r| r.beside(*level)).fold([0; 2], |[a, b], [c, d]| [a + c, b + d]);
        let [over, under] = [low, high].map(|end| ranges.iter().map(|r| r.without(end)).sum::<usize>());
        let said = |few: usize, side: &str, all: usize, than: &str| {
            format!(
                "slices have values from {low} to {high}, and of {all} pixels with {than} {few} lie {side} half way ({level}): --level V must name what bounds \
                 the body"
            )
        };
        if above.saturating_mul(RARE) < over {
            Some(said(above, "above", over, "more than the least"))
        } else if below.saturating_mul(RARE) < under {
            Some(said(below, "below", under, "less than the largest"))
        } else {
            None
        }
    }

    /// Word on a level that nobody named, of a picture: of a smoothed mask nearly all pixels have the least or the largest value, and any level is as good.
    pub fn told(&self, ranges: &[Range], named: Option<f64>) -> Option<String> {
        let (Rule::Cut(cut), None) = (self, named) else { return None };
        let all: usize = ranges.iter().map(Range::pixels).sum();
        let between: usize = ranges.iter().map(|r| r.plateau[0]).sum();
        let picture = between as f64 > PICTURE * all as f64;
        picture.then(|| {
            let Cut { level, .. } = cut;
            format!("inside is what is {} {level}, half way of the slices' values; --level V names another", cut.side())
        })
    }

    /// The slice of an image.
    pub fn content(&self, image: &Grey) -> SliceContent {
        match self {
            Rule::Least(least) => SliceContent::Mask(image.values.iter().map(|v| v >= least).collect()),
            Rule::Under(least) => SliceContent::Mask(image.values.iter().map(|v| v < least).collect()),
            Rule::Only(value) => SliceContent::Mask(image.values.iter().map(|v| v == value).collect()),
            Rule::Cut(cut) => {
                let depths: Vec<f32> = image.values.iter().map(|&v| cut.depth(f64::from(v))).collect();
                SliceContent::Level(LevelSlice::new(&depths, image.dims[0]))
            }
        }
    }
}

/// Values of all slices, as far as they are told apart.
fn distinct(ranges: &[Range]) -> BTreeSet<u16> {
    ranges.iter().flat_map(|r| r.between.iter().copied().chain(r.ends)).collect()
}

/// Values of all slices, for a message.
fn values(ranges: &[Range]) -> String {
    let all = distinct(ranges);
    let listed: Vec<String> = all.iter().take(FEW).map(u16::to_string).collect();
    listed.join(", ") + if all.len() > FEW { ", ..." } else { "" }
}
