//! The pages for people: every relative link, every anchor, every path of the repository, every constant and every function that they name is there,
//! every format is named (and no other, in the tables of README.md, in help and in messages), and folders use each other as ARCHITECTURE.md says.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

use interslice::files::format::known;
use interslice::input::format::FORMATS;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// Folders whose files are named in pages as `folder/file`.
const FOLDERS: [&str; 9] = ["src", "shaders", "tests", "benches", "docs", "examples", "fuzz", "workflow", "schema"];

/// The pages, by their path from the root, with their text. A changelog may name what is gone.
fn pages() -> Vec<(PathBuf, String)> {
    let top =
        ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "SECURITY.md", "benches/RESULTS.md"].map(PathBuf::from);
    let docs = fs::read_dir(Path::new(ROOT).join("docs")).expect("docs is a folder");
    let docs = docs.map(|e| Path::new("docs").join(e.expect("an entry").file_name()));
    let docs = docs.filter(|p| p.extension().is_some_and(|e| e == "md"));
    let read = |p: PathBuf| {
        let text = fs::read_to_string(Path::new(ROOT).join(&p)).unwrap_or_else(|e| panic!("{}: {e}", p.display()));
        (p, text)
    };
    top.into_iter().chain(docs).map(read).collect()
}

/// The text without fenced blocks.
fn prose(text: &str) -> String {
    let mut fenced = false;
    let keep = |line: &&str| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        !fenced && !fence
    };
    text.lines().filter(keep).collect::<Vec<_>>().join("\n")
}

/// Targets of `[text](target)` that are not on the web.
fn links(text: &str) -> Vec<String> {
    let prose = prose(text);
    let targets = prose.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target);
    targets.filter(|t| !t.contains("://")).map(str::to_string).collect()
}

/// The anchor that a heading has on the usual sites: lower case, words joined by -.
fn anchor(heading: &str) -> String {
    let kept = heading.to_lowercase();
    kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c)).collect::<String>().replace(' ', "-")
}

fn anchors(text: &str) -> BTreeSet<String> {
    prose(text).lines().filter(|l| l.starts_with('#')).map(|l| anchor(l.trim_start_matches('#').trim())).collect()
}

/// Paths of the repository that stand between back-quotes, and those of a folder that stand anywhere.
fn paths(text: &str) -> BTreeSet<String> {
    let word = |c: char| c.is_ascii_alphanumeric() || "_-./".contains(c);
    let words = text.split(|c: char| !word(c)).map(|w| w.trim_end_matches(['.', '/']));
    let of_a_folder =
        |w: &&str| w.split_once('/').is_some_and(|(folder, rest)| FOLDERS.contains(&folder) && !rest.is_empty());
    words.filter(of_a_folder).map(str::to_string).collect()
}

/// `a/b/../c` as `a/c`.
fn plain(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut out, part| {
        if part == Component::ParentDir {
            out.pop();
        } else if part != Component::CurDir {
            out.push(part);
        }
        out
    })
}

/// What a page names that is not there.
fn missing(page: &Path, text: &str) -> Vec<String> {
    let mut out = Vec::new();
    for link in links(text) {
        let (file, place) = link.split_once('#').map_or((link.as_str(), None), |(f, p)| (f, Some(p)));
        let target = match file {
            "" => page.to_path_buf(),
            _ => plain(&page.parent().unwrap_or(Path::new("")).join(file)),
        };
        let target = Path::new(ROOT).join(target);
        if !target.exists() {
            out.push(format!("link `{link}`"));
        } else if let Some(place) = place {
            let own = fs::read_to_string(&target).unwrap_or_default();
            let own = if file.is_empty() { text } else { &own };
            if !anchors(own).contains(place) {
                out.push(format!("anchor of link `{link}`"));
            }
        }
    }
    let there = |p: &&String| !Path::new(ROOT).join(p).exists();
    out.extend(paths(text).iter().filter(there).map(|p| format!("path `{p}`")));
    let gone = functions(text).into_iter().filter(|(name, file)| !defines(file, name));
    out.extend(gone.map(|(n, f)| format!("function `{n}` of `{f}`")));
    out.extend(
        constants(text).into_iter().filter(|(name, file)| !holds(file, name)).map(|(n, f)| format!("`{n}` of `{f}`")),
    );
    out
}

/// Rows `` | `NAME` value | `src/file.rs` | `` of a table of constants.
fn constants(text: &str) -> Vec<(String, String)> {
    let row = |line: &str| {
        let mut quoted = line.strip_prefix("| `")?.split('`').step_by(2);
        let (name, file) = (quoted.next()?, quoted.next()?);
        let constant = name.chars().all(|c| c.is_ascii_uppercase() || c == '_') && file.ends_with(".rs");
        constant.then(|| (name.to_string(), file.to_string()))
    };
    text.lines().filter_map(row).collect()
}

