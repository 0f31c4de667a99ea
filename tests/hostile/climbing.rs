//! Names out of data files lead nowhere: outputs lie where the user said, be it by a link, links under temporary names are replaced and not followed, what
//! is no file is not waited for, and a terminal obeys no name.

use std::fs;
use std::io::Write;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::files::*;
use interslice::files::member_names::words;

/// Names that lead elsewhere, are none, are reserved, are too long, or make another format of `out.tif`, `.obj`, `.json` and `.nrrd`.
const NAMES: [&str; 23] = [
    "../../up",
    "/etc/x",
    "..",
    ".",
    "",
    "   ",
    "CON",
    "nul.txt",
    "a\\b",
    "c:d",
    "a\u{0}b",
    "dem",
    "OME",
    "seg",
    "groups",
    "contours",
    "origin",
    "A",
    "a",
    "a-19",
    "\u{1b}[31mred",
    "\u{202e}drow",
    "ſ",
];

fn names() -> Vec<String> {
    NAMES
        .map(String::from)
        .into_iter()
        .chain(["L".repeat(300), "é".repeat(200), "本".repeat(150), "S".into()])
        .collect()
}

#[test]
fn words_are_each_their_own_and_short() {
    let names = names();
    let numbered = names.iter().map(String::as_str).zip(1..);
    // Names that are what other names would become.
    let twins = [("x", 50), ("x-52", 51), ("x", 52), ("X", 53), ("x-52-2", 54), ("x", 52)];
    let words = words(numbered.chain(twins));
    assert_eq!(words.len(), names.len() + twins.len());
    let mut folded: Vec<String> = words.iter().map(|w| w.to_uppercase().to_lowercase()).collect();
    folded.sort();
    folded.dedup();
    assert_eq!(folded.len(), words.len(), "{words:?}");
    for word in &words {
        assert!(!word.is_empty() && word.len() <= 150, "{} bytes: {word}", word.len());
        assert!(word.chars().all(|c| c.is_alphanumeric() || "-_+".contains(c)), "{word}");
        let lower = word.to_lowercase();
        assert!(
            !["dem", "ome", "seg", "groups", "contours", "origin", "confidence", "nii"].contains(&&*lower),
            "{word}"
        );
    }
}

/// A tube for each name.
#[cfg(feature = "dicom")]
fn structures(path: &Path, names: &[String]) {
    use dicom_core::VR;
    use dicom_dictionary_std::{tags, uids};
    let rois: Vec<_> = names.iter().map(|name| (name.as_str(), crate::rtss::tube(4.0, &[0.0, 3.0, 6.0]))).collect();
    let mut object = crate::rtss::structure_set(&rois);
    object.put(crate::rtss::text(tags::SPECIFIC_CHARACTER_SET, VR::CS, "ISO_IR 192"));
    crate::rtss::write_as(object, uids::EXPLICIT_VR_LITTLE_ENDIAN, path);
}

/// All that lies in a folder and those below, but for the folder `out`.
fn beside(place: &Path) -> Vec<std::path::PathBuf> {
    let mut files = interslice::storage::folders::files_below(place).expect("the folder is there");
    files.retain(|path| !path.starts_with(place.join("deep/out")));
    files
}

