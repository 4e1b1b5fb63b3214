//! The mask's border against the mesh's outline, both ways.
//!
//! Forward: a sample of the outline is at a signed distance from the observed border. Backward: a point of the observed
//! border lies nᵀ(x − b) from the nearest sample x of the outline with normal n. The exact gradient of the IoU is an
//! integral over the visible outline, and these are its second-order form. Each view's forward sums are normalized to the length of the observed
//! border, else a mesh that shrinks or recedes would pay less.

use nalgebra::{Vector2, Vector3};

use super::{Rows, Term, kernel::Kernel, nearest::Cells};
use crate::camera::Camera;
use crate::lie::Pose;
use crate::outline::OutlineSample;
use crate::view::View;

/// How border residuals are weighed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BorderNoise {
    /// Standard deviation of the observed border, pixels.
    pub sigma_px: f64,
    /// Length of border over which its error is one and the same, pixels.
    pub correlation_px: f64,
    /// The robust kernel.
    pub kernel: Kernel,
    /// Beyond this distance a residual is cut, pixels.
    pub cap_px: f64,
}

/// Rows of both directions for one view. The mask's error σ and the surface's s add in variance: rows keep the kernel of
/// σ, and weigh σ²/(σ² + s²).
pub fn border_rows(
    view: &View,
    camera_from_object: &Pose,
    samples: &[OutlineSample],
    noise: &BorderNoise,
    rows: &mut Rows,
) {
    let used: Vec<(&OutlineSample, f64, Vector2<f64>)> =
        samples.iter().filter_map(|s| forward_residual(view, s).map(|(r, g)| (s, r, g))).collect();
    let drawn: f64 = used.iter().map(|(s, _, _)| s.length).sum();
    let trust = noise.sigma_px.powi(2) / (noise.sigma_px.powi(2) + view.surface_sigma_px.powi(2));
    let share = 0.5 * trust / noise.correlation_px; // both ways tell the same once
    if drawn > 0.0 {
        let normalized = share * view.border_length_px / drawn;
        for (sample, residual, gradient) in used {
            push(view, camera_from_object, sample, residual, gradient, normalized * sample.length, noise, rows);
        }
    } else {
        rows.push_constant(
            0.5 * share * view.border_length_px * noise.kernel.loss((noise.cap_px / noise.sigma_px).powi(2)),
        );
    }
    backward_rows(view, camera_from_object, samples, share, noise, rows);
}

/// Signed distance of an outline sample to the observed border with its gradient on the image; none where the observed
/// border is not the object's own and says nothing about it.
fn forward_residual(view: &View, sample: &OutlineSample) -> Option<(f64, Vector2<f64>)> {
    if !view.in_image(&sample.pixel) || view.is_hidden(&sample.pixel) {
        return None;
    }
    let (distance, gradient) = view.distance(&sample.pixel);
    (view.border_is_own(&sample.pixel) || distance < 0.0).then_some((distance, gradient))
}

fn backward_rows(
    view: &View,
    camera_from_object: &Pose,
    samples: &[OutlineSample],
    share: f64,
    noise: &BorderNoise,
    rows: &mut Rows,
) {
    let visible = visible_samples(view, samples);
    for (point, nearest) in view.border.iter().zip(nearest_samples(view, &visible)) {
        let weight = share * point.length;
        let Some(sample) = nearest else {
            if point.own {
                rows.push_constant(0.5 * weight * noise.kernel.loss((noise.cap_px / noise.sigma_px).powi(2)));
            }
            continue;
        };
        let residual = sample.normal.dot(&(sample.pixel - point.pixel));
        if point.own || residual < 0.0 {
            push(view, camera_from_object, sample, residual, sample.normal, weight, noise, rows);
        }
    }
}

/// nᵀ(x − b) of every border point b; NaN where the border is not the object's own or nothing is near.
#[must_use]
pub fn backward_distances(view: &View, samples: &[OutlineSample]) -> Vec<f64> {
    let visible = visible_samples(view, samples);
    let paired = view.border.iter().zip(nearest_samples(view, &visible));
    paired
        .map(|(point, nearest)| match nearest {
            Some(sample) if point.own => sample.normal.dot(&(sample.pixel - point.pixel)),
            _ => f64::NAN,
        })
        .collect()
}

fn visible_samples<'a>(view: &View, samples: &'a [OutlineSample]) -> Vec<&'a OutlineSample> {
    samples.iter().filter(|s| view.in_image(&s.pixel) && !view.is_hidden(&s.pixel)).collect()
}

/// The sample nearest to each border point; none where there is no sample.
fn nearest_samples<'a>(view: &View, visible: &[&'a OutlineSample]) -> Vec<Option<&'a OutlineSample>> {
    let cells = Cells::new(&visible.iter().map(|s| s.pixel).collect::<Vec<_>>());
    view.border.iter().map(|p| cells.nearest(&p.pixel).map(|i| visible[i])).collect()
}

/// Add the row of a residual on the image at an outline sample: its derivative goes to the two ends of the edge.
#[allow(clippy::too_many_arguments)] // one private call, its arguments are the formula's
fn push(
    view: &View,
    camera_from_object: &Pose,
    sample: &OutlineSample,
    residual: f64,
    gradient: Vector2<f64>,
    weight: f64,
    noise: &BorderNoise,
    rows: &mut Rows,
) {
    let in_object =
        point_gradient(&view.camera, camera_from_object, &sample.point_in_camera, &gradient) / noise.sigma_px;
    let capped = residual.clamp(-noise.cap_px, noise.cap_px) / noise.sigma_px;
    let [a, b] = sample.vertices;
    let terms = [
        Term { vertex: a, gradient: in_object * (1.0 - sample.weight) },
        Term { vertex: b, gradient: in_object * sample.weight },
    ];
    rows.push(capped, weight, noise.kernel, terms);
}

/// From a gradient on the image to one over the point in the object's frame.
fn point_gradient(
    camera: &Camera,
    camera_from_object: &Pose,
    point_in_camera: &Vector3<f64>,
    on_image: &Vector2<f64>,
) -> Vector3<f64> {
    let in_camera = camera.projection_jacobian(point_in_camera).transpose() * on_image;
    camera_from_object.rotation.transpose() * in_camera
}
