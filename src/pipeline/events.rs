//! Events under the numbers that parts have on their slices, as `interslice inspect` gives them: matching sees them in the mid frame.

use std::collections::BTreeSet;

use glam::DVec2;

use super::links::origins;
use crate::contour::Contour;
use crate::contour::parts::overlaps;
use crate::grid::components::label8;
use crate::grid::field::position;
use crate::registration::mid_frame::Frame;
use crate::report::Event;

/// Events of an interval's `seen` contours in its frame as events of its `own`. What several parts of the frame tell of one part of a slice is told
/// once; a part that is too thin to be seen in the frame begins or ends, unless it overlaps something where it lies.
pub(super) fn named(events: &[Event], seen: [&Contour; 2], own: [&Contour; 2], frame: &Frame) -> Vec<Event> {
    let low = origins(seen[0], own[0], |x| frame.down(x));
    let high = origins(seen[1], own[1], |x| frame.up(x));
    let of = |numbers: &[usize], origins: &[u32]| -> Vec<usize> {
        let found: BTreeSet<usize> = numbers.iter().map(|&n| origins[n] as usize).filter(|n| *n > 0).collect();
        found.into_iter().collect()
    };
    let lone = |part: usize, origins: &[u32]| {
        // Where another piece of the part has a partner, the part goes on.
        let number = origins[part];
        let pieces = (1..origins.len()).filter(|&k| origins[k] == number).count();
        (number > 0 && pieces == 1).then_some(number as usize)
    };
    let mut out: Vec<Event> = Vec::new();
    for event in events {
        let event = match event {
            Event::Split { from, to } => {
                let (from, to) = (of(from, &low), of(to, &high));
                (!from.is_empty() && to.len() > 1).then_some(Event::Split { from, to })
            }
            Event::Merge { from, to } => {
                let (from, to) = (of(from, &low), of(to, &high));
                (from.len() > 1 && !to.is_empty()).then_some(Event::Merge { from, to })
            }
            Event::Birth { component } => lone(*component, &high).map(|component| Event::Birth { component }),
            Event::Death { component } => lone(*component, &low).map(|component| Event::Death { component }),
            // Holes are counted where they lie, by [`holes`].
            Event::HoleBirth { .. } | Event::HoleDeath { .. } => None,
        };
        out.extend(event);
    }
    let unseen = |contour: &Contour, origins: &[u32]| {
        let found: BTreeSet<u32> = origins.iter().copied().collect();
        (1..=contour.solids.count as u32).filter(|part| !found.contains(part)).collect::<Vec<u32>>()
    };
    let unseen = [unseen(own[0], &low), unseen(own[1], &high)];
    if unseen.iter().any(|parts| !parts.is_empty()) {
        let pairs = overlaps(&own[0].solids, &own[1].solids);
        let alone = |part: &&u32, end: usize| !pairs.iter().any(|pair| [pair.0, pair.1][end] == **part);
        let component = |part: &u32| *part as usize;
        out.extend(unseen[1].iter().filter(|p| alone(p, 1)).map(component).map(|component| Event::Birth { component }));
        out.extend(unseen[0].iter().filter(|p| alone(p, 0)).map(component).map(|component| Event::Death { component }));
    }
    out
}

/// Holes of two neighbouring contours that close or open between them: along the trajectories of the frame each of their pixels meets the inside of the
/// other contour.
pub(super) fn holes([low, high]: [&Contour; 2], frame: &Frame) -> Vec<Event> {
    let closes = pixels_of_lost_holes(low, high, |x| frame.up(frame.of_low(x)));
    let opens = pixels_of_lost_holes(high, low, |x| frame.down(frame.of_high(x)));
    let closes = closes.into_iter().map(|pixels| Event::HoleDeath { pixels });
    closes.chain(opens.into_iter().map(|pixels| Event::HoleBirth { pixels })).collect()
}

