//! A surface with fewer triangles, no farther from the given one than an error: meshoptimizer's edge collapses by quadric error (Garland and
//! Heckbert, 1997), whose own estimate is no bound, so that the distance is measured both ways, and closedness checked, before it counts.
//!
//! ```text
//! surface -> blocks -> collapses, measured, block by block -> surface -> other blocks -> ...
//! ```
//!
//! A vertex that remains comes to where the planes of what it took in are nearest. The whole mesh is in memory.

mod block;
mod collapse;
mod cut;
mod distances;
mod measure;
mod sound;
mod surface;

use std::io;
use std::sync::{Arc, Mutex};

use super::mesh::{Mesh, MeshSource};
use crate::progress::Stop;
use crate::storage::room;
pub use distances::TriangleTree;
use sound::torn;
use surface::Surface;

/// Places at which blocks are cut in two, from pass to pass, so that what was a border comes to lie within a block.
const SHARES: [f64; 4] = [0.5, 0.37, 0.58, 0.43];
/// Samples per block in the first pass.
const SAMPLES: usize = 24_000;
/// Part of the triangles that a pass must at least leave out for another one to follow.
const GAIN: f64 = 0.02;

/// A volume that differs by more of the full one's is told: volumes are promised to 1 % in the mean (docs/evaluation.md, spheres).
const TOLD: f64 = 0.01;

/// Bytes per triangle of the whole mesh, and per triangle of the blocks that are worked on at once.
const PER_TRIANGLE: u64 = 142;
const PER_BLOCK_TRIANGLE: u64 = 370;

/// Bytes of memory that making a mesh of so many triangles simpler takes at most, on so many threads.
pub fn bytes(triangles: u64, threads: usize) -> u64 {
    let largest = (SAMPLES << (SHARES.len() - 1)) as u64;
    triangles * PER_TRIANGLE + triangles.min(threads as u64 * largest) * PER_BLOCK_TRIANGLE
}

/// Makes the simpler surface once, for all the formats that write it.
#[derive(Debug)]
pub struct Simplifier {
    error: f64,
    stop: Stop,
    made: Mutex<Option<Made>>,
}

/// A simpler surface, or why there is none.
type Made = Result<Simplified, String>;

/// A simpler surface.
#[derive(Debug, Clone)]
pub struct Simplified {
    /// The surface.
    pub mesh: Arc<Mesh>,
    /// By how much its volume differs from that of the given one, of that one's.
    pub gain: f64,
}

impl Simplified {
    /// A sentence where its volume is another.
    pub fn warning(&self) -> Option<String> {
        let (count, percent) = (self.mesh.triangles.len(), 100.0 * self.gain.abs());
        let way = if self.gain < 0.0 { "less" } else { "more" };
        let told = || format!("simplify: {count} triangles enclose {percent:.1} % {way} volume than the full mesh");
        (self.gain.abs() > TOLD).then(told)
    }
}

impl Simplifier {
    /// A simplifier for surfaces within `error` of the given one, stack's unit, that ends where `stop` is asked for.
    pub fn new(error: f64, stop: Stop) -> Self {
        Simplifier { error, stop, made: Mutex::new(None) }
    }

    /// The simpler surface of `mesh`, which is the same in every call, or why there is none.
    ///
    /// # Errors
    /// The errors of reading the mesh; [`io::ErrorKind::Interrupted`].
    pub fn simpler(&self, mesh: &mut dyn MeshSource) -> io::Result<Made> {
        let mut made = self.made.lock().map_err(|_| io::Error::other("another output has failed"))?;
        if let Some(made) = made.as_ref() {
            return Ok(made.clone());
        }
        let simpler = self.make(mesh)?.map_err(|why| format!("simplify: {why}; meshes are the full one"));
        *made = Some(simpler.clone());
        Ok(simpler)
    }

    fn make(&self, mesh: &mut dyn MeshSource) -> io::Result<Made> {
        let [vertices, triangles] = mesh.counts();
        if triangles == 0 {
            return Ok(Ok(Simplified { mesh: Arc::new(Mesh::default()), gain: 0.0 }));
        }
        if u32::try_from(vertices + triangles).is_err() {
            return Ok(Err("at most 2^32 vertices and triangles can be simplified".into()));
        }
        if let Err(why) = room::check_room(bytes(triangles, rayon::current_num_threads()) as f64) {
            return Ok(Err(format!("{triangles} triangles {why}")));
        }
        let whole = collected(mesh)?;
        let simpler = simplified_until(&whole, self.error, &self.stop);
        if self.stop.is_asked() {
            return Err(io::ErrorKind::Interrupted.into());
        }
        let told = |mesh: Mesh| Simplified { gain: mesh.volume() / whole.volume() - 1.0, mesh: Arc::new(mesh) };
        Ok(simpler.map(told).ok_or_else(|| "no closed surface with fewer triangles was found".into()))
    }
}

fn collected(mesh: &mut dyn MeshSource) -> io::Result<Mesh> {
    let [vertices, triangles] = mesh.counts();
    let mut whole = Mesh::default();
    whole.positions.reserve_exact(vertices as usize);
    whole.triangles.reserve_exact(triangles as usize);
    mesh.vertices(&mut |v| {
        whole.positions.push(v.position);
        Ok(())
    })?;
    mesh.triangles(&mut |t, _| {
        whole.triangles.push(t.map(|v| v as u32));
        Ok(())
    })?;
    Ok(whole)
}

/// A closed surface with fewer triangles, of the same Euler number, whose distance from `mesh` is at most `error`, both ways, as far as
/// samples tell: vertices and middles of triangles of `mesh`, and grids on its triangles and on the new ones, half an error wide or a sixth
/// of the sides of triangles of `mesh`, must be within 0.85 of the error. Nothing where none was found, or `mesh` is not closed.
/// The same on any number of threads.
pub fn simplified(mesh: &Mesh, error: f64) -> Option<Mesh> {
    simplified_until(mesh, error, &Stop::default())
}

/// The same; once `stop` is asked for, what it finds does not count.
fn simplified_until(mesh: &Mesh, error: f64, stop: &Stop) -> Option<Mesh> {
    if !torn(&mesh.triangles).is_empty() {
        return None;
    }
    let mut surface = Surface::new(mesh);
    for (pass, share) in SHARES.into_iter().enumerate() {
        let before = surface.now.len();
        surface = surface.pass(error, SAMPLES << pass, share, stop);
        if surface.now.len() as f64 > (1.0 - GAIN) * before as f64 {
            break;
        }
    }
    let is_simpler = surface.now.len() < mesh.triangles.len();
    (is_simpler && torn(&surface.now).is_empty()).then(|| compact(&surface))
}

/// Only the vertices that are used, in their order.
fn compact(surface: &Surface<'_>) -> Mesh {
    let mut used = vec![false; surface.positions.len()];
    surface.now.as_flattened().iter().for_each(|&v| used[v as usize] = true);
    let mut numbers = vec![0; used.len()];
    let mut positions = Vec::new();
    for (v, _) in used.iter().enumerate().filter(|(_, used)| **used) {
        numbers[v] = positions.len() as u32;
        positions.push(surface.positions[v]);
    }
    Mesh { positions, triangles: surface.now.iter().map(|t| t.map(|v| numbers[v as usize])).collect() }
}
