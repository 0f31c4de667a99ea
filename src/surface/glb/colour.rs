//! Base colours: linear RGBA.

use crate::stack::appearance::Appearance;

/// A body of which nothing is known: warm grey.
const BODY: [f32; 4] = [0.71, 0.60, 0.45, 1.0];
/// Saturation and value of colours that tell labels apart.
const SATURATION: f32 = 0.45;
const VALUE: f32 = 0.9;
/// The golden section: hues of following numbers lie far apart.
const TURN: f64 = 0.618_033_988_749_895;

/// The colour that the input gives, else one of its number's own, else warm grey.
pub(super) fn base(appearance: &Appearance) -> [f32; 4] {
    if (appearance.colour, appearance.number) == (None, None) {
        return BODY;
    }
    let [r, g, b] = shown(appearance).map(linear);
    [r, g, b, 1.0]
}

/// The same in sRGB, as shares of 1; a body of which nothing is known has the colour of number 1.
pub(in crate::surface) fn shown(appearance: &Appearance) -> [f32; 3] {
    match (appearance.colour, appearance.number) {
        (Some(colour), _) => colour.map(|c| f32::from(c) / 255.0),
        (None, number) => of_hue((number.unwrap_or(1) as f64 * TURN).rem_euclid(1.0) as f32),
    }
}

/// A hue in turns as sRGB.
fn of_hue(hue: f32) -> [f32; 3] {
    [0.0, 2.0 / 3.0, 1.0 / 3.0].map(|shift: f32| {
        let at = ((hue + shift).fract() * 6.0 - 3.0).abs() - 1.0;
        VALUE * (1.0 - SATURATION * (1.0 - at.clamp(0.0, 1.0)))
    })
}

/// IEC 61966-2-1.
fn linear(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { libm::powf((v + 0.055) / 1.055, 2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_hues_of_their_own() {
        assert_eq!(of_hue(0.0), [VALUE, VALUE * (1.0 - SATURATION), VALUE * (1.0 - SATURATION)]);
        let of = |number| base(&Appearance::label(number));
        let far = |a: [f32; 4], b: [f32; 4]| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
        for n in -20..20 {
            assert_eq!(of(n), of(n));
            for other in n + 1..n + 5 {
                assert!(far(of(n), of(other)) > 0.1, "{n} {other}");
            }
        }
        let red = Appearance { colour: Some([255, 0, 0]), ..Appearance::label(3) };
        assert_eq!(base(&red), [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(base(&Appearance::default()), BODY);
    }
}
