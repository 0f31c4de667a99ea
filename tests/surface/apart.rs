//! Bodies that end beside others: two that never touch stay two, and one that ends where a rod at its side goes on ends as it does by itself.

use crate::backends::on_backends;
use crate::shapes::*;
use crate::support::connected;
use interslice::grid::components::label4;
use interslice::grid::sparse_image::SparseImage;
use interslice::progress::Silent;
use interslice::settings::Method;
use interslice::{Reference, Settings, reconstruct_with};

const N: usize = 72;
const C: f64 = 36.0;

/// Layers a unit apart on slices so far apart.
fn layers(gap: f64, shapes: &[Shape], method: Method) -> Vec<Vec<f32>> {
    let heights: Vec<f64> = (0..shapes.len()).map(|k| k as f64 * gap).collect();
    let all: Vec<f64> = (0..=(heights[heights.len() - 1]) as usize).map(|z| z as f64).collect();
    let settings = Settings { method, ..Settings::default() };
    let stack = masks(N, &heights, shapes);
    let body = reconstruct_with(&stack, &all, &settings, &Reference, &Silent).expect("the stack is valid");
    body.layers.iter().map(|layer| layer.phi.iter().copied().collect()).collect()
}

#[test]
fn a_body_that_ends_beside_one_that_begins_is_not_joined_to_it() {
    for method in [Method::Morph, Method::Field] {
        for (radius, gap) in [(4.0, 4.0), (4.0, 6.0), (4.0, 8.0), (6.0, 8.0), (8.0, 8.0)] {
            let [left, right] = [C - radius - 1.0, C + radius + 1.0];
            let of = |x: f64| circle(x, C, radius);
            let shapes = [nothing(), of(left), of(left), of(right), of(right), nothing()];
            let layers = layers(gap, &shapes, method);
            let all: Vec<&[f32]> = layers.iter().map(Vec::as_slice).collect();
            let node = |x: f64, z: f64| ((z * gap) as usize, C as usize * N + x as usize);
            assert!(connected(&all, [N, N], node(left, 1.0), node(left, 2.0)), "each is one");
            assert!(
                !connected(&all, [N, N], node(left, 2.0), node(right, 3.0)),
                "{method:?}: radius {radius}, gaps of {gap}"
            );
        }
    }
}

#[test]
fn what_moves_on_by_more_than_its_width_stays_one() {
    for method in [Method::Morph, Method::Field] {
        let shapes: Vec<Shape> = (0..5).map(|k| circle(12.0 + 11.0 * f64::from(k), C, 4.0)).collect();
        let layers = layers(6.0, &shapes, method);
        let all: Vec<&[f32]> = layers.iter().map(Vec::as_slice).collect();
        let node = |k: usize| (6 * k, C as usize * N + 12 + 11 * k);
        assert!(connected(&all, [N, N], node(0), node(4)), "{method:?}");
    }
}

#[test]
fn a_body_that_ends_where_a_rod_at_its_side_goes_on_ends_as_it_does_by_itself() {
    type Made = fn() -> Shape;
    let bodies: [(&str, Made); 2] = [
        ("ring", || without(circle(C, C, 18.0), circle(C, C, 12.0))),
        ("slab", || Box::new(|x, y| ((x - C).abs() - 20.0).max((y - C).abs() - 4.0))),
    ];
    let inside = |layer: &Vec<f32>| layer.iter().filter(|v| **v < 0.0).count() as f64;
    for method in [Method::Morph, Method::Field] {
        for (name, body) in bodies {
            for upward in [true, false] {
                let with = |other: fn(Shape) -> Shape| {
                    let mut shapes = vec![other(body()), other(body()), other(body())];
                    shapes.extend([other(nothing()), other(nothing())]);
                    if !upward {
                        shapes.reverse();
                    }
                    layers(8.0, &shapes, method)
                };
                let [alone, beside] = [with(|body| body), with(|body| union(body, circle(C + 15.0, C, 3.2)))];
                let gap = if upward { 17..24 } else { 9..16 };
                let [alone, beside] = [alone, beside].map(|layers| layers[gap.clone()].iter().map(inside).sum::<f64>());
                println!("{method:?}, {name}, upward {upward}: {alone} px alone, {beside} with the rod");
                assert!(beside > 0.9 * alone, "{method:?}, {name}, upward {upward}: {beside} of {alone} px");
            }
        }
    }
}

/// Slices beyond would say how it moves; where there are none what stands beside it does.
#[test]
fn on_two_slices_what_ends_is_not_joined_to_what_stands_beside_it() {
    on_backends(|backend| {
        for (height, way) in [(10.0, 3.0), (10.0, 5.0), (4.0, 3.0)] {
            let bar = |left: f64, wide: f64| -> Shape {
                Box::new(move |x, y| {
                    (x - left - 0.5 * wide).abs().max((y - C).abs() - height + 0.5 * wide) - 0.5 * wide
                })
            };
            let stands = 26.0 + way;
            for upside_down in [false, true] {
                let mut shapes = [union(bar(20.0, 6.0), bar(stands, 7.0)), bar(stands, 7.0)];
                if upside_down {
                    shapes.reverse();
                }
                let all: Vec<f64> = (0..=4).map(f64::from).collect();
                let stack = masks(N, &[0.0, 4.0], &shapes);
                let body = reconstruct_with(&stack, &all, &Settings::default(), backend, &Silent).expect("it is valid");
                let parts = |layer: &SparseImage<f32>| {
                    let inside: Vec<bool> = layer.iter().map(|v| *v < 0.0).collect();
                    label4(&inside, [N; 2]).count
                };
                let found: Vec<usize> =
                    body.layers.iter().filter(|layer| layer.output).map(|layer| parts(&layer.phi)).collect();
                let count = |z: usize| found[if upside_down { 4 - z } else { z }];
                assert!(count(0) == 2 && count(1) == 2 && count(4) == 1, "{height}, {way}: {found:?}");
                assert!([2, 3].iter().all(|z| count(*z) <= 2), "{height}, {way}: {found:?}");
                let all: Vec<Vec<f32>> = body.layers.iter().map(|layer| layer.phi.iter().copied().collect()).collect();
                let all: Vec<&[f32]> = all.iter().map(Vec::as_slice).collect();
                let node = |x: f64| (if upside_down { 4 } else { 0 }, C as usize * N + x as usize);
                assert!(
                    !connected(&all, [N, N], node(23.0), node(stands + 3.0)),
                    "{height}, {way}, {}",
                    backend.name()
                );
            }
        }
    });
}
