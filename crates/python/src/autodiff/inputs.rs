//! Arrays of any batch shape as views: broadcasting, and checks of what they hold.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use meshslam_core::batch::Placed;
use meshslam_core::camera::Camera;
use meshslam_core::error::check_finite;
use meshslam_core::lie::Pose;
use meshslam_core::mesh::Topology;
use nalgebra::{Matrix3, Vector3};
use numpy::{Element, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Ints2, faces, to_python};

/// A picture has no more pixels than this.
const MOST_PIXELS: usize = 1 << 28;

/// A floating type that arrays have.
pub trait Real: Element + Copy {
    fn of(value: f64) -> Self;
    fn get(self) -> f64;
}

impl Real for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn get(self) -> f64 {
        self
    }
}

impl Real for f32 {
    fn of(value: f64) -> Self {
        value as f32
    }
    fn get(self) -> f64 {
        f64::from(self)
    }
}

/// An array of either precision.
#[derive(FromPyObject)]
pub enum Reals<'py> {
    Double(PyReadonlyArrayDyn<'py, f64>),
    Single(PyReadonlyArrayDyn<'py, f32>),
}

impl Reals<'_> {
    pub fn shape(&self) -> &[usize] {
        match self {
            Self::Double(array) => array.shape(),
            Self::Single(array) => array.shape(),
        }
    }

    pub fn is_single(&self) -> bool {
        matches!(self, Self::Single(_))
    }

    /// All values, row by row.
    pub fn flat(&self) -> Vec<f64> {
        match self {
            Self::Double(array) => array.as_array().iter().copied().collect(),
            Self::Single(array) => array.as_array().iter().map(|&v| f64::from(v)).collect(),
        }
    }
}

pub fn finite(what: &'static str, values: &[f64]) -> PyResult<()> {
    check_finite(what, values).map_err(to_python)
}

/// A batch, and which entry of each input belongs to each of its views.
pub struct Broadcast {
    pub shape: Vec<usize>,
    pub indices: Vec<Vec<usize>>,
}

/// NumPy's rule: shapes are aligned at their ends, and a dimension of 1 serves any length.
pub fn broadcast(shapes: &[&[usize]]) -> PyResult<Broadcast> {
    let dimensions = shapes.iter().map(|s| s.len()).max().unwrap_or(0);
    let mut shape = vec![1; dimensions];
    for own in shapes {
        for (all, &n) in shape.iter_mut().rev().zip(own.iter().rev()).filter(|(_, n)| **n != 1) {
            if *all != 1 && *all != n {
                return Err(PyValueError::new_err(format!("batches of shapes {shapes:?} do not go together")));
            }
            *all = n;
        }
    }
    let count = shape.iter().try_fold(1usize, |product, &n| product.checked_mul(n));
    let Some(count) = count.filter(|n| *n <= MOST_PIXELS) else {
        return Err(PyValueError::new_err(format!("a batch of shape {shape:?} is too large")));
    };
    let index = |own: &[usize], view: usize| {
        let (mut rest, mut stride, mut at) = (view, 1, 0);
        for (axis, &n) in shape.iter().enumerate().rev() {
            let here = (axis + own.len()).checked_sub(dimensions).map_or(1, |k| own[k]);
            at += if here == 1 { 0 } else { rest % n * stride };
            stride *= here;
            rest /= n;
        }
        at
    };
    let indices = shapes.iter().map(|own| (0..count).map(|view| index(own, view)).collect()).collect();
    Ok(Broadcast { shape, indices })
}

/// Vertices (…, V, 3), faces (F, 3), camera_from_object (…, 4, 4), and intrinsics (…, 5): fx, fy, cx, cy, skew.
#[derive(FromPyObject)]
pub struct Inputs<'py>(Reals<'py>, Ints2<'py>, Reals<'py>, PyReadonlyArrayDyn<'py, f64>);

impl Inputs<'_> {
    /// Whether the vertices, and therefore the results, are of single precision.
    pub fn is_single(&self) -> bool {
        self.0.is_single()
    }
}

