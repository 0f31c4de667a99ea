//! Volumes as Zarr, version 3: a folder of chunks, so that a reader takes what it needs of a volume larger than memory. The metadata are
//! those of an OME-Zarr 0.5 image with one level. The array's axes z, y, x are those of the input, whatever axis its slices lie across; layers
//! go into chunks as they lie, so that nothing waits but the layers of a chunk.
//!
//! OME-Zarr knows a scale and a translation per axis and no rotation: its coordinates are those along the volume's own axes, from the world's
//! origin (`origin . axis`). How the volume lies in the world stands in the attribute `interslice`, as NRRD has it.

use std::io;
use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;
use serde_json::{Map, Value, json};
use zarrs::array::codec::GzipCodec;
use zarrs::array::data_type::{float32, float64, int8, int16, int32, int64, uint8, uint16, uint32, uint64};
use zarrs::array::{Array, ArrayBuilder, Element};
use zarrs::filesystem::FilesystemStore;
use zarrs::group::GroupBuilder;

use super::Layer;
use super::content::{Content, Paint, Scalar};
use super::glb::colour::shown;
use super::header::Header;
use super::own_store::{ATTRIBUTE, LEVEL};
use super::stream::{BodyWriter, Ending};
use super::voxels::VoxelGrid;
use crate::stack::appearance::Appearance;

/// Columns, rows and layers of a chunk; fewer layers where [`SLAB_BYTES`] hold no more.
const CHUNK: [usize; 3] = [256, 256, 64];
/// Most bytes of the layers that wait for their chunks to be full, if two have room.
const SLAB_BYTES: usize = 256 << 20;
/// Level of gzip: as fast as it can.
const COMPRESSION: u32 = 1;

/// A writer of the output layers into the empty folder `folder`.
///
/// # Errors
/// The errors of the folder.
pub fn writer(
    folder: &Path,
    body: &Header,
    content: Content,
    labels: &[Appearance],
) -> io::Result<Box<dyn BodyWriter>> {
    let attributes = attributes(body, content, &content.painted(labels));
    let beyond = if matches!(content, Content::Distance | Content::Confidence) { f32::NAN } else { 0.0 };
    macro_rules! of {
        ($kind:ty) => {{
            let value: fn(Content, f32) -> $kind = |content, v| match content {
                Content::Mask(Paint { value, .. }) if v < 0.0 => value as $kind,
                Content::Mask(_) => 0 as $kind,
                _ => v as $kind,
            };
            Box::new(ZarrWriter::new(folder, body, (content, attributes.clone()), beyond as $kind, value)?)
        }};
    }
    Ok(match content.scalar() {
        Scalar::U8 => of!(u8),
        Scalar::I8 => of!(i8),
        Scalar::U16 => of!(u16),
        Scalar::I16 => of!(i16),
        Scalar::U32 => of!(u32),
        Scalar::I32 => of!(i32),
        Scalar::U64 => of!(u64),
        Scalar::I64 => of!(i64),
        Scalar::F32 => of!(f32),
        Scalar::F64 => of!(f64),
    })
}

/// Layers of a chunk for layers of so many voxels of so many bytes.
fn depth(pixels: usize, voxel: usize) -> usize {
    let room = SLAB_BYTES / (pixels * voxel).max(1);
    [CHUNK[2], 32, 16, 8, 4, 2].into_iter().find(|depth| *depth <= room).unwrap_or(1)
}

/// Bytes of memory that writing layers of so many pixels needs at most: a slab, and per thread a chunk before and after its compression.
pub(crate) fn bytes(pixels: usize, threads: usize) -> u64 {
    let voxel = size_of::<f64>();
    let depth = depth(pixels, voxel);
    let chunk = depth * pixels.min(CHUNK[0] * CHUNK[1]) * voxel;
    (depth * pixels * voxel + 3 * threads * chunk) as u64
}

struct ZarrWriter<T> {
    array: Array<FilesystemStore>,
    /// Pixels of a layer, columns, rows and layers of a chunk.
    dims: [usize; 2],
    chunk: [usize; 3],
    /// Axis of the volume that each of them runs along.
    order: [usize; 3],
    /// Content of a voxel, and the value beyond the volume.
    content: Content,
    value: fn(Content, f32) -> T,
    beyond: T,
    /// Layers that wait, and how many were written before.
    slab: Vec<T>,
    written: usize,
    count: usize,
}

