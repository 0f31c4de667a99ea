//! Doubts about an input: what is probably not meant, said in words before the work.

use super::forgotten::{Forgotten, forgotten_hole, forgotten_part};
use super::mask::Mask;
use super::pinholes::Pinholes;
use super::specks::{Speck, specks};
use super::unresolved::Unresolved;
use super::{ContourStack, Slice, SliceContent};

/// A slice with less than this share of its neighbours' area is doubted: no section between two others of an organ is so small.
const STRAY: f64 = 0.05;
/// Gaps this near to each other, relatively, are the same.
const SAME: f64 = 0.01;
/// Gaps unlike by this factor: a spline that may leave the range of its contours leaves it there by several times their difference.
const UNLIKE: f64 = 10.0;
/// With more than this share of the images' border inside the body is doubted to be what lies outside.
const BORDER: f64 = 0.9;
/// Pixels up to so many times as long as wide give the body that square ones give: the random stacks of the tests have no longer ones.
const LONG: f64 = 8.0;
/// A gap so many times as wide as the usual one, which half of the gaps and [`USUAL`] of them have, is doubted.
const WIDE: f64 = 4.0;
const USUAL: usize = 4;
/// Slices that a message names.
const NAMED: usize = 6;
/// What a slice may lack.
const PART: &str = "part";
const HOLE: &str = "hole";

/// Slices of a body: heights and areas in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SliceArea {
    /// Height.
    pub z: f64,
    /// Pixels inside.
    pub area: usize,
}

/// Places of slices with under 5 % of their neighbours' area. The first and last of a body may be so small where it ends in a tip: they
/// are doubted only off the heights at which the others lie, or where no pixel lies over the neighbour's, as `overlap` says.
pub fn strays(sections: &[SliceArea], overlap: impl Fn(usize, usize) -> bool) -> Vec<usize> {
    let painted: Vec<usize> = (0..sections.len()).filter(|&k| sections[k].area > 0).collect();
    let gap = |n: usize| sections[painted[n + 1]].z - sections[painted[n]].z;
    let usual = |n: usize| {
        let gaps = (0..painted.len() - 1).filter(|&m| m != n);
        gaps.into_iter().any(|m| (gap(m) - gap(n)).abs() <= SAME * gap(n))
    };
    let small =
        |n: usize, beside: usize| (sections[painted[n]].area as f64) < STRAY * sections[painted[beside]].area as f64;
    let doubted = |n: usize| match (n.checked_sub(1), Some(n + 1).filter(|m| *m < painted.len())) {
        (Some(below), Some(above)) => small(n, below) && small(n, above),
        (Some(beside), None) => small(n, beside) && !(usual(beside) && overlap(painted[n], painted[beside])),
        (None, Some(beside)) => small(n, beside) && !(usual(n) && overlap(painted[n], painted[beside])),
        (None, None) => false,
    };
    (0..painted.len()).filter(|&n| doubted(n)).map(|n| painted[n]).collect()
}

/// Words about the slices at `places`, of which `name` tells what they are called.
pub fn stray(places: &[usize], sections: &[SliceArea], name: impl Fn(usize) -> String) -> Option<String> {
    let said = |&k: &usize| {
        let beside = [sections[..k].iter().rposition(|s| s.area > 0), {
            sections[k + 1..].iter().position(|s| s.area > 0).map(|m| k + 1 + m)
        }];
        let beside: Vec<String> =
            beside.into_iter().flatten().map(|m| format!("{} px on {}", sections[m].area, name(m))).collect();
        format!("{} has {} px (beside {})", name(k), sections[k].area, beside.join(" and "))
    };
    let listed: Vec<String> = places.iter().take(NAMED).map(said).collect();
    let more = places.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(", and {more} more") } else { String::new() };
    (!listed.is_empty())
        .then(|| format!("{}{more}: painted by mistake? Erase it or leave the slice out", listed.join(", ")))
}

/// Words about empty slices between painted ones, where most painted ones stand alone between them: each is a body of its own.
fn interleaved(sections: &[SliceArea]) -> Option<String> {
    let painted = |s: &SliceArea| s.area > 0;
    let stretches: Vec<usize> =
        sections.chunk_by(|a, b| painted(a) == painted(b)).filter(|some| painted(&some[0])).map(<[_]>::len).collect();
    let alone = stretches.iter().filter(|count| **count == 1).count();
    (stretches.len() > 2 && 2 * alone > stretches.len()).then(|| {
        format!(
            "{alone} painted slices stand alone between empty ones, where the body ends: is a slice without paint one that was not drawn? Leave it \
             out (of a volume, what chooses slices or cuts grey values takes empty ones too)"
        )
    })
}

