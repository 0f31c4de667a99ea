//! The hold-out score: how well a stack's own slices are found again when they are left out.

use serde::Serialize;

use super::along::Errors;
use super::view::View;
use crate::backend::{Backend, Means};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::reconstruct::reconstruct_into;
use crate::reference::exact::exact_distance;
use crate::settings::{Link, Settings};
use crate::stack::heights::SAME;
use crate::stack::{ContourStack, Slice};
use crate::storage::spill::Budget;
use crate::surface::Layer;
use crate::surface::heightmap::ArrivalHeights;
use crate::surface::map::Map;

/// Scores of slices that were left out and found again.
#[derive(Debug, Clone, Default, Serialize)]
pub struct HoldOut {
    /// Every which slice was left out.
    pub leave: usize,
    /// Links that were used: those between slices that are both kept.
    #[serde(skip_serializing_if = "is_zero")]
    pub links: usize,
    /// The slices that were left out and have something on them, in the truth or in the result.
    pub slices: Vec<SliceScore>,
    /// `2 |A and B| / (|A| + |B|)` over all of them together; none where the truth is empty on all.
    pub dice: Option<f64>,
    /// Mean distance between the contours of truth and result, both ways, unit of the stack, over the slices that have both; none where none has.
    pub surface_distance: Option<f64>,
    /// Volume of the result less that of the truth, % of the truth, each slice half as high as the gaps beside it; none where the truth is empty on
    /// all.
    pub volume_error_percent: Option<f64>,
    /// Of a contour map: root of the mean of `(h - z)^2` along the lines left out, h the height of the surface, z the line's, unit of the stack.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_error: Option<f64>,
    /// Scores of linear interpolation of the kept slices' distances, for the same slices.
    pub linear: Compared,
    /// The first and the last slice, left out by themselves and found from the others by the end rules; as far as one of truth, result and linear
    /// continuation has something there. They count in nothing above.
    pub ends: Vec<SliceScore>,
}

fn is_zero(n: &usize) -> bool {
    *n == 0
}

/// Scores over several slices together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Compared {
    /// Dice coefficient, see [`HoldOut::dice`].
    pub dice: Option<f64>,
    /// Mean surface distance, see [`HoldOut::surface_distance`].
    pub surface_distance: Option<f64>,
    /// Volume error, see [`HoldOut::volume_error_percent`].
    pub volume_error_percent: Option<f64>,
    /// Of a contour map: error of heights, see [`HoldOut::height_error`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_error: Option<f64>,
}

/// Scores of one slice.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SliceScore {
    /// Name of the slice.
    pub name: String,
    /// Its height.
    pub z: f64,
    /// Pixels inside, truth and result.
    pub pixels: [usize; 2],
    /// Dice coefficient; none where the truth is empty.
    pub dice: Option<f64>,
    /// Mean contour distance, unit of the stack; none where one of both is empty.
    pub surface_distance: Option<f64>,
    /// Area of the result less that of the truth, % of the truth; none where the truth is empty.
    pub area_error_percent: Option<f64>,
    /// Of a line of a contour map: error of heights along it, see [`HoldOut::height_error`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_error: Option<f64>,
    /// Dice coefficient of linear interpolation of the kept slices' distances; at an end, of their continuation.
    pub linear_dice: Option<f64>,
}

