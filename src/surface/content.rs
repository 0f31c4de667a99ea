//! Content of a volume, and the type of its voxels in a file.

/// Content of a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// f32 signed in-plane distance in the stack's unit, negative inside, clamped to the margin.
    Distance,
    /// u8, 1 inside and 0 outside.
    Mask,
    /// u8, where a voxel comes from, see [`origin`](super::origin).
    Origin,
    /// f32, how far a voxel's side can be relied on, see [`origin`](super::origin).
    Confidence,
    /// Numbers of labels: a layer has them instead of distances.
    Labels(Whole),
}

/// Whole numbers that hold labels, the smallest that can.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Whole {
    /// 0 to 255.
    U8,
    /// 0 to 65535.
    U16,
    /// Numbers to 2^24 either side of 0, as far as f32 goes.
    I32,
}

impl Whole {
    /// Largest label either side of 0.
    pub const MOST: i64 = 1 << 24;

    /// Smallest type that holds labels from `least` to `most`, and 0; `None` beyond [`Whole::MOST`].
    pub fn holding(least: i64, most: i64) -> Option<Self> {
        match (least, most) {
            (0.., ..=0xff) => Some(Whole::U8),
            (0.., ..=0xffff) => Some(Whole::U16),
            _ if least >= -Self::MOST && most <= Self::MOST => Some(Whole::I32),
            _ => None,
        }
    }
}

/// Type of a voxel in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    F32,
    U8,
    U16,
    I32,
}

impl Content {
    /// Type of a voxel.
    pub(super) fn scalar(self) -> Scalar {
        match self {
            Content::Distance | Content::Confidence => Scalar::F32,
            Content::Mask | Content::Origin | Content::Labels(Whole::U8) => Scalar::U8,
            Content::Labels(Whole::U16) => Scalar::U16,
            Content::Labels(Whole::I32) => Scalar::I32,
        }
    }

    /// Bytes of a voxel.
    pub(super) fn size(self) -> usize {
        match self.scalar() {
            Scalar::F32 | Scalar::I32 => 4,
            Scalar::U16 => 2,
            Scalar::U8 => 1,
        }
    }

    /// Voxels of (a part of) a layer as little-endian bytes, x fastest, put behind `bytes`.
    pub(super) fn voxels(self, phi: &[f32], bytes: &mut Vec<u8>) {
        match self {
            Content::Distance | Content::Confidence => {
                phi.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()))
            }
            Content::Mask => bytes.extend(phi.iter().map(|v| u8::from(*v < 0.0))),
            Content::Origin | Content::Labels(Whole::U8) => bytes.extend(phi.iter().map(|v| *v as u8)),
            Content::Labels(Whole::U16) => bytes.extend(phi.iter().flat_map(|v| (*v as u16).to_le_bytes())),
            Content::Labels(Whole::I32) => bytes.extend(phi.iter().flat_map(|v| (*v as i32).to_le_bytes())),
        }
    }
}
