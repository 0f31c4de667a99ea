//! Heights on cells that reach the border: of planes, whose lines meet it at any angle, and of hills and hollows, whose lines meet beyond it.

use std::f64::consts::TAU;

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use serde_json::Value;
use tiff::tags::Tag;

use super::border::across;
use super::height_maps::{geotiff, photograph};
use super::maps::*;
use crate::files::{folder, interslice, stderr};

/// The map of `across`.
const SIZE: [f64; 2] = [1000.0, 800.0];
/// Pixels from the border within which heights are looked at.
const NEAR: f64 = 8.0;

/// A terrain, its lines, and the pixels and cells that it is asked for on.
struct Drawn<'a> {
    height: &'a dyn Fn([f64; 2]) -> f64,
    lines: Vec<Value>,
    /// Outermost levels.
    levels: [f64; 2],
    interval: f64,
    /// Sides of the pixels.
    pixel: f64,
    /// Cells of the raster from west to east and south to north edge.
    cells: [u32; 2],
}

impl Drawn<'_> {
    /// Heights of the cells, from the north, with these options.
    fn reconstructed(&self, options: &[&str]) -> Vec<f32> {
        let place = folder();
        let [input, raster, output] = ["in.geojson", "cells.tif", "out.dem.tif"].map(|name| place.path().join(name));
        write(&input, &self.lines);
        let [dx, dy] = [0, 1].map(|axis| SIZE[axis] / f64::from(self.cells[axis] - 1));
        let tie = [0.0, 0.0, 0.0, EAST - dx / 2.0, NORTH + SIZE[1] + dy / 2.0, 0.0];
        photograph(&raster, self.cells, &[(Tag::ModelPixelScaleTag, &[dx, dy, 0.0]), (Tag::ModelTiepointTag, &tie)]);
        let [from, like, to] = [&input, &raster, &output].map(|p| p.to_str().expect("temporary paths are UTF-8"));
        let border = format!("{EAST},{NORTH},{},{}", EAST + SIZE[0], NORTH + SIZE[1]);
        let side = self.pixel.to_string();
        let run = ["reconstruct", from, "-o", to, "--like", like, "--border", &border, "--pixel", &side, "-q"];
        let result = interslice(&[&run[..], &["--backend", "cpu"], options].concat());
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        geotiff(&output).heights
    }

    /// Place of a cell on the map: outermost centres lie on the border.
    fn place(&self, n: usize) -> [f64; 2] {
        let cells = self.cells.map(|n| n as usize);
        let at = [n % cells[0], cells[1] - 1 - n / cells[0]];
        [0, 1].map(|a| SIZE[a] * at[a] as f64 / (cells[a] - 1) as f64)
    }

    /// By what heights are off, as shares of the interval, at cells near the border and between the outermost levels.
    fn off(&self, heights: &[f32]) -> Vec<f64> {
        let mut off = Vec::new();
        for (n, found) in heights.iter().enumerate() {
            let x = self.place(n);
            let inward = x[0].min(SIZE[0] - x[0]).min(x[1]).min(SIZE[1] - x[1]);
            let height = (self.height)(x);
            let slack = 0.01 * self.interval;
            if inward < NEAR * self.pixel && self.levels[0] + slack < height && height < self.levels[1] - slack {
                off.push((f64::from(*found) - height) / self.interval);
            }
        }
        off
    }

    /// The same with the heights of the cells beside, farther in, on the columns and rows at the border.
    fn off_beside(&self, heights: &[f32]) -> Vec<f64> {
        let [nx, ny] = self.cells.map(|n| n as usize);
        let inner = |n: usize| (n / nx).clamp(1, ny - 2) * nx + (n % nx).clamp(1, nx - 2);
        let beside: Vec<f32> = (0..nx * ny).map(|n| heights[inner(n)]).collect();
        self.off(&beside).into_iter().filter(|v| v.is_finite()).collect()
    }
}

fn root_mean_square(off: &[f64]) -> f64 {
    (off.iter().map(|v| v * v).sum::<f64>() / off.len() as f64).sqrt()
}

/// What is found on several maps, and bounds of it: of each, and of all together.
struct Judge {
    bounds: [f64; 2],
    found: Vec<f64>,
    /// Maps whose cells beside, farther in, are beyond the bound.
    fallen: usize,
}

impl Judge {
    fn new(each: f64, all: f64) -> Self {
        Judge { bounds: [each, all], found: Vec::new(), fallen: 0 }
    }

    fn see(&mut self, drawn: &Drawn<'_>, of: &str) {
        let heights = drawn.reconstructed(&[]);
        let own = drawn.off(&heights);
        assert!(own.len() > 500 && own.iter().all(|v| v.is_finite()), "{of}: cells without height");
        let found = root_mean_square(&own);
        assert!(found < self.bounds[0], "{of}: {found}");
        self.found.push(found);
        self.fallen += usize::from(root_mean_square(&drawn.off_beside(&heights)) > self.bounds[0]);
    }

