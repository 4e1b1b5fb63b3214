//! `window` of the core.

use meshslam_core::lie::Pose;
use meshslam_core::window::{
    BlockSystem as CoreSystem, LinearFactor as CoreFactor, Solution as CoreSolution, Variable,
    Variables as CoreVariables, linear_cost as core_linear_cost,
};
use nalgebra::{Matrix3, Vector3};
use numpy::ndarray::Array2;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Floats1, Floats2, check_shape, to_python};

type Names<'py> = PyReadonlyArray1<'py, u64>;

/// Numbers of variables, and a row of values for each.
type Group<'py> = (Names<'py>, Floats2<'py>);

#[pyclass(frozen, module = "meshslam._core")]
pub struct Variables(CoreVariables);

#[pyclass(frozen, module = "meshslam._core")]
pub struct LinearFactor(CoreFactor);

#[pyclass(module = "meshslam._core")]
pub struct BlockSystem(CoreSystem);

#[pyclass(frozen, module = "meshslam._core")]
pub struct Solution(CoreSolution);

fn rotation(row: &[f64]) -> Matrix3<f64> {
    Matrix3::from_row_slice(&row[..9])
}

fn read(group: &Group, width: Option<usize>, of: impl Fn(&[f64]) -> Variable) -> PyResult<Vec<(u64, Variable)>> {
    let (names, rows) = group;
    check_shape("values", rows.shape(), &[Some(names.len()), width])?;
    let rows = rows.as_array();
    let each = names.as_array().into_iter().zip(rows.outer_iter()).map(|(name, row)| (*name, of(&row.to_vec())));
    Ok(each.collect())
}

#[pymethods]
impl Variables {
    #[new]
    fn new(poses: Group, rotations: Group, vectors: Vec<Group>) -> PyResult<Self> {
        let pose = |row: &[f64]| {
            Variable::Pose(Pose { rotation: rotation(row), translation: Vector3::new(row[9], row[10], row[11]) })
        };
        let mut all = read(&poses, Some(12), pose)?;
        all.extend(read(&rotations, Some(9), |row| Variable::Rotation(rotation(row)))?);
        for group in &vectors {
            all.extend(read(group, None, |row| Variable::Vector(row.to_vec()))?);
        }
        CoreVariables::new(all).map(Self).map_err(to_python)
    }
}

#[pymethods]
impl LinearFactor {
    #[new]
    fn new(names: Names, at: Bound<Variables>, rows: Floats2) -> PyResult<Self> {
        let rows: Vec<f64> = rows.as_array().iter().copied().collect();
        CoreFactor::new(names.as_array().to_vec(), &at.get().0, &rows).map(Self).map_err(to_python)
    }
}

#[pyfunction]
pub fn linear_cost(factors: Vec<Py<LinearFactor>>, variables: Bound<Variables>) -> PyResult<f64> {
    core_linear_cost(factors.iter().map(|factor| &factor.get().0), &variables.get().0).map_err(to_python)
}

#[pymethods]
impl BlockSystem {
    #[new]
    fn new(names: Names, widths: PyReadonlyArray1<i64>, blocks: Names) -> PyResult<Self> {
        let found = widths.as_array().iter().map(|w| usize::try_from(*w)).collect::<Result<Vec<_>, _>>();
        let widths = found.map_err(|_| PyValueError::new_err("a variable's width must not be negative"))?;
        let (names, blocks) = (names.as_array().to_vec(), blocks.as_array().to_vec());
        CoreSystem::in_blocks(&names, &widths, &blocks).map(Self).map_err(to_python)
    }

    fn add_linear(&mut self, factors: Vec<Py<LinearFactor>>, variables: Bound<Variables>) -> PyResult<()> {
        let variables = &variables.get().0;
        factors.iter().try_for_each(|f| self.0.add_linear(&f.get().0, variables)).map_err(to_python)
    }

    fn add_rows(&mut self, names: Names, rows: Floats2) -> PyResult<()> {
        let rows: Vec<f64> = rows.as_array().iter().copied().collect();
        self.0.add_rows(&names.as_array().to_vec(), &rows).map_err(to_python)
    }

    fn add_all_rows(&mut self, names: PyReadonlyArray2<u64>, rows: PyReadonlyArray3<f64>) -> PyResult<()> {
        check_shape("rows", rows.shape(), &[Some(names.shape()[0]), None, None])?;
        for (names, rows) in names.as_array().outer_iter().zip(rows.as_array().outer_iter()) {
            let rows: Vec<f64> = rows.iter().copied().collect();
            self.0.add_rows(&names.to_vec(), &rows).map_err(to_python)?;
        }
        Ok(())
    }

    fn add_information(&mut self, names: Names, hessian: Floats2, gradient: Floats1) -> PyResult<()> {
        let size = gradient.len();
        check_shape("hessian", hessian.shape(), &[Some(size), Some(size)])?;
        let hessian: Vec<f64> = hessian.as_array().iter().copied().collect();
        let gradient = gradient.as_array().to_vec();
        self.0.add_information(&names.as_array().to_vec(), &hessian, &gradient).map_err(to_python)
    }

    fn solve(&self, py: Python, last: Names) -> PyResult<Solution> {
        let last = last.as_array().to_vec();
        py.detach(|| self.0.solve(&last)).map(Solution).map_err(to_python)
    }

    fn covariances<'py>(
        &self,
        py: Python<'py>,
        groups: Vec<Names>,
        last: Names,
    ) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        let groups: Vec<Vec<u64>> = groups.iter().map(|group| group.as_array().to_vec()).collect();
        let last = last.as_array().to_vec();
        let found = py.detach(|| self.0.covariances(&groups, &last)).map_err(to_python)?;
        found.into_iter().map(|values| square(py, values)).collect()
    }
}

fn square(py: Python<'_>, values: Vec<f64>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let size = values.len().isqrt();
    let matrix = Array2::from_shape_vec((size, size), values).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(matrix.into_pyarray(py))
}

#[pymethods]
impl Solution {
    #[getter]
    fn step<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.step)
    }

    fn covariance<'py>(&self, py: Python<'py>, names: Names) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.0.covariance(&names.as_array().to_vec()).map(|found| square(py, found)).transpose()
    }
}
