//! P16: what is far from the world's origin keeps its shape, in every format, closed and manifold when it is read back.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use crate::files::{folder, interslice, nrrd, stderr};
use crate::support::edge_defects;
use glam::DVec3;
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::surface::stream::LayerSink;
use serde_json::Value;

/// Pixels of the stack and heights of its slices, in slices.
const SIZES: [usize; 3] = [30, 26, 13];
/// Slices that are painted.
const EVERY: usize = 4;

/// A leaning body with a hole, painted on every fourth slice.
fn painted() -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let inside = |k: usize| {
        let [x, y, z] = [k % nx, k / nx % ny, k / nx / ny].map(|v| v as f64);
        let (solid, hole) = ((x - 11.3 - 0.6 * z).hypot(y - 12.6) < 8.2, (x - 11.3 - 0.6 * z).hypot(y - 13.0) < 3.1);
        (k / nx / ny).is_multiple_of(EVERY) && solid && !hole
    };
    (0..nx * ny * nz).map(|k| u8::from(inside(k))).collect()
}

/// It as a NRRD with sides `side` along `axes`, its first voxel at `origin`.
fn volume(path: &Path, side: f64, axes: [DVec3; 3], origin: DVec3) {
    let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let header = format!(
        "space: left-posterior-superior\nspace directions: {} {} {}\nspace origin: {}\nencoding: raw\nendian: little",
        vector(axes[0] * side),
        vector(axes[1] * side),
        vector(axes[2] * side),
        vector(origin)
    );
    fs::write(path, nrrd(&header, "uint8", SIZES, &painted())).expect("a file can be written");
}

/// Runs the program, which must succeed; what it said.
fn done(arguments: &[&str]) -> String {
    let run = interslice(&[arguments, &["--backend", "cpu"]].concat());
    assert_eq!(run.status.code(), Some(0), "{arguments:?}: {}", stderr(&run));
    stderr(&run)
}

/// A mesh as a reader finds it: positions in the world, and what it was relative to.
struct Found {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    origin: DVec3,
}

impl Found {
    fn read(path: &Path) -> Self {
        let bytes = fs::read(path).expect("it was written");
        match path.extension().and_then(|e| e.to_str()) {
            Some("ply") => ply(&bytes),
            Some("obj") => obj(&String::from_utf8(bytes).expect("text")),
            Some("stl") => stl(&bytes),
            _ => glb(&bytes),
        }
    }

    fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|v| self.positions[v as usize]))
    }

    /// Enclosed volume, about the first vertex.
    fn volume(&self) -> f64 {
        let first = self.positions[0];
        let sixfold = |t: [DVec3; 3]| {
            let [a, b, c] = t.map(|p| p - first);
            a.dot(b.cross(c))
        };
        self.corners().map(sixfold).sum::<f64>() / 6.0
    }

    /// Triangles without area.
    fn degenerate(&self) -> usize {
        let is = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a) == DVec3::ZERO;
        self.corners().filter(|t| is(*t)).count()
    }

    /// The same after joining vertices at the very same place, as readers do.
    fn joined(&self) -> Vec<[u32; 3]> {
        let mut numbers = HashMap::new();
        let mut number = |p: &DVec3| {
            let next = numbers.len() as u32;
            *numbers.entry((*p + 0.0).to_array().map(f64::to_bits)).or_insert(next)
        };
        let of: Vec<u32> = self.positions.iter().map(&mut number).collect();
        self.triangles.iter().map(|t| t.map(|v| of[v as usize])).collect()
    }
}

fn single(bytes: &[u8]) -> f64 {
    f64::from(f32::from_le_bytes(bytes[..4].try_into().expect("four bytes")))
}

fn three(bytes: &[u8]) -> DVec3 {
    [0, 4, 8].map(|at| single(&bytes[at..])).into()
}

fn whole(bytes: &[u8]) -> u32 {
    u32::from_le_bytes(bytes[..4].try_into().expect("four bytes"))
}

