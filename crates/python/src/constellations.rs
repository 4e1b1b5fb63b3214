//! `constellations` of the core.

use meshslam_core::constellations::{Parked, ParkedMap as CoreMap, Rules};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Floats2, check_shape, to_python};

/// Place, heading, logarithmic sizes, variance of each object.
const COLUMNS: usize = 7;

#[pyclass(frozen, module = "meshslam._core")]
pub struct ParkedMap(CoreMap);

fn parked(what: &str, array: &Floats2) -> PyResult<Vec<Parked>> {
    check_shape(what, array.shape(), &[None, Some(COLUMNS)])?;
    let rows = array.as_array();
    Ok(rows
        .rows()
        .into_iter()
        .map(|r| Parked { place: [r[0], r[1]], yaw_rad: r[2], log_size: [r[3], r[4], r[5]], variance_m2: r[6] })
        .collect())
}

#[pymethods]
impl ParkedMap {
    #[new]
    fn new(py: Python, objects: Floats2) -> PyResult<Self> {
        let objects = parked("objects", &objects)?;
        py.detach(|| CoreMap::new(objects)).map(Self).map_err(to_python)
    }

    /// Rows of (score, yaw, x, y, scale); `rules` in the order of the core's struct.
    fn candidates<'py>(
        &self,
        py: Python<'py>,
        seen: Floats2,
        ends: Vec<[usize; 2]>,
        pairs: Vec<PyReadonlyArray2<i32>>,
        rules: [f64; 8],
        keep: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let seen = parked("seen", &seen)?;
        for rows in &pairs {
            check_shape("pairs", rows.shape(), &[None, Some(2)])?;
        }
        let rows: Option<Vec<&[i32]>> = pairs.iter().map(|rows| rows.as_slice().ok()).collect();
        let rows = rows.ok_or_else(|| PyValueError::new_err("pairs must be contiguous, row by row"))?;
        let rows: Vec<&[[i32; 2]]> = rows.into_iter().map(|flat| flat.as_chunks().0).collect();
        let [place_variance_m2, drift_share, heading_sigma_rad, size_variance, other, objects_per_m2, gate, scale] =
            rules;
        let rules = Rules {
            place_variance_m2,
            drift_share,
            heading_sigma_rad,
            size_variance,
            other_size_variance: other,
            objects_per_m2,
            gate,
            scale_sigma: scale,
        };
        let found = py.detach(|| self.0.candidates(&seen, &ends, &rows, &rules, keep)).map_err(to_python)?;
        let flat = found.iter().flat_map(|c| [c.score, c.yaw_rad, c.shift[0], c.shift[1], c.scale]).collect();
        let rows = Array2::from_shape_vec((found.len(), 5), flat).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(rows.into_pyarray(py))
    }
}
