//! A section of a body on its way to be joined with the others: its layers and its report in one file.
//!
//! ```text
//! a gzip stream: one line of JSON (Head), then records:
//! 1, height f64, output u8, contour + 1 u64 (0: none), and square by square of 16 x 16 px, row by row:
//!     1 and the signed distance f32 that it has everywhere, or 0 and the distances f32 of its pixels, as far as the image goes, row by row
//! 0, length u64, report as JSON
//! ```
//! Numbers are little-endian; gzip's checksum tells whether all is as it was written. Joined sections go through the writers of a single run, so that its files have the same bytes.

use std::cmp::Ordering;
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use flate2::read::GzDecoder;
use serde::{Deserialize, Serialize};

use super::Loaded;
use super::like::Like;
use super::options::OutputOptions;
use super::pending::{Pending, Temporary};
use super::places::Places;
use crate::error::{Error, Result};
use crate::grid::sparse_image::{SQUARE, SparseImage};
use crate::report::Report;
use crate::stack::appearance::Appearance;
use crate::stack::{ContourStack, Geometry, HeightGrid};
use crate::storage::regular;
use crate::surface::content::Paint;
use crate::surface::deflate::Deflate;
use crate::surface::header::Header;
use crate::surface::like::LikeGrid;
use crate::surface::map::Map;
use crate::surface::stream::LayerSink;
use crate::surface::{Layer, Reconstruction};

/// Bytes of a file's buffer.
const BUFFER_BYTES: usize = 1 << 20;
/// First word of every file.
const MAGIC: &str = "interslice section 2";
/// Extension of their names: a section stands in no place that could be another file's.
const EXTENSION: &str = "section";
/// Longest first line, bytes.
const LONGEST_HEAD: u64 = 1 << 20;
/// Most pixels of a layer.
const MOST_PIXELS: usize = 1 << 40;
/// Most parts that are listed as missing.
const LISTED: usize = 10;
/// Kinds of records.
const LAYER: u8 = 1;
const END: u8 = 0;
/// Kinds of squares.
const WHOLE: u8 = 1;
const VALUES: u8 = 0;

/// Body that a section is part of.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    format: String,
    version: String,
    /// Fingerprint of input and options.
    fingerprint: String,
    /// Its number, from 1, and how many there are.
    part: [usize; 2],
    dims: [usize; 2],
    spacing: [f64; 2],
    unit: String,
    geometry: Geometry,
    /// Extent of the body where the section ends with it.
    extent: [f64; 2],
    /// Heights of the output layers of all sections.
    grid: HeightGrid,
    /// Options of the outputs.
    output: OutputOptions,
    /// Name and colour that the input says.
    map: Option<Map>,
    bodies: Vec<Appearance>,
    /// Voxels of a mask as the input's.
    #[serde(default)]
    paint: Option<Paint>,
    /// Grid that outputs are asked to have.
    #[serde(default)]
    like: Option<LikeGrid>,
}

