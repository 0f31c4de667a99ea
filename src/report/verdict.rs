//! Verdict on the figures of a report: whether everything that was checked holds, and what does not, in words.

use crate::report::{ContourReport, PartPair, Report, StepBeside};
use crate::settings::EndRule;

/// The body may change this much within a thousandth of the gap beside a contour, px: 0.1 px of rounding and numerics, or a surface that moves
/// by 100 px from contour to contour. One that has farther to go may change by more.
const JUMP: f64 = 0.1;

impl StepBeside {
    /// Whether the surface goes on from its contour: by no more than 0.1 px, or than the way to the other contour of the interval explains.
    pub fn holds(&self) -> bool {
        self.jump <= JUMP.max(self.explained.unwrap_or(0.0))
    }
}

/// Torn pairs that are named; of others their number is told.
const NAMED: usize = 8;

impl Report {
    /// Lists anew the checks that do not hold.
    pub fn judge(&mut self) {
        let mut broken: Vec<String> = self.contours.iter().flat_map(of_contour).collect();
        let body = &self.body;
        let several = |n: usize, one: &str, more: &str| if n == 1 { format!("1 {one}") } else { format!("{n} {more}") };
        if body.floating > 0 {
            broken.push(several(
                body.floating,
                "piece of the body touches no contour",
                "pieces of the body touch no contour",
            ));
        }
        if body.voids > 0 {
            let told = several(body.voids, "void in the body opens", "voids in the body open");
            broken.push(told + " to no contour");
        }
        if !body.torn.is_empty() {
            let name = |pair: &PartPair| {
                format!("part {} of slice {} and part {} of the next", pair.from, pair.slice, pair.to)
            };
            let named: Vec<String> = body.torn.iter().take(NAMED).map(name).collect();
            let others = body.torn.len().saturating_sub(NAMED);
            let others = if others > 0 { format!(" and {others} more") } else { String::new() };
            let pairs = several(body.torn.len(), "pair of parts overlaps but is", "pairs of parts overlap but are");
            broken.push(format!("{pairs} not connected between: {}{others}", named.join(", ")));
        }
        let rules = [self.settings.end_bottom, self.settings.end_top];
        for ((pixels, rule), end) in body.beyond.iter().zip(rules).zip(["below the first", "above the last"]) {
            if *pixels > 0 && matches!(rule, EndRule::Flat | EndRule::HalfSlice) {
                broken.push(format!("{pixels} pixels {end} contour lie outside of it, though the end is {rule}"));
            }
        }
        self.broken = broken;
    }
}

fn of_contour(c: &ContourReport) -> Vec<String> {
    let mut broken = Vec::new();
    if c.differing_pixels > 0 {
        broken.push(format!("`{}`: {} of {} pixels differ", c.name, c.differing_pixels, c.pixels));
    }
    for (beside, side) in [(c.below, "below"), (c.above, "above")] {
        if let Some(beside) = beside.filter(|b| !b.holds()) {
            broken.push(format!(
                "`{}`: the body steps by {:.3} px just {side} it, area {} beside {}",
                c.name, beside.jump, beside.area as f32, c.area as f32
            ));
        }
    }
    broken
}
