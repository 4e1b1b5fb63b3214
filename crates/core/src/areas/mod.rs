//! Exact areas: how much of each pixel a mesh covers, and the derivative of any loss over these shares.
//!
//! The share of a pixel is the area that the mesh's region and the pixel have in common. By Green's theorem it follows from
//! the region's boundary alone, and so does its derivative: a boundary that moves by n·dx sweeps n·dx dl (Reynolds'
//! transport theorem). Both are exact up to rounding, so that central differences of the shares agree with the derivative.

mod boundary;
mod cells;
mod general;

use nalgebra::{Matrix3x4, Vector2, Vector3};

use crate::camera::Camera;
use crate::lie::Pose;
use crate::mesh::Topology;
use crate::raster::{NEAR_M, Rect};
use crate::silhouette::Silhouette;
use boundary::Boundary;
use cells::Cells;
pub use cells::Touched;
use general::General;

/// A loss's gradient in one view.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewGradient {
    /// Over the vertices in the object's frame, 1/m.
    pub vertices: Vec<Vector3<f64>>,
    /// Over the twelve entries (R | t) of the matrix that takes them to the camera, each for itself.
    pub camera_from_object: Matrix3x4<f64>,
}

/// A mesh drawn by areas; buffers that one drawing after another reuses.
#[derive(Debug, Clone, Default)]
pub struct Areas {
    silhouette: Silhouette,
    boundary: Boundary,
    general: General,
    cells: Cells,
    points: Vec<Vector3<f64>>,
    on_image: Vec<Vector2<f64>>,
}

impl Areas {
    /// Draw a mesh; `pose` may be any affine map.
    pub fn draw(&mut self, camera: &Camera, pose: &Pose, vertices: &[Vector3<f64>], topology: &Topology) {
        self.points.clear();
        self.points.extend(vertices.iter().map(|v| pose.transform(v)));
        self.silhouette.draw(camera, &self.points, topology);
        let before = self.points.iter().all(|p| p.z >= NEAR_M);
        if self.silhouette.by_contour && topology.closed && before {
            self.boundary.of_contour(&self.silhouette);
        } else {
            self.general.find(&mut self.boundary, camera, &self.points, topology);
        }
        self.cells.find(&self.boundary);
    }

    /// The rectangle of pixels that the mesh may touch, within the image.
    #[must_use]
    pub fn rect(&self) -> Rect {
        self.boundary.rect
    }

    /// Runs (row, first column, column after the last), relative to [`Areas::rect`], whose centres are covered.
    #[must_use]
    pub fn spans(&self) -> &[(u32, u32, u32)] {
        &self.boundary.spans
    }

    /// The pixels that the boundary passes through; of every other pixel all is covered if its centre is, else nothing.
    #[must_use]
    pub fn touched(&self) -> &[Touched] {
        &self.cells.touched
    }

    /// Gradient of a loss from its slope over the share of each pixel, given by column and row of [`Areas::rect`].
    pub fn gradient(
        &mut self,
        camera: &Camera,
        pose: &Pose,
        vertices: &[Vector3<f64>],
        slope: impl Fn(usize, usize) -> f64,
    ) -> ViewGradient {
        let Self { boundary, cells, points, on_image, .. } = self;
        on_image.clear();
        on_image.resize(boundary.points.len(), Vector2::zeros());
        cells.pull(boundary, slope, on_image);
        let mut out =
            ViewGradient { vertices: vec![Vector3::zeros(); vertices.len()], camera_from_object: Matrix3x4::zeros() };
        let back = pose.rotation.transpose();
        let mut add = |vertex: usize, in_camera: Vector3<f64>| {
            let v = &vertices[vertex];
            out.vertices[vertex] += back * in_camera;
            out.camera_from_object += in_camera * nalgebra::RowVector4::new(v.x, v.y, v.z, 1.0);
        };
        for (point, pull) in on_image.iter().enumerate().filter(|(_, g)| g.x != 0.0 || g.y != 0.0) {
            boundary.lift(camera, points, point, pull, &mut add);
        }
        out
    }
}
