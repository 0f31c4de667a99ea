//! The bodies that many labels are reconstructed from, each on its own part of the image: every label alone, and the unions of those that touch.

use crate::estimate::memory::MemoryNeeds;
use crate::estimate::runtime::Effort;
use crate::registration::displacement::BLOCK;
use crate::settings::Settings;
use crate::stack::heights::{SAME, nodes, shown_nodes};
use crate::stack::{ContourStack, Slice, SliceContent};

use super::stack::LabelStack;

/// Pixels, of the larger side, around a label that are computed with it. What lies beyond changes no bit of its surface; distances differ by
/// rounding within a hundredth of a pixel of the clamp (`tests/labels/partitions.rs`).
const AROUND: f64 = 64.0;

/// Labels that touch, where they are united.
pub(super) fn unions(stack: &LabelStack, unite: bool) -> Vec<Vec<usize>> {
    if unite { stack.groups(&stack.contacts()) } else { Vec::new() }
}

/// Every label alone, and the unions.
pub(super) fn pieces<'s>(
    stack: &'s LabelStack,
    unite: bool,
    unions: &'s [Vec<usize>],
) -> impl Iterator<Item = LabelPiece> + 's {
    let alone = (0..stack.labels.len()).map(|a| vec![a]);
    alone.chain(unions.iter().cloned()).map(move |members| LabelPiece::of(stack, &members, unite))
}

/// What all labels take: the memory of the largest, since they are worked on one by one, and the effort of all.
pub fn requirements(stack: &LabelStack, unite: bool, heights: &[f64], settings: &Settings) -> (MemoryNeeds, Effort) {
    let unions = unions(stack, unite);
    let asked = asked(stack, unite, heights);
    let each =
        pieces(stack, unite, &unions).map(|part| (part.needs(&asked, settings), Effort::of(&part.stack, heights)));
    each.fold(Default::default(), |(needs, effort), (of_one, more)| (needs.or(of_one), effort.and(more)))
}

/// Heights this close to each other are one: far less than the narrowest gap.
pub(super) fn same_height(stack: &LabelStack) -> f64 {
    let gaps = stack.stack.slices.windows(2).map(|w| w[1].z - w[0].z);
    SAME * gaps.fold(f64::INFINITY, f64::min)
}

/// Heights at which every body is made: the output's, and where labels are decided among each other the nodes of all slices, on which it rests what
/// floats, whatever is asked for.
pub(super) fn asked(stack: &LabelStack, decided: bool, output: &[f64]) -> Vec<f64> {
    let mut asked = output.to_vec();
    if decided {
        let same = same_height(stack);
        let z: Vec<f64> = stack.stack.slices.iter().map(|slice| slice.z).collect();
        let known = |z: &f64| {
            let above = output.partition_point(|x| *x < z - same);
            output.get(above).is_some_and(|x| *x <= z + same)
        };
        asked.extend(nodes(&z).into_iter().filter(|z| !known(z)));
        asked.sort_by(f64::total_cmp);
    }
    asked
}

/// The part of a stack that is not empty, with what is around it.
pub(super) struct LabelPiece {
    pub stack: ContourStack,
    /// Its first pixel in the whole image.
    pub origin: [usize; 2],
}

impl LabelPiece {
    /// Of some labels as one body: where labels are united their own part of the image, else all of it.
    pub fn of(stack: &LabelStack, members: &[usize], unite: bool) -> Self {
        let united = stack.united(members);
        if unite { LabelPiece::cut_out(&united) } else { LabelPiece { stack: united, origin: [0; 2] } }
    }

    /// Memory of its reconstruction.
    pub fn needs(&self, heights: &[f64], settings: &Settings) -> MemoryNeeds {
        MemoryNeeds::of(&self.stack, heights, settings, rayon::current_num_threads())
    }

    /// Heights between its contours at which its surface has layers though the output has none, see [`shown_nodes`].
    pub fn shown(&self, output: &[f64]) -> Vec<f64> {
        let z: Vec<f64> = self.stack.slices.iter().map(|slice| slice.z).collect();
        shown_nodes(&z, output, self.stack.spacing[0].min(self.stack.spacing[1]))
    }

    /// Blocks of displacements lie where they lie in the whole image.
    fn cut_out(stack: &ContourStack) -> Self {
        let [nx, ny] = stack.dims;
        let mut low = [usize::MAX; 2];
        let mut high = [0; 2];
        for slice in &stack.slices {
            for n in (0..nx * ny).filter(|&n| slice.content.inside(n)) {
                let pixel = [n % nx, n / nx];
                (0..2).for_each(|a| (low[a], high[a]) = (low[a].min(pixel[a]), high[a].max(pixel[a] + 1)));
            }
        }
        let larger = stack.spacing[0].max(stack.spacing[1]);
        let around = stack.spacing.map(|side| (AROUND * larger / side).ceil() as usize);
        let origin: [usize; 2] =
            std::array::from_fn(|a| low[a].min(stack.dims[a]).saturating_sub(around[a]) / BLOCK * BLOCK);
        let dims: [usize; 2] =
            std::array::from_fn(|a| (high[a] + around[a]).min(stack.dims[a]).max(origin[a] + 1) - origin[a]);
        let cut = |slice: &Slice| {
            let pixels = (0..dims[1]).flat_map(|j| (0..dims[0]).map(move |i| (origin[1] + j) * nx + origin[0] + i));
            let content = SliceContent::Mask(pixels.map(|n| slice.content.inside(n)).collect());
            Slice { name: slice.name.clone(), z: slice.z, extra: slice.extra, content }
        };
        let slices = stack.slices.iter().map(cut).collect();
        LabelPiece { stack: ContourStack { dims, slices, unit: stack.unit.clone(), ..*stack }, origin }
    }
}