/// Places of empty slices, one by itself, between two painted ones of which some pixel lies over the other's, as `overlap` says.
fn blanks(sections: &[SliceArea], overlap: impl Fn(usize, usize) -> bool) -> Vec<usize> {
    let beside = |k: usize| sections[k - 1].area > 0 && sections[k + 1].area > 0 && overlap(k - 1, k + 1);
    (1..sections.len().max(1) - 1).filter(|&k| sections[k].area == 0 && beside(k)).collect()
}

/// Words about the empty slices at `places`, of which `name` tells what they are called.
fn blank(places: &[usize], name: impl Fn(usize) -> String) -> Option<String> {
    let listed: Vec<String> = places.iter().take(NAMED).map(|&k| name(k)).collect();
    let more = places.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(", and {more} more") } else { String::new() };
    let (are, was) = if places.len() == 1 { ("is", "Was it") } else { ("are", "Were they") };
    (!listed.is_empty()).then(|| {
        format!(
            "{}{more} {are} empty between slices that are painted one over the other, so that the body is not there. {was} left unpainted? Leave such a slice out",
            listed.join(", ")
        )
    })
}

/// Words about parts, or holes, that slices have not, by the places of these, of which `name` tells what they are called.
fn lacking(what: &str, forgotten: &[(usize, Forgotten)], name: impl Fn(usize) -> String) -> Option<String> {
    let (there, how) = if what == HOLE { ("there", "filled") } else { ("not there", "left unpainted") };
    let said =
        |(k, f): &(usize, Forgotten)| format!("{} at column {}, row {} ({} px)", name(*k), f.at[0], f.at[1], f.pixels);
    let listed: Vec<String> = forgotten.iter().take(NAMED).map(said).collect();
    let more = forgotten.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(", and {more} more") } else { String::new() };
    (!listed.is_empty()).then(|| {
        format!(
            "a {what} that the slices below and above have at the same place is not on {}{more}, so that the body is {there}: was it {how}?",
            listed.join(", ")
        )
    })
}

/// Words about the specks of slices, by the places of these, of which `name` tells what they are called.
fn specked(specks: &[(usize, Speck)], name: impl Fn(usize) -> String) -> Option<String> {
    let said =
        |(k, s): &(usize, Speck)| format!("{} px on {} at column {}, row {}", s.pixels, name(*k), s.at[0], s.at[1]);
    let listed: Vec<String> = specks.iter().take(NAMED).map(said).collect();
    let more = specks.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(", and {more} more") } else { String::new() };
    (!listed.is_empty()).then(|| {
        format!(
            "{}{more}: parts so small that touch nothing of the slices beside theirs end between them, each a body of its own: painted by mistake?",
            listed.join(", ")
        )
    })
}

/// Gaps far wider than the usual one between slices that are not empty, by the slice below each, and the usual one.
fn wide(sections: &[SliceArea]) -> Option<(Vec<usize>, f64)> {
    let gap = |k: usize| sections[k + 1].z - sections[k].z;
    let all = || 0..sections.len().saturating_sub(1);
    let mut gaps: Vec<f64> = all().map(gap).collect();
    gaps.sort_by(f64::total_cmp);
    let usual = *gaps.get(gaps.len() / 2)?;
    let alike = gaps.iter().filter(|gap| (*gap - usual).abs() <= SAME * usual).count();
    let doubted = |&k: &usize| gap(k) >= WIDE * usual && sections[k].area > 0 && sections[k + 1].area > 0;
    (alike >= USUAL && 2 * alike >= gaps.len()).then(|| (all().filter(doubted).collect(), usual))
}

impl ContourStack {
    /// Doubt about gaps that look as if slices were not drawn because the body is not there.
    pub fn undrawn(&self) -> Option<String> {
        self.far_apart().map(|[usual, places]| {
            format!(
                "slices lie {usual} apart, but none between {places}: interpolated across; if the body is not there reconstruct each stretch by itself \
                 (`slices` chooses it from a volume or an RTSTRUCT; of a folder, one with its slices alone), or give an empty slice between"
            )
        })
    }

