//! Headers of NIfTI, of NIfTI-2, and of pairs of files as Analyze has them.

use std::fs;

use super::sources::*;
use crate::files::{folder, interslice};

#[test]
fn four_axes_and_other_things_of_nifti() {
    let with = |at: usize, bytes: &[u8], says: &[&str]| {
        let mut spoilt = sound("a.nii");
        spoilt[at..at + bytes.len()].copy_from_slice(bytes);
        refused("a.nii", &spoilt, &[], says);
    };
    with(
        40,
        &[4, 0, 12, 0, 10, 0, 5, 0, 2, 0],
        &["dim[4] is 2: 2 volumes one behind the other (4D); a label volume has three axes: save the one"],
    );
    with(70, &128i16.to_le_bytes(), &["datatype 128"]);
    with(108, &f32::NAN.to_le_bytes(), &["vox_offset", "NaN"]);
    with(112, &f32::INFINITY.to_le_bytes(), &["scl_slope", "inf"]);
    with(280, &f32::NAN.to_le_bytes(), &["the orientation holds NaN"]);
    let mut bytes = sound("a.nii");
    bytes[254] = 0; // no sform
    bytes[84..88].copy_from_slice(&(-1f32).to_le_bytes());
    refused("a.nii", &bytes, &[], &["pixdim[2], a voxel spacing, must be a positive number; got -1"]);
    with(344, b"ni1\0", &["magic is \"ni1\""]);
    with(0, &540i32.to_le_bytes(), &["NIfTI-2 header: magic is"]);
}

#[test]
fn headers_of_pairs_and_of_nifti_2() {
    let place = folder();
    let [header, voxels] = &seed("analyze/analyze")[..] else { panic!("two files") };
    let refused_pair = |header: &[u8], voxels: Option<&[u8]>, says: &[&str]| {
        let _ = fs::remove_file(place.path().join("a.img"));
        fs::write(place.path().join("a.hdr"), header).expect("a file can be written");
        if let Some(voxels) = voxels {
            fs::write(place.path().join("a.img"), voxels).expect("a file can be written");
        }
        refused_in(place.path(), "a.hdr", &[], says);
    };
    let missing = "voxels must lie beside the header, in ";
    refused_pair(header, None, &["a.hdr: Analyze: ", missing, "a.img", "a.img.gz, which are not there"]);
    refused_pair(&seed("analyze/nifti")[0], None, &["a.hdr: magic is \"ni1\": ", missing]);
    refused_pair(header, Some(&voxels[..100]), &["a.hdr: data end after 100 of 360 bytes"]);
    refused_pair(&header[..200], Some(voxels), &["a.hdr: NIfTI header"]);
    let spoilt = |at: usize, bytes: &[u8]| {
        let mut header = header.clone();
        header[at..at + bytes.len()].copy_from_slice(bytes);
        header
    };
    refused_pair(&spoilt(40, &[3, 0, 12, 0, 10, 0, 255, 127]), Some(voxels), &["data end after 360 of 3932040 bytes"]);
    refused_pair(
        &spoilt(80, &f32::NAN.to_le_bytes()),
        Some(voxels),
        &["pixdim[1], a voxel spacing, must be a positive"],
    );
    let result = {
        fs::write(place.path().join("a.hdr"), header).expect("a file can be written");
        fs::write(place.path().join("a.img"), voxels).expect("a file can be written");
        interslice(&["inspect", &place.path().join("a.hdr").display().to_string()])
    };
    let said = String::from_utf8_lossy(&result.stdout).into_owned();
    assert!(said.contains("Analyze does not say how a volume lies: x is taken to run to the left"), "{said}");
    let two = &seed("nifti/two")[0];
    refused("a.nii", &two[..500], &[], &["a.nii: NIfTI-2 header: ends after 500 of 540 bytes"]);
    let with = |at: usize, bytes: &[u8], says: &[&str]| {
        let mut spoilt = two.clone();
        spoilt[at..at + bytes.len()].copy_from_slice(bytes);
        refused("a.nii", &spoilt, &[], says);
    };
    with(16, &9i64.to_le_bytes(), &["dim[0] must be 2 to 7; got 9"]);
    with(24, &(-12i64).to_le_bytes(), &["dim[1] must be a number of voxels; got -12"]);
    with(24, &i64::MAX.to_le_bytes(), &["are no volume of 1 to"]);
    with(40, &9000i64.to_le_bytes(), &["data end after"]);
    with(168, &100i64.to_le_bytes(), &["vox_offset must be a whole number from 540 on; got 100"]);
    with(400, &f64::NAN.to_le_bytes(), &["the orientation holds NaN"]);
}
