//! Work of one dispatch, bounded in time: Windows ends those of 2 s, and a screen that the GPU draws, too, stands still meanwhile.
//!
//! The cost model: a dispatch costs the values that its invocations read and write, pixels times what a pixel takes in the costliest kernel of
//! the stage. Batches are cut so that no dispatch costs more than [`MOST`], which an integrated GPU does in about half a second, or [`MOST_OF_LARGE`].
//! A job alone may cost more: above 8192 px squared, or 16384. Where batches are cut changes no bit.

use super::Gpu;

/// Values of a dispatch at most: half a second at 4 values a nanosecond, half of what 30 GB/s bring.
pub const MOST: u64 = 1 << 31;
/// And of a GPU with so many bytes of its own: half of what 120 GB/s bring. Small ones of the last ten years bring 15 to 80, those with 6 GiB 190 and
/// more.
pub const MOST_OF_LARGE: u64 = 4 * MOST;
/// See [`MOST_OF_LARGE`].
pub const LARGE: u64 = 6 << 30;

/// Values of a band place: two WENO5 stencils and their arithmetic (`hj_step`).
pub const BAND_PLACE: usize = 40;
/// Of a pixel of a slice: both sides of the widest Gaussian (`gaussian`).
pub const CONTOUR_PIXEL: usize = 48;
/// Of a pixel of a patch that is awake: itself twice, its share of the border, and its updates in the workgroup's memory (`sweep_patches`).
pub const DISTANCE_PIXEL: usize = 24;
/// Of a pixel of an interval: its share of a node's moments and of their means (`sum_moments`, `window_mean`).
pub const DISPLACEMENT_PIXEL: usize = 32;
/// Of a pixel of a slope: two secants along trajectories (`find_slopes`).
pub const SLOPE_PIXEL: usize = 40;
/// Of a pixel of a layer: two smooth samples, two slopes, two vectors (`interpolate`).
pub const LAYER_PIXEL: usize = 64;
/// And for each lone part whose tile it may lie on.
pub const LONE_PART: usize = 12;

impl Gpu {
    /// The share of a dispatch that so many values take.
    pub(super) fn share_of_work(&self, values: usize) -> f64 {
        values as f64 / self.device.most_work() as f64
    }
}
