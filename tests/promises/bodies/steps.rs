//! Half the step gives the same body, and gaps unlike each other do no harm, or it is told.

use interslice::Settings;
use interslice::settings::SlopeRule;

use super::{holds, of_zoo, run, steps, ways};
use crate::shapes::{circle, masks, nothing, plain};
use crate::{REFERENCE, named};

#[test]
fn p08_half_the_step_gives_the_same_body() {
    // At the fork it is 0.12 px with half of 0.5, 0.02 px with half of 0.1.
    for (cfl, most) in [(0.5, 0.2), (0.1, 0.05)] {
        let body = |cfl: f64| run(&of_zoo("one_to_two", 10.0), &steps(11, 1.0), &Settings { cfl, ..plain() });
        let [one, half] = [body(cfl), body(0.5 * cfl)];
        let pixels = one.layers.iter().zip(&half.layers).flat_map(|(a, b)| a.phi.iter().zip(b.phi.iter()));
        let near = pixels.filter(|(a, b)| a.abs() < 1.0 || (**a < 0.0) != (**b < 0.0));
        let change = near.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("{cfl}: {change} px");
        assert!(change < most, "{cfl}: {change} px");
    }
}

/// Beside a gap a hundred times as long, a gradient of fairing along a short one tells of rounding and of the sweeps' steps (0.94 px).
#[test]
fn p08_a_gap_unlike_its_neighbours_stays_calm() {
    let property = named("half_the_step");
    let case = (property.draw)(303_864);
    let change = match (property.check)(&case, &REFERENCE) {
        Ok(change) => change.expect("the body has pixels near its surface"),
        Err(fault) => fault.figure,
    };
    println!("{change} px");
    assert!(change < 0.1, "{change} px");
}

#[test]
fn p08_splines_that_overshoot_on_unlike_gaps_are_warned_of() {
    let discs = [8.0, 9.0, 11.0].map(|r| circle(20.0, 20.0, r));
    let warned = |z: [f64; 3], slope| {
        let body = run(&masks(40, &z, &discs), &z, &Settings { slope, ..plain() });
        body.report.warnings.iter().filter(|w| w.contains("between gaps so unlike")).count()
    };
    let unlike = [0.0, 1.0, 21.0];
    for (slope, count) in
        [(SlopeRule::Natural, 1), (SlopeRule::Catmull, 1), (SlopeRule::Hyman, 0), (SlopeRule::Pchip, 0)]
    {
        assert_eq!(warned(unlike, slope), count, "{slope:?}");
        assert_eq!(warned([0.0, 1.0, 10.0], slope), 0, "{slope:?}");
    }
}

#[test]
fn p18_distances_keep_their_bound_after_fairing() {
    // Gaps that differ by a factor of 300: what is straight over the small one is far over the large one.
    let shapes = || vec![circle(20.0, 20.0, 9.0), circle(26.0, 22.0, 12.0), nothing(), circle(24.0, 24.0, 7.0)];
    for heights in [[0.0, 0.1, 30.1, 30.2], [0.0, 30.0, 30.1, 60.1]] {
        for (_, settings) in ways() {
            holds("bounded", &masks(48, &heights, &shapes()), settings);
        }
    }
}
