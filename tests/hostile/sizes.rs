//! Small files that say they are enormous are refused before memory is taken: in a process that may have 2 GiB.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::files::*;

/// Address space of the program, KiB.
const MOST_KIB: usize = 2 << 20;

/// Runs the program on `input` within [`MOST_KIB`]; checks exit code and message.
fn refused(arguments: &[&str], says: &[&str]) {
    let limited = format!("ulimit -v {MOST_KIB} && exec \"$0\" \"$@\"");
    let program = env!("CARGO_BIN_EXE_interslice");
    let result = Command::new("sh").args(["-c", &limited, program]).args(arguments).output().expect("a shell");
    let message = stderr(&result);
    assert_eq!(result.status.code(), Some(2), "{arguments:?}: {message}");
    says.iter().for_each(|part| assert!(message.contains(part), "`{part}` is missing from: {message}"));
}

fn inspected(input: &Path, says: &[&str]) {
    refused(&["inspect", &input.display().to_string()], says);
}

/// A seed of a fuzz target.
fn seed(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(name);
    fs::read(path).expect("the seed is there")
}

/// `bytes` with others at `at`.
fn with(mut bytes: Vec<u8>, at: usize, other: &[u8]) -> Vec<u8> {
    bytes[at..at + other.len()].copy_from_slice(other);
    bytes
}

/// `bytes` with `from` replaced by `to`.
fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("the field is there");
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

#[test]
fn volumes() {
    let place = folder();
    let refuses = |name: &str, bytes: &[u8], says: &[&str]| {
        let path = place.path().join(name);
        fs::write(&path, bytes).expect("a file can be written");
        inspected(&path, &[&[name], says].concat());
    };
    let hold = "compressed bytes can hold";
    refuses(
        "a.nrrd",
        &replaced(&seed("nrrd/raw"), "12 10 3", "100000 100000 3"),
        &["data end after 360 of 30000000000"],
    );
    refuses("b.nrrd", &replaced(&seed("nrrd/nrrd"), "12 10", "100000 100000"), &[hold]);
    refuses("a.mha", &replaced(&seed("mha/mha"), "12 10", "100000 100000"), &[hold]);
    let header = b"{'descr': '|u1', 'fortran_order': False, 'shape': (3, 100000, 100000), }";
    let length = (header.len() as u16).to_le_bytes();
    let array = [b"\x93NUMPY\x01\x00", &length[..], header, &[1; 360]].concat();
    refuses("a.npy", &array, &["data end after 360 of 30000000000"]);
    let sides = [9000i16; 3].map(i16::to_le_bytes).concat();
    refuses("a.nii", &with(seed("nifti/nii"), 42, &sides), &["of 729000000000 bytes"]);
    // Width and height of the first page: entries of its directory.
    let mut tiff = seed("tiff/plain");
    for tag in [256u16, 257] {
        let entry = [tag.to_le_bytes(), 4u16.to_le_bytes()].concat();
        let at = tiff.windows(4).position(|w| w == entry).expect("the entry is there");
        tiff = with(tiff, at + 8, &100_000u32.to_le_bytes());
    }
    refuses("a.tif", &tiff, &["TIFF: format error: inconsistent sizes"]);
}

#[test]
fn slices() {
    let place = folder();
    let mut png = Vec::new();
    let grey = image::GrayImage::new(12, 10);
    grey.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).expect("memory can be written");
    // The header chunk: width, height and its checksum.
    let header = [b"IHDR", &100_000u32.to_be_bytes()[..], &100_000u32.to_be_bytes(), &png[24..29]].concat();
    let mut check = flate2::Crc::new();
    check.update(&header);
    png = with(png, 12, &header);
    png = with(png, 29, &check.sum().to_be_bytes());
    fs::write(place.path().join("s.png"), &png).expect("a file can be written");
    let entries = r#"[{"file": "s.png", "z": 0}, {"file": "s.png", "z": 1}]"#;
    write_stack(place.path(), &format!("{{\"spacing_xy\": [1, 1], \"slices\": {entries}}}"));
    inspected(place.path(), &["slice 0 (`s.png`)"]);

    // As large as one may be, but more of them than any machine holds.
    disc(&place.path().join("s.png"), 2000, 500.0);
    let entries: Vec<String> = (0..200_000).map(|k| format!("{{\"file\": \"s.png\", \"z\": {k}}}")).collect();
    write_stack(place.path(), &format!("{{\"spacing_xy\": [1, 1], \"slices\": [{}]}}", entries.join(",")));
    inspected(place.path(), &["stack.json", "200000 slices of 2000x2000 px take", "MiB of memory"]);

    let square = "[[[0, 0], [1, 0], [1, 1], [0, 1]]]";
    let polygons = |side: &str| {
        let entries = format!(r#"[{{"z": 0, "polygons": {square}}}, {{"z": 1, "polygons": {square}}}]"#);
        write_stack(place.path(), &format!("{{\"spacing_xy\": [{side}, {side}], \"slices\": {entries}}}"));
    };
    for side in ["1e-5", "1e-300"] {
        polygons(side);
        inspected(place.path(), &["`spacing_xy` must be larger: 2 slices of"]);
    }
}

