//! Layers of a morphed interval on the GPU: from the slices of its groups to packed layers, without a way over the host.

use std::ops::Range;

use super::Gpu;
use super::answers::Wanted;
use super::buffer::Buffer;
use super::compose::SweptPairs;
use super::kernels::{WORKGROUP, shader};
use super::layer_steps::{FIELDS, GROUNDS};
use super::layout::{BLOCK, Body, Image, Morph, Part, Span};
use super::morph_bodies::Bodies;
use super::morph_slices::{Origin, Slices};
use super::moving::{image, per_pixel, tile_count, vectors};
use super::moving_layer::{lone_tiles, span};
use super::packed_layers::{Packed, square_count};
use super::recorder::{Recorder, Size};
use super::trajectories::{paths, trajectories};
use crate::backend::interval_morph::{IntervalMorph, MorphFrame};
use crate::contour::direction::Direction;
use crate::error::Result;
use crate::grid::sparse_image::AREA;
use crate::reference::morph_layer as twin;
use crate::stack::heights::BESIDE;

shader! {
    morph_layer = "common/job.wgsl" + "common/moving.wgsl" + "common/sample.wgsl" + "common/spline.wgsl"
        + "common/layer_value.wgsl" + twin "src/reference/morph_layer.rs";

    /// Bodies united.
    Unite for unite, "morph_unite" {
        image: Uniform Image,
        bodies: Read [Body],
        slices: Read [f32],
        shapes: Read [f32],
        contours: Read [f32],
        nearest: Write [u32],
        morph: Uniform Morph,
    }

    /// Ways to the mid frame.
    FindMiddle for find_middle, "morph_middle" {
        image: Uniform Image,
        vectors: Read [[f32; 2]],
        morph: Uniform Morph,
        to_middle: Write [[f32; 2]],
    }

    /// What the way to the mid frame and back loses of the slices.
    Lose for lose, "morph_lose" {
        image: Uniform Image,
        seen: Read [u32],
        morph: Uniform Morph,
        middle: Read [[f32; 2]],
        fields_mut: Write [f32],
    }

    /// Tiles that are beyond the limit.
    FindSides for find_sides, "morph_sides" {
        image: Uniform Image,
        span: Uniform Span,
        fields: Read [f32],
        vectors: Read [[f32; 2]],
        times: Read [f32],
        parts: Read [Part],
        seen: Read [u32],
        morph: Uniform Morph,
        middle: Read [[f32; 2]],
        sides: Write [f32],
    }

    /// Layers, tile by tile.
    Warp for warp, "morph_warp" {
        image: Uniform Image,
        span: Uniform Span,
        fields: Read [f32],
        vectors: Read [[f32; 2]],
        times: Read [f32],
        parts: Read [Part],
        seen: Read [u32],
        morph: Uniform Morph,
        middle: Read [[f32; 2]],
        sides: Write [f32],
        layers: Write [u32],
    }

    /// Squares of the layers on the image.
    Pack for pack, "morph_pack" {
        image: Uniform Image,
        morph: Uniform Morph,
        dense: Read [u32],
        used: Write [u32],
        squares: Write [[u32; 2]],
        packed: Write [f32],
    }

    /// Values of slices at some places.
    Take for take, "morph_take" {
        slices: Read [f32],
        morph: Uniform Morph,
        places: Read [u32],
        taken: Write [f32],
    }
}

/// Layers beside the lower and the upper contour.
pub fn beside(of: &IntervalMorph<'_>) -> [Option<usize>; 2] {
    [Direction::Up, Direction::Down].map(|from| twin::beside(&of.times, from))
}

/// An interval whose layers are being composed.
pub struct Composing<'p, 'a> {
    /// The interval.
    pub of: &'p IntervalMorph<'a>,
    /// Number of its first pair.
    pub first_pair: usize,
    /// Pixel sides, px.
    pub h: [f64; 2],
    /// Squares of a layer that are guessed to have values.
    pub squares: f64,
    /// What its layers share, from the first step on.
    pub ground: Option<Ground>,
}

/// What the layers of an interval in its frame share.
pub struct Ground {
    /// Nodes of the frame's displacements.
    grid: [usize; 2],
    empty: [bool; 2],
    fields: Buffer<[f32]>,
    parts: Buffer<[Part]>,
    span: Buffer<Span>,
    trajectories: Buffer<[[f32; 2]]>,
    /// Ways off the slices, and the particles.
    behind: Buffer<[[f32; 2]]>,
}

impl Composing<'_, '_> {
    /// Numbers of its pairs.
    pub fn pairs(&self) -> Range<usize> {
        self.first_pair..self.first_pair + self.of.pairs.len()
    }

