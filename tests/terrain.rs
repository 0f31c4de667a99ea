//! Contour maps in, height maps and contour lines out: files that this test writes itself.
#![cfg(feature = "terrain")]

#[path = "support/files.rs"]
mod files;

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use files::*;
use interslice::stack::ReadOptions;
use interslice::stack::options::{Around, MapBorder};
use interslice::surface::map::Crs;
use interslice::terrain::Terrain;
use serde_json::{Value, json};
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

type Line = Vec<[f64; 2]>;

/// Far from degrees, as projected coordinates are.
const EAST: f64 = 500_000.0;
const NORTH: f64 = 4_000_000.0;

fn circle([x, y]: [f64; 2], radius: f64) -> Line {
    let at = |k: usize| TAU * (k % 120) as f64 / 120.0;
    (0..=120).map(|k| [EAST + x + radius * at(k).cos(), NORTH + y + radius * at(k).sin()]).collect()
}

fn feature(z: impl Into<Value>, line: &Line) -> Value {
    json!({"type": "Feature", "properties": {"Elev": z.into(), "id": 7},
           "geometry": {"type": "LineString", "coordinates": line}})
}

fn write(path: &Path, features: &[Value]) {
    let crs = json!({"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32611"}});
    let text = json!({"type": "FeatureCollection", "crs": crs, "features": features}).to_string();
    fs::write(path, text).expect("a file can be written");
}

fn read(features: &[Value], options: &ReadOptions) -> Terrain {
    let place = folder();
    let path = place.path().join("map.geojson");
    write(&path, features);
    Terrain::read(&path, options).expect("the map is sound")
}

fn pixels(pixel: f64) -> ReadOptions {
    ReadOptions { pixel: Some(pixel), ..ReadOptions::default() }
}

/// Whether level `k` is inside at a point.
fn inside(terrain: &Terrain, k: usize, [x, y]: [f64; 2]) -> bool {
    let stack = &terrain.stack;
    let i = ((EAST + x - stack.geometry.origin[0]) / stack.spacing[0]).round() as usize;
    let j = ((NORTH + y - stack.geometry.origin[1]) / stack.spacing[1]).round() as usize;
    stack.slices[k].content.inside(j * stack.dims[0] + i)
}

/// Levels of the cone `z = 300 - r / 2`.
fn cone() -> Vec<Value> {
    [(100.0, 400.0), (150.0, 300.0), (200.0, 200.0), (250.0, 100.0)]
        .map(|(z, r)| feature(z, &circle([0.0, 0.0], r)))
        .to_vec()
}

struct GeoTiff {
    heights: Vec<f32>,
    dims: [usize; 2],
    scale: Vec<f64>,
    tie: Vec<f64>,
    keys: Vec<u16>,
    nodata: String,
}

fn geotiff(path: &Path) -> GeoTiff {
    let file = std::io::BufReader::new(fs::File::open(path).expect("it was written"));
    let mut decoder = Decoder::new(file).expect("a TIFF");
    let (width, height) = decoder.dimensions().expect("dimensions");
    let DecodingResult::F32(heights) = decoder.read_image().expect("pixels") else { panic!("not 32-bit floats") };
    GeoTiff {
        heights,
        dims: [width as usize, height as usize],
        scale: decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).expect("scale"),
        tie: decoder.get_tag_f64_vec(Tag::ModelTiepointTag).expect("tie point"),
        keys: decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).expect("keys"),
        nodata: decoder.get_tag_ascii_string(Tag::GdalNodata).expect("no data"),
    }
}

#[test]
fn a_cone_from_lines_to_a_height_map_and_lines() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    write(&place.path().join("in.geojson"), &cone());
    let outputs = ["-o", &at("out.dem.tif"), "-o", &at("out.geojson"), "--dz", "25", "--pixel", "20"];
    let run = ["reconstruct", &at("in.geojson"), "--end-top", "extrapolate", "--backend", "cpu", "-q"];
    let output = interslice(&[&run[..], &outputs].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));

    let map = geotiff(&place.path().join("out.dem.tif"));
    // 41 pixels within the lowest line, and one around it: all lines are closed.
    assert_eq!(map.dims, [43, 43]);
    assert_eq!(map.scale, [20.0, 20.0, 0.0]);
    assert_eq!(map.tie, [0.0, 0.0, 0.0, EAST - 430.0, NORTH + 430.0, 0.0]);
    assert_eq!(map.keys, [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 32611]);
    assert_eq!(map.nodata, "nan");
    for (n, height) in map.heights.iter().enumerate() {
        let [x, y] = [(n % 43) as f64 * 20.0 - 420.0, 420.0 - (n / 43) as f64 * 20.0];
        let r = x.hypot(y);
        match r {
            // A polygon of 120 sides is up to 0.14 m narrower.
            _ if r > 401.0 => assert!(height.is_nan(), "{height} at {r}"),
            _ if r > 110.0 && r < 399.0 => {
                let wanted = 300.0 - r / 2.0;
                // Of the 50 m between levels 2.5 %: the polygons' narrowness (-0.15 m) and the dip of up to 0.8 m that fairing leaves above
                // the lowest line, 1.13 m together; next to the summit, which closes as a dome, fairing rounds the crease at its foot: 7 %.
                let off = if r > 200.0 { 1.25 } else { 3.5 };
                assert!((f64::from(*height) - wanted).abs() < off, "{height}, not {wanted}, at ({x}, {y})");
            }
            _ if r < 20.0 => assert!((260.0..310.0).contains(height), "summit {height}"),
            _ => {}
        }
    }

    let lines: Value = serde_json::from_slice(&fs::read(at("out.geojson")).expect("it was written")).expect("JSON");
    assert_eq!(lines["crs"]["properties"]["name"], "urn:ogc:def:crs:EPSG::32611");
    let features = lines["features"].as_array().expect("features");
    let at_175 = features.iter().find(|f| f["properties"]["elevation"] == 175.0).expect("a line half way");
    let ring = at_175["geometry"]["coordinates"][0].as_array().expect("a line");
    assert_eq!(ring.first(), ring.last(), "the line is closed");
    for point in ring {
        let r = (point[0].as_f64().expect("x") - EAST).hypot(point[1].as_f64().expect("y") - NORTH);
        assert!((r - 250.0).abs() < 2.0, "radius {r}");
    }
}