impl Head {
    /// Whether it is the head of a section of the same body.
    fn is_beside(&self, other: &Head) -> bool {
        // Less what is each section's own.
        let body = |head: &Head| {
            let head = Head { part: [0, head.part[1]], extent: [0.0; 2], ..head.clone() };
            serde_json::to_value(head).ok()
        };
        body(self) == body(other)
    }
}

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
        let Pending::File(file, _) = &mut self.pending else { return Ok(()) };
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
        match pending.rename(&target) {
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
        if let Pending::File(file, _) = &mut self.pending {
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
            paths.iter().map(|path| Ok((path.clone(), SectionReader::open(path)?.head))).collect::<Result<_>>()?;
        files.sort_by_key(|(_, head)| head.part[0]);
        let Some((first_path, first)) = files.first() else {
            return Err(Error::Setting { name: "parts".into(), message: "are missing: nothing to merge".into() });
        };
        let fail = |path: &Path, message: String| Err(Error::Format { path: path.into(), message });
        let count = first.part[1];
        for (path, head) in &files {
            if !head.is_beside(first) {
                let [number, of] = head.part;
                let first = first_path.display();
                return fail(
                    path,
                    format!(
                        "is part {number} of {of} of another body than {first}: input, options or number of parts differ"
                    ),
                );
            }
        }
        if let Some(twice) = files.windows(2).find(|w| w[0].1.part == w[1].1.part) {
            return fail(&twice[1].0, format!("is part {} again, as {}", twice[1].1.part[0], twice[0].0.display()));
        }
        if files.len() < count {
            let there = |k: &usize| files.binary_search_by_key(k, |(_, head)| head.part[0]).is_ok();
            let missing: Vec<String> = (1..=count).filter(|k| !there(k)).take(LISTED).map(|k| k.to_string()).collect();
            let more = if missing.len() < count - files.len() { ", ..." } else { "" };
            let number = count - files.len();
            return fail(
                first_path,
                format!("of the {count} parts of its body {number} are missing: {}{more}", missing.join(", ")),
            );
        }
        Ok(Sections { files })
    }

    /// Pixels of a layer.
    pub fn dims(&self) -> [usize; 2] {
        self.files[0].1.dims
    }

    /// Placement of the layers.
    pub fn geometry(&self) -> &Geometry {
        &self.files[0].1.geometry
    }

    /// Options of the outputs, as the sections have them.
    pub fn output(&self) -> OutputOptions {
        let Head { output, map, bodies, paint, like, .. } = self.files[0].1.clone();
        let target = like.map(|grid| Arc::new(Like::of(grid)));
        OutputOptions { map: map.map(Arc::new), bodies, paint, target, ..output }
    }

    /// Hands all layers to `sink`, lowest first; the body without layers.
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::Format`] for damaged files; what `sink` says.
    pub fn replay(&self, sink: &mut dyn LayerSink) -> Result<Reconstruction> {
        let (bottom, top) = (&self.files[0].1, &self.files[self.files.len() - 1].1);
        let Head { dims, spacing, unit, geometry, grid, .. } = bottom.clone();
        let extent = [bottom.extent[0], top.extent[1]];
        sink.begin(&Header { dims, spacing, unit: unit.clone(), geometry, extent, grid })?;
        let mut whole: Option<Report> = None;
        let mut seen = Seen { z: f64::NEG_INFINITY, output: 0 };
        for (path, _) in &self.files {
            let report = SectionReader::open(path)?.replay(&mut seen, sink)?;
            match &mut whole {
                Some(whole) => whole.join(report),
                none => *none = Some(report),
            }
        }
        if seen.output != grid.count {
            let message = format!("its body has {} output layers, expected {}", seen.output, grid.count);
            return Err(Error::Format { path: self.files[0].0.clone(), message });
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

/// Sections of a body read so far.
struct Seen {
    /// Height of the last layer.
    z: f64,
    /// Output layers.
    output: usize,
}

/// A section that is read.
struct SectionReader {
    path: PathBuf,
    head: Head,
    input: BufReader<GzDecoder<BufReader<File>>>,
}

impl SectionReader {
    fn open(path: &Path) -> Result<Self> {
        let file = regular::open(path).map_err(|source| Error::Read { path: path.into(), source })?;
        let mut input = BufReader::new(GzDecoder::new(BufReader::with_capacity(BUFFER_BYTES, file)));
        let wrong = |message: String| Error::Format { path: path.into(), message };
        let mut line = Vec::new();
        let read = input.by_ref().take(LONGEST_HEAD).read_until(b'\n', &mut line);
        let none = "is not a part that `interslice run` has written";
        read.map_err(|e| failure(path, none, e))?;
        let head: Head = serde_json::from_slice(&line).map_err(|e| wrong(format!("{none}: {e}")))?;
        if head.format != MAGIC || head.version != env!("CARGO_PKG_VERSION") {
            let Head { format, version, .. } = &head;
            let own = env!("CARGO_PKG_VERSION");
            return Err(wrong(format!("is `{format}` of version {version}, expected `{MAGIC}` of version {own}")));
        }
        let [nx, ny] = head.dims;
        let sound = nx.checked_mul(ny).is_some_and(|pixels| (1..=MOST_PIXELS).contains(&pixels));
        if !sound || !(1..=head.part[1]).contains(&head.part[0]) {
            return Err(wrong(format!("part {} of {} of {nx} x {ny} pixels cannot be", head.part[0], head.part[1])));
        }
        if let Some(map) = head.map.as_ref().filter(|map| !map.lies_within(head.dims)) {
            let ([x, y], [i, j]) = (map.dims, map.first);
            return Err(wrong(format!("a map of {x} x {y} pixels from ({i}, {j}) cannot be")));
        }
        head.geometry.validate().map_err(|e| wrong(e.to_string()))?;
        Ok(SectionReader { path: path.into(), head, input })
    }

    /// Hands its layers to `sink`; its report.
    fn replay(mut self, seen: &mut Seen, sink: &mut dyn LayerSink) -> Result<Report> {
        while let Some(layer) = self.layer().map_err(|e| self.damaged(e))? {
            if layer.z.partial_cmp(&seen.z) != Some(Ordering::Greater) {
                let order = format!("a layer at {} behind one at {}", layer.z, seen.z);
                return Err(self.damaged(io::Error::other(order)));
            }
            seen.z = layer.z;
            seen.output += usize::from(layer.output);
            sink.layer(layer)?;
        }
        self.report().map_err(|e| self.damaged(e))
    }

    /// The next layer, or nothing before the report.
    fn layer(&mut self) -> io::Result<Option<Layer>> {
        match number::<1>(&mut self.input)? {
            [LAYER] => {}
            [END] => return Ok(None),
            [kind] => return Err(io::Error::other(format!("a record of kind {kind}"))),
        }
        let z = f64::from_le_bytes(number(&mut self.input)?);
        let [output] = number(&mut self.input)?;
        let contour = u64::from_le_bytes(number(&mut self.input)?) as usize;
        let dims = self.head.dims;
        let phi = SparseImage::read_squares(dims, |square, values| match number::<1>(&mut self.input)? {
            [WHOLE] => Ok(Some(f32::from_le_bytes(number(&mut self.input)?))),
            [VALUES] => {
                let [width, height] = [0, 1].map(|a| SQUARE.min(dims[a] - square[a] * SQUARE));
                for row in values.chunks_exact_mut(SQUARE).take(height) {
                    for v in &mut row[..width] {
                        *v = f32::from_le_bytes(number(&mut self.input)?);
                    }
                }
                Ok(None)
            }
            [kind] => Err(io::Error::other(format!("a square of kind {kind}"))),
        })?;
        Ok(Some(Layer { z, phi, output: output == 1, contour: contour.checked_sub(1) }))
    }

    /// The report, and the end of the file.
    fn report(&mut self) -> io::Result<Report> {
        let length = u64::from_le_bytes(number(&mut self.input)?);
        let report = serde_json::from_slice(&take(&mut self.input, length)?)?;
        // Only at its end gzip's checksum is compared.
        match self.input.read(&mut [0])? {
            0 => Ok(report),
            _ => Err(io::Error::other("more than its report")),
        }
    }

    fn damaged(&self, e: io::Error) -> Error {
        failure(&self.path, "is damaged", e)
    }
}

/// An error of the disk, or of what the file holds.
fn failure(path: &Path, what: &str, e: io::Error) -> Error {
    use io::ErrorKind::{InvalidData, InvalidInput, Other, UnexpectedEof};
    match e.kind() {
        InvalidData | InvalidInput | Other | UnexpectedEof => {
            Error::Format { path: path.into(), message: format!("{what}: {e}") }
        }
        _ => Error::Read { path: path.into(), source: e },
    }
}

fn number<const N: usize>(input: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    input.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// Reads so many bytes, of which no more are asked of memory than there are.
fn take(input: &mut impl Read, count: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    if (input.take(count).read_to_end(&mut bytes)? as u64) < count {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(bytes)
}
