//! Levenberg–Marquardt and the linear algebra under it.

pub mod envelope;
pub mod levenberg_marquardt;
pub mod triangulate;
