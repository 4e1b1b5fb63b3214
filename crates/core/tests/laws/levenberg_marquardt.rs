use meshslam_core::error::Error;
use meshslam_core::solve::envelope::Envelope;
use meshslam_core::solve::levenberg_marquardt::{Options, Problem, Stop, covariance, levenberg_marquardt};
use nalgebra::{DMatrix, DVector};

use crate::common::Random;
use crate::problem::check_descent;

/// ½ |f(x)|² of a function with its Jacobian.
pub struct Squares<F: Fn(&[f64]) -> (Vec<f64>, DMatrix<f64>)> {
    pub size: usize,
    pub f: F,
}

impl<F: Fn(&[f64]) -> (Vec<f64>, DMatrix<f64>)> Problem for Squares<F> {
    type State = Vec<f64>;

    fn cost(&mut self, x: &Vec<f64>) -> f64 {
        0.5 * (self.f)(x).0.iter().map(|r| r * r).sum::<f64>()
    }

    fn linearize(&mut self, x: &Vec<f64>, hessian: &mut Envelope, gradient: &mut [f64]) -> f64 {
        let (residual, jacobian) = (self.f)(x);
        let (normal, right) = (jacobian.transpose() * &jacobian, jacobian.transpose() * DVector::from(residual));
        for i in 0..self.size {
            gradient[i] += right[i];
            (0..=i).for_each(|j| hessian.add(i, j, normal[(i, j)]));
        }
        self.cost(x)
    }

    fn retract(&self, x: &Vec<f64>, step: &[f64]) -> Vec<f64> {
        x.iter().zip(step).map(|(a, b)| a + b).collect()
    }

    fn structure(&self) -> Envelope {
        Envelope::dense(self.size)
    }
}

fn exact() -> Options {
    Options { max_iterations: 300, relative_decrease: 1e-14, absolute_decrease: 1e-20, ..Options::default() }
}

pub fn rosenbrock(x: &[f64]) -> (Vec<f64>, DMatrix<f64>) {
    let jacobian = DMatrix::from_row_slice(2, 2, &[-20.0 * x[0], 10.0, -1.0, 0.0]);
    (vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]], jacobian)
}

#[test]
fn rosenbrock_is_solved_from_anywhere() {
    let mut random = Random(1);
    for _ in 0..50 {
        let start = vec![random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0)];
        let (x, report) = levenberg_marquardt(&mut Squares { size: 2, f: rosenbrock }, start, &exact());
        check_descent(&report);
        assert!((x[0] - 1.0).abs() < 1e-6 && (x[1] - 1.0).abs() < 1e-6, "{x:?} {report:?}");
    }
}

#[test]
fn linear_squares_reach_their_minimum() {
    let mut random = Random(2);
    for size in 1..12 {
        let jacobian = DMatrix::from_fn(size + 5, size, |_, _| random.uniform(-1.0, 1.0));
        let target = DVector::from_fn(size + 5, |_, _| random.uniform(-4.0, 4.0));
        let f =
            |x: &[f64]| ((&jacobian * DVector::from_column_slice(x) - &target).as_slice().to_vec(), jacobian.clone());
        let (x, report) = levenberg_marquardt(&mut Squares { size, f }, vec![0.0; size], &exact());
        check_descent(&report);
        let best = (jacobian.transpose() * &jacobian).cholesky().unwrap().solve(&(jacobian.transpose() * &target));
        assert!((DVector::from(x) - best).amax() < 1e-6);
    }
}

#[test]
fn a_step_that_does_not_lower_the_true_cost_is_not_taken() {
    // the Jacobian has the wrong sign: every step climbs
    let f = |x: &[f64]| (vec![x[0]], DMatrix::from_element(1, 1, -1.0));
    let (x, report) = levenberg_marquardt(&mut Squares { size: 1, f }, vec![2.0], &Options::default());
    assert_eq!((x[0], report.stop, report.cost), (2.0, Stop::NoDescent, 2.0));
    assert!(report.iterations[0].rejected > 3);
}

