//! A slice with its holes filled, and the holes.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::contour::Contour;
use crate::error::Result;
use crate::grid::components::Components;
use crate::storage::spill::SpillVec;

/// A slice with its holes filled, and the holes, by number.
pub(in crate::pipeline) struct HollowSlice {
    /// The slice's parts with all that lies within them: those that lie within another one have no pixel.
    pub filled: Components,
    /// The holes, 8-connected.
    pub holes: Components,
    /// Bounding box of each hole, as [`Contour::solid_box`].
    pub hole_box: Vec<([usize; 2], [usize; 2])>,
    /// The outermost part around each hole.
    pub around: Vec<u32>,
}

impl HollowSlice {
    pub fn new(contour: &Contour) -> Self {
        let nx = contour.phi.dims[0];
        if contour.holes == 0 {
            let holes = Components { labels: vec![0; contour.phi.data.len()], count: 0 };
            return HollowSlice { filled: contour.solids.clone(), holes, hole_box: Vec::new(), around: vec![0] };
        }
        let Contour { solids: holes, solid_box: hole_box, .. } = contour.turned();
        // What lies above a part's first pixel in the order of rows is what the part lies in.
        let above = |of: &Components, other: &Components| {
            let mut above = vec![0u32; of.count + 1];
            for (n, part) in of.labels.iter().enumerate().rev().filter(|(_, part)| **part > 0) {
                above[*part as usize] = if n < nx { 0 } else { other.labels[n - nx] };
            }
            above
        };
        let (around, within) = (above(&holes, &contour.solids), above(&contour.solids, &holes));
        let outermost = |mut part: u32| {
            while within[part as usize] > 0 {
                part = around[within[part as usize] as usize];
            }
            part
        };
        let parts: Vec<u32> = (0..within.len() as u32).map(outermost).collect();
        let around: Vec<u32> = around.iter().map(|part| parts[*part as usize]).collect();
        let label = |(part, hole): (&u32, &u32)| if *hole > 0 { around[*hole as usize] } else { parts[*part as usize] };
        let labels = contour.solids.labels.iter().zip(&holes.labels).map(label).collect();
        let filled = Components { labels, count: contour.solids.count };
        HollowSlice { filled, holes, hole_box, around }
    }

    /// The holes of some outermost parts.
    pub fn holes_of(&self, parts: &BTreeSet<u32>) -> BTreeSet<u32> {
        (1..self.around.len() as u32).filter(|hole| parts.contains(&self.around[*hole as usize])).collect()
    }
}

/// The slices of a stack, made when they are first asked for.
pub(in crate::pipeline) struct HollowSlices<'r, 'b> {
    contours: &'r SpillVec<'b, Contour>,
    known: BTreeMap<usize, Arc<HollowSlice>>,
}

impl<'r, 'b> HollowSlices<'r, 'b> {
    pub fn new(contours: &'r SpillVec<'b, Contour>) -> Self {
        HollowSlices { contours, known: BTreeMap::new() }
    }

    /// Slice `k`.
    ///
    /// # Errors
    /// The errors of the shelf.
    pub fn get(&mut self, k: usize) -> Result<Arc<HollowSlice>> {
        if let Some(known) = self.known.get(&k) {
            return Ok(known.clone());
        }
        let made = Arc::new(HollowSlice::new(&*self.contours.get(k)?));
        Ok(self.known.entry(k).or_insert(made).clone())
    }

    /// Nobody asks for the slices below `k` any more.
    pub fn forget_below(&mut self, k: usize) {
        self.known = self.known.split_off(&k);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;

    #[test]
    fn what_lies_in_a_hole_is_filled_with_it() {
        const DIMS: [usize; 2] = [70, 30];
        // A ring, a smaller one within it, and a disc beside.
        let ring = |i: usize, j: usize, r: f64| (libm::hypot(i as f64 - 20.0, j as f64 - 14.0) - r).abs() - 1.6;
        let value = |i: usize, j: usize| {
            ring(i, j, 11.0).min(ring(i, j, 5.0)).min(libm::hypot(i as f64 - 50.0, j as f64 - 14.0) - 6.0)
        };
        let contour = Contour::new(0.0, Field::from_fn(DIMS, value), [1.0; 2], 1.0);
        assert_eq!([contour.solids.count, contour.holes], [3, 2]);
        let slice = HollowSlice::new(&contour);
        let part = |i: usize| contour.solids.labels[14 * DIMS[0] + i];
        let [outer, disc] = [part(9), part(50)];
        assert_eq!(slice.around[1..], [outer; 2]);
        for (i, wanted) in [(9, outer), (12, outer), (16, outer), (20, outer), (50, disc), (35, 0)] {
            assert_eq!(slice.filled.labels[14 * DIMS[0] + i], wanted, "column {i}");
        }
        assert_eq!(slice.holes_of(&BTreeSet::from([outer])).len(), 2);
        assert!(slice.holes_of(&BTreeSet::from([disc])).is_empty());
        let solid = HollowSlice::new(&Contour::new(0.0, Field::from_fn(DIMS, |i, _| i as f64 - 20.0), [1.0; 2], 1.0));
        assert!(solid.holes.count == 0 && solid.holes_of(&BTreeSet::from([1])).is_empty());
    }
}
