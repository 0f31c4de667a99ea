//! The bodies on which each promise was first seen broken.

mod ballooning;
mod connected;
mod crowds;
mod layers;
mod lying;
mod measured;
#[cfg(feature = "gpu")]
mod paths;
mod single_slices;
mod steps;

use interslice::settings::{Method, Motion};
use interslice::stack::ContourStack;
use interslice::{Reconstruction, Settings};

use crate::random::case::Case;
use crate::shapes::masks;
use crate::shapes::zoo::{N, zoo};
use crate::{REFERENCE, Source, named};

fn run(stack: &ContourStack, heights: &[f64], settings: &Settings) -> Reconstruction {
    REFERENCE.layers(stack, heights, settings).expect("the stack is valid")
}

/// A case of its own for a property.
fn of(stack: &ContourStack, settings: Settings) -> Case {
    Case { seed: 0, stack: stack.clone(), settings }
}

fn holds(name: &str, stack: &ContourStack, settings: Settings) {
    if let Err(fault) = (named(name).check)(&of(stack, settings), &REFERENCE) {
        panic!("{name}: {fault}");
    }
}

fn steps(count: usize, by: f64) -> Vec<f64> {
    (0..count).map(|k| by * k as f64).collect()
}

/// Stack of the zoo with slices this far apart.
fn of_zoo(name: &str, gap: f64) -> ContourStack {
    let (_, shapes) = zoo().into_iter().find(|(n, _)| *n == name).expect("it is in the zoo");
    masks(N, &steps(shapes.len(), gap), &shapes)
}

/// The default, without motion, and the field method.
fn ways() -> [(&'static str, Settings); 3] {
    let default = Settings::default();
    [
        ("default", default.clone()),
        ("still", Settings { motion: Motion::None, ..default.clone() }),
        ("field", Settings { method: Method::Field, ..default }),
    ]
}
