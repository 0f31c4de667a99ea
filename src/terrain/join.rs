//! Lines of one elevation, joined end to end: closed, or from border to border.

use std::collections::BTreeMap;

use glam::DVec2;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use super::border::Border;
use super::hull::Hull;
use super::lines::{ContourLine, distance};
use super::loose::{self, LooseEnd};
use crate::polygons::Polygon;
use crate::stack::options::{Around, MapBorder};

/// Ends this close, px, are one, and lie on the border.
pub const TOLERANCE: f64 = 0.5;
/// Share of the map's longer side by which an end may lie inside the hull of all lines: lines that a slanted or ragged edge has cut.
const NEAR: f64 = 0.01;
/// Longest gap, px, across which two ends that meet nothing else are joined, where no third one is less than twice as far away.
pub const GAP: f64 = 2.0;
/// A line closes upon itself across a gap that is at most this share of its length: else it is a piece that belongs elsewhere.
const OWN_GAP: f64 = 0.25;
/// Share of the box around closed lines along which they may run and yet do not end there: that of a flat top or two.
const FREE: f64 = 0.125;
/// Ends that are looked at around each: where more meet, they are no contours, and all pairs of them would be too many.
const MOST_NEAR: usize = 16;

/// The lines of one elevation.
#[derive(Debug)]
pub struct Elevation {
    /// Elevation.
    pub z: f64,
    /// Lines as they came, without pieces along the border.
    pub lines: Vec<ContourLine>,
    /// Closed lines.
    pub rings: Vec<Polygon>,
    /// Lines from border to border.
    pub open: Vec<Polygon>,
}

/// All levels, lowest first.
#[derive(Debug)]
pub struct JoinedMap {
    /// Border of the map.
    pub border: Border,
    /// By elevation.
    pub levels: Vec<Elevation>,
}

impl JoinedMap {
    /// Description of the map, in a few lines.
    pub fn describe(&self, field: &str, features: usize) -> Vec<String> {
        let sum = |of: fn(&Elevation) -> usize| self.levels.iter().map(of).sum::<usize>();
        let ends = [self.levels.first(), self.levels.last()].map(|l| l.map_or(f64::NAN, |l| l.z));
        let Border { low, high } = self.border;
        vec![
            format!("contour map of {features} features, elevation from {field}"),
            format!(
                "{} levels, {} to {}; {} lines make {} closed ones and {} from border to border",
                self.levels.len(),
                ends[0],
                ends[1],
                sum(|l| l.lines.len()),
                sum(|l| l.rings.len()),
                sum(|l| l.open.len())
            ),
            format!("border {}, {} to {}, {}", low.x, low.y, high.x, high.y),
        ]
    }
}

/// Where lines may end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Edges {
    /// At the box around all lines, and near their hull, from where they go on to the box.
    Near,
    /// At the box around all lines.
    Box,
    /// Anywhere: they go on from the hull to the box.
    Hull,
    /// At this border.
    Given(Border),
}

impl Edges {
    /// Those that the options ask for.
    ///
    /// # Errors
    /// The errors of [`Border::given`].
    pub fn of(asked: Option<&MapBorder>) -> crate::Result<Self> {
        Ok(match asked {
            None => Edges::Near,
            Some(MapBorder::Around(Around::Box)) => Edges::Box,
            Some(MapBorder::Around(Around::Hull)) => Edges::Hull,
            Some(MapBorder::Given(values)) => Edges::Given(Border::given(values)?),
        })
    }
}

