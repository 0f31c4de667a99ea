//! Plants mutants into the copied sources of interslice, all of them in one build, to be chosen at run time.
//!
//!     interslice-mutation TREE WANTED FILE...
//!
//! `TREE` is a copy of the repository, `FILE` a Rust source below it, which is rewritten there. `WANTED` names a file of keys, one a line
//! (`file:line:column change`): those mutants are planted. Without such a file nothing is written. Every mutant is printed as a line of four fields
//! between tabs: number, key, and the bytes of the rewritten file that hold its site, from and to.

mod plant;
mod splice;

use std::collections::BTreeSet;
use std::path::Path;
use std::{env, fs};

/// What mutated code asks: `is` in `src/mutation.rs` of the copy.
const SUPPORT: &str = include_str!("support.rs");

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [tree, wanted, files @ ..] = &arguments[..] else {
        return Err("interslice-mutation TREE WANTED FILE...".into());
    };
    let tree = Path::new(tree);
    let wanted: Option<BTreeSet<String>> =
        fs::read_to_string(wanted).ok().map(|keys| keys.lines().map(str::to_string).collect());
    let mut number = 0;
    for file in files {
        let path = tree.join(file);
        let text = fs::read_to_string(&path).map_err(|e| format!("{file}: {e}"))?;
        let planted = plant::plant(file, &text, wanted.as_ref(), &mut number).map_err(|e| format!("{file}: {e}"))?;
        if wanted.is_some() {
            fs::write(&path, &planted.text)?;
        }
        for mutant in planted.mutants {
            println!("{}\t{}\t{}\t{}", mutant.number, mutant.key, mutant.from, mutant.to);
        }
    }
    if wanted.is_some() {
        fs::write(tree.join("src/mutation.rs"), SUPPORT)?;
    }
    Ok(())
}
