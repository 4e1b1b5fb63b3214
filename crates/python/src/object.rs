//! `template` and `object` of the core.

use meshslam_core::factor;
use meshslam_core::object::{self, Block, ObjectProblem};
use meshslam_core::solve::levenberg_marquardt::{Options, Problem as _, Stop};
use meshslam_core::template::Template as CoreTemplate;
use meshslam_core::view::View as CoreView;
use nalgebra::Vector3;
use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{
    Floats1, Floats2, Ints2, check_shape, faces, point_rows, points, pose, pose_rows, pose_to_rows, to_python,
};
use crate::named::NoiseModel;
use crate::problem::{ObjectState, Problem, block};
use crate::view::{View, core_views};

/// A category's mesh with its shape space.
#[pyclass(frozen)]
pub struct Template {
    inner: CoreTemplate,
}

/// (before, after, damping, rejected) of each iteration.
type IterationRows = Vec<(f64, f64, f64, usize)>;

/// Roots stacked, costs, observations.
type SquareRoots<'py> = (Bound<'py, PyArray3<f64>>, Vec<f64>, Vec<f64>);

/// A step that lowers an object's cost by a smaller share is its last.
const LEAST_SHARE: f64 = 1e-3;

#[pymethods]
impl Template {
    #[new]
    #[pyo3(signature = (vertices, faces_array, modes, mirror, keypoint_weights, wheels))]
    fn new(
        vertices: Floats2,
        faces_array: Ints2,
        modes: PyReadonlyArray3<f64>,
        mirror: Option<PyReadonlyArray1<i64>>,
        keypoint_weights: Floats2,
        wheels: PyReadonlyArray1<i64>,
    ) -> PyResult<Self> {
        let mean = points("vertices", &vertices)?;
        check_shape("modes", modes.shape(), &[None, Some(mean.len()), Some(3)])?;
        check_shape("keypoint_weights", keypoint_weights.shape(), &[None, Some(mean.len())])?;
        let (by_mode, mode_count) = (modes.as_array(), modes.shape()[0]);
        let vertex_major = (0..mean.len()).flat_map(|v| (0..mode_count).map(move |m| (v, m)));
        let modes = vertex_major
            .map(|(v, m)| Vector3::new(by_mode[[m, v, 0]], by_mode[[m, v, 1]], by_mode[[m, v, 2]]))
            .collect();
        let association = keypoint_weights
            .as_array()
            .rows()
            .into_iter()
            .map(|row| row.iter().enumerate().filter(|(_, w)| **w != 0.0).map(|(v, w)| (v as u32, *w)).collect())
            .collect();
        let mirror: Option<Vec<i64>> = mirror.map(|m| m.as_array().to_vec());
        let inner = CoreTemplate::new(
            mean,
            &faces(&faces_array)?,
            modes,
            mirror.as_deref(),
            association,
            &wheels.as_array().to_vec(),
        )
        .map_err(to_python)?;
        Ok(Self { inner })
    }

    /// Degrees of freedom of the free-form displacement.
    #[getter]
    fn free_form_dimension(&self) -> usize {
        self.inner.symmetry.dimension()
    }

