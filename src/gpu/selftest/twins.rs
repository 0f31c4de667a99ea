//! Every stage on the GPU beside its f64 twin, on contours of every kind: what the self-test runs once and the tests run at several sizes.

use std::borrow::Cow;

use glam::DVec2;

use crate::backend::jobs::{PartJob, SweepJob, SweepPair, TraceJob, full_distance};
use crate::backend::requests::{ContourRequest, PartRequest, SweepRequest, TraceRequest};
use crate::backend::{Backend, ContourOptions, PaddedSlice};
use crate::contour::caps::{Cap, CapProfile};
use crate::contour::direction::Direction;
use crate::contour::seeds::seeds;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::selftest::cases::{BETA, Cases, GAMMA};
use crate::gpu::selftest::comparison::Comparison;
use crate::gpu::selftest::moving_twins;
use crate::gpu::selftest::single_kernels::{DistanceReach, Speeds};
use crate::grid::field::Field;
use crate::grid::spline::HermiteArc;
use crate::grid::tile::Tile;
use crate::progress::Silent;
use crate::reference::Reference;
use crate::reference::band::Band;
use crate::reference::distance::{distance_of, far_distance};
use crate::reference::exact::exact_distance;
use crate::reference::extend::Upwind;
use crate::reference::hj_step::{Scratch, Speed, Tube, hj_step};
use crate::reference::particles::{Particle, correct, land, predict};
use crate::reference::reinit::reinit;
use crate::reference::scatter::scatter;
use crate::settings::AntiAlias;

/// Every kernel and every stage on these cases.
///
/// # Errors
/// [`crate::Error::Gpu`] when the GPU cannot do a stage at all.
pub fn compare(gpu: &Gpu, cases: &Cases) -> Result<Vec<Comparison>> {
    let mut out = vec![
        distance(gpu, cases)?,
        near(gpu, cases)?,
        far(gpu, cases)?,
        exact(gpu, cases)?,
        band(gpu, cases)?,
        step_towards(gpu, cases)?,
        step_given(gpu, cases)?,
        reinitialisation(gpu, cases)?,
        carried(gpu, cases)?,
        particles(gpu, cases)?,
    ];
    out.extend(compare_stages(gpu, cases)?);
    Ok(out)
}

/// The stages that the pipeline asks for, on these cases.
///
/// # Errors
/// The errors of [`compare`].
pub fn compare_stages(gpu: &Gpu, cases: &Cases) -> Result<Vec<Comparison>> {
    let mut out = vec![parts(gpu, cases)?];
    out.extend(contour_fields(gpu, cases)?);
    out.extend(morphs(gpu, cases)?);
    out.extend(sweeps(gpu, cases)?);
    out.extend(moving_twins::compare(gpu, cases.h, cases.scale)?);
    Ok(out)
}

fn distance(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let twin: Vec<Field> = cases.phi[..3].iter().map(|u| distance_of(u, cases.h)).collect();
    Ok(Comparison::fields(
        "distance",
        2e-4,
        &gpu.distances(&cases.phi[..3], cases.h, DistanceReach::Everywhere)?,
        &twin,
    ))
}

fn near(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let limit = 7.0;
    let cut = |u: &Field| {
        let d = distance_of(u, cases.h);
        Field { dims: d.dims, data: d.data.iter().map(|v| v.clamp(-limit, limit)).collect() }
    };
    let twin: Vec<Field> = cases.phi[..3].iter().map(cut).collect();
    let ours = gpu.distances(&cases.phi[..3], cases.h, DistanceReach::Within(limit))?;
    Ok(Comparison::fields("distance near contours", 2e-4, &ours, &twin))
}

fn far(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let limit = 12.0;
    let twin: Vec<Field> = cases.phi.iter().map(|u| far_distance(u.clone(), cases.h, limit)).collect();
    Ok(Comparison::fields(
        "far distance",
        1e-4,
        &gpu.distances(&cases.phi, cases.h, DistanceReach::Beyond(limit))?,
        &twin,
    ))
}

fn exact(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let twin: Vec<Field> = cases.phi[..3].iter().map(|u| exact_distance(&u.inside(), u.dims, cases.h)).collect();
    Ok(Comparison::fields("exact distance", 2e-5, &gpu.exact_distances(&cases.phi[..3], cases.h)?, &twin))
}

