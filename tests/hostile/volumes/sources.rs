//! Sound volumes, to be spoilt, and the check that a wrong one is refused.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use tiff::encoder::{TiffEncoder, colortype::Gray8};
use tiff::tags::Tag;

use crate::files::{folder, interslice, stderr};
use crate::support;

pub const NAMES: [&str; 6] = ["a.nrrd", "a.nii", "a.nii.gz", "a.mha", "a.npy", "a.tif"];

/// A sound volume of 12 x 10 x 5 voxels in every format, by the name of its file.
pub fn sound(name: &str) -> Vec<u8> {
    let disc = support::body([12, 10], &[0.0, 1.0, 2.0, 3.0, 4.0], |x, y, _| (x - 5.0).hypot(y - 4.0) - 3.2);
    match name {
        "a.npy" => npy("{'descr': '|u1', 'fortran_order': False, 'shape': (5, 10, 12), }", &voxels(&disc)),
        "a.tif" => {
            let mut out = Cursor::new(Vec::new());
            let mut encoder = TiffEncoder::new(&mut out).expect("memory can be written");
            for page in voxels(&disc).chunks(120) {
                let mut image = encoder.new_image::<Gray8>(12, 10).expect("a page");
                let tag = image.encoder().write_tag(Tag::ImageDescription, OME);
                tag.expect("a description");
                image.write_data(page).expect("memory can be written");
            }
            out.into_inner()
        }
        volume => {
            let place = folder();
            let path = place.path().join(volume);
            support::write(&path, &disc, true);
            fs::read(path).expect("it was written")
        }
    }
}

const OME: &str = r#"<?xml version="1.0"?><OME><Image><Pixels DimensionOrder="XYZCT" SizeX="12" SizeY="10" SizeZ="5" SizeC="1" SizeT="1" PhysicalSizeX="0.5" PhysicalSizeY="0.5" PhysicalSizeZ="2" Type="uint8"><TiffData IFD="0" PlaneCount="5"/></Pixels></Image></OME>"#;

fn voxels(body: &interslice::Reconstruction) -> Vec<u8> {
    body.layers.iter().flat_map(|l| l.phi.iter().map(|v| u8::from(*v < 0.0))).collect()
}

pub fn npy(header: &str, data: &[u8]) -> Vec<u8> {
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.as_bytes());
    out.extend(data);
    out
}

/// The parts of a seed of several files.
pub fn seed(name: &str) -> Vec<Vec<u8>> {
    let bytes = fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(name)).expect(name);
    let between = b"\n%%%%\n";
    match bytes.windows(between.len()).position(|w| w == between) {
        Some(at) => vec![bytes[..at].to_vec(), bytes[at + between.len()..].to_vec()],
        None => vec![bytes],
    }
}

/// Runs `reconstruct` on the bytes as a file `name`; checks exit code, message and that no output is there.
pub fn refused(name: &str, bytes: &[u8], options: &[&str], says: &[&str]) {
    let place = folder();
    let path = place.path().join(name);
    fs::write(&path, bytes).expect("a file can be written");
    refused_in(place.path(), name, options, says);
}

pub fn refused_in(place: &Path, name: &str, options: &[&str], says: &[&str]) {
    let (input, target) = (place.join(name), place.join("out.stl"));
    let (input, output) = (input.display().to_string(), target.display().to_string());
    let mut arguments = vec!["reconstruct", &input, "-o", &output];
    arguments.extend(options);
    let result = interslice(&arguments);
    let message = stderr(&result);
    assert_eq!(result.status.code(), Some(2), "{name}: {message}");
    for part in says {
        assert!(message.contains(part), "{name}: `{part}` is missing from: {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
    assert!(!target.exists());
}
