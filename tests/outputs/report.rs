//! What a person looks at: the page, areas and volumes of the report, .glb, simpler meshes, origin and confidence.

use std::fs;
use std::path::{Path, PathBuf};

use crate::files::{folder, interslice, listing, sound_stack, stderr};
use interslice::evaluate::demo::demo;
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::{JobOptions, Loaded};
use interslice::progress::Silent;
use interslice::report::{BodyEnd, Report};
use interslice::settings::EndRule;
use interslice::stack::ContourStack;
use interslice::{Budget, Means, Reconstruction, Reference, Settings, reconstruct_with};

/// Writes `names` of a stack into `place`; gives the report.
fn write(place: &Path, stack: &ContourStack, settings: &Settings, output: OutputOptions, names: &[&str]) -> Report {
    let options = JobOptions { settings: settings.clone(), output, ..JobOptions::default() };
    let loaded = Loaded::new(stack.clone(), options).expect("the stack is sound");
    let paths: Vec<PathBuf> = names.iter().map(|n| place.join(n)).collect();
    let mut outputs =
        Outputs::open(&paths, None, Temporary::Random, &mut Places::default()).expect("the folder is there");
    let budget = Budget::unlimited();
    let means = Means { backend: &Reference, progress: &Silent, budget: &budget };
    let mut body = loaded.compute(&means, &mut outputs).expect("it can be computed");
    outputs.complete(&mut body.report).expect("it can be written");
    outputs.rename().expect("it can be renamed");
    body.report
}

fn collected(stack: &ContourStack, settings: &Settings) -> Reconstruction {
    let heights = interslice::height_grid(stack, settings, None).heights().expect("a few");
    reconstruct_with(stack, &heights, settings, &Reference, &Silent).expect("it can be computed")
}

/// A disc that shrinks by a pixel a slice.
fn cone() -> ContourStack {
    let mut stack = demo("fig10").expect("a demo").stack;
    let [nx, ny] = [64, 60];
    let (mut slice, heights) = (stack.slices[0].clone(), [0.0, 3.0, 6.0, 9.0]);
    stack.dims = [nx, ny];
    stack.spacing = [1.0, 1.0];
    stack.z_out = None;
    stack.slices = heights
        .into_iter()
        .map(|z| {
            let disc = |k: usize| ((k % nx) as f64 - 31.3).hypot((k / nx) as f64 - 29.6) < 24.0 - z;
            slice.content = interslice::stack::SliceContent::Mask((0..nx * ny).map(disc).collect());
            slice.name = format!("z{z}");
            slice.z = z;
            slice.clone()
        })
        .collect();
    stack
}

#[test]
fn a_page_survives_hostile_names() {
    let place = folder();
    let mut stack = cone();
    stack.slices[0].name = "<script>alert(1)</script>.png".into();
    stack.slices[1].name = "\"><img src=x onerror=alert(2)>{{settings}}".into();
    stack.slices[2].name = "</script><!-- &lt; '".into();
    stack.unit = "<b>mm</b>".into();
    let name = "a<script>alert(3)<&{{scene}}.html";
    write(place.path(), &stack, &Settings::default(), OutputOptions::default(), &[name]);
    let page = fs::read_to_string(place.path().join(name)).expect("it was written");
    assert_eq!(page.matches("<script").count(), 2, "the page's own: its numbers and its viewer");
    assert_eq!(page.matches("</script").count(), 2);
    for wrong in ["alert(1)</", "<img", "<b>mm", "<!-- &lt;", "https:", "src=\""] {
        assert!(!page.contains(wrong), "{wrong}");
    }
    for right in [
        "&lt;script&gt;alert(1)&lt;/script&gt;.png</button>",
        "&quot;&gt;&lt;img src=x onerror=alert(2)&gt;{{settings}}</button>",
        "<h1>a&lt;script&gt;alert(3)&lt;&amp;{{scene}}</h1>",
        "&lt;b&gt;mm&lt;/b&gt;³",
        "Everything holds that was checked.",
    ] {
        assert!(page.contains(right), "{right}");
    }
}

