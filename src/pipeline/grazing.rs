//! Parts that motion brings over others by their rims alone, where many lie around: that they meet is chance, and nothing moves there.
//!
//! A part that no part of the other slice overlaps as it is drawn ends in the interval, unless its motion brings it over one. Among many small
//! bodies, of which some end and others begin in every gap, distances tell of motions that are none, and a part that ends is joined to its
//! neighbour. So where many parts of the other slice lie around a part, a meeting counts only if two thirds of one come over the other. Around a part all of
//! whose meetings do not count the displacement fades to the guess. Nor do meetings count that are [`leaps`](super::leaps), whatever lies around.
//!
//! Measured on random ellipsoids of 3 to 9 px radius in 160 x 160 x 41 px, Dice over left-out slices by `--motion none`, without the rule, and with
//! it: 220 of them every 8th slice .617, .552, .585, every 4th .901, .876, .878; 150 of other shapes every 8th .700, .637, .678; 60 every 8th .841,
//! .813, .816. Of the evaluation's 99 volumes three change by over .001, all of many pieces: -.008, -.003, -.002; of its 504 bodies one, a gyroid, -.0015.
//! Where the share is asked for whatever lies around, what moves by its own width is lost (helix every 8th slice .915, .373); where directions in which a
//! part would meet anything stand for neighbours, .0030 of the mean of the volumes and .0010 of that of the bodies (tilted tori, shells, tubes). Narrower
//! windows of the displacement do not help cells, and four times its ridge, which does, takes .04 from the gyroid every 16th slice.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec2;
use rayon::prelude::*;

use super::leaps::Surroundings;
use crate::contour::Contour;
use crate::contour::unmatched::without_partner;
use crate::grid::field::position;
use crate::grid::spline::smoothstep;
use crate::reference::exact::exact_distance;
use crate::registration::displacement::{BLOCK, Displacement};

/// Share of a part that has to come over another one, where many lie around.
const OVER: f64 = 2.0 / 3.0;
/// Parts of the other slice around a part from which on they are many, and how far around it they count, in its inradii: two widths.
const MANY: usize = 4;
const AROUND: f64 = 4.0;
/// Around a part the displacement is the guess up to the first distance, and its own from the second on, px: a band and two nodes.
const FADE: [f64; 2] = [6.0, 14.0];
/// Rounds: without its motion a part may bare another one.
const ROUNDS: usize = 3;

/// A part that meets no part of the other slice as they are drawn.
struct Alone {
    number: u32,
    pixels: usize,
    /// Pixels that motion brings over each part of the other slice.
    over: BTreeMap<u32, usize>,
    /// Parts of the other slice that motion brings it over or within a pixel of.
    near: BTreeSet<u32>,
    /// Whether many parts of the other slice lie around it.
    crowded: bool,
}

/// The displacement `v` of an interval, faded to `guess` around the parts of its contours, `around`, that it brings over others by chance alone. Pairs
/// that are `joined` are partners however they lie.
pub(super) fn without_grazing(
    mut v: Displacement,
    guess: &Displacement,
    around: &Surroundings<'_>,
    joined: &[(u32, u32)],
) -> Displacement {
    let (contours, h) = (around.contours, around.h);
    if contours.iter().any(|contour| contour.solids.count == 0) {
        return v;
    }
    let alone = alone(contours, joined);
    if alone.iter().all(Vec::is_empty) {
        return v;
    }
    for _ in 0..ROUNDS {
        let grazing = grazing(&v, around, &alone);
        if grazing.iter().all(Vec::is_empty) {
            break;
        }
        v = faded(&v, guess, contours, &grazing, h);
    }
    v
}

/// Parts of either contour that overlap none of the other one as they are drawn, by number; `joined` pairs do.
fn alone(contours: [&Contour; 2], joined: &[(u32, u32)]) -> [Vec<u32>; 2] {
    let nx = contours[0].phi.dims[0];
    let of = |own: &Contour, other: &Contour| {
        without_partner(own, 0.0, |x| other.solids.labels[x.y as usize * nx + x.x as usize] > 0)
    };
    let [low, high] = contours;
    let [mut below, mut above] = [of(low, high), of(high, low)];
    below.retain(|part| joined.iter().all(|pair| pair.0 != *part));
    above.retain(|part| joined.iter().all(|pair| pair.1 != *part));
    [below, above]
}

