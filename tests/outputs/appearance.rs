//! Names and colours of labels and ROIs, from the input to meshes and volumes.

use std::fs;
use std::path::Path;

use crate::files::*;
use glam::DVec3;
use gltf_json::Root;
use gltf_json::validation::Validate;

const SIZES: [usize; 3] = [48, 24, 9];

/// Labels 3, 7 and 12 as boxes on every fourth slice; `named` are the file's segments.
fn write(path: &Path, named: &str) {
    let [nx, ny, nz] = SIZES;
    let at = |n: usize| {
        let (i, j, k) = (n % nx, n / nx % ny, n / (nx * ny));
        let within = k % 4 == 0 && (6..18).contains(&j) && (4..44).contains(&i);
        if within { [3, 7, 12][(i - 4) * 3 / 40] } else { 0 }
    };
    let voxels: Vec<u8> = (0..nx * ny * nz).map(at).collect();
    fs::write(path, nrrd(&format!("encoding: raw\n{named}"), "uint8", SIZES, &voxels)).expect("a file can be written");
}

const NAMED: &str = "Segment0_LabelValue:=7\nSegment0_Name:=left lung\nSegment0_Color:=1 0 0.2\n\
                     Segment1_LabelValue:=3\nSegment1_Name:=heart\nSegment2_LabelValue:=99\nSegment2_Name:=none such";

fn done(arguments: &[&str]) -> String {
    let result = interslice(&[arguments, &["--backend", "cpu"]].concat());
    assert_eq!(result.status.code(), Some(0), "{arguments:?}: {}", stderr(&result));
    stderr(&result)
}

/// A mesh of a file: its name, its number, its colour, and the file's bytes of it.
#[derive(Debug, PartialEq)]
struct Body {
    name: String,
    number: Option<i64>,
    colour: [f32; 4],
    data: Vec<u8>,
}

/// What is in a sound `.glb`.
fn bodies(path: &Path) -> Vec<Body> {
    let bytes = fs::read(path).expect("it was written");
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize;
    let json = word(12);
    let root = Root::from_slice(&bytes[20..20 + json]).expect("it is glTF");
    root.validate(&root, gltf_json::Path::new, &mut |path, error| panic!("{}: {error}", path()));
    let data = &bytes[28 + json..];
    assert_eq!([word(8), word(20 + json)], [bytes.len(), data.len()]);
    assert_eq!(root.scenes[0].nodes.len(), root.meshes.len());
    let body = |node: &gltf_json::Node| {
        let mesh = &root.meshes[node.mesh.expect("a mesh").value()];
        let primitive = &mesh.primitives[0];
        let material = &root.materials[primitive.material.expect("a material").value()];
        let accessors = primitive.attributes.values().chain(&primitive.indices);
        let mut views: Vec<[usize; 2]> = accessors
            .map(|a| {
                let view = root.accessors[a.value()].buffer_view.expect("a view").value();
                let view = &root.buffer_views[view];
                let start = view.byte_offset.map_or(0, |o| o.0 as usize);
                [start, start + view.byte_length.0 as usize]
            })
            .collect();
        views.sort_unstable();
        assert!(views.windows(2).all(|w| w[0][1] == w[1][0]), "{views:?}");
        let extras: serde_json::Value =
            serde_json::from_str(mesh.extras.as_ref().expect("unit and space").get()).expect("JSON");
        Body {
            name: node.name.clone().expect("a name"),
            number: extras["number"].as_i64(),
            colour: material.pbr_metallic_roughness.base_color_factor.0,
            data: data[views[0][0]..views[2][1]].to_vec(),
        }
    };
    let bodies: Vec<Body> = root.nodes.iter().map(body).collect();
    assert_eq!(bodies.iter().map(|b| b.data.len()).sum::<usize>(), data.len());
    bodies
}

