//! The same body however it lies.

use std::borrow::Cow;

use interslice::Settings;
use interslice::stack::ContourStack;

use super::{Case, Checked, Fault, Property, calm_or_any, made, numbers, within};
use crate::random::case::without_events;
use crate::random::measure::{change, px};
use crate::random::settings::{ends, fine_heights};
use crate::random::source::Source;
use crate::random::turned::{TURNS, Turn};

/// Largest change near the surface without and with events, px.
const BOUNDS: [f64; 2] = [0.02, 0.1];
/// Layers in every interval.
const PARTS: usize = 4;
/// Ways to lie that are tried of a stack.
const TRIED: usize = 3;

pub const PROPERTY: Property = Property {
    name: "lying",
    draw: |seed| {
        let mut case = calm_or_any(seed);
        // Parts have other numbers when they lie otherwise.
        case.settings.links.clear();
        case
    },
    check,
    damage: Some(|stack, _, _, body| {
        let (nx, by) = (stack.dims[0], 0.3 * px(stack) as f32);
        for layer in body.layers.iter_mut().filter(|l| l.contour.is_none()) {
            (0..layer.phi.len()).filter(|n| n % nx % 4 == 0).for_each(|n| layer.phi[n] += by);
        }
    }),
};

fn check(case: &Case, source: &dyn Source) -> Checked {
    let mut n = numbers(case);
    let (mut stack, mut turns) = (Cow::Borrowed(&case.stack), TURNS.to_vec());
    // What the border cuts is another body in a larger image: it is not shifted, or not cut.
    if at_border(&stack) {
        match n.whole(0, 1) {
            0 => turns.retain(|turn| !matches!(turn, Turn::Shifted(_))),
            _ => stack = Cow::Owned(away_from_border(&stack)),
        }
    }
    while turns.len() > TRIED {
        turns.remove(n.whole(0, turns.len() - 1));
    }
    let moved = moved(&stack, &case.settings, source, &turns)?;
    let (worst, turn) = moved.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, TURNS[0]));
    let events = !without_events(&case.stack);
    let with = if events { "with" } else { "without" };
    within(worst, BOUNDS[usize::from(events)], || format!("another body, {turn:?}, {with} events"))
}

/// The stack mirrored both ways in an image that goes on around it.
fn away_from_border(stack: &ContourStack) -> ContourStack {
    let around = Turn::Shifted([2, 2]);
    let turns = [around, Turn::MirrorX, Turn::MirrorY, around];
    turns.iter().fold(stack.clone(), |stack, turn| turn.stack(&stack, ends(&stack)))
}

/// Whether a slice reaches the image's border.
fn at_border(stack: &ContourStack) -> bool {
    let [nx, ny] = stack.dims;
    let is_border = |n: usize| n.is_multiple_of(nx) || n % nx == nx - 1 || n < nx || n / nx == ny - 1;
    stack.slices.iter().any(|slice| (0..nx * ny).any(|n| is_border(n) && slice.content.inside(n)))
}

/// By how much the body changes near its surface, px, for each way to lie.
pub fn moved(
    stack: &ContourStack,
    settings: &Settings,
    source: &dyn Source,
    turns: &[Turn],
) -> Result<Vec<(f64, Turn)>, Fault> {
    let (ends, px) = (ends(stack), px(stack));
    let heights = fine_heights(stack, settings, PARTS);
    let mut body = made(source.layers(stack, &heights, settings))?;
    body.layers.retain(|l| l.output);
    let [nx, ny] = stack.dims;
    let change_by = |turn: &Turn| {
        let (other, heights) = (turn.stack(stack, ends), turn.heights(ends, &heights));
        let mut turned = made(source.layers(&other, &heights, &turn.settings(settings, ends)))?;
        if *turn == Turn::UpsideDown {
            turned.layers.reverse();
        }
        // The plane of an end may be found where a height of the grid is, or beside it.
        turned.layers.retain(|l| l.output);
        let place = |n: usize| {
            let [i, j] = turn.pixel([nx, ny], [n % nx, n / nx]);
            j * other.dims[0] + i
        };
        let pairs = body.layers.iter().zip(&turned.layers);
        let changes = pairs.map(|(a, b)| change(a.phi.iter().enumerate().map(|(n, v)| (v, &b.phi[place(n)])), px));
        Ok((changes.fold(0.0, f64::max), *turn))
    };
    turns.iter().map(change_by).collect()
}
