//! The self-test: can this driver be trusted? Counting, NaN, and every stage beside its f64 twin.

use crate::error::Result;
use crate::gpu::selftest::cases::Cases;
use crate::gpu::selftest::comparison::Comparison;
use crate::gpu::selftest::twins::{compare, compare_stages};
use crate::gpu::{Gpu, doctor};

/// Loop trips that the loop test asks for: some drivers stop at 65 535 and say nothing.
const TRIPS: u32 = 70_000;

/// Pixel sides of the self-test.
const SIDES: [f64; 2] = [1.0, 0.8];

/// Findings of the self-test.
#[derive(Debug, Clone)]
pub struct Findings {
    /// Loop trips made of those asked for.
    pub trips: [u32; 2],
    /// Whether comparisons with NaN are false and arithmetic keeps NaN.
    pub keeps_nan: bool,
    /// Whether square roots and quotients are rounded to nearest.
    pub rounds: bool,
    /// Stages beside their twins.
    pub stages: Vec<Comparison>,
}

impl Findings {
    /// Whether results of this driver can be used. Long loops and NaN are told but not needed: no kernel makes more than 65 000 trips.
    pub fn trusted(&self) -> bool {
        self.stages.iter().all(Comparison::holds)
    }

    /// One line per finding and the verdict.
    pub fn in_words(&self) -> Vec<String> {
        let mut lines = Vec::new();
        let [made, asked] = self.trips;
        lines.push(if made == asked {
            format!("loops: {asked} trips made of {asked}")
        } else {
            format!("loops: stops after {made} of {asked} trips without a word; no kernel here makes that many")
        });
        lines.push(format!(
            "NaN: {}",
            if self.keeps_nan { "kept" } else { "lost in comparisons or sums; the host checks results" }
        ));
        lines.push(format!("sqrt and division: {}", if self.rounds { "rounded to nearest" } else { "approximate" }));
        for c in &self.stages {
            let verdict = if c.holds() { "agrees" } else { "DIFFERS" };
            let place = if c.holds() { String::new() } else { format!(", at {}", c.place) };
            lines.push(format!(
                "{}: {verdict}, off by {:.1e} px at most of {:.0e} allowed{place}",
                c.stage, c.worst, c.bound
            ));
        }
        let failed = self.stages.iter().filter(|c| !c.holds()).count();
        lines.push(match failed {
            0 => "This driver can be trusted.".into(),
            n => format!(
                "This driver cannot be trusted: {n} of {} stages are wrong. Use --backend cpu.",
                self.stages.len()
            ),
        });
        lines
    }
}

/// Runs the part of the self-test by which a GPU is trusted: whole stages, in which every kernel takes part.
///
/// # Errors
/// [`crate::Error::Gpu`] when the GPU cannot do the work at all.
pub fn examine_shortly(gpu: &Gpu) -> Result<Vec<Comparison>> {
    compare_stages(gpu, &Cases::new(SIDES, 1))
}

/// Runs the self-test.
///
/// # Errors
/// [`crate::Error::Gpu`] when the GPU cannot do the work at all.
pub fn examine(gpu: &Gpu) -> Result<Findings> {
    let answer = doctor::ask(gpu, TRIPS)?;
    Ok(Findings {
        trips: [answer[0], TRIPS],
        keeps_nan: answer[1..4] == [0, 0, 0] && f32::from_bits(answer[4]).is_nan(),
        rounds: answer[5] == 2f32.to_bits() && answer[6] == (1f32 / 3.0).to_bits(),
        stages: compare(gpu, &Cases::new(SIDES, 1))?,
    })
}
