//! What is promised between the slices: on random stacks (`tests/random`), on what once fell (`tests/promises/fallen_seeds.txt`), and on the bodies on
//! which each promise was first seen broken. `benches/campaign.rs` draws as many more as one likes.

mod bodies;
#[path = "../random/mod.rs"]
mod random;
#[path = "../shapes/mod.rs"]
mod shapes;
#[path = "../support/mod.rs"]
mod support;

use interslice::settings::Method;
use interslice::stack::ContourStack;
use interslice::{Reconstruction, Reference, Settings};
use random::measure::px;
use random::properties::closed_far_away::seams;
use random::properties::paths::disagreement;
use random::properties::{PROPERTIES, Property, of_seed, property};
use random::settings::{ends, fine_heights, inner_heights};
use random::source::{Damaged, Program, Source, Straight};

/// Stacks of every property on the reference path and on a GPU: all of them in two minutes on two cores.
const STACKS: u64 = 20;
#[cfg(feature = "gpu")]
const STACKS_ON_A_GPU: u64 = 4;
/// Stacks on which a property is broken on purpose, and on how many of them it must see it: some have no overlap, or a body at the damage.
const BROKEN: u64 = 12;
const SEEN: usize = 4;

/// Promises that do not hold everywhere yet: on how many of the stacks of this suite a property may still fall, on the reference path and on a GPU.
/// More than these is a fault. The counts are what was seen; they are to be lowered, not raised.
const STILL: [(&str, [usize; 2]); 2] = [
    // Some 20 of 800 stacks of a campaign, see benches/RESULTS.md. It was 1 until masks got their area back: seeds 13, 900089 and 900307 fall since,
    // others no more, and of 800 there are 21 for 20.
    ("half_the_step", [3, 0]),
    // 25 of 2500 stacks of a campaign, 20 before thin parts kept their ridges: seeds 13 and 69 fall since.
    ("half_the_step_of_surfaces", [2, 0]),
];

const REFERENCE: Program<'static> = Program { backend: &Reference, single: false };

fn named(name: &str) -> &'static Property {
    property(name).unwrap_or_else(|| panic!("no property is called {name}"))
}

/// Seeds on which a property once fell; on a GPU, where `gpu/` is before its name.
fn fallen(name: &str) -> impl Iterator<Item = u64> {
    let lines =
        include_str!("fallen_seeds.txt").lines().filter_map(move |line| line.strip_prefix(name)?.strip_prefix(' '));
    lines.map(|seed| seed.trim().parse().expect("a seed is a number"))
}

/// Checks a property on the cases of seeds; shows the first on which it falls.
fn hold(name: &str, source: &dyn Source, seeds: impl Iterator<Item = u64>, backend: usize) {
    let property = named(name);
    let (mut count, mut faults, mut first) = (0, Vec::new(), None);
    for seed in seeds {
        let case = (property.draw)(seed);
        count += 1;
        if let Err(fault) = (property.check)(&case, source) {
            faults.push(format!("seed {seed}: {fault}"));
            first.get_or_insert(case);
        }
    }
    let still = STILL.iter().find(|(known, _)| *known == name).map_or(0, |(_, still)| still[backend]);
    println!("{name} falls on {} of {count} stacks, {still} at most: {}", faults.len(), faults.join("; "));
    if let Some(case) = first.filter(|_| faults.len() > still) {
        panic!(
            "{name} falls on {} of {count} stacks:\n{}\nThe first of them:\n{case}",
            faults.len(),
            faults.join("\n")
        );
    }
}

/// A property holds for straight lines between slices and is seen to fall once they are damaged.
fn is_seen(name: &str) {
    let property = named(name);
    let damage = property.damage.expect("there is a way to break it");
    let (mut applies, mut seen) = (0, 0);
    for case in (0..BROKEN).map(property.draw) {
        let straight =
            (property.check)(&case, &Straight).unwrap_or_else(|fault| panic!("straight lines: {fault}\n{case}"));
        applies += usize::from(straight.is_some());
        seen += usize::from((property.check)(&case, &Damaged(damage)).is_err());
    }
    assert!(applies >= SEEN && seen >= SEEN, "{name}: applies to {applies} of {BROKEN}, the damage is seen in {seen}");
}

