//! Repairs of an interval's layers, all taken together: what floats in them changes sides, or is joined to what does not.

use std::ops::Range;

use rayon::prelude::*;

use crate::connectivity::bridges::join;
use crate::connectivity::grounded::{CRUMB, grounded, held_by, turn, whole, without_crumbs};
use crate::connectivity::runs::{Runs, Side};
use crate::grid::sparse_image::SparseImage;
use crate::surface::Layer;

/// A layer that waits for the others of its interval.
pub(super) struct IntervalLayer {
    pub layer: Layer,
    /// Whether it is a contour or lies at one of [`NODE_TIMES`](crate::stack::heights::NODE_TIMES).
    pub node: bool,
    /// Whether it ends at the image's border already.
    pub ended: bool,
}

impl IntervalLayer {
    pub fn new(layer: Layer, node: bool) -> Self {
        IntervalLayer { layer, node, ended: false }
    }
}

/// Repair of layers of an image.
pub(super) struct Repair {
    /// Pixels of a layer.
    pub dims: [usize; 2],
    /// Columns and rows of it that the image has.
    pub image: [Range<usize>; 2],
    /// Distance, mm, where nothing is near.
    pub far: f32,
}

impl Repair {
    /// Repairs an interval, or an end as one that goes on to nothing. Parts are joined by ways if it `joins` them.
    pub fn repair_all(&self, layers: &mut Vec<IntervalLayer>, joins: bool) {
        let [below, above] = [layers.first(), layers.last()].map(|w| w.is_some_and(|w| w.layer.contour.is_none()));
        let nothing = || {
            let phi = SparseImage::filled(self.dims, self.far);
            IntervalLayer::new(Layer { z: f64::NAN, phi, output: false, contour: None }, true)
        };
        if below {
            layers.insert(0, nothing());
        }
        if above {
            layers.push(nothing());
        }
        if layers.len() > 2 {
            self.repair(layers, joins);
        }
        if below {
            layers.remove(0);
        }
        if above {
            layers.pop();
        }
    }

    /// Puts what floats on the other side, or joins it to what does not.
    fn repair(&self, layers: &mut [IntervalLayer], joins: bool) {
        let all: Vec<[Runs; 2]> = layers.par_iter().map(|w| Runs::both(&w.layer.phi)).collect();
        let (mut inside, mut outside): (Vec<Runs>, Vec<Runs>) =
            all.into_iter().map(|[inside, outside]| (inside, outside)).unzip();
        let ends = [&layers[0], &layers[layers.len() - 1]].map(|w| w.layer.contour.is_none());
        let is_interval = ends == [false; 2];
        let mut changed = vec![false; layers.len()];
        if is_interval {
            self.repair_by_nodes(layers, &inside, joins, &mut changed);
            renew(layers, &changed, [&mut inside, &mut outside]);
        }
        let stays = without_crumbs(&inside, self.dims[0]);
        let mut changed = turn_all(layers, &inside, &stays);
        if joins && grounded(&inside, Some(&stays), self.dims[0], Side::Inside) != stays {
            let mut phi: Vec<&mut SparseImage<f32>> = layers.iter_mut().map(|w| &mut w.layer.phi).collect();
            join(&mut phi, &inside, &stays, &self.image, None);
            changed.fill(true);
        }
        renew(layers, &changed, [&mut inside, &mut outside]);
        let stays = self.voids_that_stay(layers, &outside, is_interval);
        turn_all(layers, &outside, &stays);
    }

