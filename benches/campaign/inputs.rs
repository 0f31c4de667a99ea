//! Files of random inputs, in containers of all kinds.

use std::f64::consts::TAU;
use std::io::{Cursor, Write};

use flate2::Compression;
use flate2::write::GzEncoder;
use image::GrayImage;
use serde_json::json;

use crate::random::numbers::Numbers;
use interslice::stack::{ContourStack, SliceContent};

/// What an input is of, on which it depends what can be made of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Holds {
    Body,
    /// Contours of a map.
    Map,
    /// Labels that are all asked for.
    Labels,
}

/// An input of the program.
pub struct Input {
    /// Its name in the folder of its files.
    pub name: String,
    pub files: Vec<(String, Vec<u8>)>,
    /// Options without which it cannot be read.
    pub arguments: Vec<String>,
    pub holds: Holds,
    /// Heights of its first and last slice.
    pub ends: [f64; 2],
}

impl Input {
    fn of_a_body(name: &str, files: Vec<(String, Vec<u8>)>, ends: [f64; 2]) -> Self {
        Input { name: name.into(), files, arguments: Vec::new(), holds: Holds::Body, ends }
    }
}

/// The stack in a container that can hold it, or something else on its heights.
pub fn input(n: &mut Numbers, stack: &ContourStack) -> Option<Input> {
    let heights: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
    match n.whole(0, 9) {
        0..=2 => Some(images(stack, &heights)),
        3 => Some(polygons(n, &heights)),
        4 => Some(contour_map(n, &heights)),
        5 => Some(grey_values(n, stack)),
        6 => labels(n, stack),
        _ => label(n, stack),
    }
}

fn ends(heights: &[f64]) -> [f64; 2] {
    [heights[0], heights[heights.len() - 1]]
}

/// A folder with stack.json and PNGs.
fn images(stack: &ContourStack, heights: &[f64]) -> Input {
    let [nx, ny] = stack.dims;
    let mut files = Vec::new();
    let mut slices = Vec::new();
    for (k, slice) in stack.slices.iter().enumerate() {
        let grey = |p: usize| match &slice.content {
            SliceContent::Mask(mask) => 255 * u8::from(mask.at(p)),
            SliceContent::Level(level) => 255 * u8::from(level.sides().at(p)),
        };
        let image = GrayImage::from_fn(nx as u32, ny as u32, |x, y| image::Luma([grey(y as usize * nx + x as usize)]));
        if let Some(png) = png(&image) {
            files.push((format!("stack/s{k:03}.png"), png));
        }
        slices.push(json!({"file": format!("s{k:03}.png"), "z": slice.z}));
    }
    let text = json!({"spacing_xy": stack.spacing, "unit": "mm", "slices": slices});
    files.push(("stack/stack.json".into(), text.to_string().into_bytes()));
    Input::of_a_body("stack", files, ends(heights))
}

/// A closed line around a centre, its first point once.
fn ring(n: &mut Numbers, [x, y]: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    let (lobes, depth, turn) = (n.whole(2, 5) as f64, n.between(0.0, 0.3), n.between(0.0, TAU));
    let corners = n.whole(8, 60);
    let at = |k: usize| TAU * k as f64 / corners as f64;
    let point = |k: usize| {
        let r = radius * (1.0 + depth * (lobes * at(k) + turn).sin());
        [x + r * at(k).cos(), y + r * at(k).sin()]
    };
    (0..corners).map(point).collect()
}

/// A folder of polygons in stack.json: a part or two a slice, perhaps with a hole.
fn polygons(n: &mut Numbers, heights: &[f64]) -> Input {
    let place = n.of(&[0.0, -300.0, 5e6]);
    let slices: Vec<_> = heights
        .iter()
        .map(|z| {
            let mut lines = Vec::new();
            for k in 0..n.whole(1, 2) {
                let centre = [place + 30.0 * k as f64 + n.between(-3.0, 3.0), n.between(-3.0, 3.0)];
                lines.push(ring(n, centre, 9.0));
                if n.chance(0.2) {
                    lines.push(ring(n, centre, 4.0));
                }
            }
            json!({"z": z, "polygons": lines})
        })
        .collect();
    let text = json!({"unit": "mm", "slices": slices});
    let files = vec![("stack/stack.json".to_string(), text.to_string().into_bytes())];
    Input { arguments: vec!["--pixel=1".into()], ..Input::of_a_body("stack", files, ends(heights)) }
}

