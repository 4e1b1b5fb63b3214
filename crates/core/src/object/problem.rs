//! An object with what was seen of it, as a problem for the solver.

use nalgebra::{Vector3, Vector6};

use super::derivative::RowDerivative;
use super::layout::Layout;
use super::model::{Model, Scope};
use super::prior::Priors;
use super::state::ObjectState;
use super::views::{MatchedView, Sight};
use crate::kernel::Kernel;
use crate::residuals::Rows;
use crate::residuals::ground::{Ground, ground_rows};
use crate::residuals::normal::{Dense, FreeForm, VertexNormal};
use crate::solve::envelope::Envelope;
use crate::solve::levenberg_marquardt::Problem;
use crate::template::Template;
use crate::view::View;

/// An object with what was seen of it.
pub struct ObjectProblem<'a> {
    pub(super) template: &'a Template,
    pub(super) views: &'a [&'a View],
    ground: Option<Ground>,
    model: Model,
    pub(super) scope: Scope,
    pub(super) layout: Layout,
    priors: Priors,
    pub(super) keypoint_views: Vec<u32>,
    work: Workspace,
}

/// Buffers that one evaluation after another reuses.
#[derive(Default)]
struct Workspace {
    matched: MatchedView,
    borders: VertexNormal,
    rows: Rows,
}

impl<'a> ObjectProblem<'a> {
    /// Put a problem together.
    #[must_use]
    pub fn new(
        template: &'a Template,
        views: &'a [&'a View],
        ground: Option<Ground>,
        model: Model,
        scope: Scope,
    ) -> Self {
        let layout = Layout::new(template, scope);
        let priors = Priors::new(template, &layout, &model, scope);
        let keypoint_views = vec![1; template.keypoints.len()];
        let work = Workspace::default();
        Self { template, views, ground, model, scope, layout, priors, keypoint_views, work }
    }

    /// The same problem with each key point's views sharing one offset of the category: right for a covariance. A
    /// solution keeps them apart, since a start far away needs every one of them to tell front from rear.
    #[must_use]
    pub(super) fn with_shared_keypoint_offsets(mut self) -> Self {
        self.keypoint_views.fill(0);
        self.views.iter().flat_map(|view| &view.keypoints).for_each(|seen| self.keypoint_views[seen.index] += 1);
        self
    }

    /// The object at a state, whose vertices are given, before one of the views.
    pub(super) fn sight<'b>(&'b self, view: &'b View, state: &ObjectState, vertices: &'b [Vector3<f64>]) -> Sight<'b> {
        let camera_from_object = view.world_from_camera.inverse().compose(&state.pose_at(view.time_s));
        Sight { template: self.template, model: &self.model, view, camera_from_object, vertices }
    }

    /// Views that show a border.
    fn bordered(&self) -> impl Iterator<Item = &'a View> {
        self.views.iter().copied().filter(|view| !view.border.is_empty())
    }

    /// Rows of all key points and of the ground.
    fn point_rows(&self, state: &ObjectState, vertices: &[Vector3<f64>], rows: &mut Rows) {
        rows.clear();
        for view in self.views {
            rows.set_time(view.time_s);
            self.sight(view, state, vertices).push_keypoint_rows(&self.keypoint_views, rows);
        }
        rows.set_time(0.0);
        if let Some(ground) = &self.ground {
            let contacts = &self.template.contacts;
            ground_rows(&state.world_from_object, vertices, contacts, ground, Kernel::Squared, rows);
        }
    }

    /// Add the normal equations of all borders; their cost.
    fn add_borders(
        &self,
        state: &ObjectState,
        vertices: &[Vector3<f64>],
        work: &mut Workspace,
        hessian: &mut Envelope,
        gradient: &mut [f64],
    ) -> f64 {
        let Workspace { matched, borders, .. } = work;
        let free_form = FreeForm { symmetry: &self.template.symmetry, position: &self.layout.position };
        let free_form = self.scope.free_form.then_some(&free_form);
        let mut gather = |borders: &mut VertexNormal, time_s: f64| {
            let dense = self.dense(state, vertices, time_s);
            borders.gather(&dense, free_form, self.layout.free_form, hessian, gradient);
            borders.clear(vertices.len());
        };
        borders.clear(vertices.len());
        let mut cost = 0.0;
        for view in self.bordered() {
            let sight = self.sight(view, state, vertices);
            matched.find(&sight);
            let MatchedView { points, samples, border, .. } = &*matched;
            let (rotation, noise) = (&sight.camera_from_object.rotation, &self.model.border);
            cost += borders.add_border(&view.camera, rotation, points, samples, border, noise);
            if self.scope.velocity {
                gather(borders, view.time_s); // vertices move with a velocity by its time
            }
        }
        gather(borders, 0.0);
        cost
    }

    /// How vertices move with the dense parameters, at a time.
    fn dense<'b>(&'b self, state: &ObjectState, vertices: &'b [Vector3<f64>], time_s: f64) -> Dense<'b> {
        let modes =
            if self.scope.modes { (self.template.modes.as_slice(), self.template.mode_count) } else { (&[][..], 0) };
        let velocity = self.scope.velocity.then(|| state.world_from_object.rotation.transpose() * time_s);
        Dense { vertices, modes, velocity }
    }
}

impl Problem for ObjectProblem<'_> {
    type State = ObjectState;

    fn cost(&mut self, state: &ObjectState) -> f64 {
        let mut work = std::mem::take(&mut self.work);
        let vertices = self.template.vertices(&state.z, &state.d);
        self.point_rows(state, &vertices, &mut work.rows);
        let mut cost = work.rows.cost() + self.priors.cost(state, &self.layout);
        for view in self.bordered() {
            work.matched.find(&self.sight(view, state, &vertices));
            cost += work.matched.border.cost(self.model.border.kernel);
        }
        self.work = work;
        cost
    }

    fn linearize(&mut self, state: &ObjectState, hessian: &mut Envelope, gradient: &mut [f64]) -> f64 {
        let mut work = std::mem::take(&mut self.work);
        let vertices = self.template.vertices(&state.z, &state.d);
        self.point_rows(state, &vertices, &mut work.rows);
        let derivative = RowDerivative {
            template: self.template,
            layout: &self.layout,
            scope: self.scope,
            vertices: &vertices,
            world_from_object: &state.world_from_object,
        };
        work.rows.iter().for_each(|(row, terms)| derivative.add(row, terms, hessian, gradient));
        let of_points = work.rows.cost() + self.priors.cost(state, &self.layout);
        let cost = of_points + self.add_borders(state, &vertices, &mut work, hessian, gradient);
        self.work = work;
        self.priors.add(state, &self.layout, hessian, gradient);
        cost
    }

    fn retract(&self, state: &ObjectState, step: &[f64]) -> ObjectState {
        let base = self.layout.free_form;
        let mut next = state.clone();
        next.world_from_object = state.world_from_object.retract(&Vector6::from_column_slice(&step[base..base + 6]));
        if self.scope.modes {
            next.z.iter_mut().zip(&step[base + 6..]).for_each(|(c, s)| *c += s);
        }
        if self.scope.velocity {
            next.velocity += Vector3::from_column_slice(&step[base + self.layout.velocity_start()..]);
        }
        if self.scope.free_form {
            next.d.iter_mut().enumerate().for_each(|(dof, value)| *value += step[self.layout.position[dof]]);
        }
        next
    }

    fn structure(&self) -> Envelope {
        Envelope::new(self.layout.first.clone())
    }
}
