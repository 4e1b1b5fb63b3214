//! Factors that are linear about the values that they were linearized at.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::variables::{Variable, Variables};
use crate::error::{Error, Result, check_finite, check_length};

/// ½ |A x − b|², x being the steps of some variables from given values.
#[derive(Debug, Clone)]
pub struct LinearFactor {
    pub(super) names: Vec<u64>,
    at: Vec<Variable>,
    jacobian: DMatrix<f64>, // A
    right: DVector<f64>,    // b
    /// AᵀA, whole.
    pub(super) information: Arc<[f64]>,
}

impl LinearFactor {
    /// `rows` is [A b], row by row; its columns are those of `names` in their order, `at` holds their values.
    ///
    /// # Errors
    /// [`Error`] for a variable that `at` does not hold, rows of another length, or a value that is not finite.
    pub fn new(names: Vec<u64>, at: &Variables, rows: &[f64]) -> Result<Self> {
        let at = names.iter().map(|name| at.get(*name).cloned()).collect::<Result<Vec<_>>>()?;
        let columns: usize = at.iter().map(Variable::width).sum();
        check_finite("rows", rows)?;
        let height = rows.len() / (columns + 1);
        check_length("rows", rows.len(), height * (columns + 1))?;
        let all = DMatrix::from_row_slice(height, columns + 1, rows);
        let (jacobian, right) = (all.columns(0, columns).into_owned(), all.column(columns).into_owned());
        let information = (jacobian.transpose() * &jacobian).as_slice().into();
        Ok(Self { names, at, jacobian, right, information })
    }

    /// A x − b.
    fn residual(&self, variables: &Variables) -> Result<DVector<f64>> {
        let mut step = DVector::zeros(self.jacobian.ncols());
        let mut start = 0;
        for (name, from) in self.names.iter().zip(&self.at) {
            let to = variables.get(*name)?;
            if !from.is_like(to) {
                return Err(Error::Length { what: "a variable", found: to.width(), expected: from.width() });
            }
            from.step_to(to, &mut step.as_mut_slice()[start..start + from.width()]);
            start += from.width();
        }
        Ok(&self.jacobian * step - &self.right)
    }

    /// Aᵀ (A x − b).
    pub(super) fn gradient(&self, variables: &Variables) -> Result<Vec<f64>> {
        Ok(self.jacobian.tr_mul(&self.residual(variables)?).as_slice().to_vec())
    }
}

/// The sum of the factors' costs.
///
/// # Errors
/// [`Error`] for a variable that is not there, or is of another kind.
pub fn linear_cost<'a>(factors: impl IntoIterator<Item = &'a LinearFactor>, variables: &Variables) -> Result<f64> {
    factors.into_iter().map(|factor| Ok(0.5 * factor.residual(variables)?.norm_squared())).sum()
}
