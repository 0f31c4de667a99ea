//! How large the pixels are on which drawings are laid, where nobody says it.

use std::fmt;

use super::edges::{area, contour_edges};
use super::grid::bounds;
use super::needed::needed;
use super::zones::widths;
use super::{PlaneDrawing, Polygon};
use crate::stack::heights::middle_gap;

/// Least pixels across the mean width of what is drawn, where the pixel size is chosen here: where lines have as many points as are no corners, and
/// where they turn by a right angle at each point, as a corner is rounded by half a pixel.
const ACROSS: [f64; 2] = [8.0, 32.0];
/// Points of a line from which on they are no corners.
const ROUND: f64 = 32.0;
/// Most pixels along the longer side of the box around all contours, where the pixel size is chosen here.
pub(super) const LONGEST: f64 = 1024.0;
/// Pixels across the mean width below which areas are off by some per cent.
pub(super) const COARSE: f64 = 4.0;
/// Of all lines one in so many may be narrower: the tips of a body are, and a small part beside a large one is not one of them.
const NARROWER: usize = 10;
/// Most pixels along the longer side for the sake of narrow lines alone: a lung may have a hundred holes of a few mm, and would have 1000 for them.
const FOR_NARROW: f64 = 256.0;
/// Points that lie within one part in so many of a pixel of the straight line through others say nothing.
const NOTHING: f64 = 20.0;
/// Layers in the usual gap between slices below which pixels are as fine as points are drawn, be they needed or not: between slices layers are as far
/// apart as pixels.
const LAYERS: f64 = 8.0;
/// Pixels along the longer side up to which they are as fine as points are drawn, too: those cost nothing.
const CHEAP: f64 = 64.0;
/// Times that pixels are made finer until they are fine enough for the points that they need. Of a circle each halves the logarithm of what is too much.
const ROUNDS: usize = 16;
/// Part of their side by which they may be too large.
const ENOUGH: f64 = 1.0 / 64.0;
/// Pixels across what a single line bounds that are kept at all costs: more than [`LOST`].
const SEEN: f64 = 2.0;
/// What pixels are that points are chosen by, and where some of them say nothing.
const OF_ALL_POINTS: &str = "half the distance of neighbouring points";
const OF_NEEDED_POINTS: &str = "half the distance of the points that the shape needs";
/// Pixels across the width inside a line below which it may be lost: of a disc of 0.8 px 1 % of the volume was left, of 1.2 px 64, of 1.7 px 88.
pub(super) const LOST: f64 = 1.5;
/// Rows by which the area of a plane is measured.
const LINES: usize = 64;

/// Pixel side for drawings, and why, in words.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChosenPixel {
    /// The side.
    pub side: f64,
    /// What it is: "half the distance of neighbouring points".
    pub why: &'static str,
}

impl fmt::Display for ChosenPixel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "pixels are chosen by the polygons: {}", self.why)
    }
}

impl ChosenPixel {
    /// The finer one of two; one that is no number is none.
    fn or_finer(self, other: Self) -> Self {
        if other.side < self.side || self.side.is_nan() { other } else { self }
    }
}

/// Pixel side for drawings: half the median distance of neighbouring points, so that no drawn point is lost between pixels, but at most an
/// eighth of the mean width `2 A / P` (area and length of all contours), so that what has few points is still several pixels wide, down to a 32nd
/// where lines have 8 points or less in the mean instead of 32, so that their corners stay; at most a quarter of the width inside all lines but the tenth
/// part that is narrower, so that a small part or a thin wall beside a large one is not lost, but for that alone at least 1/256 of the longer side of the
/// box around all; and at least 1/1024 of it.
///
/// Where lines have more points than they need, it is the same of the points that they do need, up to an eighth of the usual gap between slices and a
/// 64th of the longer side: those that lie within a 20th of a pixel of the line through others say nothing of the shape. What would be seen with all
/// points still is.
pub fn pixel_side(drawings: &[PlaneDrawing]) -> f64 {
    chosen_pixel(drawings).side
}

/// [`pixel_side`], and why.
pub fn chosen_pixel(drawings: &[PlaneDrawing]) -> ChosenPixel {
    let sides = sides(drawings);
    let by_points = sides.pixel(sides.points, sides.of_a_line);
    let enough = enough(drawings, &sides, by_points.side);
    enough.filter(|enough| enough.side > by_points.side).unwrap_or(by_points)
}

