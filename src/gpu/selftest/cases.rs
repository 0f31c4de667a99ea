//! Contours that the stages are compared on.

use std::borrow::Cow;

use glam::DVec2;

use crate::backend::MorphOptions;
use crate::backend::jobs::SweepJob;
use crate::contour::seeds::seeds;
use crate::gpu::selftest::single_kernels::Tubes;
use crate::grid::field::Field;
use crate::grid::spline::HermiteArc;
use crate::settings::Settings;

/// Contours to compare on: jobs of different odd sizes, and where their contours go next.
#[derive(Debug, Clone)]
pub struct Cases {
    /// Pixel size, px of the larger side.
    pub h: [f64; 2],
    /// Their scale.
    pub scale: usize,
    /// Level sets, single precision exactly.
    pub phi: Vec<Field>,
    /// Level sets of other contours on the same tiles.
    pub goal: Vec<Field>,
    /// The first level sets a step later.
    pub later: Vec<Field>,
}

/// Half width of the tubes.
pub(crate) const GAMMA: f64 = 6.0;
/// Start of the cut-off.
pub(crate) const BETA: f64 = 3.0;

/// A radius around a center, by direction.
pub(crate) fn blob(dims: [usize; 2], h: [f64; 2], [cx, cy]: [f64; 2], r: f64, lobes: f64, depth: f64) -> Field {
    Field::from_fn(dims, |i, j| {
        let (x, y) = (i as f64 * h[0] - cx, j as f64 * h[1] - cy);
        let v = x.hypot(y) - r * (1.0 + depth * (lobes * y.atan2(x)).cos());
        f64::from(v as f32)
    })
}

/// Bodies in either.
pub(crate) fn joined(a: &Field, b: &Field) -> Field {
    Field { dims: a.dims, data: a.data.iter().zip(&b.data).map(|(x, y)| x.min(*y)).collect() }
}

impl Cases {
    /// A disc and a smaller one, two discs that become one, a star that becomes a disc, nothing at all; tiles of odd sizes, 33 x 39 to 71 x 53 px,
    /// times `scale`.
    pub fn new(h: [f64; 2], scale: usize) -> Self {
        let s = scale as f64;
        let at = |dims: [usize; 2], x: f64, y: f64| [dims[0] as f64 * h[0] * x, dims[1] as f64 * h[1] * y];
        // Contours stay a tube's width off the tiles' edges, as they do in the pipeline.
        let wide = |n: usize, side: f64| ((n * scale) as f64 / side) as usize | 1;
        let sizes = [[43, 47], [71, 53], [57, 61], [33, 39]].map(|d| [wide(d[0], h[0]), wide(d[1], h[1])]);
        let disc = |k: usize, x: f64, y: f64, r: f64| blob(sizes[k], h, at(sizes[k], x, y), r * s, 1.0, 0.0);
        let star = |depth: f64| blob(sizes[2], h, at(sizes[2], 0.5, 0.48), 15.0 * s, 5.0, depth);
        let empty = Field::filled(sizes[3], 9.0);
        let pair = |r: f64| joined(&disc(1, 0.33, 0.5, r), &disc(1, 0.68, 0.47, r));
        Cases {
            h,
            scale,
            phi: vec![disc(0, 0.5, 0.5, 11.0), pair(9.0), star(0.2), empty.clone()],
            goal: vec![disc(0, 0.52, 0.49, 8.0), disc(1, 0.5, 0.5, 17.0), star(0.0), empty.clone()],
            later: vec![disc(0, 0.5, 0.5, 10.6), pair(9.4), star(0.17), empty],
        }
    }

    /// The same on tiles that lack so many columns and rows before their first: tubes that reach the rim, as those of contours that move
    /// towards an edge do.
    pub fn cut(mut self, by: usize) -> Self {
        let cut = |f: &Field| Field::from_fn(f.dims.map(|n| n - by), |i, j| f.data[(j + by) * f.dims[0] + i + by]);
        for fields in [&mut self.phi, &mut self.goal, &mut self.later] {
            fields.iter_mut().for_each(|f| *f = cut(f));
        }
        self
    }

    /// The tubes around their contours.
    pub(crate) fn tubes(&self) -> Tubes {
        Tubes { h: self.h, gamma: GAMMA, beta: BETA }
    }

    /// Tubes like these in a morph.
    pub(crate) fn options() -> MorphOptions {
        MorphOptions { half_width: GAMMA, cut_off: BETA, ..MorphOptions::from(&Settings::default()) }
    }

    /// Seeds of every job and a course for each, which differ from seed to seed.
    fn seeded(&self) -> Vec<(Vec<DVec2>, Vec<HermiteArc>)> {
        let of = |phi: &Field| {
            // Contours have no seeds on a stretch, so that pixels are filled from their neighbours there.
            let bare = |x: &DVec2| x.y * self.h[1] > 0.58 * phi.dims[1] as f64 * self.h[1];
            let positions: Vec<DVec2> = seeds(phi, self.h, 0.5).iter().map(|s| s.x).filter(|x| !bare(x)).collect();
            let course = |x: &DVec2| {
                let s = f64::from((0.3 * x.x).sin() as f32) * 2.0;
                [s, 0.5 * s, 0.25, if x.y < 20.0 { 0.0 } else { 1.0 }]
            };
            let courses = positions.iter().map(course).collect();
            (positions, courses)
        };
        self.phi.iter().map(of).collect()
    }

    /// A sweep of every job from one level set to another.
    pub(crate) fn sweeps<'a>(&self, source: &'a [Field], goal: &'a [Field]) -> Vec<SweepJob<'a>> {
        let both = source.iter().zip(goal);
        both.zip(self.seeded())
            .map(|((source, goal), (seeds, courses))| SweepJob {
                source: Cow::Borrowed(source),
                goal: Cow::Borrowed(goal),
                seeds,
                courses,
                times: Vec::new(),
            })
            .collect()
    }
}