/// A contour map of a hill, as GeoJSON: closed lines within each other, with elevations or as points with z.
fn contour_map(n: &mut Numbers, heights: &[f64]) -> Input {
    let named = n.chance(0.5);
    let (shape, count) = (ring(n, [0.0; 2], 1.0), heights.len() as f64);
    let features: Vec<_> = heights
        .iter()
        .enumerate()
        .map(|(k, z)| {
            let size = 24.0 * 0.5f64.powf(2.5 * k as f64 / count);
            let line = shape.iter().chain(&shape[..1]).map(|point| point.map(|v| size * v));
            let points: Vec<Vec<f64>> = line.map(|[x, y]| if named { vec![x, y] } else { vec![x, y, *z] }).collect();
            let properties = if named { json!({"elevation": z}) } else { json!({}) };
            json!({"type": "Feature", "properties": properties, "geometry": {"type": "LineString", "coordinates": points}})
        })
        .collect();
    let text = json!({"type": "FeatureCollection", "features": features});
    let files = vec![("map.geojson".to_string(), text.to_string().into_bytes())];
    // Metres: bare GeoJSON would be degrees.
    let arguments = vec!["--crs=local".into(), "--pixel=1".into()];
    Input { arguments, holds: Holds::Map, ..Input::of_a_body("map.geojson", files, ends(heights)) }
}

/// A volume of grey values, a ball that fades into its surroundings, cut at a level.
fn grey_values(n: &mut Numbers, stack: &ContourStack) -> Input {
    let [nx, ny] = stack.dims;
    let count = n.whole(3, 8);
    let middle = [nx as f64 / 2.0, ny as f64 / 2.0, count as f64 / 2.0];
    let radius = 0.3 * nx.min(ny) as f64;
    let value = |p: usize| {
        let [i, j, k] = [p % nx, p / nx % ny, p / (nx * ny)].map(|v| v as f64);
        let along = (k - middle[2]) * radius / count as f64;
        128.0 + 12.0 * (radius - (i - middle[0]).hypot(j - middle[1]).hypot(along))
    };
    let voxels: Vec<u8> = (0..nx * ny * count).map(|p| value(p).clamp(0.0, 255.0) as u8).collect();
    let dz = stack.spacing[0].max(stack.spacing[1]) * n.between(1.5, 5.0);
    let mut input = volume(n, [nx, ny, count], [stack.spacing[0], stack.spacing[1], dz], voxels);
    input.arguments.push(format!("--level={}", n.of(&["100", "128", "131.5"])));
    input
}

/// Where the slices of a stack lie in a volume, and its spacing.
fn laid(n: &mut Numbers, stack: &ContourStack) -> (usize, [usize; 3], [f64; 3]) {
    let [nx, ny] = stack.dims;
    let every = n.whole(1, 4);
    let count = every * (stack.slices.len() - 1) + 1 + n.whole(0, 3);
    let dz = (stack.slices[1].z - stack.slices[0].z) / every as f64;
    (every, [nx, ny, count], [stack.spacing[0], stack.spacing[1], dz])
}

/// The stack as one label of a volume, whose other layers are empty.
fn label(n: &mut Numbers, stack: &ContourStack) -> Option<Input> {
    if stack.slices.iter().any(|s| s.content.is_empty()) {
        return None;
    }
    let (every, dims, spacing) = laid(n, stack);
    let label = n.whole(1, 9) as u8;
    let mut voxels = vec![0u8; dims.iter().product()];
    for (k, slice) in stack.slices.iter().enumerate() {
        let sides = slice.content.sides();
        let first = k * every * dims[0] * dims[1];
        sides.iter().enumerate().filter(|(_, m)| **m).for_each(|(p, _)| voxels[first + p] = label);
    }
    Some(volume(n, dims, spacing, voxels))
}

/// The stack cut into up to four labels that touch, each of which is on two slices at least.
fn labels(n: &mut Numbers, stack: &ContourStack) -> Option<Input> {
    let (every, dims, spacing) = laid(n, stack);
    let cut = [0, 1].map(|a| n.whole(1, dims[a] - 1));
    let mut voxels = vec![0u8; dims.iter().product()];
    let mut slices = [0; 5];
    for (k, slice) in stack.slices.iter().enumerate() {
        let mut there = [false; 5];
        let first = k * every * dims[0] * dims[1];
        for (p, _) in slice.content.sides().iter().enumerate().filter(|(_, m)| **m) {
            let label = 1 + usize::from(p % dims[0] >= cut[0]) + 2 * usize::from(p / dims[0] >= cut[1]);
            voxels[first + p] = label as u8;
            there[label] = true;
        }
        slices.iter_mut().zip(there).for_each(|(count, there)| *count += usize::from(there));
    }
    if slices.iter().all(|count| *count < 2) {
        return None;
    }
    let mut input = if n.chance(0.2) { label_images(dims, spacing, &voxels) } else { volume(n, dims, spacing, voxels) };
    // Where a slice is empty, or labels are on slices of their own, another axis might be taken for that of the slices.
    input.arguments.extend(["--labels=all".into(), "--axis=z".into()]);
    input.holds = Holds::Labels;
    Some(input)
}

/// Bytes as a folder of PNGs, a slice each.
fn label_images([nx, ny, nz]: [usize; 3], [dx, dy, dz]: [f64; 3], voxels: &[u8]) -> Input {
    let mut files = Vec::new();
    for (k, slice) in voxels.chunks(nx * ny).enumerate() {
        let image = GrayImage::from_fn(nx as u32, ny as u32, |x, y| image::Luma([slice[y as usize * nx + x as usize]]));
        if let Some(png) = png(&image) {
            files.push((format!("stack/z{k}.png"), png));
        }
    }
    let input = Input::of_a_body("stack", files, [0.0, dz * (nz - 1) as f64]);
    Input { arguments: vec![format!("--spacing={dx},{dy},{dz}")], ..input }
}

