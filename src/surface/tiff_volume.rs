//! Volumes as TIFF, a page per slice across z: as ImageJ's hyperstack, or with OME-XML. Neither says where a volume lies in the world.
//!
//! Pages are not packed and lie one behind the other, as ImageJ reads a stack of any size; beyond 4 GB the file is a BigTIFF.

use std::io::{self, Seek, Write};
use std::path::Path;

use bytemuck::Pod;
use tiff::TiffResult;
use tiff::encoder::colortype::{
    ColorType, Gray8, Gray16, Gray32, Gray32Float, Gray64, Gray64Float, GrayI8, GrayI16, GrayI32, GrayI64,
};
use tiff::encoder::{Rational, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard, TiffValue};
use tiff::tags::{ResolutionUnit, Tag};

use super::content::{Content, Paint, Scalar};
use super::header::Header;
use super::length::of_ome;
use super::volume::{Coded, VolumeWriter};
use super::voxels::VoxelGrid;

/// Bytes of voxels beyond which a file is a BigTIFF: 4 GB, less room for what is said of the pages.
const MOST_BYTES: u64 = 0xf000_0000;

/// Share of a pixel's side by which the file's may differ.
const ROUNDED: f64 = 1e-6;

/// Description in the first page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dialect {
    /// ImageJ's lines.
    ImageJ,
    /// OME-XML.
    Ome,
}

/// A writer of the output layers. Layers that lie across x or y of the volume wait in a nameless file in `folder`. `name` is the image's.
///
/// # Errors
/// The errors of `out` and that file; [`io::ErrorKind::InvalidInput`] for a label in OME-TIFF that needs 64 bits.
pub fn writer<W: Write + Seek>(
    out: W,
    body: &Header,
    content: Content,
    dialect: Dialect,
    name: &str,
    folder: &Path,
) -> io::Result<VolumeWriter<Pages<W>>> {
    let grid = VoxelGrid::of(body);
    let content = if dialect == Dialect::Ome { without_64_bits(content)? } else { content };
    let [width, height, count] = grid.dims;
    let size = [width, height].map(|n| u32::try_from(n).map_err(|_| wide(n)));
    let [width, height] = size;
    let size = [width?, height?];
    let voxel = content.size();
    let page = grid.dims[0] * grid.dims[1] * voxel;
    let encoder = if page as u64 * count as u64 > MOST_BYTES {
        Encoder::Big(TiffEncoder::new_big(out).map_err(io::Error::other)?)
    } else {
        Encoder::Standard(TiffEncoder::new(out).map_err(io::Error::other)?)
    };
    let described = match dialect {
        Dialect::ImageJ => Described {
            text: imagej(&grid, resolution(&grid).map(|_| body.unit.as_str())),
            per_unit: resolution(&grid),
        },
        Dialect::Ome => Described { text: ome(&grid, &body.unit, content.scalar(), name), per_unit: None },
    };
    let pages = Pages {
        encoder,
        scalar: content.scalar(),
        size,
        page: Vec::with_capacity(page),
        bytes: page,
        described: Some(described),
    };
    VolumeWriter::new(Coded::Raw(pages), body, content, folder)
}

/// Note for a person about the sides of voxels that the format cannot hold, or their unit, which it does not know.
pub fn told(body: &Header, dialect: Dialect) -> Option<String> {
    let grid = VoxelGrid::of(body);
    let unit = &body.unit;
    match dialect {
        Dialect::ImageJ => resolution(&grid).is_none().then(|| {
            let [x, y, _] = grid.sides;
            format!(
                "TIFF holds the pixels per {unit} as a fraction of 32-bit numbers, but pixels are {x:?} x {y:?} {unit}: the file does not say the sides of voxels"
            )
        }),
        Dialect::Ome => (of_ome(unit).is_none() && !["px", ""].contains(&unit.trim()))
            .then(|| format!("OME-TIFF does not know the unit {unit}: the file does not say the sides of voxels")),
    }
}

fn wide(n: usize) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, format!("TIFF holds at most 2^32 pixels along a side; got {n}"))
}

