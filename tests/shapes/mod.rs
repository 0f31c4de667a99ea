//! Analytic contours for tests: signed distances in pixels, and stacks made of them.
#![allow(dead_code)]

pub mod spheres;
pub mod zoo;

use interslice::Settings;
use interslice::settings::{Method, Motion};
use interslice::stack::{ContourStack, Geometry, LevelSlice, Slice, SliceContent};

/// The morph alone: contours stay in their place, and nothing is smoothed after it.
pub fn plain() -> Settings {
    Settings { method: Method::Morph, motion: Motion::None, fair: 0.0, ..Settings::default() }
}

/// Signed distance or any implicit function, negative inside, at pixel position (x, y).
pub type Shape = Box<dyn Fn(f64, f64) -> f64>;

pub fn circle(cx: f64, cy: f64, r: f64) -> Shape {
    Box::new(move |x, y| (x - cx).hypot(y - cy) - r)
}

/// Square with half side `a`, turned by `angle`.
pub fn square(cx: f64, cy: f64, a: f64, angle: f64) -> Shape {
    Box::new(move |x, y| {
        let (c, s) = (angle.cos(), angle.sin());
        let (u, v) = ((x - cx) * c - (y - cy) * s, (x - cx) * s + (y - cy) * c);
        let (qx, qy) = (u.abs() - a, v.abs() - a);
        qx.max(0.0).hypot(qy.max(0.0)) + qx.max(qy).min(0.0)
    })
}

/// Radius `r (1 + amplitude cos(5 theta + phase))`.
pub fn star(cx: f64, cy: f64, r: f64, amplitude: f64, phase: f64) -> Shape {
    Box::new(move |x, y| {
        let theta = (y - cy).atan2(x - cx);
        (x - cx).hypot(y - cy) - r * (1.0 + amplitude * (5.0 * theta + phase).cos())
    })
}

pub fn union(a: Shape, b: Shape) -> Shape {
    Box::new(move |x, y| a(x, y).min(b(x, y)))
}

pub fn without(a: Shape, b: Shape) -> Shape {
    Box::new(move |x, y| a(x, y).max(-b(x, y)))
}

pub fn nothing() -> Shape {
    Box::new(|_, _| 1.0)
}

fn stack(dims: [usize; 2], heights: &[f64], contents: Vec<SliceContent>) -> ContourStack {
    let slices = contents
        .into_iter()
        .zip(heights)
        .enumerate()
        .map(|(k, (content, &z))| Slice { name: format!("slice {k}"), z, extra: false, content })
        .collect();
    ContourStack {
        dims,
        spacing: [1.0, 1.0],
        unit: "px".into(),
        slices,
        z_out: None,
        geometry: Geometry::default(),
        known: None,
    }
}

fn values(dims: [usize; 2], shape: &Shape) -> Vec<f64> {
    (0..dims[1]).flat_map(|j| (0..dims[0]).map(move |i| (i, j))).map(|(i, j)| shape(i as f64, j as f64)).collect()
}

/// A stack of masks.
pub fn masks(n: usize, heights: &[f64], shapes: &[Shape]) -> ContourStack {
    assert_eq!(heights.len(), shapes.len());
    let mask = |s: &Shape| SliceContent::Mask(values([n, n], s).iter().map(|v| *v < 0.0).collect());
    stack([n, n], heights, shapes.iter().map(mask).collect())
}

/// A stack of sub-pixel level sets, so that no staircase hides the method's own error.
pub fn levels(n: usize, heights: &[f64], shapes: &[Shape]) -> ContourStack {
    assert_eq!(heights.len(), shapes.len());
    let single = |s: &Shape| values([n, n], s).iter().map(|v| *v as f32).collect::<Vec<f32>>();
    let level = |s: &Shape| SliceContent::Level(LevelSlice::new(&single(s), n));
    stack([n, n], heights, shapes.iter().map(level).collect())
}

/// The stack upside down, between heights 0 and `top`.
pub fn upside_down(stack: &ContourStack, top: f64) -> ContourStack {
    let mut turned = stack.clone();
    turned.slices.reverse();
    turned.slices.iter_mut().for_each(|s| s.z = top - s.z);
    turned
}