    /// Records some layers of the interval, whose slices begin with number `slot`; what its layers share where that was not there.
    pub fn record(
        &self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        origin: &Origin<'_>,
        layers: &[usize],
        (slices, slot): (&Slices, usize),
        begun: Option<Begun>,
    ) -> Result<(Packed, Option<Ground>)> {
        let (device, of) = (&gpu.device, self.of);
        let (padded, count) = (of.image.padded(), layers.len());
        let nodes: usize = padded.iter().product();
        let known = self.ground.as_ref().map(|ground| (ground.grid, ground.empty));
        let frame = begun.as_ref().map(|begun| (begun.grid(), begun.frame.empty)).or(known);
        let (grid, empty) = frame.unwrap_or(([0; 2], [true; 2]));
        let begins = begun.is_some();
        let bodies = self.bodies(origin, layers, (slices, slot), begins);
        let images = count + if begins { GROUNDS } else { 0 };
        let beside = beside(of);
        let [low_own, high_own] = empty.map(|empty| u32::from(!empty));
        let [low_beside, high_beside] = beside.map(|k| u32::from(k.is_some()));
        let morph = Morph {
            limit: of.image.limit as f32,
            pad_x: of.image.pad[0] as u32,
            pad_y: of.image.pad[1] as u32,
            nx: of.image.dims[0] as u32,
            ny: of.image.dims[1] as u32,
            layers: count as u32,
            bodies: bodies.bodies.len() as u32,
            groups: bodies.groups as u32,
            halvings: usize::BITS - bodies.bodies.len().leading_zeros(),
            low_own,
            high_own,
            low_beside,
            high_beside,
            places: 0,
        };
        let morph = &device.uniform("morph", morph);
        let image = &device.uniform("image", image(padded, grid, self.h, count));
        let united = &device.storage("united", images * nodes)?;
        recorder.clear(united);
        if !bodies.bodies.is_empty() {
            let shapes = &device.upload("shapes", &bodies.shapes)?;
            let contours = match origin {
                Origin::Device(swept) => swept.copies.end(0).0.unwrap_or(shapes),
                Origin::Host(_) => shapes,
            };
            let listed = &device.upload("bodies", &bodies.bodies)?;
            let (slices, nearest) = (&slices.values, united);
            let unite = Unite { image, bodies: listed, slices, shapes, contours, nearest, morph };
            recorder.run(&unite.bind(gpu), Size::List(bodies.groups * BLOCK));
        }
        let ground = begun.map(|begun| Ground::new(gpu, recorder, begun, of.image.limit, self.h)).transpose()?;
        let warped = match self.ground.as_ref().or(ground.as_ref()) {
            None => None,
            Some(ground) => Some(self.warped(gpu, recorder, ground, layers, (united, morph, image), begins)?),
        };
        let dense = warped.as_ref().unwrap_or(united);
        let tasks = count * square_count(of.image);
        let (used, squares) = (&device.zeroed("used", 1)?, &device.storage("squares", tasks)?);
        let values = device.storage("packed", tasks * AREA)?;
        if count > 0 {
            let pack = Pack { image, morph, dense, used, squares, packed: &values };
            recorder.run(&pack.bind(gpu), Size::List(tasks * WORKGROUP as usize));
        }
        let guess = gpu.device.made.guess.map_or(self.squares, |squares| squares as f64);
        let guess = (count as f64 * guess) as usize;
        Ok((Packed::new(recorder, (of.image, count), (used, squares), values, guess), ground))
    }

    /// Records that the layers united in the frame are brought to their places; where the interval begins also what the way there loses of its slices.
    fn warped(
        &self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        &Ground { grid, ref fields, ref parts, ref span, ref trajectories, ref behind, .. }: &Ground,
        layers: &[usize],
        (seen, morph, image): (&Buffer<[u32]>, &Buffer<Morph>, &Buffer<Image>),
        begins: bool,
    ) -> Result<Buffer<[u32]>> {
        let (device, of, count) = (&gpu.device, self.of, layers.len());
        let padded = of.image.padded();
        let nodes: usize = padded.iter().product();
        let blocks: usize = grid.iter().product();
        // The ways from the layers, then those from the slices.
        let times: Vec<f64> = layers.iter().map(|k| of.times[*k]).chain([0.0, 1.0]).collect();
        let vectors = &paths(gpu, recorder, trajectories, (grid, padded), &times, self.h, Some(behind))?;
        let middle = &device.storage("middle", times.len() * blocks)?;
        let find_middle = FindMiddle { image, vectors, morph, to_middle: middle };
        recorder.run(&find_middle.bind(gpu), Size::List(times.len() * blocks));
        if begins {
            let lose = Lose { image, seen, morph, middle, fields_mut: fields };
            recorder.run(&lose.bind(gpu), Size::List(2 * nodes));
        }
        let table: Vec<f32> = times.iter().map(|t| *t as f32).collect();
        let times = &device.upload("times", &table)?;
        let tiles = count * tile_count(padded);
        let (sides, layers) = (&device.storage("sides", tiles)?, device.storage("layers", count * nodes)?);
        if count > 0 {
            let find_sides = FindSides { image, span, fields, vectors, times, parts, seen, morph, middle, sides };
            recorder.run(&find_sides.bind(gpu), Size::List(tiles));
            let layers = &layers;
            let warp = Warp { image, span, fields, vectors, times, parts, seen, morph, middle, sides, layers };
            recorder.run(&warp.bind(gpu), per_pixel(padded, count));
        }
        Ok(layers)
    }