    /// Doubt about gaps between the levels of a map.
    pub fn missing_levels(&self) -> Option<String> {
        self.far_apart().map(|[usual, places]| {
            format!(
                "levels lie {usual} apart, but none between {places}: interpolated across; are lines missing, or is an elevation a mark for no data?"
            )
        })
    }

    /// How far slices lie apart, and the places where none lie between.
    fn far_apart(&self) -> Option<[String; 2]> {
        let section = |s: &Slice| SliceArea { z: s.z, area: usize::from(!s.content.is_empty()) };
        let (places, usual) = wide(&self.slices.iter().map(section).collect::<Vec<_>>())?;
        let said = |&k: &usize| format!("{:.3} and {:.3}", self.slices[k].z, self.slices[k + 1].z);
        let listed: Vec<String> = places.iter().take(NAMED).map(said).collect();
        let more = places.len().saturating_sub(NAMED);
        let more = if more > 0 { format!(", and in {more} more gaps") } else { String::new() };
        (!listed.is_empty()).then(|| [format!("{usual:.3}"), listed.join(", ") + &more])
    }

    /// Doubts about slices that look painted by mistake, as a whole or in specks, or left empty, as a whole, where both neighbours have a part or in pinholes,
    /// about gaps, about what pixels do not resolve and about their sides.
    pub fn doubts(&self) -> Vec<String> {
        let sections = self.sections();
        let name = |k: usize| self.called(k);
        let strays = stray(&self.strays(&sections), &sections, name);
        let unresolved = self.unresolved().told(name);
        strays.into_iter().chain(self.empty()).chain(self.slips()).chain(unresolved).chain(self.long_pixels()).collect()
    }

    /// The same of a union: where members are interpolated to slices of others, these lack them by no mistake.
    pub fn doubts_of_union(&self, is_interpolated: bool) -> Vec<String> {
        let slips = if is_interpolated { self.slips() } else { Vec::new() };
        self.doubts().into_iter().filter(|doubt| !slips.contains(doubt)).collect()
    }

    /// Doubt about empty slices between others.
    pub fn empty(&self) -> Option<String> {
        let sections = self.sections();
        let blank = || blank(&blanks(&sections, |a, b| self.overlap(a, b)), |k| self.called(k));
        interleaved(&sections).or_else(blank)
    }

    /// Doubts about what slices lack, or have by mistake though not as a whole, and about gaps.
    pub fn slips(&self) -> Vec<String> {
        let sections = self.sections();
        let strays = self.strays(&sections);
        let name = |k: usize| self.called(k);
        let inner = (1..self.slices.len().max(1) - 1).filter(|k| sections[*k].area > 0 && !strays.contains(k));
        let mask = |k: usize| self.slices[k].content.mask();
        let inner: Vec<usize> = inner.collect();
        let without = |what: &str, of: fn([&Mask; 3], usize) -> Option<Forgotten>| {
            let found = |&k: &usize| Some((k, of([k - 1, k, k + 1].map(mask), self.dims[0])?));
            lacking(what, &inner.iter().filter_map(found).collect::<Vec<_>>(), name)
        };
        let lacking = [without(PART, forgotten_part), without(HOLE, forgotten_hole)];
        // On the first and the last slice it may be a tip: of relief the lowest level has hills by themselves.
        let specks = inner.iter().flat_map(|&k| {
            let found = specks(mask(k), &[k - 1, k + 1].map(mask), self.dims[0]);
            found.into_iter().map(move |speck| (k, speck))
        });
        let specked = specked(&specks.collect::<Vec<_>>(), name);
        let mut pinholes = Pinholes::default();
        inner.iter().for_each(|&k| pinholes.see(k, [k - 1, k, k + 1].map(mask), self.dims[0]));
        let slices = lacking.into_iter().flatten().chain(specked);
        slices.chain(pinholes.told(name)).chain(self.undrawn()).collect()
    }

    fn sections(&self) -> Vec<SliceArea> {
        self.slices.iter().map(|s| SliceArea { z: s.z, area: s.content.mask().count() }).collect()
    }

    fn strays(&self, sections: &[SliceArea]) -> Vec<usize> {
        strays(sections, |a, b| self.overlap(a, b))
    }

    /// Whether some pixel is inside on both slices.
    fn overlap(&self, a: usize, b: usize) -> bool {
        let [own, other] = [a, b].map(|k| self.slices[k].content.sides());
        own.into_iter().zip(other).any(|(own, other)| own && other)
    }

