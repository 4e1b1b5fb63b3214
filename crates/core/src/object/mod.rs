//! One object from its views: pose, modes and free-form shape by Levenberg–Marquardt.

mod derivative;
mod layout;
mod model;
mod prior;
mod problem;
mod refine;
mod state;
mod uncertainty;
mod views;

pub use model::{Model, Scope};
pub use problem::ObjectProblem;
pub use refine::{Estimate, refine};
pub use state::ObjectState;
pub use uncertainty::{Block, Uncertainty, block_covariance, uncertainty};
pub(crate) use views::Sight;
pub use views::{border_distances, mask_iou};
