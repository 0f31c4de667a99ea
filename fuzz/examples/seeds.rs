//! Writes the seeds of all targets, `seeds/<target>/<name>`: small files by the program's own writers, and by those of the crates where it
//! only reads.

use std::f64::consts::TAU;
use std::fs;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use std::sync::Arc;

use dicom_core::value::{DataSetSequence, PrimitiveValue};
use dicom_core::{DataElement, Length, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::mem::InMemElement;
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};
use flate2::read::GzDecoder;
use image::{GrayImage, ImageFormat, Luma};
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::section_file::SectionWriter;
use interslice::files::{JobOptions, Loaded};
use interslice::progress::Silent;
use interslice::stack::appearance::{Appearance, Segment};
use interslice::stack::{Geometry, Slice, SliceContent};
use interslice::surface::map::{Crs, Floor, Map};
use interslice::{Budget, ContourStack, Means, Reference};
use interslice_fuzz::BETWEEN;
use shapefile::dbase::{FieldValue, Record, TableWriterBuilder};
use tiff::encoder::{TiffEncoder, colortype::Gray8, colortype::Gray16};
use tiff::tags::Tag as TiffTag;

type Try<T = ()> = Result<T, Box<dyn std::error::Error>>;

const DIMS: [usize; 2] = [12, 10];
const HEIGHTS: [f64; 3] = [0.0, 2.0, 4.5];

fn main() -> Try {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("seeds");
    let keep = |target: &str, name: &str, bytes: &[u8]| -> Try {
        let folder = seeds.join(target);
        fs::create_dir_all(&folder)?;
        Ok(fs::write(folder.join(name), bytes)?)
    };
    written(&keep)?;
    arrays(&keep)?;
    slices(&keep)?;
    for (name, syntax) in [("explicit", uids::EXPLICIT_VR_LITTLE_ENDIAN), ("implicit", uids::IMPLICIT_VR_LITTLE_ENDIAN)]
    {
        let whole = structure_set(syntax)?;
        keep("rtstruct", name, &whole)?;
        // A data set by itself, behind preamble, magic, and the meta group with its length.
        let [a, b, c, d] = [140, 141, 142, 143].map(|at| whole[at]);
        let data_set = &whole[144 + u32::from_le_bytes([a, b, c, d]) as usize..];
        keep("rtstruct", &format!("bare-{name}"), data_set)?;
    }
    keep("shapefile", "cone", &shapes()?)?;
    words(&keep)
}

type Keep<'k> = &'k dyn Fn(&str, &str, &[u8]) -> Try;

fn disc(slice: usize, node: usize) -> bool {
    let (x, y) = ((node % DIMS[0]) as f64, (node / DIMS[0]) as f64);
    (x - 5.0 - 0.5 * slice as f64).hypot(y - 4.5) < 3.4 - 0.5 * slice as f64
}

fn mask(slice: usize) -> Vec<bool> {
    (0..DIMS[0] * DIMS[1]).map(|node| disc(slice, node)).collect()
}

fn loaded(output: OutputOptions) -> Try<Loaded> {
    let slice = |(k, z): (usize, &f64)| Slice {
        name: format!("k={k}"),
        z: *z,
        extra: false,
        content: SliceContent::Mask(mask(k).into_iter().collect()),
    };
    let stack = ContourStack {
        dims: DIMS,
        spacing: [1.0, 1.5],
        unit: "mm".into(),
        slices: HEIGHTS.iter().enumerate().map(slice).collect(),
        z_out: None,
        geometry: Geometry { origin: [500_000.0, 4_000_000.0, -3.0].into(), ..Geometry::default() },
    };
    Ok(Loaded::new(stack, JobOptions { output, ..JobOptions::default() })?)
}

