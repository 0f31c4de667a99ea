//! Layers of intervals composed of their groups' slices, and brought to their places.

use std::ops::Range;

use rayon::prelude::*;

use crate::backend::interval_morph::{FrameSource, IntervalMorph, MorphFrame, Morphed, together};
use crate::backend::jobs::Filled;
use crate::backend::requests::{LayerRequest, MorphRequest};
use crate::contour::canvas::Canvas;
use crate::contour::direction::Direction;
use crate::error::Result;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::registration::cells::Cells;
use crate::registration::warp::{Warp, Way};
use crate::stack::heights::BESIDE;

/// Largest difference of a time from that of the layer beside a contour.
const ROUNDING: f64 = 1e-6;

/// Change of distance from a contour to the layer beside, px, above which the two do not belong to one surface: one that moves by less than 50 px from
/// contour to contour changes by less.
pub const GONE: f32 = 0.05;

/// Answers the field method's questions.
pub type Others<'o> = dyn Fn(&[LayerRequest<'_>]) -> Result<Vec<Vec<SparseImage<f32>>>> + 'o;

/// Layers of all intervals from the slices of their pairs, which come one interval after the other.
///
/// # Errors
/// The errors of `others`.
pub fn layers(request: &MorphRequest<'_>, filled: Vec<Filled>, others: &Others<'_>) -> Result<Vec<Morphed>> {
    let mut filled = filled.into_iter();
    let mut out = Vec::with_capacity(request.intervals.len());
    for some in together(request.intervals.iter().map(|of| of.times.len()), request.at_once) {
        let intervals = &request.intervals[some];
        let read = |of: &IntervalMorph<'_>| of.frame.as_ref().map(FrameSource::read).transpose();
        let frames: Vec<Option<MorphFrame>> = intervals.par_iter().map(read).collect::<Result<_>>()?;
        let mut next = |of: &IntervalMorph<'_>| filled.by_ref().take(of.pairs.len()).collect();
        let pieces = intervals.iter().zip(frames).map(|(of, frame)| Piece { of, frame, filled: next(of) }).collect();
        composed(request, pieces, others, &mut out)?;
    }
    Ok(out)
}

/// An interval and the slices of its pairs.
struct Piece<'p, 'a> {
    of: &'p IntervalMorph<'a>,
    frame: Option<MorphFrame>,
    filled: Vec<Filled>,
}

/// Means that bring some layers of an interval from its frame to their places.
struct InFrame<'w> {
    warp: &'w Warp<'w>,
    frame: &'w MorphFrame,
    ways: Vec<Way>,
    /// Cells in which the field method's layers, `others`, count.
    doubts: Vec<Cells>,
    others: Vec<SparseImage<f32>>,
}

/// The layers of some intervals: those of an interval alone some at a time, those of several all at once.
fn composed(
    request: &MorphRequest<'_>,
    pieces: Vec<Piece<'_, '_>>,
    others: &Others<'_>,
    out: &mut Vec<Morphed>,
) -> Result<()> {
    let warps: Vec<Option<Warp<'_>>> = pieces.par_iter().map(Piece::warp).collect();
    let most = pieces.iter().map(|piece| piece.of.times.len()).max().unwrap_or(0);
    let at_once = if pieces.len() > 1 { most.max(1) } else { request.at_once.max(1) };
    let mut made: Vec<Vec<SparseImage<f32>>> = pieces.iter().map(|p| Vec::with_capacity(p.of.times.len())).collect();
    for first in (0..most).step_by(at_once) {
        let some = |piece: &Piece<'_, '_>| {
            let count = piece.of.times.len();
            first.min(count)..(first + at_once).min(count)
        };
        let frames = frames(request, &pieces, &warps, some, others)?;
        for ((piece, frame), made) in pieces.iter().zip(frames).zip(&mut made) {
            let layer = |seen: &mut Vec<f32>, k: usize| piece.layer(k, frame.as_ref(), k - first, seen);
            let layers: Vec<SparseImage<f32>> = some(piece).into_par_iter().map_init(Vec::new, layer).collect();
            made.extend(layers);
        }
    }
    let swept = |filled: Vec<Filled>| filled.into_iter().map(|f| [f.up, f.down]).collect();
    let of = |(layers, piece): (_, Piece<'_, '_>)| Morphed { layers, swept: swept(piece.filled) };
    out.extend(made.into_iter().zip(pieces).map(of));
    Ok(())
}