/// Joins the lines of each elevation; the border is the box around them where none is given, a pixel farther out where all lines are closed.
///
/// # Errors
/// A message with feature, coordinates and distances of the lines that end farthest inside the map.
pub fn join(lines: Vec<ContourLine>, edges: &Edges, pixel: f64, notes: &mut Vec<String>) -> Result<JoinedMap, String> {
    let given = match edges {
        Edges::Given(border) => Some(*border),
        _ => None,
    };
    let border = given.unwrap_or_else(|| Border::around(&lines));
    let tolerance = TOLERANCE * pixel;
    let beyond = |line: &ContourLine| line.points.iter().any(|p| border.nearest(*p).1 < -tolerance);
    let (cut, mut lines): (Vec<ContourLine>, Vec<ContourLine>) = lines.into_iter().partition(beyond);
    if !cut.is_empty() {
        notes.push(format!("{} lines go beyond the border and are cut there", cut.len()));
        lines.extend(cut.iter().flat_map(|line| border.cut(line)));
    }
    if lines.is_empty() {
        let Border { low, high } = border;
        return Err(format!("has no lines within the border {}, {} to {}, {}", low.x, low.y, high.x, high.y));
    }
    let hull =
        matches!(edges, Edges::Near | Edges::Hull).then(|| Hull::around(lines.iter().flat_map(|line| &line.points)));
    // Where all lines are closed and no border is given, none is cut: what touches the box touches nothing. But regions of several elevations that run
    // along it far were cut there: those of a body lie inside each other.
    let at_box = along_box(&lines, &border, pixel);
    if let (None, Some(count)) = (given, at_box) {
        notes.push(format!(
            "polygons of {count} elevations run along the box around all: they are taken to be cut there, and the terrain to go on beyond; with \
             `--border` around the box they end there"
        ));
    }
    let bordered = given.is_some() || at_box.is_some() || lines.iter().any(|l| !l.closed);
    let mut by_level: BTreeMap<u64, Elevation> = BTreeMap::new();
    let length = |lines: &[ContourLine]| {
        lines.iter().flat_map(|l| l.points.windows(2)).map(|w| distance(w[0], w[1])).sum::<f64>()
    };
    let mut along: BTreeMap<u64, f64> = BTreeMap::new();
    for line in lines {
        // Bits of floats that are turned so that they sort as the numbers do.
        let bits = (line.z + 0.0).to_bits();
        let key = if bits >> 63 == 1 { !bits } else { bits | 1 << 63 };
        let level = by_level.entry(key).or_insert_with(|| Elevation {
            z: line.z + 0.0,
            lines: Vec::new(),
            rings: Vec::new(),
            open: Vec::new(),
        });
        if !bordered {
            level.lines.push(line);
            continue;
        }
        let (closed, whole) = (line.closed, length(std::slice::from_ref(&line)));
        let left = border.without_sides(line);
        // Rings of polygons run along the border where they are cut; what is drawn there as a line says a height.
        *along.entry(key).or_default() += if closed { 0.0 } else { whole - length(&left) };
        level.lines.extend(left);
    }
    for (key, level) in by_level.iter().filter(|(_, level)| !level.lines.is_empty()) {
        let lost = along.get(key).filter(|lost| **lost > tolerance);
        notes.extend(
            lost.map(|lost| format!("level {}: its lines run along the border for {lost:.3}; left out there", level.z)),
        );
    }
    let mut levels: Vec<Elevation> = by_level.into_values().collect();
    levels.retain(|level| {
        let none = level.lines.is_empty();
        if none {
            notes.push(format!("level {}: its lines run along the border only; left out", level.z));
        }
        !none
    });
    let near = match edges {
        Edges::Hull => f64::INFINITY,
        _ => (NEAR * (border.high - border.low).max_element()).max(tolerance),
    };
    let ([mut continued, mut gaps], mut loose) = ([Lengths::default(); 2], Vec::new());
    for level in &mut levels {
        let beyond = |p: DVec2| {
            let (distance, reached) = hull.as_ref()?.beyond(p, &border)?;
            (distance <= near).then_some((distance, reached))
        };
        match chains(level, &border, tolerance, &beyond) {
            Ok(made) => [continued, gaps] = [continued.with(made[0]), gaps.with(made[1])],
            Err(ends) => loose.extend(ends),
        }
    }
    if !loose.is_empty() {
        return Err(loose::dangling(loose, *edges == Edges::Near, tolerance));
    }
    if let Lengths { count: count @ 1.., most } = continued {
        notes.push(format!(
            "{count} ends of lines are inside the box around all lines, up to {most:.3} inside their hull; the lines go on straight to the box"
        ));
    }
    if let Lengths { count: count @ 1.., most } = gaps {
        let which = if count == 1 { "1 gap of a line is" } else { &format!("{count} gaps of lines are") };
        notes.push(format!("{which} closed straight, no other end being near: up to {most:.3} long"));
    }
    // Where all lines are closed the map goes on around them, so that each has pixels on both sides. Regions that end at the box run along it far.
    let all_closed = given.is_none() && levels.iter().all(|level| level.open.is_empty());
    let along: f64 = levels.iter().flat_map(|level| &level.rings).map(|ring| border.along(ring)).sum();
    let is_free = all_closed && along < FREE * border.perimeter();
    Ok(JoinedMap { border: if is_free { border.grown(pixel) } else { border }, levels })
}