/// The content in a type that OME knows.
fn without_64_bits(content: Content) -> io::Result<Content> {
    let is_64 = |scalar| matches!(scalar, Scalar::U64 | Scalar::I64);
    let narrower = match content {
        Content::Mask(Paint { scalar, value }) if is_64(scalar) => Content::Mask(Paint::holding(Scalar::U8, value)),
        // Labels of many lie within 24 bits.
        Content::Labels(scalar) if is_64(scalar) => Content::Labels(Scalar::I32),
        other => other,
    };
    match narrower {
        Content::Mask(Paint { scalar, value }) if is_64(scalar) => {
            let message = format!("OME-TIFF holds labels of at most 32 bits; got {value}");
            Err(io::Error::new(io::ErrorKind::InvalidInput, message))
        }
        other => Ok(other),
    }
}

/// What the first page says of all.
struct Described {
    text: String,
    per_unit: Option<[Rational; 2]>,
}

enum Encoder<W: Write + Seek> {
    Standard(TiffEncoder<W, TiffKindStandard>),
    Big(TiffEncoder<W, TiffKindBig>),
}

/// Pages of a TIFF, cut from the little-endian bytes of voxels that are written to it.
pub struct Pages<W: Write + Seek> {
    encoder: Encoder<W>,
    scalar: Scalar,
    /// Columns and rows of a page.
    size: [u32; 2],
    /// Bytes of the page that is being filled, and of a whole one.
    page: Vec<u8>,
    bytes: usize,
    described: Option<Described>,
}

impl<W: Write + Seek> Pages<W> {
    fn send(&mut self) -> io::Result<()> {
        if cfg!(target_endian = "big") {
            // The encoder writes in the machine's order.
            self.page.chunks_exact_mut(self.scalar.size()).for_each(<[u8]>::reverse);
        }
        let described = self.described.take();
        let (size, bytes) = (self.size, &self.page[..]);
        macro_rules! as_pixels {
            ($colour:ty) => {
                match &mut self.encoder {
                    Encoder::Standard(encoder) => page::<$colour, W, _>(encoder, size, described, bytes),
                    Encoder::Big(encoder) => page::<$colour, W, _>(encoder, size, described, bytes),
                }
            };
        }
        let sent = match self.scalar {
            Scalar::U8 => as_pixels!(Gray8),
            Scalar::I8 => as_pixels!(GrayI8),
            Scalar::U16 => as_pixels!(Gray16),
            Scalar::I16 => as_pixels!(GrayI16),
            Scalar::U32 => as_pixels!(Gray32),
            Scalar::I32 => as_pixels!(GrayI32),
            Scalar::U64 => as_pixels!(Gray64),
            Scalar::I64 => as_pixels!(GrayI64),
            Scalar::F32 => as_pixels!(Gray32Float),
            Scalar::F64 => as_pixels!(Gray64Float),
        };
        self.page.clear();
        sent.map_err(io::Error::other)
    }
}

/// Writes a page.
fn page<C: ColorType, W: Write + Seek, K: TiffKind>(
    encoder: &mut TiffEncoder<W, K>,
    [width, height]: [u32; 2],
    described: Option<Described>,
    bytes: &[u8],
) -> TiffResult<()>
where
    C::Inner: Pod,
    [C::Inner]: TiffValue,
{
    let mut image = encoder.new_image::<C>(width, height)?;
    if let Some(Described { text, per_unit }) = described {
        image.encoder().write_tag(Tag::ImageDescription, text.as_str())?;
        if let Some([x, y]) = per_unit {
            image.resolution_unit(ResolutionUnit::None);
            image.x_resolution(x);
            image.y_resolution(y);
        }
    }
    image.write_data(&bytemuck::pod_collect_to_vec::<u8, C::Inner>(bytes))
}

impl<W: Write + Seek> Write for Pages<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(self.bytes - self.page.len());
        self.page.extend_from_slice(&bytes[..taken]);
        if self.page.len() == self.bytes {
            self.send()?;
        }
        Ok(taken)
    }

    /// The end: a page that is not whole is an error.
    fn flush(&mut self) -> io::Result<()> {
        match self.page.len() {
            0 => Ok(()),
            some => Err(io::Error::other(format!("{some} of {} bytes of a page have come", self.bytes))),
        }
    }
}

/// Pixels per unit along x and y; nothing where a fraction of 32-bit numbers is off by more than [`ROUNDED`].
fn resolution(grid: &VoxelGrid) -> Option<[Rational; 2]> {
    Some([per_unit(grid.sides[0])?, per_unit(grid.sides[1])?])
}

