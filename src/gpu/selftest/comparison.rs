//! Comparison of a stage on the GPU with its twin.

use crate::grid::field::Field;

/// Largest difference between a stage on the GPU and its twin.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The stage.
    pub stage: &'static str,
    /// Values compared.
    pub compared: usize,
    /// Largest difference, px (`inf` where one side has no number and the other has, or is longer).
    pub worst: f64,
    /// Place of that difference.
    pub place: String,
    /// Largest difference that is allowed, px.
    pub bound: f64,
}

impl Comparison {
    /// Nothing compared yet.
    pub fn new(stage: &'static str, bound: f64) -> Self {
        Comparison { stage, compared: 0, worst: 0.0, place: String::new(), bound }
    }

    /// Compares two values, which lie at `place`.
    pub fn value(&mut self, place: impl FnOnce() -> String, gpu: f64, twin: f64) {
        self.compared += 1;
        let difference = if gpu == twin { 0.0 } else { (gpu - twin).abs() };
        let difference = if difference.is_nan() { f64::INFINITY } else { difference };
        if difference > self.worst {
            self.worst = difference;
            self.place = format!("{}: {gpu} for {twin}", place());
        }
    }

    /// Pairs of what two answers list, `what`. Where one list is longer no bound holds any more.
    pub fn pairs<'a, A, B>(
        &mut self,
        what: &dyn std::fmt::Display,
        gpu: &'a [A],
        twin: &'a [B],
    ) -> impl Iterator<Item = (usize, &'a A, &'a B)> + use<'a, A, B> {
        if gpu.len() != twin.len() {
            self.worst = f64::INFINITY;
            self.place = format!("{} {what} for {}", gpu.len(), twin.len());
        }
        gpu.iter().zip(twin).enumerate().map(|(n, (a, b))| (n, a, b))
    }

    /// Compares all nodes of all jobs.
    pub fn fields(stage: &'static str, bound: f64, gpu: &[Field], twin: &[Field]) -> Self {
        Self::nodes(stage, bound, gpu, twin, |_, _| true)
    }

    /// Compares the nodes of all jobs that `which` asks for.
    pub fn nodes(
        stage: &'static str,
        bound: f64,
        gpu: &[Field],
        twin: &[Field],
        which: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let mut out = Comparison::new(stage, bound);
        for (q, a, b) in out.pairs(&"fields", gpu, twin) {
            let nx = b.dims[0].max(1);
            for (n, x, y) in out.pairs(&format_args!("nodes of job {q}"), &a.data, &b.data) {
                if which(q, n) {
                    out.value(|| format!("job {q}, node ({}, {})", n % nx, n / nx), *x, *y);
                }
            }
        }
        out
    }

    /// Whether the stage can be trusted: something was compared, and nothing is off by more than the bound.
    pub fn holds(&self) -> bool {
        self.compared > 0 && self.worst <= self.bound
    }
}
