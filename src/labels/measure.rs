//! Volume, area and areas of a label's body.

use std::io;

use super::KeptBody;
use crate::error::{Error, Result};
use crate::report::Report;
use crate::surface::Layer;
use crate::surface::header::Header;
use crate::surface::stream::{BodyStream, BodyWriter, Ending, LayerSink, WriterNeeds};

impl KeptBody {
    /// Puts volume, area and areas over its height into `report`.
    ///
    /// # Errors
    /// [`Error::Write`] for the temporary file.
    pub fn measure(&mut self, report: &mut Report) -> Result<()> {
        let mut measured = Measured::default();
        self.replay(&mut measured)?;
        measured.stream.map_or(Ok(()), |stream| stream.finish(report)).map_err(failed)
    }
}

fn failed((_, source): (usize, io::Error)) -> Error {
    Error::Write { path: "surface of a label".into(), source }
}

/// Measures a surface that nobody writes.
#[derive(Default)]
struct Measured {
    stream: Option<BodyStream<'static>>,
}

struct Measurer;

impl BodyWriter for Measurer {
    fn needs(&self) -> WriterNeeds {
        WriterNeeds::Surface
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        Ok(())
    }
}

impl LayerSink for Measured {
    fn begin(&mut self, header: &Header) -> Result<()> {
        self.stream = Some(BodyStream::new(header, vec![Box::new(Measurer)], &std::env::temp_dir()));
        Ok(())
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
        self.stream.as_mut().map_or(Ok(()), |stream| stream.layer(&layer)).map_err(failed)
    }
}