/// Leaves out every `leave`-th slice but for the first and last, reconstructs them from the rest, and compares, of a contour map (`map`) what lies
/// within its border. Links between slices of which one is left out count for nothing.
///
/// # Errors
/// [`Error::Setting`] if `leave` is less than 2, [`Error::Stack`] if that leaves nothing out; as [`crate::reconstruct_with`].
pub fn hold_out(
    stack: &ContourStack,
    map: Option<&Map>,
    settings: &Settings,
    leave: usize,
    backend: &dyn Backend,
    progress: &dyn Progress,
) -> Result<HoldOut> {
    stack.validate()?;
    if leave < 2 {
        let message = format!("must be at least 2: 2 leaves out every second slice; got {leave}");
        return Err(Error::Setting { name: "leave".into(), message });
    }
    let last = stack.slices.len() - 1;
    let left_out = |k: usize| k > 0 && k < last && k % leave == leave - 1;
    let (dropped, kept): (Vec<usize>, Vec<usize>) = (0..=last).partition(|&k| left_out(k));
    if dropped.is_empty() {
        let message = format!(
            "{} slices leave nothing out with `--leave {leave}`; at least {leave} and one more are needed",
            last + 1
        );
        return Err(Error::Stack(message));
    }
    let (heights, beyond) = heights(stack, &dropped, if map.is_some() { STEPS } else { 1 });
    let view = View::of_map(map, stack.dims);
    let mut arrival = map.map(|_| ArrivalHeights::new(stack.dims, [0, last].map(|k| stack.slices[k].z)));
    let mut out = HoldOut { leave, ..HoldOut::default() };
    let (mut tallies, mut linear) = ([Tally::default(); 2], Errors::default());
    let rest = some_of(stack, &kept);
    let means = Means { backend, progress, budget: &Budget::unlimited() };
    // Neighbours of a slice left out are kept: the gap that it lies in, of which heights this near are one.
    let is_at =
        |k: usize, z: f64| (stack.slices[k].z - z).abs() <= SAME * (stack.slices[k + 1].z - stack.slices[k - 1].z);
    let mut found = 0;
    let mut score = |layer: Layer| {
        // The first of the heights lies below the stack.
        if !layer.output || layer.z <= beyond[0] || layer.z >= beyond[1] {
            return Ok(());
        }
        arrival.iter_mut().for_each(|arrival| arrival.layer(&layer));
        for &k in dropped.iter().filter(|k| is_at(**k, layer.z)) {
            found += 1;
            let between = Between::around(&rest, layer.z);
            out.slices.extend(scored(stack, k, &layer, &between, &view, &mut tallies));
            if map.is_some() {
                let heights = view.of(&between.heights());
                linear.add(&Errors::of(&stack.slices[k].content, layer.z, &heights, &view));
            }
        }
        Ok(())
    };
    let links = links_of(&settings.links, &kept);
    out.links = links.len();
    let settings_of = |links| Settings { links, ..settings.clone() };
    reconstruct_into(&rest, &heights, &settings_of(links), &means, &mut score)?;
    if found != dropped.len() {
        let message = format!("{found} layers came for {} slices that were left out", dropped.len());
        return Err(Error::Numerics { stage: "evaluate", message });
    }
    let [own, line] = tallies.map(|tally| tally.compared());
    (out.dice, out.surface_distance, out.volume_error_percent) =
        (own.dice, own.surface_distance, own.volume_error_percent);
    out.linear = line;
    if let Some(mut arrival) = arrival {
        let found = view.of(arrival.finish());
        let mut own = Errors::default();
        for slice in dropped.iter().map(|&k| &stack.slices[k]) {
            let along = Errors::of(&slice.content, slice.z, &found, &view);
            own.add(&along);
            let score = out.slices.iter_mut().find(|score| score.z == slice.z);
            score.into_iter().for_each(|score| score.height_error = along.root_mean_square());
        }
        (out.height_error, out.linear.height_error) = (own.root_mean_square(), linear.root_mean_square());
    }
    if last >= LEAST_FOR_ENDS {
        let inner: Vec<usize> = (1..last).collect();
        let rest = some_of(stack, &inner);
        // A run wants a height at which there is a body.
        let heights: Vec<f64> = [0, 1, last].map(|k| stack.slices[k].z).into();
        let mut score = |layer: Layer| {
            // An end plane as near is that height.
            let z = |k: usize| stack.slices[k].z;
            let near = |k: usize| if k == 0 { SAME * (z(2) - z(1)) } else { SAME * (z(last - 1) - z(last - 2)) };
            let end = [0, last].into_iter().find(|&k| (z(k) - layer.z).abs() <= near(k) && layer.output);
            let Some(k) = end else { return Ok(()) };
            let linear = Between::around(&rest, layer.z);
            out.ends.extend(scored(stack, k, &layer, &linear, &view, &mut [Tally::default(); 2]));
            Ok(())
        };
        reconstruct_into(&rest, &heights, &settings_of(links_of(&settings.links, &inner)), &means, &mut score)?;
    }
    Ok(out)
}

