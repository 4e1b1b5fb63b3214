//! The object that explains its views best.

use super::model::{Model, Scope};
use super::problem::ObjectProblem;
use super::state::ObjectState;
use crate::error::Result;
use crate::residuals::ground::Ground;
use crate::solve::levenberg_marquardt::{Options, Report, levenberg_marquardt};
use crate::template::Template;
use crate::view::View;

/// What an object turned out to be.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Where the optimizer ended, in the template's frame.
    pub state: ObjectState,
    /// How it got there.
    pub report: Report,
}

/// Lower the cost of an object's state over its pose and the blocks in `scope`.
///
/// # Errors
/// [`crate::error::Error::Length`] if the state does not fit the template.
pub fn refine(
    template: &Template,
    views: &[&View],
    ground: Option<Ground>,
    model: Model,
    scope: Scope,
    state: ObjectState,
    options: &Options,
) -> Result<Estimate> {
    state.check(template)?;
    let mut problem = ObjectProblem::new(template, views, ground, model, scope);
    let (state, report) = levenberg_marquardt(&mut problem, state, options);
    Ok(Estimate { state, report })
}
