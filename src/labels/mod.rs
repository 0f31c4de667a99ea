//! Many labels in one run: each is reconstructed alone, then voxels are decided so that labels neither overlap nor leave gaps where they touch.
//!
//! With `phi_a` the signed distance of label a reconstructed alone, `m_a` the least distance of all other labels, and `u` the distance of the union of
//! all labels that touch each other somewhere, reconstructed as one more body (the least of several where some are not known on every slice, `stack.rs`),
//! label a becomes, where it touches another one in the drawn slices below and above and all are known on the same slices around,
//!
//! ```text
//! psi_a = max(min(phi_a, u), (phi_a - m_a) / 2)
//! ```
//!
//! - Where labels overlap the deepest wins, but one that is less than 3 px deep on the slices around keeps what lies deeper in it than a quarter of
//!   that: a wall would be torn wherever another label lies over it by more than its thickness. `psi_a = -psi_b` there unless a third label is as
//!   near: the two surfaces are one.
//! - Labels may have different slices ([`given`]). With `d_a` the distance from the nearest slice on which a is known, the second half of the
//!   maximum is that of `(d_b phi_a - d_a phi_b) / (d_a + d_b)` over all b, which is the above where the distances are the same: what is
//!   painted stays, and gives way to what is interpolated the more the farther off it was painted. No step at any height.
//! - Between labels that touch on one of the slices below and above the union counts where their distances add up to less than 2 px, softly:
//!   `max(u, phi_a + phi_b - 2 px)`.
//! - Inside the union, within the margin of a label, what no label has goes to the nearest that may have it, however far the others are: where a border
//!   moves by more than the margin from slice to slice both labels draw back from the rim between. Of labels that have slices of their own the union is
//!   known on fewer slices than they are, and counts less than R (the margin less a pixel) from one that touches: `max(u, t_a - R)` instead of u, with the
//!   least distance `t_a` of those that touch a.
//! - Elsewhere `psi_a` is `phi_a`, bit by bit; the second half of the maximum counts within 3 px of a only.
//! - Equal distances: the smaller sum over the 3 x 3 pixels around wins, then the label with more drawn pixels, then that whose first drawn
//!   pixel comes first. Numbers and order of the labels decide nothing.
//! - A label that ends where others of its union go on draws back between the slices as far as they do not claim, and `phi_a` is that (`ended.rs`). Labels
//!   that lie one above the other are of one union though they touch on no slice (`facing.rs`).
//! - A piece that this leaves in the air, whatever its size, goes to the label that it touches most (`floating.rs`).
//!
//! A label alone is reconstructed from its own slices, on its own part of the image, with 64 px around it; a union from the slices on which
//! all of its labels are known or have ended.
//!
//! A label on a single slice is no body: its pixels are in the label volume on that slice, whatever else would be there.
//!
//! At its slices every field has the sides that were drawn, so that `psi_a` has them too. Layers wait in temporary files, cropped to what is
//! near a label.

mod decide;
mod ended;
mod facing;
mod fill;
mod floating;
pub mod given;
mod kept;
mod measure;
mod merge;
mod piece;
pub mod report;
mod stack;

pub use fill::fill;
pub use kept::KeptBody;
pub use merge::{Bodies, DecidedLabels, Plan, decide, reconstruct};
pub use piece::requirements;
pub use stack::{Covered, LabelStack, SingleSlice};
