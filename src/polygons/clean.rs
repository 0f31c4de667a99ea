//! Lines that are left out of a drawing before it is laid on pixels: those that bound nothing, and those that are there before.

use std::cell::LazyCell;
use std::collections::HashSet;

use glam::DVec2;

use super::near::near_copies;
use super::pixel::pixel_side;
use super::{PlaneDrawing, Polygon};

/// Points of a closed line by which two are the same line, wherever they begin and whichever way they go.
pub(crate) fn line_key<const N: usize>(points: impl IntoIterator<Item = [f64; N]>) -> Vec<[u64; N]> {
    // A zero has one sign here.
    let mut bits: Vec<[u64; N]> = points.into_iter().map(|p| p.map(|v| (v + 0.0).to_bits())).collect();
    while bits.len() > 1 && bits.first() == bits.last() {
        bits.pop();
    }
    let from_least = |bits: &mut Vec<[u64; N]>| {
        let first = (0..bits.len()).min_by_key(|k| bits[*k]).unwrap_or(0);
        bits.rotate_left(first);
    };
    let mut back: Vec<[u64; N]> = bits.iter().rev().copied().collect();
    from_least(&mut bits);
    from_least(&mut back);
    bits.min(back)
}

/// Whether all points of a polygon lie on one straight line, but for what rounding moves them by.
fn bounds_nothing(polygon: &Polygon) -> bool {
    let Some(first) = polygon.first() else { return true };
    let farthest = polygon.iter().map(|p| *p - *first).max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let along = farthest.unwrap_or_default();
    let scale = along.abs().max_element();
    let size = |p: &DVec2| p.abs().max(first.abs()).max_element();
    let off = |p: &DVec2| (along / scale).perp_dot(*p - *first).abs();
    scale == 0.0 || polygon.iter().all(|p| off(p) <= 4.0 * f64::EPSILON * size(p))
}

/// A drawing whose polygons have numbers, from 1, as they are drawn.
struct Numbered<'d> {
    drawing: &'d mut PlaneDrawing,
    /// The numbers, region by region.
    numbers: Vec<Vec<usize>>,
}

impl<'d> Numbered<'d> {
    fn new(drawing: &'d mut PlaneDrawing) -> Self {
        let mut all = 1..;
        let numbers = drawing.regions.iter().map(|region| all.by_ref().take(region.len()).collect()).collect();
        Numbered { drawing, numbers }
    }

    /// Leaves out the polygons of each region whose places in it `out` gives.
    fn leave_out(&mut self, mut out: impl FnMut(&[Polygon], &[usize]) -> HashSet<usize>) {
        for (region, numbers) in self.drawing.regions.iter_mut().zip(&mut self.numbers) {
            let out = out(region, numbers);
            let [mut places, mut others] = [0.., 0..];
            region.retain(|_| places.next().is_none_or(|k| !out.contains(&k)));
            numbers.retain(|_| others.next().is_none_or(|k| !out.contains(&k)));
        }
    }

    /// Leaves out polygons that bound no area: of fewer than three points, or on a straight line. Returns a word on each.
    fn leave_out_flat(&mut self) -> Vec<String> {
        let mut words = Vec::new();
        self.leave_out(|region, numbers| {
            let flat: Vec<usize> = (0..region.len()).filter(|k| bounds_nothing(&region[*k])).collect();
            words.extend(flat.iter().map(|&k| {
                let points = match region[k].len() {
                    1 => "1 point bounds".into(),
                    n => format!("{n} points bound"),
                };
                format!("polygon {} left out, its {points} no area", numbers[k])
            }));
            flat.into_iter().collect()
        });
        self.said(words)
    }

    /// Leaves out polygons that are drawn before in the same region: under even-odd both would be gone. Returns a word on them.
    fn leave_out_copies(&mut self) -> Vec<String> {
        let mut count = 0;
        self.leave_out(|region, _| {
            let mut seen = HashSet::new();
            let key = |k: &usize| line_key(region[*k].iter().map(DVec2::to_array));
            let copies: HashSet<usize> = (0..region.len()).filter(|k| !seen.insert(key(k))).collect();
            count += copies.len();
            copies
        });
        let which = match count {
            0 => return Vec::new(),
            1 => "a polygon is".into(),
            count => format!("{count} polygons are"),
        };
        self.said(vec![format!("{which} drawn before point by point; left out")])
    }

