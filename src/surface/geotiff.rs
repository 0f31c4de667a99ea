//! Place of a height map, as the tags of a GeoTIFF (OGC 19-008) say it.

use std::io::{self, Seek, Write};

use tiff::TiffError;
use tiff::encoder::colortype::ColorType;
use tiff::encoder::{TiffEncoder, TiffValue};
use tiff::tags::Tag;

use crate::surface::map::Crs;

/// Keys of the GeoKey directory: whether places are in a plane or in degrees, what a pixel is, codes of systems, a system in words.
pub const MODEL_TYPE: u16 = 1024;
pub const RASTER_TYPE: u16 = 1025;
pub const GEOGRAPHIC_CRS: u16 = 2048;
pub const PROJECTED_CRS: u16 = 3072;
const PROJECTED_CITATION: u16 = 3073;
/// A model in a plane, pixels that are areas, a coordinate system of one's own.
const PROJECTED: u16 = 1;
const PIXEL_IS_AREA: u16 = 1;
/// Code of a system that has none.
pub const USER_DEFINED: u16 = 32767;

/// A height map in the world: rows from north to south.
#[derive(Debug, Clone)]
pub struct Raster<'a> {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Pixel sides.
    pub spacing: [f64; 2],
    /// West and north edge: the corner of pixel (0, 0).
    pub corner: [f64; 2],
    /// Coordinate system.
    pub crs: &'a Crs,
}

impl Raster<'_> {
    /// Writes heights as pixels of type `C`, NaN where there is none.
    ///
    /// # Errors
    /// The errors of `out`, as the TIFF encoder tells them.
    pub fn write<C: ColorType>(&self, out: impl Write + Seek, heights: &[C::Inner]) -> io::Result<()>
    where
        [C::Inner]: TiffValue,
    {
        self.encode::<C>(out, heights).map_err(io::Error::other)
    }

    fn encode<C: ColorType>(&self, out: impl Write + Seek, heights: &[C::Inner]) -> Result<(), TiffError>
    where
        [C::Inner]: TiffValue,
    {
        let mut encoder = TiffEncoder::new(out)?;
        let mut image = encoder.new_image::<C>(self.size[0], self.size[1])?;
        let (keys, text) = self.keys();
        let tags = image.encoder();
        tags.write_tag(Tag::ModelPixelScaleTag, &[self.spacing[0], self.spacing[1], 0.0][..])?;
        tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, self.corner[0], self.corner[1], 0.0][..])?;
        tags.write_tag(Tag::GeoKeyDirectoryTag, &keys[..])?;
        if !text.is_empty() {
            tags.write_tag(Tag::GeoAsciiParamsTag, text.as_str())?;
        }
        tags.write_tag(Tag::GdalNodata, "nan")?;
        image.write_data(heights)
    }

    /// The GeoKey directory, and the text it refers to.
    fn keys(&self) -> (Vec<u16>, String) {
        let mut text = String::new();
        // Key, the tag that has its value (0: the directory itself), number of values, value or place.
        let mut keys = vec![[RASTER_TYPE, 0, 1, PIXEL_IS_AREA]];
        match self.crs {
            Crs::Epsg(code) => {
                keys.insert(0, [MODEL_TYPE, 0, 1, PROJECTED]);
                keys.push([PROJECTED_CRS, 0, 1, *code as u16]);
            }
            Crs::Wkt(wkt) => {
                // How Esri and GDAL hand on a system that has no code: GDAL reads it of a model of one's own. A bar ends a text.
                text = format!("ESRI PE String = {}|", wkt.replace('|', "/"));
                keys.insert(0, [MODEL_TYPE, 0, 1, USER_DEFINED]);
                keys.push([PROJECTED_CRS, 0, 1, USER_DEFINED]);
                keys.push([PROJECTED_CITATION, Tag::GeoAsciiParamsTag.to_u16(), text.len() as u16, 0]);
            }
            Crs::Unknown | Crs::Local => {}
        }
        let head = [1, 1, 0, keys.len() as u16];
        (std::iter::once(head).chain(keys).flatten().collect(), text)
    }
}
