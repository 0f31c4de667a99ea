//! A shaded picture of the surface, so that a person sees the result without another program: z-buffered triangles in an orthographic
//! three-quarter view from above, smooth normals, a key light, sky light and a little rim light.

use std::io::{self, Seek, Write};

use glam::{DMat3, DVec2, DVec3};
use image::{ImageFormat, Rgb, RgbImage};

use super::Layer;
use super::header::Header;
use super::mesh::MeshSource;
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
const BODY: DVec3 = DVec3::new(0.86, 0.80, 0.70);
const RIM: DVec3 = DVec3::new(0.6, 0.7, 1.0);
const CONTOUR: DVec3 = DVec3::new(0.62, 0.10, 0.08);

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
pub type Polyline = Vec<DVec3>;

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

    fn shows_surface(&self) -> bool {
        true
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
            let points: Vec<DVec3> = line.iter().map(|p| camera.project(*p)).collect();
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
        (Some(i), Some(j)) if i < nx && j < ny => f64::from(layer.phi.at(i, j)),
        _ => 0.5 * dx.min(dy),
    });
    let point = |DVec2 { x, y }: DVec2| header.geometry.to_world(DVec3::new((x - 1.0) * dx, (y - 1.0) * dy, layer.z));
    trace_loops(&phi).iter().map(|path| path.iter().chain(path.first()).map(|c| point(c.x)).collect()).collect()
}

/// Maps world coordinates to the picture: x right, y down, depth away from the viewer, all in samples.
struct Camera {
    /// Position in the world as right, down and away.
    turn: DMat3,
    stretch: f64,
    up: DVec3,
    center: DVec3,
    scale: f64,
    middle: DVec2,
}

impl Camera {
    fn fit(g: &Geometry, mesh: &mut dyn MeshSource, size: [u32; 2]) -> io::Result<Option<Self>> {
        let (sin_yaw, cos_yaw, sin_pitch, cos_pitch) = (YAW.sin(), YAW.cos(), PITCH.sin(), PITCH.cos());
        // Right, down and away in the stack's own frame (its x to the right, its y to the back); then by its axes into the world.
        let [right, down, away] = [
            DVec3::new(cos_yaw, sin_yaw, 0.0),
            DVec3::new(sin_yaw * sin_pitch, -cos_yaw * sin_pitch, -cos_pitch),
            DVec3::new(-sin_yaw * cos_pitch, cos_yaw * cos_pitch, -sin_pitch),
        ]
        .map(|v| g.turn() * v);
        let (turn, up) = (DMat3::from_cols(right, down, away).transpose(), g.axes[2]);
        let along = g.turn().transpose();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        mesh.vertices(&mut |vertex| {
            let v = along * vertex.position;
            (low, high) = (low.min(v), high.max(v));
            Ok(())
        })?;
        let size_along = high - low;
        if !(size_along.x.is_finite() && size_along.z > 0.0) {
            return Ok(None);
        }
        let stretch = (FLATTEST * size_along.x.max(size_along.y) / size_along.z).max(1.0);
        let center = g.turn() * (0.5 * (low + high));
        let mut camera = Camera { turn, stretch, up, center, scale: 1.0, middle: DVec2::ZERO };
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        mesh.vertices(&mut |vertex| {
            let q = camera.project(vertex.position).truncate();
            (low, high) = (low.min(q), high.max(q));
            Ok(())
        })?;
        let size = DVec2::from(size.map(f64::from));
        camera.scale = (size * (1.0 - 2.0 * BORDER) / (high - low).max(DVec2::splat(1e-12))).min_element();
        camera.middle = 0.5 * size - 0.5 * (low + high) * camera.scale;
        Ok(Some(camera))
    }

    fn project(&self, p: DVec3) -> DVec3 {
        let d = p - self.center;
        let rise = d.dot(self.up) * (self.stretch - 1.0);
        self.turn * (d + rise * self.up) * self.scale + self.middle.extend(0.0)
    }

    /// A normal in the picture's frame, for a body stretched in height.
    fn turn_normal(&self, n: DVec3) -> DVec3 {
        let fall = n.dot(self.up) * (1.0 / self.stretch - 1.0);
        let n = n + fall * self.up;
        self.turn * n / n.length().max(1e-12)
    }
}

