//! Ring of buffers through which the host sends values: written by the host, copied by the device, and written again when that is done.

use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Pod;
use rayon::prelude::*;

use super::device::Device;
use super::kernels::Bound;
use super::pool::{Pool, Raw};

/// Bytes of the smallest chunk, and of the largest that is sent at once.
const LEAST: u64 = 64 << 10;
const LARGEST: u64 = 16 << 20;
/// Share of the budget that chunks may take, and bytes.
const SHARE: f64 = 0.125;
const MOST: u64 = 128 << 20;
/// Places of values in a chunk are multiples of this.
const ALIGNMENT: u64 = 16;
/// From so many bytes on a thread alone is slower than all of them.
pub const WORTH_ALL_THREADS: usize = 1 << 20;
/// Bytes that a thread makes before it writes them, which its cache holds.
const PIECE: usize = 128 << 10;

/// Bytes of a budget that the chunks may take.
pub fn share(budget: u64) -> u64 {
    ((budget as f64 * SHARE) as u64).min(MOST)
}

/// Buffer that the host writes.
#[derive(Debug)]
pub struct Chunk {
    buffer: wgpu::Buffer,
    filled: u64,
    /// It is one too many, used once.
    extra: bool,
}

/// What is to be done before the next work, and the chunks it is sent through.
#[derive(Debug, Default)]
pub struct Uploads {
    encoder: Option<wgpu::CommandEncoder>,
    /// Buffers that it writes or reads.
    targets: Vec<Raw>,
    /// Chunks with values that are not sent off.
    filling: Vec<Chunk>,
    /// Chunks that can be written, put here by the device when it has read them.
    ready: Arc<Mutex<Vec<wgpu::Buffer>>>,
    /// Bytes of all chunks.
    bytes: u64,
}

impl Uploads {
    fn encoder(&mut self, device: &Device) -> &mut wgpu::CommandEncoder {
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("uploads") };
        self.encoder.get_or_insert_with(|| device.device.create_command_encoder(&descriptor))
    }

    /// Sends values with the next work. A device that has failed is sent nothing: whoever waits for it is told.
    pub fn send(&mut self, device: &Device, target: &Raw, first: u64, bytes: &[u8]) {
        for (k, piece) in bytes.chunks(LARGEST as usize).enumerate() {
            let Some((buffer, at)) = self.write(device, piece) else { return };
            let place = first + k as u64 * LARGEST;
            self.encoder(device).copy_buffer_to_buffer(&buffer, at, target, place, piece.len() as u64);
        }
        self.targets.push(target.clone());
    }

    /// Chunks for so many bytes, which nobody else fills; fewer where the device has failed.
    pub fn chunks(&mut self, device: &Device, bytes: u64) -> Vec<Chunk> {
        let sizes = (0..bytes).step_by(LARGEST as usize).map(|first| LARGEST.min(bytes - first));
        sizes.map_while(|size| self.chunk(device, size.next_multiple_of(ALIGNMENT))).collect()
    }

    /// Sends what chunks of [`Uploads::chunks`] hold, `bytes` in all, with the next work.
    pub fn send_filled(&mut self, device: &Device, target: &Raw, first: u64, chunks: Vec<Chunk>, bytes: u64) {
        let mut sent = 0;
        for chunk in chunks {
            let size = LARGEST.min(bytes - sent);
            self.encoder(device).copy_buffer_to_buffer(&chunk.buffer, 0, target, first + sent, size);
            self.filling.push(Chunk { filled: chunk.buffer.size(), ..chunk });
            sent += size;
        }
        self.targets.push(target.clone());
    }

    /// Copies bytes from a place of one buffer to one of another before the next work, behind what was sent before.
    pub fn copy(&mut self, device: &Device, (from, first): (&Raw, u64), (target, place): (&Raw, u64), bytes: u64) {
        self.encoder(device).copy_buffer_to_buffer(from, first, target, place, bytes);
        self.targets.extend([from.clone(), target.clone()]);
    }

    /// Runs a kernel before the next work, behind what was sent before.
    pub fn run(&mut self, device: &Device, bound: &Bound<'_>, [x, y, z]: [u32; 3]) {
        let descriptor = wgpu::ComputePassDescriptor { label: Some("uploads"), timestamp_writes: None };
        let mut pass = self.encoder(device).begin_compute_pass(&descriptor);
        bound.set(&mut pass);
        pass.dispatch_workgroups(x, y, z);
        drop(pass);
        self.targets.extend(bound.buffers().iter().cloned());
    }

    /// Zeros a buffer before the next work.
    pub fn clear(&mut self, device: &Device, target: &Raw) {
        self.encoder(device).clear_buffer(target, 0, Some(target.bytes()));
        self.targets.push(target.clone());
    }

    /// The chunk and the place in it to which these bytes are written.
    fn write(&mut self, device: &Device, bytes: &[u8]) -> Option<(wgpu::Buffer, u64)> {
        let wanted = (bytes.len() as u64).next_multiple_of(ALIGNMENT);
        let known = self.filling.iter().position(|chunk| chunk.filled + wanted <= chunk.buffer.size());
        let chunk = match known {
            Some(known) => &mut self.filling[known],
            None => {
                let chunk = self.chunk(device, wanted)?;
                self.filling.push(chunk);
                self.filling.last_mut()?
            }
        };
        let at = chunk.filled;
        match chunk.buffer.get_mapped_range_mut(at..at + bytes.len() as u64) {
            Ok(mut view) => view.copy_from_slice(bytes),
            Err(e) => {
                device.fail(refused(e));
                return None;
            }
        }
        chunk.filled += wanted;
        Some((chunk.buffer.clone(), at))
    }

    /// A chunk that can be written.
    fn chunk(&mut self, device: &Device, bytes: u64) -> Option<Chunk> {
        let size = bytes.next_power_of_two().max(LEAST);
        {
            let mut ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner);
            // The smallest that is large enough.
            let fits = (0..ready.len()).filter(|&at| ready[at].size() >= size).min_by_key(|&at| ready[at].size());
            if let Some(at) = fits {
                return Some(Chunk { buffer: ready.swap_remove(at), filled: 0, extra: false });
            }
        }
        let extra = self.bytes + size > share(device.budget());
        let buffer = device.mapped("chunk", if extra { bytes } else { size })?;
        if extra {
            device.pool().count(buffer.size());
        } else {
            self.bytes += size;
        }
        Some(Chunk { buffer, filled: 0, extra })
    }

    /// Lets the chunks go that are not in use.
    pub fn release(&mut self) {
        let ready = std::mem::take(&mut *self.ready.lock().unwrap_or_else(PoisonError::into_inner));
        self.bytes -= ready.iter().map(wgpu::Buffer::size).sum::<u64>();
    }

    /// The work that goes before the next, and what holds its buffers.
    pub fn take(&mut self) -> (Option<wgpu::CommandBuffer>, Vec<Raw>) {
        self.filling.iter().for_each(|chunk| chunk.buffer.unmap());
        (self.encoder.take().map(wgpu::CommandEncoder::finish), std::mem::take(&mut self.targets))
    }

    /// Brings the chunks back when the device has read them; those that are too many go then.
    pub fn recall(&mut self, pool: &Pool) {
        for Chunk { buffer, extra, .. } in self.filling.drain(..) {
            if extra {
                pool.give_back(buffer.size());
                continue;
            }
            let (ready, again) = (self.ready.clone(), buffer.clone());
            buffer.map_async(wgpu::MapMode::Write, .., move |mapped| {
                if mapped.is_ok() {
                    ready.lock().unwrap_or_else(PoisonError::into_inner).push(again);
                }
            });
        }
    }
}

