//! Wrong fields of MetaImage and TIFF, and voxel sides given twice.

use interslice::input::format::InputFormat;

use super::sources::*;
use crate::files::{folder, sound_stack};

#[test]
fn fields_of_a_metaimage() {
    let with = |from: &str, to: &str, says: &[&str]| {
        let bytes = sound("a.mha");
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("the field is there");
        let spoilt = [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat();
        refused("a.mha", &spoilt, &[], says);
    };
    with("ObjectType = Image", "ObjectType = Tube", &["ObjectType must be Image; got Tube"]);
    with("NDims = 3", "NDims = 4", &["NDims is 4; a label volume has 3"]);
    with("MET_UCHAR", "MET_STRING", &["ElementType `MET_STRING` is not known"]);
    with(
        "ElementSpacing = 1 1 1",
        "ElementSpacing = 1 1 -1",
        &["spacing along axis 2 must be a positive number; got -1"],
    );
    for side in ["1e-200", "1e-16", "1e300"] {
        let says = format!("spacing along axis 2 must lie between 1e-15 and 1e15; got {side}");
        with("ElementSpacing = 1 1 1", &format!("ElementSpacing = 1 1 {side}"), &[&says]);
    }
    with("ElementSpacing = 1 1 1", "ElementSpacing = 1 NaN 1", &["ElementSpacing holds `NaN`"]);
    with("ElementSpacing = 1 1 1", "ElementSpacing = 1 1", &["ElementSpacing must be 3 numbers; got 2"]);
    with(
        "TransformMatrix = 1 0 0",
        "TransformMatrix = 2 0 0",
        &["TransformMatrix", "axis 0 must have length 1; got 2"],
    );
    with("TransformMatrix = 1 0 0 0 1 0", "TransformMatrix = 1 0 0 1 0 0", &["axes 0 and 1 are not perpendicular"]);
    with("Offset = 0 0 0", "Offset = 0 inf 0", &["Offset holds `inf`"]);
    with("CompressedData = True", "CompressedData = Yes", &["CompressedData must be True or False; got Yes"]);
    with("CompressedData = True", "CompressedData = False", &["data end after", "of 600 bytes"]);
    with("ElementDataFile = LOCAL", "ElementDataFile = LIST", &["ElementDataFile = LIST", "many files"]);
    with("ElementDataFile = LOCAL", "ElementDataFile = none.raw", &["ElementDataFile", "none.raw"]);
    with("BinaryData = True", "BinaryData = False", &["BinaryData is False"]);
    with("ElementType", "ElementNumberOfChannels = 3\nElementType", &["ElementNumberOfChannels must be 1; got 3"]);
}

#[test]
fn descriptions_of_a_tiff() {
    let with = |from: &str, to: &str, says: &[&str]| {
        // Of the same length, so that the file stays sound.
        assert_eq!(from.len(), to.len());
        let mut bytes = sound("a.tif");
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("the field is there");
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        refused("a.tif", &bytes, &[], says);
    };
    with("SizeT=\"1\"", "SizeT=\"2\"", &["OME-XML: SizeT is 2; a label volume has no time axis"]);
    with("SizeC=\"1\"", "SizeC=\"3\"", &["OME-XML: SizeC is 3; a label volume has no channel axis"]);
    with("SizeZ=\"5\"", "SizeZ=\"6\"", &["SizeZ is 6, but the file's pages make 5"]);
    with("PhysicalSizeX=\"0.5\"", "PhysicalSizeX=\"NaN\"", &["PhysicalSizeX must be a positive number; got NaN"]);
    with("PhysicalSizeZ=\"2\"", "PhysicalSizeQ=\"2\"", &["has no PhysicalSizeZ", "--spacing` 0.5,"]);
    with("PhysicalSizeX=\"0.5\"", "PhysicalSizeQ=\"0.5\"", &["PhysicalSizeX and Y must both be there"]);
    with("IFD=\"0\"", "IFD=\"1\"", &["pages are not in the order of z"]);
    with("</Pixels>", "</Pixelz>", &["a.tif", "OME-XML"]);
}

#[test]
fn spacing_is_refused_where_the_file_has_its_own() {
    for name in NAMES.into_iter().filter(|name| InputFormat::of_name(name).is_some_and(|(format, _)| format.sized)) {
        refused(name, &sound(name), &["--spacing", "1,2,3"], &["`spacing` is only for a file without its own", name]);
    }
    let input = folder();
    sound_stack(input.path());
    refused_in(
        input.path(),
        "stack.json",
        &["--spacing", "1,2,3"],
        &["`spacing` is not for anything but a label volume"],
    );
    refused_in(input.path(), "stack.json", &["--axis", "x"], &["`axis` is not for"]);
}
