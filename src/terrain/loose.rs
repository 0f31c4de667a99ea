//! Ends of lines that meet nothing, in words.

use glam::DVec2;

use super::border::Border;
use super::join::GAP;
use super::lines::{ContourLine, distance};

/// Ends that a message names.
const NAMED: usize = 3;

/// An end of a line inside the map that meets neither another end nor the border.
#[derive(Debug)]
pub struct LooseEnd {
    /// Its feature and elevation.
    feature: String,
    z: f64,
    at: DVec2,
    /// How far inside the border it lies.
    inside: f64,
    /// The next end of a line of its level: how far away, and of which feature.
    next: Option<(f64, String)>,
}

impl LooseEnd {
    /// End `end` of those of a level's open lines.
    pub fn of(end: usize, ends: &[DVec2], open: &[&ContourLine], border: &Border) -> Self {
        let p = ends[end];
        let others = ends.iter().enumerate().filter(|(k, _)| *k != end).map(|(k, q)| (distance(p, *q), k));
        let next = others.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(away, k)| (away, open[k / 2].feature.clone()));
        let line = open[end / 2];
        LooseEnd { feature: line.feature.clone(), z: line.z, at: p, inside: border.nearest(p).1, next }
    }

    fn words(&self) -> String {
        let next = self.next.as_ref().map_or("there is no other end".into(), |(away, feature)| {
            format!("the next end of one is {away:.4} away ({feature})")
        });
        let LooseEnd { feature, z, at, inside, .. } = self;
        format!(
            "{feature}: its line of {z} ends inside the map at ({}, {}), {inside:.4} from the border: {next}",
            at.x, at.y
        )
    }
}

/// A message with the ends farthest inside, and what to try; `near` says whether ends near the hull have gone on to the border already.
pub fn dangling(mut ends: Vec<LooseEnd>, near: bool, tolerance: f64) -> String {
    let count = ends.len();
    ends.sort_by(|a, b| b.inside.total_cmp(&a.inside));
    ends.truncate(NAMED);
    let worst: Vec<String> = ends.iter().map(LooseEnd::words).collect();
    let heading = match count {
        1 => String::new(),
        n if n <= NAMED => format!("{n} ends of lines meet nothing. "),
        n => format!("{n} ends of lines meet nothing; the {NAMED} farthest inside: "),
    };
    let hull = if near { " or is ragged: --border hull lets lines end inside the box" } else { ": --border hull" };
    // Ends of one level that face each other.
    let gap = ends.iter().filter_map(|end| end.next.as_ref()).map(|(away, _)| *away).fold(0.0, f64::max);
    let pixel = if gap > 0.0 {
        format!(" (--pixel {:.4} joins these, if they belong together)", 2.0 * gap)
    } else {
        String::new()
    };
    format!(
        "{heading}{}. What to try: where the map is no rectangle along x and y{hull}; where it ends at one: --border X0,Y0,X1,Y1; where lines \
         have gaps: ends join within {:.4} (half a pixel), and within {:.4} where no third one is near{pixel}",
        worst.join("; "),
        tolerance,
        2.0 * GAP * tolerance,
    )
}