#[test]
fn a_scene_has_every_label_with_its_name_and_colour() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    write(Path::new(&at("in.seg.nrrd")), NAMED);
    let (scene, volume) = (at("all.glb"), at("all.nrrd"));
    done(&["reconstruct", &at("in.seg.nrrd"), "--labels", "all", "-o", &scene, "-o", &volume, "-q"]);
    assert_eq!(listing(place.path()), ["all.glb", "all.nrrd", "in.seg.nrrd"].map(|n| place.path().join(n)));
    let all = bodies(Path::new(&scene));
    let told: Vec<_> = all.iter().map(|b| (b.name.as_str(), b.number)).collect();
    assert_eq!(told, [("heart", Some(3)), ("left lung", Some(7)), ("label 12", Some(12))]);
    let [r, g, b, a] = all[1].colour;
    // The share 0.2 of sRGB is 0.0331 of light.
    assert!([r, g, a] == [1.0, 0.0, 1.0] && (b - 0.0331).abs() < 1e-3, "{:?}", all[1].colour);
    assert!(all[0].colour != all[2].colour, "labels without colour have one of their own");

    // One label alone has its name too, and where nothing is said the file's.
    done(&["reconstruct", &at("in.seg.nrrd"), "--label", "7", "-o", &at("one.glb"), "-q"]);
    done(&["reconstruct", &at("in.seg.nrrd"), "-o", &at("any.glb"), "-q"]);
    assert_eq!(bodies(Path::new(&at("one.glb")))[0].name, "left lung");
    let any = bodies(Path::new(&at("any.glb")));
    assert_eq!((any.len(), any[0].name.as_str(), any[0].number), (1, "any", None));

    // Kept apart, a label's mesh is the one it has alone.
    done(&["reconstruct", &at("in.seg.nrrd"), "--labels", "7", "--keep-overlaps", "-o", &scene, "-q"]);
    assert_eq!(bodies(Path::new(&scene)), bodies(Path::new(&at("one.glb"))));

    // The volume says the same again.
    let told = interslice(&["inspect", &volume]);
    let told = String::from_utf8_lossy(&told.stdout).into_owned();
    ["3 `heart` (", "7 `left lung` (", " 12 `12` ("].iter().for_each(|w| assert!(told.contains(w), "{told}"));
    done(&["reconstruct", &volume, "--label", "7", "--keep", "4", "-o", &at("again.glb"), "-q"]);
    let again = bodies(Path::new(&at("again.glb")));
    assert_eq!((&again[0].name, again[0].colour), (&all[1].name, all[1].colour));
}

/// The one node at the top of a scene, and what the scene says of itself.
fn top(path: &Path) -> (gltf_json::Node, serde_json::Value) {
    let bytes = fs::read(path).expect("it was written");
    let json = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
    let root = Root::from_slice(&bytes[20..20 + json]).expect("it is glTF");
    root.validate(&root, gltf_json::Path::new, &mut |path, error| panic!("{}: {error}", path()));
    let [node] = &root.scenes[0].nodes[..] else { panic!("one node carries all") };
    let extras = root.scenes[0].extras.as_ref().expect("unit and space").get();
    (root.nodes[node.value()].clone(), serde_json::from_str(extras).expect("JSON"))
}

#[test]
fn a_scene_is_in_metres_with_y_upwards_where_that_is_asked_for() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let in_unit = |unit: &str| {
        let directions = "space directions: (1,0,0) (0,1,0) (0,0,1)";
        format!("space: left-posterior-superior\n{directions}\nspace units: \"{unit}\" \"{unit}\" \"{unit}\"")
    };
    write(Path::new(&at("in.nrrd")), &in_unit("mm"));
    let (plain, turned, alone) = (at("plain.glb"), at("turned.glb"), at("alone.glb"));
    let run = |more: &[&str]| done(&[&["reconstruct", &at("in.nrrd"), "-q"], more].concat());
    run(&["--labels", "all", "-o", &plain]);
    run(&["--labels", "all", "-o", &turned, "--units", "m", "--y-up"]);
    run(&["--label", "7", "-o", &alone, "--units", "m"]);
    let (node, said) = top(Path::new(&turned));
    assert_eq!(said, serde_json::json!({"unit": "m", "space": "left-superior-anterior"}));
    assert_eq!((node.mesh, node.children.map(|c| c.len()), node.scale), (None, Some(3), Some([0.001; 3])));
    let [x, y, z, w] = node.rotation.expect("it is turned").0.map(f64::from);
    // What is superior points up, what is posterior away from the viewer.
    let turn = glam::DQuat::from_xyzw(x, y, z, w);
    for (from, to) in [(DVec3::X, DVec3::X), (DVec3::Z, DVec3::Y), (DVec3::Y, DVec3::NEG_Z)] {
        assert!((turn * from - to).length() < 1e-6, "{from}");
    }
    let (node, said) = top(Path::new(&alone));
    assert_eq!((node.scale, node.rotation.is_none()), (Some([0.001; 3]), true));
    assert_eq!(said, serde_json::json!({"unit": "m", "space": "left-posterior-superior"}));
    // The bodies' own numbers stay.
    let data = |path: &str| {
        let bytes = fs::read(path).expect("it was written");
        bytes[28 + u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize..].to_vec()
    };
    assert!(data(&plain) == data(&turned));

    // Nobody knows how long a pixel is.
    write(Path::new(&at("in.nrrd")), &in_unit("px"));
    let wrong = interslice(&["reconstruct", &at("in.nrrd"), "--labels", "all", "-o", &at("px.glb"), "--units", "m"]);
    assert_eq!(wrong.status.code(), Some(2));
    let said = stderr(&wrong);
    assert!(
        said.contains("`units` m is not known of an input in px; units with a length are um, mm, cm, m, in, ft"),
        "{said}"
    );
    assert!(!Path::new(&at("px.glb")).exists());
}

