//! A mesh ten million pixels from the world's origin is closed and has its shape when it is read back.

use std::collections::HashMap;
use std::fs;

use glam::DVec3;

use super::{Case, Checked, Fault, Property, any, made, numbers, within};
use crate::random::measure::px;
use crate::random::ply;
use crate::random::settings::any_heights;
use crate::random::source::Source;
use crate::support::{edge_defects, write};

/// Layers in every interval.
const PARTS: usize = 3;
/// Distance from the origin along each axis, px.
const FAR: f64 = 1e7;

pub const PROPERTY: Property = Property {
    name: "closed_far_away",
    draw: |seed| {
        let mut case = any(seed);
        let mut n = numbers(&case);
        let far = FAR * px(&case.stack);
        case.stack.geometry.origin =
            DVec3::from_array([(); 3].map(|()| n.of(&[-1.0, 1.0]) * n.between(0.1, 1.0) * far));
        case
    },
    check,
    damage: None,
};

/// Counts edges that are not in two triangles once vertices at the same place are one.
fn check(case: &Case, source: &dyn Source) -> Checked {
    let stack = &case.stack;
    let body = made(source.layers(stack, &any_heights(case, PARTS), &case.settings))?;
    let wrong = |what: String| Fault { figure: f64::INFINITY, bound: 0.0, what };
    let place = tempfile::tempdir().map_err(|e| wrong(e.to_string()))?;
    let path = place.path().join("body.ply");
    write(&path, &body, false);
    let bytes = fs::read(&path).map_err(|e| wrong(e.to_string()))?;
    let (positions, triangles) = ply::read(&bytes).map_err(wrong)?;
    let seams = seams(&positions, &triangles);
    within(seams as f64, 0.0, || format!("{seams} edges of {} triangles are open or flat", triangles.len()))
}

/// Edges that are not in exactly two triangles, once in each direction, where vertices at the same place are one.
pub fn seams(positions: &[DVec3], triangles: &[[u32; 3]]) -> usize {
    let mut numbers: HashMap<[u64; 3], u32> = HashMap::new();
    let merged: Vec<u32> = positions
        .iter()
        .map(|p| {
            let next = numbers.len() as u32;
            *numbers.entry((*p + 0.0).to_array().map(f64::to_bits)).or_insert(next)
        })
        .collect();
    let triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|v| merged[v as usize])).collect();
    edge_defects(&triangles)
}
