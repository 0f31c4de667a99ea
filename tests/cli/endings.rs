//! Runs that end otherwise than they should: nobody reads on, an interrupt, a file beyond the limit.

use std::process::{Command, Stdio};

use crate::files::*;

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let place = folder();
    sound_stack(place.path());
    let input = place.path().display().to_string();
    for arguments in [vec!["inspect", &input], vec!["devices"]] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_interslice"))
            .args(&arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        drop(child.stdout.take());
        let result = child.wait_with_output().expect("it ends");
        assert_eq!(result.status.code(), Some(0), "{arguments:?}: {}", stderr(&result));
    }
}

/// Every command that writes, while it works under temporary names.
#[cfg(unix)]
#[test]
fn an_interrupt_leaves_no_temporary_files() {
    use std::time::{Duration, Instant};
    let place = folder();
    sound_stack(place.path());
    for name in ["s0.png", "s1.png", "s2.png"] {
        disc(&place.path().join(name), 700, 300.0);
    }
    let temporary = |path: &std::path::Path| path.to_string_lossy().contains(".interslice-");
    let stack = |command: &[&'static str]| [command, &[".", "--backend", "cpu", "-q", "--dz", "0.01"]].concat();
    for signal in ["-INT", "-TERM", "-HUP"] {
        for arguments in [
            [stack(&["reconstruct"]), vec!["-o", "a.zarr", "-o", "a.stl", "-o", "a.nrrd"]].concat(),
            [stack(&["run", "--part", "1/2"]), vec!["-o", "a.section"]].concat(),
        ] {
            let before = listing(place.path());
            let mut child = Command::new(env!("CARGO_BIN_EXE_interslice"))
                .args(&arguments)
                .current_dir(place.path())
                .stderr(Stdio::piped())
                .spawn()
                .expect("the program starts");
            let begin = Instant::now();
            while !listing(place.path()).iter().any(|p| temporary(p)) {
                let ended = child.try_wait().expect("it can be asked");
                assert!(ended.is_none() && begin.elapsed() < Duration::from_secs(60), "{arguments:?}: {ended:?}");
                std::thread::sleep(Duration::from_millis(5));
            }
            let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill starts");
            assert!(sent.success(), "{arguments:?}");
            let ended = child.wait_with_output().expect("it ends");
            let message = stderr(&ended);
            assert_eq!(ended.status.code(), Some(130), "{signal}, {arguments:?}: {message}");
            assert!(message.contains("interrupted; unfinished outputs are removed"), "{arguments:?}: {message}");
            assert_eq!(listing(place.path()), before, "{signal}, {arguments:?}");
        }
    }
}

/// A write beyond `ulimit -f` fails as any other does.
#[cfg(unix)]
#[test]
fn a_file_beyond_the_limit_is_an_error_and_leaves_nothing() {
    let place = folder();
    sound_stack(place.path());
    let before = listing(place.path());
    let script =
        format!("ulimit -f 4; exec '{}' reconstruct . -o a.stl -o a.npy -q --dz 0.1", env!("CARGO_BIN_EXE_interslice"));
    let result = Command::new("bash").args(["-c", &script]).current_dir(place.path()).output().expect("bash starts");
    let message = stderr(&result);
    assert_eq!(result.status.code(), Some(1), "{message}");
    assert!(message.contains("a.stl") || message.contains("a.npy"), "{message}");
    assert_eq!(listing(place.path()), before);
}

/// A mesh of one and a report of the other would be of no run at all.
#[cfg(unix)]
#[test]
fn two_runs_do_not_write_to_one_place() {
    use std::time::{Duration, Instant};
    let place = folder();
    sound_stack(place.path());
    for name in ["s0.png", "s1.png", "s2.png"] {
        disc(&place.path().join(name), 700, 300.0);
    }
    let command = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_interslice"));
        command.args(["reconstruct", ".", "--backend", "cpu", "-q"]).args(arguments);
        command.current_dir(place.path()).stderr(Stdio::piped());
        command
    };
    let mut child = command(&["--dz", "0.01", "-o", "a.stl", "-o", "a.json"]).spawn().expect("the program starts");
    let begin = Instant::now();
    let works = |path: &std::path::PathBuf| path.to_string_lossy().ends_with(".tmp");
    while listing(place.path()).iter().filter(|path| works(path)).count() < 2 {
        let ended = child.try_wait().expect("it can be asked");
        assert!(ended.is_none() && begin.elapsed() < Duration::from_secs(60), "{ended:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
    for (outputs, named) in [(["b.stl", "a.json"], "a.json"), (["a.json", "a.stl"], "a.json")] {
        let refused = command(&["-o", outputs[0], "-o", outputs[1]]).output().expect("the program starts");
        let says = format!("{named}: cannot write: is written by another run; wait for its end");
        assert!(refused.status.code() == Some(2) && stderr(&refused).contains(&says), "{}", stderr(&refused));
    }
    assert!(child.try_wait().expect("it can be asked").is_none(), "it has ended before it could be disturbed");
    // A killed one leaves nobody locked out, and the next one no lock.
    child.kill().expect("it can be killed");
    child.wait().expect("it has ended");
    let done = command(&["-o", "a.stl", "-o", "a.json"]).output().expect("the program starts");
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let left = listing(place.path());
    assert!(!left.iter().any(|path| path.to_string_lossy().ends_with(".lock")), "{left:?}");
}
