//! A slit between two parts that moves by more than its width from slice to slice: what overlaps across it as drawn is not what belongs together.

use crate::backends::on_backends;
use crate::shapes::*;
use interslice::grid::components::label4;
use interslice::grid::sparse_image::SparseImage;
use interslice::progress::Silent;
use interslice::report::{LinkReport, LinkedBy};
use interslice::settings::Link;
use interslice::stack::ContourStack;
use interslice::{Backend, Reconstruction, Reference, Settings, reconstruct_with};

const N: usize = 80;
const RADIUS: f64 = 30.0;
const HEIGHTS: [f64; 5] = [0.0, 4.0, 8.0, 12.0, 16.0];

/// A slit of this width through a disc, at an angle, which moves by `step` from slice to slice, on pixels of these sides.
struct Slit {
    width: f64,
    angle: f64,
    step: f64,
    spacing: [f64; 2],
}

impl Slit {
    /// Distance from its middle at height z, negative on one side, in units of the spacing.
    fn across(&self, [i, j]: [f64; 2], z: f64) -> f64 {
        let middle = 0.5 * (N - 1) as f64;
        let (s, c) = self.angle.sin_cos();
        let [x, y] = [(i - middle) * self.spacing[0], (j - middle) * self.spacing[1]];
        x * c + y * s - self.step * (z / HEIGHTS[1] - 2.0)
    }

    fn disc(&self, [i, j]: [f64; 2]) -> f64 {
        let middle = 0.5 * (N - 1) as f64;
        libm::hypot((i - middle) * self.spacing[0], (j - middle) * self.spacing[1]) - RADIUS
    }

    fn stack(&self) -> ContourStack {
        let at = |z: f64| -> Shape {
            let Slit { width, angle, step, spacing } = *self;
            let own = Slit { width, angle, step, spacing };
            Box::new(move |i, j| own.disc([i, j]).max(0.5 * own.width - own.across([i, j], z).abs()))
        };
        ContourStack { spacing: self.spacing, ..masks(N, &HEIGHTS, &HEIGHTS.map(at)) }
    }

    /// Pixels of the disc at height z that are outside of the layer, and those that are in the slit, and those that are both.
    fn found(&self, z: f64, phi: &SparseImage<f32>) -> [usize; 3] {
        let mut counts = [0; 3];
        for (n, v) in phi.iter().enumerate() {
            let at = [n % N, n / N].map(|k| k as f64);
            if self.disc(at) < -1.0 {
                let [open, slit] = [*v > 0.0, self.across(at, z).abs() < 0.5 * self.width];
                let said = [open, slit, open && slit];
                counts.iter_mut().zip(said).for_each(|(count, is)| *count += usize::from(is));
            }
        }
        counts
    }
}

fn run(stack: &ContourStack, settings: &Settings, backend: &dyn Backend) -> Reconstruction {
    let heights: Vec<f64> = (0..=16).map(f64::from).collect();
    reconstruct_with(stack, &heights, settings, backend, &Silent).expect("the stack is valid")
}

fn links(body: &Reconstruction) -> Vec<&LinkReport> {
    body.report.intervals.iter().flat_map(|interval| &interval.links).collect()
}

#[test]
fn a_slit_that_moves_stays_open() {
    on_backends(|backend| {
        for (width, angle, step, spacing) in [
            (2.0, 0.0, 4.0, [1.0; 2]),
            (3.0, 0.7, 4.0, [1.0; 2]),
            (2.5, -1.2, 5.0, [1.0; 2]),
            (4.0, 0.3, 7.0, [1.0; 2]),
            (4.0, 0.4, 6.0, [2.0, 1.0]),
            (4.0, 1.1, 6.0, [1.0, 2.0]),
        ] {
            let slit = Slit { width, angle, step, spacing };
            let told = format!("{width} at {angle} by {step} on {spacing:?}, {}", backend.name());
            let body = run(&slit.stack(), &Settings::default(), backend);
            let (mut all, mut both) = (0, 0);
            for layer in body.layers.iter().filter(|layer| layer.output) {
                let inside: Vec<bool> = layer.phi.iter().map(|v| *v < 0.0).collect();
                assert_eq!(label4(&inside, [N; 2]).count, 2, "{told}: the parts of the layer at {}", layer.z);
                let [open, drawn, common] = slit.found(layer.z, &layer.phi);
                all += open + drawn;
                both += 2 * common;
            }
            let dice = both as f64 / all as f64;
            assert!(dice > 0.85, "{told}: Dice {dice:.3} of the slit");
            let links = links(&body);
            assert_eq!(links.len(), 4, "{told}: one across the slit in each gap: {links:?}");
            assert!(links.iter().all(|link| !link.join && link.by == LinkedBy::Motion && link.meet < 0.1), "{links:?}");
            assert!(body.report.body.torn.is_empty() && body.report.body.overlapping == 8, "{told}");
        }
    });
}

/// What the user says about a pair comes first.
#[test]
fn a_link_across_the_slit_joins_its_sides() {
    let connected = |stack: &ContourStack, settings: &Settings| {
        let body = run(stack, settings, &Reference);
        let middle = body.layers.iter().find(|layer| layer.z == 2.0).expect("a layer");
        let inside: Vec<bool> = middle.phi.iter().map(|v| *v < 0.0).collect();
        (label4(&inside, [N; 2]).count == 1, links(&body).into_iter().cloned().collect::<Vec<_>>())
    };
    let slit = Slit { width: 2.0, angle: 0.0, step: 4.0, spacing: [1.0; 2] };
    let (whole, found) = connected(&slit.stack(), &Settings::default());
    assert!(!whole && found.len() == 4, "{found:?}");
    let LinkReport { from, to, .. } = found[0];
    let joined = Settings { links: vec![Link { slice: 0, from, to, join: true }], ..Settings::default() };
    let (whole, found) = connected(&slit.stack(), &joined);
    assert!(whole, "the user joins them");
    assert!(found[0].join && found[0].by == LinkedBy::File && found.len() == 4, "{found:?}");
}
