//! The slices of a union of which members have slices of their own: each is interpolated by itself to those of others, before they become one.

use std::borrow::Cow;

use super::Loaded;
use crate::backend::Means;
use crate::error::{Error, Result, counted};
use crate::grid::sparse_image::SparseImage;
use crate::reconstruct::reconstruct_into;
use crate::settings::{EndRule, Link, Settings};
use crate::stack::{ContourStack, LevelSlice, SliceContent};
use crate::surface::Layer;

impl Loaded {
    /// Refuses links between parts of slices that are completed: they number the parts as they are drawn.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub(super) fn check_links(&self, links: &[Link]) -> Result<()> {
        let Some(member) = self.interpolated.first().filter(|_| !links.is_empty()) else { return Ok(()) };
        let message = format!(
            "number parts of slices as they are drawn, but {} is interpolated to {} of others; make each by itself",
            member.name,
            counted(member.slices.len(), "slice")
        );
        Err(Error::Setting { name: "links".into(), message })
    }

    /// The stack to be reconstructed, and what there is to say of members that were interpolated: of one body the stack that was read.
    ///
    /// # Errors
    /// The errors of [`reconstruct_into`]; [`Error::Setting`] for links between parts.
    pub fn completed(&self, settings: &Settings, means: &Means<'_>) -> Result<(Cow<'_, ContourStack>, Vec<String>)> {
        self.check_links(&settings.links)?;
        if self.interpolated.is_empty() {
            return Ok((Cow::Borrowed(&self.stack), Vec::new()));
        }
        let (mut stack, mut notes) = (self.stack.clone(), Vec::new());
        // Only what lies between a member's own slices is asked for.
        let (end_bottom, end_top) = (EndRule::Flat, EndRule::Flat);
        let settings = Settings { end_bottom, end_top, ..settings.clone() };
        for member in &self.interpolated {
            let heights: Vec<f64> = member.slices.iter().map(|&k| self.stack.slices[k].z).collect();
            let mut layers = Vec::new();
            let mut keep = |layer: Layer| {
                layers.extend(layer.output.then_some(layer));
                Ok(())
            };
            let body = reconstruct_into(&member.stack, &heights, &settings, means, &mut keep)?;
            notes.extend(body.report.warnings.into_iter().map(|warning| format!("{}: {warning}", member.name)));
            for (layer, &k) in layers.iter().zip(&member.slices) {
                let content = &mut stack.slices[k].content;
                *content = united(content, &layer.phi);
            }
        }
        Ok((Cow::Owned(stack), notes))
    }
}

/// What is inside either.
fn united(content: &SliceContent, phi: &SparseImage<f32>) -> SliceContent {
    let nx = phi.dims()[0];
    match content {
        SliceContent::Mask(mask) => {
            SliceContent::Mask((0..mask.len()).map(|n| mask.at(n) || phi.at(n % nx, n / nx) < 0.0).collect())
        }
        SliceContent::Level(level) => {
            let least = |n: usize| level.value(n).min(phi.at(n % nx, n / nx));
            SliceContent::Level(LevelSlice::new(&(0..content.len()).map(least).collect::<Vec<_>>(), nx))
        }
    }
}
