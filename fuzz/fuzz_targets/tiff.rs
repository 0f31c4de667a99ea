#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = interslice_fuzz::run(interslice_fuzz::tiff, bytes);
});
