//! Z-buffered rasterization of triangle meshes.
//!
//! A pixel belongs to a triangle if its centre does; on an edge the top-left rule decides, so that a pixel of a shared
//! edge is drawn exactly once. An edge's crossing with a row is always computed from its upper end to its lower, hence
//! the same number for both triangles that share it.

use nalgebra::{Vector2, Vector3};

use crate::camera::Camera;
use crate::rounding::{ceil, floor};

/// Faces are cut at this depth: what is nearer is not drawn.
pub const NEAR_M: f64 = 0.1;

/// Rectangles reach no further than this, so that their sums stay whole numbers.
const FARTHEST_PX: f64 = 1e12;

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Rect {
    /// Column of its first pixel.
    pub x0: i64,
    /// Row of its first pixel.
    pub y0: i64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Rect {
    /// The whole image of a camera.
    #[must_use]
    pub fn image(camera: &Camera) -> Self {
        Self { x0: 0, y0: 0, width: camera.width, height: camera.height }
    }

    /// How many pixels it holds.
    #[must_use]
    pub fn area(&self) -> usize {
        self.width * self.height
    }

    /// Flat index of a pixel, if it lies inside.
    #[must_use]
    pub fn index(&self, x: i64, y: i64) -> Option<usize> {
        // a negative difference is a great one without its sign
        let (u, v) = (x.wrapping_sub(self.x0) as u64, y.wrapping_sub(self.y0) as u64);
        (u < self.width as u64 && v < self.height as u64).then(|| v as usize * self.width + u as usize)
    }

    /// The part that both share.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        let (x0, y0) = (self.x0.max(other.x0), self.y0.max(other.y0));
        let x1 = (self.x0 + self.width as i64).min(other.x0 + other.width as i64);
        let y1 = (self.y0 + self.height as i64).min(other.y0 + other.height as i64);
        Self { x0, y0, width: (x1 - x0).max(0) as usize, height: (y1 - y0).max(0) as usize }
    }

    /// The smallest rectangle that holds both; one without pixels adds nothing.
    #[must_use]
    pub fn joined(&self, other: &Self) -> Self {
        if self.area() == 0 || other.area() == 0 {
            return if self.area() == 0 { *other } else { *self };
        }
        let (x0, y0) = (self.x0.min(other.x0), self.y0.min(other.y0));
        let x1 = (self.x0 + self.width as i64).max(other.x0 + other.width as i64);
        let y1 = (self.y0 + self.height as i64).max(other.y0 + other.height as i64);
        Self { x0, y0, width: (x1 - x0) as usize, height: (y1 - y0) as usize }
    }

    /// The rectangle with a margin on all sides.
    #[must_use]
    pub fn grown(&self, margin: u32) -> Self {
        let (x0, y0) = (self.x0 - i64::from(margin), self.y0 - i64::from(margin));
        Self { x0, y0, width: self.width + 2 * margin as usize, height: self.height + 2 * margin as usize }
    }

    /// The part of the image that a mesh may cover: all of it where the near plane cuts the mesh.
    #[must_use]
    pub fn of_mesh(camera: &Camera, points_in_camera: &[Vector3<f64>]) -> Self {
        let image = Self::image(camera);
        if points_in_camera.iter().any(|p| p.z < NEAR_M) {
            return image;
        }
        Self::around(points_in_camera.iter().map(|p| camera.project(p))).intersection(&image)
    }

    /// The smallest rectangle around all pixel centres from left to right and from top to bottom.
    #[must_use]
    pub(crate) fn spanned(&[left, right, top, bottom]: &[f64; 4]) -> Self {
        if !(left <= right && top <= bottom) {
            return Self::default();
        }
        let (x0, y0) = (floor(left), floor(top));
        Self { x0, y0, width: (ceil(right) - x0 + 1) as usize, height: (ceil(bottom) - y0 + 1) as usize }
    }

    /// The smallest rectangle around all pixel centres that the points span.
    #[must_use]
    pub fn around(points: impl Iterator<Item = Vector2<f64>>) -> Self {
        let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        for p in points {
            low = low.inf(&p);
            high = high.sup(&p);
        }
        if !(low.x <= high.x && low.y <= high.y) {
            return Self { x0: 0, y0: 0, width: 0, height: 0 };
        }
        let whole = |x: f64| x.clamp(-FARTHEST_PX, FARTHEST_PX) as i64;
        let (x0, y0) = (whole(low.x.floor()), whole(low.y.floor()));
        Self {
            x0,
            y0,
            width: (whole(high.x.ceil()) - x0 + 1) as usize,
            height: (whole(high.y.ceil()) - y0 + 1) as usize,
        }
    }
}