    fn all(&self) {
        assert!(self.fallen >= 4, "{}", self.fallen);
        let all = root_mean_square(&self.found);
        assert!(all < self.bounds[1], "{all}");
    }
}

/// All cells up to the border have heights, and these are as right as elsewhere; those of the cells beside, farther in, are not.
#[test]
fn heights_of_planes_are_right_up_to_the_border() {
    // Share of the interval by which heights of a map may be off, in the mean of squares, and of all maps: with lines at right angles to the
    // border it was 0.019, on eight maps drawn like these.
    let mut judge = Judge::new(0.02, 0.01);
    let drawn = (0.0..TAU, 60.0..95.0f64, 7.0..12.0f64, [60..140u32, 60..140u32]);
    let mut runner = TestRunner::deterministic();
    for _ in 0..16 {
        let (angle, interval, pixel, cells) = drawn.new_tree(&mut runner).expect("a draw").current();
        let (a, b) = (angle.cos(), angle.sin());
        let level = |k: i32| SIZE[0] / 2.0 * a + SIZE[1] / 2.0 * b + interval * f64::from(k);
        let lines = (-4..=4).map(level).map(|z| feature(z, &across(a, b, z))).collect();
        let height = |x: [f64; 2]| x[0] * a + x[1] * b;
        let drawn = Drawn { height: &height, lines, levels: [-4, 4].map(level), interval, pixel, cells };
        judge.see(&drawn, &format!("uphill {angle}, interval {interval}, pixel {pixel}, {cells:?} cells"));
    }
    judge.all();
}

/// Paraboloids with their tops within the map: circles, some of which the border cuts.
#[test]
fn heights_of_hills_and_hollows_are_right_up_to_the_border() {
    // As above; with lines that do not meet beyond the border it was 0.049 on all of these maps, 0.062 on the worst.
    let mut judge = Judge::new(0.05, 0.03);
    let drawn = ([300.0..700.0f64, 250.0..550.0f64], 9..16i32, any::<bool>(), 7.0..12.0f64, [60..140u32, 60..140u32]);
    let mut runner = TestRunner::deterministic();
    for _ in 0..16 {
        let (middle, count, is_hill, pixel, cells) = drawn.new_tree(&mut runner).expect("a draw").current();
        // To the farthest corner.
        let far = [0, 1].map(|a| middle[a].max(SIZE[a] - middle[a]));
        let steep = f64::from(count) / (far[0] * far[0] + far[1] * far[1]);
        let way = if is_hill { -1.0 } else { 1.0 };
        let level = |k: i32| way * (f64::from(k) + 0.3);
        let circle = |k: i32| {
            let radius = ((f64::from(k) + 0.3) / steep).sqrt();
            let point = |n: u32| {
                let (sin, cos) = (TAU * f64::from(n % 720) / 720.0).sin_cos();
                [EAST + middle[0] + radius * cos, NORTH + middle[1] + radius * sin]
            };
            feature(level(k), &(0..=720).map(point).collect::<Vec<_>>())
        };
        let height = |x: [f64; 2]| way * steep * ((x[0] - middle[0]).powi(2) + (x[1] - middle[1]).powi(2));
        let levels = if is_hill { [level(count - 1), level(0)] } else { [level(0), level(count - 1)] };
        let lines = (0..count).map(circle).collect();
        let drawn = Drawn { height: &height, lines, levels, interval: 1.0, pixel, cells };
        judge
            .see(&drawn, &format!("about {middle:?}, {count} levels, hill: {is_hill}, pixel {pixel}, {cells:?} cells"));
    }
    judge.all();
}

