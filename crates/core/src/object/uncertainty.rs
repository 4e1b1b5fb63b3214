//! Uncertainty of an estimate: the inverse of its normal matrix.

use nalgebra::{DMatrix, Matrix6, Vector3};

use super::model::{Model, Scope};
use super::problem::ObjectProblem;
use super::state::ObjectState;
use crate::error::Result;
use crate::residuals::Rows;
use crate::residuals::ground::Ground;
use crate::solve::envelope::Envelope;
use crate::solve::levenberg_marquardt::{Problem, covariance};
use crate::template::Template;
use crate::view::View;

/// Uncertainty of an estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    /// Covariance of the pose whose origin is the centre of the mesh's bounding box: right perturbation, (translation, rotation).
    pub pose_covariance: Matrix6<f64>,
    /// Standard deviation of each vertex in the object's frame, root mean square over the axes, metres; empty unless asked for.
    pub vertex_sigma_m: Vec<f64>,
    /// Which vertices (or their mirror images) some view or key point fixes.
    pub vertex_observed: Vec<bool>,
}

/// A block of an object's parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Block {
    /// Right perturbation of `world_from_object`: translation, rotation.
    Pose,
    /// Coefficients of the modes.
    Modes,
    /// Free-form displacement, in the order of the symmetry basis.
    FreeForm,
    /// Velocity in the world.
    Velocity,
}

/// A vertex is observed where the measurements alone fix it along some direction to this, metres.
const OBSERVED_SIGMA_M: f64 = 0.05;

/// Uncertainty from the inverse of the normal matrix at `state`.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] where nothing holds a parameter, [`Error::Length`] if the state does not fit.
pub fn uncertainty(
    template: &Template,
    views: &[&View],
    ground: Option<Ground>,
    model: Model,
    scope: Scope,
    state: &ObjectState,
    per_vertex: bool,
) -> Result<Uncertainty> {
    state.check(template)?;
    let mut problem = ObjectProblem::new(template, views, ground, model, scope).with_shared_keypoint_offsets();
    let mut factor = problem.structure();
    let mut gradient = vec![0.0; factor.size()];
    problem.linearize(state, &mut factor, &mut gradient);
    let vertex_observed = observed_vertices(&problem, state);
    factor.factorize()?;
    let vertices = template.vertices(&state.z, &state.d);
    let pose_covariance = centre_covariance(&problem, &factor, &vertices);
    let vertex_sigma_m = if per_vertex { vertex_sigmas(&problem, &factor) } else { Vec::new() };
    Ok(Uncertainty { pose_covariance, vertex_sigma_m, vertex_observed })
}

/// Joint covariance of chosen blocks at `state`, in their order; empty for a block that is not in `scope`.
///
/// # Errors
/// As [`uncertainty`].
pub fn block_covariance(
    template: &Template,
    views: &[&View],
    ground: Option<Ground>,
    model: Model,
    scope: Scope,
    state: &ObjectState,
    blocks: &[Block],
) -> Result<DMatrix<f64>> {
    state.check(template)?;
    let mut problem = ObjectProblem::new(template, views, ground, model, scope).with_shared_keypoint_offsets();
    let chosen: Vec<usize> = blocks.iter().flat_map(|&block| parameters(&problem, block)).collect();
    covariance(&mut problem, state, &chosen)
}

/// Where a block's parameters stand in the normal equations.
fn parameters(problem: &ObjectProblem, block: Block) -> Vec<usize> {
    let ObjectProblem { layout, scope, template, .. } = problem;
    let base = layout.free_form;
    match block {
        Block::Pose => (base..base + 6).collect(),
        Block::Modes if scope.modes => (base + 6..base + 6 + template.mode_count).collect(),
        Block::FreeForm => layout.position.clone(),
        Block::Velocity if scope.velocity => (base + layout.velocity_start()..base + layout.dense).collect(),
        Block::Modes | Block::Velocity => Vec::new(),
    }
}

