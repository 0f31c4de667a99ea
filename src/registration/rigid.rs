//! The rigid motion of a part from one slice to the next.
//!
//! In the mid frame of its interval a rotation by theta and a shift are the displacement `v(x) = shift + 2 tan(theta / 2) J (x - centre)`, J a
//! quarter turn: `x - v/2` and `x + v/2` are then the same point of the part in both slices. (Half way the part is smaller by
//! `cos(theta / 2)`: points move along chords.)

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec2, Vec2Swizzles};

use crate::contour::Contour;
use crate::grid::field::{Field, position};
use crate::grid::tile::Tile;

/// A frame must lower the area in which the slices differ by this factor.
const LEAST_GAIN: f64 = 3.0;
/// One that lowers it by less than this from the start is not looked into.
const PROMISING: f64 = 1.5;
/// A rotation must lower it by this much more than a shift alone.
const TURNING_GAIN: f64 = 1.5;
/// Parts whose areas differ by more than this factor are not brought onto each other, but the smaller one into the larger.
const ALIKE: f64 = 2.0;
/// Share of what could be common at which a shift is far enough, in steps of `1 / WAYS` of the way between the centroids.
const ENOUGH: f64 = 0.5;
const WAYS: u32 = 16;
/// Least ratio of the principal moments of a part that has an axis.
const ELONGATED: f64 = 2.25;
/// Steps in which a shift is refined, px.
const STEPS: [f64; 5] = [1.0, 0.5, 0.25, 0.125, 0.0625];
/// Most moves per step.
const MOVES: usize = 8;
/// Areas that differ by less than this are equally good, pixels: single precision must not decide.
const EQUAL: f64 = 1e-2;
/// Rim of a part's tile, px.
const RIM: usize = 3;

/// A rigid motion, see above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigid {
    /// Centre of the rotation in the mid frame, pixels.
    pub centre: DVec2,
    /// Shift, pixels.
    pub shift: DVec2,
    /// `2 tan(theta / 2)`, positive from x to y.
    pub turn: f64,
}

impl Rigid {
    const STILL: Rigid = Rigid { centre: DVec2::ZERO, shift: DVec2::ZERO, turn: 0.0 };

    /// Its displacement at `x`, pixels.
    pub fn at(&self, x: DVec2, h: [f64; 2]) -> DVec2 {
        let h = DVec2::from(h);
        self.shift + self.turn * ((x - self.centre) * h).perp() / h
    }

    /// The motion from a part of the lower slice to one of the upper. Between parts of like area: shift of the centroids and, where both are
    /// elongated, rotation of the principal axis, refined on the area in which the slices differ. Else the shift towards the other's
    /// centroid that is just enough to bring the smaller part into the larger.
    pub fn between(low: (&Contour, u32), high: (&Contour, u32), h: [f64; 2]) -> Found {
        let [a, b] = [Cover::new(low.0, low.1), Cover::new(high.0, high.1)];
        let [ma, mb] = [a.moments(h), b.moments(h)];
        let centre = 0.5 * (ma.centroid + mb.centroid);
        let shift = mb.centroid - ma.centroid;
        let differing = |rigid: &Rigid| differing_area(&a, &b, rigid, h);
        if ma.area > ALIKE * mb.area || mb.area > ALIKE * ma.area {
            let part_way = |k: u32| Rigid { centre, shift: f64::from(k) / f64::from(WAYS) * shift, turn: 0.0 };
            let common = |k: u32| 0.5 * (ma.area + mb.area - differing(&part_way(k)));
            let enough = ENOUGH * common(WAYS);
            let k = (0..WAYS).find(|&k| common(k) >= enough).unwrap_or(WAYS);
            return Found { rigid: part_way(k), alike: false, worthwhile: false };
        }
        let none = differing(&Rigid::STILL);
        let mut starts = vec![Rigid { centre, shift, turn: 0.0 }];
        if ma.ratio > ELONGATED && mb.ratio > ELONGATED {
            // An axis has no direction: the smaller of both turns.
            let theta = mb.axis - ma.axis;
            let theta = theta - PI * (theta / PI).round();
            if theta.abs() < FRAC_PI_2 {
                starts.push(Rigid { turn: 2.0 * libm::tan(0.5 * theta), ..starts[0] });
            }
        }
        if starts.iter().all(|start| differing(start) * PROMISING > none) {
            return Found { rigid: starts[0], alike: true, worthwhile: false };
        }
        let found: Vec<(Rigid, f64)> = starts.into_iter().map(|start| refined(start, differing)).collect();
        let (rigid, left) = match found[..] {
            [(_, shifted), turned] if turned.1 * TURNING_GAIN < shifted => turned,
            _ => found[0],
        };
        Found { rigid, alike: true, worthwhile: left * LEAST_GAIN <= none }
    }
}

