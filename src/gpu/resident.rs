//! Values of fields that stay on the device while runs last: made there, or sent once, and copied by the device to where a stage wants them.
//!
//! Fields are known by a hash of their values, so that it does not matter on which way they come back: what a stage answers is moved, cut and cloned
//! by the host before another one reads it. What is kept takes a share of the budget; beyond it, or where there has been no memory, fields are sent again.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use rayon::prelude::*;

use super::Gpu;
use super::atlas::{Atlas, padded};
use super::buffer::Buffer;
use super::layout::BLOCK;
use super::moving::{FARTHEST, bounded};
use super::recorder::Recorder;
use super::rescale::rescaled;
use crate::error::Result;
use crate::grid::field::Field;

/// Share of the budget that kept values may take.
const SHARE: f64 = 0.1;

/// Hash of the values of a field.
type Hash = [u8; 32];

/// What tells the values of a field on the device from all others: those that the host has, and the bits of what they are multiplied with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Print {
    values: Hash,
    scale: u64,
}

impl Print {
    /// The print of a field's own values; nothing where the stages bound some of them each in its own way.
    pub fn of(field: &Field) -> Option<Self> {
        let same = field.data.iter().all(|v| v.abs() <= FARTHEST);
        same.then(|| Print { values: hash(field), scale: 1.0_f64.to_bits() })
    }
}

fn hash(field: &Field) -> Hash {
    *blake3::hash(bytemuck::cast_slice(&field.data)).as_bytes()
}

/// The buffer that holds the values of a field, and the number of the first.
type Known = (Arc<Buffer<[f32]>>, usize);

/// A buffer with the values of some fields.
#[derive(Debug)]
struct Sheet {
    values: Arc<Buffer<[f32]>>,
    /// Number of each field's first value.
    places: HashMap<Print, usize>,
}

/// Values that stay.
#[derive(Debug, Default)]
pub struct Resident {
    /// The one that nobody has asked for for the longest time is the first.
    sheets: Mutex<Vec<Sheet>>,
    /// Hashes of fields that several stages read, by their addresses, which nobody else has as long as these are held.
    names: Mutex<HashMap<usize, (Weak<Field>, Hash)>>,
    /// Runs that last.
    runs: AtomicUsize,
    /// The device has once had no memory: nothing stays there any more.
    short: AtomicBool,
}

/// Values of a field as a kernel reads them.
pub fn scaled(field: &Field, scale: f64) -> impl Iterator<Item = f32> + '_ {
    field.data.iter().map(move |v| bounded(scale * v))
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Resident {
    /// One more run begins.
    pub fn begin(&self) {
        self.runs.fetch_add(1, Ordering::Relaxed);
    }

    /// A run has ended; nobody asks for its fields any more. With the last one everything goes: the next run finds the buffers that it needs.
    pub fn end(&self) {
        if self.runs.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.clear();
        }
    }

    fn clear(&self) {
        locked(&self.sheets).clear();
        locked(&self.names).clear();
    }

    /// Whether anything is kept.
    fn keeps(&self) -> bool {
        self.runs.load(Ordering::Relaxed) > 0 && !self.short.load(Ordering::Relaxed)
    }

    /// The hash of a field, which is made once as long as the field is.
    fn name(&self, field: &Arc<Field>) -> Hash {
        let address = Arc::as_ptr(field) as usize;
        if let Some((_, hash)) = locked(&self.names).get(&address).filter(|(known, _)| known.strong_count() > 0) {
            return *hash;
        }
        let hash = hash(field);
        let mut names = locked(&self.names);
        names.retain(|_, (known, _)| known.strong_count() > 0);
        names.insert(address, (Arc::downgrade(field), hash));
        hash
    }

    /// Where these values are.
    fn find(&self, print: &Print) -> Option<Known> {
        let mut sheets = locked(&self.sheets);
        let at = sheets.iter().rposition(|sheet| sheet.places.contains_key(print))?;
        let sheet = sheets.remove(at);
        let found = sheet.places.get(print).map(|first| (sheet.values.clone(), *first));
        sheets.push(sheet);
        found
    }
}

impl Gpu {
    /// Lets everything go on the device that no stage needs, values of fields and all that waits for a user: there was no memory. From now on nothing
    /// stays.
    ///
    /// # Errors
    /// The errors of [`Device::wait`](super::device::Device::wait).
    pub(super) fn release(&self) -> Result<()> {
        self.resident.short.store(true, Ordering::Relaxed);
        self.resident.clear();
        self.device.release()
    }

    /// Bytes that kept values may take.
    fn most(&self) -> u64 {
        (SHARE * self.device.budget() as f64) as u64
    }

    /// Keeps a buffer that nobody writes any more, with the places of the fields in it, as long as runs last and there is room.
    fn keep(&self, values: &Arc<Buffer<[f32]>>, places: impl IntoIterator<Item = (Print, usize)>) {
        let (most, bytes) = (self.most(), values.raw.bytes());
        if !self.resident.keeps() || bytes > most {
            return;
        }
        let places: HashMap<Print, usize> = places.into_iter().collect();
        if places.is_empty() {
            return;
        }
        let mut sheets = locked(&self.resident.sheets);
        let mut taken = bytes + sheets.iter().map(|sheet| sheet.values.raw.bytes()).sum::<u64>();
        while taken > most {
            taken -= sheets.remove(0).values.raw.bytes();
        }
        sheets.push(Sheet { values: values.clone(), places });
    }