/// That values could not be written, and why.
fn refused(why: impl std::fmt::Display) -> String {
    format!("values could not be sent: {why}")
}

/// Fills chunks with `count` values, which `make` makes from a number of the first on: all threads at once, each where the device reads them.
///
/// # Errors
/// Why a chunk cannot be written.
pub fn fill<T: Pod>(
    chunks: &[Chunk],
    count: usize,
    make: &(impl Fn(usize, &mut [T]) + Sync),
) -> std::result::Result<(), String> {
    const { assert!(PIECE.is_multiple_of(size_of::<T>()), "whole values in every piece") };
    let [in_chunk, in_piece] = [LARGEST as usize, PIECE].map(|bytes| bytes / size_of::<T>());
    chunks.par_iter().enumerate().try_for_each(|(k, chunk)| {
        let first = k * in_chunk;
        let own = in_chunk.min(count - first);
        let range = 0..(own * size_of::<T>()) as u64;
        let mut view = chunk.buffer.get_mapped_range_mut(range).map_err(refused)?;
        let (pieces, mut rest) = view.slice(..).into_chunks::<PIECE>();
        let pieces: Vec<wgpu::WriteOnly<'_, [u8; PIECE]>> = pieces.into_iter().collect();
        let whole = pieces.len() * in_piece;
        let room = || vec![T::zeroed(); in_piece];
        pieces.into_par_iter().enumerate().for_each_init(room, |made, (k, piece)| {
            make(first + k * in_piece, made);
            wgpu::WriteOnly::<[u8]>::from(piece).copy_from_slice(bytemuck::cast_slice(made));
        });
        let mut made = vec![T::zeroed(); own - whole];
        make(first + whole, &mut made);
        rest.copy_from_slice(bytemuck::cast_slice(&made));
        Ok(())
    })
}
