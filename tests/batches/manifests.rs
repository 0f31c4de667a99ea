//! Batches as a user meets them: manifests, what is run and what is skipped, results, several processes.

use std::fs;
use std::path::Path;

use crate::cases::*;
use crate::files::*;
use serde_json::{Value, json};

/// Runs and expects all jobs done.
fn all_done(place: &Path, more: &[&str]) -> String {
    let result = batch(place, more);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    stderr(&result)
}

/// Lines of an existing manifest.
fn manifest(place: &Path) -> Vec<Value> {
    let text = fs::read_to_string(place.join("manifest.jsonl")).expect("it is there");
    text.lines().map(|l| serde_json::from_str(l).expect("it is JSON")).collect()
}

/// Whether a job is finished, by `--dry-run`.
fn finished(place: &Path) -> Vec<bool> {
    let result = batch(place, &["--dry-run"]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    String::from_utf8_lossy(&result.stdout).lines().map(|l| l.starts_with("finished ")).collect()
}

#[test]
fn a_batch_makes_what_single_runs_make_however_many_at_once() {
    let place = folder();
    let ids = cases(place.path(), 5);
    let mut lines = manifest(place.path());
    lines[2]["options"] = json!({"end_top": "extrapolate", "fair": 0.5, "dz": 2});
    lines[3]["options"] = json!({"fair": 0.25, "preset": "fast"});
    write_manifest(place.path(), &lines);
    all_done(place.path(), &["--jobs", "1"]);
    let one = outputs(place.path());
    assert_eq!(one.len(), 3 * ids.len(), "{:?}", one.keys());
    let by_options: [(&str, &[&str]); 3] = [
        ("case01", &[]),
        ("case02", &["--end-top=extrapolate", "--fair=0.5", "--dz=2"]),
        ("case03", &["--method=field", "--fair=0.25"]),
    ];
    for (id, options) in by_options {
        assert!(one[&format!("{id}.stl")] == alone(place.path(), id, options), "{id} differs from a single run");
    }
    assert!(one["case00.stl"] != one["case01.stl"], "the cases differ");
    let report: Value = serde_json::from_slice(&one["case02.json"]).expect("JSON");
    assert_eq!(report["settings"]["end_top"], "extrapolate");
    for line in results(place.path()) {
        assert_eq!(line["status"], "done");
        assert_eq!(line["certificate"]["differing_pixels"], 0);
        assert_eq!(line["certificate"]["contours"], 3);
        assert!(line["certificate"]["volume"].as_f64().is_some_and(|v| v > 500.0), "{line}");
        assert!(line["seconds"].as_f64().is_some_and(|s| s > 0.0), "{line}");
    }
    fs::remove_dir_all(place.path().join("out")).expect("it is there");
    fs::remove_file(place.path().join("results.jsonl")).expect("it is there");
    all_done(place.path(), &["--jobs", "7", "--threads", "2"]);
    same(&one, &outputs(place.path()));
    assert_eq!(done(place.path()).len(), ids.len());
}

#[test]
fn results_take_nobodys_place() {
    let place = folder();
    cases(place.path(), 1);
    let kept = place.path().join("kept.dcm");
    fs::write(&kept, b"a volume\n and its last line").expect("a file can be written");
    for more in [&[][..], &["--dry-run"]] {
        let name = kept.display().to_string();
        let refused = batch(place.path(), &[&["--results", &name], more].concat());
        let says = stderr(&refused);
        assert!(refused.status.code() == Some(2) && says.contains("kept.dcm") && says.contains("no results"), "{says}");
    }
    assert_eq!(fs::read(&kept).expect("it is there"), b"a volume\n and its last line");
    let names = ["cases", "kept.dcm", "manifest.jsonl"].map(|name| place.path().join(name));
    assert_eq!(listing(place.path()), names);
}

#[test]
fn what_has_not_changed_is_skipped_and_what_has_is_made_again() {
    let place = folder();
    let ids = cases(place.path(), 4);
    assert_eq!(finished(place.path()), [false; 4]);
    all_done(place.path(), &[]);
    let first = outputs(place.path());
    assert_eq!(finished(place.path()), [true; 4]);
    assert!(all_done(place.path(), &[]).contains("0 done, 4 finished before"));
    assert_eq!(results(place.path()).len(), 4, "nothing was run again");

    // An input, by content and not by name or time.
    let changed = slice(place.path(), &ids[1]);
    let before = fs::read(&changed).expect("it is there");
    fs::write(&changed, &before).expect("a file can be written");
    let moved = place.path().join("cases/elsewhere");
    fs::rename(place.path().join("cases").join(&ids[3]), &moved).expect("a folder can be renamed");
    let mut lines = manifest(place.path());
    lines[3]["input"] = "cases/elsewhere".into();
    write_manifest(place.path(), &lines);
    assert_eq!(finished(place.path()), [true; 4], "written anew, moved: the same content");
    disc(&changed, 32, 11.0);
    assert_eq!(finished(place.path()), [true, false, true, true]);
    all_done(place.path(), &[]);
    assert!(outputs(place.path())["case01.stl"] != first["case01.stl"]);
    fs::write(&changed, &before).expect("a file can be written");
    all_done(place.path(), &[]);
    same(&first, &outputs(place.path()));

    // Options, but not by saying the default.
    lines[2]["options"] = json!({"fair": 0});
    lines[0]["options"] = json!({"slope": "hyman", "fair": 1.5});
    write_manifest(place.path(), &lines);
    assert_eq!(finished(place.path()), [true, true, false, true]);
    all_done(place.path(), &[]);
    let without_fairing = outputs(place.path());
    assert!(without_fairing["case02.stl"] != first["case02.stl"]);
    assert_eq!(results(place.path()).len(), 7, "one line for each job that was run");

    // Outputs that are gone or not as they were written.
    fs::remove_file(place.path().join("out/case00.nrrd")).expect("it is there");
    let spoilt = place.path().join("out/case03.stl");
    let mut bytes = fs::read(&spoilt).expect("it is there");
    bytes[100] ^= 1;
    fs::write(&spoilt, bytes).expect("a file can be written");
    assert_eq!(finished(place.path()), [false, true, true, false]);
    all_done(place.path(), &[]);
    same(&without_fairing, &outputs(place.path()));

    // Another backend is another result.
    let other = interslice(&["batch", &place.path().join("manifest.jsonl").display().to_string(), "--dry-run"]);
    assert!(!String::from_utf8_lossy(&other.stdout).contains("finished"), "--backend auto is not --backend cpu");
}

#[test]
fn every_wrong_line_is_named_before_anything_runs() {
    let place = folder();
    let ids = cases(place.path(), 2);
    let sound = manifest(place.path())[0].to_string();
    let at = |name: &str| place.path().join(name);
    let refused = |name: &str, text: &str, says: &[&str]| {
        fs::write(at(name), text).expect("a file can be written");
        let result = interslice(&["batch", &at(name).display().to_string(), "--backend", "cpu"]);
        let message = stderr(&result);
        assert_eq!(result.status.code(), Some(2), "{message}");
        for part in says {
            assert!(message.contains(part), "`{part}` is missing from: {message}");
        }
        assert!(!at("out").exists() && !at("results.jsonl").exists(), "nothing was run");
    };
    let lines = [
        sound.as_str(),
        "{\"id\": 3}",
        "not JSON",
        r#"{"id": "case00", "input": "cases/case01", "outputs": ["out/x.stl", "out/../out/case00.stl"]}"#,
        r#"{"id": "b", "input": "cases/none", "outputs": ["out/b.docx", "out/b.stl", "out/b.stl"]}"#,
        r#"{"id": "c", "input": "cases/case01", "outputs": ["c.stl"], "options": {"colour": 1, "cfl": "fast", "sigma": 9, "roi": 3}}"#,
        r#"{"id": "d", "input": "cases/case01", "outputs": ["d.stl"], "options": {"dz": -1, "slope": null}, "more": 1}"#,
        "",
        r#"{"id": "", "input": "cases/case01", "outputs": []}"#,
        r#"{"id": "e", "input": "cases/case01", "outputs": ["cases/case00/s1.png", "cases"]}"#,
        r#"{"id": "f", "input": "", "outputs": ["f.stl"], "options": {"dz": -1, "slope": null}}"#,
        r#"{"id": "g", "input": "cases/case01", "outputs": ["cases/case00/s1.png/below/g.stl"], "options": {"spacing": [1, 2, -3]}}"#,
    ];
    let says = [
        "line 2: invalid type: integer `3`",
        "line 3: ",
        "line 4: id `case00` is that of line 1 too",
        "line 4: output",
        "is one of line 1 too",
        "line 5: input: ",
        "cases/none: cannot read",
        "line 5: outputs: ",
        "b.docx: cannot write: unknown extension; expected .nrrd",
        "b.stl is named twice",
        "line 6: options: unknown option `colour`; there are dz,",
        ", all_rois, keep_overlaps, labels, preset,",
        "line 6: options: `cfl` = \"fast\": invalid type: string \"fast\", expected a number",
        "line 6: options: `sigma` must lie in (0, 5]; got 9",
        "line 6: input: `roi` is not for anything but an RTSTRUCT",
        "line 7: unknown field `more`",
        "line 9: `id` must not be empty",
        "line 9: `outputs` must name at least one file",
        "line 10: ",
        "cases: cannot write",
        "line 11: options: `slope` must be",
        "line 11: options: `dz` must be a positive number; got -1",
        "line 11: `input` must not be empty",
        "line 12: input: `spacing` must be three positive numbers; got -3",
        "line 12: outputs: ",
        "g.stl: cannot write: lies below ",
        "s1.png, which is a file, no folder",
    ];
    refused("bad.jsonl", &lines.join("\n"), &says);
    let slice = r#"{"id": "e", "input": "cases/case01", "outputs": ["cases/case00/s1.png"]}"#;
    refused(
        "bad.jsonl",
        &[&sound, slice].map(String::from).join("\n"),
        &["line 2: output", "s1.png is read by line 1"],
    );
    // A folder whose images need no names reads what is laid into it, be it by another job.
    fs::create_dir(at("im")).expect("a folder can be made");
    (1..4).for_each(|k| disc(&at(&format!("im/{k}.png")), 32, 7.0 + f64::from(k)));
    let joining = [
        r#"{"id": "im", "input": "im", "outputs": ["out/im.stl", "im/im.png"], "options": {"spacing": [1, 1, 4]}}"#,
        r#"{"id": "x", "input": "cases/case01", "outputs": ["im/x.png", "im/x.stl"]}"#,
    ];
    refused(
        "bad.jsonl",
        &[&sound, joining[0], joining[1]].join("\n"),
        &[
            "im.png: the next run would read it as a slice of the input",
            "im/x.png: the next run would read it",
            "line 3",
        ],
    );
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let kept = r#"{"id": "k", "input": "cases/case01", "outputs": ["kept.stl"]}"#;
        fs::write(at("kept.stl"), "kept").expect("a file can be written");
        fs::set_permissions(at("kept.stl"), fs::Permissions::from_mode(0o444)).expect("it is ours");
        refused(
            "bad.jsonl",
            &[&sound, kept].join("\n"),
            &["line 2: outputs: ", "kept.stl: cannot write: is write-protected"],
        );
    }
    refused("bad.csv", "id,input\na,cases/case00", &["bad.csv", "column `outputs` is missing"]);
    refused("bad.csv", "id,input,outputs,color\n", &["unknown column `color`", "id, input, outputs, options"]);
    refused(
        "bad.csv",
        "id,input,outputs,options\na,cases/case00,a.stl,fair=2;fair=1\n\r\n\nb,cases/case00\nc,cases/case00,c.stl,fair=7\n\
         d,cases/case00,d.stl,preset=quick\n,,,\n ;\n,a,,",
        &[
            "line 2: option `fair` is named twice",
            "line 5: 2 cells, but the header has 4",
            "line 6: options: `fair`",
            "got 7",
            "line 7: options: `preset`",
            "expected paper or fast",
            "line 9: 1 cells",
            "line 10: `id` must not be empty",
        ],
    );
    refused("bad.jsonl", "\n\n", &["has no jobs"]);
    refused("bad.txt", "", &["bad.txt", ".jsonl"]);
    for wrong in [["--jobs", "0"], ["--memory", "some"], ["--threads", "0"]] {
        let result = batch(place.path(), &wrong);
        assert_eq!(result.status.code(), Some(2), "{}", stderr(&result));
    }
    assert_eq!(ids.len(), 2);
    assert!(!at("out").exists());
}