    /// Leaves out polygons that nearly coincide with one before in the same region. Returns a word on each.
    fn leave_out_near(&mut self, pixel: &dyn Fn() -> f64) -> Vec<String> {
        let mut words = Vec::new();
        self.leave_out(|region, numbers| {
            let copies = near_copies(region, pixel);
            words.extend(copies.iter().map(|copy| {
                let [line, of] = [copy.line, copy.of].map(|k| numbers[k]);
                format!("polygons {of} and {line} {}; polygon {line} left out", copy.says())
            }));
            copies.iter().map(|copy| copy.line).collect()
        });
        self.said(words)
    }

    /// Words with the plane's name and height.
    fn said(&self, words: Vec<String>) -> Vec<String> {
        words.into_iter().map(|word| format!("`{}` at {}: {word}", self.drawing.name, self.drawing.z)).collect()
    }
}

/// Leaves out polygons that bound no area, and those that are drawn before on their plane or nearly so, by the drawings' pixels, which have these
/// sides if they were named. Returns a word on each plane that has such.
pub fn clean(drawings: &mut [PlaneDrawing], pixel: Option<[f64; 2]>) -> Vec<String> {
    let mut numbered: Vec<Numbered<'_>> = drawings.iter_mut().map(Numbered::new).collect();
    let mut notes: Vec<String> = numbered.iter_mut().flat_map(Numbered::leave_out_flat).collect();
    notes.extend(numbered.iter_mut().flat_map(Numbered::leave_out_copies));
    let copy: Vec<PlaneDrawing> = numbered.iter().map(|of| of.drawing.clone()).collect();
    // What is no number is an error later.
    if copy.iter().flat_map(PlaneDrawing::polygons).flatten().all(|p| p.is_finite()) {
        let side = LazyCell::new(|| pixel.map_or_else(|| pixel_side(&copy), |[dx, dy]| dx.min(dy)));
        notes.extend(numbered.iter_mut().flat_map(|of| of.leave_out_near(&|| *side)));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64) -> Polygon {
        [[x, 0.0], [x + 4.0, 0.0], [x + 4.0, 4.0], [x, 4.0]].map(DVec2::from).to_vec()
    }

    fn drawing(regions: Vec<Vec<Polygon>>) -> PlaneDrawing {
        PlaneDrawing { name: "k=0".into(), z: 0.0, extra: false, regions }
    }

    #[test]
    fn a_line_that_is_drawn_twice_is_one_and_others_stay() {
        let mut turned = square(0.0);
        turned.rotate_left(2);
        turned.reverse();
        turned.push(turned[0]);
        let regions = vec![vec![square(0.0), square(1.0), turned.clone(), square(0.0)], vec![turned.clone()]];
        let mut drawings = [drawing(regions)];
        let told = ["`k=0` at 0: 2 polygons are drawn before point by point; left out"];
        assert_eq!(clean(&mut drawings, None), told);
        assert_eq!(drawings[0].regions, [vec![square(0.0), square(1.0)], vec![turned]]);
        assert_eq!(clean(&mut drawings, None), Vec::<String>::new());
    }

    #[test]
    fn what_is_left_out_has_the_number_that_it_was_drawn_with() {
        let flat = vec![DVec2::ZERO; 3];
        let regions = vec![vec![flat, square(0.0), square(0.0)], vec![square(9.0), square(9.0 + 1e-6), square(20.0)]];
        let mut drawings = [drawing(regions)];
        let told = [
            "`k=0` at 0: polygon 1 left out, its 3 points bound no area",
            "`k=0` at 0: a polygon is drawn before point by point; left out",
            "`k=0` at 0: polygons 4 and 5 nearly coincide, at most 0.000001 apart, and would cancel; polygon 5 left out",
        ];
        assert_eq!(clean(&mut drawings, None), told);
        assert_eq!(drawings[0].regions, [vec![square(0.0)], vec![square(9.0), square(20.0)]]);
        let mut endless = [drawing(vec![vec![square(f64::NAN), square(0.0), square(1e-6)]])];
        assert_eq!(clean(&mut endless, None), Vec::<String>::new(), "an error later");
    }
}
