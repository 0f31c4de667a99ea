//! Parts of a contour that go on beyond what is known of it: a slope that leaves its map, a body that its image cuts.
//!
//! What closes such a part out there is no contour. A part that ends is its contour drawn in; drawn in from there, too, a plane that rises out of its map
//! would have a crest within it and fall to the border.

use std::ops::Range;

use crate::grid::field::{FAR, Field};
use crate::grid::seen::Seen;
use crate::grid::tile::Tile;

/// Columns and rows of a part's tile in which its contour takes its course.
#[derive(Debug, Clone, PartialEq)]
pub struct OpenPart {
    course: [Range<usize>; 2],
    nx: usize,
}

impl OpenPart {
    /// Of a part with these pixels on its tile; nothing where it does not go on farther, or has no edge there.
    pub fn of(inside: &[bool], tile: &Tile, known: &Seen) -> Option<Self> {
        let open = Self::going_on(inside, tile, known)?;
        let has = |is: bool| (0..inside.len()).any(|n| inside[n] == is && open.has(n));
        (has(true) && has(false)).then_some(open)
    }

    /// The same, whether it has an edge there or not.
    pub fn going_on(inside: &[bool], tile: &Tile, known: &Seen) -> Option<Self> {
        let open = OpenPart { course: tile.local(&known.course()?), nx: tile.dims[0] };
        (0..inside.len()).any(|n| inside[n] && !open.has(n)).then_some(open)
    }

    fn has(&self, node: usize) -> bool {
        self.course[0].contains(&(node % self.nx)) && self.course[1].contains(&(node / self.nx))
    }

    /// The part's pixels, farther out those where its contour's course ends: what closes it has the same side before and behind it then, and is an edge of
    /// another part for distances.
    pub fn opened(&self, inside: &[bool]) -> Vec<bool> {
        let [columns, rows] = &self.course;
        let nearest = |n: usize, of: &Range<usize>| n.clamp(of.start, of.end - 1);
        let node = |n: usize| nearest(n / self.nx, rows) * self.nx + nearest(n % self.nx, columns);
        (0..inside.len()).map(|n| inside[node(n)]).collect()
    }

    /// Ends a part where its contour's course ends: beyond it everything is far off, however far the part is drawn in.
    pub fn end(&self, field: &mut Field) {
        (0..).zip(&mut field.data).filter(|(n, _)| !self.has(*n)).for_each(|(_, v)| *v = FAR);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::jobs::PartJob;
    use crate::reference::part::part_field;

    const DIMS: [usize; 2] = [30, 24];
    const TILE: Tile = Tile { origin: [5, 3], dims: DIMS };

    /// A strip whose long edges are at rows 8 and 16, from column 4 to 25; known up to column 20, and two more.
    fn strip() -> (Vec<bool>, Field, Seen) {
        let phi = |i: usize, j: usize| {
            let [i, j] = [i, j].map(|n| n as f64);
            (3.5 - i).max(i - 25.5).max(7.5 - j).max(j - 16.5)
        };
        let field = Field::from_fn(DIMS, phi);
        let inside = field.data.iter().map(|v| *v < 0.0).collect();
        (inside, field, Seen::image([5..26, 0..40]).going_on([2, 0]))
    }

    #[test]
    fn what_closes_a_part_beyond_its_course_is_no_edge_of_it() {
        let (inside, whole, seen) = strip();
        let open = OpenPart::of(&inside, &TILE, &seen).expect("it goes on");
        let mut field = part_field(&PartJob { whole: whole.clone(), inside: open.opened(&inside) }, [1.0; 2]);
        open.end(&mut field);
        let at = |field: &Field, i: usize, j: usize| field.data[j * DIMS[0] + i];
        // Beside the far end distances are those to the long edges, elsewhere what they were.
        for i in 4..23 {
            let long = -4.5f64.min((i as f64) - 3.5);
            assert!((at(&field, i, 12) - long).abs() < 1e-6, "column {i}: {}", at(&field, i, 12));
        }
        assert!(at(&whole, 22, 12) > -4.0 && at(&field, 23, 12) == FAR);
    }

    #[test]
    fn a_part_that_does_not_go_on_or_has_no_edge_is_left_alone() {
        let (inside, ..) = strip();
        assert_eq!(OpenPart::of(&inside, &TILE, &Seen::ALL), None);
        assert_eq!(OpenPart::of(&inside, &TILE, &Seen::image([5..31, 0..40])), None, "it ends within");
        let full = vec![true; inside.len()];
        assert_eq!(OpenPart::of(&full, &TILE, &Seen::image([5..26, 0..40])), None, "nothing but what closes it");
        assert_eq!(OpenPart::of(&inside, &TILE, &Seen::image([80..90, 0..40])), None, "it lies beyond");
    }
}
