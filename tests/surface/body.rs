//! A body whose slices are changed and which is asked for more heights: every layer is, bit by bit, that of a new run.

use std::sync::LazyLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use interslice::settings::{EndRule, Method, Motion};
use interslice::{
    Body, Budget, ContourStack, Error, Geometry, Layer, Means, Progress, Reference, Settings, Silent, Slice,
    SliceContent, reconstruct_with,
};

const N: usize = 48;

/// A disc that wanders, with a twig that ends.
fn content(k: usize, radius: f64) -> SliceContent {
    let centre = [24.0 + 3.0 * (0.4 * k as f64).sin(), 23.0 + 2.0 * (0.3 * k as f64).cos()];
    let inside = |n: usize| {
        let x = [(n % N) as f64, (n / N) as f64];
        let twig = (10..13).contains(&k) && (x[0] - 42.0).hypot(x[1] - 42.0) < 3.0;
        twig || (x[0] - centre[0]).hypot(x[1] - centre[1]) < radius
    };
    SliceContent::Mask((0..N * N).map(inside).collect())
}

fn stack(slices: usize) -> ContourStack {
    let slice = |k: usize| Slice {
        name: format!("slice {k}"),
        z: 3.0 * k as f64,
        extra: false,
        content: content(k, 9.0 + 3.0 * (0.5 * k as f64).sin()),
    };
    ContourStack {
        dims: [N, N],
        spacing: [1.0, 0.8],
        unit: "mm".into(),
        slices: (0..slices).map(slice).collect(),
        z_out: None,
        geometry: Geometry::default(),
        known: None,
    }
}

static BUDGET: LazyLock<Budget> = LazyLock::new(Budget::unlimited);

fn means() -> Means<'static> {
    Means { backend: &Reference, progress: &Silent, budget: &BUDGET }
}

fn of_a_run(stack: &ContourStack, heights: &[f64], settings: &Settings) -> Vec<Layer> {
    reconstruct_with(stack, heights, settings, &Reference, &Silent).expect("a sound stack").layers
}

fn same(a: &Layer, b: &Layer) -> bool {
    let bits = |layer: &Layer| layer.dense().into_iter().map(f32::to_bits).collect::<Vec<_>>();
    (a.z, a.output, a.contour) == (b.z, b.output, b.contour) && bits(a) == bits(b)
}

fn assert_same(own: &[Layer], run: &[Layer], what: &str) {
    assert_eq!(own.len(), run.len(), "{what}");
    let differ: Vec<f64> = own.iter().zip(run).filter(|(a, b)| !same(a, b)).map(|(a, _)| a.z).collect();
    assert!(differ.is_empty(), "{what}: layers differ at {differ:?}");
}

fn changes(settings: Settings, slices: usize, changed: usize, radius: f64) {
    let mut stack = stack(slices);
    let heights: Vec<f64> = (0..2 * slices).map(|k| 1.5 * k as f64 - 0.75).collect();
    let mut body = Body::new(stack.clone(), heights.clone(), settings.clone(), &means()).expect("a body");
    assert_same(&body.whole(&means()).expect("a body").layers, &of_a_run(&stack, &heights, &settings), "at first");
    stack.slices[changed].content = content(changed, radius);
    body.update(changed, content(changed, radius)).expect("a sound slice");
    let stale: Vec<usize> = body.stale().collect();
    assert!(stale.contains(&changed.min(slices - 2)), "{stale:?}");
    let run = of_a_run(&stack, &heights, &settings);
    // First the layers beside the slice, then a height in between that nobody has asked for, then everything.
    let beside = changed.saturating_sub(1)..(changed + 1).min(slices - 1);
    let [low, high] = [stack.slices[beside.start].z, stack.slices[beside.end].z];
    let own: Vec<Layer> = body.between(beside.clone(), &means()).expect("layers").cloned().collect();
    let within = |z: f64| (beside.start == 0 || z >= low) && (beside.end + 1 == slices || z < high);
    let expected: Vec<Layer> = run.iter().filter(|layer| within(layer.z)).cloned().collect();
    assert_same(&own, &expected, "beside the slice");
    let z = 0.3 * low + 0.7 * high;
    let asked = body.layer(z, &means()).expect("a layer");
    let of_it = of_a_run(&stack, &[z], &settings).into_iter().find(|layer| layer.output).expect("one");
    assert!(same(&asked, &of_it), "at {z}");
    assert_same(&body.whole(&means()).expect("a body").layers, &run, "whole");
    assert_eq!(body.stale().count(), 0);
}

#[test]
fn a_changed_slice_gives_what_a_new_run_gives() {
    let field = Settings { method: Method::Field, ..Settings::default() };
    changes(field.clone(), 30, 15, 10.5);
    changes(Settings { fair: 0.0, ..field.clone() }, 30, 4, 8.0);
    changes(Settings { end_top: EndRule::Extrapolate, ..field }, 12, 11, 7.0);
    changes(Settings::default(), 8, 3, 10.0);
    changes(Settings { motion: Motion::None, fair: 0.0, ..Settings::default() }, 30, 20, 9.0);
}

