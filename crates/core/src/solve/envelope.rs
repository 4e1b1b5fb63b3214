//! Symmetric matrices whose lower triangle is stored from each row's first entry on (envelope, or skyline).
//!
//! A Cholesky factor fills only the envelope, so with parameters in an order that keeps neighbours together, and the
//! few that touch everything last, a thousand free-form parameters cost little more than a band.

use crate::error::{Error, Result};
use crate::simd::wide;

/// A symmetric matrix, or its Cholesky factor.
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope {
    first: Vec<usize>,
    start: Vec<usize>,
    values: Vec<f64>,
}

impl Envelope {
    /// A zero matrix with each row's first stored column.
    #[must_use]
    pub fn new(first: Vec<usize>) -> Self {
        let mut start = Vec::with_capacity(first.len() + 1);
        start.push(0);
        for (i, &f) in first.iter().enumerate() {
            start.push(start[i] + i + 1 - f.min(i));
        }
        let first = first.into_iter().enumerate().map(|(i, f)| f.min(i)).collect();
        let values = vec![0.0; start.last().copied().unwrap_or(0)];
        Self { first, start, values }
    }

    /// A zero matrix without zeros to spare.
    #[must_use]
    pub fn dense(size: usize) -> Self {
        Self::new(vec![0; size])
    }

    /// How many rows it has.
    #[must_use]
    pub fn size(&self) -> usize {
        self.first.len()
    }

    /// Set all entries to 0.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Stored part of a row: columns `first..=i`.
    #[must_use]
    pub fn row(&self, i: usize) -> (usize, &[f64]) {
        (self.first[i], &self.values[self.start[i]..self.start[i + 1]])
    }

    /// Add to the entry (i, j), either triangle; it must lie in the envelope.
    #[inline]
    pub fn add(&mut self, i: usize, j: usize, value: f64) {
        let (row, column) = if i >= j { (i, j) } else { (j, i) };
        debug_assert!(column >= self.first[row], "entry ({row}, {column}) lies outside the envelope");
        self.values[self.start[row] + column - self.first[row]] += value;
    }

    /// Entry (i, j).
    #[must_use]
    pub fn get(&self, i: usize, j: usize) -> f64 {
        let (row, column) = if i >= j { (i, j) } else { (j, i) };
        if column < self.first[row] { 0.0 } else { self.values[self.start[row] + column - self.first[row]] }
    }

    /// Entries `from..from + values.len()` of a row's lower part, for adding a whole run at once.
    #[inline]
    pub fn run_mut(&mut self, row: usize, from: usize, count: usize) -> &mut [f64] {
        let at = self.start[row] + from - self.first[row];
        &mut self.values[at..at + count]
    }

    /// Add a matrix of the same envelope.
    pub fn add_matrix(&mut self, other: &Self) {
        self.values.iter_mut().zip(&other.values).for_each(|(a, b)| *a += b);
    }

    /// Scale the diagonal by 1 + `damping` (Marquardt), with a floor where it is almost 0.
    pub fn damp(&mut self, damping: f64) {
        for i in 0..self.size() {
            let at = self.start[i + 1] - 1;
            self.values[at] += damping * self.damped(i);
        }
    }

    /// What damping scales: a diagonal entry, with its floor.
    #[must_use]
    pub fn damped(&self, i: usize) -> f64 {
        self.values[self.start[i + 1] - 1].max(1e-9)
    }

    /// Turn the matrix into its Cholesky factor L, in place.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] with the first row that fails.
    pub fn factorize(&mut self) -> Result<()> {
        wide(
            #[inline(always)]
            || self.factorize_rows(),
        )
    }

    #[inline(always)]
    fn factorize_rows(&mut self) -> Result<()> {
        for i in 0..self.size() {
            let (done, rest) = self.values.split_at_mut(self.start[i]);
            let row = &mut rest[..self.start[i + 1] - self.start[i]];
            let fi = self.first[i];
            for j in fi..i {
                let fj = self.first[j];
                let from = fi.max(fj);
                let other = &done[self.start[j]..self.start[j + 1]];
                let sum = dot(&row[from - fi..j - fi], &other[from - fj..j - fj]);
                row[j - fi] = (row[j - fi] - sum) / other[j - fj];
            }
            let pivot = row[i - fi] - dot(&row[..i - fi], &row[..i - fi]);
            if !(pivot.is_finite() && pivot > 1e-14 * row[i - fi].abs()) {
                return Err(Error::NotPositiveDefinite { row: i });
            }
            row[i - fi] = pivot.sqrt();
        }
        Ok(())
    }

    /// Solve L x = b in place, where b is zero before `from`; the matrix must be a factor.
    pub fn forward(&self, b: &mut [f64], from: usize) {
        wide(
            #[inline(always)]
            || {
                for i in from..self.size() {
                    let (f, row) = self.row(i);
                    let begin = f.max(from);
                    let sum = dot(&row[begin - f..i - f], &b[begin..i]);
                    b[i] = (b[i] - sum) / row[i - f];
                }
            },
        );
    }

    /// Solve Lᵀ x = b in place; the matrix must be a factor.
    pub fn backward(&self, b: &mut [f64]) {
        for i in (0..self.size()).rev() {
            let (f, row) = self.row(i);
            let x = b[i] / row[i - f];
            b[i] = x;
            for (value, entry) in b[f..i].iter_mut().zip(row) {
                *value -= entry * x;
            }
        }
    }

    /// Solve A x = b in place; the matrix must be a factor.
    pub fn solve(&self, b: &mut [f64]) {
        self.forward(b, 0);
        self.backward(b);
    }
}

/// Dot product with independent partial sums, so that it vectorizes.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let mut sums = [0.0; LANES];
    let (left, right) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest = left.remainder().iter().zip(right.remainder()).fold(0.0, |sum: f64, (x, y)| x.mul_add(*y, sum));
    for (x, y) in left.zip(right) {
        for k in 0..LANES {
            sums[k] = x[k].mul_add(y[k], sums[k]);
        }
    }
    ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7])) + rest
}

/// An order of nodes that keeps neighbours close (reverse Cuthill–McKee 1969); `neighbours` is symmetric.
#[must_use]
pub fn reverse_cuthill_mckee(neighbours: &[Vec<u32>]) -> Vec<u32> {
    let mut seen = vec![false; neighbours.len()];
    let mut order = Vec::with_capacity(neighbours.len());
    while order.len() < neighbours.len() {
        let Some(any) = seen.iter().position(|s| !s) else { break };
        breadth_first(neighbours, far_end(neighbours, any as u32), &mut seen, &mut order);
    }
    order.reverse();
    order
}

fn breadth_first(neighbours: &[Vec<u32>], root: u32, seen: &mut [bool], order: &mut Vec<u32>) {
    let mut at = order.len();
    seen[root as usize] = true;
    order.push(root);
    while at < order.len() {
        let mut next: Vec<u32> =
            neighbours[order[at] as usize].iter().copied().filter(|&n| !seen[n as usize]).collect();
        next.sort_unstable_by_key(|&n| (neighbours[n as usize].len(), n));
        next.dedup();
        for n in next {
            seen[n as usize] = true;
            order.push(n);
        }
        at += 1;
    }
}

/// A node far from all others of its component: the last of a few breadth-first searches.
fn far_end(neighbours: &[Vec<u32>], start: u32) -> u32 {
    let mut node = start;
    for _ in 0..3 {
        let (mut seen, mut order) = (vec![false; neighbours.len()], Vec::new());
        breadth_first(neighbours, node, &mut seen, &mut order);
        node = order.last().copied().unwrap_or(node);
    }
    node
}
