//! The voxels of a volume, output layer by output layer, behind whatever header.

use std::io::{self, Write};
use std::path::Path;

use super::Layer;
use super::content::Content;
use super::deflate::Deflate;
use super::header::Header;
use super::stream::{BodyWriter, Ending};
use super::transposed::Transposed;

/// Voxels that are written at once.
const VOXELS: usize = 1 << 16;

/// Writes voxels in the order of the input's axes.
pub struct VolumeWriter<W: Write> {
    out: Coded<W>,
    content: Content,
    /// Bytes of some voxels.
    bytes: Vec<u8>,
    /// Place where layers wait that are none of the volume's own.
    waiting: Option<Transposed>,
}

/// Voxels on their way into a file.
pub(super) enum Coded<W: Write> {
    Raw(W),
    Deflate(Deflate<W>),
}

impl<W: Write> Coded<W> {
    pub fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Coded::Raw(out) => out.write_all(bytes),
            Coded::Deflate(out) => out.write_all(bytes),
        }
    }

    /// Ends the stream.
    fn finish(&mut self) -> io::Result<&mut W> {
        match self {
            Coded::Raw(out) => Ok(out),
            Coded::Deflate(out) => out.finish(),
        }
    }
}

impl<W: Write> VolumeWriter<W> {
    /// Voxels after what `out` has already. Layers that lie across x or y of the volume wait in a nameless file in `folder`.
    ///
    /// # Errors
    /// The errors of that file.
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
        let [nx, ny] = layer.phi.dims();
        let mut rows = Vec::new();
        let at_once = (VOXELS / nx.max(1)).max(1);
        for first in (0..ny).step_by(at_once) {
            rows.resize(at_once.min(ny - first) * nx, 0.0);
            rows.chunks_exact_mut(nx).zip(first..).for_each(|(row, j)| layer.phi.read(0, j, row));
            self.bytes.clear();
            self.content.voxels(&rows, &mut self.bytes);
            match &mut self.waiting {
                Some(layers) => layers.push(&self.bytes),
                None => self.out.write_all(&self.bytes),
            }?;
        }
        Ok(())
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        self.end()?.flush()
    }
}
