//! The voxels of a volume, output layer by output layer, behind whatever header.

use std::io::{self, Write};

use flate2::Compression;
use flate2::write::GzEncoder;

use super::Layer;
use super::stream::{BodyWriter, Ending};

/// What a volume holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// f32 signed in-plane distance in the stack's unit, negative inside, clamped to the margin.
    Distance,
    /// u8, 1 inside and 0 outside.
    Mask,
    /// u8, where a voxel comes from, see [`origin`](super::origin).
    Origin,
    /// f32, how far a voxel's side can be relied on, see [`origin`](super::origin).
    Confidence,
}

impl Content {
    /// Whether voxels are f32, else u8.
    pub fn is_float(self) -> bool {
        matches!(self, Content::Distance | Content::Confidence)
    }

    /// Voxels of a layer as little-endian bytes, x fastest, put behind `bytes`.
    pub(super) fn voxels(self, layer: &Layer, bytes: &mut Vec<u8>) {
        match self {
            Content::Distance | Content::Confidence => {
                layer.phi.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()))
            }
            Content::Mask => bytes.extend(layer.phi.iter().map(|v| u8::from(*v < 0.0))),
            Content::Origin => bytes.extend(layer.phi.iter().map(|v| *v as u8)),
        }
    }
}

/// Writes voxels.
pub struct VolumeWriter<W: Write> {
    out: Coded<W>,
    content: Content,
    /// The layer's bytes.
    bytes: Vec<u8>,
}

enum Coded<W: Write> {
    Raw(W),
    Gzip(GzEncoder<W>),
}

impl<W: Write> Coded<W> {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Coded::Raw(out) => out.write_all(bytes),
            Coded::Gzip(out) => out.write_all(bytes),
        }
    }
}

impl<W: Write> VolumeWriter<W> {
    /// Voxels as they are, after what `out` has already.
    pub fn raw(out: W, content: Content) -> Self {
        VolumeWriter { out: Coded::Raw(out), content, bytes: Vec::new() }
    }

    /// Voxels in a gzip stream that begins with `head`.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn gzip(out: W, head: &[u8], content: Content) -> io::Result<Self> {
        let mut gzip = GzEncoder::new(out, Compression::fast());
        gzip.write_all(head)?;
        Ok(VolumeWriter { out: Coded::Gzip(gzip), content, bytes: Vec::new() })
    }
}

impl<W: Write + Send> BodyWriter for VolumeWriter<W> {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        if !layer.output {
            return Ok(());
        }
        self.bytes.clear();
        self.content.voxels(layer, &mut self.bytes);
        self.out.write_all(&self.bytes)
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        match &mut self.out {
            Coded::Raw(out) => out.flush(),
            Coded::Gzip(gzip) => {
                gzip.try_finish()?;
                gzip.get_mut().flush()
            }
        }
    }
}
