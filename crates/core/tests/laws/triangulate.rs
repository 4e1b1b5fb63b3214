use meshslam_core::kernel::Kernel;
use meshslam_core::lie::Pose;
use meshslam_core::solve::triangulate::{Sight, triangulate};
use nalgebra::{Matrix3, Vector2, Vector3};

use crate::common::{Random, camera, looking};

pub fn sights(random: &mut Random, point: &Vector3<f64>, count: usize, sigma_px: f64) -> Vec<Sight> {
    (0..count)
        .map(|k| {
            let angle = 0.25 * k as f64 + random.uniform(-0.05, 0.05);
            let from = Vector3::new(8.0 * angle.cos(), 8.0 * angle.sin(), random.uniform(0.5, 2.0));
            let camera_from_world = looking(from, random.vector(0.5)).inverse();
            let pixel = camera().project(&camera_from_world.transform(point));
            Sight { camera: camera(), camera_from_world, pixel, sigma_px }
        })
        .collect()
}

#[test]
fn exact_pixels_give_the_point() {
    let mut random = Random(1);
    for count in 2..9 {
        let point = random.vector(1.0);
        for kernel in [Kernel::Squared, Kernel::Cauchy(2.0)] {
            let (found, _) = triangulate(&sights(&mut random, &point, count, 1.0), kernel).unwrap();
            assert!((found - point).norm() < 1e-6, "{found} {point}");
        }
    }
}

#[test]
fn the_covariance_is_that_of_the_noise() {
    let mut random = Random(2);
    let point = Vector3::new(0.2, -0.1, 0.4);
    let clean = sights(&mut random, &point, 5, 0.5);
    let normal =
        |r: &mut Random| (-2.0 * r.uniform(1e-12, 1.0).ln()).sqrt() * (r.uniform(0.0, std::f64::consts::TAU)).cos();
    let (mut scatter, rounds) = (Matrix3::zeros(), 800);
    let mut claimed = Matrix3::zeros();
    for _ in 0..rounds {
        let noisy: Vec<Sight> = clean
            .iter()
            .map(|s| Sight { pixel: s.pixel + Vector2::new(normal(&mut random), normal(&mut random)) * 0.5, ..*s })
            .collect();
        let (found, covariance) = triangulate(&noisy, Kernel::Squared).unwrap();
        scatter += (found - point) * (found - point).transpose() / f64::from(rounds);
        claimed += covariance / f64::from(rounds);
    }
    for axis in 0..3 {
        let ratio = scatter[(axis, axis)] / claimed[(axis, axis)];
        assert!((0.8..1.25).contains(&ratio), "{ratio}");
    }
}

#[test]
fn the_covariance_grows_with_the_square_of_the_noise_and_falls_with_views() {
    let mut random = Random(3);
    let point = Vector3::new(0.1, 0.3, 0.2);
    let few = sights(&mut random, &point, 3, 1.0);
    let many = [few.clone(), sights(&mut random, &point, 4, 1.0)].concat();
    let loud: Vec<Sight> = few.iter().map(|s| Sight { sigma_px: 3.0, ..*s }).collect();
    let covariance = |s: &[Sight]| triangulate(s, Kernel::Squared).unwrap().1;
    assert!((covariance(&loud) - covariance(&few) * 9.0).amax() < 1e-6 * covariance(&loud).amax());
    assert!((covariance(&few) - covariance(&many)).symmetric_eigenvalues().min() > 0.0);
    assert!((covariance(&few) - covariance(&few).transpose()).amax() < 1e-15);
}

#[test]
fn one_outlier_does_not_move_a_robust_point() {
    let mut random = Random(4);
    let point = Vector3::new(-0.3, 0.3, 0.2);
    let mut seen = sights(&mut random, &point, 8, 1.0);
    seen[3].pixel.x += 60.0;
    let error = |kernel| (triangulate(&seen, kernel).unwrap().0 - point).norm();
    assert!(error(Kernel::Cauchy(2.0)) < 0.01, "{}", error(Kernel::Cauchy(2.0)));
    assert!(error(Kernel::Squared) > 0.05);
}

#[test]
fn rays_that_fix_no_point_give_none() {
    let mut random = Random(5);
    let point = Vector3::new(0.3, 0.1, 0.2);
    let one = sights(&mut random, &point, 1, 1.0);
    assert!(triangulate(&[], Kernel::Squared).is_none());
    assert!(triangulate(&one, Kernel::Squared).is_none());
    assert!(triangulate(&[one[0], one[0], one[0]], Kernel::Squared).is_none());
    // rays that part in front of the cameras and would meet behind them
    let apart = |x: f64, u: f64| Sight {
        camera: camera(),
        camera_from_world: Pose { rotation: Matrix3::identity(), translation: Vector3::new(-x, 0.0, 0.0) },
        pixel: Vector2::new(camera().cx + u, camera().cy),
        sigma_px: 1.0,
    };
    assert!(triangulate(&[apart(-1.0, -40.0), apart(1.0, 40.0)], Kernel::Squared).is_none());
    assert!(triangulate(&[apart(-1.0, 0.0), apart(1.0, 0.0)], Kernel::Squared).is_none());
}
