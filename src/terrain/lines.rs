//! Lines of features, each with its elevation.

use std::collections::HashSet;

use glam::DVec2;

use super::Feature;
use super::elevation::{ElevationSource, elevation, source};
use crate::error::{Error, Result};
use crate::polygons::grid::bounds;

/// Most pixels along the longer side of the map, where the pixel size is chosen here.
const LONGEST: f64 = 1024.0;
/// Least and most pixels between neighbouring lines, in the mean, where the pixel size is chosen here: more cost time and tell nothing (of St Helens in
/// lines of 100 m, 300 m apart, heights are off by 11.1 m with 10 and with 6.7 pixels between them).
const BETWEEN: [f64; 2] = [4.0, 8.0];
/// Lines that are left out for one reason and told one by one.
const TOLD: usize = 3;
/// A line whose ends are no farther apart than this share of its length is closed: its last point is its first, but for rounding.
const ROUNDING: f64 = 1e-6;

/// A line of equal elevation.
#[derive(Debug, Clone)]
pub struct ContourLine {
    /// Its feature.
    pub feature: String,
    /// Elevation.
    pub z: f64,
    /// Points, each different from the one before.
    pub points: Vec<DVec2>,
    /// The last point joins the first, which is not repeated.
    pub closed: bool,
}

/// All lines, and where their elevations were found. What is a point, has no elevation, no length, or is closed and encloses nothing, is left out with
/// a note.
///
/// # Errors
/// A message with feature and value.
pub fn lines(
    features: &[Feature],
    asked: Option<&str>,
    notes: &mut Vec<String>,
) -> std::result::Result<(Vec<ContourLine>, String), String> {
    let source = source(features, asked)?;
    let said = match &source {
        ElevationSource::Field(field) => format!("attribute `{field}`"),
        ElevationSource::Points => "the points' z".into(),
    };
    let (mut lines, mut nothing, mut points, mut without) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for feature in features {
        for (k, part) in feature.lines.iter().enumerate() {
            let name = &feature.name;
            if part.points.len() == 1 {
                points.push(format!("{name} is a point, no line; left out"));
                continue;
            }
            if let Some(DVec2 { x, y }) = part.points.iter().find(|p| !p.is_finite()) {
                return Err(format!("{name} has the point ({x}, {y}); coordinates must be finite numbers"));
            }
            let Some(z) = elevation(feature, k, &source)? else {
                without.push(format!("{name} has no elevation ({said} is empty); left out"));
                continue;
            };
            let mut own = part.points.clone();
            own.dedup();
            let meets = meets_itself(&own);
            let closed = part.ring || meets;
            if meets {
                own.pop();
            }
            if own.len() < if closed { 3 } else { 2 } {
                nothing.push(format!("{name}: a line of {z} is a point or encloses nothing; left out"));
                continue;
            }
            lines.push(ContourLine { feature: name.clone(), z, points: own, closed });
        }
    }
    if lines.is_empty() {
        let left_out = [nothing.first(), points.first(), without.first()];
        let why: String = left_out.into_iter().flatten().map(|why| format!(": {why}")).collect();
        return Err(format!("has no lines{why}"));
    }
    notes.extend(told(nothing, "lines are points or enclose nothing"));
    notes.extend(told(points, "features are points"));
    notes.extend(told(without, "lines have no elevation"));
    Ok((lines, said))
}

/// Whether the last point of a line is its first, but for rounding.
fn meets_itself(points: &[DVec2]) -> bool {
    let [first, .., last] = points else { return false };
    let length = || points.windows(2).map(|w| distance(w[0], w[1])).sum::<f64>();
    first == last || distance(*first, *last) <= ROUNDING * length()
}

/// Leaves out lines that are there twice.
pub fn distinct(lines: Vec<ContourLine>, notes: &mut Vec<String>) -> Vec<ContourLine> {
    let mut seen = HashSet::new();
    let (mut kept, mut twice) = (Vec::with_capacity(lines.len()), Vec::new());
    for line in lines {
        let mut points: Vec<[u64; 2]> = line.points.iter().map(|p| (*p + 0.0).to_array().map(f64::to_bits)).collect();
        points.sort_unstable();
        if seen.insert((line.z.to_bits(), points)) {
            kept.push(line);
        } else {
            twice.push(format!("{}: the same line of {} is there before; left out", line.feature, line.z));
        }
    }
    notes.extend(told(twice, "lines are there before"));
    kept
}