/// Rows (as columns of the transpose) of a vertex's derivative over the shape's parameters.
fn shape_derivative(problem: &ObjectProblem, vertex: usize) -> [Vec<(usize, f64)>; 3] {
    let mut out = [Vec::new(), Vec::new(), Vec::new()];
    if problem.scope.free_form {
        for (dof, axis, sign) in problem.template.symmetry.freedoms(vertex) {
            out[axis].push((problem.layout.position[dof], sign));
        }
    }
    if problem.scope.modes {
        let base = problem.layout.free_form + 6;
        for (k, mode) in problem.template.modes_of(vertex).iter().enumerate() {
            (0..3).for_each(|axis| out[axis].push((base + k, mode[axis])));
        }
    }
    out
}

/// L⁻¹ aᵀ of a sparse row a.
fn half_solve(factor: &Envelope, row: &[(usize, f64)]) -> Vec<f64> {
    let mut x = vec![0.0; factor.size()];
    row.iter().for_each(|&(i, value)| x[i] += value);
    let from = row.iter().map(|&(i, _)| i).min().unwrap_or(0);
    factor.forward(&mut x, from);
    x
}

/// Covariance of the pose at the mesh's centre c: its perturbation is (ρ + φ × c + ∂c, φ), and c moves with the shape.
fn centre_covariance(problem: &ObjectProblem, factor: &Envelope, vertices: &[Vector3<f64>]) -> Matrix6<f64> {
    let base = problem.layout.free_form;
    let (mut centre, mut rows) = (Vector3::zeros(), vec![Vec::new(); 6]);
    for axis in 0..3 {
        let by = |a: &usize, b: &usize| vertices[*a][axis].total_cmp(&vertices[*b][axis]);
        let (low, high) = ((0..vertices.len()).min_by(by).unwrap_or(0), (0..vertices.len()).max_by(by).unwrap_or(0));
        centre[axis] = 0.5 * (vertices[low][axis] + vertices[high][axis]);
        for end in [low, high] {
            rows[axis].extend(shape_derivative(problem, end)[axis].iter().map(|&(i, value)| (i, 0.5 * value)));
        }
    }
    for axis in 0..3 {
        rows[axis].push((base + axis, 1.0));
        rows[axis + 3].push((base + 3 + axis, 1.0));
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3); // (φ × c)_i = φ_j c_k − φ_k c_j
        rows[axis].push((base + 3 + j, centre[k]));
        rows[axis].push((base + 3 + k, -centre[j]));
    }
    let solved: Vec<Vec<f64>> = rows.iter().map(|row| half_solve(factor, row)).collect();
    Matrix6::from_fn(|i, j| solved[i].iter().zip(&solved[j]).map(|(a, b)| a * b).sum())
}

fn vertex_sigmas(problem: &ObjectProblem, factor: &Envelope) -> Vec<f64> {
    let symmetry = &problem.template.symmetry;
    let of_block: Vec<f64> = symmetry
        .representative
        .iter()
        .map(|&v| {
            let variance: f64 = shape_derivative(problem, v as usize)
                .iter()
                .map(|row| half_solve(factor, row).iter().map(|x| x * x).sum::<f64>())
                .sum();
            (variance / 3.0).sqrt()
        })
        .collect();
    symmetry.block_of.iter().map(|&b| of_block[b as usize]).collect()
}

fn observed_vertices(problem: &ObjectProblem, state: &ObjectState) -> Vec<bool> {
    let symmetry = &problem.template.symmetry;
    let vertices = problem.template.vertices(&state.z, &state.d);
    let mut rows = Rows::default();
    for view in problem.views {
        problem.sight(view, state, &vertices).push_rows(&problem.keypoint_views, &mut rows);
    }
    let mut information = vec![0.0; symmetry.representative.len()];
    for (row, terms) in rows.iter() {
        let weight = row.weight * row.kernel.weight(row.residual * row.residual);
        for term in terms {
            information[symmetry.block_of[term.vertex as usize] as usize] += weight * term.gradient.norm_squared();
        }
    }
    let enough = 1.0 / (OBSERVED_SIGMA_M * OBSERVED_SIGMA_M);
    symmetry.block_of.iter().map(|&b| information[b as usize] >= enough).collect()
}
