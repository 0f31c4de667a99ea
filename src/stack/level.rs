//! An implicit function on a slice, kept where it tells where the contour runs: memory follows the contour, not the image.

use super::mask::Mask;

/// An implicit function, row-major, negative inside; its zero set is the contour (0 counts as outside). Beyond the image is outside.
///
/// Pixels with no other side beside them keep nothing but their own side: no contour runs next to them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LevelSlice {
    sides: Mask,
    /// Pixels whose values are kept, increasing, and those values.
    near: Vec<(usize, f32)>,
    largest: f32,
}

impl LevelSlice {
    /// The slice with these values of all pixels, of which a row has `nx`: as many as the stack's rows, else values beside the contour are lost.
    pub fn new(values: &[f32], nx: usize) -> Self {
        let nx = nx.max(1);
        let mut near = Vec::new();
        // Sides of a row and of those before and after it, with what lies beyond either end.
        let mut sides = [(); 3].map(|()| vec![false; nx + 2]);
        let read = |to: &mut [bool], row: Option<&[f32]>| {
            to.fill(false);
            to[1..].iter_mut().zip(row.unwrap_or_default()).for_each(|(inside, v)| *inside = *v < 0.0);
        };
        let mut rows = values.chunks(nx);
        read(&mut sides[2], rows.next());
        let mut kept = vec![false; nx];
        for (first, row) in (0..).step_by(nx).zip(values.chunks(nx)) {
            sides.rotate_left(1);
            read(&mut sides[2], rows.next());
            let [before, own, after] = sides.each_ref().map(|side| &side[..nx + 2]);
            for (i, (kept, v)) in kept.iter_mut().zip(row).enumerate() {
                let side = own[i + 1];
                let other = (own[i] != side) | (own[i + 2] != side) | (before[i + 1] != side) | (after[i + 1] != side);
                // Values that are no numbers are kept for whoever checks the slice.
                *kept = other | !v.is_finite();
            }
            let of_row = kept.iter().zip(row).enumerate().filter(|(_, (kept, _))| **kept);
            near.extend(of_row.map(|(i, (_, v))| (first + i, *v)));
        }
        near.shrink_to_fit();
        let largest = values.iter().fold(f32::MIN_POSITIVE, |a, v| a.max(v.abs()));
        LevelSlice { sides: values.iter().map(|v| *v < 0.0).collect(), near, largest }
    }

    /// This contour on other pixels: their sides, and the values of those beside one of the other side, increasing.
    pub(super) fn with(&self, sides: Mask, near: Vec<(usize, f32)>) -> Self {
        LevelSlice { sides, near, largest: self.largest }
    }

    /// The sides of all pixels.
    pub fn sides(&self) -> &Mask {
        &self.sides
    }

    /// Pixels beside one of the other side, increasing, and their values.
    pub fn near(&self) -> &[(usize, f32)] {
        &self.near
    }

    /// Value of pixel `node`: the one that is kept, else the largest with the side's sign.
    pub fn value(&self, node: usize) -> f32 {
        match self.near.binary_search_by_key(&node, |(n, _)| *n) {
            Ok(k) => self.near[k].1,
            Err(_) if self.sides.at(node) => -self.largest,
            Err(_) => self.largest,
        }
    }

    /// A value for every pixel: those that are kept, else the largest with the side's sign.
    pub fn values(&self) -> Vec<f32> {
        let mut values: Vec<f32> =
            self.sides.iter().map(|inside| if inside { -self.largest } else { self.largest }).collect();
        self.near.iter().for_each(|(n, v)| values[*n] = *v);
        values
    }

    /// Largest absolute value of any pixel.
    pub fn largest(&self) -> f32 {
        self.largest
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        self.sides.bytes() + size_of_val(&*self.near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_beside_another_side_are_kept_and_all_sides() {
        let (nx, ny) = (50, 40);
        // Two discs, one of which leaves the image, and a pixel on the contour.
        let value = |n: usize| {
            let (x, y) = ((n % nx) as f32, (n / nx) as f32);
            ((x - 12.0).hypot(y - 20.0) - 8.0).min((x - 49.0).hypot(y - 3.0) - 9.5)
        };
        let values: Vec<f32> = (0..nx * ny).map(value).collect();
        let level = LevelSlice::new(&values, nx);
        assert!(level.sides().iter().eq(values.iter().map(|v| *v < 0.0)));
        assert_eq!(level.largest(), values.iter().fold(0.0, |a: f32, v| a.max(v.abs())));
        let side = |i: i64, j: i64| {
            let is_pixel = (0..nx as i64).contains(&i) && (0..ny as i64).contains(&j);
            is_pixel && values[j as usize * nx + i as usize] < 0.0
        };
        let is_near = |n: usize| {
            let (i, j) = ((n % nx) as i64, (n / nx) as i64);
            [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().any(|(di, dj)| side(i + di, j + dj) != side(i, j))
        };
        let expected: Vec<(usize, f32)> = (0..nx * ny).filter(|&n| is_near(n)).map(|n| (n, values[n])).collect();
        assert_eq!(level.near(), expected);
        let far = |n: usize| if values[n] < 0.0 { -level.largest() } else { level.largest() };
        let expected_values = (0..nx * ny).map(|n| if is_near(n) { values[n] } else { far(n) });
        assert!(level.values().into_iter().eq(expected_values));
        assert!(expected.iter().any(|(n, v)| n % nx == nx - 1 && *v < 0.0), "the border is one of its neighbours");
    }

    #[test]
    fn memory_follows_the_contour() {
        let bytes = |n: usize| {
            let value = |k: usize| ((k % n) as f32).hypot((k / n) as f32) - 0.7 * n as f32;
            LevelSlice::new(&(0..n * n).map(value).collect::<Vec<f32>>(), n).bytes()
        };
        let [small, large] = [bytes(300), bytes(1200)];
        assert!((3.5..4.5).contains(&(large as f64 / small as f64)), "{small}, {large}");
        assert!(large < 1200 * 1200 / 10, "{large}");
    }

    #[test]
    fn what_is_no_number_is_kept() {
        let mut values = vec![3.0; 100];
        values[57] = f32::NAN;
        assert!(matches!(LevelSlice::new(&values, 10).near(), [(57, v)] if v.is_nan()));
        assert_eq!(LevelSlice::new(&[], 0).near(), []);
    }
}