/// Pixels per unit as the nearest fraction of 32-bit numbers, by continued fractions.
fn per_unit(side: f64) -> Option<Rational> {
    let x = 1.0 / side;
    let most = f64::from(u32::MAX);
    let ([mut n, mut d], [mut before_n, mut before_d]) = ([1.0, 0.0], [0.0, 1.0]);
    let mut rest = x;
    for _ in 0..64 {
        let whole = rest.floor();
        let [next_n, next_d] = [whole * n + before_n, whole * d + before_d];
        if !(next_n <= most && next_d <= most) {
            break;
        }
        ([before_n, before_d], [n, d]) = ([n, d], [next_n, next_d]);
        if rest - whole < 1e-15 * rest || n / d == x {
            break;
        }
        rest = 1.0 / (rest - whole);
    }
    // A side below 1 / most, which has no whole part in it that fits, leaves 1 / 0, and one above most may leave 0 / 1.
    let is_near = n > 0.0 && d > 0.0 && (n / d / x - 1.0).abs() < ROUNDED;
    is_near.then_some(Rational { n: n as u32, d: d as u32 })
}

/// Without a unit the lines say nothing of the sides of voxels.
fn imagej(grid: &VoxelGrid, unit: Option<&str>) -> String {
    let count = grid.dims[2];
    let unit = unit.map(|unit| match unit {
        "px" => "pixel",
        "µm" => "um",
        other => other,
    });
    let sides = unit.map_or(String::new(), |unit| {
        let unit: String = unit.chars().filter(|c| c.is_ascii_graphic()).collect();
        format!("unit={unit}\nspacing={}\n", grid.sides[2])
    });
    format!("ImageJ=1.54f\nimages={count}\nslices={count}\nhyperstack=true\nmode=grayscale\n{sides}loop=false\n")
}

fn ome(grid: &VoxelGrid, unit: &str, scalar: Scalar, name: &str) -> String {
    let kind = match scalar {
        Scalar::U8 => "uint8",
        Scalar::I8 => "int8",
        Scalar::U16 => "uint16",
        Scalar::I16 => "int16",
        Scalar::U32 => "uint32",
        Scalar::I32 | Scalar::I64 | Scalar::U64 => "int32",
        Scalar::F32 => "float",
        Scalar::F64 => "double",
    };
    // What is no length says nothing of its size.
    let sides = of_ome(unit).map_or(String::new(), |unit| {
        let unit: String = unit.chars().map(escaped).collect();
        let side = |axis: &str, h: f64| format!(" PhysicalSize{axis}=\"{h}\" PhysicalSize{axis}Unit=\"{unit}\"");
        ["X", "Y", "Z"].iter().zip(grid.sides).map(|(axis, h)| side(axis, h)).collect()
    });
    let [nx, ny, nz] = grid.dims;
    let order = if cfg!(target_endian = "big") { "true" } else { "false" };
    let name: String = name.chars().map(escaped).collect();
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" \
         xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" xsi:schemaLocation=\"http://www.openmicroscopy.org/Schemas/OME/2016-06 \
         http://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd\"><Image ID=\"Image:0\" Name=\"{name}\"><Pixels ID=\"Pixels:0\" \
         DimensionOrder=\"XYZCT\" Type=\"{kind}\" SizeX=\"{nx}\" SizeY=\"{ny}\" SizeZ=\"{nz}\" SizeC=\"1\" SizeT=\"1\" \
         BigEndian=\"{order}\"{sides}><Channel ID=\"Channel:0:0\" SamplesPerPixel=\"1\"/><TiffData IFD=\"0\" PlaneCount=\"{nz}\"/>\
         </Pixels></Image></OME>"
    )
}

/// A character of an attribute, in ASCII.
fn escaped(c: char) -> String {
    match c {
        '&' | '<' | '>' | '"' => format!("&#{};", c as u32),
        ' '..='~' => c.into(),
        c if c.is_control() => " ".into(),
        c => format!("&#{};", c as u32),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_are_near() {
        for side in [0.75, 1.0, 0.1, 1.0 / 3.0, 0.976_562_5, 2.5e-4, 1_234.567_891, 1e-9, 0.685_546_875, 5.0] {
            let Rational { n, d } = per_unit(side).expect("it can be told");
            let back = f64::from(d) / f64::from(n);
            assert!((back / side - 1.0).abs() < 1e-9, "{side}: {n} / {d} = {back}");
        }
        for side in [2.3e-10, 1e-300, 4.3e9, 1e300] {
            assert!(per_unit(side).is_none(), "{side}");
        }
    }
}
