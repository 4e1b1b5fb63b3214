//! The approximate gradient of rasterization that the paper uses (Kato, Ushiku and Harada 2018).
//!
//! A pixel changes colour when an edge reaches it, so an edge is pulled towards every pixel on its scanline whose change
//! would lower the loss, with a weight of 1/distance: outward to pixels that the mesh does not cover, inward to pixels
//! that its face covers. Per face, edge, axis and scanline; only pixels whose change lowers the loss; no σ.

use nalgebra::{Vector2, Vector3};

use super::{Chain, MaskGradient, ObservedMask, loss_slopes};
use crate::camera::Camera;
use crate::lie::Pose;
use crate::mesh::Topology;
use crate::raster::{NEAR_M, Raster, Rect};

/// Added to distances, so that a pixel on the edge pulls with a finite force; pixels.
pub const EPSILON_PX: f64 = 1e-3;

/// A vertex farther off the image than this has no pixel.
const FARTHEST_PX: f64 = 1e9;

/// A drawn mesh: which face each pixel shows, and ∂L/∂ŝ of each pixel.
#[derive(Debug, Clone, Copy)]
pub struct Picture<'a> {
    /// The pixels.
    pub rect: Rect,
    /// The face in front, −1 where there is none; row-major.
    pub face: &'a [i32],
    /// ∂L/∂ŝ, row-major.
    pub slope: &'a [f64],
}

impl Picture<'_> {
    /// Flat index of the pixel at `along` on an axis and `across` it, both from the rectangle's first pixel.
    fn index(&self, axis: usize, along: i64, across: i64) -> usize {
        let (x, y) = if axis == 0 { (along, across) } else { (across, along) };
        y as usize * self.rect.width + x as usize
    }

    /// Pixels along an axis and across it.
    fn size(&self, axis: usize) -> (i64, i64) {
        let (w, h) = (self.rect.width as i64, self.rect.height as i64);
        if axis == 0 { (w, h) } else { (h, w) }
    }
}

/// Pixels that the loss wants covered and that are not, along the scanlines of an axis: what outward passes pull towards.
struct Missing {
    start: Vec<usize>,
    across: Vec<i64>,
}

impl Missing {
    fn new(picture: &Picture, axis: usize) -> Self {
        let (length, width) = picture.size(axis);
        let (mut start, mut across) = (vec![0], Vec::new());
        for along in 0..length {
            let missing = |&at: &i64| {
                let index = picture.index(axis, along, at);
                picture.face[index] < 0 && picture.slope[index] < 0.0
            };
            across.extend((0..width).filter(missing));
            start.push(across.len());
        }
        Self { start, across }
    }

    /// Those of a scanline from `first` to `last`, both included.
    fn between(&self, along: i64, first: i64, last: i64) -> &[i64] {
        let line = &self.across[self.start[along as usize]..self.start[along as usize + 1]];
        &line[line.partition_point(|&at| at < first)..line.partition_point(|&at| at <= last)]
    }
}

/// Gradient of the loss over the pixels of every vertex.
#[must_use]
pub fn pixel_gradient(pixels: &[Vector2<f64>], faces: &[[u32; 3]], picture: &Picture) -> Vec<Vector2<f64>> {
    let mut out = vec![Vector2::zeros(); pixels.len()];
    let origin = Vector2::new(picture.rect.x0 as f64, picture.rect.y0 as f64);
    let missing = [0, 1].map(|axis| Missing::new(picture, axis));
    let mut seen = vec![false; faces.len()];
    picture.face.iter().filter(|f| **f >= 0).for_each(|&f| seen[f as usize] = true);
    for (number, face) in faces.iter().enumerate().filter(|(number, _)| seen[*number]) {
        let mut corners = *face;
        let at = |v: u32| pixels[v as usize] - origin;
        let (u, v) = (at(corners[1]) - at(corners[0]), at(corners[2]) - at(corners[0]));
        if u.x * v.y - u.y * v.x > 0.0 {
            corners.swap(1, 2); // either winding counts as the front
        }
        for k in 0..3 {
            let ends = [corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]];
            for axis in 0..2 {
                let points = ends.map(|v| Vector2::new(at(v)[axis], at(v)[1 - axis]));
                let (first, second) = scan_edge(picture, &missing[axis], number as i32, axis, &points);
                out[ends[0] as usize][1 - axis] += first;
                out[ends[1] as usize][1 - axis] += second;
            }
        }
    }
    out
}