fn png(image: &GrayImage) -> Option<Vec<u8>> {
    let mut png = Cursor::new(Vec::new());
    image.write_to(&mut png, image::ImageFormat::Png).ok()?;
    Some(png.into_inner())
}

/// Bytes as a volume of any format.
fn volume(n: &mut Numbers, dims: [usize; 3], spacing: [f64; 3], voxels: Vec<u8>) -> Input {
    let [nx, ny, nz] = dims;
    let [dx, dy, dz] = spacing;
    let mut arguments = Vec::new();
    let given = format!("--spacing={dx},{dy},{dz}");
    let (name, bytes) = match n.whole(0, 6) {
        0 => {
            let header = format!(
                "NRRD0004\ntype: uint8\ndimension: 3\nsizes: {nx} {ny} {nz}\nencoding: raw\nspacings: {dx} {dy} {dz}\n\n"
            );
            ("volume.nrrd", [header.into_bytes(), voxels].concat())
        }
        1 => {
            let header = format!(
                "NRRD0004\ntype: uint8\ndimension: 3\nsizes: {nx} {ny} {nz}\nencoding: gzip\nspacings: {dx} {dy} {dz}\n\n"
            );
            ("volume.nrrd", [header.into_bytes(), gzip(&voxels)].concat())
        }
        2 => {
            let header = format!(
                "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nDimSize = {nx} {ny} {nz}\n\
                 ElementSpacing = {dx} {dy} {dz}\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
            );
            ("volume.mha", [header.into_bytes(), voxels].concat())
        }
        3 => ("volume.nii", [nifti(dims, spacing), voxels].concat()),
        4 => ("volume.nii.gz", gzip(&[nifti(dims, spacing), voxels].concat())),
        5 => {
            arguments.push(given);
            ("volume.tif", tiff(dims, &voxels))
        }
        _ => {
            if n.chance(0.5) {
                arguments.push(given);
            }
            ("volume.npy", npy([nz, ny, nx], &voxels))
        }
    };
    let ends = [0.0, dz * (nz - 1) as f64];
    Input { arguments, ..Input::of_a_body(name, vec![(name.into(), bytes)], ends) }
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    // Memory takes whatever comes.
    packed.write_all(bytes).and_then(|()| packed.finish()).unwrap_or_default()
}

/// Header of a NIfTI-1 file of bytes, in millimetres, which lies as its sform says.
fn nifti([nx, ny, nz]: [usize; 3], [dx, dy, dz]: [f64; 3]) -> Vec<u8> {
    let mut header = vec![0u8; 352];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    for (k, count) in [3, nx, ny, nz, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * k, &(count as i16).to_le_bytes());
    }
    // Type and bits of a voxel.
    put(70, &2i16.to_le_bytes());
    put(72, &8i16.to_le_bytes());
    for (k, side) in [1.0, dx, dy, dz].into_iter().enumerate() {
        put(76 + 4 * k, &(side as f32).to_le_bytes());
    }
    put(108, &352f32.to_le_bytes());
    put(123, &[2]);
    put(254, &1i16.to_le_bytes());
    for (row, side) in [dx, dy, dz].into_iter().enumerate() {
        put(280 + 16 * row + 4 * row, &(side as f32).to_le_bytes());
    }
    put(344, b"n+1\0");
    header
}

/// A TIFF with a page of one strip per layer.
fn tiff([nx, ny, nz]: [usize; 3], voxels: &[u8]) -> Vec<u8> {
    const TAGS: usize = 9;
    let page = 2 + 12 * TAGS + 4;
    let mut bytes = [&b"II\x2a\x00"[..], &8u32.to_le_bytes()].concat();
    for k in 0..nz {
        let data = 8 + nz * page + k * nx * ny;
        let next = if k + 1 < nz { 8 + (k + 1) * page } else { 0 };
        bytes.extend((TAGS as u16).to_le_bytes());
        // Width, height, bits, packing (none), black is 0, the strip's place, samples, rows and bytes of the strip.
        let tags =
            [(256, nx), (257, ny), (258, 8), (259, 1), (262, 1), (273, data), (277, 1), (278, ny), (279, nx * ny)];
        for (tag, value) in tags {
            bytes.extend((tag as u16).to_le_bytes());
            bytes.extend(4u16.to_le_bytes());
            bytes.extend(1u32.to_le_bytes());
            bytes.extend((value as u32).to_le_bytes());
        }
        bytes.extend((next as u32).to_le_bytes());
    }
    bytes.extend(voxels);
    bytes
}

/// A NumPy array of bytes, last axis fastest.
fn npy([nz, ny, nx]: [usize; 3], data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({nz}, {ny}, {nx}), }}");
    // Magic, version and length take ten bytes; the header ends on a multiple of 64.
    header += &" ".repeat((64 - (10 + header.len() + 1) % 64) % 64);
    header.push('\n');
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
}