    /// Vertices of the shape (z, d).
    fn vertices<'py>(&self, py: Python<'py>, z: Floats1, d: Floats1) -> PyResult<Bound<'py, PyArray2<f64>>> {
        check_shape("z", z.shape(), &[Some(self.inner.mode_count)])?;
        check_shape("d", d.shape(), &[Some(self.inner.symmetry.dimension())])?;
        let vertices = self.inner.vertices(&z.as_array().to_vec(), &d.as_array().to_vec());
        Ok(PyArray2::from_vec2(py, &point_rows(&vertices))?)
    }

    /// A gradient over vertices as one over the free-form displacement.
    fn free_form_gradient<'py>(
        &self,
        py: Python<'py>,
        vertex_gradient: Floats2,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        check_shape("vertex gradient", vertex_gradient.shape(), &[Some(self.inner.mean.len()), Some(3)])?;
        Ok(PyArray1::from_vec(py, self.inner.symmetry.pull_back(&points("vertex gradient", &vertex_gradient)?)))
    }

    /// Lower the cost over pose and the blocks asked for: (world_from_object, z, d, cost, why it stopped, iterations).
    #[allow(clippy::type_complexity)] // the binding of one function
    fn refine<'py>(
        &self,
        py: Python<'py>,
        problem: Bound<'py, Problem>,
        max_iterations: usize,
        least_decrease: f64,
    ) -> PyResult<(
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray1<f64>>,
        f64,
        &'static str,
        IterationRows,
    )> {
        let Problem { ground, model, scope, state, .. } = problem.get();
        let views = problem.get().views();
        let options = Options {
            max_iterations,
            relative_decrease: LEAST_SHARE,
            absolute_decrease: least_decrease,
            ..Options::default()
        };
        let estimate = py
            .detach(|| object::refine(&self.inner, &views, *ground, *model, *scope, state.clone(), &options))
            .map_err(to_python)?;
        let stop = match estimate.report.stop {
            Stop::Converged => "converged",
            Stop::NoDescent => "no descent",
            Stop::IterationLimit => "iteration limit",
        };
        let iterations =
            estimate.report.iterations.iter().map(|i| (i.cost, i.new_cost, i.damping, i.rejected)).collect();
        Ok((
            PyArray2::from_vec2(py, &pose_to_rows(&estimate.state.world_from_object))?,
            PyArray1::from_vec(py, estimate.state.z),
            PyArray1::from_vec(py, estimate.state.d),
            PyArray1::from_slice(py, estimate.state.velocity.as_slice()),
            estimate.report.cost,
            stop,
            iterations,
        ))
    }

    /// Seconds of one evaluation of residuals, Jacobians and normal equations, each of `runs`.
    fn time(&self, py: Python, problem: Bound<Problem>, runs: usize) -> PyResult<Vec<f64>> {
        let Problem { ground, model, scope, state, .. } = problem.get();
        let views = problem.get().views();
        check_shape("z", &[state.z.len()], &[Some(self.inner.mode_count)])?;
        check_shape("d", &[state.d.len()], &[Some(self.inner.symmetry.dimension())])?;
        Ok(py.detach(|| {
            let mut problem = ObjectProblem::new(&self.inner, &views, *ground, *model, *scope);
            let (mut hessian, mut gradient) = (problem.structure(), Vec::new());
            let mut once = || {
                hessian.clear();
                gradient.clear();
                gradient.resize(hessian.size(), 0.0);
                let start = std::time::Instant::now();
                std::hint::black_box(problem.linearize(std::hint::black_box(state), &mut hessian, &mut gradient));
                start.elapsed().as_secs_f64()
            };
            (0..runs).map(|_| once()).collect()
        }))
    }

    /// Covariance of the pose at the mesh's centre, sigma of each vertex, which vertices were observed.
    #[allow(clippy::type_complexity)] // the binding of one function
    fn uncertainty<'py>(
        &self,
        py: Python<'py>,
        problem: Bound<'py, Problem>,
        per_vertex: bool,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>)> {
        let Problem { ground, model, scope, state, .. } = problem.get();
        let views = problem.get().views();
        let found = py
            .detach(|| object::uncertainty(&self.inner, &views, *ground, *model, *scope, state, per_vertex))
            .map_err(to_python)?;
        let covariance: Vec<Vec<f64>> =
            (0..6).map(|i| (0..6).map(|j| found.pose_covariance[(i, j)]).collect()).collect();
        Ok((
            PyArray2::from_vec2(py, &covariance)?,
            PyArray1::from_vec(py, found.vertex_sigma_m),
            PyArray1::from_vec(py, found.vertex_observed),
        ))
    }

    /// Joint covariance of blocks of parameters, in the order named.
    fn covariance<'py>(
        &self,
        py: Python<'py>,
        problem: Bound<'py, Problem>,
        blocks: Vec<String>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let Problem { ground, model, scope, state, .. } = problem.get();
        let views = problem.get().views();
        let blocks = blocks.iter().map(|name| block(name, *scope)).collect::<PyResult<Vec<Block>>>()?;
        let found = py
            .detach(|| object::block_covariance(&self.inner, &views, *ground, *model, *scope, state, &blocks))
            .map_err(to_python)?;
        let rows: Vec<Vec<f64>> = found.row_iter().map(|row| row.iter().copied().collect()).collect();
        Ok(PyArray2::from_vec2(py, &rows)?)
    }

    /// Signed distances from each border point to the outline, an array a view.
    #[allow(clippy::too_many_arguments)] // the binding of one function
    fn border_distances<'py>(
        &self,
        py: Python<'py>,
        views: Vec<Py<View>>,
        state: Bound<'py, ObjectState>,
        step_px: f64,
    ) -> PyResult<Vec<Bound<'py, PyArray1<f64>>>> {
        let views = core_views(&views);
        let state = &state.get().inner;
        check_shape("z", &[state.z.len()], &[Some(self.inner.mode_count)])?;
        check_shape("d", &[state.d.len()], &[Some(self.inner.symmetry.dimension())])?;
        if !(step_px.is_finite() && step_px > 0.0) {
            return Err(PyValueError::new_err(format!("step_px must be positive, found {step_px}")));
        }
        let of = |view: &&CoreView| object::border_distances(&self.inner, view, state, step_px);
        let found: Vec<Vec<f64>> = py.detach(|| views.iter().map(of).collect());
        Ok(found.into_iter().map(|row| PyArray1::from_vec(py, row)).collect())
    }

    /// As `square_root` of many views, at rows of rotation (9), row by row, and translation (3), and rows of modes.
    fn square_roots<'py>(
        &self,
        py: Python<'py>,
        views: Vec<Py<View>>,
        noise: NoiseModel,
        camera_from_object: Floats2,
        z: Floats2,
        modes: bool,
    ) -> PyResult<SquareRoots<'py>> {
        check_shape("z", z.shape(), &[Some(views.len()), None])?;
        let (model, views) = (noise.0, core_views(&views));
        let poses = pose_rows("camera_from_object", &camera_from_object)?;
        check_shape("camera_from_object", &[poses.len()], &[Some(views.len())])?;
        let z = z.as_array();
        let each = views.into_iter().zip(poses).zip(z.outer_iter());
        let at: Vec<factor::ViewAt> = each
            .map(|((view, camera_from_object), z)| factor::ViewAt { view, camera_from_object, z: z.to_vec() })
            .collect();
        let found = py.detach(|| factor::square_roots(&self.inner, &at, &model, modes)).map_err(to_python)?;
        let width = found.first().map_or(0, |root| root.columns + 1);
        let all: Vec<f64> = found.iter().flat_map(|root| root.root.iter().copied()).collect();
        let roots = Array3::from_shape_vec((found.len(), width, width), all)
            .map_err(|e| PyValueError::new_err(e.to_string()))?;
        let (costs, observations) = found.iter().map(|root| (root.cost, root.observations)).unzip();
        Ok((roots.into_pyarray(py), costs, observations))
    }

    /// A view's cost near a relative pose: (root, cost, observations), `root` as the core has it.
    #[allow(clippy::too_many_arguments)] // the binding of one function
    fn square_root<'py>(
        &self,
        py: Python<'py>,
        view: Bound<'py, View>,
        noise: NoiseModel,
        camera_from_object: Floats2,
        z: Floats1,
        d: Floats1,
        modes: bool,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, f64, f64)> {
        let (model, pose) = (noise.0, pose("camera_from_object", &camera_from_object)?);
        let (z, d, view) = (z.as_array().to_vec(), d.as_array().to_vec(), &view.get().inner);
        let found =
            py.detach(|| factor::square_root(&self.inner, view, &model, &pose, &z, &d, modes)).map_err(to_python)?;
        let width = found.columns + 1;
        let rows: Vec<Vec<f64>> = found.root.chunks(width).map(<[f64]>::to_vec).collect();
        Ok((PyArray2::from_vec2(py, &rows)?, found.cost, found.observations))
    }

    /// IoU of the drawn mesh with the observed mask: a row for each pose, a column for each view.
    fn mask_ious<'py>(
        &self,
        py: Python<'py>,
        views: Vec<Py<View>>,
        world_from_object: Vec<Floats2>,
        vertices: Floats2,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let views = core_views(&views);
        let vertices = points("vertices", &vertices)?;
        check_shape("vertices", &[vertices.len()], &[Some(self.inner.mean.len())])?;
        let poses = world_from_object.iter().map(|m| pose("world_from_object", m)).collect::<PyResult<Vec<_>>>()?;
        let topology = &self.inner.topology;
        let rows: Vec<Vec<f64>> = py.detach(|| {
            poses.iter().map(|p| views.iter().map(|v| object::mask_iou(v, p, &vertices, topology)).collect()).collect()
        });
        Ok(PyArray2::from_vec2(py, &rows)?)
    }
}
