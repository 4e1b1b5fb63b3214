//! The outline of a mesh in a view: where moving a vertex moves the border of its mask.

use nalgebra::{Matrix2x3, Vector2, Vector3};

use crate::camera::Camera;
use crate::mesh::Topology;
use crate::raster::{NEAR_M, Rect};
use crate::rounding::{ceil, nearest};
use crate::silhouette::Silhouette;

/// A point of the outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutlineSample {
    /// Where it lies on the image.
    pub pixel: Vector2<f64>,
    /// Unit normal on the image, away from the mesh.
    pub normal: Vector2<f64>,
    /// The edge's vertices.
    pub vertices: [u32; 2],
    /// Share of the second vertex, t: along the edge on the image, or in space if the near plane cuts the edge.
    pub share: f64,
    /// Length of outline that the sample stands for, pixels.
    pub length: f64,
    /// Whether the near plane cuts the edge.
    pub cut: bool,
}

impl OutlineSample {
    /// Derivatives of the pixel over the edge's ends in the camera's frame: of y = (1 − t) y_a + t y_b, or of the projection of
    /// x = (1 − t) γ_a + t γ_b where an end has no pixel.
    #[must_use]
    pub fn levers(&self, camera: &Camera, points_in_camera: &[Vector3<f64>]) -> [Matrix2x3<f64>; 2] {
        let [a, b] = self.vertices.map(|v| points_in_camera[v as usize]);
        let (p, q) = if self.cut { (a.lerp(&b, self.share), a.lerp(&b, self.share)) } else { (a, b) };
        [camera.projection_jacobian(&p) * (1.0 - self.share), camera.projection_jacobian(&q) * self.share]
    }

    /// Share of the second vertex in space, s: the sample shows the point (1 − s) γ_a + s γ_b.
    #[must_use]
    pub fn share_in_space(&self, points_in_camera: &[Vector3<f64>]) -> f64 {
        let [a, b] = self.vertices.map(|v| points_in_camera[v as usize].z);
        // the inverse depth is affine along the projected edge
        if self.cut { self.share } else { self.share * a / (b + self.share * (a - b)) }
    }
}

/// How far beyond the outline its outer side is probed, pixels.
const PROBE_PX: f64 = 1.0;

/// An edge is sampled this often at most.
const MOST_SAMPLES: f64 = 4096.0;

/// Which faces are turned to the camera.
#[must_use]
pub fn front_facing(points_in_camera: &[Vector3<f64>], faces: &[[u32; 3]]) -> Vec<bool> {
    faces
        .iter()
        .map(|face| {
            let [a, b, c] = face.map(|i| points_in_camera[i as usize]);
            (b - a).cross(&(c - a)).dot(&a) < 0.0
        })
        .collect()
}

/// Samples of the outline every `step_px` or less within `rect`.
///
/// Candidates are edges between a front and a back face, and edges that bound an open mesh. A sample counts only if no
/// face of the mesh, before or behind, covers the pixel one beyond it on its outer side; `mask` (row-major over `rect`)
/// is the mesh's own, as [`crate::raster::fill_mask`] draws it.
#[must_use]
pub fn outline(
    camera: &Camera,
    points_in_camera: &[Vector3<f64>],
    topology: &Topology,
    rect: &Rect,
    mask: &[u8],
    step_px: f64,
) -> Vec<OutlineSample> {
    let front = front_facing(points_in_camera, &topology.faces);
    let mut out = Vec::new();
    for edge in &topology.edges {
        let [f, g] = edge.faces.map(|i| i as usize);
        if edge.count == 2 && front[f] == front[g] {
            continue;
        }
        // of a face seen exactly from the side, the third vertex tells no side: the other face's does
        let thirds = [f, g].map(|face| topology.faces[face].into_iter().find(|v| !edge.vertices.contains(v)));
        let apexes = thirds.into_iter().flatten().map(|v| points_in_camera[v as usize]);
        let [a, b] = edge.vertices.map(|v| points_in_camera[v as usize]);
        let side = |apex: &Vector3<f64>| a.cross(&b).dot(apex).abs();
        let Some(third) = apexes.max_by(|p, q| side(p).total_cmp(&side(q))) else { continue };
        sample_edge(camera, points_in_camera, edge.vertices, third, step_px, |sample| {
            let probe = sample.pixel + sample.normal * PROBE_PX;
            let covered = rect.index(probe.x.round() as i64, probe.y.round() as i64).is_some_and(|i| mask[i] > 0);
            let inside = rect.index(sample.pixel.x.round() as i64, sample.pixel.y.round() as i64).is_some();
            if inside && !covered {
                out.push(sample);
            }
        });
    }
    out
}

