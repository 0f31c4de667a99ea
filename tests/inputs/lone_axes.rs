//! Volumes of four axes and more, of which all but three have a length of 1: programs for pictures over time save a single one so.

use std::fs;
use std::path::Path;

use crate::files::*;
use interslice::input::open_volume;
use interslice::input::volume::Volume;

const VOXELS: usize = 12 * 10 * 4;

fn voxels() -> Vec<u8> {
    (0..VOXELS).map(|n| (n * 7 % 5) as u8).collect()
}

/// The volume of a file with these fields, whose voxels follow.
fn volume(place: &Path, name: &str, fields: &str) -> Result<(Volume, Vec<i64>), String> {
    let path = place.join(name);
    fs::write(&path, [fields.as_bytes(), &voxels()].concat()).expect("a file can be written");
    let volume = open_volume(&path).map_err(|e| e.to_string())?;
    let mut values = Vec::new();
    volume.labels(|run| values.extend_from_slice(run.values)).map_err(|e| e.to_string())?;
    Ok((volume, values))
}

fn nrrd_of(place: &Path, fields: &str) -> Result<(Volume, Vec<i64>), String> {
    let more = "type: uint8\nencoding: raw\nspace: left-posterior-superior\nspace origin: (10,-20.5,300)";
    volume(place, "a.nrrd", &format!("NRRD0004\n{more}\n{fields}\n\n"))
}

const DIRECTIONS: &str = "(0.8,0.6,0) (-1.2,1.6,0) (0,0,2.5)";

#[test]
fn a_nrrd_lies_as_without_its_axes_of_length_one() {
    let place = folder();
    let plain =
        nrrd_of(place.path(), &format!("dimension: 3\nsizes: 12 10 4\nspace directions: {DIRECTIONS}")).expect("sound");
    for fields in [
        format!(
            "dimension: 4\nsizes: 1 12 10 4\nkinds: vector domain domain domain\nspace directions: none {DIRECTIONS}"
        ),
        format!(
            "dimension: 4\nsizes: 12 10 4 1\nkinds: domain domain domain time\nspace directions: {DIRECTIONS} none"
        ),
        format!("dimension: 4\nsizes: 12 10 4 1\nspace directions: {DIRECTIONS} (0,0,0)"),
        format!("dimension: 5\nsizes: 1 12 10 4 1\nspace directions: none {DIRECTIONS} none"),
    ] {
        let (volume, values) = nrrd_of(place.path(), &fields).expect(&fields);
        assert_eq!((&volume.grid, &values), (&plain.0.grid, &plain.1), "{fields}");
    }
    // An axis of time in the world, too, as ITK has it.
    let four = "type: uint8\nencoding: raw\nspace origin: (10,-20.5,300,7)\ndimension: 4\nsizes: 12 10 4 1\nspace dimension: 4";
    for (more, time) in [("", "(0,0,0,2)"), ("\nspace: left-posterior-superior-time", "(0,0,0,1)")] {
        let directions = format!("space directions: (0.8,0.6,0,0) (-1.2,1.6,0,0) (0,0,2.5,0) {time}");
        let (volume, values) =
            volume(place.path(), "c.nrrd", &format!("NRRD0004\n{four}\n{directions}{more}\n\n")).expect(time);
        assert_eq!((&volume.grid, &values), (&plain.0.grid, &plain.1), "{time}{more}");
    }
    let turned = "space directions: (0.8,0.6,0,0) (-1.2,1.6,0,0) (0,0,2,1.5) (0,0,-0.6,0.8)";
    let turned =
        volume(place.path(), "c.nrrd", &format!("NRRD0004\n{four}\n{turned}\n\n")).expect_err("a turn in time");
    assert!(turned.contains("space directions have 4 components"), "{turned}");
    // Spacings, least positions and centres are by axis, too.
    let spaced =
        |fields: &str| volume(place.path(), "b.nrrd", &format!("NRRD0004\ntype: uint8\nencoding: raw\n{fields}\n\n"));
    let plain = "dimension: 3\nsizes: 12 10 4\nspacings: 1 2 3\naxis mins: 5 6 7\ncenters: node cell node";
    let four = "dimension: 4\nsizes: 12 1 10 4\nspacings: 1 nan 2 3\naxis mins: 5 nan 6 7\ncenters: node ??? cell node";
    let [plain, four] = [plain, four].map(|fields| spaced(fields).expect(fields));
    assert_eq!((plain.0.grid, plain.1), (four.0.grid, four.1));
}