/// Layers per gap beside a slice left out, between which a map's heights are linear.
const STEPS: usize = 8;
/// Ends are left out where two slices and one more are kept: linear continuation needs two, a slope three.
const LEAST_FOR_ENDS: usize = 4;

/// Heights of the slices that were left out, those that cut the gaps beside them in so many parts, and one gap beyond either end: nothing is asked
/// there, but a body asked for as a grid has layers there, too. And these two.
fn heights(stack: &ContourStack, dropped: &[usize], parts: usize) -> (Vec<f64>, [f64; 2]) {
    let z = |k: usize| stack.slices[k].z;
    let last = stack.slices.len() - 1;
    let beyond = [z(0) - (z(1) - z(0)), z(last) + (z(last) - z(last - 1))];
    let between = |k: usize, n: usize| z(k) + (z(k + 1) - z(k)) * n as f64 / parts as f64;
    let beside = |k: usize| [k - 1, k].into_iter().flat_map(move |gap| (1..parts).map(move |n| between(gap, n)));
    let inner = dropped.iter().flat_map(|&k| beside(k).chain([z(k)]));
    // With the kept slices below and above where heights are asked for between them.
    let kept = dropped.iter().filter(|_| parts > 1).flat_map(|&k| [z(k - 1), z(k + 1)]);
    let mut heights: Vec<f64> = inner.chain(kept).chain(beyond).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    (heights, beyond)
}

/// Links between neighbours that are both kept, by their places among those.
fn links_of(links: &[Link], kept: &[usize]) -> Vec<Link> {
    let place = |link: &Link| {
        let place = kept.binary_search(&link.slice).ok()?;
        (kept.get(place + 1) == Some(&(link.slice + 1))).then_some(place)
    };
    links.iter().filter_map(|link| Some(Link { slice: place(link)?, ..*link })).collect()
}

/// Some slices of a stack.
fn some_of(stack: &ContourStack, kept: &[usize]) -> ContourStack {
    let slices: Vec<Slice> = kept.iter().map(|&k| stack.slices[k].clone()).collect();
    ContourStack { unit: stack.unit.clone(), slices, z_out: None, ..*stack }
}

/// The exact distances of the two slices next to a height, between which a line goes. An empty slice is infinitely far off.
struct Between {
    z: [f64; 2],
    distances: [Vec<f64>; 2],
}

impl Between {
    fn around(stack: &ContourStack, z: f64) -> Self {
        let px = stack.spacing[0].max(stack.spacing[1]);
        let above = stack.slices.partition_point(|s| s.z < z).clamp(1, stack.slices.len() - 1);
        let both = [above - 1, above].map(|k| &stack.slices[k]);
        let h = stack.spacing.map(|s| s / px);
        Between {
            z: both.map(|slice| slice.z),
            distances: both.map(|slice| exact_distance(&slice.content.sides(), stack.dims, h).data),
        }
    }

    /// Inside at height `z`.
    fn inside(&self, z: f64) -> Vec<bool> {
        let t = (z - self.z[0]) / (self.z[1] - self.z[0]);
        let [low, high] = &self.distances;
        low.iter().zip(high).map(|(a, b)| (1.0 - t) * a + t * b < 0.0).collect()
    }

    /// Where pixels leave the body, at most at either slice.
    fn heights(&self) -> Vec<f64> {
        let [low, high] = &self.distances;
        let share = |a: f64, b: f64| match (a < 0.0, b < 0.0) {
            (true, false) if b.is_finite() => a / (a - b),
            (true, true) => 1.0,
            _ => 0.0,
        };
        let height = |(a, b): (&f64, &f64)| self.z[0] + share(*a, *b) * (self.z[1] - self.z[0]);
        low.iter().zip(high).map(height).collect()
    }
}

