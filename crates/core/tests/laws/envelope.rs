use meshslam_core::error::Error;
use meshslam_core::solve::envelope::{Envelope, reverse_cuthill_mckee};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

use crate::common::Random;

/// A random positive definite matrix in a random envelope, and the same dense.
fn matrix(random: &mut Random, size: usize) -> (Envelope, DMatrix<f64>) {
    let first: Vec<usize> = (0..size).map(|i| if random.below(5) == 0 { 0 } else { random.below(i + 1) }).collect();
    let (mut sparse, mut dense) = (Envelope::new(first.clone()), DMatrix::zeros(size, size));
    for i in 0..size {
        for j in first[i]..=i {
            let value = if i == j { 0.1 + size as f64 } else { random.uniform(-1.0, 1.0) };
            sparse.add(i, j, value);
            dense[(i, j)] = value;
            dense[(j, i)] = value;
        }
    }
    (sparse, dense)
}

fn vector(random: &mut Random, size: usize) -> DVector<f64> {
    DVector::from_fn(size, |_, _| random.uniform(-3.0, 3.0))
}

proptest! {
    #[test]
    fn factor_and_solution_are_those_of_the_dense_matrix(seed in any::<u64>(), size in 1usize..60) {
        let mut random = Random(seed);
        let (mut sparse, dense) = matrix(&mut random, size);
        sparse.factorize().unwrap();
        let cholesky = dense.clone().cholesky().unwrap();
        let lower = cholesky.l();
        for i in 0..size {
            let (first, row) = sparse.row(i);
            for j in 0..=i {
                let found = if j < first { 0.0 } else { row[j - first] };
                prop_assert!((found - lower[(i, j)]).abs() < 1e-11);
            }
        }
        let b = vector(&mut random, size);
        let mut x = b.as_slice().to_vec();
        sparse.solve(&mut x);
        prop_assert!((DVector::from(x) - cholesky.solve(&b)).amax() < 1e-10);
    }

    #[test]
    fn halves_of_the_solution_are_triangular_solutions(seed in any::<u64>(), size in 1usize..40) {
        let mut random = Random(seed);
        let (mut sparse, dense) = matrix(&mut random, size);
        sparse.factorize().unwrap();
        let lower = dense.cholesky().unwrap().l();
        let from = random.below(size);
        let mut b = vector(&mut random, size);
        b.rows_mut(0, from).fill(0.0);
        let mut x = b.as_slice().to_vec();
        sparse.forward(&mut x, from);
        prop_assert!((&lower * DVector::from(x) - &b).amax() < 1e-10);
        let mut y = b.as_slice().to_vec();
        sparse.backward(&mut y);
        prop_assert!((lower.transpose() * DVector::from(y) - &b).amax() < 1e-10);
    }

    #[test]
    fn entries_are_symmetric_and_add_up(seed in any::<u64>(), size in 1usize..20) {
        let mut random = Random(seed);
        let (mut sparse, dense) = matrix(&mut random, size);
        let twin = sparse.clone();
        sparse.add_matrix(&twin);
        for i in 0..size {
            for j in 0..size {
                prop_assert_eq!(sparse.get(i, j), 2.0 * dense[(i, j)]);
            }
        }
        sparse.damp(0.5);
        for i in 0..size {
            prop_assert!((sparse.get(i, i) - 3.0 * dense[(i, i)]).abs() < 1e-12 * size as f64);
        }
        sparse.clear();
        prop_assert!((0..size).all(|i| (0..size).all(|j| sparse.get(i, j) == 0.0)));
    }

    #[test]
    fn reverse_cuthill_mckee_is_a_permutation(seed in any::<u64>(), size in 0usize..60, links in 0usize..120) {
        let mut random = Random(seed);
        let mut neighbours = vec![Vec::new(); size];
        for _ in 0..if size > 0 { links } else { 0 } {
            let (a, b) = (random.below(size), random.below(size));
            neighbours[a].push(b as u32);
            neighbours[b].push(a as u32);
        }
        let mut order = reverse_cuthill_mckee(&neighbours);
        order.sort_unstable();
        prop_assert_eq!(order, (0..size as u32).collect::<Vec<_>>());
    }
}

#[test]
fn a_shuffled_chain_gets_bandwidth_one() {
    let mut random = Random(3);
    let mut name: Vec<u32> = (0..50).collect();
    random.shuffle(&mut name);
    let mut neighbours = vec![Vec::new(); 50];
    for pair in name.windows(2) {
        neighbours[pair[0] as usize].push(pair[1]);
        neighbours[pair[1] as usize].push(pair[0]);
    }
    let order = reverse_cuthill_mckee(&neighbours);
    assert!(order.windows(2).all(|pair| neighbours[pair[0] as usize].contains(&pair[1])));
}

#[test]
fn a_matrix_that_is_not_positive_definite_names_its_row() {
    let mut singular = Envelope::dense(3);
    for i in 0..3 {
        for j in 0..=i {
            singular.add(i, j, 1.0);
        }
    }
    assert_eq!(singular.factorize(), Err(Error::NotPositiveDefinite { row: 1 }));
    for bad in [0.0, -1.0, f64::NAN] {
        let mut matrix = Envelope::dense(2);
        matrix.add(0, 0, bad);
        matrix.add(1, 1, 1.0);
        assert_eq!(matrix.factorize(), Err(Error::NotPositiveDefinite { row: 0 }));
    }
    assert_eq!(Envelope::dense(0).factorize(), Ok(()));
}
