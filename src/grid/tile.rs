//! Rectangles of an image: a tile is the bounding box of some parts and a margin, so that memory and work follow the contours and not the image.

use std::ops::Range;

use glam::DVec2;

use crate::grid::field::Field;

/// A length in units of the larger pixel side as pixels along either axis, at least as long: pixels need not be square.
pub fn samples(length: usize, h: [f64; 2]) -> [usize; 2] {
    h.map(|side| (length as f64 / side).ceil() as usize)
}

/// Signed distance of pixel `at` to the rectangle of these columns and rows, whose edges lie half a pixel beyond its outermost pixels; `h` are a
/// pixel's sides. Negative within.
pub fn to_rectangle(rectangle: &[Range<isize>; 2], h: [f64; 2], at: [usize; 2]) -> f64 {
    let past = |a: usize| {
        let (first, end, n) = (rectangle[a].start as f64, rectangle[a].end as f64, at[a] as f64);
        ((first - 0.5 - n).max(n - (end - 0.5))) * h[a]
    };
    let [x, y] = [past(0), past(1)];
    if x > 0.0 && y > 0.0 { libm::hypot(x, y) } else { x.max(y) }
}

/// A rectangle of pixels of the padded image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tile {
    /// Its first pixel in the padded image.
    pub origin: [usize; 2],
    /// Its size.
    pub dims: [usize; 2],
}

impl Tile {
    /// All pixels of an image.
    pub fn all(dims: [usize; 2]) -> Self {
        Tile { origin: [0; 2], dims }
    }

    /// The tile from pixel `low` to pixel `high`, both included, and a margin, pixels along either axis.
    pub fn spanning(image: [usize; 2], margin: [usize; 2], low: [usize; 2], high: [usize; 2]) -> Self {
        let origin: [usize; 2] = std::array::from_fn(|a| low[a].saturating_sub(margin[a]));
        Tile { origin, dims: std::array::from_fn(|a| (high[a] + margin[a] + 1).min(image[a]) - origin[a]) }
    }

    /// The smallest tile that holds both.
    pub fn joined(self, other: Tile) -> Self {
        let origin = std::array::from_fn(|a| self.origin[a].min(other.origin[a]));
        let end = |t: Tile, a: usize| t.origin[a] + t.dims[a];
        Tile { origin, dims: std::array::from_fn(|a| end(self, a).max(end(other, a)) - origin[a]) }
    }

    /// The tile in pixels of `other`, in which it lies.
    pub fn within(self, other: Tile) -> Self {
        Tile { origin: std::array::from_fn(|a| self.origin[a] - other.origin[a]), dims: self.dims }
    }

    /// The tile, in pixels of `other`, in those of the image.
    pub fn placed(self, other: Tile) -> Self {
        Tile { origin: std::array::from_fn(|a| self.origin[a] + other.origin[a]), dims: self.dims }
    }

    /// Cuts a hole on this tile out of a body on the tile in whose pixels it is, `offset` smaller than it is: `max(body, -(hole + offset))`.
    pub fn cut_out(&self, hole: &Field, offset: f64, body: &mut Field) {
        let ([i, j], [width, _], nx) = (self.origin, self.dims, body.dims[0]);
        for (row, hole) in body.data.chunks_exact_mut(nx).skip(j).zip(hole.data.chunks_exact(width)) {
            row.iter_mut().skip(i).zip(hole).for_each(|(v, hole)| *v = v.max(-(hole + offset)));
        }
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.dims[0] * self.dims[1]
    }

    /// Whether it has no pixel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Nodes of the padded image, of width `nx`, in the order of the tile's own nodes.
    pub fn nodes(&self, nx: usize) -> impl Iterator<Item = usize> + use<> {
        self.rows(nx).flatten()
    }

    /// The same row by row.
    pub fn rows(&self, nx: usize) -> impl Iterator<Item = Range<usize>> + use<> {
        let Tile { origin, dims } = *self;
        (origin[1]..origin[1] + dims[1]).map(move |j| j * nx + origin[0]..j * nx + origin[0] + dims[0])
    }

    /// What `of` makes of values on the padded image, of width `nx`, in the order of the tile's own nodes.
    pub fn map<T, U>(&self, values: &[T], nx: usize, of: impl Fn(&T) -> U) -> Vec<U> {
        let mut out = Vec::with_capacity(self.len());
        self.rows(nx).for_each(|row| out.extend(values[row].iter().map(&of)));
        out
    }

