//! No cliffs far from contours: where two contours are D px away together, the height at which a pixel changes its side changes by no more than a few D-ths
//! of the gap from pixel to pixel. Straight lines between distances, of which `h = a / (a + b)`, change by 1 / D at most.

use interslice::Settings;
use interslice::grid::sparse_image::SparseImage;
use interslice::reference::exact::exact_distance;
use interslice::settings::{EndRule, Motion, SlopeRule};
use interslice::stack::{ContourStack, Geometry, Slice, SliceContent};

use super::{Case, Checked, Property, made, within};
use crate::random::measure::px;
use crate::random::numbers::Numbers;
use crate::random::settings::{inner_heights, settings};
use crate::random::source::Source;

/// Steeper than straight lines by this much: slopes of up to three times the way, in a moving frame.
const BOUND: f64 = 5.0;
/// Layers in an interval.
const PARTS: usize = 24;
/// Contours whose distances sum up to less are near, px.
const FAR: f64 = 30.0;
/// As far from the border its own rules count, px.
const BORDER: usize = 16;

pub const PROPERTY: Property = Property {
    name: "no_cliffs",
    draw,
    check,
    damage: Some(|stack, heights, _, body| {
        // A plateau at half of the gap, where both contours are far away.
        let ([low, high], middle) = (distances(stack), 0.5 * (heights[0] + heights[heights.len() - 1]));
        for layer in body.layers.iter_mut().filter(|l| l.contour.is_none()) {
            let mut phi = layer.dense();
            for (v, (a, b)) in phi.iter_mut().zip(low.iter().zip(&high)) {
                if a.min(*b) > 0.35 * FAR {
                    *v = v.abs().max(0.5).copysign((layer.z - middle) as f32);
                }
            }
            layer.phi = SparseImage::of(stack.dims, &phi);
        }
    }),
};

/// Two contours of a saddle, of which the lower one holds the other, on square pixels.
fn draw(seed: u64) -> Case {
    let mut n = Numbers::new(seed);
    let dims = [(); 2].map(|()| n.whole(90, 150));
    let side = n.of(&[1.0, 0.25, 3.7]);
    let middle = dims.map(|d| (0.5 + n.between(-0.1, 0.1)) * d as f64);
    let (angle, steep) = (n.between(0.0, std::f64::consts::TAU), [n.between(0.7, 1.4), n.between(0.7, 1.4)]);
    let (tilt, level) = (n.between(-0.2, 0.2), n.between(0.25, 0.75));
    let half = 0.5 * dims[0].min(dims[1]) as f64;
    let value = |k: usize| {
        let [x, y] = [(k % dims[0]) as f64 - middle[0], (k / dims[0]) as f64 - middle[1]].map(|v| v / half);
        let (u, v) = (x * angle.cos() + y * angle.sin(), y * angle.cos() - x * angle.sin());
        steep[0] * u * u - steep[1] * v * v + tilt * u + level
    };
    let gap = side * n.ratio(2.0, 60.0);
    let slices = [0.0, 1.0].map(|level| Slice {
        name: format!("above {level}"),
        z: gap * level,
        extra: false,
        content: SliceContent::Mask((0..dims[0] * dims[1]).map(|k| value(k) > level).collect()),
    });
    let stack = ContourStack {
        dims,
        spacing: [side; 2],
        unit: "mm".into(),
        slices: slices.into(),
        z_out: None,
        geometry: Geometry::default(),
        known: None,
    };
    let drawn = settings(&mut n, &stack);
    let slope = if drawn.slope == SlopeRule::Linear { SlopeRule::Linear } else { SlopeRule::Hyman };
    // Without a moving frame there is no field to ask.
    let motion = if drawn.motion == Motion::None { Motion::Rigid } else { drawn.motion };
    let (end_bottom, end_top, links) = (EndRule::Flat, EndRule::Flat, Vec::new());
    Case { seed, settings: Settings { slope, motion, end_bottom, end_top, links, ..drawn }, stack }
}

fn check(case: &Case, source: &dyn Source) -> Checked {
    let stack = &case.stack;
    let body = made(source.layers(stack, &inner_heights(stack, PARTS), &case.settings))?;
    let layers: Vec<Vec<f32>> = body.layers.iter().map(|layer| layer.dense()).collect();
    let heights: Vec<Option<f64>> = (0..layers[0].len()).map(|n| leaves(&layers, n)).collect();
    let [low, high] = distances(stack);
    let ([nx, ny], mut most, mut at) = (stack.dims, 0.0, String::new());
    for j in BORDER..ny - BORDER {
        for i in BORDER..nx - BORDER {
            let n = j * nx + i;
            for next in [n + 1, n + nx] {
                let (Some(a), Some(b)) = (heights[n], heights[next]) else { continue };
                let away = (low[n] + high[n]).min(low[next] + high[next]);
                let steep = (a - b).abs() * away;
                if away > FAR && steep > most {
                    (most, at) =
                        (steep, format!("{:.3} of the gap at ({i}, {j}), {away:.1} px from both", (a - b).abs()));
                }
            }
        }
    }
    within(most, BOUND, || at)
}

/// Share of the gap at which a pixel that only the lower slice holds is left.
fn leaves(layers: &[Vec<f32>], n: usize) -> Option<f64> {
    let k = layers.iter().position(|phi| phi[n] >= 0.0).filter(|k| *k > 0)?;
    let [a, b] = [layers[k - 1][n], layers[k][n]].map(f64::from);
    Some((k as f64 - b / (b - a)) / (layers.len() - 1) as f64)
}

/// Distances from both contours, px.
fn distances(stack: &ContourStack) -> [Vec<f64>; 2] {
    [0, 1].map(|k| {
        let signed = exact_distance(&stack.slices[k].content.sides(), stack.dims, stack.spacing);
        signed.data.iter().map(|v| v.abs() / px(stack)).collect()
    })
}