/// Scores of slice `k`, left out, by the result's layer there and by linear interpolation, which go into the tallies; nothing where all is empty.
fn scored(
    stack: &ContourStack,
    k: usize,
    layer: &Layer,
    linear: &Between,
    view: &View,
    tallies: &mut [Tally; 2],
) -> Option<SliceScore> {
    let slice = &stack.slices[k];
    let truth = view.of(&slice.content.sides());
    let found: Vec<bool> = view.of(&layer.dense()).iter().map(|v| *v < 0.0).collect();
    let linear = view.of(&linear.inside(slice.z));
    let beside = [k.saturating_sub(1), (k + 1).min(stack.slices.len() - 1)].map(|k| stack.slices[k].z);
    let height = 0.5 * (beside[1] - beside[0]);
    let [own, line] = [found, linear].map(|found| Tally::new([&truth, &found], view.dims, stack.spacing, height));
    tallies.iter_mut().zip([&own, &line]).for_each(|(all, one)| all.add(one));
    if own.sizes == [0, 0] && line.sizes == [0, 0] {
        return None;
    }
    let [score, linear] = [&own, &line].map(Tally::compared);
    Some(SliceScore {
        name: slice.name.clone(),
        z: slice.z,
        pixels: own.sizes,
        dice: score.dice,
        surface_distance: score.surface_distance,
        area_error_percent: score.volume_error_percent,
        height_error: None,
        linear_dice: linear.dice,
    })
}

/// Counts over slices.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    common: usize,
    /// Pixels of truth and result, and these times the heights of their slices.
    sizes: [usize; 2],
    volumes: [f64; 2],
    /// Sum of the mean contour distances, and over how many slices.
    distances: f64,
    compared: usize,
}

impl Tally {
    /// The tally of one slice of this height, truth and result.
    fn new(masks: [&[bool]; 2], dims: [usize; 2], spacing: [f64; 2], height: f64) -> Self {
        let distance = contour_distance(&masks, dims, spacing);
        let sizes = masks.map(|m| m.iter().filter(|i| **i).count());
        Tally {
            common: masks[0].iter().zip(masks[1]).filter(|(a, b)| **a && **b).count(),
            sizes,
            volumes: sizes.map(|pixels| height * pixels as f64),
            distances: distance.unwrap_or_default(),
            compared: usize::from(distance.is_some()),
        }
    }

    fn add(&mut self, other: &Tally) {
        self.common += other.common;
        self.sizes = [0, 1].map(|k| self.sizes[k] + other.sizes[k]);
        self.volumes = [0, 1].map(|k| self.volumes[k] + other.volumes[k]);
        self.distances += other.distances;
        self.compared += other.compared;
    }

    fn compared(&self) -> Compared {
        Compared {
            dice: dice(self.common, self.sizes),
            surface_distance: (self.compared > 0).then(|| self.distances / self.compared as f64),
            volume_error_percent: excess(self.volumes),
            height_error: None,
        }
    }
}

/// Value where there is any truth.
fn dice(common: usize, [truth, found]: [usize; 2]) -> Option<f64> {
    (truth > 0).then(|| 2.0 * common as f64 / (truth + found) as f64)
}

/// Excess of the second over the first, % of the first where there is any.
fn excess([truth, found]: [f64; 2]) -> Option<f64> {
    (truth > 0.0).then(|| 100.0 * (found - truth) / truth)
}

/// Mean distance of each mask's border pixels to the other mask's border.
fn contour_distance(masks: &[&[bool]; 2], dims: [usize; 2], spacing: [f64; 2]) -> Option<f64> {
    if masks.iter().any(|m| !m.contains(&true) || !m.contains(&false)) {
        return None;
    }
    let px = spacing[0].max(spacing[1]);
    let fields = masks.map(|m| exact_distance(m, dims, spacing.map(|s| s / px)));
    let [nx, ny] = dims;
    let (mut sum, mut count) = (0.0, 0usize);
    for (own, other) in [(0, 1), (1, 0)] {
        let inside = |n: usize| masks[own][n];
        for n in (0..nx * ny).filter(|&n| inside(n)) {
            let (i, j) = (n % nx, n / nx);
            let open = (i > 0 && !inside(n - 1))
                || (i + 1 < nx && !inside(n + 1))
                || (j > 0 && !inside(n - nx))
                || (j + 1 < ny && !inside(n + nx));
            if open {
                // Both borders run half a pixel outside of their last pixels.
                sum += (fields[other].data[n] - fields[own].data[n]).abs() * px;
                count += 1;
            }
        }
    }
    (count > 0).then(|| sum / count as f64)
}