#[test]
fn the_lowest_line_of_an_island_is_closed_wherever_pixels_lie() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    for (pixel, [x, y]) in [("12", [0.3, 0.7]), ("17", [5.0, 2.0]), ("20", [9.9, 10.1])] {
        let island = [(0, 300.2), (10, 200.0), (20, 100.0)].map(|(z, r)| feature(z, &circle([x, y], r)));
        write(&place.path().join("in.geojson"), &island);
        let run = ["reconstruct", &at("in.geojson"), "-o", &at("out.geojson"), "--pixel", pixel, "--backend", "cpu"];
        let output = interslice(&run);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let lines: Value = serde_json::from_slice(&fs::read(at("out.geojson")).expect("it was written")).expect("JSON");
        let features = lines["features"].as_array().expect("features");
        let lowest = features.iter().find(|f| f["properties"]["elevation"] == 0.0).expect("the lowest line");
        let pieces: Vec<Line> = serde_json::from_value(lowest["geometry"]["coordinates"].clone()).expect("lines");
        assert_eq!(pieces.len(), 1, "pixel {pixel}");
        assert_eq!(pieces[0].first(), pieces[0].last(), "pixel {pixel}: it is closed");
        let length: f64 = pieces[0].windows(2).map(|w| (w[1][0] - w[0][0]).hypot(w[1][1] - w[0][1])).sum();
        assert!((length / (TAU * 300.2) - 1.0).abs() < 0.01, "pixel {pixel}: {length} m");
    }
}

#[test]
fn a_map_in_parts_is_the_map_of_a_single_run() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    write(&place.path().join("in.geojson"), &cone());
    let input = ["--crs", "EPSG:32611", "--dz", "25", "--pixel", "20", "--end-top", "extrapolate", "-q"];
    let run = |command: &[&str]| {
        let result = interslice(command);
        assert_eq!(result.status.code(), Some(0), "{command:?}: {}", stderr(&result));
    };
    let outputs = |name: &str| ["dem.tif", "geojson", "nrrd", "stl"].map(|e| at(&format!("{name}.{e}")));
    let [whole, joined] = ["whole", "joined"].map(outputs);
    let named = |paths: &[String; 4]| paths.each_ref().map(|p| format!("-o{p}"));
    let named = [named(&whole), named(&joined)];
    let [of_whole, of_joined] = named.each_ref().map(|n| n.each_ref().map(String::as_str));
    run(&[&["reconstruct", &at("in.geojson"), "--backend", "cpu"], &input[..], &of_whole].concat());
    let parts = ["1/2", "2/2"].map(|part| {
        let target = at(&format!("{}.section", &part[..1]));
        run(&[&["run", &at("in.geojson"), "--part", part, "-o", &target, "--backend", "cpu"], &input[..]].concat());
        target
    });
    run(&[&["merge", &parts[1], &parts[0], "-q"], &of_joined[..]].concat());
    for (one, other) in whole.iter().zip(&joined) {
        let bytes = |path: &String| fs::read(path).expect("it was written");
        assert!(bytes(one) == bytes(other), "{other}");
    }
}

