//! Sections of a body, read and joined.

use std::cmp::Ordering;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use flate2::read::GzDecoder;

use super::{BUFFER_BYTES, END, Head, LAYER, MAGIC, VALUES, WHOLE};
use crate::error::{Error, Result};
use crate::files::like::Like;
use crate::files::options::OutputOptions;
use crate::grid::sparse_image::{SQUARE, SparseImage};
use crate::report::Report;
use crate::stack::Geometry;
use crate::storage::regular;
use crate::surface::header::Header;
use crate::surface::stream::LayerSink;
use crate::surface::{Layer, Reconstruction};

/// Longest first line, bytes.
const LONGEST_HEAD: u64 = 1 << 20;
/// Most pixels of a layer.
const MOST_PIXELS: usize = 1 << 40;
/// Most parts that are listed as missing.
const LISTED: usize = 10;

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
        let lengths = [head.spacing[0], head.spacing[1], head.grid.step];
        if lengths.iter().any(|v| !v.is_normal() || *v < 0.0) {
            return Err(wrong(format!(
                "pixels of {} x {} and layers {} apart cannot be",
                lengths[0], lengths[1], lengths[2]
            )));
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
