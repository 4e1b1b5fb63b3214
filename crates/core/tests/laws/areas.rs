//! Exact areas against the polygons that convex bodies project to, and gradients against differences.

use meshslam_core::areas::Areas;
use meshslam_core::camera::Camera;
use meshslam_core::lie::Pose;
use meshslam_core::mesh::Topology;
use nalgebra::{Vector2, Vector3};

use crate::common::{Random, convex_hull, icosphere, polygon_edges, signed};

const CAMERA: Camera = Camera { width: 48, height: 40, fx: 45.0, fy: 47.0, cx: 22.3, cy: 19.1, skew: 0.7 };

struct Body {
    vertices: Vec<Vector3<f64>>,
    pose: Pose,
    hull: Vec<Vector2<f64>>,
}

/// An ellipsoid within the image.
fn body(random: &mut Random, depth: usize) -> (Body, Vec<[u32; 3]>) {
    let (sphere, faces) = icosphere(depth);
    let size = Vector3::from_fn(|_, _| random.uniform(0.2, 1.0));
    let vertices: Vec<Vector3<f64>> = sphere.iter().map(|v| v.component_mul(&size)).collect();
    let shift = random.vector(0.4) + Vector3::new(0.0, 0.0, random.uniform(3.5, 8.0));
    let pose = Pose { rotation: random.rotation(), translation: shift };
    let pixels: Vec<Vector2<f64>> = vertices.iter().map(|v| CAMERA.project(&pose.transform(v))).collect();
    (Body { hull: convex_hull(&pixels), vertices, pose }, faces)
}

/// Area of a polygon.
fn area(polygon: &[Vector2<f64>]) -> f64 {
    0.5 * polygon_edges(polygon).map(|(a, b)| a.perp(&b)).sum::<f64>().abs()
}

/// The part of a convex polygon on one side of a line of pixel borders (Sutherland and Hodgman 1974).
fn clipped(polygon: &[Vector2<f64>], axis: usize, border: f64, sign: f64) -> Vec<Vector2<f64>> {
    let inside = |p: &Vector2<f64>| sign * (p[axis] - border);
    let mut out = Vec::new();
    for (a, b) in polygon_edges(polygon) {
        let (s, t) = (inside(&a), inside(&b));
        if s >= 0.0 {
            out.push(a);
        }
        if (s > 0.0 && t < 0.0) || (s < 0.0 && t > 0.0) {
            out.push(a + (b - a) * (s / (s - t)));
        }
    }
    out
}

fn shares(areas: &Areas) -> Vec<f64> {
    let mut out = vec![0.0; CAMERA.width * CAMERA.height];
    let rect = areas.rect();
    let at =
        |row: u32, column: u32| (rect.y0 as usize + row as usize) * CAMERA.width + rect.x0 as usize + column as usize;
    for &(row, from, to) in areas.spans() {
        out[at(row, from)..at(row, from) + (to - from) as usize].fill(1.0);
    }
    areas.touched().iter().for_each(|cell| out[at(cell.row, cell.column)] = cell.share);
    out
}

#[test]
fn each_share_is_the_area_of_the_polygon_in_the_pixel() {
    let (mut random, mut areas) = (Random(5), Areas::default());
    for round in 0..40 {
        let (body, mut faces) = body(&mut random, 1 + round % 2);
        if round % 3 == 0 {
            faces.truncate(faces.len() - 1); // open where it may or may not be seen
            faces.push(faces[0]);
        }
        let topology = Topology::new(body.vertices.len(), &signed(&faces)).unwrap();
        areas.draw(&CAMERA, &body.pose, &body.vertices, &topology);
        let found = shares(&areas);
        if topology.closed {
            for (k, &share) in found.iter().enumerate() {
                let (x, y) = ((k % CAMERA.width) as f64, (k / CAMERA.width) as f64);
                let part = clipped(&clipped(&body.hull, 0, x - 0.5, 1.0), 0, x + 0.5, -1.0);
                let part = clipped(&clipped(&part, 1, y - 0.5, 1.0), 1, y + 0.5, -1.0);
                assert!((share - area(&part)).abs() < 1e-10, "round {round}, pixel {x} {y}: {share} {}", area(&part));
            }
        } else {
            let (all, hull) = (found.iter().sum::<f64>(), area(&body.hull));
            assert!(all < hull + 1e-9 && all > 0.8 * hull, "round {round}: {all} of {hull}");
        }
    }
}

#[test]
fn the_gradient_of_any_loss_is_its_difference() {
    let (mut random, mut areas) = (Random(9), Areas::default());
    for round in 0..30 {
        let (mut body, mut faces) = body(&mut random, 1);
        if round % 2 == 1 {
            faces.retain(|_| random.below(4) > 0); // holes
        }
        if round % 5 == 4 {
            body.pose.translation.z = random.uniform(0.0, 0.7); // the near plane cuts it
        }
        let topology = Topology::new(body.vertices.len(), &signed(&faces)).unwrap();
        let weights: Vec<f64> = (0..CAMERA.width * CAMERA.height).map(|_| random.uniform(-1.0, 1.0)).collect();
        let step: Vec<Vector3<f64>> = body.vertices.iter().map(|_| random.vector(1.0)).collect();
        let shift = random.vector(1.0);
        let mut value = |by: f64| {
            let vertices: Vec<Vector3<f64>> = body.vertices.iter().zip(&step).map(|(v, d)| v + d * by).collect();
            let pose = Pose { translation: body.pose.translation + shift * by, ..body.pose };
            areas.draw(&CAMERA, &pose, &vertices, &topology);
            shares(&areas).iter().zip(&weights).map(|(s, w)| s * w).sum::<f64>()
        };
        let numeric = (value(1e-6) - value(-1e-6)) / 2e-6;
        areas.draw(&CAMERA, &body.pose, &body.vertices, &topology);
        let rect = areas.rect();
        let slope =
            |column: usize, row: usize| weights[(rect.y0 as usize + row) * CAMERA.width + rect.x0 as usize + column];
        let found = areas.gradient(&CAMERA, &body.pose, &body.vertices, slope);
        let along: f64 = found.vertices.iter().zip(&step).map(|(g, d)| g.dot(d)).sum::<f64>()
            + found.camera_from_object.column(3).dot(&shift);
        assert!((along - numeric).abs() < 1e-4 * (1.0 + numeric.abs()), "round {round}: {along} {numeric}");
    }
}