#[test]
fn summits_and_pits_are_told_by_the_other_levels() {
    let (west, east) = ([-200.0, 0.0], [200.0, 0.0]);
    let lines = [
        feature(100, &circle([0.0, 0.0], 450.0)),
        feature("150", &circle(west, 150.0)),
        feature(150.0, &circle(east, 150.0)),
        // A pit on the western summit: no line lies in it.
        feature(150, &circle(west, 50.0)),
    ];
    let terrain = read(&lines, &pixels(10.0));
    assert!(inside(&terrain, 0, west) && inside(&terrain, 0, east));
    assert!(inside(&terrain, 1, east) && !inside(&terrain, 1, [0.0, 0.0]));
    assert!(!inside(&terrain, 1, west) && inside(&terrain, 1, [-200.0, 100.0]));
    // The same lines with all heights turned round are a hollow: what lies beyond all lines is the highest.
    let hollow = [feature(-100, &lines_of(&lines[0])), feature(-150, &lines_of(&lines[1]))];
    let terrain = read(&hollow, &pixels(10.0));
    assert_eq!(terrain.stack.slices[1].z, -100.0);
    assert!(!inside(&terrain, 1, west) && inside(&terrain, 1, [448.0, 448.0]));
    assert!(!inside(&terrain, 0, west) && inside(&terrain, 0, east));
}

/// Programs that draw contours leave many lines of no length, where heights are those of a level.
#[test]
fn of_many_lines_of_no_length_some_are_told_one_by_one() {
    let point = |k: usize| feature(100, &vec![[EAST + 10.0 * k as f64, NORTH]; 2]);
    let lines: Vec<Value> =
        cone().into_iter().chain((0..40).map(point)).chain((0..5).map(|_| cone()[0].clone())).collect();
    let notes = read(&lines, &pixels(20.0)).notes;
    let of = |words: &str| notes.iter().filter(|n| n.contains(words)).count();
    assert_eq!(
        (of("is a point or encloses nothing"), of("37 more lines are points or enclose nothing")),
        (3, 1),
        "{notes:?}"
    );
    assert_eq!((of("is there before"), of("2 more lines are there before; left out")), (3, 1), "{notes:?}");
}

/// Lines with points more or less dense along them.
#[test]
fn default_pixels_are_as_fine_as_points_and_the_distance_of_lines_tell() {
    let pixel = |step: f64| {
        let line = |k: usize| -> Line {
            let points = (1000.0 / step).round() as usize;
            (0..=points).map(|j| [EAST + 125.0 * k as f64, NORTH + step * j as f64]).collect()
        };
        // 8 lines and 875 across.
        let lines: Vec<Value> = (0..8).map(|k| feature(10 * k as i64, &line(k))).collect();
        let stack = read(&lines, &ReadOptions { crs: Some("EPSG:32611".into()), ..ReadOptions::default() }).stack;
        stack.spacing[0]
    };
    let apart = 875.0 * 1000.0 / 8000.0;
    for (step, wanted) in [(1.0, apart / 8.0), (20.0, 20.0), (250.0, apart / 4.0)] {
        let found = pixel(step);
        assert!((found - wanted).abs() < 1e-6, "points {step} apart: {found}, not {wanted}");
    }
}

fn lines_of(feature: &Value) -> Line {
    serde_json::from_value(feature["geometry"]["coordinates"].clone()).expect("points")
}

