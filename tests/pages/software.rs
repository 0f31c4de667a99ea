//! Others' software: docs/soup.md lists the crates of Cargo.lock.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::ROOT;

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
