//! Links that a person sets between parts of neighbouring slices: that two belong together though they miss each other, or do not though they
//! overlap.
//!
//! ```json
//! {"links": [{"slice": 3, "from": 1, "to": 2}, {"slice": 4, "from": 2, "to": 1, "join": false}]}
//! ```
//!
//! Part `from` of slice `slice` and part `to` of the next one are joined, or with `"join": false` kept apart. Slices are counted from 0 in the
//! order of their heights, parts (4-connected) from 1 in row order of their first pixel: as `interslice inspect` lists them.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::grid::components::label4;
use crate::settings::Link;
use crate::stack::ContourStack;
use crate::storage::json;
use crate::storage::regular::unmarked;

/// Schema of a links file; any other field is an error.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LinksFile {
    links: Vec<Link>,
}

/// Options of links between parts.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Input")]
pub struct LinkOptions {
    /// Parts of neighbouring slices that belong together, and those that do not, as JSON; `inspect` proposes entries
    #[arg(long, value_name = "FILE")]
    pub links: Option<PathBuf>,
}

impl LinkOptions {
    /// The file's links, checked; none without a file.
    ///
    /// # Errors
    /// The errors of [`read`].
    pub fn read(&self, stack: &ContourStack) -> Result<Vec<Link>> {
        self.links.as_ref().map_or(Ok(Vec::new()), |path| read(path, stack))
    }
}

/// Reads a links file and checks it against its stack.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] with the entry's number, value and limit.
pub fn read(path: &Path, stack: &ContourStack) -> Result<Vec<Link>> {
    let fail = |message: String| Error::Format { path: path.into(), message };
    let text = fs::read_to_string(path).map_err(|source| Error::Read { path: path.into(), source })?;
    let LinksFile { links } = json::parse(unmarked(&text)).map_err(fail)?;
    check(stack, &links).map_err(fail)?;
    Ok(links)
}

/// Checks that every link names two parts of neighbouring slices, each pair once; says what is wrong with the first that does not.
pub fn check(stack: &ContourStack, links: &[Link]) -> std::result::Result<(), String> {
    let mut counts: Vec<Option<usize>> = vec![None; stack.slices.len()];
    let mut parts_of = |k: usize| {
        *counts[k].get_or_insert_with(|| {
            let content = &stack.slices[k].content;
            let inside = content.sides();
            label4(&inside, stack.dims).count
        })
    };
    let last = stack.slices.len() - 1;
    for (n, link) in links.iter().enumerate() {
        let fail = |message: String| Err(format!("link {}: {message}", n + 1));
        if link.slice >= last {
            let limit = format!("must lie in [0, {}], the slices that have one above them", last - 1);
            return fail(format!("`slice` {limit}; got {}", link.slice));
        }
        for (name, part, k) in [("from", link.from, link.slice), ("to", link.to, link.slice + 1)] {
            let (count, slice) = (parts_of(k), format!("slice {k} (`{}`)", stack.slices[k].name));
            if count == 0 {
                return fail(format!("`{name}` is {part}, but {slice} is empty"));
            }
            if part == 0 || part as usize > count {
                return fail(format!("`{name}` must lie in [1, {count}], the parts of {slice}; got {part}"));
            }
        }
        let same = |other: &&Link| (other.slice, other.from, other.to) == (link.slice, link.from, link.to);
        if let Some(first) = links[..n].iter().find(same) {
            let says = if first.join == link.join { "is there already" } else { "is joined and kept apart" };
            return fail(format!("the pair of parts {} and {} above slice {} {says}", link.from, link.to, link.slice));
        }
    }
    Ok(())
}
