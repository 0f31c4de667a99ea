//! Every numeric parameter, once: unit and range beside each field, the default in `impl Default`. The command line (clap) and
//! the settings file (serde) read this same struct.
//!
//! Lengths are in pixels of the larger pixel side, times in normalised time of an interval (0 at one contour, 1 at the next).

use std::fmt;
use std::str::FromStr;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Rule by which a mask's staircase becomes a smooth contour. No rule flips a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AntiAlias {
    /// The contour runs half way between pixels.
    None,
    /// Ten iterations of the reinitialisation equation on the binary field (the paper's way).
    Eq6,
    /// Smoothing with `2G - G*G`, which has no second moment and so shrinks nothing, within 0.25 px of the exact distance.
    Kernel,
}

/// Rule for the slope dS/dz of the distance along each correspondence at a contour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SlopeRule {
    /// Straight lines: a crease at every contour.
    Linear,
    /// Natural cubic spline through all contours: smoothest, overshoots.
    Natural,
    /// Natural cubic spline with Hyman's monotone filter: no overshoot.
    Hyman,
    /// Harmonic mean of Fritsch and Carlson: local, never overshoots.
    Pchip,
    /// Mean of the neighbouring secants by distance (Catmull-Rom): local, may overshoot.
    Catmull,
}

impl SlopeRule {
    /// Whether a curve with these slopes may leave the range of its points.
    pub(crate) fn overshoots(self) -> bool {
        matches!(self, SlopeRule::Natural | SlopeRule::Catmull)
    }
}

/// End condition of the cubic spline of `natural` and `hyman` at the first and last contour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SplineEnd {
    /// No curvature at the end.
    Natural,
    /// Constant curvature over the end interval.
    Parabolic,
    /// The two end intervals are one cubic.
    NotAKnot,
}

/// Method by which slices become a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Metamorphosis: contours morph into each other and sweep out the surface.
    Morph,
    /// The slices' distances interpolated along the moving frame: faster.
    Field,
}

/// Sweeps of an interval that make the layers between its contours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    /// Sweeps from both contours; each counts most beside its own contour.
    Both,
    /// One sweep, upwards from the lower contour, as published: it meets the upper contour as well as its steering leads it there.
    Forward,
}

/// The frame in which neighbouring slices are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// A smooth field of displacements.
    Field,
    /// Rigid frames of single parts: an isolated part is shifted and turned from slice to slice, where that is worthwhile.
    Rigid,
    /// Slices stay where they are.
    None,
}

/// Whether parts of neighbouring slices that miss each other are taken for one and the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Linking {
    /// Never, except parts that a links file names.
    Off,
    /// Parts that are each other's nearest and alike: area ratio 0.5 to 2, overlap above 0.6 once their centroids lie on each other.
    Auto,
}

/// Rule for the body beyond the first or last contour.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum EndRule {
    /// Stop at the contour with a flat lid.
    Flat,
    /// Keep the contour for half a gap, then a flat lid.
    HalfSlice,
    /// Close as the areas of the last three or four contours say: exact for spheres, ellipsoids, paraboloids and cones.
    Extrapolate,
    /// Close at this height (unit of the stack), beginning as these areas do.
    Peak(f64),
}

impl fmt::Display for EndRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            EndRule::Flat => f.write_str("flat"),
            EndRule::HalfSlice => f.write_str("half-slice"),
            EndRule::Extrapolate => f.write_str("extrapolate"),
            EndRule::Peak(z) => write!(f, "peak={z}"),
        }
    }
}

impl FromStr for EndRule {
    type Err = String;

    fn from_str(s: &str) -> std::result::Result<Self, String> {
        match s {
            "flat" => Ok(EndRule::Flat),
            "half-slice" => Ok(EndRule::HalfSlice),
            "extrapolate" => Ok(EndRule::Extrapolate),
            _ => s
                .strip_prefix("peak=")
                .and_then(|z| z.parse::<f64>().ok())
                .filter(|z| z.is_finite())
                .map(EndRule::Peak)
                .ok_or_else(|| format!("must be flat, half-slice, extrapolate or peak=HEIGHT; got `{s}`")),
        }
    }
}