#[cfg(feature = "gpu")]
fn on_gpu<T>(work: impl FnOnce(&Program<'_>) -> T) -> T {
    use std::sync::OnceLock;

    use interslice::gpu::{Gpu, GpuOptions};
    static GPU: OnceLock<Gpu> = OnceLock::new();
    // No kernel may read what none has written.
    let options = GpuOptions { poison: true, ..GpuOptions::default() };
    let gpu = GPU.get_or_init(|| Gpu::open(&options).expect("a Vulkan driver (tests/run installs lavapipe)"));
    work(&Program { backend: gpu, single: true })
}

macro_rules! properties {
    ($($name:ident)*) => {
        mod on_the_reference_path {
            $(#[test]
            fn $name() {
                let name = stringify!($name);
                super::hold(name, &super::REFERENCE, (0..super::STACKS).chain(super::fallen(name)), 0);
            })*
        }

        #[cfg(feature = "gpu")]
        mod on_a_gpu {
            $(#[test]
            fn $name() {
                let fallen = super::fallen(concat!("gpu/", stringify!($name)));
                let seeds = (0..super::STACKS_ON_A_GPU).chain(fallen);
                super::on_gpu(|gpu| super::hold(stringify!($name), gpu, seeds, 1));
            })*
        }

        #[test]
        fn every_property_is_tested() {
            let tested = [$(stringify!($name)),*];
            assert!(PROPERTIES.iter().all(|p| tested.contains(&p.name)), "{tested:?}");
        }
    };
}

macro_rules! broken {
    ($($name:ident)*) => {
        mod broken_on_purpose {
            $(#[test]
            fn $name() {
                super::is_seen(stringify!($name));
            })*
        }
    };
}

properties! {
    rest_of_grid other_layers beside_inputs vanished_sweeps overlaps_connected nothing_floats discs_in_range lying long_pixels half_the_step
    half_the_step_of_surfaces bounded closed_far_away exact threads paths no_cliffs
}

broken! {
    rest_of_grid other_layers beside_inputs vanished_sweeps overlaps_connected nothing_floats discs_in_range lying long_pixels half_the_step
    half_the_step_of_surfaces bounded exact threads no_cliffs
}

#[test]
fn a_mesh_in_coarse_coordinates_is_seen() {
    let case = (named("closed_far_away").draw)(1);
    let body = Straight.layers(&case.stack, &inner_heights(&case.stack, 6), &case.settings).expect("it is sound");
    let mesh = interslice::surface::mesh::closed_surface(&body);
    assert_eq!(seams(&mesh.positions, &mesh.triangles), 0);
    let step = 0.5 * px(&case.stack);
    let coarse: Vec<_> = mesh.positions.iter().map(|p| p.map(|v| (v / step).round() * step)).collect();
    assert!(seams(&coarse, &mesh.triangles) > 0);
}

#[test]
fn paths_that_differ_are_seen() {
    let case = (named("paths").draw)(2);
    let heights = fine_heights(&case.stack, &case.settings, 4);
    let by = |by: f64| {
        let of = |source: &dyn Source| source.layers(&case.stack, &heights, &case.settings).expect("it is sound");
        let shift = move |stack: &ContourStack, _: &[f64], _: &Settings, body: &mut Reconstruction| {
            let by = (by * px(stack)) as f32;
            body.layers.iter_mut().for_each(|l| l.phi.map(|v| v + by));
        };
        disagreement(&of(&Damaged(shift)), &of(&Straight), px(&case.stack), Method::Morph).0
    };
    assert!(by(0.0) == 0.0 && by(0.03) > 1.0, "{} {}", by(0.0), by(0.03));
}

/// What a random case prints is enough to see it.
#[test]
fn a_case_shows_itself() {
    let text = format!("{}", (named("exact").draw)(3));
    assert!(text.contains("seed 3: ") && text.contains("settings") && text.contains('█'), "{text}");
}

/// Ends are where they are drawn.
#[test]
fn heights_of_a_case_reach_from_end_to_end() {
    let case = (named("rest_of_grid").draw)(5);
    let heights = inner_heights(&case.stack, 7);
    assert_eq!([heights[0], heights[7]], ends(&case.stack));
}

#[test]
fn a_campaign_tries_every_property_on_even_and_odd_seeds() {
    for property in &PROPERTIES {
        let tried: Vec<u64> = (0..1000).filter(|seed| of_seed(*seed).name == property.name).collect();
        let odd = tried.iter().filter(|seed| *seed % 2 == 1).count();
        assert!(
            3 * odd > tried.len() && 3 * odd < 2 * tried.len(),
            "{}: {odd} of {} are odd",
            property.name,
            tried.len()
        );
    }
}
