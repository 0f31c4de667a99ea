//! A section of a body on its way to be joined with the others: its layers and its report in one file.
//!
//! ```text
//! one line of JSON (Head), then a gzip stream of records:
//! 1, height f64, output u8, contour + 1 u64 (0: none), nx * ny signed distances f32
//! 0, length u64, report as JSON
//! ```
//! Numbers are little-endian. Joined sections go through the writers of a single run, so that its files have the same bytes.

use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use serde::{Deserialize, Serialize};

use super::pending::{Pending, Temporary, parent};
use crate::error::{Error, Result};
use crate::report::Report;
use crate::stack::Geometry;
use crate::surface::stream::{Header, LayerSink};
use crate::surface::{Layer, Reconstruction};

/// First word of every file.
const MAGIC: &str = "interslice section";
/// Longest first line, bytes.
const LONGEST_HEAD: u64 = 1 << 20;
/// Kinds of records.
const LAYER: u8 = 1;
const END: u8 = 0;

/// What a section is part of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    format: String,
    version: String,
    /// Of input and options.
    fingerprint: String,
    /// Its number, from 1, and how many there are.
    part: [usize; 2],
    dims: [usize; 2],
    spacing: [f64; 2],
    unit: String,
    geometry: Geometry,
    /// Of the body where the section ends with it.
    extent: [f64; 2],
    /// Heights of the output layers of all sections.
    heights: Vec<f64>,
}

/// Writes a section under a temporary name.
pub struct SectionWriter {
    target: PathBuf,
    pending: Pending,
    head: Head,
    out: Option<GzEncoder<BufWriter<File>>>,
}

impl SectionWriter {
    /// Opens the file of part `part` (number from 1, count) of the body with this fingerprint, whose output layers have these `heights`.
    ///
    /// # Errors
    /// [`Error::Output`] for a name that cannot be written.
    pub fn open(target: &Path, part: [usize; 2], fingerprint: String, heights: &[f64]) -> Result<Self> {
        let fail = |message: String| Error::Output { path: target.into(), message };
        if target.is_dir() {
            return Err(fail("is a folder".into()));
        }
        let pending = Pending::open(target, false, Temporary::Random)
            .map_err(|e| fail(format!("in folder {}: {e}", parent(target).display())))?;
        let head = Head {
            format: MAGIC.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            fingerprint,
            part,
            dims: [0; 2],
            spacing: [0.0; 2],
            unit: String::new(),
            geometry: Geometry::default(),
            extent: [0.0; 2],
            heights: heights.to_vec(),
        };
        Ok(SectionWriter { target: target.into(), pending, head, out: None })
    }

    fn fails(&self, source: io::Error) -> Error {
        Error::Write { path: self.target.clone(), source }
    }

    fn start(&mut self) -> io::Result<()> {
        let Pending::File(file) = &mut self.pending else { return Ok(()) };
        let mut out = BufWriter::with_capacity(1 << 20, file.reopen()?);
        serde_json::to_writer(&mut out, &self.head)?;
        out.write_all(b"\n")?;
        self.out = Some(GzEncoder::new(out, Compression::fast()));
        Ok(())
    }

    /// Writes the report behind the layers and gives the file its name.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn finish(mut self, report: &Report) -> Result<PathBuf> {
        let end = |out: Option<GzEncoder<BufWriter<File>>>| -> io::Result<()> {
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
        match pending.rename(&target) {
            Ok(()) => Ok(target),
            Err(source) => Err(Error::Write { path: target, source }),
        }
    }
}

impl LayerSink for SectionWriter {
    fn begin(&mut self, header: &Header) -> Result<()> {
        let Header { dims, spacing, unit, geometry, extent, .. } = header.clone();
        self.head = Head { dims, spacing, unit, geometry, extent, ..self.head.clone() };
        if let Pending::File(file) = &mut self.pending {
            file.as_file_mut().set_len(0).map_err(|source| Error::Write { path: self.target.clone(), source })?;
        }
        self.start().map_err(|e| self.fails(e))
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
        let Some(out) = &mut self.out else { return Ok(()) };
        let mut bytes = Vec::with_capacity(18 + 4 * layer.phi.len());
        bytes.push(LAYER);
        bytes.extend(layer.z.to_le_bytes());
        bytes.push(u8::from(layer.output));
        bytes.extend(layer.contour.map_or(0, |i| i as u64 + 1).to_le_bytes());
        layer.phi.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        out.write_all(&bytes).map_err(|source| Error::Write { path: self.target.clone(), source })
    }
}

/// All sections of a body, in order.
#[derive(Debug)]
pub struct Sections {
    files: Vec<(PathBuf, Head)>,
}

