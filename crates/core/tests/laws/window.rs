use meshslam_core::error::Error;
use meshslam_core::lie::{Pose, exp_so3};
use meshslam_core::window::{BlockSystem, LinearFactor, Variable, Variables, linear_cost};
use nalgebra::{DMatrix, DVector, Vector6};

use crate::common::Random;

fn matrix(random: &mut Random, rows: usize, columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |_, _| random.uniform(-1.0, 1.0))
}

/// [A b] row by row.
fn plain(rows: &DMatrix<f64>) -> Vec<f64> {
    rows.transpose().as_slice().to_vec()
}

/// Factors: their variables and rows [A b].
type Factors = Vec<(Vec<u64>, DMatrix<f64>)>;

/// A chain of variables with a few that many share, its factors with their numbers and rows [A b].
fn chain(random: &mut Random, count: u64) -> (Vec<u64>, Vec<usize>, Factors) {
    let names: Vec<u64> = (0..count).map(|k| (1 << 60) + 7 * k).collect();
    let widths: Vec<usize> = (0..count).map(|k| [6, 3, 1, 16][k as usize % 4]).collect();
    let width = |name: &u64| widths[names.binary_search(name).unwrap()];
    let mut factors = Vec::new();
    for k in 0..names.len() {
        let mut around = vec![names[k], names[(k + 1) % names.len()], names[(k + 5) % names.len()], names[k % 3]];
        around.dedup();
        if k >= 2 && around[around.len() - 1] == around[0] {
            around.pop();
        }
        let mut once: Vec<u64> = Vec::new();
        around.into_iter().for_each(|name| {
            if !once.contains(&name) {
                once.push(name)
            }
        });
        let columns: usize = once.iter().map(width).sum();
        factors.push((once, matrix(random, columns / 2 + 2, columns + 1)));
        factors.push((vec![names[k]], matrix(random, width(&names[k]) + 1, width(&names[k]) + 1)));
    }
    (names, widths, factors)
}

/// All rows in one dense matrix [A b].
fn stacked(names: &[u64], widths: &[usize], factors: &Factors) -> DMatrix<f64> {
    let starts: Vec<usize> = (0..=widths.len()).map(|k| widths[..k].iter().sum()).collect();
    let total = starts[widths.len()];
    let mut out = DMatrix::zeros(factors.iter().map(|(_, rows)| rows.nrows()).sum(), total + 1);
    let mut top = 0;
    for (of, rows) in factors {
        let mut from = 0;
        for name in of {
            let at = names.binary_search(name).unwrap();
            let block = rows.columns(from, widths[at]);
            out.view_mut((top, starts[at]), (rows.nrows(), widths[at])).copy_from(&block);
            from += widths[at];
        }
        out.view_mut((top, total), (rows.nrows(), 1)).copy_from(&rows.column(from));
        top += rows.nrows();
    }
    out
}

fn system(names: &[u64], widths: &[usize], factors: &Factors) -> BlockSystem {
    let mut system = BlockSystem::new(names, widths).unwrap();
    factors.iter().for_each(|(of, rows)| system.add_rows(of, &plain(rows)).unwrap());
    system
}

#[test]
fn the_step_and_the_last_covariance_are_those_of_the_dense_equations() {
    let mut random = Random(3);
    for count in [6, 17, 40] {
        let (names, widths, factors) = chain(&mut random, count);
        let all = stacked(&names, &widths, &factors);
        let total = all.ncols() - 1;
        let jacobian = all.columns(0, total);
        let inverse = (jacobian.transpose() * jacobian).cholesky().unwrap().inverse();
        let expected: DVector<f64> = &inverse * jacobian.transpose() * all.column(total);
        let starts: Vec<usize> = (0..=widths.len()).map(|k| widths[..k].iter().sum()).collect();
        for last in [vec![], vec![names[2]], vec![names[5], names[1], names[3]]] {
            let found = system(&names, &widths, &factors).solve(&last).unwrap();
            let step = DVector::from_vec(found.step.clone());
            assert!((&step - &expected).amax() < 1e-9 * (1.0 + expected.amax()), "{count}");
            let wanted: Vec<usize> = last
                .iter()
                .flat_map(|name| {
                    let at = names.binary_search(name).unwrap();
                    starts[at]..starts[at + 1]
                })
                .collect();
            let block = DMatrix::from_fn(wanted.len(), wanted.len(), |i, j| inverse[(wanted[i], wanted[j])]);
            let covariance = found.covariance(&last).unwrap();
            let covariance = DMatrix::from_vec(wanted.len(), wanted.len(), covariance);
            assert!((covariance - &block).iter().all(|x| x.abs() < 1e-9 * (1.0 + block.amax())), "{count}");
        }
        assert!(system(&names, &widths, &factors).solve(&[names[2]]).unwrap().covariance(&[names[3]]).is_none());
    }
}

