//! One residual's row over an object's parameters, and its part of the normal equations.

use nalgebra::Vector3;

use super::layout::Layout;
use super::model::Scope;
use crate::lie::Pose;
use crate::residuals::{Row, Term, object_derivative};
use crate::solve::envelope::Envelope;
use crate::template::Template;

/// Where and over what rows are differentiated.
pub(super) struct RowDerivative<'a> {
    pub template: &'a Template,
    pub layout: &'a Layout,
    pub scope: Scope,
    /// In the object's frame.
    pub vertices: &'a [Vector3<f64>],
    pub world_from_object: &'a Pose,
}

impl RowDerivative<'_> {
    /// Add a row to the normal equations.
    pub fn add(&self, row: &Row, terms: &[Term], hessian: &mut Envelope, gradient: &mut [f64]) {
        let weight = row.weight * row.kernel.weight(row.residual * row.residual);
        if weight == 0.0 {
            return;
        }
        let dense = self.dense(row, terms);
        let sparse = if self.scope.free_form { self.sparse(terms) } else { Vec::new() };
        for (n, &(i, a)) in sparse.iter().enumerate() {
            gradient[i] += weight * a * row.residual;
            for &(j, b) in &sparse[..=n] {
                hessian.add(i, j, weight * a * b);
            }
        }
        let base = self.layout.free_form;
        for (k, &a) in dense.iter().enumerate() {
            let scaled = weight * a;
            gradient[base + k] += scaled * row.residual;
            for &(j, b) in &sparse {
                hessian.add(base + k, j, scaled * b);
            }
            for (entry, b) in hessian.run_mut(base + k, base, k + 1).iter_mut().zip(&dense) {
                *entry += scaled * b;
            }
        }
    }

    /// Over pose, modes and velocity.
    fn dense(&self, row: &Row, terms: &[Term]) -> Vec<f64> {
        let mut out = vec![0.0; self.layout.dense];
        out[..6].copy_from_slice(object_derivative(terms, self.vertices).as_slice());
        if self.scope.modes {
            for term in terms {
                for (entry, mode) in out[6..].iter_mut().zip(self.template.modes_of(term.vertex as usize)) {
                    *entry += term.gradient.dot(mode);
                }
            }
        }
        if self.scope.velocity {
            let force: Vector3<f64> = terms.iter().map(|term| term.gradient).sum();
            let start = self.layout.velocity_start();
            out[start..].copy_from_slice((self.world_from_object.rotation * force * row.time_s).as_slice());
        }
        out
    }

    /// Over the free-form parameters, each named once.
    fn sparse(&self, terms: &[Term]) -> Vec<(usize, f64)> {
        let mut out: Vec<(usize, f64)> = Vec::with_capacity(3 * terms.len());
        for term in terms {
            for (dof, axis, sign) in self.template.symmetry.freedoms(term.vertex as usize) {
                let (at, value) = (self.layout.position[dof], sign * term.gradient[axis]);
                match out.iter_mut().find(|(i, _)| *i == at) {
                    Some((_, sum)) => *sum += value,
                    None => out.push((at, value)),
                }
            }
        }
        out
    }
}
