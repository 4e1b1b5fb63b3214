//! `tracks` of the core.

use meshslam_core::lie::Pose;
use meshslam_core::tracks::TrackedPoints as CoreTracks;
use nalgebra::{Matrix3, Vector2, Vector3};
use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{check_shape, to_python};
use crate::named::Camera;

/// Hessian, gradient, cost.
type NormalEquations<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, f64);
/// Points as rows, and whether each is at a finite distance.
type Points<'py> = (Bound<'py, PyArray2<f64>>, Vec<bool>);

#[pyclass(frozen, module = "meshslam._core")]
pub struct TrackedPoints(CoreTracks);

/// Matrices (m, 4, 4), finite.
fn poses(matrices: &PyReadonlyArray3<f64>) -> PyResult<Vec<Pose>> {
    check_shape("world_from_camera", matrices.shape(), &[None, Some(4), Some(4)])?;
    let found: Vec<Pose> = matrices
        .as_array()
        .outer_iter()
        .map(|m| Pose { rotation: Matrix3::from_fn(|i, j| m[[i, j]]), translation: Vector3::from_fn(|i, _| m[[i, 3]]) })
        .collect();
    if found.iter().any(|p| !p.rotation.iter().chain(p.translation.iter()).all(|x| x.is_finite())) {
        return Err(PyValueError::new_err("world_from_camera must be finite"));
    }
    Ok(found)
}

#[pymethods]
impl TrackedPoints {
    #[new]
    fn new(camera: Camera, tracks: Vec<PyReadonlyArray3<f64>>, sigma_px: f64, kernel: f64) -> PyResult<Self> {
        let Camera(camera) = camera;
        let mut groups = Vec::with_capacity(tracks.len());
        for pixels in &tracks {
            check_shape("tracks", pixels.shape(), &[None, None, Some(2)])?;
            let array = pixels.as_array();
            let rows = array
                .outer_iter()
                .flat_map(|track| track.outer_iter().map(|pixel| Vector2::new(pixel[0], pixel[1])).collect::<Vec<_>>());
            groups.push((pixels.shape()[1], rows.collect()));
        }
        CoreTracks::new(camera, sigma_px, kernel, groups).map(Self).map_err(to_python)
    }

    /// The tracks (n, m, 2) as they were given.
    fn tracks<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray3<f64>>>> {
        let each = self.0.groups().map(|(length, pixels)| {
            let values: Vec<f64> = pixels.iter().flat_map(|pixel| [pixel.x, pixel.y]).collect();
            let shape = (pixels.len() / length.max(1), length, 2);
            let tracks = Array3::from_shape_vec(shape, values).map_err(|e| PyValueError::new_err(e.to_string()))?;
            Ok(tracks.into_pyarray(py))
        });
        each.collect()
    }

    fn cost(&self, py: Python, world_from_camera: PyReadonlyArray3<f64>) -> PyResult<f64> {
        let cameras = poses(&world_from_camera)?;
        py.detach(|| self.0.cost(&cameras)).map_err(to_python)
    }

    fn normal_equations<'py>(
        &self,
        py: Python<'py>,
        world_from_camera: PyReadonlyArray3<f64>,
    ) -> PyResult<NormalEquations<'py>> {
        let cameras = poses(&world_from_camera)?;
        let found = py.detach(|| self.0.normal_equations(&cameras)).map_err(to_python)?;
        let width = found.gradient.len();
        let hessian =
            Array2::from_shape_vec((width, width), found.hessian).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok((hessian.into_pyarray(py), PyArray1::from_vec(py, found.gradient), found.cost))
    }

    fn points<'py>(&self, py: Python<'py>, world_from_camera: PyReadonlyArray3<f64>) -> PyResult<Points<'py>> {
        let cameras = poses(&world_from_camera)?;
        let found = py.detach(|| self.0.points(&cameras)).map_err(to_python)?;
        let values: Vec<f64> = found.iter().flat_map(|(p, _)| [p.x, p.y, p.z]).collect();
        let rows =
            Array2::from_shape_vec((found.len(), 3), values).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok((rows.into_pyarray(py), found.iter().map(|(_, is_finite)| *is_finite).collect()))
    }
}
