//! An object with what was seen of it, as it comes from Python.

use meshslam_core::object::{Block, Model, ObjectState as CoreState, Scope};
use meshslam_core::residuals::ground::Ground;
use meshslam_core::view::View as CoreView;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Floats1, Floats2, pose, vector};
use crate::named::{GroundPlane, NoiseModel};
use crate::view::{View, core_views};

/// Views, ground and noise of one object, which blocks of it move, and its state.
#[pyclass(frozen)]
pub struct Problem {
    views: Vec<Py<View>>,
    pub ground: Option<Ground>,
    pub model: Model,
    pub scope: Scope,
    pub state: CoreState,
}

#[pymethods]
impl Problem {
    #[new]
    #[pyo3(signature = (*, views, ground, noise, modes, free_form, velocity, state))]
    fn new(
        views: Vec<Py<View>>,
        ground: Option<GroundPlane>,
        noise: NoiseModel,
        modes: bool,
        free_form: bool,
        velocity: bool,
        state: Bound<ObjectState>,
    ) -> Self {
        let (ground, scope) = (ground.map(|ground| ground.0), Scope { modes, free_form, velocity });
        Self { views, ground, model: noise.0, scope, state: state.get().inner.clone() }
    }
}

impl Problem {
    pub fn views(&self) -> Vec<&CoreView> {
        core_views(&self.views)
    }
}

/// An object's state.
#[pyclass(frozen)]
pub struct ObjectState {
    pub inner: CoreState,
}

#[pymethods]
impl ObjectState {
    #[new]
    #[pyo3(signature = (*, world_from_object, z, d, velocity))]
    fn new(world_from_object: Floats2, z: Floats1, d: Floats1, velocity: Floats1) -> PyResult<Self> {
        let inner = CoreState {
            world_from_object: pose("world_from_object", &world_from_object)?,
            z: z.as_array().to_vec(),
            d: d.as_array().to_vec(),
            velocity: vector("velocity", &velocity)?,
        };
        Ok(Self { inner })
    }
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
