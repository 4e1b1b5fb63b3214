//! What is believed before anything is seen, and which parameters are estimated.

use crate::kernel::Kernel;
use crate::residuals::border::BorderNoise;

/// Which blocks move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scope {
    /// Mode coefficients.
    pub modes: bool,
    /// Free-form displacement.
    pub free_form: bool,
    /// Velocity.
    pub velocity: bool,
}

/// What is believed before anything is seen, and of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    /// The mask's border.
    pub border: BorderNoise,
    /// Spacing of the outline's samples, pixels.
    pub outline_step_px: f64,
    /// How far the category's key points may lie from the instance's, metres.
    pub keypoint_position_sigma_m: f64,
    /// Robust kernel of key points.
    pub keypoint_kernel: Kernel,
    /// Free-form displacement of a vertex, metres.
    pub free_form_sigma_m: f64,
    /// How far a vertex's displacement may part from its neighbours' average, metres.
    pub smoothness_sigma_m: f64,
}
