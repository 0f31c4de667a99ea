//! Certificate of a body, read off its layers and nothing else: it cannot know how they were made.
//!
//! Per contour the layers a thousandth of the gap below and above it ([`BESIDE`]); over all layers that are handed on the pieces that touch no
//! contour, the pairs of overlapping parts that are not connected between their contours, the intervals that nothing crosses, the largest step, and what
//! the ends add around their contour.

use std::collections::BTreeSet;
use std::mem::take;

use rayon::prelude::*;

use crate::connectivity::runs::{DisjointSets, Runs, Side};
use crate::grid::sparse_image::{SQUARE, SparseImage};
use crate::grid::union::unite_packed;
use crate::reference::exact::exact_distance;
use crate::report::{BodyReport, PartPair, Step, StepBeside};
use crate::stack::heights::BESIDE;
use crate::surface::Layer;
use crate::surface::areas::area;

/// Layers up to this much farther off count as beside a contour, too.
const AROUND: f64 = 1.5;

/// A course is at most this many times as steep as the straight one: the bound of the monotone rules.
const STEEPEST: f64 = 3.0;

/// Pixels along an axis of which the way between two contours is told, at most: it takes 15 MiB, whatever the image.
const LOOKED_AT: usize = 512;

/// Distance to the surface up to which changes count, px.
const NEAR: f32 = 1.0;

/// Facts about one contour.
#[derive(Debug, Clone, Copy, Default)]
pub struct Met {
    /// Its layer's area, unit squared.
    pub area: f64,
    /// Just below it.
    pub below: Option<StepBeside>,
    /// Just above.
    pub above: Option<StepBeside>,
}

/// A stack as its certificate sees it.
#[derive(Debug, Clone)]
pub struct CertificateSpec {
    /// Pixels of a layer.
    pub dims: [usize; 2],
    /// Pixel spacing.
    pub spacing: [f64; 2],
    /// Heights of the contours.
    pub z: Vec<f64>,
    /// Number of the first of them in the stack.
    pub first: usize,
}

/// What a layer says by itself and beside the one before it.
struct Facts {
    /// Area of a contour's.
    area: f64,
    /// Runs of one that is handed on or a contour's.
    runs: Option<[Runs; 2]>,
    /// Change from the one before.
    step: Option<Step>,
}

/// Looks at layers as they come, lowest first.
#[derive(Debug)]
pub struct Examined {
    spec: CertificateSpec,
    pieces: [Pieces; 2],
    /// Number and layer of the contour below.
    contour: Option<(usize, SparseImage<f32>)>,
    /// The layer before, of those that are handed on.
    before: Option<(f64, SparseImage<f32>)>,
    /// The last layer, where it lies just below the next contour.
    beside: Option<SparseImage<f32>>,
    /// Least distance of each pixel below the first contour.
    lower: Option<SparseImage<f32>>,
    /// Overlapping pairs of parts, and whether they are connected.
    overlapping: Vec<(PartPair, bool)>,
    /// Facts about the contours.
    pub contours: Vec<Met>,
    /// And of the body.
    pub body: BodyReport,
}

impl Examined {
    /// Nothing yet.
    pub fn new(spec: CertificateSpec) -> Self {
        Examined {
            contours: vec![Met::default(); spec.z.len()],
            pieces: [Side::Inside, Side::Outside].map(|side| Pieces::new(side, spec.dims[0])),
            spec,
            contour: None,
            before: None,
            beside: None,
            lower: None,
            overlapping: Vec::new(),
            body: BodyReport::default(),
        }
    }

    /// The next layers; handed on or not.
    pub fn layers(&mut self, layers: &[(&Layer, bool)]) {
        let facts: Vec<Facts> = (0..layers.len()).into_par_iter().map(|k| self.facts(layers, k)).collect();
        let mut lowest = self.before.is_none();
        for ((layer, handed), facts) in layers.iter().zip(facts) {
            match (layer.contour, facts.runs) {
                (Some(i), Some(ends)) => self.at_contour(i, layer, facts.area, ends),
                (_, runs) => self.between(layer, runs, lowest),
            }
            lowest &= !handed;
            if let Some(step) = facts.step
                && self.body.largest_step.is_none_or(|known| step.px > known.px)
            {
                self.body.largest_step = Some(step);
            }
        }
        if let Some((last, _)) = layers.iter().rev().find(|(_, handed)| *handed) {
            self.before = Some((last.z, last.phi.clone()));
        }
    }

