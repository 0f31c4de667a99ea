//! Replay of a run: every answer of a backend recorded once, then given at no cost. What is left of a run is what its host does: the time of a
//! run on an infinitely fast device, but for what the device's own host code does to ask and to take in the answers.

use std::collections::VecDeque;
use std::hash::{DefaultHasher, Hasher};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::interval_morph::Morphed;
use super::jobs::{Filled, SweepJob, SweepPair, Traced};
use super::requests::{
    ContourRequest, LayerRequest, MorphRequest, PartRequest, SlopeRequest, SweepRequest, TraceRequest,
};
use super::{Backend, PaddedSlice};
use crate::error::{Error, Result};
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::progress::Progress;
use crate::registration::displacement::{Displacement, DisplacementJob};
use crate::report::DeviceUse;

/// Values of a field that tell it from another one.
const SAMPLES: usize = 64;

/// A backend's answers to the questions of a run, in their order.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    calls: VecDeque<Call>,
}

/// A question and its answer.
#[derive(Debug, Clone)]
struct Call {
    question: &'static str,
    print: u64,
    answer: Answer,
}

#[derive(Debug, Clone)]
enum Answer {
    Fields(Vec<Field>),
    Traced(Vec<Traced>),
    Filled(Vec<Filled>),
    Morphed(Vec<Morphed>),
    Displacements(Vec<Displacement>),
    Layers(Vec<Vec<SparseImage<f32>>>),
}

/// A backend that keeps the answers of another one.
pub struct Recorder<'b> {
    backend: &'b dyn Backend,
    recording: Mutex<Recording>,
}

impl<'b> Recorder<'b> {
    /// Records what `backend` answers.
    pub fn new(backend: &'b dyn Backend) -> Self {
        Recorder { backend, recording: Mutex::default() }
    }

    /// The answers so far.
    pub fn recording(self) -> Recording {
        self.recording.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn keep<T: Clone>(&self, question: &'static str, print: u64, given: Result<T>, of: fn(T) -> Answer) -> Result<T> {
        let given = given?;
        locked(&self.recording).calls.push_back(Call { question, print, answer: of(given.clone()) });
        Ok(given)
    }
}

/// A backend that gives the recorded answers, each once.
pub struct Replay {
    recording: Mutex<Recording>,
}

impl Replay {
    /// Replays a recording.
    pub fn new(recording: Recording) -> Self {
        Replay { recording: Mutex::new(recording) }
    }

    /// Number of answers that nobody has asked for.
    pub fn left(&self) -> usize {
        locked(&self.recording).calls.len()
    }

    fn next<T>(&self, question: &'static str, print: u64, of: fn(Answer) -> Option<T>) -> Result<T> {
        let other = |what: &str| Error::Gpu(format!("replay: `{question}` is asked, {what}"));
        let call = locked(&self.recording).calls.pop_front().ok_or_else(|| other("nothing more was recorded"))?;
        if (call.question, call.print) != (question, print) {
            return Err(other(&format!("`{}` of other jobs, slices or times was recorded", call.question)));
        }
        of(call.answer).ok_or_else(|| other("another answer was recorded"))
    }
}

/// What tells a question from another one: sizes, numbers, and some values of every field.
struct Print(DefaultHasher);

impl Print {
    fn of(h: [f64; 2]) -> Self {
        let mut print = Print(DefaultHasher::new());
        print.numbers(&h);
        print
    }

    fn number(&mut self, n: usize) {
        self.0.write_usize(n);
    }

    fn numbers(&mut self, values: &[f64]) {
        self.number(values.len());
        values.iter().for_each(|v| self.0.write_u64(v.to_bits()));
    }

    fn field(&mut self, field: &Field) {
        field.dims.iter().for_each(|n| self.number(*n));
        // An odd stride, so that it is not always the same column.
        let stride = (field.data.len() / SAMPLES) | 1;
        field.data.iter().step_by(stride).for_each(|v| self.0.write_u64(v.to_bits()));
    }

    fn sweep(&mut self, job: &SweepJob<'_>) {
        self.field(&job.source);
        self.field(&job.goal);
        self.number(job.seeds.len());
        self.numbers(&job.times);
    }

    fn pair(&mut self, pair: &SweepPair<'_>) {
        self.sweep(&pair.up);
        self.sweep(&pair.down);
        self.number(pair.anchors.len());
    }

    fn layers(&mut self, request: &LayerRequest<'_>) {
        self.numbers(&request.h);
        request.moving.fields[request.interval..=request.interval + 1].iter().for_each(|field| self.field(field));
        request.slopes.iter().for_each(|slopes| self.field(slopes));
        self.numbers(request.times);
        self.numbers(&[request.limit]);
    }

