//! The hold-out score beside linear interpolation of distances, and at the ends.

use crate::shapes::*;
use interslice::evaluate::holdout::hold_out;
use interslice::progress::Silent;
use interslice::settings::EndRule;
use interslice::{Reference, Settings};

/// Distances of masks are known to half a pixel at a circle's border: of some 300 pixels to a dozen, continued to twice as many.
const NEARLY: f64 = 0.97;
const CONTINUED: f64 = 0.93;

fn cone(radii: &[f64]) -> interslice::ContourStack {
    let heights: Vec<f64> = (0..radii.len()).map(|k| 4.0 * k as f64).collect();
    let shapes: Vec<Shape> = radii.iter().map(|r| circle(24.0, 24.0, *r)).collect();
    masks(48, &heights, &shapes)
}

#[test]
fn linear_interpolation_is_exact_on_a_cone_and_wrong_where_it_must_be() {
    let score = |radii: &[f64]| hold_out(&cone(radii), None, &plain(), 2, &Reference, &Silent).expect("a valid stack");
    let even = score(&[8.0, 9.0, 10.0, 11.0, 12.0, 13.0]);
    assert_eq!(even.slices.len(), 2);
    assert!(even.slices.iter().all(|s| s.linear_dice > Some(NEARLY) && s.dice > Some(NEARLY)), "{even:?}");
    assert!(
        even.linear.dice > Some(NEARLY) && even.linear.volume_error_percent.is_some_and(|e| e.abs() < 3.0),
        "{even:?}"
    );
    // The first slice that is left out is far smaller than its neighbours say.
    let odd = score(&[8.0, 3.0, 10.0, 11.0, 12.0, 13.0]);
    assert!(odd.slices[0].linear_dice < Some(0.5) && odd.linear.volume_error_percent > Some(30.0), "{odd:?}");
}

#[test]
fn ends_are_left_out_by_themselves() {
    let stack = cone(&[8.0, 9.0, 10.0, 11.0, 12.0, 13.0]);
    let score = |end_bottom: EndRule, end_top: EndRule| {
        let settings = Settings { end_bottom, end_top, ..plain() };
        hold_out(&stack, None, &settings, 2, &Reference, &Silent).expect("a valid stack")
    };
    let flat = score(EndRule::Flat, EndRule::Flat);
    assert_eq!(flat.ends.iter().map(|s| (s.z, s.pixels[1])).collect::<Vec<_>>(), [(0.0, 0), (20.0, 0)]);
    assert!(flat.ends.iter().all(|s| s.dice == Some(0.0) && s.linear_dice > Some(CONTINUED)), "{flat:?}");
    // The body goes on below; what is between does not change.
    let longer = score(EndRule::Extrapolate, EndRule::Flat);
    assert!(longer.ends[0].dice > Some(0.5) && longer.ends[1].dice == Some(0.0), "{longer:?}");
    assert_eq!(longer.dice, flat.dice);
    // Of three slices one is left without the ends.
    let few = hold_out(&cone(&[8.0, 9.0, 10.0]), None, &plain(), 2, &Reference, &Silent).expect("a valid stack");
    assert!(few.ends.is_empty() && few.slices.len() == 1);
}

#[test]
fn volumes_count_each_slice_by_the_gaps_beside_it() {
    let (heights, radii) = ([0.0, 1.0, 2.0, 52.0, 102.0], [20.0, 22.0, 20.0, 10.0, 20.0]);
    let shapes: Vec<Shape> = radii.iter().map(|r| circle(24.0, 24.0, *r)).collect();
    let score = hold_out(&masks(48, &heights, &shapes), None, &plain(), 2, &Reference, &Silent).expect("a valid stack");
    let left_out: Vec<f64> = score.slices.iter().map(|s| s.z).collect();
    assert_eq!(left_out, [1.0, 52.0]);
    // They stand for 1 and for 50 mm.
    let volume = |k: usize| score.slices[0].pixels[k] as f64 + 50.0 * score.slices[1].pixels[k] as f64;
    let error = 100.0 * (volume(1) - volume(0)) / volume(0);
    assert!(
        score.volume_error_percent.is_some_and(|e| (e - error).abs() < 1e-9) && error > 100.0,
        "{error}: {score:?}"
    );
    assert!(score.linear.volume_error_percent > Some(100.0), "{score:?}");
}

/// A body and its score do not hang on the unit of heights: output heights in the middle of a gap are those of nodes but for their last bits.
#[test]
fn every_slice_that_is_left_out_has_a_score_whatever_the_heights() {
    let radii = [8.0, 9.0, 11.0, 12.0, 12.0, 11.0, 10.0, 8.0, 7.0, 9.0];
    let shapes: Vec<Shape> = radii.iter().map(|r| circle(24.0, 24.0, *r)).collect();
    let score = |heights: &[f64], leave: usize| {
        let stack = masks(48, heights, &shapes);
        hold_out(&stack, None, &plain(), leave, &Reference, &Silent).expect("a valid stack")
    };
    let steps = [1.0, 0.1, 0.3, 0.625, 0.7, 1.3, 2.7, 3.6, 7.2, 85.714_285_714];
    for leave in [2, 3] {
        let mut first = None;
        for step in steps {
            let evenly: Vec<f64> = (0..radii.len()).map(|k| 415.71 + step * k as f64).collect();
            let nearly: Vec<f64> = evenly.iter().map(|z| (1e4 * z).round() / 1e4).collect();
            for heights in [evenly, nearly] {
                let found = score(&heights, leave);
                let left_out = (1..radii.len() - 1).filter(|k| k % leave == leave - 1).count();
                assert_eq!(found.slices.len(), left_out, "every {leave}th, {step} apart");
                let dice = found.dice.expect("there is a truth");
                let first = *first.get_or_insert(dice);
                assert!((dice - first).abs() < 2e-3, "every {leave}th, {step} apart: {dice}, not {first}");
            }
        }
    }
}
