// Images of a moving field and their displacements, `vectors` of the including file: one per node of a grid that is centred on the image, read
// bilinearly. The twins are src/grid/field.rs and src/registration/displacement.rs.
//
// A place is a pixel `ij` and a short offset from it, so that large images cost no digits.

// Distance between two nodes, px.
const STRIDE: u32 = 4u;
// Side of a tile, px: a workgroup takes one, so that all of it may be far from contours.
const TILE: u32 = 8u;

// Size of all images, columns and rows of nodes, pixel sides in units of the larger, and how many items a dispatch has.
struct Image {
    nx: u32,
    ny: u32,
    columns: u32,
    rows: u32,
    hx: f32,
    hy: f32,
    count: u32,
    padding: u32,
}

@group(0) @binding(0) var<uniform> image: Image;

// Lower corner of a cell as a node, and the place in it.
struct Cell {
    node: u32,
    place: vec2<f32>,
}

// The cell around a place on an image of these pixels, kept `rim` pixels off its edge.
fn cell_of(dims: vec2<u32>, ij: vec2<i32>, offset: vec2<f32>, rim: i32) -> Cell {
    let last = vec2<i32>(dims) - 2 - rim;
    let whole = floor(offset);
    let at = ij + vec2<i32>(whole);
    let corner = clamp(at, vec2<i32>(rim), last);
    let off_edge = select(vec2<f32>(0.0), vec2<f32>(1.0), at > last);
    return Cell(u32(corner.y) * dims.x + u32(corner.x), select(offset - whole, off_edge, at != corner));
}

// Where the first node is, from the first pixel.
fn first_node() -> vec2<f32> {
    let pixels = vec2<f32>(vec2<u32>(image.nx, image.ny) - 1u);
    return 0.5 * (pixels - vec2<f32>(STRIDE * (vec2<u32>(image.columns, image.rows) - 1u)));
}

// The displacement that begins at `first`, at a place; beyond the nodes that of the nearest.
fn vector_at(first: u32, ij: vec2<i32>, offset: vec2<f32>) -> vec2<f32> {
    let x = (vec2<f32>(ij) - first_node() + offset) / f32(STRIDE);
    let c = cell_of(vec2<u32>(image.columns, image.rows), vec2<i32>(0), x, 0);
    let k = first + c.node;
    let low = mix(vectors[k], vectors[k + 1u], c.place.x);
    let high = mix(vectors[k + image.columns], vectors[k + image.columns + 1u], c.place.x);
    return mix(low, high, c.place.y);
}

// Tiles of an image.
fn tiles() -> vec2<u32> {
    return (vec2<u32>(image.nx, image.ny) + TILE - 1u) / TILE;
}

// The pixel of an invocation when every workgroup takes a tile, and the item it belongs to.
fn pixel_of(n: u32) -> vec3<u32> {
    let across = tiles();
    let tile = n / (TILE * TILE);
    let own = n % (TILE * TILE);
    let corner = TILE * vec2<u32>(tile % across.x, tile / across.x % across.y);
    return vec3<u32>(corner + vec2<u32>(own % TILE, own / TILE), tile / (across.x * across.y));
}

// Whether there is such a pixel.
fn on_image(p: vec3<u32>) -> bool {
    return p.x < image.nx && p.y < image.ny && p.z < image.count;
}
