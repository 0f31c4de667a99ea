//! Area of the body's layers over its height.

use crate::grid::field::covered;
use crate::report::AreaProfile;
use crate::surface::Layer;
use crate::surface::header::Header;

/// Most layers that are kept: from there on every other one is, but for the contours.
const MOST: usize = 4096;

/// Adds up areas while layers arrive.
#[derive(Debug)]
pub struct Areas {
    /// Area of a pixel.
    pixel: f64,
    /// The larger pixel side.
    px: f64,
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

impl Areas {
    /// A profile without layers yet.
    pub fn new(header: &Header) -> Self {
        Areas {
            pixel: header.spacing[0] * header.spacing[1],
            px: header.spacing[0].max(header.spacing[1]),
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
        let sum: f64 = layer.phi.iter().map(|v| covered(f64::from(*v) / self.px)).sum();
        let point = [layer.z, sum * self.pixel];
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
