//! Context of a run, which every stage reads and none changes.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Mutex;
use std::time::Instant;

use rayon::prelude::*;

use super::span::Span;
use crate::backend::Backend;
use crate::contour::Contour;
use crate::contour::canvas::Canvas;
use crate::error::Result;
use crate::grid::seen::Seen;
use crate::grid::sparse_image::SparseImage;
use crate::progress::{Halting, Progress};
use crate::registration::motion_field;
use crate::registration::motion_field::STEPS;
use crate::report::clock::{Clocks, CpuSeconds};
use crate::report::{DeviceUse, Report, StageCost, StageReport};
use crate::settings::Settings;
use crate::stack::ContourStack;
use crate::stack::heights::{Height, Heights};
use crate::stack::window::Window;
use crate::storage::spill::{Budget, Large, SpillVec};
use crate::surface::Layer;
use crate::surface::header::Header;

/// Bytes of the layers that are made together on a GPU: those of several intervals, so that it is asked rarely.
pub const LAYER_BYTES_ON_A_GPU: usize = 64 << 20;
/// And on the reference path, which can be asked as often as one likes.
const LAYER_BYTES: usize = 16 << 20;

/// Takes finished layers, lowest first.
pub type Sink<'a> = dyn FnMut(Layer) -> Result<()> + 'a;

/// Rules that hold a body together; without one of them it can be seen what it is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bonds {
    /// Overlaps keep their core at every height.
    pub cores: bool,
    /// Pieces that float are taken out, and voids that open to no contour are filled.
    pub grounded: bool,
}

impl Bonds {
    /// Everything.
    pub const ALL: Bonds = Bonds { cores: true, grounded: true };
}

/// A run's input and means.
pub(super) struct Context<'a> {
    /// Stack of the section, through the window.
    pub stack: &'a ContourStack,
    /// Pixels of the image.
    pub image: [usize; 2],
    /// The window on it.
    pub window: Window,
    /// Pixels that count where areas are measured.
    pub seen: Seen,
    /// Those in which contours are known: of a map those within its border.
    pub known: Seen,
    pub settings: &'a Settings,
    pub backend: &'a dyn Backend,
    pub progress: &'a dyn Progress,
    /// Ends the run, which `progress` then tells all that compute.
    pub halting: &'a Halting<'a>,
    pub budget: &'a Budget,
    /// Part of the stack that is made here.
    pub span: Span,
    /// Pixel size in units of its larger side.
    pub h: [f64; 2],
    /// Length of a pixel's larger side in the stack's unit.
    pub px: f64,
    /// Padding of the image, pixels along either axis.
    pub pad: [usize; 2],
    /// Margin of tiles, the same.
    pub margin: [usize; 2],
    /// Rules that hold the body together.
    pub bonds: Bonds,
    /// Clocks of the threads that compute.
    pub clocks: Clocks,
    /// Intervals in which a part ends, numbered as in the whole stack: how far from its contour depends on the rate of change of the whole.
    pub closing: Mutex<BTreeSet<usize>>,
}

impl<'a> Context<'a> {
    /// Pixels of the padded image.
    pub fn padded(&self) -> [usize; 2] {
        std::array::from_fn(|a| self.stack.dims[a] + 2 * self.pad[a])
    }

    /// Bytes of a field on it.
    pub fn field_bytes(&self) -> usize {
        size_of::<f64>() * self.padded().iter().product::<usize>()
    }

    /// Facts known before the first layer.
    pub fn header(&self, heights: &Heights, extent: [f64; 2]) -> Header {
        let ContourStack { spacing, unit, geometry, .. } = self.stack;
        let grid = Header::grid(&heights.output(), *spacing);
        Header { dims: self.image, spacing: *spacing, unit: unit.clone(), geometry: *geometry, extent, grid }
    }

    /// Number of layers that are made together, whatever the number of threads.
    pub fn layers_at_once(&self) -> usize {
        // Of a layer its values in the mid frame, the other method's, and itself.
        let bytes = 2 * self.field_bytes();
        let most = if self.backend.device_use().is_some() { LAYER_BYTES_ON_A_GPU } else { LAYER_BYTES };
        self.budget.at_once((most / bytes.max(1)).max(1), bytes)
    }

    /// All heights of the run.
    pub fn heights(&self, output: &[f64], extent: [f64; 2]) -> Result<Heights> {
        if self.span.ends == [true; 2] {
            return Heights::new(self.stack, output, extent);
        }
        let z: Vec<f64> = self.stack.slices.iter().map(|s| s.z).collect();
        Ok(Heights::merged(&z, output, extent, self.stack.spacing[0].min(self.stack.spacing[1])))
    }

    /// Results of `make`: side by side where memory is not bounded, else one after the other.
    pub fn of_all<T: Send>(
        &self,
        some: Range<usize>,
        make: impl Fn(usize) -> Result<T> + Send + Sync,
    ) -> Result<Vec<T>> {
        match self.budget.is_bounded() {
            true => some.map(make).collect(),
            false => some.into_par_iter().map(make).collect(),
        }
    }