/// A triangle's corners on the image with their inverse depths.
type Corners = [(Vector2<f64>, f64); 3];

/// Visit the triangles of a mesh as they project, cut at [`NEAR_M`]; the visitor gets the face's index.
pub fn for_each_triangle(
    camera: &Camera,
    points_in_camera: &[Vector3<f64>],
    faces: &[[u32; 3]],
    mut visit: impl FnMut(usize, &Corners),
) {
    let on_image: Vec<(Vector2<f64>, f64)> = points_in_camera
        .iter()
        .map(|p| if p.z >= NEAR_M { (camera.project(p), 1.0 / p.z) } else { (Vector2::zeros(), 0.0) })
        .collect();
    for (index, face) in faces.iter().enumerate() {
        let [a, b, c] = face.map(|i| i as usize);
        let corners = [on_image[a], on_image[b], on_image[c]];
        if corners.iter().all(|(_, w)| *w > 0.0) {
            visit(index, &corners);
        } else if corners.iter().any(|(_, w)| *w > 0.0) {
            clip_near(camera, points_in_camera, face, |part| visit(index, part));
        }
    }
}

/// Where the edge between two vertices meets the near plane; computed from the lower index up, the same for both faces.
#[must_use]
pub fn near_crossing(points_in_camera: &[Vector3<f64>], a: u32, b: u32) -> Vector3<f64> {
    let (p, q) = (points_in_camera[a.min(b) as usize], points_in_camera[a.max(b) as usize]);
    let mut x = p + (q - p) * ((NEAR_M - p.z) / (q.z - p.z));
    x.z = NEAR_M;
    x
}

fn clip_near(camera: &Camera, points: &[Vector3<f64>], face: &[u32; 3], mut visit: impl FnMut(&Corners)) {
    let mut polygon: Vec<(Vector2<f64>, f64)> = Vec::with_capacity(4);
    for k in 0..3 {
        let (a, b) = (face[k], face[(k + 1) % 3]);
        let (near_a, near_b) = (points[a as usize].z < NEAR_M, points[b as usize].z < NEAR_M);
        if !near_a {
            polygon.push((camera.project(&points[a as usize]), 1.0 / points[a as usize].z));
        }
        if near_a != near_b {
            polygon.push((camera.project(&near_crossing(points, a, b)), 1.0 / NEAR_M));
        }
    }
    for k in 1..polygon.len().saturating_sub(1) {
        visit(&[polygon[0], polygon[k], polygon[k + 1]]);
    }
}

/// Visit a triangle's rows within `rect`: the row, and its pixels `start..end`, both relative to `rect`.
#[inline]
pub fn for_each_span(corners: &Corners, rect: &Rect, mut visit: impl FnMut(usize, usize, usize)) {
    let mut p = corners.map(|(xy, _)| xy);
    let below = |a: &Vector2<f64>, b: &Vector2<f64>| a.y > b.y || (a.y == b.y && a.x > b.x);
    if below(&p[0], &p[1]) {
        p.swap(0, 1);
    }
    if below(&p[1], &p[2]) {
        p.swap(1, 2);
    }
    if below(&p[0], &p[1]) {
        p.swap(0, 1);
    }
    let [top, middle, bottom] = p;
    let (first, last) = (rect.y0, rect.y0 + rect.height as i64);
    let clamp = |y: f64| (y.ceil() as i64).clamp(first, last);
    let long = (bottom.x - top.x) / (bottom.y - top.y);
    for (a, b) in [(top, middle), (middle, bottom)] {
        let short = (b.x - a.x) / (b.y - a.y);
        for row in clamp(a.y)..clamp(b.y) {
            let y = row as f64;
            let (u, v) = (top.x + (y - top.y) * long, a.x + (y - a.y) * short);
            let limit = |x: f64| (x.ceil() as i64).saturating_sub(rect.x0).clamp(0, rect.width as i64) as usize;
            let (start, end) = (limit(u.min(v)), limit(u.max(v)));
            if start < end {
                visit((row - first) as usize, start, end);
            }
        }
    }
}

