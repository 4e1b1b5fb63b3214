//! `template`, `view` and `object` of the core.

use std::sync::Arc;

use meshslam_core::factor;
use meshslam_core::object::{self, Block, Model, ObjectProblem, ObjectState, Scope};
use meshslam_core::raster::Rect;
use meshslam_core::residuals::border::BorderNoise;
use meshslam_core::residuals::ground::Ground;
use meshslam_core::residuals::kernel::Kernel;
use meshslam_core::residuals::keypoints::KeypointObservation;
use meshslam_core::solve::levenberg_marquardt::{Options, Problem, Stop};
use meshslam_core::template::Template as CoreTemplate;
use meshslam_core::view::{BorderPoint, View as CoreView};
use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{
    CameraTuple, Floats1, Floats2, Ints2, camera, check_shape, faces, pixels, point_rows, points, pose, pose_to_rows,
    to_python, vector,
};

/// A category's mesh with its shape space.
#[pyclass(frozen)]
pub struct Template {
    inner: CoreTemplate,
}

/// What one frame shows of one object.
#[pyclass(frozen)]
pub struct View {
    inner: CoreView,
}

/// (border sigma px, correlation px, border kernel k, cap px, outline step px, key point position sigma m, key point kernel k, free-form sigma m, smoothness sigma m).
type ModelTuple = (f64, f64, f64, f64, f64, f64, f64, f64, f64);
/// Which blocks move: modes, free form, velocity.
type ScopeTuple = (bool, bool, bool);
/// (normal, offset m, height sigma m, tilt sigma rad).
type GroundTuple = ([f64; 3], f64, f64, f64);
/// (before, after, damping, rejected) of each iteration.
type IterationRows = Vec<(f64, f64, f64, usize)>;

/// A step that lowers an object's cost by a smaller share is its last.
const LEAST_SHARE: f64 = 1e-3;

