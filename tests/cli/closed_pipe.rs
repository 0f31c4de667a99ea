//! Readers of what the program says that go away: it ends quietly, with the outputs written.

use std::process::{Command, Stdio};

use crate::files::{folder, sound_stack};

#[test]
fn outputs_are_written_though_nobody_listens() {
    let place = folder();
    sound_stack(place.path());
    let (input, out) = (place.path().display().to_string(), place.path().join("out.stl"));
    for (arguments, writes) in [
        (vec!["reconstruct", &input, "-v", "--backend", "cpu", "-o", out.to_str().expect("a name")], true),
        (vec!["inspect", &input], false),
        (vec!["reconstruct", "nowhere", "-o", "x.stl"], false),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_interslice"));
        let mut child =
            command.args(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts");
        // Both pipes are closed before anything is said.
        drop((child.stdout.take(), child.stderr.take()));
        let code = child.wait().expect("it ends").code();
        let wanted = if arguments[1] == "nowhere" { 2 } else { 0 };
        assert_eq!(code, Some(wanted), "{arguments:?}");
        assert!(!writes || out.metadata().is_ok_and(|m| m.len() > 1000), "{arguments:?}");
    }
}
