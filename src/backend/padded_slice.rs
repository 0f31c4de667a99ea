//! A slice on the padded image, as a backend takes it.

use crate::grid::field::Field;
use crate::stack::SliceContent;

/// A slice on the padded image.
#[derive(Debug, Clone)]
pub enum PaddedSlice {
    /// Inside or not.
    Mask(Vec<bool>),
    /// Implicit function, negative inside.
    Level(Field),
}

impl PaddedSlice {
    /// The slice of `nx` x `ny` pixels with `pad` pixels of outside to either side along each axis.
    pub fn new(content: &SliceContent, [nx, ny]: [usize; 2], pad: [usize; 2]) -> Self {
        let dims = [nx + 2 * pad[0], ny + 2 * pad[1]];
        match content {
            SliceContent::Mask(mask) => {
                let mut out = vec![false; dims[0] * dims[1]];
                for j in 0..ny {
                    let to = (j + pad[1]) * dims[0] + pad[0];
                    mask.read(j * nx, &mut out[to..to + nx]);
                }
                PaddedSlice::Mask(out)
            }
            SliceContent::Level(u) => {
                // Outside as far from the level as the slice's own values are, so that a contour at the border lies near it.
                let far = f64::from(u.largest());
                let mut out = Field::filled(dims, far);
                let mut inside = vec![false; nx];
                for j in 0..ny {
                    u.sides().read(j * nx, &mut inside);
                    let row = &mut out.data[(j + pad[1]) * dims[0] + pad[0]..][..nx];
                    row.iter_mut().zip(&inside).filter(|(_, inside)| **inside).for_each(|(v, _)| *v = -far);
                }
                for (n, v) in u.near() {
                    let v = if *v == 0.0 { f32::MIN_POSITIVE } else { *v };
                    out.data[(n / nx + pad[1]) * dims[0] + n % nx + pad[0]] = f64::from(v);
                }
                PaddedSlice::Level(out)
            }
        }
    }
}
