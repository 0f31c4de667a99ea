//! Content of a volume, and the type of its voxels in a file.

use serde::{Deserialize, Serialize};

use crate::stack::appearance::Appearance;

/// Content of a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// f32 signed in-plane distance in the stack's unit, negative inside, clamped to the margin.
    Distance,
    /// One value inside and 0 outside.
    Mask(Paint),
    /// u8, where a voxel comes from, see [`origin`](super::origin).
    Origin,
    /// f32, the probability that a voxel lies on the right side, see [`origin`](super::origin).
    Confidence,
    /// Numbers of labels: a layer has them instead of distances.
    Labels(Scalar),
}

impl Content {
    /// The labels with the numbers that their voxels have; a mask is one label, other volumes have none.
    pub(super) fn painted(self, labels: &[Appearance]) -> Vec<Appearance> {
        match self {
            Content::Mask(paint) => {
                let only = labels.first().filter(|_| labels.len() == 1).cloned();
                vec![Appearance { number: Some(paint.value), ..only.unwrap_or_default() }]
            }
            Content::Labels(_) => labels.to_vec(),
            _ => Vec::new(),
        }
    }
}

/// Voxels of a mask: their type, and their value inside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Paint {
    /// Their type.
    pub scalar: Scalar,
    /// Their value inside, not 0.
    pub value: i64,
}

impl Default for Paint {
    fn default() -> Self {
        Paint { scalar: Scalar::U8, value: 1 }
    }
}

impl Paint {
    /// Voxels of type `scalar`, or where that cannot hold `value` of the smallest type that can.
    pub fn holding(scalar: Scalar, value: i64) -> Self {
        Paint { scalar: scalar.or_wider(value, value), value }
    }
}

/// Type of a voxel in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scalar {
    /// 0 to 2^8 - 1.
    U8,
    /// -2^7 to 2^7 - 1.
    I8,
    /// 0 to 2^16 - 1.
    U16,
    /// -2^15 to 2^15 - 1.
    I16,
    /// 0 to 2^32 - 1.
    U32,
    /// -2^31 to 2^31 - 1.
    I32,
    /// 0 to 2^64 - 1.
    U64,
    /// -2^63 to 2^63 - 1.
    I64,
    /// 32-bit numbers, whole ones to 2^24.
    F32,
    /// 64-bit numbers, whole ones to 2^53.
    F64,
}

impl Scalar {
    /// Largest label either side of 0 in a run of many: their layers are f32.
    pub const MOST_LABEL: i64 = 1 << 24;

    /// Bytes of a voxel.
    pub(super) fn size(self) -> usize {
        match self {
            Scalar::U8 | Scalar::I8 => 1,
            Scalar::U16 | Scalar::I16 => 2,
            Scalar::U32 | Scalar::I32 | Scalar::F32 => 4,
            Scalar::U64 | Scalar::I64 | Scalar::F64 => 8,
        }
    }

    /// Smallest and largest whole number that it holds without rounding, as far as i64 goes.
    fn range(self) -> [i64; 2] {
        match self {
            Scalar::U8 => [0, u8::MAX.into()],
            Scalar::I8 => [i8::MIN.into(), i8::MAX.into()],
            Scalar::U16 => [0, u16::MAX.into()],
            Scalar::I16 => [i16::MIN.into(), i16::MAX.into()],
            Scalar::U32 => [0, u32::MAX.into()],
            Scalar::I32 => [i32::MIN.into(), i32::MAX.into()],
            Scalar::U64 => [0, i64::MAX],
            Scalar::I64 => [i64::MIN, i64::MAX],
            Scalar::F32 => [-(1 << 24), 1 << 24],
            Scalar::F64 => [-(1 << 53), 1 << 53],
        }
    }

    /// This type where it holds whole numbers from `least` to `most`; else the smallest integer that does.
    pub fn or_wider(self, least: i64, most: i64) -> Self {
        let holds = |scalar: &Scalar| {
            let [low, high] = scalar.range();
            low <= least && most <= high
        };
        let wider = [self, Scalar::U8, Scalar::I16, Scalar::U16, Scalar::I32, Scalar::U32];
        wider.into_iter().find(holds).unwrap_or(Scalar::I64)
    }

    /// Appends a whole number as little-endian bytes.
    fn push(self, value: i64, bytes: &mut Vec<u8>) {
        match self {
            Scalar::F32 => bytes.extend_from_slice(&(value as f32).to_le_bytes()),
            Scalar::F64 => bytes.extend_from_slice(&(value as f64).to_le_bytes()),
            // Two's complement: a smaller integer is the lower bytes.
            _ => bytes.extend_from_slice(&value.to_le_bytes()[..self.size()]),
        }
    }
}

impl Content {
    /// Type of a voxel.
    pub(super) fn scalar(self) -> Scalar {
        match self {
            Content::Distance | Content::Confidence => Scalar::F32,
            Content::Origin => Scalar::U8,
            Content::Mask(Paint { scalar, .. }) | Content::Labels(scalar) => scalar,
        }
    }

    /// Bytes of a voxel.
    pub(super) fn size(self) -> usize {
        self.scalar().size()
    }

    /// Voxels of (a part of) a layer as little-endian bytes, x fastest, put behind `bytes`.
    pub(super) fn voxels(self, phi: &[f32], bytes: &mut Vec<u8>) {
        bytes.reserve(phi.len() * self.size());
        match self {
            Content::Distance | Content::Confidence => {
                phi.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()))
            }
            Content::Mask(Paint { scalar, value }) => {
                phi.iter().for_each(|v| scalar.push(if *v < 0.0 { value } else { 0 }, bytes));
            }
            Content::Origin => bytes.extend(phi.iter().map(|v| *v as u8)),
            Content::Labels(scalar) => phi.iter().for_each(|v| scalar.push(*v as i64, bytes)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_that_its_type_cannot_hold_gets_a_wider_one() {
        for (scalar, value, wanted) in [
            (Scalar::U8, 255, Scalar::U8),
            (Scalar::U8, 256, Scalar::I16),
            (Scalar::U8, -1, Scalar::I16),
            (Scalar::I8, 128, Scalar::U8),
            (Scalar::I16, 40_000, Scalar::U16),
            (Scalar::F32, 1 << 24, Scalar::F32),
            (Scalar::F32, (1 << 24) + 1, Scalar::I32),
            (Scalar::U32, 1 << 40, Scalar::I64),
            (Scalar::F64, -7, Scalar::F64),
        ] {
            assert_eq!(Paint::holding(scalar, value).scalar, wanted, "{value} in {scalar:?}");
        }
    }

    #[test]
    fn voxels_have_the_value_in_their_type() {
        let voxels = |scalar, value| {
            let mut bytes = Vec::new();
            Content::Mask(Paint { scalar, value }).voxels(&[1.0, -1.0], &mut bytes);
            bytes
        };
        assert_eq!(voxels(Scalar::U8, 5), [0, 5]);
        assert_eq!(voxels(Scalar::I16, -2), [0, 0, 0xfe, 0xff]);
        assert_eq!(voxels(Scalar::F32, 3), [[0; 4], 3f32.to_le_bytes()].concat());
        assert_eq!(voxels(Scalar::F64, -9), [[0; 8], (-9f64).to_le_bytes()].concat());
        assert_eq!(voxels(Scalar::U64, 1 << 40), [[0; 8], (1u64 << 40).to_le_bytes()].concat());
        let mut labels = Vec::new();
        Content::Labels(Scalar::U16).voxels(&[0.0, 300.0], &mut labels);
        assert_eq!(labels, [0, 0, 44, 1]);
    }
}
