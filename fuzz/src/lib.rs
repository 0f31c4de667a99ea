//! What the targets do: an input's bytes become files in a folder in memory, which a reader reads. The program's own tests
//! (`tests/hostile/fuzzed.rs`) do the same with the seeds, with damaged seeds, and with the inputs that once failed.

use std::cell::OnceCell;
use std::fs;
use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use interslice::batch::manifest::Manifest;
use interslice::files::JobOptions;
use interslice::files::named::Named;
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::section_file::Sections;
use interslice::grid::tile::Tile;
use interslice::input::format::{FORMATS, InputFormat};
use interslice::input::labels::{Wanted, read_labels};
use interslice::rtstruct::StructureSet;
use interslice::stack::links;
use interslice::stack::links::LinkOptions;
use interslice::stack::{Geometry, ReadOptions, Slice, SliceContent};
use interslice::storage::room;
use interslice::{ContourStack, Error, Known, Result, Settings, input};
use serde_json::Value;
use tempfile::TempDir;

/// What a target does: reads an input.
pub type Target = Box<dyn Fn(&[u8]) -> Result<()> + Send + Sync>;

/// All targets by name: every format of inputs, and what else a user brings.
pub fn targets() -> Vec<(&'static str, Target)> {
    let formats = FORMATS.iter().map(|format| {
        let target: Target = match format.name {
            "folder" => Box::new(folder),
            "rtstruct" => Box::new(rtstruct),
            "zarr" => Box::new(zarr),
            _ => Box::new(|bytes| of_format(format, bytes)),
        };
        (format.name, target)
    });
    let others: [(&str, Target); 5] = [
        ("images", Box::new(images)),
        ("links", Box::new(links)),
        ("manifest", Box::new(manifest)),
        ("section", Box::new(section)),
        ("settings", Box::new(settings)),
    ];
    formats.chain(others).collect()
}

/// Between the files of an input of several files.
pub const BETWEEN: &[u8] = b"\n%%%%\n";
/// Where grey values are cut.
const GREY: f64 = 0.5;
/// Most pixels of polygons that are tried: a file may ask for 2^30 of them, and is not wrong.
const MOST_PIXELS: f64 = (1 << 24) as f64;
/// Bytes that writing a body may take.
const MOST_WRITING: u64 = 1 << 28;

/// Runs a target: an error is the input's fault, and names the file, the slice or the setting.
pub fn run(target: &Target, bytes: &[u8]) -> Result<()> {
    let result = target(bytes);
    if let Err(e) = &result {
        assert_eq!(e.exit_code(), 2, "{e}");
        let named = match e {
            Error::Read { path, .. } | Error::Format { path, .. } | Error::Manifest { path, .. } => {
                path.file_name().is_some()
            }
            Error::Slice { name, .. } | Error::Setting { name, .. } => !name.is_empty(),
            Error::Memory { .. } => true,
            _ => false,
        };
        assert!(named, "names nothing: {e}");
    }
    result
}

/// Volumes and contour maps, with the files that may lie beside them.
fn of_format(format: &InputFormat, bytes: &[u8]) -> Result<()> {
    let first = format!("a.{}", format.extensions[0]);
    let beside = format.companions.iter().map(|c| if c.starts_with('.') { format!("a{c}") } else { (*c).to_string() });
    let names: Vec<String> = std::iter::once(first.clone()).chain(beside).collect();
    with_files(&names, bytes, |folder| {
        let path = folder.join(&first);
        if format.is_volume() { volume(&path) } else { map(&path) }
    })
}

/// A folder: `stack.json` with polygons, or with slices that are all one image (`s.png`), PNG or TIFF.
fn folder(bytes: &[u8]) -> Result<()> {
    let json = serde_json::from_slice(cut(bytes).0).unwrap_or_default();
    if pixels(&json) > MOST_PIXELS {
        return Ok(());
    }
    with_files(&["stack.json", "s.png"], bytes, |folder| read(folder, &ReadOptions::default()))
}

/// A folder of label images: two, in the order of their names.
fn images(bytes: &[u8]) -> Result<()> {
    with_files(&["images/2.png", "images/10.png"], bytes, |folder| {
        let options = ReadOptions { spacing: Some(vec![1.0, 1.0, 2.0]), ..ReadOptions::default() };
        let labels = read_labels(&folder.join("images"), &options, &Wanted::All)?;
        labels.validate().expect("a reader gives labels that may be reconstructed");
        Ok(())
    })
}