    /// Keeps the answers of a stage, which lie in a buffer as the tiles of an atlas do.
    pub(super) fn keep_tiles(&self, values: Buffer<[f32]>, atlas: &Atlas, fields: &[Field]) {
        if self.resident.keeps() {
            let prints: Vec<Option<Print>> = fields.par_iter().map(Print::of).collect();
            let places = prints.into_iter().zip(&atlas.jobs).filter_map(|(p, job)| Some((p?, job.offset as usize)));
            self.keep(&Arc::new(values), places);
        }
    }

    /// Keeps the images that a stage has made, one after the other, which are what the host has of them times `scale`.
    pub(super) fn keep_images(&self, values: Buffer<[f32]>, scale: f64, fields: &[Field]) {
        if self.resident.keeps() {
            let print = |field: &Field| Print { values: hash(field), scale: scale.to_bits() };
            let prints: Vec<Print> = fields.par_iter().map(print).collect();
            let nodes = fields.first().map_or(0, |field| field.data.len());
            self.keep(&Arc::new(values), prints.into_iter().enumerate().map(|(k, print)| (print, k * nodes)));
        }
    }

    /// Records that the values of `field`, times `scale`, are copied to `target` from the value `first` on. A stage may have made them, times `made`.
    pub(super) fn place(
        &self,
        recorder: &mut Recorder<'_>,
        (field, scale, made): (&Arc<Field>, f64, f64),
        (target, first): (&Buffer<[f32]>, usize),
    ) -> Result<()> {
        let (values, from) = self.image(field, scale, made)?;
        let bytes = size_of_val(&field.data[..]) as u64 / 2;
        recorder.copy_part((&values, 4 * from as u64), (target, 4 * first as u64), bytes);
        Ok(())
    }

    /// The values of a field, which stay as long as runs last and there is room.
    fn image(&self, field: &Arc<Field>, scale: f64, made: f64) -> Result<Known> {
        let print = self.resident.keeps().then(|| Print { values: self.resident.name(field), scale: scale.to_bits() });
        let find = |scale: f64| self.resident.find(&Print { scale: scale.to_bits(), ..print? });
        if let Some(known) = find(scale) {
            return Ok(known);
        }
        if let Some((values, first)) = find(made)
            && let Some(values) = rescaled(self, field, [made, scale], (&values, first))?
        {
            let values = Arc::new(values);
            self.keep(&values, print.map(|print| (print, 0)));
            return Ok((values, 0));
        }
        // While others compute nobody may wait for the images.
        let make = |first: usize, out: &mut [f32]| {
            out.iter_mut().zip(&field.data[first..]).for_each(|(to, v)| *to = bounded(scale * v));
        };
        let values = Arc::new(self.device.upload_made("field", field.data.len(), make)?);
        self.keep(&values, print.map(|print| (print, 0)));
        Ok((values, 0))
    }

    /// Fields of all jobs of an atlas in single precision, 1 between them. Those that are not there are sent, and stay as long as runs last and there is
    /// room; all are copied from there.
    pub(super) fn send_tiles(&self, label: &str, atlas: &Atlas, fields: &[&Field]) -> Result<Buffer<[f32]>> {
        let device = &self.device;
        let plain = || atlas.send(device, label, fields.iter().copied(), 1.0);
        if !self.resident.keeps() {
            return plain();
        }
        // The ends of a group are those of both its morphs.
        let address = |field: &Field| std::ptr::from_ref(field) as usize;
        let distinct: HashMap<usize, &Field> = fields.iter().map(|field| (address(field), *field)).collect();
        let prints: HashMap<usize, Option<Print>> =
            distinct.into_par_iter().map(|(address, field)| (address, Print::of(field))).collect();
        let prints = fields.iter().map(|field| prints.get(&address(field)).copied().flatten());
        let Some(prints) = prints.collect::<Option<Vec<Print>>>() else { return plain() };
        let mut known: HashMap<Print, Known> = HashMap::new();
        let mut new: Vec<(Print, &Field)> = Vec::new();
        for (print, field) in prints.iter().zip(fields) {
            if known.contains_key(print) || new.iter().any(|(other, _)| other == print) {
                continue;
            }
            match self.resident.find(print) {
                Some(found) => drop(known.insert(*print, found)),
                None => new.push((*print, *field)),
            }
        }
        if !new.is_empty() {
            let sheet = Atlas::new(new.iter().map(|(_, field)| field.dims));
            if 4 * sheet.node_count() as u64 > self.most() {
                return plain();
            }
            let values = Arc::new(sheet.send(device, "tiles", new.iter().map(|(_, field)| *field), 1.0)?);
            let places = || new.iter().zip(&sheet.jobs).map(|((print, _), job)| (*print, job.offset as usize));
            known.extend(places().map(|(print, first)| (print, (values.clone(), first))));
            self.keep(&values, places());
        }
        let values = device.storage(label, atlas.node_count())?;
        let between = &device.upload("between", &[1.0; BLOCK])?;
        for ((print, field), job) in prints.iter().zip(fields).zip(&atlas.jobs) {
            let Some((from, first)) = known.get(print) else { return plain() };
            let (to, count) = (job.offset as usize, field.data.len());
            device.copy_before((from, *first), (&values, to), count);
            device.copy_before((between, 0), (&values, to + count), padded(count) - count);
        }
        Ok(values)
    }
}
