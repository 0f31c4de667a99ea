//! A part of one contour that has no counterpart in the other.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::DVec2;
use rayon::prelude::*;

use crate::contour::Contour;
use crate::contour::direction::Direction;
use crate::grid::field::{Field, VALUES_OF_A_THREAD, position};
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
    /// It goes on beyond what is known: what closes it there is not in its distances, which are far where its contour's
    /// course ends.
    pub open: bool,
    /// Inradius, px; of an open part that where it is known.
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
        LonePart { tile, field, open: false, depth, closes: HALF_WAY, counted: seeds.len(), seeds, direction }
    }

    /// Seeds that count in means.
    pub fn counted(&self) -> &[u32] {
        &self.seeds[..self.counted]
    }
}

/// Numbers of the parts, at least `least` deep, no pixel of which meets anything.
pub fn without_partner(contour: &Contour, least: f64, meets: impl Fn(DVec2) -> bool + Sync) -> Vec<u32> {
    let mut lone: Vec<AtomicBool> = contour.solid_depth.iter().map(|depth| AtomicBool::new(*depth >= least)).collect();
    *lone[0].get_mut() = false;
    let nx = contour.phi.dims[0];
    // Whichever pixel is looked at first: a part that meets something anywhere has a partner.
    contour.solids.labels.par_iter().enumerate().with_min_len(VALUES_OF_A_THREAD).for_each(|(node, &label)| {
        let lone = &lone[label as usize];
        if lone.load(Ordering::Relaxed) && meets(position(node, nx)) {
            lone.store(false, Ordering::Relaxed);
        }
    });
    (0..).zip(lone).filter_map(|(part, lone)| lone.into_inner().then_some(part)).collect()
}
