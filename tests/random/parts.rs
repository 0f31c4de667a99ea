//! Parts of a body: an outline that drifts, grows, turns and branches from slice to slice.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::numbers::Numbers;

/// Outlines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outline {
    /// Its axes have this ratio.
    Ellipse(f64),
    Square,
    /// Five lobes.
    Star,
    /// A rectangle of this width, px.
    Line(f64),
    /// An open ring.
    Hook,
    /// One pixel.
    Pixel,
}

/// A part of the body, or what is cut out of it.
#[derive(Debug, Clone)]
pub struct Part {
    pub outline: Outline,
    pub cut: bool,
    /// Slices on which it is drawn.
    pub first: usize,
    pub last: usize,
    /// Centre on slice 0, and its way from slice to slice, px.
    pub centre: [f64; 2],
    pub drift: [f64; 2],
    /// Radius, px, and by what it grows from slice to slice.
    pub radius: f64,
    pub growth: f64,
    /// Angle and its change.
    pub turn: f64,
    pub spin: f64,
    /// From this slice on there are two of it, which part by this many px a slice.
    pub branch: Option<(usize, f64)>,
}

impl Part {
    /// Any part of an image of these pixels, on some of these slices.
    pub fn draw(n: &mut Numbers, dims: [usize; 2], slices: usize) -> Part {
        let small = dims[0].min(dims[1]) as f64;
        let outline = match n.whole(0, 19) {
            0..=8 => Outline::Ellipse(n.between(0.4, 1.0)),
            9..=11 => Outline::Square,
            12..=13 => Outline::Star,
            14..=15 => Outline::Line(n.of(&[0.6, 1.0, 1.5, 2.0, 3.0])),
            16..=17 => Outline::Hook,
            _ => Outline::Pixel,
        };
        let first = if n.chance(0.7) { 0 } else { n.whole(0, slices - 1) };
        let last = if n.chance(0.7) { slices - 1 } else { n.whole(first, slices - 1) };
        let far = if n.chance(0.3) { 6.0 } else { 2.0 };
        Part {
            outline,
            cut: false,
            first,
            last,
            centre: dims.map(|d| n.between(-0.02, 1.0) * d as f64),
            drift: [(); 2].map(|()| n.between(-far, far)),
            radius: n.ratio(1.5, 0.4 * small),
            growth: n.between(-2.0, 2.0),
            turn: n.between(0.0, TAU),
            spin: if n.chance(0.5) { n.between(-0.5, 0.5) } else { 0.0 },
            branch: n.chance(0.15).then(|| (n.whole(0, slices - 1), n.between(1.0, 5.0))),
        }
    }

    /// One that overlaps itself on the next slice, far from the image's border.
    pub fn calm(n: &mut Numbers, dims: [usize; 2], slices: usize) -> Part {
        let small = dims[0].min(dims[1]) as f64;
        let radius = n.between(0.15, 0.25) * small;
        let step = 0.5 * radius / slices as f64;
        Part {
            outline: n.of(&[Outline::Ellipse(0.6), Outline::Ellipse(1.0), Outline::Square, Outline::Star]),
            first: 0,
            last: slices - 1,
            centre: dims.map(|d| 0.5 * d as f64 + n.between(-3.0, 3.0)),
            drift: [(); 2].map(|()| n.between(-step, step)),
            radius,
            growth: n.between(-step, step),
            branch: None,
            ..Part::draw(n, dims, slices)
        }
    }

    /// A hole that goes with it, or a bite.
    pub fn cut_out(&self, n: &mut Numbers) -> Part {
        Part {
            outline: Outline::Ellipse(1.0),
            cut: true,
            centre: self.centre.map(|c| c + n.between(-0.6, 0.6) * self.radius),
            radius: n.between(0.1, 0.7) * self.radius,
            growth: n.between(-1.0, 1.0),
            first: n.whole(self.first, self.last),
            branch: None,
            ..self.clone()
        }
    }

    /// Whether it is drawn on slice `k`.
    pub fn on(&self, k: usize) -> bool {
        (self.first..=self.last).contains(&k)
    }

    /// Centres on slice `k`: one, or two where it has branched.
    pub fn centres(&self, k: usize) -> Vec<[f64; 2]> {
        let at = |side: f64, by: f64| {
            let axis = [self.turn.cos(), self.turn.sin()];
            std::array::from_fn(|a| self.centre[a] + self.drift[a] * k as f64 + side * by * axis[a])
        };
        match self.branch {
            Some((from, by)) if k >= from => [1.0, -1.0].map(|s| at(s, by * (k - from + 1) as f64)).to_vec(),
            _ => vec![at(0.0, 0.0)],
        }
    }

    /// Implicit function about a centre on slice `k`, px, negative inside.
    pub fn about(&self, k: usize, [u, v]: [f64; 2]) -> f64 {
        let r = (self.radius + self.growth * k as f64).max(0.4);
        let angle = self.turn + self.spin * k as f64;
        let (c, s) = (angle.cos(), angle.sin());
        let (p, q) = (u * c + v * s, v * c - u * s);
        match self.outline {
            Outline::Ellipse(ratio) => p.hypot(q / ratio) - r,
            Outline::Square => p.abs().max(q.abs()) - 0.85 * r,
            Outline::Star => p.hypot(q) - r * (1.0 + 0.25 * (5.0 * q.atan2(p)).cos()),
            Outline::Line(width) => (p.abs() - 2.0 * r).max(q.abs() - 0.5 * width),
            Outline::Hook => {
                ((p.hypot(q) - 0.75 * r).abs() - 0.25 * r).max(FRAC_PI_2 * 0.4 * r - r * (q.atan2(p)).abs())
            }
            Outline::Pixel => u.abs().max(v.abs()) - 0.5,
        }
    }

    /// The outline about a centre on slice `k` as a polygon: where rays from the centre leave it.
    pub fn polygon(&self, k: usize, corners: usize) -> Vec<[f64; 2]> {
        let ray = |n: usize| {
            let angle = TAU * n as f64 / corners as f64 - PI;
            let at = |r: f64| [r * angle.cos(), r * angle.sin()];
            // Bisection to a millionth of a pixel.
            let (mut low, mut high) = (0.0, 64.0);
            for _ in 0..26 {
                let middle = 0.5 * (low + high);
                if self.about(k, at(middle)) < 0.0 { low = middle } else { high = middle }
            }
            at(low.max(0.05))
        };
        (0..corners).map(ray).collect()
    }
}
