//! The exact gradient of the IoU: an integral over the mask's outline.
//!
//! Moving a vertex moves only the border of the mask, so dL = ∫ ∂L/∂ŝ n·dx dl over the outline. Where the mesh lies on
//! both sides of an edge, coverage stays 1 and the edge adds nothing. Steep edges are integrated row by row and flat ones
//! column by column: within a pixel ∂L/∂ŝ is constant and the weights of the edge's ends are linear, so the midpoint of
//! each piece is enough.

use nalgebra::{Vector2, Vector3};

use super::{Chain, MaskGradient, ObservedMask, loss_slopes};
use crate::camera::Camera;
use crate::lie::Pose;
use crate::mesh::Topology;
use crate::outline::outline;
use crate::silhouette::Silhouette;

/// Buffers that one evaluation after another reuses.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    silhouette: Silhouette,
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
    work.points.clear();
    work.points.extend(vertices.iter().map(|v| camera_from_object.transform(v)));
    work.silhouette.draw(camera, &work.points, topology, 1);
    if work.silhouette.by_contour {
        let lines = lines_per_pixel(&work.silhouette);
        if lines > 1 {
            work.silhouette.draw(camera, &work.points, topology, lines);
        }
        work.silhouette.scan_columns(lines);
    }
    let (intersection, union) = overlap(&work.silhouette, observed);
    let slopes = loss_slopes(intersection, union);
    work.in_camera.clear();
    work.in_camera.resize(vertices.len(), Vector3::zeros());
    let chain = Chain {
        camera,
        rotation: &camera_from_object.rotation,
        points_in_camera: &work.points,
        points_in_object: vertices,
    };
    if work.silhouette.by_contour {
        work.on_image.clear();
        work.on_image.resize(vertices.len(), Vector2::zeros());
        integrate_contour(&work.silhouette, observed, slopes, &mut work.on_image);
        for ((g, on_image), point) in work.in_camera.iter_mut().zip(&work.on_image).zip(&work.points) {
            if on_image.x != 0.0 || on_image.y != 0.0 {
                *g = chain.lift(point, on_image);
            }
        }
    } else {
        integrate_samples(&chain, topology, &work.silhouette, observed, slopes, &mut work.in_camera);
    }
    let loss = if union > 0.0 { -intersection / union } else { -1.0 };
    chain.gather(loss, intersection, union, &work.in_camera)
}

/// Areas of intersection and union of the drawn and the observed mask, pixels.
#[must_use]
pub fn overlap(drawn: &Silhouette, observed: &ObservedMask) -> (f64, f64) {
    let rect = &drawn.rect;
    let (mut both, mut area) = (0, 0);
    if drawn.by_contour {
        for &(row, start, end) in &drawn.spans {
            area += u64::from(end - start);
            let (y, from, to) = (rect.y0 + i64::from(row), rect.x0 + i64::from(start), rect.x0 + i64::from(end));
            both += observed.count(y, from, to);
        }
    } else {
        for (i, _) in drawn.mask.iter().enumerate().filter(|(_, m)| **m > 0) {
            area += 1;
            let (x, y) = (rect.x0 + (i % rect.width) as i64, rect.y0 + (i / rect.width) as i64);
            both += u64::from(observed.at(x, y));
        }
    }
    (both as f64, (area + observed.area - both) as f64)
}

/// Scanlines a pixel, so that the smallest mesh is crossed by some 150.
fn lines_per_pixel(drawn: &Silhouette) -> i64 {
    match drawn.rect.width.max(drawn.rect.height) {
        0..=40 => 7,
        41..=150 => 5,
        _ => 3,
    }
}

fn integrate_contour(drawn: &Silhouette, observed: &ObservedMask, slopes: (f64, f64), on_image: &mut [Vector2<f64>]) {
    for (number, edge) in drawn.contour.iter().enumerate() {
        let [a, b] = edge.vertices.map(|v| drawn.pixels[v as usize]);
        let along = b - a;
        // a front face turns clockwise on an image with y down, so its outer side is to the left of its way
        let outward = Vector2::new(-along.y, along.x) * f64::from(edge.side);
        let steep = along.y.abs() >= along.x.abs();
        let (gradient_a, gradient_b) = if steep {
            integrate_edge::<true>(drawn, number, observed, slopes, &a, &along, outward.x > 0.0)
        } else {
            integrate_edge::<false>(drawn, number, observed, slopes, &a, &along, outward.y > 0.0)
        };
        on_image[edge.vertices[0] as usize] += gradient_a;
        on_image[edge.vertices[1] as usize] += gradient_b;
    }
}

