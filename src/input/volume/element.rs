//! Type of a voxel: integers of 1 to 8 bytes, floats of 4 and 8.

use crate::surface::content::Scalar;

/// Type of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    /// Signed or unsigned integer of `size` bytes: 1, 2, 4 or 8.
    Int {
        /// Bytes.
        size: usize,
        /// Whether it can be negative.
        signed: bool,
    },
    /// f32.
    Float,
    /// f64.
    Double,
}

/// Some voxels as the file holds them.
pub(crate) struct Voxels<'a> {
    /// Their bytes.
    pub bytes: &'a [u8],
    /// Whether each runs from its largest byte.
    pub big_endian: bool,
    /// Factor and summand of their values.
    pub scale: Option<[f64; 2]>,
    /// The number of the first.
    pub first: usize,
}

/// A value that cannot be read.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Unreadable {
    /// The voxel's number.
    pub voxel: usize,
    /// The value, and why it cannot.
    pub why: String,
}

/// Does something with the number and the stored value of every voxel.
macro_rules! decode {
    ($kind:ty, $bytes:expr, $big_endian:expr, |$k:ident, $v:ident| $each:expr) => {{
        let (chunks, _) = $bytes.as_chunks::<{ size_of::<$kind>() }>();
        for ($k, chunk) in chunks.iter().enumerate() {
            let $v = if $big_endian { <$kind>::from_be_bytes(*chunk) } else { <$kind>::from_le_bytes(*chunk) };
            $each;
        }
    }};
}

impl Element {
    /// Bytes of a voxel.
    pub fn size(self) -> usize {
        match self {
            Element::Int { size, .. } => size,
            Element::Float => 4,
            Element::Double => 8,
        }
    }

    /// The type of voxels that are written as these are.
    pub fn scalar(self) -> Scalar {
        match self {
            Element::Int { size: 1, signed } => {
                if signed {
                    Scalar::I8
                } else {
                    Scalar::U8
                }
            }
            Element::Int { size: 2, signed } => {
                if signed {
                    Scalar::I16
                } else {
                    Scalar::U16
                }
            }
            Element::Int { size: 4, signed } => {
                if signed {
                    Scalar::I32
                } else {
                    Scalar::U32
                }
            }
            Element::Int { signed, .. } => {
                if signed {
                    Scalar::I64
                } else {
                    Scalar::U64
                }
            }
            Element::Float => Scalar::F32,
            Element::Double => Scalar::F64,
        }
    }

    /// Its name, as in `uint8`.
    pub fn name(self) -> String {
        match self {
            Element::Int { size, signed } => format!("{}int{}", if signed { "" } else { "u" }, 8 * size),
            Element::Float => "float32".into(),
            Element::Double => "float64".into(),
        }
    }

    /// Appends the labels of `voxels` to `out`.
    ///
    /// # Errors
    /// What is no whole number, or too large.
    pub(crate) fn labels(self, voxels: &Voxels<'_>, out: &mut Vec<i64>) -> Result<(), Unreadable> {
        let &Voxels { bytes, big_endian, scale, first } = voxels;
        macro_rules! each {
            ($kind:ty, $label:expr) => {
                decode!($kind, bytes, big_endian, |k, v| out.push($label(v, first + k)?))
            };
        }
        macro_rules! whole_numbers {
            ($kind:ty) => {
                match scale {
                    Some([factor, summand]) => {
                        each!($kind, |v: $kind, k| whole(v as f64 * factor + summand, k))
                    }
                    None => each!($kind, |v: $kind, voxel| i64::try_from(v)
                        .map_err(|_| Unreadable { voxel, why: format!("is {v}, a label larger than {}", i64::MAX) })),
                }
            };
        }
        let [factor, summand] = scale.unwrap_or([1.0, 0.0]);
        match self {
            Element::Int { size: 1, signed: false } => whole_numbers!(u8),
            Element::Int { size: 1, signed: true } => whole_numbers!(i8),
            Element::Int { size: 2, signed: false } => whole_numbers!(u16),
            Element::Int { size: 2, signed: true } => whole_numbers!(i16),
            Element::Int { size: 4, signed: false } => whole_numbers!(u32),
            Element::Int { size: 4, signed: true } => whole_numbers!(i32),
            Element::Int { signed: false, .. } => whole_numbers!(u64),
            Element::Int { signed: true, .. } => whole_numbers!(i64),
            Element::Float => each!(f32, |v: f32, k| whole(f64::from(v) * factor + summand, k)),
            Element::Double => each!(f64, |v: f64, k| whole(v * factor + summand, k)),
        }
        Ok(())
    }

    /// Appends the grey values of `voxels` to `out`.
    ///
    /// # Errors
    /// What is no finite number.
    pub(crate) fn greys(self, voxels: &Voxels<'_>, out: &mut Vec<f64>) -> Result<(), Unreadable> {
        let &Voxels { bytes, big_endian, scale, first } = voxels;
        let [factor, summand] = scale.unwrap_or([1.0, 0.0]);
        macro_rules! each {
            ($kind:ty) => {
                decode!($kind, bytes, big_endian, |k, v| match v as f64 * factor + summand {
                    value if value.is_finite() => out.push(value),
                    value => {
                        let why = format!("is {value}, no finite number: give such voxels a value, on the other side of the level where they are outside");
                        return Err(Unreadable { voxel: first + k, why });
                    }
                })
            };
        }
        match self {
            Element::Int { size: 1, signed: false } => each!(u8),
            Element::Int { size: 1, signed: true } => each!(i8),
            Element::Int { size: 2, signed: false } => each!(u16),
            Element::Int { size: 2, signed: true } => each!(i16),
            Element::Int { size: 4, signed: false } => each!(u32),
            Element::Int { size: 4, signed: true } => each!(i32),
            Element::Int { signed: false, .. } => each!(u64),
            Element::Int { signed: true, .. } => each!(i64),
            Element::Float => each!(f32),
            Element::Double => each!(f64),
        }
        Ok(())
    }
}

/// A float that is a label.
fn whole(value: f64, voxel: usize) -> Result<i64, Unreadable> {
    if value.fract() == 0.0 && value.abs() < 9e15 {
        Ok(value as i64)
    } else {
        let why = format!("is {value}; a label volume must hold whole numbers (grey values are cut at a `level`)");
        Err(Unreadable { voxel, why })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_float_is_a_label_where_it_is_a_whole_number_and_its_neighbours_are_too() {
        for label in [0.0, -3.0, 8e15] {
            assert_eq!(whole(label, 0), Ok(label as i64));
        }
        for none in [0.5, 9.1e15, -1e300, f64::INFINITY, f64::NAN] {
            assert!(whole(none, 7).is_err_and(|e| e.voxel == 7), "{none}");
        }
    }
}
