//! One battery of laws for every problem that the solver takes.

use meshslam_core::kernel::Kernel;
use meshslam_core::object::{ObjectProblem, ObjectState, Scope};
use meshslam_core::solve::envelope::Envelope;
use meshslam_core::solve::levenberg_marquardt::{Options, Problem, Report, Stop, covariance, levenberg_marquardt};
use meshslam_core::solve::triangulate::PointProblem;
use meshslam_core::template::Template;
use meshslam_core::view::View;
use nalgebra::{DMatrix, Vector3};

use crate::common::Random;
use crate::levenberg_marquardt::{Squares, rosenbrock};
use crate::object::{SCOPES, disturbed, ground, model, start, template, views, without_borders, without_keypoints};
use crate::triangulate::sights;

/// How well a gradient tells the slope of the true cost, over a step of so many sigmas to both sides.
struct Slope {
    step: f64,
    error: f64,
}

/// Where residuals are smooth functions of the state.
const SMOOTH: Slope = Slope { step: 1e-5, error: 1e-4 };

/// Where a border is matched anew at each state: nearest points change, and the pixels of a mask.
const MATCHED: Slope = Slope { step: 0.1, error: 0.25 };

/// All laws, from the states given.
fn obeys<P: Problem>(problem: &mut P, states: &[P::State], slope: &Slope) {
    let mut random = Random(7);
    evaluations_know_nothing_of_those_before(problem, states);
    for state in states {
        linearizing_gives_the_cost_and_adds(problem, state);
        no_step_stays(problem, state);
        the_hessian_is_positive(problem, state, &mut random);
        the_gradient_is_the_slope(problem, state, slope, &mut random);
        chosen_covariances_are_part_of_the_inverse(problem, state, &mut random);
        the_solver_descends_to_where_it_stays(problem, state);
    }
}

struct Normal {
    hessian: Envelope,
    gradient: Vec<f64>,
    cost: f64,
}

fn linearized<P: Problem>(problem: &mut P, state: &P::State) -> Normal {
    let mut hessian = problem.structure();
    let mut gradient = vec![0.0; hessian.size()];
    let cost = problem.linearize(state, &mut hessian, &mut gradient);
    Normal { hessian, gradient, cost }
}

fn dense(matrix: &Envelope) -> DMatrix<f64> {
    DMatrix::from_fn(matrix.size(), matrix.size(), |i, j| matrix.get(i.max(j), i.min(j)))
}

fn evaluations_know_nothing_of_those_before<P: Problem>(problem: &mut P, states: &[P::State]) {
    let mut bits = || -> Vec<(u64, Vec<u64>)> {
        let of = |state| {
            let found = linearized(problem, state);
            (problem.cost(state).to_bits(), found.gradient.iter().map(|g| g.to_bits()).collect())
        };
        states.iter().map(of).collect()
    };
    assert_eq!(bits(), bits());
}

fn linearizing_gives_the_cost_and_adds<P: Problem>(problem: &mut P, state: &P::State) {
    let Normal { mut hessian, mut gradient, cost } = linearized(problem, state);
    assert!((cost - problem.cost(state)).abs() <= 1e-9 * (1.0 + cost.abs()));
    let (once, slope) = (dense(&hessian), gradient.clone());
    problem.linearize(state, &mut hessian, &mut gradient);
    assert!((dense(&hessian) - &once * 2.0).amax() <= 1e-9 * once.amax());
    let largest = slope.iter().fold(0.0, |most: f64, g| most.max(g.abs()));
    assert!(gradient.iter().zip(&slope).all(|(twice, once)| (twice - 2.0 * once).abs() <= 1e-9 * largest));
}

fn no_step_stays<P: Problem>(problem: &mut P, state: &P::State) {
    let still = problem.retract(state, &vec![0.0; problem.structure().size()]);
    let cost = problem.cost(state);
    assert!((problem.cost(&still) - cost).abs() <= 1e-9 * (1.0 + cost));
}

fn the_hessian_is_positive<P: Problem>(problem: &mut P, state: &P::State, random: &mut Random) {
    let hessian = dense(&linearized(problem, state).hessian);
    for _ in 0..20 {
        let v = nalgebra::DVector::from_fn(hessian.nrows(), |_, _| random.uniform(-1.0, 1.0));
        assert!(v.dot(&(&hessian * &v)) >= -1e-9 * hessian.amax());
    }
}

/// Along random directions, each parameter in its own sigmas; along a direction as steep as any, the error is a share of the slope.
fn the_gradient_is_the_slope<P: Problem>(problem: &mut P, state: &P::State, slope: &Slope, random: &mut Random) {
    let Normal { hessian, gradient, .. } = linearized(problem, state);
    let sigma: Vec<f64> = (0..gradient.len()).map(|i| 1.0 / hessian.get(i, i).sqrt().max(1e-6)).collect();
    let steepest = gradient.iter().zip(&sigma).map(|(g, s)| (g * s).powi(2)).sum::<f64>().sqrt();
    for _ in 0..8 {
        let random_step: Vec<f64> = sigma.iter().map(|s| s * random.uniform(-1.0, 1.0)).collect();
        let descent: Vec<f64> = gradient.iter().zip(&sigma).map(|(g, s)| g * s * s / steepest.max(1e-12)).collect();
        let blend = random.uniform(0.0, 1.0);
        let norm = (gradient.len() as f64 / 3.0).sqrt();
        let direction: Vec<f64> =
            random_step.iter().zip(&descent).map(|(r, d)| (1.0 - blend) * r / norm + blend * d).collect();
        let mut at = |h: f64| {
            let step: Vec<f64> = direction.iter().map(|x| x * h).collect();
            let moved = problem.retract(state, &step);
            problem.cost(&moved)
        };
        let numeric = (at(slope.step) - at(-slope.step)) / (2.0 * slope.step);
        let told: f64 = gradient.iter().zip(&direction).map(|(g, x)| g * x).sum();
        assert!((told - numeric).abs() <= slope.error * (steepest + 1.0), "{told} {numeric} of {steepest}");
    }
}

