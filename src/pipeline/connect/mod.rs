//! Topology between slices and beyond the ends, made right after all other stages: overlaps stay connected, nothing floats. Layers wait here for the others
//! of their interval, and are handed on together.

mod interval;

use std::mem::{replace, take};
use std::panic::resume_unwind;
use std::thread;

use rayon::prelude::*;

use crate::connectivity::cores::{Cores, OutputImage};
use crate::contour::Contour;
use crate::error::Result;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::pipeline::context::{Bonds, Context};
use crate::pipeline::links::IntervalLinks;
use crate::report::clock::Clocks;
use crate::stack::heights::NODE_TIMES;
use crate::storage::spill::SpillVec;
use crate::surface::Layer;
use interval::{IntervalLayer, Repair};

/// Difference in time by which a layer may miss a node and still stand for it.
const SAME_TIME: f64 = 2e-6;

/// Taker of layers that follow each other.
pub(crate) type SinkOfSome<'a> = dyn FnMut(Vec<Layer>) -> Result<()> + 'a;

/// What ends a layer at the image's border.
pub(crate) type Ends<'r> = &'r (dyn Fn(&mut SparseImage<f32>) + Sync);

/// Does both, `other` on a thread beside this one, if there is another: one of the pool that waits for others would take it over, and be late by it.
fn meanwhile<A, B: Send>(clocks: &Clocks, own: impl FnOnce() -> A, other: impl FnOnce() -> B + Send) -> (A, Option<B>) {
    thread::scope(|scope| {
        let beside = thread::Builder::new().name("cores".into());
        let beside = beside.spawn_scoped(scope, || clocks.beside(other));
        let own = own();
        (own, beside.ok().map(|beside| beside.join().unwrap_or_else(|panic| resume_unwind(panic))))
    })
}

/// Takes layers in order of height and hands them on, interval by interval. Needs those at [`NODE_TIMES`].
pub(crate) struct Together<'r, 'b> {
    contours: &'r SpillVec<'b, Contour>,
    parted: Vec<Vec<(u32, u32)>>,
    /// Of every interval, whether a user keeps parts of it apart.
    guarded: Vec<bool>,
    shown: OutputImage,
    repair: Repair,
    end: Ends<'r>,
    /// Clocks of threads that may run beside this one, if any may.
    beside: Option<Clocks>,
    px: f64,
    bonds: Bonds,
    /// Layers that wait, from a contour on.
    waiting: Vec<IntervalLayer>,
    cores: Option<Cores>,
}

pub(crate) fn together<'a, 'r>(
    run: &Context<'a>,
    links: &[IntervalLinks],
    contours: &'r SpillVec<'a, Contour>,
    end: Ends<'r>,
    beside: Option<Clocks>,
) -> Together<'r, 'a> {
    let seen = run.window.beyond.then(|| run.window.rectangle(run.image));
    let limit = run.settings.margin() as f64;
    let shown = OutputImage { dims: run.stack.dims, pad: run.pad, h: run.h, limit, seen };
    let parted = links.iter().map(IntervalLinks::parted).collect();
    let guarded = links.iter().map(|links| !links.told_apart().is_empty()).collect();
    let image = run.window.part(Tile::all(run.image));
    let repair = Repair { dims: shown.dims, image, far: (limit * run.px) as f32 };
    Together {
        contours,
        parted,
        guarded,
        shown,
        repair,
        end,
        beside,
        px: run.px,
        bonds: run.bonds,
        waiting: Vec::new(),
        cores: None,
    }
}

