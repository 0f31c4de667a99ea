//! What lies below the first contour and above the last one.

use super::{Run, Sink};
use crate::contours::Contour;
use crate::ends::{End, EndSpec, end};
use crate::error::Result;
use crate::field::covered;
use crate::fit::Fitted;
use crate::heights::Heights;
use crate::jobs::Direction;
use crate::moving_stack::MovingStack;
use crate::report::{EndReport, Side};
use crate::settings::EndRule;
use crate::shelf::Shelf;
use crate::tile::Tile;

impl<'a> Run<'a> {
    /// Both ends of the body, from what was fitted at the first and last contour.
    pub(super) fn ends(
        &mut self,
        contours: &Shelf<'a, Contour>,
        fitted: [&Fitted; 2],
        moving: Option<&MovingStack<'a>>,
    ) -> Result<[End; 2]> {
        let last = contours.len() - 1;
        let (mut warnings, mut told) = (Vec::new(), Vec::new());
        let mut make = |at: usize, next: usize, direction, rule| {
            if !self.span.ends[usize::from(at > 0)] {
                return Ok(End::cut(contours.light(at).z));
            }
            let contour = contours.get(at)?;
            let fitted = fitted[usize::from(at > 0)];
            let rate = moving.map(|m| m.rate(at)).transpose()?;
            let whole = rate.map(|rate| fitted.with_motion(&contour, &rate, self.h, 1.0));
            let gap = (contour.z - contours.light(next).z).abs();
            let spec = EndSpec {
                contour: &contour,
                fitted: whole.as_ref().unwrap_or(fitted),
                direction,
                rule,
                gap,
                highest: self.settings.cap_gaps * gap,
                margin: self.margin,
            };
            let made = end(&spec, self.h, self.backend, &mut warnings)?;
            told.push(self.end_report(&spec, &made)?);
            Ok(made)
        };
        let ends = [
            make(0, 1, Direction::Down, self.settings.end_bottom)?,
            make(last, last - 1, Direction::Up, self.settings.end_top)?,
        ];
        self.report.warnings.append(&mut warnings);
        self.report.ends = told;
        Ok(ends)
    }

    /// What `made` and other rules add to the body.
    fn end_report(&self, spec: &EndSpec<'_>, made: &End) -> Result<EndReport> {
        let caps = match spec.rule {
            EndRule::Extrapolate => None,
            // What it warns of concerns a rule that is not in use.
            _ => Some(end(&EndSpec { rule: EndRule::Extrapolate, ..*spec }, self.h, self.backend, &mut Vec::new())?),
        };
        let image = self.canvas();
        let mut area = 0.0;
        let whole = Tile { origin: [0, 0], dims: spec.contour.phi.dims };
        image.visit(&whole, |_, n| area += covered(spec.contour.phi.data[n]));
        let pixel = self.stack.spacing[0] * self.stack.spacing[1];
        let volume = |end: &End| pixel * end.volume(area, &image);
        Ok(EndReport {
            side: if spec.direction == Direction::Up { Side::Top } else { Side::Bottom },
            z: spec.contour.z,
            area: pixel * area,
            used: volume(made),
            half_slice: 0.5 * spec.gap * pixel * area,
            extrapolate: volume(caps.as_ref().unwrap_or(made)),
        })
    }

    /// The layers below the first contour.
    pub(super) fn below(
        &self,
        contours: &Shelf<'a, Contour>,
        ends: &[End; 2],
        heights: &Heights,
        sink: &mut Sink<'_>,
    ) -> Result<()> {
        if !self.span.ends[0] {
            return Ok(());
        }
        let first = contours.get(0)?;
        let mut below = heights.all.iter().filter(|x| x.z < first.z);
        below.try_for_each(|x| sink(self.layer(x, ends[0].layer(x.z, &first, self.canvas()))))
    }

    /// The last contour's layer and those above it.
    pub(super) fn above(
        &self,
        contours: &Shelf<'a, Contour>,
        ends: &[End; 2],
        heights: &Heights,
        sink: &mut Sink<'_>,
    ) -> Result<()> {
        let number = self.span.layers.end;
        let last = contours.get(number)?;
        sink(self.contour_layer(&heights.contours[number], &last, number))?;
        if !self.span.ends[1] {
            return Ok(());
        }
        let mut above = heights.all.iter().filter(|x| x.z > last.z);
        above.try_for_each(|x| sink(self.layer(x, ends[1].layer(x.z, &last, self.canvas()))))
    }
}
