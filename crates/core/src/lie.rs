//! SO(3) and SE(3).
//!
//! Tangent vectors of SE(3) are (translation, rotation). Perturbations act on the right.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Below this angle the closed forms lose digits to cancellation and their Taylor series take over.
const SMALL_ANGLE: f64 = 1e-4;

/// The skew-symmetric matrix with `hat(a) b = a × b`.
#[must_use]
pub fn hat(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Coefficients sin θ/θ, (1 − cos θ)/θ², (θ − sin θ)/θ³ of the exponential map and its Jacobians.
fn coefficients(angle: f64) -> (f64, f64, f64) {
    let squared = angle * angle;
    if angle < SMALL_ANGLE {
        (1.0 - squared / 6.0, 0.5 - squared / 24.0, 1.0 / 6.0 - squared / 120.0)
    } else {
        let half = (0.5 * angle).sin();
        (angle.sin() / angle, 2.0 * half * half / squared, (angle - angle.sin()) / (squared * angle))
    }
}

/// Rotation by the axis-angle vector θ (Rodrigues).
#[must_use]
pub fn exp_so3(theta: &Vector3<f64>) -> Matrix3<f64> {
    let (a, b, _) = coefficients(theta.norm());
    let k = hat(theta);
    Matrix3::identity() + k * a + k * k * b
}

/// Axis-angle vector of a rotation, of length at most π; exact also near π, by the quaternion.
#[must_use]
pub fn log_so3(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let q = quaternion(rotation);
    let (w, v) = (q[0], Vector3::new(q[1], q[2], q[3]));
    let sine = v.norm();
    if sine < 1e-10 {
        return v * (2.0 / w);
    }
    v * (2.0 * sine.atan2(w) / sine)
}

/// Unit quaternion (w ≥ 0, x, y, z) by the numerically largest component (Shepperd 1978).
fn quaternion(r: &Matrix3<f64>) -> [f64; 4] {
    let trace = r.trace();
    let candidates = [trace, r[(0, 0)], r[(1, 1)], r[(2, 2)]];
    let largest = (0..4).fold(0, |best, i| if candidates[i] > candidates[best] { i } else { best });
    let off = [r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]];
    let mut q = [0.0; 4];
    if largest == 0 {
        q = [1.0 + trace, off[0], off[1], off[2]];
    } else {
        let i = largest - 1;
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        q[0] = off[i];
        q[i + 1] = 1.0 + 2.0 * r[(i, i)] - trace;
        q[j + 1] = r[(i, j)] + r[(j, i)];
        q[k + 1] = r[(i, k)] + r[(k, i)];
    }
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt().copysign(q[0]);
    q.map(|x| x / norm)
}

/// Right Jacobian of SO(3): `exp(θ + δ) ≈ exp(θ) exp(J_r(θ) δ)` (paper, Proposition 2).
#[must_use]
pub fn right_jacobian(theta: &Vector3<f64>) -> Matrix3<f64> {
    let (_, b, c) = coefficients(theta.norm());
    let k = hat(theta);
    Matrix3::identity() - k * b + k * k * c
}

/// Inverse of [`right_jacobian`], for |θ| < 2π.
#[must_use]
pub fn right_jacobian_inverse(theta: &Vector3<f64>) -> Matrix3<f64> {
    let angle = theta.norm();
    let k = hat(theta);
    let c = if angle < SMALL_ANGLE {
        1.0 / 12.0 + angle * angle / 720.0
    } else {
        (1.0 - 0.5 * angle / (0.5 * angle).tan()) / (angle * angle)
    };
    Matrix3::identity() + k * 0.5 + k * k * c
}

/// A rigid transform, named `a_from_b`: it takes coordinates in b to coordinates in a.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation part.
    pub rotation: Matrix3<f64>,
    /// Translation part, metres.
    pub translation: Vector3<f64>,
}

impl Pose {
    /// The transform that changes nothing.
    #[must_use]
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// Exponential map of a tangent vector (translation, rotation).
    #[must_use]
    pub fn exp(xi: &Vector6<f64>) -> Self {
        let (rho, theta) = (xi.fixed_rows::<3>(0).into_owned(), xi.fixed_rows::<3>(3).into_owned());
        Self { rotation: exp_so3(&theta), translation: right_jacobian(&-theta) * rho }
    }

    /// Logarithm, the inverse of [`Pose::exp`] for rotations under π.
    #[must_use]
    pub fn log(&self) -> Vector6<f64> {
        let theta = log_so3(&self.rotation);
        let rho = right_jacobian_inverse(&-theta) * self.translation;
        Vector6::new(rho.x, rho.y, rho.z, theta.x, theta.y, theta.z)
    }

    /// `a_from_b * b_from_c = a_from_c`.
    #[must_use]
    pub fn compose(&self, other: &Self) -> Self {
        Self { rotation: self.rotation * other.rotation, translation: self.transform(&other.translation) }
    }

    /// `b_from_a` of this `a_from_b`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// Take a point from b to a.
    #[must_use]
    pub fn transform(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }

    /// Move by a right perturbation (translation, rotation): `(R, p) -> (R exp(φ), p + R ρ)`.
    #[must_use]
    pub fn retract(&self, step: &Vector6<f64>) -> Self {
        let (rho, phi) = (step.fixed_rows::<3>(0).into_owned(), step.fixed_rows::<3>(3).into_owned());
        let rotation = orthonormal(&(self.rotation * exp_so3(&phi)));
        Self { rotation, translation: self.translation + self.rotation * rho }
    }

    /// The adjoint: `T exp(ξ) = exp(Ad ξ) T`.
    #[must_use]
    pub fn adjoint(&self) -> Matrix6<f64> {
        let mut out = Matrix6::zeros();
        out.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.rotation);
        out.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.rotation);
        out.fixed_view_mut::<3, 3>(0, 3).copy_from(&(hat(&self.translation) * self.rotation));
        out
    }
}

/// One Gram–Schmidt pass, so that many small steps do not let a rotation drift from SO(3).
fn orthonormal(r: &Matrix3<f64>) -> Matrix3<f64> {
    let x = r.column(0).normalize();
    let y = r.column(1) - x * x.dot(&r.column(1));
    let y = y.normalize();
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}
