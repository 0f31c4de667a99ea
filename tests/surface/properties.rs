//! Random stacks: closed, exact at every contour, finite, the same upside down.

use crate::shapes::*;
use crate::support::{edge_defects, merged};
use interslice::grid::spline::hermite_values;
use interslice::progress::Silent;
use interslice::settings::{EndRule, Linking, Method, Motion, SlopeRule};
use interslice::stack::{ContourStack, SliceContent};
use interslice::surface::Layer;
use interslice::surface::mesh::closed_surface;
use interslice::{Reconstruction, Reference, Settings, reconstruct_with};
use proptest::prelude::*;

const N: usize = 44;

/// Up to three blobs, one of them perhaps cut out; sizes from below a pixel to beyond the image.
fn slice() -> impl Strategy<Value = Vec<(f64, f64, f64, bool)>> {
    prop::collection::vec(
        (0.0..44.0f64, 0.0..44.0f64, prop_oneof![0.3..3.0f64, 2.0..16.0f64], prop::bool::weighted(0.25)),
        0..4,
    )
}

fn shape(blobs: &[(f64, f64, f64, bool)]) -> Shape {
    let mut out = nothing();
    for &(x, y, r, cut) in blobs {
        out = if cut { without(out, circle(x, y, r)) } else { union(out, circle(x, y, r)) };
    }
    out
}

fn run(stack: &ContourStack, heights: &[f64], settings: &Settings) -> Reconstruction {
    reconstruct_with(stack, heights, settings, &Reference, &Silent).expect("the stack is valid")
}

