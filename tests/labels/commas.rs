//! Segments whose names have commas.

use std::fs;
use std::path::Path;

use crate::files::*;
use crate::segments::{HEADER, layered, refused, write};
use interslice::input::labels::{Wanted, read_labels};
use interslice::stack::ReadOptions;

#[test]
fn a_name_in_a_list_may_have_a_comma() {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    write(&at("a.seg.nrrd"), &layered(&HEADER.replace("Name:=Liver", "Name:=Liver, left")));
    let line = serde_json::json!({"id": "a", "input": "a.seg.nrrd", "outputs": ["a.json"],
        "options": {"labels": ["Liver, left", 3], "keep_overlaps": true}});
    write(&at("m.jsonl"), line.to_string().as_bytes());
    let result = interslice(&["batch", &at("m.jsonl").display().to_string(), "--backend", "cpu"]);
    assert!(result.status.success(), "{}", stderr(&result));
    assert!(at("a.1.json").is_file() && at("a.3.json").is_file() && !at("a.2.json").exists());
}

/// On the command line commas part names, and one may belong to a name; where both may be meant numbers tell.
#[test]
fn a_name_with_a_comma_is_chosen_beside_others() {
    let place = folder();
    let at = |name: &str| place.path().join(name).display().to_string();
    let header = HEADER.replace("Name:=Liver", "Name:=Liver, left").replace("Name:=Spleen", "Name:=Liver, left,old");
    write(&place.path().join("a.seg.nrrd"), &layered(&header));
    let labels_of = |names: &str| {
        let wanted = names.parse::<Wanted>().expect("names");
        read_labels(Path::new(&at("a.seg.nrrd")), &ReadOptions::default(), &wanted).map(|stack| stack.labels)
    };
    for (names, labels) in [
        ("Liver, left", &[1][..]),
        ("Liver, left,Cyst", &[1, 2]),
        ("cyst,liver, LEFT", &[1, 2]),
        ("2,Liver, left", &[1, 2]),
        ("Liver, left,old", &[3]),
        ("Liver, left,old,Liver, left", &[1, 3]),
    ] {
        assert_eq!(labels_of(names).expect(names), labels, "{names}");
    }
    let run = ["reconstruct", &at("a.seg.nrrd"), "--labels", "Liver, left,2", "-o", &at("a.stl"), "-o", &at("a.glb")];
    let result = interslice(&run);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    let scene = String::from_utf8_lossy(&fs::read(at("a.glb")).expect("it was written")).into_owned();
    assert!(scene.contains(r#""name":"Liver, left""#) && scene.contains(r#""name":"Cyst""#));
    assert!(Path::new(&at("a.1.stl")).is_file() && Path::new(&at("a.2.stl")).is_file());
    refused(
        &["reconstruct", &at("a.seg.nrrd"), "--labels", "Liver, right", "-o", &at("a.stl")],
        &["`labels` must name one of the file's labels; got `Liver`", "1 `Liver, left`"],
    );
    // One label, or two.
    let header = HEADER.replace("Name:=Spleen", "Name:=Liver,Cyst");
    write(&place.path().join("a.seg.nrrd"), &layered(&header));
    refused(
        &["reconstruct", &at("a.seg.nrrd"), "--labels", "Liver,Cyst", "-o", &at("a.stl")],
        &["`labels` is `Liver,Cyst`, which can be read in several ways", "by their numbers", "3 `Liver,Cyst`"],
    );
    assert_eq!(labels_of("1,2").expect("numbers"), [1, 2]);
}
