//! The convex hull of a map's lines: where a map ends whose edges are not those of the box around it, such as one that was reprojected.

use glam::DVec2;

use super::border::Border;

/// Corners, counter-clockwise.
#[derive(Debug)]
pub struct Hull(Vec<DVec2>);

impl Hull {
    /// Around points.
    pub fn around<'p>(points: impl Iterator<Item = &'p DVec2>) -> Self {
        let mut points: Vec<DVec2> = points.copied().collect();
        points.sort_by(|p, q| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)));
        let chain = |points: &mut dyn Iterator<Item = &DVec2>| {
            let mut chain: Vec<DVec2> = Vec::new();
            for p in points {
                while let [.., a, b] = chain[..]
                    && (b - a).perp_dot(*p - b) <= 0.0
                {
                    chain.pop();
                }
                chain.push(*p);
            }
            // Its last corner begins the other chain.
            chain.pop();
            chain
        };
        let (lower, upper) = (chain(&mut points.iter()), chain(&mut points.iter().rev()));
        Hull(lower.into_iter().chain(upper).collect())
    }

    /// Distance of a point inside to the nearest side, and where a line from it, away from the hull along an axis, meets `border`.
    pub fn beyond(&self, p: DVec2, border: &Border) -> Option<(f64, DVec2)> {
        let next = self.0.iter().cycle().skip(1);
        let sides = self.0.iter().zip(next).filter_map(|(a, b)| {
            let along = (*b - *a).try_normalize()?;
            Some((along.perp_dot(p - *a), -along.perp()))
        });
        let (distance, out) = sides.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let Border { low, high } = border;
        let reached = match (out.x.abs() > out.y.abs(), out.x > 0.0, out.y > 0.0) {
            (true, true, _) => p.with_x(high.x),
            (true, false, _) => p.with_x(low.x),
            (false, _, true) => p.with_y(high.y),
            (false, _, false) => p.with_y(low.y),
        };
        Some((distance, reached))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_near_a_slanted_side_reach_the_box() {
        let points = [[0.0, 1.0], [10.0, 0.0], [11.0, 8.0], [1.0, 9.0], [5.0, 5.0], [5.0, 0.5]].map(DVec2::from);
        let hull = Hull::around(points.iter());
        assert_eq!(hull.0, [[0.0, 1.0], [10.0, 0.0], [11.0, 8.0], [1.0, 9.0]].map(DVec2::from));
        let border = Border { low: DVec2::ZERO, high: DVec2::new(11.0, 9.0) };
        let (distance, reached) = hull.beyond(DVec2::new(4.0, 0.8), &border).expect("a hull");
        assert!((distance - 0.199).abs() < 1e-3, "{distance}");
        assert_eq!(reached, DVec2::new(4.0, 0.0));
        assert_eq!(hull.beyond(DVec2::new(10.4, 5.0), &border).expect("a hull").1, DVec2::new(11.0, 5.0));
    }
}
