//! Ways back through the mask: from L_mask = −I/U to vertices and poses.
//!
//! All of them end in one chain rule: a gradient over the vertices in the camera's frame becomes one over the vertices in
//! the object's frame and over right perturbations of both poses (paper, Proposition 2).

pub mod exact;
pub mod kato;
mod walk;

use nalgebra::{Matrix3, Vector2, Vector3, Vector6};

use crate::camera::Camera;
use crate::error::{Error, Result, check_length};
use crate::raster::Rect;

/// An observed mask, with sums along its rows that make an overlap with runs of pixels cheap.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedMask {
    /// The pixels that it covers; beyond them there is no mask.
    pub rect: Rect,
    /// 1 in the mask, row-major.
    pub mask: Vec<u8>,
    /// How many pixels of the row lie before each column; one more than columns.
    sums: Vec<u32>,
    /// Pixels in the mask.
    pub area: u64,
    /// The smallest rectangle that holds them.
    pub bounds: Rect,
}

impl ObservedMask {
    /// Take a mask of zeros and others.
    ///
    /// # Errors
    /// [`Error::Length`] if it does not fill the rectangle.
    pub fn new(rect: Rect, mask: &[u8]) -> Result<Self> {
        check_length("mask", mask.len(), rect.area())?;
        if rect.width > i32::MAX as usize || rect.height > i32::MAX as usize {
            return Err(Error::Range { what: "mask size", expected: "under 2^31", found: rect.width as f64 });
        }
        let mask: Vec<u8> = mask.iter().map(|&m| u8::from(m > 0)).collect();
        let mut sums = Vec::with_capacity(rect.height * (rect.width + 1));
        let mut area = 0;
        let (mut rows, mut columns) = (rect.height..0, rect.width..0);
        for row in 0..rect.height {
            let mut sum = 0;
            sums.push(0);
            let line = &mask[row * rect.width..(row + 1) * rect.width];
            if let (Some(first), Some(last)) = (line.iter().position(|&m| m > 0), line.iter().rposition(|&m| m > 0)) {
                rows = rows.start.min(row)..row + 1;
                columns = columns.start.min(first)..columns.end.max(last + 1);
            }
            for &m in line {
                sum += u32::from(m);
                sums.push(sum);
            }
            area += u64::from(sum);
        }
        let bounds = Rect {
            x0: rect.x0.saturating_add(columns.start as i64),
            y0: rect.y0.saturating_add(rows.start as i64),
            width: columns.len(),
            height: rows.len(),
        };
        Ok(Self { rect, mask, sums, area, bounds })
    }

    /// 1 if the pixel is in the mask.
    #[inline]
    #[must_use]
    pub fn at(&self, x: i64, y: i64) -> u8 {
        self.rect.index(x, y).map_or(0, |i| self.mask[i])
    }

    /// Pixels of the mask in columns `from..to` of row `y`.
    #[inline]
    #[must_use]
    pub fn count(&self, y: i64, from: i64, to: i64) -> u64 {
        let row = y - self.rect.y0;
        if row < 0 || row >= self.rect.height as i64 {
            return 0;
        }
        let column = |x: i64| (x - self.rect.x0).clamp(0, self.rect.width as i64) as usize;
        let base = row as usize * (self.rect.width + 1);
        u64::from(self.sums[base + column(to)] - self.sums[base + column(from)])
    }
}

/// The mask loss with its gradients.
#[derive(Debug, Clone, PartialEq)]
pub struct MaskGradient {
    /// L_mask = −I/U; −1 where both masks are empty.
    pub loss: f64,
    /// Pixels that both masks have.
    pub intersection: f64,
    /// Pixels that either has.
    pub union: f64,
    /// Over the vertices in the object's frame, 1/m.
    pub vertices: Vec<Vector3<f64>>,
    /// Over a right perturbation of `world_from_object`: (translation, rotation).
    pub object: Vector6<f64>,
    /// Over a right perturbation of `world_from_camera`: (translation, rotation).
    pub camera: Vector6<f64>,
}

/// ∂L/∂ŝ where the observed mask is and where it is not: −1/U and I/U² (paper, Proposition 1).
#[must_use]
pub fn loss_slopes(intersection: f64, union: f64) -> (f64, f64) {
    if union > 0.0 { (-1.0 / union, intersection / (union * union)) } else { (0.0, 0.0) }
}

/// From gradients over vertices' pixels to vertices and poses.
pub(crate) struct Chain<'a> {
    pub camera: &'a Camera,
    pub rotation: &'a Matrix3<f64>,
    pub points_in_camera: &'a [Vector3<f64>],
    pub points_in_object: &'a [Vector3<f64>],
}

impl Chain<'_> {
    /// A pixel's gradient as one over the point in the camera's frame.
    #[inline]
    pub fn lift(&self, point_in_camera: &Vector3<f64>, on_image: &Vector2<f64>) -> Vector3<f64> {
        self.camera.projection_jacobian(point_in_camera).transpose() * on_image
    }

    /// Gather everything from gradients over vertices in the camera's frame, each vertex at most once.
    pub fn gather(
        &self,
        loss: f64,
        intersection: f64,
        union: f64,
        in_camera: impl Iterator<Item = (usize, Vector3<f64>)>,
    ) -> MaskGradient {
        let back = self.rotation.transpose();
        let mut vertices: Vec<Vector3<f64>> = bytemuck::zeroed_vec(self.points_in_object.len());
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        let (mut push, mut twist) = (Vector3::zeros(), Vector3::zeros());
        for (i, g) in in_camera {
            if g.x == 0.0 && g.y == 0.0 && g.z == 0.0 {
                continue;
            }
            let in_object = back * g;
            vertices[i] = in_object;
            force += in_object;
            torque += self.points_in_object[i].cross(&in_object);
            push -= g;
            twist -= self.points_in_camera[i].cross(&g);
        }
        let join = |a: Vector3<f64>, b: Vector3<f64>| Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z);
        MaskGradient { loss, intersection, union, vertices, object: join(force, torque), camera: join(push, twist) }
    }
}
