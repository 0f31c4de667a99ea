//! Where a contour has the distance that a layer has at a pixel.
//!
//! Where a flank falls by pixels from a contour to a node, what the contour would be moved by is not what its difference says below the node's
//! surface, beside its own: a neck would widen and a step swing. With u the layer's distance at a pixel and `u_i` that of the contour along the
//! trajectories, with its gradient g, the contour has the distance u at
//!
//! ```text
//! q = p - (1 - rugged) (u_i - u) g / max(|g|^2, 1)
//! ```
//!
//! Rugged relief reads it below, as it keeps P (`plane`): there real terrain is steeper at its contour lines than between them (RMSE of Jacksboro with q 9.412,
//! 14.37, 28.59 m, and 8.995, 13.87, 28.07 without).

use glam::DVec2;

use super::along::add;
use crate::grid::sparse_image::SparseImage;
use crate::registration::displacement::Displacement;

/// Least square of a gradient: near a ridge of the distances ways are the shorter. (Of 112 tubes, gyroids, shells and spheres: distance 0.4834, 0.4825 and
/// 0.4821 mm, volume 3.89, 3.84 and 3.82 % off, with 1/4, 0.8 and 1.)
const LEAST: f64 = 1.0;

/// A contour, as the trajectories through a layer meet it.
pub struct MetContour<'c> {
    /// Its distances.
    pub phi: &'c SparseImage<f32>,
    /// Of the trajectories.
    pub offsets: Option<&'c Displacement>,
    /// Pixel sides.
    pub spacing: [f64; 2],
    /// Degree to which the stack is rugged relief, 0 to 1.
    pub rugged: f64,
}

impl MetContour<'_> {
    /// Ways from the pixels of row `j` from `first` on, at which the layer has the distances `own` and the contour `there`, to where it has those, px.
    pub fn ways(&self, own: &[f32], there: &[f32], [first, j]: [usize; 2], out: &mut [DVec2]) {
        let [nx, ny] = self.phi.dims();
        let (count, rows) = (own.len(), [j.saturating_sub(1), (j + 1).min(ny - 1)]);
        // A pixel more at either end, where there is one.
        let columns = first.saturating_sub(1)..(first + count + 1).min(nx);
        let mut line = vec![0.0; columns.len()];
        add(self.phi, 1.0, self.offsets, j, columns.start, &mut line);
        let [mut below, mut above] = [(); 2].map(|()| vec![0.0; count]);
        add(self.phi, 1.0, self.offsets, rows[0], first, &mut below);
        add(self.phi, 1.0, self.offsets, rows[1], first, &mut above);
        let [dx, dy] = self.spacing;
        for (k, way) in out.iter_mut().enumerate() {
            let at = first + k;
            let beside = [at.saturating_sub(1), (at + 1).min(nx - 1)];
            let rise = f64::from(line[beside[1] - columns.start] - line[beside[0] - columns.start]);
            let gx = rise / (dx * (beside[1] - beside[0]).max(1) as f64);
            let gy = f64::from(above[k] - below[k]) / (dy * (rows[1] - rows[0]).max(1) as f64);
            let far = (1.0 - self.rugged) * f64::from(there[k] - own[k]) / (gx * gx + gy * gy).max(LEAST);
            *way = DVec2::new(-far * gx / dx, -far * gy / dy);
        }
    }
}
