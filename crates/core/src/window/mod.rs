//! A window of variables and what is known of them: linear factors, and the normal equations of all factors.
//!
//! Variables have numbers that the graph gives them. A step of a pose is a logarithm of SE(3), here (rotation,
//! translation), which is the graph's order; that of a rotation is one of SO(3), that of a vector is a difference.

mod eliminate;
mod linear;
mod order;
mod system;
mod variables;

pub use linear::{LinearFactor, linear_cost};
pub use system::{BlockSystem, Solution};
pub use variables::{Variable, Variables};
