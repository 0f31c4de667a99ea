//! The report as one page that needs nothing else, no network either: the surface to be turned, with the contours on it, and the report's
//! facts in words, tables and plots.
//!
//! ```text
//! cluster -> scene \
//! report -> words, plots -> page -> template.html
//! ```

mod cluster;
pub(crate) mod page;
mod plots;
mod scene;
pub(crate) mod words;

use std::io::{self, Write};

use self::scene::PageScene;
use super::Layer;
use super::header::Header;
use super::render::{Polyline, contour_lines};
use super::stream::{BodyWriter, Ending, WriterNeeds};

/// Writes the page, at the end: until then it keeps the input contours as lines.
pub struct HtmlWriter<W> {
    out: W,
    title: String,
    /// Error up to which meshes that are written are simpler than the page's.
    simplify: Option<f64>,
    header: Header,
    /// Number of the contour, and its line.
    lines: Vec<(usize, Polyline)>,
}

impl<W> HtmlWriter<W> {
    /// A page without layers yet. Meshes beside it are made simpler where `simplify` says the error.
    pub fn new(out: W, header: &Header, title: String, simplify: Option<f64>) -> Self {
        HtmlWriter { out, title, simplify, header: header.clone(), lines: Vec::new() }
    }
}

impl<W: Write + Send> BodyWriter for HtmlWriter<W> {
    fn needs(&self) -> WriterNeeds {
        WriterNeeds::Mesh
    }

    fn shows_surface(&self) -> bool {
        true
    }

    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        if let Some(number) = layer.contour {
            self.lines.extend(contour_lines(&self.header, layer).into_iter().map(|line| (number, line)));
        }
        Ok(())
    }

    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()> {
        let scene = PageScene::new(&self.header.geometry, end.mesh, &self.lines)?;
        self.out
            .write_all(page::page(&self.title, end.report, self.header.extent, &scene, self.simplify).as_bytes())?;
        self.out.flush()
    }
}