/// What the records and the index of a shapefile say of themselves.
#[test]
fn shapefiles() {
    let between = b"\n%%%%\n";
    let cone = seed("shapefile/cone");
    let mut pieces = Vec::new();
    let mut rest = &cone[..];
    while let Some(at) = rest.windows(between.len()).position(|w| w == between) {
        pieces.push(rest[..at].to_vec());
        rest = &rest[at + between.len()..];
    }
    pieces.push(rest.to_vec());
    let place = folder();
    let path = place.path().join("a.shp");
    let write = |shp: &[u8], shx: Option<&[u8]>| {
        fs::write(&path, shp).expect("a file can be written");
        for (extension, bytes) in [("dbf", &pieces[1]), ("prj", &pieces[2])] {
            fs::write(path.with_extension(extension), bytes).expect("a file can be written");
        }
        match shx {
            Some(shx) => fs::write(path.with_extension("shx"), shx).expect("a file can be written"),
            None => drop(fs::remove_file(path.with_extension("shx"))),
        }
    };
    // The first record: header at 100, parts at 144, points at 148, the first part's start at 152.
    let many = 0x7fff_0000i32.to_le_bytes();
    for shx in [None, Some(&pieces[3][..])] {
        for (at, says) in [
            (144, "feature 1, at byte 100: is said to have 2147418112 parts and 10 points, but 164 bytes are left"),
            (148, "feature 1, at byte 100: is said to have 1 parts and 2147418112 points, but 164 bytes are left"),
            (152, "part 1 begins at point 2147418112; it must lie in [0, 10]"),
        ] {
            write(&with(pieces[0].clone(), at, &many), shx);
            inspected(&path, &["a.shp", says]);
        }
        write(&with(pieces[0].clone(), 144, &(-1i32).to_le_bytes()), shx);
        inspected(&path, &["a.shp", "has -1 parts"]);
        write(&with(pieces[0].clone(), 104, &0x7000_0000u32.to_be_bytes()), shx);
        inspected(&path, &["a.shp", "feature 1, at byte 100: is said to be 3758096384 bytes long"]);
        write(&with(pieces[0].clone(), 24, &0x7000_0000u32.to_be_bytes()), shx);
        inspected(&path, &["a.shp", "is said to be 3758096384 bytes long, but has"]);
    }
    write(&pieces[0], Some(&with(pieces[3].clone(), 24, &0x7000_0000u32.to_be_bytes())));
    inspected(&path, &["a.shx", "is said to be 3758096384 bytes long, but has"]);
    write(&pieces[0], Some(&with(pieces[3].clone(), 100, &0x7000_0000u32.to_be_bytes())));
    inspected(&path, &["a.shp", "feature 1, at byte 3758096384: lies beyond the end of the file"]);
    write(&pieces[0], Some(&pieces[3][..60]));
    inspected(&path, &["a.shx", "is said to be"]);
}

/// Pairs of ends that all lie at one place.
#[test]
fn lines_from_one_point() {
    let place = folder();
    let path = place.path().join("hub.geojson");
    let line = |k: usize| {
        let at = k as f64 / 20_000.0 * std::f64::consts::TAU;
        let end = format!("[{}, {}]", 5e5 + 900.0 * at.cos(), 4e6 + 900.0 * at.sin());
        let middle = format!("[{}, {}]", 5e5 + 450.0 * at.cos(), 4e6 + 450.0 * at.sin());
        let line = format!("[[5e5, 4e6], {middle}, {end}]");
        format!(
            "{{\"type\": \"Feature\", \"properties\": {{\"z\": 1}}, \"geometry\": {{\"type\": \"LineString\", \"coordinates\": {line}}}}}"
        )
    };
    let features = (0..20_000).map(line).collect::<Vec<_>>().join(",\n");
    let text = format!("{{\"type\": \"FeatureCollection\", \"features\": [{features}]}}");
    fs::write(&path, text).expect("a file can be written");
    inspected(&path, &["hub.geojson", "ends inside the map at"]);
}

/// What makes the DICOM library take a value's bytes for the next element, and so for a length: numbers that are not whole, a meta group that
/// ends elsewhere.
#[test]
fn structure_sets() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let sound = seed("rtstruct/explicit");
    let uid = [&[8u8, 0, 0x16, 0][..], b"UI"].concat();
    let at = sound.windows(6).position(|w| w == uid).expect("SOP Class UID");
    fs::write(&path, with(sound.clone(), at + 4, b"UL")).expect("a file can be written");
    inspected(&path, &["a.dcm", "(0008,0016) has 30 bytes; a number of it (UL) has 4"]);
    for (length, says) in [(20u32, "ends at byte 164, but it ends at 316"), (u32::MAX, "ends at byte 4294967439")] {
        fs::write(&path, with(sound.clone(), 140, &length.to_le_bytes())).expect("a file can be written");
        inspected(&path, &["a.dcm", "(0002,0000) says that the file's meta group", says]);
    }
    fs::write(&path, with(sound, 140 - 2, &[8, 0])).expect("a file can be written");
    inspected(&path, &["a.dcm", "byte 132: (0002,0000) has 8 bytes; it must be the first element, of 4"]);
}

#[test]
fn parts_of_a_body() {
    use std::io::Write;

    let place = folder();
    let path = place.path().join("a.section");
    let head = replaced(&seed("section/whole"), "\"dims\":[12,10]", "\"dims\":[1048576,1048576]");
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(&head).expect("memory can be written");
    fs::write(&path, packed.finish().expect("memory can be written")).expect("a file can be written");
    let output = place.path().join("out.stl").display().to_string();
    refused(&["merge", &path.display().to_string(), "-o", &output], &["MiB of memory"]);
    assert!(!Path::new(&output).exists());
}
