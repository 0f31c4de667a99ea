//! Choice of the contours that become the stack: ROIs, their closed contours, their planes.

use std::cell::LazyCell;
use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap, HashSet};

use glam::DVec3;

use super::{Contour, Roi, StructureSet};
use crate::error::{Error, Result, counted};
use crate::polygons::clean::line_key;
use crate::polygons::crossing::crossing;
use crate::polygons::near::near_copies;
use crate::polygons::plane::{Bent, PlaneSet, TOLERANCE, smallest_gap};
use crate::polygons::{self, PlaneDrawing, Planes, Polygon};
use crate::stack::members::{InterpolatedMember, Member, drawn_on_slices_of_others};
use crate::stack::{ContourStack, ReadOptions};

/// Ratio of a ROI's gaps to those of another one's planes from which on planes were left out.
const LEFT_OUT: f64 = 1.5;

/// ROIs to be reconstructed as one body.
#[derive(Debug)]
pub struct ChosenRois<'a> {
    set: &'a StructureSet,
    /// The ROIs.
    pub rois: Vec<&'a Roi>,
    /// Contours that count: ROI (index in `rois`) and number from 0 in it.
    used: Vec<(usize, usize)>,
    /// Their planes.
    pub planes: PlaneSet,
    /// Contours that were left out, and why.
    pub notes: Vec<String>,
}

impl StructureSet {
    /// The ROIs that `options.roi` names; the only one of the file where it names none.
    ///
    /// # Errors
    /// [`Error::Setting`] where a name is none of the file's, or several ROIs could be meant; [`Error::Format`] for contours that are not
    /// closed, leave their plane, or are fewer than two planes.
    pub fn choose(&self, options: &ReadOptions) -> Result<ChosenRois<'_>> {
        let mut rois: Vec<&Roi> = options.roi.iter().map(|name| self.find(name)).collect::<Result<_>>()?;
        if let Some(k) = (1..rois.len()).find(|k| rois[..*k].iter().any(|r| r.number == rois[*k].number)) {
            let message = format!("names {} twice", rois[k].label());
            return Err(Error::Setting { name: "roi".into(), message });
        }
        match &self.rois[..] {
            [] => return Err(self.wrong("has no ROI".into())),
            [only] if rois.is_empty() => rois.push(only),
            _ if rois.is_empty() => {
                let message = format!("is needed: the file has {} ROIs: {}", self.rois.len(), self.listed());
                return Err(Error::Setting { name: "roi".into(), message });
            }
            _ => {}
        }
        self.closed(rois, options.pixel)
    }

    /// The ROIs that can be reconstructed. `leave_out` hears of each other one, and why.
    pub fn usable(&self, read: &ReadOptions, leave_out: &mut dyn FnMut(String)) -> Vec<&Roi> {
        let usable = |roi: &&Roi| match self.closed(vec![roi], read.pixel).and_then(|chosen| chosen.chosen_planes(read))
        {
            Ok(_) => true,
            Err(why) => {
                let why = if roi.is_drawn() { format!(": {why}") } else { ", not drawn".into() };
                leave_out(format!("{}: left out{why}", roi.label()));
                false
            }
        };
        self.rois.iter().filter(usable).collect()
    }

    /// The closed contours of `rois` and their planes; those that nearly coincide are one by pixels of side `pixel`, mm, where it was named.
    ///
    /// # Errors
    /// [`Error::Format`] as [`StructureSet::choose`].
    pub fn closed<'a>(&'a self, rois: Vec<&'a Roi>, pixel: Option<f64>) -> Result<ChosenRois<'a>> {
        let chosen = self.on_planes(rois, pixel)?;
        if chosen.planes.heights.len() < 2 {
            let names: Vec<String> = chosen.rois.iter().map(|r| r.label()).collect();
            return Err(self.wrong(format!(
                "{}: drawn on {}; at least 2 are needed",
                names.join(", "),
                counted(chosen.planes.heights.len(), "plane")
            )));
        }
        Ok(chosen)
    }

    /// The closed contours of `rois` and their planes, be it only one.
    ///
    /// # Errors
    /// [`Error::Format`] as [`StructureSet::choose`].
    pub(super) fn on_planes<'a>(&'a self, rois: Vec<&'a Roi>, pixel: Option<f64>) -> Result<ChosenRois<'a>> {
        let (mut used, mut notes) = (Vec::new(), Vec::new());
        if let Some(fault) = rois.iter().find_map(|roi| roi.fault.as_ref()) {
            return Err(self.wrong(fault.clone()));
        }
        for (r, roi) in rois.iter().enumerate() {
            notes.extend(roi.notes.iter().cloned());
            let mut seen = HashMap::new();
            for (c, contour) in roi.contours.iter().enumerate() {
                let at = format!("{}, contour {}", roi.label(), c + 1);
                if !contour.is_closed() {
                    let message =
                        format!("{at} is {}; only CLOSED_PLANAR and CLOSEDPLANAR_XOR bound a body", contour.kind);
                    return Err(self.wrong(message));
                }
                match contour.points.len() {
                    n @ 0..=2 => {
                        let s = if n == 1 { "" } else { "s" };
                        notes.push(format!(
                            "{at}: left out, {n} point{s} bound{} no area",
                            if n == 1 { "s" } else { "" }
                        ));
                    }
                    _ => match seen.entry(line_key(contour.points.iter().map(DVec3::to_array))) {
                        Entry::Occupied(first) => {
                            notes.push(format!("{at}: left out, it is the same line as contour {}", first.get() + 1))
                        }
                        Entry::Vacant(place) => {
                            place.insert(c);
                            used.push((r, c));
                        }
                    },
                }
            }
        }
        let points: Vec<&[DVec3]> = used.iter().map(|(r, c)| &rois[*r].contours[*c].points[..]).collect();
        let planes = PlaneSet::of(&points).map_err(|Bent { contour, by, normal: DVec3 { x, y, z } }| {
            let (r, c) = used[contour];
            self.wrong(format!(
                "{}, contour {}: leaves its plane by {by:.3} mm along the common normal ({x:.4}, {y:.4}, {z:.4}); at most {TOLERANCE} mm",
                rois[r].label(),
                c + 1
            ))
        })?;
        let mut chosen = ChosenRois { set: self, rois, used, planes, notes };
        chosen.leave_out_near(pixel);
        Ok(chosen)
    }

    fn wrong(&self, message: String) -> Error {
        Error::Format { path: self.path.clone(), message }
    }
}

