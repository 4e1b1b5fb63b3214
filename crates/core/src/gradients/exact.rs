//! The exact gradient of the IoU: an integral over the mask's outline.
//!
//! Moving a vertex moves only the border of the mask, so dL = ∫ ∂L/∂ŝ n·dx dl over the outline. Where the mesh lies on
//! both sides of an edge, coverage stays 1 and the edge adds nothing. Within a pixel ∂L/∂ŝ is constant and the weights of
//! the edge's ends are linear, so the midpoint of each pixel's piece of an edge gives its integral.

use nalgebra::{Vector2, Vector3};

use super::{Chain, MaskGradient, ObservedMask, loss_slopes};
use crate::camera::Camera;
use crate::lie::Pose;
use crate::mesh::Topology;
use crate::outline::outline;
use crate::raster::Rect;
use crate::rounding::nearest;
use crate::silhouette::Silhouette;
use crate::visible::{Piece, Visible};

/// Buffers that one evaluation after another reuses.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    silhouette: Silhouette,
    visible: Visible,
    points: Vec<Vector3<f64>>,
    on_image: Vec<Vector2<f64>>,
    in_camera: Vec<Vector3<f64>>,
}

/// Spacing of outline samples where a mesh is open or cut by the near plane, pixels.
const SAMPLE_STEP_PX: f64 = 0.5;

/// L_mask of a drawn mesh and its exact gradient.
pub fn exact_gradient(
    camera: &Camera,
    camera_from_object: &Pose,
    vertices: &[Vector3<f64>],
    topology: &Topology,
    observed: &ObservedMask,
    work: &mut Workspace,
) -> MaskGradient {
    let Workspace { silhouette, visible, points, on_image, in_camera } = work;
    points.clear();
    points.extend(vertices.iter().map(|v| camera_from_object.transform(v)));
    silhouette.draw(camera, points, topology);
    let (intersection, union) = overlap(silhouette, observed);
    let slopes = loss_slopes(intersection, union);
    in_camera.clear();
    in_camera.resize(vertices.len(), Vector3::zeros());
    let rotation = &camera_from_object.rotation;
    let chain = Chain { camera, rotation, points_in_camera: points, points_in_object: vertices };
    if silhouette.by_contour {
        visible.find(silhouette);
        on_image.clear();
        on_image.resize(vertices.len(), Vector2::zeros());
        for piece in &visible.pieces {
            integrate_piece(silhouette, piece, observed, slopes, on_image);
        }
        for &[vertex, _] in &silhouette.contour {
            let at = vertex as usize;
            in_camera[at] = chain.lift(&points[at], &on_image[at]);
        }
    } else {
        integrate_samples(&chain, topology, silhouette, observed, slopes, in_camera);
    }
    let loss = if union > 0.0 { -intersection / union } else { -1.0 };
    chain.gather(loss, intersection, union, in_camera)
}

/// Areas of intersection and union of the drawn and the observed mask, pixels.
#[must_use]
pub fn overlap(drawn: &mut Silhouette, observed: &ObservedMask) -> (f64, f64) {
    let rect = drawn.rect;
    let (mut both, mut area) = (0, 0);
    if drawn.by_contour {
        for &(row, start, end) in &drawn.spans {
            area += u64::from(end - start);
            let (y, from, to) = (rect.y0 + i64::from(row), rect.x0 + i64::from(start), rect.x0 + i64::from(end));
            both += observed.count(y, from, to);
        }
    } else {
        for (i, _) in drawn.mask().iter().enumerate().filter(|(_, m)| **m > 0) {
            area += 1;
            let (x, y) = (rect.x0 + (i % rect.width) as i64, rect.y0 + (i / rect.width) as i64);
            both += u64::from(observed.at(x, y));
        }
    }
    (both as f64, (area + observed.area - both) as f64)
}

