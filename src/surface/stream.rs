//! A body written while it is made, layer by layer, so that neither its volume nor its mesh need fit in memory.
//!
//! ```text
//! Header -> writers -> BodyStream::layer, lowest first -> BodyStream::finish
//! ```

use std::io;
use std::path::Path;

use glam::DVec3;
use rayon::prelude::*;

use super::Layer;
use super::header::Header;
use super::marching::{Builder, Piece};
use super::mesh::MeshMeasure;
use super::spool::Spool;
use crate::error::Result;
use crate::progress::Stop;
use crate::report::Report;
use crate::report::body::Step;
use crate::surface::areas::Areas;

/// Sink that takes the layers of a body as they are finished, lowest first.
pub trait LayerSink {
    /// The first layer is near. Where a run begins again, this is called again, and what came before does not count.
    ///
    /// # Errors
    /// Any; they end the run.
    fn begin(&mut self, _header: &Header) -> Result<()> {
        Ok(())
    }

    /// The next layer.
    ///
    /// # Errors
    /// Any; they end the run.
    fn layer(&mut self, layer: Layer) -> Result<()>;
}

impl<F: FnMut(Layer) -> Result<()>> LayerSink for F {
    fn layer(&mut self, layer: Layer) -> Result<()> {
        self(layer)
    }
}

/// Needs of a writer besides the layers of a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum WriterNeeds {
    /// Nothing but the layers.
    Layers,
    /// The surface as it arises, or its volume and area.
    Surface,
    /// The surface as a whole, at the end.
    Mesh,
}

/// Writer of a body in one format. It is made with the [`Header`].
pub trait BodyWriter: Send {
    /// Needs of this writer.
    fn needs(&self) -> WriterNeeds {
        WriterNeeds::Layers
    }

    /// Whether what it writes shows the surface.
    fn shows_surface(&self) -> bool {
        false
    }

    /// The next layer, output layer or not.
    ///
    /// # Errors
    /// The errors of writing.
    fn layer(&mut self, _layer: &Layer) -> io::Result<()> {
        Ok(())
    }

    /// The surface below that layer, as far as it is new.
    ///
    /// # Errors
    /// The errors of writing.
    fn piece(&mut self, _piece: &Piece) -> io::Result<()> {
        Ok(())
    }

    /// Before any writer's end, where some writer needs the mesh: what a person should know of what becomes of it.
    ///
    /// # Errors
    /// The errors of reading the mesh.
    fn prepare(&mut self, _mesh: &mut Spool) -> io::Result<Option<String>> {
        Ok(None)
    }

    /// The end: writes what is left, up to the last byte.
    ///
    /// # Errors
    /// The errors of writing.
    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()>;
}

/// Ending of a body: what is known when all layers are there.
pub struct Ending<'e> {
    /// Report of what was done, with volume and area where some writer needs the surface.
    pub report: &'e Report,
    /// The whole surface where some writer needs the mesh, else nothing.
    pub mesh: &'e mut Spool,
}

/// Failure of a writer: its number and the reason.
pub type Failed = (usize, io::Error);

/// A body on its way into its writers.
pub struct BodyStream<'w> {
    writers: Vec<Box<dyn BodyWriter + 'w>>,
    needs: WriterNeeds,
    builder: Builder,
    measure: MeshMeasure,
    areas: Areas,
    spool: Spool,
    origin: DVec3,
    notes: Vec<String>,
    stop: Stop,
}

impl<'w> BodyStream<'w> {
    /// A stream without layers yet. A mesh that does not fit in memory waits in a nameless file in `folder`.
    pub fn new(header: &Header, writers: Vec<Box<dyn BodyWriter + 'w>>, folder: &Path) -> Self {
        let needs = writers.iter().map(|w| w.needs()).max().unwrap_or(WriterNeeds::Layers);
        BodyStream {
            writers,
            needs,
            builder: Builder::new(header),
            measure: MeshMeasure::default(),
            areas: Areas::new(header),
            spool: Spool::new(folder),
            origin: DVec3::ZERO,
            notes: Vec::new(),
            stop: Stop::default(),
        }
    }

    /// The stream, which notes in the report the origin of positions in some of the files, and other notes about where things lie.
    pub fn telling(self, origin: DVec3, notes: Vec<String>) -> Self {
        BodyStream { origin, notes, ..self }
    }

    /// The stream, which at its end looks at `stop` before each writer.
    pub fn until(self, stop: Stop) -> Self {
        BodyStream { stop, ..self }
    }

