//! Small pictures of jobs for the page over a batch: of a job's own PNG, or kept beside the results by the job's fingerprint, so that a batch
//! that goes on later shows those of jobs that are finished.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::ImageFormat;

use super::manifest::Job;
use super::runner::folder_of;
use crate::error::{Error, Result};
use crate::files::pending::{Pending, Temporary};
use crate::files::places::Places;
use crate::files::preview;

/// The folder of the pictures of a results file.
#[derive(Debug)]
pub struct Pictures(PathBuf);

impl Pictures {
    /// The pictures beside `results`, in a folder that need not exist.
    pub fn beside(results: &Path) -> Self {
        Pictures(folder_of(results, "pictures"))
    }

    /// As [`Pictures::beside`], to keep some: the folder is made.
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn open(results: &Path) -> Result<Self> {
        let pictures = Self::beside(results);
        fs::create_dir_all(&pictures.0)
            .map_err(|e| Error::Output { path: pictures.0.clone(), message: e.to_string() })?;
        Ok(pictures)
    }

    fn place(&self, fingerprint: &str) -> PathBuf {
        self.0.join(&blake3::hash(fingerprint.as_bytes()).to_hex()[..32]).with_extension("png")
    }

    /// Keeps the picture of a job, a PNG.
    ///
    /// # Errors
    /// [`Error::Output`], [`Error::Write`].
    pub fn keep(&self, fingerprint: &str, picture: &[u8]) -> Result<()> {
        let place = self.place(fingerprint);
        let pending = Pending::open(&place, false, Temporary::Fixed, &mut Places::default())?;
        let write = || {
            fs::write(pending.path(), picture)?;
            pending.sync()?;
            pending.rename()
        };
        write().map_err(|source| Error::Write { path: place.clone(), source })
    }

    /// The picture of a finished job as PNG, with the output that it is made of: the job's own one in small, or what was kept.
    pub fn of<'j>(&self, job: &'j Job, fingerprint: Option<&str>) -> Option<(Option<&'j Path>, Vec<u8>)> {
        let own = job.targets.iter().find_map(|target| Some((Some(target.as_path()), in_small(target)?)));
        own.or_else(|| Some((None, fs::read(self.place(fingerprint?)).ok()?)))
    }
}

/// Whether an output is a picture of the body.
pub fn is_picture(target: &Path) -> bool {
    target.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"))
}

/// A smaller picture of an output that is one.
fn in_small(target: &Path) -> Option<Vec<u8>> {
    let [width, height] = preview::SIZE;
    let picture = is_picture(target).then(|| image::open(target).ok())??.thumbnail(width, height);
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).ok()?;
    Some(bytes.into_inner())
}