/// A plane that rises out of its map goes on rising beyond its highest line: what closes the region out there is no contour.
#[test]
fn planes_that_rise_out_of_their_map_have_no_crest_within_it() {
    let drawn = (0.0..TAU, 90.0..140.0f64, 0.2..0.8f64, 4.0..7.0f64, [60..140u32, 60..140u32]);
    let mut runner = TestRunner::deterministic();
    let mut all = Vec::new();
    for _ in 0..12 {
        let (angle, interval, shift, pixel, cells) = drawn.new_tree(&mut runner).expect("a draw").current();
        let (a, b) = (angle.cos(), angle.sin());
        let level = |k: i32| SIZE[0] / 2.0 * a + SIZE[1] / 2.0 * b + interval * (f64::from(k) + shift);
        // Of a line that is cut at a corner nothing is seen in pixels.
        let length = |line: &[[f64; 2]]| match line {
            [p, q] => (p[0] - q[0]).hypot(p[1] - q[1]),
            _ => 0.0,
        };
        let lines = (-12..=12).map(level).map(|z| (z, across(a, b, z))).filter(|(_, line)| length(line) > 4.0 * pixel);
        let lines: Vec<(f64, Line)> = lines.collect();
        let top = lines[lines.len() - 1].0;
        let levels = [lines[0].0, top];
        let lines = lines.into_iter().map(|(z, line)| feature(z, &line)).collect();
        let height = |x: [f64; 2]| x[0] * a + x[1] * b;
        let drawn = Drawn { height: &height, lines, levels, interval, pixel, cells };
        let heights = drawn.reconstructed(&["--end-top", "extrapolate"]);
        let above: Vec<usize> = (0..heights.len()).filter(|n| height(drawn.place(*n)) > top).collect();
        let off: Vec<f64> =
            above.iter().map(|n| (f64::from(heights[*n]) - height(drawn.place(*n))) / interval).collect();
        let of = format!("uphill {angle}, interval {interval}, pixel {pixel}, {cells:?} cells");
        // The cell beside that lies most downhill; rows run from the north.
        let (dx, dy) = (SIZE[0] / f64::from(cells[0] - 1), SIZE[1] / f64::from(cells[1] - 1));
        let downhill = |n: usize| match (a * dx).abs() > (b * dy).abs() {
            true => n as isize - a.signum() as isize,
            false => n as isize + b.signum() as isize * cells[0] as isize,
        };
        let falls = |n: &&usize| f64::from(heights[**n]) < f64::from(heights[downhill(**n) as usize]) - 0.01 * interval;
        assert_eq!(above.iter().filter(falls).count(), 0, "{of}: cells of {} that lie lower than before", above.len());
        all.push(root_mean_square(&off));
    }
    // Shares of the interval. With a cap that is drawn in from the outer rectangle, too, 0.19.
    assert!(root_mean_square(&all) < 0.08, "{all:?}");
}

/// The four corners of a bowl, each above its highest line, are as high: what lies beyond the border alone decides nothing.
#[test]
fn corners_of_a_symmetric_map_are_as_high() {
    let middle = [SIZE[0] / 2.0, SIZE[1] / 2.0];
    let corner = middle[0] * middle[0] + middle[1] * middle[1];
    for (count, pixel) in [(9, 8.0), (9, 10.0), (10, 8.0), (10, 10.0), (13, 8.0), (13, 10.0)] {
        let steep = f64::from(count) / corner;
        let circle = |k: i32| {
            let radius = ((f64::from(k) + 0.2) / steep).sqrt();
            let point = |n: u32| {
                let (sin, cos) = (TAU * f64::from(n % 720) / 720.0).sin_cos();
                [EAST + middle[0] + radius * cos, NORTH + middle[1] + radius * sin]
            };
            feature(f64::from(k) + 0.2, &(0..=720).map(point).collect::<Vec<_>>())
        };
        let height = |x: [f64; 2]| steep * ((x[0] - middle[0]).powi(2) + (x[1] - middle[1]).powi(2));
        let levels = [0.2, f64::from(count - 1) + 0.2];
        let lines = (0..count).map(circle).collect();
        let drawn = Drawn { height: &height, lines, levels, interval: 1.0, pixel, cells: [101, 81] };
        let heights = drawn.reconstructed(&["--end-top", "extrapolate"]);
        let corners = [0, 100, 80 * 101, 80 * 101 + 100].map(|n: usize| f64::from(heights[n]));
        let (low, high) = corners.iter().fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(*v), high.max(*v)));
        assert!(high - low < 0.1, "{count} levels, pixel {pixel}: {corners:?}");
    }
}

/// Where a map is higher along its whole border, nothing but what closes the region there could be drawn in: it is as high there as by a given peak.
#[test]
fn a_hollow_in_a_map_that_is_higher_all_around_reaches_its_peak_at_the_border() {
    let middle = [SIZE[0] / 2.0, SIZE[1] / 2.0];
    let steep = 20.0 / (350.0 * 350.0);
    let circle = |k: i32| {
        let radius = (5.0 * f64::from(k) / steep).sqrt();
        let point = |n: u32| {
            let (sin, cos) = (TAU * f64::from(n % 720) / 720.0).sin_cos();
            [EAST + middle[0] + radius * cos, NORTH + middle[1] + radius * sin]
        };
        feature(5.0 * f64::from(k), &(0..=720).map(point).collect::<Vec<_>>())
    };
    let height = |x: [f64; 2]| steep * ((x[0] - middle[0]).powi(2) + (x[1] - middle[1]).powi(2));
    let lines = (1..=4).map(circle).collect();
    let drawn = Drawn { height: &height, lines, levels: [5.0, 20.0], interval: 5.0, pixel: 8.0, cells: [101, 81] };
    let heights = drawn.reconstructed(&["--end-top", "peak=30"]);
    // In the middle of the lower side the truth is 26.1; where what lies within the map alone counts for a region that is closed beyond, 21.
    let (border, inside) = (heights[80 * 101 + 50], heights[75 * 101 + 50]);
    assert!(border > 24.0 && border > inside, "{border} at the border, {inside} within");
}
