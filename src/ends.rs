//! What the body does beyond its first and last contour.

use crate::backend::Backend;
use crate::caps::{Cap, Profile};
use crate::compose::{Canvas, mean_slope, part_numbers, unite_cap};
use crate::contours::Contour;
use crate::error::Result;
use crate::field::covered;
use crate::fit::Fitted;
use crate::jobs::Direction;
use crate::matching::lone_solids;
use crate::settings::EndRule;

/// Power of the cap law for a part that a peak closes although its contour does not shrink.
const UPRIGHT_POWER: f64 = 0.5;
/// Width of a bin where the area of a cap is asked many times, px, and layers of the integral of its volume.
const BIN: f64 = 0.02;
const CAP_LAYERS: usize = 200;

/// One end of the body.
#[derive(Debug, Clone)]
pub struct End {
    /// Height of its contour.
    pub contour: f64,
    /// Height at which the body ends.
    pub extent: f64,
    /// Caps of its parts; `away` is measured in the stack's unit.
    caps: Vec<Cap>,
    /// The contour goes on unchanged up to `extent`.
    straight: bool,
}

impl End {
    /// Where a section of a stack is cut off.
    pub fn cut(contour: f64) -> Self {
        End { contour, extent: contour, caps: Vec::new(), straight: false }
    }

    /// Whether the body can be found at height `z` beyond its contour.
    pub fn reaches(&self, z: f64) -> bool {
        (z - self.contour).abs() <= (self.extent - self.contour).abs()
    }

    /// Volume beyond the contour, whose area is `area`, within the image; lengths in px along the layers, so px squared times the stack's unit.
    pub fn volume(&self, area: f64, image: &Canvas) -> f64 {
        if self.straight {
            return area * (self.extent - self.contour).abs();
        }
        self.caps.iter().fold(0.0, |sum, cap| sum + cap_volume(cap, image))
    }

    /// The layer at height `z` beyond the end's contour.
    pub fn layer(&self, z: f64, contour: &Contour, mut canvas: Canvas) -> Canvas {
        if self.straight && self.reaches(z) {
            return Canvas::of_contour(canvas.dims, canvas.pad, canvas.limit, &contour.phi);
        }
        for cap in &self.caps {
            unite_cap(&mut canvas, cap, (z - self.contour).abs());
        }
        canvas
    }
}

/// Volume of a cap: the area of its layers, integrated by the midpoint rule. Areas come from a histogram of its field.
fn cap_volume(cap: &Cap, image: &Canvas) -> f64 {
    let last = ((cap.depth + 1.0) / BIN) as usize;
    let mut histogram = vec![0u64; last + 1];
    image.visit(&cap.tile, |_, n| {
        let below = 0.5 - cap.field.data[n];
        if below > 0.0 {
            histogram[((below / BIN) as usize).min(last)] += 1;
        }
    });
    let area = |offset: f64| -> f64 {
        let share = |bin: usize| covered(0.5 - (bin as f64 + 0.5) * BIN + offset);
        histogram.iter().enumerate().map(|(bin, count)| *count as f64 * share(bin)).sum()
    };
    let step = cap.height / CAP_LAYERS as f64;
    (0..CAP_LAYERS).map(|k| area(cap.offset((k as f64 + 0.5) * step)) * step).sum()
}

/// What an end needs to know.
pub struct EndSpec<'a> {
    /// The first or last contour.
    pub contour: &'a Contour,
    /// Its slopes.
    pub fitted: &'a Fitted,
    /// Down at the first, up at the last.
    pub direction: Direction,
    /// Rule.
    pub rule: EndRule,
    /// Distance to the neighbouring contour.
    pub gap: f64,
    /// Largest height of an extrapolated cap.
    pub highest: f64,
    /// Margin of tiles, px.
    pub margin: usize,
}

/// Builds an end: `r = D (1 - t/H)^p`, `p = |m| H / D`, `H = D / (2 |m|)` or the height to the peak. Warnings go to `warnings`.
pub fn end(spec: &EndSpec<'_>, h: [f64; 2], backend: &dyn Backend, warnings: &mut Vec<String>) -> Result<End> {
    let z = spec.contour.z;
    let sign = if spec.direction == Direction::Up { 1.0 } else { -1.0 };
    let side = if spec.direction == Direction::Up { "top" } else { "bottom" };
    let mut end = End { contour: z, extent: z, caps: Vec::new(), straight: false };
    let tip = match spec.rule {
        _ if spec.contour.solids.count == 0 => return Ok(end),
        EndRule::Flat => return Ok(end),
        EndRule::HalfSlice => {
            end.extent = z + sign * 0.5 * spec.gap;
            end.straight = true;
            return Ok(end);
        }
        EndRule::Extrapolate => None,
        EndRule::Peak(tip) => Some((tip - z).abs()),
    };
    for (number, part) in part_numbers(spec.contour).into_iter().zip(lone_solids(
        spec.contour,
        &part_numbers(spec.contour),
        h,
        spec.margin,
        spec.direction,
        backend,
    )?) {
        let m = mean_slope(spec.fitted, &part.seeds) * sign;
        let (height, power) = match tip {
            Some(height) if m < 0.0 => (height, -m * height / part.depth),
            Some(height) => {
                warnings.push(format!("{side} end: part {number} does not shrink towards its peak; closed upright"));
                (height, UPRIGHT_POWER)
            }
            None if m < 0.0 => {
                let height = (part.depth / (-2.0 * m)).min(spec.highest);
                (height, -m * height / part.depth)
            }
            None => {
                warnings
                    .push(format!("{side} end: part {number} does not shrink (slope {m:.3} px per unit); ends flat"));
                continue;
            }
        };
        end.caps.push(Cap {
            tile: part.tile,
            field: part.field,
            depth: part.depth,
            height,
            profile: Profile::Power(power),
        });
        if height > (end.extent - z).abs() {
            end.extent = z + sign * height;
        }
    }
    Ok(end)
}
