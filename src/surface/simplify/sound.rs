//! Check whether triangles bound a body.

use std::collections::HashMap;

/// Vertices where triangles do not close: those of edges that are not in exactly two triangles, once in each direction, and those around
/// which the triangles are not one ring of at least three; increasing.
pub(super) fn torn(triangles: &[[u32; 3]]) -> Vec<u32> {
    frayed(triangles, |_| true)
}

/// Vertices, of those that count, around which the triangles are not one ring.
fn frayed(triangles: &[[u32; 3]], counts: impl Fn(u32) -> bool) -> Vec<u32> {
    // Of each corner: its vertex, and the ends of the edges that leave it and come to it.
    let each = triangles.iter().flat_map(|&[a, b, c]| [[a, b, c], [b, c, a], [c, a, b]]);
    let mut corners: Vec<[u32; 3]> = each.filter(|corner| counts(corner[0])).collect();
    corners.sort_unstable();
    corners.chunk_by(|p, q| p[0] == q[0]).filter(|around| !is_ring(around)).map(|around| around[0][0]).collect()
}

/// Whether corners of one vertex, sorted, make one ring.
fn is_ring(around: &[[u32; 3]]) -> bool {
    let mut at = around[0][1];
    for step in 1..=around.len() {
        let Ok(n) = around.binary_search_by_key(&at, |c| c[1]) else { return false };
        let is_twice = |m: usize| around.get(m).is_some_and(|c| c[1] == at);
        if is_twice(n + 1) || n > 0 && is_twice(n - 1) {
            return false;
        }
        at = around[n][2];
        if at == around[0][1] {
            return step == around.len() && step > 2;
        }
    }
    false
}

/// Vertices at which triangles do not bound a body, where the surface goes on beyond a border that must stay as it was, `before`: an edge between two
/// vertices of the border must have been there, and be used as it was.
pub(super) fn torn_within(triangles: &[[u32; 3]], before: &[[u32; 3]], border: &[bool]) -> Vec<u32> {
    let (now, then) = (edges(triangles), edges(before));
    let on_border = |[a, b]: [u32; 2]| border[a as usize] && border[b as usize];
    let is_sound = |edge: [u32; 2], uses: [u8; 2]| match then.get(&edge) {
        Some(then) if on_border(edge) => *then == uses,
        None if on_border(edge) => false,
        _ => uses == [1, 1],
    };
    let mut torn: Vec<u32> =
        now.iter().filter(|(edge, uses)| !is_sound(**edge, **uses)).flat_map(|(edge, _)| *edge).collect();
    // Of the border, what has gone.
    let gone = |(edge, uses): &(&[u32; 2], &[u8; 2])| **uses != [1, 1] && !now.contains_key(*edge);
    torn.extend(then.iter().filter(gone).flat_map(|(edge, _)| *edge));
    torn.extend(frayed(triangles, |v| !border[v as usize]));
    torn.sort_unstable();
    torn.dedup();
    torn
}

/// Count of how often each edge is used in the direction of its vertices' numbers, and against it.
fn edges(triangles: &[[u32; 3]]) -> HashMap<[u32; 2], [u8; 2]> {
    let mut edges: HashMap<[u32; 2], [u8; 2]> = HashMap::with_capacity(triangles.len() * 3 / 2);
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            let uses = edges.entry([a.min(b), a.max(b)]).or_default();
            uses[usize::from(a > b)] = uses[usize::from(a > b)].saturating_add(1);
        }
    }
    edges
}

/// Euler's number: vertices less edges plus triangles.
pub(super) fn euler(triangles: &[[u32; 3]]) -> i64 {
    let mut vertices: Vec<u32> = triangles.as_flattened().to_vec();
    vertices.sort_unstable();
    vertices.dedup();
    vertices.len() as i64 - edges(triangles).len() as i64 + triangles.len() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    #[test]
    fn what_does_not_close_is_found() {
        assert!(torn(&TETRAHEDRON).is_empty());
        assert_eq!(torn(&TETRAHEDRON[..3]), [0, 2, 3], "open");
        assert_eq!(torn(&[[0, 1, 2], [0, 2, 1]]), [0, 1, 2], "a flap");
        let turned: Vec<[u32; 3]> =
            TETRAHEDRON.iter().enumerate().map(|(n, t)| if n == 0 { [0, 1, 2] } else { *t }).collect();
        assert_eq!(torn(&turned), [0, 1, 2], "one triangle inside out");
        let second = TETRAHEDRON.map(|t| t.map(|v| if v == 0 { 0 } else { v + 3 }));
        assert_eq!(torn(&[TETRAHEDRON, second].concat()), [0], "two bodies that share a vertex");
        assert_eq!([euler(&TETRAHEDRON), euler(&[TETRAHEDRON, second].concat())], [2, 3]);
    }

    #[test]
    fn a_border_must_stay() {
        // A square around a middle, its border kept.
        let before = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        let border = [true, true, true, true, false];
        assert!(torn_within(&before, &before, &border).is_empty());
        assert_eq!(torn_within(&before[..3], &before, &border), [0, 3, 4], "a side has gone");
        assert_eq!(
            torn_within(&[[0, 1, 2], [0, 2, 3]], &before, &border),
            [0, 2],
            "an edge that another block may have too"
        );
    }
}
