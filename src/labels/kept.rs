//! A body kept in a nameless file, its layers cropped to what is near its surface.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::report::Report;
use crate::surface::Layer;
use crate::surface::header::Header;
use crate::surface::stream::LayerSink;

/// A layer without its values.
#[derive(Debug, Clone)]
struct Place {
    z: f64,
    output: bool,
    contour: Option<usize>,
    /// Whether it is there for the decision alone, and no writer's.
    hidden: bool,
    patch: [usize; 4],
    offset: u64,
}

/// A rectangle of a layer: around it all is far outside.
#[derive(Debug, Clone, Default)]
pub(super) struct LayerPatch {
    /// First column and row.
    pub origin: [usize; 2],
    /// Columns and rows.
    pub dims: [usize; 2],
    /// Values, row-major.
    pub phi: Vec<f32>,
}

impl LayerPatch {
    /// Rows: the first pixel's node in an image of width `nx`, and the values.
    pub fn rows(&self, nx: usize) -> impl Iterator<Item = (usize, &[f32])> {
        let start = move |j: usize| (self.origin[1] + j) * nx + self.origin[0];
        self.phi.chunks_exact(self.dims[0].max(1)).enumerate().map(move |(j, row)| (start(j), row))
    }

    /// The value at a pixel.
    pub fn at(&self, [i, j]: [usize; 2]) -> Option<f32> {
        let i = i.checked_sub(self.origin[0]).filter(|i| *i < self.dims[0])?;
        let j = j.checked_sub(self.origin[1]).filter(|j| *j < self.dims[1])?;
        self.phi.get(j * self.dims[0] + i).copied()
    }

    /// What of the image it has.
    fn tile(&self) -> Tile {
        Tile { origin: self.origin, dims: self.dims }
    }

    /// The share `1 - t` of it and `t` of another, around both of which all is `far`, on the rectangle around both.
    fn mixed(&self, other: &LayerPatch, t: f32, far: f32) -> LayerPatch {
        let Some(tile) = [self, other].map(LayerPatch::tile).into_iter().filter(|t| !t.is_empty()).reduce(Tile::joined)
        else {
            return LayerPatch::default();
        };
        let value = |n: usize| {
            let at = [tile.origin[0] + n % tile.dims[0], tile.origin[1] + n / tile.dims[0]];
            let [low, high] = [self, other].map(|patch| patch.at(at).unwrap_or(far));
            (1.0 - t) * low + t * high
        };
        LayerPatch { origin: tile.origin, dims: tile.dims, phi: (0..tile.len()).map(value).collect() }
    }

    /// Puts a value at a pixel of the rectangle.
    pub fn set(&mut self, [i, j]: [usize; 2], value: f32) {
        if self.at([i, j]).is_some() {
            self.phi[(j - self.origin[1]) * self.dims[0] + i - self.origin[0]] = value;
        }
    }
}

/// A body whose layers wait on the disk.
#[derive(Debug)]
pub struct KeptBody {
    file: File,
    /// Where it is.
    folder: PathBuf,
    /// Value far outside.
    far: f32,
    layers: Vec<Place>,
    bytes: u64,
    /// Pixels of the whole image, and where in it the layers that arrive lie.
    dims: [usize; 2],
    origin: [usize; 2],
    part: [usize; 2],
    /// Report on the body, without volume and area.
    pub report: Report,
    /// Header for its writers.
    pub header: Option<Header>,
}

fn failed(folder: &Path, source: io::Error) -> Error {
    Error::Write { path: format!("temporary file of a label in {}", folder.display()).into(), source }
}

impl KeptBody {
    /// No layer yet. The file is in `folder`; `far` is the value far outside. Layers of an image of `dims` pixels will come, or of a part of it
    /// that begins at `origin`.
    ///
    /// # Errors
    /// [`Error::Write`] where there can be no file.
    pub(super) fn new(folder: &Path, far: f32, dims: [usize; 2], origin: [usize; 2]) -> Result<Self> {
        let file = tempfile::tempfile_in(folder).map_err(|source| failed(folder, source))?;
        let folder = folder.into();
        let (layers, report) = (Vec::new(), Report::default());
        Ok(KeptBody { file, folder, far, layers, bytes: 0, dims, origin, part: dims, report, header: None })
    }

