//! The border of a map: which lines lie within it, run along it or end at it.

use glam::DVec2;

use super::lines::{ContourLine, distance};
use crate::error::{Error, Result};
use crate::polygons::Polygon;
use crate::polygons::grid::bounds;

/// Pieces whose ends lie this close to one side, of the map's longer side, run along it.
const ALONG: f64 = 1e-7;

/// A rectangle along the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Border {
    /// Lowest x and y.
    pub low: DVec2,
    /// Highest.
    pub high: DVec2,
}

impl Border {
    /// X0,Y0,X1,Y1 as the user gives them.
    ///
    /// # Errors
    /// [`Error::Setting`] for other than four increasing numbers.
    pub fn given(values: &[f64]) -> Result<Self> {
        match *values {
            [x0, y0, x1, y1] if x0 < x1 && y0 < y1 && values.iter().all(|v| v.is_finite()) => {
                Ok(Border { low: DVec2::new(x0, y0), high: DVec2::new(x1, y1) })
            }
            _ => {
                let message = format!("must be X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1; got {values:?}");
                Err(Error::Setting { name: "border".into(), message })
            }
        }
    }

    /// The box around all lines.
    pub fn around(lines: &[ContourLine]) -> Self {
        let [low, high] = bounds(lines.iter().flat_map(|l| &l.points));
        Border { low, high }
    }

    /// Rectangle farther out.
    pub fn grown(&self, by: f64) -> Self {
        Border { low: self.low - by, high: self.high + by }
    }

    /// Distances to the lines through its bottom, right, top and left side; negative outside.
    fn inward(&self, p: DVec2) -> [f64; 4] {
        [p.y - self.low.y, self.high.x - p.x, self.high.y - p.y, p.x - self.low.x]
    }

    /// The nearest side of a point inside, and its distance; negative where the point lies beyond it.
    pub fn nearest(&self, p: DVec2) -> (usize, f64) {
        let inward = self.inward(p);
        let side = (0..4).min_by(|a, b| inward[*a].total_cmp(&inward[*b])).unwrap_or(0);
        (side, inward[side])
    }

    /// Whether a straight piece runs along a side.
    fn has(&self, p: DVec2, q: DVec2) -> bool {
        let slack = ALONG * (self.high - self.low).max_element();
        let (a, b) = (self.inward(p), self.inward(q));
        (0..4).any(|side| a[side].abs() <= slack && b[side].abs() <= slack)
    }

    /// Length of its sides.
    pub fn perimeter(&self) -> f64 {
        2.0 * (self.high - self.low).element_sum()
    }

    /// Length of a closed line's pieces along the border.
    pub fn along(&self, ring: &[DVec2]) -> f64 {
        let next = ring.iter().cycle().skip(1);
        ring.iter().zip(next).filter(|(p, q)| self.has(**p, **q)).map(|(p, q)| distance(*p, *q)).sum()
    }

    /// A line without its pieces along the border.
    pub fn without_sides(&self, line: ContourLine) -> Vec<ContourLine> {
        let n = line.points.len();
        let pieces = if line.closed { n } else { n - 1 };
        let runs_along = |k: usize| self.has(line.points[k % n], line.points[(k + 1) % n]);
        let Some(first) = (0..pieces).find(|k| runs_along(*k)) else { return vec![line] };
        // A closed line is walked from its first piece along the border.
        let start = if line.closed { first + 1 } else { 0 };
        let mut lines = Vec::new();
        let mut points: Polygon = Vec::new();
        for k in start..start + pieces {
            if runs_along(k) {
                lines.push(std::mem::take(&mut points));
            } else {
                if points.is_empty() {
                    points.push(line.points[k % n]);
                }
                points.push(line.points[(k + 1) % n]);
            }
        }
        lines.push(points);
        let open = |points| ContourLine { feature: line.feature.clone(), z: line.z, points, closed: false };
        lines.into_iter().filter(|points| points.len() > 1).map(open).collect()
    }

    /// The pieces of a line that lie within; none of one that lies beyond.
    pub fn cut(&self, line: &ContourLine) -> Vec<ContourLine> {
        let n = line.points.len();
        // A closed line is walked from a point beyond the border.
        let beyond = line.points.iter().position(|p| self.nearest(*p).1 < 0.0).unwrap_or(0);
        let (start, pieces) = if line.closed { (beyond, n) } else { (0, n - 1) };
        let (mut lines, mut points): (Vec<Polygon>, Polygon) = (Vec::new(), Polygon::new());
        for k in start..start + pieces {
            let Some([from, to]) = self.within(line.points[k % n], line.points[(k + 1) % n]) else { continue };
            if points.last() != Some(&from) {
                lines.push(std::mem::replace(&mut points, vec![from]));
            }
            if to != from {
                points.push(to);
            }
        }
        lines.push(points);
        let open = |points| ContourLine { feature: line.feature.clone(), z: line.z, points, closed: false };
        lines.into_iter().filter(|points| points.len() > 1).map(open).collect()
    }

