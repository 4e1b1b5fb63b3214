use meshslam_core::camera::Camera;
use meshslam_core::lie::Pose;
use meshslam_core::mesh::Topology;
use meshslam_core::outline::{OutlineSample, front_facing, outline};
use meshslam_core::raster::{NEAR_M, Rect};
use nalgebra::{Vector2, Vector3};

use crate::common::{
    Random, camera, convex_hull, cuboid, drawn, icosphere, joined, perimeter, placed, signed, signed_distance,
};

fn sampled(camera: &Camera, points: &[Vector3<f64>], faces: &[[u32; 3]], step_px: f64) -> Vec<OutlineSample> {
    let topology = Topology::new(points.len(), &signed(faces)).unwrap();
    outline(camera, points, &topology, &Rect::image(camera), &drawn(camera, points, faces), step_px)
}

fn hull(camera: &Camera, points: &[Vector3<f64>]) -> Vec<Vector2<f64>> {
    convex_hull(&points.iter().map(|p| camera.project(p)).collect::<Vec<_>>())
}

fn poses(seed: u64, count: usize) -> Vec<Pose> {
    let mut random = Random(seed);
    let at = |r: &mut Random| Vector3::new(r.uniform(-0.4, 0.4), r.uniform(-0.3, 0.3), r.uniform(5.0, 9.0));
    (0..count).map(|_| Pose { rotation: random.rotation(), translation: at(&mut random) }).collect()
}

/// What every sample owes: on its edge, normal of length 1 across it and away from the drawn mask.
fn check_samples(camera: &Camera, points: &[Vector3<f64>], samples: &[OutlineSample], step_px: f64) {
    for s in samples {
        let [a, b] = s.vertices.map(|v| points[v as usize]);
        assert!((0.0..=1.0).contains(&s.share) && (0.0..=1.0).contains(&s.share_in_space(points)));
        assert!((camera.project(&a.lerp(&b, s.share_in_space(points))) - s.pixel).amax() < 1e-6);
        assert!((s.normal.norm() - 1.0).abs() < 1e-12);
        assert!(s.length > 0.0 && s.length <= step_px + 1e-9);
        if a.z > NEAR_M && b.z > NEAR_M {
            let along = (camera.project(&b) - camera.project(&a)).normalize();
            assert!(along.dot(&s.normal).abs() < 1e-9);
        }
    }
}

#[test]
fn the_outline_of_a_convex_mesh_is_the_perimeter_of_its_hull() {
    let camera = camera();
    let meshes = [icosphere(2), icosphere(3), cuboid(Vector3::new(-0.9, -0.4, -0.3), Vector3::new(0.9, 0.4, 0.3))];
    for (mesh, faces) in &meshes {
        for pose in poses(1, 20) {
            let points = placed(&pose, mesh);
            let polygon = hull(&camera, &points);
            for step_px in [0.5, 2.0] {
                let samples = sampled(&camera, &points, faces, step_px);
                check_samples(&camera, &points, &samples, step_px);
                let length: f64 = samples.iter().map(|s| s.length).sum();
                assert!((length / perimeter(&polygon) - 1.0).abs() < 1e-9, "{length} {}", perimeter(&polygon));
                for s in &samples {
                    assert!(signed_distance(&polygon, &s.pixel).abs() < 1e-9);
                    let beyond = signed_distance(&polygon, &(s.pixel + s.normal * 0.5));
                    assert!((beyond - 0.5).abs() < 1e-9, "the normal points outward: {beyond}");
                }
            }
        }
    }
}

#[test]
fn faces_seen_exactly_from_the_side_still_bound_the_outline() {
    let camera = Camera { cx: 80.0, cy: 60.0, skew: 0.0, ..camera() };
    for shift in [0.0, 0.4, -0.7] {
        // one or two sides of the box lie in planes through the camera's centre
        for (low, high) in [([0.0, -0.5 + shift, 3.0], [1.0, 0.5 + shift, 4.0]), ([-1.0, 0.0, 3.0], [0.0, 0.8, 4.0])] {
            let (points, mut faces) = cuboid(Vector3::from(low), Vector3::from(high));
            for _ in 0..2 {
                let length: f64 = sampled(&camera, &points, &faces, 1.0).iter().map(|s| s.length).sum();
                let expected = perimeter(&hull(&camera, &points));
                assert!((length / expected - 1.0).abs() < 1e-6, "{low:?}: {length} of {expected}");
                faces.reverse();
            }
        }
    }
}

#[test]
fn front_faces_of_a_convex_mesh_are_those_turned_to_the_camera() {
    let (sphere, faces) = icosphere(2);
    for pose in poses(2, 5) {
        let points = placed(&pose, &sphere);
        for (front, face) in front_facing(&points, &faces).iter().zip(&faces) {
            let centre = face.iter().map(|&i| points[i as usize]).sum::<Vector3<f64>>() / 3.0;
            let outward = centre - pose.translation;
            let cosine = outward.normalize().dot(&centre.normalize());
            if cosine.abs() > 0.05 {
                assert_eq!(*front, cosine < 0.0);
            }
        }
    }
}