    /// Heights of the layers that writers get, increasing.
    pub(super) fn shown(&self) -> impl Iterator<Item = f64> + '_ {
        self.layers.iter().filter(|p| !p.hidden).map(|p| p.z)
    }

    /// Says which layers writers get, of a body that was made at more heights: those nearest to the `output` heights, within so much of them, are its
    /// output; of all others that were asked for between its contours, from the first to the last, those that are `shown` stay.
    pub(super) fn hide_all_but(&mut self, output: &[f64], shown: &[f64], contours: [f64; 2], within: f64) {
        let mut is_output = vec![false; self.layers.len()];
        for &z in output {
            let above = self.layers.partition_point(|p| p.z < z);
            let beside =
                (above.saturating_sub(1)..self.layers.len().min(above + 1)).map(|k| (k, (self.layers[k].z - z).abs()));
            let nearest = beside.filter(|(_, off)| *off <= within).min_by(|a, b| a.1.total_cmp(&b.1));
            nearest.into_iter().for_each(|(k, _)| is_output[k] = true);
        }
        for (place, output) in self.layers.iter_mut().zip(is_output) {
            let between = place.z > contours[0] && place.z < contours[1];
            let stays = output || !place.output || place.contour.is_some() || !between;
            place.hidden = !stays && !shown.iter().any(|z| (z - place.z).abs() <= within);
            place.output = output;
        }
        let output: Vec<f64> = self.layers.iter().filter(|p| p.output).map(|p| p.z).collect();
        self.header.iter_mut().for_each(|header| header.grid = Header::grid(&output, header.spacing));
    }

    /// The values of layer `k`.
    pub(super) fn patch(&mut self, k: usize) -> Result<LayerPatch> {
        let Place { patch: [i, j, width, height], offset, .. } = self.layers[k];
        let mut bytes = vec![0; 4 * width * height];
        let read = self.file.seek(SeekFrom::Start(offset)).and_then(|_| self.file.read_exact(&mut bytes));
        read.map_err(|source| failed(&self.folder, source))?;
        let phi = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        Ok(LayerPatch { origin: [i, j], dims: [width, height], phi })
    }

    /// The layer at height `z`, between two layers what linear interpolation says; `None` beyond the body. Heights within `same` are one.
    pub(super) fn at(&mut self, z: f64, same: f64) -> Result<Option<LayerPatch>> {
        let above = self.layers.partition_point(|p| p.z < z - same);
        match self.layers.get(above) {
            None => Ok(None),
            Some(p) if p.z <= z + same => self.patch(above).map(Some),
            Some(_) if above == 0 => Ok(None),
            Some(p) => {
                let t = ((z - self.layers[above - 1].z) / (p.z - self.layers[above - 1].z)) as f32;
                let (low, high) = (self.patch(above - 1)?, self.patch(above)?);
                Ok(Some(low.mixed(&high, t, self.far)))
            }
        }
    }

    /// Adds a layer, `hidden` from writers or not; its values are those of the patch.
    pub(super) fn push(&mut self, layer: &Layer, hidden: bool, patch: &LayerPatch) -> Result<()> {
        let [[i, j], [width, height]] = [patch.origin, patch.dims];
        let Layer { z, output, contour, .. } = *layer;
        self.layers.push(Place { z, output, contour, hidden, patch: [i, j, width, height], offset: self.bytes });
        self.write(self.bytes, patch)?;
        self.bytes += 4 * (width * height) as u64;
        Ok(())
    }

    /// Gives layer `k` the values of a patch on the same rectangle.
    pub(super) fn replace(&mut self, k: usize, patch: &LayerPatch) -> Result<()> {
        self.write(self.layers[k].offset, patch)
    }

    fn write(&mut self, offset: u64, patch: &LayerPatch) -> Result<()> {
        let bytes: Vec<u8> = patch.phi.iter().flat_map(|v| v.to_le_bytes()).collect();
        let written = self.file.seek(SeekFrom::Start(offset)).and_then(|_| self.file.write_all(&bytes));
        written.map_err(|source| failed(&self.folder, source))
    }

    /// What of the image each layer has.
    pub(super) fn tiles(&self) -> impl Iterator<Item = Tile> + '_ {
        self.layers
            .iter()
            .map(|Place { patch: [i, j, width, height], .. }| Tile { origin: [*i, *j], dims: [*width, *height] })
    }

    /// The contour at layer `k`.
    pub(super) fn contour_of(&self, k: usize) -> Option<usize> {
        self.layers[k].contour
    }

    /// The contour at the layer of height `z`.
    pub(super) fn contour(&self, z: f64, same: f64) -> Option<usize> {
        self.layers.iter().find(|p| (p.z - z).abs() <= same).and_then(|p| p.contour)
    }

    /// Lets the body end no sooner than it is inside: at the layer beyond the outermost on which it is.
    pub(super) fn end_where_it_is(&mut self) -> Result<()> {
        let Some([low, high]) = self.header.as_ref().map(|header| header.extent) else { return Ok(()) };
        let mut extent = [low, high];
        let shown: Vec<usize> = (0..self.layers.len()).filter(|k| !self.layers[*k].hidden).collect();
        let below = shown.partition_point(|k| self.layers[*k].z < low);
        let above = shown.partition_point(|k| self.layers[*k].z <= high);
        for n in 0..below {
            if self.patch(shown[n])?.phi.iter().any(|v| *v < 0.0) {
                extent[0] = self.layers[shown[n.saturating_sub(1)]].z;
                break;
            }
        }
        for n in (above..shown.len()).rev() {
            if self.patch(shown[n])?.phi.iter().any(|v| *v < 0.0) {
                extent[1] = self.layers[shown[(n + 1).min(shown.len() - 1)]].z;
                break;
            }
        }
        self.header.iter_mut().for_each(|header| header.extent = extent);
        Ok(())
    }

    /// A patch on the whole image.
    pub(super) fn whole(&self, patch: &LayerPatch) -> Vec<f32> {
        let dims = self.dims;
        let mut phi = vec![self.far; dims[0] * dims[1]];
        patch.rows(dims[0]).for_each(|(start, row)| phi[start..start + row.len()].copy_from_slice(row));
        phi
    }

    /// Hands all layers that are not hidden to `sink`.
    ///
    /// # Errors
    /// The errors of `sink`; [`Error::Write`] for the temporary file.
    pub fn replay(&mut self, sink: &mut dyn LayerSink) -> Result<()> {
        let Some(header) = &self.header else { return Ok(()) };
        sink.begin(header)?;
        for k in (0..self.layers.len()).filter(|k| !self.layers[*k].hidden).collect::<Vec<_>>() {
            let patch = self.patch(k)?;
            let phi = SparseImage::of(self.dims, &self.whole(&patch));
            let Place { z, output, contour, .. } = self.layers[k];
            sink.layer(Layer { z, phi, output, contour })?;
        }
        Ok(())
    }
}

