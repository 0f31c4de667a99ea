//! The certificate fails where it should: every check sees the one defect that it is for, and nothing in a sound body.

use interslice::Report;
use interslice::grid::sparse_image::SparseImage;
use interslice::pipeline::certificate::{CertificateSpec, Examined};
use interslice::progress::Silent;
use interslice::report::{ContourReport, PartPair, StepBeside};
use interslice::settings::{EndRule, Method};
use interslice::stack::heights::BESIDE;
use interslice::stack::{ContourStack, Geometry, Slice, SliceContent};
use interslice::surface::Layer;
use interslice::{Reference, Settings};

const N: usize = 40;
/// Two gaps of 10.
const HEIGHTS: [f64; 3] = [0.0, 10.0, 20.0];

/// Number of the first contour in its stack.
const FIRST: usize = 7;

/// Discs `[x, y, radius]`, and holes of negative radius.
type Discs = Vec<[f64; 3]>;

fn layer(z: f64, discs: &Discs) -> Layer {
    let far = |n: usize, d: &[f64; 3]| ((n % N) as f64 - d[0]).hypot((n / N) as f64 - d[1]) - d[2].abs();
    let value = |n: usize| {
        let solid = discs.iter().filter(|d| d[2] > 0.0).map(|d| far(n, d)).fold(14.0, f64::min);
        discs.iter().filter(|d| d[2] < 0.0).map(|d| -far(n, d)).fold(solid, f64::max) as f32
    };
    let contour = HEIGHTS.iter().position(|h| *h == z);
    let phi = (0..N * N).map(value).map(|v| if v == 0.0 { f32::MIN_POSITIVE } else { v });
    Layer { z, phi: SparseImage::of([N; 2], &phi.collect::<Vec<_>>()), output: z.fract() == 0.0, contour }
}

/// What the certificate says of a body of these discs; layers beside contours are no output.
fn examined(of: impl Fn(f64) -> Discs, parted: &[(u32, u32)]) -> Report {
    let mut all: Vec<f64> = (-2..=22).map(f64::from).collect();
    let beside = HEIGHTS.iter().flat_map(|z| [z - 10.0 * BESIDE, z + 10.0 * BESIDE]);
    all.extend(beside.filter(|z| (0.0..20.0).contains(z)));
    all.sort_by(f64::total_cmp);
    let spec = CertificateSpec { dims: [N, N], spacing: [1.0, 1.0], z: HEIGHTS.to_vec(), first: FIRST };
    let layers: Vec<Layer> = all.into_iter().map(|z| layer(z, &of(z))).collect();
    let handed: Vec<(&Layer, bool)> = layers.iter().map(|l| (l, l.output || l.contour.is_some())).collect();
    let by = |count: usize| {
        let mut examined = Examined::new(spec.clone());
        handed.chunks(count).for_each(|some| examined.layers(some));
        examined.finish(&[parted.to_vec(), Vec::new()])
    };
    let (met, body) = by(1);
    for count in [3, 7, handed.len()] {
        assert_eq!(format!("{:?}", by(count)), format!("{:?}", (&met, &body)), "{count} layers at once");
    }
    let contours = met.into_iter().map(|met| ContourReport {
        area: met.area,
        below: met.below,
        above: met.above,
        ..ContourReport::default()
    });
    let mut report = Report { contours: contours.collect(), body, ..Report::default() };
    report.settings.end_bottom = EndRule::HalfSlice;
    report.judge();
    report
}

/// A disc that swells a little, from below the first contour on to the last.
fn sound(z: f64) -> Discs {
    if z > 20.0 { Vec::new() } else { vec![[16.0, 20.0, 8.0 + 0.1 * z.max(0.0)]] }
}

#[test]
fn a_sound_body_passes() {
    let report = examined(sound, &[]);
    assert_eq!(report.broken, [""; 0]);
    assert_eq!((report.body.floating, report.body.voids, report.body.overlapping), (0, 0, 2));
    assert_eq!(
        report.contours.iter().map(|c| [c.below.is_some(), c.above.is_some()]).collect::<Vec<_>>(),
        [[false, true], [true, true], [true, false]]
    );
    let area = std::f64::consts::PI * 81.0;
    assert!((report.contours[1].area - area).abs() < 1.0, "{}", report.contours[1].area);
    let step = report.body.largest_step.expect("there is more than one layer");
    assert!((0.09..0.11).contains(&step.px), "{step:?}");
}

#[test]
fn a_body_that_balloons_beside_a_contour_fails() {
    let report = examined(|z| vec![[16.0, 20.0, if z == 10.0 { 9.0 } else { 9.4 }]], &[]);
    assert!(report.broken[0].contains("steps by 0.4"), "{:?}", report.broken);
    let [below, above] = [report.contours[1].below, report.contours[1].above].map(|b| b.expect("it was looked at"));
    assert!(below.area > report.contours[1].area + 20.0 && above.jump > 0.39);
    // Only below the contour, and where output layers alone would not show it.
    let report = examined(|z| vec![[16.0, 20.0, if (9.5..10.0).contains(&z) { 9.4 } else { 9.0 }]], &[]);
    assert_eq!(report.broken.len(), 1, "{:?}", report.broken);
    assert!(report.broken[0].contains("just below"));
}

