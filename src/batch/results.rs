//! `results.jsonl`: one line per job that has ended, appended in one piece and synced.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use super::lock::Locks;
use super::manifest::Job;
use crate::error::{Error, Result};
use crate::files::fingerprint::digest;
use crate::report::Report;
use crate::storage::regular;

/// Most bytes of a line that are looked at.
const LONGEST_LINE: u64 = 16 << 20;

/// What every line begins with.
const LINE_BEGINS: &str = "{\"id\":";

/// End of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// All outputs are written.
    Done,
    /// None is.
    Failed,
}

/// A line of the results.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ResultLine {
    /// Name of the job.
    pub id: String,
    /// End of the job.
    pub status: Status,
    /// Why it failed, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Seconds of reading (with waiting for memory), computing (with waiting for a turn on the GPU) and writing.
    pub seconds: f64,
    /// Version of the program.
    pub version: String,
    /// Fingerprint of all that the job depends on; none where its input could not be read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fingerprint: Option<String>,
    /// Files that it has written.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outputs: Vec<Written>,
    /// Certificate of how well the contours are met.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate: Option<Certificate>,
}

/// A file, or a folder of files, that a job has written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Written {
    /// Its name in the manifest.
    pub file: String,
    /// Its length.
    pub bytes: u64,
    /// Its BLAKE3 digest, hexadecimal.
    pub blake3: String,
}

/// The report of a job in short.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Certificate {
    /// Backend that did the work.
    pub backend: String,
    /// Input contours.
    pub contours: usize,
    /// Pixels of the result that differ from the input, over all contours.
    pub differing_pixels: usize,
    /// Farthest arrival of a front from its contour, px.
    pub worst_arrival: f64,
    /// Volume, unit cubed, where a mesh was made.
    pub volume: Option<f64>,
    /// Area, unit squared, where a mesh was made.
    pub area: Option<f64>,
    /// Length unit.
    #[serde(default)]
    pub unit: String,
    /// Warnings for a person.
    pub warnings: Vec<String>,
}

impl From<&Report> for Certificate {
    fn from(report: &Report) -> Self {
        let arrivals = report.contours.iter().flat_map(|c| [c.arrival_from_below, c.arrival_from_above]).flatten();
        Certificate {
            backend: report.backend.clone(),
            contours: report.contours.len(),
            differing_pixels: report.contours.iter().map(|c| c.differing_pixels).sum(),
            worst_arrival: arrivals.map(|r| r.max).fold(0.0, f64::max),
            volume: report.volume,
            area: report.area,
            unit: report.unit.clone(),
            warnings: report.warnings.clone(),
        }
    }
}

/// The results of a batch and of those before it.
#[derive(Debug)]
pub struct Results {
    path: PathBuf,
    seen: Mutex<Seen>,
}

/// Results read so far.
#[derive(Debug, Default)]
struct Seen {
    /// Bytes read, up to a line's end.
    offset: u64,
    /// Outputs of finished jobs by fingerprint.
    done: HashMap<String, Vec<Written>>,
    /// Why jobs failed since this batch began, by fingerprint.
    failed: HashMap<String, String>,
}

impl Results {
    /// The results in a file that need not exist.
    ///
    /// # Errors
    /// [`Error::Read`]; [`Error::Output`] for a file of something else, of which an appended line would take the end.
    pub fn open(path: &Path) -> Result<Self> {
        check_whose(path)?;
        let results = Results { path: path.into(), seen: Mutex::default() };
        let mut seen = results.seen.lock().unwrap_or_else(PoisonError::into_inner);
        results.refresh(&mut seen)?;
        seen.failed.clear(); // what failed in an earlier batch is tried again
        drop(seen);
        Ok(results)
    }

    /// Reads what was appended since. A line that is no result, as a crash may have left it, is passed over.
    fn refresh(&self, seen: &mut Seen) -> Result<()> {
        let mut text = Vec::new();
        let read = File::open(&self.path).and_then(|mut file| {
            file.seek(SeekFrom::Start(seen.offset))?;
            file.read_to_end(&mut text)
        });
        match read {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
            Err(source) => return Err(Error::Read { path: self.path.clone(), source }),
            Ok(_) => {}
        }
        let whole = text.iter().rposition(|b| *b == b'\n').map_or(0, |end| end + 1);
        seen.offset += whole as u64;
        for line in text[..whole].split(|b| *b == b'\n') {
            let Ok(line) = serde_json::from_slice::<ResultLine>(line) else { continue };
            let Some(fingerprint) = line.fingerprint else { continue };
            match line.status {
                Status::Done => drop(seen.done.insert(fingerprint, line.outputs)),
                Status::Failed => drop(seen.failed.insert(fingerprint, line.error.unwrap_or_default())),
            }
        }
        Ok(())
    }

