//! Answers that are kept: after a change of one slice a backend is asked only for what depends on it.
//!
//! Level sets of slices and the rounds of the displacements are known by a hash of all that they are made of, so that an answer is, bit by bit,
//! the one that the backend would give.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::interval_morph::Morphed;
use super::jobs::{Filled, Traced};
use super::requests::{
    ContourRequest, LayerRequest, MorphRequest, PartRequest, SlopeRequest, SweepRequest, TraceRequest,
};
use super::{Backend, PaddedSlice};
use crate::error::{Error, Result};
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::progress::Progress;
use crate::registration::displacement::{Displacement, DisplacementJob};
use crate::report::DeviceUse;

/// Intervals whose displacements are asked for together: between two calls a run can end.
const AT_ONCE: usize = 32;

type Key = [u8; 32];

/// Some answers, each with when it was used last.
#[derive(Debug)]
struct Known<T> {
    answers: HashMap<Key, (u64, T)>,
    uses: u64,
}

impl<T> Default for Known<T> {
    fn default() -> Self {
        Known { answers: HashMap::new(), uses: 0 }
    }
}

impl<T: Clone> Known<T> {
    fn get(&mut self, key: &Key) -> Option<T> {
        self.uses += 1;
        let (used, answer) = self.answers.get_mut(key)?;
        *used = self.uses;
        Some(answer.clone())
    }

    fn put(&mut self, key: Key, answer: T) {
        self.uses += 1;
        self.answers.insert(key, (self.uses, answer));
    }

    /// Forgets those that were used longest ago.
    fn keep(&mut self, most: usize) {
        if self.answers.len() > most {
            let mut used: Vec<u64> = self.answers.values().map(|(used, _)| *used).collect();
            used.sort_unstable();
            let oldest = used[used.len() - most];
            self.answers.retain(|_, (used, _)| *used >= oldest);
        }
    }
}

/// Answers of a backend about one stack as it is changed.
#[derive(Debug, Default)]
pub struct Answers {
    fields: Mutex<Known<SparseImage<f64>>>,
    displacements: Mutex<Known<Displacement>>,
}

impl Answers {
    /// Keeps no more than a stack of `slices` and as many again that were changed need.
    pub fn tidy(&self, slices: usize, rounds: usize) {
        locked(&self.fields).keep(2 * slices);
        locked(&self.displacements).keep(2 * slices * rounds);
    }
}

/// A backend that answers from memory where it can.
pub struct Remembering<'b> {
    /// The backend that is asked for the rest.
    pub backend: &'b dyn Backend,
    /// What is known; nothing is kept without.
    pub answers: Option<&'b Answers>,
    /// Listener that may end the run between two questions.
    pub progress: &'b dyn Progress,
}

impl Remembering<'_> {
    fn check(&self) -> Result<()> {
        if self.progress.stops() { Err(Error::Interrupted) } else { Ok(()) }
    }
}

