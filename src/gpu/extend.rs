//! Extension of values off the contour along its normals on the GPU, in band order.

use super::device::Buffer;
use super::kernels::{Bound, shader};
use super::layout::{Job, Params, Source, Work};
use super::{Gpu, band::Front};
use crate::error::Result;

shader! {
    extend = "common/job.wgsl" + "common/field.wgsl" + twin "src/reference/extend.rs";

    /// Upwind neighbours of every band pixel.
    Find for find, "extend_find" {
        params: Uniform Params,
        jobs: Read [Job],
        work: Read Work,
        band: Read [[u32; 2]],
        phi: Read [f32],
        slots: Read [u32],
        sources: Write [Source],
    }

    /// One pass over courses.
    ExtendCourses for extend_courses, "extend_courses" {
        work: Read Work,
        sources: Write [Source],
        courses: Read [[f32; 4]],
        next_courses: Write [[f32; 4]],
    }

    /// One pass over numbers.
    ExtendLine for extend_line, "extend_line" {
        work: Read Work,
        sources: Write [Source],
        line: Read [f32],
        next_line: Write [f32],
    }

    /// Courses from the places of the band before its last rebuild to those after it.
    Carry for carry, "extend_carry" {
        params: Uniform Params,
        work: Read Work,
        courses: Read [[f32; 4]],
        next_courses: Write [[f32; 4]],
        earlier: Read [u32],
    }
}

/// Courses of a front, by band place: two copies, and the passes from one to the other.
pub struct Courses<'g> {
    /// Both copies.
    pub copies: [Buffer<[[f32; 4]]>; 2],
    /// Upwind neighbours.
    pub sources: Buffer<[Source]>,
    /// Finds those of the band as it is.
    pub find: Bound<'g>,
    /// A pass from one copy to the other, there and back.
    pub extend: [Bound<'g>; 2],
    /// The way from the old band to the new, from one copy to the other.
    pub carry: [Bound<'g>; 2],
}

impl<'g> Courses<'g> {
    /// Room for the courses of a front.
    pub fn new(gpu: &'g Gpu, front: &Front<'g>) -> Result<Self> {
        let room = front.capacity;
        let copies = [gpu.device.storage("courses", room)?, gpu.device.storage("courses", room)?];
        let sources = gpu.device.storage("sources", room)?;
        let Front { params, jobs, work, band, phi, slots, earlier, .. } = front;
        let ways = [[0, 1], [1, 0]].map(|way| way.map(|k| &copies[k]));
        Ok(Courses {
            find: Find { params, jobs, work, band, phi, slots, sources: &sources }.bind(gpu),
            extend: ways.map(|[courses, next_courses]| {
                ExtendCourses { work, sources: &sources, courses, next_courses }.bind(gpu)
            }),
            carry: ways.map(|[courses, next_courses]| Carry { params, work, courses, next_courses, earlier }.bind(gpu)),
            copies,
            sources,
        })
    }
}
