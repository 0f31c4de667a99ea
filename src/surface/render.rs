//! A shaded picture of the surface, so that a person sees the result without another program: z-buffered triangles in an orthographic
//! three-quarter view from above, smooth normals, a key light, sky light and a little rim light.

use std::io::{self, Seek, Write};

use image::{ImageFormat, Rgb, RgbImage};

use super::Layer;
use super::header::Header;
use super::mesh::MeshSource;
use super::space::{cross, dot, length, sub, to_world};
use super::stream::{BodyWriter, Ending, WriterNeeds};
use crate::contour::seeds::trace_loops;
use crate::grid::field::Field;
use crate::stack::Geometry;

/// Samples per pixel side.
const SUPERSAMPLING: u32 = 2;
/// Direction of view: turned about the vertical, then down.
const YAW: f64 = 0.62;
const PITCH: f64 = 0.56;
/// Share of the picture's shorter free side that stays empty around the body.
const BORDER: f64 = 0.06;
/// A body flatter than this share of its width is drawn stretched to it in height, or a terrain would be a sheet.
pub(super) const FLATTEST: f64 = 0.15;
const BODY: [f64; 3] = [0.86, 0.80, 0.70];
const CONTOUR: [f64; 3] = [0.62, 0.10, 0.08];

/// Options of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RenderOptions {
    /// Width of the picture, px.
    pub width: u32,
    /// Height of the picture, px.
    pub height: u32,
    /// Draw the input contours on the surface.
    pub contours: bool,
}

impl Default for RenderOptions {
    fn default() -> Self {
        RenderOptions { width: 1200, height: 900, contours: false }
    }
}

/// Writes the picture as a PNG, at the end: until then it keeps the input contours as lines, where they are to be drawn.
pub struct PictureWriter<W> {
    out: W,
    header: Header,
    options: RenderOptions,
    lines: Vec<Polyline>,
}

/// A closed contour in world coordinates; the first point is the last too.
pub type Polyline = Vec<[f64; 3]>;

impl<W> PictureWriter<W> {
    /// A writer without layers yet.
    pub fn new(out: W, header: &Header, options: RenderOptions) -> Self {
        PictureWriter { out, header: header.clone(), options, lines: Vec::new() }
    }
}

impl<W: Write + Seek + Send> BodyWriter for PictureWriter<W> {
    fn needs(&self) -> WriterNeeds {
        WriterNeeds::Mesh
    }

    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        if self.options.contours && layer.contour.is_some() {
            self.lines.extend(contour_lines(&self.header, layer));
        }
        Ok(())
    }

    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()> {
        let picture = render(&self.header.geometry, end.mesh, &self.lines, self.options)?;
        picture.write_to(&mut self.out, ImageFormat::Png).map_err(io::Error::other)?;
        self.out.flush()
    }
}

/// The picture itself. Heights are to scale unless the body is flatter than 15 % of its width; then they are stretched to that.
///
/// # Errors
/// The errors of reading the mesh.
pub fn render(
    geometry: &Geometry,
    mesh: &mut dyn MeshSource,
    lines: &[Polyline],
    options: RenderOptions,
) -> io::Result<RgbImage> {
    let size = [options.width.max(1) * SUPERSAMPLING, options.height.max(1) * SUPERSAMPLING];
    let mut canvas = Canvas::new(size);
    if let Some(camera) = Camera::fit(geometry, mesh, size)? {
        mesh.triangles(&mut |_, corners| {
            canvas.triangle(corners.map(|v| camera.project(v.position)), corners.map(|v| camera.turn_normal(v.normal)));
            Ok(())
        })?;
        for line in lines {
            let points: Vec<[f64; 3]> = line.iter().map(|p| camera.project(*p)).collect();
            points.windows(2).for_each(|p| canvas.line(p[0], p[1]));
        }
    }
    Ok(canvas.finish())
}

/// The contours of a layer.
pub fn contour_lines(header: &Header, layer: &Layer) -> Vec<Polyline> {
    // One ring of outside, so that contours at the border close.
    let [nx, ny] = header.dims;
    let [dx, dy] = header.spacing;
    let phi = Field::from_fn([nx + 2, ny + 2], |i, j| match (i.checked_sub(1), j.checked_sub(1)) {
        (Some(i), Some(j)) if i < nx && j < ny => f64::from(layer.phi[j * nx + i]),
        _ => 0.5 * dx.min(dy),
    });
    let point = |x: [f64; 2]| to_world(&header.geometry, [(x[0] - 1.0) * dx, (x[1] - 1.0) * dy, layer.z]);
    trace_loops(&phi).iter().map(|path| path.iter().chain(path.first()).map(|c| point(c.x)).collect()).collect()
}