/// Parts of either contour that meet others by chance alone.
fn grazing(v: &Displacement, around: &Surroundings<'_>, numbers: &[Vec<u32>; 2]) -> [Vec<u32>; 2] {
    let (contours, h) = (around.contours, around.h);
    let at_slices = v.at_slices();
    let alone = [0, 1].map(|side| {
        let way = if side == 0 { 1.0 } else { -1.0 };
        let moved = |x: DVec2| x + way * at_slices[side].at(x);
        let seen = |part: &u32| seen(*part, contours[side], contours[1 - side], moved, h);
        numbers[side].par_iter().map(seen).collect::<Vec<Alone>>()
    });
    // What counts of a meeting is seen from either side.
    let mut met: BTreeMap<[u32; 2], bool> = BTreeMap::new();
    let mut near = BTreeSet::new();
    for (side, parts) in alone.iter().enumerate() {
        for part in parts {
            let pair = |other: u32| if side == 0 { [part.number, other] } else { [other, part.number] };
            for (&other, &pixels) in &part.over {
                *met.entry(pair(other)).or_default() |= pixels as f64 >= OVER * part.pixels as f64;
            }
            near.extend(part.near.iter().map(|other| pair(*other)));
        }
    }
    let crowded: [BTreeMap<u32, bool>; 2] = alone.map(|parts| parts.iter().map(|p| (p.number, p.crowded)).collect());
    let whole: BTreeSet<[u32; 2]> = met.iter().filter(|(_, counts)| **counts).map(|(pair, _)| *pair).collect();
    for (pair, counts) in &mut met {
        *counts |= (0..2).all(|side| crowded[side].get(&pair[side]) != Some(&true));
    }
    // What comes within a pixel meets between the pixels.
    for pair in near {
        let own = [0, 1].map(|side| crowded[side].contains_key(&pair[side]));
        if around.leaps(pair, own, whole.contains(&pair)) {
            met.insert(pair, false);
        }
    }
    [0, 1].map(|side| {
        let mut parts: BTreeMap<u32, bool> = BTreeMap::new();
        for (pair, counts) in met.iter().filter(|(pair, _)| crowded[side].contains_key(&pair[side])) {
            *parts.entry(pair[side]).or_default() |= counts;
        }
        parts.into_iter().filter_map(|(part, counts)| (!counts).then_some(part)).collect()
    })
}

/// A part as it meets the `other` contour, where `moved` says.
fn seen(number: u32, own: &Contour, other: &Contour, moved: impl Fn(DVec2) -> DVec2, h: [f64; 2]) -> Alone {
    let [nx, ny] = own.phi.dims;
    let of = |x: DVec2| {
        let x = x.round();
        let within = x.cmpge(DVec2::ZERO).all() && x.x < nx as f64 && x.y < ny as f64;
        if within { other.solids.labels[x.y as usize * nx + x.x as usize] } else { 0 }
    };
    let (mut over, mut near): (BTreeMap<u32, usize>, BTreeSet<u32>) = Default::default();
    let tile = own.tile_of(&[number], [0; 2]);
    for node in tile.nodes(nx).filter(|n| own.solids.labels[*n] == number) {
        let x = moved(position(node, nx));
        *over.entry(of(x)).or_default() += 1;
        near.extend((0..9).map(|k| of(x + DVec2::new(f64::from(k % 3 - 1), f64::from(k / 3 - 1)))));
    }
    near.remove(&0);
    let pixels = over.values().sum();
    over.remove(&0);
    let around = h.map(|side| (AROUND * own.solid_depth[number as usize] / side).ceil() as usize);
    let lying = || own.tile_of(&[number], around).nodes(nx).map(|n| other.solids.labels[n]).collect::<BTreeSet<u32>>();
    // Of parts that meet nothing nothing more is asked.
    let crowded = !over.is_empty() && lying().iter().filter(|part| **part > 0).count() >= MANY;
    Alone { number, pixels, over, near, crowded }
}