    /// The next layer, to all writers at once.
    ///
    /// # Errors
    /// The first writer that failed.
    pub fn layer(&mut self, layer: &Layer) -> std::result::Result<(), Failed> {
        if self.needs >= WriterNeeds::Surface {
            self.builder.layer(layer);
        }
        self.surface(Some(layer))?;
        if self.needs >= WriterNeeds::Surface {
            self.areas.layer(layer);
        }
        Ok(())
    }

    /// Gives the writers a layer, and then what is new of the surface.
    fn surface(&mut self, mut layer: Option<&Layer>) -> std::result::Result<(), Failed> {
        loop {
            let pieces = self.builder.made();
            if layer.is_none() && pieces.is_none() {
                return Ok(());
            }
            let write = |writer: &mut Box<dyn BodyWriter + 'w>| {
                layer.map_or(Ok(()), |layer| writer.layer(layer))?;
                pieces.iter().flatten().try_for_each(|piece| writer.piece(piece))
            };
            let written: Vec<io::Result<()>> = match self.writers.len() {
                0 | 1 => self.writers.iter_mut().map(write).collect(),
                _ => self.writers.par_iter_mut().map(write).collect(),
            };
            written.into_iter().enumerate().try_for_each(|(k, w)| w.map_err(|e| (k, e)))?;
            layer = None;
            let Some(pieces) = pieces else { return Ok(()) };
            pieces.iter().for_each(|piece| self.measure.add(piece));
            if self.needs == WriterNeeds::Mesh {
                let keep = |piece| self.spool.push(piece);
                pieces.iter().try_for_each(keep).map_err(|e| (keeper(&self.writers), e))?;
            }
        }
    }

    /// The end of the body. Where some writer needs the surface, its volume and area are put into `report`, and what writers warn of.
    ///
    /// # Errors
    /// The first writer that failed, or [`io::ErrorKind::Interrupted`] before it.
    pub fn finish(mut self, report: &mut Report) -> std::result::Result<(), Failed> {
        if self.needs >= WriterNeeds::Surface {
            self.builder.finish();
            self.surface(None)?;
            self.spool.finish().map_err(|e| (keeper(&self.writers), e))?;
            report.volume = Some(self.measure.volume());
            report.area = Some(self.measure.area());
            let areas = self.areas.finish();
            if self.writers.iter().any(|writer| writer.shows_surface()) {
                self.notes.extend(thinner(self.measure.volume(), areas.between_contours, report.body.largest_step));
            }
            report.areas = Some(areas);
        }
        report.local_origin = (self.origin != DVec3::ZERO).then(|| self.origin.to_array());
        let mut warnings = self.notes;
        for (k, writer) in self.writers.iter_mut().enumerate() {
            warnings.extend(writer.prepare(&mut self.spool).map_err(|e| (k, e))?);
        }
        for warning in warnings {
            if !report.warnings.contains(&warning) {
                report.warnings.push(warning);
            }
        }
        let mut end = Ending { report, mesh: &mut self.spool };
        let finish = |writer: &mut Box<dyn BodyWriter + 'w>| match self.stop.is_asked() {
            true => Err(io::ErrorKind::Interrupted.into()),
            false => writer.finish(&mut end),
        };
        self.writers.iter_mut().map(finish).enumerate().try_for_each(|(k, done)| done.map_err(|e| (k, e)))
    }
}

/// Share of the layers' volume below which a mesh's is told, where the body moves by more than so many pixels from layer to layer. Upright tubes of 2 px
/// have 0.95 of it, of 3 px 0.97; oblique ones of 2.5 px 0.95 where they move by a pixel per layer, 0.91 by two, 0.65 by four.
const THINNER: f64 = 0.95;
const MOVING: f64 = 1.5;

/// Warns of a mesh that holds less than its layers (unit cubed): where a thin part moves far from layer to layer, what goes straight between them is
/// thinner, and may be torn.
fn thinner(mesh: f64, layers: f64, step: Option<Step>) -> Option<String> {
    let Step { from, to, px } = step.filter(|step| step.px > MOVING && mesh < THINNER * layers)?;
    let digits = |v: f64| format!("{v:.*}", (1.0 - v.log10().floor()).max(0.0) as usize);
    Some(format!(
        "the mesh holds {:.0} % of the volume of its layers: from one to the next the body moves by up to {px:.1} px, and the mesh goes straight \
         between them; with `--dz {}` it moves by a pixel",
        100.0 * mesh / layers,
        digits((to - from) / px)
    ))
}

/// The writer for which the mesh is kept.
fn keeper(writers: &[Box<dyn BodyWriter + '_>]) -> usize {
    writers.iter().position(|w| w.needs() == WriterNeeds::Mesh).unwrap_or(0)
}