struct Canvas {
    size: [usize; 2],
    depth: Vec<f64>,
    color: Vec<DVec3>,
}

impl Canvas {
    fn new(size: [u32; 2]) -> Self {
        let size = size.map(|s| s as usize);
        let n = size[0] * size[1];
        let backdrop = |k: usize| {
            let fall = (k / size[0]) as f64 / size[1] as f64;
            DVec3::new(0.98 - 0.12 * fall, 0.98 - 0.11 * fall, 0.99 - 0.09 * fall)
        };
        Canvas { size, depth: vec![f64::INFINITY; n], color: (0..n).map(backdrop).collect() }
    }

    fn triangle(&mut self, p: [DVec3; 3], n: [DVec3; 3]) {
        let [a, b, c] = p.map(DVec3::truncate);
        let area = (b - a).perp_dot(c - a);
        if area.abs() < 1e-12 {
            return;
        }
        let last = DVec2::from(self.size.map(|n| n as f64 - 1.0));
        let low = a.min(b).min(c).ceil().max(DVec2::ZERO).as_usizevec2();
        let high = a.max(b).max(c).floor().min(last);
        if high.cmplt(DVec2::ZERO).any() {
            return;
        }
        let high = high.as_usizevec2();
        let (depths, normals) = (DVec3::new(p[0].z, p[1].z, p[2].z), DMat3::from_cols(n[0], n[1], n[2]));
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let at = DVec2::new(x as f64, y as f64);
                let (a, b, c) = (a - at, b - at, c - at);
                let w = DVec3::new(b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)) / area;
                if w.min_element() < -1e-9 {
                    continue;
                }
                let depth = w.dot(depths);
                let node = y * self.size[0] + x;
                if depth < self.depth[node] {
                    self.depth[node] = depth;
                    self.color[node] = shade(normals * w);
                }
            }
        }
    }

    /// A line two samples and a bit wide, in front of what is at most a few samples nearer.
    fn line(&mut self, a: DVec3, b: DVec3) {
        let steps = (b.x - a.x).hypot(b.y - a.y).ceil().max(1.0);
        for s in 0..=steps as usize {
            let t = s as f64 / steps;
            let p = a + t * (b - a);
            for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let (x, y) = (p.x + dx, p.y + dy);
                if x < 0.0 || y < 0.0 || x >= self.size[0] as f64 || y >= self.size[1] as f64 {
                    continue;
                }
                let node = y as usize * self.size[0] + x as usize;
                if p.z - 4.0 < self.depth[node] {
                    self.color[node] = CONTOUR;
                }
            }
        }
    }

    fn finish(self) -> RgbImage {
        let s = SUPERSAMPLING as usize;
        let (width, height) = (self.size[0] / s, self.size[1] / s);
        RgbImage::from_fn(width as u32, height as u32, |x, y| {
            let mut sum = DVec3::ZERO;
            for dy in 0..s {
                for dx in 0..s {
                    sum += self.color[(y as usize * s + dy) * self.size[0] + x as usize * s + dx];
                }
            }
            let mean = (sum / (s * s) as f64).clamp(DVec3::ZERO, DVec3::ONE);
            Rgb((255.0 * mean).round().as_u8vec3().to_array())
        })
    }
}

/// Colour of the body where its normal (picture's frame: right, down, away) is `n`.
fn shade(n: DVec3) -> DVec3 {
    let mut n = n / n.length().max(1e-12);
    if n.z > 0.0 {
        n = -n; // a back face seen through a grazing silhouette
    }
    // Divided by their lengths: `normalize` would change the last bits.
    let unit = |v: DVec3| v / v.length();
    let key = n.dot(unit(DVec3::new(-0.55, -0.65, -0.75))).max(0.0);
    let half = n.dot(unit(DVec3::new(-0.30, -0.35, -0.95))).max(0.0).powi(40);
    let sky = 0.5 - 0.5 * n.y;
    let rim = (1.0 + n.z).max(0.0).powi(3);
    let light = 0.27 + 0.60 * key + 0.24 * sky;
    BODY * light + 0.12 * half + 0.05 * rim * RIM
}
