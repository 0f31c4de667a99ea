//! Lines of a manifest as they are written: JSON Lines or CSV, one job a line.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::error::{Error, Result};
use crate::storage::kinds::in_words;
use crate::storage::regular::unmarked;

/// Columns of a CSV manifest; the last may be left out.
const COLUMNS: [&str; 4] = ["id", "input", "outputs", "options"];

/// One job as it is written.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestLine {
    /// Name of the job, unique in its manifest.
    pub id: String,
    /// Input, relative to the manifest's folder.
    pub input: String,
    /// Outputs, relative to the manifest's folder.
    pub outputs: Vec<String>,
    /// Options by name: those of `reconstruct`, with _ for -.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub options: Map<String, Value>,
}

/// A line's number, from 1, and the line or what is wrong with it.
pub type Numbered = (usize, std::result::Result<ManifestLine, String>);

/// Whether a manifest of this name is CSV; else it is JSON Lines.
fn is_csv(path: &Path) -> Result<bool> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    match extension.as_str() {
        "csv" => Ok(true),
        "jsonl" | "ndjson" | "json" => Ok(false),
        _ => Err(Error::Format {
            path: path.into(),
            message: "not a known manifest: expected .jsonl (JSON Lines) or .csv".into(),
        }),
    }
}

/// Reads all lines but for empty ones.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] for a file that is neither JSON Lines nor CSV, or a wrong CSV header.
pub fn read(path: &Path) -> Result<Vec<Numbered>> {
    let csv = is_csv(path)?;
    let text = fs::read_to_string(path).map_err(|source| Error::Read { path: path.into(), source })?;
    let text = unmarked(&text);
    if csv {
        return read_csv(text).map_err(|message| Error::Format { path: path.into(), message });
    }
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    Ok(lines.map(|(k, line)| (k + 1, serde_json::from_str(line).map_err(|e| json_error(&e)))).collect())
}

/// Lines as text for a manifest of this name.
///
/// # Errors
/// [`Error::Format`] as [`read`].
pub fn text(lines: &[ManifestLine], path: &Path) -> Result<String> {
    let fail = |message: String| Error::Format { path: path.into(), message };
    if !is_csv(path)? {
        let rows: serde_json::Result<Vec<String>> = lines.iter().map(serde_json::to_string).collect();
        return Ok(rows.map_err(|e| fail(e.to_string()))?.into_iter().map(|row| row + "\n").collect());
    }
    let mut out = csv::Writer::from_writer(Vec::new());
    let rows = lines.iter().map(|line| {
        let options =
            if line.options.is_empty() { String::new() } else { Value::from(line.options.clone()).to_string() };
        [line.id.clone(), line.input.clone(), line.outputs.join(";"), options]
    });
    let header = COLUMNS.map(String::from);
    for row in std::iter::once(header).chain(rows) {
        out.write_record(row).map_err(|e| fail(e.to_string()))?;
    }
    let bytes = out.into_inner().map_err(|e| fail(e.to_string()))?;
    String::from_utf8(bytes).map_err(|e| fail(e.to_string()))
}

/// Message of serde, with the column only: it knows of one line.
fn json_error(e: &serde_json::Error) -> String {
    let said = e.to_string();
    let said = said.rsplit_once(" at line ").map_or(said.as_str(), |(said, _)| said);
    format!("{} (column {})", in_words(said), e.column())
}

/// What stands between the cells: spreadsheets write `;` where the comma is that of numbers. Of a header of one cell nothing tells.
fn delimiter(text: &str) -> u8 {
    let header = text.lines().next().unwrap_or_default();
    if header.contains(';') && !header.contains(',') { b';' } else { b',' }
}

fn read_csv(text: &str) -> std::result::Result<Vec<Numbered>, String> {
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(delimiter(text))
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let header = reader.headers().map_err(|e| e.to_string())?.clone();
    let place = |name: &str| header.iter().position(|h| h == name);
    for h in &header {
        if !COLUMNS.contains(&h) {
            return Err(format!("line 1: unknown column `{h}`; expected {}", COLUMNS.join(", ")));
        }
    }
    for name in &COLUMNS[..3] {
        if place(name).is_none() {
            return Err(format!("line 1: column `{name}` is missing; expected {}", COLUMNS.join(", ")));
        }
    }
    let mut lines = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| e.to_string())?;
        // As spreadsheets leave them behind the last line.
        if record.iter().all(str::is_empty) {
            continue;
        }
        let number = record.position().map_or(0, |p| line_of(text, p.byte() as usize));
        let cell = |name: &str| place(name).and_then(|k| record.get(k)).unwrap_or_default();
        let line = if record.len() == header.len() {
            options_of_cell(cell("options")).map(|options| ManifestLine {
                id: cell("id").into(),
                input: cell("input").into(),
                outputs: cell("outputs")
                    .split(';')
                    .map(|o| o.trim().into())
                    .filter(|o: &String| !o.is_empty())
                    .collect(),
                options,
            })
        } else {
            Err(format!("{} cells, but the header has {}", record.len(), header.len()))
        };
        lines.push((number, line));
    }
    Ok(lines)
}

/// Number, from 1, of the line of the record that is read from this byte on: behind empty lines, which are none.
fn line_of(text: &str, from: usize) -> usize {
    let breaks = |text: &[u8]| text.iter().filter(|b| **b == b'\n').count();
    let (before, behind) = text.as_bytes().split_at(from.min(text.len()));
    let empty = behind.iter().take_while(|b| b"\r\n".contains(b)).count();
    1 + breaks(before) + breaks(&behind[..empty])
}

/// JSON, or `key=value;key=value`.
fn options_of_cell(cell: &str) -> std::result::Result<Map<String, Value>, String> {
    if cell.starts_with('{') {
        return serde_json::from_str(cell).map_err(|e| format!("options: {}", json_error(&e)));
    }
    let mut options = Map::new();
    for part in cell.split(';').map(str::trim).filter(|p| !p.is_empty()) {
        let (key, value) = part.split_once('=').unwrap_or((part, "true"));
        if options.insert(key.trim().into(), value_of(value.trim())).is_some() {
            return Err(format!("option `{}` is named twice", key.trim()));
        }
    }
    Ok(options)
}

/// A number, true, false, a list of numbers, else text.
fn value_of(text: &str) -> Value {
    let json = |text: &str| serde_json::from_str::<Value>(text).ok();
    let list = || json(&format!("[{text}]")).filter(|_| text.contains(','));
    json(text).filter(|v| !v.is_null()).or_else(list).unwrap_or_else(|| text.into())
}
