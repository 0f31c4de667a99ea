//! Plots as SVG, in the colours of the page.

use std::fmt::Write;

use super::words::{escape, height, least_gap, number};
use crate::report::{AreaProfile, ContourReport};

/// Size of a plot in its own units, small enough that its letters can be read on a telephone.
const SIZE: [f64; 2] = [440.0, 260.0];
const LEFT: f64 = 62.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 24.0;
const BOTTOM: f64 = 40.0;

/// Even steps of 1, 2 or 5 times a power of ten, some five of them.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let raw = (high - low) / 4.0;
    if !(raw.is_finite() && raw > 0.0) {
        return vec![low];
    }
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= raw).unwrap_or(raw);
    let first = (low / step).ceil();
    (0..=(high / step - first + 1e-9).max(0.0) as usize).map(|k| (first + k as f64) * step).collect()
}

/// Area over height, with a mark at every contour.
pub fn areas(profile: &AreaProfile, contours: &[ContourReport], unit: &str) -> String {
    let (Some(first), Some(last)) = (profile.layers.first(), profile.layers.last()) else { return String::new() };
    let (low, high) = (first[0], last[0]);
    let most = profile.layers.iter().fold(f64::MIN_POSITIVE, |most, p| most.max(p[1]));
    let wide = (high - low).max(f64::MIN_POSITIVE);
    let x = |z: f64| LEFT + (z - low) / wide * (SIZE[0] - LEFT - RIGHT);
    let y = |area: f64| SIZE[1] - BOTTOM - area / (1.05 * most) * (SIZE[1] - TOP - BOTTOM);
    let (unit, gap) = (escape(unit), least_gap(contours));
    let mut svg = open(
        "areas",
        &format!(
            "Area of the body from height {} to {} {unit}, largest {} {unit}\u{b2}; {} contours are marked.",
            height(low, gap),
            height(high, gap),
            number(most),
            contours.len()
        ),
    );
    for tick in ticks(0.0, most) {
        let y = y(tick);
        let _ = write!(
            svg,
            r#"<path class="grid" d="M{LEFT} {y:.1}H{}"/><text x="{}" y="{:.1}" text-anchor="end">{}</text>"#,
            SIZE[0] - RIGHT,
            LEFT - 6.0,
            y + 4.0,
            number(tick)
        );
    }
    let ticks = ticks(low, high);
    let step = ticks.windows(2).map(|w| w[1] - w[0]).next().unwrap_or(gap);
    for tick in ticks {
        let _ = write!(
            svg,
            r#"<text x="{:.1}" y="{}" text-anchor="middle">{}</text>"#,
            x(tick),
            SIZE[1] - BOTTOM + 16.0,
            height(tick, step)
        );
    }
    let mut path = String::new();
    for (k, p) in profile.layers.iter().enumerate() {
        let _ = write!(path, "{}{:.1} {:.1}", if k == 0 { 'M' } else { 'L' }, x(p[0]), y(p[1]));
    }
    let floor = y(0.0);
    let _ = write!(svg, r#"<path class="fill" d="{path}L{:.1} {floor:.1}L{:.1} {floor:.1}Z"/>"#, x(high), x(low));
    for contour in contours {
        let at = profile.layers.partition_point(|p| p[0] < contour.z - 1e-9 * wide);
        let Some(p) = profile.layers.get(at) else { continue };
        let (x, y, name) = (x(p[0]), y(p[1]), escape(&contour.name));
        let _ = write!(
            svg,
            r#"<g class="mark"><title>{name}: height {} {unit}, area {} {unit}²</title><path d="M{x:.1} {floor:.1}V{y:.1}"/><circle cx="{x:.1}" cy="{y:.1}" r="3"/></g>"#,
            height(p[0], gap),
            number(p[1])
        );
    }
    let _ = write!(
        svg,
        r#"<path class="curve" d="{path}"/><path class="axis" d="M{LEFT} {floor:.1}H{}"/>"#,
        SIZE[0] - RIGHT
    );
    let _ = write!(
        svg,
        r#"<text x="4" y="14">area, {unit}²</text><text x="{}" y="{}" text-anchor="end">height, {unit}</text></svg>"#,
        SIZE[0] - RIGHT,
        SIZE[1] - 6.0
    );
    svg
}

/// A volume by some rule: what it is called, the share between the contours, what the ends add.
pub struct Bar {
    /// Its name.
    pub name: String,
    /// Volumes below the first contour, between the contours, and above the last.
    pub parts: [f64; 3],
}

impl Bar {
    /// All of it.
    pub fn whole(&self) -> f64 {
        self.parts.iter().sum()
    }
}

/// Volumes side by side.
pub fn volumes(bars: &[Bar], unit: &str) -> String {
    let most = bars.iter().map(Bar::whole).fold(f64::MIN_POSITIVE, f64::max);
    let unit = escape(unit);
    let told: Vec<String> = bars.iter().map(|b| format!("{}: {} {unit}\u{b3}", b.name, number(b.whole()))).collect();
    let mut svg = open("volumes", &format!("Volume by end rule. {}.", told.join("; ")));
    let high = (SIZE[1] - TOP) / bars.len().max(1) as f64;
    for (k, bar) in bars.iter().enumerate() {
        let y = TOP + k as f64 * high;
        let _ = write!(
            svg,
            r#"<text x="4" y="{:.1}">{}</text><text x="{}" y="{:.1}" text-anchor="end">{} {unit}³</text>"#,
            y + 12.0,
            escape(&bar.name),
            SIZE[0] - 4.0,
            y + 12.0,
            number(bar.whole())
        );
        let mut x = 4.0;
        for (part, class) in bar.parts.iter().zip(["below", "between", "above"]) {
            let wide = part / most * (SIZE[0] - 8.0);
            let _ = write!(
                svg,
                r#"<rect class="{class}" x="{x:.1}" y="{:.1}" width="{wide:.1}" height="{:.1}"/>"#,
                y + 18.0,
                high - 30.0
            );
            x += wide;
        }
    }
    svg.push_str("</svg>");
    svg
}

fn open(id: &str, said: &str) -> String {
    let [wide, high] = SIZE;
    let said = escape(said);
    format!(r#"<svg id="{id}" viewBox="0 0 {wide} {high}" role="img" aria-label="{said}">"#)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_lie_within() {
        assert_eq!(ticks(0.0, 10.0), [0.0, 5.0, 10.0]);
        assert_eq!(ticks(-3.0, 3.0), [-2.0, 0.0, 2.0]);
        assert_eq!(ticks(2.0, 2.0), [2.0]);
    }
}