/// Maps world coordinates to the picture: x right, y down, depth away from the viewer, all in samples.
struct Camera {
    axes: [[f64; 3]; 3],
    stretch: f64,
    up: [f64; 3],
    center: [f64; 3],
    scale: f64,
    middle: [f64; 2],
}

impl Camera {
    fn fit(g: &Geometry, mesh: &mut dyn MeshSource, size: [u32; 2]) -> io::Result<Option<Self>> {
        let (sin_yaw, cos_yaw, sin_pitch, cos_pitch) = (YAW.sin(), YAW.cos(), PITCH.sin(), PITCH.cos());
        // Right, down and away in the stack's own frame (its x to the right, its y to the back); then by its axes into the world.
        let frame = [
            [cos_yaw, sin_yaw, 0.0],
            [sin_yaw * sin_pitch, -cos_yaw * sin_pitch, -cos_pitch],
            [-sin_yaw * cos_pitch, cos_yaw * cos_pitch, -sin_pitch],
        ];
        let axes =
            frame.map(|v| std::array::from_fn(|a| v[0] * g.axes[0][a] + v[1] * g.axes[1][a] + v[2] * g.axes[2][a]));
        let up = g.axes[2];
        let mut ranges = [(f64::INFINITY, f64::NEG_INFINITY); 3];
        mesh.vertices(&mut |vertex| {
            for ((a, b), axis) in ranges.iter_mut().zip(g.axes) {
                let v = dot(vertex.position, axis);
                (*a, *b) = (a.min(v), b.max(v));
            }
            Ok(())
        })?;
        let [wide, deep, high] = ranges.map(|(a, b)| b - a);
        if !(wide.is_finite() && high > 0.0) {
            return Ok(None);
        }
        let stretch = (FLATTEST * wide.max(deep) / high).max(1.0);
        let center =
            std::array::from_fn(|a| (0..3).map(|k| 0.5 * (ranges[k].0 + ranges[k].1) * g.axes[k][a]).sum::<f64>());
        let mut camera = Camera { axes, stretch, up, center, scale: 1.0, middle: [0.0; 2] };
        let (mut low, mut top) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        mesh.vertices(&mut |vertex| {
            let q = camera.project(vertex.position);
            (0..2).for_each(|a| (low[a], top[a]) = (low[a].min(q[a]), top[a].max(q[a])));
            Ok(())
        })?;
        let free = |a: usize| f64::from(size[a]) * (1.0 - 2.0 * BORDER) / (top[a] - low[a]).max(1e-12);
        camera.scale = free(0).min(free(1));
        camera.middle = std::array::from_fn(|a| 0.5 * f64::from(size[a]) - 0.5 * (low[a] + top[a]) * camera.scale);
        Ok(Some(camera))
    }

    fn project(&self, p: [f64; 3]) -> [f64; 3] {
        let mut d = sub(p, self.center);
        let rise = dot(d, self.up) * (self.stretch - 1.0);
        (0..3).for_each(|a| d[a] += rise * self.up[a]);
        let [x, y, depth] = self.axes.map(|axis| dot(d, axis) * self.scale);
        [x + self.middle[0], y + self.middle[1], depth]
    }

    /// A normal in the picture's frame, for a body stretched in height.
    fn turn_normal(&self, n: [f64; 3]) -> [f64; 3] {
        let fall = dot(n, self.up) * (1.0 / self.stretch - 1.0);
        let n = std::array::from_fn(|a| n[a] + fall * self.up[a]);
        let l = length(n).max(1e-12);
        self.axes.map(|axis| dot(n, axis) / l)
    }
}

struct Canvas {
    size: [usize; 2],
    depth: Vec<f64>,
    color: Vec<[f64; 3]>,
}

