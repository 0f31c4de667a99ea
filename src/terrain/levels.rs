//! Regions of closed lines: which side is uphill, and whether the levels lie inside each other.

use glam::DVec2;
use rayon::prelude::*;

use super::below::{Region, floor};
use super::border::Border;
use super::join::{Elevation, JoinedMap};
use super::lines::{ContourLine, distance};
use super::onward;
use super::project;
use crate::error::Error;
use crate::grid::field::sample;
use crate::grid::tile::Tile;
use crate::polygons::Polygon;
use crate::polygons::grid::DrawingGrid;
use crate::polygons::level_set;
use crate::stack::options::Below;
use crate::stack::{self, ContourStack, Geometry, Known, Slice, SliceContent};
use crate::surface::length;
use crate::surface::map::{Crs, Floor, Map};

/// Lines may lie this far, px, on the wrong side of another level's: they touch on cliffs, and are drawn by hand.
const CROSSING: f64 = 1.0;
/// Part of a pixel by which the border may lie beyond the outermost centres.
const SLACK: f64 = 1e-6;

/// Faults that there can be.
pub enum Wrong {
    /// The lines, as the message says.
    Lines(String),
    /// All else.
    Other(Error),
}

impl From<Error> for Wrong {
    fn from(error: Error) -> Self {
        Wrong::Other(error)
    }
}

/// The regions that are at least as high as each level, as level sets on a grid that goes beyond the border, and the part within it.
///
/// # Errors
/// Lines of different levels that cross, or lie on the wrong side of each other; a pixel size that is too small.
pub fn stack(joined: &JoinedMap, pixel: f64, crs: Crs, below: Option<Below>) -> Result<(ContourStack, Map), Wrong> {
    let (outer, closed) = onward::go_on(&joined.border, &joined.levels, pixel);
    let grid = DrawingGrid::over([outer.low, outer.high], DVec2::splat(pixel), joined.levels.len())?;
    let mut map = window(&joined.border, &grid, crs)?;
    let slices = joined.levels.par_iter().zip(&closed).map(|(level, closed)| {
        let region = region(level, closed, joined, &outer, &grid).map_err(Wrong::Lines)?;
        let name = format!("level {}", level.z);
        let content = stack::LevelSlice::new(&region, grid.dims[0]);
        Ok(Slice { name, z: level.z, extra: false, content: SliceContent::Level(content) })
    });
    let slices = slices.collect::<Result<Vec<Slice>, Wrong>>()?;
    let lowest: Vec<Region<'_>> = joined
        .levels
        .iter()
        .zip(&slices)
        .take(2)
        .map(|(level, slice)| Region { level, content: &slice.content })
        .collect();
    map.floor = floor(below, &lowest, &grid, &map)?;
    if let [only] = &joined.levels[..] {
        let message =
            format!("all of its lines lie at {}; contour lines of at least two elevations are needed", only.z);
        return Err(Wrong::Lines(message));
    }
    let stack = ContourStack {
        dims: grid.dims,
        spacing: grid.spacing.to_array(),
        unit: length::named(project::metres(&map.crs).unwrap_or(1.0)),
        slices,
        z_out: None,
        geometry: Geometry { origin: grid.origin.extend(0.0), ..Geometry::default() },
        known: Some(Known { part: Tile { origin: map.first, dims: map.dims }, onward: onward::COURSE }),
    };
    Ok((stack, map))
}

/// Pixels between whose centres every place within the border lies.
fn window(border: &Border, grid: &DrawingGrid, crs: Crs) -> Result<Map, Error> {
    let first = [grid.column(border.low.x), grid.row(border.low.y)].map(|v| (v + SLACK).floor().max(0.0) as usize);
    let last = [grid.column(border.high.x), grid.row(border.high.y)].map(|v| (v - SLACK).ceil().max(0.0) as usize);
    if (border.high - border.low).min_element() < grid.spacing.x {
        let message = format!("must be smaller: no two pixels of {} lie within the border", grid.spacing.x);
        return Err(Error::Setting { name: "pixel".into(), message });
    }
    let dims = [0, 1].map(|a| last[a] + 1 - first[a]);
    Ok(Map { crs, first, dims, floor: Floor::default() })
}

/// The level set of what is at least as high as a level; `closed` its lines from border to border, gone on and closed.
fn region(
    level: &Elevation,
    closed: &[Polygon],
    joined: &JoinedMap,
    outer: &Border,
    grid: &DrawingGrid,
) -> Result<Vec<f32>, String> {
    let mut polygons: Vec<Polygon> = level.rings.clone();
    polygons.extend_from_slice(closed);
    let set = level_set(std::slice::from_ref(&polygons), grid);
    let touching = CROSSING * grid.spacing.x;
    let mut uphill = 0i64;
    for other in joined.levels.iter().filter(|l| l.z != level.z) {
        let side = if other.z > level.z { 1 } else { -1 };
        let mut vote = |_: &ContourLine, _: DVec2, depth: f64| {
            uphill -= side * i64::from(depth > touching);
            uphill += side * i64::from(depth < -touching);
            true
        };
        walk(other, &set, grid, &mut vote);
    }
    let set = match uphill {
        1.. => set,
        0 if joined.levels.len() > 1 => {
            return Err(format!("level {}: the lines of no other level lie clearly on one side of its own", level.z));
        }
        0 => set,
        _ => {
            polygons.push(outer.corners().to_vec());
            level_set(&[polygons], grid)
        }
    };
    for other in joined.levels.iter().filter(|l| l.z != level.z) {
        let side = if other.z > level.z { 1.0 } else { -1.0 };
        let mut wrong = None;
        walk(other, &set, grid, &mut |line, p, depth| {
            let good = side * depth <= touching;
            if !good {
                wrong = Some((line.feature.clone(), p));
            }
            good
        });
        if let Some((feature, p)) = wrong {
            return Err(crossing(level, other.z, &feature, p, grid.spacing.x));
        }
    }
    Ok(set)
}

