//! What is read: volumes, images, polygons, RT structure sets and contour maps, and what is said of them before the work.

mod dense_polygons;
mod doubts;
#[path = "../support/files.rs"]
mod files;
mod forgotten;
#[cfg(feature = "geopackage")]
mod geopackage;
mod grey_volumes;
mod image_values;
mod lone_axes;
#[cfg(feature = "terrain")]
mod map_units;
#[cfg(feature = "zarr")]
mod ome_zarr;
mod pixels;
mod polygons;
#[cfg(feature = "dicom")]
#[path = "../support/rtss.rs"]
mod rtss;
#[cfg(feature = "dicom")]
mod rtstruct;
#[cfg(feature = "terrain")]
mod terrain;
mod tiff_lzw;
mod volumes;
