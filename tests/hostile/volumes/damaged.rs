//! Files of every format cut short, with sizes that they cannot hold, with flipped bits.

use std::fs;

use interslice::input::read;
use interslice::stack::ReadOptions;
use proptest::prelude::*;

use super::sources::*;
use crate::files::folder;

#[test]
fn cut_short() {
    for name in NAMES {
        let bytes = sound(name);
        refused(name, &[], &[], &[name]);
        refused(name, &bytes[..20], &[], &[name]);
        // Deep in the voxels, but for TIFF, whose directory lies at the end.
        refused(name, &bytes[..bytes.len() - 30], &[], &[name]);
    }
    refused("a.npy", &sound("a.npy")[..300], &[], &["a.npy", "data end after", "of 600 bytes"]);
    refused("a.nii", &sound("a.nii")[..652], &[], &["a.nii", "data end after 300 of 600 bytes"]);
    // All voxels are there, but not the checksum, or another.
    for name in ["a.nrrd", "a.nii.gz", "a.mha"] {
        let mut bytes = sound(name);
        let end = bytes.len();
        refused(name, &bytes[..end - 2], &[], &[name, "data, behind the last voxel"]);
        // Of gzip it stands before the length.
        bytes[end - if name == "a.mha" { 1 } else { 5 }] ^= 1;
        refused(name, &bytes, &[], &[name, "data", "corrupt"]);
    }
}

#[test]
fn sizes_that_the_file_cannot_hold() {
    let with = |name: &str, from: &str, to: &str, says: &[&str]| {
        let bytes = sound(name);
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("the field is there");
        let spoilt = [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat();
        refused(name, &spoilt, &[], says);
    };
    let cannot = "compressed bytes can hold";
    with("a.nrrd", "sizes: 12 10 5", "sizes: 9000 9000 9000", &["a.nrrd", "729000000000 bytes of voxels", cannot]);
    with("a.nrrd", "sizes: 12 10 5", "sizes: 18446744073709551615 2 2", &["sizes 18446744073709551615 2 2"]);
    with("a.mha", "DimSize = 12 10 5", "DimSize = 9000 9000 9000", &["a.mha", cannot]);
    with("a.mha", "DimSize = 12 10 5", "DimSize = -12 10 5", &["DimSize must be 3 numbers; got `-12 10 5`"]);
    let array = |shape: &str| npy(&format!("{{'descr': '|u1', 'fortran_order': True, 'shape': {shape}, }}"), &[1; 600]);
    refused("a.npy", &array("(9000, 9000, 9000)"), &[], &["a.npy", "data end after 600 of 729000000000 bytes"]);
    refused("a.npy", &array("(4294967296, 4294967296, 4294967296)"), &[], &["are no volume of 1 to"]);
    let mut nifti = sound("a.nii");
    (0..3).for_each(|k| nifti[42 + 2 * k..44 + 2 * k].copy_from_slice(&9000i16.to_le_bytes()));
    refused("a.nii", &nifti, &[], &["a.nii", "data end after 600 of 729000000000 bytes"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    /// Whatever comes back of a damaged file, it comes back, and what is wrong is the input's fault.
    #[test]
    fn damaged_volumes_never_panic(
        kind in 0usize..NAMES.len(),
        cut in prop::option::weighted(0.3, 0.0f64..1.0),
        flips in prop::collection::vec((0.0f64..1.0, any::<u8>(), any::<bool>()), 1..5),
    ) {
        let name = NAMES[kind];
        let mut bytes = sound(name);
        for (at, value, early) in flips {
            // Half of them in what is mostly header.
            let n = if early { bytes.len().min(400) } else { bytes.len() };
            bytes[(at * n as f64) as usize] ^= value;
        }
        bytes.truncate((cut.unwrap_or(1.0) * bytes.len() as f64) as usize);
        let place = folder();
        let path = place.path().join(name);
        fs::write(&path, bytes).expect("a file can be written");
        match read(&path, &ReadOptions::default()) {
            Ok(stack) => prop_assert!(stack.slices.iter().all(|s| s.content.len() == stack.dims[0] * stack.dims[1])),
            Err(e) => prop_assert_eq!(e.exit_code(), 2, "{}", e),
        }
    }
}
