//! The bodies on which each promise was first seen broken.

use std::f64::consts::PI;

use crate::random::case::Case;
#[cfg(feature = "gpu")]
use crate::random::case::{self, Kind};
use crate::random::measure::{area, layer_at};
use crate::random::numbers::Numbers;
use crate::random::properties::beside_inputs::jumps_beside;
use crate::random::properties::long_pixels::beyond_hulls;
use crate::random::properties::lying::moved;
use crate::random::properties::nothing_floats::{floating_in_mesh, floating_in_voxels};
use crate::random::properties::overlaps_connected::torn;
use crate::random::settings::{fine_heights, inner_heights};
use crate::random::source::Source;
use crate::random::turned::TURNS;
use crate::shapes::zoo::zoo;
use crate::shapes::*;
use glam::DVec2;
use interslice::evaluate::demo::demo;
use interslice::polygons::{self, PlaneDrawing, Planes};
#[cfg(feature = "gpu")]
use interslice::settings::SplineEnd;
use interslice::settings::{AntiAlias, EndRule, Method, Motion, SlopeRule};
use interslice::stack::{ContourStack, Geometry, SliceContent};
use interslice::{Reconstruction, Settings, height_grid};

use crate::*;

fn run(stack: &ContourStack, heights: &[f64], settings: &Settings) -> Reconstruction {
    REFERENCE.layers(stack, heights, settings).expect("the stack is valid")
}

/// A case of its own for a property.
fn of(stack: &ContourStack, settings: Settings) -> Case {
    Case { seed: 0, stack: stack.clone(), settings }
}

fn holds(name: &str, stack: &ContourStack, settings: Settings) {
    if let Err(fault) = (named(name).check)(&of(stack, settings), &REFERENCE) {
        panic!("{name}: {fault}");
    }
}

fn steps(count: usize, by: f64) -> Vec<f64> {
    (0..count).map(|k| by * k as f64).collect()
}

/// Stack of the zoo with slices this far apart.
fn of_zoo(name: &str, gap: f64) -> ContourStack {
    let (_, shapes) = zoo().into_iter().find(|(n, _)| *n == name).expect("it is in the zoo");
    masks(shapes::zoo::N, &steps(shapes.len(), gap), &shapes)
}

fn pixels(body: &Reconstruction, z: f64) -> usize {
    layer_at(body, z).map_or(0, |l| l.phi.iter().filter(|v| **v < 0.0).count())
}

/// Seven equal discs of about 609 px at 8, 16 .. 56.
fn seven_discs() -> ContourStack {
    let heights: Vec<f64> = (1..=7).map(|k| 8.0 * f64::from(k)).collect();
    masks(64, &heights, &(0..7).map(|_| circle(31.5, 31.5, 13.9)).collect::<Vec<_>>())
}

