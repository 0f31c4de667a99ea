//! A bound on the memory of jobs in flight.

use std::sync::{Condvar, Mutex, PoisonError};

use crate::error::{Error, Result};

/// Lets jobs through as long as together they need no more than a budget.
#[derive(Debug)]
pub struct Gate {
    budget: u64,
    taken: Mutex<u64>,
    given_back: Condvar,
}

/// A job's part of the budget, given back when dropped.
#[derive(Debug)]
pub struct Permit<'g> {
    gate: &'g Gate,
    bytes: u64,
}

impl Gate {
    /// A gate for `budget` bytes.
    pub fn new(budget: u64) -> Self {
        Gate { budget, taken: Mutex::new(0), given_back: Condvar::new() }
    }

    /// Waits until `bytes` are free.
    ///
    /// # Errors
    /// [`Error::Memory`] for a job that needs more than there is.
    pub fn pass(&self, bytes: u64) -> Result<Permit<'_>> {
        if bytes > self.budget {
            return Err(Error::Memory { needed_mib: bytes.div_ceil(1 << 20), available_mib: self.budget >> 20 });
        }
        let taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let full = |taken: &mut u64| *taken + bytes > self.budget;
        *self.given_back.wait_while(taken, full).unwrap_or_else(PoisonError::into_inner) += bytes;
        Ok(Permit { gate: self, bytes })
    }
}

impl Drop for Permit<'_> {
    fn drop(&mut self) {
        *self.gate.taken.lock().unwrap_or_else(PoisonError::into_inner) -= self.bytes;
        self.gate.given_back.notify_all();
    }
}
