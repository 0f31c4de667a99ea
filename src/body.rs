//! A body whose slices may be changed, and which may be asked for more heights, without a new run.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use crate::backend::Means;
use crate::backend::answers::{Answers, Remembering};
use crate::error::{Error, Result};
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::samples;
use crate::pipeline::section::Section;
use crate::reconstruct::{reconstruct_into, reconstruct_section};
use crate::reference::displacement::ROUNDS;
use crate::report::{ContourReport, Report};
use crate::settings::Settings;
use crate::stack::change::Change;
use crate::stack::heights::SAME;
use crate::stack::window::Window;
use crate::stack::{ContourStack, SliceContent};
use crate::surface::{Layer, Reconstruction};

/// Note in the report of a body that was changed.
const CHANGED: &str = "slices were changed after the run: `body` and `broken` are still those of the first run, and so are warnings before this one";

/// A body with its slices: layers at more heights, and slices that change, cost only what depends on them. Every layer is, bit by bit, that of a
/// run with the slices as they are.
#[derive(Debug)]
pub struct Body {
    stack: ContourStack,
    settings: Settings,
    heights: Vec<f64>,
    whole: Reconstruction,
    /// Intervals whose layers are out of date.
    stale: BTreeSet<usize>,
    /// The slice that was changed last.
    changed: Option<usize>,
    /// Layers that were asked for later, by the bits of their heights.
    later: BTreeMap<u64, Layer>,
    answers: Answers,
    facts: Facts,
}

/// Facts about all slices that each interval depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Facts {
    window: Window,
    change: Change,
}

impl Facts {
    fn of(stack: &ContourStack, settings: &Settings) -> Self {
        let px = stack.spacing[0].max(stack.spacing[1]);
        let window = Window::around(stack, samples(settings.margin(), stack.spacing.map(|s| s / px)));
        Facts { window, change: Change::of(stack) }
    }
}

impl Body {
    /// Reconstructs the body at `heights` (increasing, unit of the stack).
    ///
    /// # Errors
    /// The errors of [`reconstruct_with`](crate::reconstruct_with).
    pub fn new(stack: ContourStack, heights: Vec<f64>, settings: Settings, means: &Means<'_>) -> Result<Self> {
        stack.validate()?;
        let answers = Answers::default();
        let mut layers = Vec::new();
        let mut keep = |layer: Layer| {
            layers.push(layer);
            if means.progress.stops() { Err(Error::Interrupted) } else { Ok(()) }
        };
        let backend = Remembering { backend: means.backend, answers: Some(&answers), progress: means.progress };
        let means = Means { backend: &backend, ..*means };
        let body = reconstruct_into(&stack, &heights, &settings, &means, &mut keep)?;
        let facts = Facts::of(&stack, &settings);
        let whole = Reconstruction { layers, ..body };
        let (stale, later) = (BTreeSet::new(), BTreeMap::new());
        Ok(Body { stack, settings, heights, whole, stale, changed: None, later, answers, facts })
    }

    /// Its slices.
    pub fn stack(&self) -> &ContourStack {
        &self.stack
    }

    /// Heights of the output layers.
    pub fn heights(&self) -> &[f64] {
        &self.heights
    }