fn model(values: ModelTuple) -> PyResult<Model> {
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
    #[allow(clippy::too_many_arguments, clippy::type_complexity)] // the binding of one function
    fn refine<'py>(
        &self,
        py: Python<'py>,
        views: Vec<Bound<'py, View>>,
        ground_values: Option<GroundTuple>,
        model_values: ModelTuple,
        scope: ScopeTuple,
        world_from_object: Floats2,
        z: Floats1,
        d: Floats1,
        velocity: Floats1,
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
        let views = core_views(&views);
        let (ground, model, state) =
            (ground(ground_values)?, model(model_values)?, state(&world_from_object, &z, &d, &velocity)?);
        let (scope, options) = (
            Scope { modes: scope.0, free_form: scope.1, velocity: scope.2 },
            Options {
                max_iterations,
                relative_decrease: LEAST_SHARE,
                absolute_decrease: least_decrease,
                ..Options::default()
            },
        );
        let estimate = py
            .detach(|| object::refine(&self.inner, &views, ground, model, scope, state, &options))
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
    #[allow(clippy::too_many_arguments)] // the binding of one function
    fn time(
        &self,
        py: Python,
        views: Vec<Bound<View>>,
        ground_values: Option<GroundTuple>,
        model_values: ModelTuple,
        scope: ScopeTuple,
        world_from_object: Floats2,
        z: Floats1,
        d: Floats1,
        velocity: Floats1,
        runs: usize,
    ) -> PyResult<Vec<f64>> {
        let views = core_views(&views);
        let (ground, model, state) =
            (ground(ground_values)?, model(model_values)?, state(&world_from_object, &z, &d, &velocity)?);
        check_shape("z", &[state.z.len()], &[Some(self.inner.mode_count)])?;
        check_shape("d", &[state.d.len()], &[Some(self.inner.symmetry.dimension())])?;
        let scope = Scope { modes: scope.0, free_form: scope.1, velocity: scope.2 };
        Ok(py.detach(|| {
            let mut problem = ObjectProblem::new(&self.inner, &views, ground, model, scope);
            let (mut hessian, mut gradient) = (problem.structure(), Vec::new());
            let mut once = || {
                hessian.clear();
                gradient.clear();
                gradient.resize(hessian.size(), 0.0);
                let start = std::time::Instant::now();
                std::hint::black_box(problem.linearize(std::hint::black_box(&state), &mut hessian, &mut gradient));
                start.elapsed().as_secs_f64()
            };
            (0..runs).map(|_| once()).collect()
        }))
    }

    /// Covariance of the pose at the mesh's centre, sigma of each vertex, which vertices were observed.
    #[allow(clippy::too_many_arguments, clippy::type_complexity)] // the binding of one function
    fn uncertainty<'py>(
        &self,
        py: Python<'py>,
        views: Vec<Bound<'py, View>>,
        ground_values: Option<GroundTuple>,
        model_values: ModelTuple,
        scope: ScopeTuple,
        world_from_object: Floats2,
        z: Floats1,
        d: Floats1,
        velocity: Floats1,
        per_vertex: bool,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>)> {
        let views = core_views(&views);
        let (ground, model, state) =
            (ground(ground_values)?, model(model_values)?, state(&world_from_object, &z, &d, &velocity)?);
        let scope = Scope { modes: scope.0, free_form: scope.1, velocity: scope.2 };
        let found = py
            .detach(|| object::uncertainty(&self.inner, &views, ground, model, scope, &state, per_vertex))
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
    #[allow(clippy::too_many_arguments)] // the binding of one function
    fn covariance<'py>(
        &self,
        py: Python<'py>,
        views: Vec<Bound<'py, View>>,
        ground_values: Option<GroundTuple>,
        model_values: ModelTuple,
        scope: ScopeTuple,
        world_from_object: Floats2,
        z: Floats1,
        d: Floats1,
        velocity: Floats1,
        blocks: Vec<String>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let views = core_views(&views);
        let (ground, model, state) =
            (ground(ground_values)?, model(model_values)?, state(&world_from_object, &z, &d, &velocity)?);
        let scope = Scope { modes: scope.0, free_form: scope.1, velocity: scope.2 };
        let blocks = blocks.iter().map(|name| block(name, scope)).collect::<PyResult<Vec<Block>>>()?;
        let found = py
            .detach(|| object::block_covariance(&self.inner, &views, ground, model, scope, &state, &blocks))
            .map_err(to_python)?;
        let rows: Vec<Vec<f64>> = found.row_iter().map(|row| row.iter().copied().collect()).collect();
        Ok(PyArray2::from_vec2(py, &rows)?)
    }

    /// Signed distances from each border point to the outline, an array a view.
    #[allow(clippy::too_many_arguments)] // the binding of one function
    fn border_distances<'py>(
        &self,
        py: Python<'py>,
        views: Vec<Bound<'py, View>>,
        world_from_object: Floats2,
        z: Floats1,
        d: Floats1,
        velocity: Floats1,
        step_px: f64,
    ) -> PyResult<Vec<Bound<'py, PyArray1<f64>>>> {
        let views = core_views(&views);
        let state = state(&world_from_object, &z, &d, &velocity)?;
        check_shape("z", &[state.z.len()], &[Some(self.inner.mode_count)])?;
        check_shape("d", &[state.d.len()], &[Some(self.inner.symmetry.dimension())])?;
        if !(step_px.is_finite() && step_px > 0.0) {
            return Err(PyValueError::new_err(format!("step_px must be positive, found {step_px}")));
        }
        let of = |view: &&CoreView| object::border_distances(&self.inner, view, &state, step_px);
        let found: Vec<Vec<f64>> = py.detach(|| views.iter().map(of).collect());
        Ok(found.into_iter().map(|row| PyArray1::from_vec(py, row)).collect())
    }

    /// A view's cost near a relative pose: (root, cost, observations), `root` as the core has it.
    #[allow(clippy::too_many_arguments)] // the binding of one function
    fn square_root<'py>(
        &self,
        py: Python<'py>,
        view: Bound<'py, View>,
        model_values: ModelTuple,
        camera_from_object: Floats2,
        z: Floats1,
        d: Floats1,
        modes: bool,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, f64, f64)> {
        let (model, pose) = (model(model_values)?, pose("camera_from_object", &camera_from_object)?);
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
        views: Vec<Bound<'py, View>>,
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

/// The block of a name, which must be among those that are estimated.
fn block(name: &str, scope: Scope) -> PyResult<Block> {
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

fn core_views<'a>(views: &'a [Bound<View>]) -> Vec<&'a CoreView> {
    views.iter().map(|v| &v.get().inner).collect()
}

fn state(world_from_object: &Floats2, z: &Floats1, d: &Floats1, velocity: &Floats1) -> PyResult<ObjectState> {
    Ok(ObjectState {
        world_from_object: pose("world_from_object", world_from_object)?,
        z: z.as_array().to_vec(),
        d: d.as_array().to_vec(),
        velocity: vector("velocity", velocity)?,
    })
}

