//! Terrain: the height at which each pixel leaves the body.

use std::io::{self, Seek, Write};

use super::Reconstruction;

/// Arrival height per pixel, unit of the stack, row-major: the highest z at which the pixel is inside, by the linear zero between
/// layers; the upper end of the body where it is still inside there, NaN where it is never inside.
pub fn arrival_heights(body: &Reconstruction) -> Vec<f32> {
    let mut out = vec![f32::NAN; body.dims[0] * body.dims[1]];
    let within: Vec<_> = body.layers.iter().filter(|l| l.z >= body.extent[0] && l.z <= body.extent[1]).collect();
    for (k, layer) in within.iter().enumerate() {
        let above = within.get(k + 1);
        for (n, h) in out.iter_mut().enumerate() {
            let a = f64::from(layer.phi[n]);
            if a >= 0.0 {
                continue;
            }
            *h = match above {
                None => layer.z as f32,
                Some(next) => {
                    let b = f64::from(next.phi[n]);
                    if b < 0.0 { continue } else { (layer.z + (next.z - layer.z) * a / (a - b)) as f32 }
                }
            };
        }
    }
    out
}

/// Writes the height map as a 32-bit float grey TIFF.
///
/// # Errors
/// Those of `out`, as the TIFF encoder tells them.
pub fn write_tiff(out: impl Write + Seek, body: &Reconstruction) -> io::Result<()> {
    // The encoder of `image` has no single-channel float; `tiff` beneath it does.
    let mut encoder = tiff::encoder::TiffEncoder::new(out).map_err(io::Error::other)?;
    encoder
        .write_image::<tiff::encoder::colortype::Gray32Float>(
            body.dims[0] as u32,
            body.dims[1] as u32,
            &arrival_heights(body),
        )
        .map_err(io::Error::other)
}
