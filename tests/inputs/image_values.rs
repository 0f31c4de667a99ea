//! Folders of images: which of their values are inside, which are labels, and what is doubted of them (P14).

use std::fs;

use crate::doubts::{Case, SPACED, images, in_ball, in_disc, volume};
use crate::files::*;
use interslice::input::Input;
use interslice::stack::ReadOptions;
use interslice::stack::options::LabelName;

#[test]
fn drawings_black_on_white_are_doubted() {
    let names = ["s0.png", "s1.png", "s2.png"];
    let told = "nearly all of the images' border is inside on every slice";
    images(&names, |x, y, k| if in_disc(x, y, k) { 0 } else { 255 }).all_say(&SPACED, 0, told);
    // A sheet that is left white is one of them.
    images(&names, |x, y, k| if k > 0 && in_disc(x, y, k) { 0 } else { 255 }).all_say(&SPACED, 0, told);
    images(&names, |x, y, k| if in_disc(x, y, k) { 255 } else { 0 }).none_doubts(&SPACED);
    let inverted = [&SPACED[..], &["--invert"]].concat();
    images(&names, |x, y, k| if in_disc(x, y, k) { 0 } else { 255 }).none_doubts(&inverted);
    images(&names, |x, y, k| if in_disc(x, y, k) { 255 } else { 0 }).all_say(&inverted, 0, "Without --invert it is");
    images(&names, |_, _, _| 0).all_say(&inverted, 0, "nothing is white on any slice");
    let whole = volume(|at| u16::from(at[2] % 5 == 1));
    Case::new(&whole, "1 1 1").none_doubts(&[]);
    // A block with a hole that only some slices show in full width.
    images(&names, |x, _, k| if k == 1 && x > 20 { 0 } else { 255 }).none_doubts(&SPACED);
    let voxels = volume(|at| u16::from(at[2] % 5 == 1 && !in_ball(at, 13.0)));
    Case::new(&voxels, "1 1 1").all_say(&[], 0, told);
}

#[test]
fn images_are_in_the_order_of_their_numbers_and_others_than_png_and_tiff_are_named() {
    let named = ["z_-10.png", "z_-5.png", "z_0.png", "z_5.png"];
    let case = images(&named, |x, y, k| if in_disc(x, y, k) { 255 } else { 0 });
    let options = ReadOptions { spacing: Some(vec![1.0, 1.0, 5.0]), ..ReadOptions::default() };
    let stack = Input::read(&case.input, &options).expect("it is sound").stack;
    assert!(stack.slices.iter().map(|slice| &slice.name).eq(&named));
    let case = images(&[], |_, _, _| 0);
    for name in ["s0.bmp", "s1.JPG", "s2.jpg"] {
        fs::write(case.place.path().join(name), "is not opened").expect("a file can be written");
    }
    case.all_say(&SPACED, 2, "it has 2 .jpg: save them as PNG or TIFF");
}

/// Value of a pixel of [`rings`] of radius `r`, where they are not smooth.
fn ring([near, middle, far]: [u8; 3], r: f64, x: u32, y: u32) -> u8 {
    match (f64::from(x) - 15.5).hypot(f64::from(y) - 15.5) - r {
        d if d < -4.0 => far,
        d if d < 0.0 => middle,
        _ => near,
    }
}

/// Radii of the slices of [`rings`].
const RADII: [f64; 3] = [8.0, 10.0, 7.0];

/// Slices of rings: a value within, another one without.
fn rings(values: [u8; 3], smooth: bool) -> Case {
    let place = folder();
    for (k, r) in RADII.into_iter().enumerate() {
        let smoothed = |x: u32, y: u32| match (f64::from(x) - 15.5).hypot(f64::from(y) - 15.5) - r {
            d if d < -0.5 => values[2],
            d if d < 0.5 => values[1],
            _ => values[0],
        };
        let value = |x: u32, y: u32| if smooth { smoothed(x, y) } else { ring(values, r, x, y) };
        let image = image::GrayImage::from_fn(32, 32, |x, y| image::Luma([value(x, y)]));
        image.save(place.path().join(format!("s{k}.png"))).expect("a PNG can be written");
    }
    let text = r#"{"spacing_xy": [1, 1], "slices": [{"file": "s0.png", "z": 0}, {"file": "s1.png", "z": 4},
        {"file": "s2.png", "z": 8}]}"#;
    write_stack(place.path(), text);
    let input = place.path().to_path_buf();
    Case { place, input }
}

#[test]
fn p14_of_a_few_values_one_is_asked_for() {
    rings([0, 127, 255], false).all_say(
        &[],
        2,
        "slices have 3 values, 0, 127, 255: which of them is the body? `--label N`",
    );
    rings([0, 127, 255], false).none_doubts(&["--level", "100"]);
    rings([0, 127, 255], false).none_doubts(&["--label", "127"]);
    rings([0, 127, 255], false).all_say(
        &["--label", "3"],
        2,
        "`label` must be a value of the pixels (0, 127, 255); got 3",
    );
    rings([0, 127, 255], false).all_say(
        &["--label", "ring"],
        2,
        "`label` is the value of the pixels in a folder of images",
    );
    rings([0, 127, 255], true).none_doubts(&[]);
    rings([0, 255, 255], false).none_doubts(&[]);
}

