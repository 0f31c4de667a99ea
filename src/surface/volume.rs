//! The voxels of a volume, output layer by output layer, behind whatever header.

use std::io::{self, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};

use super::Layer;
use super::stream::{BodyWriter, Ending, Header};
use super::transposed::Transposed;

/// What a volume holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// f32 signed in-plane distance in the stack's unit, negative inside, clamped to the margin.
    Distance,
    /// u8, 1 inside and 0 outside.
    Mask,
}

impl Content {
    /// Bytes of a voxel.
    pub(super) fn size(self) -> usize {
        match self {
            Content::Distance => size_of::<f32>(),
            Content::Mask => size_of::<u8>(),
        }
    }

    /// Voxels of a layer as little-endian bytes, x fastest, put behind `bytes`.
    pub(super) fn voxels(self, layer: &Layer, bytes: &mut Vec<u8>) {
        match self {
            Content::Distance => layer.phi.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes())),
            Content::Mask => bytes.extend(layer.phi.iter().map(|v| u8::from(*v < 0.0))),
        }
    }
}

/// Writes voxels in the order of the input's axes.
pub struct VolumeWriter<W: Write> {
    out: Coded<W>,
    content: Content,
    /// The layer's bytes.
    bytes: Vec<u8>,
    /// Where layers wait that are none of the volume's own.
    waiting: Option<Transposed>,
}

/// Voxels on their way into a file.
pub(super) enum Coded<W: Write> {
    Raw(W),
    Gzip(GzEncoder<W>),
    Zlib(ZlibEncoder<W>),
}

impl<W: Write> Coded<W> {
    /// A gzip stream, as fast as can be.
    pub fn gzip(out: W) -> Self {
        Coded::Gzip(GzEncoder::new(out, Compression::fast()))
    }

    /// A zlib stream, as fast as can be.
    pub fn zlib(out: W) -> Self {
        Coded::Zlib(ZlibEncoder::new(out, Compression::fast()))
    }

    pub fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Coded::Raw(out) => out.write_all(bytes),
            Coded::Gzip(out) => out.write_all(bytes),
            Coded::Zlib(out) => out.write_all(bytes),
        }
    }

    /// Ends the stream.
    fn finish(&mut self) -> io::Result<&mut W> {
        Ok(match self {
            Coded::Raw(out) => out,
            Coded::Gzip(gzip) => {
                gzip.try_finish()?;
                gzip.get_mut()
            }
            Coded::Zlib(zlib) => {
                zlib.try_finish()?;
                zlib.get_mut()
            }
        })
    }
}

impl<W: Write> VolumeWriter<W> {
    /// Voxels after what `out` has already. Layers that lie across x or y of the volume wait in a nameless file in `folder`.
    ///
    /// # Errors
    /// Those of that file.
    pub(super) fn new(out: Coded<W>, body: &Header, content: Content, folder: &Path) -> io::Result<Self> {
        let waiting = if body.geometry.is_layered() { None } else { Some(Transposed::new(body, content, folder)?) };
        Ok(VolumeWriter { out, content, bytes: Vec::new(), waiting })
    }

    /// Writes what waits and ends the stream.
    pub(super) fn end(&mut self) -> io::Result<&mut W> {
        if let Some(mut layers) = self.waiting.take() {
            layers.rows(|row| self.out.write_all(row))?;
        }
        self.out.finish()
    }
}

impl<W: Write + Send> BodyWriter for VolumeWriter<W> {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        if !layer.output {
            return Ok(());
        }
        self.bytes.clear();
        self.content.voxels(layer, &mut self.bytes);
        match &mut self.waiting {
            Some(layers) => layers.push(&self.bytes),
            None => self.out.write_all(&self.bytes),
        }
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        self.end()?.flush()
    }
}
