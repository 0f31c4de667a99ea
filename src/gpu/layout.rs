//! The structs that host and shaders share, member by member as in `shaders/`; `tests/gpu/shaders.rs` asks naga for the other side and compares
//! names, types, offsets and sizes.

use bytemuck::{Pod, Zeroable};

/// No place, no node, no copy.
pub const NONE: u32 = u32::MAX;
/// Farther than any contour can be, px.
pub const NOWHERE: f32 = 1e9;
/// Nodes of an eighth of a block.
pub const EIGHTH: usize = 8;
/// Nodes of a block.
pub const BLOCK: usize = 64;
/// Side of a patch of the distance sweeps, px.
pub const PATCH: usize = 16;
/// Patches that a workgroup of the distance sweeps looks at.
pub const PATCHES: usize = 8;
/// Most workgroups along an axis of a dispatch.
pub const GRID: u32 = 4096;
/// Side of the tiles that workgroups take in the moving field, px.
pub const TILE: usize = 8;
/// Moments of a node of a displacement.
pub const MOMENTS: usize = 9;
/// Numbers of its evidence.
pub const EVIDENCE: usize = 6;
/// Numbers that what its slices differ by is made of.
pub const CHANGES: usize = 2;
/// A slice with others on both sides.
pub const BOTH: u32 = 0;
/// The lowest slice.
pub const ABOVE: u32 = 1;
/// The highest slice.
pub const BELOW: u32 = 2;
/// Phases of a job.
pub const RUNNING: u32 = 0;
/// The front has arrived, or its steps are used up.
pub const DONE: u32 = 1;
/// The front disappeared on the way.
pub const VANISHED: u32 = 2;

/// Content of a buffer, as the host knows it and as WGSL spells it.
pub trait Shared {
    /// The type in WGSL: `f32`, `vec2<u32>`, `Job`, `array<Job>`.
    fn spelling() -> String;
    /// Structs in it.
    fn structs() -> Vec<StructLayout> {
        Vec::new()
    }
}

/// A mirrored struct.
#[derive(Debug, Clone)]
pub struct StructLayout {
    /// Its name on both sides.
    pub name: &'static str,
    /// Bytes on the host.
    pub size: usize,
    /// Name, offset and scalar type of its members in order.
    pub members: Vec<(&'static str, usize, &'static str)>,
    /// Type in WGSL of the items of the list behind it.
    pub tail: Option<String>,
}

/// A struct with a list behind it, as long as its buffer.
pub trait Headed: Pod {
    /// An item of the list.
    type Item: Pod + Shared;
}

/// Scalar that a member is made of.
trait Scalar {
    /// The scalar's name, the same in Rust and WGSL.
    const NAME: &'static str;
}

macro_rules! scalars {
    ($($name:ident)*) => { $(
        impl Scalar for $name {
            const NAME: &'static str = stringify!($name);
        }

        impl Shared for $name {
            fn spelling() -> String {
                Self::NAME.into()
            }
        }
    )* };
}

scalars!(f32 u32 i32);

impl<T: Scalar, const N: usize> Scalar for [T; N] {
    const NAME: &'static str = T::NAME;
}

impl<T: Scalar, const N: usize> Shared for [T; N] {
    fn spelling() -> String {
        format!("vec{N}<{}>", T::NAME)
    }
}

impl<T: Shared> Shared for [T] {
    fn spelling() -> String {
        format!("array<{}>", T::spelling())
    }

    fn structs() -> Vec<StructLayout> {
        T::structs()
    }
}

