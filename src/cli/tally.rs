//! Progress of a batch: a bar with jobs per hour and time left on a terminal, a line now and then elsewhere.

use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressStyle};
use interslice::batch::{Job, Outcome, Watch};

/// Between lines, where there is no terminal.
const EVERY: Duration = Duration::from_secs(10);

/// Counts the jobs that end.
pub struct Tally {
    begin: Instant,
    bar: ProgressBar,
    quiet: bool,
    counts: Mutex<Counts>,
}

#[derive(Default)]
struct Counts {
    total: usize,
    skipped: usize,
    /// Done or failed now.
    run: usize,
    told: Option<Instant>,
}

impl Counts {
    /// Speed and time left by the jobs that were run; those skipped took none.
    fn words(&self, elapsed: Duration) -> String {
        if self.run == 0 {
            return String::new();
        }
        let each = elapsed.div_f64(self.run as f64);
        let left = each.mul_f64((self.total - self.skipped - self.run) as f64);
        format!("{:.0} jobs per hour, {} left", 3600.0 / each.as_secs_f64().max(1e-9), HumanDuration(left))
    }
}

impl Tally {
    /// Counts to `total`.
    pub fn new(total: usize, quiet: bool) -> Self {
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(total as u64) };
        if let Ok(style) = ProgressStyle::with_template("{wide_bar} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        let counts = Mutex::new(Counts { total, ..Counts::default() });
        Tally { begin: Instant::now(), bar, quiet, counts }
    }

    /// Prints a message without tearing the bar.
    pub fn say(&self, message: &str) {
        self.bar.suspend(|| tell!("{message}"));
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Watch for Tally {
    fn ended(&self, job: &Job, outcome: &Outcome) {
        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        match outcome {
            Outcome::Skipped => counts.skipped += 1,
            Outcome::Done | Outcome::Failed(_) => counts.run += 1,
            Outcome::NotRun => {}
        }
        let words = counts.words(self.begin.elapsed());
        self.bar.set_position((counts.skipped + counts.run) as u64);
        self.bar.set_message(words.clone());
        if let Outcome::Failed(why) = outcome {
            self.say(&format!("failed: {}: {why}", job.id));
        }
        let due = counts.told.unwrap_or(self.begin).elapsed() >= EVERY;
        if due && !self.quiet && !std::io::stderr().is_terminal() {
            counts.told = Some(Instant::now());
            tell!("{} of {} jobs, {words}", counts.skipped + counts.run, counts.total);
        }
    }
}
