//! A section on its way into its file.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::{BUFFER_BYTES, END, Head, LAYER, MAGIC, VALUES, WHOLE};
use crate::error::{Error, Result};
use crate::files::Loaded;
use crate::files::pending::{Made, Pending, Temporary};
use crate::files::places::Places;
use crate::report::Report;
use crate::stack::ContourStack;
use crate::surface::Layer;
use crate::surface::deflate::Deflate;
use crate::surface::header::Header;
use crate::surface::stream::LayerSink;

/// Extension of their names: a section stands in no place that could be another file's.
const EXTENSION: &str = "section";

/// Writes a section under a temporary name.
pub struct SectionWriter {
    target: PathBuf,
    pending: Pending,
    head: Head,
    out: Option<Deflate<BufWriter<File>>>,
}

impl SectionWriter {
    /// Opens the file of part `part` (number from 1, count) of the body with this fingerprint.
    ///
    /// # Errors
    /// [`Error::Output`] for a name that cannot be written is that of an input, or is not `*.section`.
    pub fn open(
        target: &Path,
        part: [usize; 2],
        fingerprint: String,
        loaded: &Loaded,
        places: &mut Places,
    ) -> Result<Self> {
        if target.extension().is_none_or(|e| e != EXTENSION) {
            let message = format!("a part's name must end in .{EXTENSION}");
            return Err(Error::Output { path: target.into(), message });
        }
        let pending = Pending::open(target, false, Temporary::Random, places)?;
        let ContourStack { dims, spacing, unit, geometry, .. } = &loaded.stack;
        let head = Head {
            format: MAGIC.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            fingerprint,
            part,
            dims: *dims,
            spacing: *spacing,
            unit: unit.clone(),
            geometry: *geometry,
            extent: [0.0; 2],
            grid: loaded.grid(),
            output: loaded.options.output.clone(),
            map: loaded.options.output.map.as_deref().cloned(),
            bodies: loaded.options.output.bodies.clone(),
            paint: loaded.options.output.paint,
            like: loaded.options.output.target.as_ref().map(|like| like.grid.clone()),
        };
        Ok(SectionWriter { target: target.into(), pending, head, out: None })
    }

    fn fails(&self, source: io::Error) -> Error {
        Error::Write { path: self.target.clone(), source }
    }

    fn start(&mut self) -> io::Result<()> {
        let Made::File(file, _) = &mut self.pending.made else { return Ok(()) };
        let out = BufWriter::with_capacity(BUFFER_BYTES, file.reopen()?);
        let mut out = Deflate::gzip(out);
        serde_json::to_writer(&mut out, &self.head)?;
        out.write_all(b"\n")?;
        self.out = Some(out);
        Ok(())
    }

    /// Writes the report behind the layers and gives the file its name.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn finish(mut self, report: &Report) -> Result<PathBuf> {
        let end = |out: Option<Deflate<BufWriter<File>>>| -> io::Result<()> {
            let Some(mut out) = out else { return Ok(()) };
            let report = serde_json::to_vec(report)?;
            out.write_all(&[END])?;
            out.write_all(&(report.len() as u64).to_le_bytes())?;
            out.write_all(&report)?;
            out.finish()?.flush()
        };
        let out = self.out.take();
        end(out).and_then(|()| self.pending.sync()).map_err(|e| self.fails(e))?;
        let SectionWriter { target, pending, .. } = self;
        match pending.rename() {
            Ok(()) => Ok(target),
            Err(source) => Err(Error::Write { path: target, source }),
        }
    }
}

impl LayerSink for SectionWriter {
    fn begin(&mut self, header: &Header) -> Result<()> {
        self.head.extent = header.extent;
        // What came before ends in the file first.
        self.out = None;
        if let Made::File(file, _) = &mut self.pending.made {
            file.as_file_mut().set_len(0).map_err(|source| Error::Write { path: self.target.clone(), source })?;
        }
        self.start().map_err(|e| self.fails(e))
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
        let Some(out) = &mut self.out else { return Ok(()) };
        let phi = &layer.phi;
        let mut bytes = Vec::with_capacity(18 + phi.bytes());
        bytes.push(LAYER);
        bytes.extend(layer.z.to_le_bytes());
        bytes.push(u8::from(layer.output));
        bytes.extend(layer.contour.map_or(0, |i| i as u64 + 1).to_le_bytes());
        for square in phi.each_square() {
            match phi.whole(square) {
                Some(v) => {
                    bytes.push(WHOLE);
                    bytes.extend_from_slice(&v.to_le_bytes());
                }
                None => {
                    bytes.push(VALUES);
                    phi.of_square(square).flatten().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
                }
            }
        }
        out.write_all(&bytes).map_err(|source| Error::Write { path: self.target.clone(), source })
    }
}
