//! The heights at which the body is computed: output heights, all contours, nodes between them, both end planes.

use crate::error::{Error, Result};
use crate::settings::{EndRule, Settings};
use crate::stack::ending::{gap_of_ending, gap_to_next};
use crate::stack::{ContourStack, HeightGrid};

/// Share of the gap at which a contour's neighbours are looked at: what moves by 30 px from contour to contour moves by 0.03 px there, while a step
/// in the body shows in full.
pub const BESIDE: f64 = 1e-3;
/// Heights this close to each other, in gaps, are one: an output height at a contour, a node or an end plane is that one's. It is far more than what
/// 32-bit spacings (NIfTI) and coordinates of four decimals (RTSTRUCT) add up to, and a surface that moves by 30 px from contour to contour moves by
/// 0.006 px there.
pub const SAME: f64 = 2e-4;

/// Nodes of an interval, its lower contour one of them: layers that are computed whatever is asked for, as what a layer becomes is told by
/// its stack alone. Three lie strictly between contours: with two the crease is 0.04 of the truth's larger, with five 0.01 smaller.
pub const NODES: usize = 4;
/// Times of those between contours.
pub const NODE_TIMES: [f64; NODES - 1] = [0.25, 0.5, 0.75];

/// Layers of an end beyond its contour where output heights have fewer, the nearer to each other the nearer they are to the end plane: caps are round.
pub const CAP_LAYERS: usize = 6;

/// Whether output layers are too few for a surface on a stretch of so much height: fewer than `enough`, and farther apart than pixels of side `px` are.
fn too_few(between: usize, enough: usize, height: f64, px: f64) -> bool {
    between < enough && height > (between + 1) as f64 * px
}

/// Output heights that lie strictly between two others, farther from them than [`SAME`] gaps.
fn strictly_between(output: &[f64], [low, high]: [f64; 2]) -> usize {
    let slack = SAME * (high - low);
    output.partition_point(|x| *x < high - slack).saturating_sub(output.partition_point(|x| *x <= low + slack))
}

/// The nodes that are handed on although nobody asks for layers there: those of intervals in which output layers are too few for a surface, as
/// of a volume that is painted on every slice. `z` are the contours, `px` a pixel's smaller side.
pub fn shown_nodes(z: &[f64], output: &[f64], px: f64) -> Vec<f64> {
    let coarse = |pair: &&[f64]| {
        let ends = [pair[0], pair[1]];
        too_few(strictly_between(output, ends), NODES - 1, ends[1] - ends[0], px)
    };
    z.windows(2).filter(coarse).flat_map(nodes_between).collect()
}

/// Heights of the nodes strictly between two contours.
fn nodes_between(pair: &[f64]) -> [f64; NODES - 1] {
    NODE_TIMES.map(|t| at_time([pair[0], pair[1]], t))
}

/// All nodes of contours at `z`, these among them, increasing.
pub fn nodes(z: &[f64]) -> Vec<f64> {
    let mut all: Vec<f64> = z.iter().copied().chain(z.windows(2).flat_map(nodes_between)).collect();
    all.sort_by(f64::total_cmp);
    all
}

/// Heights beyond a contour, up to an end plane, where output heights are too few for a surface.
fn shown_beyond(contour: f64, extent: f64, output: &[f64], px: f64) -> impl Iterator<Item = f64> {
    let between = strictly_between(output, [contour.min(extent), contour.max(extent)]);
    let count = if too_few(between, CAP_LAYERS - 1, (extent - contour).abs(), px) { CAP_LAYERS } else { 0 };
    (1..count).map(move |k| {
        let left = 1.0 - k as f64 / CAP_LAYERS as f64;
        contour + (1.0 - left * left) * (extent - contour)
    })
}

/// Height at a time between two contours, the same to the last bit upside down where heights are.
pub fn at_time([low, high]: [f64; 2], t: f64) -> f64 {
    if t <= 0.5 { low + t * (high - low) } else { high - (1.0 - t) * (high - low) }
}

/// One height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Height {
    /// The height, unit of the stack.
    pub z: f64,
    /// Whether it belongs to the output grid. What lies between contours and does not is there for other layers' sake, and handed to nobody
    /// but as [`shown_nodes`] says.
    pub output: bool,
}

/// All heights of a run.
#[derive(Debug, Clone)]
pub struct Heights {
    /// Every height, increasing.
    pub all: Vec<Height>,
    /// The heights of the contours.
    pub contours: Vec<Height>,
    between: Vec<(usize, usize)>,
}

