//! Headers of NIfTI-1, which the `nifti` crate reads, of Analyze 7.5, which has the same places for what it says, and of NIfTI-2, which the
//! crate does not know.

use nifti::{Endianness, NiftiHeader};

use crate::input::volume::grid::Failure;

/// Sizes of the headers.
pub(super) const ONE: usize = 348;
pub(super) const TWO: usize = 540;

/// What a header says.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) format: &'static str,
    /// Whether voxels lie in a file of their own.
    pub(super) pair: bool,
    pub(super) dim: [i64; 8],
    pub(super) datatype: i16,
    pub(super) pixdim: [f64; 8],
    pub(super) vox_offset: f64,
    pub(super) slope: f64,
    pub(super) inter: f64,
    pub(super) units: i32,
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    pub(super) quatern: [f64; 3],
    pub(super) offset: [f64; 3],
    /// The rows of the sform.
    pub(super) rows: [[f64; 4]; 3],
    pub(super) big_endian: bool,
}

/// NIfTI-1, by the crate.
pub(super) fn one(bytes: &[u8]) -> Failure<Header> {
    if bytes.len() < ONE {
        return Err(format!("NIfTI header: ends after {} of {ONE} bytes", bytes.len()));
    }
    let h = NiftiHeader::from_reader(bytes).map_err(|e| format!("NIfTI header: {e}"))?;
    let f64s = |row: [f32; 4]| row.map(f64::from);
    Ok(Header {
        format: "NIfTI",
        pair: &h.magic == b"ni1\0",
        // The format's are signed.
        dim: h.dim.map(|n| i64::from(n.cast_signed())),
        datatype: h.datatype,
        pixdim: h.pixdim.map(f64::from),
        vox_offset: f64::from(h.vox_offset),
        slope: f64::from(h.scl_slope),
        inter: f64::from(h.scl_inter),
        units: i32::from(h.xyzt_units),
        qform_code: i32::from(h.qform_code),
        sform_code: i32::from(h.sform_code),
        quatern: [h.quatern_b, h.quatern_c, h.quatern_d].map(f64::from),
        offset: [h.quatern_x, h.quatern_y, h.quatern_z].map(f64::from),
        rows: [f64s(h.srow_x), f64s(h.srow_y), f64s(h.srow_z)],
        big_endian: h.endianness == Endianness::Big,
    })
}

/// Analyze 7.5: NIfTI-1 without what came later, of which other things may stand in its place.
pub(super) fn analyze(mut bytes: Vec<u8>) -> Failure<Header> {
    // Scaling, units, from the codes of the forms to the end of the rows, magic.
    for unknown in [112..120, 123..124, 252..328] {
        bytes.get_mut(unknown).unwrap_or_default().fill(0);
    }
    bytes.truncate(ONE);
    bytes.get_mut(344..).unwrap_or_default().copy_from_slice(b"ni1\0");
    Ok(Header { format: "Analyze", ..one(&bytes)? })
}

/// NIfTI-2.
pub(super) fn two(bytes: &[u8]) -> Failure<Header> {
    let bytes: &[u8; TWO] =
        bytes.try_into().map_err(|_| format!("NIfTI-2 header: ends after {} of {TWO} bytes", bytes.len()))?;
    let big_endian = bytes[0] == 0;
    fn at<const N: usize>(bytes: &[u8; TWO], at: usize, big_endian: bool) -> [u8; N] {
        let mut value: [u8; N] = std::array::from_fn(|k| bytes[at + k]);
        if big_endian {
            value.reverse();
        }
        value
    }
    let short = |place| i16::from_le_bytes(at(bytes, place, big_endian));
    let int = |place| i32::from_le_bytes(at(bytes, place, big_endian));
    let long = |place| i64::from_le_bytes(at(bytes, place, big_endian));
    let real = |place| f64::from_le_bytes(at(bytes, place, big_endian));
    let magic = &bytes[4..12];
    if ![b"n+2\0\r\n\x1a\n", b"ni2\0\r\n\x1a\n"].iter().any(|known| magic == *known) {
        return Err(format!("NIfTI-2 header: magic is \"{}\"; expected n+2 or ni2", text(magic).escape_default()));
    }
    Ok(Header {
        format: "NIfTI-2",
        pair: magic.starts_with(b"ni2"),
        dim: std::array::from_fn(|k| long(16 + 8 * k)),
        datatype: short(12),
        pixdim: std::array::from_fn(|k| real(104 + 8 * k)),
        // Exact: no file is 2^53 bytes long.
        vox_offset: long(168) as f64,
        slope: real(176),
        inter: real(184),
        units: int(500),
        qform_code: int(344),
        sform_code: int(348),
        quatern: [352, 360, 368].map(real),
        offset: [376, 384, 392].map(real),
        rows: [400, 432, 464].map(|row| std::array::from_fn(|k| real(row + 8 * k))),
        big_endian,
    })
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).trim_end_matches('\0').to_string()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A NIfTI-2 header of 540 bytes, numbers as `order` turns them.
    pub fn nifti_2(magic: &[u8; 8], order: impl Fn(&mut [u8])) -> Vec<u8> {
        let mut bytes = vec![0; TWO];
        let mut put = |at: usize, value: &[u8]| {
            bytes[at..at + value.len()].copy_from_slice(value);
            order(&mut bytes[at..at + value.len()]);
        };
        put(0, &(TWO as i32).to_le_bytes());
        put(12, &4i16.to_le_bytes());
        [3i64, 7, 8, 9, 1, 1, 1, 1].iter().enumerate().for_each(|(k, n)| put(16 + 8 * k, &n.to_le_bytes()));
        [1.0, 0.5, 0.75, 3.0f64].iter().enumerate().for_each(|(k, side)| put(104 + 8 * k, &side.to_le_bytes()));
        put(168, &544i64.to_le_bytes());
        put(500, &2i32.to_le_bytes());
        bytes[4..12].copy_from_slice(magic);
        bytes
    }

    #[test]
    fn sizes_of_nifti_1_have_a_sign_and_a_header_has_all_its_bytes() {
        let mut bytes = vec![0; ONE];
        bytes[..4].copy_from_slice(&(ONE as i32).to_le_bytes());
        for (k, n) in [3i16, 20, -1, 9].iter().enumerate() {
            bytes[40 + 2 * k..][..2].copy_from_slice(&n.to_le_bytes());
        }
        bytes[344..].copy_from_slice(b"n+1\0");
        assert_eq!(one(&bytes).expect("it is whole").dim[..4], [3, 20, -1, 9]);
        let Err(message) = one(&bytes[..200]) else { panic!("it is cut off") };
        assert_eq!(message, "NIfTI header: ends after 200 of 348 bytes");
    }

    #[test]
    fn numbers_of_nifti_2_are_read_in_either_order() {
        for turn in [false, true] {
            let bytes = nifti_2(b"n+2\0\r\n\x1a\n", |value| {
                if turn {
                    value.reverse()
                }
            });
            let header = two(&bytes).expect("it is sound");
            assert_eq!((header.dim, header.datatype, header.units), ([3, 7, 8, 9, 1, 1, 1, 1], 4, 2));
            assert_eq!((&header.pixdim[..4], header.vox_offset), (&[1.0, 0.5, 0.75, 3.0][..], 544.0));
            assert_eq!((header.big_endian, header.pair), (turn, false));
        }
    }
}
