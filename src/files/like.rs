//! `--like`: the grid of a volume, of a GeoTIFF, or of the images of a DICOM folder.

use std::path::{Path, PathBuf};
#[cfg(feature = "dicom")]
use std::sync::Arc;

use glam::DVec3;
use tiff::decoder::Decoder;
use tiff::tags::Tag;

use crate::error::{Error, Result};
use crate::input;
use crate::input::format::Kind;
use crate::input::volume::{Lacking, Volume};
#[cfg(feature = "dicom")]
use crate::rtstruct::ImageSeries;
use crate::storage::folders::files_below;
use crate::storage::regular;
use crate::surface::geotiff::{GEOGRAPHIC_CRS, MODEL_TYPE, PROJECTED_CRS, RASTER_TYPE, USER_DEFINED};
use crate::surface::like::LikeGrid;
use crate::surface::map::Crs;

/// Values of GeoKeys: places are in degrees; a pixel is a point.
const IN_DEGREES: u16 = 2;
const PIXEL_IS_POINT: u16 = 2;

/// What outputs are to be like.
#[derive(Debug, Clone)]
pub struct Like {
    /// The grid.
    pub grid: LikeGrid,
    /// Coordinate system of a raster.
    pub crs: Crs,
    /// Unit of a volume's grid: that of its file, or what is taken where it says none.
    pub unit: Option<String>,
    /// The series of images, where it is one.
    #[cfg(feature = "dicom")]
    pub series: Option<Arc<ImageSeries>>,
}

impl Like {
    /// Reads a grid; voxels and pixels are not looked at.
    ///
    /// # Errors
    /// [`Error::Read`]; [`Error::Format`] for what has no grid in the world.
    pub fn read(path: &Path) -> Result<Self> {
        match Kind::of(path)? {
            Kind::StructureSet => images(path),
            Kind::Volume(header) => {
                if let Some(raster) = raster(path)? {
                    return Ok(raster);
                }
                let Volume { grid, lacks, .. } = header(path)?;
                if let Some(Lacking::Needed(message)) = lacks {
                    return Err(Error::Format { path: path.into(), message });
                }
                if !grid.spaced {
                    let message = "does not say how far apart its voxels are; `like` needs a file that does".into();
                    return Err(Error::Format { path: path.into(), message });
                }
                let steps = grid.steps;
                let (dims, origin) = (grid.dims, grid.origin);
                let own = Like::of(LikeGrid { dims, origin, steps, planes: None, is_flat: false });
                Ok(Like { unit: Some(grid.unit), ..own })
            }
            Kind::Folder | Kind::Map => {
                let message =
                    "has no grid to be like: expected a volume, a GeoTIFF, or a folder of DICOM images".into();
                Err(Error::Format { path: path.into(), message })
            }
        }
    }

    /// A grid alone.
    pub(super) fn of(grid: LikeGrid) -> Self {
        Like {
            grid,
            crs: Crs::Unknown,
            unit: None,
            #[cfg(feature = "dicom")]
            series: None,
        }
    }

    /// The files whose content decides the grid.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn files(path: &Path) -> Result<Vec<PathBuf>> {
        if path.is_dir() {
            return files_below(path).map_err(|source| Error::Read { path: path.into(), source });
        }
        match Kind::of(path)? {
            // Photographs are grids, though no volumes.
            Kind::Volume(_) if raster(path)?.is_none() => input::files(path),
            _ => Ok(vec![path.into()]),
        }
    }
}