impl Together<'_, '_> {
    /// Takes the next layer.
    pub fn push(&mut self, layer: Layer, sink: &mut SinkOfSome<'_>) -> Result<()> {
        let last = self.contours.len() - 1;
        if let Some(i) = layer.contour {
            self.waiting.push(IntervalLayer::new(layer, true));
            let (waiting, cores) = (take(&mut self.waiting), self.cores.take());
            let next = |this: &Self| if i < last { this.cores(i) } else { Ok(None) };
            let (mut layers, made) = match &self.beside {
                Some(clocks) if i < last && self.bonds.cores => {
                    meanwhile(clocks, || self.finished(waiting, cores), || next(self))
                }
                _ => (self.finished(waiting, cores), None),
            };
            self.waiting.extend(layers.pop());
            self.hand_on(layers, sink)?;
            self.cores = made.unwrap_or_else(|| next(self))?;
            return Ok(());
        }
        let Some(low) = self.waiting.first().and_then(|w| w.layer.contour).filter(|low| *low < last) else {
            // Beyond the ends nothing hangs together over a layer that is empty: no more waits than the body is high.
            let is_empty = layer.phi.values().all(|v| v >= 0.0);
            self.waiting.push(IntervalLayer::new(layer, false));
            return if is_empty { self.hand_on_all(sink) } else { Ok(()) };
        };
        let [low, high] = [low, low + 1].map(|k| self.contours.light(k).z);
        let t = (layer.z - low) / (high - low);
        let node = NODE_TIMES.iter().any(|node| (t - node).abs() <= SAME_TIME);
        self.waiting.push(IntervalLayer::new(layer, node));
        Ok(())
    }

    /// Hands on everything that is left.
    pub fn finish(mut self, sink: &mut SinkOfSome<'_>) -> Result<()> {
        self.hand_on_all(sink)
    }

    fn hand_on_all(&mut self, sink: &mut SinkOfSome<'_>) -> Result<()> {
        let (waiting, cores) = (take(&mut self.waiting), self.cores.take());
        self.hand_on(self.finished(waiting, cores), sink)
    }

    /// Hands layers on: together, but one by one where nothing runs beside this thread and memory may be short.
    fn hand_on(&self, layers: Vec<IntervalLayer>, sink: &mut SinkOfSome<'_>) -> Result<()> {
        let mut layers = layers.into_iter().map(|w| w.layer);
        if self.beside.is_none() {
            return layers.try_for_each(|layer| sink(vec![layer]));
        }
        if layers.len() == 0 { Ok(()) } else { sink(layers.collect()) }
    }

    /// All layers of an interval, from contour to contour, or of an end, with its contour: ended at the image's border, with the cores of the interval
    /// inside those between its contours, and with nothing that floats.
    fn finished(&self, mut layers: Vec<IntervalLayer>, cores: Option<Cores>) -> Vec<IntervalLayer> {
        layers.par_iter_mut().for_each(|w| {
            if !replace(&mut w.ended, true) {
                (self.end)(&mut w.layer.phi);
            }
            if let Some(cores) = cores.as_ref().filter(|_| w.layer.contour.is_none()) {
                cores.keep(&mut w.layer, self.px);
                w.layer.phi.shrink_to_fit();
            }
        });
        if self.bonds.grounded {
            // A way might join what links keep apart.
            let low = layers.first().and_then(|w| w.layer.contour);
            let joins = low.and_then(|i| self.guarded.get(i)) != Some(&true);
            self.repair.repair_all(&mut layers, joins);
        }
        layers
    }

