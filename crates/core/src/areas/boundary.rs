//! The boundary of a mesh's region on the image, in pieces of its edges.

use nalgebra::{Vector2, Vector3};

use crate::camera::Camera;
use crate::raster::{NEAR_M, Rect};
use crate::silhouette::Silhouette;
use crate::visible::Visible;

/// Part of an edge that bounds the region: from parameter to parameter of the way from its first end to its second. The outer
/// side of a way (x, y) is at (−y, x).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    /// Points of [`Boundary::points`].
    pub ends: [u32; 2],
    pub from: f64,
    pub to: f64,
}

/// Where the near plane cuts the edge between two vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cut {
    pub vertices: [u32; 2],
    /// Share of the second vertex.
    pub share: f64,
}

/// The boundary with what is inside of it.
#[derive(Debug, Clone, Default)]
pub(super) struct Boundary {
    /// The pixels drawn.
    pub rect: Rect,
    /// Pixels of the vertices, then those of `cuts`; meaningless for vertices behind the near plane.
    pub points: Vec<Vector2<f64>>,
    pub cuts: Vec<Cut>,
    pub segments: Vec<Segment>,
    /// Runs of pixels whose centres are covered, as in [`Silhouette::spans`].
    pub spans: Vec<(u32, u32, u32)>,
    /// First span of each row; one entry more than rows.
    pub span_start: Vec<u32>,
    visible: Visible,
}

impl Boundary {
    /// Take it from a silhouette that was drawn by its contour.
    pub fn of_contour(&mut self, drawn: &Silhouette) {
        self.cuts.clear();
        self.rect = drawn.rect;
        self.points.clone_from(&drawn.pixels);
        self.spans.clone_from(&drawn.spans);
        self.span_start.clone_from(&drawn.span_start);
        self.visible.find(drawn);
        self.segments.clear();
        self.segments.extend(self.visible.pieces.iter().map(|piece| Segment {
            ends: drawn.contour.edges[piece.edge as usize],
            from: piece.from,
            to: piece.to,
        }));
    }

    /// Pass a gradient over a point's pixel on to the vertices that it follows from, in the camera's frame.
    pub fn lift(
        &self,
        camera: &Camera,
        points_in_camera: &[Vector3<f64>],
        point: usize,
        on_image: &Vector2<f64>,
        add: &mut impl FnMut(usize, Vector3<f64>),
    ) {
        let Some(cut) = point.checked_sub(points_in_camera.len()).map(|k| self.cuts[k]) else {
            let jacobian = camera.projection_jacobian(&points_in_camera[point]);
            add(point, jacobian.transpose() * on_image);
            return;
        };
        // x = p + s (q − p) with x_z held at the near plane: ds = −((1 − s) dp_z + s dq_z) / (q_z − p_z)
        let [first, second] = cut.vertices.map(|v| v as usize);
        let (p, q) = (points_in_camera[first], points_in_camera[second]);
        let along = q - p;
        let mut at = p + along * cut.share;
        at.z = NEAR_M;
        let mut pull = camera.projection_jacobian(&at).transpose() * on_image;
        pull.z -= pull.dot(&along) / along.z;
        add(first, pull * (1.0 - cut.share));
        add(second, pull * cut.share);
    }
}