    /// What layer `k` of some says by itself and beside the one before it, of those that are handed on.
    fn facts(&self, layers: &[(&Layer, bool)], k: usize) -> Facts {
        let (layer, handed) = layers[k];
        let known = self.before.as_ref().map(|(z, phi)| (*z, phi));
        let before = layers[..k].iter().rev().find(|(_, handed)| *handed).map(|(layer, _)| (layer.z, &layer.phi));
        Facts {
            area: if layer.contour.is_some() { self.area(&layer.phi) } else { 0.0 },
            runs: (handed || layer.contour.is_some()).then(|| Runs::both(&layer.phi)),
            step: before.or(known).filter(|_| handed).and_then(|before| self.step(before, layer)),
        }
    }

    /// Findings, but for pairs of parts of every interval that are kept apart.
    pub fn finish(mut self, parted: &[Vec<(u32, u32)>]) -> (Vec<Met>, BodyReport) {
        // Above the last contour; beyond the last layer everything is outside.
        self.pieces[1].ground_last();
        self.count();
        for (pair, connected) in self.overlapping {
            if parted.get(pair.slice - self.spec.first).is_some_and(|apart| apart.contains(&(pair.from, pair.to))) {
                continue;
            }
            self.body.overlapping += 1;
            if !connected {
                self.body.torn.push(pair);
            }
        }
        (self.contours, self.body)
    }

    fn at_contour(&mut self, i: usize, layer: &Layer, area: f64, ends: [Runs; 2]) {
        self.contours[i].area = area;
        if let Some(beside) = self.beside.take() {
            self.contours[i].below = Some(self.beside_of(&layer.phi, &beside));
        }
        self.explain(i, &layer.phi);
        if i == 0 {
            self.body.beyond[0] = self.lower.take().map_or(0, |lower| around(&layer.phi, &lower));
        }
        let inside = ends[0].clone();
        for (pieces, runs) in self.pieces.iter_mut().zip(ends) {
            pieces.add(runs);
            pieces.ground_last();
        }
        let below = self.contour.as_ref().map(|(i, _)| *i);
        if let Some(i) = below {
            self.pairs(i, &inside);
        }
        self.count();
        self.pieces.iter_mut().for_each(Pieces::begin);
        self.contour = Some((i, layer.phi.clone()));
    }

    /// Looks at the way from the contour below to contour `i`, where the surface steps beside one of them.
    fn explain(&mut self, i: usize, contour: &SparseImage<f32>) {
        let Some((i_low, low)) = &self.contour else { return };
        let sides = [self.contours[*i_low].above, self.contours[i].below];
        if sides.into_iter().flatten().all(|beside| beside.holds()) {
            return;
        }
        let explained = Some(STEEPEST * BESIDE * self.way([low, contour]));
        let [above, below] = sides.map(|beside| beside.map(|b| StepBeside { explained, ..b }));
        (self.contours[*i_low].above, self.contours[i].below) = (above, below);
    }

    /// The way that the surface has to go between two contours, px: how deep below the edge of one lies what is outside of the other. Of large
    /// images, only every few pixels are looked at.
    fn way(&self, layers: [&SparseImage<f32>; 2]) -> f64 {
        let step = self.spec.dims[0].max(self.spec.dims[1]).div_ceil(LOOKED_AT);
        let dims = self.spec.dims.map(|n| n.div_ceil(step));
        let h = self.spec.spacing.map(|side| step as f64 * side / self.px());
        let inside = |phi: &SparseImage<f32>| -> Vec<bool> {
            (0..dims[0] * dims[1]).map(|n| phi.at(n % dims[0] * step, n / dims[0] * step) < 0.0).collect()
        };
        let [a, b] = layers.map(inside);
        let deepest = |own: &[bool], other: &[bool]| {
            let depths = exact_distance(own, dims, h).data;
            let left = depths.iter().zip(other).filter(|(d, other)| !**other && d.is_finite());
            left.map(|(d, _)| -d).fold(0.0, f64::max)
        };
        deepest(&a, &b).max(deepest(&b, &a))
    }

