//! A manifest: the jobs of a batch, all checked before any runs.

use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::path::{Path, PathBuf};

use super::line::{ManifestLine, read};
use super::spread::{SPREADING, Spread, spread};
use crate::error::{Error, Result};
use crate::files::JobOptions;
use crate::files::fingerprint::fingerprint;
use crate::files::format::{check_name, check_page};
use crate::files::named::{Named, PRESET, names};
use crate::files::options::OutputOptions;
use crate::files::pending::{Pending, Temporary};
use crate::files::places::Places;
use crate::input::check;
use crate::preset::Preset;
use crate::settings::Settings;
use crate::stack::ReadOptions;
use crate::stack::links::LinkOptions;

/// The jobs of a batch.
#[derive(Debug)]
pub struct Manifest {
    /// The file.
    pub path: PathBuf,
    /// Folder to which paths in it are relative.
    pub folder: PathBuf,
    /// Its jobs, in its order.
    pub jobs: Vec<Job>,
    /// Labels and ROIs that lines ask for with all others, and that cannot be reconstructed: input and why.
    pub left_out: Vec<String>,
    /// Places that they read and write.
    places: Places,
}

/// One job.
#[derive(Debug)]
pub struct Job {
    /// Its name.
    pub id: String,
    /// Input.
    pub input: PathBuf,
    /// Outputs as the manifest names them.
    pub outputs: Vec<String>,
    /// The files they are.
    pub targets: Vec<PathBuf>,
    /// Options of the job.
    pub options: JobOptions,
}

impl Job {
    /// Fingerprint of all that its bytes depend on, by content, on the machine asked for.
    ///
    /// # Errors
    /// The errors of [`fingerprint`].
    pub fn fingerprint(&self, machine: &str) -> Result<String> {
        let words: Vec<&str> = std::iter::once(machine).chain(self.outputs.iter().map(String::as_str)).collect();
        fingerprint(&self.input, &self.options, &words)
    }
}

/// Names that lines must not have in common.
#[derive(Default)]
struct Claims {
    /// Ids and their lines.
    ids: HashMap<String, usize>,
    /// Lines and their outputs.
    targets: Vec<(usize, PathBuf)>,
}

impl Manifest {
    /// Reads and checks a manifest.
    ///
    /// # Errors
    /// [`Error::Manifest`] with every wrong line; as [`read`].
    pub fn read(path: &Path) -> Result<Self> {
        let lines = read(path)?;
        let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
        let (mut jobs, mut wrong, mut claims) = (Vec::new(), Vec::new(), Claims::default());
        let mut left_out = Vec::new();
        for (number, line) in lines {
            let spread = line.and_then(|line| {
                let input = line.input.clone();
                let Spread { lines, left_out } = spread(line, &folder)?;
                Ok((lines, left_out.into_iter().map(move |why| format!("{input}: {why}"))))
            });
            let lines = match spread {
                Ok((lines, without)) => {
                    left_out.extend(without);
                    lines
                }
                Err(message) => {
                    wrong.push((number, message));
                    continue;
                }
            };
            for line in lines {
                match job(line, number, &folder, &mut claims) {
                    Ok(job) => jobs.push((number, job)),
                    Err(messages) => wrong.extend(messages.into_iter().map(|m| (number, m))),
                }
            }
        }
        let mut places = places(path, &jobs);
        for (number, target) in claims.targets {
            let own = format!("one of line {number} too");
            match places.write(&target, &own) {
                Err(what) => {
                    let what = if what == own { "named twice" } else { &what };
                    wrong.push((number, format!("output {} is {what}", target.display())));
                }
                Ok(()) => {
                    let joins = places.joins(&target);
                    wrong.extend(joins.map(|why| (number, format!("output {}: {why}", target.display()))));
                }
            }
        }
        if jobs.is_empty() && wrong.is_empty() {
            return Err(Error::Format { path: path.into(), message: "has no jobs".into() });
        }
        if !wrong.is_empty() {
            wrong.sort_by_key(|(number, _)| *number);
            return Err(Error::Manifest { path: path.into(), lines: wrong });
        }
        let jobs = jobs.into_iter().map(|(_, job)| job).collect();
        Ok(Manifest { path: path.into(), folder, jobs, left_out, places })
    }

    /// Opens a page that is written under a temporary name; other processes that share the batch may write it, too.
    ///
    /// # Errors
    /// [`Error::Output`] for a name that is no page's, cannot be written, or is that of something a job reads or writes.
    pub fn page(&mut self, path: &Path) -> Result<Pending> {
        let page = Pending::open(path, false, Temporary::Shared, &mut self.places)?;
        check_page(path).map(|()| page)
    }

