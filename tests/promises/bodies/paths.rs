//! Both paths give the same body.

use interslice::Settings;
use interslice::settings::{AntiAlias, EndRule, Method, Motion, SlopeRule, SplineEnd};

use super::of;
use crate::random::case::{self, Kind};
use crate::random::numbers::Numbers;
use crate::shapes::plain;
use crate::{named, on_gpu};

/// Stacks and options like those on which the paths once differed.
#[test]
fn p20_the_paths_agree_on_what_a_campaign_draws() {
    let default = Settings::default;
    let extrapolate = EndRule::Extrapolate;
    let alike: [(&[f64], [f64; 2], Settings); 6] = [
        (
            &[0.0, 3.0, 6.0, 9.0],
            [0.5, 2.0],
            Settings {
                method: Method::Field,
                slope: SlopeRule::Catmull,
                end_bottom: extrapolate,
                end_top: EndRule::HalfSlice,
                cfl: 0.9,
                ..default()
            },
        ),
        (
            &[2.0, 9.0, 9.1],
            [1.0, 1.0],
            Settings {
                fair: 1.0,
                end_bottom: extrapolate,
                end_top: extrapolate,
                anti_alias: AntiAlias::None,
                seed_spacing: 0.05,
                ..default()
            },
        ),
        (&[7.0, 8.0, 15.0, 15.1], [1.0, 1.0], Settings { fair: 1.0, end_bottom: EndRule::Peak(4.0), ..default() }),
        (
            &[0.25, 0.275, 0.775],
            [0.5, 0.5],
            Settings {
                spline_end: Some(SplineEnd::NotAKnot),
                cap_gaps: Some(5.08),
                anti_alias: AntiAlias::None,
                sigma: 0.05,
                tolerance: 0.5,
                ..plain()
            },
        ),
        (
            &[4.65, 14.65, 15.15],
            [0.5, 2.0],
            Settings { motion: Motion::None, end_bottom: extrapolate, end_top: extrapolate, ..default() },
        ),
        (
            &[0.5, 1.0, 6.0],
            [1.0, 0.5],
            Settings { motion: Motion::None, spline_end: Some(SplineEnd::NotAKnot), ..default() },
        ),
    ];
    let mut faults = Vec::new();
    on_gpu(|gpu| {
        for (k, (heights, spacing, settings)) in alike.into_iter().enumerate() {
            for seed in 0..3 {
                let mut n = Numbers::new(2000 + 10 * k as u64 + seed);
                let mut stack = case::stack(&mut n, Kind::Any);
                while stack.slices.len() < heights.len() {
                    stack = case::stack(&mut n, Kind::Any);
                }
                stack.slices.truncate(heights.len());
                stack.slices.iter_mut().zip(heights).for_each(|(s, z)| s.z = *z);
                stack.spacing = spacing;
                if stack.validate().is_err() {
                    continue;
                }
                let case = of(&stack, settings.clone());
                faults
                    .extend((named("paths").check)(&case, gpu).err().map(|fault| format!("{k}, seed {seed}: {fault}")));
            }
        }
    });
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
