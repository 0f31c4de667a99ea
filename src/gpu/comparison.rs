//! What a stage says on the GPU beside what its twin says.

use crate::field::Field;

/// How far a stage on the GPU is from its twin.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The stage.
    pub stage: &'static str,
    /// Values compared.
    pub compared: usize,
    /// Largest difference, px (`inf` where one side has no number and the other has).
    pub worst: f64,
    /// Largest difference that is allowed, px.
    pub bound: f64,
}

impl Comparison {
    /// Compares values pair by pair.
    pub fn of(stage: &'static str, bound: f64, pairs: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let mut out = Comparison { stage, compared: 0, worst: 0.0, bound };
        for (gpu, twin) in pairs {
            out.compared += 1;
            let difference = if gpu == twin { 0.0 } else { (gpu - twin).abs() };
            out.worst = if difference.is_nan() { f64::INFINITY } else { out.worst.max(difference) };
            if out.worst == f64::INFINITY {
                break;
            }
        }
        out
    }

    /// Compares all nodes of all jobs.
    pub fn fields<'a>(stage: &'static str, bound: f64, gpu: &'a [Field], twin: &'a [Field]) -> Self {
        Self::nodes(stage, bound, gpu, twin, |_, _| true)
    }

    /// Compares the nodes of all jobs that `which` asks for.
    pub fn nodes<'a>(
        stage: &'static str,
        bound: f64,
        gpu: &'a [Field],
        twin: &'a [Field],
        which: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let mut pairs = Vec::new();
        for (q, (a, b)) in gpu.iter().zip(twin).enumerate() {
            let both = a.data.iter().zip(&b.data).enumerate();
            pairs.extend(both.filter(|(n, _)| which(q, *n)).map(|(_, (x, y))| (*x, *y)));
        }
        Self::of(stage, bound, pairs)
    }

    /// Whether the stage can be trusted: something was compared, and nothing is off by more than the bound.
    pub fn holds(&self) -> bool {
        self.compared > 0 && self.worst <= self.bound
    }
}
