//! Arrays of Zarr (versions 2 and 3), decoded a layer of chunks at a time.

use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;

use zarrs::array::data_type::{
    BoolDataType, Float32DataType, Float64DataType, Int8DataType, Int16DataType, Int32DataType, Int64DataType,
    UInt8DataType, UInt16DataType, UInt32DataType, UInt64DataType,
};
use zarrs::array::{Array, ArrayBytes, ArraySubset};
use zarrs::filesystem::FilesystemStore;

use super::element::Element;
use super::grid::Failure;
use super::zarr_bounded;
use crate::storage::folders::files_below;
use crate::storage::{regular, room};

/// Most bytes of voxels for a byte of all chunks, where those that are not there are empty; and of a chunk for a byte of the largest.
const MOST_SPARSE: u64 = 1 << 17;
const MOST_IN_CHUNKS: u64 = 1 << 15;

/// What an array's metadata say.
#[derive(Debug)]
pub(crate) struct Shape {
    /// Voxels along its axes.
    pub sizes: Vec<usize>,
    /// Type of a voxel.
    pub element: Element,
}

impl Shape {
    /// Of the array in a folder.
    pub fn of(folder: &Path) -> Failure<Self> {
        let array = open(folder)?;
        let sizes = array.shape().iter().map(|n| usize::try_from(*n).map_err(|e| format!("shape: {n}: {e}")));
        Ok(Shape { sizes: sizes.collect::<Failure<_>>()?, element: element(&array)? })
    }
}

fn open(folder: &Path) -> Failure<Array<FilesystemStore>> {
    let unreadable = |e: String| format!("array {}: {e}", folder.display());
    if !folder.is_dir() {
        return Err(unreadable("is not there".into()));
    }
    zarr_bounded::register();
    let store = FilesystemStore::new(folder).map_err(|e| unreadable(e.to_string()))?;
    Array::open(Arc::new(store), "/").map_err(|e| unreadable(e.to_string()))
}

fn element(array: &Array<FilesystemStore>) -> Failure<Element> {
    let kind = array.data_type();
    let int = |size, signed| Ok(Element::Int { size, signed });
    if kind.is::<UInt8DataType>() || kind.is::<BoolDataType>() {
        int(1, false)
    } else if kind.is::<UInt16DataType>() {
        int(2, false)
    } else if kind.is::<UInt32DataType>() {
        int(4, false)
    } else if kind.is::<UInt64DataType>() {
        int(8, false)
    } else if kind.is::<Int8DataType>() {
        int(1, true)
    } else if kind.is::<Int16DataType>() {
        int(2, true)
    } else if kind.is::<Int32DataType>() {
        int(4, true)
    } else if kind.is::<Int64DataType>() {
        int(8, true)
    } else if kind.is::<Float32DataType>() {
        Ok(Element::Float)
    } else if kind.is::<Float64DataType>() {
        Ok(Element::Double)
    } else {
        Err(format!("has voxels of type {kind:?}; they must be bool, integers of 8 to 64 bits, or floats of 32 or 64"))
    }
}

/// Voxels along the axes of a chunk.
fn chunk(array: &Array<FilesystemStore>) -> Failure<Vec<u64>> {
    let first = vec![0; array.dimensionality()];
    let shape = array.chunk_shape(&first).map_err(|e| format!("its chunks: {e}"))?;
    Ok(shape.iter().map(|n| n.get()).collect())
}

/// Checks that the files of an array can hold `needed` bytes of voxels, and its chunks.
pub(crate) fn check(folder: &Path, voxel: usize, needed: u64) -> Failure<()> {
    let array = open(folder)?;
    let files = files_below(folder).map_err(|e| format!("array {}: {e}", folder.display()))?;
    // A link among them may lead to what is no file.
    files.iter().try_for_each(|file| regular::check(file)).map_err(|e| format!("array {}: {e}", folder.display()))?;
    let lengths = files.iter().filter_map(|file| {
        // Metadata are no chunks.
        let name = file.file_name()?.to_string_lossy();
        let own = name == "zarr.json" || name.starts_with(".z");
        if own { None } else { Some(file.metadata().ok()?.len()) }
    });
    let (all, largest) = lengths.fold((0u64, 0), |(all, most), n| (all.saturating_add(n), n.max(most)));
    if all == 0 {
        return Err(format!("array {} has no chunks", folder.display()));
    }
    if needed > all.saturating_mul(MOST_SPARSE) {
        return Err(format!("{needed} bytes of voxels are more than chunks of {all} bytes can be meant to hold"));
    }
    let bytes = chunk(&array)?.iter().try_fold(voxel as u64, |n, side| n.checked_mul(*side));
    match bytes.filter(|bytes| *bytes <= largest.saturating_mul(MOST_IN_CHUNKS)) {
        Some(_) => Ok(()),
        None => Err(format!("its chunks are said to be larger than the largest of {largest} bytes can hold")),
    }
}

