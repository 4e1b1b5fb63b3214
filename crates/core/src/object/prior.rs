//! Priors of an object: z ~ N(0, I), d smooth and small, a velocity along the object's own x.

use nalgebra::Vector3;

use super::layout::Layout;
use super::model::{Model, Scope};
use super::state::ObjectState;
use crate::lie::hat;
use crate::solve::envelope::Envelope;
use crate::template::Template;

/// Standard deviations of an object's velocity along its own x (it may drive), y and z (it neither skids nor flies), m/s.
const VELOCITY_SIGMA_M_S: [f64; 3] = [10.0, 0.3, 0.2];

/// The priors of the blocks that move.
pub(super) struct Priors {
    scope: Scope,
    free_form: Option<Envelope>,
}

impl Priors {
    pub fn new(template: &Template, layout: &Layout, model: &Model, scope: Scope) -> Self {
        Self { scope, free_form: scope.free_form.then(|| free_form_prior(template, layout, model)) }
    }

    /// Cost at a state: z ~ N(0, I), d as in [`free_form_prior`].
    pub fn cost(&self, state: &ObjectState, layout: &Layout) -> f64 {
        let modes = if self.scope.modes { 0.5 * state.z.iter().map(|c| c * c).sum::<f64>() } else { 0.0 };
        let free_form = self.free_form.as_ref().map_or(0.0, |prior| {
            let d = layout.ordered(&state.d);
            0.5 * multiply(prior, &d, layout.free_form).iter().zip(&d).map(|(a, b)| a * b).sum::<f64>()
        });
        let velocity = if self.scope.velocity { 0.5 * whitened_velocity(state).norm_squared() } else { 0.0 };
        modes + free_form + velocity
    }

    /// Add their normal equations.
    pub fn add(&self, state: &ObjectState, layout: &Layout, hessian: &mut Envelope, gradient: &mut [f64]) {
        if self.scope.modes {
            let base = layout.free_form + 6;
            for (k, c) in state.z.iter().enumerate() {
                gradient[base + k] += c;
                hessian.add(base + k, base + k, 1.0);
            }
        }
        if self.scope.velocity {
            add_velocity(state, layout, hessian, gradient);
        }
        if let Some(prior) = &self.free_form {
            let product = multiply(prior, &layout.ordered(&state.d), layout.free_form);
            gradient.iter_mut().zip(&product).for_each(|(g, p)| *g += p);
            hessian.add_matrix(prior);
        }
    }
}

/// The velocity in the object's frame, in standard deviations.
fn whitened_velocity(state: &ObjectState) -> Vector3<f64> {
    let in_object = state.world_from_object.rotation.transpose() * state.velocity;
    in_object.component_div(&Vector3::from(VELOCITY_SIGMA_M_S))
}

/// Rows u/σ of the velocity u = Rᵀv in the object's frame: ∂u/∂v = Rᵀ, ∂u/∂φ = û.
fn add_velocity(state: &ObjectState, layout: &Layout, hessian: &mut Envelope, gradient: &mut [f64]) {
    let base = layout.free_form;
    let (turn, start) = (base + 3, base + layout.velocity_start());
    let rotation = state.world_from_object.rotation.transpose();
    let (residual, by_turn) = (whitened_velocity(state), hat(&(rotation * state.velocity)));
    for (k, sigma) in VELOCITY_SIGMA_M_S.into_iter().enumerate() {
        let entry = |n: usize| {
            if n < 3 { (turn + n, by_turn[(k, n)] / sigma) } else { (start + n - 3, rotation[(k, n - 3)] / sigma) }
        };
        for (i, a) in (0..6).map(entry) {
            gradient[i] += a * residual[k];
            (0..6).map(entry).filter(|&(j, _)| j <= i).for_each(|(j, b)| hessian.add(i, j, a * b));
        }
    }
}

/// Precision of d: each vertex stays near 0, and near its neighbours' average (normalized cotangent Laplacian of the mean).
fn free_form_prior(template: &Template, layout: &Layout, model: &Model) -> Envelope {
    let mut out = Envelope::new(layout.first.clone());
    let symmetry = &template.symmetry;
    for (block, neighbours) in template.laplacian.iter().enumerate() {
        let area = template.relative_area[block];
        let alone = area / model.free_form_sigma_m.powi(2);
        let together = 1.0 / (area * model.smoothness_sigma_m.powi(2));
        for dof in symmetry.offset[block]..symmetry.offset[block + 1] {
            out.add(layout.position[dof], layout.position[dof], alone);
        }
        for axis in 0..3 {
            let vertex = symmetry.representative[block] as usize;
            let mut row: Vec<(usize, f64)> = Vec::new();
            let mut push = |v: usize, share: f64| {
                for (dof, _, sign) in symmetry.freedoms(v).filter(|&(_, a, _)| a == axis) {
                    let at = layout.position[dof];
                    match row.iter_mut().find(|(i, _)| *i == at) {
                        Some((_, sum)) => *sum += share * sign,
                        None => row.push((at, share * sign)),
                    }
                }
            };
            push(vertex, 1.0);
            neighbours.iter().for_each(|&(v, share)| push(v as usize, -share));
            for n in 0..row.len() {
                for m in 0..=n {
                    out.add(row[n].0, row[m].0, together * row[n].1 * row[m].1);
                }
            }
        }
    }
    out
}

/// Product of the leading part of a symmetric matrix with a vector.
fn multiply(matrix: &Envelope, x: &[f64], size: usize) -> Vec<f64> {
    let mut out = vec![0.0; size];
    for i in 0..size {
        let (first, row) = matrix.row(i);
        let mut sum = row[i - first] * x[i];
        for (j, entry) in (first..i).zip(row) {
            sum += entry * x[j];
            out[j] += entry * x[i];
        }
        out[i] += sum;
    }
    out
}
