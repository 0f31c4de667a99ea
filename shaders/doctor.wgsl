// What the self-test asks a driver: how far it counts, and what it makes of a number that is none.

@group(0) @binding(0) var<storage, read> asked: array<u32>;
@group(0) @binding(1) var<storage, read_write> answer: array<u32>;

// Counts to asked[0] in one loop.
@compute @workgroup_size(1)
fn count() {
    var n = 0u;
    for (var k = 0u; k < asked[0]; k++) {
        n += asked[1];
    }
    answer[0] = n;
}

// asked[2] holds the bits of a NaN, asked[3] those of a number: comparisons with NaN are false, and arithmetic keeps it.
@compute @workgroup_size(1)
fn not_a_number() {
    let nan = bitcast<f32>(asked[2]);
    let one = bitcast<f32>(asked[3]);
    answer[1] = select(0u, 1u, nan < one);
    answer[2] = select(0u, 1u, nan > one);
    answer[3] = select(0u, 1u, nan >= one);
    answer[4] = bitcast<u32>(nan + one);
    answer[5] = bitcast<u32>(sqrt(4.0 * one));
    answer[6] = bitcast<u32>(one / (3.0 * one));
}
