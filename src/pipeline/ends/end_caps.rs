//! Ends of the body beyond its first and last contour.
//!
//! A part closes by an [area law](crate::pipeline::ends::end_law): its layers are its contour drawn in, by as much at every height as gives them the area of the
//! law. Holes follow laws of their own, so that shells, tubes and rings end as such.

use crate::contour::Contour;
use crate::contour::canvas::Canvas;
use crate::contour::direction::Direction;
use crate::contour::offsets::{OUT, Offsets};
use crate::contour::unmatched::HALF_WAY;
use crate::grid::field::Field;
use crate::grid::tile::Tile;
use crate::pipeline::compose::mean_slope;
use crate::pipeline::ends::end_law::{Law, quadratic};
use crate::pipeline::ends::end_parts::{EndPart, Region};
use crate::pipeline::fit::Fitted;
use crate::report::CapRule;
use crate::settings::EndRule;

/// Layers of the integral of a cap's volume: the error of the midpoint rule for a square root's end is 1e-4 of it.
const CAP_LAYERS: usize = 200;
/// The slope at which a contour passes into its end is at most this many secants: a cubic course is monotone up to there (Fritsch and
/// Carlson 1980).
const STEEPEST: f64 = 3.0;

/// Steps to a gap in which the plane is told where an extrapolated body ends. A tip is where areas that hardly differ say, and single precision
/// knows it to 1e-4 gaps at worst; layers are the same for whoever computes.
const PLANES: f64 = 1024.0;
/// Share of a step by which a tip may lie beyond its plane: whole steps are common, and rounding must not decide.
const BEYOND: f64 = 0.01;
/// Half the width of what is left below a tip whose height is given, px: an area of less than half a pixel is that of no line, and what is not drawn in
/// farther than this ends at the tip. A line of half a pixel to either side has the area of pixels that are just touched.
const LEAST_HALF_WIDTH: f64 = 0.25;

/// One end of the body.
#[derive(Debug, Clone)]
pub struct End {
    /// Height of its contour.
    pub contour: f64,
    /// Height at which the body ends.
    pub extent: f64,
    /// Ends of its parts, by number; nothing under rules that ask for no caps.
    pub told: Vec<Told>,
    caps: Vec<Cap>,
    /// The contour goes on unchanged up to `extent`.
    straight: bool,
}

/// End of a part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Told {
    /// Component number.
    pub part: u32,
    /// By which rule.
    pub rule: CapRule,
    /// Height beyond its contour, the stack's unit.
    pub height: f64,
}

/// Area of a hole beyond the contour.
#[derive(Debug, Clone, Copy)]
enum HoleLaw {
    Closes(Law),
    /// Value, slope and half the second derivative.
    Grows([f64; 3]),
}

impl HoleLaw {
    /// By its areas in contours at distances `away` inward; a hole of which nothing else is known goes on as it is.
    fn new(areas: &[f64], away: &[f64]) -> Self {
        // One that lies beyond what is known.
        if areas[0] <= 0.0 {
            return HoleLaw::Grows([0.0; 3]);
        }
        // As a part that the next contour has not, it is taken to begin half way.
        if let [area, 0.0] = *areas {
            return HoleLaw::Grows([area, area / (HALF_WAY * away[1]), 0.0]);
        }
        match Law::through(areas, away, f64::INFINITY) {
            Some((law, _)) => HoleLaw::Closes(law),
            None => {
                let secant = if let [a, b, ..] = areas { (a - b) / away[1] } else { 0.0 };
                let [slope, bend] = quadratic(areas, away).unwrap_or([secant, 0.0]);
                HoleLaw::Grows([areas[0], slope, bend])
            }
        }
    }

    fn slope(&self) -> f64 {
        match self {
            HoleLaw::Closes(law) => law.slope(),
            HoleLaw::Grows([_, slope, _]) => slope.max(0.0),
        }
    }

    fn at(&self, t: f64) -> f64 {
        match self {
            HoleLaw::Closes(law) => law.at(t),
            HoleLaw::Grows([area, slope, bend]) => area.max(area + (slope + bend * t) * t),
        }
    }
}

/// A closed line beyond the contour.
#[derive(Debug, Clone)]
struct CapLine {
    /// Tile on which it lies, in pixels of the part's.
    tile: Tile,
    /// Signed distance at the contour, negative within.
    field: Field,
    offsets: Offsets,
}