#[test]
fn csv_says_the_same_as_json_lines() {
    let place = folder();
    cases(place.path(), 3);
    let mut lines = manifest(place.path());
    lines[1]["options"] = json!({"end_top": "peak=12", "fair": 0.5, "mask": true});
    lines[2]["options"] = json!({"slope": "pchip", "dz": 0.5});
    write_manifest(place.path(), &lines);
    all_done(place.path(), &[]);
    let out = |k: usize| OUTPUTS.map(|e| format!("out/case0{k}.{e}")).join("; ");
    let text = format!(
        "id,input,options,outputs\ncase00,cases/case00,,{}\ncase01,cases/case01,end_top=peak=12; fair = 0.5;mask,{}\n\
         case02,cases/case02,\"{{\"\"slope\"\": \"\"pchip\"\", \"\"dz\"\": 0.5}}\",{}\n",
        out(0),
        out(1),
        out(2)
    );
    let csv = place.path().join("manifest.csv");
    fs::write(&csv, text).expect("a file can be written");
    let result = interslice(&["batch", &csv.display().to_string(), "--backend", "cpu"]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    assert!(stderr(&result).contains("0 done, 3 finished before"), "{}", stderr(&result));
}

#[test]
fn one_failing_job_does_not_stop_the_others() {
    let place = folder();
    let ids = cases(place.path(), 5);
    let whole = fs::read(slice(place.path(), &ids[1])).expect("it is there");
    fs::write(slice(place.path(), &ids[1]), &whole[..whole.len() / 2]).expect("a file can be written");
    let mut lines = manifest(place.path());
    // Found by the pipeline only: the peak lies below the last contour.
    lines[3]["options"] = json!({"end_top": "peak=3"});
    write_manifest(place.path(), &lines);
    let result = batch(place.path(), &[]);
    let said = stderr(&result);
    assert_eq!(result.status.code(), Some(1), "{said}");
    let end: Vec<&str> = said.lines().rev().take(3).collect();
    assert!(end[0].trim_start().starts_with("case03: `end_top` peak must lie above"), "{said}");
    assert!(end[1].trim_start().starts_with("case01: slice 1 (`s1.png`)"), "{said}");
    assert!(end[2].contains("2 jobs failed, 0 not run, of 5"), "{said}");
    let made = outputs(place.path());
    assert_eq!(made.len(), 9, "{:?}", made.keys());
    let failed: Vec<Value> = results(place.path()).into_iter().filter(|l| l["status"] == "failed").collect();
    assert_eq!(failed.len(), 2);
    assert!(failed.iter().any(|l| l["error"].as_str().is_some_and(|e| e.contains("s1.png"))), "{failed:?}");

    // Put right, only these are run.
    fs::write(slice(place.path(), &ids[1]), whole).expect("a file can be written");
    lines[3]["options"] = json!({"end_top": "peak=10"});
    write_manifest(place.path(), &lines);
    assert!(all_done(place.path(), &[]).contains("2 done, 3 finished before"));
    let now = outputs(place.path());
    assert!(made.iter().all(|(name, bytes)| now[name] == *bytes));
}

#[test]
fn fail_fast_begins_nothing_after_a_failure() {
    let place = folder();
    let ids = cases(place.path(), 6);
    fs::write(slice(place.path(), &ids[0]), "not an image").expect("a file can be written");
    let result = batch(place.path(), &["--fail-fast", "--jobs", "1"]);
    assert_eq!(result.status.code(), Some(1));
    assert!(stderr(&result).contains("1 job failed, 5 not run, of 6"), "{}", stderr(&result));
    assert!(outputs(place.path()).is_empty());
}

#[test]
fn a_job_that_needs_more_memory_than_allowed_fails_in_words() {
    let place = folder();
    cases(place.path(), 3);
    let result = batch(place.path(), &["--memory", "1M"]);
    assert_eq!(result.status.code(), Some(1));
    assert!(stderr(&result).contains("case02: this job needs about"), "{}", stderr(&result));
    assert!(stderr(&result).contains("1 MiB are available"), "{}", stderr(&result));
    // Room for one at a time is enough.
    assert!(all_done(place.path(), &["--memory", "40M", "--jobs", "3"]).contains("3 done"));
}

#[test]
fn two_processes_share_the_work() {
    let place = folder();
    let ids = cases(place.path(), 16);
    let mut running: Vec<_> =
        (0..3).map(|_| command(place.path(), &["--jobs", "2"]).spawn().expect("the program starts")).collect();
    for child in &mut running {
        assert_eq!(child.wait().expect("it ends").code(), Some(0));
    }
    let mut ran = done(place.path());
    assert_eq!(ran.len(), ids.len(), "none was run twice: {ran:?}");
    ran.sort();
    assert_eq!(ran, ids);
    assert_eq!(outputs(place.path()).len(), 3 * ids.len());
}

#[test]
fn a_killed_process_leaves_its_jobs_to_the_other() {
    let place = folder();
    let ids = cases(place.path(), 20);
    fs::write(slice(place.path(), &ids[7]), "not an image").expect("a file can be written");
    let mut running: Vec<_> =
        (0..2).map(|_| command(place.path(), &["--jobs", "2"]).spawn().expect("the program starts")).collect();
    while done(place.path()).is_empty() {
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let second = running.pop().expect("there are two");
    let mut first = running.pop().expect("there are two");
    first.kill().expect("it can be killed");
    first.wait().expect("it ends");
    let left = second.wait_with_output().expect("it ends");
    assert_eq!(left.status.code(), Some(1), "{}", stderr(&left));
    assert!(stderr(&left).contains("1 job failed, 0 not run, of 20"), "{}", stderr(&left));
    assert_eq!(outputs(place.path()).len(), 3 * 19, "{:?}", outputs(place.path()).keys());
    let mut ran = done(place.path());
    ran.sort();
    assert_eq!(ran.len(), 19, "none was run twice: {ran:?}");
    assert!(!ran.contains(&ids[7]));
}

#[test]
fn a_torn_line_is_passed_over_and_gone() {
    let place = folder();
    cases(place.path(), 3);
    all_done(place.path(), &["--jobs", "1"]);
    let path = place.path().join("results.jsonl");
    let text = fs::read(&path).expect("it is there");
    fs::write(&path, &text[..text.len() - 40]).expect("a file can be written");
    assert_eq!(finished(place.path()), [true, true, false]);
    assert!(all_done(place.path(), &[]).contains("1 done, 2 finished before"));
    assert!(all_done(place.path(), &[]).contains("0 done, 3 finished before"));
    assert_eq!(results(place.path()).len(), 3);
    let text = fs::read_to_string(&path).expect("it is there");
    assert!(text.lines().all(|line| serde_json::from_str::<Value>(line).is_ok()), "the torn piece is gone: {text}");
}

#[test]
fn a_template_is_a_manifest() {
    let place = folder();
    let cases_in = place.path().join("cases");
    cases(place.path(), 2);
    fs::remove_file(place.path().join("manifest.jsonl")).expect("it is there");
    fs::create_dir(cases_in.join("not a case")).expect("a folder can be made");
    let labels: Vec<u8> = [[0u8; 16], [7; 16], [7; 16], [2; 16]].concat();
    fs::write(cases_in.join("both.nrrd"), nrrd("encoding: raw", "uchar", [4, 4, 4], &labels)).expect("a file");
    for (name, more) in [("m.jsonl", &[][..]), ("m.csv", &["--ext", "ply,nii.gz", "--out", "made", "--each-label"])] {
        let target = place.path().join(name).display().to_string();
        let made = interslice(&[&["batch", "--template", &cases_in.display().to_string(), &target], more].concat());
        assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
        let again = interslice(&[&["batch", "--template", &cases_in.display().to_string(), &target], more].concat());
        assert_eq!(again.status.code(), Some(2), "an existing manifest is not written over");
    }
    let text = fs::read_to_string(place.path().join("m.jsonl")).expect("it is there");
    let ids: Vec<Value> = text.lines().map(|l| serde_json::from_str(l).expect("JSON")).collect();
    let both = json!({"id": "both", "input": "cases/both.nrrd", "outputs": ["out/both.nrrd", "out/both.stl"]});
    assert_eq!(ids[0], both);
    assert_eq!(ids.len(), 3);
    let text = fs::read_to_string(place.path().join("m.csv")).expect("it is there");
    // Label 2 is drawn on a single slice: nothing can be made of it.
    assert_eq!(text.lines().count(), 4, "{text}");
    assert!(text.contains("both-7,cases/both.nrrd,made/both-7.ply;made/both-7.nii.gz,\"{\"\"label\"\":7}\""), "{text}");
    let listed = interslice(&["batch", &place.path().join("m.csv").display().to_string(), "--dry-run"]);
    assert_eq!(listed.status.code(), Some(0), "{}", stderr(&listed));
    assert_eq!(String::from_utf8_lossy(&listed.stdout).lines().count(), 3);
    let bad = place.path().join("bad.jsonl");
    let folder_of_cases = cases_in.display().to_string();
    let wrong = ["batch", "--template", &folder_of_cases, &bad.display().to_string(), "--ext", "ply,xyz"];
    let wrong = interslice(&wrong);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(stderr(&wrong).contains("`ext` has `xyz`: unknown extension; expected"), "{}", stderr(&wrong));
    assert!(!bad.exists());
    let empty = folder();
    let none = interslice(&["batch", "--template", &empty.path().display().to_string()]);
    assert_eq!(none.status.code(), Some(2));
    assert!(stderr(&none).contains("has no cases"), "{}", stderr(&none));
}
