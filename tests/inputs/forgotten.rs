//! What is missing on an image of a stack, or too much, is said before the work (P14).

use crate::doubts::{SPACED, images, in_disc};

#[test]
fn an_image_left_blank_is_doubted() {
    let names = ["s0.png", "s1.png", "s2.png", "s3.png", "s4.png"];
    let disc = |blank: &'static [usize]| {
        move |x: u32, y: u32, k: usize| if in_disc(x, y, k) && !blank.contains(&k) { 255 } else { 0 }
    };
    images(&names, disc(&[2])).all_say(&SPACED, 0, "slice `s2.png` is empty between slices that are painted");
    images(&names, disc(&[0, 4])).none_doubts(&SPACED);
    images(&names, disc(&[1, 2])).none_doubts(&SPACED);
}

#[test]
fn a_part_that_one_image_lacks_is_doubted() {
    let names = ["s0.png", "s1.png", "s2.png", "s3.png", "s4.png"];
    // A disc and, but on some slices, a block beside it.
    let drawn = |without: &'static [usize]| {
        let block = |x: u32, y: u32| (2..8).contains(&x) && (2..9).contains(&y);
        let inside = move |x, y, k| in_disc(x, y, k) || block(x, y) && !without.contains(&k);
        move |x: u32, y: u32, k: usize| if inside(x, y, k) { 255 } else { 0 }
    };
    let told = "a part that the slices below and above have at the same place is not on slice `s2.png` at column 5, row 2 (42 px)";
    images(&names, drawn(&[2])).all_say(&SPACED, 0, told);
    images(&names, drawn(&[1, 2])).none_doubts(&SPACED);
    images(&names, drawn(&[3, 4])).none_doubts(&SPACED);
    // Of a slice that is said to be painted by mistake nothing else is.
    let stray =
        move |x: u32, y: u32, k: usize| if k == 2 { 255 * u8::from([x, y] == [25, 5]) } else { drawn(&[])(x, y, k) };
    let [(_, said), ..] = images(&names, stray).said(&SPACED);
    assert!(said.contains("painted by mistake") && !said.contains("left unpainted"), "{said}");
}

#[test]
fn a_hole_that_one_image_lacks_is_doubted() {
    let names = ["s0.png", "s1.png", "s2.png", "s3.png", "s4.png"];
    let drawn = |without: &'static [usize]| {
        let hole = |x: u32, y: u32| (12..18).contains(&x) && (11..18).contains(&y);
        move |x: u32, y: u32, k: usize| 255 * u8::from(in_disc(x, y, k) && (!hole(x, y) || without.contains(&k)))
    };
    let told = "a hole that the slices below and above have at the same place is not on slice `s2.png` at column 15, row 11 (42 px), so that the body is \
                there: was it filled?";
    images(&names, drawn(&[2])).all_say(&SPACED, 0, told);
    images(&names, drawn(&[1, 2])).none_doubts(&SPACED);
    images(&names, drawn(&[3, 4])).none_doubts(&SPACED);
}

#[test]
fn a_speck_is_doubted() {
    let names = ["s0.png", "s1.png", "s2.png", "s3.png", "s4.png"];
    let with = |specks: &'static [[usize; 3]]| {
        move |x: u32, y: u32, k: usize| {
            255 * u8::from(in_disc(x, y, k) || specks.contains(&[x as usize, y as usize, k]))
        }
    };
    let told = "1 px on slice `s1.png` at column 1, row 2, 2 px on slice `s3.png` at column 30, row 3: parts so small";
    images(&names, with(&[[1, 2, 1], [30, 3, 3], [31, 3, 3]])).all_say(&SPACED, 0, told);
    // On the next slice as well it is a thin part.
    images(&names, with(&[[1, 2, 1], [2, 2, 2]])).none_doubts(&SPACED);
    // At either end of the stack it may be a tip.
    images(&names, with(&[[1, 2, 0], [30, 3, 4]])).none_doubts(&SPACED);
}

#[test]
fn a_hole_of_a_pixel_or_two_is_doubted() {
    let names = ["s0.png", "s1.png", "s2.png", "s3.png", "s4.png"];
    let with = |holes: &'static [[usize; 3]]| {
        move |x: u32, y: u32, k: usize| {
            255 * u8::from(in_disc(x, y, k) && !holes.contains(&[x as usize, y as usize, k]))
        }
    };
    let told = "2 holes of at most 2 px lie in the midst of what is painted there and on the slices below and above (the first on slice `s1.png` at column 14, row 13)";
    images(&names, with(&[[14, 13, 1], [17, 16, 3], [18, 16, 3]])).all_say(&SPACED, 0, told);
    images(&names, with(&[[14, 13, 2]])).all_say(&SPACED, 0, "1 hole of at most 2 px lies in the midst");
    // On the next slice as well it is a thin channel; three pixels are a hole, and one at the rim is none.
    images(&names, with(&[[14, 13, 1], [14, 14, 2], [14, 14, 3]])).none_doubts(&SPACED);
    images(&names, with(&[[14, 13, 2], [15, 13, 2], [16, 13, 2]])).none_doubts(&SPACED);
}
