//! The pinhole camera.

use nalgebra::{Matrix2x3, Vector2, Vector3};

use crate::error::{Error, Result};

/// A pinhole camera with skew: x right, y down, z forward; pixel (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point, x.
    pub cx: f64,
    /// Principal point, y.
    pub cy: f64,
    /// Skew, pixels: the entry K₀₁.
    pub skew: f64,
}

impl Camera {
    /// Check the values.
    ///
    /// # Errors
    /// [`Error::NotFinite`] or [`Error::Range`] if a value has no meaning.
    pub fn checked(self) -> Result<Self> {
        crate::error::check_finite("camera intrinsics", &[self.fx, self.fy, self.cx, self.cy, self.skew])?;
        let smallest = self.fx.min(self.fy);
        if smallest <= 0.0 {
            return Err(Error::Range { what: "focal length", expected: "positive", found: smallest });
        }
        Ok(self)
    }

    /// Pixel of a point in the camera's frame, y = K π(γ); the caller keeps γ₃ away from 0.
    #[must_use]
    pub fn project(&self, point_in_camera: &Vector3<f64>) -> Vector2<f64> {
        let (x, y) = (point_in_camera.x / point_in_camera.z, point_in_camera.y / point_in_camera.z);
        Vector2::new(self.fx * x + self.skew * y + self.cx, self.fy * y + self.cy)
    }

    /// Derivative of [`Camera::project`] (paper, Proposition 2: K ∂π/∂x).
    #[must_use]
    pub fn projection_jacobian(&self, point_in_camera: &Vector3<f64>) -> Matrix2x3<f64> {
        let inverse_depth = 1.0 / point_in_camera.z;
        let (x, y) = (point_in_camera.x * inverse_depth, point_in_camera.y * inverse_depth);
        Matrix2x3::new(self.fx, self.skew, -(self.fx * x + self.skew * y), 0.0, self.fy, -self.fy * y) * inverse_depth
    }
}
