//! `gradients` and `silhouette` of the core.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use meshslam_core::camera::Camera as CoreCamera;
use meshslam_core::error::check_finite;
use meshslam_core::gradients::exact::{Workspace, exact_gradient, held_gradient, prepared_gradient};
use meshslam_core::gradients::kato::{Picture, kato_gradient, pixel_gradient};
use meshslam_core::gradients::{MaskGradient, ObservedMask};
use meshslam_core::lie::Pose;
use meshslam_core::raster::Rect;
use meshslam_core::silhouette::Silhouette;
use nalgebra::Vector3;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::convert::{Floats1, Floats2, Ints2, check_shape, faces, pixels, points, pose_of, to_python};
use crate::named::Camera;
use crate::shared::{SharedMesh, locked};

/// The mask loss of one topology against one observed mask in one camera.
#[pyclass(frozen)]
pub struct MaskLoss {
    camera: CoreCamera,
    mesh: Arc<SharedMesh>,
    observed: ObservedMask,
}

/// (loss, intersection, union, over vertices, over the object's pose, over the camera's).
type Gradient<'py> = (f64, f64, f64, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

fn to_arrays<'py>(py: Python<'py>, g: MaskGradient) -> PyResult<Gradient<'py>> {
    let count = g.vertices.len();
    let flat = bytemuck::allocation::cast_vec::<_, [f64; 3]>(g.vertices).into_flattened();
    let rows = Array2::from_shape_vec((count, 3), flat).map_err(|e| PyValueError::new_err(e.to_string()))?;
    let object = PyArray1::from_slice(py, g.object.as_slice());
    let camera = PyArray1::from_slice(py, g.camera.as_slice());
    Ok((g.loss, g.intersection, g.union, rows.into_pyarray(py), object, camera))
}

fn vertex_rows(what: &'static str, array: &Floats2, count: usize) -> PyResult<Vec<Vector3<f64>>> {
    check_shape(what, array.shape(), &[Some(count), Some(3)])?;
    points(what, array)
}

#[pymethods]
impl MaskLoss {
    #[new]
    fn new(
        camera: Camera,
        vertex_count: usize,
        face_array: Ints2,
        mask: PyReadonlyArray2<u8>,
        origin: (i64, i64),
    ) -> PyResult<Self> {
        let mesh = SharedMesh::of(vertex_count, &faces(&face_array)?).map_err(to_python)?;
        let rect = Rect { x0: origin.0, y0: origin.1, width: mask.shape()[1], height: mask.shape()[0] };
        let values: Vec<u8> = mask.as_array().iter().copied().collect();
        let observed = ObservedMask::new(rect, &values).map_err(to_python)?;
        Ok(Self { camera: camera.0, mesh, observed })
    }

    /// Loss and gradient at a pose; `kato` takes Kato's gradient, else it is exact.
    fn gradient<'py>(
        &self,
        py: Python<'py>,
        rotation: Floats2,
        translation: Floats1,
        vertices: Floats2,
        kato: bool,
    ) -> PyResult<Gradient<'py>> {
        let pose = pose_of(&rotation, &translation)?;
        let found = self.mesh.with_workspace(|work| {
            self.hold(&vertices, work)?;
            Ok::<_, PyErr>(py.detach(|| self.evaluate(&pose, kato, work)))
        })?;
        to_arrays(py, found)
    }

    /// The mask as it is drawn over the whole image.
    fn draw<'py>(
        &self,
        py: Python<'py>,
        rotation: Floats2,
        translation: Floats1,
        vertices: Floats2,
    ) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let pose = pose_of(&rotation, &translation)?;
        let vertices = vertex_rows("vertices", &vertices, self.mesh.topology.vertex_count)?;
        let mut picture = Array2::zeros((self.camera.height, self.camera.width));
        let points: Vec<Vector3<f64>> = vertices.iter().map(|v| pose.transform(v)).collect();
        let mut drawn = Silhouette::default();
        drawn.draw_by_contour(&self.camera, &points, &self.mesh.topology);
        let rect = drawn.rect;
        for (i, _) in drawn.mask().iter().enumerate().filter(|(_, m)| **m > 0) {
            picture[[rect.y0 as usize + i / rect.width, rect.x0 as usize + i % rect.width]] = 1;
        }
        Ok(picture.into_pyarray(py))
    }

    /// Seconds of one exact evaluation, each of `runs`, without what crosses from Python.
    fn time(
        &self,
        py: Python,
        rotation: Floats2,
        translation: Floats1,
        vertices: Floats2,
        runs: usize,
    ) -> PyResult<Vec<f64>> {
        let pose = pose_of(&rotation, &translation)?;
        let topology = &self.mesh.topology;
        let vertices = vertex_rows("vertices", &vertices, topology.vertex_count)?;
        Ok(py.detach(|| {
            self.mesh.with_workspace(|work| {
                let mut once = || {
                    let start = std::time::Instant::now();
                    let pose = std::hint::black_box(&pose);
                    let found = exact_gradient(&self.camera, pose, &vertices, topology, &self.observed, work);
                    std::hint::black_box(found);
                    start.elapsed().as_secs_f64()
                };
                (0..runs).map(|_| once()).collect()
            })
        }))
    }
}

impl MaskLoss {
    /// Let a workspace hold vertices; what it holds already was checked before.
    fn hold(&self, vertices: &Floats2, work: &mut Workspace) -> PyResult<()> {
        let topology = &self.mesh.topology;
        let held = |flat: &[f64]| {
            vertices.shape() == [topology.vertex_count, 3] && work.recent.holds(topology, bytemuck::cast_slice(flat))
        };
        if !vertices.as_slice().is_ok_and(held) {
            work.recent.hold(topology, &vertex_rows("vertices", vertices, topology.vertex_count)?);
        }
        Ok(())
    }

