// One stage of a TVD-RK3 step of `phi_t + F |grad phi| = 0` in the band: Godunov, WENO5, Peng's cut-off.
//
// A step is three dispatches that go back and forth between two copies of the tiles; `begun` keeps phi of the step's start in band order.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> stage: Stage;
@group(0) @binding(2) var<storage, read> jobs: array<Job>;
@group(0) @binding(3) var<storage, read> work: Work;
@group(0) @binding(4) var<storage, read> band: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> phi: array<f32>;
@group(0) @binding(6) var<storage, read> field: array<f32>;
@group(0) @binding(7) var<storage, read_write> begun: array<f32>;
@group(0) @binding(8) var<storage, read_write> next: array<f32>;

@compute @workgroup_size(lane_count)
fn hj_step(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
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
    var origin = center;
    if stage.first == 1u {
        begun[k] = center;
    } else {
        origin = begun[k];
    }
    var speed = 0.0;
    if stage.towards == 1u {
        speed = center - field[node];
    } else {
        speed = field[k];
    }
    let x = one_sided(
        array<f32, 7>(phi[node - 3u], phi[node - 2u], phi[node - 1u], center, phi[node + 1u], phi[node + 2u], phi[node + 3u]),
        1.0 / params.hx,
    );
    let y = one_sided(
        array<f32, 7>(
            phi[node - 3u * nx], phi[node - 2u * nx], phi[node - nx], center, phi[node + nx], phi[node + 2u * nx], phi[node + 3u * nx],
        ),
        1.0 / params.hy,
    );
    let change = -speed * cut_off(center, params.beta, params.gamma) * godunov(x, y, speed);
    next[node] = stage.a * origin + stage.b * (center + jobs[q].dt * change);
}