/// Walk an edge along its longer axis (down the rows if `STEEP`), strip by strip: gradients over its two ends.
#[inline]
fn integrate_edge<const STEEP: bool>(
    drawn: &Silhouette,
    number: usize,
    observed: &ObservedMask,
    slopes: (f64, f64),
    a: &Vector2<f64>,
    along: &Vector2<f64>,
    outward: bool,
) -> (Vector2<f64>, Vector2<f64>) {
    let (start, step, start_across, step_across) =
        if STEEP { (a.y, along.y, a.x, along.x) } else { (a.x, along.x, a.y, along.y) };
    let scan = if STEEP { &drawn.rows } else { &drawn.columns };
    let (first_line, entry, count) = scan.edges[number];
    if step == 0.0 {
        return (Vector2::zeros(), Vector2::zeros());
    }
    let (low, high) = if step > 0.0 { (start, start + step) } else { (start + step, start) };
    let rect = &drawn.rect;
    let (first_pixel, pixels, across_low, across_size) = if STEEP {
        (rect.y0, rect.height as i64, rect.x0, rect.width as i64)
    } else {
        (rect.x0, rect.width as i64, rect.y0, rect.height as i64)
    };
    let (slope, inverse, scale) = (step_across / step, 1.0 / step, scan.lines_per_pixel as f64);
    let sign = if outward { 1.0 } else { -1.0 };
    let shift = 0.5 - first_pixel as f64;
    let from = (((low + shift) * scale).floor() as i64).max(0);
    let to = (((high + shift) * scale).floor() as i64).min(pixels * scan.lines_per_pixel - 1);
    let (mut near_a, mut near_b) = (0.0, 0.0);
    for line in from..=to {
        let (u, v) = (low.max(line as f64 / scale - shift), high.min((line + 1) as f64 / scale - shift));
        let t = (0.5 * (u + v) - start) * inverse;
        let across = start_across + t * step_across;
        let here = (across + 0.5).floor() as i64;
        if here < across_low || here >= across_low + across_size {
            continue;
        }
        let pixel = first_pixel + line / scan.lines_per_pixel;
        let bounds = if count > 0 {
            // a strip that the edge ends in before its centre goes with the nearest that it crosses
            let k = (line - first_line).clamp(0, i64::from(count) - 1) as usize;
            scan.bounds[entry as usize + k] > 0
        } else {
            let beyond = (across + sign + 0.5).floor() as i64;
            !if STEEP { drawn.covers(beyond, pixel) } else { drawn.covers(pixel, beyond) }
        };
        if !bounds {
            continue;
        }
        let inside = if STEEP { observed.at(here, pixel) } else { observed.at(pixel, here) };
        let weight = (v - u) * if inside > 0 { slopes.0 } else { slopes.1 };
        near_a += (1.0 - t) * weight;
        near_b += t * weight;
    }
    // a shift across the walk moves the border itself, one along it moves it by the slope
    let turn = |g: f64| {
        let (across, along) = (sign * g, -sign * g * slope);
        if STEEP { Vector2::new(across, along) } else { Vector2::new(along, across) }
    };
    (turn(near_a), turn(near_b))
}

/// The same integral by samples of the outline, for open meshes and for those that the near plane cuts.
fn integrate_samples(
    chain: &Chain,
    topology: &Topology,
    drawn: &Silhouette,
    observed: &ObservedMask,
    slopes: (f64, f64),
    in_camera: &mut [Vector3<f64>],
) {
    for s in outline(chain.camera, chain.points_in_camera, topology, &drawn.rect, &drawn.mask, SAMPLE_STEP_PX) {
        let inside = observed.at(s.pixel.x.round() as i64, s.pixel.y.round() as i64) > 0;
        let on_image = s.normal * (s.length * if inside { slopes.0 } else { slopes.1 });
        let g = chain.lift(&s.point_in_camera, &on_image);
        in_camera[s.vertices[0] as usize] += g * (1.0 - s.weight);
        in_camera[s.vertices[1] as usize] += g * s.weight;
    }
}