/// Functions and types behind their files, `` `src/file.rs`, `one`, `Type::other` ``, each by its last name.
fn functions(text: &str) -> Vec<(String, String)> {
    let quoted: Vec<&str> = text.split('`').collect();
    let mut found = Vec::new();
    for (k, file) in quoted.iter().enumerate().filter(|(k, word)| k % 2 == 1 && word.ends_with(".rs")) {
        for pair in quoted[k + 1..].chunks_exact(2).take_while(|pair| pair[0] == ", " && !pair[1].contains(['/', ' ']))
        {
            let name = pair[1].rsplit("::").next().unwrap_or_default();
            found.push((name.to_string(), file.to_string()));
        }
    }
    found
}

fn defines(file: &str, name: &str) -> bool {
    let text = fs::read_to_string(Path::new(ROOT).join(file)).unwrap_or_default();
    ["fn", "struct", "enum", "trait"].iter().any(|kind| {
        let item = format!("{kind} {name}");
        let mut after = text.match_indices(&item).map(|(at, _)| &text[at + item.len()..]);
        after.any(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
    })
}

fn holds(file: &str, constant: &str) -> bool {
    let text = fs::read_to_string(Path::new(ROOT).join(file)).unwrap_or_default();
    text.contains(&format!("const {constant}:"))
}

#[test]
fn everything_that_pages_name_is_there() {
    let (mut linked, mut named, mut counted, mut defined, mut wrong) = (0, 0, 0, 0, Vec::new());
    for (page, text) in pages() {
        wrong.extend(missing(&page, &text).into_iter().map(|what| format!("{}: {what}", page.display())));
        linked += links(&text).len();
        named += paths(&text).len();
        counted += constants(&text).len();
        defined += functions(&text).len();
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(
        linked > 40 && named > 80 && counted > 20 && defined > 12,
        "{linked} links, {named} paths, {counted} constants, {defined} functions were looked at"
    );
}

#[test]
fn what_is_not_there_is_seen() {
    let page = Path::new("docs/page.md");
    for (text, said) in [
        ("[a](nowhere.md)", "link `nowhere.md`"),
        ("[a](../README.md#no-such-place)", "anchor of link `../README.md#no-such-place`"),
        ("# One\n[a](#two)", "link `#two`"),
        ("see `src/nowhere.rs`, line 1", "path `src/nowhere.rs`"),
        ("    cat shaders/nowhere.wgsl", "path `shaders/nowhere.wgsl`"),
        ("see `src/reconstruct.rs`, `reconstruct`, `No::such`, and", "function `such` of `src/reconstruct.rs`"),
        ("| `NO_SUCH` 0.5 | `src/lib.rs` | 1 |", "`NO_SUCH` of `src/lib.rs`"),
    ] {
        let wrong = missing(page, text);
        assert!(wrong.len() == 1 && wrong[0].contains(said), "{text}: {wrong:?}");
    }
    let sound = "# A place: `x`\n[a](#a-place-x) [b](../README.md#input-and-output) `src/lib.rs` [c](https://example.org/src/no.rs)";
    assert_eq!(missing(Path::new("README.md"), &sound.replace("../", "")), ["link"; 0]);
}

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

/// Folders and files of `src` in the order in which ARCHITECTURE.md lists them: place in the list by name.
fn floors(text: &str) -> Vec<(String, usize)> {
    let rows = text.lines().skip_while(|l| !l.starts_with("## Folders")).skip_while(|l| !l.starts_with("| `src/"));
    let rows = rows.take_while(|l| l.starts_with("| `src/")).enumerate();
    let of_row = |(floor, row): (usize, &str)| {
        let names = row.split('|').nth(1).unwrap_or_default().split('`').filter_map(|w| w.strip_prefix("src/"));
        names.map(|n| (n.trim_end_matches(".rs").to_string(), floor)).collect::<Vec<_>>()
    };
    rows.flat_map(of_row).collect()
}

/// Folders that a source file uses by `crate::folder`, outside comments and its own tests.
fn used(text: &str) -> BTreeSet<String> {
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    let code: String = code.lines().map(|l| l.split("//").next().unwrap_or_default().to_string() + "\n").collect();
    let name = |rest: &str| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    code.split("crate::").skip(1).map(name).collect()
}

/// Every `.rs` file below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path());
    let of = |path: PathBuf| if path.is_dir() { sources(&path) } else { vec![path] };
    entries.flat_map(of).filter(|p| p.extension().is_some_and(|e| e == "rs")).collect()
}

/// Uses of a folder that stands below the user's own in the list.
fn upward(floors: &[(String, usize)], user: &str, text: &str) -> Vec<String> {
    let floor = |name: &str| floors.iter().find(|(n, _)| n == name).map(|(_, floor)| *floor);
    let Some(own) = floor(user) else { return vec![format!("`{user}` stands in no row")] };
    let above = |name: &String| floor(name).is_some_and(|other| other > own);
    used(text).into_iter().filter(above).map(|name| format!("`{user}` uses `{name}`")).collect()
}

#[test]
fn folders_use_only_those_above_them_in_the_list() {
    let text = fs::read_to_string(Path::new(ROOT).join("ARCHITECTURE.md")).expect("the page is there");
    let floors = floors(&text);
    assert!(floors.len() > 20, "{floors:?}");
    let src = Path::new(ROOT).join("src");
    let mut wrong = Vec::new();
    for file in sources(&src) {
        let inner = file.strip_prefix(&src).expect("below src");
        let user = inner.components().next().expect("a name").as_os_str().to_string_lossy();
        let text = fs::read_to_string(&file).expect("a text");
        let found = upward(&floors, user.trim_end_matches(".rs"), &text);
        wrong.extend(found.into_iter().map(|what| format!("{}: {what}", inner.display())));
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    let seen = |user: &str, text: &str| upward(&floors, user, text).len();
    assert_eq!(seen("grid", "use crate::pipeline::run;"), 1);
    assert_eq!(seen("nowhere", ""), 1);
    assert_eq!(
        seen("grid", "// crate::pipeline\nuse crate::error::Error;\n#[cfg(test)]\nuse crate::pipeline::run;"),
        0
    );
}

/// Crates of Cargo.lock but for those of the workspace, and what is wrong with where they come from.
fn locked(text: &str) -> (BTreeSet<(String, String)>, Vec<String>) {
    let lock: toml::Table = text.parse().expect("Cargo.lock is TOML");
    let (mut crates, mut wrong) = (BTreeSet::new(), Vec::new());
    // One registry, whatever its address: what most come from.
    let sources = text.lines().filter(|l| l.starts_with("source = \"registry+"));
    let mut counts = BTreeMap::<&str, usize>::new();
    sources.for_each(|line| *counts.entry(line).or_default() += 1);
    let registry = counts.into_iter().max_by_key(|(_, count)| *count).map(|(line, _)| line);
    for package in lock["package"].as_array().expect("a list") {
        let word = |key: &str| package.get(key).and_then(toml::Value::as_str).map(str::to_string);
        let (name, version) = (word("name").expect("a name"), word("version").expect("a version"));
        match word("source") {
            Some(source) if registry == Some(&*format!("source = \"{source}\"")) => {
                crates.insert((name, version));
            }
            None if ["interslice", "interslice-python"].contains(&&*name) => {}
            source => wrong.push(format!("{name} comes from {source:?}")),
        }
    }
    (crates, wrong)
}

/// Crates of the sheet of others' software.
fn sheet(page: &str) -> BTreeSet<(String, String)> {
    let rows = page.lines().skip_while(|l| !l.starts_with("| crate |")).skip(2).take_while(|l| l.starts_with('|'));
    let of_row = |row: &str| {
        let mut cells = row.split('|').skip(1).map(|cell| cell.trim().to_string());
        Some((cells.next()?, cells.next()?))
    };
    rows.filter_map(of_row).collect()
}

/// The sheet has the crates of Cargo.lock, all from crates.io; their licences and uses are compared by docs/soup.py itself (tests/run).
#[test]
fn the_sheet_of_others_software_is_that_of_the_lock() {
    let read = |path: &str| fs::read_to_string(Path::new(ROOT).join(path)).expect("it is there");
    let (lock, page) = (read("Cargo.lock"), read("docs/soup.md"));
    let (crates, wrong) = locked(&lock);
    assert!(wrong.is_empty(), "{wrong:?}");
    assert!(crates.len() > 300, "{}", crates.len());
    let listed = sheet(&page);
    let differ: Vec<_> = crates.symmetric_difference(&listed).collect();
    assert!(differ.is_empty(), "run python3 docs/soup.py: {differ:?}");
    // A new version, a crate less, a source elsewhere are seen.
    let (newer, _) = locked(&lock.replacen("name = \"adler2\"\nversion = \"", "name = \"adler2\"\nversion = \"9", 1));
    assert_eq!(newer.symmetric_difference(&listed).count(), 2);
    assert_eq!(sheet(&page.replacen("\n| adler2 |", "\nadler2 |", 1)).len(), 0);
    let elsewhere = lock.replacen("source = \"registry+", "source = \"git+", 1);
    assert_eq!(locked(&elsewhere).1.len(), 1);
}

/// Lines of code with `unsafe` in them, and proofs of them.
fn unsafe_lines(text: &str) -> [usize; 2] {
    let code = |l: &&str| {
        l.split("//").next().is_some_and(|code| code.split(|c: char| !c.is_alphanumeric()).any(|w| w == "unsafe"))
    };
    [text.lines().filter(code).count(), text.lines().filter(|l| l.trim_start().starts_with("// SAFETY:")).count()]
}

/// Rows `` | `file` | count | `` of the page on security.
fn listed_unsafe(page: &str) -> Vec<(String, usize)> {
    let row = |line: &str| {
        let mut cells = line.strip_prefix("| `")?.split('|');
        let file = cells.next()?.trim().strip_suffix('`')?.to_string();
        Some((file, cells.next()?.trim().parse().ok()?))
    };
    page.lines().filter_map(row).collect()
}

/// SECURITY.md lists every file with `unsafe`; each has a proof beside each, but for functions of a trait that is unsafe as a whole.
#[test]
fn unsafe_code_is_listed_and_proved() {
    let page = fs::read_to_string(Path::new(ROOT).join("SECURITY.md")).expect("it is there");
    let mut found = Vec::new();
    for folder in ["src", "python/src"] {
        for file in sources(&Path::new(ROOT).join(folder)) {
            let text = fs::read_to_string(&file).expect("a text");
            let [places, proofs] = unsafe_lines(&text);
            let of_a_trait = text.lines().filter(|l| l.trim_start().starts_with("unsafe fn")).count();
            let name = file.strip_prefix(ROOT).expect("below the root").display().to_string().replace('\\', "/");
            assert_eq!(
                places - of_a_trait,
                proofs,
                "{name}: {places} places, {of_a_trait} of a trait, {proofs} proofs"
            );
            if places > 0 {
                found.push((name, places));
            }
        }
    }
    found.sort();
    let mut listed = listed_unsafe(&page);
    listed.sort();
    assert_eq!(found, listed);
    assert_eq!(unsafe_lines("// SAFETY: so.\nunsafe { f() } // unsafe\nlet unsafely = 1;\nunsafe impl X {}"), [2, 1]);
}

/// Crates that open connections.
const OF_NETWORKS: [&str; 14] = [
    "curl",
    "curl-sys",
    "h2",
    "hyper",
    "mio",
    "native-tls",
    "openssl",
    "openssl-sys",
    "quinn",
    "reqwest",
    "rustls",
    "socket2",
    "tokio",
    "ureq",
];

/// The program has no connection to a network and starts no other, as SECURITY.md says.
#[test]
fn nothing_of_a_network_is_in_the_program() {
    let named = |text: &str| ["std::net", "std::process::Command", "process::Command"].iter().any(|w| text.contains(w));
    for folder in ["src", "python/src"] {
        for file in sources(&Path::new(ROOT).join(folder)) {
            assert!(!named(&fs::read_to_string(&file).expect("a text")), "{}", file.display());
        }
    }
    assert!(named("use std::net::TcpStream;"));
    let page = fs::read_to_string(Path::new(ROOT).join("docs/soup.md")).expect("it is there");
    let of_program = |page: &str| {
        let rows = page.lines().filter_map(|l| l.strip_prefix("| ").map(|l| l.split(" | ").collect::<Vec<_>>()));
        let mut rows = rows.filter(|cells| cells.get(3) == Some(&"program")).map(|cells| cells[0].to_string());
        rows.any(|name| OF_NETWORKS.contains(&&*name))
    };
    assert!(page.contains("| program |") && !of_program(&page));
    assert!(of_program(&page.replacen("| adler2 |", "| ureq |", 1)));
}

/// Every kernel has its row in the table of kernels, under its stem.
#[test]
fn kernels_stand_in_their_table() {
    let page = fs::read_to_string(Path::new(ROOT).join("ARCHITECTURE.md")).expect("it is there");
    for entry in fs::read_dir(Path::new(ROOT).join("shaders")).expect("shaders is a folder") {
        let name = entry.expect("an entry").file_name().to_string_lossy().into_owned();
        if let Some(stem) = name.strip_suffix(".wgsl") {
            assert!(
                page.contains(&format!("| {stem} | `shaders/{name}` | `src/gpu/{stem}.rs` |")),
                "ARCHITECTURE.md has no kernel {stem}"
            );
        }
    }
}
