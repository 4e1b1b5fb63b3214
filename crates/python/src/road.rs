//! `road` of the core.

use meshslam_core::road::{RoadPatch, RoadTexture as CoreTexture};
use numpy::{PyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Floats1, Floats2, check_shape, pose, to_python, vector};
use crate::named::Camera;

/// The road's points that a camera sees, ready to be looked up in an earlier image.
#[pyclass(frozen, module = "meshslam._core")]
pub struct RoadTexture(CoreTexture);

#[pymethods]
impl RoadTexture {
    #[new]
    #[allow(clippy::too_many_arguments)] // the binding of one function
    fn new(
        py: Python,
        camera: Camera,
        images: (PyReadonlyArray2<u8>, PyReadonlyArray2<u8>),
        free: PyReadonlyArray2<u8>,
        first_from_second: Floats2,
        up: Floats1,
        height_m: f64,
        depths_m: (f64, f64),
        aside_m: f64,
        step_px: usize,
    ) -> PyResult<Self> {
        let Camera(camera) = camera;
        for (what, picture) in [("images", &images.0), ("images", &images.1), ("free", &free)] {
            check_shape(what, picture.shape(), &[Some(camera.height), Some(camera.width)])?;
        }
        let pixels = [&images.0, &images.1, &free].map(|picture| picture.as_slice());
        let [Ok(first), Ok(second), Ok(free)] = pixels else {
            return Err(PyValueError::new_err("pictures must be contiguous, row by row"));
        };
        let (min_distance_m, max_distance_m) = depths_m;
        let up = vector("up", &up)?;
        let patch = RoadPatch { up, height_m, min_distance_m, max_distance_m, aside_m, step_px };
        let moved = pose("first_from_second", &first_from_second)?;
        py.detach(|| CoreTexture::new(camera, [first, second], free, &moved, &patch)).map(Self).map_err(to_python)
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn correlations<'py>(&self, py: Python<'py>, lengths_m: Floats1) -> Bound<'py, PyArray1<f64>> {
        let lengths = lengths_m.as_array().to_vec();
        PyArray1::from_vec(py, py.detach(|| self.0.correlations(&lengths)))
    }
}
