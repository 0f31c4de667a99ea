//! Random stacks: closed, exact at every contour, finite, the same upside down.

mod shapes;
mod support;

use interslice::progress::Silent;
use interslice::settings::{EndRule, Linking, Method, Motion, SlopeRule};
use interslice::stack::{ContourStack, SliceContent};
use interslice::surface::mesh::closed_surface;
use interslice::{Reconstruction, Reference, Settings, reconstruct_with};
use proptest::prelude::*;
use shapes::*;
use support::{edge_defects, merged};

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
        let heights: Vec<f64> = (-3..=13).map(|k| top * f64::from(k) / 10.0).collect();
        let settings = Settings { slope: rule, end_top: end, method, motion, fair, link, ..Settings::default() };
        let body = run(&stack, &heights, &settings);
        for layer in &body.layers {
            prop_assert!(layer.phi.iter().all(|v| v.is_finite() && *v != 0.0));
            if let Some(i) = layer.contour {
                let SliceContent::Mask(mask) = &stack.slices[i].content else { unreachable!("masks went in") };
                prop_assert!(mask.iter().zip(&layer.phi).all(|(m, v)| *m == (*v < 0.0)), "contour {i} is not met");
            }
        }
        let mesh = closed_surface(&body);
        prop_assert_eq!(edge_defects(&mesh.triangles), 0);
        prop_assert_eq!(edge_defects(&merged(&mesh)), 0);
        prop_assert!(mesh.volume() > 0.0);

        let turned = upside_down(&stack, top);
        let turned_heights: Vec<f64> = heights.iter().rev().map(|z| top - z).collect();
        let back = run(&turned, &turned_heights, &Settings { end_top: EndRule::Flat, end_bottom: end, ..settings });
        prop_assert_eq!(body.layers.len(), back.layers.len());
        for (a, b) in body.layers.iter().zip(back.layers.iter().rev()) {
            // Trajectories of a moving frame are found to a thousandth of a pixel.
            let sure = if motion == Motion::None { 0.0 } else { 0.02 };
            let flipped = |(a, b): &(&f32, &f32)| (**a < 0.0) != (**b < 0.0) && a.abs().max(b.abs()) > sure;
            let different = a.phi.iter().zip(&b.phi).filter(flipped).count();
            prop_assert_eq!(different, 0, "z = {}", a.z);
        }
    }
}
