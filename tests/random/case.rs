//! Random stacks: 2 to 7 slices of several parts, with all that a person may draw.

use std::fmt;

use glam::DVec2;
use interslice::Settings;
use interslice::grid::components;
use interslice::polygons::{self, PlaneDrawing, Planes, Polygon};
use interslice::stack::{ContourStack, Geometry, LevelSlice, Slice, SliceContent};

use super::numbers::Numbers;
use super::parts::{Outline, Part};

/// A stack with the settings it is reconstructed by.
#[derive(Clone)]
pub struct Case {
    pub seed: u64,
    pub stack: ContourStack,
    pub settings: Settings,
}

/// What a property draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Anything.
    Any,
    /// One part that overlaps itself on the next slice, without holes: nothing happens between slices.
    Calm,
    /// Discs about one centre, some perhaps equal, slices perhaps empty.
    Discs,
    /// A disc that drifts, on pixels up to eight times as long as wide.
    Sheared,
    /// Lines about a pixel wide that cross.
    Lines,
}

/// How slices say where their contours are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Drawn {
    Masks,
    Levels,
    Polygons,
}

/// The stack of a seed. Whoever changes what is drawn gives all seeds other stacks: those of `tests/promises/fallen_seeds.txt` must be found anew.
pub fn stack(n: &mut Numbers, kind: Kind) -> ContourStack {
    let slices = if kind == Kind::Lines { n.whole(2, 4) } else { n.whole(2, 7) };
    let side = n.of(&[1.0, 1.0, 1.0, 0.25, 3.7]);
    // Up to eight times as long as wide, both ways.
    let aspect = match kind {
        Kind::Any if n.chance(0.5) => n.ratio(1.0 / 8.0, 8.0),
        Kind::Sheared => n.ratio(1.0 / 8.0, 8.0),
        _ => 1.0,
    };
    let spacing = if aspect < 1.0 { [side * aspect, side] } else { [side, side / aspect] };
    let dims = match kind {
        // Room beside the body along the short side, beyond the tile around it.
        Kind::Sheared if aspect < 1.0 => [n.whole(90, 120), n.whole(24, 32)],
        Kind::Sheared => [n.whole(24, 32), n.whole(90, 120)],
        _ => [(); 2].map(|()| n.whole(36, 56)),
    };
    // Round in space, or round in pixels.
    let scale = if kind == Kind::Sheared || n.chance(0.5) {
        let mean = (spacing[0] * spacing[1]).sqrt();
        spacing.map(|h| h / mean)
    } else {
        [1.0; 2]
    };
    let parts = parts(n, kind, dims, slices);
    let heights = heights(n, slices, side);
    let empty: Vec<usize> = (0..slices).filter(|_| matches!(kind, Kind::Any | Kind::Discs) && n.chance(0.06)).collect();
    let drawn = match (kind, n.whole(0, 9)) {
        (Kind::Any | Kind::Calm, 0..=1) => Drawn::Levels,
        (Kind::Any | Kind::Calm, 2) => Drawn::Polygons,
        _ => Drawn::Masks,
    };
    let on = |k: usize| parts.iter().filter(move |p| p.on(k));
    if drawn == Drawn::Polygons {
        let corners = n.whole(12, 60);
        let outline = |part: &Part, k: usize, centre: [f64; 2]| {
            let place = |p: [f64; 2]| DVec2::from([0, 1].map(|a| spacing[a] * (centre[a] + p[a] / scale[a])));
            part.polygon(k, corners).into_iter().map(place).collect::<Polygon>()
        };
        let drawings: Vec<PlaneDrawing> = (0..slices)
            .map(|k| {
                let polygons =
                    on(k).filter(|_| !empty.contains(&k)).flat_map(|p| p.centres(k).into_iter().map(move |c| (p, c)));
                let region = polygons.map(|(p, c)| outline(p, k, c)).collect();
                PlaneDrawing { name: format!("plane {k}"), z: heights[k], extra: false, regions: vec![region] }
            })
            .collect();
        let planes = Planes { unit: "mm".into(), axes: Geometry::default().axes, z_out: None };
        if let Ok(stack) = polygons::stack(&drawings, &planes, Some(spacing))
            && stack.validate().is_ok()
        {
            return stack;
        }
    }
    let value = |k: usize, x: f64, y: f64| {
        let mut value = f64::INFINITY;
        for part in on(k) {
            for c in part.centres(k) {
                // A pixel is drawn on a pixel.
                let c = if part.outline == Outline::Pixel { c.map(f64::round) } else { c };
                let scale = if part.outline == Outline::Pixel { [1.0; 2] } else { scale };
                let v = part.about(k, [(x - c[0]) * scale[0], (y - c[1]) * scale[1]]);
                value = if part.cut { value.max(-v) } else { value.min(v) };
            }
        }
        value.min(dims[0] as f64)
    };
    let mut contents: Vec<Vec<f64>> = (0..slices)
        .map(|k| {
            let values = (0..dims[1]).flat_map(|j| (0..dims[0]).map(move |i| (i as f64, j as f64)));
            values.map(|(x, y)| if empty.contains(&k) { 1.0 } else { value(k, x, y) }).collect()
        })
        .collect();
    if contents.iter().flatten().all(|v| *v >= 0.0) {
        let middle = dims.map(|d| 0.5 * d as f64);
        let disc = |n: usize| ((n % dims[0]) as f64 - middle[0]).hypot((n / dims[0]) as f64 - middle[1]) - 6.3;
        contents[slices / 2] = (0..dims[0] * dims[1]).map(disc).collect();
    }
    let slices = contents.into_iter().enumerate().map(|(k, values)| {
        let content = match drawn {
            Drawn::Levels => {
                SliceContent::Level(LevelSlice::new(&values.iter().map(|v| *v as f32).collect::<Vec<_>>(), dims[0]))
            }
            _ => SliceContent::Mask(values.iter().map(|v| *v < 0.0).collect()),
        };
        Slice { name: format!("slice {k}"), z: heights[k], extra: false, content }
    });
    let slices = slices.collect();
    ContourStack { dims, spacing, unit: "mm".into(), slices, z_out: None, geometry: Geometry::default(), known: None }
}