    /// The bodies of some layers, and where the interval begins those of its ground behind them.
    fn bodies(&self, origin: &Origin<'_>, layers: &[usize], (slices, slot): (&Slices, usize), begins: bool) -> Bodies {
        let (of, count) = (self.of, layers.len());
        let mut bodies = Bodies::default();
        for (n, k) in layers.iter().enumerate() {
            bodies.add_slices(of, n, slices, slot + n * of.pairs.len());
            for (cap, from) in of.solids.iter() {
                bodies.add_cap(cap, from.away(of.times[*k]), n);
            }
        }
        if begins {
            let beside = beside(of);
            for (end, from) in [Direction::Up, Direction::Down].into_iter().enumerate() {
                let contour = count + 2 * end;
                bodies.add_contour(of, self.first_pair, origin, from, contour);
                if let Some(n) = beside[end].and_then(|k| layers.iter().position(|other| *other == k)) {
                    bodies.add_slices(of, contour + 1, slices, slot + n * of.pairs.len());
                }
                for (cap, _) in of.solids.iter().filter(|(_, way)| *way == from) {
                    bodies.add_cap(cap, 0.0, contour);
                    bodies.add_cap(cap, BESIDE, contour + 1);
                }
            }
        }
        bodies
    }
}

/// A frame, and what follows from it on the host.
pub struct Begun {
    frame: MorphFrame,
    /// Ways off the slices, and the particles.
    behind: Vec<[f32; 2]>,
}

impl Begun {
    /// What follows from a frame.
    pub fn new(frame: MorphFrame) -> Self {
        let MorphFrame { moving, trust, .. } = &frame;
        let off = moving.off_slices(0, 0.5, &moving.paths(0, 0.5));
        let behind = vectors(off.iter().chain([trust.particles()]));
        Begun { frame, behind }
    }

    fn grid(&self) -> [usize; 2] {
        self.frame.moving.displacements[0].grid
    }
}

impl Ground {
    /// The ground of an interval in its frame, but for what the way there loses.
    fn new(
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        Begun { frame, behind }: Begun,
        limit: f64,
        h: [f64; 2],
    ) -> Result<Self> {
        let device = &gpu.device;
        let MorphFrame { moving, slopes, lone, .. } = &frame;
        let nodes = moving.fields[0].data.len();
        let (lone_values, parts) = lone_tiles(lone, FIELDS * nodes);
        let span = device.uniform("span", span(moving, lone, limit, h));
        let fields = device.storage("fields", FIELDS * nodes + lone_values.len())?;
        device.write_from(&fields, FIELDS * nodes, &lone_values);
        let gap = moving.gap(0);
        let [low, high] = slopes.each_ref().map(|slopes| (slopes, gap, moving.px));
        let images = [(&moving.fields[0], 1.0, 1.0), (&moving.fields[1], 1.0, 1.0), low, high];
        for (k, image) in images.into_iter().enumerate() {
            gpu.place(recorder, image, (&fields, k * nodes))?;
        }
        let parts = device.upload("parts", &parts)?;
        let (trajectories, behind) = (trajectories(gpu, moving, 0)?, device.upload("behind", &behind)?);
        Ok(Ground { grid: moving.displacements[0].grid, empty: frame.empty, fields, parts, span, trajectories, behind })
    }
}

/// Records that the values at the anchors of all slices are read.
pub fn read_anchors(
    gpu: &Gpu,
    recorder: &mut Recorder<'_>,
    swept: &SweptPairs<'_>,
    slices: &Slices,
) -> Result<Option<Wanted<f32>>> {
    let device = &gpu.device;
    let of = |(slot, &(p, _)): (usize, &(usize, usize))| {
        let first = slices.first(slot);
        swept.pairs[p].anchors.iter().map(move |anchor| first + *anchor as u32)
    };
    let places: Vec<u32> = slices.wanted.iter().enumerate().flat_map(of).collect();
    if places.is_empty() {
        return Ok(None);
    }
    let count = places.len();
    let morph = &device.uniform("morph", Morph { places: count as u32, ..Morph::default() });
    let (places, taken) = (&device.upload("places", &places)?, &device.storage("taken", count)?);
    recorder.run(&Take { slices: &slices.values, morph, places, taken }.bind(gpu), Size::List(count));
    Ok(Some(recorder.read(taken, 0, count)))
}
