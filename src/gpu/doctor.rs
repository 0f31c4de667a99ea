//! Questions of the self-test to a driver: how far it counts, and what it makes of a number that is none.

use super::Gpu;
use super::kernels::shader;
use super::recorder::{Recorder, Size};
use crate::error::Result;

shader! {
    doctor = ;

    /// Counts in one long loop.
    Count for count, "doctor_count" {
        asked: Read [u32],
        answer: Write [u32],
    }

    /// Compares and adds NaN, takes a root and a quotient.
    NotANumber for not_a_number, "doctor_nan" {
        asked: Read [u32],
        answer: Write [u32],
    }
}

/// Numbers of an answer.
const ANSWERS: usize = 7;

/// The driver's answer to `trips` trips of a loop, NaN and 1, as `shaders/doctor.wgsl` numbers it.
pub fn ask(gpu: &Gpu, trips: u32) -> Result<Vec<u32>> {
    let device = &gpu.device;
    let asked = &device.upload("asked", &[trips, 1, f32::NAN.to_bits(), 1f32.to_bits()])?;
    let answer = &device.zeroed("answer", ANSWERS)?;
    let mut recorder = Recorder::new(device, &gpu.profiler);
    recorder.run(&Count { asked, answer }.bind(gpu), Size::One);
    recorder.run(&NotANumber { asked, answer }.bind(gpu), Size::One);
    recorder.submit()?;
    device.read(answer, 0, ANSWERS)
}
