//! The topology zoo: stacks of small contours.

use super::{Shape, circle, nothing, square, union, without};

/// Pixels to a side.
pub const N: usize = 90;

pub fn disc(y: f64, x: f64, r: f64) -> Shape {
    circle(x, y, r)
}

/// A bar of width `w` and length 50 through the middle.
pub fn bar(w: f64, angle: f64) -> Shape {
    let (c, s) = (angle.cos(), angle.sin());
    Box::new(move |x, y| {
        let (u, v) = ((y - 45.0) * c + (x - 45.0) * s, (x - 45.0) * c - (y - 45.0) * s);
        (u.abs() - 0.5 * w).max(v.abs() - 25.0)
    })
}

pub fn ring() -> Shape {
    without(disc(45.0, 45.0, 25.0), disc(45.0, 45.0, 12.0))
}

/// The ring, open to the right.
pub fn letter_c() -> Shape {
    without(ring(), Box::new(|x, y| ((y - 45.0).abs() - 6.0).max(45.0 - x)))
}

/// Every way in which contours can relate, by name.
pub fn zoo() -> Vec<(&'static str, Vec<Shape>)> {
    let four = || {
        union(union(disc(30.0, 30.0, 9.0), disc(30.0, 60.0, 9.0)), union(disc(60.0, 30.0, 9.0), disc(60.0, 60.0, 9.0)))
    };
    let cross = |angle: f64| union(bar(8.0, angle), bar(8.0, angle + std::f64::consts::FRAC_PI_2));
    vec![
        ("one_to_one", vec![disc(45.0, 45.0, 20.0), disc(47.0, 44.0, 14.0)]),
        ("hole_born_and_dead", vec![disc(45.0, 45.0, 25.0), ring(), disc(45.0, 45.0, 25.0)]),
        ("hole_appears", vec![disc(45.0, 45.0, 22.0), ring(), ring()]),
        (
            "tiny_hole_off_centre",
            vec![
                disc(45.0, 45.0, 25.0),
                without(disc(45.0, 45.0, 25.0), disc(40.0, 52.0, 2.0)),
                disc(45.0, 45.0, 25.0),
            ],
        ),
        ("island_in_hole", vec![union(ring(), disc(45.0, 45.0, 5.0)), disc(45.0, 45.0, 27.0), ring()]),
        ("island_dies_in_hole", vec![union(ring(), disc(45.0, 45.0, 5.0)), ring(), ring()]),
        ("disjoint", vec![disc(30.0, 30.0, 9.0), disc(62.0, 62.0, 9.0), disc(30.0, 62.0, 9.0)]),
        (
            "appearing",
            vec![disc(45.0, 30.0, 12.0), union(disc(45.0, 30.0, 12.0), disc(45.0, 68.0, 8.0)), disc(45.0, 30.0, 12.0)],
        ),
        (
            "one_to_two",
            vec![
                disc(45.0, 45.0, 16.0),
                union(disc(45.0, 30.0, 10.0), disc(45.0, 60.0, 10.0)),
                union(disc(45.0, 25.0, 8.0), disc(45.0, 65.0, 8.0)),
            ],
        ),
        (
            "two_to_one",
            vec![union(disc(45.0, 28.0, 14.0), disc(50.0, 66.0, 5.0)), disc(46.0, 40.0, 26.0), disc(45.0, 45.0, 10.0)],
        ),
        ("one_to_four", vec![disc(45.0, 45.0, 20.0), four()]),
        ("four_to_four", vec![four(), union(bar(8.0, 0.0), bar(8.0, 1.57)), four()]),
        ("empty_middle", vec![disc(45.0, 45.0, 20.0), nothing(), disc(45.0, 45.0, 16.0)]),
        ("empty_ends", vec![nothing(), disc(45.0, 45.0, 20.0), nothing()]),
        ("identical", vec![ring(), ring(), ring()]),
        ("thin_line", vec![bar(1.0, 0.0), bar(1.0, 0.15), bar(1.0, 0.3)]),
        ("thin_diagonal", vec![bar(2.2, 0.8), bar(2.2, 0.9), bar(2.2, 1.2)]),
        ("single_pixel", vec![disc(45.0, 45.0, 0.8), disc(45.0, 46.0, 0.8), disc(45.0, 45.0, 12.0)]),
        (
            "square_to_circle",
            vec![square(45.0, 45.0, 24.0, 0.0), disc(45.0, 45.0, 24.0), square(45.0, 45.0, 24.0, 0.7)],
        ),
        ("small_in_big", vec![disc(45.0, 45.0, 28.0), disc(30.0, 50.0, 3.0), disc(45.0, 45.0, 28.0)]),
        ("cross_to_blob", vec![cross(0.0), disc(50.0, 40.0, 10.0), cross(0.78)]),
        ("letters_c_to_o", vec![letter_c(), ring(), disc(45.0, 45.0, 20.0)]),
        (
            "at_the_border",
            vec![disc(0.0, 40.0, 20.0), disc(10.0, 45.0, 20.0), union(disc(89.0, 89.0, 6.0), disc(5.0, 45.0, 30.0))],
        ),
        ("barely_overlapping", vec![disc(45.0, 30.0, 10.0), disc(45.0, 48.9, 10.0), disc(62.0, 55.0, 11.5)]),
        ("full_image", vec![disc(45.0, 45.0, 200.0), disc(45.0, 45.0, 20.0)]),
    ]
}