#[cfg(feature = "dicom")]
#[test]
fn rois_of_any_name_stay_in_the_folder() {
    let place = folder();
    let out = place.path().join("deep/out");
    fs::create_dir_all(&out).expect("a folder can be made");
    let names = names();
    structures(&place.path().join("in.dcm"), &names);
    let before = beside(place.path());
    let done = Command::new(env!("CARGO_BIN_EXE_interslice"))
        .args(["reconstruct", "../../in.dcm", "--all-rois", "--pixel", "2", "--backend", "cpu"])
        .args(["-o", "out.stl", "-o", "out.tif", "-o", "all.glb", "-o", "all.groups.obj", "--report", "out.json"])
        .current_dir(&out)
        .output()
        .expect("the program starts");
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    assert_eq!(beside(place.path()), before, "nothing else was written");
    let written = listing(&out);
    assert_eq!(written.len(), 3 * names.len() + 2, "{written:#?}");
    let lengths: Vec<u64> = written
        .iter()
        .filter(|path| path.extension().is_some_and(|e| e == "tif"))
        .map(|path| {
            let name = path.file_name().expect("a name").to_string_lossy().into_owned();
            assert!(!name.to_lowercase().ends_with(".dem.tif") && !name.to_lowercase().ends_with(".ome.tif"), "{name}");
            fs::metadata(path).expect("it is there").len()
        })
        .collect();
    assert!(lengths.len() == names.len() && lengths.iter().all(|n| *n == lengths[0]), "one format: {lengths:?}");
    let said = stderr(&done);
    assert!(said.contains("[31mred") && !said.contains(['\u{1b}', '\u{0}', '\u{202e}']), "a terminal obeys none");
    // As jobs of a batch, whose names are data too.
    let manifest = place.path().join("deep/m.jsonl");
    let line = r#"{"id": "../../id", "input": "../in.dcm", "outputs": ["out/b.stl"], "options": {"all_rois": true, "pixel": 2}}"#;
    fs::write(&manifest, line).expect("a file can be written");
    let done = interslice(&["batch", &manifest.display().to_string(), "--backend", "cpu", "--quiet"]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    assert_eq!(listing(&out).len(), written.len() + names.len());
    let new: Vec<_> = beside(place.path()).into_iter().filter(|path| !before.contains(path)).collect();
    let own = |path: &Path| path.starts_with(place.path().join("deep"));
    assert!(!new.is_empty() && new.iter().all(|path| own(path)), "{new:?}");
}

/// A label volume whose segments have these names.
fn segments(path: &Path, names: &[&str]) {
    let (nx, nz) = (8 * names.len(), 5);
    let inside = |n: usize| n % 8 > 1 && n % 8 < 6 && (2..6).contains(&(n / nx % 8));
    let bytes: Vec<u8> = (0..nx * 8 * nz).map(|n| if inside(n) { (n % nx / 8 + 1) as u8 } else { 0 }).collect();
    let named = |(k, name): (usize, &&str)| format!("\nSegment{k}_LabelValue:={}\nSegment{k}_Name:={name}", k + 1);
    let header = format!("spacings: 1 1 1\nencoding: raw{}", names.iter().enumerate().map(named).collect::<String>());
    fs::write(path, nrrd(&header, "uchar", [nx, 8, nz], &bytes)).expect("a file can be written");
}

#[test]
fn labels_of_any_name_stay_in_the_folder() {
    let place = folder();
    let out = place.path().join("deep/out");
    fs::create_dir_all(&out).expect("a folder can be made");
    segments(&place.path().join("in.nrrd"), &["../../up", "/etc/x", "..", "\u{1b}[31mred"]);
    let before = beside(place.path());
    let done = Command::new(env!("CARGO_BIN_EXE_interslice"))
        .args(["reconstruct", "../../in.nrrd", "--labels", "all", "--backend", "cpu"])
        .args(["-o", "o.stl", "-o", "o.glb", "-o", "o.groups.obj", "-o", "o.3mf", "-o", "o.seg.nrrd", "-o", "o.json"])
        .current_dir(&out)
        .output()
        .expect("the program starts");
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    assert_eq!(beside(place.path()), before, "nothing else was written");
    let names = ["o.1.stl", "o.2.stl", "o.3.stl", "o.3mf", "o.4.stl", "o.glb", "o.groups.obj", "o.json", "o.seg.nrrd"];
    assert_eq!(listing(&out), names.map(|name| out.join(name)));
    let told = interslice(&["inspect", &place.path().join("in.nrrd").display().to_string(), "--labels", "all"]);
    let told = String::from_utf8_lossy(&[told.stdout, told.stderr].concat()).into_owned();
    assert!(told.contains("`../../up`") && told.contains("\u{fffd}[31mred") && !told.contains('\u{1b}'), "{told}");
}

/// A name that no file can have is told before the work, and nothing of the others is written.
#[test]
fn names_that_no_file_can_have() {
    let place = folder();
    sound_stack(place.path());
    let input = place.path().display().to_string();
    let before = listing(place.path());
    let [good, long] = ["good.stl".into(), "n".repeat(252) + ".stl"].map(|name| format!("{input}/{name}"));
    let done = interslice(&["reconstruct", &input, "--backend", "cpu", "-o", &good, "-o", &long]);
    let said = stderr(&done);
    assert_eq!(done.status.code(), Some(2), "{said}");
    assert!(said.contains("is no name for a file here") && said.contains("256 bytes"), "{said}");
    assert_eq!(listing(place.path()), before);
    // 255 bytes are a name.
    let longest = format!("{input}/{}.stl", "n".repeat(251));
    let done = interslice(&["reconstruct", &input, "--backend", "cpu", "-o", &longest]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    fs::remove_file(&longest).expect("it was written");
    let manifest = place.path().join("m.jsonl");
    for (name, says) in [("a\\u0000b.stl".into(), "NUL"), ("n".repeat(252) + ".stl", "256 bytes")] {
        let line = format!("{{\"id\": \"a\", \"input\": \".\", \"outputs\": [\"good.stl\", \"{name}\"]}}");
        fs::write(&manifest, line).expect("a file can be written");
        let done = interslice(&["batch", &manifest.display().to_string(), "--backend", "cpu"]);
        let said = stderr(&done);
        assert_eq!(done.status.code(), Some(2), "{said}");
        assert!(said.contains("line 1: outputs") && said.contains(says), "{said}");
        fs::remove_file(&manifest).expect("it is there");
        assert_eq!(listing(place.path()), before);
    }
}

/// A link under an output's name is the user's, and is followed. One under that of its temporary file is not: what it leads to stays as it is.
#[test]
fn links_are_followed_under_the_names_that_a_user_has_given() {
    let place = folder();
    let (inputs, out) = (place.path().join("in"), place.path().join("out"));
    [&inputs, &out].into_iter().for_each(|folder| fs::create_dir(folder).expect("a folder can be made"));
    sound_stack(&inputs);
    let kept = place.path().join("kept");
    fs::write(&kept, "what the user had").expect("a file can be written");
    fs::write(place.path().join("old"), "what it leads to").expect("a file can be written");
    symlink("../old", out.join("a.stl")).expect("a link can be made");
    symlink("../not-there", out.join("b.stl")).expect("a link can be made");
    // The temporary file of a job of a batch has a name that can be known before.
    let fixed = format!(".interslice-{}.tmp", &blake3_of("c.stl")[..32]);
    symlink("../kept", out.join(&fixed)).expect("a link can be made");
    let manifest = place.path().join("m.jsonl");
    let line = |name: &str| format!("{{\"id\": \"{name}\", \"input\": \"in\", \"outputs\": [\"out/{name}\"]}}\n");
    fs::write(&manifest, ["a.stl", "b.stl", "c.stl"].map(line).concat()).expect("a file can be written");
    let done = interslice(&["batch", &manifest.display().to_string(), "--backend", "cpu", "--quiet"]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    assert_eq!(fs::read_to_string(&kept).expect("it is there"), "what the user had");
    assert_eq!(listing(&out), ["a.stl", "b.stl", "c.stl"].map(|name| out.join(name)));
    let bytes = |name: &str| fs::read(place.path().join(name)).expect("it was written");
    assert!(bytes("old") == bytes("out/c.stl") && bytes("not-there") == bytes("out/c.stl"));
    for (path, is_link) in listing(&out).iter().zip([true, true, false]) {
        assert_eq!(path.is_symlink(), is_link, "{}", path.display());
    }
    // A pipe or a link under the name of a lock is not waited for, and not followed.
    let lock = out.join(format!(".interslice-{}.lock", &blake3_of("d.stl")[..32]));
    let out = out.join("d.stl").display().to_string();
    for make in ["mkfifo", "ln"] {
        let made = match make {
            "ln" => Command::new(make).args(["-s", "../made"]).arg(&lock).status(),
            _ => Command::new(make).arg(&lock).status(),
        };
        assert!(made.expect("it starts").success(), "{make}");
        let done = interslice(&["reconstruct", &inputs.display().to_string(), "--backend", "cpu", "-o", &out]);
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
        assert!(!place.path().join("made").exists());
        let _ = fs::remove_file(&lock);
    }
}

fn blake3_of(name: &str) -> String {
    blake3::hash(name.as_bytes()).to_hex().to_string()
}

#[cfg(feature = "zarr")]
#[test]
fn a_folder_behind_a_link_is_as_any_other() {
    let place = folder();
    sound_stack(place.path());
    let at = |name: &str| place.path().join(name);
    fs::create_dir(at("kept.zarr")).expect("a folder can be made");
    fs::write(at("kept.zarr/zarr.json"), "{}").expect("a file can be written");
    symlink("kept.zarr", at("out.zarr")).expect("a link can be made");
    let [input, output] = [place.path(), &at("out.zarr")].map(|p| p.display().to_string());
    let run = || interslice(&["reconstruct", &input, "--backend", "cpu", "-o", &output]);
    let refused = run();
    assert!(refused.status.code() == Some(2) && stderr(&refused).contains("out.zarr"), "{}", stderr(&refused));
    assert_eq!(listing(&at("kept.zarr")), [at("kept.zarr/zarr.json")]);
    assert_eq!(fs::read_to_string(at("kept.zarr/zarr.json")).expect("it is there"), "{}");
    // One that is not there is made, and then written again.
    fs::remove_dir_all(at("kept.zarr")).expect("it can be removed");
    for _ in 0..2 {
        let done = run();
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
        assert!(at("out.zarr").is_symlink() && at("kept.zarr/zarr.json").is_file());
    }
}

/// Exit code and words of `inspect`, which must end by itself.
fn inspected(input: &Path) -> (Option<i32>, String) {
    let mut run = Command::new(env!("CARGO_BIN_EXE_interslice"))
        .args([Path::new("inspect"), input])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let begin = Instant::now();
    while run.try_wait().expect("it is asked").is_none() {
        if begin.elapsed() > Duration::from_secs(20) {
            run.kill().expect("it can be ended");
            run.wait().expect("it ends");
            panic!("{}: it waits", input.display());
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let done = run.wait_with_output().expect("it has ended");
    (done.status.code(), stderr(&done))
}

/// Pipes and devices that a link, or a name in a file, leads to: an error, whatever reads them.
#[test]
fn what_is_no_file_is_not_waited_for() {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    assert!(Command::new("mkfifo").arg(at("pipe")).status().expect("mkfifo is there").success());
    let refused = |name: &str, says: &[&str]| {
        let (code, said) = inspected(&at(name));
        assert_eq!(code, Some(2), "{name}: {said}");
        says.iter().for_each(|words| assert!(said.contains(words), "{name}: `{words}` is not in: {said}"));
    };
    let no_file = "it is a pipe, a device or a socket, not a file";
    for target in ["pipe", "/dev/zero"] {
        for name in [
            "a",
            "a.nrrd",
            "a.nii",
            "a.mha",
            "a.tif",
            "a.npy",
            "a.npz",
            "a.dcm",
            "a.geojson",
            "a.shp",
            "a.gpkg",
            "a.json",
        ] {
            symlink(target, at(name)).expect("a link can be made");
            refused(name, &[name, no_file]);
            fs::remove_file(at(name)).expect("it is there");
        }
        // Named by a file.
        fs::create_dir_all(at("stack")).expect("a folder can be made");
        let named = if target == "pipe" { "../pipe" } else { target };
        let slice = |z: usize| format!("{{\"file\": \"{named}\", \"z\": {z}}}");
        write_stack(&at("stack"), &format!("{{\"spacing_xy\": [1, 1], \"slices\": [{}, {}]}}", slice(0), slice(1)));
        refused("stack", &["slice 0", no_file]);
        let header = "type: uchar\ndimension: 3\nsizes: 4 4 4\nspacings: 1 1 1\nencoding: raw";
        for skip in ["", "\nline skip: 1", "\nbyte skip: -1"] {
            fs::write(at("a.nhdr"), format!("NRRD0004\n{header}{skip}\ndata file: {target}\n\n")).expect("room");
            refused("a.nhdr", &["a.nhdr", "data"]);
        }
        let header = "NDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\nHeaderSize = -1";
        fs::write(at("a.mhd"), format!("{header}\nElementDataFile = {target}\n")).expect("room");
        refused("a.mhd", &["a.mhd"]);
        // Beside what is read.
        fs::create_dir_all(at("masks")).expect("a folder can be made");
        symlink(if target == "pipe" { "../pipe" } else { target }, at("masks/liver.nrrd")).expect("a link can be made");
        refused("masks", &["masks"]);
        fs::remove_file(at("masks/liver.nrrd")).expect("it is there");
    }
}

/// Names of members in an archive are names and no places.
#[test]
fn members_of_an_archive_are_not_unpacked() {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    fs::create_dir_all(at("deep/in")).expect("a folder can be made");
    let header = "{'descr': '|u1', 'fortran_order': False, 'shape': (4, 6, 6), }\n";
    let mut array = b"\x93NUMPY\x01\x00".to_vec();
    array.extend((header.len() as u16).to_le_bytes());
    array.extend(header.as_bytes());
    array.extend((0..144).map(|n| u8::from(n % 6 > 0 && n % 6 < 5 && (1..5).contains(&(n / 6 % 6)))));
    let absolute = at("up.npy").display().to_string();
    for name in ["../../up.npy", "../up.npy", &absolute, "..\\up.npy", "a/../../up.npy"] {
        let mut archive = zip::ZipWriter::new(fs::File::create(at("deep/in/a.npz")).expect("a file can be made"));
        archive.start_file(name, zip::write::SimpleFileOptions::default()).expect("a member");
        archive.write_all(&array).expect("its bytes");
        archive.finish().expect("an archive");
        let before = beside(place.path());
        let output = at("out.stl").display().to_string();
        let input = at("deep/in/a.npz").display().to_string();
        let done = interslice(&["reconstruct", &input, "--spacing", "1,1,2", "--backend", "cpu", "-o", &output]);
        assert_eq!(done.status.code(), Some(0), "{name}: {}", stderr(&done));
        fs::remove_file(&output).expect("it was written");
        assert_eq!(beside(place.path()), before, "{name}");
    }
}

/// What the user writes is his wish, also where it leads up.
#[test]
fn a_path_that_the_user_writes_is_followed() {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    fs::create_dir_all(at("deep/in")).expect("a folder can be made");
    sound_stack(&at("deep/in"));
    let line = r#"{"id": "a", "input": "in", "outputs": ["../up/a.stl"]}"#;
    fs::write(at("deep/m.jsonl"), line).expect("a file can be written");
    let done = interslice(&["batch", &at("deep/m.jsonl").display().to_string(), "--backend", "cpu", "--quiet"]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    assert_eq!(listing(&at("up")), [at("up/a.stl")]);
    // Slices may lie elsewhere; they are read, and nothing is written there.
    let text = fs::read_to_string(at("deep/in/stack.json")).expect("it is there");
    fs::create_dir(at("other")).expect("a folder can be made");
    write_stack(&at("other"), &text.replace("\"file\": \"", "\"file\": \"../deep/in/"));
    let before = listing(&at("deep/in"));
    let output = at("up/b.stl").display().to_string();
    let done = interslice(&["reconstruct", &at("other").display().to_string(), "--backend", "cpu", "-o", &output]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    assert_eq!(listing(&at("deep/in")), before);
}
