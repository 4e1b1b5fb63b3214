//! The mask's border against the mesh's outline, both ways.
//!
//! Forward: a sample of the outline is at a signed distance from the observed border. Backward: a point of the observed
//! border lies nᵀ(x − b) from the nearest sample x of the outline with normal n. The exact gradient of the IoU is an
//! integral over the visible outline, and these are its second-order form. Each view's forward sums are normalized to the length of the observed
//! border, else a mesh that shrinks or recedes would pay less.

use nalgebra::{Vector2, Vector3};

use super::nearest::Cells;
use super::{Rows, Term};
use crate::camera::Camera;
use crate::kernel::Kernel;
use crate::lie::Pose;
use crate::outline::OutlineSample;
use crate::simd::wide;
use crate::view::{BorderPoint, Look, View};

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

/// What the observed border asks of one sample of the outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pull {
    /// The sample.
    pub sample: u32,
    /// Its signed distance over σ, cut at the cap.
    pub residual: f64,
    /// Derivative of the distance over the sample's pixel.
    pub direction: Vector2<f64>,
    /// The share of an independent observation that it is.
    pub weight: f64,
}

/// A view's border matched with an outline; the buffers are reused.
#[derive(Debug, Clone, Default)]
pub struct BorderMatch {
    /// Forward pulls in the order of the samples, then backward ones in the order of the border.
    pub pulls: Vec<Pull>,
    /// Cost of what no sample explains.
    pub constant: f64,
    visible: Vec<u32>,
    cells: Cells,
}

impl BorderMatch {
    /// Match both ways. The mask's error σ and the surface's s add in variance: pulls keep the kernel of σ, and weigh
    /// σ²/(σ² + s²).
    pub fn find(&mut self, view: &View, samples: &[OutlineSample], noise: &BorderNoise) {
        let trust = noise.sigma_px.powi(2) / (noise.sigma_px.powi(2) + view.surface_sigma_px.powi(2));
        let share = 0.5 * trust / noise.correlation_px; // both ways tell the same once
        self.constant = 0.0;
        self.find_forward(view, samples, share, noise);
        wide(
            #[inline(always)]
            || self.find_backward(view, samples, share, noise),
        );
    }

    /// Robust cost ½ Σ w ρ(r²).
    #[must_use]
    pub fn cost(&self, kernel: Kernel) -> f64 {
        let of_pulls: f64 = self.pulls.iter().map(|p| 0.5 * p.weight * kernel.loss(p.residual * p.residual)).sum();
        self.constant + of_pulls
    }

    /// A row for each pull: its derivative goes to the two ends of the sample's edge. Vertices are given in the camera's frame.
    pub fn push_rows(
        &self,
        camera: &Camera,
        camera_from_object: &Pose,
        points_in_camera: &[Vector3<f64>],
        samples: &[OutlineSample],
        noise: &BorderNoise,
        rows: &mut Rows,
    ) {
        rows.push_constant(self.constant);
        for pull in &self.pulls {
            let sample = &samples[pull.sample as usize];
            let on_image = pull.direction / noise.sigma_px;
            let levers = sample.levers(camera, points_in_camera);
            let terms = [0, 1].map(|end| Term {
                vertex: sample.vertices[end],
                gradient: camera_from_object.rotation.transpose() * (levers[end].transpose() * on_image),
            });
            rows.push(pull.residual, pull.weight, noise.kernel, terms);
        }
    }

    fn find_forward(&mut self, view: &View, samples: &[OutlineSample], share: f64, noise: &BorderNoise) {
        let Self { pulls, constant, visible, .. } = self;
        pulls.clear();
        visible.clear();
        let mut drawn_px = 0.0;
        for (sample, at) in samples.iter().zip(0u32..) {
            let Some(Look { distance_px, direction, own }) = view.look(&sample.pixel) else { continue };
            visible.push(at);
            // where the observed border is not the object's own, the object may reach beyond it
            if own || distance_px < 0.0 {
                drawn_px += sample.length;
                pulls.push(Pull { sample: at, residual: whiten(distance_px, noise), direction, weight: sample.length });
            }
        }
        if drawn_px > 0.0 {
            let normalized = share * view.border_length_px / drawn_px;
            pulls.iter_mut().for_each(|pull| pull.weight *= normalized);
        } else {
            *constant += share * view.border_length_px * unexplained(noise);
        }
    }

    #[inline(always)]
    fn find_backward(&mut self, view: &View, samples: &[OutlineSample], share: f64, noise: &BorderNoise) {
        let Self { pulls, constant, visible, cells } = self;
        cells.sort(visible.iter().map(|&at| samples[at as usize].pixel));
        let mut last = None;
        for point in &view.border {
            let weight = share * point.length;
            last = cells.nearest(&point.pixel, last);
            let Some(nearest) = last else {
                if point.own {
                    *constant += weight * unexplained(noise);
                }
                continue;
            };
            let sample = visible[nearest];
            let OutlineSample { pixel, normal, .. } = samples[sample as usize];
            let distance_px = normal.dot(&(pixel - point.pixel));
            if point.own || distance_px < 0.0 {
                pulls.push(Pull { sample, residual: whiten(distance_px, noise), direction: normal, weight });
            }
        }
    }
}

/// nᵀ(x − b) of every border point b; NaN where the border is not the object's own or nothing is near.
#[must_use]
pub fn backward_distances(view: &View, samples: &[OutlineSample]) -> Vec<f64> {
    let visible: Vec<&OutlineSample> = samples.iter().filter(|s| view.look(&s.pixel).is_some()).collect();
    let mut cells = Cells::default();
    cells.sort(visible.iter().map(|s| s.pixel));
    let distance = |point: &BorderPoint| match cells.nearest(&point.pixel, None) {
        Some(nearest) if point.own => visible[nearest].normal.dot(&(visible[nearest].pixel - point.pixel)),
        _ => f64::NAN,
    };
    view.border.iter().map(distance).collect()
}

fn whiten(distance_px: f64, noise: &BorderNoise) -> f64 {
    distance_px.clamp(-noise.cap_px, noise.cap_px) / noise.sigma_px
}

/// Cost of an independent observation that the model does not explain at all.
fn unexplained(noise: &BorderNoise) -> f64 {
    0.5 * noise.kernel.loss((noise.cap_px / noise.sigma_px).powi(2))
}