fn chosen_covariances_are_part_of_the_inverse<P: Problem>(problem: &mut P, state: &P::State, random: &mut Random) {
    let whole = dense(&linearized(problem, state).hessian);
    let scale =
        DMatrix::from_fn(whole.nrows(), whole.nrows(), |i, j| (whole[(i, i)] * whole[(j, j)]).sqrt().max(1e-12));
    let held = whole.component_div(&scale).symmetric_eigenvalues().min() > 1e-9;
    let mut chosen: Vec<usize> = (0..whole.nrows()).collect();
    random.shuffle(&mut chosen);
    chosen.truncate(1 + random.below(whole.nrows().min(12)));
    let found = covariance(problem, state, &chosen);
    if !held {
        return assert!(found.is_err());
    }
    let (found, inverse) = (found.unwrap(), whole.try_inverse().unwrap());
    let expected = DMatrix::from_fn(chosen.len(), chosen.len(), |i, j| inverse[(chosen[i], chosen[j])]);
    assert!((&found - &expected).amax() <= 1e-6 * expected.amax());
}

/// The solver's last state costs what its report says; starting anew from there gains next to nothing.
fn the_solver_descends_to_where_it_stays<P: Problem>(problem: &mut P, state: &P::State) {
    let before = problem.cost(state);
    let options = Options { max_iterations: 200, ..Options::default() };
    let (end, report) = levenberg_marquardt(problem, state.clone(), &options);
    check_descent(&report);
    assert!((problem.cost(&end) - report.cost).abs() <= 1e-9 * (1.0 + report.cost) && report.cost <= before);
    let (_, again) = levenberg_marquardt(problem, end, &options);
    assert!(report.cost - again.cost <= 0.05 * (before - report.cost) + 1e-3 * report.cost, "{report:?} {again:?}");
    let (_, same) = levenberg_marquardt(problem, state.clone(), &options);
    assert_eq!(same, report);
}

/// The cost falls with every iteration but perhaps the last, and each begins where the other ended.
pub fn check_descent(report: &Report) {
    for (k, iteration) in report.iterations.iter().enumerate() {
        let last = k + 1 == report.iterations.len();
        assert!(iteration.new_cost < iteration.cost || (last && report.stop != Stop::IterationLimit));
        assert!(iteration.new_cost <= iteration.cost);
    }
    let rounding = 1e-12 * (1.0 + report.cost);
    assert!(report.iterations.windows(2).all(|pair| (pair[0].new_cost - pair[1].cost).abs() <= rounding));
    assert!(report.iterations.last().is_none_or(|i| i.new_cost == report.cost));
}

#[test]
fn rosenbrock_obeys() {
    let mut random = Random(1);
    let states: Vec<Vec<f64>> = (0..10).map(|_| vec![random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0)]).collect();
    obeys(&mut Squares { size: 2, f: rosenbrock }, &states, &SMOOTH);
}

#[test]
fn triangulation_obeys() {
    let mut random = Random(2);
    for kernel in [Kernel::Squared, Kernel::Huber(2.0), Kernel::Cauchy(2.0)] {
        let point = random.vector(0.5);
        let mut seen = sights(&mut random, &point, 6, 1.5);
        seen.iter_mut().for_each(|s| s.pixel += random.vector(3.0).xy());
        let states: Vec<Vector3<f64>> = (0..4).map(|_| point + random.vector(0.1)).collect();
        obeys(&mut PointProblem { sights: &seen, kernel }, &states, &SMOOTH);
    }
}

fn objects_obey(
    prepare: impl Fn(&Template, &ObjectState) -> Vec<View>,
    scopes: &[Scope],
    size: f64,
    count: usize,
    slope: &Slope,
) {
    let (template, mut random) = (template(), Random(3));
    let views = prepare(&template, &disturbed(&template, &mut random, 0.3));
    let seen: Vec<&View> = views.iter().collect();
    for &scope in scopes {
        let states: Vec<ObjectState> = (0..count).map(|_| disturbed(&template, &mut random, size)).collect();
        obeys(&mut ObjectProblem::new(&template, &seen, ground(), model(), scope), &states, slope);
    }
}

fn spread_in_time(mut views: Vec<View>) -> Vec<View> {
    views.iter_mut().zip(0u8..).for_each(|(view, k)| view.time_s = 0.3 * f64::from(k) - 0.2);
    views
}

#[test]
fn objects_of_key_points_obey() {
    let prepare = |t: &Template, s: &ObjectState| spread_in_time(without_borders(&views(t, s, 3)));
    objects_obey(prepare, &SCOPES, 0.5, 1, &SMOOTH);
}

#[test]
fn objects_of_borders_obey() {
    objects_obey(|t, s| without_keypoints(&views(t, s, 4)), &SCOPES[..4], 0.3, 1, &MATCHED);
}

#[test]
fn objects_of_all_that_is_seen_obey() {
    objects_obey(|t, s| views(t, s, 3), &SCOPES[..2], 0.3, 3, &MATCHED);
    objects_obey(|t, s| spread_in_time(views(t, s, 3)), &SCOPES[4..], 0.3, 1, &MATCHED);
}

#[test]
fn objects_that_nothing_shows_obey() {
    let template = template();
    for scope in [SCOPES[1], SCOPES[3]] {
        obeys(&mut ObjectProblem::new(&template, &[], ground(), model(), scope), &[start(&template)], &SMOOTH);
    }
}
