//! Levenberg–Marquardt (Marquardt 1963) over any problem that can be linearized.

use nalgebra::DMatrix;

use super::envelope::Envelope;
use crate::error::{Error, Result};

/// A sum of squares to be lowered.
pub trait Problem {
    /// What is estimated.
    type State: Clone;

    /// The true cost at a state: correspondences, visibility and kernels evaluated anew.
    fn cost(&mut self, state: &Self::State) -> f64;

    /// The normal equations at a state: add the Hessian's approximation and the gradient into cleared buffers, return the cost.
    fn linearize(&mut self, state: &Self::State, hessian: &mut Envelope, gradient: &mut [f64]) -> f64;

    /// A state moved by a step in its tangent space.
    fn retract(&self, state: &Self::State, step: &[f64]) -> Self::State;

    /// The zero matrix that [`Problem::linearize`] fills.
    fn structure(&self) -> Envelope;
}

/// When to stop and how to start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Linearizations at most.
    pub max_iterations: usize,
    /// First damping, relative to the diagonal.
    pub initial_damping: f64,
    /// Stop when a step lowers the cost by less than this share of it.
    pub relative_decrease: f64,
    /// Stop when a step lowers the cost by less than this.
    pub absolute_decrease: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { max_iterations: 30, initial_damping: 1e-3, relative_decrease: 1e-5, absolute_decrease: 1e-6 }
    }
}

/// Why it stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The cost fell by less than the tolerance.
    Converged,
    /// No damping gave a step that lowers the true cost.
    NoDescent,
    /// The iterations were used up.
    IterationLimit,
}

/// What one iteration did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iteration {
    /// Cost before the step.
    pub cost: f64,
    /// Cost after the accepted step; the same if none was accepted.
    pub new_cost: f64,
    /// Damping of the accepted (or last) try.
    pub damping: f64,
    /// Tries that did not lower the cost.
    pub rejected: usize,
}

/// How a run went; the state that it gives is the best it saw, also without convergence.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// One entry an iteration.
    pub iterations: Vec<Iteration>,
    /// Cost at the state returned.
    pub cost: f64,
    /// Why it stopped.
    pub stop: Stop,
}

const MAX_DAMPING: f64 = 1e8;
const MIN_DAMPING: f64 = 1e-9;

/// Lower the cost from `state`; a step is taken only if the true cost falls.
pub fn levenberg_marquardt<P: Problem>(problem: &mut P, mut state: P::State, options: &Options) -> (P::State, Report) {
    let mut hessian = problem.structure();
    let mut gradient = vec![0.0; hessian.size()];
    let mut damping = options.initial_damping;
    let mut report = Report { iterations: Vec::new(), cost: f64::INFINITY, stop: Stop::IterationLimit };
    for _ in 0..options.max_iterations {
        hessian.clear();
        gradient.fill(0.0);
        let cost = problem.linearize(&state, &mut hessian, &mut gradient);
        report.cost = cost;
        let mut rejected = 0;
        let accepted = loop {
            if let Some((next, lower)) = try_step(problem, &state, cost, &hessian, &gradient, damping) {
                break Some((next, lower));
            }
            rejected += 1;
            damping *= 8.0;
            if damping > MAX_DAMPING {
                break None;
            }
        };
        let new_cost = accepted.as_ref().map_or(cost, |(_, lower)| *lower);
        report.iterations.push(Iteration { cost, new_cost, damping, rejected });
        report.cost = new_cost;
        let Some((next, _)) = accepted else {
            report.stop = Stop::NoDescent;
            break;
        };
        state = next;
        damping = (damping / 8.0).max(MIN_DAMPING);
        if cost - new_cost < options.absolute_decrease.max(options.relative_decrease * cost.abs()) {
            report.stop = Stop::Converged;
            break;
        }
    }
    if report.iterations.is_empty() {
        report.cost = problem.cost(&state);
    }
    (state, report)
}

/// Covariance of chosen parameters at a state: rows and columns `chosen` of the inverse of the normal matrix, without the rest.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] where nothing holds a parameter, [`Error::Index`] for one that does not exist.
pub fn covariance<P: Problem>(problem: &mut P, state: &P::State, chosen: &[usize]) -> Result<DMatrix<f64>> {
    let mut factor = problem.structure();
    let count = factor.size();
    if let Some(&index) = chosen.iter().find(|&&i| i >= count) {
        return Err(Error::Index { what: "parameter", index: index as i64, count });
    }
    problem.linearize(state, &mut factor, &mut vec![0.0; count]);
    factor.factorize()?;
    // (L Lᵀ)⁻¹ = L⁻ᵀ L⁻¹: its entry (i, j) is the dot product of L⁻¹ eᵢ and L⁻¹ eⱼ, which are zero before i and j
    let halves: Vec<Vec<f64>> = chosen
        .iter()
        .map(|&i| {
            let mut half = vec![0.0; count];
            half[i] = 1.0;
            factor.forward(&mut half, i);
            half
        })
        .collect();
    let entry = |i: usize, j: usize| {
        let from = chosen[i].max(chosen[j]);
        halves[i][from..].iter().zip(&halves[j][from..]).map(|(a, b)| a * b).sum()
    };
    Ok(DMatrix::from_fn(chosen.len(), chosen.len(), entry))
}

fn try_step<P: Problem>(
    problem: &mut P,
    state: &P::State,
    cost: f64,
    hessian: &Envelope,
    gradient: &[f64],
    damping: f64,
) -> Option<(P::State, f64)> {
    let mut factor = hessian.clone();
    factor.damp(damping);
    factor.factorize().ok()?;
    let mut step: Vec<f64> = gradient.iter().map(|g| -g).collect();
    factor.solve(&mut step);
    if step.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let next = problem.retract(state, &step);
    let lower = problem.cost(&next);
    (lower < cost).then_some((next, lower))
}
