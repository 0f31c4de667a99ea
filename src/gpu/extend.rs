//! Extension of values off the contour along its normals on the GPU, in band order.

use super::band::Front;
use super::buffer::Buffer;
use super::kernels::{Bound, shader};
use super::layout::{Job, Params, Source, Work};
use super::recorder::Recorder;
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

/// Upwind neighbours of a front's band.
pub struct Upwind<'g> {
    /// The neighbours, by band place.
    pub sources: Buffer<[Source]>,
    /// Finds those of the band as it is.
    pub find: Bound<'g>,
}

impl<'g> Upwind<'g> {
    /// Room for the neighbours of a front.
    ///
    /// # Errors
    /// The errors of [`super::device::Device::buffer`].
    pub fn new(front: &Front<'g>) -> Result<Self> {
        let Front { gpu, params, jobs, work, band, phi, slots, .. } = front;
        let sources = gpu.device.storage("sources", front.capacity)?;
        Ok(Upwind { find: Find { params, jobs, work, band, phi, slots, sources: &sources }.bind(gpu), sources })
    }
}

/// Courses of a front, by band place: two copies, and the passes from one to the other.
pub struct Courses<'g> {
    /// Both copies.
    pub copies: [Buffer<[[f32; 4]]>; 2],
    /// A pass from one copy to the other, there and back.
    pub pass: [Bound<'g>; 2],
    /// The way from the old band to the new, from one copy to the other.
    pub carry: [Bound<'g>; 2],
}

impl<'g> Courses<'g> {
    /// Room for the courses of a front.
    ///
    /// # Errors
    /// The errors of [`super::device::Device::buffer`].
    pub fn new(front: &Front<'g>, Upwind { sources, .. }: &Upwind<'g>) -> Result<Self> {
        let Front { gpu, params, work, earlier, capacity, .. } = front;
        let copies = [gpu.device.storage("courses", *capacity)?, gpu.device.storage("courses", *capacity)?];
        let ways = [[0, 1], [1, 0]].map(|way| way.map(|k| &copies[k]));
        Ok(Courses {
            pass: ways.map(|[courses, next_courses]| ExtendCourses { work, sources, courses, next_courses }.bind(gpu)),
            carry: ways.map(|[courses, next_courses]| Carry { params, work, courses, next_courses, earlier }.bind(gpu)),
            copies,
        })
    }

    /// Records some passes, an even number, from the copy that holds the courses.
    pub fn extend(&self, recorder: &mut Recorder<'_>, front: &Front<'_>, holds: usize, passes: usize) {
        debug_assert!(passes.is_multiple_of(2), "courses end where they began");
        for pass in 0..passes {
            recorder.run(&self.pass[(holds + pass) % 2], front.per_pixel());
        }
    }
}