    /// A layer that is no contour's, with its runs where it is handed on; the `lowest` of those, or not.
    fn between(&mut self, layer: &Layer, runs: Option<[Runs; 2]>, lowest: bool) {
        let z = &self.spec.z;
        let above = z.partition_point(|v| *v < layer.z);
        if above > 0 && above < z.len() {
            let near = AROUND * BESIDE * (z[above] - z[above - 1]);
            if layer.z - z[above - 1] <= near
                && let Some((i, contour)) = self.contour.as_ref().filter(|(i, _)| self.contours[*i].above.is_none())
            {
                self.contours[*i].above = Some(self.beside_of(contour, &layer.phi));
            }
            self.beside = (z[above] - layer.z <= near).then(|| layer.phi.clone());
        }
        let Some(runs) = runs else { return };
        if above == 0 {
            match &mut self.lower {
                Some(lower) => unite_packed(lower, self.spec.dims.map(|n| 0..n), [0; 2], &layer.phi, |v| v),
                none => *none = Some(layer.phi.clone()),
            }
        } else if above == z.len()
            && let Some((_, contour)) = &self.contour
        {
            self.body.beyond[1] = self.body.beyond[1].max(around(contour, &layer.phi));
        }
        for (pieces, runs) in self.pieces.iter_mut().zip(runs) {
            pieces.add(runs);
            if lowest && pieces.side == Side::Outside {
                pieces.ground_last();
            }
        }
    }

    /// Adds what floats since the last contour.
    fn count(&mut self) {
        let [floating, voids] = self.pieces.each_mut().map(Pieces::floating);
        self.body.floating += floating;
        self.body.voids += voids;
    }

    /// Looks whether any part of contour `i` is connected with one of the next, whose parts are `above`, and notes for overlapping ones whether they are.
    fn pairs(&mut self, i: usize, above: &Runs) {
        let pieces = &mut self.pieces[0];
        if pieces.low.count > 0 && above.count > 0 && !pieces.cross() {
            self.body.apart.push(self.spec.first + i);
        }
        let mut pairs = BTreeSet::new();
        pieces.low.meeting(above, |a, b| _ = pairs.insert((a as u32 + 1, b as u32 + 1)));
        for (from, to) in pairs {
            let connected = pieces.connects(from as usize - 1, to as usize - 1);
            self.overlapping.push((PartPair { slice: self.spec.first + i, from, to }, connected));
        }
    }

    /// The change from the layer before, between the first and the last contour: beyond, the body may end flat.
    fn step(&self, (z, before): (f64, &SparseImage<f32>), layer: &Layer) -> Option<Step> {
        let [low, high] = [self.spec.z.first(), self.spec.z.last()].map(|z| z.copied().unwrap_or_default());
        (z >= low && layer.z <= high).then(|| Step { from: z, to: layer.z, px: self.change(before, &layer.phi) })
    }

    fn beside_of(&self, contour: &SparseImage<f32>, beside: &SparseImage<f32>) -> StepBeside {
        StepBeside { area: self.area(beside), jump: self.change(contour, beside), explained: None }
    }

    /// Largest difference of two layers at pixels near the surface of the first, px.
    fn change(&self, from: &SparseImage<f32>, to: &SparseImage<f32>) -> f64 {
        let px = self.px();
        let near = NEAR * px as f32;
        // The largest of each column of a square: they are looked at together.
        let mut most = [0.0f32; SQUARE];
        for square in from.each_square().filter(|square| from.whole(*square).is_none_or(|v| v.abs() < near)) {
            for (from, to) in from.of_square(square).zip(to.of_square(square)) {
                for (most, (a, b)) in most.iter_mut().zip(from.iter().zip(to)) {
                    *most = most.max(if a.abs() < near { (a - b).abs() } else { 0.0 });
                }
            }
        }
        f64::from(most.into_iter().fold(0.0, f32::max)) / px
    }

    fn area(&self, phi: &SparseImage<f32>) -> f64 {
        area(phi, self.spec.spacing)
    }

    fn px(&self) -> f64 {
        self.spec.spacing[0].max(self.spec.spacing[1])
    }
}

/// Pixels that are outside of a contour and inside another layer.
fn around(contour: &SparseImage<f32>, layer: &SparseImage<f32>) -> usize {
    let of_square = |square| match layer.whole(square) {
        Some(v) if v >= 0.0 => 0,
        _ => {
            let pairs = contour.of_square(square).flatten().zip(layer.of_square(square).flatten());
            pairs.filter(|(c, v)| **c > 0.0 && **v < 0.0).count()
        }
    };
    layer.each_square().map(of_square).sum()
}

/// The pieces of one side over the layers since the last contour, that contour's included.
#[derive(Debug)]
struct Pieces {
    side: Side,
    nx: usize,
    joined: DisjointSets,
    /// Parts that need no other to hang on.
    ground: Vec<usize>,
    /// Parts of the contour below, which are the first.
    low: Runs,
    /// Parts of the last layer, and the number of the first of them.
    last: (Runs, usize),
    layers: usize,
}