    fn called(&self, k: usize) -> String {
        format!("slice `{}`", self.slices[k].name)
    }

    /// Parts of masks that pixels do not resolve; grey values and polygons say where their outline lies.
    fn unresolved(&self) -> Unresolved {
        let mut seen = Unresolved::default();
        for (k, slice) in self.slices.iter().enumerate() {
            if let SliceContent::Mask(mask) = &slice.content {
                seen.see(k, &mask.rows(self.dims[0]).collect::<Vec<_>>(), self.dims[0]);
            }
        }
        seen
    }

    /// Doubt about pixels that are far longer than wide.
    fn long_pixels(&self) -> Option<String> {
        let ([dx, dy], aspect) = (self.spacing, self.aspect());
        (aspect > LONG).then(|| {
            format!(
                "pixels are {dx} x {dy}, {aspect:.0} times as long as wide: is that so? Spacings come in the order x, y, z. Beyond {LONG} times nothing \
                 is promised, and time and memory grow with this factor"
            )
        })
    }

    /// Doubt whether what is inside is the body, where nearly all of the images' border is: on its side of the level of grey slices, or on every mask
    /// that is not empty, unless all are wholly inside. Sides may have been `inverted`.
    pub fn inside_out(&self, inverted: bool) -> Option<String> {
        let [nx, ny] = self.dims;
        let edges = (0..nx * ny).step_by(nx.max(1)).flat_map(|row| [row, row + nx - 1]);
        let border: Vec<usize> = (0..nx).chain(nx * ny.saturating_sub(1)..nx * ny).chain(edges).collect();
        let inside = |slice: &Slice| border.iter().filter(|n| slice.content.inside(**n)).count();
        let nearly = |inside: usize, slices: usize| inside as f64 > BORDER * (border.len() * slices) as f64;
        let grey = |slice: &Slice| matches!(slice.content, SliceContent::Level(_));
        if self.slices.iter().all(grey) {
            return nearly(self.slices.iter().map(inside).sum(), self.slices.len()).then(|| {
                let other =
                    "nearly all of the images' border is inside: is the body what lies on the other side of the level";
                match inverted {
                    true => format!("{other}? Without --invert it is"),
                    false => {
                        format!("{other}, as of a signed distance that is negative inside? --invert takes that side")
                    }
                }
            });
        }
        let masks = || self.slices.iter().filter(|slice| !grey(slice) && !slice.content.is_empty());
        let whole = |slice: &Slice| matches!(&slice.content, SliceContent::Mask(mask) if mask.count() == nx * ny);
        if inverted && masks().next().is_some() && masks().all(whole) {
            return Some("nothing is white on any slice: with --invert all of the images is inside".into());
        }
        (masks().any(|slice| !whole(slice)) && masks().all(|slice| nearly(inside(slice), 1))).then(|| {
            let outside = "nearly all of the images' border is inside on every slice: is the body what lies outside?";
            match inverted {
                true => format!("{outside} Without --invert it is"),
                false => format!(
                    "{outside} Inside is what is white, or not 0; --invert takes what is black of images, as of drawings black on white, and of a \
                     volume --level 0.5 --invert what is 0"
                ),
            }
        })
    }