/// The grid of a series of images.
#[cfg(feature = "dicom")]
fn images(path: &Path) -> Result<Like> {
    let series = ImageSeries::read(path)?;
    let heights = series.heights();
    let count = heights.len();
    if count < 2 {
        let message = format!("has {count} image of its series; a grid needs at least 2");
        return Err(Error::Format { path: path.into(), message });
    }
    let (first, last) = (series.images[0].position, series.images[count - 1].position);
    let between = last - first;
    let along = series.normal();
    // A gantry that is tilted shifts images from plane to plane: no grid.
    let shift = (between - along * between.dot(along)).length();
    if shift > 0.5 * series.sides[0].min(series.sides[1]) {
        let message =
            format!("its images are shifted by {shift:.2} mm from the first to the last, across their normal");
        return Err(Error::Format { path: path.into(), message });
    }
    let step = (heights[count - 1] - heights[0]) / (count - 1) as f64;
    let grid = LikeGrid {
        dims: [series.dims[0], series.dims[1], count],
        origin: first,
        steps: [series.axes[0] * series.sides[0], series.axes[1] * series.sides[1], along * step],
        planes: Some(heights),
        is_flat: false,
    };
    Ok(Like { series: Some(Arc::new(series)), ..Like::of(grid) })
}

#[cfg(not(feature = "dicom"))]
fn images(path: &Path) -> Result<Like> {
    let message = "is DICOM, which this program was built without (feature `dicom`)".into();
    Err(Error::Format { path: path.into(), message })
}

/// The grid of a GeoTIFF; nothing of any other file.
fn raster(path: &Path) -> Result<Option<Like>> {
    let Ok(file) = regular::open(path) else { return Ok(None) };
    let Ok(mut decoder) = Decoder::new(std::io::BufReader::new(file)) else { return Ok(None) };
    let numbers = |decoder: &mut Decoder<_>, tag| decoder.get_tag_f64_vec(tag).ok();
    let fail = |message: String| Err(Error::Format { path: path.into(), message });
    let Some(scale) = numbers(&mut decoder, Tag::ModelPixelScaleTag) else {
        return match numbers(&mut decoder, Tag::ModelTransformationTag) {
            None => Ok(None),
            Some(_) => fail(
                "its ModelTransformation turns the raster, or has its rows run to the north; `like` needs one whose rows run to the east, from the \
                 north to the south (gdalwarp makes one)"
                    .into(),
            ),
        };
    };
    let tie = numbers(&mut decoder, Tag::ModelTiepointTag).unwrap_or_default();
    let (&[dx, dy, ..], &[i, j, _, x, y, ..]) = (&scale[..], &tie[..]) else {
        return fail("ModelPixelScale needs 3 numbers and ModelTiepoint 6".into());
    };
    if ![dx, dy, i, j, x, y].iter().all(|v| v.is_finite()) || dx <= 0.0 || dy <= 0.0 {
        return fail(format!("ModelPixelScale must be positive; got {dx}, {dy}"));
    }
    let Ok((width, height)) = decoder.dimensions() else { return fail("does not say its size".into()) };
    let keys = decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).unwrap_or_default();
    let (rows, _) = keys.as_chunks::<4>();
    let key = |wanted: u16| rows.iter().skip(1).find(|k| k[0] == wanted && k[1] == 0).map(|k| k[3]);
    // The tie is a corner of pixel (i, j), or its centre.
    let half = if key(RASTER_TYPE) == Some(PIXEL_IS_POINT) { 0.0 } else { 0.5 };
    let (west, north) = (x + (half - i) * dx, y - (half - j) * dy);
    // A projected system names that of its degrees too; one without a code is not known.
    let code = key(if key(MODEL_TYPE) == Some(IN_DEGREES) { GEOGRAPHIC_CRS } else { PROJECTED_CRS });
    let crs = code
        .filter(|code| *code != USER_DEFINED)
        .and_then(|code| Crs::named(&format!("EPSG:{code}")))
        .unwrap_or_default();
    let [nx, ny] = [width as usize, height as usize];
    // Maps have y to the north.
    let grid = LikeGrid {
        dims: [nx, ny, 1],
        origin: DVec3::new(west, north - (ny as f64 - 1.0) * dy, 0.0),
        steps: [dx * DVec3::X, dy * DVec3::Y, DVec3::Z],
        planes: None,
        is_flat: true,
    };
    Ok(Some(Like { crs, ..Like::of(grid) }))
}