    fn cores(&self, i: usize) -> Result<Option<Cores>> {
        let parted = self.parted.get(i).map_or(&[][..], |parted| parted);
        let somewhere = Cores::tile(self.contours.light(i), self.contours.light(i + 1), &self.shown).is_some();
        if !(somewhere && self.bonds.cores) {
            return Ok(None);
        }
        let read =
            |k: usize| if parted.is_empty() { self.contours.some(k, Contour::FIELD) } else { self.contours.get(k) };
        Ok(Cores::new(&*read(i)?, &*read(i + 1)?, parted, &self.shown))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;
    use crate::storage::spill::Budget;

    const N: usize = 9;

    /// A layer that is inside at these pixels of row 1.
    fn layer(z: f64, inside: &[usize]) -> Layer {
        let value = |n: usize| if n / N == 1 && inside.contains(&(n % N)) { -0.5 } else { 0.5 };
        let phi = SparseImage::of([N; 2], &(0..N * N).map(value).collect::<Vec<_>>());
        Layer { z, phi, output: true, contour: [0.0, 8.0].iter().position(|contour| *contour == z) }
    }

    /// Taker of the layers between two contours, of which a user keeps these parts apart.
    fn taking<'r, 'b>(contours: &'r SpillVec<'b, Contour>, parted: Vec<(u32, u32)>) -> Together<'r, 'b> {
        Together {
            contours,
            guarded: vec![!parted.is_empty()],
            parted: vec![parted],
            shown: OutputImage { dims: [N; 2], pad: [0; 2], h: [1.0; 2], limit: 9.0, seen: None },
            repair: Repair { dims: [N; 2], image: [0..N, 0..N], far: 9.0 },
            end: &|_| (),
            beside: None,
            px: 1.0,
            bonds: Bonds { cores: false, grounded: true },
            waiting: Vec::new(),
            cores: None,
        }
    }

    #[test]
    fn nothing_floats_beyond_the_ends() {
        let budget = Budget::unlimited();
        let mut contours = SpillVec::new(&budget);
        let field = |i: usize, j: usize| libm::hypot(i as f64 - 1.0, j as f64 - 1.0) - 0.6;
        for z in [0.0, 8.0] {
            contours.push(Contour::new(z, Field::from_fn([N; 2], field), [1.0; 2], 1.0)).expect("it stays in memory");
        }
        // A stair that hangs on each contour and a pixel in the air, below and above.
        let stairs: [(f64, &[usize]); 14] = [
            (-5.0, &[]),
            (-4.0, &[]),
            (-3.0, &[3]),
            (-2.0, &[2, 3]),
            (-1.0, &[1, 2, 5]),
            (0.0, &[1]),
            (2.0, &[1]),
            (4.0, &[1]),
            (6.0, &[1]),
            (8.0, &[1]),
            (9.0, &[1, 2, 6]),
            (10.0, &[2, 4]),
            (11.0, &[]),
            (12.0, &[]),
        ];
        let mut together = taking(&contours, Vec::new());
        let mut out: Vec<(f64, Vec<usize>)> = Vec::new();
        let mut sink = |layers: Vec<Layer>| {
            let inside = |l: &Layer| (l.z, (0..N).filter(|&i| l.phi.at(i, 1) < 0.0).collect());
            out.extend(layers.iter().map(inside));
            Ok(())
        };
        for (z, inside) in stairs {
            together.push(layer(z, inside), &mut sink).expect("nothing fails");
            let is_empty = inside.is_empty();
            assert!(!is_empty || together.waiting.is_empty(), "what lies beyond an empty layer at {z} need not wait");
        }
        together.finish(&mut sink).expect("nothing fails");
        let wanted = stairs.map(|(z, inside)| (z, inside.iter().copied().filter(|i| *i < 4).collect::<Vec<_>>()));
        assert_eq!(out, wanted);
    }

    /// A block of 15 pixels in the middle layer, two columns beside a line that goes through all.
    #[test]
    fn a_large_piece_is_joined_but_where_links_keep_parts_apart() {
        let budget = Budget::unlimited();
        let mut contours = SpillVec::new(&budget);
        let field = |i: usize, j: usize| libm::hypot(i as f64 - 1.0, j as f64 - 4.0) - 0.6;
        for z in [0.0, 8.0] {
            contours.push(Contour::new(z, Field::from_fn([N; 2], field), [1.0; 2], 1.0)).expect("it stays in memory");
        }
        let block = |i: usize, j: usize| (4..7).contains(&i) && (2..7).contains(&j);
        let middle = |parted: Vec<(u32, u32)>| {
            let mut together = taking(&contours, parted);
            let mut inside = Vec::new();
            let mut sink = |layers: Vec<Layer>| {
                if let Some(layer) = layers.iter().find(|layer| layer.z == 4.0) {
                    inside = (0..N * N).filter(|n| layer.phi.at(n % N, n / N) < 0.0).collect();
                }
                Ok(())
            };
            for z in [0.0, 2.0, 4.0, 6.0, 8.0] {
                let is_in = |n: usize| [n % N, n / N] == [1, 4] || z == 4.0 && block(n % N, n / N);
                let phi: Vec<f32> = (0..N * N).map(|n| if is_in(n) { -0.5 } else { 0.5 }).collect();
                let layer = Layer { phi: SparseImage::of([N; 2], &phi), ..layer(z, &[]) };
                together.push(layer, &mut sink).expect("nothing fails");
            }
            together.finish(&mut sink).expect("nothing fails");
            inside
        };
        let apart: Vec<usize> = (0..N * N).filter(|n| *n == 4 * N + 1 || block(n % N, n / N)).collect();
        assert_eq!(middle(vec![(1, 2)]), apart);
        let joined = middle(Vec::new());
        assert!(joined.len() == apart.len() + 2 && [2, 3].iter().all(|i| joined.contains(&(4 * N + i))), "{joined:?}");
    }
}
