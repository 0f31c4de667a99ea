//! Ends of lines that meet beyond a side of the border: a ridge or a valley ends there, and its two lines are one.

/// Straight pieces of a parabola: they leave it by 1/512 of the height at which its tangents meet, 1/32 px at most.
const PIECES: usize = 16;

/// How a line comes to a side, in a frame of that side: along it, and outward from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Number of its level.
    pub level: usize,
    /// Where along the side.
    pub place: f64,
    /// How far along the side it goes on for each length outward.
    pub slope: f64,
}

impl Ray {
    /// How far outward it meets one that comes after it along the side, if it does.
    fn meets(&self, after: &Ray) -> Option<f64> {
        let up = (after.place - self.place) / (self.slope - after.slope);
        (up > 0.0 && up.is_finite()).then_some(up)
    }
}

/// The parabola that leaves the side in the directions of two ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arch {
    /// Which ends.
    pub ends: [usize; 2],
    /// Where along the side they are.
    feet: [f64; 2],
    /// Where its tangents at the feet meet, `[along, outward]`; not beyond the feet along the side.
    meet: [f64; 2],
}

impl Arch {
    /// Points half way from each foot to where the tangents meet. The parabola lies within the feet and these, and touches the line between them.
    pub fn shoulders(&self) -> [[f64; 2]; 2] {
        self.feet.map(|foot| [(foot + self.meet[0]) / 2.0, self.meet[1] / 2.0])
    }

    /// Its points, `[along, outward]`, from foot to foot: `(1 - t)^2 a + 2 t (1 - t) m + t^2 b`.
    pub fn points(&self) -> impl Iterator<Item = [f64; 2]> + use<> {
        let (feet, meet) = (self.feet, self.meet);
        (0..=PIECES).map(move |k| {
            let t = k as f64 / PIECES as f64;
            let at = |a: f64, m: f64, b: f64| (1.0 - t) * (1.0 - t) * a + 2.0 * t * (1.0 - t) * m + t * t * b;
            [at(feet[0], meet[0], feet[1]), at(0.0, meet[1], 0.0)]
        })
    }

    /// Whether it passes outward of a point.
    fn is_above(&self, [at, up]: [f64; 2]) -> bool {
        self.points().zip(self.points().skip(1)).any(|([x, y], [next_x, next_y])| {
            let share = (at - x) / (next_x - x);
            (0.0..=1.0).contains(&share) && up < y + share * (next_y - y)
        })
    }
}

/// Ends along a side, in order, that meet, as parabolas at most `highest` outward: neighbours of one level, those apart between which all others
/// have met nearer to the side.
pub fn arches(rays: &[Ray], highest: f64) -> Vec<Arch> {
    let mut arches: Vec<Arch> = Vec::new();
    let mut waiting: Vec<usize> = Vec::new();
    for (k, ray) in rays.iter().enumerate() {
        let arch = waiting.last().and_then(|&last| {
            let before = &rays[last];
            // The parabola's top lies half as far out.
            let up = before.meets(ray).filter(|up| before.level == ray.level && up / 2.0 <= highest)?;
            let along = (before.place + up * before.slope).clamp(before.place, ray.place);
            let arch = Arch { ends: [last, k], feet: [before.place, ray.place], meet: [along, up] };
            let mut within = arches.iter().filter(|inner| inner.ends[0] > last).flat_map(Arch::shoulders);
            within.all(|point| arch.is_above(point)).then_some(arch)
        });
        match arch {
            Some(arch) => {
                waiting.pop();
                arches.push(arch);
            }
            None => waiting.push(k),
        }
    }
    arches
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays of circles about a point of the side, those of each radius with a level of their own, outermost first.
    fn hill(radii: &[f64], depth: f64) -> Vec<Ray> {
        let half = |r: f64| (r * r - depth * depth).sqrt();
        let west = radii.iter().enumerate().map(|(level, r)| Ray { level, place: -half(*r), slope: depth / half(*r) });
        let mirrored = |ray: Ray| Ray { place: -ray.place, slope: -ray.slope, ..ray };
        let west: Vec<Ray> = west.collect();
        west.iter().copied().chain(west.iter().rev().copied().map(mirrored)).collect()
    }

    #[test]
    fn flat_circles_are_closed_beyond_the_side() {
        // Centres lie 40 px within the side: of circles that go on 1, 2 and 3 px beyond it. The lowest is the last.
        let rays = hill(&[43.0, 42.0, 41.0], 40.0);
        let found = arches(&rays, 8.0);
        assert_eq!(found.iter().map(|arch| arch.ends).collect::<Vec<_>>(), [[2, 3], [1, 4], [0, 5]]);
        for (arch, radius) in found.iter().zip([41.0, 42.0, 43.0f64]) {
            for [x, up] in arch.points() {
                let off = x.hypot(40.0 + up) - radius;
                assert!(off.abs() < 0.04 * (radius - 40.0), "{x} {up}: {off} of a circle of {radius}");
            }
        }
        // What would go on farther does not meet.
        assert_eq!(arches(&rays, 2.5).iter().map(|arch| arch.ends).collect::<Vec<_>>(), [[2, 3], [1, 4]]);
    }

    #[test]
    fn lines_of_other_levels_and_those_that_part_do_not_meet() {
        let ray = |level, place, slope| Ray { level, place, slope };
        assert!(arches(&[ray(0, 0.0, 1.0), ray(1, 4.0, -1.0)], 8.0).is_empty(), "of two levels");
        assert!(arches(&[ray(0, 0.0, -1.0), ray(0, 4.0, 1.0)], 8.0).is_empty(), "that part");
        assert!(arches(&[ray(0, 0.0, 0.5), ray(0, 4.0, 0.5)], 8.0).is_empty(), "side by side");
        assert!(arches(&[ray(0, 0.0, 1.0), ray(1, 2.0, 0.0), ray(0, 4.0, -1.0)], 8.0).is_empty(), "one between");
        // Of three the first two that can; both lean to the right, where they would meet beyond the second.
        let leaning = arches(&[ray(0, 0.0, 3.0), ray(0, 2.0, 2.0), ray(0, 9.0, 2.0)], 8.0);
        assert_eq!(leaning.iter().map(|arch| arch.ends).collect::<Vec<_>>(), [[0, 1]]);
        assert!(leaning[0].points().all(|[along, up]| (0.0..=2.0).contains(&along) && (0.0..=1.0).contains(&up)));
        // An outer pair that would meet below an inner one is left.
        let flat = [ray(0, 0.0, 10.0), ray(1, 1.0, 0.5), ray(1, 3.0, -0.5), ray(0, 4.0, -10.0)];
        assert_eq!(arches(&flat, 8.0).iter().map(|arch| arch.ends).collect::<Vec<_>>(), [[1, 2]]);
    }
}