/// One edge of one face along one axis: the pull on the coordinate across it at both ends. Points are (along, across).
fn scan_edge(picture: &Picture, missing: &Missing, face: i32, axis: usize, points: &[Vector2<f64>; 3]) -> (f64, f64) {
    let [p, q, third] = *points;
    let (length, width) = picture.size(axis);
    let (mut first, mut second) = (0.0, 0.0);
    if p.x == q.x {
        return (first, second);
    }
    // a front face turns clockwise in x and y down: its outside lies on this side, across the axis
    let outward = if (p.x < q.x) == (axis == 0) { 1 } else { -1 };
    let from = (p.x.min(q.x).ceil() as i64).max(0);
    let to = (p.x.max(q.x).floor() as i64).min(length - 1);
    for along in from..=to {
        let crossing = (q.y - p.y) / (q.x - p.x) * (along as f64 - p.x) + p.y;
        let inner = if outward > 0 { crossing.floor() } else { crossing.ceil() } as i64;
        let outer = inner.saturating_add(outward);
        if inner < 0 || inner >= width || outer < 0 || outer >= width {
            continue;
        }
        let mut pull = |across: i64, gain: f64| {
            let away = across as f64 - crossing;
            for (sum, end, other) in [(&mut first, q.x, p.x), (&mut second, p.x, q.x)] {
                if end != along as f64 {
                    let scaled = (end - other) / (end - along as f64) * away;
                    *sum -= gain / if scaled > 0.0 { scaled + EPSILON_PX } else { scaled - EPSILON_PX };
                }
            }
        };
        if picture.face[picture.index(axis, along, inner)] == face {
            let limit = if outward > 0 { width - 1 } else { 0 };
            for &across in missing.between(along, outer.min(limit), outer.max(limit)) {
                pull(across, -picture.slope[picture.index(axis, along, across)]);
            }
        }
        if picture.face[picture.index(axis, along, outer)] >= 0 {
            continue; // what leaves the face there uncovers nothing
        }
        let limit = far_side(&p, &q, &third, along as f64, outward).clamp(0, width - 1);
        for across in inner.min(limit)..=inner.max(limit) {
            let at = picture.index(axis, along, across);
            if picture.face[at] == face && picture.slope[at] > 0.0 {
                pull(across, picture.slope[at]);
            }
        }
    }
    (first, second)
}

/// Where the scanline leaves the face through one of its other two edges.
fn far_side(p: &Vector2<f64>, q: &Vector2<f64>, third: &Vector2<f64>, along: f64, outward: i64) -> i64 {
    let crossing = if (along - p.x) * (along - third.x) < 0.0 {
        (third.y - p.y) / (third.x - p.x) * (along - p.x) + p.y
    } else {
        (q.y - third.y) / (q.x - third.x) * (along - third.x) + third.y
    };
    let limit = if outward > 0 { crossing.ceil() } else { crossing.floor() };
    limit as i64 // saturates; not a number gives 0, the edge itself then bounds the run
}

fn pixel(camera: &Camera, point_in_camera: &Vector3<f64>) -> Option<Vector2<f64>> {
    let found = camera.project(point_in_camera);
    (point_in_camera.z >= NEAR_M && found.iter().all(|y| y.abs() < FARTHEST_PX)).then_some(found)
}

/// L_mask of a drawn mesh and Kato's gradient of it.
#[must_use]
pub fn kato_gradient(
    camera: &Camera,
    camera_from_object: &Pose,
    vertices: &[Vector3<f64>],
    topology: &Topology,
    observed: &ObservedMask,
) -> MaskGradient {
    let points: Vec<Vector3<f64>> = vertices.iter().map(|v| camera_from_object.transform(v)).collect();
    let image = Rect::image(camera);
    let seen = observed.bounds.intersection(&image);
    let rect = Rect::of_mesh(camera, &points).joined(&seen).grown(1).intersection(&image);
    let mut raster = Raster::new(rect);
    raster.draw(camera, &points, &topology.faces, 0);
    let (mut both, mut drawn) = (0u64, 0u64);
    let place = |i: usize| ((i % rect.width) as i64 + rect.x0, (i / rect.width) as i64 + rect.y0);
    for (i, _) in raster.face.iter().enumerate().filter(|(_, f)| **f >= 0) {
        let (x, y) = place(i);
        drawn += 1;
        both += u64::from(observed.at(x, y));
    }
    let (intersection, union) = (both as f64, (drawn + observed.area - both) as f64);
    let (inside, outside) = loss_slopes(intersection, union);
    let slope: Vec<f64> = (0..rect.area())
        .map(|i| {
            let (x, y) = place(i);
            if observed.at(x, y) > 0 { inside } else { outside }
        })
        .collect();
    // a vertex behind the near plane, or beyond what numbers tell apart, has no pixel: faces that hold one do not pull
    let placed: Vec<Option<Vector2<f64>>> = points.iter().map(|p| pixel(camera, p)).collect();
    let pixels: Vec<Vector2<f64>> = placed.iter().map(|y| y.unwrap_or_default()).collect();
    let whole = |face: &[u32; 3]| face.iter().all(|&v| placed[v as usize].is_some());
    let faces: Vec<[u32; 3]> = topology.faces.iter().map(|f| if whole(f) { *f } else { [f[0]; 3] }).collect();
    let on_image = pixel_gradient(&pixels, &faces, &Picture { rect, face: &raster.face, slope: &slope });
    let rotation = &camera_from_object.rotation;
    let chain = Chain { camera, rotation, points_in_camera: &points, points_in_object: vertices };
    let lift = |v: usize| placed[v].map_or_else(Vector3::zeros, |_| chain.lift(&points[v], &on_image[v]));
    let loss = if union > 0.0 { -intersection / union } else { -1.0 };
    chain.gather(loss, intersection, union, (0..points.len()).map(|v| (v, lift(v))))
}
