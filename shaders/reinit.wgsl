// One iteration of `phi_tau + S(phi) (|grad phi| - 1) = 0` in the tube N (Eq. 6): forward Euler, WENO5. The sign S of the field as it came
// in is kept in band order over the iterations.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> stage: Stage;
@group(0) @binding(2) var<storage, read> jobs: array<Job>;
@group(0) @binding(3) var<storage, read> work: Work;
@group(0) @binding(4) var<storage, read> band: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> phi: array<f32>;
@group(0) @binding(6) var<storage, read_write> signs: array<f32>;
@group(0) @binding(7) var<storage, read_write> next: array<f32>;

// Pseudo-time step in pixels of the smaller side.
const STEP: f32 = 0.5;

// Size of the difference of neighbours along an axis, from one pixel to the next: the mean of both sides, and the steeper one where the contour is near.
fn slope(below: f32, own: f32, above: f32) -> f32 {
    let mean = 0.5 * abs(above - below);
    let steeper = max(abs(own - below), abs(above - own));
    // Pixels to the contour by that side, less than 1 where it passes on it.
    let near = max(steeper - abs(own), 0.0) / max(steeper, 1e-30);
    return mean + near * (steeper - mean);
}

@compute @workgroup_size(lane_count)
fn reinit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.band_total {
        return;
    }
    let node = band[k].x;
    let q = band[k].y;
    if jobs[q].phase != RUNNING {
        return;
    }
    let nx = jobs[q].nx;
    let center = phi[node];
    let xs = array<f32, 7>(phi[node - 3u], phi[node - 2u], phi[node - 1u], center, phi[node + 1u], phi[node + 2u], phi[node + 3u]);
    let ys = array<f32, 7>(
        phi[node - 3u * nx], phi[node - 2u * nx], phi[node - nx], center, phi[node + nx], phi[node + 2u * nx], phi[node + 3u * nx],
    );
    var sign = 0.0;
    if stage.first == 1u {
        let slopes = vec2<f32>(slope(xs[2], center, xs[4]), slope(ys[2], center, ys[4]));
        sign = smeared_sign(center, slopes / vec2<f32>(params.hx, params.hy));
        signs[k] = sign;
    } else {
        sign = signs[k];
    }
    let step = params.step_share * STEP * min(params.hx, params.hy);
    let slope = godunov(one_sided(xs, 1.0 / params.hx), one_sided(ys, 1.0 / params.hy), sign);
    next[node] = center - step * sign * (slope - 1.0);
}