/// Calls `see` with points of the level's lines, at most a pixel apart, and their distance from the region of `set`, negative inside; until
/// it says false.
fn walk(level: &Elevation, set: &[f32], grid: &DrawingGrid, see: &mut dyn FnMut(&ContourLine, DVec2, f64) -> bool) {
    for line in &level.lines {
        let back = line.closed.then(|| [line.points[line.points.len() - 1], line.points[0]]);
        for [p, q] in line.points.windows(2).map(|w| [w[0], w[1]]).chain(back) {
            let steps = (distance(p, q) / grid.spacing.x).ceil().max(1.0) as usize;
            for k in 0..steps {
                let t = k as f64 / steps as f64;
                let x = p + t * (q - p);
                let depth = sample(set, grid.dims, DVec2::new(grid.column(x.x), grid.row(x.y)));
                if !see(line, x, depth) {
                    return;
                }
            }
        }
    }
}

fn crossing(level: &Elevation, z: f64, feature: &str, p: DVec2, pixel: f64) -> String {
    let from = |line: &ContourLine| line.points.iter().map(|q| distance(p, *q)).fold(f64::INFINITY, f64::min);
    let nearest = level.lines.iter().min_by(|a, b| from(a).total_cmp(&from(b)));
    let of = nearest.map_or(String::new(), |line| format!(", the nearest of which is {}", line.feature));
    let side = if z > level.z { "below" } else { "above" };
    format!(
        "{feature}: its line of {z} lies {side} the lines of {} at ({}, {}) by more than {pixel} (a pixel){of}: they cross, or a line is \
         missing or has a wrong elevation (contours of a body that is no height field are not read as a map; `.contours.json` keeps them)",
        level.z, p.x, p.y
    )
}

/// A note on closed lines that the pixels cannot show.
pub fn too_small(joined: &JoinedMap, pixel: f64) -> Option<String> {
    let rings = joined.levels.iter().flat_map(|l| &l.rings);
    let small = rings.filter(|ring| area(ring).abs() < pixel * pixel).count();
    (small > 0)
        .then(|| format!("{small} closed lines are smaller than a pixel and may be lost; a smaller --pixel keeps them"))
}

/// Signed area, about the first point.
fn area(ring: &[DVec2]) -> f64 {
    let o = ring[0];
    ring.windows(2).map(|w| (w[0] - o).perp_dot(w[1] - o)).sum::<f64>() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: DrawingGrid = DrawingGrid { origin: DVec2::new(-1.0, 3.0), spacing: DVec2::splat(0.5), dims: [40, 30] };

    /// A linear function on the grid.
    fn plane(at: impl Fn(DVec2) -> f64) -> Vec<f32> {
        let [nx, ny] = GRID.dims;
        let centre = |n: usize| GRID.origin + GRID.spacing * DVec2::new((n % nx) as f64, (n / nx) as f64);
        (0..nx * ny).map(|n| at(centre(n)) as f32).collect()
    }

    #[test]
    fn lines_are_walked_in_steps_of_a_pixel_at_most() {
        let at = |p: DVec2| 0.25 * p.x - 0.5 * p.y + 1.0;
        let points: Vec<DVec2> =
            [[2.0, 4.0], [2.9, 4.0], [2.9, 8.3], [3.0, 8.3]].into_iter().map(DVec2::from).collect();
        for closed in [false, true] {
            let line = ContourLine { feature: "a".into(), z: 1.0, points: points.clone(), closed };
            let level = Elevation { z: 1.0, lines: vec![line], rings: Vec::new(), open: Vec::new() };
            let mut seen = Vec::new();
            walk(&level, &plane(at), &GRID, &mut |_, p, depth| {
                assert!((depth - at(p)).abs() < 1e-5, "{depth} at {p}");
                seen.push(p);
                true
            });
            assert!(points[..3].iter().all(|p| seen.contains(p)));
            let ends = if closed { [seen[seen.len() - 1], seen[0]] } else { [points[3]; 2] };
            let longest = seen.windows(2).map(|w| w[0].distance(w[1])).fold(ends[0].distance(ends[1]), f64::max);
            assert!(longest <= 0.5 + 1e-9, "{longest}");
            let mut first = 0;
            walk(&level, &plane(at), &GRID, &mut |_, _, _| {
                first += 1;
                first < 4
            });
            assert_eq!(first, 4, "it stops where it is told to");
        }
    }
}
