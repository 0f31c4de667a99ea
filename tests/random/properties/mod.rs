//! What must hold for every stack: one property a file, each with a way to break it that it must see.

pub mod beside_inputs;
mod bounded;
pub mod closed_far_away;
mod discs_in_range;
mod exact;
mod half_the_step;
pub mod long_pixels;
pub mod lying;
mod no_cliffs;
pub mod nothing_floats;
mod other_layers;
pub mod overlaps_connected;
pub mod paths;
mod rest_of_grid;
mod threads;

use std::fmt;

use interslice::stack::ContourStack;
use interslice::{Reconstruction, Result as Made, Settings};

use super::case::{self, Case, Kind};
use super::numbers::Numbers;
use super::settings;
use super::source::Source;

/// What did not hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// What was measured, and what it may be.
    pub figure: f64,
    pub bound: f64,
    pub what: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({:.3e}, bound {:.3e})", self.what, self.figure, self.bound)
    }
}

/// The figure that was measured, or nothing where the property says nothing about the case.
pub type Checked = Result<Option<f64>, Fault>;

/// A check of a case on a source.
pub type Check = fn(&Case, &dyn Source) -> Checked;

/// What breaks a sound result so that the property must see it.
pub type Damage = fn(&ContourStack, &[f64], &Settings, &mut Reconstruction);

/// Something that must hold.
pub struct Property {
    pub name: &'static str,
    /// The case of a seed.
    pub draw: fn(u64) -> Case,
    pub check: Check,
    /// Nothing where it is broken otherwise (`tests/promises`).
    pub damage: Option<Damage>,
}

/// All properties.
pub const PROPERTIES: [Property; 17] = [
    rest_of_grid::PROPERTY,
    other_layers::PROPERTY,
    beside_inputs::PROPERTY,
    beside_inputs::OF_VANISHED_SWEEPS,
    overlaps_connected::PROPERTY,
    nothing_floats::PROPERTY,
    discs_in_range::PROPERTY,
    lying::PROPERTY,
    long_pixels::PROPERTY,
    half_the_step::PROPERTY,
    half_the_step::OF_SURFACES,
    bounded::PROPERTY,
    closed_far_away::PROPERTY,
    exact::PROPERTY,
    threads::PROPERTY,
    paths::PROPERTY,
    no_cliffs::PROPERTY,
];

/// The property of that name.
pub fn property(name: &str) -> Option<&'static Property> {
    PROPERTIES.iter().find(|p| p.name == name)
}

/// The property that a campaign tries on a seed. Each has even and odd seeds, whatever its number: some draw other stacks for one than for the other.
pub fn of_seed(seed: u64) -> &'static Property {
    let count = PROPERTIES.len() as u64;
    &PROPERTIES[((seed + seed / count) % count) as usize]
}

/// A random stack of a kind with random settings.
fn drawn(seed: u64, kind: Kind) -> Case {
    let mut n = Numbers::new(seed);
    let stack = case::stack(&mut n, kind);
    let settings = settings::settings(&mut n, &stack);
    Case { seed, stack, settings }
}

/// Anything.
fn any(seed: u64) -> Case {
    drawn(seed, Kind::Any)
}

/// Half of the stacks are such that nothing happens between their slices.
fn calm_or_any(seed: u64) -> Case {
    drawn(seed, if seed.is_multiple_of(2) { Kind::Calm } else { Kind::Any })
}

/// Numbers of a case that are not those of its stack.
fn numbers(case: &Case) -> Numbers {
    Numbers::new(case.seed ^ 0x5eed)
}

/// The layers of a sound stack, or that they could not be made.
fn made(body: Made<Reconstruction>) -> Result<Reconstruction, Fault> {
    let refused = |e| Fault { figure: f64::INFINITY, bound: 0.0, what: format!("sound input is refused: {e}") };
    body.map_err(refused)
}

/// Holds if the figure, which is a number, is no larger than the bound.
fn within(figure: f64, bound: f64, what: impl FnOnce() -> String) -> Checked {
    if figure <= bound { Ok(Some(figure)) } else { Err(Fault { figure, bound, what: what() }) }
}
