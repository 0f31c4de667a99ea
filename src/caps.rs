//! Parts that end: an offset of their own distance field that closes them at a given height.

use crate::field::Field;
use crate::tile::Tile;

/// Powers of the cap law outside this range look like a needle or a lid.
const POWERS: std::ops::RangeInclusive<f64> = 0.3..=2.0;
/// Below this power a part that ends inside an interval closes as a quarter ellipse.
const ROUND_BELOW: f64 = 0.15;

/// At its tip a part is gone, whichever way the height was rounded.
const AT_TIP: f64 = 1.0 - 1e-6;

/// How a part's inradius falls from D at q = 0 to 0 at q = 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Profile {
    /// Quarter ellipse, `sqrt(1 - q^2)`: leaves the contour upright.
    Ellipse,
    /// `(1 - q)^p`: leaves the contour with slope `-p D / H`.
    Power(f64),
}

impl Profile {
    /// The profile of a part that ends between two contours, `shrinking = -m H / D` by the slope m of its own contour.
    pub fn between(shrinking: f64) -> Self {
        if shrinking > ROUND_BELOW {
            Profile::Power(shrinking.clamp(*POWERS.start(), *POWERS.end()))
        } else {
            Profile::Ellipse
        }
    }

    /// Radius over depth at `q` in [0, 1].
    pub fn radius(self, q: f64) -> f64 {
        let q = q.clamp(0.0, 1.0);
        match self {
            Profile::Ellipse => (1.0 - q * q).sqrt(),
            Profile::Power(p) => (1.0 - q).powf(p),
        }
    }
}

/// A part that closes at `height` above (or below) its contour.
#[derive(Debug, Clone)]
pub struct Cap {
    /// Where it is.
    pub tile: Tile,
    /// Its signed distance at the contour, negative inside.
    pub field: Field,
    /// Its inradius D, px.
    pub depth: f64,
    /// Where it closes, in the unit in which [`Cap::offset`] is asked.
    pub height: f64,
    /// How it closes.
    pub profile: Profile,
}

impl Cap {
    /// What is added to the field at a distance `away` from the contour: `D (1 - r(q))`, beyond the tip as far again as it is away.
    pub fn offset(&self, away: f64) -> f64 {
        let q = away / self.height;
        self.depth * if q < AT_TIP { 1.0 - self.profile.radius(q) } else { q / AT_TIP }
    }
}
