//! The hold-out score says what is to be said, and no more (P19).

use crate::files::*;
use interslice::evaluate::holdout::hold_out;
use interslice::settings::Link;
use interslice::stack::{Geometry, HeightGrid, Slice, SliceContent};
use interslice::{ContourStack, Reference, Settings, progress, reconstruct};

const N: usize = 48;

/// A part of radius `r` about (`x`, 23).
fn slice(k: usize, z: f64, parts: &[(f64, f64)]) -> Slice {
    let inside = |n: usize| parts.iter().any(|(x, r)| ((n % N) as f64 - x).hypot((n / N) as f64 - 23.0) < *r);
    let content = SliceContent::Mask((0..N * N).map(inside).collect());
    Slice { name: format!("s{k}"), z, extra: false, content }
}

fn stack(slices: Vec<Slice>) -> ContourStack {
    let geometry = Geometry::default();
    ContourStack { dims: [N, N], spacing: [1.0, 1.0], unit: "mm".into(), slices, z_out: None, geometry, known: None }
}

/// A body that branches.
fn branching() -> ContourStack {
    let slices = (0..9).map(|k| {
        let (z, apart) = (4.0 * k as f64, 1.6 * (k as f64 - 2.0).max(0.0));
        slice(k, z, &[(23.0 - apart, 9.0 - 0.3 * k as f64), (23.0 + apart, 7.0)])
    });
    stack(slices.collect())
}

/// A link counts where both its slices are kept, and then between these: elsewhere there is no second part.
#[test]
fn links_go_with_their_slices() {
    let two = |k: usize| if k == 3 || k == 4 { vec![(12.0, 5.0), (34.0, 5.0)] } else { vec![(23.0, 16.0)] };
    let all = stack((0..8).map(|k| slice(k, 4.0 * k as f64, &two(k))).collect());
    let link = |slice, from, to| Link { slice, from, to, join: true };
    // 2 and 5 are left out: of the pairs that are named only 3 and 4 are kept.
    let settings = Settings { links: vec![link(2, 1, 2), link(3, 2, 2), link(4, 2, 1)], ..Settings::default() };
    let score = hold_out(&all, None, &settings, 3, &Reference, &progress::Silent).expect("it can be scored");
    assert_eq!((score.links, score.slices.len()), (1, 2));
    let wrong = Settings { links: vec![link(3, 2, 3)], ..Settings::default() };
    let e = hold_out(&all, None, &wrong, 3, &Reference, &progress::Silent).expect_err("there is no third part");
    assert!(e.to_string().contains("`to` must lie in [1, 2]"), "{e}");
}

fn score(stack: &ContourStack) -> interslice::evaluate::holdout::HoldOut {
    hold_out(stack, None, &Settings::default(), 2, &Reference, &progress::Silent).expect("it can be scored")
}

#[test]
fn p19_the_score_is_that_of_a_reconstruction_at_the_same_heights() {
    let all = branching();
    let score = score(&all);
    let kept = all.slices.iter().step_by(2).cloned().collect();
    let grid = HeightGrid { start: 4.0, step: 8.0, count: 4 };
    let thinned = ContourStack { z_out: Some(grid), ..stack(kept) };
    let body = reconstruct(&thinned, &Settings::default()).expect("it can be computed");
    let layers: Vec<_> = body.output_layers().collect();
    assert_eq!((layers.len(), score.slices.len()), (4, 4));
    let (mut common, mut sizes) = (0, 0);
    for (s, layer) in score.slices.iter().zip(layers) {
        let truth = all.slices.iter().find(|slice| slice.z == layer.z).expect("the slice left out").content.sides();
        let both = truth.iter().zip(layer.phi.iter()).filter(|(t, v)| **t && **v < 0.0).count();
        let found = layer.phi.iter().filter(|v| **v < 0.0).count();
        let there = truth.iter().filter(|t| **t).count();
        assert_eq!(s.pixels, [there, found], "height {}", s.z);
        let dice = 2.0 * both as f64 / (there + found) as f64;
        assert!(s.dice.is_some_and(|d| (d - dice).abs() < 1e-12), "{:?}, not {dice}", s.dice);
        (common, sizes) = (common + both, sizes + there + found);
    }
    let dice = 2.0 * common as f64 / sizes as f64;
    assert!(score.dice.is_some_and(|d| (d - dice).abs() < 1e-12), "{:?}, not {dice}", score.dice);
    assert!(dice > 0.9 && score.surface_distance.is_some_and(|d| d > 0.0 && d < 1.0), "{score:?}");
}

/// Every second slice is empty: what is found there can be compared with nothing.
#[test]
fn p19_nothing_is_said_where_the_truth_is_empty() {
    let slices = |empty: fn(usize) -> bool| {
        let parts = |k: usize| if empty(k) { vec![] } else { vec![(23.0, 8.0)] };
        stack((0..7).map(|k| slice(k, 4.0 * k as f64, &parts(k))).collect())
    };
    let nothing = score(&slices(|k| k % 2 == 1));
    assert_eq!((nothing.dice, nothing.surface_distance, nothing.volume_error_percent), (None, None, None));
    assert_eq!(nothing.slices.len(), 3);
    for s in &nothing.slices {
        assert!(s.pixels[0] == 0 && s.pixels[1] > 0, "{s:?}");
        assert_eq!((s.dice, s.surface_distance, s.area_error_percent), (None, None, None));
    }
    let json = serde_json::to_value(&nothing).expect("JSON");
    assert!(json["dice"].is_null() && json["volume_error_percent"].is_null(), "{json}");
    // One slice of three is empty: the others have a score.
    let some = score(&slices(|k| k == 3));
    assert_eq!(some.slices.iter().map(|s| s.dice.is_some()).collect::<Vec<_>>(), [true, false, true]);
    assert!(some.dice.is_some() && some.volume_error_percent.is_some());
}

#[test]
fn p19_a_dash_stands_where_there_is_nothing_to_say() {
    let place = folder();
    for (k, r) in [8.0, 0.0, 8.0, 0.0, 8.0].into_iter().enumerate() {
        disc(&place.path().join(format!("s{k}.png")), 32, r);
    }
    let entries: Vec<String> = (0..5).map(|k| format!(r#"{{"file": "s{k}.png", "z": {}}}"#, 4 * k)).collect();
    write_stack(place.path(), &format!(r#"{{"spacing_xy": [1, 1], "slices": [{}]}}"#, entries.join(", ")));
    let output = interslice(&["evaluate", &place.path().display().to_string(), "--backend", "cpu"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(said.contains("2 slices left out, one in 2: Dice -, mean contour distance -, volume -"), "{said}");
    assert!(said.contains("linear interpolation of distances: Dice -, mean contour distance -, volume -"), "{said}");
    // The ends have something to say.
    let between = said.split("the first and the last slice").next().expect("the slices between");
    assert!(!between.contains("0.0000 mm") && !between.contains('%'), "{said}");
}