/// The largest pixel side, of at most an eighth of the usual gap and a 64th of the longer side, that is no larger than the points that lines need tell;
/// nothing where that is no more than what all points tell.
fn enough(drawings: &[PlaneDrawing], sides: &Sides, by_points: f64) -> Option<ChosenPixel> {
    let mut heights: Vec<f64> = drawings.iter().map(|drawing| drawing.z).filter(|z| z.is_finite()).collect();
    heights.sort_by(f64::total_cmp);
    let by_gap = ChosenPixel {
        side: middle_gap(&heights) / LAYERS,
        why: "an eighth of the usual gap between slices: the points are closer than their shape needs",
    };
    // One line of a hundred counts as well: it has been seen so far.
    let narrowest = sides.widths.iter().find(|width| **width >= LOST * by_points).copied().unwrap_or(f64::INFINITY);
    let by_narrowest = ChosenPixel {
        side: (narrowest / COARSE).max((narrowest / SEEN).min(sides.least * LONGEST / FOR_NARROW)),
        why: "what the narrowest of all lines needs",
    };
    let cheap = ChosenPixel {
        side: sides.least * LONGEST / CHEAP,
        why: "1/64 of the longer side of all contours: the points are closer than their shape needs",
    };
    let mut pixel = by_gap.or_finer(cheap).or_finer(by_narrowest).or_finer(sides.pixel(f64::INFINITY, ROUND));
    for _ in 0..ROUNDS {
        if pixel.side <= by_points {
            return None;
        }
        let points = needed(drawings.iter().flat_map(PlaneDrawing::polygons), pixel.side / NOTHING)?;
        let by_needed = sides.pixel(points.points, points.count / sides.lines);
        if by_needed.side >= (1.0 - ENOUGH) * pixel.side {
            break;
        }
        let why = if by_needed.why == OF_ALL_POINTS { OF_NEEDED_POINTS } else { by_needed.why };
        pixel = ChosenPixel { why, ..by_needed };
    }
    Some(pixel)
}

/// Widths of what each line of a plane bounds, but for those without area.
pub(super) fn inner_widths(drawing: &PlaneDrawing) -> impl Iterator<Item = f64> {
    drawing.regions.iter().flat_map(|region| widths(region)).flatten()
}

/// Lengths that pixels are chosen by.
#[derive(Debug)]
pub(super) struct Sides {
    /// Median distance of neighbouring points.
    points: f64,
    /// Points of a line, in the mean.
    of_a_line: f64,
    /// Mean width.
    pub(super) width: f64,
    /// Widths inside the lines, increasing.
    widths: Vec<f64>,
    /// Number of lines.
    lines: f64,
    /// Least pixel side.
    pub(super) least: f64,
}

impl Sides {
    /// Pixel side for lines whose points have this median distance and this mean number.
    fn pixel(&self, points: f64, of_a_line: f64) -> ChosenPixel {
        let [round, cornered] = ACROSS;
        let across = (round * ROUND / of_a_line).clamp(round, cornered);
        let narrow = self.widths.get(self.widths.len() / NARROWER).copied().unwrap_or(f64::INFINITY);
        let most = [
            (0.5 * points, OF_ALL_POINTS),
            (self.width / across, "a part of the mean width of what is drawn"),
            ((narrow / COARSE).max(self.least * LONGEST / FOR_NARROW), "what the narrowest of the lines need"),
        ];
        let [first, others @ ..] = most.map(|(side, why)| ChosenPixel { side, why });
        let pixel = others.into_iter().fold(first, ChosenPixel::or_finer);
        match pixel.side < self.least {
            true => ChosenPixel { side: self.least, why: "1/1024 of the longer side of all contours" },
            false => pixel,
        }
    }
}

/// The lengths of drawings.
pub(super) fn sides(drawings: &[PlaneDrawing]) -> Sides {
    let [low, high] = bounds(drawings.iter().flat_map(PlaneDrawing::polygons).flatten());
    let longer = (high - low).max_element();
    let (mut lengths, mut area_sum) = (Vec::new(), 0.0);
    for group in drawings.iter().flat_map(|d| &d.regions).flat_map(|region| groups(region)) {
        let edges = contour_edges(&group, 1e-9 * longer);
        lengths.extend(edges.iter().map(|[p, q]| (q.x - p.x).hypot(q.y - p.y)));
        let [low, high] = bounds(group.iter().flatten());
        if low.y < high.y {
            area_sum += area(&edges, [low.y, high.y], LINES);
        }
    }
    lengths.sort_by(f64::total_cmp);
    let least = longer / LONGEST;
    let Some(points) = lengths.get(lengths.len() / 2) else {
        return Sides { points: 0.0, of_a_line: ROUND, width: f64::INFINITY, widths: Vec::new(), lines: 0.0, least };
    };
    let lines = drawings.iter().flat_map(PlaneDrawing::polygons).count() as f64;
    let mut widths: Vec<f64> = drawings.iter().flat_map(inner_widths).collect();
    widths.sort_by(f64::total_cmp);
    Sides {
        points: *points,
        of_a_line: lengths.len() as f64 / lines,
        width: 2.0 * area_sum / lengths.iter().sum::<f64>(),
        widths,
        lines,
        least,
    }
}

/// A region's polygons in groups one above the other: together, rows over all of them might miss small ones far apart.
fn groups(region: &[Polygon]) -> Vec<Vec<Polygon>> {
    let spans = region.iter().map(|line| bounds(line.iter()).map(|x| x.y));
    let mut all: Vec<([f64; 2], &Polygon)> = spans.zip(region).collect();
    all.sort_by(|a, b| a.0[0].total_cmp(&b.0[0]));
    let mut groups: Vec<(f64, Vec<Polygon>)> = Vec::new();
    for ([low, high], line) in all {
        match groups.last_mut().filter(|(top, _)| low <= *top) {
            Some((top, group)) => {
                *top = top.max(high);
                group.push(line.clone());
            }
            None => groups.push((high, vec![line.clone()])),
        }
    }
    groups.into_iter().map(|(_, group)| group).collect()
}
