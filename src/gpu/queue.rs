//! Runs on several threads share a device: a stage has it for itself, and what others ask for meanwhile is done in one go if it is alike.
//!
//! The jobs of a call lie in one atlas. A small run leaves most of a GPU idle; the waiting calls of many small runs, put together, fill it. Bits of
//! a job's result do not depend on what else is in the atlas.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use crate::error::Result;
use crate::gpu::device::failure;
use crate::progress::{Progress, Silent};

/// Turns of those who want the device.
#[derive(Debug, Default)]
pub struct Turns {
    taken: Mutex<bool>,
    free: Condvar,
}

/// The device, until it is dropped.
pub struct Turn<'t> {
    turns: &'t Turns,
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        *locked(&self.turns.taken) = false;
        self.turns.free.notify_all();
    }
}

impl Turns {
    /// Waits for the device.
    pub fn take(&self) -> Turn<'_> {
        let taken = locked(&self.taken);
        self.given(self.free.wait_while(taken, |taken| *taken).unwrap_or_else(PoisonError::into_inner))
    }

    /// The device, if it is free.
    fn take_now(&self) -> Option<Turn<'_>> {
        let taken = locked(&self.taken);
        (!*taken).then(|| self.given(taken))
    }

    /// Waits for the device, unless `done` comes true before.
    fn take_unless(&self, done: impl Fn() -> bool) -> Option<Turn<'_>> {
        let waits = self.free.wait_while(locked(&self.taken), |taken| *taken && !done());
        let taken = waits.unwrap_or_else(PoisonError::into_inner);
        (!done()).then(|| self.given(taken))
    }

    fn given(&self, mut taken: MutexGuard<'_, bool>) -> Turn<'_> {
        *taken = true;
        Turn { turns: self }
    }
}

/// A job that may wait on its own.
pub trait Waits: Sized {
    /// Owned copy.
    type Owned;
    /// Steps of progress that the job counts for.
    fn steps(&self) -> usize {
        1
    }
    /// A copy that waits.
    ///
    /// # Errors
    /// What hinders reading what it refers to.
    fn owned(&self) -> Result<Self::Owned>;
    /// Copies as the jobs they are.
    fn lent(jobs: &[Self::Owned]) -> &[Self];
}

/// Calls of one stage that wait. Those with equal `K` may be answered together.
#[derive(Debug)]
pub struct Calls<K, J, R> {
    waiting: Mutex<Vec<Call<K, J, R>>>,
}

#[derive(Debug)]
struct Call<K, J, R> {
    alike: K,
    jobs: Vec<J>,
    answer: Answer<R>,
}

type Answer<R> = Arc<Mutex<Option<Result<Vec<R>>>>>;

impl<K, J, R> Default for Calls<K, J, R> {
    fn default() -> Self {
        Calls { waiting: Mutex::new(Vec::new()) }
    }
}

impl<K: PartialEq, J, R> Calls<K, J, R> {
    /// Results of `jobs` in their order, by `run`, which may be asked for jobs of other calls with them.
    ///
    /// # Errors
    /// The errors of `run` for these jobs alone.
    pub fn ask<B: Waits<Owned = J>>(
        &self,
        turns: &Turns,
        alike: K,
        jobs: &[B],
        progress: &dyn Progress,
        run: impl Fn(&[B], &dyn Progress) -> Result<Vec<R>>,
    ) -> Result<Vec<R>> {
        if let Some(_turn) = turns.take_now() {
            return run(jobs, progress);
        }
        let answer = Answer::default();
        let call = Call { alike, jobs: jobs.iter().map(B::owned).collect::<Result<_>>()?, answer: answer.clone() };
        locked(&self.waiting).push(call);
        if let Some(_turn) = turns.take_unless(|| locked(&answer).is_some()) {
            run_together(self.alike(&answer), |jobs| run(B::lent(jobs), &Silent));
        }
        progress.advance(jobs.iter().map(B::steps).sum());
        let given_up = || Err(failure("the run that computed this stage for several has failed"));
        locked(&answer).take().unwrap_or_else(given_up)
    }

    /// Takes the call with this answer and those like it out of the line.
    fn alike(&self, answer: &Answer<R>) -> Vec<Call<K, J, R>> {
        let mut waiting = locked(&self.waiting);
        let Some(own) = waiting.iter().position(|call| Arc::ptr_eq(&call.answer, answer)) else { return Vec::new() };
        let own = waiting.remove(own);
        let mut calls: Vec<_> = waiting.extract_if(.., |call| call.alike == own.alike).collect();
        calls.push(own);
        calls
    }
}

