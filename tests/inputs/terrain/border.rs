//! Where a map ends: lines that end at its border, go beyond it or meet nothing.

use std::f64::consts::TAU;
use std::fs;

use interslice::stack::ReadOptions;
use interslice::stack::options::{Around, MapBorder};
use interslice::terrain::Terrain;
use serde_json::Value;

use super::maps::*;
use crate::files::folder;

/// Where the plane `a x + b y = z` crosses the box of 1000 x 800.
pub fn across(a: f64, b: f64, z: f64) -> Line {
    let mut ends = Vec::new();
    for x in [0.0, 1000.0] {
        let y = (z - a * x) / b;
        if b != 0.0 && (0.0..=800.0).contains(&y) {
            ends.push([EAST + x, NORTH + y]);
        }
    }
    for y in [0.0, 800.0] {
        let x = (z - b * y) / a;
        if a != 0.0 && (0.0..=1000.0).contains(&x) {
            ends.push([EAST + x, NORTH + y]);
        }
    }
    ends.dedup();
    ends.truncate(2);
    ends
}

#[test]
fn lines_that_end_at_the_border_are_closed_round_any_corner() {
    for turn in 0..16 {
        let angle = TAU * (f64::from(turn) + 0.25) / 16.0;
        let (a, b) = (angle.cos(), angle.sin());
        let middle = 500.0 * a + 400.0 * b;
        let levels: Vec<f64> = (-4..=4).map(|k| middle + 90.0 * f64::from(k)).collect();
        let lines: Vec<Value> = levels.iter().map(|z| feature(*z, &across(a, b, *z))).collect();
        let border = Some(MapBorder::Given(vec![EAST, NORTH, EAST + 1000.0, NORTH + 800.0]));
        let terrain = read(&lines, &ReadOptions { border, ..pixels(10.0) });
        assert_eq!(terrain.map.dims, [101, 81]);
        for (k, z) in levels.iter().enumerate() {
            for n in 0..101 * 81 {
                let x = [(n % 101) as f64 * 10.0, (n / 101) as f64 * 10.0];
                let height = a * x[0] + b * x[1];
                if (height - z).abs() > 1e-3 {
                    assert_eq!(inside(&terrain, k, x), height > *z, "turn {turn}, level {z} at {x:?}");
                }
            }
        }
    }
}