    /// The part of a straight piece that lies within (Liang and Barsky, 1984).
    fn within(&self, p: DVec2, q: DVec2) -> Option<[DVec2; 2]> {
        let (a, b) = (self.inward(p), self.inward(q));
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for side in 0..4 {
            match (a[side] >= 0.0, b[side] >= 0.0) {
                (true, true) => {}
                (false, false) => return None,
                (false, true) => from = from.max(a[side] / (a[side] - b[side])),
                (true, false) => to = to.min(a[side] / (a[side] - b[side])),
            }
        }
        let at = |t: f64| match t {
            0.0 => p,
            1.0 => q,
            _ => (p + t * (q - p)).clamp(self.low, self.high),
        };
        (from <= to).then(|| [at(from), at(to)])
    }

    /// A line from border to border, closed along it.
    pub fn close(&self, line: &[DVec2]) -> Polygon {
        let (Some(start), Some(end)) = (line.first(), line.last()) else { return Polygon::new() };
        let mut polygon = line.to_vec();
        let (from, mut to) = (self.place(*end), self.place(*start));
        if to < from {
            to += 4.0;
        }
        let corners = self.corners();
        polygon.extend((0..8).filter(|k| f64::from(*k) > from && f64::from(*k) < to).map(|k| corners[k as usize % 4]));
        polygon
    }

    /// Corners, counter-clockwise from the lowest.
    pub fn corners(&self) -> [DVec2; 4] {
        [self.low, self.low.with_x(self.high.x), self.high, self.high.with_x(self.low.x)]
    }

    /// Way round the rectangle to a point of it: corner 0, 1, 2, 3 at whole numbers.
    fn place(&self, p: DVec2) -> f64 {
        let (side, _) = self.nearest(p);
        let [from, to] = [self.corners()[side], self.corners()[(side + 1) % 4]];
        side as f64 + (distance(from, p) / distance(from, to)).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BORDER: Border = Border { low: DVec2::ZERO, high: DVec2::new(10.0, 6.0) };

    #[test]
    fn lines_from_border_to_border_are_closed_along_it() {
        let closed = BORDER.close(&[[0.0, 3.0], [4.0, 3.0], [4.0, 0.0]].map(DVec2::from));
        // From the bottom counter-clockwise round to the left: three corners.
        let wanted = [[0.0, 3.0], [4.0, 3.0], [4.0, 0.0], [10.0, 0.0], [10.0, 6.0], [0.0, 6.0]];
        assert_eq!(closed, wanted.map(DVec2::from));
        let back = BORDER.close(&[[4.0, 0.0], [4.0, 3.0], [0.0, 3.0]].map(DVec2::from));
        assert_eq!(back[3..], [DVec2::ZERO]);
    }

    #[test]
    fn pieces_along_the_border_are_left_out() {
        let ring = [[0.0, 0.0], [5.0, 0.0], [5.0, 6.0], [0.0, 6.0]].map(DVec2::from).to_vec();
        let line = ContourLine { feature: "a".into(), z: 1.0, points: ring, closed: true };
        let left = BORDER.without_sides(line);
        assert_eq!(left.len(), 1);
        assert_eq!(left[0].points, [[5.0, 0.0], [5.0, 6.0]].map(DVec2::from));
    }

    #[test]
    fn an_open_line_loses_its_last_piece_too() {
        let open = |points: &[[f64; 2]]| ContourLine {
            feature: "a".into(),
            z: 1.0,
            points: points.iter().copied().map(DVec2::from).collect(),
            closed: false,
        };
        let left = BORDER.without_sides(open(&[[1.0, 3.0], [4.0, 0.0], [10.0, 0.0]]));
        assert_eq!(left.len(), 1);
        assert_eq!(left[0].points, [[1.0, 3.0], [4.0, 0.0]].map(DVec2::from));
        let inner = open(&[[1.0, 3.0], [4.0, 1.0], [0.0, 5.0]]);
        assert_eq!(BORDER.without_sides(inner.clone())[0].points, inner.points);
    }
}