    /// Whether a job with this fingerprint is finished: it has a line, and its outputs are as they were written.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn finished(&self, fingerprint: &str, job: &Job) -> Result<bool> {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        self.refresh(&mut seen)?;
        let Some(written) = seen.done.get(fingerprint).cloned() else { return Ok(false) };
        drop(seen);
        let as_written = |(target, written): (&PathBuf, &Written)| {
            // A file of another length need not be read.
            std::fs::metadata(target).is_ok_and(|m| m.is_dir() || m.len() == written.bytes)
                && digest(target).is_ok_and(|is| is == (written.bytes, written.blake3.clone()))
        };
        Ok(written.len() == job.targets.len() && job.targets.iter().zip(&written).all(as_written))
    }

    /// Why a job with this fingerprint has failed since this batch began.
    pub fn failure(&self, fingerprint: &str) -> Option<String> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner).failed.get(fingerprint).cloned()
    }

    /// Appends a line in one piece and waits until it is on the disk. A piece of a line that a crash has left goes.
    ///
    /// # Errors
    /// [`Error::Write`]; the file then ends as before.
    pub fn append(&self, line: &ResultLine, locks: &Locks) -> Result<()> {
        let _held = locks.results()?;
        let write = || -> std::io::Result<()> {
            let mut file = OpenOptions::new().create(true).read(true).append(true).open(&self.path)?;
            let (end, whole) = whole_lines(&mut file)?;
            file.set_len(end)?;
            let mut text = if whole { Vec::new() } else { vec![b'\n'] };
            serde_json::to_writer(&mut text, line)?;
            text.push(b'\n');
            let written = file.write_all(&text).and_then(|()| file.sync_data());
            if written.is_err() {
                let _ = file.set_len(end);
            }
            written
        };
        write().map_err(|source| Error::Write { path: self.path.clone(), source })
    }
}

/// Refuses a file that is there and holds no results: one that is not blank, has no line of a result, and is none either that a crash has cut short.
fn check_whose(path: &Path) -> Result<()> {
    let wrong = |message: &str| Err(Error::Output { path: path.into(), message: message.into() });
    match std::fs::metadata(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Ok(of) if !of.is_file() => return wrong("is no file; results need a file of their own"),
        _ => {}
    }
    let text = regular::begin(path, LONGEST_LINE).map_err(|source| Error::Read { path: path.into(), source })?;
    // A crash may leave zeros.
    let blank = |text: &[u8]| text.iter().all(|b| b.is_ascii_whitespace() || *b == 0);
    let result = |line: &[u8]| serde_json::from_slice::<ResultLine>(line).is_ok();
    let cut_short = !text.contains(&b'\n') && text.starts_with(LINE_BEGINS.as_bytes());
    if blank(&text) || cut_short || LINE_BEGINS.as_bytes().starts_with(&text) || text.split(|b| *b == b'\n').any(result)
    {
        return Ok(());
    }
    wrong("is there already and holds no results of a batch; results need a file of their own")
}

/// Where the lines of a file end but for a torn last one, and whether that is a line's end: what is JSON and lacks only that is not torn.
fn whole_lines(file: &mut File) -> std::io::Result<(u64, bool)> {
    let end = file.seek(SeekFrom::End(0))?;
    let from = end.saturating_sub(LONGEST_LINE);
    file.seek(SeekFrom::Start(from))?;
    let mut tail = Vec::new();
    file.read_to_end(&mut tail)?;
    let start = tail.iter().rposition(|b| *b == b'\n').map_or(0, |at| at + 1);
    let last = &tail[start..];
    let torn = !last.is_empty() && serde_json::from_slice::<serde::de::IgnoredAny>(last).is_err();
    // What is longer than any line is none of ours.
    Ok(if torn && (start > 0 || from == 0) { (from + start as u64, true) } else { (end, last.is_empty()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_something_else_is_refused() {
        let place = tempfile::tempdir().expect("a folder can be made");
        let path = place.path().join("results.jsonl");
        let opened =
            |text: &[u8]| std::fs::write(&path, text).map(|()| Results::open(&path).is_ok()).expect("it is there");
        assert!(Results::open(&path).is_ok(), "it need not be there");
        let line = ResultLine {
            id: "a".into(),
            status: Status::Failed,
            error: None,
            seconds: 0.0,
            version: "1".into(),
            fingerprint: None,
            outputs: Vec::new(),
            certificate: None,
        };
        let line = serde_json::to_vec(&line).expect("it is JSON");
        assert!(line.starts_with(LINE_BEGINS.as_bytes()));
        let torn = |n: usize| [&line[..], b"\n", &line[..n]].concat();
        for ours in
            [b"" as &[u8], b" \n\n", &[0; 64], &line, &line[..4], &line[..20], &torn(0), &torn(9), &torn(line.len())]
        {
            assert!(opened(ours), "{}", String::from_utf8_lossy(ours));
        }
        for other in [&b"DICM\0\0 and so on"[..], b"{\"id\": 1, \"input\": \"a\"}\n", b"notes", b"0", &[1; 3000]] {
            assert!(!opened(other), "{}", String::from_utf8_lossy(other));
        }
        assert!(matches!(Results::open(place.path()), Err(Error::Output { .. })), "a folder");
    }

    #[test]
    fn a_torn_line_ends_where_the_one_before_it_does() {
        for (text, wanted) in [
            ("", (0, true)),
            ("{}\n{\"id\": 1}\n", (13, true)),
            ("{}\n{\"id\": 1}", (12, false)),
            ("{}\n{\"id\": 1", (3, true)),
            ("{\"id", (0, true)),
        ] {
            let mut file = tempfile::tempfile().expect("a temporary file can be made");
            file.write_all(text.as_bytes()).expect("it can be written");
            assert_eq!(whole_lines(&mut file).expect("it can be read"), wanted, "{text}");
        }
    }
}