/// A reader that goes by the header.
fn ply(bytes: &[u8]) -> Found {
    let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
    let header = std::str::from_utf8(&bytes[..end]).expect("text");
    let count = |what: &str| {
        let line = header.lines().find_map(|l| l.strip_prefix(&format!("element {what} "))).expect("a count");
        line.parse::<usize>().expect("a number")
    };
    let width = |l: &str| match l.split(' ').nth(1) {
        Some("double") => 8,
        Some("float") => 4,
        _ => 0,
    };
    let properties: Vec<usize> = header.lines().filter(|l| l.starts_with("property")).map(width).collect();
    let stride: usize = properties.iter().sum();
    let number = |at: usize| match properties[0] {
        8 => f64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes")),
        _ => single(&bytes[at..]),
    };
    let vertex = |n: usize| DVec3::from([0, 1, 2].map(|k| number(end + n * stride + k * properties[0])));
    let faces = end + count("vertex") * stride;
    let face = |n: usize| [0, 1, 2].map(|k| whole(&bytes[faces + 13 * n + 1 + 4 * k..]));
    Found {
        positions: (0..count("vertex")).map(vertex).collect(),
        triangles: (0..count("face")).map(face).collect(),
        origin: DVec3::ZERO,
    }
}

fn obj(text: &str) -> Found {
    let three = |line: &str| {
        let numbers: Vec<f64> =
            line.split(' ').map(|v| v.split('/').next().unwrap_or(v).parse().expect("a number")).collect();
        [numbers[0], numbers[1], numbers[2]]
    };
    Found {
        positions: text.lines().filter_map(|l| l.strip_prefix("v ")).map(|l| three(l).into()).collect(),
        triangles: text.lines().filter_map(|l| l.strip_prefix("f ")).map(|l| three(l).map(|v| v as u32 - 1)).collect(),
        origin: DVec3::ZERO,
    }
}

/// Facets whose corners are one where they are equal, relative to the origin that the header names.
fn stl(bytes: &[u8]) -> Found {
    let header = String::from_utf8_lossy(&bytes[..80]).into_owned();
    let origin = header.split("origin ").nth(1).map_or(DVec3::ZERO, |text| {
        let numbers: Vec<f64> = text.split_whitespace().map(|v| v.parse().expect("a number")).collect();
        DVec3::from_slice(&numbers)
    });
    let mut found = Found { positions: Vec::new(), triangles: Vec::new(), origin };
    let mut numbers = HashMap::new();
    for facet in bytes[84..].chunks_exact(50) {
        let corner = |k: usize| {
            let at = three(&facet[12 + 12 * k..]);
            *numbers.entry((at + 0.0).to_array().map(f64::to_bits)).or_insert_with(|| {
                found.positions.push(at + origin);
                found.positions.len() as u32 - 1
            })
        };
        found.triangles.push([0, 1, 2].map(corner));
    }
    assert_eq!(found.triangles.len(), whole(&bytes[80..]) as usize);
    found
}

/// The only mesh of a file, where its node puts it.
fn glb(bytes: &[u8]) -> Found {
    let json = 20 + whole(&bytes[12..]) as usize;
    let told: Value = serde_json::from_slice(&bytes[20..json]).expect("JSON");
    let data = &bytes[json + 8..];
    let view = |n: usize| {
        let [at, length] =
            ["byteOffset", "byteLength"].map(|k| told["bufferViews"][n][k].as_u64().unwrap_or(0) as usize);
        &data[at..at + length]
    };
    let moved = told["nodes"][0]["translation"].as_array();
    let origin = moved.map_or(DVec3::ZERO, |t| [0, 1, 2].map(|a| t[a].as_f64().expect("a number")).into());
    let said = told["meshes"][0]["extras"]["origin"].as_array();
    assert_eq!(said.is_some(), origin != DVec3::ZERO, "extras name it too");
    Found {
        positions: view(0).chunks_exact(12).map(|p| three(p) + origin).collect(),
        triangles: view(2).chunks_exact(12).map(|t| [0, 4, 8].map(|at| whole(&t[at..]))).collect(),
        origin,
    }
}

const STRAIGHT: [DVec3; 3] = DVec3::AXES;
const ASLANT: [DVec3; 3] = [DVec3::new(0.36, 0.48, -0.8), DVec3::new(-0.8, 0.6, 0.0), DVec3::new(0.48, 0.64, 0.6)];
const FORMATS: [&str; 4] = ["ply", "obj", "stl", "glb"];