#[test]
fn only_what_depends_on_a_slice_is_out_of_date() {
    let settings = Settings { method: Method::Field, motion: Motion::None, fair: 0.0, ..Settings::default() };
    let plain = |k: usize| content(if k == 10 { 9 } else { k.min(9) }, 10.0);
    let mut stack = stack(30);
    (0..30).for_each(|k| stack.slices[k].content = plain(k));
    let heights: Vec<f64> = (0..60).map(|k| 1.5 * k as f64).collect();
    let mut body = Body::new(stack, heights, settings, &means()).expect("a body");
    // One row less of the disc: the window stays.
    let smaller = plain(9).sides().iter().enumerate().map(|(n, inside)| *inside && n / N < 30).collect();
    body.update(15, SliceContent::Mask(smaller)).expect("a sound slice");
    let stale: Vec<usize> = body.stale().collect();
    assert!(stale.len() < 29 && stale.contains(&14) && stale.contains(&15) && !stale.contains(&0), "{stale:?}");
}

#[test]
fn wrong_slices_are_refused_and_change_nothing() {
    let mut body = Body::new(stack(6), vec![1.0, 2.0], Settings::default(), &means()).expect("a body");
    let refused = body.update(6, content(3, 9.0)).expect_err("there are six").to_string();
    assert_eq!(refused, "`slice` must lie in [0, 5], the body's slices; got 6");
    let refused = body.update(2, SliceContent::Mask([true].into_iter().collect())).expect_err("one pixel").to_string();
    assert_eq!(refused, "slice 2 (`slice 2`): 1 pixels, but the stack is 48x48 px");
    assert_eq!(body.stale().count(), 0);
    assert!(body.layer(f64::NAN, &means()).is_err());
    let far = body.layer(1e3, &means()).expect("outside");
    assert!(far.dense().iter().all(|v| *v > 0.0));
}

/// Ends a run after some questions.
struct Stops(AtomicUsize);

impl Progress for Stops {
    fn begin(&self, _stage: &'static str, _total: usize) {}
    fn advance(&self, _units: usize) {}
    fn end(&self) {}
    fn stops(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) >= 5
    }
}

#[test]
fn a_listener_ends_a_run() {
    let stops = Stops(0.into());
    let means = Means { progress: &stops, ..means() };
    let ended = Body::new(stack(12), vec![1.0], Settings::default(), &means).expect_err("it was ended");
    assert!(matches!(ended, Error::Interrupted) && ended.exit_code() == 1);
}

/// A volume has one distance of its layers: others than these are refused, and what has heights of its own is written.
#[test]
fn layers_that_lie_unevenly_are_no_volume() {
    let place = tempfile::tempdir().expect("a folder");
    let at = |name: &str| place.path().join(name);
    let made = |heights: &[f64]| {
        let settings = Settings { method: Method::Field, ..Settings::default() };
        reconstruct_with(&stack(3), heights, &settings, &Reference, &Silent).expect("a sound stack")
    };
    let uneven = made(&[0.0, 1.0, 2.0, 5.0]);
    for name in ["a.nrrd", "a.nii.gz", "a.mha", "a.vti", "a.tif", "a.npz"] {
        match interslice::write(&uneven, &[at(name)]) {
            Err(Error::Output { path, message }) => {
                assert!(path == at(name) && message.contains("got heights 0 and 1, 1 apart"), "{message}");
            }
            other => panic!("{name}: {other:?}"),
        }
    }
    assert_eq!(std::fs::read_dir(place.path()).expect("a folder").count(), 0, "nothing is left");
    // Far from zero the distances of heights are rounded.
    let far =
        ContourStack { slices: stack(3).slices.into_iter().map(|s| Slice { z: 1e9 + s.z, ..s }).collect(), ..stack(3) };
    let heights: Vec<f64> = (0..50).map(|k| 1e9 + 0.1 * f64::from(k)).collect();
    let settings = Settings { method: Method::Field, ..Settings::default() };
    let body = reconstruct_with(&far, &heights, &settings, &Reference, &Silent).expect("a sound stack");
    interslice::write(&body, &[at("far.nrrd")]).expect("even heights");
    for (heights, name) in [
        (&[0.0, 1.0, 2.0, 5.0][..], "b.npy"),
        (&[0.0, 1.0, 2.0, 5.0], "b.contours.json"),
        (&[0.5, 1.7, 2.9, 4.1], "b.nrrd"),
        (&[0.5, 5.0], "c.nrrd"),
        (&[2.0], "d.nrrd"),
    ] {
        interslice::write(&made(heights), &[at(name)]).expect(name);
    }
}