impl<T: Element + Copy + Send + Sync> ZarrWriter<T> {
    fn new(
        folder: &Path,
        body: &Header,
        (content, attributes): (Content, Map<String, Value>),
        beyond: T,
        value: fn(Content, f32) -> T,
    ) -> io::Result<Self> {
        let store = Arc::new(FilesystemStore::new(folder).map_err(io::Error::other)?);
        let grid = VoxelGrid::of(body);
        let group = GroupBuilder::new().attributes(attributes).build(store.clone(), "/");
        group.map_err(io::Error::other)?.store_metadata().map_err(io::Error::other)?;
        let [nx, ny] = body.dims;
        let count = body.grid.count;
        let chunk = [CHUNK[0].min(nx), CHUNK[1].min(ny), depth(nx * ny, size_of::<T>()).min(count.max(1))];
        let shape = zyx(grid.dims).to_vec();
        let chunks = zyx(along_axes(chunk, grid.order));
        let mut builder = match content.scalar() {
            Scalar::U8 => ArrayBuilder::new(shape, chunks, uint8(), 0u8),
            Scalar::I8 => ArrayBuilder::new(shape, chunks, int8(), 0i8),
            Scalar::U16 => ArrayBuilder::new(shape, chunks, uint16(), 0u16),
            Scalar::I16 => ArrayBuilder::new(shape, chunks, int16(), 0i16),
            Scalar::U32 => ArrayBuilder::new(shape, chunks, uint32(), 0u32),
            Scalar::I32 => ArrayBuilder::new(shape, chunks, int32(), 0i32),
            Scalar::U64 => ArrayBuilder::new(shape, chunks, uint64(), 0u64),
            Scalar::I64 => ArrayBuilder::new(shape, chunks, int64(), 0i64),
            Scalar::F32 if matches!(content, Content::Distance | Content::Confidence) => {
                ArrayBuilder::new(shape, chunks, float32(), f32::NAN)
            }
            Scalar::F32 => ArrayBuilder::new(shape, chunks, float32(), 0f32),
            Scalar::F64 => ArrayBuilder::new(shape, chunks, float64(), 0f64),
        };
        let gzip = GzipCodec::new(COMPRESSION).map_err(io::Error::other)?;
        builder.bytes_to_bytes_codecs(vec![Arc::new(gzip)]).dimension_names(Some(["z", "y", "x"]));
        let array = builder.build(store, &format!("/{LEVEL}")).map_err(io::Error::other)?;
        array.store_metadata().map_err(io::Error::other)?;
        let order = grid.order;
        Ok(ZarrWriter {
            array,
            dims: body.dims,
            chunk,
            order,
            content,
            value,
            beyond,
            slab: Vec::new(),
            written: 0,
            count,
        })
    }

    /// Writes the layers that wait as one layer of chunks.
    fn store(&mut self) -> io::Result<()> {
        let [nx, ny] = self.dims;
        let [width, height, depth] = self.chunk;
        let layers = self.slab.len() / (nx * ny);
        let ck = self.written / depth;
        // How far apart neighbours along the layers' columns, rows and heights lie in a chunk.
        let [x, y, _] = along_axes(self.chunk, self.order);
        let [columns, rows, heights] = self.order.map(|axis| [1, x, x * y][axis]);
        let across = nx.div_ceil(width);
        (0..across * ny.div_ceil(height)).into_par_iter().try_for_each(|n| {
            let (cj, ci) = (n / across, n % across);
            let mut chunk = vec![self.beyond; depth * height * width];
            let (i, row_length) = (ci * width, width.min(nx - ci * width));
            for k in 0..layers {
                for j in 0..height.min(ny - cj * height) {
                    let from = (k * ny + cj * height + j) * nx + i;
                    let to = chunk[k * heights + j * rows..].iter_mut().step_by(columns);
                    to.zip(&self.slab[from..from + row_length]).for_each(|(to, from)| *to = *from);
                }
            }
            self.array.store_chunk(&zyx(along_axes([ci, cj, ck], self.order)), chunk).map_err(io::Error::other)
        })?;
        self.written += layers;
        self.slab.clear();
        Ok(())
    }
}