#[test]
fn a_label_is_one_value_of_images() {
    let values = [0, 127, 255];
    let case = rings(values, false);
    for wanted in [127, 255] {
        let label = Some(LabelName::Number(i64::from(wanted)));
        let stack =
            Input::read(&case.input, &ReadOptions { label, ..ReadOptions::default() }).expect("it is sound").stack;
        for (slice, r) in stack.slices.iter().zip(RADII) {
            let inside = |n: u32| ring(values, r, n % 32, n / 32) == wanted;
            assert!((0..32 * 32).all(|n| slice.content.inside(n as usize) == inside(n)), "{wanted}: {}", slice.name);
        }
    }
}

/// Bands of two columns, each brighter by `step` than the one before, on two slices.
fn bands(count: u32, step: u32) -> Result<Input, String> {
    let place = folder();
    let image = image::GrayImage::from_fn(2 * count, 8, |x, _| image::Luma([(x / 2 * step) as u8]));
    image.save(place.path().join("s.png")).expect("a PNG can be written");
    let text = r#"{"spacing_xy": [1, 1], "slices": [{"file": "s.png", "z": 0}, {"file": "s.png", "z": 4}]}"#;
    write_stack(place.path(), text);
    Input::read(place.path(), &ReadOptions::default()).map_err(|e| e.to_string())
}

#[test]
fn p14_values_that_leap_from_one_to_the_next_are_labels_and_others_grey() {
    for few in [3, 16] {
        let said = bands(few, 10).expect_err("a few values");
        assert!(said.contains(&format!("slices have {few} values, 0, 10, 20")), "{said}");
    }
    for (many, step) in [(17, 15), (25, 4)] {
        let said = bands(many, step).expect_err("labels");
        assert!(said.contains("slices have more than 16 values") && said.contains("as of labels"), "{said}");
    }
    // A field that rises as slowly, in smaller steps: what lies above half way is the body.
    let stack = bands(100, 2).expect("grey values").stack;
    assert!((0..200).all(|x| stack.slices[0].content.inside(x) == (x / 2 * 2 > 99)));
}

/// Cells of 25 numbers on each image, as programs that find cells write them, and what their levels would make of them.
#[test]
fn images_of_many_labels_are_no_grey_values() {
    let cell = |x: u32, y: u32| {
        let near = (x % 6).abs_diff(3).pow(2) + (y % 6).abs_diff(3).pow(2) <= 6;
        if near { (1 + x / 6 + 5 * (y / 6)) as u8 } else { 0 }
    };
    let case = images(&["s0.png", "s1.png", "s2.png"], |x, y, _| cell(x, y));
    case.all_say(&SPACED, 2, "slices have more than 16 values");
    case.none_doubts(&["--spacing", "1,1,4", "--label", "7"]);
    // The same cells with noise, as in a picture.
    let noise = |x: u32, y: u32, k: usize| (x * 7 + y * 13 + x * y * 5 + k as u32 * 3) % 11;
    let picture = |x, y, k| 100 * u8::from(cell(x, y) > 0) + noise(x, y, k) as u8;
    let case = || images(&["s0.png", "s1.png", "s2.png"], picture);
    case().all_say(&SPACED, 0, "inside is what is above 55, half way of the slices' values; --level V names another");
    case().none_doubts(&["--spacing", "1,1,4", "--level", "55"]);
}

/// A pixel that is far brighter, or darker, than all others draws the range of values, and half way there is no body.
#[test]
fn a_level_that_an_odd_pixel_has_drawn_away_is_not_taken() {
    let names = ["s0.png", "s1.png", "s2.png", "s3.png"];
    let odd = |x: u32, y: u32, k: usize| (x, y, k) == (3, 3, 1);
    let picture =
        |x: u32, y: u32, k: usize| 20 + 40 * u8::from(in_disc(x, y, k)) + (x * 7 + y * 13 + x * y * 5) as u8 % 11;
    images(&names, picture).all_say(&SPACED, 0, "inside is what is above 45, half way");
    let hot = || images(&names, |x, y, k| if odd(x, y, k) { 255 } else { picture(x, y, k) });
    hot().all_say(&SPACED, 2, "1 lie above half way (137.5): --level V must name what bounds the body");
    hot().all_say(
        &["--spacing", "1,1,4", "--level", "45"],
        0,
        "1 px on slice `s1.png` at column 3, row 3: parts so small",
    );
    let light = |x, y, k| 255 - picture(x, y, k);
    let dead = images(&names, |x, y, k| if odd(x, y, k) { 0 } else { light(x, y, k) });
    dead.all_say(&SPACED, 2, "1 lie below half way (117.5)");
    // A small body on a large sheet, smoothed, is no odd pixel.
    let small = |x: u32, y: u32| [255, 128, 60].get((x.abs_diff(9) + y.abs_diff(8)) as usize).copied().unwrap_or(0);
    images(&names, |x, y, _| small(x, y)).none_doubts(&SPACED);
}
