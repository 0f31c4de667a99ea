// Values of a field times a number that single precision does not hold: the product with the nearest one that it does, and for each by how many of
// its last places the host's own product is off, plus 1, in two bits. The twin is `scaled` in src/gpu/resident.rs.

@group(0) @binding(0) var<uniform> factor: Factor;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read> places: array<u32>;
@group(0) @binding(3) var<storage, read_write> product: array<f32>;

// The number, and where the values of the field begin, and how many they are.
struct Factor {
    nearest: f32,
    first: u32,
    count: u32,
    padding: u32,
}

@compute @workgroup_size(lane_count)
fn rescale(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    if n >= factor.count {
        return;
    }
    let more = (places[n / 16u] >> (2u * (n % 16u))) & 3u;
    product[n] = bitcast<f32>(bitcast<u32>(values[factor.first + n] * factor.nearest) + more - 1u);
}
