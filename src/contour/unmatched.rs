//! A part of one contour that has no counterpart in the other.

use crate::contour::direction::Direction;
use crate::grid::field::Field;
use crate::grid::tile::Tile;

/// Share of the gap at which a part ends of which nothing is known.
pub const HALF_WAY: f64 = 0.5;

/// A part of one contour without counterpart in the other.
#[derive(Debug, Clone)]
pub struct LonePart {
    /// Tile on which it lies.
    pub tile: Tile,
    /// Signed distance to the part, negative inside.
    pub field: Field,
    /// Inradius, px.
    pub depth: f64,
    /// Distance beyond its contour at which it ends, in gaps of its interval.
    pub closes: f64,
    /// Its seeds on the contour, by number; those that count in means come first.
    pub seeds: Vec<u32>,
    /// Number of those.
    pub counted: usize,
    /// Motion from its contour to its end.
    pub direction: Direction,
}

impl LonePart {
    /// A part that ends half way, from the signed distance to it on its tile.
    pub fn new(tile: Tile, field: Field, seeds: Vec<u32>, direction: Direction) -> Self {
        let depth = -field.data.iter().copied().fold(0.0, f64::min);
        LonePart { tile, field, depth, closes: HALF_WAY, counted: seeds.len(), seeds, direction }
    }

    /// Seeds that count in means.
    pub fn counted(&self) -> &[u32] {
        &self.seeds[..self.counted]
    }
}
