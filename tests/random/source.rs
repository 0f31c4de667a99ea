//! Where the layers of a stack come from: the program, or results that are right or wrong by construction.

use interslice::grid::sparse_image::SparseImage;
use interslice::progress::Silent;
use interslice::report::Report;
use interslice::stack::ContourStack;
use interslice::surface::Layer;
use interslice::{Backend, Reconstruction, Result, Settings, reconstruct_with};

/// Makes the layers of a stack at some heights (increasing), with those of the contours.
pub trait Source: Sync {
    /// # Errors
    /// Those of the program.
    fn layers(&self, stack: &ContourStack, heights: &[f64], settings: &Settings) -> Result<Reconstruction>;

    /// Whether it computes in single precision.
    fn is_single(&self) -> bool {
        false
    }
}

/// The program on a backend.
pub struct Program<'a> {
    pub backend: &'a dyn Backend,
    pub single: bool,
}

impl Source for Program<'_> {
    fn layers(&self, stack: &ContourStack, heights: &[f64], settings: &Settings) -> Result<Reconstruction> {
        reconstruct_with(stack, heights, settings, self.backend, &Silent)
    }

    fn is_single(&self) -> bool {
        self.single
    }
}

/// Straight lines in z between the slices' distances: `(1 - t) A + t B`, flat ends. It looks at sides only, at nothing but the height, the two
/// slices beside it and the pixel, and what is inside is inside on the line to one of both: it keeps every promise, though no surface is smooth.
pub struct Straight;

impl Source for Straight {
    fn layers(&self, stack: &ContourStack, heights: &[f64], settings: &Settings) -> Result<Reconstruction> {
        let limit = settings.margin() as f64 * stack.spacing[0].max(stack.spacing[1]);
        let fields: Vec<Vec<f64>> = stack.slices.iter().map(|s| distance(&s.content.sides(), stack, limit)).collect();
        let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
        let mut all: Vec<(f64, bool)> = heights.iter().map(|z| (*z, true)).collect();
        all.extend(z.iter().filter(|z| !heights.contains(z)).map(|z| (*z, false)));
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let last = z.len() - 1;
        let layer = |(height, output): (f64, bool)| {
            let contour = z.iter().position(|z| *z == height);
            let i = z.partition_point(|z| *z <= height).clamp(1, last) - 1;
            let t = (height - z[i]) / (z[i + 1] - z[i]);
            let value = |(a, b): (&f64, &f64)| match contour {
                Some(k) if k == i => *a,
                Some(_) => *b,
                None if (0.0..=1.0).contains(&t) => (1.0 - t) * a + t * b,
                None => limit,
            };
            let value = |pair| match value(pair).clamp(-limit, limit) as f32 {
                0.0 => f32::MIN_POSITIVE,
                v => v,
            };
            let phi: Vec<f32> = fields[i].iter().zip(&fields[i + 1]).map(value).collect();
            Layer { z: height, phi: SparseImage::of(stack.dims, &phi), output, contour }
        };
        Ok(Reconstruction {
            dims: stack.dims,
            spacing: stack.spacing,
            unit: stack.unit.clone(),
            geometry: stack.geometry,
            extent: [z[0], z[last]],
            layers: all.into_iter().map(layer).collect(),
            report: Report::default(),
        })
    }
}

/// Distance to the nearest pixel of the other side less half a pixel, negative inside, and `limit` on a slice of nothing; beyond the image is outside.
fn distance(inside: &[bool], stack: &ContourStack, limit: f64) -> Vec<f64> {
    let ([nx, ny], [dx, dy]) = (stack.dims, stack.spacing);
    let half = 0.5 * dx.min(dy);
    let side = |i: i64, j: i64| {
        (0..nx as i64).contains(&i) && (0..ny as i64).contains(&j) && inside[j as usize * nx + i as usize]
    };
    // Only pixels beside one of the other side can be the nearest.
    let mut beside = [Vec::new(), Vec::new()];
    for j in -1..=ny as i64 {
        for i in -1..=nx as i64 {
            let own = side(i, j);
            if [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().any(|(a, b)| side(i + a, j + b) != own) {
                beside[usize::from(own)].push([i, j]);
            }
        }
    }
    let value = |n: usize| {
        let (i, j) = ((n % nx) as i64, (n / nx) as i64);
        let other = &beside[usize::from(!inside[n])];
        let squares = other.iter().map(|p| ((p[0] - i) as f64 * dx).powi(2) + ((p[1] - j) as f64 * dy).powi(2));
        let d = if other.is_empty() { limit } else { squares.fold(f64::INFINITY, f64::min).sqrt() - half };
        if inside[n] { -d } else { d }
    };
    (0..nx * ny).map(value).collect()
}

/// What another source gives, damaged.
pub struct Damaged<D>(pub D);

impl<D: Fn(&ContourStack, &[f64], &Settings, &mut Reconstruction) + Sync> Source for Damaged<D> {
    fn layers(&self, stack: &ContourStack, heights: &[f64], settings: &Settings) -> Result<Reconstruction> {
        let mut body = Straight.layers(stack, heights, settings)?;
        (self.0)(stack, heights, settings, &mut body);
        Ok(body)
    }
}