#[test]
fn meshes_far_from_the_origin_are_those_near_it() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    // In a map, and ten million pixels and more away, along any axis.
    let cases: [(f64, _, [f64; 3], [f64; 3]); 8] = [
        (0.25, STRAIGHT, [500_003.21, 5_400_001.77, 312.5], [500_000.0, 5_400_000.0, 0.0]),
        (1.0, STRAIGHT, [1e7, 0.0, 0.0], [1e7, 0.0, 0.0]),
        (1.0, STRAIGHT, [-1e7, 1e7 + 0.3, 1e7], [-1e7, 1e7, 1e7]),
        (0.7, STRAIGHT, [0.0, 0.0, 7e6], [0.0, 0.0, 7e6]),
        (1.0, STRAIGHT, [0.0, 0.0, 1e9], [0.0, 0.0, 1e9]),
        (0.25, STRAIGHT, [1e9, -1e9, 1e9], [1e9, -1e9, 1e9]),
        (1.0, ASLANT, [1e7, 1e7, -1e7], [1e7, 1e7, -1e7]),
        (3e-5, STRAIGHT, [300.0, 300.0, 0.0], [300.0, 300.0, 0.0]),
    ];
    for (n, (side, axes, origin, local)) in cases.into_iter().enumerate() {
        let (origin, local) = (DVec3::from(origin), DVec3::from(local));
        let run = |name: &str, origin: DVec3| {
            let input = at(&format!("{name}.nrrd"));
            volume(Path::new(&input), side, axes, origin);
            let outputs = FORMATS.map(|e| at(&format!("{name}.{e}")));
            let report = at(&format!("{name}.json"));
            let mut arguments = vec!["reconstruct", &input, "--report", &report];
            outputs.iter().for_each(|o| arguments.extend(["-o", o]));
            let said = done(&arguments);
            let told: Value = serde_json::from_slice(&fs::read(&report).expect("written")).expect("JSON");
            (said, told, outputs.map(|path| Found::read(Path::new(&path))))
        };
        let (near_said, near_told, near) = run(&format!("near{n}"), DVec3::ZERO);
        let (far_said, far_told, far) = run(&format!("far{n}"), origin);
        assert!(!near_said.contains("relative to") && near_told.get("local_origin").is_none(), "{near_said}");
        let DVec3 { x, y, z } = local;
        let words = format!("positions in .stl and .glb are 32-bit and relative to ({x}, {y}, {z})");
        assert!(
            far_said.contains(&words) && far_said.contains("; .ply, .obj, .groups.obj, .3mf and .vtp are in world"),
            "case {n}: {far_said}"
        );
        assert_eq!(far_told["local_origin"], serde_json::json!(local), "case {n}");
        let report_volume = far_told["volume"].as_f64().expect("a number");
        for ((format, near), far) in FORMATS.iter().zip(&near).zip(&far) {
            let name = format!("case {n}, .{format}");
            let is_single = matches!(*format, "stl" | "glb");
            assert_eq!(far.origin, if is_single { local } else { DVec3::ZERO }, "{name}");
            assert_eq!(edge_defects(&far.triangles), 0, "{name}: by index");
            assert_eq!(edge_defects(&far.joined()), 0, "{name}: by place");
            assert_eq!(far.degenerate(), 0, "{name}");
            assert_eq!(far.positions.len(), near.positions.len(), "{name}");
            let off =
                near.positions.iter().zip(&far.positions).map(|(near, far)| (far - origin - near).abs().max_element());
            // Half the distance of neighbouring f32, of f64 some.
            let bound = if is_single { 6e-4 * side } else { 8.0 * f64::EPSILON * origin.abs().max_element() };
            let off = off.fold(0.0, f64::max);
            assert!(off < bound, "{name}: {off} from where they were, bound {bound}");
            let volume = far.volume();
            println!("{name}: {} triangles, moved by {off:.1e}, volume {volume}", far.triangles.len());
            assert!((volume / near.volume() - 1.0).abs() < 1e-4, "{name}: volume {volume} for {}", near.volume());
            assert!((volume / report_volume - 1.0).abs() < 1e-4, "{name}: volume {volume}, report {report_volume}");
        }
    }
}

