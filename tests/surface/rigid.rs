//! Parts that shift and turn, followed by rigid frames.

use crate::links::{FOLLOWED, N, at, misfit, run, stadium};
use crate::shapes::zoo::bar;
use crate::shapes::*;
use interslice::Settings;
use interslice::settings::{Method, Motion};

#[test]
fn an_isolated_part_that_shifts_is_followed_rigidly() {
    let shapes: Vec<Shape> = [30.0, 41.3, 52.6].map(|x| stadium(x, 20.0 + 0.9 * x, 9.0)).into_iter().collect();
    let stack = levels(N, &[0.0, 10.0, 20.0], &shapes);
    let middle = stadium(35.65, 20.0 + 0.9 * 35.65, 9.0);
    for method in [Method::Morph, Method::Field] {
        let settings = |motion| Settings { method, motion, fair: 0.0, ..Settings::default() };
        let rigid = misfit(at(&run(&stack, &[5.0], &settings(Motion::Rigid)), 5.0), N, &middle);
        let none = misfit(at(&run(&stack, &[5.0], &settings(Motion::None)), 5.0), N, &middle);
        println!("{method:?}: {rigid:.4} px, without motion {none:.2} px");
        assert!(rigid <= FOLLOWED && none > 1.0, "{method:?}: {rigid}, {none}");
    }
}

#[test]
fn a_bar_that_turns_is_turned() {
    let angle = 0.5f64;
    let stack = masks(90, &[0.0, 10.0], &[bar(7.0, 0.2), bar(7.0, 0.2 + angle)]);
    // Points move along chords: half way everything is nearer to the centre by this.
    let shrunk = (0.5 * angle).cos();
    let turned = bar(7.0, 0.2 + 0.5 * angle);
    let middle: Shape = Box::new(move |x, y| turned(45.0 + (x - 45.0) / shrunk, 45.0 + (y - 45.0) / shrunk));
    for method in [Method::Morph, Method::Field] {
        let dice = |motion| {
            let body = run(&stack, &[5.0], &Settings { method, motion, fair: 0.0, ..Settings::default() });
            let found: Vec<bool> = at(&body, 5.0).phi.iter().map(|v| *v < 0.0).collect();
            let wanted: Vec<bool> = (0..90 * 90).map(|k| middle((k % 90) as f64, (k / 90) as f64) < 0.0).collect();
            let count = |m: &[bool]| m.iter().filter(|m| **m).count();
            let both: Vec<bool> = found.iter().zip(&wanted).map(|(a, b)| *a && *b).collect();
            2.0 * count(&both) as f64 / (count(&found) + count(&wanted)) as f64
        };
        let (rigid, none) = (dice(Motion::Rigid), dice(Motion::None));
        println!("{method:?}: Dice {rigid:.4}, without motion {none:.4}");
        assert!(rigid > 0.95 && none < 0.9, "{method:?}: {rigid}, {none}");
    }
}

#[test]
fn crowded_parts_get_no_frame() {
    // The second is 5 px from the first one's way.
    let slice = |x: f64| union(circle(x, 40.0, 10.0), circle(45.0, 65.0, 10.0));
    let stack = masks(N, &[0.0, 10.0], &[slice(40.0), slice(52.0)]);
    let layers = |motion| {
        let settings = Settings { method: Method::Field, motion, fair: 0.0, ..Settings::default() };
        run(&stack, &[2.5, 5.0], &settings).layers.into_iter().map(|l| l.phi).collect::<Vec<_>>()
    };
    assert!(layers(Motion::Rigid) == layers(Motion::None), "the same bits");
    assert!(layers(Motion::Rigid) != layers(Motion::Field), "the test can fail");
}
