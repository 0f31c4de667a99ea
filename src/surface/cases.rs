//! The 256 cases of marching cubes, built from one rule for a cell's faces instead of copied from a table.
//!
//! Corner c of a cell has bit 0 for x, bit 1 for y, bit 2 for z. On each face the contour is a set of segments that depends on the four
//! signs of that face alone: every run of inside corners is cut off by itself (so an ambiguous face parts its two inside corners). Two
//! cells see the same segments on their common face, in opposite directions; within a cell they link into loops. Hence every segment
//! has exactly two cells, and the mesh is closed and edge-manifold whatever the data.
//!
//! Loops of three are triangles. Loops of four are cut by a diagonal that lies on no face, so that no other cell can have it. Longer
//! loops, and quads without such a diagonal, are fans around a vertex of their own.

use std::sync::LazyLock;

/// Way in which a loop is filled.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LoopFill {
    /// Triangles between the loop's own vertices, by cell edge.
    Flat(Vec<[u8; 3]>),
    /// A fan around the mean of the loop's vertices, by cell edge in order.
    Fan(Vec<u8>),
}

/// The two corners of each cell edge, the lower first: four along x, four along y, four along z.
pub const EDGES: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// Corners of each face, counter-clockwise seen from outside the cell.
const FACES: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Patches of each of the 256 sign patterns; bit c is set where corner c is inside. Seen from outside the body, triangles turn
/// counter-clockwise.
pub static CASES: LazyLock<Vec<Vec<LoopFill>>> = LazyLock::new(|| (0..256).map(patches).collect());

fn edge_between(a: usize, b: usize) -> u8 {
    let key = [a.min(b), a.max(b)];
    EDGES.iter().position(|e| *e == key).unwrap_or(0) as u8
}

fn patches(pattern: usize) -> Vec<LoopFill> {
    let inside = |c: usize| pattern >> c & 1 == 1;
    // Where the loop goes on from each cell edge.
    let mut next = [None; 12];
    for face in FACES {
        for k in 0..4 {
            if inside(face[k]) || !inside(face[(k + 1) % 4]) {
                continue;
            }
            // A run of inside corners begins after corner k: follow it to where it ends.
            let end = (1..4).find(|s| !inside(face[(k + s + 1) % 4])).unwrap_or(3);
            let enter = edge_between(face[k], face[(k + 1) % 4]);
            let leave = edge_between(face[(k + end) % 4], face[(k + end + 1) % 4]);
            next[enter as usize] = Some(leave);
        }
    }
    let mut out = Vec::new();
    for first in 0..12 {
        let mut path = Vec::new();
        let mut at = first;
        while let Some(to) = next[at as usize].take() {
            path.push(at);
            at = to;
        }
        if !path.is_empty() {
            out.push(fill(path));
        }
    }
    out
}

fn fill(path: Vec<u8>) -> LoopFill {
    let diagonal_is_free = |a: usize, b: usize| !share_a_face(path[a], path[b]);
    match path.len() {
        3 => LoopFill::Flat(vec![[path[0], path[1], path[2]]]),
        4 if diagonal_is_free(0, 2) => LoopFill::Flat(vec![[path[0], path[1], path[2]], [path[0], path[2], path[3]]]),
        4 if diagonal_is_free(1, 3) => LoopFill::Flat(vec![[path[0], path[1], path[3]], [path[1], path[2], path[3]]]),
        _ => LoopFill::Fan(path),
    }
}

fn share_a_face(a: u8, b: u8) -> bool {
    let on = |e: u8, face: &[usize; 4]| EDGES[e as usize].iter().all(|c| face.contains(c));
    FACES.iter().any(|f| on(a, f) && on(b, f))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_crossed_edge_is_in_one_loop() {
        for (pattern, patches) in CASES.iter().enumerate() {
            let crossed = EDGES.iter().filter(|[a, b]| (pattern >> a & 1) != (pattern >> b & 1)).count();
            let in_loops: usize = patches
                .iter()
                .map(|p| match p {
                    LoopFill::Flat(t) => t.len() + 2,
                    LoopFill::Fan(path) => path.len(),
                })
                .sum();
            assert_eq!(crossed, in_loops, "case {pattern:08b}");
        }
        assert!(CASES[0].is_empty() && CASES[255].is_empty());
    }
}