/// Set the pixels of `mask` (row-major over `rect`) that the mesh covers.
pub fn fill_mask(camera: &Camera, points_in_camera: &[Vector3<f64>], faces: &[[u32; 3]], rect: &Rect, mask: &mut [u8]) {
    for_each_triangle(camera, points_in_camera, faces, |_, corners| {
        for_each_span(corners, rect, |row, start, end| mask[row * rect.width + start..row * rect.width + end].fill(1));
    });
}

/// How much of each pixel of `rect` the mesh covers, 0 to 1: the share of `samples` × `samples` points spread over it evenly.
#[must_use]
pub fn coverage(
    camera: &Camera,
    points_in_camera: &[Vector3<f64>],
    faces: &[[u32; 3]],
    rect: &Rect,
    samples: usize,
) -> Vec<f64> {
    let n = samples.max(1);
    let scale = n as f64;
    // its pixels are the samples: pixel x holds n x .. n x + n − 1, the centre of all at n x + (n − 1)/2
    let centre = |c: f64| (c + 0.5) * scale - 0.5;
    let fine = Camera {
        fx: camera.fx * scale,
        fy: camera.fy * scale,
        cx: centre(camera.cx),
        cy: centre(camera.cy),
        skew: camera.skew * scale,
        ..*camera
    };
    // one strip of pixels after another, so that the samples stay in the cache
    let mut out = vec![0.0; rect.area()];
    let height = STRIP_ROWS.min(rect.height);
    let mut mask = vec![0u8; height * rect.width * n * n];
    for first in (0..rect.height).step_by(STRIP_ROWS) {
        let rows = height.min(rect.height - first);
        let strip = Rect {
            x0: rect.x0 * n as i64,
            y0: (rect.y0 + first as i64) * n as i64,
            width: rect.width * n,
            height: rows * n,
        };
        let mask = &mut mask[..strip.area()];
        mask.fill(0);
        fill_mask(&fine, points_in_camera, faces, &strip, mask);
        for (i, &m) in mask.iter().enumerate() {
            out[(first + i / (strip.width * n)) * rect.width + i % strip.width / n] += f64::from(m);
        }
    }
    out.iter_mut().for_each(|c| *c /= scale * scale);
    out
}

/// Rows of pixels that [`coverage`] draws at once.
const STRIP_ROWS: usize = 32;

/// What is nearest in each pixel of a rectangle.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// The pixels drawn.
    pub rect: Rect,
    /// Nearest face, −1 where there is none.
    pub face: Vec<i32>,
    /// Number of the object that holds the face, −1 where there is none.
    pub object: Vec<i32>,
    /// Inverse depth of the nearest face, 1/m; 0 where there is none.
    pub inverse_depth: Vec<f64>,
}

impl Raster {
    /// An empty picture.
    #[must_use]
    pub fn new(rect: Rect) -> Self {
        let n = rect.area();
        Self { rect, face: vec![-1; n], object: vec![-1; n], inverse_depth: vec![0.0; n] }
    }

    /// Draw a mesh into it; of two faces at the same depth the one drawn first stays.
    pub fn draw(&mut self, camera: &Camera, points_in_camera: &[Vector3<f64>], faces: &[[u32; 3]], object: i32) {
        let rect = self.rect;
        for_each_triangle(camera, points_in_camera, faces, |face, corners| {
            let Some((slope, origin)) = inverse_depth_plane(corners) else { return };
            for_each_span(corners, &rect, |row, start, end| {
                let y = (row as i64 + rect.y0) as f64;
                for column in start..end {
                    let x = (column as i64 + rect.x0) as f64;
                    let inverse_depth = origin + slope.x * x + slope.y * y;
                    let at = row * rect.width + column;
                    if inverse_depth > self.inverse_depth[at] {
                        self.inverse_depth[at] = inverse_depth;
                        self.face[at] = face as i32;
                        self.object[at] = object;
                    }
                }
            });
        });
    }
}

/// Inverse depth is affine on the image: (slope, value at pixel (0, 0)); none for a triangle without area.
fn inverse_depth_plane(corners: &Corners) -> Option<(Vector2<f64>, f64)> {
    let [(a, wa), (b, wb), (c, wc)] = *corners;
    let (u, v) = (b - a, c - a);
    let area = u.x * v.y - u.y * v.x;
    if area == 0.0 {
        return None;
    }
    let (du, dv) = (wb - wa, wc - wa);
    let slope = Vector2::new((du * v.y - dv * u.y) / area, (dv * u.x - du * v.x) / area);
    Some((slope, wa - slope.dot(&a)))
}
