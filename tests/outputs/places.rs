//! Places that outputs are written to: pipes and devices, links, and what is write-protected.

use std::fs;

use crate::files::{folder, interslice, listing, sound_stack, stderr};

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
