//! Terrain: the height at which each pixel leaves the body.

use std::io::{self, Seek, Write};

use glam::{DVec2, DVec3};
use tiff::encoder::colortype::{ColorType, Gray32Float, Gray64Float};
use tiff::encoder::{TiffEncoder, TiffValue};

use super::Layer;
use super::contour_lines::AlongAxes;
use super::geotiff::Raster;
use super::header::Header;
use super::stream::{BodyWriter, Ending};
use crate::grid::sparse_image::SQUARE;
use crate::surface::map::{Crs, Floor, Map};

/// Arrival height per pixel, unit of the stack, row-major: the highest z at which the pixel is inside, by the linear zero between
/// layers; the upper end of the body where it is still inside there, NaN where it is never inside.
#[derive(Debug, Clone)]
pub struct ArrivalHeights {
    extent: [f64; 2],
    heights: Vec<f64>,
    /// The layer below, of those within the extent.
    below: Option<Layer>,
}

impl ArrivalHeights {
    /// A map of no layer yet: of a body of so many pixels between these heights.
    pub fn new(dims: [usize; 2], extent: [f64; 2]) -> Self {
        ArrivalHeights { extent, heights: vec![f64::NAN; dims[0] * dims[1]], below: None }
    }

    /// The next layer.
    pub fn layer(&mut self, layer: &Layer) {
        if layer.z < self.extent[0] || layer.z > self.extent[1] {
            return;
        }
        let Some(below) = &mut self.below else {
            self.below = Some(layer.clone());
            return;
        };
        let nx = layer.phi.dims()[0];
        for square in layer.phi.each_square() {
            if below.phi.whole(square).is_some_and(|a| a >= 0.0) || layer.phi.whole(square).is_some_and(|b| b < 0.0) {
                continue;
            }
            let rows = below.phi.of_square(square).zip(layer.phi.of_square(square));
            for (j, (below_row, row)) in (square[1] * SQUARE..).zip(rows) {
                let heights = &mut self.heights[j * nx + square[0] * SQUARE..];
                for ((h, a), b) in heights.iter_mut().zip(below_row).zip(row) {
                    let (a, b) = (f64::from(*a), f64::from(*b));
                    if a < 0.0 && b >= 0.0 {
                        *h = below.z + (layer.z - below.z) * a / (a - b);
                    }
                }
            }
        }
        below.clone_from(layer);
    }

    /// The heights, when there is no more layer.
    pub fn finish(&mut self) -> &[f64] {
        if let Some(last) = &self.below {
            let inside = self.heights.iter_mut().zip(last.dense()).filter(|(_, phi)| *phi < 0.0);
            inside.for_each(|(h, _)| *h = last.z);
        }
        &self.heights
    }
}

/// Part of the distance between output heights by which heights may be rounded.
const ROUNDED: f64 = 0.01;

/// Writes the height map as a float grey TIFF, at the end: of 32 bits, or of 64 where heights would be rounded by more than a hundredth of the
/// distance between output heights; rows as the stack's; of a contour map as a GeoTIFF, from north to south.
pub struct HeightMapWriter<W> {
    out: W,
    size: [u32; 2],
    heights: ArrivalHeights,
    /// Heights are those of the world, as all that is told along the axes.
    along: AlongAxes,
    is_double: bool,
    place: Option<Place>,
    floor: Option<FloorBelow>,
}

/// What a map has below its lowest contour, seen from the pixels that are written.
struct FloorBelow {
    floor: Floor,
    /// The map's pixels.
    dims: [usize; 2],
    /// Place of the first pixel and steps to its neighbours, in pixels of the map.
    first: DVec2,
    steps: [DVec2; 2],
}

impl FloorBelow {
    fn new(floor: Floor, header: &Header, map: &Header) -> Self {
        let (geometry, spacing) = (&map.geometry, DVec2::from(map.spacing));
        let flat = |p: DVec3| DVec2::new(p.dot(geometry.axes[0]), p.dot(geometry.axes[1])) / spacing;
        let step = |axis: usize| flat(header.geometry.axes[axis] * header.spacing[axis]);
        let first = flat(header.geometry.origin - geometry.origin);
        FloorBelow { floor, dims: map.dims, first, steps: [step(0), step(1)] }
    }

    /// Height of a pixel.
    fn height(&self, column: usize, row: usize) -> f64 {
        self.floor.height(self.first + column as f64 * self.steps[0] + row as f64 * self.steps[1], self.dims)
    }
}

/// Place of a map.
struct Place {
    crs: Crs,
    spacing: [f64; 2],
    corner: [f64; 2],
}

impl<W> HeightMapWriter<W> {
    /// A writer without layers yet, which have the pixels of `header` and the heights of `body`, whose pixels are those of `map`.
    pub fn new(out: W, header: &Header, body: &Header, map: Option<&Map>) -> Self {
        let ([nx, ny], spacing) = (header.dims, header.spacing);
        let along = AlongAxes::new(&body.geometry, body.spacing);
        let place = map.map(|Map { crs, .. }| {
            let corner = AlongAxes::new(&header.geometry, spacing).point(DVec2::new(-0.5, ny as f64 - 0.5));
            Place { crs: crs.clone(), spacing, corner: corner.to_array() }
        });
        let farthest = header.extent.map(|z| along.height(z).abs()).into_iter().fold(0.0, f64::max);
        let is_double = farthest * f64::from(f32::EPSILON) / 2.0 > ROUNDED * header.grid.step;
        let (size, heights) = ([nx as u32, ny as u32], ArrivalHeights::new(header.dims, header.extent));
        let floor = map.map(|map| FloorBelow::new(map.floor.clone(), header, body));
        HeightMapWriter { out, size, heights, along, is_double, place, floor }
    }
}

impl<W: Write + Seek + Send> BodyWriter for HeightMapWriter<W> {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        self.heights.layer(layer);
        Ok(())
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        let mut heights = self.heights.finish().to_vec();
        let columns = self.size[0] as usize;
        for (node, height) in heights.iter_mut().enumerate() {
            if let (true, Some(below)) = (height.is_nan(), &self.floor) {
                *height = below.height(node % columns, node / columns);
            }
            *height = self.along.height(*height);
        }
        if self.is_double {
            self.write::<Gray64Float>(heights)?;
        } else {
            self.write::<Gray32Float>(heights.into_iter().map(|h| h as f32).collect())?;
        }
        self.out.flush()
    }
}

impl<W: Write + Seek> HeightMapWriter<W> {
    /// Writes heights as pixels of type `C`.
    fn write<C: ColorType>(&mut self, heights: Vec<C::Inner>) -> io::Result<()>
    where
        C::Inner: Copy,
        [C::Inner]: TiffValue,
    {
        let [width, height] = self.size;
        let Some(Place { crs, spacing, corner }) = &self.place else {
            // The encoder of `image` has no single-channel float; `tiff` beneath it does.
            let mut encoder = TiffEncoder::new(&mut self.out).map_err(io::Error::other)?;
            return encoder.write_image::<C>(width, height, &heights).map_err(io::Error::other);
        };
        let rows = heights.chunks_exact(width as usize);
        let heights: Vec<C::Inner> = rows.rev().flatten().copied().collect();
        let raster = Raster { size: self.size, spacing: *spacing, corner: *corner, crs };
        raster.write::<C>(&mut self.out, &heights)
    }
}