/// The displacement, faded to the guess around some parts of either contour.
fn faded(
    v: &Displacement,
    guess: &Displacement,
    contours: [&Contour; 2],
    parts: &[Vec<u32>; 2],
    h: [f64; 2],
) -> Displacement {
    let nx = contours[0].phi.dims[0];
    let mut near = vec![false; v.vectors.len()];
    for (contour, parts) in contours.iter().zip(parts) {
        for &part in parts {
            let tile = contour.tile_of(&[part], [0; 2]);
            let pixels = tile.nodes(nx).filter(|n| contour.solids.labels[*n] == part);
            pixels.for_each(|n| v.nearest(position(n, nx)).for_each(|node| near[node] = true));
        }
    }
    let away = exact_distance(&near, v.grid, h.map(|side| BLOCK as f64 * side)).data;
    let vectors = v.vectors.iter().zip(&guess.vectors).zip(&away);
    let [none, whole] = FADE;
    v.with(vectors.map(|((v, g), away)| g.lerp(*v, smoothstep((away - none) / (whole - none)))).collect())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::grid::field::Field;

    const DIMS: [usize; 2] = [120, 90];

    /// Discs about these centres with this radius.
    fn discs(centres: &[[f64; 2]], radius: f64) -> Contour {
        let away = |i: usize, j: usize| {
            let from = |c: &[f64; 2]| libm::hypot(i as f64 - c[0], j as f64 - c[1]) - radius;
            centres.iter().map(from).fold(1e3, f64::min)
        };
        Contour::new(0.0, Field::from_fn(DIMS, away), [1.0; 2], 1.0)
    }

    fn everywhere(v: [f64; 2]) -> Displacement {
        let zero = Displacement::zero(DIMS);
        zero.with(vec![v.into(); zero.vectors.len()])
    }

    /// Two slices with nothing beyond them.
    fn alone<'c>(contours: [&'c Contour; 2], h: [f64; 2]) -> Surroundings<'c> {
        Surroundings::new(contours, [None; 2], [1.0; 2], h)
    }

    /// The displacement at (60, 45), of one that is `v` everywhere.
    fn kept(low: &[[f64; 2]], high: &[[f64; 2]], v: [f64; 2], joined: &[(u32, u32)]) -> DVec2 {
        let (low, high) = (discs(low, 5.3), discs(high, 5.3));
        let guess = Displacement::zero(DIMS);
        without_grazing(everywhere(v), &guess, &alone([&low, &high], [1.0; 2]), joined).at(DVec2::new(60.0, 45.0))
    }

    #[test]
    fn one_that_grazes_others_all_around_does_not_move() {
        let around: Vec<[f64; 2]> =
            (0..6).map(|k| f64::from(k) * TAU / 6.0).map(|t| [60.0 + 13.0 * t.cos(), 45.0 + 13.0 * t.sin()]).collect();
        let (one, v) = ([[60.0, 45.0]], [4.0, 0.0]);
        assert_eq!(kept(&one, &around, v, &[]), DVec2::ZERO);
        assert_eq!(kept(&around, &one, [-4.0, 0.0], &[]), DVec2::ZERO, "upside down");
        // Where it lands on one of them it is that one, and a link says the same.
        assert_eq!(kept(&one, &around, [12.0, 0.0], &[]).x, 12.0);
        assert_eq!(kept(&one, &around, v, &[(1, 1)]).x, 4.0);
        // Where it overlaps one as drawn it has a partner.
        assert_eq!(kept(&one, &[around.as_slice(), &[[64.0, 45.0]]].concat(), v, &[]).x, 4.0);
    }

    #[test]
    fn one_that_moves_on_by_its_own_width_does() {
        assert_eq!(kept(&[[60.0, 45.0]], &[[73.0, 45.0]], [4.0, 0.0], &[]).x, 4.0);
    }

    #[test]
    fn motion_fades_around_a_part_and_no_farther() {
        let around: Vec<[f64; 2]> = [[43.0, 45.0], [17.0, 45.0], [30.0, 32.0], [30.0, 58.0]].to_vec();
        let (low, high) = (discs(&[[30.0, 45.0]], 5.3), discs(&around, 5.3));
        for h in [[1.0, 1.0], [0.5, 1.0], [1.0, 0.5]] {
            let guess = everywhere([0.5, 0.0]);
            let v = without_grazing(everywhere([4.0, 0.0]), &guess, &alone([&low, &high], h), &[]);
            // The parts that it grazes do not move either; the last of them ends at 48.3.
            let beyond = |x: f64| v.at(DVec2::new(48.3 + x / h[0], 45.0)).x;
            assert_eq!([30.0, 43.0].map(|x| v.at(DVec2::new(x, 45.0)).x), [0.5; 2]);
            assert!(beyond(4.0) < 1.5 && beyond(20.0) == 4.0, "{h:?}: {} {}", beyond(4.0), beyond(20.0));
        }
    }
}
