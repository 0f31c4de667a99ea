//! A layer being filled: bodies united by their signed distances.

use std::ops::Range;

use crate::contour::caps::Cap;
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::grid::union::{unite, unite_packed};

/// A layer being filled: the unpadded image, px, positive outside.
#[derive(Debug, Clone)]
pub struct Canvas {
    /// Pixels of the image.
    pub dims: [usize; 2],
    /// Padding of the padded image that tiles live on, pixels along either axis.
    pub pad: [usize; 2],
    /// Distances are clamped to this, px.
    pub limit: f64,
    /// Signed distance, px.
    pub phi: SparseImage<f32>,
}

impl Canvas {
    /// A layer with nothing on it.
    pub fn empty(dims: [usize; 2], pad: [usize; 2], limit: f64) -> Self {
        Canvas { dims, pad, limit, phi: SparseImage::filled(dims, limit as f32) }
    }

    /// Unites the layer with a body on a tile: the smaller distance counts.
    pub fn unite(&mut self, tile: &Tile, value: impl Fn(usize) -> f64) {
        let (limit, covered, [dx, dy]) = (self.limit, self.covered(tile), self.offset(tile));
        unite(&mut self.phi, covered, |[i, j], out| {
            let first = (j as isize + dy) as usize * tile.dims[0] + (i as isize + dx) as usize;
            out.iter_mut().zip(first..).for_each(|(v, node)| *v = value(node).clamp(-limit, limit) as f32);
        });
    }

    /// The same with a body that is there.
    pub fn unite_packed(&mut self, tile: &Tile, body: &SparseImage<f32>) {
        let (limit, covered, offset) = (self.limit, self.covered(tile), self.offset(tile));
        unite_packed(&mut self.phi, covered, offset, body, |v| f64::from(v).clamp(-limit, limit) as f32);
    }

    /// Unites the layer with a cap, `away` from the cap's contour as a share of the gap.
    pub fn unite_cap(&mut self, cap: &Cap, away: f64) {
        let offset = cap.offset(away);
        self.unite(&cap.tile, |n| cap.field.data[n] + offset);
    }

    /// Pixel of a tile that lies on the image's first.
    fn offset(&self, tile: &Tile) -> [isize; 2] {
        [0, 1].map(|a| self.pad[a] as isize - tile.origin[a] as isize)
    }

    /// Columns and rows of the image that a tile covers.
    fn covered(&self, tile: &Tile) -> [Range<usize>; 2] {
        std::array::from_fn(|a| {
            let end = (self.pad[a] + self.dims[a]).min(tile.origin[a] + tile.dims[a]);
            let start = self.pad[a].max(tile.origin[a]);
            start - self.pad[a]..end.max(start) - self.pad[a]
        })
    }

    /// Goes over the nodes of a tile that lie on the image.
    pub fn visit(&self, tile: &Tile, mut each: impl FnMut(usize)) {
        let ([dx, dy], [columns, rows]) = (self.offset(tile), self.covered(tile));
        for j in rows {
            let from = (j as isize + dy) as usize * tile.dims[0];
            for i in columns.clone() {
                each(from + (i as isize + dx) as usize);
            }
        }
    }

    /// A layer that is an input contour.
    pub fn of_contour(dims: [usize; 2], pad: [usize; 2], limit: f64, contour: &Field) -> Self {
        let [phi] = SparseImage::of_rows(dims, |first, [rows]: [&mut [f32]; 1]| {
            for (j, row) in (first..).zip(rows.chunks_exact_mut(dims[0])) {
                let values = &contour.data[(j + pad[1]) * contour.dims[0] + pad[0]..];
                row.iter_mut().zip(values).for_each(|(to, v)| *to = v.clamp(-limit, limit) as f32);
            }
        });
        Canvas { dims, pad, limit, phi }
    }
}
