//! From files to files: one reconstruction, as the command line or a line of a manifest asks for it.
//!
//! ```text
//! Loaded::read -> Loaded::compute -> Outputs::complete -> Outputs::rename
//! ```

pub mod named;
pub mod outputs;

use std::path::Path;

use serde::Serialize;

use crate::backend::Backend;
use crate::error::{Error, Result};
use crate::links::LinkOptions;
use crate::progress::Progress;
use crate::settings::Settings;
use crate::stack::{ContourStack, ReadOptions, read};
use crate::surface::Reconstruction;
use crate::{height_grid, memory, reconstruct_with};
use outputs::OutputOptions;

/// All that decides a result besides its input.
#[derive(Debug, Clone, Default, Serialize)]
pub struct JobOptions {
    /// What is read.
    pub read: ReadOptions,
    /// What is said about its parts; the file's content counts, not its name.
    #[serde(skip)]
    pub links: LinkOptions,
    /// How it is reconstructed.
    pub settings: Settings,
    /// What is made of the result.
    pub output: OutputOptions,
}

impl JobOptions {
    /// Checks every range.
    ///
    /// # Errors
    /// [`Error::Setting`] with name, range and value.
    pub fn check(&self) -> Result<()> {
        self.settings.validate()?;
        match self.output.dz {
            Some(dz) if !(dz.is_finite() && dz > 0.0) => {
                Err(Error::Setting { name: "dz".into(), message: format!("must be a positive number; got {dz}") })
            }
            _ => Ok(()),
        }
    }
}

/// A stack that was read, and how it is to be reconstructed.
#[derive(Debug)]
pub struct Loaded {
    /// The checked stack.
    pub stack: ContourStack,
    /// Output heights.
    pub heights: Vec<f64>,
    /// How.
    pub options: JobOptions,
    /// What a person should know of the input; the report's first warnings.
    pub notes: Vec<String>,
}

impl Loaded {
    /// Checks the options and reads the input.
    ///
    /// # Errors
    /// As [`JobOptions::check`], [`read::read`] and [`LinkOptions::read`].
    pub fn read(input: &Path, mut options: JobOptions) -> Result<Self> {
        options.check()?;
        let stack = read::read(input, &options.read)?;
        options.settings.links = options.links.read(&stack)?;
        options.settings.validate()?;
        #[cfg(feature = "dicom")]
        if read::is_structure_set(input) {
            let mut source = crate::rtstruct::Source::read(input, &options.read)?;
            let (steps, notes) = source.about(&stack)?;
            if options.output.dz.is_none() {
                options.output.dz = steps.map(|s| s.heights);
                source.every = steps.map(|s| s.planes);
            }
            options.output.source = Some(std::sync::Arc::new(source));
            return Ok(Loaded { notes, ..Self::new(stack, options)? });
        }
        Self::new(stack, options)
    }

    /// The same for a stack that no file holds.
    ///
    /// # Errors
    /// [`Error::Stack`] for too many output heights.
    pub fn new(stack: ContourStack, options: JobOptions) -> Result<Self> {
        let heights = height_grid(&stack, &options.settings, options.output.dz).heights()?;
        Ok(Loaded { stack, heights, options, notes: Vec::new() })
    }

    /// Bytes of memory the reconstruction needs at most.
    pub fn bytes(&self) -> u64 {
        memory::estimate_bytes(&self.stack, &self.heights, &self.options.settings, rayon::current_num_threads())
    }

    /// Reconstructs the body.
    ///
    /// # Errors
    /// As [`reconstruct_with`].
    pub fn compute(&self, backend: &dyn Backend, progress: &dyn Progress) -> Result<Reconstruction> {
        let mut body = reconstruct_with(&self.stack, &self.heights, &self.options.settings, backend, progress)?;
        body.report.warnings.splice(0..0, self.notes.iter().cloned());
        Ok(body)
    }
}
