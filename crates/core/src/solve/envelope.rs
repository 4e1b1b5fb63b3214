//! Symmetric matrices whose lower triangle is stored from each row's first entry on (envelope, or skyline).
//!
//! A Cholesky factor fills only the envelope, so with parameters in an order that keeps neighbours together, and the
//! few that touch everything last, a thousand free-form parameters cost little more than a band. Rows stand in blocks of
//! four that begin at the same column, a multiple of four, so that the factorization goes by 4 × 4 blocks.

use std::array::from_fn;

use crate::error::{Error, Result};
use crate::simd::wide;

/// Rows and columns of a block.
const BLOCK: usize = 4;

/// A symmetric matrix, or its Cholesky factor.
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope {
    first: Vec<usize>,
    start: Vec<usize>,
    values: Vec<f64>,
}

impl Envelope {
    /// A zero matrix with the first column of each row that may be other than zero.
    #[must_use]
    pub fn new(mut first: Vec<usize>) -> Self {
        for (block, rows) in first.chunks_mut(BLOCK).enumerate() {
            let lowest = rows.iter().fold(block * BLOCK, |low, &f| low.min(f));
            rows.fill(lowest / BLOCK * BLOCK);
        }
        let mut start = Vec::with_capacity(first.len() + 1);
        start.push(0);
        for (i, &f) in first.iter().enumerate() {
            start.push(start[i] + i + 1 - f);
        }
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
        for begin in (0..self.size()).step_by(BLOCK) {
            for column in (self.first[begin]..begin).step_by(BLOCK) {
                self.eliminate(begin, column);
            }
            self.factorize_diagonal(begin)?;
        }
        Ok(())
    }

    /// The block of the rows from `begin` and the columns from `column` on, from those before it.
    #[inline(always)]
    fn eliminate(&mut self, begin: usize, column: usize) {
        let (first, count) = (self.first[begin], BLOCK.min(self.size() - begin));
        let shared = first.max(self.first[column]);
        let length = column - shared;
        let (done, rest) = self.values.split_at_mut(self.start[begin]);
        let start: [usize; BLOCK] = from_fn(|r| self.start[begin + r.min(count - 1)] - self.start[begin]);
        let others: [&[f64]; BLOCK] = from_fn(|c| &done[self.start[column + c] + shared - self.first[column]..]);
        let rows = start.map(|at| &rest[at + shared - first..][..length]);
        let sums = products(rows, others.map(|row| &row[..length]));
        for (at, sums) in start.iter().zip(&sums).take(count) {
            let row = &mut rest[at + column - first..][..BLOCK];
            for (c, sum) in sums.iter().enumerate() {
                let other = &others[c][length..];
                row[c] = (row[c] - add_product(*sum, &row[..c], other)) / other[c];
            }
        }
    }

    #[inline(always)]
    fn factorize_diagonal(&mut self, begin: usize) -> Result<()> {
        let (first, count) = (self.first[begin], BLOCK.min(self.size() - begin));
        let length = begin - first;
        let rest = &mut self.values[self.start[begin]..];
        let start: [usize; BLOCK] = from_fn(|r| self.start[begin + r.min(count - 1)] - self.start[begin]);
        let rows = start.map(|at| &rest[at..][..length]);
        let sums = products(rows, rows);
        for (r, &at) in start.iter().enumerate().take(count) {
            let (above, here) = rest.split_at_mut(at);
            let row = &mut here[length..=length + r];
            for c in 0..r {
                let other = &above[start[c] + length..];
                row[c] = (row[c] - add_product(sums[r][c], &row[..c], other)) / other[c];
            }
            let whole = row[r];
            let pivot = whole - add_product(sums[r][r], &row[..r], &row[..r]);
            if !(pivot.is_finite() && pivot > 1e-14 * whole.abs()) {
                return Err(Error::NotPositiveDefinite { row: begin + r });
            }
            row[r] = pivot.sqrt();
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

/// Dot products of each left row with each right one, whose lengths are one multiple of [`BLOCK`].
#[inline(always)]
fn products(left: [&[f64]; BLOCK], right: [&[f64]; BLOCK]) -> [[f64; BLOCK]; BLOCK] {
    let (left, right) = (left.map(|row| row.as_chunks::<BLOCK>().0), right.map(|row| row.as_chunks::<BLOCK>().0));
    let count = left[0].len();
    let (left, right) = (left.map(|row| &row[..count]), right.map(|row| &row[..count]));
    let mut sums = [[[0.0; BLOCK]; BLOCK]; BLOCK];
    for k in 0..count {
        for r in 0..BLOCK {
            for c in 0..BLOCK {
                for l in 0..BLOCK {
                    sums[r][c][l] = left[r][k][l].mul_add(right[c][k][l], sums[r][c][l]);
                }
            }
        }
    }
    sums.map(|row| row.map(|[a, b, c, d]| (a + c) + (b + d)))
}

/// sum + aᵀb, over as many entries as a has.
#[inline(always)]
fn add_product(sum: f64, a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(sum, |sum, (x, y)| x.mul_add(*y, sum))
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
