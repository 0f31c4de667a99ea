//! Volumes that say where a voxel comes from and how probable it is that it lies on the right side, from geometry alone.
//!
//! *Origin*, u8: 0 outside; inside 1 on a contour's own layer (drawn), 2 between two contours (interpolated), 3 beyond the first or last
//! contour (extrapolated).
//!
//! *Confidence*, f32 in [1/2, 1]: the probability `p = 1 - (1 + |phi| / (k u))^-2 / 2` that the voxel is inside or outside as it should be. phi is
//! its own in-plane distance from the surface and u the way by which the surface may be wrong there, in the same unit: `u = t (1 - t) D` between two
//! contours with distances phi_0 and phi_1, where `D = |phi_1 - phi_0|` is the local change and t the share of the gap below the voxel;
//! `u = d D / gap` at a distance d beyond an end, with D and gap of the end's own interval. On a contour's layer, and where nothing changes
//! (u = 0), p = 1; on a surface that changes, p = 1/2.
//!
//! The tail is that of what goes wrong between contours: now and then a part forks otherwise, and voxels far from the surface are wrong. `k` is
//! fitted on one half of 504 bodies and holds on the other, in the mean: docs/evaluation.md ("When to trust it") has the diagram. Beyond the first
//! and the last contour it was not measured, and is no more than the same law. Distances are
//! clamped to some pixels from the contour and D is taken at the voxel's place, not along a motion: where a part moves by more than its width, D is
//! the change that a fixed observer sees, larger than what the moving frame has to bridge.

use std::io::{self, BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;

use tempfile::SpooledTempFile;

use super::Layer;
use super::content::Content;
use super::spool::FILE_IN_MEMORY;
use super::stream::{BodyWriter, Ending};
use crate::grid::sparse_image::SparseImage;

/// The `k` of the confidence: distance over u at which a voxel is right in 7 of 8 cases.
const SCALE: f32 = 0.63;

/// Writer of an origin or confidence volume, through the writer of its format. Layers wait for the contour above them, in memory while they are few.
pub struct OriginWriter {
    inner: Box<dyn BodyWriter>,
    content: Content,
    /// Heights and signed distances of output layers.
    heights: Vec<f64>,
    file: BufWriter<SpooledTempFile>,
    /// The contour below.
    below: Option<Layer>,
    /// The last interval, once there is one.
    interval: Option<Interval>,
}

/// An interval between two contours.
struct Interval {
    heights: [f64; 2],
    /// Pixels of a layer.
    dims: [usize; 2],
    /// Change of each pixel's distance.
    change: Vec<f32>,
}

impl OriginWriter {
    /// A writer without layers yet. What does not fit in memory waits in a nameless file in `folder`.
    pub fn new(inner: Box<dyn BodyWriter>, content: Content, folder: &Path) -> Self {
        let file = BufWriter::new(tempfile::spooled_tempfile_in(FILE_IN_MEMORY, folder));
        OriginWriter { inner, content, heights: Vec::new(), file, below: None, interval: None }
    }

    fn wait(&mut self, layer: &Layer) -> io::Result<()> {
        self.heights.push(layer.z);
        layer.dense().iter().try_for_each(|v| self.file.write_all(&v.to_le_bytes()))
    }

    /// Writes all that waits; `interval` is their own, or the one next to them.
    fn release(&mut self, interval: &Interval) -> io::Result<()> {
        self.file.flush()?;
        let file = self.file.get_mut();
        file.rewind()?;
        let mut reader = BufReader::new(file);
        let mut value = [0; 4];
        for z in self.heights.drain(..) {
            let mut phi = vec![0.0; interval.change.len()];
            for v in &mut phi {
                reader.read_exact(&mut value)?;
                *v = f32::from_le_bytes(value);
            }
            let at = interval.at(z);
            for (v, change) in phi.iter_mut().zip(&interval.change) {
                *v = match self.content {
                    Content::Confidence => confidence(*v, at.reach * change),
                    _ if *v < 0.0 => at.origin,
                    _ => 0.0,
                };
            }
            let phi = SparseImage::of(interval.dims, &phi);
            self.inner.layer(&Layer { z, phi, output: true, contour: None })?;
        }
        self.file.get_mut().rewind()
    }
}

/// Place of a height in an interval.
struct At {
    origin: f32,
    /// `u / D`.
    reach: f32,
}

impl Interval {
    fn at(&self, z: f64) -> At {
        let [low, high] = self.heights;
        let t = (z - low) / (high - low);
        if t == 0.0 || t == 1.0 {
            At { origin: 1.0, reach: 0.0 }
        } else if t > 0.0 && t < 1.0 {
            At { origin: 2.0, reach: (t * (1.0 - t)) as f32 }
        } else {
            At { origin: 3.0, reach: (-t).max(t - 1.0) as f32 }
        }
    }
}

fn confidence(phi: f32, u: f32) -> f32 {
    if u > 0.0 { 1.0 - 0.5 * (1.0 + phi.abs() / (SCALE * u)).powi(-2) } else { 1.0 }
}

impl BodyWriter for OriginWriter {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        if layer.contour.is_some() {
            if let Some(below) = self.below.take() {
                let change = below.dense().iter().zip(layer.dense()).map(|(a, b)| (b - a).abs()).collect();
                let interval = Interval { heights: [below.z, layer.z], dims: layer.phi.dims(), change };
                self.release(&interval)?;
                self.interval = Some(interval);
            }
            self.below = Some(layer.clone());
        }
        if layer.output { self.wait(layer) } else { Ok(()) }
    }

    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()> {
        let interval = self.interval.take().ok_or_else(|| io::Error::other("a body has two contours at least"))?;
        self.release(&interval)?;
        self.inner.finish(end)
    }
}