impl CapLine {
    fn new(region: &Region, part: Tile) -> Self {
        CapLine { tile: region.tile.within(part), field: region.field.clone(), offsets: region.offsets.clone() }
    }
}

/// A part that closes.
#[derive(Debug, Clone)]
struct Cap {
    tile: Tile,
    outline: CapLine,
    /// Inradius of the outline, px.
    depth: f64,
    law: Law,
    holes: Vec<(CapLine, HoleLaw)>,
    /// Height at which nothing is left of it.
    tip: f64,
    /// The tip is given, not told by areas: something is left up to there.
    given: bool,
}

impl Cap {
    fn new(part: &EndPart, law: Law, given: bool, away: &[f64]) -> Self {
        let outline = CapLine::new(&part.outline, part.tile);
        let depth = outline.offsets.depth;
        let holes =
            part.holes.iter().map(|hole| (CapLine::new(hole, part.tile), HoleLaw::new(&hole.areas, away))).collect();
        let mut cap = Cap { tile: part.tile, outline, depth, law, holes, tip: law.height, given };
        // A ring is gone where its hole has become as large as itself.
        let gone = (1..CAP_LAYERS).map(|k| cap.height_of(k as f64)).find(|t| cap.area(*t) <= 0.0);
        cap.tip = gone.unwrap_or(law.height);
        cap
    }

    fn height_of(&self, layer: f64) -> f64 {
        layer / CAP_LAYERS as f64 * self.law.height
    }

    /// Area at a distance `t` beyond the contour.
    fn area(&self, t: f64) -> f64 {
        (self.law.at(t) - self.holes.iter().map(|(_, law)| law.at(t)).sum::<f64>()).max(0.0)
    }

    fn volume(&self) -> f64 {
        (0..CAP_LAYERS).map(|k| self.area(self.height_of(k as f64 + 0.5))).sum::<f64>() * self.height_of(1.0)
    }

    /// The offset that leaves nothing, and below a given tip as much as a disc of the law's area is deep.
    fn deepest(&self, t: f64) -> f64 {
        let radius = (self.law.at(t) / std::f64::consts::PI).sqrt();
        if self.given { self.depth - radius.min(LEAST_HALF_WIDTH) } else { self.depth }
    }

    /// Unites a layer with the cap `t` beyond the contour.
    fn unite(&self, canvas: &mut Canvas, t: f64) {
        // Beyond its tip as far again as it is away, so that the surface between layers passes through the tip.
        let offset = match t < self.law.height {
            true => self.outline.offsets.of(self.law.at(t)).min(self.deepest(t)),
            // In this order never less than the depth: a crumb would be left.
            false => self.depth * (t / self.law.height),
        };
        let mut body = self.outline.field.clone();
        body.data.iter_mut().for_each(|v| *v += offset);
        for (line, law) in &self.holes {
            line.tile.cut_out(&line.field, line.offsets.of(law.at(t)), &mut body);
        }
        canvas.unite(&self.tile, |n| body.data[n]);
    }
}

impl End {
    /// The end at which a section of a stack is cut off.
    pub fn cut(contour: f64) -> Self {
        End { contour, extent: contour, told: Vec::new(), caps: Vec::new(), straight: false }
    }

    /// Whether the body can be found at height `z` beyond its contour.
    pub fn reaches(&self, z: f64) -> bool {
        (z - self.contour).abs() <= (self.extent - self.contour).abs()
    }

    /// Volume beyond the contour, whose area is `area`; lengths in px along the layers, so px squared times the stack's unit.
    pub fn volume(&self, area: f64) -> f64 {
        if self.straight {
            return area * (self.extent - self.contour).abs();
        }
        self.caps.iter().fold(0.0, |sum, cap| sum + cap.volume())
    }

    /// The layer at height `z` beyond the end's contour.
    pub fn layer(&self, z: f64, contour: &Contour, mut canvas: Canvas) -> Canvas {
        if self.straight && self.reaches(z) {
            return Canvas::of_contour(canvas.dims, canvas.pad, canvas.limit, &contour.phi);
        }
        self.caps.iter().for_each(|cap| cap.unite(&mut canvas, (z - self.contour).abs()));
        canvas
    }
}

