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
mod naming;
pub mod sheets;
pub mod slices;
pub mod survey;
pub(crate) mod tiff_lzw;
pub(crate) mod tiff_pages;
#[cfg(feature = "zarr")]
mod zarr_bounded;
#[cfg(feature = "zarr")]
pub(crate) mod zarr_slabs;

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::stack::appearance::Appearance;
use crate::storage::regular;
use data::{Data, GivenVoxels};
use element::{Element, Unreadable, Voxels};
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
    /// What the file lacks of the sides of its voxels, though it has some.
    pub lacks: Option<Lacking>,
    /// Labels that the file names.
    pub segments: BTreeMap<i64, Appearance>,
    /// Segments that may overlap, where the file holds such.
    pub(crate) layers: Option<Layers>,
    /// The bytes.
    pub(crate) data: Data,
}

/// Words on a side of the voxels that a file does not have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Lacking {
    /// By its format's custom it has a value all the same.
    Assumed(String),
    /// It must be said.
    Needed(String),
}

/// Several values of a voxel, one behind the other: each layer holds segments that do not overlap, and those of different layers may.
#[derive(Debug, Clone)]
pub(crate) struct Layers {
    /// Layers.
    pub count: usize,
    /// Layer and value of each segment; its label is its place here, from 1 on.
    pub segments: Vec<(usize, i64)>,
    /// The only segments that are wanted.
    pub only: Option<BTreeSet<i64>>,
}

impl Layers {
    /// Labels of the segments that have a voxel with these values, the last first.
    fn found(&self, values: &[i64]) -> impl Iterator<Item = i64> {
        // Nearly all voxels are in none.
        let count = if values.iter().all(|value| *value == 0) { 0 } else { self.segments.len() };
        let labels = self.segments[..count].iter().enumerate().rev().map(|(k, segment)| (k as i64 + 1, segment));
        let wanted = labels.filter(|(label, _)| self.only.as_ref().is_none_or(|only| only.contains(label)));
        wanted.filter(|(_, (layer, value))| values[*layer] == *value).map(|(label, _)| label)
    }
}

/// What the segments that overlap leave one another.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Overlaps {
    /// Voxels that are in several segments.
    pub voxels: u64,
    /// By label: voxels of each segment, and those of them that no later one has.
    pub segments: BTreeMap<i64, [u64; 2]>,
}

impl Overlaps {
    /// Counts a voxel in these segments, the last first.
    fn count(&mut self, mut labels: impl Iterator<Item = i64>) {
        let Some(last) = labels.next() else { return };
        let all = self.segments.entry(last).or_default();
        *all = all.map(|n| n + 1);
        let mut several = false;
        for label in labels {
            self.segments.entry(label).or_default()[0] += 1;
            several = true;
        }
        self.voxels += u64::from(several);
    }

    /// Whether later segments have voxels of this one.
    pub fn is_covered(&self, label: i64) -> bool {
        self.segments.get(&label).is_some_and(|[voxels, left]| left < voxels)
    }

    /// The voxels of a segment of which later ones leave nothing.
    pub fn hidden(&self, label: i64) -> Option<u64> {
        self.segments.get(&label).filter(|[_, left]| *left == 0).map(|[voxels, _]| *voxels)
    }
}