    /// Repairs the nodes of an interval, and every other layer by the two nodes around it: none depends on which others are made. Says which have `changed`.
    fn repair_by_nodes(&self, layers: &mut [IntervalLayer], inside: &[Runs], joins: bool, changed: &mut [bool]) {
        let nx = self.dims[0];
        let places: Vec<usize> = (0..layers.len()).filter(|&k| layers[k].node).collect();
        let mut nodes: Vec<Runs> = places.iter().map(|&k| inside[k].clone()).collect();
        let held = grounded(&nodes, None, nx, Side::Inside);
        let stays = or_whole(held.clone(), &nodes);
        let mut phi: Vec<&mut SparseImage<f32>> =
            layers.iter_mut().filter(|w| w.node).map(|w| &mut w.layer.phi).collect();
        for ((phi, runs), stays) in phi.iter_mut().zip(&nodes).zip(&stays) {
            turn(phi, runs, stays);
        }
        if joins && held != stays {
            join(&mut phi, &nodes, &stays, &self.image, Some(CRUMB));
        }
        if held.iter().flatten().any(|held| !held) {
            nodes = phi.iter().map(|phi| Runs::new(phi, Side::Inside)).collect();
            places.iter().for_each(|&k| changed[k] = true);
        }
        let repair = |(k, (w, changed)): (usize, (&mut IntervalLayer, &mut bool))| {
            let above = places.partition_point(|place| *place < k);
            if places[above] == k {
                return;
            }
            let around = [above - 1, above].map(|n| &nodes[n]);
            let all = around.map(|runs| vec![true; runs.count]);
            let held = held_by(&inside[k], [0, 1].map(|n| (around[n], all[n].as_slice())), nx, Side::Inside);
            if held.iter().all(|held| *held) {
                return;
            }
            *changed = true;
            let stays: Vec<bool> = held.iter().zip(whole(&inside[k])).map(|(held, whole)| *held || whole).collect();
            turn(&mut w.layer.phi, &inside[k], &stays);
            if joins && held != stays {
                // Of the nodes the runs alone are read.
                let [mut below, mut above] = [(); 2].map(|()| SparseImage::filled(self.dims, 0.0));
                let [first, last] = all;
                let runs = [around[0].clone(), inside[k].clone(), around[1].clone()];
                let mut layers = [&mut below, &mut w.layer.phi, &mut above];
                join(&mut layers, &runs, &[first, stays, last], &self.image, Some(CRUMB));
            }
        };
        layers.par_iter_mut().zip(changed).enumerate().for_each(repair);
    }

    /// Parts of what is outside that open to a contour or to what is around, or are more than crumbs.
    fn voids_that_stay(&self, layers: &[IntervalLayer], outside: &[Runs], is_interval: bool) -> Vec<Vec<bool>> {
        let nx = self.dims[0];
        let by_nodes = || -> Vec<Vec<bool>> {
            let places: Vec<usize> = (0..outside.len()).filter(|&k| layers[k].node).collect();
            let nodes: Vec<Runs> = places.iter().map(|&k| outside[k].clone()).collect();
            let stays = or_whole(grounded(&nodes, None, nx, Side::Outside), &nodes);
            let of = |(k, runs): (usize, &Runs)| {
                let above = places.partition_point(|place| *place < k);
                if places[above] == k {
                    return stays[above].clone();
                }
                held_by(runs, [above - 1, above].map(|n| (&nodes[n], stays[n].as_slice())), nx, Side::Outside)
            };
            outside.par_iter().enumerate().map(of).collect()
        };
        // An end has no nodes.
        let there = is_interval.then(by_nodes);
        or_whole(grounded(outside, there.as_deref(), nx, Side::Outside), outside)
    }
}

/// Parts that are chosen or more than crumbs.
fn or_whole(chosen: Vec<Vec<bool>>, all: &[Runs]) -> Vec<Vec<bool>> {
    let of = |(chosen, runs): (Vec<bool>, &Runs)| chosen.into_iter().zip(whole(runs)).map(|(c, w)| c || w).collect();
    chosen.into_iter().zip(all).map(of).collect()
}

/// Turns the parts that do not stay; which layers that changes.
fn turn_all(layers: &mut [IntervalLayer], all: &[Runs], stays: &[Vec<bool>]) -> Vec<bool> {
    let turned =
        |((w, runs), stays): ((&mut IntervalLayer, &Runs), &Vec<bool>)| turn(&mut w.layer.phi, runs, stays) > 0;
    layers.par_iter_mut().zip(all).zip(stays).map(turned).collect()
}