/// Checks a reconstruction of `stack`, which ends at `top`, and the same upside down.
fn check(stack: &ContourStack, top: f64, settings: &Settings) -> Result<(), TestCaseError> {
    let heights: Vec<f64> = (-3..=13).map(|k| top * f64::from(k) / 10.0).collect();
    let body = run(stack, &heights, settings);
    for layer in &body.layers {
        prop_assert!(layer.phi.iter().all(|v| v.is_finite() && *v != 0.0));
        if let Some(i) = layer.contour {
            let SliceContent::Mask(mask) = &stack.slices[i].content else { unreachable!("masks went in") };
            prop_assert!(mask.iter().zip(layer.phi.iter()).all(|(m, v)| m == (*v < 0.0)), "contour {i} is not met");
        }
    }
    let mesh = closed_surface(&body);
    prop_assert_eq!(edge_defects(&mesh.triangles), 0);
    prop_assert_eq!(edge_defects(&merged(&mesh)), 0);
    prop_assert!(mesh.volume() > 0.0);

    let turned = upside_down(stack, top);
    let turned_heights: Vec<f64> = heights.iter().rev().map(|z| top - z).collect();
    let back = run(
        &turned,
        &turned_heights,
        &Settings { end_top: settings.end_bottom, end_bottom: settings.end_top, ..settings.clone() },
    );
    prop_assert_eq!(body.layers.len(), back.layers.len());
    for (a, b) in body.layers.iter().zip(back.layers.iter().rev()) {
        // Trajectories of a moving frame are found to a thousandth of a pixel.
        let sure = if settings.motion == Motion::None { 0.0 } else { 0.02 };
        let flipped = |(a, b): &(&f32, &f32)| (**a < 0.0) != (**b < 0.0) && a.abs().max(b.abs()) > sure;
        let different: Vec<(&f32, &f32)> = a.phi.iter().zip(b.phi.iter()).filter(flipped).collect();
        prop_assert!(different.is_empty(), "z = {}: {different:?}", a.z);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn closed_exact_finite_and_reversible(
        slices in prop::collection::vec(slice(), 2..5),
        gaps in prop::collection::vec(0.5f64..20.0, 4),
        rule in prop_oneof![Just(SlopeRule::Hyman), Just(SlopeRule::Natural), Just(SlopeRule::Linear)],
        end in prop_oneof![Just(EndRule::Flat), Just(EndRule::HalfSlice), Just(EndRule::Extrapolate)],
        method in prop_oneof![Just(Method::Morph), Just(Method::Field)],
        (motion, fair, link) in prop_oneof![
            Just((Motion::None, 0.0, Linking::Off)),
            Just((Motion::Field, 1.0, Linking::Off)),
            Just((Motion::Field, 1.0, Linking::Auto)),
            Just((Motion::Rigid, 1.0, Linking::Auto)),
        ],
    ) {
        let z: Vec<f64> = (0..slices.len()).map(|k| gaps[..k].iter().sum()).collect();
        let shapes: Vec<Shape> = slices.iter().map(|s| shape(s)).collect();
        let stack = masks(N, &z, &shapes);
        prop_assume!(stack.slices.iter().any(|s| !s.content.is_empty()));
        let top = z[z.len() - 1];
        let settings = Settings { slope: rule, end_top: end, method, motion, fair, link, ..Settings::default() };
        check(&stack, top, &settings)?;
    }
}

#[test]
fn values_between_slices_are_the_same_from_either_end() {
    let value = |k: u32, by: f64| (f64::from(k) * by).sin() * 10.0;
    for k in 0..10_000 {
        let (a, b, ma, mb) = (value(k, 0.7), value(k, 1.3), value(k, 2.1), value(k, 3.7));
        // Times are steps of a power of two: `1 - t` is exact.
        let t = f64::from(k % 1024) / 1024.0;
        let (up, down) = (hermite_values([a, b], [ma, mb], t), hermite_values([b, a], [-mb, -ma], 1.0 - t));
        assert_eq!(up.to_bits(), down.to_bits(), "{a} {b} {ma} {mb} at {t}");
    }
}

#[test]
fn a_disc_that_closes_above_an_empty_slice_ends_in_a_tie() {
    // Half way its deepest pixel is at distance 0.
    let z = [0.0, 0.5];
    let stack = masks(N, &z, &[nothing(), circle(26.6133486550037, 41.341264513151835, 9.578079769709053)]);
    let settings = Settings { method: Method::Field, motion: Motion::None, fair: 0.0, ..Settings::default() };
    check(&stack, 0.5, &settings).expect("the same upside down");
}

#[test]
fn a_slice_beyond_a_small_gap_is_read_alike_from_either_side() {
    // Fairing reaches across the small gap.
    let z = [0.0, 17.26205588527773, 18.897919237465434];
    let lower = union(circle(5.0979558746454705, 24.86896256579865, 14.01124332706829), circle(0.0, 0.0, 2.0));
    let stack = masks(N, &z, &[nothing(), lower, circle(31.774114597539594, 34.14344685200299, 13.31051842111368)]);
    let settings = Settings {
        slope: SlopeRule::Natural,
        end_top: EndRule::Extrapolate,
        link: Linking::Auto,
        ..Settings::default()
    };
    check(&stack, z[2], &settings).expect("the same upside down");
}

#[test]
fn an_end_plane_half_a_gap_beyond_counts_from_either_side() {
    let tiny = || circle(0.0, 0.0, 0.3);
    let settings = Settings { end_top: EndRule::HalfSlice, ..Settings::default() };
    let [first, second, third] = [12.39357670353125, 8.846571585616067, 1.3315453412357692];
    let z = [0.0, first, first + second, first + second + third];
    let stack = masks(N, &z, &[nothing(), nothing(), circle(37.16483021114159, 0.0, 10.305424578823077), tiny()]);
    let by_field = Settings { method: Method::Field, ..settings.clone() };
    check(&stack, z[3], &by_field).expect("the same upside down");
    let [first, second] = [13.912394820253496, 1.2098172527458766];
    let z = [0.0, first, first + second];
    let stack = masks(N, &z, &[nothing(), tiny(), circle(0.0, 30.508509291035846, 1.9654920508037057)]);
    check(&stack, z[2], &settings).expect("the same upside down");
}

#[test]
fn a_piece_that_floats_is_joined_in_the_same_layer_from_either_side() {
    // Two layers have a way of one pixel.
    let z = [0.0, 0.5, 8.541074236869873];
    let blobs = [
        circle(13.399783227585187, 5.104447213559773, 7.841323650936938),
        circle(0.0, 24.6635928174255, 1.809152581083111),
        circle(13.58052076954891, 41.35157941339401, 12.27249366567758),
    ];
    let [first, second, third] = blobs;
    let shapes = [
        circle(15.78088135819946, 39.97086258719118, 14.923638640765587),
        circle(38.99283486153443, 37.26710384797735, 2.4181565385498454),
        union(union(first, second), third),
    ];
    let settings = Settings { slope: SlopeRule::Linear, end_top: EndRule::HalfSlice, fair: 1.0, ..Settings::default() };
    check(&masks(N, &z, &shapes), z[2], &settings).expect("the same upside down");
}

#[test]
fn discs_on_a_slice_each_are_read_alike_from_either_side() {
    let gaps = [6.440272801485348, 0.5, 10.2931628623887];
    let z: Vec<f64> = (0..4).map(|k| gaps[..k].iter().sum()).collect();
    let shapes = [
        circle(38.69322286482654, 17.397250990585974, 2.527076459721017),
        nothing(),
        circle(21.73024340937658, 38.91274559282184, 2.0),
        circle(32.359987894191406, 14.890971953724653, 2.484284597185238),
    ];
    let settings =
        Settings { end_top: EndRule::HalfSlice, motion: Motion::Rigid, link: Linking::Auto, ..Settings::default() };
    check(&masks(N, &z, &shapes), z[3], &settings).expect("the same upside down");
}

/// Radii of the layers of a stack, from their areas; a pixel on the contour counts by its distance.
fn radii(stack: &ContourStack, heights: &[f64]) -> Vec<f64> {
    let body = run(stack, heights, &Settings::default());
    let shown = body.layers.iter().filter(|layer| layer.output);
    let area = |layer: &Layer| layer.phi.iter().map(|v| f64::from(0.5 - v).clamp(0.0, 1.0)).sum::<f64>();
    shown.map(|layer| (area(layer) / std::f64::consts::PI).sqrt()).collect()
}

#[test]
fn slices_close_beside_others_do_not_bend_what_lies_in_wide_gaps() {
    // Over the narrow gaps a cone and a neck move by a fraction of a pixel, in the wide ones by several.
    let cone = |z: f64| 22.0 * (1.0 - z / 60.0);
    let neck = |z: f64| (64.0 + 0.25 * (z - 25.0).powi(2)).sqrt();
    let heights: Vec<f64> = (0..=100).map(|k| 0.5 * f64::from(k)).collect();
    let mut state = 3;
    for round in 0..4 {
        for (name, z, radius) in [
            ("cone", [0.0, 0.5, 1.0, 20.0, 21.0, 40.0, 40.2, 50.0], &cone as &dyn Fn(f64) -> f64),
            ("neck", [0.0, 1.0, 12.0, 12.5, 25.0, 38.0, 39.0, 50.0], &neck),
        ] {
            let [x, y] = [(); 2].map(|()| 30.0 + crate::shapes::spheres::random(&mut state));
            let shapes: Vec<Shape> = z.iter().map(|z| circle(x, y, radius(*z))).collect();
            for (kind, stack, most) in
                [("pixels", masks(61, &z, &shapes), 0.15), ("lines", levels(61, &z, &shapes), 0.06)]
            {
                let off: f64 =
                    radii(&stack, &heights).iter().zip(&heights).map(|(r, z)| (r - radius(*z)).powi(2)).sum();
                let off = (off / heights.len() as f64).sqrt();
                println!("{round} {name} {kind}: {off:.3}");
                assert!(off < most, "{name} {round} of {kind}: radii are off by {off} px");
            }
        }
    }
}
