//! Pixels that count where areas are measured: those of the image, where bodies go on beyond it, or those of a map. Contours go on as they come for
//! some pixels more, and are closed somehow beyond.

use std::ops::Range;

use crate::grid::tile::Tile;

/// Pixels of the padded image that count in areas.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    part: Option<[Range<usize>; 2]>,
    /// Pixels beyond them, along either axis, up to which contours go on as they come.
    onward: [usize; 2],
}

impl Seen {
    /// All of them.
    pub const ALL: Seen = Seen { part: None, onward: [0; 2] };

    /// Those in these columns and rows, the image's.
    pub fn image(part: [Range<usize>; 2]) -> Self {
        Seen { part: Some(part), onward: [0; 2] }
    }

    /// The same, where contours go on as they come for so many pixels more.
    pub fn going_on(self, onward: [usize; 2]) -> Self {
        Seen { onward, ..self }
    }

    /// Columns and rows of the image; nothing where all pixels count.
    pub fn part(&self) -> Option<&[Range<usize>; 2]> {
        self.part.as_ref()
    }

    /// Columns and rows in which contours are what they are; beyond them they are closed somehow. Nothing where all of them are.
    pub fn course(&self) -> Option<[Range<usize>; 2]> {
        let grown = |a: usize, of: &Range<usize>| {
            of.start.saturating_sub(self.onward[a])..of.end.saturating_add(self.onward[a])
        };
        self.part.as_ref().map(|[columns, rows]| [grown(0, columns), grown(1, rows)])
    }

    /// Whether pixel `node` of the padded image, of width `nx`, counts.
    pub fn has(&self, node: usize, nx: usize) -> bool {
        self.part.as_ref().is_none_or(|[columns, rows]| columns.contains(&(node % nx)) && rows.contains(&(node / nx)))
    }

    /// Pixels on the image's border, each with the one beyond it, where the padded image of size `dims` has one.
    pub fn edges(&self, [nx, ny]: [usize; 2]) -> Vec<[usize; 2]> {
        let Some([columns, rows]) = self.part().filter(|part| part.iter().all(|range| !range.is_empty())) else {
            return Vec::new();
        };
        // The outermost index on the image and the one beyond it, on either side.
        let sides = |range: &Range<usize>, count: usize| {
            let low = range.start.checked_sub(1).map(|beyond| [range.start, beyond]);
            let high = (range.end < count).then(|| [range.end - 1, range.end]);
            low.into_iter().chain(high)
        };
        let across = sides(columns, nx).flat_map(|pair| rows.clone().map(move |j| pair.map(|i| j * nx + i)));
        let along = sides(rows, ny).flat_map(|pair| columns.clone().map(move |i| pair.map(|j| j * nx + i)));
        across.chain(along).collect()
    }

    /// Of a tile's values those whose pixels count.
    pub fn on<'v>(&self, tile: &Tile, values: &'v [f64]) -> impl Iterator<Item = f64> + Clone + use<'v> {
        let all = tile.dims.map(|n| 0..n);
        let ([columns, rows], nx) = (self.part.as_ref().map_or(all, |part| tile.local(part)), tile.dims[0]);
        rows.flat_map(move |j| values[j * nx + columns.start..j * nx + columns.end].iter().copied())
    }

    /// Seeds by number in the order in which those whose pixel inside counts come first, and how many those are: all, if none counts. `inside`
    /// tells a seed's pixel.
    pub fn first(&self, seeds: Vec<u32>, nx: usize, inside: impl Fn(u32) -> usize) -> (Vec<u32>, usize) {
        let (mut first, mut others): (Vec<u32>, Vec<u32>) =
            seeds.into_iter().partition(|&seed| self.has(inside(seed), nx));
        let counted = if first.is_empty() { others.len() } else { first.len() };
        first.append(&mut others);
        (first, counted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_tile_what_lies_on_the_image_counts() {
        let (nx, tile) = (20, Tile { origin: [3, 5], dims: [6, 4] });
        let values: Vec<f64> = tile.nodes(nx).map(|n| n as f64).collect();
        for part in [[0..20, 0..20], [5..7, 6..30], [9..12, 5..9], [0..3, 0..20], [0..9, 0..6]] {
            let seen = Seen::image(part);
            let expected: Vec<f64> = tile.nodes(nx).filter(|n| seen.has(*n, nx)).map(|n| n as f64).collect();
            assert_eq!(seen.on(&tile, &values).collect::<Vec<_>>(), expected, "{seen:?}");
        }
        assert_eq!(Seen::ALL.on(&tile, &values).collect::<Vec<_>>(), values);
    }

    #[test]
    fn pixels_on_the_border_are_told_with_those_beyond() {
        let seen = Seen::image([1..3, 0..2]);
        assert_eq!(seen.edges([4, 3]), [[1, 0], [5, 4], [2, 3], [6, 7], [5, 9], [6, 10]]);
        assert!(Seen::ALL.edges([4, 3]).is_empty() && Seen::image([2..2, 0..3]).edges([4, 3]).is_empty());
    }

    #[test]
    fn seeds_on_the_image_come_first() {
        let seen = Seen::image([4..10, 0..1]);
        let of = |seeds: &[u32]| seen.first(seeds.to_vec(), 10, |seed| seed as usize);
        assert_eq!(of(&[1, 5, 2, 9]), (vec![5, 9, 1, 2], 2));
        assert_eq!(of(&[3, 1]), (vec![3, 1], 2), "what lies beyond alone counts as a whole");
        assert_eq!(Seen::ALL.first(vec![3, 1], 10, |seed| seed as usize), (vec![3, 1], 2));
    }
}
