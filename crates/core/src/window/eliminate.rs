//! Cholesky's factor of a matrix of blocks, column of blocks by column of blocks; only blocks that elimination fills are
//! held. Neighbouring variables with the same ties are eliminated together, as one dense front (Duff and Reid 1983).

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut, Dyn, U1};

use super::order::Order;
use crate::error::{Error, Result};
use crate::simd::wide;

/// Columns that are eliminated before the rest of a front is brought up to date.
const BLOCK: usize = 32;
/// Columns of an update that are computed at once: what lies above their diagonal is left out.
const UPDATE: usize = 48;
/// A pivot that falls below this share of its diagonal entry is rounding.
const LOST: f64 = 1e-15;

/// Variables that are eliminated together.
#[derive(Debug, Clone)]
struct Front {
    first: usize,           // position of its first variable
    last: usize,            // and behind its last
    rows: Vec<usize>,       // positions of the later variables that it is tied to
    row_starts: Vec<usize>, // where these begin in the panel; one more at the end
    columns: usize,
    panel: DMatrix<f64>, // its columns of the factor, from its diagonal on
}

/// The factor, while it is filled and afterwards. Positions are those of the order.
#[derive(Debug, Clone)]
pub(super) struct Factor {
    fronts: Vec<Front>,
    front_of: Vec<usize>, // by position
    starts: Vec<usize>,   // of each position's numbers; one more at the end
}

/// A variable among those of its position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    pub position: usize,
    pub offset: usize, // its first number among those of the position
    pub width: usize,
}

/// Fronts whose panels hold covariances: of its columns, and of its rows with its columns.
#[derive(Debug, Clone)]
pub(super) struct Covariances(Factor);

impl Factor {
    /// An empty one; positions from `tail` on are in fronts of their own.
    pub fn new(order: &Order, widths: &[usize], tail: usize) -> Self {
        let count = order.nodes.len();
        let mut starts = vec![0];
        for &node in &order.nodes {
            starts.push(starts[starts.len() - 1] + widths[node]);
        }
        let mut fronts: Vec<Front> = Vec::new();
        let mut front_of = vec![0; count];
        let mut first = 0;
        while first < count {
            let mut last = first + 1;
            while last < count && last != tail && follows(&order.tied[last - 1], last, &order.tied[last]) {
                last += 1;
            }
            let rows = order.tied[last - 1].clone();
            let columns = starts[last] - starts[first];
            let mut row_starts = vec![columns];
            for &row in &rows {
                row_starts.push(row_starts[row_starts.len() - 1] + starts[row + 1] - starts[row]);
            }
            let height = row_starts[rows.len()];
            front_of[first..last].iter_mut().for_each(|front| *front = fronts.len());
            fronts.push(Front { first, last, rows, row_starts, columns, panel: DMatrix::zeros(height, columns) });
            first = last;
        }
        Self { fronts, front_of, starts }
    }

    /// Add a symmetric matrix over some variables; `matrix` is whole, column by column.
    pub fn add(&mut self, variables: &[Span], matrix: &[f64]) {
        let mut size = 0;
        let mut froms = Vec::with_capacity(variables.len());
        for span in variables {
            froms.push(size);
            size += span.width;
        }
        for (column, column_from) in variables.iter().zip(&froms) {
            let front = &mut self.fronts[self.front_of[column.position]];
            let at_column = self.starts[column.position] - self.starts[front.first] + column.offset;
            let height = front.panel.nrows();
            for (row, row_from) in variables.iter().zip(&froms).filter(|(row, _)| row.position >= column.position) {
                let at_row = front.row(row.position, &self.starts) + row.offset;
                for k in 0..column.width {
                    let target = &mut front.panel.as_mut_slice()[(at_column + k) * height + at_row..][..row.width];
                    let source = &matrix[(column_from + k) * size + row_from..][..row.width];
                    target.iter_mut().zip(source).for_each(|(t, s)| *t += s);
                }
            }
        }
    }

    /// Eliminate all variables.
    pub fn eliminate(&mut self) -> Result<()> {
        for at in 0..self.fronts.len() {
            let (done, rest) = self.fronts.split_at_mut(at + 1);
            let front = &mut done[at];
            eliminate_columns(&mut front.panel, front.columns)
                .map_err(|column| Error::NotPositiveDefinite { row: self.starts[front.first] + column })?;
            let below = front.panel.rows_range(front.columns..);
            let size = below.nrows();
            let mut update = DMatrix::zeros(size, size);
            add_outer(&mut update.view_mut((0, 0), (size, size)), &below, size, 1.0);
            let mut begin = 0;
            while begin < front.rows.len() {
                let index = self.front_of[front.rows[begin]];
                let target = &mut rest[index - at - 1];
                let end = begin + front.rows[begin..].iter().take_while(|row| **row < target.last).count();
                let places: Vec<usize> = front.rows[begin..].iter().map(|row| target.row(*row, &self.starts)).collect();
                for column in begin..end {
                    let from_column = front.row_starts[column] - front.columns;
                    let width = front.row_starts[column + 1] - front.row_starts[column];
                    for row in column..front.rows.len() {
                        let from_row = front.row_starts[row] - front.columns;
                        let height = front.row_starts[row + 1] - front.row_starts[row];
                        let (top, left) = (places[row - begin], places[column - begin]);
                        for k in 0..width {
                            let source = &update.as_slice()[(from_column + k) * size + from_row..][..height];
                            let start = (left + k) * target.panel.nrows() + top;
                            let target = &mut target.panel.as_mut_slice()[start..start + height];
                            target.iter_mut().zip(source).for_each(|(t, s)| *t -= s);
                        }
                    }
                }
                begin = end;
            }
        }
        Ok(())
    }

