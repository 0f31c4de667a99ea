//! Pure scalar arithmetic of the level-set scheme: WENO5 one-sided derivatives, Godunov's Hamiltonian, TVD-RK3 weights, the tube's
//! cut-off, the smeared sign.

use glam::DVec2;

/// Pixels this close to a front decide about its time step.
pub const FRONT_REACH: f64 = 1.5;
/// The Courant number for which everything that goes by steps is set: largest steps, reinitialisation, patience.
pub const COURANT: f64 = 0.5;

/// Share of a step that a smaller Courant number counts as, at most 1: half the number is half a step in everything, or what goes by steps would
/// be done twice as often in the same time, and the front that it moves would depend on the step for ever.
pub fn step_share(cfl: f64) -> f64 {
    (cfl / COURANT).min(1.0)
}

/// Pixels a WENO5 stencil reaches to each side.
pub const REACH: usize = 3;

/// Keeps the smoothness weights finite (Jiang and Peng 2000, eq. 2.12), for differences of order 1.
pub const EPSILON: f64 = 1e-6;

/// Weights `(a, b)` of the three stages of TVD-RK3, `u <- a u0 + b (u + dt L(u))` (Shu and Osher 1988).
pub const TVD_RK3: [(f64, f64); 3] = [(0.0, 1.0), (0.75, 0.25), (1.0 / 3.0, 2.0 / 3.0)];

/// Fifth-order one-sided derivative from five consecutive difference quotients, `a` farthest upwind (Jiang and Peng 2000).
///
/// The weights `w_k = c_k / (EPSILON + s_k)^2` are brought to one denominator, so that one division serves all.
#[inline(always)]
pub fn weno5(a: f64, b: f64, c: f64, d: f64, e: f64) -> f64 {
    let s1 = 13.0 / 12.0 * (a - 2.0 * b + c).powi(2) + 0.25 * (a - 4.0 * b + 3.0 * c).powi(2);
    let s2 = 13.0 / 12.0 * (b - 2.0 * c + d).powi(2) + 0.25 * (b - d).powi(2);
    let s3 = 13.0 / 12.0 * (c - 2.0 * d + e).powi(2) + 0.25 * (3.0 * c - 4.0 * d + e).powi(2);
    let (q1, q2, q3) = ((EPSILON + s1).powi(2), (EPSILON + s2).powi(2), (EPSILON + s3).powi(2));
    let (w1, w2, w3) = (0.1 * (q2 * q3), 0.6 * (q1 * q3), 0.3 * (q1 * q2));
    let p1 = 1.0 / 3.0 * a - 7.0 / 6.0 * b + 11.0 / 6.0 * c;
    let p2 = -1.0 / 6.0 * b + 5.0 / 6.0 * c + 1.0 / 3.0 * d;
    let p3 = 1.0 / 3.0 * c + 5.0 / 6.0 * d - 1.0 / 6.0 * e;
    (w1 * p1 + w2 * p2 + w3 * p3) / (w1 + w2 + w3)
}

/// Both one-sided derivatives `(minus, plus)` at the middle of seven consecutive values.
#[inline(always)]
pub fn one_sided(v: [f64; 7], per_h: f64) -> (f64, f64) {
    let a = (v[1] - v[0]) * per_h;
    let b = (v[2] - v[1]) * per_h;
    let c = (v[3] - v[2]) * per_h;
    let d = (v[4] - v[3]) * per_h;
    let e = (v[5] - v[4]) * per_h;
    let f = (v[6] - v[5]) * per_h;
    (weno5(a, b, c, d, e), weno5(f, e, d, c, b))
}

/// Godunov's `|grad phi|` for `phi_t + F |grad phi| = 0`, where only the sign of `speed` counts (Rouy and Tourin 1992).
#[inline(always)]
pub fn godunov((xm, xp): (f64, f64), (ym, yp): (f64, f64), speed: f64) -> f64 {
    let s = if speed > 0.0 { 1.0 } else { -1.0 };
    let gx = (s * xm).max(-s * xp).max(0.0);
    let gy = (s * ym).max(-s * yp).max(0.0);
    (gx * gx + gy * gy).sqrt()
}

