//! Many labels in one run: each is reconstructed alone, then voxels are decided so that labels neither overlap nor leave gaps where they touch.
//!
//! With `phi_a` the signed distance of label a reconstructed alone, `m_a` the least distance of all other labels, `t_a` that of those that touch
//! a in the drawn slices below and above, and `u` the distance of the union of all labels that touch each other somewhere, reconstructed as
//! one more body, label a becomes
//!
//! ```text
//! psi_a = max(min(phi_a, max(u, t_a - R)), (phi_a - m_a) / 2)
//! ```
//!
//! - Where labels overlap the deepest wins; `psi_a = -psi_b` there unless a third label is as near: the two surfaces are one.
//! - Inside the union, less than R (the margin less a pixel) from both, what no label has goes to the nearest that may have it.
//! - Elsewhere `psi_a` is `phi_a`, bit by bit; the second half of the maximum counts within 3 px of a only.
//! - Equal distances: the smaller sum over the 3 x 3 pixels around wins, then the label with more drawn pixels, then that whose first drawn
//!   pixel comes first. Numbers and order of the labels decide nothing.
//!
//! A label alone takes part in slices from its own first to its own last (in all of them where the user has chosen slices), drawn or empty; it
//! is computed on its own part of the image, with 64 px around it.
//!
//! At drawn slices every field has the sides that were drawn, so that `psi_a` has them too. Layers wait in temporary files, cropped to what is
//! near a label.

mod decide;
mod kept;
mod merge;
pub mod report;
mod stack;

pub use kept::KeptBody;
pub use merge::{Bodies, Decided, Plan, decide, reconstruct};
pub use stack::LabelStack;
