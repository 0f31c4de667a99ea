//! Labels that lie one above the other, so that they touch on no slice.

use interslice::stack::ReadOptions;
use proptest::prelude::*;

use crate::own_slices::{Disc, areas, decided, volume};

const AT: [f64; 2] = [24.0, 23.0];

/// Both meanings of slices: of each label its own, and complete.
fn meanings() -> [ReadOptions; 2] {
    [false, true].map(|complete_slices| ReadOptions { complete_slices, ..ReadOptions::default() })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    #[test]
    fn labels_one_above_the_other_leave_no_gap(first in 1usize..4, second in 2usize..4, radius in 8.0..21.0f64, fine in 1usize..3) {
        let painted: Vec<usize> = (0..=30).step_by(3).collect();
        let borders = [first + 1, first + 1 + second];
        let parts = [&painted[..borders[0]], &painted[borders[0]..borders[1]], &painted[borders[1]..]];
        let discs: Vec<Disc<'_>> =
            (1..).zip(parts).map(|(label, slices)| Disc { label, at: AT, radius, slices }).collect();
        for options in meanings() {
            let (layers, ..) = decided(&volume(&discs), &options, fine);
            let [low, middle, high] = [1, 2, 3].map(|label| areas(&layers, label));
            let all: Vec<usize> = (0..layers.len()).map(|k| low[k] + middle[k] + high[k]).collect();
            prop_assert!(all.iter().all(|n| 100 * n.abs_diff(all[0]) <= 2 * all[0]), "{all:?}");
            // Each has what lies on its side of the middle between both slices.
            for (border, [below, above]) in borders.into_iter().zip([[&low, &middle], [&middle, &high]]) {
                let [on, off] = [painted[border - 1], painted[border]].map(|k| k * fine);
                for k in (on..=off).filter(|k| 2 * k != on + off) {
                    let [own, other] = if 2 * k < on + off { [below, above] } else { [above, below] };
                    prop_assert!(100 * other[k] <= own[k], "layer {k} between {on} and {off}: {below:?} and {above:?}");
                }
            }
        }
    }
}

#[test]
fn a_label_that_passes_below_the_corner_of_another_ends_by_itself() {
    let lower = Disc { label: 1, at: AT, radius: 10.0, slices: &[0, 6, 12] };
    let beside = Disc { label: 2, at: [AT[0] + 14.0, AT[1]], radius: 10.0, slices: &[18, 24, 30] };
    for options in meanings() {
        let both = decided(&volume(&[lower, beside]), &options, 1).0;
        let far = Disc { at: [AT[0] + 24.0, AT[1]], ..beside };
        let apart = decided(&volume(&[lower, far]), &options, 1).0;
        for label in [1, 2] {
            assert_eq!(areas(&both, label), areas(&apart, label), "label {label}");
        }
    }
}
