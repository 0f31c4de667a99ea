//! A page over the jobs of a batch: status, volume, warnings and a picture each, to be sorted. It needs no network; pictures are in it.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::agenda::Outcome;
use super::manifest::{Job, Manifest};
use super::pictures::Pictures;
use super::results::{Certificate, ResultLine, Status};
use crate::error::{Error, Result};
use crate::files::pending::{Pending, parent};
use crate::surface::html::page::fill;
use crate::surface::html::words::{count, escape, number};

const TEMPLATE: &str = include_str!("index.html");

/// Columns by which the page can be sorted: their place, title, and whether numbers are in them.
const COLUMNS: [(&str, bool); 8] = [
    ("Picture", false),
    ("Job", false),
    ("Status", false),
    ("Volume", true),
    ("Surface", true),
    ("Contours", true),
    ("Warnings", false),
    ("Seconds", true),
];

/// Writes the page of a batch that has ended into `pending`, which becomes `target`.
///
/// # Errors
/// [`Error::Read`] where the results cannot be read; [`Error::Write`].
pub fn write(target: &Path, pending: Pending, manifest: &Manifest, results: &Path, outcomes: &[Outcome]) -> Result<()> {
    let lines = last_lines(results)?;
    let text = page(target, manifest, &lines, &Pictures::beside(results), outcomes);
    let write = || {
        std::fs::write(pending.path(), text)?;
        pending.sync()?;
        pending.rename()
    };
    write().map_err(|source| Error::Write { path: target.into(), source })
}

/// The last line of each job in the results; a file that is not there has none.
fn last_lines(results: &Path) -> Result<HashMap<String, ResultLine>> {
    let text = match std::fs::read_to_string(results) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(source) => return Err(Error::Read { path: results.into(), source }),
    };
    let lines = text.lines().filter_map(|line| serde_json::from_str::<ResultLine>(line).ok());
    Ok(lines.map(|line| (line.id.clone(), line)).collect())
}

