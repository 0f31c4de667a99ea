//! What the surface is, from the library: exact, closed, connected, the same however it lies, on shapes whose mathematics is known.

mod apart;
mod backends;
mod body;
mod borders;
mod budget;
mod certificate;
mod closing;
mod cut_bodies;
mod displacement;
mod ends;
#[path = "../support/files.rs"]
mod files;
mod fine_pixels;
mod holdout;
mod hollow;
mod kernels;
mod known_part;
mod links;
mod mesh;
mod moving_frame;
mod pipeline;
mod properties;
mod rigid;
mod sections;
#[path = "../shapes/mod.rs"]
mod shapes;
mod sliding;
mod slits;
mod smooth;
mod sphere_volumes;
mod stack;
#[path = "../support/mod.rs"]
mod support;
mod sweeps;
mod together;
mod topology;
