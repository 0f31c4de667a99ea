//! Several bodies in one Wavefront OBJ (`.groups.obj`), each a group with its name.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Seek, Write};
use std::path::Path;

use super::glb::About;
use super::mesh::MeshSource;
use super::mesh_files::{obj_head, write_obj_body};

/// Writes one mesh as a group.
///
/// # Errors
/// The errors of `out`.
pub fn write_group<W: Write>(out: &mut W, mesh: &mut dyn MeshSource, about: &About) -> io::Result<()> {
    obj_head(out)?;
    writeln!(out, "g {}", word(about))?;
    write_obj_body(out, mesh, 0)?;
    out.flush()
}

/// Several bodies on their way into one file, in a nameless file.
#[derive(Debug)]
pub struct ObjGroups {
    names: HashSet<String>,
    vertices: u64,
    text: BufWriter<File>,
}

impl ObjGroups {
    /// A file without bodies; the nameless one is in `folder`.
    ///
    /// # Errors
    /// The errors of making that file.
    pub fn new(folder: &Path) -> io::Result<Self> {
        let text = BufWriter::new(tempfile::tempfile_in(folder)?);
        Ok(ObjGroups { names: HashSet::new(), vertices: 0, text })
    }

    /// Adds a body. Of two with one name the later has a number behind it.
    ///
    /// # Errors
    /// The errors of the nameless file.
    pub fn add(&mut self, mesh: &mut dyn MeshSource, about: &About) -> io::Result<()> {
        let name = word(about);
        let mut own = name.clone();
        let mut count = 1;
        while !self.names.insert(own.clone()) {
            count += 1;
            own = format!("{name}_{count}");
        }
        writeln!(self.text, "g {own}")?;
        write_obj_body(&mut self.text, mesh, self.vertices)?;
        self.vertices += mesh.counts()[0];
        Ok(())
    }

    /// Writes all bodies, in their order.
    ///
    /// # Errors
    /// The errors of [`write_group`].
    pub fn write<W: Write>(&mut self, out: &mut W) -> io::Result<()> {
        obj_head(out)?;
        self.text.flush()?;
        let file = self.text.get_mut();
        file.rewind()?;
        io::copy(&mut BufReader::new(&mut *file), out)?;
        file.seek(io::SeekFrom::End(0))?;
        out.flush()
    }
}

/// A name as OBJ holds it: one word, or it would be several groups.
fn word(about: &About) -> String {
    let name = about.appearance.name.as_deref().unwrap_or_default();
    let word = name.split(|c: char| c.is_whitespace() || c.is_control()).filter(|part| !part.is_empty());
    let word = word.collect::<Vec<_>>().join("_");
    if word.is_empty() { "body".into() } else { word }
}
