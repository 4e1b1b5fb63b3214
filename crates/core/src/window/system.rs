//! The normal equations of all factors of a window, and their solution.

use std::sync::Arc;

use nalgebra::{DMatrix, DMatrixView};

use super::eliminate::Factor;
use super::linear::LinearFactor;
use super::order::minimum_degree;
use super::variables::Variables;
use crate::error::{Error, Result, check_finite, check_length};

/// Σ ½ |A x − b|² over the steps x of some variables.
#[derive(Debug, Clone, Default)]
pub struct BlockSystem {
    names: Vec<u64>, // ascending
    widths: Vec<usize>,
    terms: Vec<Term>,
}

/// ½ xᵀ H x + gᵀ x over some of the variables.
#[derive(Debug, Clone)]
struct Term {
    nodes: Vec<u32>,
    hessian: Arc<[f64]>,
    gradient: Vec<f64>,
}

/// The step that lowers the cost most, and what the equations say of the variables that were eliminated last.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Behind each other, in the ascending order of the variables' numbers.
    pub step: Vec<f64>,
    tail: Vec<(u64, usize, usize)>, // the last variables: number, where they start, width
    root: DMatrix<f64>,             // lower triangular, of these
}

impl BlockSystem {
    /// Over variables with their numbers and widths, without any factor.
    ///
    /// # Errors
    /// [`Error`] for a number that is given twice, or lengths that do not fit.
    pub fn new(names: &[u64], widths: &[usize]) -> Result<Self> {
        check_length("widths", widths.len(), names.len())?;
        let mut pairs: Vec<(u64, usize)> = names.iter().copied().zip(widths.iter().copied()).collect();
        pairs.sort_unstable();
        if let Some(pair) = pairs.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let found = pair[0].0 as f64;
            return Err(Error::Range { what: "number of a variable", expected: "given once", found });
        }
        let (names, widths) = pairs.into_iter().unzip();
        Ok(Self { names, widths, terms: Vec::new() })
    }

    /// Add a factor that is linear, at these values.
    ///
    /// # Errors
    /// [`Error`] for a variable that is not there, or is of another kind.
    pub fn add_linear(&mut self, factor: &LinearFactor, variables: &Variables) -> Result<()> {
        let gradient = factor.gradient(variables)?;
        self.push(&factor.names, factor.information.clone(), gradient)
    }

    /// Add ½ |A x − b|²; `rows` is [A b], row by row, its columns those of `names` in their order.
    ///
    /// # Errors
    /// [`Error`] for a variable that is not there, rows of another length, or a value that is not finite.
    pub fn add_rows(&mut self, names: &[u64], rows: &[f64]) -> Result<()> {
        let columns = self.columns(names)?;
        check_finite("rows", rows)?;
        let height = rows.len() / (columns + 1);
        check_length("rows", rows.len(), height * (columns + 1))?;
        let all = DMatrixView::from_slice(rows, columns + 1, height); // transposed
        let jacobian = all.rows(0, columns);
        let information = jacobian * jacobian.transpose();
        let gradient = -(jacobian * all.row(columns).transpose());
        self.push(names, information.as_slice().into(), gradient.as_slice().to_vec())
    }

    /// Add ½ xᵀ H x + gᵀ x; H is whole.
    ///
    /// # Errors
    /// [`Error`] for a variable that is not there, other lengths, or a value that is not finite.
    pub fn add_information(&mut self, names: &[u64], hessian: &[f64], gradient: &[f64]) -> Result<()> {
        let columns = self.columns(names)?;
        check_length("gradient", gradient.len(), columns)?;
        check_length("hessian", hessian.len(), columns * columns)?;
        check_finite("gradient", gradient)?;
        check_finite("hessian", hessian)?;
        self.push(names, hessian.into(), gradient.to_vec())
    }

    /// Solve for all variables by Cholesky; those of `last` are eliminated last, and their covariance is kept.
    ///
    /// # Errors
    /// [`Error`] for a variable of `last` that is not there; [`Error::NotPositiveDefinite`] if a variable is free, or its
    /// pivot is lost to rounding.
    pub fn solve(&self, last: &[u64]) -> Result<Solution> {
        let mut at_end = last.iter().map(|name| self.node(*name)).collect::<Result<Vec<_>>>()?;
        at_end.sort_unstable();
        at_end.dedup();
        let order = minimum_degree(&self.widths, self.terms.iter().map(|term| term.nodes.as_slice()), &at_end);
        let tail = order.nodes.len() - at_end.len();
        let mut position = vec![0; self.widths.len()];
        order.nodes.iter().enumerate().for_each(|(at, &node)| position[node] = at);
        let mut starts = vec![0; self.widths.len()]; // by node, among the positions' numbers
        let mut total = 0;
        for &node in &order.nodes {
            starts[node] = total;
            total += self.widths[node];
        }
        let mut factor = Factor::new(&order, &self.widths, tail);
        let mut right = vec![0.0; total];
        for Term { nodes, hessian, gradient } in &self.terms {
            let positions: Vec<usize> = nodes.iter().map(|&node| position[node as usize]).collect();
            factor.add(&positions, hessian);
            let mut from = 0;
            for &node in nodes {
                let (start, width) = (starts[node as usize], self.widths[node as usize]);
                right[start..start + width].iter_mut().zip(&gradient[from..]).for_each(|(r, g)| *r -= g);
                from += width;
            }
        }
        factor.eliminate()?;
        factor.solve(&mut right);
        let span = |node: usize| starts[node]..starts[node] + self.widths[node];
        let step: Vec<f64> = (0..self.widths.len()).flat_map(|node| right[span(node)].iter().copied()).collect();
        check_finite("step", &step)?;
        let first = at_end.first().map_or(total, |&node| starts[node]);
        let tail_of = |&node: &usize| (self.names[node], starts[node] - first, self.widths[node]);
        let root = if at_end.is_empty() { DMatrix::zeros(0, 0) } else { factor.tail(tail) };
        Ok(Solution { step, tail: at_end.iter().map(tail_of).collect(), root })
    }

    fn node(&self, name: u64) -> Result<usize> {
        let missing = Error::Index { what: "variable", index: name as i64, count: self.names.len() };
        self.names.binary_search(&name).map_err(|_| missing)
    }

    fn columns(&self, names: &[u64]) -> Result<usize> {
        names.iter().map(|name| Ok(self.widths[self.node(*name)?])).sum()
    }

    fn push(&mut self, names: &[u64], hessian: Arc<[f64]>, gradient: Vec<f64>) -> Result<()> {
        check_length("gradient", gradient.len(), self.columns(names)?)?;
        let nodes = names.iter().map(|name| Ok(self.node(*name)? as u32)).collect::<Result<Vec<_>>>()?;
        if (1..nodes.len()).any(|k| nodes[..k].contains(&nodes[k])) {
            let expected = "named once by a factor";
            return Err(Error::Range { what: "a variable", expected, found: names[0] as f64 });
        }
        self.terms.push(Term { nodes, hessian, gradient });
        Ok(())
    }
}

impl Solution {
    /// Joint covariance of some of the variables that were eliminated last, row by row; None where one was not.
    #[must_use]
    pub fn covariance(&self, names: &[u64]) -> Option<Vec<f64>> {
        let mut chosen = Vec::new();
        for name in names {
            let (_, start, width) = self.tail.iter().find(|(other, ..)| other == name)?;
            chosen.extend(*start..start + width);
        }
        let size = self.root.nrows();
        let mut columns = DMatrix::zeros(size, chosen.len()); // L⁻¹ of the unit columns
        chosen.iter().enumerate().for_each(|(k, &at)| columns[(at, k)] = 1.0);
        if !self.root.solve_lower_triangular_mut(&mut columns) {
            return None;
        }
        Some(columns.tr_mul(&columns).as_slice().to_vec())
    }
}