#[test]
fn covariances_of_groups_are_blocks_of_the_inverse_whatever_is_eliminated_together() {
    let mut random = Random(8);
    for count in [6, 17, 40] {
        let (names, widths, factors) = chain(&mut random, count);
        let all = stacked(&names, &widths, &factors);
        let jacobian = all.columns(0, all.ncols() - 1);
        let inverse = (jacobian.transpose() * jacobian).cholesky().unwrap().inverse();
        let starts: Vec<usize> = (0..=widths.len()).map(|k| widths[..k].iter().sum()).collect();
        // neighbours, a pair in the other order, and one that no factor ties together
        let mut groups: Vec<Vec<u64>> = names.windows(2).map(|pair| vec![pair[1], pair[0]]).collect();
        groups.push(vec![names[0], names[names.len() / 2], names[names.len() - 2]]);
        for together in [1, 2, 3] {
            let blocks: Vec<u64> = (0..count).map(|k| k / together).collect();
            let mut system = BlockSystem::in_blocks(&names, &widths, &blocks).unwrap();
            factors.iter().for_each(|(of, rows)| system.add_rows(of, &plain(rows)).unwrap());
            let step = system.solve(&[names[1]]).unwrap().step;
            let expected = &inverse * jacobian.transpose() * all.column(all.ncols() - 1);
            assert!(step.iter().zip(expected.iter()).all(|(a, b)| (a - b).abs() < 1e-9 * (1.0 + expected.amax())));
            for last in [vec![], vec![names[2]], vec![names[5], names[1]]] {
                for (group, found) in groups.iter().zip(system.covariances(&groups, &last).unwrap()) {
                    let wanted: Vec<usize> = group
                        .iter()
                        .flat_map(|name| {
                            let at = names.binary_search(name).unwrap();
                            starts[at]..starts[at + 1]
                        })
                        .collect();
                    let block = DMatrix::from_fn(wanted.len(), wanted.len(), |i, j| inverse[(wanted[i], wanted[j])]);
                    let found = DMatrix::from_vec(wanted.len(), wanted.len(), found);
                    assert!((found - &block).amax() < 1e-9 * (1.0 + block.amax()), "{count} {together} {last:?}");
                }
            }
        }
    }
}

#[test]
fn rows_and_their_information_are_the_same() {
    let mut random = Random(4);
    let (names, widths, factors) = chain(&mut random, 12);
    let mut other = BlockSystem::new(&names, &widths).unwrap();
    for (of, rows) in &factors {
        let (jacobian, right) = (rows.columns(0, rows.ncols() - 1), rows.column(rows.ncols() - 1));
        let (hessian, gradient) = (jacobian.transpose() * jacobian, -(jacobian.transpose() * right));
        other.add_information(of, hessian.as_slice(), gradient.as_slice()).unwrap();
    }
    let (one, other) = (system(&names, &widths, &factors).solve(&[]).unwrap(), other.solve(&[]).unwrap());
    assert!(one.step.iter().zip(&other.step).all(|(a, b)| (a - b).abs() < 1e-9 * (1.0 + a.abs())));
}

#[test]
fn a_free_variable_is_an_error() {
    let mut random = Random(5);
    let (mut names, mut widths, factors) = chain(&mut random, 8);
    names.push(u64::MAX);
    widths.push(2);
    let mut system = system(&names, &widths, &factors);
    assert!(matches!(system.solve(&[]), Err(Error::NotPositiveDefinite { .. })));
    // held in one direction only
    system.add_rows(&[u64::MAX], &[1.0, 1.0, 0.5]).unwrap();
    assert!(matches!(system.solve(&[u64::MAX]), Err(Error::NotPositiveDefinite { .. })));
    system.add_rows(&[u64::MAX], &[1.0, -1.0, 0.5]).unwrap();
    let step = system.solve(&[]).unwrap().step;
    assert!((step[step.len() - 2] - 0.5).abs() < 1e-12);
}