/// About the pixels that polygons are laid on, of the size that the file asks for.
fn pixels(json: &Value) -> f64 {
    fn numbers(value: &Value, out: &mut [Vec<f64>; 2]) {
        match value.as_array().map(Vec::as_slice) {
            Some([x, y]) if x.is_number() && y.is_number() => {
                [x, y].iter().zip(out).for_each(|(v, out)| out.extend(v.as_f64()));
            }
            Some(more) => more.iter().for_each(|v| numbers(v, out)),
            None => {}
        }
    }
    let slices = json["slices"].as_array().map(Vec::as_slice).unwrap_or_default();
    let mut places = [Vec::new(), Vec::new()];
    slices.iter().for_each(|s| numbers(&s["polygons"], &mut places));
    if places[0].is_empty() {
        return 0.0;
    }
    let side = |axis: usize| {
        let (low, high) =
            places[axis].iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        json["spacing_xy"][axis].as_f64().map_or(1.0, |h| ((high - low) / h).abs() + 20.0)
    };
    side(0) * side(1) * slices.len() as f64
}

/// DICOM RTSTRUCT: every ROI described, and the first ones read.
fn rtstruct(bytes: &[u8]) -> Result<()> {
    with_files(&["a.dcm"], bytes, |folder| {
        let path = folder.join("a.dcm");
        let set = StructureSet::read(&path)?;
        assert!(set.describe().len() > set.rois.len());
        let roi = |number: i64| ReadOptions { roi: vec![number.into()], ..ReadOptions::default() };
        let stacks = set.rois.iter().take(3).map(|r| read(&path, &roi(r.number)));
        stacks.reduce(Result::or).unwrap_or(Ok(()))
    })
}

/// A group of Zarr with the attributes of an image, an array in it, and its first two chunks; of version 2 where the array says so.
fn zarr(bytes: &[u8]) -> Result<()> {
    const THREE: [&str; 4] = ["a/zarr.json", "a/0/zarr.json", "a/0/c/0/0/0", "a/0/c/1/0/0"];
    const TWO: [&str; 4] = ["a/.zattrs", "a/0/.zarray", "a/0/0/0/0", "a/0/1/0/0"];
    const IS_TWO: &[u8] = b"\"zarr_format\": 2";
    let two = bytes.windows(IS_TWO.len()).any(|w| w == IS_TWO);
    let (names, others) = if two { (TWO, THREE) } else { (THREE, TWO) };
    with_files(&others[..2], b"", |folder| {
        others[..2].iter().for_each(|name| drop(fs::remove_file(folder.join(name))));
        with_files(&names, bytes, |folder| volume(&folder.join("a")))
    })
}

/// Links between the parts of three slices: two, one and three parts.
fn links(bytes: &[u8]) -> Result<()> {
    with_files(&["links.json"], bytes, |folder| {
        let links = links::read(&folder.join("links.json"), &small())?;
        assert!(links.iter().all(|l| l.slice < 2 && l.from > 0 && l.to > 0));
        Ok(())
    })
}

/// A part of a body on its way to `merge`, unpacked: it is packed here, so that gzip's checksum fits.
fn section(bytes: &[u8]) -> Result<()> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::none());
    let packed = packed.write_all(bytes).and_then(|()| packed.finish()).expect("memory can be written");
    with_files(&["a.section"], &packed, |folder| {
        let sections = Sections::open(&[folder.join("a.section")])?;
        let outputs = [folder.join("out.nrrd"), folder.join("out.stl")];
        let mut outputs = Outputs::open(&outputs, None, Temporary::Random, &mut Places::default())?;
        // As `merge` does.
        room::check(
            outputs.bytes(sections.dims(), sections.geometry(), sections.dims().iter().product()),
            Some(MOST_WRITING),
        )?;
        let options = OutputOptions { mask: false, ..sections.output() };
        options.check_ranges()?;
        let mut sink = outputs.sink(&options);
        sections.replay(&mut sink).map(drop)
    })
}

/// Manifests of batches: CSV where the first byte is an `i` (of `id,`), else JSON Lines.
fn manifest(bytes: &[u8]) -> Result<()> {
    let name = if bytes.starts_with(b"i") { "m.csv" } else { "m.jsonl" };
    with_files(&[name], bytes, |folder| {
        fs::write(folder.join("a.nrrd"), "").expect("a file can be written");
        let manifest = Manifest::read(&folder.join(name))?;
        assert!(!manifest.jobs.is_empty());
        Ok(())
    })
}