/// What the program writes and reads.
fn written(keep: Keep<'_>) -> Try {
    let place = tempfile::tempdir()?;
    let means = Means { backend: &Reference, progress: &Silent, budget: &Budget::unlimited() };
    let write = |names: &[&str], output: OutputOptions| -> Try {
        let paths: Vec<_> = names.iter().map(|name| place.path().join(name)).collect();
        let mut outputs = Outputs::open(&paths, None, Temporary::Random, &mut Places::default())?;
        let mut body = loaded(output)?.compute(&means, &mut outputs)?;
        outputs.complete(&mut body.report)?;
        outputs.rename()?;
        Ok(())
    };
    write(
        &["a.nrrd", "a.nii", "a.nii.gz", "a.mha"],
        OutputOptions { mask: true, dz: Some(1.5), ..OutputOptions::default() },
    )?;
    write(&["a.contours.json"], OutputOptions { dz: Some(2.25), ..OutputOptions::default() })?;
    let map = Map { crs: Crs::Epsg(32611), first: [0, 0], dims: DIMS, floor: Floor::default() };
    write(&["a.geojson"], OutputOptions { dz: Some(2.25), map: Some(Arc::new(map)), ..OutputOptions::default() })?;
    for (target, name) in [
        ("nrrd", "a.nrrd"),
        ("nifti", "a.nii"),
        ("nifti", "a.nii.gz"),
        ("mha", "a.mha"),
        ("folder", "a.contours.json"),
        ("geojson", "a.geojson"),
    ] {
        keep(target, &name.replace("a.", ""), &fs::read(place.path().join(name))?)?;
    }
    let path = place.path().join("a.section");
    let map = Map { crs: Crs::Epsg(32611), first: [1, 2], dims: DIMS.map(|n| n - 2), floor: Floor::default() };
    let segment = Some(Segment { id: Some("Segment_1".into()), tags: Some("Segmentation.Status:completed|".into()) });
    let bodies =
        vec![Appearance { name: Some("a body".into()), number: Some(1), colour: Some([200, 100, 50]), segment }];
    let whole = loaded(OutputOptions { dz: Some(2.25), map: Some(Arc::new(map)), bodies, ..OutputOptions::default() })?;
    let mut writer = SectionWriter::open(&path, [1, 1], "0".repeat(64), &whole, &mut Places::default())?;
    let body = whole.compute_section(&whole.section(1, 1)?, &means, &mut writer)?;
    writer.finish(&body.report)?;
    let mut bytes = Vec::new();
    GzDecoder::new(fs::File::open(path)?).read_to_end(&mut bytes)?;
    keep("section", "whole", &bytes)
}

/// Volumes by other writers: raw, detached, big-endian, floats.
fn arrays(keep: Keep<'_>) -> Try {
    let bytes: Vec<u8> = (0..3).flat_map(mask).map(u8::from).collect();
    let shorts: Vec<u8> = bytes.iter().flat_map(|v| [0, *v]).collect();
    let floats: Vec<u8> = bytes.iter().flat_map(|v| f32::from(*v).to_le_bytes()).collect();
    let header =
        |kind: &str, more: &str| format!("NRRD0004\ntype: {kind}\ndimension: 3\nsizes: 12 10 3\n{more}\n").into_bytes();
    keep("nrrd", "raw", &[header("uchar", "encoding: raw\nspacings: 1 1 2\n"), bytes.clone()].concat())?;
    let skips = "encoding: raw\ndata file: data\nbyte skip: 2\nline skip: 1";
    keep("nrrd", "detached", &[&header("uchar", skips), BETWEEN, b"a line\nxx", &bytes].concat())?;
    keep("nrrd", "short", &[header("short", "encoding: raw\nendian: big\nbyte skip: -1\n"), shorts.clone()].concat())?;
    let mut bzip2 = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
    bzip2.write_all(&bytes)?;
    keep("nrrd", "bzip2", &[header("uchar", "encoding: bzip2\n"), bzip2.finish()?].concat())?;
    let ras =
        "encoding: raw\nendian: little\nspace: RAS\nspace directions: (0,1,0) (1,0,0) (0,0,2)\nspace origin: (1,2,3)\n";
    let segments = "encoding: raw\nSegment0_LabelValue:=1\nSegment0_Name:=a\\nb\nSegment0_Color:=0.5 1 0\n";
    keep("nrrd", "segments", &[header("uchar", segments), bytes.clone()].concat())?;
    keep("nrrd", "float", &[header("float", ras), floats.clone()].concat())?;
    let mha = "ObjectType = Image\nNDims = 3\nDimSize = 12 10 3\nElementType = MET_SHORT\nElementByteOrderMSB = True\n";
    keep(
        "mha",
        "detached",
        &[mha.as_bytes(), b"HeaderSize = -1\nElementDataFile = data\n", BETWEEN, &shorts].concat(),
    )?;
    let mha =
        "NDims = 3\nDimSize = 12 10 3\nElementSpacing = 1 1 2\nElementType = MET_FLOAT\nElementDataFile = LOCAL\n";
    keep("mha", "float", &[mha.as_bytes(), &floats].concat())?;
    for (name, descr, order, data) in
        [("bytes", "|u1", "False", &bytes), ("shorts", ">i2", "True", &shorts), ("floats", "<f4", "False", &floats)]
    {
        let text = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': (3, 10, 12), }}\n");
        let length = u16::try_from(text.len())?.to_le_bytes();
        keep("npy", name, &[b"\x93NUMPY\x01\x00", &length[..], text.as_bytes(), data].concat())?;
    }
    const OME: &str = r#"<?xml version="1.0"?><OME><Image><Pixels DimensionOrder="XYZCT" SizeX="12" SizeY="10" SizeZ="3" SizeC="1" SizeT="1" PhysicalSizeX="0.5" PhysicalSizeY="0.5" PhysicalSizeZ="2" PhysicalSizeZUnit="mm" Type="uint8"><TiffData IFD="0" PlaneCount="3"/></Pixels></Image></OME>"#;
    const IMAGEJ: &str = "ImageJ=1.53\nimages=3\nslices=3\nunit=mm\nspacing=2.0\n";
    for (name, description) in [("ome", OME), ("imagej", IMAGEJ), ("plain", "{\"shape\": [3, 10, 12]}")] {
        let mut out = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut out)?;
        for page in bytes.chunks(120) {
            let mut image = encoder.new_image::<Gray8>(12, 10)?;
            image.resolution(tiff::tags::ResolutionUnit::Inch, tiff::encoder::Rational { n: 2, d: 1 });
            image.encoder().write_tag(TiffTag::ImageDescription, description)?;
            image.write_data(page)?;
        }
        keep("tiff", name, out.get_ref())?;
    }
    let mut out = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut out)?.with_compression(tiff::encoder::Compression::Lzw);
    for page in bytes.chunks(120) {
        encoder.write_image::<Gray16>(12, 10, &page.iter().map(|v| u16::from(*v)).collect::<Vec<_>>())?;
    }
    keep("tiff", "lzw", out.get_ref())
}

