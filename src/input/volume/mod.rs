//! Volumes of voxels in files: where they lie, and their values in the file's order.
//!
//! ```text
//! reader (header) -> Volume -> Survey (first pass: what is painted) -> axis -> slices (second pass: what is chosen)
//! ```
//!
//! No volume is ever held whole: a pass decodes it a run of voxels at a time.

pub mod axis;
pub mod data;
pub mod element;
pub mod grid;
pub mod sheets;
pub mod slices;
pub mod survey;
pub(crate) mod tiff_pages;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::stack::appearance::Appearance;
use data::Data;
use element::{Element, Voxels};
use grid::{Failure, VolumeGrid};

/// Voxels decoded at a time.
const RUN: usize = 1 << 16;

/// A volume in a file.
#[derive(Debug, Clone)]
pub struct Volume {
    /// The file that was named.
    pub path: PathBuf,
    /// Its format, for people.
    pub format: &'static str,
    /// Grid of the voxels.
    pub grid: VolumeGrid,
    /// Type of a voxel.
    pub element: Element,
    /// Whether its bytes run from the largest.
    pub big_endian: bool,
    /// The axes as the file runs through them, the fastest first.
    pub stored: [usize; 3],
    /// Factor and summand that turn a stored value into a label.
    pub scale: Option<[f64; 2]>,
    /// Notes on its header for a person.
    pub notes: Vec<String>,
    /// Labels that the file names.
    pub segments: BTreeMap<i64, Appearance>,
    /// The bytes.
    pub(crate) data: Data,
}

/// Decoder of voxels: bytes to values.
type Decode<T> = fn(Element, &Voxels<'_>, &mut Vec<T>) -> Failure<()>;

/// Neighbouring voxels of one row of the file.
#[derive(Debug, Clone, Copy)]
pub struct VoxelRun<'a, T = i64> {
    /// The first voxel, by x, y, z.
    pub first: [usize; 3],
    /// The axis along which they run.
    pub along: usize,
    /// Their labels or grey values.
    pub values: &'a [T],
}

impl Volume {
    /// A volume of labels as they are stored, x fastest, then y, then z. `element` is the type of a voxel, and whether its bytes run from the
    /// largest.
    pub(crate) fn new(
        path: &Path,
        format: &'static str,
        grid: VolumeGrid,
        (element, big_endian): (Element, bool),
        data: Data,
    ) -> Self {
        let (notes, segments) = (Vec::new(), BTreeMap::new());
        let stored = [0, 1, 2];
        Volume { path: path.into(), format, grid, element, big_endian, stored, scale: None, notes, segments, data }
    }

    /// Checks the grid, and the size of the data by that of the file.
    ///
    /// # Errors
    /// [`Error::Format`] with value and limit.
    pub(crate) fn check(&self) -> Result<()> {
        let fail = |message| Error::Format { path: self.path.clone(), message };
        self.grid.check().map_err(fail)?;
        // At most 2^40 voxels of 8 bytes.
        self.data.check(self.bytes()).map_err(fail)
    }

    /// This volume with voxels of these sides.
    ///
    /// # Errors
    /// [`Error::Setting`] where the file has its own.
    pub(crate) fn with_spacing(mut self, sides: &[f64]) -> Result<Self> {
        let fail = |message: String| Err(Error::Setting { name: "spacing".into(), message });
        let &[dx, dy, dz] = sides else { return fail(format!("must be three numbers DX,DY,DZ; got {}", sides.len())) };
        if let Some(bad) = sides.iter().find(|h| !(h.is_finite() && **h > 0.0)) {
            return fail(format!("must be three positive numbers; got {bad}"));
        }
        if self.grid.spaced {
            let [x, y, z] = self.grid.spacing();
            let path = self.path.display();
            return fail(format!("is only for a file without its own; {path} has {x} x {y} x {z} {}", self.grid.unit));
        }
        let axes = self.grid.axes();
        self.grid.steps = [dx * axes[0], dy * axes[1], dz * axes[2]];
        self.grid.unit = "mm".into();
        Ok(self)
    }

    /// The files that hold the volume.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files = vec![self.path.clone()];
        files.extend(Some(self.data.file().to_path_buf()).filter(|file| *file != self.path));
        files
    }

    /// Name and colour of a label, as far as the file says them.
    pub fn appearance(&self, label: i64) -> Appearance {
        self.segments.get(&label).cloned().unwrap_or_else(|| Appearance::label(label))
    }

    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.grid.dims.iter().product()
    }

    /// Bytes of all voxels.
    pub fn bytes(&self) -> u64 {
        self.voxels() as u64 * self.element.size() as u64
    }

    /// Decodes the volume from its first voxel to its last and hands the labels to `each`, run by run.
    ///
    /// # Errors
    /// [`Error::Format`] for data that end early or cannot be decoded, and for values that are no whole numbers.
    pub fn labels(&self, mut each: impl FnMut(VoxelRun<'_>)) -> Result<()> {
        self.decode(Element::labels, &mut each)
    }

    /// Rows of grey values.
    ///
    /// # Errors
    /// [`Error::Format`] for data that end early or cannot be decoded, and for values that are no finite numbers.
    pub fn greys(&self, mut each: impl FnMut(VoxelRun<'_, f64>)) -> Result<()> {
        self.decode(Element::greys, &mut each)
    }

    fn decode<T>(&self, decode: Decode<T>, each: &mut impl FnMut(VoxelRun<'_, T>)) -> Result<()> {
        self.runs(decode, each).map_err(|message| Error::Format { path: self.path.clone(), message })
    }

    fn runs<T>(&self, decode: Decode<T>, each: &mut impl FnMut(VoxelRun<'_, T>)) -> Failure<()> {
        let (count, size) = (self.voxels(), self.element.size());
        let row = self.grid.dims[self.stored[0]];
        let rows = self.grid.dims[self.stored[1]];
        let mut input = self.data.open()?;
        let (mut bytes, mut values) = (vec![0; RUN.min(count) * size], Vec::with_capacity(RUN.min(count)));
        let mut at = 0;
        while at < count {
            let n = RUN.min(count - at);
            let bytes = &mut bytes[..n * size];
            data::fill(&mut input, bytes, (at * size) as u64, self.bytes())?;
            values.clear();
            let voxels = Voxels { bytes, big_endian: self.big_endian, scale: self.scale, first: at };
            decode(self.element, &voxels, &mut values)?;
            let mut done = 0;
            while done < n {
                let (i, rest) = ((at + done) % row, (at + done) / row);
                let length = (row - i).min(n - done);
                let mut first = [0; 3];
                for (axis, position) in self.stored.into_iter().zip([i, rest % rows, rest / rows]) {
                    first[axis] = position;
                }
                each(VoxelRun { first, along: self.stored[0], values: &values[done..done + length] });
                done += length;
            }
            at += n;
        }
        data::end(&mut input)
    }
}

/// A file whose header is to be read.
pub(crate) fn open(path: &Path) -> Result<std::io::BufReader<std::fs::File>> {
    let file = std::fs::File::open(path).map_err(|source| Error::Read { path: path.into(), source })?;
    Ok(std::io::BufReader::new(file))
}
