//! The Python binding: shapes and indices are checked here, the GIL is released, errors are mapped; no logic.

mod autodiff;
mod constellations;
mod convert;
mod geometry;
mod gradients;
mod named;
mod object;
mod problem;
mod raster;
mod road;
mod shared;
mod tracks;
mod view;
mod window;

use pyo3::prelude::*;

#[pymodule]
mod _core {
    #[pymodule_export]
    use super::autodiff::{
        broadcast_shape, keypoint_losses, mask_iou_losses, silhouette_gradients, silhouettes, weighted_sums,
    };
    #[pymodule_export]
    use super::constellations::ParkedMap;
    #[pymodule_export]
    use super::geometry::{
        cotangent_weights, exp_so3, log_so3, right_jacobian, right_jacobian_inverse, triangulate, voxel_iou,
    };
    #[pymodule_export]
    use super::gradients::{MaskLoss, kato_pixel_gradient, mask_gradients};
    #[pymodule_export]
    use super::object::Template;
    #[pymodule_export]
    use super::problem::{ObjectState, Problem};
    #[pymodule_export]
    use super::raster::{coverage, outline, rasterize};
    #[pymodule_export]
    use super::road::RoadTexture;
    #[pymodule_export]
    use super::tracks::TrackedPoints;
    #[pymodule_export]
    use super::view::View;
    #[pymodule_export]
    use super::window::{BlockSystem, LinearFactor, Solution, Variables, linear_cost};
}
