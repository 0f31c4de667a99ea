//! Layers moved by the curve through the corrections of their nodes.

use super::fairing::ReferenceFairing;
use super::fairing_limit::cut;
use super::fairing_paths::add;
use crate::backend::fairing::LayerMove;
use crate::grid::tiled::Packed;

impl ReferenceFairing<'_> {
    /// A layer between two contours, moved: `u + C`, cut off at the room between them, at most the farthest distance, never 0.
    pub(super) fn layer(&self, layer: &LayerMove, ends: [usize; 2]) -> Packed<f32> {
        let of = |&(k, w): &(usize, f64)| Some((self.node(k)?.correction.as_ref()?, w as f32));
        let terms: Vec<(&Packed<f32>, f32)> = layer.curve.iter().filter_map(of).collect();
        let (nx, farthest, side) = (self.frame.dims[0], self.frame.farthest as f32, self.frame.side() as f32);
        let ends = ends.map(|k| self.node(k).map(|node| &node.phi));
        let [moved] = Packed::of_rows(self.frame.dims, |first, [rows]: [&mut [f32]; 1]| {
            let mut sum = vec![0.0f32; nx];
            for (j, row) in (first..).zip(rows.chunks_exact_mut(nx)) {
                layer.phi.read(0, j, row);
                sum.fill(0.0);
                terms.iter().for_each(|(correction, w)| add(correction, *w, None, j, 0, &mut sum));
                for (n, (u, c)) in row.iter_mut().zip(&sum).enumerate().filter(|(_, (_, c))| **c != 0.0) {
                    let mut c = *c;
                    if let (true, [Some(low), Some(high)]) = (self.frame.limited, ends) {
                        c = cut(c, *u, [low.at(n, j), high.at(n, j)], side);
                    }
                    *u = (*u + c).clamp(-farthest, farthest);
                    if *u == 0.0 {
                        *u = f32::MIN_POSITIVE;
                    }
                }
            }
        });
        moved
    }
}
