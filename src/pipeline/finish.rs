//! The last stage of both methods: layers get what is hollow and what slides, are faired, held together, looked at and handed on.
//!
//! ```text
//! a thread: make -> Hollows -> Slides -> Fairing        a thread: Together -> certificate        the calling thread: sink
//! ```

use std::panic::resume_unwind;
use std::sync::mpsc::sync_channel;
use std::sync::{Mutex, PoisonError};
use std::thread;

use super::connect::together;
use super::context::{Context, Sink};
use super::hollow::Hollows;
use super::hollow::slice::HollowSlices;
use super::links::{IntervalLinks, fairing_shares};
use super::sliding::Slides;
use crate::contour::Contour;
use crate::error::{Error, Result};
use crate::fairing::{Fairing, FairingSpec, GAPS_AT_ONCE, LARGE_AT_ONCE, SMALL};
use crate::grid::sparse_image::SparseImage;
use crate::registration::motion_stack::MotionStack;
use crate::stack::heights::NODES;
use crate::storage::spill::SpillVec;
use crate::surface::Layer;
use crate::surface::stream::LayerSink;

/// Layers that wait between two threads, at most.
pub(crate) const AHEAD: usize = 16;

/// Maker of layers.
pub(super) trait Make: FnOnce(&mut Sink<'_>) -> Result<()> + Send {}

impl<F: FnOnce(&mut Sink<'_>) -> Result<()> + Send> Make for F {}

/// Takers of the layers of a run, one after the other.
pub(super) struct Takers<'t> {
    /// Looks at layers that follow each other; gives back what is handed on.
    pub look: &'t mut (dyn FnMut(Vec<Layer>) -> Vec<Layer> + Send),
    /// Takes it.
    pub sink: &'t mut dyn LayerSink,
}

/// Runs `make`, whose layers reach the takers faired if that is wanted, connected where their contours overlap, with nothing that floats.
///
/// Where memory is not bounded they are made, and looked at, by threads beside the calling one, which takes them.
pub(super) fn faired<'a>(
    run: &Context<'a>,
    links: &[IntervalLinks],
    contours: &SpillVec<'a, Contour>,
    moving: Option<&MotionStack<'a>>,
    Takers { look, sink }: Takers<'_>,
    make: impl Make,
) -> Result<()> {
    let limit = (run.settings.margin() as f64 * run.px) as f32;
    let end = |phi: &mut SparseImage<f32>| run.window.end_at_border(phi, run.image, run.stack.spacing, limit);
    // A thread of a pool that waits would be missing there.
    let alone = run.budget.is_bounded() || rayon::current_thread_index().is_some();
    let mut together = together(run, links, contours, &end, (!alone).then(|| run.clocks.clone()));
    let fairing = fairing(run, links, contours, moving)?;
    let drawn = moving.map(|moving| Drawn {
        slices: HollowSlices::new(contours),
        hollows: Hollows::new(run, links, contours, moving),
        slides: Slides::new(run, links, contours, moving),
    });
    let fair = |take: &mut Sink<'_>| fair(drawn, fairing, make, take);
    let hold = |take: &mut Sink<'_>| {
        let mut looked_at = |layers| look(layers).into_iter().try_for_each(&mut *take);
        let hold = &mut |layer| together.push(layer, &mut looked_at);
        if alone { fair(hold) } else { beside(run, fair, hold) }?;
        together.finish(&mut looked_at)
    };
    let take = &mut |layer| sink.layer(layer);
    if alone { hold(take) } else { beside(run, hold, take) }
}

/// Does `make` on a thread beside the calling one, on which its layers reach `take`.
fn beside(run: &Context<'_>, make: impl Make, take: &mut Sink<'_>) -> Result<()> {
    // Whoever comes first has it: without a second thread the calling one makes the layers, too.
    let make = Mutex::new(Some(make));
    let begin = || make.lock().unwrap_or_else(PoisonError::into_inner).take();
    thread::scope(|scope| {
        let (hand_over, layers) = sync_channel(AHEAD);
        let maker = move || {
            let Some(make) = begin() else { return Ok(()) };
            // Whoever takes no more layers has failed.
            run.clocks.beside(|| make(&mut |layer| hand_over.send(layer).map_err(|_| Error::Interrupted)))
        };
        let Ok(maker) = thread::Builder::new().name("layers".into()).spawn_scoped(scope, maker) else {
            return begin().map_or(Ok(()), |make| make(take));
        };
        let taken = layers.into_iter().try_for_each(take);
        if taken.is_err() {
            run.halting.halt();
        }
        let made = maker.join().unwrap_or_else(|panic| resume_unwind(panic));
        taken.and(made)
    })
}

/// What is drawn into layers that come in order of height.
struct Drawn<'r, 'b> {
    slices: HollowSlices<'r, 'b>,
    hollows: Hollows<'r, 'b>,
    slides: Slides<'r, 'b>,
}

impl Drawn<'_, '_> {
    fn draw(&mut self, layer: &mut Layer) -> Result<()> {
        if let Some(i) = layer.contour {
            self.slices.forget_below(i);
        }
        self.hollows.draw(layer, &mut self.slices)?;
        self.slides.draw(layer, &mut self.slices)
    }
}

/// Makes layers and hands them on, with what is hollow and what slides, faired if that is wanted.
fn fair(
    mut drawn: Option<Drawn<'_, '_>>,
    fairing: Option<Fairing<'_>>,
    make: impl Make,
    take: &mut Sink<'_>,
) -> Result<()> {
    let mut with_drawn = |mut layer: Layer| {
        if let Some(drawn) = &mut drawn {
            drawn.draw(&mut layer)?;
        }
        Ok(layer)
    };
    let Some(mut fairing) = fairing else { return make(&mut |layer| take(with_drawn(layer)?)) };
    make(&mut |layer| fairing.push(with_drawn(layer)?, take))?;
    fairing.finish(take)
}

/// Fairing of a run that wants it.
fn fairing<'m>(
    run: &Context<'_>,
    links: &[IntervalLinks],
    contours: &SpillVec<'_, Contour>,
    moving: Option<&'m MotionStack<'m>>,
) -> Result<Option<Fairing<'m>>> {
    if run.settings.fair == 0.0 {
        return Ok(None);
    }
    let nodes_at_once = if run.budget.is_bounded() {
        1
    } else if run.stack.dims[0] * run.stack.dims[1] < SMALL {
        GAPS_AT_ONCE * NODES
    } else {
        LARGE_AT_ONCE
    };
    Ok(Some(Fairing::new(FairingSpec {
        moving: moving.map(|moving| (moving, run.pad)),
        contours: run.stack.slices.iter().map(|s| s.z).collect(),
        drawn: run.stack.slices.iter().map(|s| !s.content.is_empty()).collect(),
        dims: run.stack.dims,
        spacing: run.stack.spacing,
        layers: run.span.layers.clone(),
        gap: run.span.gap,
        alpha: run.settings.fair,
        rugged: run.span.change.rugged,
        limited: !run.settings.slope.overshoots(),
        farthest: run.settings.margin() as f64 * run.px,
        steered: run.settings.steered_ends(),
        shares: fairing_shares(run, links, contours)?,
        nodes_at_once,
    })))
}
