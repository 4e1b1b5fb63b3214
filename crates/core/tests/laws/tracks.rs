use meshslam_core::lie::{Pose, exp_so3};
use meshslam_core::tracks::TrackedPoints;
use nalgebra::{DMatrix, Vector2, Vector3, Vector6};

use crate::common::{Random, camera};

/// Cameras that look along z and come ahead, turning a little.
fn ride(random: &mut Random, count: usize) -> Vec<Pose> {
    (0..count)
        .map(|k| Pose {
            rotation: exp_so3(&random.vector(0.02)),
            translation: Vector3::new(0.05, 0.02, 1.1) * k as f64,
        })
        .collect()
}

/// Tracks of points before all cameras, each pixel moved by up to `noise_px`.
fn tracks(random: &mut Random, cameras: &[Pose], count: usize, noise_px: f64) -> (usize, Vec<Vector2<f64>>) {
    let mut pixels = Vec::new();
    for _ in 0..count {
        let point = Vector3::new(random.uniform(-8.0, 8.0), random.uniform(-3.0, 1.5), random.uniform(12.0, 60.0));
        for pose in cameras {
            let noise = Vector2::new(random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0)) * noise_px;
            pixels.push(camera().project(&pose.inverse().transform(&point)) + noise);
        }
    }
    (cameras.len(), pixels)
}

#[test]
fn exact_tracks_cost_nothing_and_draw_nowhere() {
    let mut random = Random(1);
    let cameras = ride(&mut random, 5);
    let group = tracks(&mut random, &cameras, 30, 0.0);
    let points = TrackedPoints::new(camera(), 0.7, 2.0, vec![group]).unwrap();
    let found = points.normal_equations(&cameras).unwrap();
    assert!(found.cost < 1e-12, "{}", found.cost);
    assert!(found.gradient.iter().all(|x| x.abs() < 1e-4));
    assert!(points.points(&cameras).unwrap().iter().all(|(_, is_finite)| *is_finite));
}

#[test]
fn a_similarity_of_all_cameras_changes_no_cost() {
    let mut random = Random(2);
    let cameras = ride(&mut random, 6);
    let groups = vec![tracks(&mut random, &cameras[..3], 20, 0.8), tracks(&mut random, &cameras, 20, 0.8)];
    let points = TrackedPoints::new(camera(), 0.7, 2.0, groups).unwrap();
    let cost = points.cost(&cameras).unwrap();
    for scale in [0.3, 1.0, 2.5] {
        let moved = Pose { rotation: exp_so3(&random.vector(2.0)), translation: random.vector(30.0) };
        let others: Vec<Pose> = cameras
            .iter()
            .map(|c| moved.compose(&Pose { rotation: c.rotation, translation: c.translation * scale }))
            .collect();
        let other = points.cost(&others).unwrap();
        assert!((other / cost - 1.0).abs() < 1e-6, "{other} {cost}");
    }
}

#[test]
fn the_hessian_has_no_negative_direction_and_seven_that_are_free() {
    let mut random = Random(3);
    for noise_px in [0.1, 5.0, 300.0] {
        let cameras = ride(&mut random, 5);
        let group = tracks(&mut random, &cameras, 40, noise_px);
        let points = TrackedPoints::new(camera(), 0.7, 2.0, vec![group]).unwrap();
        let found = points.normal_equations(&cameras).unwrap();
        let sizes = DMatrix::from_row_slice(30, 30, &found.hessian).symmetric_eigenvalues();
        let largest = sizes.max();
        assert!(sizes.min() > -1e-12 * largest, "{} of {largest}", sizes.min());
        if noise_px < 1.0 {
            assert!(sizes.iter().filter(|size| **size < 1e-7 * largest).count() == 7, "{sizes}");
        }
    }
}

#[test]
fn the_gradient_is_that_of_the_cost_where_no_track_is_wild() {
    let mut random = Random(4);
    let cameras = ride(&mut random, 4);
    let group = tracks(&mut random, &cameras, 25, 0.5);
    let points = TrackedPoints::new(camera(), 0.7, 1e6, vec![group]).unwrap();
    let found = points.normal_equations(&cameras).unwrap();
    let largest = found.gradient.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    for (k, gradient) in found.gradient.iter().enumerate() {
        let cost = |sign: f64| {
            let mut moved = cameras.clone();
            let mut step = Vector6::zeros();
            step[k % 6] = sign * 1e-6;
            moved[k / 6] = moved[k / 6].compose(&Pose::exp(&step));
            points.cost(&moved).unwrap()
        };
        let numeric = (cost(1.0) - cost(-1.0)) / 2e-6;
        assert!((gradient - numeric).abs() < 2e-2 * gradient.abs() + 2e-3 * largest, "{k}: {gradient} {numeric}");
    }
}

#[test]
fn cameras_of_any_kind_give_finite_numbers() {
    let mut random = Random(5);
    let still = vec![Pose::identity(); 3];
    let group = tracks(&mut random, &still, 10, 1.0);
    let points = TrackedPoints::new(camera(), 0.7, 2.0, vec![group]).unwrap();
    let behind = Pose { rotation: exp_so3(&Vector3::new(0.0, 3.0, 0.0)), translation: Vector3::new(0.0, 0.0, 90.0) };
    let far = Pose { rotation: still[0].rotation, translation: Vector3::repeat(1e15) };
    for cameras in [still.clone(), vec![still[0], behind, behind], vec![far, still[0], behind]] {
        let found = points.normal_equations(&cameras).unwrap();
        assert!(found.cost.is_finite() && found.hessian.iter().chain(&found.gradient).all(|x| x.is_finite()));
    }
}