/// A motion that was looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// The best.
    pub rigid: Rigid,
    /// Whether the parts are of like area.
    pub alike: bool,
    /// Whether it lowers the area in which the slices differ by enough.
    pub worthwhile: bool,
}

/// Share of each pixel around a part that lies inside it.
struct Cover {
    tile: Tile,
    share: Field,
}

struct Moments {
    /// Pixels.
    area: f64,
    /// Pixels.
    centroid: DVec2,
    /// Larger over smaller principal moment.
    ratio: f64,
    /// Angle of the longer axis.
    axis: f64,
}

impl Cover {
    fn new(contour: &Contour, part: u32) -> Self {
        let tile = contour.tile_of(&[part], [RIM; 2]);
        let [nx, ny] = contour.phi.dims;
        let share = |node: usize| {
            let (i, j) = (node % nx, node / nx);
            let mut around = (j.saturating_sub(1)..=(j + 1).min(ny - 1))
                .flat_map(|j| (i.saturating_sub(1)..=(i + 1).min(nx - 1)).map(move |i| j * nx + i));
            if around.any(|n| contour.solids.labels[n] == part) {
                (0.5 - contour.phi.data[node]).clamp(0.0, 1.0)
            } else {
                0.0
            }
        };
        let share = Field { dims: tile.dims, data: tile.nodes(nx).map(share).collect() };
        Cover { tile, share }
    }

    fn moments(&self, h: [f64; 2]) -> Moments {
        let width = self.tile.dims[0];
        let mean = |f: &dyn Fn(DVec2) -> f64| {
            let terms = self.share.data.iter().enumerate().filter(|(_, w)| **w > 0.0);
            let (sum, whole) = terms.fold((0.0, 0.0), |(sum, whole), (n, w)| {
                let x = self.tile.to_image(position(n, width));
                (sum + w * f(x), whole + w)
            });
            sum / whole
        };
        let centroid = DVec2::new(mean(&|x| x.x), mean(&|x| x.y));
        let moment = |p: usize, q: usize| mean(&|x| (x[p] - centroid[p]) * h[p] * (x[q] - centroid[q]) * h[q]);
        let (xx, yy, xy) = (moment(0, 0), moment(1, 1), moment(0, 1));
        let spread = libm::hypot(0.5 * (xx - yy), xy);
        let middle = 0.5 * (xx + yy);
        let ratio = (middle + spread) / (middle - spread).max(f64::MIN_POSITIVE);
        let area = self.share.data.iter().sum();
        Moments { area, centroid, ratio, axis: 0.5 * libm::atan2(2.0 * xy, xx - yy) }
    }

    /// Share of the pixel at position `x` of the image.
    fn at(&self, x: DVec2) -> f64 {
        self.share.sample(self.tile.to_local(x))
    }

    /// Corners of the tile.
    fn corners(&self) -> [DVec2; 2] {
        let end = std::array::from_fn(|c| self.tile.origin[c] + self.tile.dims[c]);
        [self.tile.origin, end].map(|corner| corner.map(|v| v as f64).into())
    }
}

/// Area in which both parts differ once the motion has brought them together in the mid frame, pixels.
fn differing_area(a: &Cover, b: &Cover, rigid: &Rigid, h: [f64; 2]) -> f64 {
    let [[a_low, a_high], [b_low, b_high]] = [a.corners(), b.corners()];
    // A turned part needs more room than its box.
    let across = (a_high - a_low).max(b_high - b_low).yx();
    let room = 1.0 + rigid.turn.abs() * 0.5 * across / DVec2::from(h);
    let half = 0.5 * rigid.shift;
    let low = (a_low + half).min(b_low - half) - room;
    let high = (a_high + half).max(b_high - half) + room;
    let mut area = 0.0;
    for j in low.y.floor() as i64..=high.y.ceil() as i64 {
        for i in low.x.floor() as i64..=high.x.ceil() as i64 {
            let x = DVec2::new(i as f64, j as f64);
            let half = 0.5 * rigid.at(x, h);
            area += (a.at(x - half) - b.at(x + half)).abs();
        }
    }
    area
}