#[test]
fn a_page_says_which_contours_are_not_met() {
    let place = folder();
    let stack = cone();
    let loaded = Loaded::new(stack, JobOptions::default()).expect("the stack is sound");
    let path = place.path().join("x.html");
    let mut outputs =
        Outputs::open(&[], Some(&path), Temporary::Random, &mut Places::default()).expect("the folder is there");
    let budget = Budget::unlimited();
    let means = Means { backend: &Reference, progress: &Silent, budget: &budget };
    let mut body = loaded.compute(&means, &mut outputs).expect("it can be computed");
    body.report.contours[2].differing_pixels = 17;
    body.report.judge();
    outputs.complete(&mut body.report).expect("it can be written");
    outputs.rename().expect("it can be renamed");
    let page = fs::read_to_string(path).expect("--report takes a page too");
    assert!(page.contains("1 of 4 contours are not met, by 17 pixels.") && page.contains(r#"<td class="off">17</td>"#));
}

#[cfg(feature = "simplify")]
#[test]
fn a_page_says_that_its_figures_are_not_those_of_the_simplified_mesh() {
    let place = folder();
    for (simplify, said) in [(None, false), (Some(0.25), true)] {
        let output = OutputOptions { simplify, ..OutputOptions::default() };
        write(place.path(), &cone(), &Settings::default(), output, &["a.html", "a.stl"]);
        let page = fs::read_to_string(place.path().join("a.html")).expect("it was written");
        assert_eq!(page.contains("those of the mesh before it was simplified"), said);
    }
}

#[test]
fn a_page_tells_where_the_body_ends_and_not_its_layers() {
    let place = folder();
    let mut stack = cone();
    let last = stack.slices.len() - 1;
    stack.slices[last].content = interslice::stack::SliceContent::Mask((0..64 * 60).map(|_| false).collect());
    let report = write(place.path(), &stack, &Settings::default(), OutputOptions::default(), &["a.html", "a.ply"]);
    let page = fs::read_to_string(place.path().join("a.html")).expect("it was written");
    let said = page.split_once("Body from height</dt><dd>").expect("it says so").1;
    let highest: f64 = said.split(' ').nth(2).and_then(|n| n.parse().ok()).expect("a number");
    // The last painted slice lies at 6, the empty one at 9.
    assert!(highest > 6.5 && highest < 8.5, "{said:.40}");
    let beyond = report.areas.expect("a report has them").layers.into_iter().filter(|[z, _]| *z > highest + 1e-3);
    assert!(beyond.map(|[_, area]| area).sum::<f64>() == 0.0);
}

#[test]
fn areas_and_ends_add_up_to_the_volume() {
    let place = folder();
    let stack = cone();
    let run = |rule: EndRule| {
        let settings = Settings { end_bottom: rule, end_top: rule, fair: 0.0, ..Settings::default() };
        write(place.path(), &stack, &settings, OutputOptions { dz: Some(0.1), ..Default::default() }, &["r.json"])
    };
    for rule in [EndRule::Flat, EndRule::HalfSlice, EndRule::Extrapolate, EndRule::Peak(14.0)] {
        let rule_is = rule.to_string();
        let settings = Settings { end_top: rule, fair: 0.0, ..Settings::default() };
        let report =
            write(place.path(), &stack, &settings, OutputOptions { dz: Some(0.1), ..Default::default() }, &["r.json"]);
        let areas = report.areas.expect("a report has them");
        let sum = areas.between_contours + report.ends.iter().map(|e| e.used).sum::<f64>();
        let volume = report.volume.expect("a report has it");
        println!("{rule_is}: {volume:.1}, by areas {sum:.1}, ends {:?}", report.ends);
        assert!((sum / volume - 1.0).abs() < 2e-3, "{rule_is}: {sum} for {volume}");
        assert_eq!(report.ends.iter().map(|e| e.side).collect::<Vec<_>>(), [BodyEnd::Bottom, BodyEnd::Top]);
        assert!(areas.layers.windows(2).all(|w| w[0][0] < w[1][0]), "heights increase");
    }
    // What a run says of rules that it does not use is what a run that uses them does.
    let [flat, half, extrapolated] = [EndRule::Flat, EndRule::HalfSlice, EndRule::Extrapolate].map(run);
    for k in 0..2 {
        assert_eq!(flat.ends[k].half_slice, half.ends[k].used);
        assert_eq!(flat.ends[k].extrapolate, extrapolated.ends[k].used);
        assert_eq!(flat.ends[k].used, 0.0);
    }
    // A cone with 15 to its tip; two gaps, 6, are the most: beginning with the cone's slope, -2 A / 15, the area is A (1 - q) (1 + 0.2 q).
    let tip = extrapolated.areas.and_then(|a| a.layers.last().copied()).expect("it has layers")[0];
    let exact = flat.ends[1].area * 6.0 * (4.0 - 0.8) / 6.0;
    println!("extrapolate: {} for {exact}", flat.ends[1].extrapolate);
    assert!((tip - 15.0).abs() < 1e-9 && (flat.ends[1].extrapolate / exact - 1.0).abs() < 0.02);
}

#[test]
fn origin_and_confidence_are_as_defined() {
    let place = folder();
    let stack = cone();
    let settings = Settings { end_top: EndRule::Extrapolate, ..Settings::default() };
    let names = ["a.origin.nrrd", "a.confidence.nii", "a.nrrd"];
    write(place.path(), &stack, &settings, OutputOptions::default(), &names);
    let body = collected(&stack, &settings);
    let origin = inflated(&fs::read(place.path().join(names[0])).expect("written"));
    let bytes = fs::read(place.path().join(names[1])).expect("written");
    let confidence: Vec<f32> = bytes[352..].as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let layers: Vec<_> = body.output_layers().collect();
    let n = stack.dims[0] * stack.dims[1];
    assert_eq!([origin.len(), confidence.len()], [n * layers.len(); 2]);
    let contour = |k: usize| &body.layers.iter().find(|l| l.contour == Some(k)).expect("a layer each").phi;
    let mut seen = [0usize; 4];
    for (layer, (origin, confidence)) in layers.iter().zip(origin.chunks(n).zip(confidence.chunks(n))) {
        let above = stack.slices.iter().position(|s| s.z >= layer.z).unwrap_or(3).max(1);
        let [low, high] = [stack.slices[above - 1].z, stack.slices[above].z];
        let t = (layer.z - low) / (high - low);
        let kind = if layer.contour.is_some() {
            1
        } else if t > 1.0 {
            3
        } else {
            2
        };
        for k in 0..n {
            let inside = layer.phi[k] < 0.0;
            assert_eq!(origin[k], if inside { kind } else { 0 }, "pixel {k} at {}", layer.z);
            seen[usize::from(origin[k])] += 1;
            let change = f64::from(contour(above)[k] - contour(above - 1)[k]).abs();
            let u = change * if kind == 3 { t - 1.0 } else { t * (1.0 - t) };
            let expected = match u > 0.0 {
                true => 1.0 - 0.5 / (1.0 + f64::from(layer.phi[k]).abs() / (0.63 * u)).powi(2),
                false => 1.0,
            };
            assert!((f64::from(confidence[k]) - expected).abs() < 1e-5, "pixel {k} at {}", layer.z);
        }
    }
    println!("voxels: {seen:?}");
    assert!(seen.iter().all(|count| *count > 100), "{seen:?}");
    assert!(confidence.iter().any(|p| *p < 0.6), "somewhere the surface is uncertain");
}

/// What is behind a NRRD's header.
fn inflated(bytes: &[u8]) -> Vec<u8> {
    let start = bytes.windows(2).position(|w| w == b"\n\n").expect("a header ends") + 2;
    let mut out = Vec::new();
    std::io::copy(&mut flate2::read::GzDecoder::new(&bytes[start..]), &mut out).expect("a gzip stream");
    out
}

#[test]
fn a_wrong_simplification_is_refused_before_any_work() {
    let place = folder();
    sound_stack(place.path());
    let [input, output] = [place.path(), &place.path().join("x.stl")].map(|p| p.display().to_string());
    for wrong in ["0", "-1", "nan", "inf"] {
        let result = interslice(&["reconstruct", &input, "-o", &output, &format!("--simplify={wrong}")]);
        assert_eq!(result.status.code(), Some(2), "{wrong}");
        assert!(stderr(&result).contains("simplify"), "{}", stderr(&result));
    }
    assert!(!Path::new(&output).exists());
}

#[test]
fn an_option_for_what_is_not_written_is_told() {
    let place = folder();
    sound_stack(place.path());
    let input = place.path().display().to_string();
    let at = |name: &str| place.path().join(name).display().to_string();
    let told = |options: &[&str], name: &str| {
        let out = at(name);
        let result = interslice(&[&["reconstruct", &input, "-o", &out, "--backend", "cpu"], options].concat());
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        stderr(&result)
    };
    let field: &[&str] = &["--method", "field"];
    let cases: [(&[&str], &[&str], &str, &str); 8] = [
        (&["--simplify", "0.1"], &[], "a.nrrd", "b.stl"),
        (&["--units", "m"], &[], "a.stl", "b.glb"),
        (&["--y-up"], &[], "a.stl", "c.glb"),
        (&["--contours"], &[], "a.stl", "b.png"),
        (&["--mask"], &[], "a.stl", "b.nrrd"),
        (&["--distance"], &[], "a.origin.nrrd", "c.nrrd"),
        (&["--link-reach", "5"], &["--link", "auto"], "b.stl", "b.stl"),
        (&["--cap-gaps", "1"], &["--end-top", "extrapolate"], "b.stl", "b.stl"),
    ];
    for (options, more, without, with) in cases {
        let setting = format!("`{}` changes nothing", options[0].trim_start_matches('-').replace('-', "_"));
        let [idle, used] = [told(options, without), told(&[options, more].concat(), with)];
        assert!(idle.contains(&setting), "{options:?}:\n{idle}");
        assert!(!used.contains("changes nothing"), "{options:?}:\n{used}");
    }
    // Settings that another one leaves nothing to do.
    let of_the_morph: [&[&str]; 8] = [
        &["--slope", "pchip"],
        &["--spline-end", "not-a-knot"],
        &["--sweep", "forward"],
        &["--redistance", "9"],
        &["--cfl", "0.3"],
        &["--cut-off", "2"],
        &["--seed-spacing", "1"],
        &["--tolerance", "0.2"],
    ];
    let others: [(&[&str], &[&str]); 4] = [
        (&["--sigma", "0.8"], &["--anti-alias", "none"]),
        (&["--sigma", "0.8"], &["--anti-alias", "eq6"]),
        (&["--spline-end", "not-a-knot"], &["--slope", "pchip"]),
        (&["--slope", "natural", "--fair", "0"], field),
    ];
    for (options, by) in of_the_morph.into_iter().map(|options| (options, field)).chain(others) {
        let setting = format!("`{}` changes nothing", options[0].trim_start_matches('-').replace('-', "_"));
        let bytes = |name: &str| fs::read(at(name)).expect("it was written");
        let (idle, without, used) = (
            told(&[options, by].concat(), "e.stl"),
            told(&[by, &options[2..]].concat(), "f.stl"),
            told(options, "g.stl"),
        );
        assert!(idle.contains(&setting), "{options:?} {by:?}:\n{idle}");
        assert!(bytes("e.stl") == bytes("f.stl"), "{options:?} {by:?} changes something");
        assert!(!(without + &used).contains("changes nothing"), "{options:?}:\n{used}");
    }
    // Fairing keeps to what slopes may do in both methods.
    assert!(!told(&["--slope", "natural", "--method", "field"], "h.stl").contains("changes nothing"));
    for preset in ["paper", "fast"] {
        assert!(!told(&["--preset", preset], "h.stl").contains("changes nothing"), "{preset}");
    }
    assert!(!told(&["--link-reach", "4"], "b.stl").contains("changes nothing"), "its default");
    let far = told(&["--dz", "50"], "d.nrrd");
    assert!(far.contains("`dz` is 50 mm, and the body is 8 mm high"), "{far}");
}

#[cfg(unix)]
#[test]
fn a_pipe_or_a_device_is_not_replaced() {
    use std::os::unix::fs::{FileTypeExt, symlink};
    let place = folder();
    sound_stack(place.path());
    let at = |name: &str| place.path().join(name);
    assert!(std::process::Command::new("mkfifo").arg(at("pipe.stl")).status().expect("mkfifo is there").success());
    symlink("/dev/null", at("device.nrrd")).expect("a link can be made");
    let input = place.path().display().to_string();
    for name in ["pipe.stl", "device.nrrd"] {
        let result = interslice(&["reconstruct", &input, "-o", &at(name).display().to_string()]);
        assert_eq!(result.status.code(), Some(2), "{name}: {}", stderr(&result));
        let says = format!("{name}: cannot write: is no plain file: a pipe, a device or a socket is not replaced");
        assert!(stderr(&result).contains(&says), "{}", stderr(&result));
    }
    let kind = |name: &str| fs::symlink_metadata(at(name)).expect("it is there").file_type();
    assert!(kind("pipe.stl").is_fifo() && kind("device.nrrd").is_symlink());
}

/// What it leads to has the new bytes; a link that leads nowhere leads to a file then.
#[cfg(unix)]
#[test]
fn an_output_that_is_a_link_stays_one() {
    let place = folder();
    sound_stack(place.path());
    let at = |name: &str| place.path().join(name);
    fs::create_dir(at("there")).expect("a folder can be made");
    fs::write(at("there/old.stl"), "old").expect("a file can be written");
    let links = [("there/old.stl", "a.stl"), ("there/new.nrrd", "b.nrrd"), ("b.nrrd", "c.nrrd")];
    links.iter().for_each(|(to, link)| std::os::unix::fs::symlink(to, at(link)).expect("a link can be made"));
    let input = place.path().display().to_string();
    let run = |names: &[&str]| {
        let outputs = names.iter().flat_map(|name| ["-o".into(), at(name).display().to_string()]);
        let arguments: Vec<String> =
            ["reconstruct", &input, "--backend", "cpu"].map(String::from).into_iter().chain(outputs).collect();
        interslice(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    };
    let done = run(&["a.stl", "c.nrrd", "plain.stl"]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    assert!(links.iter().all(|(_, link)| at(link).is_symlink()), "the links have gone");
    assert!(fs::read(at("there/old.stl")).expect("it is there") == fs::read(at("plain.stl")).expect("it is there"));
    assert!(fs::read(at("there/new.nrrd")).expect("it was made").starts_with(b"NRRD"));
    let left = [listing(place.path()), listing(&at("there"))].concat();
    assert!(!left.iter().any(|path| path.to_string_lossy().contains(".interslice-")), "{left:?}");
    // Both are one file.
    let twice = run(&["b.nrrd", "there/new.nrrd"]);
    assert!(twice.status.code() == Some(2) && stderr(&twice).contains("is named twice: it is "), "{}", stderr(&twice));
}

#[cfg(unix)]
#[test]
fn what_is_write_protected_is_not_replaced() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let place = folder();
    sound_stack(place.path());
    let at = |name: &str| place.path().join(name);
    for name in ["a.stl", "a.json", "a.html", "behind.nrrd"] {
        fs::write(at(name), "kept").expect("a file can be written");
        fs::set_permissions(at(name), fs::Permissions::from_mode(0o444)).expect("it is ours");
    }
    symlink("behind.nrrd", at("link.nrrd")).expect("a link can be made");
    let input = place.path().display().to_string();
    for (name, option) in [("a.stl", "-o"), ("a.json", "--report"), ("a.html", "-o"), ("link.nrrd", "-o")] {
        let (kept, out) = (at(name), at("out.ply").display().to_string());
        let arguments = ["reconstruct", &input, "-o", &out, option, &kept.display().to_string(), "--backend", "cpu"];
        let result = interslice(&arguments);
        let says = format!("{name}: cannot write: is write-protected, and is not replaced");
        assert!(result.status.code() == Some(2) && stderr(&result).contains(&says), "{}", stderr(&result));
        assert!(!stderr(&result).contains("running on"), "it is refused before the work");
        assert!(fs::read(&kept).expect("it is there") == b"kept" && !at("out.ply").exists());
    }
}

#[test]
fn a_glb_holds_the_mesh() {
    use interslice::surface::mesh::closed_surface;
    let place = folder();
    let stack = cone();
    write(place.path(), &stack, &Settings::default(), OutputOptions::default(), &["left lung.glb"]);
    let mesh = closed_surface(&collected(&stack, &Settings::default()));
    let bytes = fs::read(place.path().join("left lung.glb")).expect("it was written");
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize;
    assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
    let json = word(12);
    let root = gltf_json::Root::from_slice(&bytes[20..20 + json]).expect("it is glTF");
    let mut wrong = Vec::new();
    gltf_json::validation::Validate::validate(&root, &root, gltf_json::Path::new, &mut |path, error| {
        wrong.push((path().to_string(), error.to_string()));
    });
    assert!(wrong.is_empty(), "{wrong:?}");
    assert_eq!(root.meshes[0].name.as_deref(), Some("left lung"));
    let extras = root.meshes[0].extras.as_ref().expect("the unit is told").get();
    assert!(extras.contains(r#""unit":"#) && extras.contains("left-posterior-superior"), "{extras}");
    let data = &bytes[28 + json..];
    assert_eq!(word(20 + json), data.len());
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    assert_eq!(data.len(), 24 * vertices + 12 * triangles);
    for (p, b) in mesh.positions.iter().zip(data.as_chunks::<12>().0) {
        assert_eq!(p.as_vec3().to_array().map(f32::to_le_bytes).as_flattened(), b);
    }
    let corners = data[24 * vertices..].as_chunks::<12>().0;
    for (t, b) in mesh.triangles.iter().zip(corners) {
        assert_eq!(t.map(u32::to_le_bytes).as_flattened(), b);
    }
}

#[cfg(feature = "simplify")]
mod simplify {
    use interslice::surface::mesh::{Mesh, closed_surface};
    use interslice::surface::simplify::{TriangleTree, simplified};
    use interslice::surface::stream::LayerSink;

    use super::*;
    use crate::support::{edge_defects, merged};

    /// Largest distance of random points of `from` to `to`.
    fn farthest(from: &Mesh, to: &Mesh) -> f64 {
        let to = TriangleTree::new(to);
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let corners: Vec<_> = from.corners().collect();
        let points = corners.iter().flat_map(|[a, b, c]| {
            let [u, v] = [random(), random()];
            let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
            [a + u * (b - a) + v * (c - a), *a, a.midpoint(*b)]
        });
        points.map(|p| to.from(p)).fold(0.0, f64::max)
    }

    /// Vertices less edges plus triangles, of a closed mesh.
    fn euler(mesh: &Mesh) -> i64 {
        mesh.positions.len() as i64 - mesh.triangles.len() as i64 / 2
    }

    #[test]
    fn simpler_meshes_are_closed_and_near() {
        // Errors, and parts of the triangles that may be left; fig9 and fig10 have caps, creases and needles.
        let rounds = [
            ("fig5", 0.05, 0.4),
            ("fig6", 0.5, 0.1),
            ("fig9", 0.05, 0.25),
            ("fig9", 0.3, 0.05),
            ("fig10", 0.02, 0.6),
            ("fig10", 1.0, 0.04),
        ];
        for (name, error, share) in rounds {
            let demo = demo(name).expect("a demo");
            let mesh = closed_surface(&collected(&demo.stack, &demo.settings));
            let simpler = simplified(&mesh, error).expect("there is a simpler one");
            let far = [farthest(&mesh, &simpler), farthest(&simpler, &mesh)];
            println!(
                "{name}, {error}: {} of {} triangles, {:.3} and {:.3} away, volume {:+.4} %",
                simpler.triangles.len(),
                mesh.triangles.len(),
                far[0],
                far[1],
                100.0 * (simpler.volume() / mesh.volume() - 1.0)
            );
            assert_eq!(edge_defects(&simpler.triangles), 0, "{name}");
            assert_eq!(edge_defects(&merged(&simpler)), 0, "{name}: after merging equal positions");
            assert_eq!(euler(&simpler), euler(&mesh), "{name}");
            assert!(far[0] <= error && far[1] <= error, "{name}: {far:?} beyond {error}");
            assert!((simpler.triangles.len() as f64) < share * mesh.triangles.len() as f64, "{name}, {error}");
        }
    }

    #[test]
    fn the_simpler_mesh_does_not_depend_on_the_threads() {
        let demo = demo("fig10").expect("a demo");
        let mesh = closed_surface(&collected(&demo.stack, &demo.settings));
        let [one, three] = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| simplified(&mesh, 0.2)).expect("there is a simpler one")
        });
        assert!(one == three);
    }

    #[test]
    fn an_open_mesh_is_not_made_simpler() {
        let demo = demo("fig10").expect("a demo");
        let mut mesh = closed_surface(&collected(&demo.stack, &demo.settings));
        mesh.triangles.swap_remove(1000);
        assert!(simplified(&mesh, 0.5).is_none());
    }

    #[test]
    fn where_nothing_is_simpler_the_whole_mesh_is_written_and_the_report_says_so() {
        let place = folder();
        let heights: Vec<f64> = (0..7).map(f64::from).collect();
        // Rough everywhere, and nothing of it flat: outside along the border and on the first and last layer.
        let rough = |x: f64, y: f64, z: f64| {
            let on_border = [x, y].iter().any(|v| *v == 0.0 || *v == 9.0) || z == 0.0 || z == 6.0;
            let noise = ((12.9898 * x + 78.233 * y + 37.719 * z).sin() * 43758.5453).fract();
            if on_border { 0.6 + 0.3 * noise } else { noise }
        };
        let body = crate::support::body([10, 10], &heights, rough);
        let whole = closed_surface(&body);
        assert!(whole.triangles.len() > 500);
        assert!(simplified(&whole, 1e-9).is_none());
        let targets = ["a.json", "a.stl", "a.ply"].map(|name| place.path().join(name));
        let mut outputs =
            Outputs::open(&targets, None, Temporary::Random, &mut Places::default()).expect("the folder is there");
        let options = OutputOptions { simplify: Some(1e-9), ..OutputOptions::default() };
        let mut sink = outputs.sink(&options);
        sink.begin(&body.header()).expect("it can be written");
        body.layers.iter().try_for_each(|l| sink.layer(l.clone())).expect("it can be written");
        drop(sink);
        let mut report = Report::default();
        outputs.complete(&mut report).expect("it can be written");
        outputs.rename().expect("it can be renamed");
        let stl = fs::read(&targets[1]).expect("written");
        assert_eq!(stl.len(), 84 + 50 * whole.triangles.len());
        let told: Report = serde_json::from_slice(&fs::read(&targets[0]).expect("written")).expect("a report");
        assert_eq!(told.warnings.len(), 1, "{:?}", told.warnings);
        assert!(told.warnings[0].contains("simplify: no closed surface with fewer triangles"), "{:?}", told.warnings);
        assert_eq!(told.warnings, report.warnings);
    }

    #[test]
    fn all_mesh_files_hold_the_same_simpler_mesh() {
        let place = folder();
        let stack = cone();
        let settings = Settings::default();
        let output = OutputOptions { simplify: Some(0.3), ..OutputOptions::default() };
        let report = write(place.path(), &stack, &settings, output, &["a.stl", "a.ply", "a.obj"]);
        let whole = closed_surface(&collected(&stack, &settings));
        assert_eq!(report.volume, Some(whole.volume()), "the report tells of the full one");
        let simpler = simplified(&whole, 0.3).expect("there is a simpler one");
        let stl = fs::read(place.path().join("a.stl")).expect("written");
        assert_eq!(stl.len(), 84 + 50 * simpler.triangles.len());
        let obj = fs::read_to_string(place.path().join("a.obj")).expect("written");
        assert_eq!(obj.lines().filter(|l| l.starts_with("f ")).count(), simpler.triangles.len());
        let ply = fs::read(place.path().join("a.ply")).expect("written");
        let header = String::from_utf8_lossy(&ply[..400]).into_owned();
        assert!(header.contains(&format!("element vertex {}\n", simpler.positions.len())), "{header}");
    }
}
