//! The target that the environment variable INTERSLICE_TARGET names.
#![no_main]

use std::sync::LazyLock;

use interslice_fuzz::{Target, run, targets};

static CHOSEN: LazyLock<Target> = LazyLock::new(|| {
    let wanted = std::env::var("INTERSLICE_TARGET").unwrap_or_default();
    let mut known = Vec::new();
    for (name, target) in targets() {
        if name == wanted {
            return target;
        }
        known.push(name);
    }
    eprintln!("INTERSLICE_TARGET is `{wanted}`; it must be one of {}", known.join(", "));
    std::process::exit(2)
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = run(&CHOSEN, bytes);
});