    /// Results of `make` for the two contours of every interval.
    pub fn of_pairs<T: Send>(
        &self,
        contours: &SpillVec<'_, Contour>,
        make: impl Fn(usize, [&Contour; 2]) -> T + Sync,
    ) -> Result<Vec<T>> {
        let mut out = Vec::with_capacity(contours.len() - 1);
        self.for_pairs(contours, make, |made| {
            out.push(made);
            Ok(())
        })?;
        Ok(out)
    }

    /// Results of `make` for every interval, taken one by one in order.
    pub fn for_pairs<T: Send>(
        &self,
        contours: &SpillVec<'_, Contour>,
        make: impl Fn(usize, [&Contour; 2]) -> T + Sync,
        mut take: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let count = contours.len() - 1;
        let at_once = self.budget.at_once(count, 4 * self.field_bytes());
        for first in (0..count).step_by(at_once) {
            let end = (first + at_once).min(count);
            let some = (first..=end).map(|i| contours.get(i)).collect::<Result<Vec<_>>>()?;
            let pair = |i: usize| make(first + i, [&*some[i], &*some[i + 1]]);
            let made: Vec<T> = (0..end - first).into_par_iter().map(pair).collect();
            made.into_iter().try_for_each(&mut take)?;
        }
        Ok(())
    }

    pub fn canvas(&self) -> Canvas {
        Canvas::empty(self.stack.dims, self.pad, self.settings.margin() as f64)
    }

    pub fn contour_layer(&self, height: &Height, contour: &Contour, i: usize) -> Layer {
        let limit = self.settings.margin() as f64;
        let layer = self.layer(height, Canvas::of_contour(self.stack.dims, self.pad, limit, &contour.phi).phi);
        Layer { contour: Some(i), ..layer }
    }

    /// A layer of these distances, px, in physical units.
    pub fn layer(&self, height: &Height, mut phi: SparseImage<f32>) -> Layer {
        let px = self.px as f32;
        phi.map(|v| if v * px == 0.0 { f32::MIN_POSITIVE } else { v * px });
        phi.shrink_to_fit();
        Layer { z: height.z, phi, output: height.output, contour: None }
    }

    /// Things that may leave memory.
    pub fn spilled<T: Large>(&self, things: impl IntoIterator<Item = T>) -> Result<SpillVec<'a, T>> {
        let mut spilled = SpillVec::new(self.budget);
        things.into_iter().try_for_each(|thing| spilled.push(thing))?;
        Ok(spilled)
    }
}

/// Height between two contours as time of their interval, never quite 0 or 1: a stack and the same upside down then sweep with the very same
/// times, whichever way their heights were rounded.
pub fn time(z: f64, low: f64, high: f64) -> f64 {
    motion_field::time(z, low, high).clamp(1.0 / STEPS, 1.0 - 1.0 / STEPS)
}

/// What a run has spent on the host and on a device so far.
pub struct Spent {
    host: Option<CpuSeconds>,
    device: DeviceUse,
}

impl Spent {
    /// Spent so far; nothing where there is no device.
    pub fn now(clocks: &Clocks, backend: &dyn Backend) -> Option<Self> {
        Some(Spent { device: backend.device_use()?, host: clocks.read() })
    }

    /// The cost since then. What the calling thread does in the driver is not the host's: a software driver computes there.
    pub fn cost(&self, name: &'static str, clocks: &Clocks, backend: &dyn Backend) -> Option<StageCost> {
        let now = Spent::now(clocks, backend)?;
        let device = now.device.since(&self.device);
        let host = now.host.zip(self.host).map(|(now, then)| [now.all - then.all, now.own - then.own]);
        let host = host.map(|both| both.map(|seconds| (seconds - device.driver_seconds).max(0.0)));
        Some(StageCost {
            name: name.into(),
            host_seconds: host.map(|[all, _]| all),
            serial_seconds: host.map(|[_, own]| own),
            device,
        })
    }
}

/// Runs one stage, telling listeners and taking its time.
pub fn stage<T>(
    run: &Context<'_>,
    report: &mut Report,
    name: &'static str,
    total: usize,
    work: impl FnOnce(&mut Report) -> Result<T>,
) -> Result<T> {
    run.progress.begin(name, total);
    let (start, before) = (Instant::now(), Spent::now(&run.clocks, run.backend));
    let result = work(report);
    if let Some(cost) = before.and_then(|before| before.cost(name, &run.clocks, run.backend)) {
        report.profile.get_or_insert_default().stages.push(cost);
    }
    report.stages.push(StageReport { name: name.into(), seconds: start.elapsed().as_secs_f64() });
    run.progress.end();
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_the_same_upside_down_and_never_quite_a_contours() {
        for (low, high) in [(0.0, 1.0), (-3.0, 4.1), (100.3, 100.7)] {
            for share in [0.0, 1e-9, 0.1, 0.37, 0.5, 0.9, 1.0] {
                let z = low + share * (high - low);
                let t = time(z, low, high);
                assert!(t > 0.0 && t < 1.0 && (t - share).abs() < 1e-6, "{z} from {low} to {high}: {t}");
                assert_eq!(t, 1.0 - time(-z, -high, -low));
            }
        }
    }
}