/// The list of nodes must be the twin's to the last; `worst` counts the jobs that differ beside the level sets.
fn band(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let (nodes, phi) = gpu.bands(&cases.phi, &cases.later, cases.tubes())?;
    let (mut lists, mut fields) = (Vec::new(), Vec::new());
    for (first, second) in cases.phi.iter().zip(&cases.later) {
        let mut field = first.clone();
        let mut band = Band::new(&mut field, GAMMA);
        field = second.clone();
        band.rebuild(&mut field);
        lists.push(band.nodes().collect::<Vec<_>>());
        // Off the band the twin keeps what the field was.
        fields.push(field);
    }
    let in_band = |q: usize, n: usize| lists[q].binary_search(&n).is_ok();
    let mut out = Comparison::nodes("band", 1e-6, &phi, &fields, in_band);
    for (q, a, b) in out.pairs(&"lists of nodes", &nodes, &lists) {
        out.value(|| format!("list of job {q}"), f64::from(u8::from(a != b)), 0.0);
    }
    Ok(out)
}

fn stepped<'a>(cases: &Cases, dt: &[f64], speed: impl Fn(usize) -> Speed<'a>) -> Vec<Field> {
    let step = |(q, phi): (usize, &Field)| {
        let mut phi = phi.clone();
        let band = Band::new(&mut phi, GAMMA);
        let mut scratch = Scratch::default();
        hj_step(&mut phi, speed(q), &band, cases.h, Tube { beta: BETA, gamma: GAMMA }, dt[q], &mut scratch);
        reinit(&mut phi, &band, cases.h, 1, &mut scratch);
        phi
    };
    cases.phi.iter().enumerate().map(step).collect()
}

const STEPS: [f64; 4] = [0.03, 0.05, 0.02, 0.04];

fn step_towards(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let twin = stepped(cases, &STEPS, |q| Speed::Towards(&cases.goal[q]));
    let ours = gpu.hj_step(&cases.phi, Speeds::Towards(&cases.goal), cases.tubes(), &STEPS)?;
    Ok(Comparison::fields("step towards a contour", 2e-5, &ours, &twin))
}

fn step_given(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let speed = |f: &Field| Field::from_fn(f.dims, |i, j| f64::from(((0.2 * i as f64).sin() + 0.05 * j as f64) as f32));
    let speeds: Vec<Field> = cases.phi.iter().map(speed).collect();
    let twin = stepped(cases, &STEPS, |q| Speed::Given(&speeds[q]));
    let ours = gpu.hj_step(&cases.phi, Speeds::Given(&speeds), cases.tubes(), &STEPS)?;
    Ok(Comparison::fields("step at given speed", 2e-5, &ours, &twin))
}

fn reinitialisation(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let iterations = 6;
    // Not a distance to begin with.
    let bent = |f: &Field| Field { dims: f.dims, data: f.data.iter().map(|v| f64::from((1.4 * v) as f32)).collect() };
    let bent: Vec<Field> = cases.phi.iter().map(bent).collect();
    let twin = |phi: &Field| {
        let mut phi = phi.clone();
        let band = Band::new(&mut phi, GAMMA);
        reinit(&mut phi, &band, cases.h, iterations, &mut Scratch::default());
        phi
    };
    let twin: Vec<Field> = bent.iter().map(twin).collect();
    Ok(Comparison::fields("reinitialisation", 2e-5, &gpu.reinit(&bent, cases.tubes(), iterations)?, &twin))
}

/// Scatter, fill, extension and carrying in one: courses where both bands have their contours.
fn carried(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let passes = 5;
    let jobs = cases.sweeps(&cases.phi, &cases.goal);
    let ours = gpu.carried(&jobs, &cases.later, cases.tubes(), passes)?;
    let mut out = Comparison::new("courses at pixels", 5e-5);
    for (q, ours, job) in out.pairs(&"jobs", &ours, &jobs) {
        let later = &cases.later[q];
        let mut phi = job.source.clone().into_owned();
        let mut band = Band::new(&mut phi, GAMMA);
        let mut upwind = Upwind::default();
        let mut courses: Vec<HermiteArc> = scatter(&phi, &band, cases.h, &job.seeds, &job.courses);
        let mut extend = |phi: &Field, band: &Band, courses: &mut Vec<HermiteArc>| {
            upwind.find(phi, band, cases.h);
            upwind.extend(courses, band, passes, &mut Vec::new());
        };
        extend(&phi, &band, &mut courses);
        phi = later.clone();
        band.rebuild(&mut phi);
        extend(&phi, &band, &mut courses);
        if ours.len() != later.data.len() {
            out.value(|| format!("nodes of job {q}"), f64::NAN, later.data.len() as f64);
            continue;
        }
        for n in band.nodes() {
            for (k, a, b) in out.pairs(&"parameters", &ours[n], &courses[n]) {
                out.value(|| format!("job {q}, node {n}, parameter {k}"), *a, *b);
            }
        }
    }
    Ok(out)
}

