//! Kernels of the reference path, one thread, on the tube of a circle: divan prints time and band pixels per second.
//!
//! `cargo bench --bench kernels`

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use interslice::contour::seeds::seeds;
use interslice::grid::field::Field;
use interslice::reference::band::Band;
use interslice::reference::distance::distance_of;
use interslice::reference::exact::exact_distance;
use interslice::reference::extend::Upwind;
use interslice::reference::hj_step::{Scratch, Speed, Tube, hj_step};
use interslice::reference::reinit::reinit;
use interslice::reference::scatter::scatter;

const H: [f64; 2] = [1.0, 1.0];
const TUBE: Tube = Tube { beta: 3.0, gamma: 6.0 };

fn main() {
    divan::main();
}

fn circle(n: usize) -> Field {
    let c = 0.5 * n as f64 + 0.2;
    Field::from_fn([n, n], |i, j| (i as f64 - c).hypot(j as f64 - c) - 0.35 * n as f64)
}

/// One RK3 step: three WENO5 evaluations per band pixel.
#[divan::bench(args = [128, 512, 2048])]
fn hj_step_three_weno5(bencher: Bencher, n: usize) {
    let mut phi = circle(n);
    let band = Band::new(&mut phi, TUBE.gamma);
    let speed = Field::filled(phi.dims, 1e-6);
    let mut scratch = Scratch::default();
    bencher
        .counter(ItemsCount::new(3 * band.count))
        .bench_local(|| hj_step(black_box(&mut phi), Speed::Given(&speed), &band, H, TUBE, 1e-6, &mut scratch));
}

/// The same over a whole image: no band, long rows.
#[divan::bench(args = [1024])]
fn hj_step_dense(bencher: Bencher, n: usize) {
    let mut phi = circle(n);
    for v in &mut phi.data {
        *v = v.clamp(-5.9, 5.9);
    }
    let band = Band::new(&mut phi, TUBE.gamma);
    let speed = Field::filled(phi.dims, 1e-6);
    let mut scratch = Scratch::default();
    bencher
        .counter(ItemsCount::new(3 * band.count))
        .bench_local(|| hj_step(black_box(&mut phi), Speed::Given(&speed), &band, H, TUBE, 1e-6, &mut scratch));
}

#[divan::bench(args = [128, 512, 2048])]
fn reinit_once(bencher: Bencher, n: usize) {
    let mut phi = circle(n);
    let band = Band::new(&mut phi, TUBE.gamma);
    let mut scratch = Scratch::default();
    bencher.counter(ItemsCount::new(band.count)).bench_local(|| reinit(black_box(&mut phi), &band, H, 1, &mut scratch));
}

#[divan::bench(args = [128, 512, 2048])]
fn band_rebuild(bencher: Bencher, n: usize) {
    let mut phi = circle(n);
    let mut band = Band::new(&mut phi, TUBE.gamma);
    bencher.counter(ItemsCount::new(band.count)).bench_local(|| band.rebuild(black_box(&mut phi)));
}

/// Four channels, four passes, sources found anew: what a sweep does in every step.
#[divan::bench(args = [128, 512, 2048])]
fn extend_four_channels(bencher: Bencher, n: usize) {
    let mut phi = circle(n);
    let band = Band::new(&mut phi, TUBE.gamma);
    let mut values = vec![[1.0; 4]; phi.data.len()];
    let (mut upwind, mut scratch) = (Upwind::default(), Vec::new());
    bencher.counter(ItemsCount::new(band.count)).bench_local(|| {
        upwind.find(black_box(&phi), &band, H);
        upwind.extend(black_box(&mut values), &band, 4, &mut scratch);
    });
}

#[divan::bench(args = [128, 512])]
fn scatter_four_channels(bencher: Bencher, n: usize) {
    let mut phi = circle(n);
    let band = Band::new(&mut phi, TUBE.gamma);
    let places: Vec<_> = seeds(&phi, H, 0.5).iter().map(|s| s.x).collect();
    let values = vec![[1.0; 4]; places.len()];
    bencher.counter(ItemsCount::new(places.len())).bench_local(|| scatter(&phi, &band, H, &places, &values));
}

#[divan::bench(args = [512, 2048], sample_count = 10)]
fn sweep_whole_image(bencher: Bencher, n: usize) {
    let phi = circle(n);
    bencher.counter(ItemsCount::new(n * n)).bench_local(|| distance_of(black_box(&phi), H));
}

#[divan::bench(args = [512, 2048], sample_count = 10)]
fn exact_distance_whole_image(bencher: Bencher, n: usize) {
    let mask = circle(n).inside();
    bencher.counter(ItemsCount::new(n * n)).bench_local(|| exact_distance(black_box(&mask), [n, n], H));
}
