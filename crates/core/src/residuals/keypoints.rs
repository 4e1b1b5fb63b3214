//! Key points: y − Kπ(R_cᵀ(R_o V a + p_o − p_c)) (paper, Eq. 5, Proposition 2).

use nalgebra::Vector3;

use super::{Rows, Term};
use crate::camera::Camera;
use crate::kernel::Kernel;
use crate::lie::Pose;
use crate::raster::NEAR_M;
use crate::view::KeypointObservation;

/// How far the category's key points may lie from an instance's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionNoise {
    /// Standard deviation of each coordinate, metres.
    pub sigma_m: f64,
    /// In how many views the point is seen: all share one offset, so each tells one part in so many of it.
    pub views: u32,
}

/// Two rows for an observation: x, then y. `association` is the key point's column of A: (vertex, weight).
///
/// The offset of the category's key point adds to the pixel's sigma at the point's depth. n views of one offset τ with
/// pixel sigma σ tell of the point's place what n independent ones of variance σ² + nτ² would: the rows keep the kernel of
/// σ² + τ², and weigh (σ² + τ²)/(σ² + nτ²). A point behind the camera adds nothing.
#[allow(clippy::too_many_arguments)] // the arguments are the formula's
pub fn keypoint_rows(
    camera: &Camera,
    camera_from_object: &Pose,
    vertices: &[Vector3<f64>],
    association: &[(u32, f64)],
    observation: &KeypointObservation,
    position: PositionNoise,
    kernel: Kernel,
    rows: &mut Rows,
) {
    let in_object: Vector3<f64> = association.iter().map(|&(v, w)| vertices[v as usize] * w).sum();
    let in_camera = camera_from_object.transform(&in_object);
    if in_camera.z < NEAR_M {
        return;
    }
    let gap = camera.project(&in_camera) - observation.pixel;
    let jacobian = camera.projection_jacobian(&in_camera) * camera_from_object.rotation;
    let offset_px = position.sigma_m * camera.fx / in_camera.z;
    let sigma_px = observation.sigma_px.hypot(offset_px);
    let weight = (sigma_px / observation.sigma_px.hypot(f64::from(position.views).sqrt() * offset_px)).powi(2);
    for axis in 0..2 {
        let gradient = jacobian.row(axis).transpose() / sigma_px;
        let terms = association.iter().map(|&(vertex, w)| Term { vertex, gradient: gradient * w });
        rows.push(gap[axis] / sigma_px, weight, kernel, terms);
    }
}
