//! The last stage of both methods: layers are faired and held together.

use super::connect::together;
use super::context::{Context, Sink};
use super::links::{IntervalLinks, fairing_shares};
use crate::contour::Contour;
use crate::error::Result;
use crate::fairing::{Fairing, FairingSpec};
use crate::registration::motion_stack::MotionStack;
use crate::storage::spill::SpillVec;
use crate::surface::Layer;

/// Runs `make`, whose layers reach `sink` faired if that is wanted, connected where their contours overlap, with nothing that floats.
pub(super) fn faired<'a>(
    run: &Context<'a>,
    links: &[IntervalLinks],
    contours: &SpillVec<'a, Contour>,
    moving: Option<&MotionStack<'a>>,
    sink: &mut Sink<'_>,
    make: impl FnOnce(&mut Sink<'_>) -> Result<()>,
) -> Result<()> {
    let mut together = together(run, links, contours);
    let limit = (run.settings.margin() as f64 * run.px) as f32;
    let on_image = |mut layer: Layer| {
        if run.window.beyond {
            run.window.end_at_border(&mut layer.phi, run.image, run.stack.spacing, limit);
        }
        layer
    };
    if run.settings.fair == 0.0 {
        make(&mut |layer| together.push(on_image(layer), sink))?;
        return together.finish(sink);
    }
    let mut fairing = Fairing::new(FairingSpec {
        moving: moving.map(|moving| (moving, run.pad)),
        contours: run.stack.slices.iter().map(|s| s.z).collect(),
        drawn: run.stack.slices.iter().map(|s| !s.content.is_empty()).collect(),
        dims: run.stack.dims,
        spacing: run.stack.spacing,
        layers: run.span.layers.clone(),
        gap: run.span.gap,
        alpha: run.settings.fair,
        limited: !run.settings.slope.overshoots(),
        farthest: run.settings.margin() as f64 * run.px,
        steered: run.settings.steered_ends(),
        shares: fairing_shares(run, links, contours)?,
    });
    make(&mut |layer| fairing.push(layer, &mut |layer| together.push(on_image(layer), sink)))?;
    fairing.finish(&mut |layer| together.push(on_image(layer), sink))?;
    together.finish(sink)
}