/// Pixels of each hole of a contour that lies over nothing but the inside of another one, to which its pixels go by `over`.
fn pixels_of_lost_holes(contour: &Contour, other: &Contour, over: impl Fn(DVec2) -> DVec2) -> Vec<usize> {
    if contour.holes == 0 {
        return Vec::new();
    }
    let [nx, ny] = contour.phi.dims;
    let outside: Vec<bool> = contour.phi.data.iter().map(|v| *v >= 0.0).collect();
    let parts = label8(&outside, [nx, ny]);
    // The image goes on around all contours, so its first pixel is no hole's.
    let around = parts.labels[0];
    let (mut pixels, mut lost) = (vec![0; parts.count + 1], vec![true; parts.count + 1]);
    for (n, &part) in parts.labels.iter().enumerate().filter(|(_, part)| **part > 0 && **part != around) {
        pixels[part as usize] += 1;
        if lost[part as usize] {
            let x = over(position(n, nx)).round().max(DVec2::ZERO);
            let [i, j] = [(x.x as usize).min(nx - 1), (x.y as usize).min(ny - 1)];
            lost[part as usize] = other.phi.data[j * nx + i] < 0.0;
        }
    }
    pixels.into_iter().zip(lost).filter(|(pixels, lost)| *pixels > 0 && *lost).map(|(pixels, _)| pixels).collect()
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::grid::field::Field;

    #[test]
    fn parts_have_the_numbers_of_their_slices() {
        // In the frame the parts of the lower slice come in the other order: its rows are turned over.
        let discs = |at: &[[f64; 2]]| {
            let near = |i: usize, j: usize| at.iter().map(move |c| (i as f64 - c[0]).hypot(j as f64 - c[1]) - 4.0);
            Field::from_fn([40, 40], |i, j| near(i, j).fold(f64::INFINITY, f64::min))
        };
        let contour = |at: &[[f64; 2]]| Contour::with_seeds(0.0, discs(at), Vec::new());
        let (own, seen) = (contour(&[[10.0, 8.0], [30.0, 30.0]]), contour(&[[10.0, 31.0], [30.0, 9.0]]));
        let turned = |x: DVec2| DVec2::new(x.x, 39.0 - x.y);
        assert_eq!(origins(&seen, &own, turned)[1..], [2, 1]);
        // No part of the frame is lost, and one that is in two pieces there is told once.
        let frame = Frame::default();
        let told = named(
            &[Event::Split { from: vec![1], to: vec![1, 2] }, Event::Death { component: 2 }],
            [&own, &own],
            [&own, &own],
            &frame,
        );
        assert_eq!(told, [Event::Split { from: vec![1], to: vec![1, 2] }, Event::Death { component: 2 }]);
        let whole = contour(&[[10.0, 8.0]]);
        let lost = named(&[Event::Split { from: vec![1], to: vec![1] }], [&whole, &whole], [&own, &whole], &frame);
        assert_eq!(lost, [Event::Death { component: 2 }]);
    }

    #[test]
    fn a_hole_closes_where_the_other_contour_is_inside_along_the_trajectories() {
        // Rings: middle along x, outer and inner radius.
        let ring = |x: f64, [outer, inner]: [f64; 2]| {
            let value = |i: usize, j: usize| {
                let r = (i as f64 - x).hypot(j as f64 - 25.0);
                (r - outer).max(inner - r)
            };
            Contour::with_seeds(0.0, Field::from_fn([80, 50], value), Vec::new())
        };
        let pixels = |contour: &Contour, x: f64| {
            let near = |(n, v): (usize, &f64)| *v >= 0.0 && position(n, 80).distance(DVec2::new(x, 25.0)) < 12.0;
            contour.phi.data.iter().enumerate().filter(|of| near(*of)).count()
        };
        let (disc, with, away) = (ring(25.0, [20.0, -1.0]), ring(25.0, [20.0, 6.0]), ring(38.0, [20.0, 6.0]));
        let still = Frame::default();
        let count = pixels(&with, 25.0);
        assert!((100..120).contains(&count) && with.holes == 1 && disc.holes == 0);
        assert_eq!(holes([&with, &disc], &still), [Event::HoleDeath { pixels: count }]);
        assert_eq!(holes([&disc, &with], &still), [Event::HoleBirth { pixels: count }]);
        assert_eq!(holes([&with, &with], &still), []);
        // Where they lie each of both is over the inside of the other.
        let both = [Event::HoleDeath { pixels: count }, Event::HoleBirth { pixels: pixels(&away, 38.0) }];
        assert_eq!(holes([&with, &away], &still), both);
        // A part that ends takes its holes along.
        let nothing = Contour::with_seeds(0.0, Field::filled([80, 50], f64::INFINITY), Vec::new());
        assert_eq!(holes([&with, &nothing], &still), []);
    }
}
