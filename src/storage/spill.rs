//! Rows of things with large arrays, of which no more stay in memory than a budget allows: the arrays of the others lie in a temporary file.
//!
//! Values that are read back have the very bits that were put in, so that no result depends on the budget.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec2;

use crate::error::{Error, Result};

/// Bytes that all shelves of a run may keep in memory together.
#[derive(Debug)]
pub struct Budget {
    left: AtomicU64,
    /// Bytes that may be worked on beside one thing.
    spare: Option<u64>,
}

impl Default for Budget {
    fn default() -> Self {
        Budget::unlimited()
    }
}

impl Budget {
    /// A budget with which everything stays in memory.
    pub fn unlimited() -> Self {
        Budget { left: AtomicU64::new(u64::MAX), spare: None }
    }

    /// Shelves keep `kept` bytes; where one thing is worked on, others may take `spare` bytes.
    pub fn of(kept: u64, spare: u64) -> Self {
        Budget { left: AtomicU64::new(kept), spare: Some(spare) }
    }

    /// Number of things, of `count` with `bytes` each, that are worked on at once, at least one.
    pub fn at_once(&self, count: usize, bytes: usize) -> usize {
        let more = self.spare.map_or(usize::MAX, |spare| (spare / bytes.max(1) as u64) as usize);
        more.saturating_add(1).min(count).max(1)
    }

    /// Whether anything is bounded.
    pub fn is_bounded(&self) -> bool {
        self.spare.is_some()
    }

    /// Bytes that shelves may keep, where they are bounded.
    pub fn kept(&self) -> Option<u64> {
        self.spare.map(|_| self.left.load(Ordering::Relaxed))
    }

    /// Bytes that what is worked on beside one thing may take, at most `most`.
    pub fn spare(&self, most: usize) -> usize {
        self.spare.map_or(most, |spare| most.min(spare as usize))
    }

    fn take(&self, bytes: u64) -> bool {
        self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(bytes)).is_ok()
    }

    fn give_back(&self, bytes: u64) {
        self.left.fetch_add(bytes, Ordering::Relaxed);
    }
}

/// A large array of a thing.
pub type Array<'a> = &'a mut dyn SpillArray;

/// Values that can be laid down as bytes and come back with the very same bits.
pub trait SpillArray {
    /// Number of values.
    fn count(&self) -> usize;

    /// Bytes of one.
    fn size(&self) -> usize;

    /// Writes them.
    ///
    /// # Errors
    /// The errors of the file.
    fn write(&self, file: &mut dyn Write) -> io::Result<()>;

    /// Drops them.
    fn clear(&mut self);

    /// Reads `count` of them.
    ///
    /// # Errors
    /// The errors of the file.
    fn read(&mut self, count: usize, file: &mut dyn Read) -> io::Result<()>;
}

/// Declares plain values whose rows are laid down as they are.
macro_rules! stored_as_they_are {
    ($($value:ty),*) => {$(
        impl $crate::storage::spill::SpillArray for Vec<$value> {
            fn count(&self) -> usize {
                self.len()
            }

            fn size(&self) -> usize {
                size_of::<$value>()
            }

            fn write(&self, file: &mut dyn std::io::Write) -> std::io::Result<()> {
                file.write_all(bytemuck::cast_slice(self))
            }

            fn clear(&mut self) {
                *self = Vec::new();
            }

            fn read(&mut self, count: usize, file: &mut dyn std::io::Read) -> std::io::Result<()> {
                *self = vec![bytemuck::Zeroable::zeroed(); count];
                file.read_exact(bytemuck::cast_slice_mut(self))
            }
        }
    )*};
}

pub(crate) use stored_as_they_are;

stored_as_they_are!(f64, f32, u32, DVec2);

impl SpillArray for Vec<bool> {
    fn count(&self) -> usize {
        self.len()
    }

    fn size(&self) -> usize {
        1
    }

    fn write(&self, file: &mut dyn Write) -> io::Result<()> {
        file.write_all(bytemuck::cast_slice(self))
    }

    fn clear(&mut self) {
        *self = Vec::new();
    }

    fn read(&mut self, count: usize, file: &mut dyn Read) -> io::Result<()> {
        let mut bytes = vec![0u8; count];
        file.read_exact(&mut bytes)?;
        *self = bytes.into_iter().map(|byte| byte != 0).collect();
        Ok(())
    }
}

/// A thing with large arrays.
pub trait Large: Clone {
    /// The arrays, always in the same order.
    fn arrays(&mut self) -> Vec<Array<'_>>;
}