impl Backend for Remembering<'_> {
    fn name(&self) -> String {
        self.backend.name()
    }

    fn host_bytes(&self) -> u64 {
        self.backend.host_bytes()
    }

    fn device_use(&self) -> Option<DeviceUse> {
        self.backend.device_use()
    }

    fn run_begins(&self) {
        self.backend.run_begins();
    }

    fn run_ends(&self) {
        self.backend.run_ends();
    }

    fn contour_fields(&self, request: &ContourRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>> {
        self.check()?;
        let Some(answers) = self.answers else { return self.backend.contour_fields(request, progress) };
        let keys: Vec<Key> = request.slices.par_iter().map(|slice| of_slice(slice, request)).collect();
        let mut found: Vec<Option<SparseImage<f64>>> = {
            let mut known = locked(&answers.fields);
            keys.iter().map(|key| known.get(key)).collect()
        };
        let new: Vec<usize> = (0..keys.len()).filter(|&k| found[k].is_none()).collect();
        progress.advance(keys.len() - new.len());
        let slices: Vec<PaddedSlice> = new.iter().map(|&k| request.slices[k].clone()).collect();
        let made = self.backend.contour_fields(&ContourRequest { slices: &slices, ..*request }, progress)?;
        let mut fields: Vec<Field> = found
            .par_iter_mut()
            .map(|found| found.take().map_or_else(Field::default, |packed| unpacked(&packed)))
            .collect();
        let packed: Vec<SparseImage<f64>> =
            made.par_iter().map(|field| SparseImage::of(field.dims, &field.data)).collect();
        let mut known = locked(&answers.fields);
        for ((k, field), packed) in new.into_iter().zip(made).zip(packed) {
            known.put(keys[k], packed);
            fields[k] = field;
        }
        Ok(fields)
    }

    fn displacements(&self, job: &DisplacementJob<'_>) -> Result<Vec<Displacement>> {
        self.check()?;
        // A GPU is asked once for all rounds.
        if self.backend.device_use().is_some() {
            return self.backend.displacements(job);
        }
        let fields: Vec<Key> = match self.answers {
            Some(_) => job.fields.par_iter().map(|field| of_field(field)).collect(),
            None => Vec::new(),
        };
        let guess: Vec<Key> = job.guess.iter().map(of_displacement).collect();
        let mut current = job.begin.to_vec();
        for round in job.rounds.clone() {
            let beside = |i: usize| i.saturating_sub(1)..(i + 2).min(job.gaps.len());
            let now: Vec<Key> = current.iter().map(of_displacement).collect();
            let key = |i: usize| {
                let around = beside(i);
                let mut hash = blake3::Hasher::new();
                hash.update(&round.to_le_bytes()).update(&(i - around.start).to_le_bytes());
                hash.update(bytemuck::cast_slice(&job.h)).update(bytemuck::cast_slice(&job.gaps[around.clone()]));
                for key in &fields[around.start..=around.end] {
                    hash.update(key);
                }
                for k in around {
                    hash.update(&guess[k]).update(&now[k]);
                }
                *hash.finalize().as_bytes()
            };
            let keys: Vec<Option<Key>> = (0..job.gaps.len()).map(|i| self.answers.map(|_| key(i))).collect();
            let mut next: Vec<Option<Displacement>> = match self.answers {
                Some(answers) => {
                    let mut known = locked(&answers.displacements);
                    keys.iter().map(|key| known.get(key.as_ref()?)).collect()
                }
                None => vec![None; keys.len()],
            };
            for wanted in stretches(&next) {
                self.check()?;
                let around = beside(wanted.start).start..beside(wanted.end - 1).end;
                let some = self.backend.displacements(&DisplacementJob {
                    fields: &job.fields[around.start..=around.end],
                    gaps: &job.gaps[around.clone()],
                    guess: &job.guess[around.clone()],
                    begin: &current[around.clone()],
                    rounds: round..round + 1,
                    h: job.h,
                })?;
                let skipped = wanted.start - around.start;
                for (i, found) in wanted.zip(some.into_iter().skip(skipped)) {
                    if let (Some(answers), Some(key)) = (self.answers, keys[i]) {
                        locked(&answers.displacements).put(key, found.clone());
                    }
                    next[i] = Some(found);
                }
            }
            current = next.into_iter().flatten().collect();
        }
        Ok(current)
    }

    fn part_fields(&self, request: &PartRequest<'_>) -> Result<Vec<Field>> {
        self.check()?;
        self.backend.part_fields(request)
    }

    fn trace(&self, request: &TraceRequest<'_>, progress: &dyn Progress) -> Result<Vec<Traced>> {
        self.check()?;
        self.backend.trace(request, progress)
    }

    fn propagate(&self, request: &SweepRequest<'_>, progress: &dyn Progress) -> Result<Vec<Filled>> {
        self.check()?;
        self.backend.propagate(request, progress)
    }

    fn morph_layers(&self, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
        self.check()?;
        self.backend.morph_layers(request, progress)
    }

    fn moving_slopes(&self, request: &SlopeRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>> {
        self.check()?;
        self.backend.moving_slopes(request, progress)
    }

    fn moving_layers(&self, requests: &[LayerRequest<'_>]) -> Result<Vec<Vec<SparseImage<f32>>>> {
        self.check()?;
        self.backend.moving_layers(requests)
    }
}

/// Stretches of what is missing, none longer than [`AT_ONCE`].
fn stretches<T>(found: &[Option<T>]) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = Vec::new();
    for i in (0..found.len()).filter(|&i| found[i].is_none()) {
        match out.last_mut() {
            Some(last) if last.end == i && last.len() < AT_ONCE => last.end = i + 1,
            _ => out.push(i..i + 1),
        }
    }
    out
}

fn unpacked(packed: &SparseImage<f64>) -> Field {
    Field { dims: packed.dims(), data: packed.unpack() }
}

fn of_slice(slice: &PaddedSlice, request: &ContourRequest<'_>) -> Key {
    let mut hash = blake3::Hasher::new();
    hash.update(format!("{:?} {:?} {:?}", request.dims, request.h.map(f64::to_bits), request.options).as_bytes());
    match slice {
        PaddedSlice::Mask(mask) => hash.update(b"mask").update(bytemuck::cast_slice(mask)),
        PaddedSlice::Level(field) => hash.update(b"level").update(bytemuck::cast_slice(&field.data)),
    };
    *hash.finalize().as_bytes()
}

fn of_displacement(v: &Displacement) -> Key {
    let mut hash = blake3::Hasher::new();
    hash.update(bytemuck::cast_slice(&v.vectors));
    *hash.finalize().as_bytes()
}

fn of_field(field: &Field) -> Key {
    let mut hash = blake3::Hasher::new();
    hash.update(bytemuck::cast_slice(&field.data));
    *hash.finalize().as_bytes()
}

fn locked<T>(known: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    known.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_used_longest_ago_is_forgotten_first() {
        let key = |k: u8| [k; 32];
        let mut known = Known::default();
        (0..4).for_each(|k| known.put(key(k), k));
        assert_eq!(known.get(&key(0)), Some(0));
        known.keep(2);
        assert_eq!([0, 1, 2, 3].map(|k| known.get(&key(k))), [Some(0), None, None, Some(3)]);
    }
}