/// Finds the parts of layers that have `changed` anew.
fn renew(layers: &[IntervalLayer], changed: &[bool], [inside, outside]: [&mut [Runs]; 2]) {
    let both = layers.par_iter().zip(changed).zip(inside).zip(outside);
    both.filter(|(((_, changed), _), _)| **changed)
        .for_each(|(((w, _), inside), outside)| [*inside, *outside] = Runs::both(&w.layer.phi));
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 9;

    /// The layer at `z` of an interval from 0 to 8, of which these pixels are inside.
    fn layer(z: f64, dims: [usize; 2], is_in: impl Fn(usize, usize) -> bool) -> IntervalLayer {
        let value = |n: usize| if is_in(n % dims[0], n / dims[0]) { -0.5 } else { 0.5 };
        let phi = SparseImage::of(dims, &(0..dims[0] * dims[1]).map(value).collect::<Vec<_>>());
        let contour = [0.0, 8.0].iter().position(|contour| *contour == z);
        IntervalLayer::new(Layer { z, phi, output: true, contour }, z % 2.0 == 0.0)
    }

    fn repaired(dims: [usize; 2], mut layers: Vec<IntervalLayer>) -> Vec<IntervalLayer> {
        layers.sort_by(|a, b| a.layer.z.total_cmp(&b.layer.z));
        Repair { dims, image: dims.map(|n| 0..n), far: 9.0 }.repair_all(&mut layers, true);
        layers
    }

    #[test]
    fn what_floats_by_the_nodes_goes_whatever_other_layers_come() {
        let inside_at = |others: &[(f64, &[usize])]| -> Vec<(f64, Vec<usize>)> {
            let nodes: [(f64, &[usize]); 5] = [(0.0, &[1]), (2.0, &[1]), (4.0, &[1, 3]), (6.0, &[1]), (8.0, &[1])];
            let of = |(z, inside): &(f64, &[usize])| layer(*z, [N; 2], |i, j| j == 1 && inside.contains(&i));
            let layers = repaired([N; 2], nodes.iter().chain(others).map(of).collect());
            let inside = |w: &IntervalLayer| (0..N).filter(|&i| w.layer.phi.at(i, 1) < 0.0).collect();
            layers.iter().map(|w| (w.layer.z, inside(w))).collect()
        };
        let alone = inside_at(&[]);
        assert_eq!(alone, [0.0, 2.0, 4.0, 6.0, 8.0].map(|z| (z, vec![1])));
        // A layer on which the piece at 4 hangs together with the rest does not save it.
        let with = inside_at(&[(5.0, &[1, 2, 3])]);
        assert_eq!(with[3], (5.0, vec![1, 2, 3]));
        assert!(with.into_iter().filter(|layer| layer.0 != 5.0).eq(alone));
    }

    /// A block that a node shows two columns beside what hangs on the lower contour, and other layers nowhere near it.
    #[test]
    fn a_piece_that_the_nodes_join_stays_whatever_other_layers_come() {
        let dims = [40, N];
        let columns = |z: f64| match z {
            0.0 | 2.0 => vec![1, 20, 21, 22],
            4.0 => vec![1, 24, 25],
            _ => vec![1],
        };
        let block = |heights: &[f64]| {
            let of = |&z: &f64| layer(z, dims, |i, j| columns(z).contains(&i) && j > 0 && j < N - 1);
            let layers = repaired(dims, heights.iter().map(of).collect());
            let middle = layers.into_iter().find(|w| w.layer.z == 4.0);
            let phi = middle.expect("the layer is among them").layer.phi;
            (0..N).filter(|j| phi.at(24, *j) < 0.0 && phi.at(25, *j) < 0.0).count()
        };
        assert_eq!(block(&[0.0, 2.0, 4.0, 6.0, 8.0]), N - 2);
        assert_eq!(block(&[0.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]), N - 2);
    }
}
