// How far a front is from its goal: |goal| where the contour of phi crosses the edges between pixels.

// Pixels this close to a front decide about its time step.
const FRONT_REACH: f32 = 1.5;

struct Rest {
    most: f32,
    // Sum in REST_UNIT parts of a pixel, each crossing cut at REST_MOST px: integers add up the same in any order.
    sum: u32,
    count: u32,
}

const REST_UNIT: f32 = 1024.0;
const REST_MOST: f32 = 4.0;

fn crossing(rest: Rest, node: u32, next: u32) -> Rest {
    let a = phi[node];
    let b = phi[next];
    if (a < 0.0) == (b < 0.0) {
        return rest;
    }
    let f = a / (a - b);
    let v = abs((1.0 - f) * goal[node] + f * goal[next]);
    return Rest(max(rest.most, v), rest.sum + u32(round(min(v, REST_MOST) * REST_UNIT)), rest.count + 1u);
}

fn add_rest(q: u32, rest: Rest) {
    if rest.count > 0u {
        atomicMax(&sums[q].residual_max, bitcast<u32>(rest.most));
        atomicAdd(&sums[q].residual_sum, rest.sum);
        atomicAdd(&sums[q].crossings, rest.count);
    }
}
