//! Contours that were drawn twice, nearly.

use interslice::input::read;
use interslice::stack::ReadOptions;

use super::checks::*;
use crate::files::folder;
use crate::rtss::*;

/// The circle drawn with 91 points for 90.
fn resampled(radius: f64, z: f64) -> Points {
    let at = |k: usize| std::f64::consts::TAU * k as f64 / 91.0;
    (0..91).map(|k| [100.0 + radius * at(k).cos(), -50.0 + radius * at(k).sin(), z]).collect()
}

fn moved(by: f64, z: f64) -> Points {
    circle(20.0, z).into_iter().map(|[x, y, z]| [x + by, y, z]).collect()
}

#[test]
fn contours_that_nearly_coincide_are_one() {
    let place = folder();
    let path = place.path().join("a.dcm");
    let with = |again: Points| [tube(20.0, &[0.0, 4.0, 8.0]), vec![(CLOSED, again)]].concat();
    let rois = [
        ("height", with(circle(20.0, 4.05))),
        ("beside", with(moved(1e-4, 4.0))),
        ("points", with(resampled(20.0, 4.0))),
        ("ring", with(circle(19.7, 4.0))),
    ];
    write(&rois, &path);
    let input = path.display().to_string();
    let out = place.path().join("a.json").display().to_string();
    for (number, (roi, _)) in rois.iter().enumerate() {
        let of_pixels = [Some(0.5), None].map(|pixel| {
            let options = ReadOptions { roi: vec![(*roi).into()], pixel, ..ReadOptions::default() };
            read(&path, &options).expect("the file is sound")
        });
        let told = format!("ROI {} (`{roi}`): contours 2 and 4 nearly coincide, at most ", number + 1);
        let said = said(&["reconstruct", &input, "--roi", roi, "-o", &out, "--backend", "cpu"], 0);
        if *roi == "ring" {
            assert!(!said.contains("coincide"), "{said}");
            of_pixels.iter().for_each(|stack| assert!(area(stack, 1) < 0.1 * disc(20.0), "a wall of 0.3 mm stays"));
        } else {
            assert_says(&said, &[&told, "and would cancel; contour 4 left out"]);
            of_pixels.iter().for_each(|stack| assert_near(area(stack, 1), disc(20.0), 0.02 * disc(20.0)));
        }
    }
}

#[test]
fn polygons_that_nearly_coincide_are_one() {
    let place = folder();
    let file = place.path().join("stack.json");
    let flat = |points: Points| points.into_iter().map(|[x, y, _]| [x, y]).collect::<Vec<_>>();
    for (again, apart) in [(moved(1e-4, 0.0), true), (resampled(20.0, 0.0), true), (circle(19.0, 0.0), false)] {
        let slice = |z: f64| match z {
            4.0 => serde_json::json!({"z": z, "polygons": [flat(circle(20.0, 0.0)), flat(again.clone())]}),
            _ => serde_json::json!({"z": z, "polygons": [flat(circle(20.0, 0.0))]}),
        };
        let stack = serde_json::json!({"unit": "mm", "slices": [slice(0.0), slice(4.0), slice(8.0)]});
        std::fs::write(&file, stack.to_string()).expect("a file can be written");
        let told = "`polygons 1` at 4: polygons 1 and 2 nearly coincide, at most ";
        let said = said(&["inspect", &file.display().to_string()], 0);
        assert_eq!(said.contains(told), apart, "{said}");
        let stack = read(&file, &ReadOptions::default()).expect("the file is sound");
        let wanted = if apart { disc(20.0) } else { disc(20.0) - disc(19.0) };
        assert_near(area(&stack, 1), wanted, 0.02 * disc(20.0));
    }
}