/// Answers all calls; where that fails together, each by itself. Nothing to do where somebody took the calls and panicked.
fn run_together<K, J, R>(calls: Vec<Call<K, J, R>>, run: impl Fn(&[J]) -> Result<Vec<R>>) {
    if calls.is_empty() {
        return;
    }
    let mut all = Vec::new();
    let mut answers = Vec::new();
    for call in calls {
        answers.push((all.len()..all.len() + call.jobs.len(), call.answer));
        all.extend(call.jobs);
    }
    match run(&all) {
        Ok(results) => {
            let mut results = results.into_iter();
            for (jobs, answer) in answers {
                *locked(&answer) = Some(Ok(results.by_ref().take(jobs.len()).collect()));
            }
        }
        Err(e) if answers.len() == 1 => *locked(&answers[0].1) = Some(Err(e)),
        Err(_) => answers.into_iter().for_each(|(jobs, answer)| *locked(&answer) = Some(run(&all[jobs]))),
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::thread;

    use super::*;

    impl Waits for i32 {
        type Owned = i32;
        fn owned(&self) -> Result<i32> {
            Ok(*self)
        }
        fn lent(jobs: &[i32]) -> &[i32] {
            jobs
        }
    }

    /// Four threads ask while a fifth has the device; sizes of the runs, and what each thread got.
    fn ask_together(
        alike: [u8; 4],
        run: impl Fn(&[i32]) -> Result<Vec<i32>> + Sync,
    ) -> (Vec<usize>, Vec<Result<Vec<i32>>>) {
        let (turns, calls) = (Turns::default(), Calls::<u8, i32, i32>::default());
        let sizes = Mutex::new(Vec::new());
        let counted = |jobs: &[i32], _: &dyn Progress| {
            locked(&sizes).push(jobs.len());
            run(jobs)
        };
        let got = thread::scope(|scope| {
            let turn = turns.take();
            let asks: Vec<_> = (0..4)
                .map(|k| {
                    let (turns, calls, counted) = (&turns, &calls, &counted);
                    scope.spawn(move || calls.ask(turns, alike[k as usize], &[10 * k, 10 * k + 1], &Silent, counted))
                })
                .collect();
            while locked(&calls.waiting).len() < 4 {
                thread::yield_now();
            }
            drop(turn);
            asks.into_iter().map(|ask| ask.join().expect("no panic")).collect()
        });
        (sizes.into_inner().expect("no panic"), got)
    }

    #[test]
    fn calls_that_wait_are_answered_together_each_with_its_own() {
        let (sizes, got) = ask_together([7; 4], |jobs| Ok(jobs.iter().map(|j| j + 100).collect()));
        assert_eq!(sizes, [8]);
        for (k, got) in (0..).zip(got) {
            assert_eq!(got.expect("an answer"), [10 * k + 100, 10 * k + 101]);
        }
    }

    #[test]
    fn only_like_calls_are_put_together() {
        let (mut sizes, got) = ask_together([1, 2, 1, 1], |jobs| Ok(jobs.to_vec()));
        sizes.sort_unstable();
        assert_eq!(sizes, [2, 6]);
        assert!(got.into_iter().all(|got| got.is_ok()));
    }

    #[test]
    fn one_calls_failure_is_its_own() {
        let run = |jobs: &[i32]| if jobs.contains(&21) { Err(failure("21")) } else { Ok(jobs.to_vec()) };
        let (sizes, got) = ask_together([0; 4], run);
        assert_eq!(sizes, [8, 2, 2, 2, 2]);
        let failed: Vec<bool> = got.iter().map(Result::is_err).collect();
        assert_eq!(failed, [false, false, true, false]);
    }

    #[test]
    fn a_panic_leaves_nobody_waiting() {
        let turns = Turns::default();
        let calls = Calls::<u8, i32, i32>::default();
        let asked = AtomicUsize::new(0);
        let run = |_: &[i32], _: &dyn Progress| -> Result<Vec<i32>> {
            asked.fetch_add(1, Ordering::Relaxed);
            panic!("a defect");
        };
        thread::scope(|scope| {
            let turn = turns.take();
            let asks: Vec<_> = (0..3)
                .map(|k| {
                    scope.spawn({
                        let (turns, calls) = (&turns, &calls);
                        move || calls.ask(turns, 0, &[k], &Silent, run)
                    })
                })
                .collect();
            while locked(&calls.waiting).len() < 3 {
                thread::yield_now();
            }
            drop(turn);
            let ended = asks.into_iter().map(|ask| ask.join()).filter(|end| matches!(end, Ok(Err(_)))).count();
            assert_eq!((asked.load(Ordering::Relaxed), ended), (1, 2), "one panics, the others are told");
        });
        assert!(turns.take_now().is_some(), "the device is free again");
    }
}