    /// The tile's own node for a node of the padded image of width `nx`; `None` beyond the tile.
    pub fn local_node(&self, node: usize, nx: usize) -> Option<usize> {
        let i = (node % nx).checked_sub(self.origin[0]).filter(|&i| i < self.dims[0])?;
        let j = (node / nx).checked_sub(self.origin[1]).filter(|&j| j < self.dims[1])?;
        Some(j * self.dims[0] + i)
    }

    /// These columns and rows of the padded image that the tile has, in its own pixels.
    pub fn local(&self, part: &[Range<usize>; 2]) -> [Range<usize>; 2] {
        [0, 1].map(|a| {
            let local = |n: usize| n.clamp(self.origin[a], self.origin[a] + self.dims[a]) - self.origin[a];
            local(part[a].start)..local(part[a].end)
        })
    }

    /// The tile's part of a field on the padded image.
    pub fn cut(&self, image: &Field) -> Field {
        Field { dims: self.dims, data: self.map(&image.data, image.dims[0], |v| *v) }
    }

    /// A position of the padded image in the tile's own pixels.
    pub fn to_local(&self, x: DVec2) -> DVec2 {
        x - self.first()
    }

    /// Whether a position of the padded image lies between its pixels, or no farther off than `around`.
    #[inline]
    pub fn holds(&self, x: DVec2, around: f64) -> bool {
        let local = self.to_local(x);
        (0..2).all(|a| local[a] >= -around && local[a] <= (self.dims[a] - 1) as f64 + around)
    }

    /// A position of the tile in pixels of the padded image.
    pub fn to_image(&self, x: DVec2) -> DVec2 {
        x + self.first()
    }

    /// Position of its first pixel.
    #[inline]
    fn first(&self) -> DVec2 {
        DVec2::from(self.origin.map(|c| c as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tile_knows_its_own_nodes_and_no_others() {
        let (nx, ny) = (23, 17);
        let tile = Tile { origin: [4, 6], dims: [9, 5] };
        let own: Vec<usize> = tile.nodes(nx).collect();
        assert_eq!((own.len(), tile.len(), tile.is_empty()), (45, 45, false));
        assert_eq!((own[0], own[9], own[44]), (6 * 23 + 4, 7 * 23 + 4, 10 * 23 + 12));
        for node in 0..nx * ny {
            assert_eq!(tile.local_node(node, nx), own.iter().position(|n| *n == node), "node {node}");
        }
    }

    #[test]
    fn tiles_end_at_the_image_and_grow_by_their_margin() {
        let image = [30, 20];
        let inner = Tile::spanning(image, [2, 3], [10, 9], [14, 9]);
        assert_eq!(inner, Tile { origin: [8, 6], dims: [9, 7] });
        assert_eq!(Tile::spanning(image, [12, 12], [10, 9], [25, 9]), Tile { origin: [0, 0], dims: [30, 20] });
        let joined = inner.joined(Tile { origin: [3, 12], dims: [6, 5] });
        assert_eq!(joined, Tile { origin: [3, 6], dims: [14, 11] });
        assert_eq!(samples(10, [1.0, 0.4]), [10, 25]);
        assert_eq!(samples(10, [0.3, 1.0]), [34, 10]);
    }
    #[test]
    fn a_tile_holds_what_lies_between_its_pixels() {
        let tile = Tile { origin: [4, 6], dims: [9, 5] };
        for (x, around) in
            [([4.0, 6.0], 0.0), ([12.0, 10.0], 0.0), ([3.0, 11.0], 1.0), ([13.0, 5.0], 1.0), ([8.0, 8.0], -2.0)]
        {
            assert!(tile.holds(x.into(), around), "{x:?}, {around}");
        }
        for (x, around) in
            [([3.9, 6.0], 0.0), ([12.1, 8.0], 0.0), ([8.0, 5.9], 0.0), ([8.0, 11.1], 1.0), ([8.0, 7.9], -2.0)]
        {
            assert!(!tile.holds(x.into(), around), "{x:?}, {around}");
        }
        assert_eq!(tile.to_image(tile.to_local(DVec2::new(7.5, 3.0))), DVec2::new(7.5, 3.0));
        assert_eq!(tile.to_local(DVec2::new(7.5, 7.0)), DVec2::new(3.5, 1.0));
    }
}
