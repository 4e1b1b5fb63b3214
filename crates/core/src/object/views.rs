//! What one view says of an object: rows for the solver, overlap of masks, distances of borders.

use nalgebra::{Vector2, Vector3};

use super::model::Model;
use super::state::ObjectState;
use crate::lie::Pose;
use crate::mesh::Topology;
use crate::outline::{OutlineSample, contour_samples, outline};
use crate::raster::Rect;
use crate::residuals::Rows;
use crate::residuals::border::{BorderMatch, backward_distances};
use crate::residuals::keypoints::{PositionNoise, keypoint_rows};
use crate::silhouette::Silhouette;
use crate::template::Template;
use crate::view::View;

/// An object before a view.
#[derive(Clone, Copy)]
pub(crate) struct Sight<'a> {
    pub template: &'a Template,
    pub model: &'a Model,
    pub view: &'a View,
    pub camera_from_object: Pose,
    /// In the object's frame.
    pub vertices: &'a [Vector3<f64>],
}

/// A view's border matched with the outline of an object; the buffers are reused.
#[derive(Debug, Clone, Default)]
pub(crate) struct MatchedView {
    pub(super) points: Vec<Vector3<f64>>,
    drawn: Silhouette,
    pub(super) samples: Vec<OutlineSample>,
    pub(super) border: BorderMatch,
}

impl MatchedView {
    /// Draw the object, sample its outline, match it with the observed border.
    pub(super) fn find(&mut self, sight: &Sight) {
        let Sight { template, model, view, camera_from_object, vertices } = sight;
        self.sample_outline(view, camera_from_object, vertices, template, model.outline_step_px);
        self.border.find(view, &self.samples, &model.border);
    }

    fn sample_outline(
        &mut self,
        view: &View,
        camera_from_object: &Pose,
        vertices: &[Vector3<f64>],
        template: &Template,
        step_px: f64,
    ) {
        let Self { points, drawn, samples, .. } = self;
        points.clear();
        points.extend(vertices.iter().map(|v| camera_from_object.transform(v)));
        drawn.draw(&view.camera, points, &template.topology);
        samples.clear();
        if drawn.by_contour {
            contour_samples(drawn, step_px, samples);
        } else {
            let rect = drawn.rect;
            *samples = outline(&view.camera, points, &template.topology, &rect, drawn.mask(), step_px);
        }
    }
}

impl Sight<'_> {
    /// Rows of border and key points; `keypoint_views` says in how many views each key point shares its offset.
    pub(crate) fn push_rows(&self, keypoint_views: &[u32], rows: &mut Rows) {
        if !self.view.border.is_empty() {
            let mut matched = MatchedView::default();
            matched.find(self);
            let MatchedView { points, samples, border, .. } = &matched;
            let noise = &self.model.border;
            border.push_rows(&self.view.camera, &self.camera_from_object, points, samples, noise, rows);
        }
        self.push_keypoint_rows(keypoint_views, rows);
    }

    /// Rows of the key points alone.
    pub(super) fn push_keypoint_rows(&self, keypoint_views: &[u32], rows: &mut Rows) {
        let Self { template, model, view, camera_from_object, vertices } = self;
        for observation in &view.keypoints {
            let association = &template.keypoints[observation.index];
            let views = keypoint_views[observation.index];
            let position = PositionNoise { sigma_m: model.keypoint_position_sigma_m, views };
            let kernel = model.keypoint_kernel;
            keypoint_rows(&view.camera, camera_from_object, vertices, association, observation, position, kernel, rows);
        }
    }
}

/// IoU of the drawn mesh with the observed mask in a view; pixels that an occluder hides count only where the mask has them.
#[must_use]
pub fn mask_iou(view: &View, world_from_object: &Pose, vertices: &[Vector3<f64>], topology: &Topology) -> f64 {
    let camera_from_object = view.world_from_camera.inverse().compose(world_from_object);
    let points: Vec<Vector3<f64>> = vertices.iter().map(|v| camera_from_object.transform(v)).collect();
    let mut silhouette = Silhouette::default();
    silhouette.draw(&view.camera, &points, topology);
    let rect = silhouette.rect;
    let shared = rect.intersection(&view.crop);
    let mask = silhouette.mask();
    let drawn = sum(mask.iter().copied());
    let (mut both, mut hidden) = (0, 0);
    let rows = if shared.width > 0 { shared.height } else { 0 };
    for row in 0..rows as i64 {
        let run = |of: &Rect| {
            let from = (shared.y0 + row - of.y0) as usize * of.width + (shared.x0 - of.x0) as usize;
            from..from + shared.width
        };
        let (mask, crop) = (&mask[run(&rect)], run(&view.crop));
        let inside = view.distance_px[crop.clone()].iter().map(|d| u8::from(*d < 0.0));
        both += sum(mask.iter().zip(inside.clone()).map(|(m, i)| m & i));
        hidden +=
            sum(mask.iter().zip(inside).zip(&view.hidden[crop]).map(|((m, i), h)| m & (1 - i) & u8::from(*h > 0)));
    }
    hidden += hidden_beyond(view, &rect, mask);
    both as f64 / (view.area_px + drawn - both - hidden).max(1) as f64
}

/// Drawn pixels off the crop that an occluder hides.
fn hidden_beyond(view: &View, rect: &Rect, mask: &[u8]) -> usize {
    if rect.intersection(&view.crop).area() == rect.area() || view.hidden.iter().all(|h| *h == 0) {
        return 0;
    }
    let pixels = mask.iter().enumerate().filter(|(_, drawn)| **drawn > 0);
    pixels
        .map(|(at, _)| (rect.x0 + (at % rect.width) as i64, rect.y0 + (at / rect.width) as i64))
        .filter(|(x, y)| view.crop.index(*x, *y).is_none() && view.is_hidden(&Vector2::new(*x as f64, *y as f64)))
        .count()
}

fn sum(ones: impl Iterator<Item = u8>) -> usize {
    ones.map(usize::from).sum()
}

/// Signed distances between the observed border and the mesh's outline in a view, in the order of the border's points:
/// nᵀ(x − b), pixels; NaN where the border is not the object's own or nothing is near.
#[must_use]
pub fn border_distances(template: &Template, view: &View, state: &ObjectState, step_px: f64) -> Vec<f64> {
    let camera_from_object = view.world_from_camera.inverse().compose(&state.pose_at(view.time_s));
    let vertices = template.vertices(&state.z, &state.d);
    let mut matched = MatchedView::default();
    matched.sample_outline(view, &camera_from_object, &vertices, template, step_px);
    backward_distances(view, &matched.samples)
}
