//! Slices of the groups that the layers of morphed intervals are composed of, on the device.

use super::Gpu;
use super::answers::{Landed, Wanted};
use super::atlas::{Atlas, padded};
use super::buffer::Buffer;
use super::compose::SweptPairs;
use super::distance::{DistanceBuffers, Rounds, settled_by};
use super::layout::BLOCK;
use super::recorder::Recorder;
use crate::backend::blend::is_broken;
use crate::backend::jobs::Filled;
use crate::error::Result;

/// Slices of the groups that layers are composed of.
pub enum Origin<'s> {
    /// Fronts on the device.
    Device(&'s SweptPairs<'s>),
    /// Slices on the host, pair by pair.
    Host(&'s [Filled]),
}

/// Slices that have been mended, each a pair and the number of its time, with their values.
#[derive(Clone, Copy)]
pub struct Mended<'s> {
    /// The slices.
    pub wanted: &'s [(usize, usize)],
    /// Their tiles.
    pub atlas: &'s Atlas,
    /// Their values, as the tiles lie.
    pub values: &'s [f32],
}

/// Slices of the groups on the device.
pub struct Slices {
    /// Each a pair and the number of its time.
    pub wanted: Vec<(usize, usize)>,
    atlas: Atlas,
    /// Their values, as the tiles lie.
    pub values: Buffer<[f32]>,
    /// The answer to whether their distances still change; none of slices that the host has.
    changes: Option<Wanted<u32>>,
}

impl Slices {
    /// Records these slices: blended, mended where that is known to be needed, continued outwards. The device begins with it at once.
    pub fn new<'g>(
        gpu: &'g Gpu,
        origin: &Origin<'_>,
        wanted: Vec<(usize, usize)>,
        (mended, rounds): (Option<Mended<'_>>, Rounds),
    ) -> Result<(Recorder<'g>, Slices)> {
        let swept = match origin {
            Origin::Device(swept) if !wanted.is_empty() => swept,
            Origin::Device(_) => return Slices::sent(gpu, wanted, &[]),
            Origin::Host(filled) => return Slices::sent(gpu, wanted, filled),
        };
        let atlas = swept.atlas(&wanted);
        let (mut recorder, blended) = swept.blend(gpu, &wanted, &atlas)?;
        if let Some(mended) = mended {
            let values = gpu.device.upload("mended", mended.values)?;
            for (slice, from) in mended.wanted.iter().zip(&mended.atlas.jobs) {
                let Some(slot) = wanted.iter().position(|other| other == slice) else { continue };
                let bytes = 4 * u64::from(from.block_count) * BLOCK as u64;
                let to = atlas.jobs[slot].offset;
                recorder.copy_part((&values, 4 * u64::from(from.offset)), (&blended, 4 * u64::from(to)), bytes);
            }
        }
        let tiles = DistanceBuffers::new(gpu, atlas, swept.params, blended)?;
        tiles.solve(recorder, true, rounds)?.submit()?;
        let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
        let changes = Some(tiles.ask(&mut recorder));
        let DistanceBuffers { atlas, d: values, .. } = tiles;
        Ok((recorder, Slices { wanted, atlas, values, changes }))
    }

    /// Slices that the host has.
    fn sent<'g>(gpu: &'g Gpu, wanted: Vec<(usize, usize)>, filled: &[Filled]) -> Result<(Recorder<'g>, Slices)> {
        let slice = |&(p, k): &(usize, usize)| &filled[p].slices[k];
        let atlas = Atlas::new(wanted.iter().map(|of| slice(of).dims()));
        let mut values = Vec::with_capacity(atlas.node_count());
        for own in wanted.iter().map(slice) {
            values.extend(own.unpack());
            values.resize(padded(values.len()), 0.0);
        }
        let values = gpu.device.upload("slices", &values)?;
        Ok((Recorder::new(&gpu.device, &gpu.profiler), Slices { wanted, atlas, values, changes: None }))
    }

    /// Place of a slice's first value.
    pub fn first(&self, slot: usize) -> u32 {
        self.atlas.jobs[slot].offset
    }

    /// Whether their distances have settled.
    pub fn settled(&self, landed: &Landed<'_>) -> Result<bool> {
        self.changes.as_ref().map_or(Ok(true), |changes| settled_by(landed, changes))
    }

    /// Slices that have lost an overlap, by the values at their anchors.
    pub fn lost(&self, swept: &SweptPairs<'_>, values: &[f32]) -> Vec<(usize, usize)> {
        let mut next = 0;
        let mut out = Vec::new();
        for &(p, k) in &self.wanted {
            let pair = swept.pairs[p];
            let own = &values[next..next + pair.anchors.len()];
            next += own.len();
            let value = |pixel: usize| pair.anchors.iter().position(|anchor| *anchor == pixel).map(|n| own[n]);
            if is_broken(pair, |pixel| value(pixel).is_some_and(|v| v >= 0.0)) {
                out.push((p, k));
            }
        }
        out
    }
}
