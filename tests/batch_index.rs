//! The page over the jobs of a batch.

#[path = "support/files.rs"]
mod files;

use std::fs;
use std::path::Path;

use files::{folder, interslice, listing, sound_stack, stderr};
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
        json!({"id": "two", "input": "good", "outputs": ["out/two.nrrd"]}),
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
        assert!(two.contains("no picture among the outputs") && two.contains("not measured"), "{two}");
        assert!(three.contains(">failed<") && three.contains("slice 0") && !three.contains("href"), "{three}");
        assert!(!text.contains("http"), "it needs no network");
        assert!(!listing(place.path()).iter().any(|p| p.extension().is_some_and(|e| e == "tmp")));
    }
}

#[test]
fn a_page_takes_nobodys_place() {
    let place = folder();
    let manifest = manifest(place.path());
    for (name, says) in
        [("out/a.stl", "give the output a name"), ("jobs.jsonl", "is the manifest"), ("none/x.html", "in folder")]
    {
        let page = place.path().join(name);
        let output = interslice(&["batch", &manifest, "--index", page.to_str().expect("a name"), "-q"]);
        assert!(output.status.code() == Some(2) && stderr(&output).contains(says), "{name}: {}", stderr(&output));
    }
    assert!(!place.path().join("out").exists(), "no job has run");
}