impl Heights {
    /// Merges output heights (increasing), contours, the nodes between them, and the end planes `extent`.
    ///
    /// # Errors
    /// [`Error::Stack`] where no output height meets the body.
    pub fn new(stack: &ContourStack, output: &[f64], extent: [f64; 2]) -> Result<Self> {
        let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
        let range = [extent[0].min(z[0]), extent[1].max(z[z.len() - 1])];
        missing(output, range).map_or(Ok(()), |message| Err(Error::Stack(message)))?;
        Ok(Heights::merged(&z, output, extent, stack.spacing[0].min(stack.spacing[1])))
    }

    /// Heights for contours at `z`, where no output height need be; `px` is a pixel's smaller side.
    pub fn merged(z: &[f64], output: &[f64], extent: [f64; 2], px: f64) -> Self {
        let inner = |pair: &[f64]| {
            let ends = [pair[0], pair[1]];
            let times = NODE_TIMES.into_iter().chain([BESIDE, 1.0 - BESIDE]);
            times.map(move |t| Height { z: at_time(ends, t), output: false })
        };
        let contour = |&z: &f64| Height { z, output: false };
        let mut all: Vec<Height> = z.iter().map(contour).chain(z.windows(2).flat_map(inner)).collect();
        all.sort_by(|a, b| a.z.total_cmp(&b.z));
        let mut beside: Vec<Height> = Vec::new();
        for &x in output {
            let (_, gap) = nearest(z, x);
            let above = all.partition_point(|h| h.z < x);
            let known =
                (above.saturating_sub(1)..all.len().min(above + 1)).find(|&k| (all[k].z - x).abs() <= SAME * gap);
            match known {
                Some(k) => all[k].output = true,
                None => beside.push(Height { z: x, output: true }),
            }
        }
        let beyond = [z[0], z[z.len() - 1]].into_iter().zip(extent);
        let caps: Vec<f64> = beyond.flat_map(|(contour, extent)| shown_beyond(contour, extent, output, px)).collect();
        for x in extent.into_iter().chain(caps) {
            let (_, gap) = nearest(z, x);
            let is_known = |h: &Height| (h.z - x).abs() <= SAME * gap;
            if let Some(known) = beside.iter_mut().find(|h| is_known(h)) {
                known.z = if extent.contains(&x) { x } else { known.z };
            } else if !all.iter().any(is_known) {
                beside.push(Height { z: x, output: false });
            }
        }
        all.append(&mut beside);
        all.sort_by(|a, b| a.z.total_cmp(&b.z));
        let contours = z.iter().map(|z| all[all.partition_point(|h| h.z < *z)]).collect();
        let place = |z: f64| all.partition_point(|h| h.z < z);
        let between = z.windows(2).map(|w| (place(w[0]) + 1, place(w[1]))).collect();
        Heights { all, contours, between }
    }

    /// The heights of the output grid, where they are contours' as these.
    pub fn output(&self) -> Vec<f64> {
        self.all.iter().filter(|x| x.output).map(|x| x.z).collect()
    }

    /// Heights strictly between contours `i` and `i + 1`.
    pub fn between(&self, i: usize) -> &[Height] {
        let (from, to) = self.between[i];
        &self.all[from..to]
    }
}

/// The gap between increasing heights `z` of which as much of the whole height lies in narrower gaps as in wider ones; 0 of nothing. However many slices lie
/// close to each other, what matters is between those that do not.
pub fn middle_gap(z: &[f64]) -> f64 {
    let mut gaps: Vec<f64> = z.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(f64::total_cmp);
    let half = 0.5 * gaps.iter().sum::<f64>();
    let upto = gaps.iter().scan(0.0, |below, gap| {
        *below += gap;
        Some((*below, *gap))
    });
    let middle = upto.into_iter().find(|(below, _)| *below > half).map(|(_, gap)| gap);
    middle.or(gaps.last().copied()).unwrap_or(0.0)
}

/// Nearest contour and the smaller of the gaps around it.
fn nearest(z: &[f64], x: f64) -> (usize, f64) {
    let k = z.partition_point(|&v| v < x);
    let k = if k == z.len() || (k > 0 && x - z[k - 1] < z[k] - x) { k - 1 } else { k };
    let left = if k > 0 { z[k] - z[k - 1] } else { f64::INFINITY };
    let right = if k + 1 < z.len() { z[k + 1] - z[k] } else { f64::INFINITY };
    (k, left.min(right))
}

