//! One view of one object as a factor of a graph: its cost near a relative pose, in square-root form.
//!
//! The residuals of a view depend on camera and object only through `camera_from_object`. A right perturbation of
//! `world_from_object` is one of `camera_from_object`; one of `world_from_camera` by ξ is one by −Ad(object_from_camera) ξ.
//! So the derivative over the object, and over the modes, is all that a graph needs.

use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::error::{Error, Result, check_finite, check_length};
use crate::lie::Pose;
use crate::object::{Model, Sight};
use crate::residuals::{Rows, object_derivative};
use crate::template::Template;
use crate::view::View;

/// A robust cost near a state: ½ |R (δ, 1)|² with δ = (translation, rotation, modes).
#[derive(Debug, Clone, PartialEq)]
pub struct SquareRoot {
    /// Upper triangular, columns + 1 rows and columns, row-major. The last column is the residual; its last entry carries
    /// what no step changes, so that half the squared norm of the column is the cost.
    pub root: Vec<f64>,
    /// Columns of δ.
    pub columns: usize,
    /// The cost at the state.
    pub cost: f64,
    /// How many independent observations there are: the sum of the rows' weights.
    pub observations: f64,
}

/// Linearize a view of an object at `camera_from_object`, with `modes` also over z; `d` may be empty.
///
/// The pose and the time in `view` are not used.
///
/// # Errors
/// [`Error`] if the state does not fit the template, or is not finite.
pub fn square_root(
    template: &Template,
    view: &View,
    model: &Model,
    camera_from_object: &Pose,
    z: &[f64],
    d: &[f64],
    modes: bool,
) -> Result<SquareRoot> {
    check_length("mode coefficients", z.len(), template.mode_count)?;
    check_finite("mode coefficients", z)?;
    if !d.is_empty() {
        check_length("free-form displacement", d.len(), template.symmetry.dimension())?;
    }
    let count = template.keypoints.len();
    if let Some(odd) = view.keypoints.iter().find(|k| k.index >= count) {
        return Err(Error::Index { what: "key point", index: odd.index as i64, count });
    }
    let vertices = template.vertices(z, d);
    let mut rows = Rows::default();
    let each_alone = vec![1; count];
    let sight = Sight { template, model, view, camera_from_object: *camera_from_object, vertices: &vertices };
    sight.push_rows(&each_alone, &mut rows);
    let columns = 6 + if modes { template.mode_count } else { 0 };
    let width = columns + 1;
    let mut stacked = DMatrix::zeros(rows.len().max(width), width);
    let mut observations = 0.0;
    for (i, (row, terms)) in rows.iter().enumerate() {
        observations += row.weight;
        let scale = (row.weight * row.kernel.weight(row.residual * row.residual)).sqrt();
        let mut out = stacked.row_mut(i);
        object_derivative(terms, &vertices).iter().enumerate().for_each(|(k, x)| out[k] = scale * x);
        if modes {
            for term in terms {
                for (k, mode) in template.modes_of(term.vertex as usize).iter().enumerate() {
                    out[6 + k] += scale * term.gradient.dot(mode);
                }
            }
        }
        out[columns] = scale * row.residual;
    }
    let cost = rows.cost();
    Ok(SquareRoot { root: triangle(stacked, cost), columns, cost, observations })
}

/// A view with the relative pose and the modes that it is linearized at.
#[derive(Debug, Clone)]
pub struct ViewAt<'a> {
    /// The view; its own pose and time are not used.
    pub view: &'a View,
    /// Where the object is.
    pub camera_from_object: Pose,
    /// Its modes, in standard deviations.
    pub z: Vec<f64>,
}

/// As [`square_root`] of many views, without free form; views share the threads, each result is one thread's.
///
/// # Errors
/// As of [`square_root`], for the first view that has one.
pub fn square_roots(template: &Template, views: &[ViewAt], model: &Model, modes: bool) -> Result<Vec<SquareRoot>> {
    let of = |at: &ViewAt| square_root(template, at.view, model, &at.camera_from_object, &at.z, &[], modes);
    views.par_iter().map(of).collect::<Vec<_>>().into_iter().collect()
}

/// The triangular factor of rows [J | r], its last entry set so that the last column's norm gives the cost: a robust
/// cost is never less than half the sum of the weighted squares.
fn triangle(stacked: DMatrix<f64>, cost: f64) -> Vec<f64> {
    let width = stacked.ncols();
    let factor = stacked.qr().unpack_r();
    let mut root: Vec<f64> = (0..width * width).map(|i| factor[(i / width, i % width)]).collect();
    let within: f64 = (0..width - 1).map(|i| root[i * width + width - 1].powi(2)).sum();
    root[width * width - 1] = (2.0 * cost - within).max(0.0).sqrt();
    root
}