/// Where the plane `a x + b y = z` crosses the box of 1000 x 800.
fn across(a: f64, b: f64, z: f64) -> Line {
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

#[test]
fn pieces_of_a_line_are_joined_whatever_their_direction() {
    let whole = circle([0.0, 0.0], 300.0);
    let mut piece = whole[40..=80].to_vec();
    piece.reverse();
    // Half a pixel is 5: the ends of the second piece lie 3 off.
    let moved = whole[80..=120].iter().map(|p| [p[0] + 3.0, p[1]]).collect();
    let outer = circle([0.0, 0.0], 400.0);
    let point = [EAST + 1.0, NORTH];
    let pieces = [
        feature(100, &outer),
        feature(150, &whole[0..=40].to_vec()),
        feature(150, &moved),
        feature(150, &piece),
        feature(100, &outer.iter().rev().copied().collect()),
        feature(150, &vec![point, [EAST + 2.0, NORTH], point]),
    ];
    let terrain = read(&pieces, &pixels(10.0));
    assert!(
        inside(&terrain, 1, [0.0, 0.0]) && inside(&terrain, 1, [0.0, -290.0]) && !inside(&terrain, 1, [0.0, 320.0])
    );
    assert!(terrain.notes.iter().any(|n| n.contains("feature 5: the same line")), "{:?}", terrain.notes);
    assert!(terrain.notes.iter().any(|n| n.contains("feature 6: a line of 150 is a point")), "{:?}", terrain.notes);
}

#[test]
fn heights_may_be_in_the_points_and_polygons_be_lines() {
    let ring = |r: f64, z: f64| -> Vec<[f64; 3]> { circle([0.0, 0.0], r).iter().map(|p| [p[0], p[1], z]).collect() };
    let polygon = |r: f64, z: f64| {
        json!({"type": "Feature", "properties": {"name": "hill"},
               "geometry": {"type": "MultiPolygon", "coordinates": [[ring(r, z)]]}})
    };
    let terrain = read(&[polygon(300.0, 20.0), polygon(200.0, 30.0)], &pixels(10.0));
    assert_eq!([terrain.stack.slices[0].z, terrain.stack.slices[1].z], [20.0, 30.0]);
    assert!(inside(&terrain, 1, [0.0, 0.0]) && !inside(&terrain, 1, [250.0, 0.0]) && inside(&terrain, 0, [250.0, 0.0]));
    assert_eq!(terrain.map.crs, Crs::Epsg(32611));
}

/// What the program says of a map that it must refuse.
fn refused(features: &[Value], more: &[&str]) -> String {
    let place = folder();
    let path = place.path().join("in.geojson");
    write(&path, features);
    refused_file(&path, more)
}

fn refused_file(path: &Path, more: &[&str]) -> String {
    let out = path.with_extension("dem.tif");
    let (input, name) = (path.display().to_string(), out.display().to_string());
    let run = ["reconstruct", &input, "-o", &name, "--pixel", "20", "--backend", "cpu"];
    let output = interslice(&[&run[..], more].concat());
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(!out.exists());
    stderr(&output)
}

#[test]
fn a_map_has_a_height_map_and_no_volume_as_tiff() {
    let place = folder();
    let (path, out) = (place.path().join("in.geojson"), place.path().join("out.tif"));
    write(&path, &cone());
    let (input, name) = (path.display().to_string(), out.display().to_string());
    let output = interslice(&["reconstruct", &input, "-o", &name, "--pixel", "20", "--backend", "cpu"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert_says(&stderr(&output), &["out.tif", "its height map is NAME.dem.tif"]);
    assert!(!out.exists());
}

#[track_caller]
fn assert_says(said: &str, words: &[&str]) {
    words.iter().for_each(|w| assert!(said.contains(w), "`{w}` is not in: {said}"));
}

fn with_fields(line: &Line, fields: Value) -> Value {
    json!({"type": "Feature", "properties": fields, "geometry": {"type": "LineString", "coordinates": line}})
}

#[test]
fn elevations_that_cannot_be_found_are_named() {
    let [outer, inner] = [400.0, 300.0].map(|r| circle([0.0, 0.0], r));
    let nameless = [with_fields(&outer, json!({"colour": 1})), with_fields(&inner, json!({"colour": 2}))];
    assert_says(&refused(&nameless, &[]), &["in.geojson", "no attribute", "--elevation", "`colour`"]);
    let two = |z: f64| json!({"ELEV_MIN": z, "ELEV_MAX": z + 50.0});
    let ambiguous = [with_fields(&outer, two(100.0)), with_fields(&inner, two(150.0))];
    assert_says(&refused(&ambiguous, &[]), &["several attributes", "`ELEV_MAX`, `ELEV_MIN`"]);
    assert_says(&refused(&ambiguous, &["--elevation", "H"]), &["got `H`", "`ELEV_MAX`"]);
    let terrain = read(&ambiguous, &ReadOptions { elevation: Some("elev_min".into()), ..pixels(20.0) });
    assert_eq!(terrain.stack.slices[0].z, 100.0);
    assert_says(&refused(&[feature(100, &outer), feature(Value::Null, &inner)], &[]), &["feature 2", "`Elev` is null"]);
    assert_says(&refused(&[feature(100, &outer), feature("NaN", &inner)], &[]), &["feature 2", "NaN", "finite"]);
    assert_says(
        &refused(&[feature(100, &outer)], &[]),
        &["all of its lines lie at 100; contour lines of at least two"],
    );
    let band = |ring: &Line, z: f64| json!({"type": "Feature", "properties": two(z), "geometry": {"type": "Polygon", "coordinates": [ring]}});
    assert_says(
        &refused(&[band(&outer, 100.0), band(&inner, 150.0)], &[]),
        &["in.geojson", "its polygons lie between two elevations (`ELEV_MAX`, `ELEV_MIN`); contour lines are needed"],
    );
}

#[test]
fn lines_that_dangle_or_cross_are_named() {
    let dangling = [feature(100, &circle([0.0, 0.0], 400.0)), feature(150, &circle([0.0, 0.0], 200.0)[..90].to_vec())];
    let said = refused(&dangling, &[]);
    assert_says(&said, &["feature 2", "line of 150", "ends inside the map at (500200, 4000000)", "away", "within 10"]);
    assert_says(
        &said,
        &["2 ends of lines meet nothing. feature 2", "What to try", "--border hull", "--pixel 580.2995"],
    );
    let crossing = [feature(100, &circle([0.0, 0.0], 400.0)), feature(150, &circle([300.0, 0.0], 200.0))];
    assert_says(&refused(&crossing, &[]), &["feature", "150", "100", "cross", "more than 20"]);
    // A summit outside the level below: a line around it is missing.
    let mut missing = cone();
    missing.push(feature(200, &circle([800.0, 0.0], 100.0)));
    assert_says(&refused(&missing, &[]), &["feature 5", "line of 200", "missing"]);
}

/// A gap of a line up to two pixels long is closed straight, and told; none where another end might be meant.
#[test]
fn short_gaps_of_lines_are_closed_where_nothing_else_is_near() {
    let (outer, ring) = (circle([0.0, 0.0], 400.0), circle([0.0, 0.0], 200.0));
    let (whole, gap) = (ring.clone(), ring[1..ring.len() - 2].to_vec());
    let [first, last] = [gap[0], gap[gap.len() - 1]];
    let long = (first[0] - last[0]).hypot(first[1] - last[1]);
    assert!(long > 30.0 && long < 40.0, "{long}");
    let map = |line: &Line| read(&[feature(100, &outer), feature(150, line)], &pixels(20.0));
    let (closed, given) = (map(&gap), map(&whole));
    let told = format!("1 gap of a line is closed straight, no other end being near: up to {long:.3} long");
    assert!(closed.notes.iter().any(|n| n.contains(&told)), "{:?}", closed.notes);
    assert!(given.notes.iter().all(|n| !n.contains("closed straight")), "{:?}", given.notes);
    for at in [[190.0, 0.0], [170.0, 8.0], [-190.0, 0.0], [230.0, 0.0], [0.0, 0.0]] {
        assert_eq!(inside(&closed, 1, at), inside(&given, 1, at), "{at:?}");
    }
    // One point more is missing.
    let wide = refused(&[feature(100, &outer), feature(150, &ring[1..ring.len() - 3].to_vec())], &[]);
    assert_says(
        &wide,
        &["ends inside the map", "within 10.0000 (half a pixel), and within 40.0000 where no third one is near"],
    );
    // A piece of a line begins near the gap: which ends belong together?
    let piece: Line = [[240.0, 0.0], [260.0, 0.0]].map(|[x, y]| [EAST + x, NORTH + y]).to_vec();
    let said = refused(&[feature(100, &outer), feature(150, &gap), feature(150, &piece)], &[]);
    assert_says(&said, &["4 ends of lines meet nothing"]);
}

#[test]
fn degrees_and_wrong_files_are_refused() {
    let place = folder();
    let path = place.path().join("in.geojson");
    let degrees = |r: f64| -> Line { circle([0.0, 0.0], r).iter().map(|p| [p[0] - EAST, p[1] - NORTH]).collect() };
    let features = [feature(100, &degrees(0.4)), feature(150, &degrees(0.3))];
    let text = |crs: Value| json!({"type": "FeatureCollection", "features": features, "crs": crs}).to_string();
    let named = |name: &str| json!({"type": "name", "properties": {"name": name}});
    for (crs, words) in [(named("mine"), "`crs` is `mine`"), (Value::Null, "properties.name")] {
        fs::write(&path, text(crs)).expect("a file can be written");
        assert_says(&refused_file(&path, &[]), &["in.geojson", words]);
    }
    let bare = json!({"type": "FeatureCollection", "features": features}).to_string();
    fs::write(&path, &bare).expect("a file can be written");
    let local = ReadOptions { crs: Some("local".into()), ..pixels(0.02) };
    assert_eq!(Terrain::read(&path, &local).expect("lengths of one's own").map.crs, Crs::Local);
    assert_says(&refused_file(&path, &["--crs", "metres"]), &["`crs` must be EPSG:N"]);
    assert_says(&refused_file(&path, &["--label", "3"]), &["`label` is not for a contour map"]);

    fs::write(&path, &bare[..bare.len() / 2]).expect("a file can be written");
    assert_says(&refused_file(&path, &[]), &["in.geojson: is not GeoJSON"]);
    fs::write(&path, r#"{"type": "Point", "coordinates": [1, 2]}"#).expect("a file can be written");
    assert_says(&refused_file(&path, &[]), &["FeatureCollection"]);
    let point =
        json!({"type": "Feature", "properties": {"elev": 1}, "geometry": {"type": "Point", "coordinates": [1, 2]}});
    assert_says(&refused(&[point], &[]), &["feature 1", "is a Point"]);
}

/// Writes the cone as a shapefile, with the height of ring `spoilt` as no number.
fn shapefile(path: &Path, spoilt: Option<usize>) {
    use shapefile::dbase::{FieldValue, Record, TableWriterBuilder};
    let name = "CONTOUR".try_into().expect("a field's name");
    let table = TableWriterBuilder::new().add_numeric_field(name, 12, 2);
    let mut writer = shapefile::Writer::from_path(path, table).expect("a file can be written");
    for (k, feature) in cone().iter().enumerate() {
        let points = lines_of(feature).iter().map(|p| shapefile::Point::new(p[0], p[1])).collect();
        let z = feature["properties"]["Elev"].as_f64().filter(|_| spoilt != Some(k));
        let mut record = Record::default();
        record.insert("CONTOUR".into(), FieldValue::Numeric(z));
        writer.write_shape_and_record(&shapefile::Polyline::new(points), &record).expect("it can be written");
    }
}

#[test]
fn shapefiles_are_read_and_damaged_ones_refused() {
    let place = folder();
    let path = place.path().join("cone.shp");
    shapefile(&path, None);
    let wkt = r#"PROJCS["WGS_1984_UTM_Zone_11N",GEOGCS["GCS_WGS_1984"],UNIT["Meter",1.0]]"#;
    fs::write(path.with_extension("prj"), wkt).expect("a file can be written");
    let [ours, theirs] = [Terrain::read(&path, &pixels(20.0)).expect("a shapefile"), read(&cone(), &pixels(20.0))];
    assert_eq!(ours.map, theirs.map);
    for (a, b) in ours.stack.slices.iter().zip(&theirs.stack.slices) {
        assert_eq!(a.z, b.z);
        assert!((0..a.content.len()).all(|n| a.content.inside(n) == b.content.inside(n)));
    }
    let degrees = r#"GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984"]]"#;
    fs::write(path.with_extension("prj"), degrees).expect("a file can be written");
    let far = "feature 1: (500400, 4000000) cannot be turned from EPSG:4326 into EPSG:32616: longitude and latitude must lie in";
    assert_says(&refused_file(&path, &["--crs-out", "EPSG:32616"]), &["cone.shp", far]);
    assert_says(
        &refused_file(&path, &[]),
        &["degrees wide, more than the 12 that a UTM zone can hold; --crs-out EPSG:N"],
    );
    fs::write(path.with_extension("prj"), wkt).expect("a file can be written");

    for file in ["shp", "dbf"] {
        let damaged = path.with_extension(file);
        let whole = fs::read(&damaged).expect("it was written");
        for part in [0, 10, 60, 110, whole.len() / 2, whole.len() - 9] {
            fs::write(&damaged, &whole[..part.min(whole.len() - 9)]).expect("a file can be written");
            assert_says(&refused_file(&path, &[]), &["cone."]);
        }
        fs::write(&damaged, &whole).expect("a file can be written");
    }
    shapefile(&path, Some(2));
    assert_says(&refused_file(&path, &[]), &["feature 3", "`CONTOUR` is null"]);
    fs::remove_file(path.with_extension("dbf")).expect("it is there");
    assert_says(&refused_file(&path, &[]), &["cone.dbf: cannot read"]);
}

/// Degrees of latitude and longitude about (-84.2, 36.3) of metres to the east and north, nearly.
fn degrees([x, y]: [f64; 2]) -> [f64; 2] {
    [-84.2 + x / 89_800.0, 36.3 + y / 111_000.0]
}

fn in_degrees(line: &Line) -> Line {
    line.iter().map(|p| degrees([p[0] - EAST, p[1] - NORTH])).collect()
}

fn collection(crs: Option<&str>, features: &[Value]) -> String {
    let mut text = json!({"type": "FeatureCollection", "features": features});
    if let Some(name) = crs {
        text["crs"] = json!({"type": "name", "properties": {"name": name}});
    }
    text.to_string()
}

#[test]
fn degrees_are_reprojected() {
    let place = folder();
    let path = place.path().join("in.geojson");
    let rings = [(100, 4000.0), (150, 3000.0), (200, 2000.0)];
    let features: Vec<Value> = rings.iter().map(|(z, r)| feature(*z, &in_degrees(&circle([0.0, 0.0], *r)))).collect();
    // GeoJSON that names no system has longitude and latitude.
    for crs in [None, Some("urn:ogc:def:crs:OGC:1.3:CRS84"), Some("EPSG:4326"), Some("EPSG:4269")] {
        fs::write(&path, collection(crs, &features)).expect("a file can be written");
        let terrain = Terrain::read(&path, &pixels(100.0)).expect("a map in degrees");
        assert_eq!(terrain.map.crs, Crs::Epsg(32616), "{crs:?}");
        let says = "are reprojected to EPSG:32616, WGS 84 / UTM zone 16N; --crs-out EPSG:N names another";
        assert!(terrain.notes.iter().any(|note| note.contains(says)), "{:?}", terrain.notes);
        for (k, (_, r)) in rings.iter().enumerate() {
            let content = &terrain.stack.slices[k].content;
            let area = (0..content.len()).filter(|n| content.inside(*n)).count() as f64 * 1e4;
            let share = area / (std::f64::consts::PI * r * r);
            assert!((share - 1.0).abs() < 0.02, "{share}");
        }
        let wanted = ReadOptions { crs_out: Some("EPSG:5070".into()), ..pixels(100.0) };
        assert_eq!(Terrain::read(&path, &wanted).expect("another system").map.crs, Crs::Epsg(5070));
    }
    let out = place.path().join("x.dem.tif").display().to_string();
    let result = interslice(&["reconstruct", &path.display().to_string(), "-o", &out, "--pixel", "200"]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    assert_says(&stderr(&result), &["longitude and latitude (EPSG:4269) are reprojected to EPSG:32616"]);
    for (options, says) in [
        (
            &["--crs-out", "EPSG:4326"][..],
            "`crs_out` must be a system of lengths, as heights are; EPSG:4326 has degrees",
        ),
        (&["--crs-out", "metres"], "`crs_out` must be EPSG:N with 1024 <= N < 32767; got `metres`"),
        (&["--crs-out", "EPSG:1999"], "EPSG:1999 is not known to this program"),
        (
            &["--crs", "local", "--crs-out", "EPSG:32616"],
            "`crs_out` needs the system of the file: --crs EPSG:N names it",
        ),
    ] {
        assert_says(&refused_file(&path, options), &["in.geojson", says]);
    }
    let wide = [feature(100, &vec![[0.0, 0.0], [20.0, 0.0], [20.0, 5.0]]), feature(200, &vec![[0.0, 1.0], [9.0, 5.0]])];
    fs::write(&path, collection(None, &wide)).expect("a file can be written");
    assert_says(
        &refused_file(&path, &[]),
        &["the map is 20.0 degrees wide, more than the 12 that a UTM zone can hold"],
    );
    let polar = [feature(100, &vec![[0.0, 83.0], [2.0, 86.0]]), feature(200, &vec![[1.0, 83.0], [2.0, 84.0]])];
    fs::write(&path, collection(None, &polar)).expect("a file can be written");
    assert_says(&refused_file(&path, &[]), &["from latitude 83 to 86, where there is no UTM; --crs-out EPSG:N"]);
    let stack = folder();
    sound_stack(stack.path());
    for (option, value) in [("--crs-out", "EPSG:32616"), ("--z-unit", "ft")] {
        let says =
            format!("`{}` is not for anything but contour maps", option.trim_start_matches('-').replace('-', "_"));
        assert_says(&refused_file(stack.path(), &[option, value]), &[&says]);
    }
}

/// A map cut along meridians and parallels has slanted edges in any system of lengths.
/// Maps across 180 degrees, and such as count from 0 to 360; a plan in metres from a corner may be as far east, but is wider.
#[test]
fn degrees_go_on_beyond_180() {
    let place = folder();
    let path = place.path().join("map.geojson");
    let rings = |[x, y]: [f64; 2], wide: f64| {
        let line =
            |r: f64| -> Line { circle([0.0; 2], r).iter().map(|p| [x + p[0] - EAST, y + p[1] - NORTH]).collect() };
        fs::write(&path, collection(None, &[feature(100, &line(wide / 2.0)), feature(150, &line(wide / 3.0))]))
            .expect("a file can be written");
    };
    for (middle, wide, wanted) in [
        ([180.0, -17.0], 0.02, Crs::Epsg(32701)),
        ([-180.0, -17.0], 0.02, Crs::Epsg(32701)),
        ([350.01, 65.0], 0.02, Crs::Epsg(32629)),
        ([179.0, 17.0], 4.0, Crs::Epsg(32660)),
        ([181.0, 40.0], 80.0, Crs::Unknown),
        ([200.0, 40.0], 13.0, Crs::Unknown),
        ([365.0, 40.0], 8.0, Crs::Unknown),
    ] {
        rings(middle, wide);
        let terrain = Terrain::read(&path, &ReadOptions::default()).expect("a map");
        assert_eq!(terrain.map.crs, wanted, "{middle:?} {wide}");
        let [dx, _] = terrain.stack.spacing;
        let across = dx * terrain.stack.dims[0] as f64;
        let widest = if wanted == Crs::Unknown { wide } else { wide * 111e3 };
        assert!(across < 4.0 * widest, "{middle:?}: {across} of {widest}");
    }
}

#[test]
fn a_byte_order_mark_is_no_part_of_geojson() {
    let place = folder();
    let rings = [feature(100, &circle([0.0; 2], 400.0)), feature(150, &circle([0.0; 2], 200.0))];
    for name in ["map.geojson", "map.json"] {
        let path = place.path().join(name);
        fs::write(&path, format!("\u{feff}{}", collection(Some("EPSG:32611"), &rings))).expect("a file can be written");
        let stack = interslice::input::read(&path, &pixels(20.0)).expect("a map");
        assert_eq!(stack.slices.len(), 2, "{name}");
    }
}

#[test]
fn a_system_that_contradicts_the_files_own_is_told() {
    let place = folder();
    let path = place.path().join("map.geojson");
    let rings = [feature(100, &circle([0.0; 2], 400.0)), feature(150, &circle([0.0; 2], 200.0))];
    fs::write(&path, collection(Some("EPSG:32611"), &rings)).expect("a file can be written");
    let says = |given: &str| {
        let options = ReadOptions { crs: Some(given.into()), ..pixels(20.0) };
        let notes = Terrain::read(&path, &options).expect("a map").notes;
        notes.into_iter().find(|note| note.contains("the file names"))
    };
    assert_eq!(says("EPSG:32611"), None);
    let note = "`crs` is EPSG:32612, but the file names EPSG:32611: coordinates are taken as `crs` says";
    assert_eq!(says("EPSG:32612").as_deref(), Some(note));
    assert!(says("local").is_some_and(|note| note.starts_with("`crs` is local, but the file names EPSG:32611")));
    let shape = place.path().join("cone.shp");
    shapefile(&shape, None);
    let text = r#"PROJCS["WGS_1984_UTM_Zone_11N",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984"]],UNIT["Meter",1.0]]"#;
    fs::write(shape.with_extension("prj"), text).expect("a file can be written");
    let said = interslice(&["inspect", &shape.display().to_string(), "--crs", "EPSG:2056"]);
    let said = String::from_utf8_lossy(&said.stdout).into_owned() + &stderr(&said);
    assert_says(&said, &["`crs` is EPSG:2056, but the file names EPSG:32611"]);
}

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

#[test]
fn elevations_have_many_names_and_units() {
    let [outer, inner] = [400.0, 300.0].map(|r| circle([0.0, 0.0], r));
    for name in ["level", "LEVEL", "Hoehe", "quota", "cota", "ELEV", "contour"] {
        let map = [(&outer, 100.0), (&inner, 150.0)].map(|(line, z)| with_fields(line, json!({name: z, "id": 4})));
        assert_eq!(read(&map, &pixels(20.0)).stack.slices[1].z, 150.0, "{name}");
    }
    // A better name wins.
    let both = [(&outer, 100.0), (&inner, 150.0)].map(|(line, z)| with_fields(line, json!({"level": 1, "elev": z})));
    assert_eq!(read(&both, &pixels(20.0)).stack.slices[1].z, 150.0);
    let map = [feature(100, &outer), feature(1000, &inner)];
    for (unit, metres) in [("m", 1000.0), ("ft", 304.8), ("us-ft", 1000.0 * 1200.0 / 3937.0)] {
        let z_unit = Some(serde_json::from_value(json!(unit)).expect("a unit"));
        let z = read(&map, &ReadOptions { z_unit, ..pixels(20.0) }).stack.slices[1].z;
        assert!((z - metres).abs() < 1e-9, "{unit}: {z}");
    }
    assert_says(&refused(&map, &["--z-unit", "yard"]), &["invalid value 'yard' for '--z-unit <UNIT>'", "m, ft, us-ft"]);
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

/// A cone whose lowest contour is a circle: beyond it nothing, its height, or a slope that goes on.
#[test]
fn below_the_lowest_contour_there_may_be_heights() {
    let place = folder();
    let (input, output) = (place.path().join("cone.geojson"), place.path().join("cone.dem.tif"));
    write(&input, &cone());
    let heights = |below: &[&str]| {
        let [from, to] = [&input, &output].map(|p| p.to_str().expect("temporary paths are UTF-8"));
        // Wider than high.
        let border = format!("{},{},{},{}", EAST - 500.0, NORTH - 500.0, EAST + 560.0, NORTH + 500.0);
        let common = ["--pixel", "10", "--border", &border, "--backend", "cpu", "-q"];
        let result = interslice(&[&["reconstruct", from, "-o", to], &common[..], below].concat());
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        geotiff(&output)
    };
    let none = heights(&[]);
    let outside: Vec<usize> = (0..none.heights.len()).filter(|n| none.heights[*n].is_nan()).collect();
    assert!(outside.len() > 4000, "{}", outside.len());
    let constant = heights(&["--below", "constant"]);
    assert!(outside.iter().all(|n| constant.heights[*n] == 100.0));
    let slope = heights(&["--below", "extrapolate"]);
    let [nx, ny] = slope.dims;
    for n in 0..nx * ny {
        if !none.heights[n].is_nan() {
            assert_eq!(slope.heights[n], none.heights[n], "pixel {n} lies above the lowest contour");
            continue;
        }
        // Pixels have their centres at multiples of 10 from -500 on; d0 = r - 400, d1 = r - 300.
        let [x, y] = [(n % nx) as f64 * 10.0 - 500.0, (n / nx) as f64 * 10.0 - 500.0];
        let r = x.hypot(y);
        let wanted = 100.0 - 50.0 * (r - 400.0) / (r - 300.0);
        let off = f64::from(slope.heights[n]) - wanted;
        // Lines have 120 points; beyond 12 pixels distances go from pixel to pixel, which is up to half a pixel off.
        assert!(off.abs() < if r < 420.0 { 0.2 } else { 0.6 }, "at {x}, {y}: {} for {wanted}", slope.heights[n]);
    }
    let one = [feature(100, &circle([0.0, 0.0], 400.0))];
    assert_says(&refused(&one, &["--below", "extrapolate"]), &["`below` extrapolate needs two levels", "only 100"]);
    let stack = place.path().join("stack");
    fs::create_dir(&stack).expect("a folder can be made");
    sound_stack(&stack);
    assert_says(&refused_file(&stack, &["--below", "constant"]), &["`below` is not for anything but contour maps"]);
}

#[test]
fn heights_are_an_eighth_of_the_middle_distance_between_levels_apart() {
    let levels = [(100.0, 400.0), (110.0, 300.0), (150.0, 200.0), (250.0, 100.0)];
    let terrain = read(&levels.map(|(z, r)| feature(z, &circle([0.0, 0.0], r))), &pixels(20.0));
    assert_eq!(terrain.step(), Some(5.0));
}