/// Moves the shift in smaller and smaller steps to where `area` is least; the area there. Where two ways are equally good neither is gone,
/// so that it is the same upside down.
fn refined(start: Rigid, area: impl Fn(&Rigid) -> f64) -> (Rigid, f64) {
    let mut best = (start, area(&start));
    for step in STEPS {
        for _ in 0..MOVES {
            let ways = (0..9).filter(|k| *k != 4).map(|k| position(k, 3) - 1.0);
            let mut tried: Vec<(Rigid, f64)> = ways
                .map(|way| {
                    let rigid = Rigid { shift: best.0.shift + step * way, ..best.0 };
                    (rigid, area(&rigid))
                })
                .collect();
            tried.sort_by(|a, b| a.1.total_cmp(&b.1));
            if best.1.min(tried[1].1) - tried[0].1 < EQUAL {
                break;
            }
            best = tried[0];
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIMS: [usize; 2] = [90, 70];

    fn contour(h: [f64; 2], phi: impl Fn(DVec2) -> f64) -> Contour {
        let value = |i: usize, j: usize| phi(DVec2::new(i as f64 * h[0], j as f64 * h[1])) + 1e-9;
        Contour::new(0.0, Field::from_fn(DIMS, value), h, 1.0)
    }

    /// A bar of 24 x 6 px of the larger side, turned by `angle`.
    fn bar(h: [f64; 2], centre: DVec2, angle: f64) -> Contour {
        contour(h, |x| {
            let [along, across] =
                [DVec2::from_angle(angle), DVec2::from_angle(angle).perp()].map(|a| a.dot(x - centre));
            (along.abs() - 12.0).max(across.abs() - 3.0)
        })
    }

    fn disc(centre: DVec2, radius: f64) -> Contour {
        contour([1.0; 2], |x| x.distance(centre) - radius)
    }

    #[test]
    fn half_a_displacement_to_either_side_is_the_motion() {
        let (theta, h) = (0.7f64, [1.0, 1.0]);
        let rigid =
            Rigid { centre: DVec2::new(30.0, 20.0), shift: DVec2::new(4.0, -2.0), turn: 2.0 * (0.5 * theta).tan() };
        for x in [[33.0, 20.0], [30.0, 20.0], [11.0, 47.0]].map(DVec2::from) {
            let v = rigid.at(x, h);
            let [p, q] = [x - 0.5 * (v - rigid.shift), x + 0.5 * (v - rigid.shift)].map(|p| p - rigid.centre);
            assert!(DVec2::from_angle(theta).rotate(p).distance(q) < 1e-12, "{p} becomes {q}");
        }
        // The same in px of the larger side where pixels are not square.
        let v = Rigid { shift: DVec2::ZERO, ..rigid }.at(rigid.centre + DVec2::new(8.0, 3.0), [0.5, 1.0]);
        assert!((v - rigid.turn * DVec2::new(-3.0 / 0.5, 4.0)).length() < 1e-12, "{v}");
    }

    #[test]
    fn a_bar_has_its_area_middle_and_axis() {
        for h in [[1.0, 1.0], [0.5, 1.0]] {
            let cover = Cover::new(&bar(h, DVec2::new(22.0, 33.0), 0.6), 1);
            let moments = cover.moments(h);
            assert!((moments.area * h[0] * h[1] - 144.0).abs() < 3.0, "{}", moments.area);
            assert!((moments.centroid * DVec2::from(h)).distance(DVec2::new(22.0, 33.0)) < 0.1, "{}", moments.centroid);
            assert!((moments.axis - 0.6).abs() < 0.02 && (moments.ratio - 16.0).abs() < 2.0, "{}", moments.ratio);
        }
    }

    #[test]
    fn a_bar_that_turns_and_moves_is_found_and_the_same_upside_down() {
        for h in [[1.0, 1.0], [0.5, 1.0]] {
            let (from, to) = (DVec2::new(20.0, 33.0), DVec2::new(24.0, 30.0));
            let [low, high] = [bar(h, from, 0.2), bar(h, to, 0.7)];
            let found = Rigid::between((&low, 1), (&high, 1), h);
            assert!(found.alike && found.worthwhile, "{found:?}");
            assert!((found.rigid.turn - 2.0 * 0.25f64.tan()).abs() < 0.03, "{found:?}");
            assert!((found.rigid.shift * DVec2::from(h)).distance(to - from) < 0.3, "{found:?}");
            let back = Rigid::between((&high, 1), (&low, 1), h).rigid;
            assert!((back.turn + found.rigid.turn).abs() < 1e-9 && (back.shift + found.rigid.shift).length() < 1e-9);
        }
        let [low, high] = [[30.0, 30.0], [36.0, 33.0]].map(|c| disc(DVec2::from(c), 7.0));
        let moved = Rigid::between((&low, 1), (&high, 1), [1.0; 2]);
        assert!(moved.alike && moved.worthwhile && moved.rigid.turn == 0.0, "{moved:?}");
        assert!(moved.rigid.shift.distance(DVec2::new(6.0, 3.0)) < 0.1, "{moved:?}");
        let still = Rigid::between((&low, 1), (&low, 1), [1.0; 2]);
        assert!(!still.worthwhile || still.rigid.shift.length() < 0.1, "{still:?}");
    }

    #[test]
    fn a_small_part_goes_half_into_a_large_one() {
        let (small, large) = (disc(DVec2::new(62.0, 35.0), 4.0), disc(DVec2::new(30.0, 35.0), 16.0));
        let found = Rigid::between((&small, 1), (&large, 1), [1.0; 2]);
        // Its middle comes to the large one's edge, 16 px of 32, in steps of a sixteenth of the way.
        assert!(!found.alike && found.rigid.turn == 0.0 && found.rigid.shift.y.abs() < 1e-6, "{found:?}");
        assert!((-19.0..=-15.5).contains(&found.rigid.shift.x), "{found:?}");
        let back = Rigid::between((&large, 1), (&small, 1), [1.0; 2]);
        assert!((back.rigid.shift + found.rigid.shift).length() < 1e-9, "{back:?}");
    }

    #[test]
    fn parts_differ_by_what_only_one_of_them_has() {
        let [a, b] = [disc(DVec2::new(40.0, 30.0), 9.0), disc(DVec2::new(40.0, 30.0), 5.0)].map(|c| Cover::new(&c, 1));
        let ring = std::f64::consts::PI * (81.0 - 25.0);
        assert!((differing_area(&a, &b, &Rigid::STILL, [1.0; 2]) - ring).abs() < 1.0);
        assert!((differing_area(&b, &a, &Rigid::STILL, [1.0; 2]) - ring).abs() < 1.0);
        let away = Rigid { shift: DVec2::new(25.0, -17.0), ..Rigid::STILL };
        let both = std::f64::consts::PI * (81.0 + 25.0);
        let found = differing_area(&a, &b, &away, [1.0; 2]);
        assert!((found - both).abs() < 2.0, "{found}, not {both}");
    }

    #[test]
    fn another_part_a_row_away_is_not_its_own() {
        for across in [DVec2::X, DVec2::Y] {
            let bars = contour([1.0; 2], |x| {
                let of = |middle: f64| ((x - DVec2::new(40.0, 33.0)).dot(across) - middle).abs() - 3.0;
                of(-3.5).min(of(3.5)).max((x - DVec2::new(40.0, 33.0)).perp_dot(across).abs() - 12.0)
            });
            assert_eq!(bars.solids.count, 2);
            for part in [1, 2] {
                let area = Cover::new(&bars, part).moments([1.0; 2]).area;
                assert!((area - 144.0).abs() < 3.0, "part {part}: {area}");
            }
        }
    }

    #[test]
    fn a_turned_part_differs_in_all_of_its_area() {
        // In the mid frame both lie crosswise and smaller by the cosine of half the angle; what they share is a rhombus as wide as they are.
        let (bar, theta) = (Cover::new(&bar([1.0; 2], DVec2::new(40.0, 33.0), 0.0), 1), 1.2f64);
        let shrunk = (0.5 * theta).cos();
        let expected = 2.0 * (144.0 * shrunk.powi(2) - (6.0 * shrunk).powi(2) / theta.sin());
        for sign in [1.0, -1.0] {
            let turn = sign * 2.0 * (0.5 * theta).tan();
            let rigid = Rigid { centre: DVec2::new(40.0, 33.0), turn, ..Rigid::STILL };
            let found = differing_area(&bar, &bar, &rigid, [1.0; 2]);
            assert!((found - expected).abs() < 4.0, "{found}, not {expected}");
        }
    }
}
