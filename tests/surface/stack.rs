//! Stacks made by hand and folders of images: what the library checks and takes.

use std::fs;

use crate::files::*;
use crate::shapes::{circle, levels, masks};
use glam::DVec3;
use interslice::input::read;
use interslice::settings::EndRule;
use interslice::stack::{Geometry, HeightGrid, LevelSlice, ReadOptions, SliceContent};
use interslice::{Settings, height_grid, reconstruct};

#[test]
fn heights_that_are_no_numbers_are_refused_by_name() {
    let mut stack = masks(40, &[0.0, 5.0, 10.0], &[9.0, 8.0, 7.0].map(|r| circle(19.0, 19.0, r)));
    stack.slices[1].z = f64::NAN;
    let message = reconstruct(&stack, &Settings::default()).expect_err("NaN is no height").to_string();
    assert!(message.contains("slice 1 (`slice 1`)") && message.contains("NaN"), "{message}");
    stack.slices[1].z = f64::INFINITY;
    assert!(reconstruct(&stack, &Settings::default()).is_err());
    stack.slices[1].z = 5.0;
    stack.slices[2].content = SliceContent::Mask([true; 7].into_iter().collect());
    let message = reconstruct(&stack, &Settings::default()).expect_err("seven pixels are no slice").to_string();
    assert!(message.contains("slice 2") && message.contains("7 pixels") && message.contains("40x40"), "{message}");
    let mut grey = levels(40, &[0.0, 5.0], &[9.0, 8.0].map(|r| circle(19.0, 19.0, r)));
    let SliceContent::Level(u) = &mut grey.slices[1].content else { panic!("levels were asked for") };
    let mut values = u.values();
    values[85] = f32::NAN;
    *u = LevelSlice::new(&values, 40);
    let message = grey.validate().expect_err("NaN is no value").to_string();
    assert!(message.contains("slice 1") && message.contains("pixel (5, 2)"), "{message}");
}

#[test]
fn output_heights_near_a_contour_are_the_contours() {
    let mut stack = masks(40, &[0.0, 5.0, 10.0], &[9.0, 8.0, 7.0].map(|r| circle(19.0, 19.0, r)));
    stack.z_out = Some(HeightGrid { start: -2.000_001, step: 1.0, count: 14 });
    let body = reconstruct(&stack, &Settings::default()).expect("the stack is valid");
    let contours: Vec<_> = body.layers.iter().filter(|l| l.contour.is_some()).map(|l| (l.z, l.output)).collect();
    assert_eq!(contours, [(0.0, true), (5.0, true), (10.0, true)], "1e-6 is within 1e-6 of a gap of 5");
    assert_eq!(body.output_layers().count(), 14);
    assert!(body.layers.windows(2).all(|w| w[0].z < w[1].z));
    // Beyond flat ends there is nothing.
    assert!(body.layers.iter().filter(|l| l.z < 0.0 || l.z > 10.0).all(|l| l.phi.iter().all(|v| *v > 0.0)));
    stack.z_out = Some(HeightGrid { start: 0.25, step: 1.0, count: 3 });
    let body = reconstruct(&stack, &Settings::default()).expect("the stack is valid");
    assert!(body.report.contours.iter().all(|c| c.differing_pixels == 0), "checked though no output height lies there");
    assert_eq!(body.output_layers().count(), 3);
}

#[test]
fn the_default_grid_covers_the_body_with_its_ends() {
    let mut stack = masks(40, &[2.0, 6.0, 10.0], &[9.0, 8.0, 7.0].map(|r| circle(19.0, 19.0, r)));
    stack.spacing = [0.5, 0.8];
    let grid = |settings: &Settings, dz| {
        let g = height_grid(&stack, settings, dz);
        (g.start, g.step, g.count)
    };
    assert_eq!(grid(&Settings::default(), None), (2.0, 0.5, 17));
    assert_eq!(grid(&Settings::default(), Some(2.0)), (2.0, 2.0, 5));
    let ends = Settings { end_bottom: EndRule::HalfSlice, end_top: EndRule::Peak(13.1), ..Settings::default() };
    assert_eq!(grid(&ends, Some(1.0)), (0.0, 1.0, 14));
}

