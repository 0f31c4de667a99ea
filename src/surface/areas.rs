//! Area of the body's layers over its height.

use rayon::prelude::*;

use crate::grid::field::covered;
use crate::grid::sparse_image::SparseImage;
use crate::report::AreaProfile;
use crate::surface::Layer;
use crate::surface::header::Header;

/// Pixels of a layer that one thread looks at: fewer are done before others have begun.
pub const OF_A_THREAD: usize = 1 << 20;
/// Most layers that are kept: from there on every other one is, but for the contours.
const MOST: usize = 4096;

/// Adds up areas while layers arrive.
#[derive(Debug)]
pub struct Areas {
    spacing: [f64; 2],
    extent: [f64; 2],
    /// Height, area, and whether it is a contour.
    kept: Vec<([f64; 2], bool)>,
    /// Number of layers that are no contours, of which one is kept.
    every: usize,
    /// Layers since the last one kept.
    since: usize,
    last: Option<[f64; 2]>,
    /// Integral from the first contour up to the last layer, and up to the last contour.
    sums: [f64; 2],
    begun: bool,
}

/// Area inside a layer: the sum of what each pixel has covered by its distance, times the pixel's area; 0 where no pixel is inside.
pub fn area(phi: &SparseImage<f32>, [dx, dy]: [f64; 2]) -> f64 {
    let px = dx.max(dy);
    let share = |v: f32| covered(f64::from(v) / px);
    let [columns, rows] = phi.squares();
    let of_row = |row: usize| {
        let (mut inside, mut sum) = (false, 0.0);
        for square in (0..columns).map(|column| [column, row]) {
            match phi.whole(square) {
                Some(v) => {
                    inside |= v < 0.0;
                    sum += share(v) * phi.size_of_square(square).iter().product::<usize>() as f64;
                }
                None => phi.of_square(square).flatten().for_each(|v| {
                    inside |= *v < 0.0;
                    sum += share(*v);
                }),
            }
        }
        (inside, sum)
    };
    let sums: Vec<(bool, f64)> = match phi.dims().iter().product::<usize>() < OF_A_THREAD {
        true => (0..rows).map(of_row).collect(),
        false => (0..rows).into_par_iter().map(of_row).collect(),
    };
    let inside = sums.iter().any(|(inside, _)| *inside);
    if inside { dx * dy * sums.iter().map(|(_, sum)| sum).sum::<f64>() } else { 0.0 }
}

impl Areas {
    /// A profile without layers yet.
    pub fn new(header: &Header) -> Self {
        Areas {
            spacing: header.spacing,
            extent: header.extent,
            kept: Vec::new(),
            every: 1,
            since: 0,
            last: None,
            sums: [0.0; 2],
            begun: false,
        }
    }

    /// The next layer.
    pub fn layer(&mut self, layer: &Layer) {
        let slack = 1e-9 * (self.extent[1] - self.extent[0]).abs();
        if layer.z < self.extent[0] - slack || layer.z > self.extent[1] + slack {
            return;
        }
        let point = [layer.z, area(&layer.phi, self.spacing)];
        let is_contour = layer.contour.is_some();
        if let Some(last) = self.last.filter(|_| self.begun) {
            self.sums[0] += 0.5 * (point[0] - last[0]) * (point[1] + last[1]);
        }
        if is_contour {
            self.begun = true;
            self.sums[1] = self.sums[0];
        }
        self.last = Some(point);
        self.since += 1;
        if is_contour || self.since >= self.every || self.kept.is_empty() {
            self.since = 0;
            self.kept.push((point, is_contour));
        }
        if self.kept.len() > MOST {
            self.every *= 2;
            let mut odd = false;
            self.kept.retain(|(_, is_contour)| {
                odd = !odd;
                *is_contour || odd
            });
        }
    }

    /// Profile of the areas that were taken in.
    pub fn finish(mut self) -> AreaProfile {
        if let (Some(last), Some((kept, _))) = (self.last, self.kept.last())
            && last[0] > kept[0]
        {
            self.kept.push((last, false));
        }
        AreaProfile { layers: self.kept.into_iter().map(|(point, _)| point).collect(), between_contours: self.sums[1] }
    }
}