    /// Intervals between slices, from 0, whose layers are out of date: they are computed when they are asked for.
    pub fn stale(&self) -> impl Iterator<Item = usize> + '_ {
        self.stale.iter().copied()
    }

    /// Puts `content` in the place of slice `slice`, counted from 0. What depends on it is out of date from now on.
    ///
    /// # Errors
    /// [`Error::Setting`] for a slice that is not there, the errors of [`ContourStack::validate`]; the body is then as it was.
    pub fn update(&mut self, slice: usize, content: SliceContent) -> Result<()> {
        let count = self.stack.slices.len();
        if slice >= count {
            let message = format!("must lie in [0, {}], the body's slices; got {slice}", count - 1);
            return Err(Error::Setting { name: "slice".into(), message });
        }
        let mut stale = self.depending(slice..slice + 1);
        let before = std::mem::replace(&mut self.stack.slices[slice].content, content);
        if let Err(wrong) = self.stack.validate() {
            self.stack.slices[slice].content = before;
            return Err(wrong);
        }
        stale.extend(self.depending(slice..slice + 1));
        let facts = Facts::of(&self.stack, &self.settings);
        let of_all = |facts: &Facts| (facts.window, facts.change.relief, facts.change.rugged);
        if of_all(&facts) != of_all(&self.facts) {
            stale.extend(0..count - 1);
        } else if facts.change.rate != self.facts.change.rate {
            for &i in &self.whole.report.closing {
                stale.extend(self.depending(i..i + 2));
            }
        }
        self.facts = facts;
        let z: Vec<f64> = self.stack.slices.iter().map(|s| s.z).collect();
        self.later.retain(|z_bits, _| !stale.contains(&interval(&z, f64::from_bits(*z_bits))));
        self.stale.extend(stale);
        self.changed = Some(slice);
        Ok(())
    }

    /// The layer at a height; beyond the body all of it is outside. It is kept for the next question.
    ///
    /// # Errors
    /// The errors of a run; [`Error::Setting`] for a height that is no number.
    pub fn layer(&mut self, z: f64, means: &Means<'_>) -> Result<Layer> {
        if !z.is_finite() {
            return Err(Error::Setting { name: "z".into(), message: format!("must be a finite number; got {z}") });
        }
        let contours: Vec<f64> = self.stack.slices.iter().map(|s| s.z).collect();
        let i = interval(&contours, z);
        let gap = contours[i + 1] - contours[i];
        let is_here = |layer: &&Layer| (layer.z - z).abs() <= SAME * gap;
        if !self.stale.contains(&i)
            && let Some(known) = self.whole.layers.iter().find(is_here)
        {
            return Ok(known.clone());
        }
        if let Some(known) = self.later.get(&z.to_bits()) {
            return Ok(known.clone());
        }
        let beyond = z < contours[0] || z > contours[contours.len() - 1];
        let is_asked = self.heights.iter().chain(&contours).any(|h| (h - z).abs() <= SAME * gap);
        if self.stale.contains(&i) && (beyond || is_asked) {
            self.refresh(self.together(i), means)?;
            if let Some(known) = self.whole.layers.iter().find(is_here) {
                return Ok(known.clone());
            }
        }
        let [low, high] = self.whole.extent;
        let layer = if beyond && (z < low || z > high) {
            let px = self.stack.spacing[0].max(self.stack.spacing[1]);
            let outside = self.settings.margin() as f32 * px as f32;
            Layer { z, phi: SparseImage::filled(self.stack.dims, outside), output: true, contour: None }
        } else {
            let made = self.section(i..i + 1, &[z], means)?.layers;
            let found = made.into_iter().find(|layer| is_here(&layer));
            found.ok_or_else(|| Error::Numerics { stage: "layers", message: format!("none came at height {z}") })?
        };
        self.later.insert(z.to_bits(), layer.clone());
        Ok(layer)
    }

    /// The whole body, with everything that was out of date computed anew.
    ///
    /// # Errors
    /// The errors of a run.
    pub fn whole(&mut self, means: &Means<'_>) -> Result<&Reconstruction> {
        while let Some(first) = self.stale.first().copied() {
            let end = (first..).find(|i| !self.stale.contains(i)).unwrap_or(first + 1);
            self.refresh(first..end, means)?;
        }
        Ok(&self.whole)
    }

    /// The layers of the intervals `wanted`, contours' and output's, as they are now.
    ///
    /// # Errors
    /// The errors of a run; [`Error::Setting`] for intervals that are not there.
    pub fn between(&mut self, wanted: Range<usize>, means: &Means<'_>) -> Result<impl Iterator<Item = &Layer>> {
        let count = self.stack.slices.len() - 1;
        if wanted.is_empty() || wanted.end > count {
            let message = format!("must lie in [0, {}], the body's intervals; got {wanted:?}", count - 1);
            return Err(Error::Setting { name: "intervals".into(), message });
        }
        if wanted.clone().any(|i| self.stale.contains(&i)) {
            self.refresh(wanted.clone(), means)?;
        }
        let [low, high] = self.bounds(&wanted);
        Ok(self.whole.layers.iter().filter(move |layer| layer.z >= low && layer.z < high))
    }

    /// Intervals that are computed together with interval `i`: both beside the slice that was changed last, which have most in common.
    fn together(&self, i: usize) -> Range<usize> {
        let beside = |slice: usize| slice.saturating_sub(1)..(slice + 1).min(self.stack.slices.len() - 1);
        let both = self.changed.map(beside).filter(|both| both.contains(&i));
        both.filter(|both| both.clone().all(|k| self.stale.contains(&k))).unwrap_or(i..i + 1)
    }

    /// Intervals that depend on some slices.
    fn depending(&self, slices: Range<usize>) -> BTreeSet<usize> {
        let depends = |i: &usize| {
            let read = Section::keeping(&self.stack, &self.settings, *i..i + 1).slices;
            // Where a slice goes on beyond the border depends on those beside it, too.
            let beside = usize::from(self.facts.window.beyond);
            read.start < slices.end + beside && slices.start < read.end + beside
        };
        (0..self.stack.slices.len() - 1).filter(depends).collect()
    }

    /// Heights from the first on and below the second belong to these intervals.
    fn bounds(&self, intervals: &Range<usize>) -> [f64; 2] {
        let slices = &self.stack.slices;
        let low = if intervals.start == 0 { f64::NEG_INFINITY } else { slices[intervals.start].z };
        let high = if intervals.end + 1 == slices.len() { f64::INFINITY } else { slices[intervals.end].z };
        [low, high]
    }

    /// A run of these intervals alone.
    fn section(&self, intervals: Range<usize>, heights: &[f64], means: &Means<'_>) -> Result<Reconstruction> {
        let section = Section::keeping(&self.stack, &self.settings, intervals);
        let mut layers = Vec::new();
        let mut keep = |layer: Layer| {
            layers.push(layer);
            if means.progress.stops() { Err(Error::Interrupted) } else { Ok(()) }
        };
        let backend = Remembering { backend: means.backend, answers: Some(&self.answers), progress: means.progress };
        let means = Means { backend: &backend, ..*means };
        let body = reconstruct_section(&self.stack, &section, heights, &self.settings, &means, &mut keep)?;
        self.answers.tidy(self.stack.slices.len(), ROUNDS.len());
        Ok(Reconstruction { layers, ..body })
    }

    /// Computes the layers of these intervals anew.
    fn refresh(&mut self, intervals: Range<usize>, means: &Means<'_>) -> Result<()> {
        let made = self.section(intervals.clone(), &self.heights, means)?;
        let [low, high] = self.bounds(&intervals);
        let layers = &mut self.whole.layers;
        let first = layers.partition_point(|layer| layer.z < low);
        let end = layers.partition_point(|layer| layer.z < high);
        layers.splice(first..end, made.layers);
        if intervals.start == 0 {
            self.whole.extent[0] = made.extent[0];
        }
        if intervals.end + 1 == self.stack.slices.len() {
            self.whole.extent[1] = made.extent[1];
        }
        splice(&mut self.whole.report, &intervals, made.report);
        self.stale.retain(|i| !intervals.contains(i));
        Ok(())
    }
}