impl TryFrom<String> for EndRule {
    type Error = String;

    fn try_from(s: String) -> std::result::Result<Self, String> {
        s.parse()
    }
}

impl From<EndRule> for String {
    fn from(rule: EndRule) -> String {
        rule.to_string()
    }
}

/// Statement about a pair of parts of neighbouring slices: they belong together, or they do not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Link {
    /// The lower slice, from 0.
    pub slice: usize,
    /// Its part, from 1.
    pub from: u32,
    /// The part of the next slice, from 1.
    pub to: u32,
    /// Whether they belong together.
    #[serde(default = "joined")]
    pub join: bool,
}

fn joined() -> bool {
    true
}

/// The place of the end slopes in `--help`: behind the rules for the ends.
const END_SLOPES: usize = 1000;
/// Largest height of an extrapolated end, gaps, where none is asked for.
const CAP_GAPS: f64 = 2.0;

/// Every numeric parameter of a reconstruction.
#[derive(Debug, Clone, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Method")]
pub struct Settings {
    /// Method by which slices become a body
    #[arg(long, value_enum, default_value_t = Settings::default().method)]
    pub method: Method,

    /// Fairing along z that makes the input contours invisible, 0 (none) to 1.5
    #[arg(long, value_name = "STRENGTH", default_value_t = Settings::default().fair)]
    pub fair: f64,

    /// Frame in which parts that move sideways are followed
    #[arg(long, value_enum, default_value_t = Settings::default().motion)]
    pub motion: Motion,

    /// Rule by which parts that miss each other are taken for the same
    #[arg(long, value_enum, default_value_t = Settings::default().link)]
    pub link: Linking,

    /// Largest distance of such parts, centroid from centroid, in radii of a circle of the larger one's area, (0, 20]
    #[arg(long, value_name = "RADII", default_value_t = Settings::default().link_reach)]
    pub link_reach: f64,

    /// Links that a person sets between pairs of parts; on the command line from a file
    #[arg(skip)]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub links: Vec<Link>,

    /// Rule by which a mask's staircase becomes a smooth contour
    #[arg(long, value_enum, default_value_t = Settings::default().anti_alias)]
    pub anti_alias: AntiAlias,

    /// Width of the anti-aliasing kernel, samples, (0, 5]
    #[arg(long, value_name = "PX", default_value_t = Settings::default().sigma)]
    pub sigma: f64,

    /// Rule for the slope of the surface at the contours
    #[arg(long, value_enum, default_value_t = Settings::default().slope)]
    pub slope: SlopeRule,

    /// Ends of the cubic spline (natural and hyman) [default: natural for natural, parabolic for hyman]
    #[arg(long, value_enum)]
    pub spline_end: Option<SplineEnd>,

    /// Slope of the surface at the first contour, outward length per height (same unit), instead of the rule's own
    #[arg(long, value_name = "SLOPE", help_heading = "Ends", display_order = END_SLOPES)]
    pub clamp_bottom: Option<f64>,

    /// Slope of the surface at the last contour, outward length per height (same unit), instead of the rule's own
    #[arg(long, value_name = "SLOPE", help_heading = "Ends", display_order = END_SLOPES)]
    pub clamp_top: Option<f64>,

    /// Below the first contour: flat, half-slice, extrapolate or peak=HEIGHT
    #[arg(long, value_name = "RULE", default_value_t = Settings::default().end_bottom, help_heading = "Ends")]
    pub end_bottom: EndRule,

    /// Above the last contour: flat, half-slice, extrapolate or peak=HEIGHT
    #[arg(long, value_name = "RULE", default_value_t = Settings::default().end_top, help_heading = "Ends")]
    pub end_top: EndRule,