#[test]
fn wrong_inputs_are_errors() {
    assert!(BlockSystem::new(&[1, 1], &[2, 2]).is_err());
    assert!(BlockSystem::new(&[1], &[2, 2]).is_err());
    assert!(BlockSystem::in_blocks(&[1, 2], &[2, 2], &[1]).is_err());
    let mut system = BlockSystem::new(&[1, 2], &[1, 1]).unwrap();
    assert!(system.add_rows(&[3], &[1.0, 0.0]).is_err());
    assert!(system.add_rows(&[1], &[1.0, 0.0, 1.0]).is_err());
    assert!(system.add_rows(&[1, 1], &[1.0, 0.0, 1.0]).is_err());
    assert!(system.add_rows(&[1], &[f64::NAN, 0.0]).is_err());
    assert!(system.add_information(&[1], &[1.0, 0.0], &[1.0]).is_err());
    assert!(system.solve(&[3]).is_err());
    assert!(system.covariances(&[vec![3]], &[]).is_err());
    assert!(system.covariances(&[vec![1]], &[]).is_err()); // nothing holds it
    let mut empty = BlockSystem::new(&[1, 2], &[0, 1]).unwrap();
    empty.add_rows(&[1, 2], &[2.0, 4.0]).unwrap();
    assert_eq!(empty.solve(&[1]).unwrap().step, vec![2.0]);
    assert!(BlockSystem::default().solve(&[]).unwrap().step.is_empty());
}

fn variables(random: &mut Random) -> Vec<(u64, Variable)> {
    let pose = Pose { rotation: exp_so3(&random.vector(2.0)), translation: random.vector(9.0) };
    let numbers = (0..4).map(|_| random.uniform(-1.0, 1.0)).collect();
    vec![
        (9, Variable::Pose(pose)),
        (2, Variable::Rotation(exp_so3(&random.vector(2.0)))),
        (5, Variable::Vector(numbers)),
    ]
}

#[test]
fn a_linear_factor_costs_what_its_rows_say_and_draws_along_its_slope() {
    let mut random = Random(6);
    let at = variables(&mut random);
    let rows = matrix(&mut random, 15, 14);
    let factor = LinearFactor::new(vec![9, 2, 5], &Variables::new(at.clone()).unwrap(), &plain(&rows)).unwrap();
    // a step of (rotation, translation), rotation, numbers
    let step = DVector::from_fn(13, |_, _| random.uniform(-0.3, 0.3));
    let moved: Vec<(u64, Variable)> = at
        .iter()
        .map(|(name, variable)| {
            let s = step.as_slice();
            let value = match variable {
                Variable::Pose(pose) => {
                    Variable::Pose(pose.compose(&Pose::exp(&Vector6::new(s[3], s[4], s[5], s[0], s[1], s[2]))))
                }
                Variable::Rotation(turn) => {
                    Variable::Rotation(turn * exp_so3(&nalgebra::Vector3::new(s[6], s[7], s[8])))
                }
                Variable::Vector(x) => Variable::Vector(x.iter().zip(&s[9..]).map(|(x, s)| x + s).collect()),
            };
            (*name, value)
        })
        .collect();
    let moved = Variables::new(moved).unwrap();
    let residual = rows.columns(0, 13) * &step - rows.column(13);
    assert!((linear_cost([&factor], &moved).unwrap() - 0.5 * residual.norm_squared()).abs() < 1e-9);
    // about the values that it is at, its equations lead back to the best step
    let mut system = BlockSystem::new(&[2, 5, 9], &[3, 4, 6]).unwrap();
    system.add_linear(&factor, &moved).unwrap();
    let best = rows.columns(0, 13).into_owned().svd(true, true).solve(&rows.column(13), 1e-12).unwrap() - &step;
    let found = system.solve(&[]).unwrap().step; // 2, 5, 9
    let expected: Vec<f64> = [6..9, 9..13, 0..6].into_iter().flatten().map(|k| best[k]).collect();
    assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-8), "{found:?} {expected:?}");
}

#[test]
fn a_linear_factor_asks_for_its_variables() {
    let mut random = Random(7);
    let at = Variables::new(variables(&mut random)).unwrap();
    let factor = LinearFactor::new(vec![5], &at, &[1.0, 0.0, 0.0, 0.0, 2.0]).unwrap();
    let other = Variables::new(vec![(5, Variable::Vector(vec![0.0]))]).unwrap();
    assert!(linear_cost([&factor], &other).is_err());
    assert!(linear_cost([&factor], &Variables::default()).is_err());
    assert!(LinearFactor::new(vec![6], &at, &[1.0]).is_err());
    assert!(LinearFactor::new(vec![5], &at, &[1.0]).is_err());
    assert!(Variables::new(vec![(1, Variable::Vector(vec![f64::NAN]))]).is_err());
    assert!(Variables::new(vec![(1, Variable::Vector(vec![1.0])), (1, Variable::Vector(vec![1.0]))]).is_err());
}