/// Folders of slices.
fn slices(keep: Keep<'_>) -> Try {
    let text = r#"{"spacing_xy": [1.0, 1.5], "unit": "mm", "outside": "black", "z_out": {"start": 0, "step": 1, "count": 4},
 "slices": [{"file": "s.png", "z": 0.0}, {"file": "s.png", "z": 4.5, "extra": true}]}"#;
    let grey =
        GrayImage::from_fn(12, 10, |x, y| Luma([if disc(0, (y * 12 + x) as usize) { 200 } else { (x * y) as u8 }]));
    for (name, format) in [("png", ImageFormat::Png), ("tiff", ImageFormat::Tiff)] {
        let mut out = Cursor::new(Vec::new());
        grey.write_to(&mut out, format)?;
        keep("folder", name, &[text.as_bytes(), BETWEEN, out.get_ref()].concat())?;
        keep("images", name, &[out.get_ref(), BETWEEN, out.get_ref()].concat())?;
    }
    let polygons = r#"{"axes": [[0,1,0],[0,0,1],[1,0,0]], "slices": [{"z": 0, "polygons": [[[0, 0], [9, 0], [9, 8], [0, 8]], [[3, 3], [6, 3], [6, 6]]]}, {"z": 5, "polygons": []}]}"#;
    keep("folder", "polygons", polygons.as_bytes())
}

fn text(tag: Tag, vr: VR, value: &str) -> InMemElement {
    DataElement::new(tag, vr, PrimitiveValue::from(value))
}

fn sequence(tag: Tag, items: Vec<InMemDicomObject>, length: Length) -> InMemElement {
    DataElement::new(tag, VR::SQ, DataSetSequence::new(items, length))
}