impl LayerSink for KeptBody {
    fn begin(&mut self, header: &Header) -> Result<()> {
        self.layers.clear();
        self.bytes = 0;
        self.header = Some(Header { dims: self.dims, ..header.clone() });
        self.part = header.dims;
        Ok(())
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
        let mut patch = crop(&layer.dense(), self.part, self.far);
        (0..2).for_each(|a| patch.origin[a] += self.origin[a]);
        self.push(&layer, false, &patch)
    }
}

/// The smallest rectangle beyond which all is `far`.
fn crop(phi: &[f32], [nx, _]: [usize; 2], far: f32) -> LayerPatch {
    let near = |v: &f32| v.to_bits() != far.to_bits();
    let mut columns = [usize::MAX, 0];
    let mut rows = [usize::MAX, 0];
    for (j, row) in phi.chunks_exact(nx.max(1)).enumerate() {
        let (Some(first), Some(last)) = (row.iter().position(near), row.iter().rposition(near)) else { continue };
        columns = [columns[0].min(first), columns[1].max(last + 1)];
        rows = [rows[0].min(j), j + 1];
    }
    if rows[1] == 0 {
        return LayerPatch::default();
    }
    let values = (rows[0]..rows[1]).flat_map(|j| &phi[j * nx + columns[0]..j * nx + columns[1]]).copied().collect();
    LayerPatch { origin: [columns[0], rows[0]], dims: [columns[1] - columns[0], rows[1] - rows[0]], phi: values }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_two_layers_it_is_on_the_rectangle_around_both() -> Result<()> {
        // Its shares add up to another number at 22 of the heights below.
        const FAR: f32 = 3.7;
        let mut body = KeptBody::new(&std::env::temp_dir(), FAR, [20, 16], [0; 2])?;
        let patches = [([4, 6], [3, 2], -2.0), ([6, 5], [2, 4], 1.0), ([0; 2], [0; 2], 0.0), ([0; 2], [0; 2], 0.0)];
        for (k, (origin, dims, value)) in patches.into_iter().enumerate() {
            let layer = Layer { z: k as f64, phi: SparseImage::default(), output: true, contour: None };
            body.push(&layer, false, &LayerPatch { origin, dims, phi: vec![value; dims[0] * dims[1]] })?;
        }
        let mut between = |z: f64| Ok(body.at(z, 1e-9)?.expect("it lies within the body"));
        for k in 1..64 {
            let t = f64::from(k) / 64.3;
            let low = between(t)?;
            assert_eq!((low.origin, low.dims), ([4, 5], [4, 4]), "at {t}");
            let mix = |a: f32, b: f32| Some((1.0 - t as f32) * a + t as f32 * b);
            // Of both, of the lower alone, of neither.
            assert_eq!([[6, 6], [4, 6], [4, 5]].map(|at| low.at(at)), [mix(-2.0, 1.0), mix(-2.0, FAR), mix(FAR, FAR)]);
            let high = between(1.0 + t)?;
            assert_eq!((high.origin, high.dims), ([6, 5], [2, 4]), "at {}", 1.0 + t);
            assert!(between(2.0 + t)?.tile().is_empty());
        }
        Ok(())
    }
}
