//! Rows of things with large arrays, of which no more stay in memory than a budget allows: the arrays of the others lie in a temporary file.
//!
//! What is read back has the very bits that were put in, so that no result depends on the budget.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Pod;

use crate::error::{Error, Result};

/// Bytes that all shelves of a run may keep in memory together.
#[derive(Debug)]
pub struct Budget {
    left: AtomicU64,
    working: Option<u64>,
}

impl Default for Budget {
    fn default() -> Self {
        Budget::unlimited()
    }
}

impl Budget {
    /// Everything stays in memory.
    pub fn unlimited() -> Self {
        Budget { left: AtomicU64::new(u64::MAX), working: None }
    }

    /// Shelves keep `kept` bytes, and what is worked on at once should stay within `working`.
    pub fn of(kept: u64, working: u64) -> Self {
        Budget { left: AtomicU64::new(kept), working: Some(working) }
    }

    /// How many of `count` things of `bytes` each are worked on at once, at least one.
    pub fn at_once(&self, count: usize, bytes: usize) -> usize {
        let fit = self.working.map_or(usize::MAX, |working| (working / bytes.max(1) as u64) as usize);
        fit.min(count).max(1)
    }

    /// Bytes that shelves may keep, where they are bounded.
    pub fn kept(&self) -> Option<u64> {
        self.working.map(|_| self.left.load(Ordering::Relaxed))
    }

    /// Bytes of what is worked on at once, at most `most`.
    pub fn working(&self, most: usize) -> usize {
        self.working.map_or(most, |working| most.min(working as usize))
    }

    fn take(&self, bytes: u64) -> bool {
        self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(bytes)).is_ok()
    }

    fn give_back(&self, bytes: u64) {
        self.left.fetch_add(bytes, Ordering::Relaxed);
    }
}

/// A large array of a thing.
pub enum Array<'a> {
    /// Numbers of fields.
    F64(&'a mut Vec<f64>),
    /// Labels.
    U32(&'a mut Vec<u32>),
    /// Vectors of displacements.
    Pairs(&'a mut Vec<[f64; 2]>),
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
    /// What is left without its arrays, and where in the file those are: first byte and lengths.
    Laid {
        rest: T,
        at: u64,
        lengths: Vec<usize>,
    },
}

/// A row of things.
pub struct Shelf<'b, T> {
    budget: &'b Budget,
    items: Vec<Item<T>>,
    /// Made when the first thing does not fit.
    file: Option<Mutex<File>>,
    end: u64,
}

impl<'b, T: Large> Shelf<'b, T> {
    /// An empty row.
    pub fn new(budget: &'b Budget) -> Self {
        Shelf { budget, items: Vec::new(), file: None, end: 0 }
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
        let bytes = item.arrays().iter_mut().map(|a| a.bytes().len() as u64).sum();
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
        for mut array in item.arrays() {
            file.write_all(array.bytes()).map_err(failed)?;
            lengths.push(array.clear());
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
        let (rest, at, lengths) = match &self.items[i] {
            Item::Kept { item, .. } => return Ok(item.clone()),
            Item::Laid { rest, at, lengths } => (rest, at, lengths),
        };
        let failed = |source| Error::Read { path: std::env::temp_dir(), source };
        let mut item = rest.clone();
        if let Some(file) = &self.file {
            let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
            file.seek(SeekFrom::Start(*at)).map_err(failed)?;
            for (mut array, &length) in item.arrays().into_iter().zip(lengths) {
                file.read_exact(array.grow(length)).map_err(failed)?;
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

impl<T> Drop for Shelf<'_, T> {
    fn drop(&mut self) {
        for item in &self.items {
            if let Item::Kept { bytes, .. } = item {
                self.budget.give_back(*bytes);
            }
        }
    }
}

impl Array<'_> {
    fn bytes(&mut self) -> &[u8] {
        match self {
            Array::F64(values) => bytemuck::cast_slice(values),
            Array::U32(values) => bytemuck::cast_slice(values),
            Array::Pairs(values) => bytemuck::cast_slice(values),
        }
    }

    /// Drops the values; how many they were.
    fn clear(&mut self) -> usize {
        match self {
            Array::F64(values) => std::mem::take(*values).len(),
            Array::U32(values) => std::mem::take(*values).len(),
            Array::Pairs(values) => std::mem::take(*values).len(),
        }
    }

    /// Room for as many values, as bytes.
    fn grow(&mut self, length: usize) -> &mut [u8] {
        fn zeros<N: Pod>(values: &mut Vec<N>, length: usize) -> &mut [u8] {
            *values = vec![N::zeroed(); length];
            bytemuck::cast_slice_mut(values)
        }
        match self {
            Array::F64(values) => zeros(values, length),
            Array::U32(values) => zeros(values, length),
            Array::Pairs(values) => zeros(values, length),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::Field;

    #[test]
    fn what_does_not_fit_is_laid_down_and_read_back_bit_by_bit() {
        let field = |k: usize| Field::from_fn([6, 10], |i, j| (k * 100 + j * 6 + i) as f64 / 7.0);
        let budget = Budget::of(100 * 8, 0);
        let mut shelf = Shelf::new(&budget);
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