impl Pieces {
    fn new(side: Side, nx: usize) -> Self {
        Pieces {
            side,
            nx,
            joined: DisjointSets::default(),
            ground: Vec::new(),
            low: Runs::default(),
            last: (Runs::default(), 0),
            layers: 0,
        }
    }

    /// Begins anew from the last layer, a contour.
    fn begin(&mut self) {
        let low = take(&mut self.last.0);
        *self = Pieces {
            joined: DisjointSets::new(low.count),
            ground: (0..low.count).collect(),
            low: low.clone(),
            last: (low, 0),
            layers: 1,
            ..Pieces::new(self.side, self.nx)
        };
    }

    fn add(&mut self, runs: Runs) {
        let first = self.joined.more(runs.count);
        if self.layers > 0 {
            let (last, below) = &self.last;
            last.meeting(&runs, |a, b| self.joined.join(below + a, first + b));
        }
        if self.side == Side::Outside {
            self.ground.extend(runs.at_edge(self.nx).map(|part| first + part));
        }
        self.last = (runs, first);
        self.layers += 1;
    }

    /// Parts of the last layer need no other.
    fn ground_last(&mut self) {
        let (last, first) = &self.last;
        self.ground.extend(*first..first + last.count);
    }

    /// Whether a part of the contour below and one of the last layer are one piece.
    fn connects(&mut self, low: usize, last: usize) -> bool {
        self.joined.root(low) == self.joined.root(self.last.1 + last)
    }

    /// Whether any piece goes from the contour below to the last layer.
    fn cross(&mut self) -> bool {
        let low: BTreeSet<usize> = (0..self.low.count).map(|part| self.joined.root(part)).collect();
        let (first, count) = (self.last.1, self.last.0.count);
        (first..first + count).any(|part| low.contains(&self.joined.root(part)))
    }

    /// Number of pieces that hang on nothing.
    fn floating(&mut self) -> usize {
        let count = self.last.1 + self.last.0.count;
        let ground: BTreeSet<usize> = self.ground.iter().map(|&k| self.joined.root(k)).collect();
        (0..count).filter(|&k| self.joined.root(k) == k && !ground.contains(&k)).count()
    }
}

#[cfg(test)]
mod tests {

    use super::*;

    const N: usize = 12;

    /// The pieces of a layer with these columns of row 5 inside, the first and the one behind the last.
    fn runs(columns: &[[usize; 2]]) -> Runs {
        let inside = |n: usize| n / N == 5 && columns.iter().any(|[first, end]| (*first..*end).contains(&(n % N)));
        let phi: Vec<f32> = (0..N * N).map(|n| if inside(n) { -0.5 } else { 0.5 }).collect();
        Runs::new(&SparseImage::of([N; 2], &phi), Side::Inside)
    }

    #[test]
    fn a_pair_that_a_layer_between_does_not_join_is_torn_and_floats() {
        let mut pieces = Pieces::new(Side::Inside, N);
        pieces.add(runs(&[[1, 3], [6, 9]]));
        pieces.begin();
        pieces.add(runs(&[[1, 4]]));
        pieces.add(runs(&[[2, 4], [6, 8], [10, 11]]));
        assert!(pieces.connects(0, 0) && !pieces.connects(1, 1) && !pieces.connects(0, 1) && !pieces.connects(1, 0));
        assert_eq!(pieces.floating(), 2, "both that hang on nothing below");
        pieces.ground_last();
        assert_eq!(pieces.floating(), 0, "the last layer is a contour");
        pieces.begin();
        pieces.add(runs(&[[2, 11]]));
        assert!((0..3).all(|part| pieces.connects(part, 0)));
    }

    #[test]
    fn a_pixel_is_as_long_as_its_longer_side() {
        for spacing in [[2.0, 1.0], [1.0, 2.0], [2.0, 2.0]] {
            let spec = CertificateSpec { dims: [N; 2], spacing, z: vec![0.0, 1.0], first: 0 };
            assert_eq!(Examined::new(spec).px(), 2.0);
        }
    }

    #[test]
    fn a_change_is_as_large_whichever_way_the_surface_goes() {
        let spec = CertificateSpec { dims: [N; 2], spacing: [2.0; 2], z: vec![0.0, 1.0], first: 0 };
        let examined = Examined::new(spec);
        let layer = |by: f32| {
            let phi: Vec<f32> = (0..N * N).map(|n| 2.0 * (n % N) as f32 - 9.0 + by).collect();
            SparseImage::of([N; 2], &phi)
        };
        for by in [1.5, -1.5] {
            assert_eq!(examined.change(&layer(0.0), &layer(by)), 0.75);
        }
    }
}
