//! The zero set of a field as closed polylines, and tracker seeds evenly spaced along them.

use bytemuck::{Pod, Zeroable};
use glam::DVec2;

use crate::grid::field::{Field, distance, position};
use crate::storage::spill::stored_as_they_are;

/// A point where a contour crosses the edge between two pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Position, pixels.
    pub x: DVec2,
    /// Pixel on the inside of the edge.
    pub inside: usize,
    /// Pixel on the outside.
    pub outside: usize,
}

/// A closed contour: the last crossing joins the first. The inside lies to the left in a frame with y upward.
pub type Loop = Vec<Crossing>;

/// A tracker particle's start.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Seed {
    /// Position, pixels.
    pub x: DVec2,
    /// A pixel inside, next to it.
    pub inside: usize,
    /// A pixel outside, next to it.
    pub outside: usize,
}

stored_as_they_are!(Seed);

/// All closed contours of `phi` by marching squares, in row order of their first crossing. The contour must not touch the field's
/// edge (fields are padded). In a saddle cell the sign of the mean of the four corners says which corners are joined.
pub fn trace_loops(phi: &Field) -> Vec<Loop> {
    let [nx, ny] = phi.dims;
    let inside = |node: usize| phi.data[node] < 0.0;
    // Edge 2 n joins pixels n and n + 1, edge 2 n + 1 joins n and n + nx. `next[e]` is where the contour that enters a cell at edge e leaves it.
    let mut edges = Vec::new();
    for j in 0..ny {
        for i in 0..nx {
            let node = j * nx + i;
            if i + 1 < nx && inside(node) != inside(node + 1) {
                edges.push(2 * node);
            }
            if j + 1 < ny && inside(node) != inside(node + nx) {
                edges.push(2 * node + 1);
            }
        }
    }
    let mut visited = vec![false; edges.len()];
    let mut loops = Vec::new();
    for first in 0..edges.len() {
        if visited[first] {
            continue;
        }
        let mut path = Loop::new();
        let mut at = first;
        loop {
            visited[at] = true;
            path.push(crossing(phi, edges[at]));
            let Some(next) = successor(phi, edges[at]).and_then(|e| edges.binary_search(&e).ok()) else { break };
            at = next;
            if visited[at] {
                break;
            }
        }
        loops.push(path);
    }
    loops
}

fn crossing(phi: &Field, edge: usize) -> Crossing {
    let nx = phi.dims[0];
    let (a, axis) = (edge / 2, edge % 2);
    let b = a + [1, nx][axis];
    let f = phi.data[a] / (phi.data[a] - phi.data[b]);
    let mut x = position(a, nx);
    x[axis] += if f.is_finite() { f.clamp(0.0, 1.0) } else { 0.5 };
    let (inside, outside) = if phi.data[a] < 0.0 { (a, b) } else { (b, a) };
    Crossing { x, inside, outside }
}

/// The edge by which the contour that crosses `edge` with the inside on its left leaves the cell it enters.
fn successor(phi: &Field, edge: usize) -> Option<usize> {
    let [nx, ny] = phi.dims;
    let (a, axis) = (edge / 2, edge % 2);
    let (i, j) = (a % nx, a / nx);
    let a_inside = phi.data[a] < 0.0;
    // The cell ahead, by its lower corner: above or below a horizontal edge, right or left of a vertical one.
    let (ci, cj) = match (axis, a_inside) {
        (0, true) => (Some(i), Some(j)),
        (0, false) => (Some(i), j.checked_sub(1)),
        (_, true) => (i.checked_sub(1), Some(j)),
        (_, false) => (Some(i), Some(j)),
    };
    let (ci, cj) = (ci?, cj?);
    if ci + 1 >= nx || cj + 1 >= ny {
        return None;
    }
    let c = cj * nx + ci;
    // Corners and edges counter-clockwise from the lower left; edge k joins corners k and k + 1.
    let corners = [c, c + 1, c + 1 + nx, c + nx];
    let edges = [2 * c, 2 * (c + 1) + 1, 2 * (c + nx), 2 * c + 1];
    let sign = corners.map(|n| phi.data[n] < 0.0);
    let entry = edges.iter().position(|&e| e == edge)?;
    let crossed = (0..4).filter(|&k| sign[k] != sign[(k + 1) % 4]).count();
    let joined = corners.iter().map(|&n| phi.data[n]).sum::<f64>() < 0.0;
    // Entering with the inside on the left, the corner behind the entry edge (k) is inside or the one after it, never both. Around a
    // joined inside the contour turns about the outside corner, around a parted one about the inside corner.
    let exit = if crossed == 2 {
        (1..4).map(|s| (entry + s) % 4).find(|&k| sign[k] != sign[(k + 1) % 4])?
    } else if joined {
        (entry + 1) % 4
    } else {
        (entry + 3) % 4
    };
    Some(edges[exit])
}

/// Seeds along the contours of `phi`, `spacing` px apart or a little less, and so the same whatever the machine and however the image lies: each
/// loop is cut into equal arcs, four at least, which begin where its crossings say (see `phase`), then each seed is put onto the bilinear
/// zero set.
pub fn seeds(phi: &Field, h: [f64; 2], spacing: f64) -> Vec<Seed> {
    let mut out = Vec::new();
    for path in trace_loops(phi) {
        let joints: Vec<_> = path.iter().chain(path.first()).collect();
        let lengths: Vec<f64> = joints.windows(2).map(|p| distance(p[0].x, p[1].x, h)).collect();
        let length: f64 = lengths.iter().sum();
        let count = 4.0 * (length / (4.0 * spacing)).ceil().max(1.0);
        let first = phase(&lengths, length / count);
        let (mut segment, mut before) = (0, 0.0);
        for k in 0..count as usize {
            let at = (k as f64 + first) / count * length;
            while segment + 1 < lengths.len() && before + lengths[segment] < at {
                before += lengths[segment];
                segment += 1;
            }
            let (a, b) = (joints[segment], joints[segment + 1]);
            let f = if lengths[segment] > 0.0 { ((at - before) / lengths[segment]).clamp(0.0, 1.0) } else { 0.5 };
            let mut x = a.x + f * (b.x - a.x);
            let nearer = if f < 0.5 { a } else { b };
            for _ in 0..2 {
                let (v, n) = (phi.sample(x).clamp(-0.5, 0.5), phi.normal(x, h));
                x -= v * n / DVec2::from(h);
            }
            out.push(Seed { x, inside: nearer.inside, outside: nearer.outside });
        }
    }
    out
}

/// Place in [0, 1) of an arc at which the first seed lies: `arg sum_k exp(2 pi i s_k / arc)` over the places s_k of the crossings. Begun
/// elsewhere, the other way round or turned, a loop has the same seeds. (A loop that is its own image turned by a half or a quarter would have the
/// sum 0, were its arcs not a multiple of four.)
fn phase(lengths: &[f64], arc: f64) -> f64 {
    let (mut at, mut sum) = (0.0, DVec2::ZERO);
    for length in lengths {
        sum += DVec2::from_angle(std::f64::consts::TAU * (at / arc).fract());
        at += length;
    }
    // Rounding decides nothing where the crossings are of no opinion.
    if libm::hypot(sum.x, sum.y) < 1e-9 * lengths.len() as f64 {
        return 0.5;
    }
    (libm::atan2(sum.y, sum.x) / std::f64::consts::TAU).rem_euclid(1.0).min(1.0 - f64::EPSILON)
}