fn page(
    target: &Path,
    manifest: &Manifest,
    lines: &HashMap<String, ResultLine>,
    pictures: &Pictures,
    outcomes: &[Outcome],
) -> String {
    let title = manifest.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let is = |what: fn(&Outcome) -> bool| outcomes.iter().filter(|o| what(o)).count() as u64;
    let done = is(|o| matches!(o, Outcome::Done | Outcome::Skipped));
    let (failed, not_run) = (is(|o| matches!(o, Outcome::Failed(_))), is(|o| *o == Outcome::NotRun));
    let mut summary = format!("{} jobs: {} done, {} failed", count(outcomes.len() as u64), count(done), count(failed));
    if not_run > 0 {
        let _ = write!(summary, ", {} not run", count(not_run));
    }
    let head = |(name, numeric): &(&str, bool)| {
        let class = if *numeric { r#" class="number""# } else { "" };
        match *name {
            "Picture" => format!("<th{class}>{name}</th>"),
            _ => format!(r#"<th{class}><button type="button">{name}</button></th>"#),
        }
    };
    let choice = |(k, (name, _)): (usize, &(&str, bool))| {
        format!(r#"<option value="{k}">{name}, up</option><option value="{k}-">{name}, down</option>"#)
    };
    let rows = manifest.jobs.iter().zip(outcomes).map(|(job, outcome)| {
        let line = lines.get(&job.id).filter(|_| *outcome != Outcome::NotRun);
        row(parent(target), job, outcome, line, pictures)
    });
    let fills = [
        ("title", escape(&title)),
        ("summary", summary + "; made by interslice " + env!("CARGO_PKG_VERSION") + "."),
        ("heads", COLUMNS.iter().map(head).collect()),
        ("choices", COLUMNS.iter().enumerate().skip(1).map(choice).collect()),
        ("rows", rows.collect()),
    ];
    fill(TEMPLATE, &fills)
}

fn row(folder: &Path, job: &Job, outcome: &Outcome, line: Option<&ResultLine>, pictures: &Pictures) -> String {
    let certificate = line.filter(|l| l.status == Status::Done).and_then(|l| l.certificate.as_ref());
    let (class, status, warnings) = match outcome {
        Outcome::Done | Outcome::Skipped => ("done", "done", certificate.map_or(&[][..], |c| &c.warnings)),
        Outcome::Failed(why) => ("failed", "failed", std::slice::from_ref(why)),
        Outcome::NotRun => ("none", "not run", &[][..]),
    };
    let cell = |k: usize, key: &str, shown: &str| {
        let (name, numeric) = COLUMNS[k];
        let class = if numeric { r#" class="number""# } else { "" };
        let shown = if shown.is_empty() { r#"<span class="none">none</span>"# } else { shown };
        format!(r#"<td{class} data-name="{name}" data-key="{}">{shown}</td>"#, escape(key))
    };
    let measured = |k: usize, value: Option<f64>, power: &str| match (value, certificate) {
        (Some(v), Some(Certificate { unit, .. })) => {
            cell(k, &v.to_string(), &format!("{} {}{power}", number(v), escape(unit)))
        }
        _ => cell(k, "", r#"<span class="none">not measured</span>"#),
    };
    let is_done = matches!(outcome, Outcome::Done | Outcome::Skipped);
    let picture = is_done.then(|| pictures.of(job, line.and_then(|l| l.fingerprint.as_deref()))).flatten();
    let picture = match picture {
        Some((target, png)) => {
            let shown =
                format!(r#"<img alt="{}" src="data:image/png;base64,{}">"#, escape(&job.id), STANDARD.encode(png));
            match target {
                Some(target) => format!(r#"<a href="{}">{shown}</a>"#, escape(&address(folder, target))),
                None => shown,
            }
        }
        None if is_done => r#"<span class="none">no picture: finished before one was asked for</span>"#.into(),
        None => r#"<span class="none">no picture</span>"#.into(),
    };
    let files: Vec<String> = match is_done {
        true => job
            .targets
            .iter()
            .zip(&job.outputs)
            .map(|(target, name)| format!(r#"<a href="{}">{}</a>"#, escape(&address(folder, target)), escape(name)))
            .collect(),
        false => Vec::new(),
    };
    let listed: String = warnings.iter().map(|w| format!("<li>{}</li>", escape(w))).collect();
    let listed = if listed.is_empty() { String::new() } else { format!("<ul>{listed}</ul>") };
    let seconds = line.map(|l| l.seconds);
    format!(
        "<tr><td class=\"picture\">{picture}</td><td class=\"job\" data-key=\"{id}\">{id}<br><small>{}</small></td>{}{}{}{}{}{}</tr>\n",
        files.join(" · "),
        cell(2, status, &format!(r#"<span class="{class}">{status}</span>"#)),
        measured(3, certificate.and_then(|c| c.volume), "³"),
        measured(4, certificate.and_then(|c| c.area), "²"),
        cell(5, &certificate.map_or(String::new(), |c| c.contours.to_string()), &contours(certificate)),
        cell(6, &warnings.len().to_string(), &listed),
        cell(
            7,
            &seconds.map_or(String::new(), |s| s.to_string()),
            &seconds.map_or(String::new(), |s| format!("{s:.1}"))
        ),
        id = escape(&job.id),
    )
}

/// How many contours there are, and whether they are met.
fn contours(certificate: Option<&Certificate>) -> String {
    certificate.map_or(String::new(), |c| match c.differing_pixels {
        0 => format!("{}, all met", c.contours),
        n => format!(r#"{}, <span class="failed">{} pixels differ</span>"#, c.contours, count(n as u64)),
    })
}

/// A file's address as a page in `folder` names it.
fn address(folder: &Path, target: &Path) -> String {
    let absolute =
        |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path)).unwrap_or_else(|_| path.into());
    let (folder, target) = (absolute(folder), absolute(target));
    let shared = folder.iter().zip(target.iter()).take_while(|(a, b)| a == b).count();
    let up = folder.iter().skip(shared).map(|_| PathBuf::from(".."));
    let relative: PathBuf = up.chain(target.iter().skip(shared).map(PathBuf::from)).collect();
    let parts = relative.iter().map(|part| part.to_string_lossy().bytes().map(plain).collect::<String>());
    parts.collect::<Vec<_>>().join("/")
}

/// A byte of an address: what is no plain letter is escaped.
fn plain(byte: u8) -> String {
    match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' => char::from(byte).into(),
        other => format!("%{other:02X}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_relative_and_escaped() {
        assert_eq!(address(Path::new("/a/b"), Path::new("/a/b/c d/é.stl")), "c%20d/%C3%A9.stl");
        assert_eq!(address(Path::new("/a/b"), Path::new("/a/x/#1.png")), "../x/%231.png");
    }
}
