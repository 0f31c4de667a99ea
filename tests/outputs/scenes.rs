//! Files that hold all bodies of a run: `.3mf` and `.groups.obj` have each body's own mesh, with its name and colour.

use std::fs::{self, File};
use std::io::Read;

use crate::files::*;
use quick_xml::Reader;
use quick_xml::events::Event;

/// A body of a file.
#[derive(Debug, Default, PartialEq)]
struct Body {
    name: String,
    number: Option<String>,
    colour: Option<String>,
    points: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

fn numbers<T: std::str::FromStr>(words: impl Iterator<Item = String>) -> [T; 3] {
    let all: Vec<T> = words.map(|w| w.parse().ok().expect("a number")).collect();
    all.try_into().ok().expect("three numbers")
}

/// The unit and the bodies of a `.3mf`, as they are built.
fn three_mf(path: &str) -> (String, Vec<Body>) {
    let mut archive = zip::ZipArchive::new(File::open(path).expect("it was written")).expect("an archive");
    let names: Vec<String> = archive.file_names().map(|n| n.expect("a name").into_owned()).collect();
    assert_eq!(names, ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]);
    let mut text = String::new();
    archive.by_name("3D/3dmodel.model").expect("a model").read_to_string(&mut text).expect("text");
    let (mut unit, mut colours, mut bodies, mut built) = (String::new(), Vec::new(), Vec::<Body>::new(), Vec::new());
    let mut reader = Reader::from_str(&text);
    loop {
        let (Event::Start(tag) | Event::Empty(tag)) = (match reader.read_event().expect("XML") {
            Event::Eof => break,
            event @ (Event::Start(_) | Event::Empty(_)) => event,
            _ => continue,
        }) else {
            unreachable!()
        };
        let of = |key: &str| -> Option<String> {
            let found = tag.attributes().map(|a| a.expect("an attribute")).find(|a| a.key.as_ref() == key)?;
            let value = found.value.into_owned();
            Some(quick_xml::escape::unescape(&value).expect("escaped").into_owned())
        };
        let must = |key: &str| of(key).unwrap_or_else(|| panic!("{key}"));
        match tag.name().as_ref() {
            "model" => unit = must("unit"),
            "base" => colours.push([must("name"), must("displaycolor")]),
            "object" => {
                let [name, colour] = colours[must("pindex").parse::<usize>().expect("a number")].clone();
                assert_eq!((name, must("id")), (must("name"), (bodies.len() + 2).to_string()));
                let colour = Some(colour);
                bodies.push(Body { name: must("name"), number: of("partnumber"), colour, ..Body::default() });
            }
            "vertex" => {
                bodies.last_mut().expect("an object").points.push(numbers(["x", "y", "z"].into_iter().map(must)));
            }
            "triangle" => {
                let corners = numbers(["v1", "v2", "v3"].into_iter().map(must));
                bodies.last_mut().expect("an object").triangles.push(corners);
            }
            "item" => built.push(must("objectid")),
            _ => {}
        }
    }
    assert_eq!(built, (2..bodies.len() + 2).map(|n| n.to_string()).collect::<Vec<_>>());
    (unit, bodies)
}

/// The groups of an `.obj`; each has the vertices that stand behind its name.
fn groups(path: &str) -> Vec<Body> {
    let (mut bodies, mut before) = (Vec::<Body>::new(), 0);
    for line in fs::read_to_string(path).expect("it was written").lines() {
        let (word, rest) = line.split_once(' ').expect("two words");
        let rest = rest.split(' ').map(|w| w.split('/').next().expect("a word").to_string());
        match word {
            "g" => {
                before += bodies.last().map_or(0, |b| b.points.len() as u32);
                bodies.push(Body { name: rest.collect::<Vec<_>>().join(" "), ..Body::default() });
            }
            "v" => bodies.last_mut().expect("a group").points.push(numbers(rest)),
            "f" => {
                let corners: [u32; 3] = numbers(rest);
                bodies.last_mut().expect("a group").triangles.push(corners.map(|v| v - 1 - before));
            }
            _ => {}
        }
    }
    bodies
}

const SIZES: [usize; 3] = [40, 24, 9];