#[pymethods]
impl View {
    #[new]
    #[allow(clippy::too_many_arguments)] // the fields of a view
    fn new(
        camera_values: CameraTuple,
        world_from_camera: Floats2,
        time_s: f64,
        origin: (i64, i64),
        distance_px: PyReadonlyArray2<f32>,
        cut: PyReadonlyArray2<u8>,
        hidden: PyReadonlyArray2<u8>,
        border: Floats2,
        border_length: Floats1,
        border_own: PyReadonlyArray1<bool>,
        keypoint_index: PyReadonlyArray1<i64>,
        keypoint_pixels: Floats2,
        keypoint_sigma_px: Floats1,
        keypoint_count: usize,
    ) -> PyResult<Self> {
        let (height, width) = (distance_px.shape()[0], distance_px.shape()[1]);
        check_shape("cut", cut.shape(), &[Some(height), Some(width)])?;
        check_shape("hidden", hidden.shape(), &[Some(height), Some(width)])?;
        let border = pixels("border", &border)?;
        check_shape("border_length", border_length.shape(), &[Some(border.len())])?;
        check_shape("border_own", border_own.shape(), &[Some(border.len())])?;
        let keypoints = keypoints(&keypoint_index, &keypoint_pixels, &keypoint_sigma_px)?;
        let (length, own) = (border_length.as_array(), border_own.as_array());
        let border = border
            .into_iter()
            .enumerate()
            .map(|(i, pixel)| BorderPoint { pixel, length: length[i], own: own[i] })
            .collect();
        let inner = CoreView {
            camera: camera(camera_values)?,
            world_from_camera: pose("world_from_camera", &world_from_camera)?,
            time_s,
            crop: Rect { x0: origin.0, y0: origin.1, width, height },
            distance_px: picture(&distance_px),
            cut: picture(&cut),
            hidden: picture(&hidden),
            border,
            area_px: 0,
            border_length_px: 0.0,
            surface_sigma_px: 0.0,
            keypoints,
        };
        Ok(Self { inner: inner.checked(keypoint_count).map_err(to_python)? })
    }

    /// The same view, where the true surface may lie this far from any mesh.
    fn with_surface_sigma(&self, sigma_px: f64) -> PyResult<Self> {
        check_sigma("surface", sigma_px)?;
        Ok(Self { inner: CoreView { surface_sigma_px: sigma_px, ..self.inner.clone() } })
    }

    /// The same view, where each key point's pixel sigma grows by this one, in variance.
    fn with_keypoint_sigma(&self, sigma_px: f64) -> PyResult<Self> {
        check_sigma("key point", sigma_px)?;
        let mut inner = self.inner.clone();
        for keypoint in &mut inner.keypoints {
            keypoint.sigma_px = keypoint.sigma_px.hypot(sigma_px);
        }
        Ok(Self { inner })
    }
}

fn check_sigma(whose: &str, sigma_px: f64) -> PyResult<()> {
    if sigma_px.is_finite() && sigma_px >= 0.0 {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("a {whose}'s sigma must not be negative, found {sigma_px}")))
}

/// Pixels row by row.
fn picture<T: numpy::Element + Copy>(pixels: &PyReadonlyArray2<T>) -> Arc<[T]> {
    match pixels.as_slice() {
        Ok(contiguous) => contiguous.into(),
        Err(_) => pixels.as_array().iter().copied().collect(),
    }
}

fn keypoints(
    index: &PyReadonlyArray1<i64>,
    pixel_array: &Floats2,
    sigma_px: &Floats1,
) -> PyResult<Vec<KeypointObservation>> {
    let seen = pixels("keypoint_pixels", pixel_array)?;
    check_shape("keypoint_index", index.shape(), &[Some(seen.len())])?;
    check_shape("keypoint_sigma_px", sigma_px.shape(), &[Some(seen.len())])?;
    let (index, sigma) = (index.as_array(), sigma_px.as_array());
    seen.into_iter()
        .enumerate()
        .map(|(i, pixel)| {
            let number = usize::try_from(index[i]).map_err(|_| {
                pyo3::exceptions::PyIndexError::new_err(format!("key point index {} is negative", index[i]))
            })?;
            Ok(KeypointObservation { index: number, pixel, sigma_px: sigma[i] })
        })
        .collect()
}
