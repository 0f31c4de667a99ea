// Reading `phi` (a storage array of the including file) between pixels; the twin is src/grid/field.rs. Positions are in pixels of the
// tile of `job`, which is passed by its index in `jobs`.

struct Cell {
    node: u32,
    place: vec2<f32>,
}

// Lower corner of the cell around `x`, kept `rim` pixels off the tile's edge, and the place in it.
fn cell_of(q: u32, x: vec2<f32>, rim: u32) -> Cell {
    let last = vec2<u32>(jobs[q].nx - 2u - rim, jobs[q].ny - 2u - rim);
    let at = clamp(x, vec2<f32>(f32(rim)), vec2<f32>(last + 1u));
    let corner = min(vec2<u32>(at), last);
    return Cell(jobs[q].offset + corner.y * jobs[q].nx + corner.x, at - vec2<f32>(corner));
}

fn sample_phi(q: u32, x: vec2<f32>) -> f32 {
    let c = cell_of(q, x, 0u);
    let nx = jobs[q].nx;
    let low = (1.0 - c.place.x) * phi[c.node] + c.place.x * phi[c.node + 1u];
    let high = (1.0 - c.place.x) * phi[c.node + nx] + c.place.x * phi[c.node + nx + 1u];
    return (1.0 - c.place.y) * low + c.place.y * high;
}

// Gradient at a pixel with four neighbours, by central differences.
fn gradient(node: u32, nx: u32) -> vec2<f32> {
    return vec2<f32>(0.5 * (phi[node + 1u] - phi[node - 1u]) / params.hx, 0.5 * (phi[node + nx] - phi[node - nx]) / params.hy);
}

// Unit normal at `x`: bilinear mean of the gradients at the four pixels around; zero where it vanishes.
fn normal_of(q: u32, x: vec2<f32>) -> vec2<f32> {
    let c = cell_of(q, x, 1u);
    let nx = jobs[q].nx;
    let g = (1.0 - c.place.y) * ((1.0 - c.place.x) * gradient(c.node, nx) + c.place.x * gradient(c.node + 1u, nx))
        + c.place.y * ((1.0 - c.place.x) * gradient(c.node + nx, nx) + c.place.x * gradient(c.node + nx + 1u, nx));
    let size = length(g);
    return select(g / max(size, 1e-9), vec2<f32>(0.0), size < 1e-9);
}

// Whether the contour passes between a pixel and one of its four neighbours.
fn at_contour(node: u32, nx: u32) -> bool {
    let inside = phi[node] < 0.0;
    return (phi[node - 1u] < 0.0) != inside || (phi[node + 1u] < 0.0) != inside
        || (phi[node - nx] < 0.0) != inside || (phi[node + nx] < 0.0) != inside;
}

// Contour point closest to a pixel, `x - phi n`.
fn closest_point(q: u32, node: u32) -> vec2<f32> {
    let nx = jobs[q].nx;
    let g = gradient(node, nx);
    let scale = phi[node] / (length(g) + 1e-9);
    let local = node - jobs[q].offset;
    return vec2<f32>(f32(local % nx), f32(local / nx)) - scale * g / vec2<f32>(params.hx, params.hy);
}
