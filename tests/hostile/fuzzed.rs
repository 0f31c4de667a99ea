//! Every reader with the seeds of the fuzz targets (`fuzz/`): sound ones are read, damaged ones refused in words, whatever the damage; and
//! with the inputs that once failed.

#[path = "../../fuzz/src/lib.rs"]
mod targets;

use std::fs;
use std::path::{Path, PathBuf};

use targets::{BETWEEN, run, targets};

/// Parts of a file that are left when it is cut short, of 64.
const CUTS: usize = 64;
/// Bits that are flipped, one at a time, in a file.
const FLIPS: usize = 160;

/// The files of a target in a folder of `fuzz/`, by name.
fn files(folder: &str, target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz").join(folder).join(target);
    let mut paths: Vec<PathBuf> =
        fs::read_dir(folder).into_iter().flatten().map(|e| e.expect("an entry").path()).collect();
    paths.sort();
    let read = |path: PathBuf| (path.display().to_string(), fs::read(&path).expect("it is there"));
    paths.into_iter().map(read).collect()
}

#[test]
fn seeds_are_read() {
    for (name, target) in targets() {
        let seeds = files("seeds", name);
        assert!(!seeds.is_empty(), "{name} has no seeds");
        for (seed, bytes) in seeds {
            run(&target, &bytes).unwrap_or_else(|e| panic!("{seed}: {e}"));
        }
    }
}

/// Most cuts are refused; what is left of some texts and tables is sound.
#[test]
fn seeds_cut_short_are_refused() {
    for (name, target) in targets() {
        for (seed, bytes) in files("seeds", name) {
            let cut = |k: usize| {
                println!("{seed} cut to {k} of {CUTS}"); // shown where it fails
                run(&target, &bytes[..k * bytes.len() / CUTS])
            };
            let refused = (0..CUTS).filter(|k| cut(*k).is_err()).count();
            assert!(refused > CUTS / 2, "{seed}: {refused} of {CUTS} cuts were refused");
        }
    }
}

/// What flipped bits make is read or refused; half of the bits lie in the first bytes, where headers are.
#[test]
fn seeds_with_flipped_bits_are_read_or_refused() {
    for (name, target) in targets() {
        for (seed, bytes) in files("seeds", name) {
            let mut refused = 0;
            for k in 0..FLIPS {
                let within = if k % 2 == 0 { bytes.len() } else { bytes.len().min(200) };
                let (at, bit) = (k * within / FLIPS, k * 5 % 8);
                let mut spoilt = bytes.clone();
                spoilt[at] ^= 1 << bit;
                println!("{seed}, bit {bit} of byte {at}"); // shown where it fails
                refused += usize::from(run(&target, &spoilt).is_err());
            }
            assert!(refused > 0, "{seed}: no flipped bit was refused");
        }
    }
}

/// Inputs of one file, as a user meets them.
#[test]
fn the_program_names_a_file_cut_short() {
    let names = [
        ("folder", "stack.json"),
        ("geojson", "a.geojson"),
        ("mha", "a.mha"),
        ("nifti", "a.nii"),
        ("npy", "a.npy"),
        ("nrrd", "a.nrrd"),
        ("rtstruct", "a.dcm"),
        ("tiff", "a.tif"),
    ];
    for (target, name) in names {
        let whole = files("seeds", target);
        for (seed, bytes) in whole.iter().filter(|(_, bytes)| !bytes.windows(BETWEEN.len()).any(|w| w == BETWEEN)) {
            let place = crate::files::folder();
            let path = place.path().join(name);
            for part in [0, 1, 20, 31] {
                fs::write(&path, &bytes[..bytes.len() * part / 32]).expect("a file can be written");
                let result = crate::files::interslice(&["inspect", &path.display().to_string()]);
                let message = crate::files::stderr(&result);
                assert_eq!(result.status.code(), Some(2), "{seed}, {part} of 32: {message}");
                assert!(message.contains(name) && !message.contains("panicked"), "{seed}, {part} of 32: {message}");
            }
        }
    }
}

/// Inputs that once made a reader panic, hang or take too much memory.
#[test]
fn inputs_that_once_failed_are_refused_or_read() {
    let mut tried = 0;
    for (name, target) in targets() {
        for (input, bytes) in files("found", name) {
            println!("{input}"); // shown where it fails
            let _ = run(&target, &bytes);
            tried += 1;
        }
    }
    assert!(tried > 0, "fuzz/found is empty");
}