    /// Largest height of an extrapolated end, in gaps to where the next slice would lie, (0, 10] [default: 2 of the wider of the last two that count, of a contour map 1: the next level was not drawn]
    #[arg(long, value_name = "GAPS", help_heading = "Ends")]
    pub cap_gaps: Option<f64>,

    /// Sweeps that make the layers between contours
    #[arg(long, value_enum, default_value_t = Settings::default().sweep)]
    pub sweep: Sweep,

    /// Re-estimate the remaining distances by a new morph every N steps of the sweep, on the CPU; 0: never
    #[arg(long, value_name = "N", default_value_t = Settings::default().redistance)]
    pub redistance: usize,

    /// Courant number: pixels the front may move in a step, [0.05, 0.9]
    #[arg(long, value_name = "NUMBER", default_value_t = Settings::default().cfl)]
    pub cfl: f64,

    /// Half width of the tube in which the level set lives (gamma), px, [4, 12]
    #[arg(long, value_name = "PX", default_value_t = Settings::default().half_width)]
    pub half_width: f64,

    /// Beginning of the tube's cut-off (beta), px, [1, half_width - 1]
    #[arg(long, value_name = "PX", default_value_t = Settings::default().cut_off)]
    pub cut_off: f64,

    /// Distance between tracker particles along a contour, px, [0.05, 2]
    #[arg(long, value_name = "PX", default_value_t = Settings::default().seed_spacing)]
    pub seed_spacing: f64,

    /// A morph has arrived when no crossing is farther than this from the next contour, px, [0.01, 0.5]
    #[arg(long, value_name = "PX", default_value_t = Settings::default().tolerance)]
    pub tolerance: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            method: Method::Morph,
            motion: Motion::Field,
            link: Linking::Off,
            link_reach: 4.0,
            links: Vec::new(),
            fair: 1.5,
            anti_alias: AntiAlias::Kernel,
            sigma: 1.0,
            slope: SlopeRule::Hyman,
            spline_end: None,
            clamp_bottom: None,
            clamp_top: None,
            end_bottom: EndRule::Flat,
            end_top: EndRule::Flat,
            cap_gaps: None,
            sweep: Sweep::Both,
            redistance: 0,
            cfl: 0.5,
            half_width: 6.0,
            cut_off: 3.0,
            seed_spacing: 0.5,
            tolerance: 0.1,
        }
    }
}

impl Settings {
    /// Ends of the cubic spline: where none are asked for, those that make `natural` the natural spline, and else parabolic ones, which follow a
    /// body that tapers.
    pub fn spline_end(&self) -> SplineEnd {
        self.spline_end.unwrap_or(match self.slope {
            SlopeRule::Natural => SplineEnd::Natural,
            _ => SplineEnd::Parabolic,
        })
    }

    /// Width of "outside" around every image and tile, px: a front may leave its contours by this much.
    pub fn margin(&self) -> usize {
        self.half_width.ceil() as usize + 8
    }

    /// Whether the first and the last contour have a slope that a rule for ends or a person has set.
    pub(crate) fn steered_ends(&self) -> [bool; 2] {
        [(self.end_bottom, self.clamp_bottom), (self.end_top, self.clamp_top)]
            .map(|(rule, clamp)| rule != EndRule::Flat || clamp.is_some())
    }

    /// Largest height of an extrapolated end, where the next slice would lie beyond a gap `to_next`, and the gap of the slices that have a say is
    /// `of_ending`. A slice close beside the last one says no less of how the body ends.
    pub(crate) fn highest_cap(&self, to_next: f64, of_ending: f64) -> f64 {
        self.cap_gaps.map_or(CAP_GAPS * of_ending, |count| count * to_next)
    }