/// The default, without motion, and the field method.
fn ways() -> [(&'static str, Settings); 3] {
    let default = Settings::default();
    [
        ("default", default.clone()),
        ("still", Settings { motion: Motion::None, ..default.clone() }),
        ("field", Settings { method: Method::Field, ..default }),
    ]
}

fn does_not_balloon(source: &dyn Source) {
    let stack = seven_discs();
    for (name, settings) in ways() {
        let body = source.layers(&stack, &steps(64, 1.0), &settings).expect("the stack is valid");
        let drawn = pixels(&body, 8.0) as f64;
        let areas: Vec<usize> = (8..=56).map(|z| pixels(&body, f64::from(z))).collect();
        // A tenth of a pixel of the radius.
        let most = 0.1 * 2.0 * PI * (drawn / PI).sqrt();
        assert!(areas.iter().all(|a| (*a as f64 - drawn).abs() <= most), "{name}: {areas:?} for {drawn}");
        assert!((0..8).chain(57..64).all(|z| pixels(&body, f64::from(z)) == 0), "{name}: flat ends");
    }
}

#[test]
fn p01_a_cylinder_does_not_balloon_in_a_grid_that_goes_on() {
    does_not_balloon(&REFERENCE);
}

#[cfg(feature = "gpu")]
#[test]
fn p01_nor_on_a_gpu() {
    on_gpu(|gpu| does_not_balloon(gpu));
}

#[test]
fn p01_what_lies_beyond_changes_no_bit() {
    for (_, settings) in ways() {
        holds("rest_of_grid", &seven_discs(), settings);
    }
}

/// A cylinder of radius 12 that leans by 12 from slice to slice 10 apart, lengths in short pixels: 160 pixels that are `1 / aspect` as long as
/// the others, or as wide.
fn sheared_cylinder(aspect: f64, across: bool) -> ContourStack {
    let (long, short) = (40, 160);
    let mut stack = masks(2, &steps(4, 10.0), &[(); 4].map(|()| circle(0.0, 0.0, 1.0)));
    (stack.dims, stack.spacing) = if across { ([long, short], [aspect, 1.0]) } else { ([short, long], [1.0, aspect]) };
    let [nx, ny] = stack.dims;
    for (k, slice) in stack.slices.iter_mut().enumerate() {
        let inside = |n: usize| {
            let [x, y] = [n % nx, n / nx].map(|v| v as f64);
            let [p, q] = if across { [y, x * aspect] } else { [x, y * aspect] };
            (p - 62.0 - 12.0 * k as f64).hypot(q - 0.5 * aspect * long as f64) < 12.0
        };
        slice.content = SliceContent::Mask((0..nx * ny).map(inside).collect());
    }
    stack
}

#[test]
fn p02_a_sheared_cylinder_on_long_pixels_leaves_no_debris() {
    let mut faults = Vec::new();
    for aspect in [2.5, 3.0, 4.0, 7.0, 8.0] {
        for across in [false, true] {
            let stack = sheared_cylinder(aspect, across);
            let body = run(&stack, &fine_heights(&stack, &Settings::default(), 8), &Settings::default());
            let (beyond, floating) = (beyond_hulls(&stack, &body), floating_in_voxels(&body));
            if beyond > 0 || !floating.is_empty() {
                faults.push(format!("aspect {aspect}, across {across}: {beyond} voxels outside, {floating:?} float"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn p03_a_layer_does_not_depend_on_others() {
    let concentric = masks(90, &steps(4, 8.0), &[20.0, 26.0, 16.0, 22.0].map(|r| circle(45.0, 45.0, r)));
    for stack in [concentric, of_zoo("one_to_two", 10.0)] {
        for (_, settings) in ways() {
            holds("other_layers", &stack, settings);
        }
    }
}

#[test]
fn p03_beside_an_input_is_the_input() {
    for name in ["one_to_two", "one_to_one", "square_to_circle"] {
        holds("beside_inputs", &of_zoo(name, 10.0), Settings::default());
    }
}

#[test]
fn p04_overlapping_parts_stay_connected() {
    let beside_a_disc = |x: f64| union(circle(30.0, 45.0, 14.0 + x), circle(70.0, 45.0, 0.4));
    let pixel = masks(90, &steps(3, 8.0), &[0.0, 2.0, 4.0].map(beside_a_disc));
    let mut stacks = vec![("a pixel beside a disc", pixel)];
    stacks.extend(["barely_overlapping", "one_to_four", "four_to_four", "two_to_one"].map(|n| (n, of_zoo(n, 10.0))));
    for (name, stack) in stacks {
        for (way, settings) in ways() {
            let body = run(&stack, &fine_heights(&stack, &settings, 16), &settings);
            let torn = torn(&stack, &body);
            assert!(torn.is_empty(), "{name}, {way}: {torn:?}");
            assert_eq!((floating_in_voxels(&body), floating_in_mesh(&stack, &body)), (vec![], 0), "{name}, {way}");
        }
    }
}

#[test]
fn p05_equal_neighbours_stay_equal() {
    let stack = masks(90, &steps(4, 10.0), &[20.0, 20.0, 30.0, 30.0].map(|r| circle(44.5, 44.5, r)));
    for (_, settings) in ways() {
        for slope in [SlopeRule::Hyman, SlopeRule::Pchip] {
            holds("discs_in_range", &stack, Settings { slope, ..settings.clone() });
        }
    }
}

#[test]
fn p06_the_same_body_however_it_lies() {
    for (name, bound) in [("one_to_one", 0.02), ("one_to_two", 0.1)] {
        for (way, settings) in ways() {
            let moved = moved(&of_zoo(name, 10.0), &settings, &REFERENCE, &TURNS).expect("the stack is valid");
            assert!(moved.iter().all(|(change, _)| *change <= bound), "{name}, {way}: {moved:?}");
        }
    }
}

#[test]
fn p07_no_jump_where_a_sweep_vanishes() {
    let line = |angle: f64| shapes::zoo::bar(1.0, angle);
    let mut faults = Vec::new();
    for angle in [0.4, 0.8, 1.2, 1.57] {
        let stack = masks(90, &steps(3, 10.0), &[line(0.1), line(0.1 + angle), line(0.1)]);
        let jumps = jumps_beside(&stack, &plain(), &REFERENCE).expect("the stack is valid");
        let surface = |layer: &interslice::surface::Layer| area(layer, 1.0);
        faults.extend(jumps.into_iter().filter(|(jump, _)| *jump > 0.02).map(|jump| (angle, jump)));
        // A thousandth of the gap beside each line there is the line, by area: 13.8 px of distance and half of its area were gone.
        let heights = [0.0, 0.01, 9.99, 10.0, 10.01, 19.99, 20.0];
        let body = run(&stack, &heights, &plain());
        for (beside, input) in [(1, 0), (2, 3), (4, 3), (5, 6)] {
            let at = |k: usize| layer_at(&body, heights[k]).expect("it was asked for");
            let [beside, input] = [beside, input].map(|k| surface(at(k)));
            assert!((beside / input - 1.0).abs() < 0.02, "{angle}: {beside} px beside {input}");
        }
    }
    assert!(faults.is_empty(), "{faults:?}");
}

#[test]
fn p08_half_the_step_gives_the_same_body() {
    // At the fork it is 0.12 px with half of 0.5, 0.02 px with half of 0.1.
    for (cfl, most) in [(0.5, 0.2), (0.1, 0.05)] {
        let body = |cfl: f64| run(&of_zoo("one_to_two", 10.0), &steps(11, 1.0), &Settings { cfl, ..plain() });
        let [one, half] = [body(cfl), body(0.5 * cfl)];
        let pixels = one.layers.iter().zip(&half.layers).flat_map(|(a, b)| a.phi.iter().zip(b.phi.iter()));
        let near = pixels.filter(|(a, b)| a.abs() < 1.0 || (**a < 0.0) != (**b < 0.0));
        let change = near.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("{cfl}: {change} px");
        assert!(change < most, "{cfl}: {change} px");
    }
}

/// Beside a gap a hundred times as long, a gradient of fairing along a short one tells of rounding and of the sweeps' steps (0.94 px).
#[test]
fn p08_a_gap_unlike_its_neighbours_stays_calm() {
    let property = named("half_the_step");
    let case = (property.draw)(303_864);
    let change = match (property.check)(&case, &REFERENCE) {
        Ok(change) => change.expect("the body has pixels near its surface"),
        Err(fault) => fault.figure,
    };
    println!("{change} px");
    assert!(change < 0.1, "{change} px");
}

#[test]
fn p08_splines_that_overshoot_on_unlike_gaps_are_warned_of() {
    let discs = [8.0, 9.0, 11.0].map(|r| circle(20.0, 20.0, r));
    let warned = |z: [f64; 3], slope| {
        let body = run(&masks(40, &z, &discs), &z, &Settings { slope, ..plain() });
        body.report.warnings.iter().filter(|w| w.contains("between gaps so unlike")).count()
    };
    let unlike = [0.0, 1.0, 21.0];
    for (slope, count) in
        [(SlopeRule::Natural, 1), (SlopeRule::Catmull, 1), (SlopeRule::Hyman, 0), (SlopeRule::Pchip, 0)]
    {
        assert_eq!(warned(unlike, slope), count, "{slope:?}");
        assert_eq!(warned([0.0, 1.0, 10.0], slope), 0, "{slope:?}");
    }
}

/// Values of the natural cubic through `y` at `x`, equally spaced, three knots: `(values at either end, the middle's slope)`.
fn natural_cubic(y: [f64; 3], gap: f64, z: f64) -> f64 {
    // One inner knot: its second derivative is all there is.
    let m = 1.5 * (y[0] - 2.0 * y[1] + y[2]) / (gap * gap);
    let (k, m) = if z < gap { (0, [0.0, m]) } else { (1, [m, 0.0]) };
    let (a, b) = (gap * (k + 1) as f64 - z, z - gap * k as f64);
    (m[0] * a.powi(3) + m[1] * b.powi(3)) / (6.0 * gap)
        + (y[k] / gap - m[0] * gap / 6.0) * a
        + (y[k + 1] / gap - m[1] * gap / 6.0) * b
}

#[test]
fn p09_natural_is_the_natural_cubic() {
    for name in ["fig5", "fig6"] {
        let demo = demo(name).expect("a demo");
        let settings = Settings { slope: SlopeRule::Natural, anti_alias: AntiAlias::Kernel, ..plain() };
        let body = run(&demo.stack, &steps(33, 1.0), &settings);
        let radius = |z: f64| (area(layer_at(&body, z).expect("a layer"), 1.0) / PI).sqrt();
        let knots = [0.0, 16.0, 32.0].map(radius);
        let off = |k: usize| (radius(k as f64) - natural_cubic(knots, 16.0, k as f64)).abs();
        let worst = (0..33).map(off).fold(0.0, f64::max);
        assert!(worst <= 0.05, "{name}: {worst:.2} px from the natural cubic");
    }
}

/// Mean and worst relative error of the volume of spheres drawn as polygons, by an end rule.
fn spheres(rule: EndRule) -> (f64, f64) {
    let mut errors = Vec::new();
    let mut n = Numbers::new(10);
    for radius in [3.0f64, 5.0, 8.0, 12.0, 20.0] {
        for gap in [1.0, 2.0] {
            for place in 0..4 {
                let [x, y] = [n.between(0.0, 1.0), n.between(0.0, 1.0)];
                // Places of the first slice spread evenly: a mean over few drawn ones is off by more than what is promised.
                let first = gap * (f64::from(place) + n.between(0.0, 1.0)) / 4.0;
                let planes = (0..).map(|k| gap * f64::from(k) + first - radius).take_while(|z| *z < radius);
                let of_plane = |z: f64| {
                    let r = (radius * radius - z * z).sqrt();
                    let at = |k: usize| PI * k as f64 / 36.0;
                    let circle = (0..72).map(|k| DVec2::new(x, y) + r * DVec2::from_angle(at(k))).collect();
                    PlaneDrawing { name: format!("{z}"), z, extra: false, regions: vec![vec![circle]] }
                };
                let drawings: Vec<PlaneDrawing> = planes.map(of_plane).collect();
                if drawings.len() < 3 {
                    continue;
                }
                let planes = Planes { unit: "mm".into(), axes: Geometry::default().axes, z_out: None };
                let stack = polygons::stack(&drawings, &planes, Some([0.5; 2])).expect("it is sound");
                let settings = Settings { end_bottom: rule, end_top: rule, ..Settings::default() };
                let heights = height_grid(&stack, &settings, Some(0.125 * gap)).heights().expect("a grid");
                let volume = interslice::surface::mesh::closed_surface(&run(&stack, &heights, &settings)).volume();
                errors.push(volume / (4.0 / 3.0 * PI * radius.powi(3)) - 1.0);
            }
        }
    }
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (mean, errors.into_iter().map(f64::abs).fold(0.0, f64::max))
}

#[test]
fn p10_ends_give_volumes_one_can_trust() {
    let (mean, worst) = spheres(EndRule::Extrapolate);
    assert!(mean.abs() <= 0.01 && worst <= 0.08, "extrapolated: mean {mean:.3}, worst {worst:.3}");
    let (mean, _) = spheres(EndRule::HalfSlice);
    assert!(mean.abs() <= 0.01, "half-slice: mean {mean:.3}");
}

/// Work is counted, not timed: band pixels of morphs and sweeps follow the contours.
#[test]
fn p11_work_follows_the_contours() {
    let work = |times: usize| {
        let small = of_zoo("one_to_two", 10.0);
        let [nx, ny] = small.dims;
        let inside = |k: usize, n: usize| {
            let (i, j) = (n % (times * nx), n / (times * nx));
            i < nx && j < ny && small.slices[k].content.inside(j * nx + i)
        };
        let mut stack = small.clone();
        stack.dims = [times * nx, times * ny];
        for (k, slice) in stack.slices.iter_mut().enumerate() {
            let mask = (0..times * nx * times * ny).map(|n| inside(k, n)).collect();
            slice.content = SliceContent::Mask(mask);
        }
        let body = run(&stack, &inner_heights(&stack, 8), &Settings::default());
        body.report.intervals.iter().map(|i| [i.trace_pixels, i.sweep_pixels]).collect::<Vec<_>>()
    };
    assert_eq!(work(1), work(4));
}

#[test]
fn p17_a_disc_between_empty_slices_does_not_balloon() {
    let disc = || circle(31.5, 31.5, 5.97);
    let stack = masks(64, &steps(3, 8.0), &[nothing(), disc(), nothing()]);
    let volume = |settings: &Settings| {
        let body = run(&stack, &fine_heights(&stack, settings, 8), settings);
        body.layers.iter().map(|l| area(l, 1.0)).sum::<f64>()
    };
    let default = Settings::default();
    let (faired, still) = (volume(&default), volume(&Settings { motion: Motion::None, ..default.clone() }));
    let unfaired = volume(&Settings { fair: 0.0, ..default });
    assert!((faired / unfaired - 1.0).abs() <= 0.1, "{faired:.0} px faired, {unfaired:.0} without");
    assert!(
        (faired / still - 1.0).abs() <= 0.02,
        "{faired:.0} px with motion, {still:.0} without, though nothing moves"
    );
}

#[test]
fn p17_nor_one_drawn_three_times() {
    let disc = || circle(31.5, 31.5, 5.97);
    let stack = masks(64, &steps(4, 8.0), &[disc(), disc(), disc(), nothing()]);
    holds("discs_in_range", &stack, Settings::default());
}

#[test]
fn p18_distances_keep_their_bound_after_fairing() {
    // Gaps that differ by a factor of 300: what is straight over the small one is far over the large one.
    let shapes = || vec![circle(20.0, 20.0, 9.0), circle(26.0, 22.0, 12.0), nothing(), circle(24.0, 24.0, 7.0)];
    for heights in [[0.0, 0.1, 30.1, 30.2], [0.0, 30.0, 30.1, 60.1]] {
        for (_, settings) in ways() {
            holds("bounded", &masks(48, &heights, &shapes()), settings);
        }
    }
}

/// Stacks and options like those on which the paths once differed.
#[cfg(feature = "gpu")]
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
                cap_gaps: 5.08,
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
