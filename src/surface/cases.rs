//! The cases of marching cubes, built from one rule for a cell's faces instead of copied from a table.
//!
//! Corner c of a cell has bit 0 for x, bit 1 for y, bit 2 for z. On each face the contour is a set of segments that depends on the four
//! values of that face alone: every run of inside corners is cut off by itself, but on an ambiguous face, two corners of which are inside across from
//! each other, both are joined where the mean of its four values is inside, and the outside corners are cut off (as
//! [`contour_lines`](super::contour_lines) has it). Two cells see the same segments on their common face, in opposite directions; within a cell they
//! link into loops. Hence every segment has exactly two cells, and the mesh is closed and edge-manifold whatever the data.
//!
//! Loops of three are triangles. Loops of four are cut by a diagonal that lies on no face, so that no other cell can have it. Longer
//! loops, and quads without such a diagonal, are fans around a vertex of their own.

use std::sync::{LazyLock, OnceLock};

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
pub const FACES: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Sign patterns; bit c is set where corner c is inside.
const PATTERNS: usize = 256;
/// Choices of faces on which the inside corners are joined.
const CHOICES: usize = 64;

/// For each sign pattern the ambiguous faces: bit f is set for face f.
pub static AMBIGUOUS: LazyLock<[u8; PATTERNS]> = LazyLock::new(|| {
    std::array::from_fn(|pattern| {
        let inside = |c: usize| pattern >> c & 1 == 1;
        let ambiguous = |f: &[usize; 4]| {
            let [a, b, c, d] = f.map(inside);
            a == c && b == d && a != b
        };
        FACES.iter().enumerate().map(|(f, face)| u8::from(ambiguous(face)) << f).sum()
    })
});

/// Patches of a sign pattern; on the ambiguous faces whose bits are set in `joined` the inside corners are joined. Seen from outside the body,
/// triangles turn counter-clockwise.
pub fn patches(pattern: u8, joined: u8) -> &'static [LoopFill] {
    static KNOWN: [OnceLock<Vec<LoopFill>>; PATTERNS * CHOICES] = [const { OnceLock::new() }; PATTERNS * CHOICES];
    let joined = usize::from(joined) % CHOICES;
    KNOWN[usize::from(pattern) * CHOICES + joined].get_or_init(|| made(usize::from(pattern), joined))
}

fn edge_between(a: usize, b: usize) -> u8 {
    let key = [a.min(b), a.max(b)];
    EDGES.iter().position(|e| *e == key).unwrap_or(0) as u8
}

fn made(pattern: usize, joined: usize) -> Vec<LoopFill> {
    let inside = |c: usize| pattern >> c & 1 == 1;
    // Where the loop goes on from each cell edge.
    let mut next = [None; 12];
    for (f, face) in FACES.into_iter().enumerate() {
        for k in 0..4 {
            if inside(face[k]) || !inside(face[(k + 1) % 4]) {
                continue;
            }
            if (usize::from(AMBIGUOUS[pattern]) & joined) >> f & 1 == 1 {
                // Corner k, outside, is cut off.
                let enter = edge_between(face[k], face[(k + 1) % 4]);
                next[enter as usize] = Some(edge_between(face[(k + 3) % 4], face[k]));
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
        for (pattern, joined) in (0..=255).flat_map(|pattern| (0..64).map(move |joined| (pattern, joined))) {
            let crossed = EDGES.iter().filter(|[a, b]| (pattern >> a & 1) != (pattern >> b & 1)).count();
            let in_loops: usize = patches(pattern, joined)
                .iter()
                .map(|p| match p {
                    LoopFill::Flat(t) => t.len() + 2,
                    LoopFill::Fan(path) => path.len(),
                })
                .sum();
            assert_eq!(crossed, in_loops, "case {pattern:08b}, joined on {joined:06b}");
        }
        assert!(patches(0, 0).is_empty() && patches(255, 0).is_empty());
    }

    #[test]
    fn corners_across_a_face_are_joined_where_it_says_so() {
        // Two upright edges across from each other: apart they are two posts, joined on floor and ceiling a wall.
        let pattern = 1 << 0 | 1 << 3 | 1 << 4 | 1 << 7;
        assert_eq!(AMBIGUOUS[pattern], 0b110000);
        let loops = |joined: u8| patches(pattern as u8, joined).len();
        assert_eq!([0, 0b110000, 0b010000, 0b100000].map(loops), [2, 2, 1, 1]);
        assert_eq!(patches(pattern as u8, 0b001111), patches(pattern as u8, 0));
    }
}