#[test]
fn parts_labels_and_simpler_meshes_far_away_are_sound_too() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let input = at("in.nrrd");
    volume(Path::new(&input), 0.25, STRAIGHT, DVec3::new(500_003.21, 5_400_001.77, 1e8));
    let local = DVec3::new(500_000.0, 5_400_000.0, 1e8);
    done(&["reconstruct", &input, "-o", &at("whole.stl"), "-o", &at("whole.glb"), "-o", &at("whole.ply")]);
    let parts = [1, 2, 3].map(|k| (format!("{k}/3"), at(&format!("{k}.section"))));
    parts.iter().for_each(|(part, file)| drop(done(&["run", &input, "--part", part, "-o", file])));
    let merge = ["merge", &parts[2].1, &parts[0].1, &parts[1].1];
    let merged = ["parts.stl", "parts.glb", "parts.ply"].map(at);
    let arguments = [&merge[..], &["-o", &merged[0], "-o", &merged[1], "-o", &merged[2]]].concat();
    let run = interslice(&arguments);
    assert!(
        run.status.success() && stderr(&run).contains("relative to (500000, 5400000, 100000000)"),
        "{}",
        stderr(&run)
    );
    for kind in ["stl", "ply"] {
        let [whole, parts] = ["whole", "parts"].map(|name| fs::read(at(&format!("{name}.{kind}"))).expect("written"));
        assert!(whole == parts, ".{kind} of parts");
    }
    done(&["reconstruct", &input, "--labels", "all", "-o", &at("labels.glb"), "-o", &at("labels.stl")]);
    done(&[
        "reconstruct",
        &input,
        "--simplify",
        "0.02",
        "-o",
        &at("few.stl"),
        "-o",
        &at("few.glb"),
        "-o",
        &at("few.ply"),
    ]);
    let whole = Found::read(Path::new(&at("whole.ply")));
    for name in ["whole.stl", "parts.glb", "labels.glb", "labels.1.stl", "few.stl", "few.glb", "few.ply"] {
        let found = Found::read(Path::new(&at(name)));
        assert_eq!(found.origin, if name.ends_with("ply") { DVec3::ZERO } else { local }, "{name}");
        assert_eq!((edge_defects(&found.joined()), found.degenerate()), (0, 0), "{name}");
        let is_few = name.starts_with("few");
        assert_eq!(
            found.triangles.len() < whole.triangles.len(),
            is_few,
            "{name}: {} triangles",
            found.triangles.len()
        );
        let off = (found.volume() / whole.volume() - 1.0).abs();
        assert!(off < if is_few { 2e-2 } else { 1e-4 }, "{name}: {off}");
    }
}

#[test]
fn pictures_and_pages_show_the_same_far_away() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let pictures = [DVec3::ZERO, DVec3::new(1e7, -1e7, 1e7)].map(|origin| {
        volume(Path::new(&at("in.nrrd")), 1.0, STRAIGHT, origin);
        done(&["reconstruct", &at("in.nrrd"), "--contours", "-o", &at("out.png"), "-o", &at("out.html")]);
        image::open(at("out.png")).expect("a picture").to_rgb8().into_raw()
    });
    let differ = pictures[0].iter().zip(&pictures[1]).filter(|(a, b)| a.abs_diff(**b) > 8).count();
    println!("{differ} of {} samples differ", pictures[0].len());
    assert!(differ < pictures[0].len() / 2000, "{differ} samples differ");
}

#[test]
fn volumes_maps_and_lines_say_where_they_lie_or_that_they_cannot() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let (input, origin) = (at("in.nrrd"), DVec3::new(500_003.21, 5_400_001.77, 1e9 + 0.5));
    volume(Path::new(&input), 0.25, STRAIGHT, origin);
    let outputs = ["nrrd", "mha", "nii", "dem.tif", "contours.json", "geojson"].map(|e| at(&format!("out.{e}")));
    let mut arguments = vec!["reconstruct", &input];
    outputs.iter().for_each(|o| arguments.extend(["-o", o]));
    let said = done(&arguments);
    assert!(
        said.contains("NIfTI holds where a volume lies as 32-bit numbers") && said.contains("voxels) off; .nrrd, .mha"),
        "{said}"
    );
    let head = |k: usize| String::from_utf8_lossy(&fs::read(&outputs[k]).expect("written")[..600]).into_owned();
    assert!(head(0).contains("space origin: (500003.21,5400001.77,1000000000.5)"), "{}", head(0));
    assert!(head(1).contains("Offset = 500003.21 5400001.77 1000000000.5"), "{}", head(1));
    let lines: Value = serde_json::from_slice(&fs::read(&outputs[4]).expect("written")).expect("JSON");
    let heights: Vec<f64> =
        lines["slices"].as_array().expect("a list").iter().filter_map(|s| s["z"].as_f64()).collect();
    assert!(heights.windows(2).all(|w| (w[1] - w[0] - 0.25).abs() < 1e-6) && heights[0] == origin.z, "{heights:?}");
    let xs = |v: &Value| {
        v["slices"][0]["polygons"][0]
            .as_array()
            .expect("points")
            .iter()
            .map(|p| p[0].as_f64().expect("x"))
            .collect::<Vec<_>>()
    };
    let places = xs(&lines);
    assert!(places.iter().any(|x| (x * 4.0).fract().abs() > 1e-3) && places[0] > 500_003.0, "{places:?}");
    // A height map has the heights of the world, too.
    let mut tiff = tiff::decoder::Decoder::new(fs::File::open(&outputs[3]).expect("written")).expect("a TIFF");
    let tiff::decoder::DecodingResult::F64(dem) = tiff.read_image().expect("pixels") else {
        panic!("64 bits so far away")
    };
    let top = dem.into_iter().filter(|h| !h.is_nan()).fold(f64::MIN, f64::max);
    assert!((top - heights[heights.len() - 1]).abs() < 1e-6, "{top} where the last slice lies at {heights:?}");
    // Near, nothing is said.
    volume(Path::new(&input), 0.25, STRAIGHT, DVec3::new(-120.5, 33.25, 4000.0));
    let said = done(&["reconstruct", &input, "-o", &outputs[2]]);
    assert!(!said.contains("NIfTI"), "{said}");
}

