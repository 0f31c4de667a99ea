//! Contours between the drawn planes, found while a body's layers arrive; only the lines are kept.

use std::io::{self, Write};
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::{CLOSED, CLOSED_XOR, ChosenRois, Contour, ImageSeries, ReferencedSet};
use crate::error::Result;
use crate::polygons::Polygon;
use crate::stack::Geometry;
use crate::surface::Layer;
use crate::surface::contour_lines::contour_lines;
use crate::surface::header::Header;
use crate::surface::stream::{BodyWriter, Ending, LayerSink};

/// Contours that were made for a ROI.
#[derive(Debug, Clone)]
pub struct Added {
    /// ROI Number.
    pub(super) roi: i64,
    /// CLOSED_PLANAR, or CLOSEDPLANAR_XOR where the ROI was drawn so.
    pub(super) kind: &'static str,
    /// The planes' normal.
    pub(super) normal: DVec3,
    /// Heights along it, increasing, and Contour Data of each line there.
    pub(super) planes: Vec<(f64, Vec<String>)>,
    /// Images of these planes, where they were named.
    pub(super) images: Option<Arc<ImageSeries>>,
}

/// The planes that get contours: those of output layers that lie between drawn planes, at least half a step from both: with `every`, of those that
/// lie whole such steps from the lowest contour; else of all.
#[derive(Debug)]
pub(super) struct Between {
    /// Heights of the drawn planes, increasing.
    drawn: Vec<f64>,
    /// Least distance from them.
    apart: f64,
    /// Height of the lowest contour, and steps from it.
    start: f64,
    every: Option<f64>,
}

impl Between {
    /// The planes between those of the chosen ROIs, for output heights in steps of `step`.
    ///
    /// # Errors
    /// The errors of [`ChosenRois::chosen_planes`].
    pub fn new(chosen: &ChosenRois<'_>, source: &ReferencedSet, step: f64) -> Result<Self> {
        let ReferencedSet { options, every, images, .. } = source;
        let step = every.unwrap_or(step);
        let lowest = chosen.chosen_planes(options)?[0];
        let same = chosen.planes.tolerance;
        Ok(Between {
            drawn: chosen.planes.heights.clone(),
            // Planes of images that were named are all wanted.
            apart: if images.is_some() { same } else { (0.5 * step - 1e-6 * step).max(same) },
            start: chosen.planes.heights[lowest],
            every: *every,
        })
    }

    /// Whether contours at a height are wanted.
    pub fn wants(&self, z: f64) -> bool {
        let due = |every: f64| ((z - self.start) / every - ((z - self.start) / every).round()).abs() < 1e-3;
        let within = self.drawn.first().is_some_and(|low| z > *low) && self.drawn.last().is_some_and(|high| z < *high);
        within && self.every.is_none_or(due) && self.drawn.iter().all(|d| (d - z).abs() >= self.apart)
    }
}

/// The contour lines of the output layers between drawn planes.
#[derive(Debug)]
pub(super) struct Adding {
    added: Added,
    between: Between,
    dims: [usize; 2],
    spacing: [f64; 2],
    geometry: Geometry,
}

impl Adding {
    /// To the only one of the chosen ROIs; nothing yet.
    ///
    /// # Errors
    /// The errors of [`ChosenRois::chosen_planes`].
    pub fn new(chosen: &ChosenRois<'_>, source: &ReferencedSet, header: &Header) -> Result<Self> {
        let roi = chosen.rois[0];
        let kind = if roi.contours.iter().any(Contour::is_xor) { CLOSED_XOR } else { CLOSED };
        Ok(Adding {
            added: Added {
                roi: roi.number,
                kind,
                normal: chosen.planes.axes[2],
                planes: Vec::new(),
                images: source.images.clone(),
            },
            between: Between::new(chosen, source, header.grid.step)?,
            dims: header.dims,
            spacing: header.spacing,
            geometry: header.geometry,
        })
    }

    /// The next layer.
    pub fn layer(&mut self, layer: &Layer) {
        if !layer.output || !self.between.wants(layer.z) {
            return;
        }
        let point = |x: DVec2| {
            let place = (x * DVec2::from(self.spacing)).extend(layer.z);
            self.geometry.to_world(place).to_array().map(decimal).join("\\")
        };
        let data = |line: Polygon| line.into_iter().map(point).collect::<Vec<_>>().join("\\");
        let lines: Vec<String> = contour_lines(layer, self.dims).into_iter().map(data).collect();
        if !lines.is_empty() {
            self.added.planes.push((layer.z, lines));
        }
    }
}

/// Writes the completed structure set, at the end.
pub struct StructuresWriter<W> {
    out: W,
    source: Arc<ReferencedSet>,
    adding: Adding,
}

impl<W> StructuresWriter<W> {
    /// For the body that is made of what `source` chose.
    ///
    /// # Errors
    /// The errors of [`StructureSet::choose`](super::StructureSet::choose).
    pub fn new(out: W, source: &Arc<ReferencedSet>, header: &Header) -> Result<Self> {
        Ok(StructuresWriter { out, source: source.clone(), adding: source.adding(header)? })
    }
}

impl<W: Write + Send> BodyWriter for StructuresWriter<W> {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        self.adding.layer(layer);
        Ok(())
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        self.source.set.write_completed(&mut self.out, std::slice::from_ref(&self.adding.added))?;
        self.out.flush()
    }
}

/// Keeps what a body adds, for a file of several bodies, while its layers go on to `rest`.
pub struct Gather<'s, S> {
    source: &'s ReferencedSet,
    adding: Option<Adding>,
    rest: S,
}

impl<'s, S: LayerSink> Gather<'s, S> {
    /// For the body that is made of what `source` chose.
    pub fn new(source: &'s ReferencedSet, rest: S) -> Self {
        Gather { source, adding: None, rest }
    }

    /// Contours that the body adds; nothing before its first layer.
    pub fn added(self) -> Option<Added> {
        self.adding.map(|a| a.added)
    }
}

impl<S: LayerSink> LayerSink for Gather<'_, S> {
    fn begin(&mut self, header: &Header) -> Result<()> {
        self.adding = Some(self.source.adding(header)?);
        self.rest.begin(header)
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
        if let Some(adding) = &mut self.adding {
            adding.layer(&layer);
        }
        self.rest.layer(layer)
    }
}

/// A decimal string of at most 16 characters.
pub(super) fn decimal(v: f64) -> String {
    let text = format!("{v:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    match text {
        "-0" => "0".into(),
        text if text.len() <= 16 => text.into(),
        _ => format!("{v:.8e}"),
    }
}
