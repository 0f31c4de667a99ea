// A stage of a Hamilton-Jacobi step: `next = a begun + b (phi + dt L(phi))`; of a reinitialisation only `first` counts.
struct Stage {
    a: f32,
    b: f32,
    first: u32,
    // 1: F = phi - field (a goal, by node), taken anew in every stage: the morph of Eq. 2. 0: F = field (by band place), frozen.
    towards: u32,
}
