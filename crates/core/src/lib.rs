//! The mesh observation model, its residuals and its solvers.
//!
//! Metres, radians, pixels. A transform is named `a_from_b`; SE(3) tangent vectors are (translation, rotation) and
//! perturb on the right.

pub mod areas;
pub mod batch;
pub mod camera;
pub mod constellations;
pub mod contour;
pub mod error;
pub mod factor;
pub mod gradients;
pub mod kernel;
pub mod lie;
pub mod losses;
pub mod mesh;
pub mod object;
pub mod outline;
pub mod prepared;
pub mod raster;
pub mod residuals;
pub mod road;
mod rounding;
pub mod silhouette;
mod simd;
pub mod solve;
mod strips;
pub mod template;
pub mod tracks;
pub mod view;
pub mod visible;
pub mod voxel;
pub mod window;