macro_rules! mirrored {
    ($(#[$doc:meta])* $name:ident { $($(#[$member_doc:meta])* $member:ident: $kind:ty,)* } $(then [$item:ty])?) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
        pub struct $name {
            $($(#[$member_doc])* #[allow(missing_docs)] pub $member: $kind,)*
        }

        $(impl Headed for $name {
            type Item = $item;
        })?

        impl Shared for $name {
            fn spelling() -> String {
                stringify!($name).into()
            }

            fn structs() -> Vec<StructLayout> {
                let mut structs = Vec::new();
                $(structs.extend(<$item>::structs());)?
                structs.push(StructLayout {
                    name: stringify!($name),
                    size: size_of::<$name>(),
                    members: vec![
                        $((stringify!($member), std::mem::offset_of!($name, $member), <$kind as Scalar>::NAME),)*
                    ],
                    tail: None$(.or(Some(<$item>::spelling())))?,
                });
                structs
            }
        }
    };
}

mirrored!(
    /// Parameters that all jobs of a batch share (`common/job.wgsl`).
    Params {
        hx: f32,
        hy: f32,
        gamma: f32,
        beta: f32,
        cfl: f32,
        step_share: f32,
        tolerance: f32,
        limit: f32,
        job_count: u32,
        block_count: u32,
        band_capacity: u32,
        value_capacity: u32,
    }
);

mirrored!(
    /// A job: its tile in the atlas and its state (`common/job.wgsl`).
    Job {
        offset: u32,
        nx: u32,
        ny: u32,
        first_block: u32,
        block_count: u32,
        phase: u32,
        steps: u32,
        pixels: u32,
        now: f32,
        dt: f32,
        most_steps: u32,
        idle: u32,
        best: f32,
        residual_max: f32,
        residual_mean: f32,
        first_time: u32,
        time_count: u32,
        next_time: u32,
        reaches: u32,
        first_copy: u32,
        vanished: f32,
        first_bin: u32,
        bins_x: u32,
        bins_y: u32,
    }
);

mirrored!(
    /// 64 nodes of a tile (`common/job.wgsl`).
    Block {
        near: [u32; 2],
        tube: [u32; 2],
        inner: [u32; 2],
        first: u32,
        job: u32,
    }
);

mirrored!(
    /// Reductions of a job (`common/job.wgsl`).
    Sums { fastest: u32, residual_max: u32, residual_sum: u32, crossings: u32, inside: u32, pixels: u32, }
);

mirrored!(
    /// Head of the work lists; the list of blocks follows (`common/job.wgsl`).
    Work {
        block_total: u32,
        band_total: u32,
        band_wanted: u32,
        padding: u32,
        block_groups: [u32; 4],
        eighth_groups: [u32; 4],
        band_groups: [u32; 4],
        chunk_groups: [u32; 4],
    } then [u32]
);

mirrored!(
    /// Head of the list of fronts that a step reaches, with the indirect arguments of their copying (`common/reached.wgsl`).
    Reached { groups_x: u32, groups_y: u32, groups_z: u32, count: u32, } then [Read]
);

mirrored!(
    /// A front that is wanted within a step (`common/reached.wgsl`).
    Read { job: u32, copy: u32, share: f32, padding: u32, }
);

mirrored!(
    /// Head of the pool of copied values (`compose.wgsl`).
    Values { used: u32, padding_a: u32, padding_b: u32, padding_c: u32, } then [f32]
);

mirrored!(
    /// Head of the rounds in which band places became known: that which is being filled (`scatter.wgsl`).
    Known { round: u32, padding_a: u32, padding_b: u32, padding_c: u32, } then [u32]
);

mirrored!(
    /// The side of a mask that distances are measured to (`exact.wgsl`).
    Side { inside: u32, padding_a: u32, padding_b: u32, padding_c: u32, }
);

mirrored!(
    /// A stage of a step (`common/stage.wgsl`).
    Stage { a: f32, b: f32, first: u32, towards: u32, }
);

mirrored!(
    /// A tracker particle (`particles.wgsl`).
    Particle {
        x: [f32; 2],
        predicted: [f32; 2],
        velocity: [f32; 2],
        speed: f32,
        covered: f32,
        arc: f32,
        dragged: f32,
        kept: f32,
        own: f32,
        share: f32,
        job: u32,
    }
);

mirrored!(
    /// Upwind neighbours of a band pixel (`extend.wgsl`).
    Source { x: u32, other_x: u32, y: u32, other_y: u32, weight: f32, }
);

mirrored!(
    /// A seed with its course `[s, m0, m1, ok]` (`scatter.wgsl`), of single numbers: vectors would make it longer by their alignment.
    Seed { s: f32, m0: f32, m1: f32, ok: f32, x: f32, y: f32, bin: u32, }
);

mirrored!(
    /// A block of a copied front (`compose.wgsl`).
    Copy { near: [u32; 2], inside: [u32; 2], first: u32, padding: u32, }
);

mirrored!(
    /// A slice to blend (`compose.wgsl`).
    Item {
        up: u32,
        down: u32,
        up_weight: f32,
        down_weight: f32,
        block_count: u32,
        offset: u32,
        first_hole: u32,
        hole_count: u32,
        nx: u32,
    }
);

mirrored!(
    /// A hole that is cut out of a slice (`compose.wgsl`).
    Hole { first: u32, offset: f32, x: u32, y: u32, nx: u32, ny: u32, }
);

mirrored!(
    /// The patches of one colour (`distance.wgsl`).
    Colour { first: u32, count: u32, padding_a: u32, padding_b: u32, }
);

mirrored!(
    /// A patch of the distance sweeps (`distance.wgsl`).
    Patch { job: u32, column: u32, row: u32, number: u32, }
);

mirrored!(
    /// Rule by which slices become level sets (`contour_field.wgsl`).
    Rule {
        weights: [[f32; 4]; 11],
        reach: u32,
        vertical: u32,
        mask_floor: f32,
        field_floor: f32,
        kernel_clip: f32,
        conditioned: f32,
        least_length: f32,
        most_shift: f32,
        flat_square: f32,
        padding_a: u32,
        padding_b: u32,
        padding_c: u32,
    }
);

mirrored!(
    /// Size of the images of a moving field and of their displacements (`common/moving.wgsl`).
    Image { nx: u32, ny: u32, columns: u32, rows: u32, hx: f32, hy: f32, count: u32, padding: u32, }
);

mirrored!(
    /// One round of the displacements (`displacement.wgsl`).
    Iteration {
        clip: f32,
        width: f32,
        reach: f32,
        half_evidence: f32,
        coupling: f32,
        no_change: f32,
        padding_a: u32,
        padding_b: u32,
    }
);

mirrored!(
    /// A pass of smoothing (`displacement.wgsl`).
    Axis { vertical: u32, first: u32, reach: u32, width: u32, }
);

mirrored!(
    /// Interval and its neighbours (`displacement.wgsl`).
    Interval { before: f32, after: f32, ridge: f32, padding: f32, }
);

mirrored!(
    /// Time of a layer (`trajectories.wgsl`).
    Time { t: f32, first: f32, second: f32, }
);

mirrored!(
    /// A slice with its gaps (`moving_slopes.wgsl`).
    Knot { slice: u32, sides: u32, gaps: [f32; 2], farther: [f32; 2], relief: f32, doubt: f32, }
);

mirrored!(
    /// Parameters that the layers of an interval share (`common/layer_value.wgsl`).
    Span {
        limit: f32,
        reach: f32,
        lower_parts: u32,
        all_parts: u32,
        relief: f32,
        empty: u32,
        asked: u32,
        others: u32,
    }
);

mirrored!(
    /// A part without partner (`common/layer_value.wgsl`).
    Part { first: u32, nx: u32, ny: u32, x: i32, y: i32, depth: f32, height: f32, shrinking: f32, farthest: f32, open: u32, hole: u32, }
);

/// Sources of a body's values: slices of groups.
pub const OF_SLICES: u32 = 0;
/// Contours that groups end at.
pub const OF_ENDS: u32 = 1;
/// Shapes that the host has made.
pub const OF_SHAPES: u32 = 2;

mirrored!(
    /// Parameters that the layers of a morphed interval share (`morph_layer.wgsl`).
    Morph {
        limit: f32,
        pad_x: u32,
        pad_y: u32,
        nx: u32,
        ny: u32,
        layers: u32,
        bodies: u32,
        groups: u32,
        halvings: u32,
        low_own: u32,
        high_own: u32,
        low_beside: u32,
        high_beside: u32,
        places: u32,
    }
);

mirrored!(
    /// A body on its tile (`morph_layer.wgsl`).
    Body {
        first: u32,
        source: u32,
        nx: u32,
        ny: u32,
        x: i32,
        y: i32,
        offset: f32,
        layer: u32,
        first_group: u32,
        padding: u32,
    }
);

mirrored!(
    /// Number that a field's values are multiplied with (`rescale.wgsl`).
    Factor { nearest: f32, first: u32, count: u32, padding: u32, }
);
