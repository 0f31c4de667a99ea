//! P15: no input is ever overwritten, whatever its name on the command line.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::files::{folder, interslice, nrrd, sound_stack, stderr};
use interslice::input;
use interslice::stack::ReadOptions;
use tempfile::TempDir;

/// Closed lines around a hill, as GeoJSON.
const MAP: &str = r#"{"type": "FeatureCollection", "features": [
  {"type": "Feature", "properties": {"elevation": 10}, "geometry": {"type": "LineString",
    "coordinates": [[500, 500], [900, 500], [900, 900], [500, 900], [500, 500]]}},
  {"type": "Feature", "properties": {"elevation": 20}, "geometry": {"type": "LineString",
    "coordinates": [[600, 600], [800, 600], [800, 800], [600, 800], [600, 600]]}}]}"#;

/// One input of every kind, and files that are named beside it; `w` is a folder for outputs.
fn inputs() -> TempDir {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    let put = |name: &str, bytes: &[u8]| fs::write(at(name), bytes).expect("a file can be written");
    for name in ["s", "w", "w/deep"] {
        fs::create_dir(at(name)).expect("a folder can be made");
    }
    sound_stack(&at("s"));
    let labels: Vec<u8> = (0..12 * 12 * 3).map(|k| u8::from((3..9).contains(&(k % 12)) && k / 12 % 12 > 4)).collect();
    let space =
        "space directions: (1,0,0) (0,1,0) (0,0,4)\nspace: left-posterior-superior\nencoding: raw\nendian: little";
    put("a.nrrd", &nrrd(space, "uint8", [12, 12, 3], &labels));
    put("d.nhdr", &nrrd(&format!("{space}\ndata file: d.raw"), "uint8", [12, 12, 3], &[]));
    put("d.raw", &labels);
    let mhd = "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n\
               ElementSpacing = 1 1 4\nDimSize = 12 12 3\nElementType = MET_UCHAR\nElementDataFile = m.mha\n";
    put("m.mhd", mhd.as_bytes());
    put("m.mha", &labels);
    put("g.geojson", MAP.as_bytes());
    put("links.json", br#"{"links": []}"#);
    put("set.toml", b"cfl = 0.4\n");
    shapefile(&at("h.shp"));
    place
}

/// The same hill as a shapefile with a .dbf, .shx and .prj.
fn shapefile(path: &Path) {
    use shapefile::dbase::{FieldValue, Record, TableWriterBuilder};
    use shapefile::{Point, Polyline, Writer};
    let name = "elevation".try_into().expect("a name");
    let table = TableWriterBuilder::new().add_numeric_field(name, 10, 2);
    let mut writer = Writer::from_path(path, table).expect("it can be made");
    for (level, low, high) in [(10.0, 500.0, 900.0), (20.0, 600.0, 800.0)] {
        let ring = [[low, low], [high, low], [high, high], [low, high], [low, low]];
        let mut record = Record::default();
        record.insert("elevation".into(), FieldValue::Numeric(Some(level)));
        let line = Polyline::new(ring.map(|[x, y]| Point::new(x, y)).to_vec());
        writer.write_shape_and_record(&line, &record).expect("it can be written");
    }
    drop(writer);
    fs::write(path.with_extension("prj"), r#"PROJCS["Mine",GEOGCS["G"],UNIT["Meter",1.0]]"#).expect("written");
}

/// All files below a folder, and what is in them.
fn content(place: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let files = interslice::storage::folders::files_below(place).expect("the folder can be read");
    files.into_iter().map(|file| (file.clone(), fs::read(&file).unwrap_or_default())).collect()
}

/// Runs the program in `place`; it must refuse, name all of `says`, and touch nothing.
fn refused(place: &Path, arguments: &[&str], says: &[&str]) {
    let before = content(place);
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_interslice")).args(arguments).current_dir(place).output();
    let run = run.expect("the program starts");
    let said = stderr(&run);
    assert_eq!(run.status.code(), Some(2), "{arguments:?}: {said}");
    says.iter().for_each(|part| assert!(said.contains(part), "{arguments:?}: `{part}` is missing from: {said}"));
    assert!(!said.contains("running on"), "{arguments:?} is refused before the work: {said}");
    assert!(content(place) == before, "{arguments:?} has touched something");
}

/// Makes a link to a file.
type Link = dyn Fn(&Path, &Path) -> std::io::Result<()>;

/// Inputs with the files they consist of.
const READ: [(&str, &[&str]); 8] = [
    ("s", &["s/stack.json", "s/s0.png", "s/s2.png"]),
    ("s/stack.json", &["s/stack.json", "s/s1.png"]),
    ("a.nrrd", &["a.nrrd"]),
    ("d.nhdr", &["d.nhdr", "d.raw"]),
    ("m.mhd", &["m.mhd", "m.mha"]),
    ("g.geojson", &["g.geojson"]),
    ("h.shp", &["h.shp", "h.dbf", "h.shx", "h.prj"]),
    ("w/../a.nrrd", &["a.nrrd"]),
];

/// Options with a file that is read, and that file.
const BESIDE: [(&[&str], &str); 2] =
    [(&["--links", "links.json"], "links.json"), (&["--settings", "set.toml"], "set.toml")];

#[test]
fn no_input_is_an_output_under_its_own_name() {
    let place = inputs();
    let place = place.path();
    for (input, files) in READ {
        // Those whose names can be an output's.
        let named = |file: &&&str| ["json", "png", "nrrd", "mha", "geojson"].iter().any(|e| file.ends_with(e));
        for file in files.iter().filter(named) {
            for output in [file.to_string(), format!("./{file}"), format!("w/deep/../../{file}")] {
                refused(
                    place,
                    &["reconstruct", input, "-o", "w/x.stl", "-o", &output],
                    &[&output, file, "is the input"],
                );
            }
        }
    }
    refused(place, &["reconstruct", "s", "--report", "s/stack.json"], &["s/stack.json", "is the input"]);
    refused(place, &["reconstruct", "s", "--links", "links.json", "-o", "links.json"], &["is the input links.json"]);
    for part in [["run", "--part"], ["reconstruct", "--dz"]] {
        let [command, option] = part;
        let value = if command == "run" { "1/1" } else { "1" };
        let output = if command == "run" { "w/x.section" } else { "w/x.nrrd" };
        fs::hard_link(place.join("a.nrrd"), place.join(output)).expect("a link can be made");
        refused(place, &[command, "a.nrrd", option, value, "-o", output], &[output, "is the input a.nrrd"]);
    }
}

#[test]
fn no_input_is_an_output_by_a_link() {
    let place = inputs();
    let place = place.path();
    fs::copy(place.join("a.nrrd"), place.join("w/a.nrrd")).expect("it can be copied");
    let link = |make: &Link, file: &str, to: &str| {
        let _ = fs::remove_file(place.join(to));
        make(&place.join(file), &place.join(to)).expect("a link can be made");
    };
    let hard = |file: &Path, to: &Path| fs::hard_link(file, to);
    #[cfg(unix)]
    let soft = |file: &Path, to: &Path| std::os::unix::fs::symlink(file, to);
    let kinds: Vec<&Link> = vec![
        &hard,
        #[cfg(unix)]
        &soft,
    ];
    for make in kinds {
        // The output is a link to the input, to whatever file of it.
        for (input, files) in READ {
            for file in files {
                link(make, file, "w/out.nrrd");
                refused(place, &["reconstruct", input, "-o", "w/out.nrrd"], &["w/out.nrrd", "is the input"]);
            }
        }
        for (options, file) in BESIDE {
            link(make, file, "w/out.json");
            let arguments = [&["reconstruct", "s", "--report", "w/out.json"], options].concat();
            refused(place, &arguments, &["w/out.json", "is the input", file]);
        }
        // The input is a link to the output.
        link(make, "a.nrrd", "w/in.nrrd");
        refused(place, &["reconstruct", "w/in.nrrd", "-o", "a.nrrd"], &["a.nrrd", "is the input w/in.nrrd"]);
        refused(place, &["reconstruct", "w/in.nrrd", "-o", "w/in.nrrd"], &["is the input w/in.nrrd"]);
        refused(place, &["reconstruct", "w/in.nrrd", "--labels", "all", "-o", "a.nrrd"], &["is the input w/in.nrrd"]);
        link(make, "a.nrrd", "w/out.1.nrrd");
        let each = ["reconstruct", "a.nrrd", "--labels", "all", "--keep-overlaps", "-o", "w/out.nrrd"];
        refused(place, &each, &["out.1.nrrd", "is the input a.nrrd"]);
        // A job of a batch, and its results.
        link(make, "d.raw", "w/out.nrrd");
        let job = |output: &str| format!(r#"{{"id": "a", "input": "d.nhdr", "outputs": ["w/x.stl", "{output}"]}}"#);
        fs::write(place.join("jobs.jsonl"), job("w/out.nrrd")).expect("a file can be written");
        refused(place, &["batch", "jobs.jsonl"], &["line 1: output w/out.nrrd is read by line 1"]);
        fs::write(place.join("jobs.jsonl"), job("w/y.nrrd")).expect("a file can be written");
        for results in ["a.nrrd", "jobs.jsonl", "w/y.nrrd"] {
            link(make, "d.nhdr", "a.nrrd");
            refused(place, &["batch", "jobs.jsonl", "--results", results], &[results, "give it a name of its own"]);
        }
        fs::remove_file(place.join("a.nrrd")).expect("it is a link");
        fs::copy(place.join("w/a.nrrd"), place.join("a.nrrd")).expect("it can be copied");
    }
    // A part that is merged.
    let part = place.join("w/1.section").display().to_string();
    let input = place.join("s").display().to_string();
    let made = interslice(&["run", &input, "--part", "1/1", "-o", &part, "-q", "--backend", "cpu"]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    link(&hard, "w/1.section", "w/out.nrrd");
    refused(place, &["merge", "w/1.section", "-o", "w/out.nrrd"], &["w/out.nrrd", "is the input w/1.section"]);
}

#[test]
fn no_output_is_named_twice() {
    let place = inputs();
    let place = place.path();
    for (first, second) in [("w/x.nrrd", "./w/x.nrrd"), ("w/x.stl", "w/deep/../x.stl"), ("x.json", "./x.json")] {
        refused(place, &["reconstruct", "s", "-o", first, "-o", second], &[second, "is named twice: it is", first]);
        refused(place, &["reconstruct", "s", "-o", "w/a.png", "-o", first, "-o", first], &[first, "is named twice"]);
    }
    refused(place, &["reconstruct", "s", "-o", "x.json", "--report", "./x.json"], &["./x.json", "is named twice"]);
    let own = ["reconstruct", "a.nrrd", "--labels", "all", "-o", "w/x.glb", "-o", "w/./x.glb"];
    refused(place, &own, &["w/./x.glb", "is named twice"]);
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(place.join("w"), place.join("v")).expect("a link can be made");
        refused(place, &["reconstruct", "s", "-o", "w/x.nrrd", "-o", "v/x.nrrd"], &["v/x.nrrd", "is named twice"]);
    }
}

#[test]
fn no_output_joins_the_input() {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    ["im", "masks", "out"].iter().for_each(|name| fs::create_dir(at(name)).expect("a folder can be made"));
    (1..4).for_each(|k| crate::files::disc(&at(&format!("im/{k}.png")), 32, 7.0 + f64::from(k)));
    let voxels: Vec<u8> =
        (0..32 * 32 * 9).map(|n| u8::from(n / 1024 % 4 == 0 && (8..24).contains(&(n % 32)))).collect();
    let mask = crate::files::nrrd("spacings: 1 1 2\nencoding: raw", "uint8", [32, 32, 9], &voxels);
    fs::write(at("masks/liver.nrrd"), mask).expect("a file can be written");
    let slices = ["reconstruct", "im", "--spacing", "1,1,4", "--backend", "cpu"];
    let masks = ["reconstruct", "masks", "--label", "liver", "--backend", "cpu"];
    for (run, output, one) in [
        (&slices, "im/new.png", "a slice of the input im"),
        (&slices, "out/../im/new.TIF", "a slice of the input im"),
        (&masks, "masks/out.nii.gz", "a mask of the input masks"),
        (&masks, "masks/out.nrrd", "a mask of the input masks"),
    ] {
        refused(
            place.path(),
            &[&run[..], &["-o", "out/a.stl", "-o", output]].concat(),
            &[output, one, "another folder"],
        );
    }
    // Others are none of them: the same line works twice.
    for (run, outputs) in [(&slices, ["im/a.stl", "im/a.json"]), (&masks, ["masks/a.png", "masks/a.stl"])] {
        for _ in 0..2 {
            let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_interslice"));
            let done = command.current_dir(place.path()).args(run).args(["-o", outputs[0], "-o", outputs[1]]).output();
            let done = done.expect("the program starts");
            assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
        }
    }
}

#[test]
fn readers_say_all_that_they_read() {
    let place = inputs();
    for (input, named) in READ.iter().filter(|(input, _)| !input.contains("..")) {
        let from = place.path().join(input);
        let options = ReadOptions::default();
        let files = input::files(&from).expect("it says them");
        named.iter().for_each(|name| assert!(files.contains(&place.path().join(name)), "{input}: {name} in {files:?}"));
        // What they name is all there is to it: a copy of these files is the same stack.
        let copy = folder();
        for file in &files {
            let to = copy.path().join(file.strip_prefix(place.path()).expect("it is in that folder"));
            fs::create_dir_all(to.parent().expect("a folder")).expect("a folder can be made");
            fs::copy(file, to).expect("it can be copied");
        }
        let all = |path: &Path| {
            let options = interslice::files::JobOptions { read: options.clone(), ..Default::default() };
            let loaded = interslice::files::Loaded::read(path, options).expect("it can be read");
            let told = format!("{:?} {:?} {:?}", loaded.stack, loaded.notes, loaded.options.output);
            told.replace(&path.parent().expect("a folder").display().to_string(), "")
        };
        assert!(all(&from) == all(&copy.path().join(input)), "{input} is more than {files:?}");
    }
}

#[test]
fn a_run_that_is_killed_leaves_what_was_there() {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    ["in", "out", "out/v.zarr", "out/v.zarr/0"]
        .iter()
        .for_each(|name| fs::create_dir(at(name)).expect("a folder can be made"));
    (0..3).for_each(|k| crate::files::disc(&at(&format!("in/s{k}.png")), 300, 100.0 + 10.0 * f64::from(k)));
    let slices = r#"{"file": "s0.png", "z": 0}, {"file": "s1.png", "z": 40}, {"file": "s2.png", "z": 80}"#;
    crate::files::write_stack(&at("in"), &format!(r#"{{"spacing_xy": [1, 1], "slices": [{slices}]}}"#));
    let had = ["out/v.nrrd", "out/m.stl", "out/v.zarr/0/zarr.json"];
    had.iter().for_each(|name| fs::write(at(name), name).expect("a file can be written"));
    let own = r#"{"attributes": {"interslice": {}}}"#;
    fs::write(at("out/v.zarr/zarr.json"), own).expect("a file can be written");
    let outputs = ["out/v.nrrd", "out/m.stl", "out/v.zarr"].map(|name| at(name).display().to_string());
    let input = at("in").display().to_string();
    let mut run = std::process::Command::new(env!("CARGO_BIN_EXE_interslice"));
    run.args(["reconstruct", &input, "--dz", "0.25", "--backend", "cpu", "-q"]);
    for output in &outputs {
        run.args(["-o", output]);
    }
    let mut run = run.spawn().expect("the program starts");
    let is_temporary = |path: &PathBuf| path.to_string_lossy().contains(".interslice-");
    while crate::files::listing(&at("out")).iter().filter(|path| is_temporary(path)).count() < 3 {
        assert!(run.try_wait().expect("it can be asked").is_none(), "it has ended before it could be killed");
        std::thread::yield_now();
    }
    std::thread::sleep(std::time::Duration::from_millis(200));
    run.kill().expect("it runs");
    let ended = run.wait().expect("it has ended");
    assert!(!ended.success(), "it was killed in the middle");
    for name in had {
        assert_eq!(fs::read_to_string(at(name)).expect("it is there"), name);
    }
    assert_eq!(fs::read_to_string(at("out/v.zarr/zarr.json")).expect("it is there"), own);
}
