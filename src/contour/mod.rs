//! The input contours as the host stages see them: level set, parts, seeds.

pub mod canvas;
pub mod caps;
pub mod direction;
pub(crate) mod offsets;
pub(crate) mod open_part;
pub mod overlap;
pub mod parts;
pub mod seeds;
pub(crate) mod termination;
pub(crate) mod unmatched;

use std::f64::consts::PI;
use std::ops::Range;

use crate::contour::seeds::{Seed, seeds};
use crate::grid::components::{Components, count8, label4, label8};
use crate::grid::field::{Field, covered};
use crate::grid::seen::Seen;
use crate::grid::tile::Tile;
use crate::storage::spill::{Array, Large};

/// Bounding box `(low, high)` of a part, both ends included.
pub type Extent = ([usize; 2], [usize; 2]);

/// One input contour on the padded image.
#[derive(Debug, Clone, Default)]
pub struct Contour {
    /// Height.
    pub z: f64,
    /// Its level set, px; `inf` everywhere for an empty slice.
    pub phi: Field,
    /// 4-connected solid parts.
    pub solids: Components,
    /// Number of holes: 8-connected parts of the background but the outside.
    pub holes: usize,
    /// Tracker seeds along the contour, pixels of the padded image.
    pub seeds: Vec<Seed>,
    /// Inradius of each solid part, px, by number; entry 0 is unused.
    pub solid_depth: Vec<f64>,
    /// Bounding box of each solid part.
    pub solid_box: Vec<Extent>,
}

impl Contour {
    /// Labels and seeds for a level set.
    pub fn new(z: f64, phi: Field, h: [f64; 2], seed_spacing: f64) -> Self {
        let seeds = seeds(&phi, h, seed_spacing);
        Contour::with_seeds(z, phi, seeds)
    }

    /// Labels for a level set with given seeds.
    pub fn with_seeds(z: f64, phi: Field, seeds: Vec<Seed>) -> Self {
        let mut side = phi.inside();
        let solids = label4(&side, phi.dims);
        side.iter_mut().for_each(|inside| *inside = !*inside);
        let holes = count8(&side, phi.dims).saturating_sub(1);
        let (solid_depth, solid_box) = measured(&solids, &phi);
        Contour { z, seeds, phi, solids, holes, solid_depth, solid_box }
    }

    /// Its holes as solid parts, 8-connected and negative inside, with its seeds by number.
    pub fn turned(&self) -> Self {
        // What lies on the contour itself is outside, and so within a hole.
        let turned = |v: &f64| if *v == 0.0 { -f64::MIN_POSITIVE } else { -v };
        let phi = Field { dims: self.phi.dims, data: self.phi.data.iter().map(turned).collect() };
        let mut solids = label8(&phi.inside(), phi.dims);
        // The first pixel is outside, as the whole rim of a padded image is.
        solids.labels.iter_mut().for_each(|label| *label = label.saturating_sub(1));
        solids.count = solids.count.saturating_sub(1);
        let (solid_depth, solid_box) = measured(&solids, &phi);
        let turned = |seed: &Seed| Seed { inside: seed.outside, outside: seed.inside, ..*seed };
        let seeds = self.seeds.iter().map(turned).collect();
        Contour { z: self.z, phi, solids, holes: 0, seeds, solid_depth, solid_box }
    }

    /// Numbers the solid parts in row order of their first pixels in these columns and rows, which each of them reaches: what lies around may
    /// come first in the rows.
    pub fn number_within(&mut self, [columns, rows]: &[Range<usize>; 2]) {
        let nx = self.phi.dims[0];
        let mut numbers = vec![0u32; self.solids.count + 1];
        let mut next = 0;
        for j in rows.clone() {
            for label in &self.solids.labels[j * nx..][columns.clone()] {
                if *label > 0 && numbers[*label as usize] == 0 {
                    next += 1;
                    numbers[*label as usize] = next;
                }
            }
        }
        for number in numbers.iter_mut().skip(1).filter(|number| **number == 0) {
            next += 1;
            *number = next;
        }
        self.solids.labels.iter_mut().for_each(|label| *label = numbers[*label as usize]);
        let (mut depth, mut boxes) = (self.solid_depth.clone(), self.solid_box.clone());
        for (old, new) in numbers.iter().enumerate() {
            depth[*new as usize] = self.solid_depth[old];
            boxes[*new as usize] = self.solid_box[old];
        }
        (self.solid_depth, self.solid_box) = (depth, boxes);
    }

    /// Its seeds alone, of what [`SpillVec::some`](crate::storage::spill::SpillVec::some) gives.
    pub const SEEDS: &[usize] = &[0];
    /// Its level set alone.
    pub const FIELD: &[usize] = &[1];
    /// Its parts alone.
    pub const PARTS: &[usize] = &[2];
    /// Its seeds and its level set, but not the parts.
    pub const SEEDS_AND_FIELD: &[usize] = &[0, 1];
    /// Its seeds and its parts, but not the level set.
    pub const SEEDS_AND_PARTS: &[usize] = &[0, 2];

    /// The tile of some solid parts and `margin` pixels around them.
    pub fn tile_of(&self, parts: &[u32], margin: [usize; 2]) -> Tile {
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for &p in parts {
            let (a, b) = self.solid_box[p as usize];
            low = [low[0].min(a[0]), low[1].min(a[1])];
            high = [high[0].max(b[0]), high[1].max(b[1])];
        }
        Tile::spanning(self.phi.dims, margin, low, high)
    }