/// Decoder of voxels: bytes to values.
type Decode<T> = fn(Element, &Voxels<'_>, &mut Vec<T>) -> std::result::Result<(), Unreadable>;

/// The values of a voxel's layers as one.
type Fold<'f, T> = &'f dyn Fn(&[T]) -> T;

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
        let (stored, layers) = ([0, 1, 2], None);
        Volume {
            path: path.into(),
            format,
            grid,
            element,
            big_endian,
            stored,
            scale: None,
            notes,
            lacks: None,
            segments,
            layers,
            data,
        }
    }

    /// A volume of labels in memory, its axes from the fastest that is read to the slowest; `name` stands in messages where a file's would.
    ///
    /// # Errors
    /// [`Error::Format`] for a grid that cannot be.
    pub fn given(
        name: &str,
        grid: VolumeGrid,
        element: (Element, bool),
        stored: [usize; 3],
        voxels: Arc<dyn GivenVoxels>,
    ) -> Result<Self> {
        let data = Data::Given(voxels);
        let volume = Volume { stored, ..Volume::new(Path::new(name), "array", grid, element, data) };
        volume.check()?;
        Ok(volume)
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

    /// This volume with voxels of these sides, in its unit where it has one, else mm.
    ///
    /// # Errors
    /// [`Error::Setting`] where the file has its own.
    pub(crate) fn with_spacing(mut self, sides: &[f64]) -> Result<Self> {
        let fail = |message: String| Err(Error::Setting { name: "spacing".into(), message });
        let [dx, dy, dz] = grid::sides(sides)?;
        if self.grid.spaced && self.lacks.is_none() {
            let [x, y, z] = self.grid.spacing();
            let path = self.path.display();
            return fail(format!("is only for a file without its own; {path} has {x} x {y} x {z} {}", self.grid.unit));
        }
        let axes = self.grid.axes();
        self.grid.steps = [dx * axes[0], dy * axes[1], dz * axes[2]];
        // Of a file that has some sides they are in its unit.
        if self.lacks.take().is_none() {
            self.grid.unit = "mm".into();
        }
        Ok(self)
    }

    /// The files that hold the volume.
    pub fn files(&self) -> Vec<PathBuf> {
        if let Data::Masks(masks) = &self.data {
            return masks.iter().flat_map(Volume::files).collect();
        }
        match &self.data {
            Data::Given(_) => return Vec::new(),
            Data::Images { files, .. } => return files.clone(),
            _ => {}
        }
        // An array is a folder of files, most often one below the group that was named.
        if self.data.file().starts_with(&self.path) {
            return vec![self.path.clone()];
        }
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
        self.voxels() as u64 * self.voxel_bytes() as u64
    }

    /// Bytes of a voxel, of all its layers.
    pub(crate) fn voxel_bytes(&self) -> usize {
        self.element.size() * self.layers.as_ref().map_or(1, |layers| layers.count)
    }

    /// From now on only these labels are there, whatever lies over them.
    pub(crate) fn take_only(&mut self, labels: &[i64]) {
        if let Some(layers) = &mut self.layers {
            layers.only = Some(labels.iter().copied().collect());
        }
    }

    /// Which voxels of segments that overlap the last of them has.
    ///
    /// # Errors
    /// The errors of [`Volume::labels`].
    pub(crate) fn overlaps(&self) -> Result<Overlaps> {
        let overlaps = RefCell::new(Overlaps::default());
        if let Some(layers) = &self.layers {
            let fold = |values: &[i64]| {
                overlaps.borrow_mut().count(layers.found(values));
                0
            };
            self.decode(Element::labels, Some(&fold), &mut |_| ())?;
        }
        Ok(overlaps.into_inner())
    }

    /// Decodes the volume from its first voxel to its last and hands the labels to `each`, run by run.
    ///
    /// # Errors
    /// [`Error::Format`] for data that end early or cannot be decoded, and for values that are no whole numbers.
    pub fn labels(&self, mut each: impl FnMut(VoxelRun<'_>)) -> Result<()> {
        let fold = self.layers.as_ref().map(|layers| |values: &[i64]| layers.found(values).next().unwrap_or(0));
        self.decode(Element::labels, fold.as_ref().map(|fold| fold as Fold<'_, i64>), &mut each)
    }

    /// Layers of segments, of which those of different layers may overlap; 1 where none can.
    pub fn layers(&self) -> usize {
        self.layers.as_ref().map_or(1, |layers| layers.count)
    }

    /// The one of the [`Volume::layers`] in which a segment is, if there are several.
    pub fn layer_of(&self, label: i64) -> Option<usize> {
        let segments = &self.layers.as_ref()?.segments;
        segments.get(usize::try_from(label).ok()?.checked_sub(1)?).map(|(layer, _)| *layer)
    }

    /// As [`Volume::labels`], but only the segments of one of the [`Volume::layers`], counted from 0, whatever lies over them.
    ///
    /// # Errors
    /// The errors of [`Volume::labels`].
    pub fn labels_of_layer(&self, layer: usize, mut each: impl FnMut(VoxelRun<'_>)) -> Result<()> {
        let Some(layers) = &self.layers else { return self.labels(each) };
        let own = |label: &i64| layers.segments[*label as usize - 1].0 == layer;
        let fold = |values: &[i64]| layers.found(values).find(own).unwrap_or(0);
        self.decode(Element::labels, Some(&fold), &mut each)
    }

    /// Rows of grey values.
    ///
    /// # Errors
    /// [`Error::Format`] for data that end early or cannot be decoded, and for values that are no finite numbers.
    pub fn greys(&self, mut each: impl FnMut(VoxelRun<'_, f64>)) -> Result<()> {
        if self.layers.is_some() {
            let message = format!("is not for segments, which {} holds; it cuts grey values", self.path.display());
            return Err(Error::Setting { name: "level".into(), message });
        }
        self.decode(Element::greys, None, &mut each)
    }

    /// Words about a value of one of so many layers that cannot be read.
    pub(crate) fn told(&self, Unreadable { voxel, why }: &Unreadable, layers: usize) -> String {
        let mut rest = voxel / layers;
        let mut place = [0; 3];
        for axis in self.stored {
            place[axis] = rest % self.grid.dims[axis];
            rest /= self.grid.dims[axis];
        }
        let [x, y, z] = place;
        format!("voxel x = {x}, y = {y}, z = {z} {why}")
    }

    fn decode<T: Copy>(
        &self,
        decode: Decode<T>,
        fold: Option<Fold<'_, T>>,
        each: &mut impl FnMut(VoxelRun<'_, T>),
    ) -> Result<()> {
        self.runs(decode, fold, each).map_err(|message| Error::Format { path: self.path.clone(), message })
    }

    fn runs<T: Copy>(
        &self,
        decode: Decode<T>,
        fold: Option<Fold<'_, T>>,
        each: &mut impl FnMut(VoxelRun<'_, T>),
    ) -> Failure<()> {
        let layers = self.layers.as_ref().map_or(1, |layers| layers.count);
        let (count, size, most) = (self.voxels(), self.voxel_bytes(), (RUN / layers).max(1));
        let row = self.grid.dims[self.stored[0]];
        let rows = self.grid.dims[self.stored[1]];
        let mut input = self.data.open()?;
        let (mut bytes, mut values) = (vec![0; most.min(count) * size], Vec::with_capacity(most.min(count) * layers));
        let mut at = 0;
        while at < count {
            let n = most.min(count - at);
            let bytes = &mut bytes[..n * size];
            data::fill(&mut input, bytes, (at * size) as u64, self.bytes())?;
            values.clear();
            let voxels = Voxels { bytes, big_endian: self.big_endian, scale: self.scale, first: at * layers };
            decode(self.element, &voxels, &mut values).map_err(|e| self.told(&e, layers))?;
            if let Some(fold) = fold {
                for k in 0..n {
                    values[k] = fold(&values[k * layers..(k + 1) * layers]);
                }
            }
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
    let file = regular::open(path).map_err(|source| Error::Read { path: path.into(), source })?;
    Ok(std::io::BufReader::new(file))
}
