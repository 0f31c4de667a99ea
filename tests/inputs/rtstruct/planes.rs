//! Planes that contours lie on: uneven, noisy, oblique, chosen.

use std::f64::consts::TAU;
use std::fs;

use glam::DVec3;
use interslice::input::read;
use interslice::stack::ReadOptions;

use super::checks::*;
use crate::files::folder;
use crate::rtss::*;

#[test]
fn planes_are_found_from_points_with_noise_and_uneven_gaps() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let noisy = |z: f64| {
        let points = circle(10.0, z).into_iter().enumerate();
        points.map(|(k, [x, y, z])| [x, y, z + 0.02 * (k as f64).sin()]).collect::<Points>()
    };
    let far = |z: f64| circle(5.0, z).into_iter().map(|[x, y, z]| [x + 40.0, y, z + 0.04]).collect::<Points>();
    let contours = vec![(CLOSED, noisy(9.5)), (CLOSED, noisy(0.0)), (CLOSED, far(0.0)), (CLOSED, noisy(2.5))];
    write(&[("a", contours)], &path);
    let stack = stack(&path, &[]);
    let heights: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
    assert_eq!(heights.len(), 3);
    [0.02, 2.5, 9.5].into_iter().zip(&heights).for_each(|(w, z)| assert_near(*z, w, 0.01));
    assert_near(area(&stack, 0), disc(10.0) + disc(5.0), 5.0);
    assert_says(&said(&["inspect", &path.display().to_string()], 0), &["3 planes", "1 gap of 2.4", "1 gap of 7"]);
    // Noise beyond the tolerance is told.
    let bent = circle(10.0, 5.0).into_iter().enumerate().map(|(k, [x, y, z])| [x, y, z + 0.01 * k as f64]).collect();
    write(&[("a", vec![(CLOSED, circle(9.0, 0.0)), (CLOSED, bent)])], &path);
    let refused = said(&["inspect", &path.display().to_string()], 2);
    assert_says(&refused, &["a.dcm", "ROI 1 (`a`), contour 2", "leaves its plane", "at most 0.1 mm"]);
}

#[test]
fn oblique_planes_have_their_own_frame_and_meshes_lie_in_the_patient() {
    let place = folder();
    let path = place.path().join("a.dcm");
    // A tube along n, drawn on planes across it, rounded to 0.01 mm as planning systems do.
    let n = DVec3::new(0.36, 0.48, 0.8);
    let (u, v) = (DVec3::new(0.8, -0.6, 0.0), DVec3::new(0.48, 0.64, -0.6));
    let start = DVec3::new(12.0, -230.0, 88.0);
    let ring = |h: f64| -> Points {
        (0..120)
            .map(|k| {
                let t = TAU * k as f64 / 120.0;
                let p = start + h * n + 15.0 * (t.cos() * u + t.sin() * v);
                ((p * 100.0).round() / 100.0).to_array()
            })
            .collect()
    };
    write(&[("tube", [0.0, 5.0, 10.0, 20.0].map(|h| (CLOSED, ring(h))).to_vec())], &path);
    let out = place.path().join("a.obj");
    let text = said(&["inspect", &path.display().to_string()], 0);
    assert_says(&text, &["oblique, normal (0.36", "4 planes"]);
    said(&["reconstruct", &path.display().to_string(), "-o", &out.display().to_string(), "-q", "--backend", "cpu"], 0);
    let mesh = fs::read_to_string(&out).expect("it was written");
    let vertices: Vec<DVec3> = mesh
        .lines()
        .filter_map(|l| l.strip_prefix("v "))
        .map(|l| {
            let v: Vec<f64> = l.split_whitespace().take(3).map(|t| t.parse().expect("a number")).collect();
            DVec3::from_slice(&v)
        })
        .collect();
    assert!(vertices.len() > 1000);
    for p in &vertices {
        let along = (p - start).dot(n);
        let from_axis = (p - start).reject_from_normalized(n).length();
        assert!((-0.05..20.05).contains(&along), "{p:?} lies at {along}");
        // Lids lie inside.
        let lid = !(0.05..=19.95).contains(&along);
        assert!(from_axis < 15.15 && (lid || from_axis > 14.85), "{p:?} is {from_axis} from the axis");
    }
}

#[test]
fn planes_can_be_chosen() {
    let place = folder();
    let path = place.path().join("a.dcm");
    write(&[("a", tube(10.0, &[0.0, 3.0, 6.0, 9.0, 12.0]))], &path);
    let heights =
        |options: ReadOptions| read(&path, &options).map(|s| s.slices.iter().map(|s| s.z).collect::<Vec<_>>());
    let of = |slices: &[usize]| ReadOptions { slices: Some(slices.to_vec()), ..ReadOptions::default() };
    assert_eq!(heights(of(&[4, 0, 2])).expect("they are there"), [0.0, 6.0, 12.0]);
    assert_eq!(heights(ReadOptions { keep: Some(3), ..ReadOptions::default() }).expect("they are there"), [0.0, 9.0]);
    assert!(heights(of(&[0, 5])).expect_err("there is no plane 5").to_string().contains("planes 0 to 4; got 5"));
    assert!(heights(of(&[1])).expect_err("one is too few").to_string().contains("at least 2"));
}
