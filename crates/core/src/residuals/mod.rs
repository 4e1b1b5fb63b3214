//! Residuals over mesh vertices.
//!
//! Every residual of the observation model depends on the state only through positions of vertices, so a row holds
//! ∂r/∂v for the few vertices that it touches, in the object's frame. The derivative over the object's pose, the shape
//! and the camera follow from these by one chain rule: a right perturbation (ρ, φ) of the object moves a vertex by
//! ρ + φ × v, one of the camera moves it by the opposite in the camera's frame.

pub mod border;
pub mod ground;
pub mod keypoints;
pub mod nearest;
pub mod normal;

use nalgebra::{Vector3, Vector6};

use crate::kernel::Kernel;
use crate::lie::Pose;

/// ∂r/∂v of one vertex, in the object's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// The vertex.
    pub vertex: u32,
    /// Derivative of the whitened residual over its position, 1/m.
    pub gradient: Vector3<f64>,
}

/// One scalar residual, whitened by its sigma.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Residual over sigma.
    pub residual: f64,
    /// Weight beside the kernel: the share of an independent observation that the row is.
    pub weight: f64,
    /// The robust kernel.
    pub kernel: Kernel,
    /// When it was seen, seconds from the state's time.
    pub time_s: f64,
    first: u32,
    count: u32,
}

/// Residuals with their sparse derivatives.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Rows {
    rows: Vec<Row>,
    terms: Vec<Term>,
    constant: f64,
    time_s: f64,
}

impl Rows {
    /// Forget all rows, keep the memory.
    pub fn clear(&mut self) {
        self.rows.clear();
        self.terms.clear();
        self.constant = 0.0;
        self.time_s = 0.0;
    }

    /// Rows pushed from now on were seen at this time.
    pub fn set_time(&mut self, time_s: f64) {
        self.time_s = time_s;
    }

    /// Add a row.
    pub fn push(&mut self, residual: f64, weight: f64, kernel: Kernel, terms: impl IntoIterator<Item = Term>) {
        let first = self.terms.len() as u32;
        self.terms.extend(terms);
        let count = self.terms.len() as u32 - first;
        self.rows.push(Row { residual, weight, kernel, time_s: self.time_s, first, count });
    }

    /// Add a cost that no step changes: an observation that the model cannot explain where it is now.
    pub fn push_constant(&mut self, cost: f64) {
        self.constant += cost;
    }

    /// The rows with their terms.
    pub fn iter(&self) -> impl Iterator<Item = (&Row, &[Term])> {
        self.rows.iter().map(|row| (row, &self.terms[row.first as usize..(row.first + row.count) as usize]))
    }

    /// Robust cost ½ Σ w ρ(r²).
    #[must_use]
    pub fn cost(&self) -> f64 {
        self.constant
            + self.rows.iter().map(|row| 0.5 * row.weight * row.kernel.loss(row.residual * row.residual)).sum::<f64>()
    }

    /// How many rows there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no row.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }
}

/// Derivative of a row over a right perturbation of `world_from_object`.
#[must_use]
pub fn object_derivative(terms: &[Term], vertices: &[Vector3<f64>]) -> Vector6<f64> {
    let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
    for term in terms {
        force += term.gradient;
        torque += vertices[term.vertex as usize].cross(&term.gradient);
    }
    Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
}

/// Derivative of a row over a right perturbation of `world_from_camera`.
#[must_use]
pub fn camera_derivative(terms: &[Term], vertices: &[Vector3<f64>], camera_from_object: &Pose) -> Vector6<f64> {
    let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
    for term in terms {
        let gradient = camera_from_object.rotation * term.gradient;
        force -= gradient;
        torque -= camera_from_object.transform(&vertices[term.vertex as usize]).cross(&gradient);
    }
    Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
}
