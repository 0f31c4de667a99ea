//! What pages name is there: links, anchors, paths, constants, functions.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};

use crate::ROOT;

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
