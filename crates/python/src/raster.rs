//! `raster` and `outline` of the core.

use meshslam_core::mesh::Topology;
use meshslam_core::outline::outline as core_outline;
use meshslam_core::raster::{Raster, Rect, coverage as core_coverage, fill_mask};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Floats2, Ints2, faces, points, to_python};
use crate::named::Camera;

/// Rectangle (x0, y0, width, height).
type RectTuple = (i64, i64, usize, usize);

fn rect((x0, y0, width, height): RectTuple) -> PyResult<Rect> {
    if width.saturating_mul(height) > 1 << 28 {
        return Err(PyValueError::new_err(format!("a picture of {width}x{height} pixels is too large")));
    }
    Ok(Rect { x0, y0, width, height })
}

fn picture<T>(rect: &Rect, values: Vec<T>) -> PyResult<Array2<T>> {
    Array2::from_shape_vec((rect.height, rect.width), values).map_err(|e| PyValueError::new_err(e.to_string()))
}

type Pictures<'py> = (Bound<'py, PyArray2<i32>>, Bound<'py, PyArray2<i32>>, Bound<'py, PyArray2<f64>>);

/// Nearest object, face and inverse depth of each pixel of several meshes in one view.
#[pyfunction]
pub fn rasterize<'py>(
    py: Python<'py>,
    camera: Camera,
    meshes: Vec<(Floats2, Ints2)>,
    rect_values: RectTuple,
) -> PyResult<Pictures<'py>> {
    let (camera, rect) = (camera.0, rect(rect_values)?);
    let mut checked = Vec::with_capacity(meshes.len());
    for (vertices, face_array) in &meshes {
        let vertices = points("points_in_camera", vertices)?;
        let topology = Topology::new(vertices.len(), &faces(face_array)?).map_err(to_python)?;
        checked.push((vertices, topology.faces));
    }
    let raster = py.detach(|| {
        let mut raster = Raster::new(rect);
        for (number, (vertices, faces)) in checked.iter().enumerate() {
            raster.draw(&camera, vertices, faces, number as i32);
        }
        raster
    });
    let pictures =
        (picture(&rect, raster.object)?, picture(&rect, raster.face)?, picture(&rect, raster.inverse_depth)?);
    Ok((pictures.0.into_pyarray(py), pictures.1.into_pyarray(py), pictures.2.into_pyarray(py)))
}

/// Share of each pixel that a mesh covers.
#[pyfunction]
pub fn coverage<'py>(
    py: Python<'py>,
    camera: Camera,
    points_in_camera: Floats2,
    face_array: Ints2,
    rect_values: RectTuple,
    samples: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (camera, rect) = (camera.0, rect(rect_values)?);
    if !(1..=64).contains(&samples) {
        return Err(PyValueError::new_err(format!("samples must be from 1 to 64, found {samples}")));
    }
    let vertices = points("points_in_camera", &points_in_camera)?;
    let topology = Topology::new(vertices.len(), &faces(&face_array)?).map_err(to_python)?;
    let shares = py.detach(|| core_coverage(&camera, &vertices, &topology.faces, &rect, samples));
    Ok(picture(&rect, shares)?.into_pyarray(py))
}

/// Outline samples as rows: x, y, normal x, normal y, vertex a, vertex b, weight of b, length.
#[pyfunction]
pub fn outline<'py>(
    py: Python<'py>,
    camera: Camera,
    points_in_camera: Floats2,
    face_array: Ints2,
    rect_values: RectTuple,
    step_px: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (camera, rect) = (camera.0, rect(rect_values)?);
    if !(step_px.is_finite() && step_px > 0.0) {
        return Err(PyValueError::new_err(format!("step_px must be positive, found {step_px}")));
    }
    let vertices = points("points_in_camera", &points_in_camera)?;
    let topology = Topology::new(vertices.len(), &faces(&face_array)?).map_err(to_python)?;
    let samples = py.detach(|| {
        let mut mask = vec![0; rect.area()];
        fill_mask(&camera, &vertices, &topology.faces, &rect, &mut mask);
        core_outline(&camera, &vertices, &topology, &rect, &mask, step_px)
    });
    let rows: Vec<f64> = samples
        .iter()
        .flat_map(|s| {
            [
                s.pixel.x,
                s.pixel.y,
                s.normal.x,
                s.normal.y,
                f64::from(s.vertices[0]),
                f64::from(s.vertices[1]),
                s.share_in_space(&vertices),
                s.length,
            ]
        })
        .collect();
    let array = Array2::from_shape_vec((samples.len(), 8), rows).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(array.into_pyarray(py))
}
