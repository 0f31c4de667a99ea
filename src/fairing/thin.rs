//! Thin walls and gaps, which fairing leaves alone.
//!
//! A wall of about a pixel has no room for a shape: means along z make it wider where the trajectories miss it by a fraction of a pixel, and
//! what they change is a share of all it is. With d the least of both sides' largest |u| within 3 px of a pixel, in px, fairing counts by
//! `smoothstep(4 (d - 0.5))`: not in a wall of a pixel, wholly in one of one and a half. A wall goes on across that window: what has less than 4 px of its
//! area, as a thread has, counts, wholly from 6 px on. So does what lies farther than 2 px from the surface, since of it only one side can be seen.

use crate::grid::sparse_image::SparseImage;
use crate::grid::spline::smoothstep;

/// Half the window, px of the larger side.
const REACH: f64 = 3.0;
/// Depths of a side from which on fairing counts, and counts wholly, px.
const DEPTHS: [f64; 2] = [0.5, 0.75];
/// Areas of a side in the window, px: below the first it is no wall, from the other on nothing else.
const AREAS: [f64; 2] = [4.0, 6.0];
/// Pixels up to here lie at the surface, px, and from the other on they do not.
const AT_SURFACE: [f64; 2] = [1.0, 2.0];

/// Shares by which fairing counts beside thin walls of a layer.
pub struct Thin<'l> {
    phi: &'l SparseImage<f32>,
    /// A pixel's larger side.
    side: f64,
    /// Half the window, pixels along either axis.
    reach: [usize; 2],
    row: Vec<f32>,
    /// Of each column the least and the largest value of the window's rows, and how many of these are inside.
    least: Vec<f32>,
    largest: Vec<f32>,
    inside: Vec<f32>,
    /// The same of each window.
    windows: [Vec<f32>; 3],
    /// Area of a pixel, px of the larger side.
    area: f64,
}

impl<'l> Thin<'l> {
    /// Of a layer with the distances `phi`, unit of the spacing.
    pub fn new(phi: &'l SparseImage<f32>, spacing: [f64; 2]) -> Self {
        let side = spacing[0].max(spacing[1]);
        let reach = spacing.map(|s| (REACH * side / s).round() as usize);
        let area = spacing[0] * spacing[1] / (side * side);
        let [row, least, largest, inside] = [const { Vec::new() }; 4];
        Thin { phi, side, reach, row, least, largest, inside, windows: Default::default(), area }
    }

