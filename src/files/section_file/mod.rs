//! A section of a body on its way to be joined with the others: its layers and its report in one file.
//!
//! ```text
//! a gzip stream: one line of JSON (Head), then records:
//! 1, height f64, output u8, contour + 1 u64 (0: none), and square by square of 16 x 16 px, row by row:
//!     1 and the signed distance f32 that it has everywhere, or 0 and the distances f32 of its pixels, as far as the image goes, row by row
//! 0, length u64, report as JSON
//! ```
//! Numbers are little-endian; gzip's checksum tells whether all is as it was written. Joined sections go through the writers of a single run, so that its files have the same bytes.

mod reader;
mod writer;

use serde::{Deserialize, Serialize};

pub use self::reader::Sections;
pub use self::writer::SectionWriter;
use super::options::OutputOptions;
use crate::stack::appearance::Appearance;
use crate::stack::{Geometry, HeightGrid};
use crate::surface::content::Paint;
use crate::surface::like::LikeGrid;
use crate::surface::map::Map;

/// Bytes of a file's buffer.
const BUFFER_BYTES: usize = 1 << 20;
/// First word of every file.
const MAGIC: &str = "interslice section 2";
/// Kinds of records.
const LAYER: u8 = 1;
const END: u8 = 0;
/// Kinds of squares.
const WHOLE: u8 = 1;
const VALUES: u8 = 0;

/// Body that a section is part of.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    format: String,
    version: String,
    /// Fingerprint of input and options.
    fingerprint: String,
    /// Its number, from 1, and how many there are.
    part: [usize; 2],
    dims: [usize; 2],
    spacing: [f64; 2],
    unit: String,
    geometry: Geometry,
    /// Extent of the body where the section ends with it.
    extent: [f64; 2],
    /// Heights of the output layers of all sections.
    grid: HeightGrid,
    /// Options of the outputs.
    output: OutputOptions,
    /// Name and colour that the input says.
    map: Option<Map>,
    bodies: Vec<Appearance>,
    /// Voxels of a mask as the input's.
    #[serde(default)]
    paint: Option<Paint>,
    /// Grid that outputs are asked to have.
    #[serde(default)]
    like: Option<LikeGrid>,
}

impl Head {
    /// Whether it is the head of a section of the same body.
    fn is_beside(&self, other: &Head) -> bool {
        // Less what is each section's own.
        let body = |head: &Head| {
            let head = Head { part: [0, head.part[1]], extent: [0.0; 2], ..head.clone() };
            serde_json::to_value(head).ok()
        };
        body(self) == body(other)
    }
}