enum Item<T> {
    Kept {
        item: Arc<T>,
        bytes: u64,
    },
    /// The thing without its arrays, and the place of those in the file: first byte and lengths.
    Laid {
        rest: T,
        at: u64,
        lengths: Vec<usize>,
    },
}

/// A row of things.
pub struct SpillVec<'b, T> {
    budget: &'b Budget,
    items: Vec<Item<T>>,
    /// Made when the first thing does not fit.
    file: Option<Mutex<File>>,
    end: u64,
}

impl<'b, T: Large> SpillVec<'b, T> {
    /// An empty row.
    pub fn new(budget: &'b Budget) -> Self {
        SpillVec { budget, items: Vec::new(), file: None, end: 0 }
    }

    /// Number of things.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// Puts a thing at the end of the row.
    ///
    /// # Errors
    /// [`Error::Write`] where the temporary file cannot be written.
    pub fn push(&mut self, mut item: T) -> Result<()> {
        let bytes = item.arrays().iter().map(|a| (a.count() * a.size()) as u64).sum();
        if self.budget.take(bytes) {
            self.items.push(Item::Kept { item: Arc::new(item), bytes });
            return Ok(());
        }
        let failed = |source| Error::Write { path: std::env::temp_dir(), source };
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(Mutex::new(tempfile::tempfile().map_err(failed)?)),
        };
        let file = file.get_mut().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(self.end)).map_err(failed)?;
        let mut lengths = Vec::new();
        for array in item.arrays() {
            array.write(file).map_err(failed)?;
            lengths.push(array.count());
            array.clear();
        }
        self.items.push(Item::Laid { rest: item, at: self.end, lengths });
        self.end += bytes;
        Ok(())
    }

    /// Thing `i`.
    ///
    /// # Errors
    /// [`Error::Read`] where the temporary file cannot be read.
    pub fn get(&self, i: usize) -> Result<Arc<T>> {
        self.load(i, |_| true)
    }

    /// Thing `i` with at least these of its arrays, by their places in [`Large::arrays`]; others may be missing.
    ///
    /// # Errors
    /// The errors of [`SpillVec::get`].
    pub fn some(&self, i: usize, wanted: &[usize]) -> Result<Arc<T>> {
        self.load(i, |k| wanted.contains(&k))
    }

    fn load(&self, i: usize, wanted: impl Fn(usize) -> bool) -> Result<Arc<T>> {
        let (rest, at, lengths) = match &self.items[i] {
            Item::Kept { item, .. } => return Ok(item.clone()),
            Item::Laid { rest, at, lengths } => (rest, at, lengths),
        };
        let failed = |source| Error::Read { path: std::env::temp_dir(), source };
        let mut item = rest.clone();
        if let Some(file) = &self.file {
            let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
            let mut at = *at;
            for (k, (array, &length)) in item.arrays().into_iter().zip(lengths).enumerate() {
                if wanted(k) {
                    file.seek(SeekFrom::Start(at)).map_err(failed)?;
                    array.read(length, &mut *file).map_err(failed)?;
                }
                at += (length * array.size()) as u64;
            }
        }
        Ok(Arc::new(item))
    }

    /// Thing `i` whose large arrays may be missing.
    pub fn light(&self, i: usize) -> &T {
        match &self.items[i] {
            Item::Kept { item, .. } => item,
            Item::Laid { rest, .. } => rest,
        }
    }
}

impl<T> Drop for SpillVec<'_, T> {
    fn drop(&mut self) {
        for item in &self.items {
            if let Item::Kept { bytes, .. } = item {
                self.budget.give_back(*bytes);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;

    #[test]
    fn what_does_not_fit_is_laid_down_and_read_back_bit_by_bit() {
        let field = |k: usize| Field::from_fn([6, 10], |i, j| (k * 100 + j * 6 + i) as f64 / 7.0);
        let budget = Budget::of(100 * 8, 0);
        let mut shelf = SpillVec::new(&budget);
        (0..3).for_each(|k| shelf.push(field(k)).expect("there is room for a temporary file"));
        // Of 100 numbers that may stay 60 do.
        assert_eq!([0, 1, 2].map(|k| shelf.light(k).data.len()), [60, 0, 0]);
        assert_eq!(budget.kept(), Some(40 * 8));
        for k in [2, 0, 1, 2] {
            let back = shelf.get(k).expect("it is read");
            assert!(
                back.data.iter().zip(&field(k).data).all(|(a, b)| a.to_bits() == b.to_bits()) && back.dims == [6, 10]
            );
        }
        drop(shelf);
        assert_eq!((budget.kept(), budget.at_once(5, 1)), (Some(100 * 8), 1));
    }
}
