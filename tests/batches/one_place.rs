//! A batch and a single run that name one output.

use std::fs;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::json;

use crate::cases::*;
use crate::files::*;

/// What one writes the other does not write at the same time: a part of each would be left.
#[test]
fn a_batch_and_a_single_run_do_not_write_to_one_place() {
    let place = folder();
    let ids = cases(place.path(), 2);
    ids.iter().for_each(|id| disc(&slice(place.path(), id), 700, 300.0));
    for id in &ids {
        for name in ["s0.png", "s2.png"] {
            disc(&place.path().join("cases").join(id).join(name), 700, 280.0);
        }
    }
    fs::create_dir(place.path().join("out")).expect("a folder can be made");
    let lines = ids.iter().map(|id| {
        json!({"id": id, "input": format!("cases/{id}"), "outputs": [format!("out/{id}.stl"), format!("out/{id}.json")],
            "options": {"dz": 0.01}})
    });
    write_manifest(place.path(), &lines.collect::<Vec<_>>());
    let single = |id: &str, dz: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_interslice"));
        let outputs = ["stl", "json"].map(|e| format!("out/{id}.{e}"));
        command.args(["reconstruct", &format!("cases/{id}"), "-o", &outputs[0], "-o", &outputs[1], "--dz", dz, "-q"]);
        command.args(["--backend", "cpu"]).current_dir(place.path()).stderr(Stdio::piped());
        command
    };
    let works = |child: &mut Child| {
        let begin = Instant::now();
        while outputs(place.path()).keys().filter(|name| name.ends_with(".tmp")).count() < 2 {
            let ended = child.try_wait().expect("it can be asked");
            assert!(ended.is_none() && begin.elapsed() < Duration::from_secs(60), "{ended:?}");
            sleep(Duration::from_millis(5));
        }
    };
    let ends = |mut child: Child| {
        child.kill().expect("it can be killed");
        child.wait_with_output().expect("it ends")
    };
    let says = "is written by another run; wait for its end";
    let mut first = command(place.path(), &["-q", "--jobs", "1"]).spawn().expect("the program starts");
    works(&mut first);
    let refused = single(&ids[0], "1").output().expect("the program starts");
    assert!(first.try_wait().expect("it can be asked").is_none(), "it has ended before it could be disturbed");
    ends(first);
    let message = stderr(&refused);
    assert!(refused.status.code() == Some(2) && message.contains(says), "{:?}: {message}", refused.status);
    // The other way round, a job fails and the others go on; what a killed run has left locks nobody out.
    for file in outputs(place.path()).keys() {
        fs::remove_file(place.path().join("out").join(file)).expect("it is there");
    }
    let mut first = single(&ids[0], "0.01").spawn().expect("the program starts");
    works(&mut first);
    let quick = ids.iter().map(|id| {
        json!({"id": id, "input": format!("cases/{id}"), "outputs": [format!("out/{id}.stl"), format!("out/{id}.json")]})
    });
    write_manifest(place.path(), &quick.collect::<Vec<_>>());
    let both = batch(place.path(), &[]);
    assert!(first.try_wait().expect("it can be asked").is_none(), "it has ended before it could be disturbed");
    ends(first);
    assert!(both.status.code() == Some(1) && stderr(&both).contains(says), "{:?}: {}", both.status, stderr(&both));
    assert_eq!(done(place.path()), ids[1..]);
    let after = batch(place.path(), &[]);
    assert_eq!(after.status.code(), Some(0), "{}", stderr(&after));
    let left: Vec<String> = outputs(place.path()).into_keys().filter(|name| name.ends_with(".lock")).collect();
    assert!(left.is_empty(), "{left:?}");
}