    /// Doubt about the slice whose two gaps are the most unlike, for splines that may overshoot.
    pub fn unlike_gaps(&self) -> Option<String> {
        let ratio = |[below, above]: [f64; 2]| (below / above).max(above / below);
        let gap = |k: usize| self.slices[k + 1].z - self.slices[k].z;
        let inner = 1..self.slices.len().saturating_sub(1);
        let gaps = inner.map(|k| (k, [gap(k - 1), gap(k)]));
        let (k, gaps) = gaps.max_by(|a, b| ratio(a.1).total_cmp(&ratio(b.1)))?;
        let name = &self.slices[k].name;
        (ratio(gaps) >= UNLIKE).then(|| {
            format!(
                "slice `{name}` lies {:.3} over the one below and {:.3} under the one above: between gaps so unlike `natural` and `catmull` leave \
                 the range of their contours by far; `pchip` and `hyman` do not",
                gaps[0], gaps[1]
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places of doubted slices; tips lie over their neighbours if `overlap`.
    fn doubted(sections: &[(f64, usize)], overlap: bool) -> Vec<usize> {
        let sections: Vec<SliceArea> = sections.iter().map(|&(z, area)| SliceArea { z, area }).collect();
        strays(&sections, |_, _| overlap)
    }

    #[test]
    fn p14_a_speck_between_slices_or_off_them_is_doubted() {
        assert_eq!(doubted(&[(0.0, 600), (10.0, 610), (17.0, 1), (20.0, 600)], true), [2]);
        assert_eq!(doubted(&[(0.0, 600), (10.0, 610), (20.0, 600), (27.0, 1)], true), [3]);
        assert_eq!(doubted(&[(0.0, 600), (10.0, 610), (20.0, 600), (30.0, 1)], false), [3]);
        assert_eq!(doubted(&[(-4.0, 3), (0.0, 600)], true), [0]);
        assert_eq!(doubted(&[(0.0, 600), (10.0, 0), (15.0, 29), (18.0, 0), (20.0, 590)], true), [2]);
    }

    #[test]
    fn painted_slices_that_stand_alone_between_empty_ones_are_doubted() {
        let doubted = |areas: &[usize]| {
            let sections: Vec<SliceArea> =
                areas.iter().enumerate().map(|(k, &area)| SliceArea { z: k as f64, area }).collect();
            interleaved(&sections).is_some()
        };
        assert!(doubted(&[9, 0, 9, 0, 9]) && doubted(&[0, 9, 0, 0, 9, 0, 9, 9, 0]));
        assert!(!doubted(&[9, 9, 0, 0, 9, 9]) && !doubted(&[0, 9, 9, 9, 0]) && !doubted(&[9, 0, 9]));
        assert!(!doubted(&[9, 9, 0, 9, 9, 0, 9]) && !doubted(&[]));
    }

    #[test]
    fn an_empty_slice_between_two_of_one_body_is_doubted() {
        let doubted = |areas: &[usize], overlap: bool| {
            let sections: Vec<SliceArea> =
                areas.iter().enumerate().map(|(k, &area)| SliceArea { z: k as f64, area }).collect();
            blanks(&sections, |_, _| overlap)
        };
        assert_eq!(doubted(&[9, 9, 0, 9, 9, 9, 0, 9], true), [2, 6]);
        assert!(doubted(&[9, 9, 0, 9, 9], false).is_empty());
        assert!(doubted(&[0, 9, 9, 0, 0, 9, 9, 0], true).is_empty());
        assert!(doubted(&[], true).is_empty() && doubted(&[0], true).is_empty() && doubted(&[9, 0], true).is_empty());
    }

    #[test]
    fn a_gap_far_wider_than_the_usual_one_is_doubted() {
        let doubted = |heights: &[f64], empty: &[usize]| {
            let area = |k: usize| 9 * usize::from(!empty.contains(&k));
            let sections: Vec<SliceArea> =
                heights.iter().enumerate().map(|(k, &z)| SliceArea { z, area: area(k) }).collect();
            wide(&sections).map(|(places, _)| places).unwrap_or_default()
        };
        let dense = [0.0, 3.0, 6.0, 9.0, 39.0, 42.0, 45.0];
        assert_eq!(doubted(&dense, &[]), [3]);
        // An empty slice ends the body there.
        assert!(doubted(&dense, &[3]).is_empty() && doubted(&dense, &[4]).is_empty());
        // Slices that were left out here and there, of different gaps, and too few to say what is usual.
        assert!(doubted(&[0.0, 3.0, 6.0, 9.0, 18.0, 21.0, 24.0], &[]).is_empty());
        assert!(doubted(&[0.0, 1.0, 3.0, 6.0, 10.0, 15.0, 45.0], &[]).is_empty());
        assert!(doubted(&[0.0, 3.0, 30.0, 33.0, 36.0], &[]).is_empty());
        assert!(doubted(&[0.0, 3.0, 6.0, 9.0, 12.0, 30.0, 60.0, 90.0, 120.0, 150.0], &[]).is_empty());
        assert!(doubted(&[], &[]).is_empty() && doubted(&[0.0], &[]).is_empty());
    }

    #[test]
    fn p14_a_tip_is_not() {
        assert!(doubted(&[(0.0, 600), (10.0, 610), (20.0, 600), (30.0, 1)], true).is_empty());
        assert!(doubted(&[(0.0, 2), (1.0, 60), (2.0, 200), (3.0, 61), (4.0, 1)], true).is_empty());
        assert!(doubted(&[(0.0, 600), (10.0, 30), (20.0, 500)], false).is_empty());
        assert!(doubted(&[(0.0, 0), (1.0, 4)], false).is_empty());
    }
}
