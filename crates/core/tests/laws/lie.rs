use std::f64::consts::PI;

use meshslam_core::lie::{Pose, exp_so3, hat, log_so3, right_jacobian, right_jacobian_inverse};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use proptest::prelude::*;

use crate::common::{axis_angle, pose, vector3};

fn tangent() -> impl Strategy<Value = Vector6<f64>> {
    (vector3(3.0), axis_angle()).prop_map(|(r, t)| Vector6::new(r.x, r.y, r.z, t.x, t.y, t.z))
}

fn close(a: &Pose, b: &Pose, tolerance: f64) -> bool {
    (a.rotation - b.rotation).amax() < tolerance && (a.translation - b.translation).amax() < tolerance
}

/// exp by its power series.
fn exp_by_series(theta: &Vector3<f64>) -> Matrix3<f64> {
    let (mut sum, mut term) = (Matrix3::identity(), Matrix3::identity());
    for k in 1..60 {
        term = term * hat(theta) / f64::from(k);
        sum += term;
    }
    sum
}

/// J_r by its power series, Σ (−hat)ᵏ / (k + 1)!.
fn right_jacobian_by_series(theta: &Vector3<f64>) -> Matrix3<f64> {
    let (mut sum, mut term) = (Matrix3::identity(), Matrix3::identity());
    for k in 1..60 {
        term = -term * hat(theta) / f64::from(k + 1);
        sum += term;
    }
    sum
}

proptest! {
    #[test]
    fn hat_is_the_cross_product(a in vector3(4.0), b in vector3(4.0)) {
        prop_assert!((hat(&a) * b - a.cross(&b)).amax() < 1e-12);
    }

    #[test]
    fn exp_is_the_power_series(theta in axis_angle()) {
        prop_assert!((exp_so3(&theta) - exp_by_series(&theta)).amax() < 1e-12);
    }

    #[test]
    fn exp_gives_rotations(theta in vector3(20.0)) {
        let r = exp_so3(&theta);
        prop_assert!((r.transpose() * r - Matrix3::identity()).amax() < 1e-12);
        prop_assert!((r.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn log_inverts_exp(theta in axis_angle()) {
        let back = log_so3(&exp_so3(&theta));
        prop_assert!(back.norm() <= PI + 1e-12);
        prop_assert!((exp_so3(&back) - exp_so3(&theta)).amax() < 1e-12);
        if theta.norm() < PI - 1e-6 {
            prop_assert!((back - theta).amax() < 1e-9 * (1.0 + 1e-3 / (PI - theta.norm())), "{back} {theta}");
        }
    }

    #[test]
    fn right_jacobian_is_the_power_series(theta in axis_angle()) {
        prop_assert!((right_jacobian(&theta) - right_jacobian_by_series(&theta)).amax() < 1e-12);
    }

    #[test]
    fn right_jacobian_is_the_derivative(theta in axis_angle(), direction in vector3(1.0)) {
        let h = 1e-5;
        let ends = [h, -h].map(|s| log_so3(&(exp_so3(&theta).transpose() * exp_so3(&(theta + direction * s)))));
        let slope = (ends[0] - ends[1]) / (2.0 * h);
        prop_assert!((slope - right_jacobian(&theta) * direction).amax() < 1e-8);
    }

    #[test]
    fn right_jacobian_inverse_inverts_it(theta in axis_angle(), scale in 0.0..1.9) {
        let theta = theta * scale;
        let product = right_jacobian(&theta) * right_jacobian_inverse(&theta);
        prop_assert!((product - Matrix3::identity()).amax() < 1e-9);
    }

    #[test]
    fn poses_are_a_group(a in pose(), b in pose(), c in pose(), x in vector3(5.0)) {
        prop_assert!(close(&a.compose(&b).compose(&c), &a.compose(&b.compose(&c)), 1e-11));
        prop_assert!(close(&a.compose(&a.inverse()), &Pose::identity(), 1e-11));
        prop_assert!(close(&a.inverse().compose(&a), &Pose::identity(), 1e-11));
        prop_assert!(close(&a.compose(&Pose::identity()), &a, 1e-15));
        prop_assert!(close(&Pose::identity().compose(&a), &a, 1e-15));
        prop_assert!((a.compose(&b).transform(&x) - a.transform(&b.transform(&x))).amax() < 1e-11);
    }

    #[test]
    fn pose_log_inverts_exp(xi in tangent()) {
        let pose = Pose::exp(&xi);
        prop_assert!(close(&Pose::exp(&pose.log()), &pose, 1e-9));
        if xi.fixed_rows::<3>(3).norm() < PI - 1e-3 {
            prop_assert!((pose.log() - xi).amax() < 1e-8);
        }
    }

    #[test]
    fn pose_exp_is_a_one_parameter_group(xi in tangent(), s in -1.0..1.0_f64) {
        let parts = Pose::exp(&(xi * s)).compose(&Pose::exp(&(xi * (1.0 - s))));
        prop_assert!(close(&parts, &Pose::exp(&xi), 1e-10));
    }

    #[test]
    fn adjoint_moves_a_perturbation_across(t in pose(), xi in tangent()) {
        let right = t.compose(&Pose::exp(&xi));
        let left = Pose::exp(&(t.adjoint() * xi)).compose(&t);
        prop_assert!(close(&right, &left, 1e-8));
    }

    #[test]
    fn adjoint_is_a_homomorphism(a in pose(), b in pose()) {
        prop_assert!((a.compose(&b).adjoint() - a.adjoint() * b.adjoint()).amax() < 1e-9);
        prop_assert!((a.adjoint() * a.inverse().adjoint() - Matrix6::identity()).amax() < 1e-9);
    }

    #[test]
    fn retract_moves_on_the_right(t in pose(), rho in vector3(2.0), phi in axis_angle()) {
        let moved = t.retract(&Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z));
        let expected = t.compose(&Pose { rotation: exp_so3(&phi), translation: rho });
        prop_assert!(close(&moved, &expected, 1e-11));
    }
}

#[test]
fn retract_stays_in_so3_over_many_steps() {
    let mut t = Pose::identity();
    for k in 0..100_000 {
        let s = f64::from(k % 17) * 0.01;
        t = t.retract(&Vector6::new(0.0, 0.0, 0.0, 0.3 - s, s, 0.1));
    }
    assert!((t.rotation.transpose() * t.rotation - Matrix3::identity()).amax() < 1e-14);
}

#[test]
fn log_at_exactly_pi_is_a_half_turn() {
    for axis in [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(1.0, 1.0, 0.0).normalize()] {
        let half_turn = 2.0 * axis * axis.transpose() - Matrix3::identity();
        let theta = log_so3(&half_turn);
        assert!((theta.norm() - PI).abs() < 1e-9);
        assert!((theta.normalize().dot(&axis).abs() - 1.0).abs() < 1e-12);
    }
}
