//! The number of threads changes no bit.

use rayon::ThreadPoolBuilder;

use super::{Case, Checked, Fault, Property, any, made, within};
use crate::random::measure::{common, px};
use crate::random::settings::any_heights;
use crate::random::source::Source;

/// Layers in every interval.
const PARTS: usize = 3;

pub const PROPERTY: Property = Property {
    name: "threads",
    draw: any,
    check,
    damage: Some(|stack, _, _, body| {
        let by = 1e-3 * (px(stack) * rayon::current_num_threads() as f64) as f32;
        body.layers.iter_mut().filter(|l| l.contour.is_none()).for_each(|l| l.phi.map(|v| v + by));
    }),
};

/// Counts values with other bits.
fn check(case: &Case, source: &dyn Source) -> Checked {
    let stack = &case.stack;
    let heights = any_heights(case, PARTS);
    let with = |threads: usize| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|e| Fault { figure: f64::INFINITY, bound: 0.0, what: e.to_string() })?;
        made(pool.install(|| source.layers(stack, &heights, &case.settings)))
    };
    let (one, two) = (with(1)?, with(2)?);
    let pairs = common(&one, &two);
    let all = one.layers.len().max(two.layers.len()) - pairs.len();
    let values = pairs.into_iter().flat_map(|(a, b)| a.phi.iter().zip(b.phi.iter()));
    let differing = all + values.filter(|(a, b)| a.to_bits() != b.to_bits()).count();
    within(differing as f64, 0.0, || format!("{differing} values have other bits with two threads"))
}
