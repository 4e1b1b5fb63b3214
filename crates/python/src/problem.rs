//! An object with what was seen of it, as it comes from Python.

use meshslam_core::kernel::Kernel;
use meshslam_core::object::{Block, Model, ObjectState, Scope};
use meshslam_core::residuals::border::BorderNoise;
use meshslam_core::residuals::ground::Ground;
use meshslam_core::view::View as CoreView;
use nalgebra::Vector3;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Floats1, Floats2, pose, vector};
use crate::view::{View, core_views};

/// (border sigma px, correlation px, border kernel k, cap px, outline step px, key point position sigma m, key point kernel k, free-form sigma m, smoothness sigma m).
pub type ModelTuple = (f64, f64, f64, f64, f64, f64, f64, f64, f64);
/// Which blocks move: modes, free form, velocity.
type ScopeTuple = (bool, bool, bool);
/// (normal, offset m, height sigma m, tilt sigma rad).
type GroundTuple = ([f64; 3], f64, f64, f64);

/// Views, ground, model, scope and state: world_from_object, z, d, velocity.
#[derive(FromPyObject)]
pub struct Problem<'py>(
    Vec<Bound<'py, View>>,
    Option<GroundTuple>,
    ModelTuple,
    ScopeTuple,
    Floats2<'py>,
    Floats1<'py>,
    Floats1<'py>,
    Floats1<'py>,
);

/// The same for the core.
pub struct Given<'a> {
    pub views: Vec<&'a CoreView>,
    pub ground: Option<Ground>,
    pub model: Model,
    pub scope: Scope,
    pub state: ObjectState,
}

impl Problem<'_> {
    pub fn given(&self) -> PyResult<Given<'_>> {
        let Self(views, ground_values, model_values, (modes, free_form, velocity), pose, z, d, speed) = self;
        Ok(Given {
            views: core_views(views),
            ground: ground(*ground_values)?,
            model: model(*model_values)?,
            scope: Scope { modes: *modes, free_form: *free_form, velocity: *velocity },
            state: state(pose, z, d, speed)?,
        })
    }
}

pub fn model(values: ModelTuple) -> PyResult<Model> {
    let (
        sigma_px,
        correlation_px,
        border_k,
        cap_px,
        outline_step_px,
        keypoint_position_sigma_m,
        keypoint_k,
        free_form_sigma_m,
        smoothness_sigma_m,
    ) = values;
    let positive = [
        sigma_px,
        correlation_px,
        border_k,
        cap_px,
        outline_step_px,
        keypoint_k,
        free_form_sigma_m,
        smoothness_sigma_m,
    ];
    if positive.iter().any(|x| !(x.is_finite() && *x > 0.0))
        || keypoint_position_sigma_m.is_nan()
        || keypoint_position_sigma_m < 0.0
    {
        return Err(PyValueError::new_err(format!(
            "every sigma, length and threshold of the model must be positive, found {values:?}"
        )));
    }
    Ok(Model {
        border: BorderNoise { sigma_px, correlation_px, kernel: Kernel::Huber(border_k), cap_px },
        outline_step_px,
        keypoint_position_sigma_m,
        keypoint_kernel: Kernel::GemanMcClure(keypoint_k),
        free_form_sigma_m,
        smoothness_sigma_m,
    })
}

fn ground(values: Option<GroundTuple>) -> PyResult<Option<Ground>> {
    let Some((normal, offset_m, height_sigma_m, tilt_sigma_rad)) = values else { return Ok(None) };
    let normal = Vector3::from(normal);
    let unit = (normal.norm() - 1.0).abs() <= 1e-6;
    if !(unit && offset_m.is_finite() && height_sigma_m > 0.0 && tilt_sigma_rad > 0.0) {
        return Err(PyValueError::new_err(format!(
            "the ground needs a unit normal, a finite offset and positive sigmas, found {values:?}"
        )));
    }
    Ok(Some(Ground { normal, offset_m, height_sigma_m, tilt_sigma_rad }))
}

pub fn state(world_from_object: &Floats2, z: &Floats1, d: &Floats1, velocity: &Floats1) -> PyResult<ObjectState> {
    Ok(ObjectState {
        world_from_object: pose("world_from_object", world_from_object)?,
        z: z.as_array().to_vec(),
        d: d.as_array().to_vec(),
        velocity: vector("velocity", velocity)?,
    })
}

/// The block of a name, which must be among those that are estimated.
pub fn block(name: &str, scope: Scope) -> PyResult<Block> {
    let (block, estimated) = match name {
        "pose" => (Block::Pose, true),
        "modes" => (Block::Modes, scope.modes),
        "free_form" => (Block::FreeForm, scope.free_form),
        "velocity" => (Block::Velocity, scope.velocity),
        _ => {
            let expected = "expected pose, modes, free_form or velocity";
            return Err(PyValueError::new_err(format!("no block of parameters is called {name:?}: {expected}")));
        }
    };
    if !estimated {
        return Err(PyValueError::new_err(format!("{name} is not estimated, so it has no covariance")));
    }
    Ok(block)
}
