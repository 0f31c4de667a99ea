//! Places at which contour lines cross: what lies twice within lines of one elevation is on the other side, and between two elevations the terrain cannot be.

use glam::DVec2;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::join::JoinedMap;
use super::lines::ContourLine;

/// Share of a piece's length by which the ends of another one must lie on both sides of it, and the other way: lines that touch do not cross.
const TOUCHING: f64 = 1e-6;
/// Pairs of pieces that are compared, for each piece: of a map few have their boxes in common, of a scribble all.
const PAIRS: usize = 64;

/// A straight piece, by its line's place and its own in it.
type Piece = [u32; 2];

/// Crossings of a kind.
#[derive(Debug, Clone, Default, PartialEq)]
struct Crossings {
    count: usize,
    /// The first pair of pieces in the lines' order, and where it crosses.
    first: Option<([Piece; 2], DVec2)>,
}

impl Crossings {
    fn add(&mut self, pair: [Piece; 2], at: DVec2) {
        self.count += 1;
        self.first = self.first.filter(|(first, _)| *first < pair).or(Some((pair, at)));
    }
}

/// Notes on lines that cross themselves or others of their elevation, and on those of others, which cross by a pixel at most: more is an error.
pub fn crossings(joined: &JoinedMap) -> Vec<String> {
    let lines: Vec<&ContourLine> = joined.levels.iter().flat_map(|level| &level.lines).collect();
    let ([alike, unlike], all) = found(&lines);
    let places = |count: usize| match (count, all) {
        (1, true) => "1 place".into(),
        (_, true) => format!("{count} places"),
        (_, false) => format!("{count} places or more"),
    };
    let told = |of: &Crossings, what: &str, so: &str| {
        let ([a, b], DVec2 { x, y }) = of.first?;
        let [a, b] = [a, b].map(|[k, _]| &lines[k as usize]).map(|line| format!("{} of {}", line.feature, line.z));
        let who = if a == b { a } else { format!("{a} and {b}") };
        Some(format!("{what} at {}, the first at ({x:.3}, {y:.3}) ({who}): {so}", places(of.count)))
    };
    let same = "lines cross themselves or others of their elevation";
    let outside = "what lies within two of them, or twice within one, counts as outside (even-odd)";
    let other = "lines of different elevations cross";
    let within = "by no more than a pixel, which is let be; heights are off there";
    told(&alike, same, outside).into_iter().chain(told(&unlike, other, within)).collect()
}

/// Crossings of lines of one elevation, and of those of two; and whether all pieces were looked at.
fn found(lines: &[&ContourLine]) -> ([Crossings; 2], bool) {
    let pieces = || lines.iter().zip(0u32..).flat_map(|(line, k)| (0..count(line)).map(move |n| [k, n]));
    let ends = |[k, n]: Piece| {
        let points = &lines[k as usize].points;
        [points[n as usize], points[(n as usize + 1) % points.len()]]
    };
    let boxed = |piece: Piece| {
        let [p, q] = ends(piece).map(|p| p.to_array());
        GeomWithData::new(Rectangle::from_corners(p, q), piece)
    };
    let tree = RTree::bulk_load(pieces().map(boxed).collect());
    let (mut found, mut left) = ([Crossings::default(), Crossings::default()], PAIRS * tree.size());
    for piece in pieces() {
        let [p, q] = ends(piece).map(|p| p.to_array());
        for other in tree.locate_in_envelope_intersecting(AABB::from_corners(p, q)) {
            let Some(less) = left.checked_sub(1) else { return (found, false) };
            left = less;
            // Each pair comes twice.
            if let Some(at) = (other.data > piece).then(|| crossing(ends(piece), ends(other.data))).flatten() {
                let [z, theirs] = [piece, other.data].map(|[k, _]| lines[k as usize].z);
                found[usize::from(z != theirs)].add([piece, other.data], at);
            }
        }
    }
    (found, true)
}

/// Straight pieces of a line.
fn count(line: &ContourLine) -> u32 {
    line.points.len().saturating_sub(usize::from(!line.closed)) as u32
}

/// Where two pieces cross, neither of which ends on the other.
fn crossing([p, q]: [DVec2; 2], [r, s]: [DVec2; 2]) -> Option<DVec2> {
    let [along, across] = [q - p, s - r];
    let apart = |from: DVec2, way: DVec2, ends: [DVec2; 2]| {
        let [a, b] = ends.map(|end| way.perp_dot(end - from));
        let least = TOUCHING * way.length_squared();
        (a.min(b) < -least && a.max(b) > least).then(|| a / (a - b))
    };
    apart(p, along, [r, s])?;
    apart(r, across, [p, q]).map(|t| p + t * along)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(z: f64, points: &[[f64; 2]], closed: bool) -> ContourLine {
        let points = points.iter().copied().map(DVec2::from).collect();
        ContourLine { feature: format!("feature of {z}"), z, points, closed }
    }

    #[test]
    fn lines_that_cross_are_counted_and_those_that_touch_are_not() {
        let square = line(10.0, &[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]], true);
        let eight = line(10.0, &[[10.0, 0.0], [14.0, 4.0], [14.0, 0.0], [10.0, 4.0]], true);
        let over = line(20.0, &[[3.0, 1.0], [5.0, 1.0], [5.0, 3.0], [3.0, 3.0]], true);
        // Beside, at a corner, and with an end on a side.
        let others = [
            line(20.0, &[[0.0, -1.0], [4.0, -1.0], [4.0, -3.0]], true),
            line(20.0, &[[4.0, 4.0], [6.0, 6.0], [4.0, 6.0]], true),
            line(20.0, &[[-2.0, 2.0], [0.0, 2.0]], false),
        ];
        let none = found(&[&square, &others[0], &others[1], &others[2]]);
        assert_eq!(none, ([Crossings::default(), Crossings::default()], true));
        let ([alike, unlike], _) = found(&[&square, &eight, &over]);
        assert_eq!((alike.count, alike.first), (1, Some(([[1, 0], [1, 2]], DVec2::new(12.0, 2.0)))));
        assert_eq!(unlike.count, 2);
        assert_eq!(unlike.first, Some(([[0, 1], [2, 0]], DVec2::new(4.0, 1.0))));
    }

    #[test]
    fn a_scribble_is_looked_at_for_a_while() {
        let way = |k: usize| [(k * 7919 % 10007) as f64, (k * 104_729 % 9973) as f64];
        let scribble = line(10.0, &(0..20_000).map(way).collect::<Vec<_>>(), false);
        let ([alike, _], all) = found(&[&scribble]);
        assert!(alike.count > 1000 && !all, "{}", alike.count);
    }
}
