//! Laws of the core, over random and degenerate samples; slow, literal references stand beside them.
#![allow(clippy::unwrap_used, clippy::panic)] // a test fails by panicking

mod areas;
mod camera;
mod common;
mod envelope;
mod exact;
mod factor;
mod kernel;
mod levenberg_marquardt;
mod lie;
mod losses;
mod mesh;
mod nearest;
mod normal;
mod object;
mod outline;
mod problem;
mod raster;
mod residuals;
mod road;
mod template;
mod tracks;
mod triangulate;
mod view;
mod voxel;
mod window;
