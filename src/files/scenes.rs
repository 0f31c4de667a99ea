//! The files of a run with many bodies that hold all of them: `.glb`, `.3mf`, `.groups.obj`.

use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use glam::DVec3;

use super::format::{BUFFER_BYTES, Format, Kind};
use super::options::OutputOptions;
use super::pending::{Made, Pending, Temporary, parent};
use super::places::Places;
use crate::error::{Error, Result};
use crate::stack::appearance::Appearance;
use crate::surface::glb::{About, GlbScene};
use crate::surface::groups::ObjGroups;
use crate::surface::mesh::MeshSource;
use crate::surface::mesh_files::WriteMesh;
use crate::surface::three_mf::ThreeMfScene;

/// Open files of all bodies.
pub struct Scenes {
    files: Vec<(PathBuf, Format, Pending)>,
    shared: SharedScene,
}

/// Scene that takes the meshes of all bodies, one after the other.
#[derive(Clone)]
pub struct SharedScene {
    /// The files that messages name, with their formats.
    targets: Vec<(PathBuf, Format)>,
    scenes: Arc<Mutex<Vec<(Format, Scene)>>>,
}

/// Bodies on their way into a format.
enum Scene {
    Glb(GlbScene),
    Groups(ObjGroups),
    ThreeMf(ThreeMfScene),
}

impl Scene {
    /// An empty scene of a format; nothing where a body has a file of its own in it.
    fn new(format: Format, folder: &Path) -> Option<io::Result<Self>> {
        match format {
            Format::Glb => Some(GlbScene::new(folder).map(Scene::Glb)),
            Format::ObjGroups => Some(ObjGroups::new(folder).map(Scene::Groups)),
            Format::ThreeMf => Some(ThreeMfScene::new(folder).map(Scene::ThreeMf)),
            _ => None,
        }
    }

    fn add(&mut self, mesh: &mut dyn MeshSource, about: &About) -> io::Result<()> {
        match self {
            Scene::Glb(scene) => scene.add(mesh, about),
            Scene::Groups(scene) => scene.add(mesh, about),
            Scene::ThreeMf(scene) => scene.add(mesh, about),
        }
    }

    fn write<W: Write + Seek>(&mut self, out: &mut W) -> io::Result<()> {
        match self {
            Scene::Glb(scene) => scene.write(out),
            Scene::Groups(scene) => scene.write(out),
            Scene::ThreeMf(scene) => scene.write(out),
        }
    }
}

impl Scenes {
    /// Whether a run with many bodies puts them all into a file of this name.
    pub fn has(path: &Path) -> bool {
        matches!(Format::of(path), Ok(Format::Glb | Format::ObjGroups | Format::ThreeMf))
    }

    /// Opens the files under temporary names; nothing where there are none.
    ///
    /// # Errors
    /// [`Error::Output`] for a name that cannot be written, or is that of an input or another output.
    pub fn open(paths: &[PathBuf], places: &mut Places) -> Result<Option<Self>> {
        let (mut files, mut scenes) = (Vec::new(), Vec::<(Format, Scene)>::new());
        for path in paths {
            let format = Format::of(path)?;
            files.push((path.clone(), format, Pending::open(path, false, Temporary::Random, places)?));
            if !scenes.iter().any(|(known, _)| *known == format)
                && let Some(scene) = Scene::new(format, parent(path))
            {
                scenes.push((format, scene.map_err(|source| Error::Write { path: path.clone(), source })?));
            }
        }
        let targets: Vec<_> = files.iter().map(|(path, format, _)| (path.clone(), *format)).collect();
        let shared = SharedScene { targets, scenes: Arc::new(Mutex::new(scenes)) };
        Ok((!files.is_empty()).then_some(Scenes { files, shared }))
    }

    /// The files, by their names.
    pub fn targets(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|(target, ..)| target.as_path())
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
        let mut scenes = self.shared.lock().map_err(|source| self.shared.fails(source))?;
        self.files.iter_mut().try_for_each(|(target, format, pending)| {
            let mut write = || {
                let Made::File(file, _) = &mut pending.made else { return Ok(()) };
                let Some((_, scene)) = scenes.iter_mut().find(|(of, _)| of == format) else { return Ok(()) };
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
        let rename = |(target, _, pending): (PathBuf, Format, Pending)| match pending.rename() {
            Ok(()) => Ok(target),
            Err(source) => Err(Error::Write { path: target, source }),
        };
        self.files.into_iter().map(rename).collect()
    }
}

impl SharedScene {
    /// The file that messages name.
    pub(super) fn target(&self) -> &Path {
        self.targets.first().map_or(Path::new(""), |(path, _)| path)
    }

    /// The formats of its files.
    pub(super) fn formats(&self) -> impl Iterator<Item = Format> {
        self.targets.iter().map(|(_, format)| *format)
    }

    /// The first file that holds positions as f32.
    pub(super) fn single(&self) -> Option<&Path> {
        self.targets.iter().find(|(_, format)| format.is_single(Kind::Mesh)).map(|(path, _)| path.as_path())
    }

    /// Adds the mesh of the first of the options' bodies, in this unit and relative to this origin.
    pub(super) fn write_mesh(&self, options: &OutputOptions, unit: &str, origin: DVec3) -> WriteMesh {
        let (shared, unit) = (self.clone(), unit.to_string());
        let appearance = options.bodies.first().cloned().unwrap_or_default();
        let label = appearance.number.map(|number| format!("label {number}"));
        let appearance = Appearance { name: appearance.name.or(label), ..appearance };
        let about = About { appearance, unit, origin, frame: options.frame() };
        Box::new(move |mesh| shared.lock()?.iter_mut().try_for_each(|(_, scene)| scene.add(mesh, &about)))
    }

    fn lock(&self) -> io::Result<MutexGuard<'_, Vec<(Format, Scene)>>> {
        self.scenes.lock().map_err(|_| io::Error::other("a body before has failed"))
    }

    fn fails(&self, source: io::Error) -> Error {
        Error::Write { path: self.target().into(), source }
    }
}
