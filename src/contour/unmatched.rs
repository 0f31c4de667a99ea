//! A part of one contour that has no counterpart in the other.

use crate::contour::direction::Direction;
use crate::grid::field::Field;
use crate::grid::tile::Tile;

/// Where in the gap a part ends of which nothing is known.
pub const HALF_WAY: f64 = 0.5;

/// A part of one contour without counterpart in the other.
#[derive(Debug, Clone)]
pub struct LonePart {
    /// Where.
    pub tile: Tile,
    /// Signed distance to the part, negative inside.
    pub field: Field,
    /// Inradius, px.
    pub depth: f64,
    /// Where it ends beyond its contour, in gaps of its interval.
    pub closes: f64,
    /// Its seeds on the contour, by number.
    pub seeds: Vec<u32>,
    /// Where it goes from its contour to its end.
    pub direction: Direction,
}

impl LonePart {
    /// One that ends half way, from the signed distance to it on its tile.
    pub fn new(tile: Tile, field: Field, seeds: Vec<u32>, direction: Direction) -> Self {
        let depth = -field.data.iter().copied().fold(0.0, f64::min);
        LonePart { tile, field, depth, closes: HALF_WAY, seeds, direction }
    }
}