    /// Its area, px squared. Of a contour that the image's border cuts that of a whole disc: its radius is that of the sector which has the
    /// contour's area `A` and perimeter `P` on the image, `2 A / P`.
    pub fn disc_area(&self, seen: &Seen, h: [f64; 2]) -> f64 {
        let nx = self.phi.dims[0];
        let sum = |share: &dyn Fn(f64) -> f64| {
            let counted = self.phi.data.iter().enumerate().filter(|(node, _)| seen.has(*node, nx));
            counted.map(|(_, v)| share(*v)).sum::<f64>() * h[0] * h[1]
        };
        let area = sum(&|v| f64::from(u8::from(v < 0.0)));
        let is_cut = seen.edges(self.phi.dims).iter().any(|pair| pair.iter().all(|node| self.phi.data[*node] < 0.0));
        if !is_cut {
            return area;
        }
        let perimeter = sum(&|v| covered(v - 0.5) - covered(v + 0.5));
        PI * (2.0 * area / perimeter.max(1.0)).powi(2)
    }
}

impl Large for Contour {
    fn arrays(&mut self) -> Vec<Array<'_>> {
        vec![&mut self.seeds, &mut self.phi.data, &mut self.solids.labels]
    }
}

/// Largest |phi| within each part, and the bounding boxes of all. Rows are passed over run by run: most of an image is background.
fn measured(parts: &Components, phi: &Field) -> (Vec<f64>, Vec<Extent>) {
    let mut depths = vec![0.0f64; parts.count + 1];
    let mut boxes = vec![([usize::MAX; 2], [0; 2]); parts.count + 1];
    let nx = phi.dims[0].max(1);
    for (j, (labels, values)) in parts.labels.chunks_exact(nx).zip(phi.data.chunks_exact(nx)).enumerate() {
        let mut i = 0;
        while i < nx {
            let label = labels[i];
            let end = end_of_run(labels, i);
            if label > 0 {
                let depth = &mut depths[label as usize];
                *depth = values[i..end].iter().fold(*depth, |depth, v| depth.max(v.abs()));
                let (low, high) = &mut boxes[label as usize];
                *low = [low[0].min(i), low[1].min(j)];
                *high = [high[0].max(end - 1), high[1].max(j)];
            }
            i = end;
        }
    }
    (depths, boxes)
}

/// Pixels of a run that are looked at together.
const LANES: usize = 16;

/// The first pixel of a row behind those from `from` on that have one label.
fn end_of_run(labels: &[u32], from: usize) -> usize {
    let (label, mut end) = (labels[from], from);
    while labels.get(end..end + LANES).is_some_and(|some| some.iter().fold(true, |all, other| all & (*other == label)))
    {
        end += LANES;
    }
    labels[end..].iter().position(|other| *other != label).map_or(labels.len(), |more| end + more)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_that_the_border_cuts_through_its_middle_counts_as_the_whole_one() {
        let disc = |i: usize, j: usize| libm::hypot(i as f64 - 19.5, j as f64 - 19.5) - 11.0;
        let contour = Contour::with_seeds(0.0, Field::from_fn([40, 40], disc), Vec::new());
        for part in [[0..40, 0..40], [20..40, 0..40], [0..40, 0..20], [20..40, 20..40]] {
            let radius = (contour.disc_area(&Seen::image(part.clone()), [1.0; 2]) / PI).sqrt();
            assert!((radius - 11.0).abs() < 0.3, "{part:?}: {radius}, of whole pixels");
        }
    }

    #[test]
    fn turned_its_holes_are_its_parts() {
        let away = |i: usize, j: usize, x: f64, y: f64| libm::hypot(i as f64 - x, j as f64 - y);
        // A hole with an island in it, and another.
        let value = |i, j| {
            let island = away(i, j, 20.0, 24.0) - 3.0;
            (away(i, j, 24.0, 24.0) - 20.0)
                .max(8.0 - away(i, j, 20.0, 24.0))
                .max(4.5 - away(i, j, 36.0, 24.0))
                .min(island)
        };
        let contour = Contour::new(1.0, Field::from_fn([50, 50], value), [1.0; 2], 1.0);
        let turned = contour.turned();
        assert_eq!([contour.solids.count, contour.holes, turned.solids.count, turned.z as usize], [2, 2, 2, 1]);
        assert_eq!(turned.solid_box[1..], [([12, 16], [28, 32]), ([32, 20], [40, 28])]);
        assert!((turned.solid_depth[2] - 4.5).abs() < 1e-9, "{:?}", turned.solid_depth);
        assert_eq!(turned.seeds.len(), contour.seeds.len());
        for (a, b) in contour.seeds.iter().zip(&turned.seeds) {
            assert!(a.x == b.x && a.inside == b.outside && turned.phi.data[b.inside] < 0.0);
            let outer = away(a.outside % 50, a.outside / 50, 24.0, 24.0) > 19.0;
            assert_eq!(turned.solids.labels[b.inside] == 0, outer, "{a:?}");
        }
    }

    #[test]
    fn parts_are_numbered_within_the_image() {
        // Beyond the image, above row 4, the right part comes first; on the image the left one does.
        let inside = |i: usize, j: usize| {
            ((2..5).contains(&i) && (4..9).contains(&j)) || ((7..11).contains(&i) && (1..9).contains(&j))
        };
        let phi = Field::from_fn([12, 12], |i, j| if inside(i, j) { -1.0 - i as f64 } else { 1.0 });
        let mut contour = Contour::with_seeds(0.0, phi, Vec::new());
        let at = |contour: &Contour| [2, 7].map(|i| contour.solids.labels[6 * 12 + i]);
        assert_eq!(at(&contour), [2, 1]);
        contour.number_within(&[1..12, 4..12]);
        assert_eq!(at(&contour), [1, 2]);
        assert_eq!(contour.solid_depth[1..], [5.0, 11.0]);
        assert_eq!(contour.solid_box[1..], [([2, 4], [4, 8]), ([7, 1], [10, 8])]);
    }
}
