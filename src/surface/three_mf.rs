//! Meshes as 3MF (core specification 1.3, `.3mf`): a packed XML in which each body is an object with its name and colour.
//!
//! Positions are those of all other outputs: world coordinates (LPS) in the stack's unit, as many digits as tell an f64 from all others. The
//! model's `unit` is the stack's; of a unit that 3MF does not know, 1 counts as a millimetre, see [`told`].

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Seek, Write};
use std::path::Path;

use glam::DVec3;
use quick_xml::escape::escape;
use zip::ZipWriter;

use super::glb::About;
use super::glb::colour::shown;
use super::length::{foot_of_3mf, of_3mf};
use super::mesh::MeshSource;
use super::npy::options;

/// Number of the colours among the model's resources; those of the bodies follow.
const COLOURS: usize = 1;
/// Most vertices of a body: their numbers have 31 bits.
const MOST: u64 = 1 << 31;

const TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"#;
const RELATIONS: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"#;

/// Note for a person about a unit that the format does not know.
pub fn told(unit: &str) -> Option<String> {
    if let Some(note) = foot_of_3mf(unit) {
        return Some(note);
    }
    let known = of_3mf(unit).is_some();
    (!known).then(|| format!("3MF does not know the unit {unit}: 1 {unit} is written as 1 millimeter"))
}

/// Writes one mesh.
///
/// # Errors
/// The errors of `out`; [`io::ErrorKind::InvalidInput`] beyond 2^31 vertices.
pub fn write_3mf<W: Write + Seek>(out: &mut W, mesh: &mut dyn MeshSource, about: &About) -> io::Result<()> {
    let filled = mesh.counts()[1] > 0;
    let bodies = if filled { std::slice::from_ref(about) } else { &[] };
    package(out, bodies, |model| if filled { object(model, COLOURS + 1, mesh, about) } else { Ok(()) })
}

/// Several bodies on their way into one file. Their text waits in a nameless file.
#[derive(Debug)]
pub struct ThreeMfScene {
    bodies: Vec<About>,
    text: BufWriter<File>,
}

impl ThreeMfScene {
    /// A scene without bodies; its nameless file is in `folder`.
    ///
    /// # Errors
    /// The errors of making that file.
    pub fn new(folder: &Path) -> io::Result<Self> {
        Ok(ThreeMfScene { bodies: Vec::new(), text: BufWriter::new(tempfile::tempfile_in(folder)?) })
    }

    /// Adds a body; one without a surface is no object.
    ///
    /// # Errors
    /// The errors of [`write_3mf`].
    pub fn add(&mut self, mesh: &mut dyn MeshSource, about: &About) -> io::Result<()> {
        if mesh.counts()[1] == 0 {
            return Ok(());
        }
        self.bodies.push(about.clone());
        object(&mut self.text, COLOURS + self.bodies.len(), mesh, about)
    }

    /// Writes all bodies, in their order.
    ///
    /// # Errors
    /// The errors of [`write_3mf`].
    pub fn write<W: Write + Seek>(&mut self, out: &mut W) -> io::Result<()> {
        self.text.flush()?;
        let file = self.text.get_mut();
        file.rewind()?;
        package(out, &self.bodies, |model| io::copy(&mut BufReader::new(&mut *file), model).map(drop))?;
        file.seek(io::SeekFrom::End(0)).map(drop)
    }
}

/// The package around the objects that `objects` writes.
fn package<W: Write + Seek>(
    out: &mut W,
    bodies: &[About],
    objects: impl FnOnce(&mut ZipWriter<&mut W>) -> io::Result<()>,
) -> io::Result<()> {
    let mut archive = ZipWriter::new(out);
    for (name, text) in [("[Content_Types].xml", TYPES), ("_rels/.rels", RELATIONS)] {
        archive.start_file(name, options())?;
        archive.write_all(text.as_bytes())?;
    }
    archive.start_file("3D/3dmodel.model", options())?;
    let unit = bodies.first().map_or("mm", |body| body.unit.as_str());
    write!(
        archive,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model unit=\"{}\" xml:lang=\"en-US\" \
         xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\">\n\
         <metadata name=\"Application\">interslice {}</metadata>\n\
         <metadata name=\"Description\">left-posterior-superior, {}</metadata>\n<resources>\n",
        of_3mf(unit).unwrap_or("millimeter"),
        env!("CARGO_PKG_VERSION"),
        text(unit),
    )?;
    if !bodies.is_empty() {
        writeln!(archive, "<basematerials id=\"{COLOURS}\">")?;
        for body in bodies {
            let [r, g, b] = shown(&body.appearance).map(|c| (255.0 * c).round() as u8);
            writeln!(archive, "<base name=\"{}\" displaycolor=\"#{r:02X}{g:02X}{b:02X}\"/>", name(body))?;
        }
        writeln!(archive, "</basematerials>")?;
    }
    objects(&mut archive)?;
    writeln!(archive, "</resources>\n<build>")?;
    (0..bodies.len()).try_for_each(|k| writeln!(archive, "<item objectid=\"{}\"/>", COLOURS + 1 + k))?;
    writeln!(archive, "</build>\n</model>")?;
    archive.finish()?.flush()
}

/// A body as object number `id`, which follows the colours.
fn object<W: Write>(out: &mut W, id: usize, mesh: &mut dyn MeshSource, about: &About) -> io::Result<()> {
    if mesh.counts()[0] > MOST {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "3MF holds at most 2^31 vertices of a body"));
    }
    let (name, colour) = (name(about), id - COLOURS - 1);
    write!(out, "<object id=\"{id}\" type=\"model\" name=\"{name}\" pid=\"{COLOURS}\" pindex=\"{colour}\"")?;
    if let Some(number) = about.appearance.number {
        write!(out, " partnumber=\"{number}\"")?;
    }
    out.write_all(b">\n<mesh>\n<vertices>\n")?;
    mesh.vertices(&mut |v| {
        let DVec3 { x, y, z } = v.position;
        writeln!(out, "<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>")
    })?;
    out.write_all(b"</vertices>\n<triangles>\n")?;
    mesh.triangles(&mut |[a, b, c], _| writeln!(out, "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>"))?;
    out.write_all(b"</triangles>\n</mesh>\n</object>\n")
}

fn name(about: &About) -> String {
    text(about.appearance.name.as_deref().unwrap_or_default())
}

/// Text as XML holds it: it has no control characters.
fn text(text: &str) -> String {
    let plain: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    escape(plain.as_str()).into_owned()
}