/// Boxes 3, 7 and 12 on every fourth slice, far from the origin; 3 and 12 have one name.
fn given(unit: &str) -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let at = |n: usize| {
        let (i, j, k) = (n % nx, n / nx % ny, n / (nx * ny));
        if k % 4 == 0 && (6..18).contains(&j) && (5..35).contains(&i) { [3, 7, 12][(i - 5) / 10] } else { 0 }
    };
    let voxels: Vec<u8> = (0..nx * ny * nz).map(at).collect();
    let fields = format!(
        "encoding: raw\nspace: left-posterior-superior\nspace directions: (0.1,0,0) (0,0.1,0) (0,0,0.1)\n\
         space origin: (500000.1,5400000.7,-3)\nspace units: \"{unit}\" \"{unit}\" \"{unit}\"\n\
         Segment0_LabelValue:=7\nSegment0_Name:=left <lung> & co\nSegment0_Color:=1 0 0.2\n\
         Segment1_LabelValue:=3\nSegment1_Name:=rib\nSegment2_LabelValue:=12\nSegment2_Name:=rib"
    );
    nrrd(&fields, "uint8", SIZES, &voxels)
}

#[test]
fn every_body_is_an_object_or_a_group_with_its_own_closed_mesh() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let run = |outputs: &[&str]| {
        let mut arguments = vec!["reconstruct".to_string(), at("in.nrrd"), "--backend".into(), "cpu".into()];
        outputs.iter().for_each(|o| arguments.extend(["-o".to_string(), at(o)]));
        arguments
    };
    let done = |arguments: Vec<String>| {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let result = interslice(&arguments);
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        stderr(&result)
    };
    fs::write(at("in.nrrd"), given("cm")).expect("a file can be written");
    let mut all = run(&["all.3mf", "all.groups.obj", "each.obj"]);
    all.extend(["--labels".into(), "all".into()]);
    let said = done(all.clone());
    assert!(!said.contains("3MF does not know"), "{said}");
    let (unit, bodies) = three_mf(&at("all.3mf"));
    assert_eq!(unit, "centimeter");
    let told: Vec<_> = bodies.iter().map(|b| (b.name.as_str(), b.number.as_deref())).collect();
    assert_eq!(told, [("rib", Some("3")), ("left <lung> & co", Some("7")), ("rib", Some("12"))]);
    assert_eq!(bodies[1].colour.as_deref(), Some("#FF0033"));
    assert!(bodies[0].colour != bodies[2].colour, "labels without colour have one of their own");
    let grouped = groups(&at("all.groups.obj"));
    let names: Vec<_> = grouped.iter().map(|b| b.name.as_str()).collect();
    assert_eq!(names, ["rib", "left_<lung>_&_co", "rib_2"]);
    for ((body, group), label) in bodies.iter().zip(&grouped).zip([3, 7, 12]) {
        let text = fs::read_to_string(at(&format!("each.{label}.obj"))).expect("it was written");
        fs::write(at("one.obj"), format!("g one\n{text}")).expect("a file can be written");
        let alone = groups(&at("one.obj")).remove(0);
        assert!(alone.points.len() > 100 && alone.points[0][0] > 5e5 && alone.points[0][1] > 5.4e6, "{label}");
        for (what, found) in [("3mf", body), ("obj", group)] {
            assert!(found.points == alone.points && found.triangles == alone.triangles, "{label}, {what}");
        }
        assert_eq!(crate::support::edge_defects(&body.triangles), 0, "{label}");
    }

    // One body has its file's name; a unit that 3MF does not know is told.
    fs::write(at("in.nrrd"), given("px")).expect("a file can be written");
    let mut one = run(&["knee bone.3mf", "knee bone.groups.obj"]);
    one.extend(["--label".into(), "12".into(), "--simplify".into(), "0.01".into()]);
    one.truncate(if cfg!(feature = "simplify") { one.len() } else { one.len() - 2 });
    let said = done(one);
    assert!(said.contains("3MF does not know the unit px: 1 px is written as 1 millimeter"), "{said}");
    let (unit, bodies) = three_mf(&at("knee bone.3mf"));
    assert_eq!((unit.as_str(), bodies.len(), bodies[0].name.as_str()), ("millimeter", 1, "rib"));
    assert_eq!(crate::support::edge_defects(&bodies[0].triangles), 0);
    assert_eq!(groups(&at("knee bone.groups.obj"))[0].name, "rib");
}