#[test]
fn pieces_in_the_air_fail() {
    let crumb = |z: f64| if (13.0..15.0).contains(&z) { vec![[34.0, 34.0, 0.6]] } else { Vec::new() };
    let report = examined(|z| [sound(z), crumb(z)].concat(), &[]);
    assert_eq!(report.body.floating, 1);
    assert_eq!(report.broken, ["1 piece of the body touches no contour"]);
    // Beyond an end, too.
    let above = |z: f64| if z == 22.0 { vec![[34.0, 34.0, 2.0]] } else { Vec::new() };
    assert_eq!(examined(|z| [sound(z), above(z)].concat(), &[]).body.floating, 1);
}

#[test]
fn voids_fail() {
    let bubble = |z: f64| if (3.0..5.0).contains(&z) { vec![[16.0, 20.0, -2.0]] } else { Vec::new() };
    let report = examined(|z| [sound(z), bubble(z)].concat(), &[]);
    assert_eq!((report.body.voids, report.body.floating), (1, 0));
    assert_eq!(report.broken, ["1 void in the body opens to no contour"]);
    // One that opens to a contour is a hole of it.
    let hole = |z: f64| if (3.0..=10.0).contains(&z) { vec![[16.0, 20.0, -2.0]] } else { Vec::new() };
    assert_eq!(examined(|z| [sound(z), hole(z)].concat(), &[]).body.voids, 0);
}

#[test]
fn overlapping_parts_that_are_torn_fail_unless_a_link_says_so() {
    let torn = |z: f64| if z == 4.0 { vec![[34.0, 4.0, 3.0]] } else { vec![[34.0, 4.0, 3.0], [16.0, 20.0, 8.0]] };
    let report = examined(torn, &[]);
    // In row order the small one comes first.
    assert_eq!(report.body.torn, [PartPair { slice: FIRST, from: 2, to: 2 }]);
    assert!(report.broken[0].contains("part 2 of slice 7 and part 2 of the next"), "{:?}", report.broken);
    assert_eq!(examined(torn, &[(2, 2)]).broken, [""; 0]);
}

#[test]
fn an_interval_that_nothing_crosses_is_named_where_both_its_contours_have_parts() {
    let apart = |of: &dyn Fn(f64) -> Discs| {
        let report = examined(of, &[]);
        assert_eq!(report.broken, [""; 0]);
        report.body.apart
    };
    let at = |x: f64| vec![[x, 20.0, 6.0]];
    assert_eq!(apart(&|z| at(if z < 5.0 { 9.0 } else { 29.0 })), [FIRST]);
    assert_eq!(apart(&|z| at(if z < 15.0 { 9.0 } else { 29.0 })), [FIRST + 1]);
    // A neck from one to the other, seen in one layer alone.
    let necked = |z: f64| match z {
        5.0 => vec![[9.0, 20.0, 6.0], [19.0, 20.0, 6.0], [29.0, 20.0, 6.0]],
        z => at(if z < 5.0 { 9.0 } else { 29.0 }),
    };
    let report = examined(necked, &[]);
    assert!(report.body.apart.is_empty(), "{:?}", report.body);
    // One that goes through is enough; where a contour is empty the body ends.
    assert!(apart(&|z| [at(if z < 5.0 { 9.0 } else { 29.0 }), vec![[20.0, 4.0, 3.0]]].concat()).is_empty());
    let ends = examined(|z| if z < 5.0 { at(9.0) } else { Vec::new() }, &[]);
    assert!(ends.body.apart.is_empty(), "{:?}", ends.body);
}

#[test]
fn ends_that_grow_beyond_their_contour_fail() {
    let report = examined(|z| vec![[16.0, 20.0, if z == -1.0 { 9.5 } else { 8.0 }]], &[]);
    assert!(report.body.beyond[0] > 50 && report.body.beyond[1] == 0, "{:?}", report.body);
    assert!(report.broken.iter().any(|b| b.contains("below the first contour")), "{:?}", report.broken);
}

/// A disc swells by 140 px from one contour to the next: what looks like a step beside them is its way, and no more than that. In the larger
/// image only every third pixel is looked at for it.
#[test]
fn a_surface_that_has_far_to_go_may_change_by_more() {
    for (side, within) in [(321, 3.0), (1201, 6.0)] {
        far_to_go(side, within);
    }
}

fn far_to_go(side: usize, within: f64) {
    let center = (side / 2) as f64;
    let disc = |radius: f64| {
        let inside = |n: usize| ((n % side) as f64 - center).hypot((n / side) as f64 - center) < radius;
        SliceContent::Mask((0..side * side).map(inside).collect())
    };
    let slice = |z: f64, radius: f64| Slice { name: format!("at {z}"), z, extra: false, content: disc(radius) };
    let stack = ContourStack {
        dims: [side; 2],
        spacing: [2.0; 2],
        unit: "mm".into(),
        slices: vec![slice(0.0, 10.0), slice(50.0, 150.0)],
        z_out: None,
        geometry: Geometry::default(),
        known: None,
    };
    let settings = Settings { method: Method::Field, ..Settings::default() };
    let body = interslice::reconstruct_with(&stack, &[25.0], &settings, &Reference, &Silent).expect("it can be");
    let mut report = body.report;
    assert_eq!(report.broken, [""; 0]);
    let above = report.contours[0].above.expect("it was looked at");
    assert!(above.jump > 0.12, "{above:?}");
    assert!(above.explained.is_some_and(|px| (px / (3.0 * BESIDE) - 140.0).abs() < within), "{above:?}");
    // The same change where the way is shorter, and a larger one.
    for wrong in [StepBeside { explained: Some(0.05), ..above }, StepBeside { jump: 0.5, ..above }] {
        report.contours[0].above = Some(wrong);
        report.judge();
        assert!(report.broken[0].contains("just above"), "{wrong:?}: {:?}", report.broken);
    }
}