    /// Solve L Lᵀ x = right, in the order of the positions, in place.
    pub fn solve(&self, right: &mut [f64]) {
        let mut part = Vec::new(); // of a front: its own numbers, then those below
        for front in self.fronts.iter().filter(|front| front.columns > 0) {
            self.gather(front, right, &mut part);
            for (column, values) in front.panel.as_slice().chunks_exact(part.len()).enumerate() {
                let x = part[column] / values[column];
                part[column] = x;
                let (rest, values) = (&mut part[column + 1..], &values[column + 1..]);
                rest.iter_mut().zip(values).for_each(|(r, value)| *r -= x * value);
            }
            self.scatter(front, &part, right);
        }
        for front in self.fronts.iter().rev().filter(|front| front.columns > 0) {
            self.gather(front, right, &mut part);
            for (column, values) in front.panel.as_slice().chunks_exact(part.len()).enumerate().rev() {
                let known: f64 = part[column + 1..].iter().zip(&values[column + 1..]).map(|(x, value)| x * value).sum();
                part[column] = (part[column] - known) / values[column];
            }
            self.scatter(front, &part, right);
        }
    }

    fn gather(&self, front: &Front, right: &[f64], part: &mut Vec<f64>) {
        part.clear();
        part.extend_from_slice(&right[self.starts[front.first]..self.starts[front.last]]);
        front.rows.iter().for_each(|&row| part.extend_from_slice(&right[self.starts[row]..self.starts[row + 1]]));
    }

    fn scatter(&self, front: &Front, part: &[f64], right: &mut [f64]) {
        right[self.starts[front.first]..self.starts[front.last]].copy_from_slice(&part[..front.columns]);
        for (&row, at) in front.rows.iter().zip(front.row_starts.windows(2)) {
            right[self.starts[row]..self.starts[row + 1]].copy_from_slice(&part[at[0]..at[1]]);
        }
    }

    /// The factor's part from a position on, whole.
    pub fn tail(&self, position: usize) -> DMatrix<f64> {
        let start = self.starts[position];
        let size = self.starts[self.starts.len() - 1] - start;
        let mut out = DMatrix::zeros(size, size);
        for front in self.fronts.iter().filter(|front| front.first >= position) {
            let left = self.starts[front.first] - start;
            for column in 0..front.columns {
                for row in column..front.columns {
                    out[(left + row, left + column)] = front.panel[(row, column)];
                }
                for (row, place) in self.below(front) {
                    out[(place - start, left + column)] = front.panel[(row, column)];
                }
            }
        }
        out
    }

    /// The covariances of the variables that each front ties together, from the last front to the first (Takahashi, Fagan
    /// and Chin 1973): with G = L_RC L_CC⁻¹, Σ_RC = −Σ_RR G and Σ_CC = L_CC⁻ᵀ L_CC⁻¹ − Gᵀ Σ_RC.
    ///
    /// Only the fronts of `wanted` positions are filled, and those that they follow from.
    pub fn into_covariances(mut self, wanted: &[usize]) -> Covariances {
        let mut needed = vec![false; self.fronts.len()];
        wanted.iter().for_each(|&position| needed[self.front_of[position]] = true);
        for at in 0..self.fronts.len() {
            if needed[at] {
                self.fronts[at].rows.iter().for_each(|&row| needed[self.front_of[row]] = true);
            }
        }
        for at in (0..self.fronts.len()).rev().filter(|&at| needed[at]) {
            let front = &self.fronts[at];
            let columns = front.columns;
            let below = self.joint(front);
            let root = front.panel.view((0, 0), (columns, columns));
            let mut inverse = DMatrix::identity(columns, columns);
            root.solve_lower_triangular_mut(&mut inverse); // no pivot is 0: elimination would have failed
            let gain = front.panel.rows_range(columns..) * &inverse;
            let across = -(below * &gain);
            let own = inverse.tr_mul(&inverse) - gain.tr_mul(&across);
            let panel = &mut self.fronts[at].panel;
            panel.rows_range_mut(..columns).copy_from(&own);
            panel.rows_range_mut(columns..).copy_from(&across);
        }
        Covariances(self)
    }

