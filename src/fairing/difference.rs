//! The difference of a node, `K v - v - P`, at stretches of its rows.

use super::along::read;
use super::near::fade;
use super::plane::Plane;
use crate::grid::sparse_image::SparseImage;
use crate::registration::displacement::Displacement;

/// v of a node, read along the trajectories, and its weight.
pub struct Term<'f> {
    /// Its v.
    pub v: &'f SparseImage<f32>,
    /// Weight.
    pub w: f32,
    /// Of the trajectories from the node whose difference it is.
    pub offsets: Option<&'f Displacement>,
}

/// v of the node below or above.
pub enum Beside<'f> {
    /// That of the node itself, where there is no other.
    Own,
    /// That of a term of the mean: it is read once for both.
    Term(usize),
    /// That of a node which the mean does not read.
    Other(Term<'f>),
}

/// The difference of a node.
pub struct Difference<'f> {
    /// Terms of the mean K v.
    pub terms: Vec<Term<'f>>,
    /// What it moves planes by, by the nodes below and above.
    pub plane: Option<(Plane, [Beside<'f>; 2])>,
    /// At a contour the B by which it fades out.
    pub fades: Option<f32>,
}

/// Lines that are used again and again.
#[derive(Default)]
pub struct Scratch {
    some: Vec<f32>,
    beside: [Vec<f32>; 2],
}

impl Difference<'_> {
    /// The differences at pixels of row `j` from `first` on, whose v are `own`.
    pub fn read(&self, own: &[f32], at: [usize; 2], scratch: &mut Scratch, out: &mut [f32]) {
        let Scratch { some, beside } = scratch;
        [&mut *some].into_iter().chain(&mut *beside).for_each(|line| line.resize(own.len(), 0.0));
        out.iter_mut().zip(own).for_each(|(sum, own)| *sum = -own);
        let sides = self.plane.as_ref().map(|(_, sides)| sides);
        for (t, Term { v, w, offsets }) in self.terms.iter().enumerate() {
            read(v, *offsets, at, some);
            out.iter_mut().zip(&*some).for_each(|(sum, v)| *sum += w * v);
            for (_, line) in sides.into_iter().flatten().zip(&mut *beside).filter(|(side, _)| side.is(t)) {
                line.copy_from_slice(some);
            }
        }
        if let Some((plane, sides)) = &self.plane {
            for (side, line) in sides.iter().zip(&mut *beside) {
                match side {
                    Beside::Own => line.copy_from_slice(own),
                    Beside::Term(_) => {}
                    Beside::Other(Term { v, offsets, .. }) => read(v, *offsets, at, line),
                }
            }
            plane.take_off(own, [&beside[0], &beside[1]], out);
        }
        if let Some(bound) = self.fades {
            out.iter_mut().zip(own).for_each(|(sum, own)| *sum *= fade(own.abs() / bound) as f32);
        }
    }
}

impl Beside<'_> {
    /// Whether it is term `t` of the mean.
    fn is(&self, t: usize) -> bool {
        matches!(self, Beside::Term(own) if *own == t)
    }
}