/// Facts that decide an end.
pub struct EndSpec<'a> {
    /// Height of the first or last contour.
    pub z: f64,
    /// Its parts.
    pub parts: &'a [EndPart],
    /// Distances inward of the contours by which they end, the first 0.
    pub away: &'a [f64],
    /// Down at the first, up at the last.
    pub direction: Direction,
    /// Rule.
    pub rule: EndRule,
    /// Distance to the neighbouring contour.
    pub gap: f64,
    /// Largest height of an extrapolated cap.
    pub highest: f64,
    /// Whether a person has given the slope.
    pub clamped: bool,
    /// Share of the slopes that the areas tell, 0 to 1: none of relief, whose contours go on beyond the border of the map and merge with others
    /// below.
    pub told_by_areas: f64,
}

impl EndSpec<'_> {
    fn sign(&self) -> f64 {
        if self.direction == Direction::Up { 1.0 } else { -1.0 }
    }

    /// Height beyond the contour at which a body ends whose highest tip is at `height`.
    fn plane(&self, height: f64) -> f64 {
        match self.rule {
            EndRule::Extrapolate if height > 0.0 && self.gap > 0.0 => {
                let steps = (height / self.gap * PLANES - BEYOND).ceil().max(1.0);
                (steps / PLANES * self.gap).min(self.highest.max(height))
            }
            _ => height,
        }
    }

    /// The law of a part by its areas alone.
    fn by_areas(&self, part: &EndPart) -> Option<(Law, CapRule)> {
        // A peak is as high as a person says.
        let highest = if let EndRule::Peak(_) = self.rule { f64::INFINITY } else { self.highest };
        let (law, rule) = (!self.clamped).then(|| Law::through(&part.outline.areas, self.away, highest))??;
        match self.rule {
            EndRule::Peak(tip) => Some((Law::ending(law.area, law.slope(), (tip - self.z).abs()), CapRule::Peak)),
            _ => Some((law, rule)),
        }
    }

    /// The law of a part, and by which rule; `slopes` are the contour's, outward per height away from the body.
    fn law(&self, part: &EndPart, slopes: impl Fn(&[u32]) -> f64) -> (Option<Law>, CapRule) {
        if let Some((law, rule)) = self.by_areas(part) {
            return (Some(law), rule);
        }
        let (area, tip) = (part.outline.areas[0], |z: f64| (z - self.z).abs());
        // What the next contour says of the area, the contour's own slope is not asked.
        let slope = match self.clamped || part.outline.areas.len() == 1 {
            true => slopes(part.outline.counted()) * part.outline.offsets.perimeter(),
            false => 0.0,
        };
        match (self.rule, Law::paraboloid(area, slope, self.highest)) {
            (EndRule::Peak(z), Some(_)) => (Some(Law::ending(area, slope, tip(z))), CapRule::Peak),
            (EndRule::Peak(z), None) => (Some(Law::ending(area, 0.0, tip(z))), CapRule::Upright),
            (_, Some(law)) => (Some(law), CapRule::Slope),
            (_, None) => (None, CapRule::Flat),
        }
    }
}

/// Builds an end from its parts and the slopes of its contour. Warnings go to `warnings`.
pub fn end(spec: &EndSpec<'_>, fitted: &Fitted, warnings: &mut Vec<String>) -> End {
    let (z, sign) = (spec.z, spec.sign());
    let side = if spec.direction == Direction::Up { "top" } else { "bottom" };
    let mut end = End::cut(z);
    match spec.rule {
        _ if spec.parts.is_empty() => return end,
        EndRule::Flat => return end,
        EndRule::HalfSlice => {
            end.extent = z + sign * 0.5 * spec.gap;
            end.straight = true;
            return end;
        }
        EndRule::Extrapolate | EndRule::Peak(_) => (),
    }
    for part in spec.parts {
        let number = part.number;
        let (law, rule) = spec.law(part, |seeds| sign * mean_slope(fitted, seeds));
        match rule {
            CapRule::Upright => {
                warnings.push(format!("{side} end: part {number} does not shrink towards its peak; closed upright"));
            }
            CapRule::Flat => warnings.push(format!("{side} end: part {number} does not shrink, or hardly; ends flat")),
            _ => (),
        }
        let given = matches!(rule, CapRule::Peak | CapRule::Upright);
        let cap = law.map(|law| Cap::new(part, law, given, spec.away));
        let height = cap.as_ref().map_or(0.0, |cap| cap.tip);
        end.told.push(Told { part: number, rule, height });
        end.caps.extend(cap);
        end.extent = z + sign * spec.plane(height).max((end.extent - z).abs());
    }
    end
}