#[test]
fn a_scene_is_refused_before_anything_runs_where_it_cannot_be_written() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    write(Path::new(&at("in.nrrd")), "# no segments");
    fs::create_dir(at("folder.glb")).expect("a folder can be made");
    let before = listing(place.path());
    for (names, words) in [
        (["folder.glb", "b.glb"], "is a folder"),
        (["a.glb", "a.glb"], "is named twice"),
        (["nowhere/a.glb", "b.glb"], "there is no folder"),
    ] {
        let [first, second] = names.map(at);
        let wrong = interslice(&["reconstruct", &at("in.nrrd"), "--labels", "all", "-o", &first, "-o", &second]);
        assert_eq!(wrong.status.code(), Some(2), "{}", stderr(&wrong));
        assert!(stderr(&wrong).contains(words), "{}", stderr(&wrong));
        assert_eq!(listing(place.path()), before);
    }
}

#[cfg(feature = "dicom")]
#[test]
fn a_scene_has_every_roi_with_its_name_and_colour() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let planes = [0.0, 3.0, 6.0];
    let rois =
        [("Heart", crate::rtss::tube(12.0, &planes)), ("Cord ", crate::rtss::tube(4.0, &planes)), ("", Vec::new())];
    crate::rtss::write(&rois, Path::new(&at("in.dcm")));
    let (scene, apart) = (at("all.glb"), at("each.stl"));
    done(&["reconstruct", &at("in.dcm"), "--all-rois", "-o", &scene, "-o", &apart, "-q"]);
    let names = ["all.glb", "each.Cord.stl", "each.Heart.stl", "in.dcm"];
    assert_eq!(listing(place.path()), names.map(|n| place.path().join(n)));
    let all = bodies(Path::new(&scene));
    let told: Vec<_> = all.iter().map(|b| (b.name.as_str(), b.number)).collect();
    assert_eq!(told, [("Heart", Some(1)), ("Cord", Some(2))]);
    // sRGB 200, 10, 30 and 200, 20, 30 as light.
    for (body, green) in all.iter().zip([0.00304, 0.00700]) {
        let [r, g, b, _] = body.colour;
        let near = |v: f32, wanted: f32| (v - wanted).abs() < 1e-4;
        assert!(near(r, 0.57758) && near(g, green) && near(b, 0.01298), "{:?}", body.colour);
    }
    done(&["reconstruct", &at("in.dcm"), "--roi", "Cord", "-o", &at("one.glb"), "-q"]);
    assert_eq!(bodies(Path::new(&at("one.glb"))), all[1..]);
    done(&["reconstruct", &at("in.dcm"), "--roi", "1", "--roi", "2", "-o", &at("both.glb"), "-q"]);
    let both = bodies(Path::new(&at("both.glb")));
    assert_eq!((both[0].name.as_str(), both[0].number, both[0].colour), ("Heart + Cord", None, all[0].colour));
}

#[test]
fn a_merged_run_has_the_names_of_a_whole_one() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    write(Path::new(&at("in.nrrd")), NAMED);
    let input = ["in.nrrd", "--label", "7"].map(|a| if a == "in.nrrd" { at(a) } else { a.into() });
    let input = input.each_ref().map(String::as_str);
    done(&[&["reconstruct"], &input[..], &["-o", &at("whole.glb"), "-q"]].concat());
    let parts = ["1/2", "2/2"].map(|part| {
        let target = at(&format!("{}.section", &part[..1]));
        done(&[&["run"], &input[..], &["--part", part, "-o", &target, "-q"]].concat());
        target
    });
    let merged = interslice(&["merge", &parts[0], &parts[1], "-o", &at("merged.glb"), "-q"]);
    assert_eq!(merged.status.code(), Some(0), "{}", stderr(&merged));
    let bytes = |name: &str| fs::read(at(name)).expect("it was written");
    assert!(bytes("whole.glb") == bytes("merged.glb"));
    assert_eq!(bodies(Path::new(&at("merged.glb")))[0].name, "left lung");
}