/// Two ROIs: a tube with a hole on three planes, and a point.
fn structure_set(syntax: &str) -> Try<Vec<u8>> {
    let circle = |radius: f64, z: f64| -> String {
        let at = |k: usize| TAU * k as f64 / 9.0;
        let point = |k: usize| format!("{:.2}\\{:.2}\\{z}", 10.0 + radius * at(k).cos(), -5.0 + radius * at(k).sin());
        (0..9).map(point).collect::<Vec<_>>().join("\\")
    };
    let contour = |kind: &str, points: usize, data: &str| {
        InMemDicomObject::from_element_iter([
            text(tags::CONTOUR_GEOMETRIC_TYPE, VR::CS, kind),
            text(tags::NUMBER_OF_CONTOUR_POINTS, VR::IS, &points.to_string()),
            text(tags::CONTOUR_DATA, VR::DS, data),
        ])
    };
    let mut tube: Vec<InMemDicomObject> = [0.0, 3.0, 6.0].map(|z| contour("CLOSED_PLANAR", 9, &circle(4.0, z))).into();
    tube.push(contour("CLOSED_PLANAR", 9, &circle(2.0, 3.0)));
    let rois = [("Tube", tube), ("Point", vec![contour("POINT", 1, "1\\2\\3")])];
    let named = rois.iter().enumerate().map(|(k, (name, _))| {
        InMemDicomObject::from_element_iter([
            text(tags::ROI_NUMBER, VR::IS, &(k + 1).to_string()),
            text(tags::ROI_NAME, VR::LO, name),
        ])
    });
    let named = named.collect();
    let drawn = rois.into_iter().enumerate().map(|(k, (_, contours))| {
        InMemDicomObject::from_element_iter([
            text(tags::ROI_DISPLAY_COLOR, VR::IS, "200\\100\\50"),
            text(tags::REFERENCED_ROI_NUMBER, VR::IS, &(k + 1).to_string()),
            sequence(tags::CONTOUR_SEQUENCE, contours, Length::UNDEFINED),
        ])
    });
    let object = InMemDicomObject::from_element_iter([
        text(tags::SOP_CLASS_UID, VR::UI, uids::RT_STRUCTURE_SET_STORAGE),
        text(tags::SOP_INSTANCE_UID, VR::UI, "1.2.3.4"),
        sequence(tags::STRUCTURE_SET_ROI_SEQUENCE, named, Length::UNDEFINED),
        sequence(tags::ROI_CONTOUR_SEQUENCE, drawn.collect(), Length::UNDEFINED),
    ]);
    let meta = FileMetaTableBuilder::new()
        .transfer_syntax(syntax)
        .media_storage_sop_class_uid(uids::RT_STRUCTURE_SET_STORAGE)
        .media_storage_sop_instance_uid("1.2.3.4");
    let mut out = Vec::new();
    object.with_meta(meta)?.write_all(&mut out)?;
    Ok(out)
}

/// Three rings: .shp, .dbf, .prj and .shx.
fn shapes() -> Try<Vec<u8>> {
    let place = tempfile::tempdir()?;
    let path = place.path().join("a.shp");
    let table = TableWriterBuilder::new()
        .add_numeric_field("ELEV".try_into()?, 8, 1)
        .add_character_field("NAME".try_into()?, 4);
    let mut writer = shapefile::Writer::from_path(&path, table)?;
    for (z, radius) in [(100.0, 40.0), (110.0, 25.0), (120.0, 10.0)] {
        let at = |k: usize| TAU * (k % 9) as f64 / 9.0;
        let point = |k: usize| shapefile::Point::new(5e5 + radius * at(k).cos(), 4e6 + radius * at(k).sin());
        let mut record = Record::default();
        record.insert("ELEV".into(), FieldValue::Numeric(Some(z)));
        record.insert("NAME".into(), FieldValue::Character(Some("ring".into())));
        writer.write_shape_and_record(&shapefile::Polyline::new((0..=9).map(point).collect()), &record)?;
    }
    drop(writer);
    let projection = br#"PROJCS["WGS_1984_UTM_Zone_11N",GEOGCS["GCS_WGS_1984"],UNIT["Meter",1.0]]"#;
    let file = |extension: &str| fs::read(path.with_extension(extension));
    Ok([&file("shp")?, BETWEEN, &file("dbf")?, BETWEEN, projection, BETWEEN, &file("shx")?].concat())
}

/// Texts.
fn words(keep: Keep<'_>) -> Try {
    let links = r#"{"links": [{"slice": 0, "from": 2, "to": 1}, {"slice": 1, "from": 1, "to": 3, "join": false}]}"#;
    keep("links", "two", links.as_bytes())?;
    let lines = r#"{"id": "a", "input": "a.nrrd", "outputs": ["a.stl", "a.origin.nrrd"], "options": {"dz": 0.5, "label": 3, "method": "field"}}
{"id": "b", "input": "a.nrrd", "outputs": ["b.nii.gz"], "options": {"end_top": "peak=9", "slices": [0, 4], "mask": true}}
"#;
    keep("manifest", "lines", lines.as_bytes())?;
    let settings = "method = \"morph\"\nmotion = \"rigid\"\nend_top = \"peak=3.5\"\nend_bottom = \"extrapolate\"\nslope = \"natural\"\nfair = 0.5\ncfl = 0.4\nlink = \"auto\"\nlink_reach = 8\nmask = true\ndz = 0.25\naxis = \"z\"\nroi = [\"Heart\", 3]\n";
    keep("settings", "many", settings.as_bytes())?;
    keep("settings", "field", b"method = \"field\"\nmotion = \"none\"\nsigma = 0.7\nhalf_width = 4\ncut_off = 3.0\n")?;
    let table = "id,input,outputs,options\na,a.nrrd,a.stl;a.json,dz=0.5;label=3\nb,a.nrrd,b.ply,\"{\"\"axis\"\": \"\"x\"\"}\"\n";
    keep("manifest", "table", table.as_bytes())
}
