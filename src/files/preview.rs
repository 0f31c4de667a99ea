//! A small picture of a body, made beside its files for a page over many bodies.

use std::io::{self, Cursor};
use std::sync::{Arc, Mutex, PoisonError};

use image::ImageFormat;

use crate::stack::Geometry;
use crate::surface::header::Header;
use crate::surface::render::{RenderOptions, render};
use crate::surface::stream::{BodyWriter, Ending, WriterNeeds};

/// Columns and rows of the picture: twice of what a page shows, for fine screens.
pub const SIZE: [u32; 2] = [320, 240];
/// Bytes of memory that drawing needs: colour and depth of four samples a pixel.
pub const BYTES: u64 = 4 * 32 * SIZE[0] as u64 * SIZE[1] as u64;

/// The place where the picture of a body, as PNG, is kept when it is drawn.
#[derive(Debug, Clone, Default)]
pub(super) struct Preview(Arc<Mutex<Option<Vec<u8>>>>);

impl Preview {
    /// A writer that keeps the picture here.
    pub fn writer(&self, header: &Header) -> Box<dyn BodyWriter> {
        Box::new(PreviewWriter { geometry: header.geometry, place: self.clone() })
    }

    /// What was kept, once.
    pub fn take(&self) -> Option<Vec<u8>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

struct PreviewWriter {
    geometry: Geometry,
    place: Preview,
}

impl BodyWriter for PreviewWriter {
    fn needs(&self) -> WriterNeeds {
        WriterNeeds::Mesh
    }

    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()> {
        let [width, height] = SIZE;
        let drawn = render(&self.geometry, end.mesh, &[], RenderOptions { width, height, contours: false })?;
        let mut picture = Cursor::new(Vec::new());
        drawn.write_to(&mut picture, ImageFormat::Png).map_err(io::Error::other)?;
        *self.place.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(picture.into_inner());
        Ok(())
    }
}