/// Cut-off `c(phi)` of the speed near the tube's edge: 1 up to `beta`, 0 from `gamma` (Peng et al. 1999, eq. 2.5).
#[inline(always)]
pub fn cut_off(phi: f64, beta: f64, gamma: f64) -> f64 {
    let p = phi.abs().clamp(beta, gamma);
    let away = p - gamma;
    away * away * (2.0 * p + gamma - 3.0 * beta) / ((gamma - beta) * (gamma - beta) * (gamma - beta))
}

/// Smeared sign `S = phi / sqrt(phi^2 + |grad phi|^2 h^2)` with `h = 1` (Peng et al. 1999, eq. 3.4).
#[inline(always)]
pub fn smeared_sign(phi: f64, gradient: DVec2) -> f64 {
    phi / (phi * phi + gradient.x * gradient.x + gradient.y * gradient.y + 1e-12).sqrt()
}

/// The upwind eikonal update on pixels of given sides (Zhao 2005, eq. 2.4).
#[derive(Debug, Clone, Copy)]
pub struct Eikonal {
    h: [f64; 2],
    /// Shares of both neighbours in the mean, and what the discriminant is made of.
    shares: [f64; 2],
    alike: f64,
    apart: f64,
}

impl Eikonal {
    /// The solver for pixel sides `h`.
    pub fn new(h: [f64; 2]) -> Self {
        let [wx, wy] = h.map(|side| 1.0 / (side * side));
        let sum = wx + wy;
        Eikonal { h, shares: [wx / sum, wy / sum], alike: 1.0 / sum, apart: wx * wy / (sum * sum) }
    }

    /// Solution `v` of `((v - a)+ / hx)^2 + ((v - b)+ / hy)^2 = 1`.
    #[inline(always)]
    pub fn solve(&self, a: f64, b: f64) -> f64 {
        let one = (a + self.h[0]).min(b + self.h[1]);
        // Both neighbours count where the one-sided answer lies above them.
        let discriminant = self.alike - self.apart * (a - b) * (a - b);
        if one > a.max(b) && discriminant > 0.0 {
            self.shares[0] * a + self.shares[1] * b + discriminant.sqrt()
        } else {
            one
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-12, "{a}, not {b}");
    }

    #[test]
    fn half_the_courant_number_is_half_a_step_and_none_counts_more_than_one() {
        for (cfl, share) in [(COURANT, 1.0), (0.5 * COURANT, 0.5), (0.1 * COURANT, 0.1), (1.6 * COURANT, 1.0)] {
            near(step_share(cfl), share);
        }
    }

    #[test]
    fn the_cut_off_goes_from_one_to_nothing_and_is_even() {
        // (p - gamma)^2 (2 p + gamma - 3 beta) / (gamma - beta)^3, half way between: 1/2.
        for (phi, c) in [(0.0, 1.0), (2.0, 1.0), (3.0, 0.84375), (4.0, 0.5), (5.0, 0.15625), (6.0, 0.0), (7.0, 0.0)] {
            near(cut_off(phi, 2.0, 6.0), c);
            near(cut_off(-phi, 2.0, 6.0), c);
        }
    }

    #[test]
    fn the_smeared_sign_is_that_of_a_right_triangle() {
        near(smeared_sign(3.0, DVec2::new(0.0, 4.0)), 0.6);
        near(smeared_sign(-3.0, DVec2::new(4.0, 0.0)), -0.6);
        near(smeared_sign(6.0, DVec2::new(2.0, 3.0)), 6.0 / 7.0);
    }

    #[test]
    fn a_wave_from_two_neighbours_has_unit_slope() {
        for h in [[1.0, 1.0], [0.5, 1.0], [1.0, 0.3]] {
            let eikonal = Eikonal::new(h);
            for (a, b) in [(0.2, 0.3), (0.3, 0.2), (0.0, 0.0), (-1.0, -1.1)] {
                let v = eikonal.solve(a, b);
                near(((v - a) / h[0]).powi(2) + ((v - b) / h[1]).powi(2), 1.0);
                assert!(v > a && v > b, "{v} comes from ({a}, {b})");
            }
            // The later neighbour lies beyond the front: one counts.
            near(eikonal.solve(0.0, 9.0), h[0]);
            near(eikonal.solve(9.0, 0.0), h[1]);
        }
    }
}