fn parts(n: &mut Numbers, kind: Kind, dims: [usize; 2], slices: usize) -> Vec<Part> {
    let middle = dims.map(|d| 0.5 * (d - 1) as f64);
    match kind {
        Kind::Any => {
            let mut parts = Vec::new();
            for _ in 0..n.whole(1, 4) {
                let part = Part::draw(n, dims, slices);
                let hole = n.chance(0.3).then(|| part.cut_out(n));
                parts.push(part);
                parts.extend(hole);
            }
            parts
        }
        Kind::Calm => vec![Part::calm(n, dims, slices)],
        Kind::Discs => {
            let mut radius = n.between(5.0, 15.0);
            let disc = |k: usize| {
                if k > 0 && !n.chance(0.4) {
                    radius = n.between(4.0, 16.0);
                }
                let still = Part { branch: None, outline: Outline::Ellipse(1.0), ..Part::draw(n, dims, slices) };
                Part { first: k, last: k, centre: middle, drift: [0.0; 2], radius, growth: 0.0, ..still }
            };
            (0..slices).map(disc).collect()
        }
        Kind::Sheared => {
            let small = dims[0].min(dims[1]) as f64;
            let part = Part { outline: Outline::Ellipse(1.0), growth: 0.0, ..Part::calm(n, dims, slices) };
            let reach = 0.25 * small / slices as f64;
            let drift = [(); 2].map(|()| n.between(-reach, reach));
            let back = 0.5 * (slices - 1) as f64;
            vec![Part { centre: [0, 1].map(|a| middle[a] - back * drift[a]), drift, ..part }]
        }
        Kind::Lines => (0..slices)
            .map(|k| {
                let line = Outline::Line(n.of(&[1.0, 1.0, 1.5, 2.2]));
                let part = Part { outline: line, branch: None, ..Part::draw(n, dims, slices) };
                let centre = middle.map(|m| m + n.between(-4.0, 4.0));
                Part { first: k, last: k, centre, drift: [0.0; 2], radius: n.between(5.0, 8.0), growth: 0.0, ..part }
            })
            .collect(),
    }
}

/// Gaps of 0.1 to 30 px.
fn heights(n: &mut Numbers, slices: usize, side: f64) -> Vec<f64> {
    let gap = |n: &mut Numbers| side * if n.chance(0.6) { n.between(2.0, 12.0) } else { n.ratio(0.1, 30.0) };
    let first = side * n.between(-20.0, 20.0);
    let equal = n.chance(0.5).then(|| gap(n));
    let mut heights = vec![first];
    for k in 1..slices {
        heights.push(heights[k - 1] + equal.unwrap_or_else(|| gap(n)));
    }
    heights
}

/// Whether nothing happens between slices: on each is one part, without holes, and it overlaps that of the next one.
pub fn without_events(stack: &ContourStack) -> bool {
    let sides: Vec<Vec<bool>> = stack.slices.iter().map(|s| s.content.sides()).collect();
    let whole = |inside: &Vec<bool>| {
        // What is beyond the image joins all outside that reaches its border.
        let [nx, ny] = stack.dims;
        let outside = |k: usize| {
            let (i, j) = (k % (nx + 2), k / (nx + 2));
            i == 0 || j == 0 || i > nx || j > ny || !inside[(j - 1) * nx + i - 1]
        };
        let around: Vec<bool> = (0..(nx + 2) * (ny + 2)).map(outside).collect();
        components::label4(inside, stack.dims).count == 1 && components::label8(&around, [nx + 2, ny + 2]).count == 1
    };
    sides.iter().all(whole) && sides.windows(2).all(|w| w[0].iter().zip(&w[1]).any(|(a, b)| *a && *b))
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ContourStack { dims, spacing, .. } = &self.stack;
        writeln!(f, "seed {}: {}x{} px of {spacing:?}", self.seed, dims[0], dims[1])?;
        let settings = serde_json::to_value(&self.settings).map_err(|_| fmt::Error)?;
        let default = serde_json::to_value(Settings::default()).map_err(|_| fmt::Error)?;
        let differ = settings.as_object().into_iter().flatten().filter(|(k, v)| default[k.as_str()] != **v);
        writeln!(f, "settings{}", differ.map(|(k, v)| format!(" {k}={v}")).collect::<String>())?;
        for slice in &self.stack.slices {
            let kind = if matches!(slice.content, SliceContent::Mask(_)) { "mask" } else { "level" };
            writeln!(f, "{} ({kind}) at {}", slice.name, slice.z)?;
            let side = |i: usize, j: usize| j < dims[1] && slice.content.inside(j * dims[0] + i);
            for j in (0..dims[1]).step_by(2) {
                let row = (0..dims[0])
                    .map(|i| [[' ', '▄'], ['▀', '█']][usize::from(side(i, j))][usize::from(side(i, j + 1))]);
                let row: String = row.collect();
                if !row.trim().is_empty() {
                    writeln!(f, "{j:3} {}", row.trim_end())?;
                }
            }
        }
        Ok(())
    }
}