/// The same samples of a mesh that was drawn by its contour: the edges are known, and runs of pixels stand for the mask.
pub fn contour_samples(drawn: &Silhouette, step_px: f64, out: &mut Vec<OutlineSample>) {
    for &[a, b] in &drawn.contour.edges {
        let vertices = [a.min(b), a.max(b)];
        let [from, to] = vertices.map(|v| drawn.pixels[v as usize]);
        let length = (to - from).norm();
        if length < 1e-9 {
            continue;
        }
        let along = (to - from) / length;
        let outward = Vector2::new(-along.y, along.x);
        let normal = if a < b { outward } else { -outward };
        let count = ceil((length / step_px).min(MOST_SAMPLES));
        let (each, length) = (1.0 / count as f64, length / count as f64);
        for k in 0..count {
            let share = (k as f64 + 0.5) * each;
            let pixel = from + (to - from) * share;
            let probe = pixel + normal * PROBE_PX;
            let inside = !drawn.clipped || drawn.rect.index(nearest(pixel.x), nearest(pixel.y)).is_some();
            if inside && !drawn.covers(nearest(probe.x), nearest(probe.y)) {
                out.push(OutlineSample { pixel, normal, vertices, share, length, cut: false });
            }
        }
    }
}

/// Sample the part of an edge that lies before the near plane; `third` tells which side the mesh is on.
fn sample_edge(
    camera: &Camera,
    points: &[Vector3<f64>],
    vertices: [u32; 2],
    third: Vector3<f64>,
    step_px: f64,
    mut visit: impl FnMut(OutlineSample),
) {
    let [a, b] = vertices.map(|i| points[i as usize]);
    let Some((start, end)) = before_near_plane(a.z, b.z) else { return };
    let at = |s: f64| a + (b - a) * s;
    let (p, q) = (at(start), at(end));
    let (from, to) = (camera.project(&p), camera.project(&q));
    let length = (to - from).norm();
    if !length.is_finite() || length < 1e-9 {
        return;
    }
    let along = (to - from) / length;
    let mut normal = Vector2::new(along.y, -along.x);
    // the edge's plane through the camera's centre parts the mesh's side from the outer side, also behind the near plane
    let plane = a.cross(&b);
    let outer = image_point_in_camera(camera, &(from + normal));
    if plane.dot(&outer) * plane.dot(&third) > 0.0 {
        normal = -normal;
    }
    let cut = (start, end) != (0.0, 1.0);
    let count = (length / step_px).ceil().min(MOST_SAMPLES) as usize;
    for k in 0..count {
        let t = (k as f64 + 0.5) / count as f64;
        let within = t * p.z / (q.z + t * (p.z - q.z)); // the inverse depth is affine along the projected edge
        let share = if cut { start + (end - start) * within } else { t };
        visit(OutlineSample {
            pixel: from + (to - from) * t,
            normal,
            vertices,
            share,
            length: length / count as f64,
            cut,
        });
    }
}

fn image_point_in_camera(camera: &Camera, pixel: &Vector2<f64>) -> Vector3<f64> {
    let y = (pixel.y - camera.cy) / camera.fy;
    Vector3::new((pixel.x - camera.cx - camera.skew * y) / camera.fx, y, 1.0)
}

/// The interval of an edge's parameter with depth at least [`NEAR_M`].
fn before_near_plane(za: f64, zb: f64) -> Option<(f64, f64)> {
    match (za >= NEAR_M, zb >= NEAR_M) {
        (true, true) => Some((0.0, 1.0)),
        (false, false) => None,
        (true, false) => Some((0.0, (NEAR_M - za) / (zb - za))),
        (false, true) => Some(((NEAR_M - za) / (zb - za), 1.0)),
    }
}
