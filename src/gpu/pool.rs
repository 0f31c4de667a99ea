//! Buffers that outlive their user: what is given back waits for the next who needs a buffer of its size.
//!
//! A buffer goes back when nobody holds it any more: neither its user nor a kernel bound to it nor work that is not yet sent off. Whatever is
//! asked of it afterwards comes later in the queue than all that was asked of it before.

use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Buffers up to this size are made in powers of two, larger ones in steps of it.
const STEP: u64 = 4096;
/// Smallest buffer, bytes.
const LEAST: u64 = 256;
/// Share of the budget that buffers without user may take.
const KEPT: f64 = 0.25;

/// Bytes of a buffer made for so many.
pub fn capacity(bytes: u64) -> u64 {
    if bytes <= STEP { bytes.next_power_of_two().max(LEAST) } else { bytes.next_multiple_of(STEP) }
}

/// Buffers of a device.
#[derive(Debug)]
pub struct Pool {
    budget: u64,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Bytes of all buffers.
    used: u64,
    /// Bytes of those that wait.
    waiting: u64,
    /// Buffers that wait, by their use and size.
    free: BTreeMap<(u32, u64), Vec<wgpu::Buffer>>,
}

impl State {
    /// Lets the largest waiting buffer go; whether there was one.
    fn drop_one(&mut self) -> bool {
        let largest = self.free.keys().max_by_key(|(_, size)| *size).copied();
        let Some(key) = largest else { return false };
        if let Some(buffers) = self.free.get_mut(&key) {
            buffers.pop();
            if buffers.is_empty() {
                self.free.remove(&key);
            }
        }
        self.used -= key.1;
        self.waiting -= key.1;
        true
    }
}

impl Pool {
    /// An empty pool that keeps within `budget` bytes.
    pub fn new(budget: u64) -> Arc<Self> {
        Arc::new(Pool { budget, state: Mutex::default() })
    }

    /// Lets all waiting buffers go.
    pub fn clear(&self) {
        let mut state = self.state();
        while state.drop_one() {}
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A waiting buffer for this use. It has the very size that a new one would have: a second run like the first finds what it needs.
    pub fn take(self: &Arc<Self>, capacity: u64, usage: wgpu::BufferUsages) -> Option<Held> {
        let mut state = self.state();
        let key = (usage.bits(), capacity);
        let waiting = state.free.get_mut(&key)?;
        let buffer = waiting.pop()?;
        if waiting.is_empty() {
            state.free.remove(&key);
        }
        state.waiting -= key.1;
        Some(self.held(buffer))
    }

    /// Room for a buffer of so many bytes; buffers that wait make place for it. Nothing where even that is not enough.
    pub fn reserve(&self, bytes: u64) -> bool {
        let mut state = self.state();
        while state.used + bytes > self.budget {
            if !state.drop_one() {
                return false;
            }
        }
        state.used += bytes;
        true
    }

    /// Counts a buffer that is needed in any case.
    pub fn count(&self, bytes: u64) {
        self.state().used += bytes;
    }

    /// Bytes that no buffer takes after all.
    pub fn give_back(&self, bytes: u64) {
        self.state().used -= bytes;
    }

    /// A buffer whose bytes are counted.
    pub fn held(self: &Arc<Self>, buffer: wgpu::Buffer) -> Held {
        Held { buffer, pool: self.clone() }
    }
}

/// A buffer that goes back to its pool.
#[derive(Debug)]
pub struct Held {
    buffer: wgpu::Buffer,
    pool: Arc<Pool>,
}

impl Drop for Held {
    fn drop(&mut self) {
        let size = self.buffer.size();
        let mut state = self.pool.state();
        state.waiting += size;
        state.free.entry((self.buffer.usage().bits(), size)).or_default().push(self.buffer.clone());
        let most = (self.pool.budget as f64 * KEPT) as u64;
        while state.waiting > most && state.drop_one() {}
    }
}

/// The first bytes of a buffer that several may hold.
#[derive(Debug, Clone)]
pub struct Raw {
    held: Arc<Held>,
    bytes: u64,
}

impl Raw {
    /// The first `bytes` of a buffer.
    pub fn new(held: Held, bytes: u64) -> Self {
        Raw { held: Arc::new(held), bytes }
    }

    /// Number of its bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// What a kernel sees of the buffer: as much as was asked for, so that its lists are as long as that.
    pub fn binding(&self) -> wgpu::BindingResource<'_> {
        let size = wgpu::BufferSize::new(self.bytes);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.held.buffer, offset: 0, size })
    }
}

impl Deref for Raw {
    type Target = wgpu::Buffer;

    fn deref(&self) -> &wgpu::Buffer {
        &self.held.buffer
    }
}
