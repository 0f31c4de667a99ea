//! The pages for people: every relative link, every anchor, every path of the repository, every constant and every function that they name is there,
//! every format is named (and no other, in the tables of README.md, in help and in messages), folders use each other as ARCHITECTURE.md says, and
//! what SECURITY.md and docs/soup.md say of the code and of others' software is so.

mod architecture;
mod formats;
mod names;
mod security;
mod software;

use std::fs;
use std::path::{Path, PathBuf};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Every `.rs` file below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path());
    let of = |path: PathBuf| if path.is_dir() { sources(&path) } else { vec![path] };
    entries.flat_map(of).filter(|p| p.extension().is_some_and(|e| e == "rs")).collect()
}