/// Notes on what is left out for one reason ("lines have no elevation"): of many some are told one by one.
pub fn told(mut notes: Vec<String>, why: &str) -> Vec<String> {
    let more = notes.len().saturating_sub(TOLD);
    notes.truncate(TOLD);
    notes.extend((more > 0).then(|| format!("{more} more {why}; left out")));
    notes
}

/// The side of pixels that is asked for, else the median distance of neighbouring points, but at most a quarter and at least an eighth of the mean
/// distance of lines (area of the map by length of all lines), and at least 1/1024 of the longer side of the map.
///
/// # Errors
/// [`Error::Setting`] for one that is none; [`Error::Stack`] where all points lie on a line.
pub fn pixel(lines: &[ContourLine], asked: Option<f64>) -> Result<f64> {
    if let Some(pixel) = asked {
        let message = format!("must be a positive number; got {pixel}");
        let good = pixel.is_finite() && pixel > 0.0;
        return if good { Ok(pixel) } else { Err(Error::Setting { name: "pixel".into(), message }) };
    }
    let [low, high] = bounds(lines.iter().flat_map(|l| &l.points));
    let [width, height] = (high - low).to_array();
    if !(width > 0.0 && height > 0.0) {
        return Err(Error::Stack("contour lines enclose no area".into()));
    }
    let mut lengths: Vec<f64> = lines.iter().flat_map(|l| l.points.windows(2)).map(|w| distance(w[0], w[1])).collect();
    lengths.sort_by(f64::total_cmp);
    let apart = width * height / lengths.iter().sum::<f64>();
    let median = lengths.get(lengths.len() / 2).copied().unwrap_or(f64::INFINITY);
    let [finest, coarsest] = [apart / BETWEEN[1], apart / BETWEEN[0]];
    Ok(median.min(coarsest).max(finest).max(width.max(height) / LONGEST))
}

/// Distance of two points, rounded as `hypot` does: pixel sides are made of it.
pub fn distance(p: DVec2, q: DVec2) -> f64 {
    (q.x - p.x).hypot(q.y - p.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::MapPart;

    /// A circle in points of this accuracy whose last point misses its first by `off`.
    fn circle(off: f64) -> Feature {
        let at = |k: usize| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * k as f64 / 64.0);
            DVec2::new(5e5 + 300.0 * cos, 5e6 + 300.0 * sin)
        };
        let points = (0..64).map(at).chain([at(0) + DVec2::new(0.0, off)]).collect();
        let part = MapPart { points, z: Vec::new(), ring: false };
        Feature { name: "feature 1".into(), fields: vec![("z".into(), 10.0.into())], lines: vec![part] }
    }

    #[test]
    fn a_line_is_closed_if_its_last_point_is_its_first_but_for_rounding() {
        for (off, closed, points) in [(0.0, true, 64), (1e-9, true, 64), (1e-3, true, 64), (0.01, false, 65)] {
            let (lines, _) = lines(&[circle(off)], None, &mut Vec::new()).expect("the lines are good");
            assert_eq!((lines[0].closed, lines[0].points.len()), (closed, points), "ends {off} apart");
        }
        // However short a line of two points is, it has two ends.
        assert!(!meets_itself(&[DVec2::ZERO, DVec2::new(1e-12, 0.0)]) && !meets_itself(&[DVec2::ZERO]));
    }

    #[test]
    fn a_line_is_there_twice_whichever_zero_it_is_written_with() {
        let line = |zero: f64, z: f64| ContourLine {
            feature: format!("feature of {zero:?}"),
            z,
            points: [[zero, 2.0], [3.0, zero], [4.0, 5.0]].map(DVec2::from).to_vec(),
            closed: true,
        };
        let mut notes = Vec::new();
        let kept = distinct(vec![line(0.0, 1.0), line(-0.0, 1.0), line(-0.0, 2.0)], &mut notes);
        assert_eq!(kept.iter().map(|line| line.z).collect::<Vec<_>>(), [1.0, 2.0]);
        assert_eq!(notes.len(), 1, "{notes:?}");
    }
}