/// Checks output heights and peaks against the stack before anything is computed.
///
/// # Errors
/// [`Error::Stack`] or [`Error::Setting`] with value and limit.
pub fn check(stack: &ContourStack, heights: &[f64], settings: &Settings) -> Result<()> {
    if let Some(k) = (1..heights.len()).find(|&k| heights[k] <= heights[k - 1]) {
        let message = format!("output heights must increase; got {} after {}", heights[k], heights[k - 1]);
        return Err(Error::Stack(message));
    }
    let (z, empty) = slices(stack);
    missed(heights, &z, empty, settings).map_or(Ok(()), |message| Err(Error::Stack(message)))?;
    let (first, last) = (stack.slices[0].z, stack.slices[stack.slices.len() - 1].z);
    let fail = |name: &str, message| Err(Error::Setting { name: name.into(), message });
    match (settings.end_bottom, settings.end_top) {
        (EndRule::Peak(z), _) if z >= first => {
            fail("end_bottom", format!("peak must lie below the first contour at {first}; got {z}"))
        }
        (_, EndRule::Peak(z)) if z <= last => {
            fail("end_top", format!("peak must lie above the last contour at {last}; got {z}"))
        }
        _ => Ok(()),
    }
}

/// Heights of a stack's slices, and whether the first and the last are empty.
fn slices(stack: &ContourStack) -> (Vec<f64>, [bool; 2]) {
    let empty = [stack.slices.first(), stack.slices.last()];
    (stack.slices.iter().map(|s| s.z).collect(), empty.map(|s| s.is_none_or(|s| s.content.is_empty())))
}

/// Why no output height lies in a body with slices at `z`, of which the first and the last are empty or not; nothing where one does.
pub fn missed(output: &[f64], z: &[f64], empty: [bool; 2], settings: &Settings) -> Option<String> {
    missing(output, reach(z, empty, settings))
}

/// Why no output height lies in the range `[low, high]` of the body.
fn missing(output: &[f64], [low, high]: [f64; 2]) -> Option<String> {
    let slack = SAME * (high - low);
    let (Some(first), Some(last)) = (output.first(), output.last()) else { return Some("no output heights".into()) };
    let misses = output.iter().all(|&x| x < low - slack || x > high + slack);
    misses.then(|| format!("output heights {first} to {last} meet no part of the body, which lies in {low} to {high}"))
}

/// Lowest and highest height that a body can reach under its end rules (extrapolated ends may stop earlier), by its slices as for [`missed`].
fn reach(z: &[f64], empty: [bool; 2], settings: &Settings) -> [f64; 2] {
    let (Some(first), Some(last)) = (z.first(), z.last()) else { return [0.0; 2] };
    let middle = middle_gap(z);
    let beyond = |inward: &[f64], rule: EndRule, empty: bool| match rule {
        _ if empty => 0.0,
        EndRule::Flat => 0.0,
        EndRule::HalfSlice => 0.5 * (inward[1] - inward[0]).abs(),
        EndRule::Extrapolate => settings.highest_cap(gap_to_next(inward, middle), gap_of_ending(inward, middle)),
        EndRule::Peak(tip) => (tip - inward[0]).abs(),
    };
    if z.len() < 2 {
        return [*first, *last];
    }
    let from_top: Vec<f64> = z.iter().rev().copied().collect();
    [first - beyond(z, settings.end_bottom, empty[0]), last + beyond(&from_top, settings.end_top, empty[1])]
}

/// A sentence for each rule for an end that is asked for where the stack ends with an empty slice: the body ends before that, whatever the rule.
pub fn passed_over(stack: &ContourStack, settings: &Settings) -> Vec<String> {
    let (_, empty) = slices(stack);
    if stack.slices.iter().all(|slice| slice.content.is_empty()) {
        return Vec::new();
    }
    let rules = [("end_bottom", settings.end_bottom), ("end_top", settings.end_top)];
    let ends = [stack.slices.first(), stack.slices.last()].into_iter().flatten();
    let over =
        rules.into_iter().zip(ends).zip(empty).filter(|(((_, rule), _), empty)| *empty && *rule != EndRule::Flat);
    over.map(|(((name, rule), slice), _)| {
        format!(
            "setting `{name}` = {rule} changes nothing: slice {} at {} {} is empty, and the body ends before it; without empty slices beyond the body \
             the rule counts",
            slice.name, slice.z, stack.unit
        )
    })
    .collect()
}

