//! `lie`, `mesh`, `voxel` and `solve::triangulate` of the core.

use meshslam_core::error::check_finite;
use meshslam_core::kernel::Kernel;
use meshslam_core::mesh::Topology;
use meshslam_core::solve::triangulate::{Sight, triangulate as core_triangulate};
use meshslam_core::{lie, mesh, voxel};
use nalgebra::Matrix3;
use numpy::ndarray::{Array2, Array3, ArrayView2};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Floats1, Floats2, Ints2, check_shape, faces, pixels, point_rows, points, pose, to_python};
use crate::named::Camera;

fn matrix3<'py>(py: Python<'py>, m: &Matrix3<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows: Vec<Vec<f64>> = (0..3).map(|i| (0..3).map(|j| m[(i, j)]).collect()).collect();
    Ok(PyArray2::from_vec2(py, &rows)?)
}

/// Matrices (n, 3, 3).
fn matrices<'py>(py: Python<'py>, found: &[Matrix3<f64>]) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let values: Vec<f64> = found.iter().flat_map(|m| m.transpose().iter().copied().collect::<Vec<_>>()).collect();
    let array =
        Array3::from_shape_vec((found.len(), 3, 3), values).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(array.into_pyarray(py))
}

#[pyfunction]
pub fn exp_so3<'py>(py: Python<'py>, theta: Floats2) -> PyResult<Bound<'py, PyArray3<f64>>> {
    matrices(py, &points("theta", &theta)?.iter().map(lie::exp_so3).collect::<Vec<_>>())
}

#[pyfunction]
pub fn log_so3<'py>(py: Python<'py>, rotations: PyReadonlyArray3<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    check_shape("rotation", rotations.shape(), &[None, Some(3), Some(3)])?;
    check_finite("rotation", &rotations.as_array().iter().copied().collect::<Vec<_>>()).map_err(to_python)?;
    let logarithm = |r: ArrayView2<f64>| lie::log_so3(&Matrix3::from_fn(|i, j| r[[i, j]]));
    let found: Vec<f64> =
        rotations.as_array().outer_iter().flat_map(|r| logarithm(r).iter().copied().collect::<Vec<_>>()).collect();
    let array =
        Array2::from_shape_vec((found.len() / 3, 3), found).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(array.into_pyarray(py))
}

#[pyfunction]
pub fn right_jacobian<'py>(py: Python<'py>, theta: Floats2) -> PyResult<Bound<'py, PyArray3<f64>>> {
    matrices(py, &points("theta", &theta)?.iter().map(lie::right_jacobian).collect::<Vec<_>>())
}

#[pyfunction]
pub fn right_jacobian_inverse<'py>(py: Python<'py>, theta: Floats2) -> PyResult<Bound<'py, PyArray3<f64>>> {
    matrices(py, &points("theta", &theta)?.iter().map(lie::right_jacobian_inverse).collect::<Vec<_>>())
}

/// Edges as rows, and their weights.
type EdgeWeights<'py> = (Bound<'py, PyArray2<i64>>, Bound<'py, PyArray1<f64>>);

#[pyfunction]
pub fn cotangent_weights<'py>(py: Python<'py>, vertices: Floats2, face_array: Ints2) -> PyResult<EdgeWeights<'py>> {
    let vertices = points("vertices", &vertices)?;
    let topology = Topology::new(vertices.len(), &faces(&face_array)?).map_err(to_python)?;
    let weights = mesh::cotangent_weights(&topology, &vertices);
    let edges: Vec<Vec<i64>> =
        topology.edges.iter().map(|e| e.vertices.iter().map(|&v| i64::from(v)).collect()).collect();
    Ok((PyArray2::from_vec2(py, &edges)?, PyArray1::from_vec(py, weights)))
}

#[pyfunction]
pub fn voxel_iou(
    py: Python,
    vertices_a: Floats2,
    faces_a: Ints2,
    vertices_b: Floats2,
    faces_b: Ints2,
    step_m: f64,
) -> PyResult<f64> {
    let (va, vb) = (points("vertices_a", &vertices_a)?, points("vertices_b", &vertices_b)?);
    let fa = Topology::new(va.len(), &faces(&faces_a)?).map_err(to_python)?.faces;
    let fb = Topology::new(vb.len(), &faces(&faces_b)?).map_err(to_python)?.faces;
    if !(step_m.is_finite() && step_m > 0.0) {
        return Err(PyValueError::new_err(format!("step_m must be positive, found {step_m}")));
    }
    py.detach(|| voxel::voxel_iou(&va, &fa, &vb, &fb, step_m)).map_err(to_python)
}

/// A point in the world and its covariance, as rows.
type PointEstimate<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

#[pyfunction]
pub fn triangulate<'py>(
    py: Python<'py>,
    camera: Camera,
    camera_from_world: Vec<Floats2>,
    observed: Floats2,
    sigma_px: Floats1,
    cauchy: f64,
) -> PyResult<Option<PointEstimate<'py>>> {
    let Camera(camera) = camera;
    let observed = pixels("pixels", &observed)?;
    check_shape("camera_from_world", &[camera_from_world.len()], &[Some(observed.len())])?;
    check_shape("sigma_px", sigma_px.shape(), &[Some(observed.len())])?;
    let sigma = sigma_px.as_array();
    let mut sights = Vec::with_capacity(observed.len());
    for (k, (matrix, pixel)) in camera_from_world.iter().zip(observed).enumerate() {
        sights.push(Sight { camera, camera_from_world: pose("camera_from_world", matrix)?, pixel, sigma_px: sigma[k] });
    }
    match py.detach(|| core_triangulate(&sights, Kernel::Cauchy(cauchy))) {
        None => Ok(None),
        Some((point, covariance)) => {
            Ok(Some((PyArray2::from_vec2(py, &point_rows(&[point]))?, matrix3(py, &covariance)?)))
        }
    }
}