    fn evaluate(&self, pose: &Pose, kato: bool, work: &mut Workspace) -> MaskGradient {
        let topology = &self.mesh.topology;
        if kato {
            kato_gradient(&self.camera, pose, work.recent.vertices(), topology, &self.observed)
        } else {
            held_gradient(&self.camera, pose, topology, &self.observed, work)
        }
    }
}

/// Work is parted into so many pieces for each thread, so that none waits long for another.
const PIECES_A_THREAD: usize = 4;

/// A pool of so many threads (0: all), started once.
pub fn pool(threads: usize) -> PyResult<Arc<ThreadPool>> {
    static POOLS: Mutex<BTreeMap<usize, Arc<ThreadPool>>> = Mutex::new(BTreeMap::new());
    let failed = |e: String| PyValueError::new_err(format!("no pool of {threads} threads: {e}"));
    let mut pools = POOLS.lock().map_err(|e| failed(e.to_string()))?;
    if let Some(pool) = pools.get(&threads) {
        return Ok(pool.clone());
    }
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| failed(e.to_string()))?;
    Ok(pools.entry(threads).or_insert(Arc::new(pool)).clone())
}

/// Exact loss and gradient of one mesh in many views, side by side on `threads` threads (0: all).
#[pyfunction]
pub fn mask_gradients<'py>(
    py: Python<'py>,
    losses: Vec<Bound<'py, MaskLoss>>,
    camera_from_object: Vec<(Floats2<'py>, Floats1<'py>)>,
    vertices: Floats2,
    threads: usize,
) -> PyResult<Vec<Gradient<'py>>> {
    check_shape("camera_from_object", &[camera_from_object.len()], &[Some(losses.len())])?;
    let poses: Vec<Pose> = camera_from_object.iter().map(|(r, t)| pose_of(r, t)).collect::<PyResult<_>>()?;
    let views: Vec<&MaskLoss> = losses.iter().map(|l| l.get()).collect();
    let count = views.first().map_or(0, |view| view.mesh.topology.vertex_count);
    let vertices = vertex_rows("vertices", &vertices, count)?;
    if let Some(odd) = views.iter().position(|view| view.mesh.topology.vertex_count != count) {
        return Err(PyValueError::new_err(format!("loss {odd} is of a mesh with another number of vertices")));
    }
    let pool = pool(threads)?;
    let found: Vec<MaskGradient> = py.detach(|| {
        let prepared = views.first().and_then(|view| {
            let mut recent = locked(&view.mesh.batches);
            recent.hold(&view.mesh.topology, &vertices);
            recent.ask(&view.mesh.topology, views.len())
        });
        let evaluate = |view: &MaskLoss, pose: &Pose, work: &mut Workspace| {
            let (camera, topology, observed) = (&view.camera, &view.mesh.topology, &view.observed);
            match prepared.as_deref().filter(|mesh| mesh.is_of(topology)) {
                Some(mesh) => prepared_gradient(camera, pose, mesh, topology, observed, work),
                None => exact_gradient(camera, pose, &vertices, topology, observed, work),
            }
        };
        pool.install(|| {
            // few pieces: each starts with buffers that are cold
            let piece = views.len().div_ceil(PIECES_A_THREAD * pool.current_num_threads()).max(1);
            let pieces = views.par_chunks(piece).zip(poses.par_chunks(piece));
            let evaluate_piece = |(views, poses): (&[&MaskLoss], &[Pose])| {
                let all = |work: &mut Workspace| views.iter().zip(poses).map(|(v, p)| evaluate(v, p, work)).collect();
                views.first().map_or_else(Vec::new, |view| view.mesh.with_workspace(all))
            };
            pieces.flat_map_iter(evaluate_piece).collect()
        })
    });
    found.into_iter().map(|g| to_arrays(py, g)).collect()
}

/// Kato's gradient over vertex pixels of a picture: which face each pixel shows, and the loss's slope there.
#[pyfunction]
pub fn kato_pixel_gradient<'py>(
    py: Python<'py>,
    vertex_pixels: Floats2,
    face_array: Ints2,
    face_index: PyReadonlyArray2<i32>,
    slope: Floats2,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let vertices = pixels("vertex_pixels", &vertex_pixels)?;
    let topology = meshslam_core::mesh::Topology::new(vertices.len(), &faces(&face_array)?).map_err(to_python)?;
    let (height, width) = (face_index.shape()[0], face_index.shape()[1]);
    check_shape("slope", slope.shape(), &[Some(height), Some(width)])?;
    let face: Vec<i32> = face_index.as_array().iter().copied().collect();
    if let Some(&odd) = face.iter().find(|f| **f >= topology.faces.len() as i32) {
        return Err(pyo3::exceptions::PyIndexError::new_err(format!(
            "face_index holds {odd}, there are {} faces",
            topology.faces.len()
        )));
    }
    let slope: Vec<f64> = slope.as_array().iter().copied().collect();
    check_finite("slope", &slope).map_err(to_python)?;
    let rect = Rect { x0: 0, y0: 0, width, height };
    let found = pixel_gradient(&vertices, &topology.faces, &Picture { rect, face: &face, slope: &slope });
    let rows: Vec<Vec<f64>> = found.iter().map(|g| vec![g.x, g.y]).collect();
    Ok(PyArray2::from_vec2(py, &rows)?)
}
