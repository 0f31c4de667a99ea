//! The `.glb` files of a run with many bodies: each holds all of them.

use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use glam::DVec3;

use super::format::{BUFFER_BYTES, Format};
use super::pending::{Pending, Temporary, parent};
use super::places::Places;
use crate::error::{Error, Result};
use crate::stack::appearance::Appearance;
use crate::surface::glb::{About, GlbScene};
use crate::surface::mesh_files::WriteMesh;

/// Open files of all bodies.
pub struct Scenes {
    files: Vec<(PathBuf, Pending)>,
    shared: SharedScene,
}

/// Scene that takes the meshes of all bodies, one after the other.
#[derive(Clone)]
pub struct SharedScene {
    /// The file that messages name.
    target: PathBuf,
    scene: Arc<Mutex<GlbScene>>,
}

impl Scenes {
    /// Whether a run with many bodies puts them all into a file of this name.
    pub fn has(path: &Path) -> bool {
        matches!(Format::of(path), Ok(Format::Glb))
    }

    /// Opens the files under temporary names; nothing where there are none.
    ///
    /// # Errors
    /// [`Error::Output`] for a name that cannot be written, or is that of an input or another output.
    pub fn open(paths: &[PathBuf], places: &mut Places) -> Result<Option<Self>> {
        let Some(target) = paths.first() else { return Ok(None) };
        let files = paths.iter().map(|path| Ok((path.clone(), Pending::open(path, false, Temporary::Random, places)?)));
        let files = files.collect::<Result<_>>()?;
        let scene = GlbScene::new(parent(target)).map_err(|source| Error::Write { path: target.clone(), source })?;
        let shared = SharedScene { target: target.clone(), scene: Arc::new(Mutex::new(scene)) };
        Ok(Some(Scenes { files, shared }))
    }

    /// The files, by their names.
    pub fn targets(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|(target, _)| target.as_path())
    }

    /// Scene that takes the bodies' meshes.
    pub fn share(&self) -> SharedScene {
        self.shared.clone()
    }

    /// Writes all bodies into every file, which keeps its temporary name.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn complete(&mut self) -> Result<()> {
        let mut scene = self.shared.lock().map_err(|source| self.shared.fails(source))?;
        self.files.iter_mut().try_for_each(|(target, pending)| {
            let mut write = || {
                let Pending::File(file, _) = &mut *pending else { return Ok(()) };
                scene.write(&mut BufWriter::with_capacity(BUFFER_BYTES, file.as_file_mut()))?;
                pending.sync()
            };
            write().map_err(|source| Error::Write { path: target.clone(), source })
        })
    }

    /// Gives the files their names.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn rename(self) -> Result<Vec<PathBuf>> {
        let rename = |(target, pending): (PathBuf, Pending)| match pending.rename(&target) {
            Ok(()) => Ok(target),
            Err(source) => Err(Error::Write { path: target, source }),
        };
        self.files.into_iter().map(rename).collect()
    }
}

impl SharedScene {
    /// The file that messages name.
    pub(super) fn target(&self) -> &Path {
        &self.target
    }

    /// Adds the mesh of the first of `bodies`, in this unit and relative to this origin.
    pub(super) fn write_mesh(&self, bodies: &[Appearance], unit: &str, origin: DVec3) -> WriteMesh {
        let (shared, unit) = (self.clone(), unit.to_string());
        let appearance = bodies.first().cloned().unwrap_or_default();
        let label = appearance.number.map(|number| format!("label {number}"));
        let appearance = Appearance { name: appearance.name.or(label), ..appearance };
        let about = About { appearance, unit, origin };
        Box::new(move |mesh| shared.lock()?.add(mesh, &about))
    }

    fn lock(&self) -> io::Result<MutexGuard<'_, GlbScene>> {
        self.scene.lock().map_err(|_| io::Error::other("a body before has failed"))
    }

    fn fails(&self, source: io::Error) -> Error {
        Error::Write { path: self.target.clone(), source }
    }
}
