//! Cost of kernels, and the share of its time in which the device works, by its own clock.
//!
//! Timing gives every dispatch a pass of its own. Its timestamps are read long after, so that nobody waits for the device because of them.

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::buffer::Buffer;
use super::device::Device;
use super::recorder::LISTS;
use crate::error::Result;
use crate::report::{Busy, Profile};

/// Submissions whose timestamps are read together.
const READ_TOGETHER: usize = 128;

/// Profiler that gathers what kernels cost.
#[derive(Debug)]
pub struct Profiler {
    /// Whether kernels are timed.
    pub timed: bool,
    gathered: Mutex<Gathered>,
}

#[derive(Debug, Default)]
struct Gathered {
    profile: Profile,
    unread: Vec<Stamps>,
    /// Dispatches over lists since the last look at their lengths.
    listed: [u64; LISTS],
    busy: Option<Spans>,
}

/// Timestamps of a submission: where they are, and the kernels of its dispatches.
#[derive(Debug)]
pub struct Stamps {
    /// Begin and end of each dispatch, ticks of 8 bytes.
    pub buffer: Buffer<[u64]>,
    /// Number of them.
    pub count: usize,
    /// Kernels of the dispatches.
    pub kernels: Vec<&'static str>,
}

/// Time in which the device has work, in ticks.
#[derive(Debug, Clone, Copy)]
struct Spans {
    first: u64,
    last: u64,
    busy: u64,
}

impl Spans {
    /// Adds a submission from `begin` to `end`, which begins after those before have begun.
    fn and(known: Option<Spans>, begin: u64, end: u64) -> Spans {
        let known = known.unwrap_or(Spans { first: begin, last: begin, busy: 0 });
        let last = known.last.max(end);
        Spans { first: known.first.min(begin), last, busy: known.busy + (last - known.last.max(begin).min(last)) }
    }
}

impl Profiler {
    /// Nothing gathered yet.
    pub fn new(timed: bool) -> Self {
        Profiler { timed, gathered: Mutex::default() }
    }

    /// Profile gathered so far. Timestamps of a device that has failed are left out.
    pub fn profile(&self, device: &Device) -> Profile {
        let mut gathered = self.gathered();
        // What cannot be read any more says nothing.
        let _ = gathered.read(device);
        let period = period(device);
        let busy = gathered.busy.map(|spans| Busy {
            seconds: spans.busy as f64 * period,
            of_seconds: (spans.last - spans.first) as f64 * period,
        });
        Profile { busy, ..gathered.profile.clone() }
    }

    /// Says how many pixels kernels over the band have updated, which the host learns only afterwards.
    pub fn count(&self, kernels: &[&'static str], pixels: usize) {
        let mut gathered = self.gathered();
        for kernel in kernels {
            gathered.profile.kernels.entry((*kernel).into()).or_default().pixels += pixels as u64;
        }
    }

    /// Counts the dispatches over lists since the last look, by the threads that each list has now.
    pub fn looked(&self, device: &Device, threads: [u64; LISTS]) {
        let listed = std::mem::take(&mut self.gathered().listed);
        let known = listed.into_iter().zip(threads).filter(|(dispatches, _)| *dispatches > 0);
        device.count(|counts| known.for_each(|(dispatches, threads)| counts.count_dispatches(dispatches, threads)));
    }

    /// A submission of dispatches, by kernel and pixels, and of how many dispatches over each list.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`] when the device has failed.
    pub fn submitted(
        &self,
        device: &Device,
        runs: &[(&'static str, usize)],
        listed: [u64; LISTS],
        stamps: Option<Stamps>,
    ) -> Result<()> {
        let mut gathered = self.gathered();
        gathered.listed.iter_mut().zip(listed).for_each(|(all, more)| *all += more);
        for (kernel, pixels) in runs {
            let cost = gathered.profile.kernels.entry((*kernel).into()).or_default();
            cost.dispatches += 1;
            cost.pixels += *pixels as u64;
        }
        gathered.unread.extend(stamps);
        if gathered.unread.len() >= READ_TOGETHER { gathered.read(device) } else { Ok(()) }
    }

    fn gathered(&self) -> MutexGuard<'_, Gathered> {
        self.gathered.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Gathered {
    fn read(&mut self, device: &Device) -> Result<()> {
        for stamps in std::mem::take(&mut self.unread) {
            let ticks: Vec<u64> = device.read(&stamps.buffer, 0, stamps.count)?;
            let (spans, _) = ticks.as_chunks::<2>();
            for (kernel, [from, to]) in stamps.kernels.iter().zip(spans) {
                let cost = self.profile.kernels.entry((*kernel).into()).or_default();
                cost.seconds += to.saturating_sub(*from) as f64 * period(device);
            }
            if let (Some([begin, _]), Some([_, end])) = (spans.first(), spans.last()) {
                self.busy = Some(Spans::and(self.busy, *begin, *end));
            }
        }
        Ok(())
    }
}

/// Seconds of a tick.
fn period(device: &Device) -> f64 {
    f64::from(device.queue.get_timestamp_period()) * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_is_counted_once() {
        let spans = [(100, 150), (140, 160), (145, 155), (200, 210), (210, 215)];
        let all = spans.iter().fold(None, |known, (begin, end)| Some(Spans::and(known, *begin, *end)));
        let all = all.expect("there are some");
        assert_eq!((all.first, all.last, all.busy), (100, 215, 60 + 15));
    }
}