#[test]
fn a_nrrd_of_which_several_readings_are_possible_is_refused() {
    let place = folder();
    let said = |fields: &str| nrrd_of(place.path(), fields).map(|(volume, _)| volume.grid.dims);
    // Nobody says which is an axis of space; where it is said it is that.
    let doubtful = said("dimension: 4\nsizes: 1 12 40 1\nspacings: 1 1 1 1").expect_err("either may be meant");
    assert!(
        doubtful.contains("sizes are 1 12 40 1") && doubtful.contains("`kinds` or `space directions`"),
        "{doubtful}"
    );
    let told = format!(
        "dimension: 4\nsizes: 1 12 40 1\nkinds: vector domain domain domain\nspace directions: none {DIRECTIONS}"
    );
    assert_eq!(said(&told), Ok([12, 40, 1]));
    // Five channels of a single slice are no five slices.
    let channels = format!(
        "dimension: 4\nsizes: 4 12 10 1\nkinds: list domain domain domain\nspace directions: none {DIRECTIONS}"
    );
    let channels = said(&channels).expect_err("four channels");
    assert!(channels.contains("dimension is 4") && channels.contains("(a time, a channel)"), "{channels}");
    let times = said("dimension: 4\nsizes: 12 10 2 2\nspacings: 1 1 1 1").expect_err("two times");
    assert!(times.contains("dimension is 4"), "{times}");
}

fn meta(place: &Path, fields: &str) -> Result<(Volume, Vec<i64>), String> {
    let (begin, end) = ("ObjectType = Image\nBinaryData = True\n", "ElementType = MET_UCHAR\nElementDataFile = LOCAL");
    volume(place, "a.mha", &format!("{begin}{fields}\n{end}\n"))
}

#[test]
fn a_metaimage_lies_as_without_its_axes_of_length_one() {
    let place = folder();
    let plain = "NDims = 3\nDimSize = 12 10 4\nElementSpacing = 1 2 2.5\nOffset = 10 -20.5 300\n\
                 TransformMatrix = 0.8 0.6 0 -0.6 0.8 0 0 0 1";
    let plain = meta(place.path(), plain).expect("sound");
    for fields in [
        "NDims = 4\nDimSize = 12 10 4 1\nElementSpacing = 1 2 2.5 40\nOffset = 10 -20.5 300 7\n\
         TransformMatrix = 0.8 0.6 0 0 -0.6 0.8 0 0 0 0 1 0 0 0 0 1",
        "NDims = 4\nDimSize = 1 12 10 4\nElementSpacing = 40 1 2 2.5\nOffset = 7 10 -20.5 300\n\
         TransformMatrix = 1 0 0 0 0 0.8 0.6 0 0 -0.6 0.8 0 0 0 0 1",
        "NDims = 5\nDimSize = 12 10 4 1 1\nElementSpacing = 1 2 2.5 1 1\nOffset = 10 -20.5 300 0 0\n\
         TransformMatrix = 0.8 0.6 0 0 0 -0.6 0.8 0 0 0 0 0 1 0 0 0 0 0 1 0 0 0 0 0 1",
    ] {
        let (volume, values) = meta(place.path(), fields).expect(fields);
        assert_eq!((&volume.grid, &values), (&plain.0.grid, &plain.1), "{fields}");
    }
}

#[test]
fn a_metaimage_of_which_several_readings_are_possible_is_refused() {
    let place = folder();
    let said = |fields: &str| meta(place.path(), fields).expect_err(fields);
    let doubtful = said("NDims = 4\nDimSize = 12 40 1 1");
    assert!(doubtful.contains("DimSize is 12 40 1 1") && doubtful.contains("2 axes have a length of 1"), "{doubtful}");
    let times = said("NDims = 4\nDimSize = 12 10 2 2");
    assert!(times.contains("NDims is 4") && times.contains("(a time, a channel)"), "{times}");
    let turned = said("NDims = 4\nDimSize = 12 10 4 1\nTransformMatrix = 1 0 0 0 0 1 0 0 0 0 0.8 0.6 0 0 -0.6 0.8");
    assert!(turned.contains("TransformMatrix turns axis 3"), "{turned}");
}
