//! Files of a few bytes that ask for gigabytes: they are refused, or read for what they are, in little memory.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Command;

use crate::files::{disc, folder, write_stack};
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};

/// Address space that the program has here, KiB: a sound input takes less than 100 MiB of it.
const ROOM: u32 = 256 << 10;
/// Zeros in a bomb: more than [`ROOM`].
const ZEROS: usize = 512 << 20;

/// Exit code and words of `inspect` within [`ROOM`].
fn inspected(input: &Path) -> (Option<i32>, String) {
    let limited = format!("ulimit -v {ROOM} && exec \"$@\"");
    let program = env!("CARGO_BIN_EXE_interslice");
    let done = Command::new("sh")
        .args(["-c", &limited, "sh", program, "inspect"])
        .env("RAYON_NUM_THREADS", "1")
        .arg(input)
        .output()
        .expect("a shell is there");
    (done.status.code(), String::from_utf8_lossy(&[done.stdout, done.stderr].concat()).into_owned())
}

/// What is in `bytes` is refused with these words.
fn refused(name: &str, bytes: &[u8], says: &[&str]) {
    let place = folder();
    let path = place.path().join(name);
    fs::write(&path, bytes).expect("a file can be written");
    refused_at(&path, says);
}

fn refused_at(path: &Path, says: &[&str]) {
    let (code, said) = inspected(path);
    assert_eq!(code, Some(2), "{}: {said}", path.display());
    assert!(said.len() < 2000, "{}: {} bytes of words", path.display(), said.len());
    says.iter().for_each(|words| assert!(said.contains(words), "{}: `{words}` is not in: {said}", path.display()));
}

fn zlib(bytes: usize) -> Vec<u8> {
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::best());
    let zeros = vec![0; 1 << 20];
    (0..bytes >> 20).for_each(|_| packed.write_all(&zeros).expect("memory can be written"));
    packed.finish().expect("memory can be written")
}

fn chunk(name: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let mut check = flate2::Crc::new();
    check.update(name);
    check.update(data);
    [&(data.len() as u32).to_be_bytes()[..], name, data, &check.sum().to_be_bytes()].concat()
}