/// How many elevations closed lines have that run along the box around all lines, where all lines are closed, and those of several elevations run along
/// it far.
fn along_box(lines: &[ContourLine], border: &Border, pixel: f64) -> Option<usize> {
    if lines.iter().any(|line| !line.closed) {
        return None;
    }
    let along = lines.iter().map(|line| (line.z, border.along(&line.points))).filter(|(_, along)| *along > pixel);
    let (mut levels, lengths): (Vec<f64>, Vec<f64>) = along.unzip();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    (levels.len() > 1 && lengths.iter().sum::<f64>() >= FREE * border.perimeter()).then_some(levels.len())
}

/// How many lengths there are, and the longest.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Lengths {
    count: usize,
    most: f64,
}

impl Lengths {
    fn of(lengths: impl Iterator<Item = f64>) -> Self {
        lengths.fold(Lengths::default(), |all, most| all.with(Lengths { count: 1, most }))
    }

    fn with(self, other: Self) -> Self {
        Lengths { count: self.count + other.count, most: self.most.max(other.most) }
    }
}

/// Thing that an end of a line meets.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mate {
    Border,
    End(usize),
}

/// The level's lines end to end. End `2 k` is where line `k` begins, end `2 k + 1` where it stops. How far inside the hull ends lie that go on to
/// the border, and how long gaps are that were closed.
fn chains(
    level: &mut Elevation,
    border: &Border,
    tolerance: f64,
    beyond: &impl Fn(DVec2) -> Option<(f64, DVec2)>,
) -> Result<[Lengths; 2], Vec<LooseEnd>> {
    level.rings = level.lines.iter().filter(|l| l.closed).map(|l| l.points.clone()).collect();
    let open: Vec<&ContourLine> = level.lines.iter().filter(|l| !l.closed).collect();
    let ends: Vec<DVec2> = open.iter().flat_map(|l| [l.points[0], l.points[l.points.len() - 1]]).collect();
    let mut continued: Vec<Option<(f64, DVec2)>> = vec![None; ends.len()];
    let closes = |line: usize, gap: f64| {
        gap <= OWN_GAP * open[line].points.windows(2).map(|w| distance(w[0], w[1])).sum::<f64>()
    };
    let (mates, gaps) = mates(&ends, border, tolerance, beyond, &closes, &mut continued)
        .map_err(|loose| loose.into_iter().map(|end| LooseEnd::of(end, &ends, &open, border)).collect::<Vec<_>>())?;
    let mut used = vec![false; open.len()];
    let mut walk = |from: usize| {
        let (mut chain, mut end) = (Polygon::new(), from);
        let reached = |end: usize| continued[end].map(|(_, reached)| reached);
        loop {
            let line = end / 2;
            if used[line] {
                return chain;
            }
            used[line] = true;
            if chain.is_empty() {
                chain.extend(reached(end));
            }
            let points = open[line].points.iter().copied();
            if end % 2 == 0 {
                chain.extend(points)
            } else {
                chain.extend(points.rev())
            }
            match mates[end ^ 1] {
                Mate::Border => {
                    chain.extend(reached(end ^ 1));
                    return chain;
                }
                Mate::End(next) => end = next,
            }
        }
    };
    let at_border = |end: &usize| mates[*end] == Mate::Border;
    level.open = (0..ends.len()).filter(at_border).map(&mut walk).collect();
    // Chains that were walked from their other end are empty.
    level.open.retain(|chain| !chain.is_empty());
    for end in (0..ends.len()).step_by(2) {
        level.rings.push(walk(end));
    }
    level.rings.retain(|ring| ring.len() > 2);
    Ok([Lengths::of(continued.iter().flatten().map(|(distance, _)| *distance)), Lengths::of(gaps.into_iter())])
}