fn particles(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let starts: Vec<Vec<DVec2>> =
        cases.phi.iter().map(|phi| seeds(phi, cases.h, 0.5).iter().map(|s| s.x).collect()).collect();
    let ours = gpu.advect(&starts, [&cases.phi, &cases.later, &cases.later], cases.tubes(), &STEPS)?;
    let mut out = Comparison::new("particles", 2e-4);
    for (q, ours, _) in out.pairs(&"jobs", &ours, &cases.phi) {
        let (before, after) = (&cases.phi[q], &cases.later[q]);
        let mut twin: Vec<Particle> = seeds(before, cases.h, 0.5).iter().map(Particle::at).collect();
        predict(&mut twin, before, after, cases.h, STEPS[q]);
        correct(&mut twin, after, after, cases.h, STEPS[q], STEPS[q]);
        land(&mut twin, after, after, cases.h);
        for (k, a, b) in out.pairs(&format_args!("particles of job {q}"), ours, &twin) {
            let mut value = |what: &str, x, y| out.value(|| format!("job {q}, particle {k}, {what}"), x, y);
            value("share to which it arrives", a.kept, b.kept);
            value("S", a.distance, full_distance(b.covered, b.kept, [b.own, b.share]));
            if b.kept > 0.0 {
                value("length of the path", a.arc, b.arc);
                (0..2).for_each(|axis| value("landing", a.landing[axis], b.x[axis]));
            }
        }
    }
    Ok(out)
}

fn parts(gpu: &Gpu, cases: &Cases) -> Result<Comparison> {
    let job = |phi: &Field| {
        let middle = phi.dims[0] / 2;
        let inside = phi.data.iter().enumerate().map(|(n, v)| *v < 0.0 && n % phi.dims[0] < middle).collect();
        PartJob { whole: distance_of(phi, cases.h), inside }
    };
    // The second job's left disc; of the others a part of nothing and a whole.
    let mut jobs = vec![job(&cases.phi[1])];
    jobs.push(PartJob { inside: cases.phi[2].inside(), whole: distance_of(&cases.phi[2], cases.h) });
    jobs.push(PartJob { inside: vec![false; cases.phi[0].data.len()], whole: distance_of(&cases.phi[0], cases.h) });
    jobs.push(job(&cases.phi[1]));
    // Two rectangles one pixel apart: the pixels between them lie at edges of both, nearer to the other's.
    let dims = [35, 31];
    let in_left = |i: usize, j: usize| (9..16).contains(&i) && (9..22).contains(&j);
    let in_right = |i: usize, j: usize| (17..25).contains(&i) && (11..20).contains(&j);
    let level = |i, j| if in_left(i, j) { -0.375 } else { 0.625 };
    let near = Field::from_fn(dims, |i, j| if in_right(i, j) { -1.5 } else { level(i, j) });
    let left = (0..dims[0] * dims[1]).map(|n| in_left(n % dims[0], n / dims[0])).collect();
    jobs.push(PartJob { whole: distance_of(&near, cases.h), inside: left });
    let twin = Reference.part_fields(&PartRequest { jobs: &jobs, h: cases.h })?;
    Ok(Comparison::fields("parts", 3e-4, &gpu.part_fields(&PartRequest { jobs: &jobs, h: cases.h })?, &twin))
}

fn contour_fields(gpu: &Gpu, cases: &Cases) -> Result<Vec<Comparison>> {
    let mut out = Vec::new();
    for (anti_alias, stage) in [
        (AntiAlias::None, "contour of a mask"),
        (AntiAlias::Eq6, "contour of a mask, Eq. 6"),
        (AntiAlias::Kernel, "contour of a mask, kernel"),
    ] {
        let options = ContourOptions { anti_alias, sigma: 1.0, half_width: GAMMA };
        let (mut ours, mut twin) = (Vec::new(), Vec::new());
        for phi in &cases.phi {
            let slices =
                [PaddedSlice::Mask(phi.inside()), PaddedSlice::Level(phi.clone()), PaddedSlice::Mask(phi.inside())];
            let request = ContourRequest { slices: &slices, dims: phi.dims, h: cases.h, options };
            ours.extend(gpu.contour_fields(&request, &Silent)?);
            twin.extend(Reference.contour_fields(&request, &Silent)?);
        }
        out.push(Comparison::fields(stage, 1e-3, &ours, &twin));
    }
    Ok(out)
}