/// Checked inputs, each entry once.
pub struct Scene {
    pub topology: Arc<Topology>,
    pub vertex_count: usize,
    pub size: (usize, usize),
    vertices: Vec<Vector3<f64>>,
    poses: Vec<Pose>,
    cameras: Vec<Camera>,
}

impl Scene {
    /// Check and read inputs; their batch has the indices of vertices, poses, cameras, and of one more input whose leading
    /// dimensions are given.
    pub fn new(
        Inputs(vertices, face_array, camera_from_object, intrinsics): &Inputs,
        size: (usize, usize),
        more: &[usize],
    ) -> PyResult<(Self, Broadcast)> {
        let (width, height) = size;
        if width == 0 || height == 0 || width.saturating_mul(height) > MOST_PIXELS {
            return Err(PyValueError::new_err(format!("pictures of {width}x{height} pixels cannot be drawn")));
        }
        let shapes = (vertices.shape(), camera_from_object.shape(), intrinsics.shape());
        let ([vertex_batch @ .., vertex_count, 3], [pose_batch @ .., 4, 4], [camera_batch @ .., 5]) = shapes else {
            return Err(PyValueError::new_err(format!(
                "vertices must have shape (..., V, 3), camera_from_object (..., 4, 4) and intrinsics (..., 5), found {:?}, \
                 {:?} and {:?}",
                shapes.0, shapes.1, shapes.2
            )));
        };
        let batch = broadcast(&[vertex_batch, pose_batch, camera_batch, more])?;
        let points = vertices.flat();
        finite("vertices", &points)?;
        let cameras: Vec<f64> = intrinsics.as_array().iter().copied().collect();
        let camera = |k: &[f64]| Camera { width, height, fx: k[0], fy: k[1], cx: k[2], cy: k[3], skew: k[4] }.checked();
        let scene = Self {
            topology: topology(*vertex_count, &faces(face_array)?)?,
            vertex_count: *vertex_count,
            size,
            vertices: points.chunks_exact(3).map(Vector3::from_column_slice).collect(),
            poses: read_poses(&camera_from_object.flat())?,
            cameras: cameras.chunks_exact(5).map(camera).collect::<Result<_, _>>().map_err(to_python)?,
        };
        Ok((scene, batch))
    }

    pub fn views(&self, batch: &Broadcast) -> Vec<Placed<'_>> {
        let count = batch.indices[0].len();
        let placed = |view: usize| Placed {
            vertices: &self.vertices[batch.indices[0][view] * self.vertex_count..][..self.vertex_count],
            camera_from_object: self.poses[batch.indices[1][view]],
            camera: self.cameras[batch.indices[2][view]],
        };
        (0..count).map(placed).collect()
    }
}

/// Matrices of 16 entries; the last row is not read.
fn read_poses(entries: &[f64]) -> PyResult<Vec<Pose>> {
    let mut out = Vec::with_capacity(entries.len() / 16);
    for m in entries.chunks_exact(16) {
        finite("camera_from_object", &m[..12])?;
        let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
        out.push(Pose { rotation, translation: Vector3::new(m[3], m[7], m[11]) });
    }
    Ok(out)
}

/// How many topologies are kept.
const KEPT: usize = 16;

/// The topology of a face list: the last few are kept, since an optimizer asks for the same one thousands of times.
fn topology(vertex_count: usize, faces: &[[i64; 3]]) -> PyResult<Arc<Topology>> {
    type Known = VecDeque<(Vec<[i64; 3]>, Arc<Topology>)>;
    static KNOWN: Mutex<Known> = Mutex::new(VecDeque::new());
    let failed = |e: String| PyValueError::new_err(format!("topologies that are kept: {e}"));
    let same = |known: &(Vec<[i64; 3]>, Arc<Topology>)| known.1.vertex_count == vertex_count && known.0 == faces;
    if let Some((_, found)) = KNOWN.lock().map_err(|e| failed(e.to_string()))?.iter().find(|k| same(k)) {
        return Ok(found.clone());
    }
    let made = Arc::new(Topology::new(vertex_count, faces).map_err(to_python)?);
    let mut known = KNOWN.lock().map_err(|e| failed(e.to_string()))?;
    known.push_front((faces.to_vec(), made.clone()));
    known.truncate(KEPT);
    Ok(made)
}