impl Canvas {
    fn new(size: [u32; 2]) -> Self {
        let size = size.map(|s| s as usize);
        let n = size[0] * size[1];
        let backdrop = |k: usize| {
            let fall = (k / size[0]) as f64 / size[1] as f64;
            [0.98 - 0.12 * fall, 0.98 - 0.11 * fall, 0.99 - 0.09 * fall]
        };
        Canvas { size, depth: vec![f64::INFINITY; n], color: (0..n).map(backdrop).collect() }
    }

    fn triangle(&mut self, p: [[f64; 3]; 3], n: [[f64; 3]; 3]) {
        let flat = p.map(|p| [p[0], p[1], 0.0]);
        let area = cross(sub(flat[1], flat[0]), sub(flat[2], flat[0]))[2];
        if area.abs() < 1e-12 {
            return;
        }
        let range = |a: usize| {
            let low = p[0][a].min(p[1][a]).min(p[2][a]).ceil().max(0.0) as usize;
            let high = p[0][a].max(p[1][a]).max(p[2][a]).floor().min(self.size[a] as f64 - 1.0);
            low..if high < 0.0 { 0 } else { high as usize + 1 }
        };
        for y in range(1) {
            for x in range(0) {
                let at = [x as f64, y as f64, 0.0];
                let w: [f64; 3] =
                    std::array::from_fn(|k| cross(sub(flat[(k + 1) % 3], at), sub(flat[(k + 2) % 3], at))[2] / area);
                if w.iter().any(|w| *w < -1e-9) {
                    continue;
                }
                let mix = |v: [[f64; 3]; 3], a: usize| w[0] * v[0][a] + w[1] * v[1][a] + w[2] * v[2][a];
                let depth = mix(p, 2);
                let node = y * self.size[0] + x;
                if depth < self.depth[node] {
                    self.depth[node] = depth;
                    self.color[node] = shade([mix(n, 0), mix(n, 1), mix(n, 2)]);
                }
            }
        }
    }

    /// A line two samples and a bit wide, in front of what is at most a few samples nearer.
    fn line(&mut self, a: [f64; 3], b: [f64; 3]) {
        let steps = (b[0] - a[0]).hypot(b[1] - a[1]).ceil().max(1.0);
        for s in 0..=steps as usize {
            let t = s as f64 / steps;
            let p: [f64; 3] = std::array::from_fn(|k| a[k] + t * (b[k] - a[k]));
            for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let (x, y) = (p[0] + dx, p[1] + dy);
                if x < 0.0 || y < 0.0 || x >= self.size[0] as f64 || y >= self.size[1] as f64 {
                    continue;
                }
                let node = y as usize * self.size[0] + x as usize;
                if p[2] - 4.0 < self.depth[node] {
                    self.color[node] = CONTOUR;
                }
            }
        }
    }

    fn finish(self) -> RgbImage {
        let s = SUPERSAMPLING as usize;
        let (width, height) = (self.size[0] / s, self.size[1] / s);
        RgbImage::from_fn(width as u32, height as u32, |x, y| {
            let mut sum = [0.0; 3];
            for dy in 0..s {
                for dx in 0..s {
                    let c = self.color[(y as usize * s + dy) * self.size[0] + x as usize * s + dx];
                    (0..3).for_each(|a| sum[a] += c[a]);
                }
            }
            Rgb(sum.map(|v| (255.0 * (v / (s * s) as f64).clamp(0.0, 1.0)).round() as u8))
        })
    }
}

/// Colour of the body where its normal (picture's frame: right, down, away) is `n`.
fn shade(n: [f64; 3]) -> [f64; 3] {
    let l = length(n).max(1e-12);
    let mut n = n.map(|v| v / l);
    if n[2] > 0.0 {
        n = n.map(|v| -v); // a back face seen through a grazing silhouette
    }
    let unit = |v: [f64; 3]| {
        let l = length(v);
        v.map(|c| c / l)
    };
    let key = dot(n, unit([-0.55, -0.65, -0.75])).max(0.0);
    let half = dot(n, unit([-0.30, -0.35, -0.95])).max(0.0).powi(40);
    let sky = 0.5 - 0.5 * n[1];
    let rim = (1.0 + n[2]).max(0.0).powi(3);
    let light = 0.27 + 0.60 * key + 0.24 * sky;
    std::array::from_fn(|a| BODY[a] * light + 0.12 * half + 0.05 * rim * [0.6, 0.7, 1.0][a])
}
