//! P10: spheres drawn as polygons on a few slices have the volume of spheres, and bodies that are quadratic in area end where they do.

use std::f64::consts::PI;

use crate::shapes::spheres::*;
use glam::DVec2;
use interslice::Settings;
use interslice::report::CapRule;
use interslice::settings::{EndRule, Method, Motion};

fn both(rule: EndRule) -> Settings {
    Settings { end_bottom: rule, end_top: rule, ..Settings::default() }
}

/// Relative errors of the mesh's volume, with checks that layers and report agree with the mesh.
fn errors(rule: EndRule, settings: &Settings) -> Vec<f64> {
    let mut out = Vec::new();
    for (diameter, gap) in [(3.0, 1.0), (4.0, 1.0), (8.0, 1.0), (6.0, 2.0), (8.0, 2.0), (12.0, 2.0), (20.0, 2.0)] {
        let exact = sphere_volume(diameter);
        let found: Vec<f64> = spheres(diameter, gap, 6)
            .iter()
            .map(|stack| {
                let [mesh, areas, _] =
                    volumes(stack, &Settings { end_bottom: rule, end_top: rule, ..settings.clone() })
                        .expect("a sound stack");
                assert!((areas / mesh - 1.0).abs() < 0.005, "{diameter} mm: {areas} by areas, {mesh} by the mesh");
                mesh / exact - 1.0
            })
            .collect();
        println!("{rule}, {diameter} mm on {gap} mm: {:?}", spread(&found).map(|e| (1000.0 * e).round() / 10.0));
        out.extend(found);
    }
    out
}

/// The default, and what a user may set that changes how a sphere is rounded.
fn ways() -> [(&'static str, Settings); 4] {
    let default = Settings::default;
    [
        ("default", default()),
        ("unfaired", Settings { fair: 0.0, ..default() }),
        ("still", Settings { fair: 0.0, motion: Motion::None, ..default() }),
        ("field", Settings { method: Method::Field, ..default() }),
    ]
}

#[test]
fn spheres_on_few_slices_have_their_volume() {
    for (way, settings) in ways() {
        let [mean, least, largest] = spread(&errors(EndRule::Extrapolate, &settings));
        assert!(mean.abs() <= 0.01 && least >= -0.08 && largest <= 0.08, "{way}: {mean} [{least}, {largest}]");
    }
}

#[test]
fn half_slices_have_the_volume_of_spheres_in_the_mean() {
    for (way, settings) in ways() {
        let [mean, ..] = spread(&errors(EndRule::HalfSlice, &settings));
        assert!(mean.abs() <= 0.01, "{way}: {mean}");
    }
    // Without the end the mean is off by many times that: the bound can fail.
    assert!(spread(&errors(EndRule::Flat, &Settings::default()))[0] < -0.05);
}

#[test]
fn caps_of_ellipsoids_paraboloids_and_cones_are_theirs() {
    // Name, half axes over height, heights of contours, tip, volume beyond the last one.
    type Case = (&'static str, fn(f64) -> DVec2, [f64; 4], f64, f64);
    let cases: [Case; 3] = [
        (
            "ellipsoid",
            |z| DVec2::new(3.0, 1.5) * (36.0 - z * z).max(0.0).sqrt(),
            [-1.0, 1.0, 3.0, 5.0],
            6.0,
            PI * 4.5 * 17.0 / 3.0,
        ),
        ("paraboloid", |z| 4.0 * DVec2::new(1.0, 2.0) * (6.0 - z).sqrt(), [-1.0, 1.0, 3.0, 5.0], 6.0, PI * 32.0 * 0.5),
        ("cone", |z| DVec2::new(3.0, 2.0) * (7.0 - z), [-1.0, 1.0, 3.0, 5.0], 7.0, PI * 6.0 * 8.0 / 3.0),
    ];
    for (name, axes, heights, tip, exact) in cases {
        let stack = drawn(DVec2::new(3.0, 5.0), &heights, axes).expect("a sound drawing");
        let settings = Settings { end_top: EndRule::Extrapolate, ..Settings::default() };
        let end = interslice::reconstruct(&stack, &settings).expect("a sound stack").report.ends.remove(1);
        println!("{name}: {:.3} for {exact:.3}, {:?}", end.used, end.caps);
        assert!((end.used / exact - 1.0).abs() < 0.02, "{name}: {} for {exact}", end.used);
        assert!(matches!(end.caps[0].rule, CapRule::Quadratic | CapRule::Cone), "{name}");
        // A double root moves by the root of the noise.
        let slack = if name == "cone" { 0.2 } else { 0.03 };
        assert!((end.caps[0].height - (tip - 5.0)).abs() < slack * (tip - 5.0), "{name}: {:?}", end.caps);
    }
}

#[test]
fn rods_that_are_rounded_off_end_as_they_do() {
    // Half balls on a rod 12 mm wide: three of its areas look like a ball's, and its end was taken for one of half the curvature. Share of the ends' volume, of
    // all together, and the largest error of a single pair of ends, of the mean pair's.
    for (gap, least, most, worst) in [(2.0, 0.95, 1.05, 0.15), (4.0, 0.95, 1.3, 0.8)] {
        let radius = |z: f64| (36.0 - (z.abs() - 14.0).max(0.0).powi(2)).max(0.0).sqrt();
        let cap = |z: f64| PI * (20.0 - z.abs()).powi(2) * (z.abs() - 2.0) / 3.0;
        let pairs: Vec<[f64; 2]> = (0..12)
            .filter_map(|k| {
                let off = gap * (f64::from(k) + 0.5) / 12.0;
                let heights: Vec<f64> = (-20..20).map(|n| gap * f64::from(n) + off).collect();
                let stack = drawn(DVec2::new(3.0, 5.0), &heights, |z| DVec2::splat(radius(z)))?;
                let [first, .., last] = &stack.slices[..] else { return None };
                let [.., ends] = volumes(&stack, &both(EndRule::Extrapolate)).expect("a sound stack");
                println!("{gap} mm, from {} to {}: {ends:.1} for {:.1}", first.z, last.z, cap(first.z) + cap(last.z));
                Some([ends, cap(first.z) + cap(last.z)])
            })
            .collect();
        assert_eq!(pairs.len(), 12);
        let [found, exact] = [0, 1].map(|k| pairs.iter().map(|pair| pair[k]).sum::<f64>());
        let single = pairs.iter().map(|[found, exact]| (found - exact).abs()).fold(0.0, f64::max) * 12.0 / exact;
        println!("{gap} mm: {:.3} of the volume, single ends up to {single:.3} of it off", found / exact);
        assert!((least..most).contains(&(found / exact)) && single < worst, "{gap} mm: {}, {single}", found / exact);
    }
}

#[test]
fn too_few_contours_are_told() {
    let cone = |heights: &[f64]| {
        let stack = drawn(DVec2::ZERO, heights, |z| DVec2::splat(8.0 - z)).expect("a sound drawing");
        interslice::reconstruct(&stack, &both(EndRule::Extrapolate)).expect("a sound stack").report
    };
    let report = cone(&[1.0, 3.0]);
    assert_eq!(report.ends[1].caps[0].rule, CapRule::Paraboloid);
    assert_eq!(report.ends[0].caps[0].rule, CapRule::Flat);
    assert!(report.warnings.iter().any(|w| w.contains("bottom end: part 1 does not shrink, or hardly; ends flat")));
}
