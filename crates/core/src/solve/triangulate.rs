//! A point from its pixels in several views (paper, Sec. IV-C: L_kps alone, by Levenberg–Marquardt).

use nalgebra::{Matrix3, Vector2, Vector3};

use super::envelope::Envelope;
use super::levenberg_marquardt::{Options, Problem, covariance, levenberg_marquardt};
use crate::camera::Camera;
use crate::kernel::Kernel;
use crate::lie::Pose;
use crate::raster::NEAR_M;

/// One sight of the point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// The camera.
    pub camera: Camera,
    /// Where it stood.
    pub camera_from_world: Pose,
    /// The pixel seen.
    pub pixel: Vector2<f64>,
    /// Standard deviation of each coordinate, pixels.
    pub sigma_px: f64,
}

/// A point in the world from its pixels.
pub struct PointProblem<'a> {
    /// Where it was seen.
    pub sights: &'a [Sight],
    /// The robust kernel.
    pub kernel: Kernel,
}

impl PointProblem<'_> {
    /// Cost of a sight of a point that lies behind its camera: more than any in front of it.
    const BEHIND: f64 = 1e6;
}

impl Problem for PointProblem<'_> {
    type State = Vector3<f64>;

    fn cost(&mut self, point: &Vector3<f64>) -> f64 {
        let of = |s: &Sight| {
            let x = s.camera_from_world.transform(point);
            if x.z < NEAR_M {
                Self::BEHIND
            } else {
                0.5 * self.kernel.loss((s.camera.project(&x) - s.pixel).norm_squared() / (s.sigma_px * s.sigma_px))
            }
        };
        self.sights.iter().map(of).sum()
    }

    fn linearize(&mut self, point: &Vector3<f64>, hessian: &mut Envelope, gradient: &mut [f64]) -> f64 {
        for s in self.sights {
            let x = s.camera_from_world.transform(point);
            if x.z < NEAR_M {
                continue;
            }
            let gap = (s.camera.project(&x) - s.pixel) / s.sigma_px;
            let jacobian = s.camera.projection_jacobian(&x) * s.camera_from_world.rotation / s.sigma_px;
            let weight = self.kernel.weight(gap.norm_squared());
            let (h, g): (Matrix3<f64>, Vector3<f64>) =
                (jacobian.transpose() * jacobian * weight, jacobian.transpose() * gap * weight);
            for i in 0..3 {
                gradient[i] += g[i];
                for j in 0..=i {
                    hessian.add(i, j, h[(i, j)]);
                }
            }
        }
        self.cost(point)
    }

    fn retract(&self, point: &Vector3<f64>, step: &[f64]) -> Vector3<f64> {
        point + Vector3::new(step[0], step[1], step[2])
    }

    fn structure(&self) -> Envelope {
        Envelope::dense(3)
    }
}

/// The point that explains the sights best, with its covariance; none where they do not fix it.
///
/// The start is the point nearest to all rays; with fewer than two sights, or parallel rays, there is none.
#[must_use]
pub fn triangulate(sights: &[Sight], kernel: Kernel) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let start = nearest_to_rays(sights)?;
    let mut problem = PointProblem { sights, kernel };
    let (point, _) = levenberg_marquardt(&mut problem, start, &Options::default());
    let found = covariance(&mut problem, &point, &[0, 1, 2]).ok()?;
    let covariance = Matrix3::from_fn(|i, j| found[(i, j)]);
    let sane = point.iter().chain(covariance.iter()).all(|x| x.is_finite()) && covariance.diagonal().min() > 0.0;
    sane.then_some((point, covariance))
}

fn nearest_to_rays(sights: &[Sight]) -> Option<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for s in sights {
        let world_from_camera = s.camera_from_world.inverse();
        let y = (s.pixel.y - s.camera.cy) / s.camera.fy;
        let x = (s.pixel.x - s.camera.cx - s.camera.skew * y) / s.camera.fx;
        let direction = (world_from_camera.rotation * Vector3::new(x, y, 1.0)).normalize();
        let across = Matrix3::identity() - direction * direction.transpose();
        normal += across;
        right += across * world_from_camera.translation;
    }
    let smallest = normal.symmetric_eigenvalues().min();
    if sights.len() < 2 || smallest < 1e-8 {
        return None;
    }
    normal.try_inverse().map(|inverse| inverse * right)
}