    fn done(self) -> u64 {
        self.0.finish()
    }
}

fn contour_print(request: &ContourRequest<'_>) -> u64 {
    let mut print = Print::of(request.h);
    print.numbers(&[request.options.sigma, request.options.half_width]);
    request.dims.iter().for_each(|n| print.number(*n));
    for slice in request.slices {
        match slice {
            PaddedSlice::Mask(mask) => {
                let stride = (mask.len() / SAMPLES) | 1;
                mask.iter().step_by(stride).for_each(|m| print.number(usize::from(*m)));
            }
            PaddedSlice::Level(field) => print.field(field),
        }
    }
    print.done()
}

fn part_print(request: &PartRequest<'_>) -> u64 {
    let mut print = Print::of(request.h);
    for job in request.jobs {
        print.field(&job.whole);
        print.number(job.inside.iter().filter(|inside| **inside).count());
    }
    print.done()
}

fn trace_print(request: &TraceRequest<'_>) -> u64 {
    let mut print = Print::of(request.h);
    print.numbers(&[request.options.half_width, request.options.cfl, request.options.tolerance, request.options.limit]);
    for job in request.jobs {
        print.field(&job.source);
        print.field(&job.goal);
        print.number(job.seeds.len());
    }
    print.done()
}

fn sweep_print(request: &SweepRequest<'_>) -> u64 {
    let mut print = Print::of(request.h);
    print.numbers(&[request.options.half_width, request.options.cfl, request.options.limit]);
    request.pairs.iter().for_each(|pair| print.pair(pair));
    print.done()
}

fn morph_print(request: &MorphRequest<'_>) -> u64 {
    let mut print = Print::of(request.h);
    print.numbers(&[request.options.half_width, request.options.cfl, request.options.limit]);
    for interval in request.intervals {
        interval.image.dims.iter().for_each(|n| print.number(*n));
        print.numbers(&interval.times);
        interval.pairs.iter().for_each(|(_, pair)| print.pair(pair));
        print.number(interval.solids.len());
        print.number(interval.frame.as_ref().map_or(0, |frame| 1 + frame.parts));
    }
    print.done()
}

fn displacement_print(job: &DisplacementJob<'_>) -> u64 {
    let mut print = Print::of(job.h);
    job.fields.iter().for_each(|field| print.field(field));
    print.numbers(job.gaps);
    print.number(job.rounds.start);
    print.number(job.rounds.end);
    print.done()
}

fn slope_print(request: &SlopeRequest<'_>) -> u64 {
    let mut print = Print::of([request.moving.px, request.moving.relief]);
    print.numbers(&[request.moving.doubt]);
    request.moving.fields.iter().for_each(|field| print.field(field));
    print.numbers(&request.moving.gaps);
    print.number(request.wanted.start);
    print.number(request.wanted.end);
    print.done()
}

fn layer_print(requests: &[LayerRequest<'_>]) -> u64 {
    let mut print = Print::of([0.0; 2]);
    requests.iter().for_each(|request| print.layers(request));
    print.done()
}

/// The questions, each with what tells it apart and its kind of answer.
macro_rules! questions {
    ($($question:ident($request:ty $(, $progress:ident)?) -> $given:ty, $print:ident, $kind:ident;)*) => {
        impl Backend for Recorder<'_> {
            fn name(&self) -> String {
                self.backend.name()
            }

            fn host_bytes(&self) -> u64 {
                self.backend.host_bytes()
            }

            fn device_use(&self) -> Option<DeviceUse> {
                self.backend.device_use()
            }

            fn run_begins(&self) {
                self.backend.run_begins();
            }

            fn run_ends(&self) {
                self.backend.run_ends();
            }

            $(fn $question(&self, request: &$request $(, $progress: &dyn Progress)?) -> Result<$given> {
                let given = self.backend.$question(request $(, $progress)?);
                self.keep(stringify!($question), $print(request), given, Answer::$kind)
            })*
        }

        impl Backend for Replay {
            fn name(&self) -> String {
                "a replay".into()
            }

            fn device_use(&self) -> Option<DeviceUse> {
                Some(DeviceUse::default())
            }

            $(fn $question(&self, request: &$request $(, $progress: &dyn Progress)?) -> Result<$given> {
                $(let _ = $progress;)?
                self.next(stringify!($question), $print(request), |answer| match answer {
                    Answer::$kind(given) => Some(given),
                    _ => None,
                })
            })*
        }
    };
}

questions! {
    contour_fields(ContourRequest<'_>, progress) -> Vec<Field>, contour_print, Fields;
    part_fields(PartRequest<'_>) -> Vec<Field>, part_print, Fields;
    trace(TraceRequest<'_>, progress) -> Vec<Traced>, trace_print, Traced;
    propagate(SweepRequest<'_>, progress) -> Vec<Filled>, sweep_print, Filled;
    morph_layers(MorphRequest<'_>, progress) -> Vec<Morphed>, morph_print, Morphed;
    displacements(DisplacementJob<'_>) -> Vec<Displacement>, displacement_print, Displacements;
    moving_slopes(SlopeRequest<'_>, progress) -> Vec<Field>, slope_print, Fields;
    moving_layers([LayerRequest<'_>]) -> Vec<Vec<SparseImage<f32>>>, layer_print, Layers;
}

fn locked(recording: &Mutex<Recording>) -> MutexGuard<'_, Recording> {
    recording.lock().unwrap_or_else(PoisonError::into_inner)
}