/// What brings some layers of each interval to their places, with the field method's layers, which are asked for together.
fn frames<'f>(
    request: &MorphRequest<'_>,
    pieces: &'f [Piece<'_, '_>],
    warps: &'f [Option<Warp<'f>>],
    some: impl Fn(&Piece<'_, '_>) -> Range<usize>,
    others: &Others<'_>,
) -> Result<Vec<Option<InFrame<'f>>>> {
    let mut placed = Vec::with_capacity(pieces.len());
    for (piece, warp) in pieces.iter().zip(warps) {
        let (Some(frame), Some(warp)) = (&piece.frame, warp) else {
            placed.push(None);
            continue;
        };
        let ways: Vec<Way> = piece.of.times[some(piece)].par_iter().map(|t| warp.way(*t)).collect();
        let padded = piece.of.image.padded();
        let doubts: Vec<Cells> = ways.par_iter().map(|way| way.doubts(padded, &frame.trust)).collect();
        placed.push(Some(InFrame { warp, frame, ways, doubts, others: Vec::new() }));
    }
    let mut requests = Vec::new();
    for (piece, placed) in pieces.iter().zip(&placed) {
        let Some(InFrame { frame: MorphFrame { moving, slopes, lone, .. }, doubts, .. }) = placed else { continue };
        let (times, limit, wanted) = (&piece.of.times[some(piece)], piece.of.image.limit, Some(doubts.as_slice()));
        let slopes = slopes.each_ref();
        requests.push(LayerRequest { moving, interval: 0, slopes, lone, times, limit, h: request.h, wanted });
    }
    let given = if requests.is_empty() { Vec::new() } else { others(&requests)? };
    drop(requests);
    for (frame, others) in placed.iter_mut().flatten().zip(given) {
        frame.others = others;
    }
    Ok(placed)
}

impl Piece<'_, '_> {
    /// Warp from the mid frame to the layers.
    fn warp(&self) -> Option<Warp<'_>> {
        let MorphFrame { moving, empty, .. } = self.frame.as_ref()?;
        let begun = [Direction::Up, Direction::Down].map(|from| self.begun(from));
        // The frame's own field of a slice that is not empty is the slice's.
        let own = |side: usize| (!empty[side]).then(|| &*moving.fields[side]);
        let slices = [0, 1].map(|side| (own(side), begun[side].as_slice()));
        Some(Warp::new(moving, 0, slices, self.of.image.limit))
    }

    /// An empty layer in the frame.
    fn canvas(&self) -> Canvas {
        Canvas::empty(self.of.image.padded(), [0; 2], self.of.image.limit)
    }

    /// Body between the contours at the one from which `from` goes, in the mid frame: its end, but for what is gone in the layer beside. A crumb that the
    /// frame does not show is a valley in it, and the distances of layers are those to their own surface.
    fn begun(&self, from: Direction) -> Vec<f32> {
        let [mut begun, mut next] = [0, 1].map(|_| self.canvas());
        let beside = beside(&self.of.times, from);
        for ((tile, pair), filled) in self.of.pairs.iter().zip(&self.filled) {
            let end = if from == Direction::Up { &pair.up.source } else { &pair.down.source };
            let without = pair.without_holes(end, from);
            begun.unite(tile, |n| without.data[n]);
            if let Some(k) = beside {
                next.unite_packed(tile, &filled.slices[k]);
            }
        }
        for (cap, _) in self.of.solids.iter().filter(|(_, way)| *way == from) {
            begun.unite_cap(cap, 0.0);
            next.unite_cap(cap, BESIDE);
        }
        let mut begun = begun.phi.unpack();
        if beside.is_some() {
            let gone = begun.iter_mut().zip(next.phi.unpack()).filter(|(v, next)| (**v - next).abs() > GONE);
            gone.for_each(|(v, next)| *v = next);
        }
        begun
    }

    /// The layer at the `k`-th time: in the frame, whose `n`-th layer it is, or straight on the image. `seen` is memory for its values in the frame.
    fn layer(&self, k: usize, frame: Option<&InFrame<'_>>, n: usize, seen: &mut Vec<f32>) -> SparseImage<f32> {
        let IntervalMorph { image, times, pairs, solids, .. } = self.of;
        let on_image = Canvas::empty(image.dims, image.pad, image.limit);
        let mut canvas = if frame.is_some() { self.canvas() } else { on_image.clone() };
        for ((tile, _), filled) in pairs.iter().zip(&self.filled) {
            canvas.unite_packed(tile, &filled.slices[k]);
        }
        for (cap, direction) in solids.iter() {
            canvas.unite_cap(cap, direction.away(times[k]));
        }
        let Some(InFrame { warp, frame, ways, doubts, others }) = frame else { return canvas.phi };
        canvas.phi.unpack_to(seen);
        let whole = warp.layer(seen, &ways[n], &frame.trust, &doubts[n], &others[n]);
        let mut canvas = on_image;
        canvas.unite_packed(&Tile::all(image.padded()), &whole);
        canvas.phi
    }
}

/// Number of the layer beside the contour that `from` comes from.
pub fn beside(times: &[f64], from: Direction) -> Option<usize> {
    times.iter().position(|t| (from.away(*t) - BESIDE).abs() <= ROUNDING)
}