/// Settings as a TOML file has them, and a small body by those that are sound.
fn settings(bytes: &[u8]) -> Result<()> {
    let wrong = |message: String| Error::Setting { name: "settings".into(), message };
    let text = std::str::from_utf8(bytes).map_err(|e| wrong(e.to_string()))?;
    let mut named = Named::new(text.parse().map_err(|e: toml::de::Error| wrong(e.to_string()))?);
    let (read, of_read) = named.claim(ReadOptions::default(), |_| false);
    let (links, of_links) = named.claim(LinkOptions::default(), |_| false);
    let (settings, of_settings) = named.claim(Settings::default(), |_| false);
    let (output, of_output) = named.claim(OutputOptions::default(), |_| false);
    let all = [of_read, of_links, of_settings, of_output, named.unknown().map(String::from).collect()].concat();
    if !all.is_empty() {
        return Err(wrong(all.join("; ")));
    }
    let options = JobOptions { read, links, settings, output, settings_file: None };
    options.check()?;
    // A stage may fail, in words.
    let known = Known { part: Tile { origin: [1, 0], dims: [4, 6] }, onward: 1 };
    let known = (bytes.len() % 2 == 1).then_some(known);
    let _ = interslice::reconstruct(&ContourStack { known, ..small() }, &options.settings);
    Ok(())
}

/// Three small slices of two, one and three parts.
fn small() -> ContourStack {
    let slice = |(z, parts): (f64, usize)| {
        let mask = (0..64).map(|node| node % 8 != 7 && node / 8 < 2 * parts && node / 8 % 2 == 0).collect();
        Slice { name: format!("k={z}"), z, extra: false, content: SliceContent::Mask(mask) }
    };
    let slices = [(0.0, 2), (1.0, 1), (2.0, 3)].map(slice).into();
    let (unit, geometry) = (String::from("mm"), Geometry::default());
    ContourStack { dims: [8, 8], spacing: [1.0; 2], unit, slices, z_out: None, geometry, known: None }
}

/// The bytes before the first [`BETWEEN`], and those behind it.
fn cut(bytes: &[u8]) -> (&[u8], Option<&[u8]>) {
    let at = bytes.windows(BETWEEN.len()).position(|w| w == BETWEEN);
    at.map_or((bytes, None), |at| (&bytes[..at], Some(&bytes[at + BETWEEN.len()..])))
}

thread_local! {
    static FOLDER: OnceCell<TempDir> = const { OnceCell::new() };
}

/// Calls `each` with a folder in which the pieces of `bytes` are the files `names`, in their order; the last has all that is left.
fn with_files(names: &[impl AsRef<Path>], bytes: &[u8], each: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    FOLDER.with(|folder| {
        let in_memory = || tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir());
        let folder = folder.get_or_init(|| in_memory().expect("a folder can be made")).path();
        let mut rest = Some(bytes);
        for (k, name) in names.iter().enumerate() {
            let path = folder.join(name);
            path.parent().map_or(Ok(()), fs::create_dir_all).expect("a folder can be made");
            let Some(all) = rest else {
                let _ = fs::remove_file(path);
                continue;
            };
            let (piece, more) = if k + 1 < names.len() { cut(all) } else { (all, None) };
            fs::write(path, piece).expect("a file can be written");
            rest = more;
        }
        each(folder)
    })
}

/// Reads a stack of any kind; what comes back is one that may be reconstructed.
fn read(path: &Path, options: &ReadOptions) -> Result<()> {
    let stack = input::read(path, options)?;
    stack.validate().expect("a reader gives a stack that may be reconstructed");
    Ok(())
}

/// Reads a volume as grey values, as one body and as many labels.
fn volume(path: &Path) -> Result<()> {
    // Not every volume of labels crosses this level.
    match read(path, &ReadOptions { level: Some(GREY), ..ReadOptions::default() }) {
        Err(e) if !matches!(e, Error::Setting { .. }) => return Err(e),
        _ => {}
    }
    read(path, &ReadOptions::default())?;
    // A single drawn slice is a body, but no label.
    if let Ok(labels) = read_labels(path, &ReadOptions::default(), &Wanted::All) {
        labels.validate().expect("a reader gives labels that may be reconstructed");
    }
    Ok(())
}

/// Reads a contour map in the system that it names, or in none.
fn map(path: &Path) -> Result<()> {
    let local = || ReadOptions { crs: Some("local".into()), ..ReadOptions::default() };
    read(path, &ReadOptions::default()).or_else(|_| read(path, &local()))
}