/// A stack of two slices, both this PNG of grey values: its sides, what it has beside its pixels, and its packed rows.
fn slices(place: &Path, [columns, rows]: [u32; 2], beside: &[u8], pixels: &[u8]) {
    let header = [&columns.to_be_bytes()[..], &rows.to_be_bytes(), &[8, 0, 0, 0, 0]].concat();
    let png =
        [b"\x89PNG\r\n\x1a\n", &chunk(b"IHDR", &header)[..], beside, &chunk(b"IDAT", pixels), &chunk(b"IEND", b"")];
    fs::write(place.join("s.png"), png.concat()).expect("a file can be written");
    write_stack(place, r#"{"spacing_xy": [1, 1], "slices": [{"file": "s.png", "z": 0}, {"file": "s.png", "z": 1}]}"#);
}

/// Rows of 32 pixels, the right half inside.
fn half() -> Vec<u8> {
    let row = [&[0][..], &[0; 16], &[255; 16]].concat();
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(&row.repeat(32)).expect("memory can be written");
    packed.finish().expect("memory can be written")
}

#[test]
fn the_room_is_a_limit() {
    let place = folder();
    disc(&place.path().join("s.png"), 12_000, 5000.0);
    write_stack(
        place.path(),
        r#"{"spacing_xy": [1, 1], "slices": [{"file": "s.png", "z": 0}, {"file": "s.png", "z": 1}]}"#,
    );
    let (code, said) = inspected(place.path());
    assert_eq!(code, Some(2), "slices of 137 MiB were read within {} MiB: {said}", ROOM >> 10);
    assert!(said.contains("12000x12000 px take 1099 MiB of memory") && said.contains("are available"), "{said}");
    slices(place.path(), [32, 32], b"", &half());
    let (code, said) = inspected(place.path());
    assert_eq!(code, Some(0), "a sound stack is not read within {} MiB: {said}", ROOM >> 10);
}

#[test]
fn what_a_png_has_beside_its_pixels() {
    let bomb = zlib(ZEROS);
    for (name, head) in [(b"iCCP", &b"profile\0\0"[..]), (b"zTXt", b"Comment\0\0"), (b"iTXt", b"Comment\0\x01\0\0\0")] {
        let place = folder();
        slices(place.path(), [32, 32], &chunk(name, &[head, &bomb].concat()), &half());
        let (code, said) = inspected(place.path());
        assert_eq!(code, Some(0), "{}: {said}", String::from_utf8_lossy(name));
    }
}

#[test]
fn pixels_of_a_png() {
    let place = folder();
    slices(place.path(), [1 << 31, 1 << 31], b"", &half());
    refused_at(place.path(), &["slice 0 (`s.png`)"]);
    slices(place.path(), [2_000_000, 2_000_000], b"", &half());
    refused_at(place.path(), &["slice 0 (`s.png`)", "2000000x2000000 px take 30517579 MiB of memory"]);
    slices(place.path(), [32, 32], b"", &zlib(ZEROS));
    refused_at(place.path(), &["all slices are empty"]);
}

#[test]
fn tiff_of_30_bytes() {
    refused("a.tif", &[b"II*\0\x08\0\0\0", &[0xff; 22][..]].concat(), &["a.tif", "TIFF"]);
    // Two counts of values that no file holds: strips of a page.
    let entry = |tag: u16, count: u32, value: u32| {
        [&tag.to_le_bytes()[..], &[4, 0], &count.to_le_bytes(), &value.to_le_bytes()].concat()
    };
    let most = u32::MAX;
    let page =
        [entry(256, 1, 64), entry(257, 1, 64), entry(273, most, 8), entry(278, 1, 1), entry(279, most, 8)].concat();
    refused("a.tif", &[b"II*\0\x08\0\0\0\x05\0", &page[..], &[0; 4]].concat(), &["a.tif", "TIFF"]);
}

#[test]
fn volumes_of_few_bytes() {
    let mut nifti = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| nifti[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    put(40, &[3i16, 32767, 32767, 32767, 1, 1, 1, 1].map(i16::to_le_bytes).concat());
    put(70, &[2i16, 8].map(i16::to_le_bytes).concat());
    put(76, &[1f32; 8].map(f32::to_le_bytes).concat());
    put(108, &352f32.to_le_bytes());
    put(344, b"n+1\0");
    refused("a.nii", &nifti, &["a.nii", "32767 32767 32767"]);
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(&nifti).expect("memory can be written");
    refused("a.nii.gz", &packed.finish().expect("memory can be written"), &["a.nii.gz", "32767 32767 32767"]);
    // A gzip of zeros alone, 1000 to 1.
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    let zeros = vec![0; 1 << 20];
    (0..ZEROS >> 20).for_each(|_| packed.write_all(&zeros).expect("memory can be written"));
    let packed = packed.finish().expect("memory can be written");
    refused("b.nii.gz", &packed, &["b.nii.gz", "NIfTI"]);
    let header = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 10000 10000 10000\nspacings: 1 1 1\nencoding: gzip\n\n";
    refused("a.nrrd", &[&header[..], &packed].concat(), &["a.nrrd", "1000000000000 bytes of voxels"]);
    let header = b"NRRD0004\n#";
    refused("b.nrrd", &[&header[..], &vec![b'a'; 20 << 20]].concat(), &["b.nrrd"]);
}

#[test]
fn json_a_million_deep() {
    let deep = "[".repeat(1_000_000);
    let place = folder();
    write_stack(place.path(), &deep);
    refused_at(place.path(), &["stack.json"]);
    write_stack(place.path(), &format!(r#"{{"slices": [{{"z": 0, "polygons": {deep}"#));
    refused_at(place.path(), &["stack.json"]);
    #[cfg(feature = "terrain")]
    {
        let inner = r#"{"type":"GeometryCollection","geometries":["#.repeat(100_000);
        let map = format!(
            r#"{{"type":"FeatureCollection","features":[{{"type":"Feature","properties":{{}},"geometry":{inner}"#
        );
        refused("a.geojson", map.as_bytes(), &["a.geojson", "recursion limit"]);
        refused("b.geojson", format!(r#"{{"type":"FeatureCollection","features":{deep}"#).as_bytes(), &["b.geojson"]);
    }
}

#[cfg(feature = "terrain")]
#[test]
fn a_shapefile_of_two_billion_parts() {
    let place = folder();
    let most = i32::MAX.to_le_bytes();
    let record = [&3i32.to_le_bytes()[..], &[0; 32], &most, &most].concat();
    let words = |bytes: usize| ((bytes / 2) as i32).to_be_bytes();
    let file = |body: &[u8]| {
        let head = [
            &9994i32.to_be_bytes()[..],
            &[0; 20],
            &words(100 + body.len()),
            &1000i32.to_le_bytes(),
            &3i32.to_le_bytes(),
        ];
        [&head.concat(), &[0; 64][..], body].concat()
    };
    let shapes = file(&[&1i32.to_be_bytes()[..], &words(record.len()), &record].concat());
    let index = file(&[&50i32.to_be_bytes()[..], &words(record.len())].concat());
    for (name, bytes) in [
        ("a.shp", shapes),
        ("a.shx", index),
        ("a.dbf", [&[3][..], &[0; 7], &[65, 0, 1, 0], &[0; 20], &[0; 32], &[13]].concat()),
    ] {
        fs::write(place.path().join(name), bytes).expect("a file can be written");
    }
    refused_at(&place.path().join("a.shp"), &["a.shp"]);
}

#[cfg(feature = "dicom")]
#[test]
fn dicom_of_absurd_lengths() {
    let meta = [&[0; 128][..], b"DICM\x02\0\0\0UL\x04\0\x1c\0\0\0\x02\0\x10\0UI\x14\x001.2.840.10008.1.2.1\0"].concat();
    let with = |rest: &[u8]| [&meta, rest].concat();
    let most = 0xffff_fff0u32.to_le_bytes();
    refused("a.dcm", &with(&[b"\x08\0\x60\0UN\0\0", &most[..]].concat()), &["a.dcm"]);
    let sequence = b"\x06\x30\x39\0SQ\0\0";
    refused("a.dcm", &with(&[sequence, &most[..], b"\xfe\xff\0\xe0", &most].concat()), &["a.dcm"]);
    // Sequences in items in sequences, none of which ends.
    let nested = [sequence, &[0xff; 4][..], b"\xfe\xff\0\xe0", &[0xff; 4]].concat().repeat(100_000);
    refused("a.dcm", &with(&nested), &["a.dcm"]);
}

#[test]
fn arrays_of_numpy() {
    let npy = |header: &str| [b"\x93NUMPY\x01\0", &(header.len() as u16).to_le_bytes()[..], header.as_bytes()].concat();
    let header = "{'descr':'|u1','fortran_order':False,'shape':(4294967295,4294967295,4294967295)}\n";
    refused("a.npy", &npy(header), &["a.npy", "4294967295 4294967295 4294967295"]);
    refused("a.npy", b"\x93NUMPY\x02\0\xff\xff\xff\xff{", &["a.npy", "header of 4294967295 bytes"]);
}

/// Zeros, packed by gzip 1000 to 1.
#[cfg(feature = "zarr")]
fn gzip(bytes: usize) -> Vec<u8> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    let zeros = vec![0; 1 << 20];
    (0..bytes >> 20).for_each(|_| packed.write_all(&zeros).expect("memory can be written"));
    packed.finish().expect("memory can be written")
}

/// An array of 4 x 8 x 8 bytes in one chunk of these sizes, in `c/0/0/0`.
#[cfg(feature = "zarr")]
fn array(folder: &Path, chunk: [usize; 3], codecs: &serde_json::Value, bytes: &[u8]) {
    let array = serde_json::json!({"zarr_format": 3, "node_type": "array", "shape": [4, 8, 8], "data_type": "uint8", "fill_value": 0,
        "attributes": {}, "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}}, "codecs": codecs});
    fs::create_dir_all(folder.join("c/0/0")).expect("a folder can be made");
    fs::write(folder.join("zarr.json"), array.to_string()).expect("a file can be written");
    fs::write(folder.join("c/0/0/0"), bytes).expect("a file can be written");
}

#[cfg(feature = "zarr")]
#[test]
fn chunks_of_zarr() {
    use serde_json::json;

    let place = folder();
    let path = place.path().join("a.zarr");
    let bytes = || json!({"name": "bytes"});
    let packed = |by| json!([bytes(), by]);
    let gzipped = || json!({"name": "gzip", "configuration": {"level": 1}});
    let bomb = gzip(ZEROS);
    let holds = "its metadata say that it holds at most 256 bytes";
    array(&path, [4, 8, 8], &packed(gzipped()), &bomb);
    refused_at(&path, &["a.zarr", "layers from 0 on: c/0/0/0: gzip unpacks to more", holds]);
    // In a shard: its only chunk, then where that lies, and how long it is.
    let shard = json!([{"name": "sharding_indexed", "configuration": {"chunk_shape": [4, 8, 8], "codecs": packed(gzipped()),
        "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}], "index_location": "end"}}]);
    let index = [0, bomb.len() as u64].map(u64::to_le_bytes).concat();
    array(&path, [4, 8, 8], &shard, &[&bomb[..], &index].concat());
    refused_at(&path, &["a.zarr", "c/0/0/0: gzip unpacks to more", holds]);
    // An index that points beyond its shard.
    let index = [1 << 40, 1u64 << 40].map(u64::to_le_bytes).concat();
    array(&path, [4, 8, 8], &shard, &[&bomb[..], &index].concat());
    refused_at(&path, &["a.zarr", "c/0/0/0: "]);
    #[cfg(feature = "zstd")]
    {
        // Blocks that repeat a byte 128 Ki times; the header does not say how many there are.
        let block = |last: u32| {
            let [a, b, c, _] = (last | 1 << 1 | (1 << 17) << 3).to_le_bytes();
            [a, b, c, 0]
        };
        let frame = [0x28, 0xb5, 0x2f, 0xfd, 0, 0x38];
        let blocks = [block(0).repeat((ZEROS >> 17) - 1), block(1).to_vec()].concat();
        let zstd = json!({"name": "zstd", "configuration": {"level": 1, "checksum": false}});
        array(&path, [4, 8, 8], &packed(zstd), &[&frame[..], &blocks].concat());
        refused_at(&path, &["a.zarr", "c/0/0/0: zstd unpacks to more", holds]);
    }
    #[cfg(feature = "blosc")]
    {
        use zarrs::array::codec::{BloscCompressor, BloscShuffleMode, blosc_compress_bytes};
        let level = 9.try_into().expect("a level of Blosc");
        let none = BloscShuffleMode::NoShuffle;
        let bomb = blosc_compress_bytes(&vec![0; ZEROS], level, none, 1, BloscCompressor::LZ4, 0, 1);
        let blosc = json!({"name": "blosc", "configuration": {"cname": "lz4", "clevel": 9, "shuffle": "noshuffle", "blocksize": 0}});
        array(&path, [4, 8, 8], &packed(blosc), &bomb.expect("zeros can be packed"));
        refused_at(&path, &["a.zarr", "c/0/0/0: Blosc unpacks to 536870912 bytes", holds]);
    }
    // And of version 2.
    fs::remove_dir_all(&path).expect("it is there");
    fs::create_dir(&path).expect("a folder can be made");
    let array = json!({"zarr_format": 2, "shape": [4, 8, 8], "chunks": [4, 8, 8], "dtype": "|u1", "compressor": {"id": "gzip", "level": 1},
        "fill_value": 0, "order": "C", "filters": null});
    fs::write(path.join(".zarray"), array.to_string()).expect("a file can be written");
    fs::write(path.join("0.0.0"), &bomb).expect("a file can be written");
    refused_at(&path, &["a.zarr", "0.0.0: gzip unpacks to more", holds]);
    fs::write(path.join(".zarray"), array.to_string().replace("gzip", "zlib")).expect("a file can be written");
    fs::write(path.join("0.0.0"), zlib(ZEROS)).expect("a file can be written");
    refused_at(&path, &["a.zarr", "0.0.0: zlib unpacks to more", holds]);
}

/// Views whose rows are not in the file.
#[cfg(feature = "geopackage")]
#[test]
fn layers_of_geopackage() {
    let place = folder();
    let path = place.path().join("a.gpkg");
    let count = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 300000)";
    for (rows, says) in [
        ("SELECT zeroblob(600000000) AS geom, 1 AS Elev".to_string(), "too big"),
        ("SELECT NULL AS geom, printf('%600000000d', 1) AS Elev".to_string(), "too big"),
        (
            format!("{count} SELECT NULL AS geom, i AS Elev, i AS a, i AS b, i AS c FROM n"),
            "its values are more than 6",
        ),
        (format!("{count} SELECT NULL AS geom, zeroblob(1000) AS Elev FROM n"), "its values are more than 6"),
        (format!("{count} SELECT NULL AS geom, group_concat(zeroblob(1000)) AS Elev FROM n"), "too big"),
    ] {
        let _ = fs::remove_file(&path);
        let database = rusqlite::Connection::open(&path).expect("a database can be made");
        let text = format!(
            "CREATE TABLE gpkg_contents (table_name TEXT PRIMARY KEY, data_type TEXT);
             CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, geometry_type_name TEXT, srs_id INTEGER, z INTEGER, m INTEGER);
             INSERT INTO gpkg_contents VALUES ('lines', 'features');
             INSERT INTO gpkg_geometry_columns VALUES ('lines', 'geom', 'LINESTRING', 0, 0, 0);
             CREATE VIEW lines AS {rows};"
        );
        database.execute_batch(&text).expect("tables");
        drop(database);
        refused_at(&path, &["a.gpkg", "layer `lines`", says]);
    }
}