/// Add a piece's integral to the gradients over its edge's ends on the image.
fn integrate_piece(
    drawn: &Silhouette,
    piece: &Piece,
    observed: &ObservedMask,
    slopes: (f64, f64),
    on_image: &mut [Vector2<f64>],
) {
    let [first, second] = drawn.contour[piece.edge as usize].map(|v| v as usize);
    let (a, b) = (drawn.pixels[first], drawn.pixels[second]);
    let along = b - a;
    let steep = along.y.abs() >= along.x.abs();
    let (of_first, of_second) = if steep {
        integrate::<true>(&drawn.rect, piece, observed, slopes, (a.y, a.x), (along.y, along.x))
    } else {
        integrate::<false>(&drawn.rect, piece, observed, slopes, (a.x, a.y), (along.x, along.y))
    };
    // a shift of the border along its outward normal, of the edge's length, sweeps as much area as it is long
    let outward = if steep { Vector2::new(-1.0, along.x / along.y) } else { Vector2::new(-along.y / along.x, 1.0) };
    let outward = outward * if steep { along.y.signum() } else { along.x.signum() };
    if of_first != 0.0 || of_second != 0.0 {
        on_image[first] += outward * of_first;
        on_image[second] += outward * of_second;
    }
}

/// Walk a piece along its longer axis (down the rows if `STEEP`), pixel by pixel: ∫ ∂L/∂ŝ (1 − t) and ∫ ∂L/∂ŝ t over that
/// axis. Start and direction of the edge are given as (along the walk, across it).
#[inline]
fn integrate<const STEEP: bool>(
    rect: &Rect,
    piece: &Piece,
    observed: &ObservedMask,
    slopes: (f64, f64),
    start: (f64, f64),
    direction: (f64, f64),
) -> (f64, f64) {
    if direction.0 == 0.0 {
        return (0.0, 0.0);
    }
    let (first, size) = if STEEP { (rect.y0, rect.height) } else { (rect.x0, rect.width) };
    let (across_first, across_size) = if STEEP { (rect.x0, rect.width) } else { (rect.y0, rect.height) };
    let (inverse, slope) = (1.0 / direction.0, direction.1 / direction.0);
    let ends = (start.0 + piece.from * direction.0, start.0 + piece.to * direction.0);
    let (low, high) = (ends.0.min(ends.1), ends.0.max(ends.1));
    let value = |pixel: i64, across: i64| {
        if across < across_first || across >= across_first + across_size as i64 {
            return 0.0;
        }
        let inside = if STEEP { observed.at(across, pixel) } else { observed.at(pixel, across) };
        if inside > 0 { slopes.0 } else { slopes.1 }
    };
    let (mut whole, mut of_second) = (0.0, 0.0);
    let mut add = |from: f64, to: f64, value: f64| {
        let weight = (to - from) * value;
        whole += weight;
        of_second += (0.5 * (from + to) - start.0) * inverse * weight;
    };
    for pixel in nearest(low).max(first)..=nearest(high).min(first + size as i64 - 1) {
        let (from, to) = (low.max(pixel as f64 - 0.5), high.min(pixel as f64 + 0.5));
        let across = |at: f64| start.1 + (at - start.0) * slope;
        let (here, there) = (nearest(across(from)), nearest(across(to)));
        if here == there {
            add(from, to, value(pixel, here));
        } else {
            // not steeper than 1, so it changes pixels across the walk once
            let border = here.max(there) as f64 - 0.5;
            let middle = (start.0 + (border - start.1) / slope).clamp(from, to);
            add(from, middle, value(pixel, here));
            add(middle, to, value(pixel, there));
        }
    }
    (whole - of_second, of_second)
}

/// The same integral by samples of the outline, for open meshes and for those that the near plane cuts.
fn integrate_samples(
    chain: &Chain,
    topology: &Topology,
    drawn: &mut Silhouette,
    observed: &ObservedMask,
    slopes: (f64, f64),
    in_camera: &mut [Vector3<f64>],
) {
    for s in outline(chain.camera, chain.points_in_camera, topology, &drawn.rect.clone(), drawn.mask(), SAMPLE_STEP_PX)
    {
        let inside = observed.at(s.pixel.x.round() as i64, s.pixel.y.round() as i64) > 0;
        let on_image = s.normal * (s.length * if inside { slopes.0 } else { slopes.1 });
        for (vertex, lever) in s.vertices.into_iter().zip(s.levers(chain.camera, chain.points_in_camera)) {
            in_camera[vertex as usize] += lever.transpose() * on_image;
        }
    }
}