#[test]
fn a_shell_within_another_has_no_outline() {
    let camera = camera();
    let (outer, inner) = (icosphere(2), icosphere(2));
    let count = outer.0.len() as u32;
    let inner = (inner.0.iter().map(|v| v * 0.6 + Vector3::new(0.05, 0.1, 0.0)).collect(), inner.1);
    let (mesh, faces) = joined(outer, inner);
    for pose in poses(3, 10) {
        let points = placed(&pose, &mesh);
        let samples = sampled(&camera, &points, &faces, 1.0);
        assert!(samples.iter().all(|s| s.vertices.iter().all(|v| *v < count)));
        let length: f64 = samples.iter().map(|s| s.length).sum();
        assert!((length / perimeter(&hull(&camera, &points)) - 1.0).abs() < 1e-9);
    }
}

#[test]
fn a_part_before_the_body_gives_samples_only_where_it_stands_out() {
    let camera = Camera { skew: 0.0, ..camera() };
    let body = cuboid(Vector3::new(-1.0, -0.6, 5.0), Vector3::new(1.0, 0.6, 6.0));
    let part = cuboid(Vector3::new(0.4, -0.2, 4.0), Vector3::new(1.4, 0.2, 4.4));
    let (points, faces) = joined(body, part);
    let mask = drawn(&camera, &points, &faces);
    let samples = sampled(&camera, &points, &faces, 1.0);
    check_samples(&camera, &points, &samples, 1.0);
    let covered = |p: Vector2<f64>| mask[p.y.round() as usize * camera.width + p.x.round() as usize] > 0;
    for s in &samples {
        assert!(!covered(s.pixel + s.normal * 1.0), "{:?}", s.pixel);
        assert!(covered(s.pixel - s.normal * 1.5), "the mesh lies behind the normal: {:?}", s.pixel);
    }
    let body_right = camera.project(&Vector3::new(1.0, 0.0, 5.0)).x;
    let of_part = samples.iter().filter(|s| s.vertices[0] >= 8);
    assert!(of_part.clone().count() > 20);
    assert!(of_part.into_iter().all(|s| s.pixel.x > body_right - 1.5));
    // the body's right side is hidden behind the part, or ends at it
    let (top, bottom) =
        (camera.project(&Vector3::new(1.0, -0.2, 4.0)).y, camera.project(&Vector3::new(1.0, 0.2, 4.0)).y);
    let hidden = |s: &&OutlineSample| s.vertices[1] < 8 && s.pixel.y > top + 1.5 && s.pixel.y < bottom - 1.5;
    assert!(samples.iter().filter(hidden).all(|s| s.pixel.x < body_right - 10.0));
}

#[test]
fn an_open_mesh_is_bounded_by_its_boundary() {
    let camera = camera();
    let sheet = [[-1.0, -0.5, 4.0], [1.0, -0.6, 5.0], [0.9, 0.7, 5.0], [-1.0, 0.4, 4.0]].map(Vector3::from);
    for faces in [[[0, 1, 2], [0, 2, 3]], [[0, 2, 1], [0, 3, 2]]] {
        let samples = sampled(&camera, &sheet, &faces, 1.0);
        let polygon = hull(&camera, &sheet);
        let length: f64 = samples.iter().map(|s| s.length).sum();
        assert!((length / perimeter(&polygon) - 1.0).abs() < 1e-9);
        assert!(samples.iter().all(|s| signed_distance(&polygon, &(s.pixel + s.normal * 0.5)) > 0.0));
    }
}

#[test]
fn an_outline_across_the_near_plane_stays_on_the_image_and_outward() {
    let camera = camera();
    let (points, faces) = cuboid(Vector3::new(-0.3, 0.1, -1.0), Vector3::new(0.3, 0.4, 6.0));
    let mask = drawn(&camera, &points, &faces);
    let samples = sampled(&camera, &points, &faces, 1.0);
    assert!(samples.len() > 20);
    check_samples(&camera, &points, &samples, 1.0);
    for s in &samples {
        let [a, b] = s.vertices.map(|v| points[v as usize].z);
        assert!(a + (b - a) * s.share_in_space(&points) >= NEAR_M - 1e-9);
        let behind = s.pixel - s.normal * 1.5;
        let at = Rect::image(&camera).index(behind.x.round() as i64, behind.y.round() as i64);
        assert!(at.is_none_or(|i| mask[i] > 0));
    }
}

#[test]
fn no_mesh_no_outline() {
    let (points, faces) = cuboid(Vector3::new(-1.0, -1.0, -4.0), Vector3::new(1.0, 1.0, -2.0));
    assert!(sampled(&camera(), &points, &faces, 1.0).is_empty());
    assert!(sampled(&camera(), &[Vector3::z(); 3], &[[0, 1, 2]], 1.0).is_empty());
}
