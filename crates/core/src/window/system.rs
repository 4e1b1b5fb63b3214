//! The normal equations of all factors of a window, and their solution.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{DMatrix, DMatrixView};

use super::eliminate::{Factor, Span};
use super::linear::LinearFactor;
use super::order::minimum_degree;
use super::variables::Variables;
use crate::error::{Error, Result, check_finite, check_length};

/// Σ ½ |A x − b|² over the steps x of some variables.
#[derive(Debug, Clone, Default)]
pub struct BlockSystem {
    names: Vec<u64>, // ascending
    widths: Vec<usize>,
    blocks: Blocks,
    terms: Vec<Term>,
}

/// Variables that are eliminated together: each has a place in one block.
#[derive(Debug, Clone, Default)]
struct Blocks {
    widths: Vec<usize>,
    of: Vec<u32>,        // by variable
    offsets: Vec<usize>, // by variable
}

/// The factor of the normal equations.
struct Eliminated {
    factor: Factor,
    spans: Vec<Span>,   // by variable
    starts: Vec<usize>, // by variable, among the numbers in the order of their elimination
    tail: usize,        // the position where the last blocks begin
    right: Vec<f64>,    // −gradient, in that order
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
        Self::in_blocks(names, widths, names)
    }

    /// The same; variables of the same block are eliminated together, as one dense one.
    ///
    /// # Errors
    /// As of [`BlockSystem::new`].
    pub fn in_blocks(names: &[u64], widths: &[usize], blocks: &[u64]) -> Result<Self> {
        check_length("widths", widths.len(), names.len())?;
        check_length("blocks", blocks.len(), names.len())?;
        let mut each: Vec<(u64, usize, u64)> =
            names.iter().zip(widths).zip(blocks).map(|((name, width), block)| (*name, *width, *block)).collect();
        each.sort_unstable();
        if let Some(pair) = each.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let found = pair[0].0 as f64;
            return Err(Error::Range { what: "number of a variable", expected: "given once", found });
        }
        let mut found = Self::default();
        let mut numbers: BTreeMap<u64, u32> = BTreeMap::new();
        for (name, width, block) in each {
            let next = numbers.len() as u32;
            let number = *numbers.entry(block).or_insert(next);
            found.names.push(name);
            found.widths.push(width);
            found.blocks.push(number, width);
        }
        Ok(found)
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
        let Eliminated { factor, spans, starts, tail, mut right } = self.eliminated(last, &[])?;
        factor.solve(&mut right);
        let all = |node: usize| starts[node]..starts[node] + self.widths[node];
        let step: Vec<f64> = (0..self.widths.len()).flat_map(|node| right[all(node)].iter().copied()).collect();
        check_finite("step", &step)?;
        let at_end: Vec<usize> = (0..spans.len()).filter(|&node| spans[node].position >= tail).collect();
        let first = at_end.iter().map(|&node| starts[node]).min().unwrap_or(right.len());
        let tail_of = |&node: &usize| (self.names[node], starts[node] - first, self.widths[node]);
        let root = if at_end.is_empty() { DMatrix::zeros(0, 0) } else { factor.tail(tail) };
        Ok(Solution { step, tail: at_end.iter().map(tail_of).collect(), root })
    }

    /// Joint covariance of each group of variables, row by row, its blocks in the group's order, by one elimination; those
    /// of `last` are eliminated last: what many groups share. The cost grows with the number of groups, not its square.
    ///
    /// # Errors
    /// As of [`BlockSystem::solve`].
    pub fn covariances(&self, groups: &[Vec<u64>], last: &[u64]) -> Result<Vec<Vec<f64>>> {
        let named = |group: &Vec<u64>| group.iter().map(|name| self.node(*name)).collect::<Result<Vec<_>>>();
        let groups = groups.iter().map(named).collect::<Result<Vec<_>>>()?;
        let Eliminated { factor, spans, .. } = self.eliminated(last, &groups)?;
        let wanted: Vec<usize> = groups.iter().flatten().map(|&node| spans[node].position).collect();
        let covariances = factor.into_covariances(&wanted);
        let of = |group: &Vec<usize>| {
            let chosen: Vec<Span> = group.iter().map(|&node| spans[node]).collect();
            let found = covariances.of(&chosen);
            check_finite("covariance", &found).map(|()| found)
        };
        groups.iter().map(of).collect()
    }

    /// Eliminate all variables, those of `last` last, as if each of `groups` had a factor.
    fn eliminated(&self, last: &[u64], groups: &[Vec<usize>]) -> Result<Eliminated> {
        let mut at_end =
            last.iter().map(|name| Ok(self.blocks.of[self.node(*name)?] as usize)).collect::<Result<Vec<_>>>()?;
        at_end.sort_unstable();
        at_end.dedup();
        let tied =
            |nodes: &mut dyn Iterator<Item = usize>| nodes.map(|node| self.blocks.of[node]).collect::<Vec<u32>>();
        let cliques: Vec<Vec<u32>> = (self.terms.iter().map(|term| tied(&mut term.nodes.iter().map(|&n| n as usize))))
            .chain(groups.iter().map(|group| tied(&mut group.iter().copied())))
            .collect();
        let order = minimum_degree(&self.blocks.widths, cliques.iter().map(Vec::as_slice), &at_end);
        let tail = order.nodes.len() - at_end.len();
        let mut position = vec![0; order.nodes.len()];
        let mut block_starts = vec![0; order.nodes.len()]; // by block
        let mut total = 0;
        for (at, &block) in order.nodes.iter().enumerate() {
            (position[block], block_starts[block]) = (at, total);
            total += self.blocks.widths[block];
        }
        let place = |node: usize| (self.blocks.of[node] as usize, self.blocks.offsets[node]);
        let span = |node: usize| {
            let (block, offset) = place(node);
            Span { position: position[block], offset, width: self.widths[node] }
        };
        let spans: Vec<Span> = (0..self.widths.len()).map(span).collect();
        let starts: Vec<usize> =
            (0..self.widths.len()).map(place).map(|(block, offset)| block_starts[block] + offset).collect();
        let mut factor = Factor::new(&order, &self.blocks.widths, tail);
        let mut right = vec![0.0; total];
        for Term { nodes, hessian, gradient } in &self.terms {
            let variables: Vec<Span> = nodes.iter().map(|&node| spans[node as usize]).collect();
            factor.add(&variables, hessian);
            let mut from = 0;
            for &node in nodes {
                let (start, width) = (starts[node as usize], self.widths[node as usize]);
                right[start..start + width].iter_mut().zip(&gradient[from..]).for_each(|(r, g)| *r -= g);
                from += width;
            }
        }
        factor.eliminate()?;
        Ok(Eliminated { factor, spans, starts, tail, right })
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

impl Blocks {
    /// Take in the next variable.
    fn push(&mut self, block: u32, width: usize) {
        let at = block as usize;
        if at == self.widths.len() {
            self.widths.push(0);
        }
        self.of.push(block);
        self.offsets.push(self.widths[at]);
        self.widths[at] += width;
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
