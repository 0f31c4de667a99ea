//! Areas stay between those that are drawn: equal discs stay as they are, and nothing balloons beside empty slices.

use std::f64::consts::PI;

use interslice::settings::{Motion, SlopeRule};
use interslice::stack::ContourStack;
use interslice::{Reconstruction, Settings};

use super::{holds, run, steps, ways};
use crate::REFERENCE;
#[cfg(feature = "gpu")]
use crate::on_gpu;
use crate::random::measure::{area, layer_at};
use crate::random::settings::fine_heights;
use crate::random::source::Source;
use crate::shapes::{circle, masks, nothing};

fn pixels(body: &Reconstruction, z: f64) -> usize {
    layer_at(body, z).map_or(0, |l| l.phi.iter().filter(|v| **v < 0.0).count())
}

/// Seven equal discs of about 609 px at 8, 16 .. 56.
fn seven_discs() -> ContourStack {
    let heights: Vec<f64> = (1..=7).map(|k| 8.0 * f64::from(k)).collect();
    masks(64, &heights, &(0..7).map(|_| circle(31.5, 31.5, 13.9)).collect::<Vec<_>>())
}

fn does_not_balloon(source: &dyn Source) {
    let stack = seven_discs();
    for (name, settings) in ways() {
        let body = source.layers(&stack, &steps(64, 1.0), &settings).expect("the stack is valid");
        let drawn = pixels(&body, 8.0) as f64;
        let areas: Vec<usize> = (8..=56).map(|z| pixels(&body, f64::from(z))).collect();
        // A tenth of a pixel of the radius.
        let most = 0.1 * 2.0 * PI * (drawn / PI).sqrt();
        assert!(areas.iter().all(|a| (*a as f64 - drawn).abs() <= most), "{name}: {areas:?} for {drawn}");
        assert!((0..8).chain(57..64).all(|z| pixels(&body, f64::from(z)) == 0), "{name}: flat ends");
    }
}

#[test]
fn p01_a_cylinder_does_not_balloon_in_a_grid_that_goes_on() {
    does_not_balloon(&REFERENCE);
}

#[cfg(feature = "gpu")]
#[test]
fn p01_nor_on_a_gpu() {
    on_gpu(|gpu| does_not_balloon(gpu));
}

#[test]
fn p01_what_lies_beyond_changes_no_bit() {
    for (_, settings) in ways() {
        holds("rest_of_grid", &seven_discs(), settings);
    }
}

#[test]
fn p05_equal_neighbours_stay_equal() {
    let stack = masks(90, &steps(4, 10.0), &[20.0, 20.0, 30.0, 30.0].map(|r| circle(44.5, 44.5, r)));
    for (_, settings) in ways() {
        for slope in [SlopeRule::Hyman, SlopeRule::Pchip] {
            holds("discs_in_range", &stack, Settings { slope, ..settings.clone() });
        }
    }
}

#[test]
fn p17_a_disc_between_empty_slices_does_not_balloon() {
    let disc = || circle(31.5, 31.5, 5.97);
    let stack = masks(64, &steps(3, 8.0), &[nothing(), disc(), nothing()]);
    let volume = |settings: &Settings| {
        let body = run(&stack, &fine_heights(&stack, settings, 8), settings);
        body.layers.iter().map(|l| area(l, 1.0)).sum::<f64>()
    };
    let default = Settings::default();
    let (faired, still) = (volume(&default), volume(&Settings { motion: Motion::None, ..default.clone() }));
    let unfaired = volume(&Settings { fair: 0.0, ..default });
    assert!((faired / unfaired - 1.0).abs() <= 0.1, "{faired:.0} px faired, {unfaired:.0} without");
    assert!(
        (faired / still - 1.0).abs() <= 0.02,
        "{faired:.0} px with motion, {still:.0} without, though nothing moves"
    );
}

#[test]
fn p17_nor_one_drawn_three_times() {
    let disc = || circle(31.5, 31.5, 5.97);
    let stack = masks(64, &steps(4, 8.0), &[disc(), disc(), disc(), nothing()]);
    holds("discs_in_range", &stack, Settings::default());
}