    /// The joint covariance of a front's rows, taken from the later fronts.
    fn joint(&self, front: &Front) -> DMatrix<f64> {
        let size = front.panel.nrows() - front.columns;
        let mut out = DMatrix::zeros(size, size);
        for (k, &column) in front.rows.iter().enumerate() {
            let later = &self.fronts[self.front_of[column]];
            let left = front.row_starts[k] - front.columns;
            let from = self.starts[column] - self.starts[later.first];
            for (i, &row) in front.rows.iter().enumerate().skip(k) {
                let (top, height) = (front.row_starts[i] - front.columns, self.width(row));
                let (at, of) = (later.row(row, &self.starts), later.panel.nrows());
                for c in 0..self.width(column) {
                    let source = &later.panel.as_slice()[(from + c) * of + at..][..height];
                    out.as_mut_slice()[(left + c) * size + top..][..height].copy_from_slice(source);
                }
            }
        }
        out.fill_upper_triangle_with_lower_triangle();
        out
    }

    fn width(&self, position: usize) -> usize {
        self.starts[position + 1] - self.starts[position]
    }

    /// The rows below a front's own columns: in its panel, and among all numbers.
    fn below<'a>(&'a self, front: &'a Front) -> impl Iterator<Item = (usize, usize)> + 'a {
        front.rows.iter().zip(&front.row_starts).flat_map(|(row, at)| {
            let places = self.starts[*row]..self.starts[*row + 1];
            places.enumerate().map(move |(k, place)| (at + k, place))
        })
    }
}

impl Covariances {
    /// The joint covariance of variables that one factor or one of the ties holds together, column by column.
    pub fn of(&self, variables: &[Span]) -> Vec<f64> {
        let size = variables.iter().map(|span| span.width).sum();
        let mut out = DMatrix::zeros(size, size);
        let mut left = 0;
        for column in variables {
            let mut top = 0;
            for row in variables {
                if row.position >= column.position {
                    let block = self.block(row, column);
                    out.view_mut((left, top), (column.width, row.width)).copy_from(&block.transpose());
                    out.view_mut((top, left), (row.width, column.width)).copy_from(&block);
                }
                top += row.width;
            }
            left += column.width;
        }
        out.as_slice().to_vec()
    }

    fn block(&self, row: &Span, column: &Span) -> DMatrixView<'_, f64> {
        let Self(factor) = self;
        let front = &factor.fronts[factor.front_of[column.position]];
        let from = factor.starts[column.position] - factor.starts[front.first] + column.offset;
        let at = front.row(row.position, &factor.starts) + row.offset;
        front.panel.view((at, from), (row.width, column.width))
    }
}

impl Front {
    /// Where a position's rows begin in the panel.
    fn row(&self, position: usize, starts: &[usize]) -> usize {
        if position < self.last {
            return starts[position] - starts[self.first];
        }
        self.row_starts[self.rows.partition_point(|row| *row < position)]
    }
}

/// Whether a position's ties are the next position and that one's ties: then both are one front.
fn follows(tied: &[usize], next: usize, ties_of_next: &[usize]) -> bool {
    tied.first() == Some(&next) && tied[1..] == *ties_of_next
}

/// Cholesky of the first columns, all rows of these brought along; the column whose pivot is lost is an error.
fn eliminate_columns(panel: &mut DMatrix<f64>, columns: usize) -> std::result::Result<(), usize> {
    let height = panel.nrows();
    let diagonal: Vec<f64> = (0..columns).map(|k| panel[(k, k)]).collect();
    for begin in (0..columns).step_by(BLOCK) {
        let end = (begin + BLOCK).min(columns);
        for column in begin..end {
            let (before, own) = panel.as_mut_slice().split_at_mut(column * height);
            let own = &mut own[column..height];
            for earlier in begin..column {
                let other = &before[earlier * height + column..(earlier + 1) * height];
                let factor = -other[0];
                wide(
                    #[inline(always)]
                    || own.iter_mut().zip(other).for_each(|(x, y)| *x = factor.mul_add(*y, *x)),
                );
            }
            let pivot = own[0];
            if !pivot.is_finite() || pivot <= LOST * diagonal[column] {
                return Err(column);
            }
            let scale = 1.0 / pivot.sqrt();
            own.iter_mut().for_each(|x| *x *= scale);
        }
        if end < columns {
            let (done, rest) = panel.columns_range_pair_mut(begin..end, end..columns);
            let mut rest = rest;
            let (done, size) = (done.rows_range(end..), columns - end);
            add_outer(&mut rest.view_mut((end, 0), (height - end, size)), &done, size, -1.0);
        }
    }
    Ok(())
}

type Part<'a> = nalgebra::MatrixView<'a, f64, Dyn, Dyn, U1, Dyn>;

/// target += scale · rows rowsᵀ, from the diagonal of its columns on: those of the first `columns` rows.
fn add_outer(target: &mut DMatrixViewMut<f64>, rows: &Part, columns: usize, scale: f64) {
    for begin in (0..columns).step_by(UPDATE) {
        let width = UPDATE.min(columns - begin);
        let across = rows.rows(begin, width).transpose();
        let height = rows.nrows() - begin;
        target.view_mut((begin, begin), (height, width)).gemm(scale, &rows.rows(begin, height), &across, 1.0);
    }
}
