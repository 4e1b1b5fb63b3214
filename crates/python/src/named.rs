//! Values that cross from Python by the names of their attributes: any object that has them will do.

use meshslam_core::camera::Camera as CoreCamera;
use meshslam_core::kernel::Kernel;
use meshslam_core::object::Model;
use meshslam_core::residuals::border::BorderNoise;
use meshslam_core::residuals::ground::Ground as CoreGround;
use nalgebra::Vector3;
use pyo3::exceptions::{PyAttributeError, PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::convert::to_python;

/// An argument that is read by the names of its fields and then checked.
macro_rules! named {
    ($name:ident, $whose:literal, $fields:ident => $core:ty, $check:path) => {
        #[doc = concat!("The core's value of ", $whose, ".")]
        pub struct $name(pub $core);

        impl<'py> FromPyObject<'_, 'py> for $name {
            type Error = PyErr;

            fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
                let fields: $fields = given.extract().map_err(|error| misnamed(given, $whose, error))?;
                $check(fields).map(Self)
            }
        }
    };
}

/// A missing attribute as an error that says whose it is.
fn misnamed(given: Borrowed<PyAny>, whose: &str, error: PyErr) -> PyErr {
    let py = given.py();
    if error.is_instance_of::<PyAttributeError>(py) {
        return PyTypeError::new_err(format!("{whose} is not complete: {}", error.value(py)));
    }
    error
}

#[derive(FromPyObject)]
struct CameraFields {
    width: usize,
    height: usize,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    skew: f64,
}

fn camera(CameraFields { width, height, fx, fy, cx, cy, skew }: CameraFields) -> PyResult<CoreCamera> {
    CoreCamera { width, height, fx, fy, cx, cy, skew }.checked().map_err(to_python)
}

named!(Camera, "a camera", CameraFields => CoreCamera, camera);

#[derive(FromPyObject)]
struct NoiseFields {
    border_sigma_px: f64,
    border_correlation_px: f64,
    border_kernel: f64,
    border_cap_px: f64,
    outline_step_px: f64,
    keypoint_position_sigma_m: f64,
    keypoint_kernel: f64,
    free_form_sigma_m: f64,
    smoothness_sigma_m: f64,
}

fn model(noise: NoiseFields) -> PyResult<Model> {
    let positive = [
        ("border_sigma_px", noise.border_sigma_px),
        ("border_correlation_px", noise.border_correlation_px),
        ("border_kernel", noise.border_kernel),
        ("border_cap_px", noise.border_cap_px),
        ("outline_step_px", noise.outline_step_px),
        ("keypoint_kernel", noise.keypoint_kernel),
        ("free_form_sigma_m", noise.free_form_sigma_m),
        ("smoothness_sigma_m", noise.smoothness_sigma_m),
    ];
    if let Some((name, value)) = positive.iter().find(|(_, x)| !(x.is_finite() && *x > 0.0)) {
        return Err(PyValueError::new_err(format!("the noise model's {name} must be positive, found {value}")));
    }
    let position = noise.keypoint_position_sigma_m;
    if position.is_nan() || position < 0.0 {
        let what = "the noise model's keypoint_position_sigma_m must not be negative";
        return Err(PyValueError::new_err(format!("{what}, found {position}")));
    }
    Ok(Model {
        border: BorderNoise {
            sigma_px: noise.border_sigma_px,
            correlation_px: noise.border_correlation_px,
            kernel: Kernel::Huber(noise.border_kernel),
            cap_px: noise.border_cap_px,
        },
        outline_step_px: noise.outline_step_px,
        keypoint_position_sigma_m: position,
        keypoint_kernel: Kernel::GemanMcClure(noise.keypoint_kernel),
        free_form_sigma_m: noise.free_form_sigma_m,
        smoothness_sigma_m: noise.smoothness_sigma_m,
    })
}

named!(NoiseModel, "a noise model", NoiseFields => Model, model);

#[derive(FromPyObject)]
struct GroundFields {
    normal: [f64; 3],
    offset_m: f64,
    height_sigma_m: f64,
    tilt_sigma_rad: f64,
}

fn ground(GroundFields { normal, offset_m, height_sigma_m, tilt_sigma_rad }: GroundFields) -> PyResult<CoreGround> {
    let normal = Vector3::from(normal);
    let unit = (normal.norm() - 1.0).abs() <= 1e-6;
    if !(unit && offset_m.is_finite() && height_sigma_m > 0.0 && tilt_sigma_rad > 0.0) {
        return Err(PyValueError::new_err(format!(
            "the ground needs a unit normal, a finite offset and positive sigmas, found normal {:?}, offset_m {offset_m}, \
             height_sigma_m {height_sigma_m}, tilt_sigma_rad {tilt_sigma_rad}",
            normal.as_slice()
        )));
    }
    Ok(CoreGround { normal, offset_m, height_sigma_m, tilt_sigma_rad })
}

named!(GroundPlane, "a ground plane", GroundFields => CoreGround, ground);