#[test]
fn tiff_slices_and_grey_saved_as_colour_are_taken() {
    let place = folder();
    let text = sound_stack(place.path());
    let from = |k: usize| image::open(place.path().join(format!("s{k}.png"))).expect("it was written");
    from(0).to_luma8().save(place.path().join("s0.tif")).expect("a TIFF can be written");
    from(1).to_rgb8().save(place.path().join("s1.png")).expect("a PNG can be written");
    let options = ReadOptions::default();
    let plain = read(place.path(), &options).expect("the stack is sound");
    write_stack(place.path(), &text.replace("s0.png", "s0.tif"));
    let stack = read(place.path(), &options).expect("the stack is sound");
    for (a, b) in plain.slices.iter().zip(&stack.slices) {
        assert!((0..a.content.len()).all(|n| a.content.inside(n) == b.content.inside(n)), "{}", b.name);
    }
    assert!(!stack.slices[0].content.is_empty());
}

#[test]
fn sixteen_bit_labels_of_one_value_are_masks_and_extras_are_marked() {
    let place = folder();
    let text = sound_stack(place.path());
    for k in 0..3u32 {
        let image = image::ImageBuffer::<image::Luma<u16>, _>::from_fn(32, 32, |x, y| {
            image::Luma([if x.abs_diff(15) + y.abs_diff(15) < 8 + k { 40_000 } else { 100 }])
        });
        image.save(place.path().join(format!("s{k}.png"))).expect("a PNG can be written");
    }
    write_stack(place.path(), &text.replace("\"z\": 4.0", "\"z\": 4.0, \"extra\": true"));
    let stack = read(place.path(), &ReadOptions::default()).expect("the stack is sound");
    assert!(stack.slices.iter().all(|s| matches!(s.content, SliceContent::Mask(_))));
    assert_eq!(stack.slices.iter().map(|s| s.extra).collect::<Vec<_>>(), [false, true, false]);
    let body = reconstruct(&stack, &Settings::default()).expect("the stack is valid");
    assert_eq!(body.report.contours.iter().map(|c| c.extra).collect::<Vec<_>>(), [false, true, false]);
    // One slice of another depth is refused.
    let image = image::GrayImage::new(32, 32);
    image.save(place.path().join("s2.png")).expect("a PNG can be written");
    let message = read(place.path(), &ReadOptions::default()).expect_err("depths differ").to_string();
    assert!(
        message.contains("slice 2 (`s2.png`)") && message.contains("8 bits per pixel, but slice 0 has 16"),
        "{message}"
    );
    fs::remove_file(place.path().join("s2.png")).expect("it is there");
}

#[test]
fn places_and_directions_are_lists_of_numbers_in_files() {
    let axes = [DVec3::Y, DVec3::Z, DVec3::X];
    let geometry = Geometry { origin: DVec3::new(1.0, -2.5, 1e7), axes, order: [1, 2, 0], ..Geometry::default() };
    let text = r#"{"origin":[1.0,-2.5,10000000.0],"axes":[[0.0,1.0,0.0],[0.0,0.0,1.0],[1.0,0.0,0.0]],"order":[1,2,0]}"#;
    assert_eq!(serde_json::to_string(&geometry).expect("it can be told"), text);
    assert_eq!(serde_json::from_str::<Geometry>(text).expect("it is sound"), geometry);
    assert!(serde_json::from_str::<Geometry>(&text.replace("[1.0,-2.5,", "[-2.5,")).is_err());
    assert!(serde_json::from_str::<Geometry>(&text.replace("[1.0,-2.5,", "[0.0,1.0,-2.5,")).is_err());
}