/// Things that the ends meet: the nearest pairs first. What meets none may go on `beyond` itself, to the border; where is put into `continued`.
/// What then meets none may be one side of a gap; the lengths of gaps are returned too.
///
/// # Errors
/// The ends that meet nothing.
fn mates(
    ends: &[DVec2],
    border: &Border,
    tolerance: f64,
    beyond: &impl Fn(DVec2) -> Option<(f64, DVec2)>,
    closes: &impl Fn(usize, f64) -> bool,
    continued: &mut [Option<(f64, DVec2)>],
) -> Result<(Vec<Mate>, Vec<f64>), Vec<usize>> {
    let tree = RTree::bulk_load(ends.iter().enumerate().map(|(k, p)| GeomWithData::new(p.to_array(), k)).collect());
    let mut pairs: Vec<(f64, usize, Mate)> = Vec::new();
    for (k, p) in ends.iter().enumerate() {
        let beside = border.nearest(*p).1.abs();
        if beside <= tolerance {
            pairs.push((beside, k, Mate::Border));
        }
        let near = tree.nearest_neighbor_iter_with_distance_2(p.to_array()).take(1 + MOST_NEAR);
        let near = near.take_while(|(_, squared)| *squared <= tolerance * tolerance).map(|(other, _)| other);
        let near = near.filter(|other| other.data != k);
        pairs.extend(
            near.map(|other| (distance(*p, ends[other.data]), k.min(other.data), Mate::End(k.max(other.data)))),
        );
    }
    let rank = |mate: &Mate| match mate {
        Mate::End(k) => *k,
        Mate::Border => usize::MAX,
    };
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(rank(&a.2).cmp(&rank(&b.2))).then(a.1.cmp(&b.1)));
    // Most pairs were found from both their ends.
    pairs.dedup();
    let mut mates: Vec<Option<Mate>> = vec![None; ends.len()];
    for (_, k, mate) in pairs {
        let free = mates[k].is_none() && !matches!(mate, Mate::End(other) if mates[other].is_some());
        if free {
            mates[k] = Some(mate);
            if let Mate::End(other) = mate {
                mates[other] = Some(Mate::End(k));
            }
        }
    }
    for (k, mate) in mates.iter_mut().enumerate().filter(|(_, mate)| mate.is_none()) {
        continued[k] = beyond(ends[k]);
        *mate = continued[k].map(|_| Mate::Border);
    }
    let loose: Vec<usize> = (0..ends.len()).filter(|k| mates[*k].is_none()).collect();
    let mut gaps = Vec::new();
    for (a, b) in facing(&loose, ends, 2.0 * GAP * tolerance, closes) {
        gaps.push(distance(ends[a], ends[b]));
        [mates[a], mates[b]] = [Some(Mate::End(b)), Some(Mate::End(a))];
    }
    let loose: Vec<usize> = loose.into_iter().filter(|k| mates[*k].is_none()).collect();
    if loose.is_empty() { Ok((mates.into_iter().flatten().collect(), gaps)) } else { Err(loose) }
}

/// Pairs of loose ends that are each other's nearest, no farther apart than `longest`, with no third one within twice their distance; those of one
/// line where it `closes`.
fn facing(loose: &[usize], ends: &[DVec2], longest: f64, closes: &impl Fn(usize, f64) -> bool) -> Vec<(usize, usize)> {
    let tree = RTree::bulk_load(loose.iter().map(|k| GeomWithData::new(ends[*k].to_array(), *k)).collect());
    let nearest = |k: usize| {
        let mut others = tree.nearest_neighbor_iter(ends[k].to_array()).map(|p| p.data).filter(|other| *other != k);
        let (first, second) = (others.next()?, others.next());
        let away = distance(ends[k], ends[first]);
        let alone = second.is_none_or(|other| distance(ends[k], ends[other]) >= 2.0 * away);
        let is_line = first / 2 != k / 2 || closes(k / 2, away);
        (away <= longest && alone && is_line).then_some(first)
    };
    let pair =
        |k: &usize| nearest(*k).filter(|other| k < other && nearest(*other) == Some(*k)).map(|other| (*k, other));
    loose.iter().filter_map(pair).collect()
}