/// Change of the slopes along a line.
struct Change<'m> {
    region: &'m Region,
    is_hole: bool,
    by: f64,
}

/// By how much the slopes along each line of an end contour change so that the line passes smoothly into what lies beyond, in its mean: upright
/// into half a slice, by the area's law into a cap. `whole` are the slopes with what the frame's motion explains.
fn changes<'m>(spec: &EndSpec<'m>, whole: &Fitted) -> Vec<Change<'m>> {
    if spec.clamped || spec.rule == EndRule::Flat {
        return Vec::new();
    }
    let mut out = Vec::new();
    for part in spec.parts {
        let caps = spec.rule != EndRule::HalfSlice;
        let law = caps.then(|| spec.by_areas(part)).flatten();
        if caps && law.is_none() {
            continue;
        }
        let outline = law.map_or(0.0, |(law, _)| law.slope());
        let holes = part.holes.iter().map(|hole| match caps {
            true => (hole, -1.0, HoleLaw::new(&hole.areas, spec.away).slope()),
            false => (hole, -1.0, 0.0),
        });
        for (region, outward, change) in std::iter::once((&part.outline, 1.0, outline)).chain(holes) {
            let wanted = spec.sign() * outward * outward_slope(region, change, spec.away);
            let by = spec.told_by_areas * (wanted - mean_slope(whole, region.counted()));
            out.push(Change { region, is_hole: outward < 0.0, by });
        }
    }
    out
}

/// The slopes of an end contour's seeds, moved by [`changes`].
pub fn passing(spec: &EndSpec<'_>, fitted: Fitted, whole: &Fitted) -> Fitted {
    let mut out = fitted;
    for Change { region, by, .. } in changes(spec, whole) {
        region.seeds.iter().for_each(|&k| out.slopes[k as usize] += by);
    }
    out
}

/// Distance from a hole up to which it has a say in the slopes of a field, px: holes are known so far ([`OUT`] and the margin of tiles, 12 at least).
const SAID: f64 = OUT as f64 + 12.0;

/// The slopes of an end contour's field, outward is downward in it, moved by [`changes`]: beside a line by its own, between lines by a mean that
/// falls with the fourth power of the distance, of holes up to [`SAID`].
pub fn passing_field(spec: &EndSpec<'_>, slopes: &mut Field, whole: &Fitted) {
    let changes = changes(spec, whole);
    if changes.is_empty() {
        return;
    }
    let share = |away: f64| (1.0 + away * away).powi(-2);
    // Sums of weights and of weighted changes.
    let mut sums = vec![[0.0; 2]; slopes.data.len()];
    for Change { region, is_hole, by } in &changes {
        let least = if *is_hole { share(SAID) } else { 0.0 };
        for (node, away) in region.tile.nodes(slopes.dims[0]).zip(&region.field.data) {
            let weight = (share(*away) - least).max(0.0);
            sums[node][0] += weight;
            sums[node][1] += weight * by;
        }
    }
    for (slope, [weight, sum]) in slopes.data.iter_mut().zip(sums) {
        if weight > 0.0 {
            *slope -= sum / weight;
        }
    }
}

/// Slope of a line whose area changes by `change` per height, at most [`STEEPEST`] secants of its mean radius.
fn outward_slope(region: &Region, change: f64, away: &[f64]) -> f64 {
    let (&[area, inner, ..], &[_, gap, ..]) = (region.areas.as_slice(), away) else { return 0.0 };
    let steepest = STEEPEST * 2.0 * area.sqrt() * (area.sqrt() - inner.sqrt()).abs() / gap;
    change.clamp(-steepest, steepest) / region.offsets.perimeter().max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_of_which_nothing_is_known_stays_none() {
        for areas in [&[0.0][..], &[0.0, 4.0], &[0.0, 4.0, 9.0]] {
            let law = HoleLaw::new(areas, &[0.0, 1.0, 2.0]);
            assert_eq!([law.at(0.0), law.at(0.7), law.slope()], [0.0; 3], "{areas:?}");
        }
        // One that begins grows, another one closes by its areas.
        assert_eq!(HoleLaw::new(&[4.0, 0.0], &[0.0, 2.0]).at(1.0), 8.0);
        assert!(HoleLaw::new(&[4.0, 9.0], &[0.0, 1.0]).at(0.4) < 4.0);
    }
}