    /// A sentence for each setting that was changed and changes nothing, because of another.
    pub fn idle(&self) -> Vec<String> {
        let own = Settings::default();
        let morph = self.method == Method::Morph;
        let extrapolated = [self.end_bottom, self.end_top].contains(&EndRule::Extrapolate);
        let splines = matches!(self.slope, SlopeRule::Natural | SlopeRule::Hyman);
        // Fairing asks whether slopes may overshoot.
        let slope = self.slope.overshoots() != own.slope.overshoots() && self.fair > 0.0;
        let settings = [
            ("link_reach", self.link_reach != own.link_reach, self.link == Linking::Auto, "`link` = auto"),
            ("sigma", self.sigma != own.sigma, self.anti_alias == AntiAlias::Kernel, "`anti_alias` = kernel"),
            ("slope", self.slope != own.slope, morph || slope, "`method` = morph"),
            ("spline_end", self.spline_end.is_some(), splines && morph, "`slope` = natural or hyman, `method` = morph"),
            ("cap_gaps", self.cap_gaps.is_some(), extrapolated, "an end that is to `extrapolate`"),
            ("sweep", self.sweep != own.sweep, morph, "`method` = morph"),
            ("redistance", self.redistance != own.redistance, morph, "`method` = morph"),
            ("cfl", self.cfl != own.cfl, morph, "`method` = morph"),
            ("cut_off", self.cut_off != own.cut_off, morph, "`method` = morph"),
            ("seed_spacing", self.seed_spacing != own.seed_spacing, morph, "`method` = morph"),
            ("tolerance", self.tolerance != own.tolerance, morph, "`method` = morph"),
        ];
        let idle = settings.into_iter().filter(|(_, changed, counts, _)| *changed && !counts);
        idle.map(|(name, .., of)| format!("setting `{name}` changes nothing: it is for {of}")).collect()
    }

    /// Checks every range.
    ///
    /// # Errors
    /// [`Error::Setting`] with name, range and value.
    pub fn validate(&self) -> Result<()> {
        let within = |name: &str, value: f64, low: f64, high: f64, low_open: bool| {
            if value >= low && value <= high && !(low_open && value == low) {
                return Ok(());
            }
            let bracket = if low_open { '(' } else { '[' };
            let message = format!("must lie in {bracket}{low}, {high}]; got {value}");
            Err(Error::Setting { name: name.into(), message })
        };
        within("sigma", self.sigma, 0.0, 5.0, true)?;
        within("cap_gaps", self.cap_gaps.unwrap_or(CAP_GAPS), 0.0, 10.0, true)?;
        within("fair", self.fair, 0.0, 1.5, false)?;
        within("link_reach", self.link_reach, 0.0, 20.0, true)?;
        within("cfl", self.cfl, 0.05, 0.9, false)?;
        within("half_width", self.half_width, 4.0, 12.0, false)?;
        within("cut_off", self.cut_off, 1.0, self.half_width - 1.0, false)?;
        within("seed_spacing", self.seed_spacing, 0.05, 2.0, false)?;
        within("tolerance", self.tolerance, 0.01, 0.5, false)?;
        if self.method == Method::Field && (self.clamp_bottom.is_some() || self.clamp_top.is_some()) {
            let message = "need `method` morph: the field method takes its slopes from the slices".to_string();
            return Err(Error::Setting { name: "clamp_bottom and clamp_top".into(), message });
        }
        let joins = self.links.iter().any(|l| l.join);
        if self.motion == Motion::None && (joins || self.link == Linking::Auto) {
            let name = if joins { "links" } else { "link" };
            let message =
                "needs `motion` field or rigid: parts that miss each other meet in a moving frame only".into();
            return Err(Error::Setting { name: name.into(), message });
        }
        if self.method == Method::Field && self.links.iter().any(|l| !l.join) {
            let message = "with `join` false need `method` morph: the field method joins whatever overlaps".into();
            return Err(Error::Setting { name: "links".into(), message });
        }
        for (name, slope) in [("clamp_bottom", self.clamp_bottom), ("clamp_top", self.clamp_top)] {
            if let Some(m) = slope
                && !m.is_finite()
            {
                return Err(Error::Setting { name: name.into(), message: format!("must be a finite number; got {m}") });
            }
        }
        Ok(())
    }
}
