//! Holes on tiles of their own: a hole costs what it is large, not what the part is that it is in.

use crate::backend::jobs::PartJob;
use crate::grid::components::Components;
use crate::grid::field::Field;
use crate::grid::tile::Tile;

/// Tiles of a hole, in pixels of the tile of its part.
#[derive(Debug, Clone, Copy)]
pub struct HoleTiles {
    /// Tile that its distances are asked for: on it are the edges of others that are nearer to some pixel of `kept` than its own.
    asked: Tile,
    /// Tile on which it lies.
    pub kept: Tile,
}

impl HoleTiles {
    /// Tiles for all parts of the background on a part's tile, by number; entry 0 is unused. Distances count up to `margin`, and are kept `more`
    /// pixels farther.
    pub fn of(background: &Components, dims: [usize; 2], margin: [usize; 2], more: [usize; 2]) -> Vec<Self> {
        let mut boxes = vec![[dims, [0; 2]]; background.count + 1];
        for (n, &label) in background.labels.iter().enumerate() {
            let [low, high] = &mut boxes[label as usize];
            for (axis, at) in [n % dims[0], n / dims[0]].into_iter().enumerate() {
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at);
            }
        }
        let kept = [0, 1].map(|a| margin[a] + more[a]);
        let asked = kept.map(|n| 2 * n);
        let tiles = |[low, high]: [[usize; 2]; 2]| {
            let [asked, kept] = [asked, kept].map(|around| Tile::spanning(dims, around, low, high));
            HoleTiles { asked, kept }
        };
        boxes.into_iter().map(tiles).collect()
    }

    /// The question for the distances of the hole in a contour, `whole` on the part's tile, where `is_in` says which pixels are the hole's.
    pub fn job(&self, whole: &Field, is_in: impl Fn(usize) -> bool) -> PartJob {
        let mut turned = self.asked.cut(whole);
        turned.data.iter_mut().for_each(|v| *v = -*v);
        PartJob { whole: turned, inside: self.asked.nodes(whole.dims[0]).map(is_in).collect() }
    }

    /// The hole's distances on its tile, of the answer.
    pub fn of_answer(&self, answer: &Field) -> Field {
        self.kept.within(self.asked).cut(answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::components::label8;
    use crate::reference::part::part_field;

    const MARGIN: [usize; 2] = [14; 2];

    /// A disc with holes beside each other, its signed distance on a tile.
    fn pierced() -> Field {
        let away = |i: usize, j: usize, [x, y]: [f64; 2]| libm::hypot(i as f64 - x, j as f64 - y);
        let holes = [([85.0, 85.0], 4.5), ([102.0, 87.0], 2.0), ([70.0, 66.0], 3.2), ([85.0, 94.0], 0.8)];
        let phi = |i, j| holes.iter().fold(away(i, j, [85.0; 2]) - 46.0, |v, (x, r)| f64::max(v, r - away(i, j, *x)));
        Field::from_fn([171; 2], phi)
    }

    #[test]
    fn a_hole_on_its_own_tile_has_the_distances_of_one_on_its_parts() {
        let whole = pierced();
        let outside: Vec<bool> = whole.data.iter().map(|v| *v >= 0.0).collect();
        let background = label8(&outside, whole.dims);
        let turned = Field { dims: whole.dims, data: whole.data.iter().map(|v| -v).collect() };
        for (more, largest) in [(0, 9 + 28), (11, 9 + 50)] {
            let tiles = HoleTiles::of(&background, whole.dims, MARGIN, [more; 2]);
            let holes: Vec<u32> = (1..=background.count as u32).filter(|l| *l != background.labels[0]).collect();
            assert_eq!(holes.len(), 4);
            for l in holes {
                let own = tiles[l as usize];
                assert!(own.kept.dims.iter().all(|&n| n <= largest), "{:?}", own.kept);
                let is_in = |n: usize| background.labels[n] == l;
                let inside = (0..whole.data.len()).map(is_in).collect();
                let on_all = own.kept.cut(&part_field(&PartJob { whole: turned.clone(), inside }, [1.0; 2]));
                let alone = own.of_answer(&part_field(&own.job(&whole, is_in), [1.0; 2]));
                let counts = |v: f64| v.clamp(-14.0 - more as f64, 14.0 + more as f64);
                let both = alone.data.iter().zip(&on_all.data);
                let most = both.map(|(a, b)| (counts(*a) - counts(*b)).abs()).fold(0.0, f64::max);
                assert!(most < 1e-9, "{most} px");
            }
        }
    }

    #[test]
    fn a_hole_is_cut_out_where_it_lies() {
        let part = Tile { origin: [10, 20], dims: [8, 6] };
        let hole = Tile { origin: [13, 21], dims: [3, 2] };
        let mut body = Field::filled(part.dims, -5.0);
        hole.within(part).cut_out(
            &Field { dims: [3, 2], data: vec![-1.0, 0.5, 9.0, -2.0, -3.0, 1.0] },
            0.25,
            &mut body,
        );
        assert_eq!(hole.within(part).placed(part), hole);
        let row = |j: usize| body.data[8 * j..8 * (j + 1)].to_vec();
        assert_eq!(row(1), [-5.0, -5.0, -5.0, 0.75, -0.75, -5.0, -5.0, -5.0]);
        assert_eq!(row(2), [-5.0, -5.0, -5.0, 1.75, 2.75, -1.25, -5.0, -5.0]);
        assert!([0, 3, 4, 5].iter().all(|j| row(*j) == [-5.0; 8]));
    }
}
