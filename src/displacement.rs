//! A smooth displacement between two contours: one vector per block of pixels, read bilinearly.
//!
//! The displacement v of an interval lives in its mid frame: what lies at `x - v/2` in the lower slice lies at `x + v/2` in the upper one.
//! Vectors are in pixels of the image.

/// Side of a block, px.
pub const BLOCK: usize = 4;
/// Fixed-point passes that find the trajectory through a point.
pub const PASSES: usize = 3;
/// Gaussian means over blocks are cut here, sigmas.
const TRUNCATE: f64 = 3.0;

/// A vector per block.
#[derive(Debug, Clone, PartialEq)]
pub struct Displacement {
    /// Blocks `[columns, rows]`.
    pub grid: [usize; 2],
    /// Vectors at the blocks' centres, row-major, pixels of the image.
    pub vectors: Vec<[f64; 2]>,
}

impl Displacement {
    /// No displacement on an image of these pixels.
    pub fn zero(dims: [usize; 2]) -> Self {
        let grid = dims.map(|n| n.div_ceil(BLOCK).max(2));
        Displacement { grid, vectors: vec![[0.0; 2]; grid[0] * grid[1]] }
    }

    /// The displacement with a value for every block centre, which `f` is given in pixels, with the block's own vector.
    pub fn map(&self, f: impl Fn([f64; 2], [f64; 2]) -> [f64; 2]) -> Self {
        let vectors = self.vectors.iter().enumerate().map(|(k, &v)| f(self.centre(k), v)).collect();
        Displacement { grid: self.grid, vectors }
    }

    /// The displacement with a value for every block centre that is wanted; the other vectors stay.
    pub fn map_where(&self, wanted: &[bool], f: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        let vector = |k: usize| if wanted[k] { f(self.centre(k)) } else { self.vectors[k] };
        Displacement { grid: self.grid, vectors: (0..self.vectors.len()).map(vector).collect() }
    }

    /// Centre of a block, pixels.
    pub fn centre(&self, k: usize) -> [f64; 2] {
        [k % self.grid[0], k / self.grid[0]].map(|b| (b * BLOCK) as f64 + 0.5 * (BLOCK - 1) as f64)
    }

    /// The vector at `x`; beyond the blocks' centres that of the nearest.
    #[inline(always)]
    pub fn at(&self, x: [f64; 2]) -> [f64; 2] {
        let mut corner = [0; 2];
        let mut place = [0.0; 2];
        for a in 0..2 {
            let at = (x[a] - 0.5 * (BLOCK - 1) as f64) / BLOCK as f64;
            let at = at.clamp(0.0, (self.grid[a] - 1) as f64);
            corner[a] = (at as usize).min(self.grid[a] - 2);
            place[a] = at - corner[a] as f64;
        }
        let k = corner[1] * self.grid[0] + corner[0];
        let [fx, fy] = place;
        let v = &self.vectors;
        std::array::from_fn(|a| {
            (1.0 - fy) * ((1.0 - fx) * v[k][a] + fx * v[k + 1][a])
                + fy * ((1.0 - fx) * v[k + self.grid[0]][a] + fx * v[k + self.grid[0] + 1][a])
        })
    }

    /// Displacement of the trajectory that passes through `x` at time `1/2 + tau`: `u = v(x - tau u)`.
    pub fn through(&self, x: [f64; 2], tau: f64) -> [f64; 2] {
        let mut u = self.at(x);
        if tau != 0.0 {
            for _ in 0..PASSES {
                u = self.at([x[0] - tau * u[0], x[1] - tau * u[1]]);
            }
        }
        u
    }

    /// The same read at the pixels of the lower and of the upper slice.
    pub fn at_slices(&self) -> [Self; 2] {
        [-0.5, 0.5].map(|tau| self.map(|x, _| self.through(x, tau)))
    }

    /// Largest component of any vector, px.
    pub fn largest(&self) -> f64 {
        self.vectors.iter().flatten().fold(0.0, |m, v| m.max(v.abs()))
    }
}

/// Gaussian means over blocks, the edge repeated. `sigma` in blocks.
pub fn smooth<const C: usize>(values: &mut Vec<[f64; C]>, [nx, ny]: [usize; 2], sigma: [f64; 2]) {
    for (axis, count, stride) in [(0, nx, 1), (1, ny, nx)] {
        let weights = weights(sigma[axis]);
        let reach = weights.len() / 2;
        let from = std::mem::take(values);
        *values = (0..nx * ny)
            .map(|k| {
                let at = if axis == 0 { k % nx } else { k / nx };
                let origin = k - at * stride;
                let mut sum = [0.0; C];
                for (n, w) in weights.iter().enumerate() {
                    let reading = (at + n).saturating_sub(reach).min(count - 1);
                    sum.iter_mut().zip(&from[origin + reading * stride]).for_each(|(s, v)| *s += w * v);
                }
                sum
            })
            .collect();
    }
}

/// Weights of a Gaussian mean, as many to either side; their sum is 1.
pub fn weights(sigma: f64) -> Vec<f64> {
    let reach = (TRUNCATE * sigma + 0.5) as i64;
    let raw: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|w| w / sum).collect()
}
