//! Parts of neighbouring slices that overlap are connected between them.

use interslice::Reconstruction;
use interslice::stack::ContourStack;
use interslice::surface::Layer;

use super::{Case, Checked, Property, any, made, within};
use crate::random::measure::{Overlap, overlaps, pieces, px};
use crate::random::settings::fine_heights;
use crate::random::source::Source;

/// Layers in every interval: neighbours that follow a drift of some px per gap touch.
pub const PARTS: usize = 16;

pub const PROPERTY: Property = Property {
    name: "overlaps_connected",
    draw: any,
    check,
    damage: Some(|stack, _, _, body| {
        let far = px(stack) as f32;
        body.layers.iter_mut().filter(|l| l.contour.is_none()).step_by(PARTS - 1).for_each(|l| l.phi.map(|_| far));
    }),
};

fn check(case: &Case, source: &dyn Source) -> Checked {
    let (stack, settings) = (&case.stack, &case.settings);
    let pairs: usize = (0..stack.slices.len() - 1).map(|i| overlaps(stack, i).len()).sum();
    if pairs == 0 {
        return Ok(None);
    }
    let body = made(source.layers(stack, &fine_heights(stack, settings, PARTS), settings))?;
    let mut torn = torn(stack, &body);
    let kept_apart = |(i, o): &(usize, Overlap)| {
        settings.links.iter().any(|l| !l.join && l.slice == *i && [l.from, l.to] == o.parts)
    };
    torn.retain(|pair| !kept_apart(pair));
    let most = torn.iter().map(|(_, o)| o.shared).max().unwrap_or(0);
    within(torn.len() as f64, 0.0, || {
        let parts: Vec<String> = torn.iter().map(|(i, o)| format!("{:?} above slice {i}", o.parts)).collect();
        format!("{} of {pairs} pairs are torn, with up to {most} px in common: {}", torn.len(), parts.join(", "))
    })
}

/// Overlapping pairs that are not connected through faces within their interval, with the lower slice's number.
pub fn torn(stack: &ContourStack, body: &Reconstruction) -> Vec<(usize, Overlap)> {
    let mut out = Vec::new();
    for i in 0..stack.slices.len() - 1 {
        let [low, high] = [i, i + 1].map(|k| stack.slices[k].z);
        let layers: Vec<&Layer> = body.layers.iter().filter(|l| l.z >= low && l.z <= high).collect();
        let (labels, _) = pieces(&layers, stack.dims, false);
        let top = (layers.len() - 1) * stack.dims[0] * stack.dims[1];
        let is_torn = |o: &Overlap| labels[o.pixel] == 0 || labels[o.pixel] != labels[top + o.pixel];
        out.extend(overlaps(stack, i).into_iter().filter(is_torn).map(|o| (i, o)));
    }
    out
}