    /// Adds another file that is written.
    ///
    /// # Errors
    /// [`Error::Output`] where that is something a job reads or writes.
    pub fn writes(&mut self, path: &Path) -> Result<()> {
        let output =
            |what| Error::Output { path: path.into(), message: format!("is {what}; give it a name of its own") };
        self.places.write(path, "a file of this batch").map_err(output)
    }
}

/// A line as a job, or all that is wrong with it.
fn job(line: ManifestLine, number: usize, folder: &Path, claims: &mut Claims) -> std::result::Result<Job, Vec<String>> {
    let mut wrong = Vec::new();
    if line.id.trim().is_empty() {
        wrong.push("`id` must not be empty".into());
    } else if let Some(first) = claims.ids.get(&line.id) {
        wrong.push(format!("id `{}` is that of line {first} too", line.id));
    } else {
        claims.ids.insert(line.id.clone(), number);
    }
    let options = options(&line, folder, &mut wrong);
    let input = folder.join(&line.input);
    if line.input.is_empty() {
        wrong.push("`input` must not be empty".into());
    } else if let Err(e) = check(&input, &options.read) {
        wrong.push(format!("input: {e}"));
    }
    if line.outputs.is_empty() {
        wrong.push("`outputs` must name at least one file".into());
    }
    let targets: Vec<PathBuf> = line.outputs.iter().map(|o| folder.join(o)).collect();
    for target in &targets {
        if let Err(e) = check_name(target) {
            wrong.push(format!("outputs: {e}"));
        }
        claims.targets.push((number, target.clone()));
    }
    if wrong.is_empty() { Ok(Job { id: line.id, input, outputs: line.outputs, targets, options }) } else { Err(wrong) }
}

/// The options of a line; what is wrong with them is added to `wrong`.
fn options(line: &ManifestLine, folder: &Path, wrong: &mut Vec<String>) -> JobOptions {
    let mut table = toml::Table::new();
    for (key, value) in &line.options {
        match toml::Value::try_from(value) {
            Ok(value) => drop(table.insert(key.clone(), value)),
            Err(_) => {
                wrong.push(format!("options: `{key}` must be a number, a text, true, false or a list; got {value}"))
            }
        }
    }
    let mut named = Named::new(table);
    let (read, of_read) = named.claim(ReadOptions::default(), |_| false);
    let (mut links, of_links) = named.claim(LinkOptions::default(), |_| false);
    let (preset, of_preset) = named.preset().map_or_else(|e| (None, vec![e]), |preset| (preset, Vec::new()));
    let preset = preset.map_or_else(Settings::default, Preset::settings);
    let (settings, of_settings) = named.claim(preset, |_| false);
    let (output, of_output) = named.claim(OutputOptions::default(), |_| false);
    links.links = links.links.map(|path| folder.join(path));
    if let Some((path, Err(e))) = links.links.as_ref().map(|path| (path, File::open(path))) {
        wrong.push(format!("options: `links`: {}: {e}", path.display()));
    }
    let output = OutputOptions { like: output.like.map(|path| folder.join(path)), ..output };
    let options = JobOptions { read, links, settings, output, settings_file: None };
    let preset = vec![PRESET.into()];
    let spreading: Vec<String> = SPREADING.map(String::from).into();
    let known = [
        names::<OutputOptions>(),
        names::<ReadOptions>(),
        names::<LinkOptions>(),
        spreading,
        preset,
        names::<Settings>(),
    ];
    let known = known.concat().join(", ");
    let unknown = named.unknown().map(|key| format!("unknown option `{key}`; there are {known}")).collect();
    let range = options.check().err().map(|e| e.to_string());
    let all = [of_read, of_links, of_preset, of_settings, of_output, unknown, range.into_iter().collect()].concat();
    wrong.extend(all.into_iter().map(|e| format!("options: {e}")));
    options
}

/// Places that the jobs of a manifest read. An input that cannot be read is told when its job runs.
fn places(manifest: &Path, jobs: &[(usize, Job)]) -> Places {
    let mut places = Places::default();
    places.read(manifest, "the manifest");
    let inputs: BTreeSet<&Path> = jobs.iter().map(|(_, job)| job.input.as_path()).collect();
    inputs.into_iter().for_each(|input| places.gathers(input));
    for (number, job) in jobs {
        for file in job.options.files(&job.input).unwrap_or_else(|_| vec![job.input.clone()]) {
            let what = if file == job.input { "the input of" } else { "read by" };
            places.read(&file, &format!("{what} line {number}"));
        }
    }
    places
}
