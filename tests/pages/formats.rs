//! Formats in docs/formats.md, in README.md's tables, in help and in messages: those of the program's own tables, and no other.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

use interslice::files::format::known;
use interslice::input::format::FORMATS;

use crate::{ROOT, sources};

/// Extensions of all inputs. A folder is named by its `stack.json`.
fn inputs() -> BTreeSet<String> {
    FORMATS.iter().filter(|f| f.name != "folder").flat_map(|f| f.extensions).map(|e| format!(".{e}")).collect()
}

/// Extensions of all outputs.
fn outputs() -> BTreeSet<String> {
    dotted(&known())
}

/// Words that begin with a dot, as extensions do: `.nii.gz`, and neither the end of `x.nrrd` nor `..`.
fn dotted(text: &str) -> BTreeSet<String> {
    let words = text.split(|c: char| !c.is_ascii_alphanumeric() && !"._-<>{}".contains(c));
    let words = words.map(|w| w.trim_end_matches('.'));
    words
        .filter(|w| w.starts_with('.') && w[1..].starts_with(char::is_alphanumeric) && w.contains(char::is_alphabetic))
        .map(str::to_string)
        .collect()
}

/// Extensions of all formats, inputs and outputs, that a page does not name between back-quotes.
fn unnamed(text: &str) -> Vec<String> {
    let all: BTreeSet<String> = inputs().into_iter().chain(outputs()).collect();
    assert!(all.len() > 18, "{all:?}");
    all.into_iter().filter(|e| !text.contains(&format!("`{e}`"))).collect()
}

#[test]
fn every_format_stands_in_its_page() {
    let text = fs::read_to_string(Path::new(ROOT).join("docs/formats.md")).expect("the page is there");
    assert_eq!(unnamed(&text), ["extension"; 0]);
    assert_eq!(unnamed(&text.replace("`.mhd`", "")), [".mhd"]);
    assert_eq!(unnamed(&text.replace("`.glb`", "")), [".glb"]);
}

/// Extensions between back-quotes in the first column of the table that begins so.
fn column(page: &str, heading: &str) -> BTreeSet<String> {
    let rows = page.lines().skip_while(|l| !l.starts_with(heading)).take_while(|l| l.starts_with('|'));
    let cells = rows.filter_map(|row| row.split('|').nth(1));
    cells
        .flat_map(|cell| cell.split('`').skip(1).step_by(2))
        .filter(|w| w.starts_with('.'))
        .map(str::to_string)
        .collect()
}

/// README's tables name each format once they are read or written, and no other.
#[test]
fn readme_lists_the_formats() {
    let text = fs::read_to_string(Path::new(ROOT).join("README.md")).expect("the page is there");
    assert_eq!(column(&text, "| input |"), inputs());
    assert_eq!(column(&text, "| output |"), outputs());
}

/// What the program says of all its options, subcommand by subcommand.
fn helps() -> String {
    let help = |arguments: &[&str]| {
        let done = Command::new(env!("CARGO_BIN_EXE_interslice")).args(arguments).output().expect("the program runs");
        assert!(done.status.success(), "{arguments:?}");
        String::from_utf8(done.stdout).expect("text")
    };
    let list = help(&["--help"]);
    let list = list.lines().skip_while(|l| !l.starts_with("Commands:")).skip(1).take_while(|l| !l.is_empty());
    let names: Vec<&str> = list.filter_map(|l| l.strip_prefix("  ")?.split(' ').next()).collect();
    assert!(names.contains(&"reconstruct") && names.contains(&"batch"), "{names:?}");
    names.into_iter().filter(|n| !n.is_empty() && *n != "help").map(|name| help(&[name, "--help"])).collect()
}

/// The help of an option, in one line.
fn help_of(helps: &str, option: &str) -> String {
    let lines = helps.lines().skip_while(|l| !l.trim_start().starts_with(option)).skip(1);
    lines.take_while(|l| l.starts_with("          ")).map(str::trim).collect::<Vec<_>>().join(" ")
}

/// Formats that help names though there are none, and lists of some that are not what the tables say.
fn misnamed(helps: &str) -> Vec<String> {
    // Manifests, their results and parts of a body are no formats of contours or surfaces.
    let others = [".csv", ".jsonl", ".section"].map(str::to_string);
    let all: BTreeSet<String> = inputs().into_iter().chain(outputs()).chain(others).collect();
    let unsized_ones = FORMATS.iter().filter(|f| f.is_volume() && !f.sized).flat_map(|f| f.extensions);
    let known = known();
    let meshes = known.split("), ").find(|kind| kind.ends_with("(mesh")).expect("there are meshes");
    let lists = [("--spacing", unsized_ones.map(|e| format!(".{e}")).collect()), ("--simplify", dotted(meshes))];
    let mut wrong: Vec<String> = dotted(helps).difference(&all).cloned().collect();
    wrong.extend(lists.iter().filter(|(o, list)| dotted(&help_of(helps, o)) != *list).map(|(o, _)| o.to_string()));
    wrong
}

#[test]
fn help_names_the_formats_that_there_are() {
    let helps = helps();
    assert_eq!(misnamed(&helps), ["name"; 0]);
    assert_eq!(misnamed(&helps.replace(".html)", ".xhtml)")), [".xhtml"]);
    assert_eq!(misnamed(&helps.replace(".npy never", "they never")), ["--spacing"]);
    assert_eq!(
        misnamed(&helps.replace(
            "(.stl .ply .obj .glb .groups.obj .3mf .vtp) with",
            "(.stl .ply .obj .groups.obj .3mf .vtp) with"
        )),
        ["--simplify"]
    );
}

/// Extensions of formats in what a source file says, outside comments and its own tests.
fn said(text: &str) -> BTreeSet<String> {
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    let lines = code.lines().filter(|l| !l.trim_start().starts_with("//"));
    let formats: BTreeSet<String> = inputs().into_iter().chain(outputs()).collect();
    let words = lines.flat_map(|l| l.split('"').skip(1).step_by(2)).flat_map(dotted);
    words.filter(|w| formats.contains(w)).collect()
}

/// What is said of formats comes from their tables; a reader may name its own, in a file of the format's name.
#[test]
fn no_message_lists_formats_by_hand() {
    let own = |file: &Path| {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let format = FORMATS.iter().find(|f| f.name == stem);
        format.map_or_else(BTreeSet::new, |f| f.extensions.iter().map(|e| format!(".{e}")).collect())
    };
    let files = sources(&Path::new(ROOT).join("src")).into_iter();
    let wrong = files.filter_map(|file| {
        let text = fs::read_to_string(&file).expect("a text");
        let others: Vec<String> = said(&text).difference(&own(&file)).cloned().collect();
        (!others.is_empty()).then(|| format!("{}: {others:?}", file.display()))
    });
    assert_eq!(wrong.collect::<Vec<_>>(), ["file"; 0]);
    assert_eq!(
        said("say(\"use .ply, or\"); // .obj\n#[cfg(test)]\n\".stl\"").into_iter().collect::<Vec<_>>(),
        [".ply"]
    );
}
