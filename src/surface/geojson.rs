//! Contour lines of the output layers as GeoJSON: a feature a level, with its `elevation`.

use std::io::{self, Write};

use glam::DVec2;
use serde::Serialize;

use super::Layer;
use super::contour_lines::{AlongAxes, contour_lines};
use super::header::Header;
use super::stream::{BodyWriter, Ending};
use crate::polygons::Polygon;
use crate::surface::map::Crs;

#[derive(Serialize)]
struct Feature {
    r#type: &'static str,
    properties: Properties,
    geometry: Geometry,
}

#[derive(Serialize)]
struct Properties {
    elevation: f64,
}

#[derive(Serialize)]
struct Geometry {
    r#type: &'static str,
    coordinates: Vec<Polygon>,
}

/// Writes the contour lines of output layers as these arrive. Where the body touches the border of the image, lines are open: the border is no
/// contour.
pub struct GeoJsonWriter<W> {
    out: W,
    dims: [usize; 2],
    along: AlongAxes,
    features: usize,
}

impl<W: Write> GeoJsonWriter<W> {
    /// The file as far as the features.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn new(mut out: W, header: &Header, crs: &Crs) -> io::Result<Self> {
        write!(out, "{{\"type\":\"FeatureCollection\",")?;
        if let Crs::Epsg(code) = crs {
            // Not of RFC 7946, which knows degrees only; GDAL and QGIS write and read it.
            write!(out, "\"crs\":{{\"type\":\"name\",\"properties\":{{\"name\":\"urn:ogc:def:crs:EPSG::{code}\"}}}},")?;
        }
        write!(out, "\"features\":[")?;
        Ok(GeoJsonWriter {
            out,
            dims: header.dims,
            along: AlongAxes::new(&header.geometry, header.spacing),
            features: 0,
        })
    }
}

impl<W: Write + Send> BodyWriter for GeoJsonWriter<W> {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        if !layer.output {
            return Ok(());
        }
        let loops = contour_lines(layer, self.dims);
        let lines = loops.iter().flat_map(|ring| within(ring, self.dims));
        let coordinates: Vec<Polygon> =
            lines.map(|line| line.into_iter().map(|x| self.along.point(x)).collect()).collect();
        if coordinates.is_empty() {
            return Ok(());
        }
        if self.features > 0 {
            self.out.write_all(b",\n")?;
        }
        self.features += 1;
        let feature = Feature {
            r#type: "Feature",
            properties: Properties { elevation: self.along.height(layer.z) },
            geometry: Geometry { r#type: "MultiLineString", coordinates },
        };
        serde_json::to_writer(&mut self.out, &feature)?;
        Ok(())
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        self.out.write_all(b"]}\n")?;
        self.out.flush()
    }
}

/// The parts of a closed line that lie within the image; the whole of it closed by its first point again.
fn within(ring: &[DVec2], dims: [usize; 2]) -> Vec<Polygon> {
    let last = DVec2::from(dims.map(|n| (n - 1) as f64));
    let inside = |p: &DVec2| p.cmpge(DVec2::ZERO).all() && p.cmple(last).all();
    let Some(outside) = ring.iter().position(|p| !inside(p)) else {
        return vec![ring.iter().chain(ring.first()).copied().collect()];
    };
    let walked: Polygon = (0..ring.len()).map(|k| ring[(outside + k) % ring.len()]).collect();
    walked.split(|p| !inside(p)).filter(|line| line.len() > 1).map(<[_]>::to_vec).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_open_at_the_border() {
        let ring = [[1.0, 1.0], [3.0, 1.0], [3.5, 1.0], [3.5, 2.0], [3.0, 2.0], [1.0, 2.0]].map(DVec2::from);
        assert_eq!(within(&ring, [4, 4]), [[4, 5, 0, 1].map(|k| ring[k])]);
        assert_eq!(within(&ring, [5, 5])[0].len(), 7);
    }
}