/// The interval that a height belongs to; beyond the ends that of the end.
fn interval(contours: &[f64], z: f64) -> usize {
    contours.partition_point(|contour| *contour <= z).clamp(1, contours.len() - 1) - 1
}

/// Puts the report of some intervals into that of the whole.
fn splice(whole: &mut Report, intervals: &Range<usize>, part: Report) {
    let mut contours = part.contours;
    let (last, count) = (contours.len().saturating_sub(1), whole.contours.len());
    let above = |own: &mut ContourReport, of: &ContourReport| {
        own.differing_pixels = of.differing_pixels;
        own.arrival_from_above = of.arrival_from_above;
        own.area = of.area;
        own.above = of.above;
    };
    // A contour between two sections is swept to from below by the lower, from above by the upper one.
    if let (Some(first), true) = (contours.first_mut(), intervals.start > 0) {
        let mut own = whole.contours[intervals.start].clone();
        above(&mut own, first);
        *first = own;
    }
    if let (Some(end), true) = (contours.get_mut(last), intervals.end + 1 < count) {
        above(end, &whole.contours[intervals.end]);
    }
    whole.contours.splice(intervals.start..=intervals.end, contours);
    whole.intervals.splice(intervals.clone(), part.intervals);
    let ends: Vec<_> = part.ends.iter().map(|end| end.side).collect();
    whole.ends.retain(|end| !ends.contains(&end.side));
    whole.ends.extend(part.ends);
    whole.closing.extend(part.closing);
    whole.closing.sort_unstable();
    whole.closing.dedup();
    whole.warnings.extend(part.warnings.into_iter().filter(|w| !whole.warnings.contains(w)).collect::<Vec<_>>());
    if !whole.warnings.iter().any(|w| w == CHANGED) {
        whole.warnings.push(CHANGED.into());
    }
}