impl ChosenRois<'_> {
    /// Leaves out contours that nearly coincide with one before of their ROI, on its plane: under even-odd both would be gone.
    fn leave_out_near(&mut self, pixel: Option<f64>) {
        let mut regions: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
        for (k, ((roi, _), plane)) in self.used.iter().zip(&self.planes.plane_of).enumerate() {
            regions.entry((*plane, *roi)).or_default().push(k);
        }
        let all = LazyCell::new(|| {
            let drawing = |(k, z): (usize, &f64)| PlaneDrawing {
                name: String::new(),
                z: *z,
                extra: false,
                regions: self.regions(k),
            };
            polygons::pixel::pixel_side(&self.planes.heights.iter().enumerate().map(drawing).collect::<Vec<_>>())
        });
        let (mut out, mut notes) = (HashSet::new(), Vec::new());
        for members in regions.values().filter(|members| members.len() > 1) {
            let line = |k: &usize| {
                let (roi, contour) = self.used[*k];
                self.planes.project(&self.rois[roi].contours[contour].points)
            };
            let lines: Vec<Polygon> = members.iter().map(line).collect();
            for copy in near_copies(&lines, &|| pixel.unwrap_or_else(|| *all)) {
                let [line, of] = [copy.line, copy.of].map(|k| self.used[members[k]]);
                let [number, before] = [line.1 + 1, of.1 + 1];
                let says = copy.says();
                notes.push(format!(
                    "{}: contours {before} and {number} {says}; contour {number} left out",
                    self.rois[line.0].label()
                ));
                out.insert(members[copy.line]);
            }
        }
        let [mut places, mut others] = [0.., 0..];
        self.used.retain(|_| places.next().is_none_or(|k| !out.contains(&k)));
        self.planes.plane_of.retain(|_| others.next().is_none_or(|k| !out.contains(&k)));
        self.notes.extend(notes);
    }

    /// The contours of plane `k`, by ROI.
    pub fn on_plane(&self, k: usize) -> impl Iterator<Item = (usize, &Contour)> {
        let here = self.used.iter().zip(&self.planes.plane_of).filter(move |(_, plane)| **plane == k);
        here.map(|((r, c), _)| (*r, &self.rois[*r].contours[*c]))
    }

    /// Planes that `options` choose, numbered from 0 by height; all without a choice.
    ///
    /// # Errors
    /// [`Error::Setting`] for a number that is none, or fewer than two planes.
    pub fn chosen_planes(&self, options: &ReadOptions) -> Result<Vec<usize>> {
        let count = self.planes.heights.len();
        let fail = |name: &str, message: String| Err(Error::Setting { name: name.into(), message });
        let chosen: Vec<usize> = match (&options.slices, options.keep) {
            (Some(list), _) => {
                if let Some(k) = list.iter().find(|k| **k >= count) {
                    return fail("slices", format!("must name planes 0 to {}; got {k}", count - 1));
                }
                let mut list = list.clone();
                list.sort_unstable();
                list.dedup();
                list
            }
            (None, Some(0)) => return fail("keep", "must be at least 1; got 0".into()),
            (None, keep) => (0..count).step_by(keep.unwrap_or(1)).collect(),
        };
        if chosen.len() < 2 {
            let name = if options.slices.is_some() { "slices" } else { "keep" };
            return fail(name, format!("must leave at least 2 of the {count} planes; got {}", chosen.len()));
        }
        Ok(chosen)
    }

    /// The contours as a stack; heights are those along the planes' normal, x and y those in the planes.
    ///
    /// # Errors
    /// The errors of [`ChosenRois::chosen_planes`], [`polygons::stack`] and [`ContourStack::validate`], with the file's name.
    pub fn stack(&self, options: &ReadOptions) -> Result<ContourStack> {
        let drawings = self.drawings(options)?;
        let planes = Planes { unit: "mm".into(), axes: self.planes.axes, z_out: None };
        let stack = polygons::stack(&drawings, &planes, options.pixel.map(|p| [p; 2]));
        let checked = stack.and_then(|stack| stack.validate().map(|()| stack));
        checked.map_err(|e| e.in_file(&self.set.path))
    }

    /// Doubts about the stack of what was chosen.
    ///
    /// # Errors
    /// The errors of [`ChosenRois::chosen_planes`].
    pub fn doubts(&self, stack: &ContourStack, options: &ReadOptions) -> Result<Vec<String>> {
        let planes = self.chosen_planes(options)?;
        let z = self.heights(&planes);
        let is_interpolated = self.members(&planes).iter().any(|member| !member.between(&z).is_empty());
        Ok(stack.doubts_of_union(is_interpolated))
    }

    /// Words where of several ROIs some are not drawn on planes of others.
    ///
    /// # Errors
    /// The errors of [`ChosenRois::chosen_planes`].
    pub fn on_planes_of_others(&self, options: &ReadOptions) -> Result<Option<String>> {
        let planes = self.chosen_planes(options)?;
        let (members, z) = (self.members(&planes), self.heights(&planes));
        Ok(drawn_on_slices_of_others(&members, &z, true, ["planes", "`all_rois` makes each by itself"]))
    }

    /// Which ROI is drawn on which of some planes; none where it is only one.
    fn members(&self, planes: &[usize]) -> Vec<Member> {
        if self.rois.len() < 2 {
            return Vec::new();
        }
        let mut on: HashSet<(usize, usize)> = HashSet::new();
        on.extend(self.used.iter().zip(&self.planes.plane_of).map(|((roi, _), plane)| (*roi, *plane)));
        let member = |(r, roi): (usize, &&Roi)| Member {
            name: roi.label(),
            drawn: planes.iter().map(|plane| on.contains(&(r, *plane))).collect(),
        };
        self.rois.iter().enumerate().map(member).collect()
    }

    fn heights(&self, planes: &[usize]) -> Vec<f64> {
        planes.iter().map(|k| self.planes.heights[*k]).collect()
    }

    /// The ROIs that have planes of their own, and are interpolated to those of others before they become one with them, on the pixels of their `union`.
    ///
    /// # Errors
    /// The errors of [`ChosenRois::stack`].
    pub fn interpolated(&self, options: &ReadOptions, union: &ContourStack) -> Result<Vec<InterpolatedMember>> {
        let planes = self.chosen_planes(options)?;
        let z = self.heights(&planes);
        let mut interpolated = Vec::new();
        for (r, member) in self.members(&planes).into_iter().enumerate() {
            let slices = member.between(&z);
            if slices.is_empty() {
                continue;
            }
            let drawing =
                |k: usize| PlaneDrawing { regions: vec![self.region(planes[k], r)], ..self.drawing(planes[k]) };
            let drawings: Vec<PlaneDrawing> = member.places().into_iter().map(drawing).collect();
            let all = self.drawings(options)?;
            let own = polygons::slices(&drawings, &all, options.pixel.map(|p| [p; 2]));
            let slices_of = own.map_err(|e| e.in_file(&self.set.path))?;
            let stack = ContourStack { slices: slices_of, unit: union.unit.clone(), ..*union };
            interpolated.push(InterpolatedMember { name: member.name, stack, slices });
        }
        Ok(interpolated)
    }

    /// Words on planes on which contours cross each other or themselves; where a ROI says even-odd outright it is meant.
    pub fn crossing(&self, drawings: &[PlaneDrawing]) -> Vec<String> {
        let is_xor = self.rois.iter().any(|roi| roi.contours.iter().any(Contour::is_xor));
        if is_xor { Vec::new() } else { crossing(drawings) }
    }

    /// What is drawn on the planes that `options` name.
    ///
    /// # Errors
    /// The errors of [`ChosenRois::chosen_planes`].
    pub fn drawings(&self, options: &ReadOptions) -> Result<Vec<PlaneDrawing>> {
        Ok(self.chosen_planes(options)?.into_iter().map(|k| self.drawing(k)).collect())
    }

    fn drawing(&self, k: usize) -> PlaneDrawing {
        let regions = self.regions(k);
        PlaneDrawing { name: format!("k={k}"), z: self.planes.heights[k], extra: false, regions }
    }

    /// The contours of one ROI on plane `k`, in the plane.
    fn region(&self, k: usize, roi: usize) -> Vec<Polygon> {
        let own = self.on_plane(k).filter(|(r, _)| *r == roi);
        own.map(|(_, contour)| self.planes.project(&contour.points)).collect()
    }

    /// The contours of plane `k`, in the plane, those of a ROI together.
    pub(super) fn regions(&self, k: usize) -> Vec<Vec<Polygon>> {
        let mut regions: Vec<Vec<Polygon>> = vec![Vec::new(); self.rois.len()];
        self.on_plane(k).for_each(|(r, contour)| regions[r].push(self.planes.project(&contour.points)));
        regions.retain(|region| !region.is_empty());
        regions
    }

    /// Steps of the output heights of `stack` where none is asked for. Where all its planes lie on those of another ROI that has planes
    /// between them, those are taken for the images' slices, and interpolated contours belong there; else half way in the smallest gap.
    pub fn steps(&self, stack: &ContourStack) -> Option<Steps> {
        let heights: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
        let gap = smallest_gap(&heights)?;
        let images = self.alike().filter_map(|other| other.lies_between(&heights, self));
        let planes = images.min_by(f64::total_cmp).unwrap_or(0.5 * gap);
        let px = stack.spacing[0].min(stack.spacing[1]);
        Some(Steps { planes, heights: planes / (planes / px).ceil().max(1.0) })
    }

    /// Whether its planes are those of the images as far as the file tells: another ROI is drawn on some of them, none on others between them, and none is
    /// left out.
    pub(super) fn is_on_every_image(&self) -> bool {
        let heights = &self.planes.heights;
        let is_even = smallest_gap(heights).is_some_and(|gap| heights.windows(2).all(|w| w[1] - w[0] < LEFT_OUT * gap));
        let others: Vec<ChosenRois<'_>> = if is_even { self.alike().collect() } else { Vec::new() };
        others.iter().any(|other| self.lies_between(&other.planes.heights, other).is_some())
            && others.iter().all(|other| other.lies_between(heights, self).is_none())
    }

    /// All ROIs of the file in the same frame of reference, each by itself, that are closed.
    fn alike(&self) -> impl Iterator<Item = ChosenRois<'_>> {
        let numbers: Vec<i64> = self.rois.iter().map(|roi| roi.number).collect();
        let own = self.set.frames(&numbers);
        let alike = move |roi: &&Roi| own.is_empty() || self.set.frames(&[roi.number]) == own;
        self.set.rois.iter().filter(alike).filter_map(|roi| self.set.closed(vec![roi], None).ok())
    }

    /// Smallest gap of its planes, where it is drawn at all of these heights of another ROI and on planes between them.
    fn lies_between(&self, heights: &[f64], other: &Self) -> Option<f64> {
        let off = (self.planes.axes[2] - other.planes.axes[2]).abs().element_sum();
        let same = self.planes.tolerance.min(other.planes.tolerance);
        let lies = |z: &f64| self.planes.heights.iter().any(|w| (w - z).abs() <= same);
        let (step, gap) = (smallest_gap(&self.planes.heights)?, smallest_gap(heights)?);
        (off < 1e-6 && LEFT_OUT * step <= gap && heights.iter().all(lies)).then_some(step)
    }
}

/// Steps of heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// Between the planes of interpolated contours.
    pub planes: f64,
    /// Between output heights: a whole part of `planes`, as fine as the pixels.
    pub heights: f64,
}
