//! Between numpy arrays and the core's types.

use meshslam_core::error::{Error, check_finite};
use meshslam_core::lie::Pose;
use nalgebra::{Matrix3, Vector2, Vector3};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;

pub type Floats1<'py> = PyReadonlyArray1<'py, f64>;
pub type Floats2<'py> = PyReadonlyArray2<'py, f64>;
pub type Ints2<'py> = PyReadonlyArray2<'py, i64>;

/// A core error as the exception that Python's users expect.
pub fn to_python(error: Error) -> PyErr {
    match error {
        Error::FaceIndex { .. } | Error::Index { .. } => PyIndexError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}

pub fn check_shape(what: &str, found: &[usize], expected: &[Option<usize>]) -> PyResult<()> {
    let fits = found.len() == expected.len() && found.iter().zip(expected).all(|(f, e)| e.is_none_or(|e| e == *f));
    if fits {
        return Ok(());
    }
    let wanted: Vec<String> = expected.iter().map(|e| e.map_or("any".to_owned(), |n| n.to_string())).collect();
    Err(PyValueError::new_err(format!("{what} must have shape ({}), found {found:?}", wanted.join(", "))))
}

/// Rows (n, 3), finite.
pub fn points(what: &'static str, array: &Floats2) -> PyResult<Vec<Vector3<f64>>> {
    check_shape(what, array.shape(), &[None, Some(3)])?;
    let out = match array.as_slice() {
        Ok(flat) => bytemuck::cast_slice(flat).to_vec(),
        Err(_) => array.as_array().rows().into_iter().map(|r| Vector3::new(r[0], r[1], r[2])).collect(),
    };
    check_finite(what, bytemuck::cast_slice(&out)).map_err(to_python)?;
    Ok(out)
}

/// Rows (n, 2), finite.
pub fn pixels(what: &'static str, array: &Floats2) -> PyResult<Vec<Vector2<f64>>> {
    check_shape(what, array.shape(), &[None, Some(2)])?;
    let out: Vec<Vector2<f64>> = array.as_array().rows().into_iter().map(|r| Vector2::new(r[0], r[1])).collect();
    check_finite(what, out.iter().flat_map(|p| p.iter().copied()).collect::<Vec<_>>().as_slice()).map_err(to_python)?;
    Ok(out)
}

pub fn vector(what: &'static str, array: &Floats1) -> PyResult<Vector3<f64>> {
    check_shape(what, array.shape(), &[Some(3)])?;
    let a = array.as_array();
    check_finite(what, &[a[0], a[1], a[2]]).map_err(to_python)?;
    Ok(Vector3::new(a[0], a[1], a[2]))
}

pub fn faces(array: &Ints2) -> PyResult<Vec<[i64; 3]>> {
    check_shape("faces", array.shape(), &[None, Some(3)])?;
    Ok(array.as_array().rows().into_iter().map(|r| [r[0], r[1], r[2]]).collect())
}

/// A homogeneous (4, 4) matrix.
pub fn pose(what: &'static str, array: &Floats2) -> PyResult<Pose> {
    check_shape(what, array.shape(), &[Some(4), Some(4)])?;
    let a = array.as_array();
    let rotation = Matrix3::from_fn(|i, j| a[[i, j]]);
    let translation = Vector3::from_fn(|i, _| a[[i, 3]]);
    check_finite(what, rotation.as_slice()).map_err(to_python)?;
    check_finite(what, translation.as_slice()).map_err(to_python)?;
    Ok(Pose { rotation, translation })
}

/// A pose from its rotation (3, 3) and translation (3,).
pub fn pose_of(rotation: &Floats2, translation: &Floats1) -> PyResult<Pose> {
    check_shape("rotation", rotation.shape(), &[Some(3), Some(3)])?;
    check_shape("translation", translation.shape(), &[Some(3)])?;
    let (r, t) = (rotation.as_array(), translation.as_array());
    let rotation = Matrix3::from_fn(|i, j| r[[i, j]]);
    let translation = Vector3::from_fn(|i, _| t[i]);
    check_finite("rotation", rotation.as_slice()).map_err(to_python)?;
    check_finite("translation", translation.as_slice()).map_err(to_python)?;
    Ok(Pose { rotation, translation })
}

/// Rows (n, 12) of a rotation, row by row, and a translation.
pub fn pose_rows(what: &'static str, array: &Floats2) -> PyResult<Vec<Pose>> {
    check_shape(what, array.shape(), &[None, Some(12)])?;
    let rows: Vec<f64> = array.as_array().iter().copied().collect();
    check_finite(what, &rows).map_err(to_python)?;
    let pose = |row: &[f64]| Pose {
        rotation: Matrix3::from_row_slice(&row[..9]),
        translation: Vector3::new(row[9], row[10], row[11]),
    };
    Ok(rows.chunks_exact(12).map(pose).collect())
}

pub fn pose_to_rows(pose: &Pose) -> Vec<Vec<f64>> {
    let (r, t) = (&pose.rotation, &pose.translation);
    let mut rows: Vec<Vec<f64>> = (0..3).map(|i| vec![r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]]).collect();
    rows.push(vec![0.0, 0.0, 0.0, 1.0]);
    rows
}

pub fn point_rows(points: &[Vector3<f64>]) -> Vec<Vec<f64>> {
    points.iter().map(|p| vec![p.x, p.y, p.z]).collect()
}
