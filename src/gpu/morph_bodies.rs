//! Bodies that make up the layers of a morphed interval in its frame, as a list for the device.

use super::layout::{BLOCK, Body, OF_ENDS, OF_SHAPES, OF_SLICES};
use super::morph_slices::{Origin, Slices};
use super::resident::scaled;
use crate::backend::interval_morph::IntervalMorph;
use crate::contour::caps::Cap;
use crate::contour::direction::Direction;
use crate::grid::field::Field;
use crate::grid::tile::Tile;

/// Bodies that the device unites, and the values of those that the host has made.
#[derive(Default)]
pub struct Bodies {
    /// The bodies.
    pub bodies: Vec<Body>,
    /// Values of those that the host has made.
    pub shapes: Vec<f32>,
    /// Groups of pixels that they take.
    pub groups: usize,
}

impl Bodies {
    fn add(&mut self, tile: &Tile, (source, first): (u32, u32), offset: f64, image: usize) {
        self.bodies.push(Body {
            first,
            source,
            nx: tile.dims[0] as u32,
            ny: tile.dims[1] as u32,
            x: tile.origin[0] as i32,
            y: tile.origin[1] as i32,
            offset: super::moving::bounded(offset),
            layer: image as u32,
            first_group: self.groups as u32,
            padding: 0,
        });
        self.groups += tile.len().div_ceil(BLOCK);
    }

    /// Slices of all groups of an interval, which begin with number `slot`.
    pub fn add_slices(&mut self, of: &IntervalMorph<'_>, image: usize, slices: &Slices, slot: usize) {
        for (n, (tile, _)) in of.pairs.iter().enumerate() {
            self.add(tile, (OF_SLICES, slices.first(slot + n)), 0.0, image);
        }
    }

    /// A part that ends, this far off its contour.
    pub fn add_cap(&mut self, cap: &Cap, away: f64, image: usize) {
        self.add_shape(&cap.tile, &cap.field, cap.offset(away), image);
    }

    fn add_shape(&mut self, tile: &Tile, field: &Field, offset: f64, image: usize) {
        let first = self.shapes.len() as u32;
        self.shapes.extend(scaled(field, 1.0));
        self.add(tile, (OF_SHAPES, first), offset, image);
    }

    /// The ends of all groups of an interval, whose first pair has this number, at the contour from which `from` goes, without holes.
    pub fn add_contour(
        &mut self,
        of: &IntervalMorph<'_>,
        first_pair: usize,
        origin: &Origin<'_>,
        from: Direction,
        image: usize,
    ) {
        for (n, (tile, pair)) in of.pairs.iter().enumerate() {
            let (end, goes_there) = match from {
                Direction::Up => (&pair.up.source, 1),
                Direction::Down => (&pair.down.source, 0),
            };
            match origin {
                Origin::Device(swept) if pair.holes_of(from).next().is_none() => {
                    let first = swept.copies.end(2 * (first_pair + n) + goes_there).1;
                    self.add(tile, (OF_ENDS, first), 0.0, image);
                }
                _ => self.add_shape(tile, &pair.without_holes(end, from), 0.0, image),
            }
        }
    }
}
