//! Folders use each other as ARCHITECTURE.md says, and its table of kernels has all of them.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::{ROOT, sources};

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