    /// The shares of the pixels of row `j` from `first` on, whose distances are `own`.
    pub fn shares(&mut self, own: &[f32], [first, j]: [usize; 2], out: &mut Vec<f32>) {
        let ([nx, ny], [across, along]) = (self.phi.dims(), self.reach);
        let columns = first.saturating_sub(across)..(first + own.len() + across).min(nx);
        let lines = [
            (&mut self.least, f32::INFINITY),
            (&mut self.largest, f32::NEG_INFINITY),
            (&mut self.inside, 0.0),
            (&mut self.row, 0.0),
        ];
        for (line, at) in lines {
            line.clear();
            line.resize(columns.len(), at);
        }
        let rows = j.saturating_sub(along)..(j + along + 1).min(ny);
        for j in rows.clone() {
            self.phi.read(columns.start, j, &mut self.row);
            let sides = self.least.iter_mut().zip(&mut self.largest).zip(&mut self.inside);
            for (((least, largest), inside), v) in sides.zip(&self.row) {
                (*least, *largest) = (least.min(*v), largest.max(*v));
                *inside += f32::from(u8::from(*v < 0.0));
            }
        }
        let px = |v: f32| f64::from(v) / self.side;
        let between = |v: f64, [low, high]: [f64; 2]| smoothstep((v - low) / (high - low));
        // The windows' own, column by column of all of them: sums of whole numbers and bounds are the same in any order.
        let [least, largest, inside] = &mut self.windows;
        for (line, at) in [(&mut *least, f32::INFINITY), (&mut *largest, f32::NEG_INFINITY), (&mut *inside, 0.0)] {
            line.clear();
            line.resize(own.len(), at);
        }
        for shift in 0..2 * across + 1 {
            // Column `first + k + shift - across` of each, as far as there is one.
            let skipped = (across + columns.start).saturating_sub(first + shift);
            let from = first + shift + skipped - across - columns.start;
            let count = own.len().saturating_sub(skipped).min(columns.len().saturating_sub(from));
            if count == 0 {
                continue;
            }
            let [to, of] = [skipped..skipped + count, from..from + count];
            least[to.clone()].iter_mut().zip(&self.least[of.clone()]).for_each(|(least, v)| *least = least.min(*v));
            largest[to.clone()].iter_mut().zip(&self.largest[of.clone()]).for_each(|(most, v)| *most = most.max(*v));
            inside[to].iter_mut().zip(&self.inside[of]).for_each(|(sum, v)| *sum += v);
        }
        out.clear();
        out.extend(own.iter().enumerate().map(|(k, own)| {
            let at = first + k - columns.start;
            let window = at.saturating_sub(across)..(at + across + 1).min(columns.len());
            let all = (rows.len() * window.len()) as f64;
            let inside = f64::from(inside[k]);
            let of = |depth: f32, pixels: f64| (1.0 - between(px(depth), DEPTHS)) * between(self.area * pixels, AREAS);
            let thin = f64::max(of(-least[k], inside), of(largest[k], all - inside));
            (1.0 - thin * (1.0 - between(px(own.abs()), AT_SURFACE))) as f32
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The share beside the edge of a wall so wide, or of a gap, along rows and columns of pixels with these sides.
    fn share(width: f64, gap: bool, spacing: [f64; 2]) -> [f32; 2] {
        [0, 1].map(|axis| {
            let at = |n: usize| [(n % 64) as f64, (n / 64) as f64][axis] * spacing[axis];
            let sign = if gap { -1.0 } else { 1.0 };
            let value = |n: usize| (sign * ((at(n) - 32.2 * spacing[axis]).abs() - 0.5 * width)) as f32;
            let phi = SparseImage::of([64, 64], &(0..64 * 64).map(value).collect::<Vec<_>>());
            let edge = ((32.2 * spacing[axis] + 0.5 * width) / spacing[axis]).ceil() as usize;
            let [i, j] = [[edge, 32], [32, edge]][axis];
            let mut shares = Vec::new();
            Thin::new(&phi, spacing).shares(&[phi.at(i, j)], [i, j], &mut shares);
            shares[0]
        })
    }

    #[test]
    fn a_wall_of_a_pixel_is_left_alone_and_one_of_three_is_not() {
        for gap in [false, true] {
            for spacing in [[1.0, 1.0], [1.0, 0.5], [0.25, 1.0]] {
                assert_eq!(share(1.0, gap, spacing), [0.0; 2], "{spacing:?}");
                assert_eq!(share(3.0, gap, spacing), [1.0; 2], "{spacing:?}");
                assert!(share(1.6, gap, [0.25, 0.25].map(|s| s * 4.0)).iter().all(|share| *share < 0.7));
            }
        }
    }

    #[test]
    fn a_thread_is_no_wall() {
        for gap in [false, true] {
            let sign = if gap { -1.0 } else { 1.0 };
            let value = |n: usize| sign * (libm::hypot((n % 64) as f64 - 20.2, (n / 64) as f64 - 20.4) as f32 - 0.8);
            let phi = SparseImage::of([64, 64], &(0..64 * 64).map(value).collect::<Vec<_>>());
            let mut shares = Vec::new();
            Thin::new(&phi, [1.0; 2]).shares(&[phi.at(21, 20)], [21, 20], &mut shares);
            assert_eq!(shares, [1.0]);
        }
    }

    #[test]
    fn a_thick_body_counts_wherever_it_is_asked() {
        // A disc, and its pixels up to 6 px from the edge on either side, also beside the image's border.
        let value = |n: usize| libm::hypot((n % 64) as f64 - 20.0, (n / 64) as f64 - 20.0) as f32 - 17.3;
        let phi = SparseImage::of([64, 64], &(0..64 * 64).map(value).collect::<Vec<_>>());
        let mut thin = Thin::new(&phi, [1.0; 2]);
        let (mut row, mut shares) = (vec![0.0; 60], Vec::new());
        for j in 0..64 {
            phi.read(2, j, &mut row);
            thin.shares(&row, [2, j], &mut shares);
            assert!(row.iter().zip(&shares).all(|(v, share)| *share == 1.0 || v.abs() > 6.0), "{j}: {shares:?}");
        }
    }
}