#[test]
fn steps_to_where_the_cost_is_not_finite_are_not_taken() {
    // √x − 0.1 from 4: the full step lands at x < 0, where the cost is NaN
    let f = |x: &[f64]| (vec![x[0].sqrt() - 0.1], DMatrix::from_element(1, 1, 0.5 / x[0].sqrt()));
    let (x, report) = levenberg_marquardt(&mut Squares { size: 1, f }, vec![4.0], &exact());
    check_descent(&report);
    assert!((x[0] - 0.01).abs() < 1e-6, "{x:?}");
    assert!(report.iterations.iter().any(|i| i.rejected > 0));
}

#[test]
fn normal_equations_that_are_not_finite_end_the_run_where_it_stands() {
    let f = |x: &[f64]| (vec![x[0]], DMatrix::from_element(1, 1, f64::NAN));
    let (x, report) = levenberg_marquardt(&mut Squares { size: 1, f }, vec![3.0], &Options::default());
    assert_eq!((x[0], report.stop, report.cost), (3.0, Stop::NoDescent, 4.5));
}

#[test]
fn a_parameter_that_nothing_holds_stays() {
    let f = |x: &[f64]| (vec![x[0] - 5.0], DMatrix::from_row_slice(1, 2, &[1.0, 0.0]));
    let (x, _) = levenberg_marquardt(&mut Squares { size: 2, f }, vec![0.0, 7.0], &exact());
    assert!((x[0] - 5.0).abs() < 1e-6);
    assert_eq!(x[1], 7.0);
}

#[test]
fn the_limit_of_iterations_holds_and_the_best_state_is_given() {
    let mut problem = Squares { size: 2, f: rosenbrock };
    let start = vec![-1.2, 1.0];
    let (x, report) = levenberg_marquardt(&mut problem, start.clone(), &Options { max_iterations: 3, ..exact() });
    assert_eq!((report.iterations.len(), report.stop), (3, Stop::IterationLimit));
    assert_eq!(problem.cost(&x), report.cost);
    let (same, report) = levenberg_marquardt(&mut problem, start.clone(), &Options { max_iterations: 0, ..exact() });
    assert_eq!((same, report.cost), (start.clone(), problem.cost(&start)));
}

#[test]
fn the_covariance_of_chosen_parameters_is_that_part_of_the_inverse() {
    let mut random = Random(5);
    for size in 1..12 {
        let jacobian = DMatrix::from_fn(size + 5, size, |_, _| random.uniform(-1.0, 1.0));
        let f = |x: &[f64]| ((&jacobian * DVector::from_column_slice(x)).as_slice().to_vec(), jacobian.clone());
        let inverse = (jacobian.transpose() * &jacobian).try_inverse().unwrap();
        let mut chosen: Vec<usize> = (0..size).collect();
        random.shuffle(&mut chosen);
        chosen.truncate(1 + random.below(size));
        let found = covariance(&mut Squares { size, f }, &vec![0.3; size], &chosen).unwrap();
        let expected = DMatrix::from_fn(chosen.len(), chosen.len(), |i, j| inverse[(chosen[i], chosen[j])]);
        assert!((&found - &expected).amax() < 1e-9 * expected.amax());
        let beyond = covariance(&mut Squares { size, f }, &vec![0.3; size], &[size]);
        assert_eq!(beyond.unwrap_err(), Error::Index { what: "parameter", index: size as i64, count: size });
    }
    let loose = |x: &[f64]| (vec![x[0]], DMatrix::from_row_slice(1, 2, &[1.0, 0.0]));
    let found = covariance(&mut Squares { size: 2, f: loose }, &vec![0.0; 2], &[0]);
    assert_eq!(found.unwrap_err(), Error::NotPositiveDefinite { row: 1 });
}
