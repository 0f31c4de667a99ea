//! What is measured on layers.

use interslice::Reconstruction;
use interslice::grid::components::label4;
use interslice::stack::ContourStack;
use interslice::surface::Layer;

/// Larger pixel side.
pub fn px(stack: &ContourStack) -> f64 {
    stack.spacing[0].max(stack.spacing[1])
}

/// Largest difference of two layers near the surface, px: where one of both is less than a pixel away, or the side differs.
pub fn change<'a>(pairs: impl Iterator<Item = (&'a f32, &'a f32)>, px: f64) -> f64 {
    let near = px as f32;
    let of = |(a, b): (&f32, &f32)| {
        let counts = a.abs().min(b.abs()) < near || (*a < 0.0) != (*b < 0.0);
        let d = f64::from((a - b).abs()) / px;
        if d.is_nan() {
            f64::INFINITY
        } else if counts {
            d
        } else {
            0.0
        }
    };
    pairs.map(of).fold(0.0, f64::max)
}

/// Largest distance of a point of one layer's contour from the other layer's contour, both ways, px: points lie where pixels' edges are crossed, and
/// the other layer's distance there is read between both pixels.
pub fn moved(a: &Layer, b: &Layer, [nx, ny]: [usize; 2], px: f64) -> f64 {
    let (a, b) = (a.dense(), b.dense());
    let across = |of: &[f32], from: &[f32], [n, m]: [usize; 2]| {
        if (of[n] < 0.0) == (of[m] < 0.0) {
            return 0.0;
        }
        let f = of[n] / (of[n] - of[m]);
        let d = f64::from(((1.0 - f) * from[n] + f * from[m]).abs()) / px;
        if d.is_nan() { f64::INFINITY } else { d }
    };
    let rows = (0..nx * ny).filter(|n| (n + 1) % nx > 0).map(|n| [n, n + 1]);
    let columns = (nx..nx * ny).map(|n| [n - nx, n]);
    rows.chain(columns).map(|edge| across(&a, &b, edge).max(across(&b, &a, edge))).fold(0.0, f64::max)
}

/// Layers of both at the same height.
pub fn common<'a>(a: &'a Reconstruction, b: &'a Reconstruction) -> Vec<(&'a Layer, &'a Layer)> {
    let scale = a.layers.iter().map(|l| l.z.abs()).fold(0.0, f64::max);
    let same = |x: f64, y: f64| (x - y).abs() <= 1e-12 * scale;
    let mut k = 0;
    let mut out = Vec::new();
    for layer in &a.layers {
        while k < b.layers.len() && b.layers[k].z < layer.z && !same(b.layers[k].z, layer.z) {
            k += 1;
        }
        out.extend(b.layers.get(k).filter(|other| same(other.z, layer.z)).map(|other| (layer, other)));
    }
    out
}

/// The layer at a height.
pub fn layer_at(body: &Reconstruction, z: f64) -> Option<&Layer> {
    let scale = body.layers.iter().map(|l| l.z.abs()).fold(0.0, f64::max);
    body.layers.iter().find(|l| (l.z - z).abs() <= 1e-12 * scale)
}

/// Sub-pixel area, pixels: a pixel counts by `1/2 - phi`, between 0 and 1.
pub fn area(layer: &Layer, px: f64) -> f64 {
    layer.phi.iter().map(|v| (0.5 - f64::from(*v) / px).clamp(0.0, 1.0)).sum()
}

/// Parts of a block of layers, numbered from 1, 0 outside: joined through faces, or through edges and corners too.
pub fn pieces(layers: &[&Layer], [nx, ny]: [usize; 2], corners: bool) -> (Vec<u32>, u32) {
    let n = nx * ny;
    let inside = |k: usize| layers[k / n].phi[k % n] < 0.0;
    let mut labels = vec![0u32; n * layers.len()];
    let mut open = Vec::new();
    let mut count = 0;
    for start in 0..labels.len() {
        if labels[start] != 0 || !inside(start) {
            continue;
        }
        count += 1;
        labels[start] = count;
        open.push(start);
        while let Some(k) = open.pop() {
            let at = [(k % nx) as i64, (k / nx % ny) as i64, (k / n) as i64];
            for step in 0..27i64 {
                let d = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
                if !corners && d.iter().map(|d| d.abs()).sum::<i64>() != 1 {
                    continue;
                }
                let [i, j, l] = std::array::from_fn(|a| at[a] + d[a]);
                let exists =
                    (0..nx as i64).contains(&i) && (0..ny as i64).contains(&j) && (0..layers.len() as i64).contains(&l);
                if exists {
                    let other = l as usize * n + j as usize * nx + i as usize;
                    if labels[other] == 0 && inside(other) {
                        labels[other] = count;
                        open.push(other);
                    }
                }
            }
        }
    }
    (labels, count)
}

/// Parts of two slices that share pixels.
#[derive(Debug, Clone, Copy)]
pub struct Overlap {
    /// Numbers of both parts, as `inspect` lists them.
    pub parts: [u32; 2],
    /// A pixel of both.
    pub pixel: usize,
    /// How many there are.
    pub shared: usize,
}

/// Parts of slice `i` and of the next one that overlap.
pub fn overlaps(stack: &ContourStack, i: usize) -> Vec<Overlap> {
    let [a, b] = [i, i + 1].map(|k| label4(&stack.slices[k].content.sides(), stack.dims));
    let mut pairs = std::collections::BTreeMap::new();
    for (pixel, (p, q)) in a.labels.iter().zip(&b.labels).enumerate().filter(|(_, (p, q))| **p > 0 && **q > 0) {
        pairs.entry((*p, *q)).or_insert(Overlap { parts: [*p, *q], pixel, shared: 0 }).shared += 1;
    }
    pairs.into_values().collect()
}

/// Convex hull, counter-clockwise (Andrew, 1979).
pub fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let turn = |o: [f64; 2], a: [f64; 2], b: [f64; 2]| (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    let half = |points: &mut dyn Iterator<Item = &[f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while chain.len() > 1 && turn(chain[chain.len() - 2], chain[chain.len() - 1], *p) <= 0.0 {
                chain.pop();
            }
            chain.push(*p);
        }
        chain.pop();
        chain
    };
    let (mut lower, upper) = (half(&mut points.iter()), half(&mut points.iter().rev()));
    lower.extend(upper);
    lower
}

/// Distance of a point from a convex polygon, 0 inside.
pub fn outside(hull: &[[f64; 2]], p: [f64; 2]) -> f64 {
    let edge = |k: usize| (hull[k], hull[(k + 1) % hull.len()]);
    let right = |(a, b): ([f64; 2], [f64; 2])| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) < 0.0;
    if hull.len() > 2 && !(0..hull.len()).any(|k| right(edge(k))) {
        return 0.0;
    }
    let from = |(a, b): ([f64; 2], [f64; 2])| {
        let (d, w) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
        let length = d[0] * d[0] + d[1] * d[1];
        let t = if length > 0.0 { ((w[0] * d[0] + w[1] * d[1]) / length).clamp(0.0, 1.0) } else { 0.0 };
        (w[0] - t * d[0]).hypot(w[1] - t * d[1])
    };
    (0..hull.len()).map(|k| from(edge(k))).fold(f64::INFINITY, f64::min)
}
