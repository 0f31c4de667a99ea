//! The page over the jobs of a batch.

use std::fs;
use std::path::Path;

use crate::files::{folder, interslice, listing, sound_stack, stderr};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::json;

/// Three jobs: with a picture, without one, and one whose input cannot be read.
fn manifest(place: &Path) -> String {
    for name in ["good", "bad"] {
        fs::create_dir(place.join(name)).expect("a folder can be made");
        sound_stack(&place.join(name));
    }
    let broken = fs::read_dir(place.join("bad")).expect("a folder").map(|e| e.expect("an entry").path());
    let picture = broken.into_iter().find(|p| p.extension().is_some_and(|e| e == "png")).expect("a slice");
    fs::write(picture, "no picture").expect("a file can be written");
    let jobs = [
        json!({"id": "<b>one</b>", "input": "good", "outputs": ["out/a b.png", "out/a.stl"]}),
        json!({"id": "two", "input": "good", "outputs": ["out/two.nrrd", "out/two.json"]}),
        json!({"id": "three", "input": "bad", "outputs": ["out/three.stl"]}),
    ];
    let path = place.join("jobs.jsonl");
    fs::write(&path, jobs.map(|job| format!("{job}\n")).concat()).expect("a file can be written");
    path.display().to_string()
}

#[test]
fn a_page_has_every_job_with_volume_status_and_picture() {
    let place = folder();
    let manifest = manifest(place.path());
    let page = place.path().join("index.html");
    let run = ["batch", &manifest, "--index", page.to_str().expect("a name"), "-q", "--backend", "cpu"];
    for again in [false, true] {
        let output = interslice(&run);
        assert_eq!(output.status.code(), Some(1), "one job fails: {}", stderr(&output));
        let text = fs::read_to_string(&page).expect("there is a page");
        let rows: Vec<&str> = text.split("<tr>").filter(|row| row.contains("class=\"picture\"")).collect();
        assert_eq!(rows.len(), 3, "{again}");
        let [one, two, three] = rows[..] else { panic!("three") };
        assert!(text.contains("3 jobs: 2 done, 1 failed"), "{text}");
        assert!(one.contains("&lt;b&gt;one&lt;/b&gt;") && !text.contains("<b>one"), "{one}");
        assert!(one.contains("src=\"data:image/png;base64,") && one.contains("href=\"out/a%20b.png\""));
        assert!(one.contains(" mm³") && one.contains(", all met"), "{one}");
        assert!(two.contains("src=\"data:image/png;base64,") && !two.contains("png\">"), "{two}");
        assert!(two.contains(" mm³") && two.contains(" mm²"), "{two}");
        assert!(three.contains(">failed<") && three.contains("slice 0") && !three.contains("href"), "{three}");
        assert!(!text.contains("http"), "it needs no network");
        assert!(!listing(place.path()).iter().any(|p| p.extension().is_some_and(|e| e == "tmp")));
    }
}

/// Each row's picture as base64, where it has one.
fn pictures(page: &Path) -> Vec<Option<String>> {
    let text = fs::read_to_string(page).expect("there is a page");
    let rows = text.split("<tr>").filter(|row| row.contains("class=\"picture\""));
    rows.map(|row| Some(row.split_once("base64,")?.1.split_once('"')?.0.to_string())).collect()
}

#[test]
fn a_picture_costs_no_byte_of_the_outputs_and_outlives_the_run() {
    let (plain, place) = (folder(), folder());
    let outputs =
        |place: &Path| ["out/two.nrrd", "out/two.json"].map(|name| fs::read(place.join(name)).expect("written"));
    let run = |place: &Path, options: &[&str]| {
        let jobs = place.join("jobs.jsonl");
        let jobs = jobs.to_str().expect("a name");
        let output = interslice(&[&["batch", jobs, "-q", "--backend", "cpu"], options].concat());
        assert_eq!(output.status.code(), Some(1), "one job fails: {}", stderr(&output));
    };
    manifest(plain.path());
    run(plain.path(), &[]);
    let page = plain.path().join("index.html");
    run(plain.path(), &["--index", page.to_str().expect("a name")]);
    let text = fs::read_to_string(&page).expect("there is a page");
    assert!(text.contains("no picture: finished before") && text.contains("not measured"), "what is finished stays so");
    assert!(matches!(&pictures(&page)[..], [Some(_), None, None]));

    manifest(place.path());
    let page = place.path().join("index.html");
    run(place.path(), &["--index", page.to_str().expect("a name")]);
    // The report names its input, which lies elsewhere.
    let named = |bytes: &[u8], place: &Path| String::from_utf8_lossy(bytes).replace(&place.display().to_string(), "");
    let ([volume, report], [alone, its]) = (outputs(place.path()), outputs(plain.path()));
    assert!(volume == alone && named(&report, place.path()) == named(&its, plain.path()));

    let first = pictures(&page);
    let [Some(own), Some(made), None] = &first[..] else { panic!("two have pictures") };
    // The same body, once in small from its PNG and once drawn in small.
    let pixels = |base64: &str| {
        let bytes = STANDARD.decode(base64).expect("base64");
        image::load_from_memory(&bytes).expect("a picture").to_rgb8()
    };
    let (own, made) = (pixels(own), pixels(made));
    assert_eq!(own.dimensions(), made.dimensions());
    let off = own.as_raw().iter().zip(made.as_raw()).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>();
    let spread = own.as_raw().iter().map(|a| f64::from(a.abs_diff(own.as_raw()[0]))).sum::<f64>();
    assert!(off < 0.1 * spread, "{off} of {spread}");
    fs::remove_file(&page).expect("it can go");
    run(place.path(), &["--index", page.to_str().expect("a name")]);
    assert_eq!(pictures(&page), first, "those of finished jobs are kept");
}

#[test]
fn a_page_takes_nobodys_place() {
    let place = folder();
    let manifest = manifest(place.path());
    fs::write(place.path().join("of_another.json"), "{}").expect("a file can be written");
    for (name, says) in [
        ("out/a.stl", "give the output a name"),
        ("jobs.jsonl", "is the manifest"),
        ("none/x.html", "there is no folder"),
        ("of_another.json", "is no page; expected .html"),
    ] {
        let page = place.path().join(name);
        let output = interslice(&["batch", &manifest, "--index", page.to_str().expect("a name"), "-q"]);
        assert!(output.status.code() == Some(2) && stderr(&output).contains(says), "{name}: {}", stderr(&output));
    }
    assert!(!place.path().join("out").exists(), "no job has run");
    assert_eq!(fs::read(place.path().join("of_another.json")).expect("it is there"), b"{}");
}
