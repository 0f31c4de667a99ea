//! The text of every shader, put together of its own and what it shares with others.

macro_rules! source {
    ($($file:literal),+) => { concat!($(include_str!(concat!("../../shaders/", $file)), "\n"),+) };
}

/// Every module of WGSL: its stem and its whole text.
pub const MODULES: [(&str, &str); 18] = [
    ("band", source!("common/job.wgsl", "common/stencil.wgsl", "band.wgsl")),
    ("hj_step", source!("common/job.wgsl", "common/stencil.wgsl", "common/stage.wgsl", "hj_step.wgsl")),
    ("reinit", source!("common/job.wgsl", "common/stencil.wgsl", "common/stage.wgsl", "reinit.wgsl")),
    ("extend", source!("common/job.wgsl", "common/field.wgsl", "extend.wgsl")),
    ("trace", source!("common/job.wgsl", "common/arrival.wgsl", "trace.wgsl")),
    ("particles", source!("common/job.wgsl", "common/field.wgsl", "common/goal.wgsl", "particles.wgsl")),
    (
        "propagate",
        source!(
            "common/job.wgsl",
            "common/stencil.wgsl",
            "common/field.wgsl",
            "common/goal.wgsl",
            "common/arrival.wgsl",
            "common/course.wgsl",
            "propagate.wgsl"
        ),
    ),
    ("scatter", source!("common/job.wgsl", "common/field.wgsl", "scatter.wgsl")),
    ("compose", source!("common/job.wgsl", "compose.wgsl")),
    ("distance", source!("common/job.wgsl", "common/stencil.wgsl", "distance.wgsl")),
    ("exact", source!("common/job.wgsl", "common/stencil.wgsl", "exact.wgsl")),
    ("contour_field", source!("common/job.wgsl", "contour_field.wgsl")),
    ("displacement", source!("common/job.wgsl", "common/moving.wgsl", "displacement.wgsl")),
    ("trajectories", source!("common/job.wgsl", "common/moving.wgsl", "trajectories.wgsl")),
    (
        "moving_slopes",
        source!(
            "common/job.wgsl",
            "common/moving.wgsl",
            "common/sample.wgsl",
            "common/spline.wgsl",
            "moving_slopes.wgsl"
        ),
    ),
    (
        "moving_layer",
        source!(
            "common/job.wgsl",
            "common/moving.wgsl",
            "common/sample.wgsl",
            "common/spline.wgsl",
            "moving_layer.wgsl"
        ),
    ),
    ("doctor", source!("doctor.wgsl")),
    ("part", source!("common/job.wgsl", "common/stencil.wgsl", "part.wgsl")),
];
