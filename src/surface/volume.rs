//! The voxels of a volume, output layer by output layer, behind whatever header.

use std::io::{self, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};

use super::Layer;
use super::header::Header;
use super::stream::{BodyWriter, Ending};
use super::transposed::Transposed;

/// Voxels that are written at once.
const VOXELS: usize = 1 << 16;

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
    /// Numbers of labels: a layer has them instead of distances.
    Labels(Whole),
}

/// Whole numbers that hold labels, the smallest that can.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Whole {
    /// 0 to 255.
    U8,
    /// 0 to 65535.
    U16,
    /// To 2^24 either side of 0, as far as f32 goes.
    I32,
}

impl Whole {
    /// Largest label either side of 0.
    pub const MOST: i64 = 1 << 24;

    /// What holds labels from `least` to `most`, and 0; `None` beyond [`Whole::MOST`].
    pub fn holding(least: i64, most: i64) -> Option<Self> {
        match (least, most) {
            (0.., ..=0xff) => Some(Whole::U8),
            (0.., ..=0xffff) => Some(Whole::U16),
            _ if least >= -Self::MOST && most <= Self::MOST => Some(Whole::I32),
            _ => None,
        }
    }
}

/// What a voxel is in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    F32,
    U8,
    U16,
    I32,
}

impl Content {
    /// What a voxel is.
    pub(super) fn scalar(self) -> Scalar {
        match self {
            Content::Distance | Content::Confidence => Scalar::F32,
            Content::Mask | Content::Origin | Content::Labels(Whole::U8) => Scalar::U8,
            Content::Labels(Whole::U16) => Scalar::U16,
            Content::Labels(Whole::I32) => Scalar::I32,
        }
    }

    /// Bytes of a voxel.
    pub(super) fn size(self) -> usize {
        match self.scalar() {
            Scalar::F32 | Scalar::I32 => 4,
            Scalar::U16 => 2,
            Scalar::U8 => 1,
        }
    }

    /// Voxels of (a part of) a layer as little-endian bytes, x fastest, put behind `bytes`.
    pub(super) fn voxels(self, phi: &[f32], bytes: &mut Vec<u8>) {
        match self {
            Content::Distance | Content::Confidence => {
                phi.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()))
            }
            Content::Mask => bytes.extend(phi.iter().map(|v| u8::from(*v < 0.0))),
            Content::Origin | Content::Labels(Whole::U8) => bytes.extend(phi.iter().map(|v| *v as u8)),
            Content::Labels(Whole::U16) => bytes.extend(phi.iter().flat_map(|v| (*v as u16).to_le_bytes())),
            Content::Labels(Whole::I32) => bytes.extend(phi.iter().flat_map(|v| (*v as i32).to_le_bytes())),
        }
    }
}

/// Writes voxels in the order of the input's axes.
pub struct VolumeWriter<W: Write> {
    out: Coded<W>,
    content: Content,
    /// Bytes of some voxels.
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
        layer.phi.chunks(VOXELS).try_for_each(|some| {
            self.bytes.clear();
            self.content.voxels(some, &mut self.bytes);
            match &mut self.waiting {
                Some(layers) => layers.push(&self.bytes),
                None => self.out.write_all(&self.bytes),
            }
        })
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        self.end()?.flush()
    }
}
