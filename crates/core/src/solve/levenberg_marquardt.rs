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
    /// Stop when a step lowers the cost, or promises to, by less than this share of it.
    pub relative_decrease: f64,
    /// Stop when a step lowers the cost, or promises to, by less than this.
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
    /// The cost fell by less than the tolerance, or no step promised more.
    Converged,
    /// No damping gave a step that lowers the true cost, as far as steps promised more than the tolerance.
    NoDescent,
    /// The iterations were used up.
    IterationLimit,
}

/// What one iteration did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iteration {
    /// Cost before the step.
    pub cost: f64,
    /// Cost after the accepted step; the same if there was none.
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

/// The damping, ruled by how well the linear model foretells the cost (Nielsen 1999).
struct Damping {
    value: f64,
    growth: f64,
}

impl Damping {
    fn accept(&mut self, gain: f64) {
        self.value = (self.value * (1.0 - (2.0 * gain - 1.0).powi(3)).max(1.0 / 8.0)).max(MIN_DAMPING);
        self.growth = 4.0;
    }

    fn reject(&mut self) {
        self.value *= self.growth;
        self.growth *= 2.0;
    }
}

/// Lower the cost from `state`; a step is taken only if the true cost falls.
pub fn levenberg_marquardt<P: Problem>(problem: &mut P, mut state: P::State, options: &Options) -> (P::State, Report) {
    let mut hessian = problem.structure();
    let mut gradient = vec![0.0; hessian.size()];
    let mut damping = Damping { value: options.initial_damping, growth: 4.0 };
    let mut report = Report { iterations: Vec::new(), cost: f64::INFINITY, stop: Stop::IterationLimit };
    for _ in 0..options.max_iterations {
        hessian.clear();
        gradient.fill(0.0);
        let cost = problem.linearize(&state, &mut hessian, &mut gradient);
        let enough = options.absolute_decrease.max(options.relative_decrease * cost.abs());
        let search = Search { problem, state: &state, cost, hessian: &hessian, gradient: &gradient, enough };
        let (found, rejected) = search.descend(&mut damping);
        let new_cost = if let Found::Step { cost: lower, .. } = &found { *lower } else { cost };
        report.iterations.push(Iteration { cost, new_cost, damping: damping.value, rejected });
        report.cost = new_cost;
        match found {
            Found::Step { state: next, gain, .. } => {
                state = next;
                damping.accept(gain);
                if cost - new_cost < enough {
                    report.stop = Stop::Converged;
                    break;
                }
            }
            Found::Nothing(stop) => {
                report.stop = stop;
                break;
            }
        }
    }
    if report.iterations.is_empty() {
        report.cost = problem.cost(&state);
    }
    (state, report)
}

/// What a search from one linearization came to.
enum Found<S> {
    Step { state: S, cost: f64, gain: f64 },
    Nothing(Stop),
}

/// The linearized problem at a state.
struct Search<'a, P: Problem> {
    problem: &'a mut P,
    state: &'a P::State,
    cost: f64,
    hessian: &'a Envelope,
    gradient: &'a [f64],
    enough: f64,
}

impl<P: Problem> Search<'_, P> {
    /// The first step, with ever more damping, that lowers the true cost; none once no step promises enough. Also how many
    /// were rejected.
    fn descend(self, damping: &mut Damping) -> (Found<P::State>, usize) {
        let mut rejected = 0;
        while damping.value <= MAX_DAMPING {
            if let Some((step, promised)) = self.step(damping.value) {
                if promised < self.enough {
                    let stop = if rejected == 0 { Stop::Converged } else { Stop::NoDescent };
                    return (Found::Nothing(stop), rejected);
                }
                let next = self.problem.retract(self.state, &step);
                let lower = self.problem.cost(&next);
                if lower < self.cost {
                    let gain = (self.cost - lower) / promised;
                    return (Found::Step { state: next, cost: lower, gain }, rejected);
                }
            }
            rejected += 1;
            damping.reject();
        }
        (Found::Nothing(Stop::NoDescent), rejected)
    }

    /// s = −(H + λD)⁻¹ g, and by how much the quadratic model falls there: −gᵀs − ½ sᵀHs = ½ (λ sᵀDs − gᵀs).
    fn step(&self, damping: f64) -> Option<(Vec<f64>, f64)> {
        let mut factor = self.hessian.clone();
        factor.damp(damping);
        factor.factorize().ok()?;
        let mut step: Vec<f64> = self.gradient.iter().map(|g| -g).collect();
        factor.solve(&mut step);
        let along: f64 = step.iter().zip(self.gradient).map(|(s, g)| s * g).sum();
        let damped: f64 = step.iter().enumerate().map(|(i, s)| damping * self.hessian.damped(i) * s * s).sum();
        let promised = 0.5 * (damped - along);
        promised.is_finite().then_some((step, promised))
    }
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