impl<T: Element + Copy + Send + Sync> BodyWriter for ZarrWriter<T> {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        if !layer.output {
            return Ok(());
        }
        self.slab.extend(layer.dense().into_iter().map(|v| (self.value)(self.content, v)));
        let full = self.chunk[2] * self.dims[0] * self.dims[1];
        if self.slab.len() == full { self.store() } else { Ok(()) }
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        if !self.slab.is_empty() {
            self.store()?;
        }
        if self.written == self.count {
            Ok(())
        } else {
            Err(io::Error::other(format!("{} of {} layers have come", self.written, self.count)))
        }
    }
}

/// Numbers of the layers' columns, rows and heights as those of the volume's axes.
fn along_axes(of_layers: [usize; 3], order: [usize; 3]) -> [usize; 3] {
    let mut axes = [0; 3];
    order.into_iter().zip(of_layers).for_each(|(axis, n)| axes[axis] = n);
    axes
}

fn zyx([x, y, z]: [usize; 3]) -> [u64; 3] {
    [z, y, x].map(|n| n as u64)
}

fn attributes(body: &Header, content: Content, labels: &[Appearance]) -> Map<String, Value> {
    let grid = VoxelGrid::of(body);
    let axis = |name: &str| match ome_unit(&body.unit) {
        Some(unit) => json!({"name": name, "type": "space", "unit": unit}),
        None => json!({"name": name, "type": "space"}),
    };
    let backwards = |of: &dyn Fn(usize) -> f64| json!([of(2), of(1), of(0)]);
    let transformations = json!([
        {"type": "scale", "scale": backwards(&|a| grid.sides[a])},
        {"type": "translation", "translation": backwards(&|a| grid.origin.dot(grid.axes[a]))},
    ]);
    let axes = ["z", "y", "x"].map(axis);
    let image = json!({
        "name": "interslice",
        "axes": axes,
        "datasets": [{"path": LEVEL, "coordinateTransformations": transformations}],
    });
    let own = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "content": match content {
            Content::Distance => "signed distance",
            Content::Mask(_) => "mask",
            Content::Origin => "origin",
            Content::Confidence => "confidence",
            Content::Labels(_) => "labels",
        },
        "space": "left-posterior-superior",
        "space units": body.unit,
        "space origin": grid.origin,
        "space directions": {"x": grid.step(0), "y": grid.step(1), "z": grid.step(2)},
    });
    let mut ome = json!({"version": "0.5", "multiscales": [image]});
    if !labels.is_empty() {
        ome["image-label"] = image_label(labels);
    }
    Map::from_iter([("ome".into(), ome), (ATTRIBUTE.into(), own)])
}

/// Names and colours of labels.
fn image_label(labels: &[Appearance]) -> Value {
    let of = |entry: &dyn Fn(&Appearance) -> Value| labels.iter().map(entry).collect::<Vec<_>>();
    let colours = of(&|label| {
        let [r, g, b] = shown(label).map(|share| (255.0 * share).round() as u8);
        json!({"label-value": label.number, "rgba": [r, g, b, 255]})
    });
    let names = of(&|label| match &label.name {
        Some(name) => json!({"label-value": label.number, "name": name}),
        None => json!({"label-value": label.number}),
    });
    json!({"colors": colours, "properties": names})
}

/// Units and their names in OME-Zarr.
const UNITS: [(&str, &str); 7] = [
    ("nm", "nanometer"),
    ("um", "micrometer"),
    ("µm", "micrometer"),
    ("mm", "millimeter"),
    ("cm", "centimeter"),
    ("m", "meter"),
    ("km", "kilometer"),
];

/// The unit's name in OME-Zarr.
fn ome_unit(unit: &str) -> Option<&'static str> {
    UNITS.iter().find(|(short, _)| *short == unit).map(|(_, name)| *name)
}

/// The unit that OME-Zarr calls so.
pub(crate) fn unit_of(name: &str) -> Option<&'static str> {
    UNITS.iter().find(|(_, known)| *known == name).map(|(short, _)| *short)
}