#[test]
fn heights_that_are_large_themselves_are_kept() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    for (k, r) in [12.0, 9.0, 5.0].into_iter().enumerate() {
        crate::files::disc(&place.path().join(format!("s{k}.png")), 32, r);
    }
    let heights = [0.0, 1e9].map(|from| {
        let slices: Vec<String> =
            (0..3).map(|k| format!(r#"{{"file": "s{k}.png", "z": {}}}"#, from + 3.0 * f64::from(k))).collect();
        let text = format!(r#"{{"spacing_xy": [0.5, 0.5], "slices": [{}]}}"#, slices.join(", "));
        crate::files::write_stack(place.path(), &text);
        let folder = place.path().display().to_string();
        done(&["reconstruct", &folder, "-o", &at("out.dem.tif"), "-o", &at("out.stl"), "-o", &at("out.ply")]);
        for name in ["out.stl", "out.ply"] {
            let found = Found::read(Path::new(&at(name)));
            assert_eq!((edge_defects(&found.joined()), found.degenerate()), (0, 0), "{name}");
            assert_eq!(found.origin.z, if name == "out.stl" { from } else { 0.0 });
        }
        let mut tiff =
            tiff::decoder::Decoder::new(fs::File::open(at("out.dem.tif")).expect("written")).expect("a TIFF");
        match tiff.read_image().expect("pixels") {
            tiff::decoder::DecodingResult::F32(heights) if from == 0.0 => heights.into_iter().map(f64::from).collect(),
            tiff::decoder::DecodingResult::F64(heights) if from > 0.0 => {
                heights.into_iter().map(|h| h - from).collect::<Vec<_>>()
            }
            _ => panic!("32 bits near 0, 64 far from it"),
        }
    });
    let [near, far] = &heights;
    assert!(near.iter().filter(|h| !h.is_nan()).count() > 300);
    for (near, far) in near.iter().zip(far) {
        assert!((near - far).abs() < 1e-5 || near.is_nan() && far.is_nan(), "{far} for {near}");
    }
}

#[test]
fn a_surface_too_wide_for_32_bits_is_refused_there_only() {
    let place = folder();
    let body = crate::support::body([40_000, 1], &[0.0, 1.0], |x, _, _| x - 9.0);
    let begun = |format: &str| {
        let path = place.path().join(format!("out.{format}"));
        let mut outputs = Outputs::open(&[path], None, Temporary::Random, &mut Places::default()).expect("a place");
        outputs.sink(&OutputOptions::default()).begin(&body.header()).map_err(|e| (e.exit_code(), e.to_string()))
    };
    for format in ["stl", "glb"] {
        let (code, said) = begun(format).expect_err("32 bits do not hold it");
        assert!(
            code == 2
                && said.contains("40001 cells wide")
                && said.contains(".ply, .obj, .groups.obj, .3mf and .vtp hold 64 bits"),
            "{said}"
        );
    }
    for format in ["ply", "obj", "3mf", "vtp", "groups.obj", "nrrd"] {
        assert_eq!(begun(format), Ok(()), "{format}");
    }
}
