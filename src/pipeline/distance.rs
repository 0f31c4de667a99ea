//! The first stage: signed distances of all slices, and their contours.

use rayon::prelude::*;

use super::context::Context;
use crate::backend::requests::ContourRequest;
use crate::backend::{ContourOptions, PaddedSlice};
use crate::contour::Contour;
use crate::error::Result;
use crate::report::ContourReport;
use crate::stack::Slice;
use crate::storage::spill::SpillVec;

/// The contours of all slices on the padded image, and what there is to say of each.
pub(super) fn distance<'a>(run: &Context<'a>) -> Result<(SpillVec<'a, Contour>, Vec<ContourReport>)> {
    let (h, spacing, dims) = (run.h, run.settings.seed_spacing, run.padded());
    let options = ContourOptions::from(run.settings);
    let slices = &run.stack.slices;
    let (mut contours, mut reports) = (SpillVec::new(run.budget), Vec::with_capacity(slices.len()));
    let contour = |z: f64, phi| {
        let mut contour = Contour::new(z, phi, h, spacing);
        if let Some(part) = run.seen.part() {
            contour.number_within(part);
        }
        contour
    };
    let counts = |(node, label): &(usize, &u32)| **label > 0 && run.seen.has(*node, dims[0]);
    let pixels = |c: &Contour| c.solids.labels.iter().enumerate().filter(counts).count();
    // A slice, its field with what is made on the way, its labels.
    for some in slices.chunks(run.budget.at_once(slices.len(), 4 * run.field_bytes())) {
        let padded: Vec<PaddedSlice> =
            some.par_iter().map(|s| PaddedSlice::new(&s.content, run.stack.dims, run.pad)).collect();
        let fields = run.backend.contour_fields(&ContourRequest { slices: &padded, dims, h, options }, run.progress)?;
        drop(padded);
        let made: Vec<Contour> = fields.into_par_iter().zip(some).map(|(phi, s)| contour(s.z, phi)).collect();
        let report = |(c, s): (&Contour, &Slice)| ContourReport {
            name: s.name.clone(),
            z: s.z,
            extra: s.extra,
            components: c.solids.count,
            holes: c.holes,
            pixels: pixels(c),
            ..ContourReport::default()
        };
        reports.par_extend(made.par_iter().zip(some).map(report));
        made.into_iter().try_for_each(|contour| contours.push(contour))?;
    }
    Ok((contours, reports))
}