/// The part of the box of 1000 x 800 where the plane `a x + b y` is at least z.
fn above(a: f64, b: f64, z: f64) -> Line {
    let corners = [[0.0, 0.0], [1000.0, 0.0], [1000.0, 800.0], [0.0, 800.0]];
    let depth = |p: [f64; 2]| a * p[0] + b * p[1] - z;
    let mut ring = Vec::new();
    for (k, p) in corners.into_iter().enumerate() {
        let q = corners[(k + 1) % 4];
        ring.extend((depth(p) >= 0.0).then_some(p));
        if (depth(p) >= 0.0) != (depth(q) >= 0.0) {
            let t = depth(p) / (depth(p) - depth(q));
            ring.push([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
        }
    }
    ring.push(ring[0]);
    ring.into_iter().map(|[x, y]| [EAST + x, NORTH + y]).collect()
}

#[test]
fn polygons_that_the_maps_frame_has_cut_are_the_lines_within_it() {
    for (a, b) in [(0.6, 0.8), (-0.6, 0.8), (0.6, -0.8), (-0.6, -0.8)] {
        let middle = 500.0 * a + 400.0 * b;
        // The outer two cross three sides of the box, so that it is the box of lines and polygons alike.
        let levels = [-150.0, -75.0, 0.0, 75.0, 150.0].map(|off| middle + off);
        let lines: Vec<Value> = levels.iter().map(|z| feature(*z, &across(a, b, *z))).collect();
        let polygons: Vec<Value> = levels.iter().map(|z| feature(*z, &above(a, b, *z))).collect();
        let [wanted, found] = [lines, polygons].map(|features| read(&features, &pixels(10.0)));
        let levels = |terrain: &Terrain| {
            let slices = terrain.stack.slices.iter();
            slices.map(|slice| (slice.z, slice.content.sides())).collect::<Vec<_>>()
        };
        assert_eq!((&found.map, found.stack.dims), (&wanted.map, wanted.stack.dims), "{a}, {b}");
        assert!(levels(&found) == levels(&wanted), "{a}, {b}");
        let says = "polygons of 5 elevations run along the box around all: they are taken to be cut there";
        assert!(found.notes.iter().any(|note| note.contains(says)), "{:?}", found.notes);
    }
    // Terraces lie inside each other, and none of their walls is a frame.
    let square = |z: f64, half: f64| {
        let corners = [[-half, -half], [half, -half], [half, half], [-half, half], [-half, -half]];
        feature(z, &corners.map(|[x, y]| [EAST + x, NORTH + y]).to_vec())
    };
    let terraces = read(&[square(1.0, 100.0), square(2.0, 60.0), square(3.0, 20.0)], &pixels(10.0));
    assert_eq!(terraces.stack.slices.len(), 3);
    assert!(!terraces.notes.iter().any(|note| note.contains("run along")), "{:?}", terraces.notes);
}

/// A map cut along meridians and parallels has slanted edges in any system of lengths.
#[test]
fn lines_that_a_slanted_edge_has_cut_go_on_to_the_box() {
    let place = folder();
    let path = place.path().join("in.geojson");
    let north_south =
        |k: usize| -> Line { (0..=40).map(|j| [-84.4 + 0.02 * k as f64, 36.2 + 0.005 * f64::from(j)]).collect() };
    let ramp: Vec<Value> = (1..20).map(|k| feature(10 * k as i64, &north_south(k))).collect();
    fs::write(&path, collection(None, &ramp)).expect("a file can be written");
    let terrain = Terrain::read(&path, &pixels(100.0)).expect("a map with slanted edges");
    let told = |note: &String| note.contains(" ends of lines are inside the box around all lines, up to ");
    assert!(terrain.notes.iter().any(told), "{:?}", terrain.notes);
    assert_eq!(terrain.stack.slices.len(), 19);
    // A ramp: every level's region is an end of the map, smaller than that of the level below.
    let areas: Vec<usize> =
        terrain.stack.slices.iter().map(|s| (0..s.content.len()).filter(|n| s.content.inside(*n)).count()).collect();
    assert!(areas.windows(2).all(|w| w[1] < w[0]) && areas[18] > 0, "{areas:?}");
}

#[test]
fn lines_beyond_the_border_are_cut() {
    let given = |x: [f64; 4]| ReadOptions {
        border: Some(MapBorder::Given(vec![EAST + x[0], NORTH + x[1], EAST + x[2], NORTH + x[3]])),
        ..pixels(20.0)
    };
    let (whole, part) = (read(&cone(), &pixels(20.0)), read(&cone(), &given([-100.0, -300.0, 900.0, 300.0])));
    assert!(part.notes.iter().any(|n| n.ends_with("lines go beyond the border and are cut there")), "{:?}", part.notes);
    let levels = whole.stack.slices.iter().filter(|s| part.stack.slices.iter().any(|p| p.z == s.z));
    for (k, slice) in levels.enumerate() {
        assert_eq!(part.stack.slices[k].z, slice.z);
        for point in [[0.0, 0.0], [150.0, 100.0], [350.0, 0.0], [500.0, -200.0]] {
            assert_eq!(inside(&part, k, point), inside(&whole, k, point), "level {} at {point:?}", slice.z);
        }
    }
    let far = format!("{},{},{},{}", EAST + 9000.0, NORTH, EAST + 9100.0, NORTH + 100.0);
    assert_says(&refused(&cone(), &["--border", &far]), &["has no lines within the border 509000, 4000000 to 509100"]);
}

fn contents(terrain: &Terrain) -> Vec<Vec<bool>> {
    terrain.stack.slices.iter().map(|s| s.content.sides()).collect()
}

/// A ramp whose northern edge has a notch, deeper than what is near the hull.
fn notched() -> Vec<Value> {
    let end = |k: usize| if (8..12).contains(&k) { 600.0 } else { 1000.0 };
    let line = |k: usize| -> Line {
        (0..=40).map(|j| [EAST + 100.0 * k as f64, NORTH + end(k) * f64::from(j) / 40.0]).collect()
    };
    (0..20).map(|k| feature(10 * k as i64, &line(k))).collect()
}

#[test]
fn the_three_worst_ends_are_named_and_the_hull_may_be_the_border() {
    let said = refused(&notched(), &[]);
    assert_says(
        &said,
        &["4 ends of lines meet nothing; the 3 farthest inside: feature 9: its line of 80", "--border hull"],
    );
    assert_says(&said, &["feature 10: its", "feature 11: its", "400.0000 from the border"]);
    assert!(!said.contains("feature 12"), "{said}");
    let hull = ReadOptions { border: Some(MapBorder::Around(Around::Hull)), ..pixels(10.0) };
    let terrain = read(&notched(), &hull);
    assert!(terrain.notes.iter().any(|n| n.contains("up to 400.000 inside their hull")), "{:?}", terrain.notes);
    // The first and the last line run along the border.
    assert_eq!(terrain.stack.slices.len(), 18);
    // Where all lines end in the box, it does not matter.
    let whole = ReadOptions { border: Some(MapBorder::Around(Around::Box)), ..pixels(10.0) };
    assert_eq!(contents(&read(&cone(), &whole)), contents(&read(&cone(), &hull)));
    for (wrong, says) in [("hul", "expected box, hull or four numbers"), ("1,2,3", "must be X0,Y0,X1,Y1 with X0 < X1")]
    {
        assert_says(&refused(&cone(), &["--border", wrong]), &[says]);
    }
}

/// What a line says of the border is not used, which is told; the frame that polygons have there says nothing.
#[test]
fn lines_along_a_part_of_the_border_are_told() {
    let told = |end: &[[f64; 2]]| {
        let line = |x: f64| vec![[EAST + x, NORTH], [EAST + x, NORTH + 800.0]];
        let mut middle = line(500.0);
        middle.extend(end.iter().map(|p| [EAST + p[0], NORTH + p[1]]));
        let lines = [(200, line(200.0)), (500, middle), (800, line(800.0))];
        let features: Vec<Value> = lines.iter().map(|(z, line)| feature(*z, line)).collect();
        let border = MapBorder::Given(vec![EAST, NORTH, EAST + 1000.0, NORTH + 800.0]);
        let terrain = read(&features, &ReadOptions { border: Some(border), ..pixels(10.0) });
        let along = |note: &&String| note.contains("along the border");
        terrain.notes.iter().filter(along).cloned().collect::<Vec<_>>()
    };
    assert_eq!(told(&[[700.0, 800.0]]), ["level 500: its lines run along the border for 200.000; left out there"]);
    assert!(told(&[]).is_empty() && told(&[[503.0, 800.0]]).is_empty());
}