/// A whole morph: what it measures, and that it takes the same steps.
fn morphs(gpu: &Gpu, cases: &Cases) -> Result<Vec<Comparison>> {
    let job = |(source, goal)| TraceJob {
        source: Cow::Borrowed(source),
        goal: Cow::Borrowed(goal),
        seeds: seeds(source, cases.h, 0.5),
    };
    let jobs: Vec<TraceJob<'_>> = cases.phi.iter().zip(&cases.goal).map(job).collect();
    let request = TraceRequest { jobs: &jobs, h: cases.h, options: Cases::options() };
    let ours = gpu.trace(&request, &Silent)?;
    let twin = Reference.trace(&request, &Silent)?;
    let (mut steps, mut out) = (Comparison::new("steps of morphs", 1e-3), Comparison::new("morphs", 2e-3));
    for (q, a, b) in out.pairs(&"jobs", &ours, &twin) {
        steps.value(|| format!("job {q}, steps"), a.steps as f64, b.steps as f64);
        let share = a.pixels as f64 / b.pixels.max(1) as f64;
        steps.value(|| format!("job {q}, share of pixels"), share, f64::from(u8::from(b.pixels > 0)));
        out.value(|| format!("job {q}, residual"), a.residual.max, b.residual.max);
        for (n, k, l) in out.pairs(&format_args!("tracks of job {q}"), &a.tracks, &b.tracks) {
            let mut value = |what: &str, x, y| out.value(|| format!("job {q}, track {n}, {what}"), x, y);
            value("share to which it arrives", k.kept, l.kept);
            value("S", k.distance, l.distance);
            // Where nothing is left of a particle, it stands wherever its front left it: nobody reads its place.
            let kept = k.kept.max(l.kept);
            (0..2).for_each(|axis| value("landing, weighted", kept * k.landing[axis], kept * l.landing[axis]));
        }
    }
    Ok(vec![steps, out])
}

/// Whole sweeps in both directions and the slices made of them, one of which the host mends.
fn sweeps(gpu: &Gpu, cases: &Cases) -> Result<Vec<Comparison>> {
    let times = [0.2, 0.45, 0.5, 0.9];
    let pairs = || -> Vec<SweepPair<'_>> {
        let ups = cases.sweeps(&cases.phi, &cases.later);
        let downs = cases.sweeps(&cases.later, &cases.phi);
        let pair = |(up, down)| SweepPair {
            up: SweepJob { times: times.to_vec(), ..up },
            down: SweepJob { times: times.iter().rev().map(|t| 1.0 - t).collect(), ..down },
            anchors: Vec::new(),
            holes: Cow::Borrowed(&[]),
        };
        let mut pairs: Vec<SweepPair<'_>> = ups.into_iter().zip(downs).map(pair).collect();
        // The host mends one pair's slices: a hole that closes.
        if let Some(pair) = pairs.first_mut() {
            let [nx, ny] = pair.up.source.dims;
            let tile = Tile { origin: [7, 4], dims: [nx - 9, ny - 7] };
            let field =
                Field::from_fn(tile.dims, |i, j| ((i as f64 - 17.0).powi(2) + (j as f64 - 20.0).powi(2)).sqrt() - 6.0);
            let hole = Cap {
                tile,
                field,
                hole: true,
                open: false,
                depth: 6.0,
                height: 0.7,
                farthest: 14.0,
                profile: CapProfile::new(0.0),
            };
            pair.holes = Cow::Owned(vec![(hole, Direction::Up)]);
        }
        pairs
    };
    let pairs = pairs();
    let request = SweepRequest { pairs: &pairs, h: cases.h, options: Cases::options() };
    let ours = gpu.propagate(&request, &Silent)?;
    let twin = Reference.propagate(&request, &Silent)?;
    let mut steps = Comparison::new("steps of sweeps", 1e-4);
    let (mut near, mut far) = (Comparison::new("slices", 1e-4), Comparison::new("slices far from contours", 1e-4));
    for (q, a, b) in steps.pairs(&"pairs", &ours, &twin) {
        for (way, a, b) in [("up", &a.up, &b.up), ("down", &a.down, &b.down)] {
            let mut value = |what: &str, x, y| steps.value(|| format!("pair {q} {way}, {what}"), x, y);
            value("steps", a.steps as f64, b.steps as f64);
            value("time at which it vanishes", a.vanished.unwrap_or(-1.0), b.vanished.unwrap_or(-1.0));
            value("residual", a.residual.max, b.residual.max);
        }
        for (k, a, b) in near.pairs(&format_args!("slices of pair {q}"), &a.slices, &b.slices) {
            for (n, x, y) in near.pairs(&format_args!("nodes of slice {k} of pair {q}"), &a.unpack(), &b.unpack()) {
                let out = if y.abs() < 3.0 { &mut near } else { &mut far };
                out.value(|| format!("pair {q}, slice {k}, node {n}"), f64::from(*x), f64::from(*y));
            }
        }
    }
    Ok(vec![steps, near, far])
}