/// The output heights of a stack: `dz` where given, else the input's own grid, else as fine as the pixel spacing. A grid made here
/// contains the first contour's height and covers the whole body.
pub fn height_grid(stack: &ContourStack, settings: &Settings, dz: Option<f64>) -> HeightGrid {
    if let (None, Some(grid)) = (dz, stack.z_out) {
        return grid;
    }
    let step = dz.unwrap_or(stack.spacing[0].min(stack.spacing[1]));
    let first = stack.slices.first().map_or(0.0, |s| s.z);
    let (z, empty) = slices(stack);
    let [low, high] = reach(&z, empty, settings);
    // As near as this to an end of the body a layer lies there.
    let gaps: Vec<f64> = stack.slices.windows(2).map(|pair| pair[1].z - pair[0].z).collect();
    let [below, above] = [gaps.first(), gaps.last()].map(|gap| SAME * gap.copied().unwrap_or_default());
    let below = ((first - low - below) / step).ceil().max(0.0);
    let above = ((high - first + above) / step).floor().max(0.0);
    // Of a step next to nothing there are as many as a number holds, which is refused where they are made.
    HeightGrid { start: first - below * step, step, count: ((below + above) as usize).saturating_add(1) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::{Geometry, Slice, SliceContent};

    #[test]
    fn the_middle_gap_is_that_of_half_the_height() {
        assert_eq!([middle_gap(&[]), middle_gap(&[4.0])], [0.0; 2]);
        assert_eq!(middle_gap(&[1.0, 4.0, 7.0, 10.0]), 3.0);
        // Narrow ones are more, but not higher together.
        assert_eq!(middle_gap(&[0.0, 0.5, 1.0, 20.0, 21.0, 40.0, 40.25, 50.0]), 19.0);
        assert_eq!(middle_gap(&[0.0, 1.0, 2.0, 6.0, 7.0, 8.0, 9.0]), 1.0);
    }

    /// A stack with one pixel painted at these heights.
    fn stack_at(z: impl IntoIterator<Item = f64>) -> ContourStack {
        let slice = |z: f64| {
            let content = SliceContent::Mask((0..9).map(|n| n == 4).collect());
            Slice { name: "a".into(), z, extra: false, content }
        };
        ContourStack {
            dims: [3, 3],
            spacing: [1.0; 2],
            unit: "px".into(),
            slices: z.into_iter().map(slice).collect(),
            z_out: None,
            geometry: Geometry::default(),
            known: None,
        }
    }

    #[test]
    fn a_step_that_is_the_spacing_meets_every_contour_whatever_was_rounded() {
        // As a file rounds heights: to 32 bits (NIfTI), to four decimals (RTSTRUCT).
        let single = |v: f64| f64::from(v as f32);
        let decimal = |v: f64| (v * 1e4).round() / 1e4;
        let mut state = 7u32;
        for (spacing, every) in
            [1.3, 0.7, 3.3, 0.6, 1.1, 2.0 / 3.0, 2.5 / 7.0].into_iter().flat_map(|v| [3, 4, 7].map(|n| (v, n)))
        {
            for round in [&single as &dyn Fn(f64) -> f64, &decimal] {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let first = f64::from(state >> 20) - 2048.0;
                let z: Vec<f64> = (0..12).map(|k| round(first + f64::from(k * every) * single(spacing))).collect();
                let place = format!("{spacing} from {first}, every {every}");
                let grid = height_grid(&stack_at(z.clone()), &Settings::default(), Some(spacing));
                assert_eq!(grid.count, 11 * every as usize + 1, "{place}");
                let output: Vec<f64> = (0..grid.count).map(|k| grid.start + k as f64 * grid.step).collect();
                let heights = Heights::merged(&z, &output, [z[0], z[11]], 1.0);
                assert_eq!(heights.output().len(), grid.count, "{place}");
                // Of a layer that nearly touches a contour a mesh would have slivers.
                assert!(heights.contours.iter().all(|h| h.output), "{place}");
            }
        }
    }

    #[test]
    fn output_may_lie_in_the_ends_alone() {
        let stack = stack_at([0.0, 1.0]);
        for output in [1.4, 0.3, -0.4] {
            assert!(Heights::new(&stack, &[output], [-0.5, 1.5]).is_ok(), "{output}");
            assert_eq!(Heights::new(&stack, &[output], [0.1, 0.9]).is_ok(), output == 0.3, "{output}");
        }
        for output in [1.6, -0.6] {
            assert!(Heights::new(&stack, &[output], [-0.5, 1.5]).is_err(), "{output}");
        }
    }
}