/// The voxels of an array in their order, a layer of chunks in memory.
pub(crate) struct Slabs {
    array: Array<FilesystemStore>,
    sizes: Vec<usize>,
    /// The slowest axis with more than one place, how many are read at a time, and which are next.
    slow: usize,
    depth: usize,
    next: usize,
    /// The voxels of some places, and how much of them was given away.
    bytes: Vec<u8>,
    used: usize,
}

/// Voxels in memory while `depth` places of the axis `slow` are read, along which chunks are `side` long: what zarrs decodes, which are whole chunks,
/// also where they stand out beyond the array, and what is made of it.
fn voxels_at_once(sizes: &[usize], chunk: &[u64], slow: usize, [side, depth]: [usize; 2]) -> f64 {
    let layer: f64 = sizes.iter().skip(slow + 1).map(|n| *n as f64).product();
    let whole = |(n, side): (&usize, &u64)| (*n as u64).div_ceil(*side) as f64 * *side as f64;
    let chunks: f64 = side as f64 * sizes.iter().zip(chunk).skip(slow + 1).map(whole).product::<f64>();
    let before: f64 = chunk.iter().take(slow).map(|side| *side as f64).product();
    layer * depth as f64 + before * chunks
}

impl Slabs {
    pub fn open(folder: &Path, sizes: &[usize], voxel: usize) -> Failure<Self> {
        let array = open(folder)?;
        let slow = sizes.iter().position(|n| *n > 1).unwrap_or(0);
        let chunk = chunk(&array)?;
        let side = chunk.get(slow).map_or(1, |n| usize::try_from(*n).unwrap_or(usize::MAX));
        let depth = side.min(sizes.get(slow).copied().unwrap_or(1)).max(1);
        room::check_room(voxels_at_once(sizes, &chunk, slow, [side, depth]) * voxel as f64)
            .map_err(|m| format!("{depth} layers, which its chunks hold together, {m}"))?;
        Ok(Slabs { array, sizes: sizes.into(), slow, depth, next: 0, bytes: Vec::new(), used: 0 })
    }

    fn read_on(&mut self) -> Failure<()> {
        let until = (self.next + self.depth).min(self.sizes[self.slow]);
        let range =
            |(k, n): (usize, &usize)| if k == self.slow { self.next as u64..until as u64 } else { 0..*n as u64 };
        let ranges: Vec<std::ops::Range<u64>> = self.sizes.iter().enumerate().map(range).collect();
        let subset = ArraySubset::new_with_ranges(&ranges);
        let bytes: ArrayBytes<'static> =
            self.array.retrieve_array_subset(&subset).map_err(|e| match self.at_fault(&subset) {
                Some(message) => message,
                None => e.to_string(),
            })?;
        self.bytes = bytes.into_fixed().map_err(|e| e.to_string())?.into_owned();
        (self.next, self.used) = (until, 0);
        Ok(())
    }

    /// The first chunk of a subset that cannot be read, by the file it is in: zarrs does not name it.
    fn at_fault(&self, subset: &ArraySubset) -> Option<String> {
        let chunks = self.array.chunks_in_array_subset(subset).ok()??;
        chunks.indices().iter().find_map(|at| {
            let read = self.array.retrieve_chunk::<ArrayBytes<'static>>(&at);
            read.err().map(|e| format!("{}: {e}", self.array.chunk_key(&at)))
        })
    }
}

impl Read for Slabs {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.used == self.bytes.len() {
            if self.sizes.get(self.slow).is_none_or(|n| self.next >= *n) {
                return Ok(0);
            }
            let first = self.next;
            self.read_on().map_err(|m| io::Error::other(format!("layers from {first} on: {m}")))?;
        }
        let n = out.len().min(self.bytes.len() - self.used);
        out[..n].copy_from_slice(&self.bytes[self.used..self.used + n]);
        self.used += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_chunks_are_in_memory_beside_the_voxels_that_are_made_of_them() {
        // Two chunks of 64 cover 100 places, one covers 60.
        assert_eq!(voxels_at_once(&[10, 100, 60], &[4, 64, 64], 0, [4, 4]), (4 * 100 * 60 + 4 * 128 * 64) as f64);
        // Of an axis with one place before it a whole chunk is decoded, too; and no more than there is is made of a chunk.
        assert_eq!(voxels_at_once(&[1, 3, 100], &[5, 4, 64], 1, [4, 3]), (3 * 100 + 5 * 4 * 128) as f64);
    }
}