impl Sections {
    /// Opens the sections of one body, given in any order.
    ///
    /// # Errors
    /// [`Error::Read`]; [`Error::Format`] for files that are no sections, of different bodies, or not all of them.
    pub fn open(paths: &[PathBuf]) -> Result<Self> {
        let mut files: Vec<(PathBuf, Head)> =
            paths.iter().map(|path| Ok((path.clone(), head(path)?.0))).collect::<Result<_>>()?;
        files.sort_by_key(|(_, head)| head.part[0]);
        let Some((first_path, first)) = files.first() else {
            return Err(Error::Setting { name: "parts".into(), message: "are missing: nothing to merge".into() });
        };
        let count = first.part[1];
        for (path, head) in &files {
            let fail = |message: String| Err(Error::Format { path: path.clone(), message });
            if head.fingerprint != first.fingerprint || head.part[1] != count {
                return fail(format!(
                    "is part {} of {} of another body (input, options or number of parts differ from {})",
                    head.part[0],
                    head.part[1],
                    first_path.display()
                ));
            }
        }
        let numbers: Vec<usize> = files.iter().map(|(_, head)| head.part[0]).collect();
        let missing: Vec<String> = (1..=count).filter(|k| !numbers.contains(k)).map(|k| k.to_string()).collect();
        if !missing.is_empty() {
            let message = format!("of the {count} parts of its body these are missing: {}", missing.join(", "));
            return Err(Error::Format { path: first_path.clone(), message });
        }
        if let Some(twice) = files.windows(2).find(|w| w[0].1.part == w[1].1.part) {
            let message = format!("is part {} again, as {}", twice[1].1.part[0], twice[0].0.display());
            return Err(Error::Format { path: twice[1].0.clone(), message });
        }
        Ok(Sections { files })
    }

    /// Pixels of a layer.
    pub fn dims(&self) -> [usize; 2] {
        self.files[0].1.dims
    }

    /// How the layers lie.
    pub fn geometry(&self) -> &Geometry {
        &self.files[0].1.geometry
    }

    /// Hands all layers to `sink`, lowest first; the body without layers.
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::Format`] for damaged files; what `sink` says.
    pub fn replay(&self, sink: &mut dyn LayerSink) -> Result<Reconstruction> {
        let (bottom, top) = (&self.files[0].1, &self.files[self.files.len() - 1].1);
        let Head { dims, spacing, unit, geometry, heights, .. } = bottom.clone();
        let extent = [bottom.extent[0], top.extent[1]];
        let grid = Header::grid(&heights, spacing);
        sink.begin(&Header { dims, spacing, unit: unit.clone(), geometry, extent, grid })?;
        let mut whole: Option<Report> = None;
        for (path, _) in &self.files {
            let report = replay_one(path, sink)?;
            match &mut whole {
                Some(whole) => whole.join(report),
                none => *none = Some(report),
            }
        }
        Ok(Reconstruction {
            dims,
            spacing,
            unit,
            geometry,
            extent,
            layers: Vec::new(),
            report: whole.unwrap_or_default(),
        })
    }
}

/// The first line of a section, and what follows it.
fn head(path: &Path) -> Result<(Head, BufReader<File>)> {
    let failed = |source| Error::Read { path: path.into(), source };
    let mut file = BufReader::with_capacity(1 << 20, File::open(path).map_err(failed)?);
    let mut line = Vec::new();
    file.by_ref().take(LONGEST_HEAD).read_until(b'\n', &mut line).map_err(failed)?;
    let wrong = |message: String| Error::Format { path: path.into(), message };
    let head: Head = serde_json::from_slice(&line)
        .map_err(|e| wrong(format!("is not a section that `interslice run` has written: {e}")))?;
    if head.format != MAGIC || head.version != env!("CARGO_PKG_VERSION") {
        return Err(wrong(format!(
            "is `{}` of version {}, expected `{MAGIC}` of version {}",
            head.format,
            head.version,
            env!("CARGO_PKG_VERSION")
        )));
    }
    if head.part[0] == 0 || head.part[0] > head.part[1] || head.dims.contains(&0) {
        return Err(wrong(format!("part {:?} of {:?} pixels cannot be", head.part, head.dims)));
    }
    head.geometry.validate().map_err(|e| wrong(e.to_string()))?;
    Ok((head, file))
}

fn replay_one(path: &Path, sink: &mut dyn LayerSink) -> Result<Report> {
    let (head, file) = head(path)?;
    let damaged = |e: io::Error| Error::Format { path: path.into(), message: format!("is damaged: {e}") };
    let too_large = || damaged(io::Error::other(format!("{:?} pixels", head.dims)));
    let pixels = head.dims[0].checked_mul(head.dims[1]).filter(|n| *n < usize::MAX / 4).ok_or_else(too_large)?;
    let mut input = GzDecoder::new(file);
    loop {
        match number::<1>(&mut input).map_err(damaged)? {
            [LAYER] => {
                let z = f64::from_le_bytes(number(&mut input).map_err(damaged)?);
                let [output] = number(&mut input).map_err(damaged)?;
                let contour = u64::from_le_bytes(number(&mut input).map_err(damaged)?);
                let bytes = take(&mut input, 4 * pixels as u64).map_err(damaged)?;
                let phi = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
                let contour = (contour as usize).checked_sub(1);
                sink.layer(Layer { z, phi, output: output == 1, contour })?;
            }
            [END] => {
                let length = u64::from_le_bytes(number(&mut input).map_err(damaged)?);
                let bytes = take(&mut input, length).map_err(damaged)?;
                return serde_json::from_slice(&bytes).map_err(|e| damaged(e.into()));
            }
            [kind] => return Err(damaged(io::Error::other(format!("record of kind {kind}")))),
        }
    }
}

fn number<const N: usize>(input: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    input.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// So many bytes, of which no more are asked of memory than there are.
fn take(input: &mut impl Read, count: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    if (input.take(count).read_to_end(&mut bytes)? as u64) < count {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(bytes)
}
