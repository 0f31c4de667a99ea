//! Heights of planes, whose lines meet the border at any angle, on cells that reach it.

use std::f64::consts::TAU;

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use serde_json::Value;
use tiff::tags::Tag;

use crate::border::across;
use crate::files::{folder, interslice, stderr};
use crate::height_maps::{geotiff, photograph};
use crate::maps::*;

/// The map of `across`.
const SIZE: [f64; 2] = [1000.0, 800.0];
/// Pixels from the border within which heights are looked at.
const NEAR: f64 = 8.0;
/// Share of the interval by which heights may be off near the border, in the mean of squares.
const BOUND: f64 = 0.02;
/// The same over all maps. With lines at right angles to the border it was 0.019, on eight maps drawn like these.
const BOUND_OF_ALL: f64 = 0.01;

#[derive(Debug, Clone)]
struct Drawn {
    /// The way uphill.
    angle: f64,
    interval: f64,
    /// Sides of the pixels.
    pixel: f64,
    /// Cells of the raster from west to east and south to north edge.
    cells: [u32; 2],
}

/// By what heights are off, as shares of the interval, at cells near the border and between the outermost levels.
fn off(drawn: &Drawn, heights: &[f32]) -> Vec<f64> {
    let Drawn { angle, interval, pixel, cells } = *drawn;
    let middle = SIZE[0] / 2.0 * angle.cos() + SIZE[1] / 2.0 * angle.sin();
    let near = NEAR * pixel;
    let mut off = Vec::new();
    for (n, found) in heights.iter().enumerate() {
        // From the north; outermost centres lie on the border.
        let [i, j] = [n % cells[0] as usize, cells[1] as usize - 1 - n / cells[0] as usize];
        let x = [SIZE[0] * i as f64 / f64::from(cells[0] - 1), SIZE[1] * j as f64 / f64::from(cells[1] - 1)];
        let height = x[0] * angle.cos() + x[1] * angle.sin();
        let inward = x[0].min(SIZE[0] - x[0]).min(x[1]).min(SIZE[1] - x[1]);
        if inward < near && (height - middle).abs() < 3.99 * interval {
            off.push((f64::from(*found) - height) / interval);
        }
    }
    off
}

fn root_mean_square(off: &[f64]) -> f64 {
    (off.iter().map(|v| v * v).sum::<f64>() / off.len() as f64).sqrt()
}

/// All cells up to the border have heights, and these are as right as elsewhere; those of the cells beside, farther in, are not.
#[test]
fn heights_are_right_up_to_the_border() {
    let drawn = (0.0..TAU, 60.0..95.0f64, 7.0..12.0f64, [60..140u32, 60..140u32]);
    let mut runner = TestRunner::deterministic();
    let place = folder();
    let [input, raster, output] = ["in.geojson", "cells.tif", "out.dem.tif"].map(|name| place.path().join(name));
    let (mut fallen, mut all) = (0, Vec::new());
    for _ in 0..16 {
        let (angle, interval, pixel, cells) = drawn.new_tree(&mut runner).expect("a draw").current();
        let drawn = Drawn { angle, interval, pixel, cells };
        let (a, b) = (angle.cos(), angle.sin());
        let levels = (-4..=4).map(|k| SIZE[0] / 2.0 * a + SIZE[1] / 2.0 * b + interval * f64::from(k));
        let lines: Vec<Value> = levels.map(|z| feature(z, &across(a, b, z))).collect();
        write(&input, &lines);
        let [dx, dy] = [0, 1].map(|axis| SIZE[axis] / f64::from(cells[axis] - 1));
        let tie = [0.0, 0.0, 0.0, EAST - dx / 2.0, NORTH + SIZE[1] + dy / 2.0, 0.0];
        photograph(&raster, cells, &[(Tag::ModelPixelScaleTag, &[dx, dy, 0.0]), (Tag::ModelTiepointTag, &tie)]);
        let [from, like, to] = [&input, &raster, &output].map(|p| p.to_str().expect("temporary paths are UTF-8"));
        let border = format!("{EAST},{NORTH},{},{}", EAST + SIZE[0], NORTH + SIZE[1]);
        let side = pixel.to_string();
        let run = ["reconstruct", from, "-o", to, "--like", like, "--border", &border, "--pixel", &side, "-q"];
        let result = interslice(&[&run[..], &["--backend", "cpu"]].concat());
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));

        let heights = geotiff(&output).heights;
        let own = off(&drawn, &heights);
        assert!(own.len() > 500 && own.iter().all(|v| v.is_finite()), "{drawn:?}: cells without height");
        let found = root_mean_square(&own);
        assert!(found < BOUND, "{drawn:?}: {found}");
        all.push(found);
        // Columns and rows at the border with the heights of those beside.
        let [nx, ny] = cells.map(|n| n as usize);
        let inner = |n: usize| (n / nx).clamp(1, ny - 2) * nx + (n % nx).clamp(1, nx - 2);
        let twin: Vec<f32> = (0..nx * ny).map(|n| heights[inner(n)]).collect();
        let twin: Vec<f64> = off(&drawn, &twin).into_iter().filter(|v| v.is_finite()).collect();
        let twin = root_mean_square(&twin);
        fallen += usize::from(twin > BOUND);
    }
    assert!(fallen >= 4, "{fallen}");
    let all = root_mean_square(&all);
    assert!(all < BOUND_OF_ALL, "{all}");
}
