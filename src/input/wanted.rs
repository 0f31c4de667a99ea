//! Labels that a user wants of a label volume, by number or by name.

use crate::error::Result;
use crate::input::volume::Volume;
use crate::stack::options::{BACKGROUND, LabelName};

/// Name of the option, for messages.
const OPTION: &str = "labels";

/// Labels that are wanted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Wanted {
    /// All that are not 0.
    All,
    /// These.
    These(Vec<LabelName>),
    /// Those of a text, parted at its commas. Some of these may belong to names.
    Text(Vec<String>),
}

impl std::fmt::Display for Wanted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = |label: &LabelName| match label {
            LabelName::Number(number) => number.to_string(),
            LabelName::Name(name) => name.clone(),
        };
        match self {
            Wanted::All => f.write_str("all"),
            Wanted::These(labels) => f.write_str(&labels.iter().map(name).collect::<Vec<_>>().join(",")),
            Wanted::Text(pieces) => f.write_str(&pieces.join(",")),
        }
    }
}

impl std::str::FromStr for Wanted {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        if text == "all" {
            return Ok(Wanted::All);
        }
        text.split(',').try_for_each(|name| checked(name).map(drop))?;
        Ok(Wanted::Text(text.split(',').map(String::from).collect()))
    }
}

impl Wanted {
    /// The labels of these names or numbers, whatever commas are in them.
    ///
    /// # Errors
    /// A message for 0, and for an empty name.
    pub fn these<'n>(names: impl Iterator<Item = &'n str>) -> std::result::Result<Self, String> {
        names.map(checked).collect::<std::result::Result<_, String>>().map(Wanted::These)
    }

    /// The numbers of these labels of a volume, each once, in increasing order; none of `all`.
    ///
    /// # Errors
    /// [`Error::Setting`](crate::Error::Setting) with the names that there are, for one that is none of them, and for a text that can be read in several ways.
    pub(super) fn labels(&self, volume: &Volume) -> Result<Vec<i64>> {
        let names = match self {
            Wanted::All => Vec::new(),
            Wanted::These(names) => names.clone(),
            Wanted::Text(pieces) => parted(pieces, volume)?,
        };
        let mut labels = names.iter().map(|name| volume.label(name, OPTION)).collect::<Result<Vec<i64>>>()?;
        labels.sort_unstable();
        labels.dedup();
        Ok(labels)
    }
}

fn checked(name: &str) -> std::result::Result<LabelName, String> {
    match LabelName::from(name) {
        LabelName::Number(0) => Err(BACKGROUND.into()),
        LabelName::Name(name) if name.is_empty() => {
            Err("expected `all`, or numbers or names with commas between, such as 1,2,5; got an empty name".into())
        }
        label => Ok(label),
    }
}

/// The names of a text parted at its commas: pieces that are a name together are one. Where nothing is a name the pieces are taken as they are.
///
/// # Errors
/// [`Error::Setting`](crate::Error::Setting) for a text that can be read in several ways.
fn parted(pieces: &[String], volume: &Volume) -> Result<Vec<LabelName>> {
    let names: Vec<String> =
        volume.segments.values().filter_map(|a| Some(a.name.as_ref()?.trim().to_lowercase())).collect();
    let most = names.iter().map(|name| 1 + name.matches(',').count()).max().unwrap_or(1);
    let is_one = |text: &str| names.contains(&text.trim().to_lowercase());
    let is_number = |text: &str| matches!(LabelName::from(text), LabelName::Number(_));
    if most == 1 || pieces.iter().all(|piece| is_number(piece)) {
        return Ok(pieces.iter().map(|piece| LabelName::from(piece.as_str())).collect());
    }
    // From the end: in how many ways the rest can be read, and how many pieces its first name has then.
    let mut ways = vec![(0usize, 1); pieces.len()];
    ways.push((1, 0));
    for from in (0..pieces.len()).rev() {
        for count in 1..=most.min(pieces.len() - from) {
            let text = pieces[from..from + count].join(",");
            let behind = ways[from + count].0;
            if behind > 0 && (is_one(&text) || count == 1 && is_number(&text)) {
                ways[from] = (ways[from].0.saturating_add(behind), count);
            }
        }
    }
    if ways[0].0 > 1 {
        let message =
            format!("is `{}`, which can be read in several ways: name labels by their numbers", pieces.join(","));
        return Err(volume.wrong_label(OPTION, &message));
    }
    let (mut from, mut found) = (0, Vec::new());
    while from < pieces.len() {
        // What is no name is told piece by piece.
        let count = if ways[0].0 == 0 { 1 } else { ways[from].1 };
        found.push(LabelName::from(pieces[from..from + count].join(",").as_str()));
        from += count;
    }
    Ok(found)
}
