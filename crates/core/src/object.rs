//! One object from its views: pose, modes and free-form shape by Levenberg–Marquardt.

mod layout;
mod uncertainty;
mod views;

use nalgebra::{Vector3, Vector6};

use crate::error::{Result, check_length};
use crate::lie::{Pose, hat};
use crate::residuals::border::BorderNoise;
use crate::residuals::ground::{Ground, ground_rows};
use crate::residuals::kernel::Kernel;
use crate::residuals::normal::{Dense, FreeForm, VertexNormal};
use crate::residuals::{Row, Rows, Term, object_derivative};
use crate::solve::envelope::Envelope;
use crate::solve::levenberg_marquardt::{Options, Problem, Report, levenberg_marquardt};
use crate::template::Template;
use crate::view::View;
use layout::{Layout, free_form_prior, multiply};
pub use uncertainty::{Block, Uncertainty, block_covariance, uncertainty};
use views::MatchedView;
pub(crate) use views::Sight;
pub use views::{border_distances, mask_iou};

/// An object: where it is and what it looks like.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectState {
    /// Its pose.
    pub world_from_object: Pose,
    /// Mode coefficients, in standard deviations.
    pub z: Vec<f64>,
    /// Free-form displacement, metres; one entry a degree of freedom of the symmetry basis.
    pub d: Vec<f64>,
    /// Its velocity in the world, m/s: `world_from_object` holds at time 0.
    pub velocity: Vector3<f64>,
}

impl ObjectState {
    /// The pose at another time.
    #[must_use]
    pub fn pose_at(&self, time_s: f64) -> Pose {
        let Pose { rotation, translation } = self.world_from_object;
        Pose { rotation, translation: translation + self.velocity * time_s }
    }
}

/// The velocity in the object's frame, in standard deviations.
fn whitened_velocity(state: &ObjectState) -> Vector3<f64> {
    let in_object = state.world_from_object.rotation.transpose() * state.velocity;
    in_object.component_div(&Vector3::from(VELOCITY_SIGMA_M_S))
}

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

/// Standard deviations of an object's velocity along its own x (it may drive), y and z (it neither skids nor flies), m/s.
const VELOCITY_SIGMA_M_S: [f64; 3] = [10.0, 0.3, 0.2];

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

/// An object with what was seen of it.
pub struct ObjectProblem<'a> {
    template: &'a Template,
    views: &'a [&'a View],
    ground: Option<Ground>,
    model: Model,
    scope: Scope,
    layout: Layout,
    free_form_prior: Option<Envelope>,
    keypoint_views: Vec<u32>,
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
        let free_form_prior = scope.free_form.then(|| free_form_prior(template, &layout, &model));
        let keypoint_views = vec![1; template.keypoints.len()];
        let work = Workspace::default();
        Self { template, views, ground, model, scope, layout, free_form_prior, keypoint_views, work }
    }

    /// The same problem with each key point's views sharing one offset of the category: right for a covariance. A
    /// solution keeps them apart, since a start far away needs every one of them to tell front from rear.
    #[must_use]
    fn with_shared_keypoint_offsets(mut self) -> Self {
        self.keypoint_views.fill(0);
        self.views.iter().flat_map(|view| &view.keypoints).for_each(|seen| self.keypoint_views[seen.index] += 1);
        self
    }

    /// The object at a state, whose vertices are given, before one of the views.
    fn sight<'b>(&'b self, view: &'b View, state: &ObjectState, vertices: &'b [Vector3<f64>]) -> Sight<'b> {
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

    /// Cost of the priors at a state: z ~ N(0, I), d as in [`free_form_prior`].
    fn prior_cost(&self, state: &ObjectState) -> f64 {
        let modes = if self.scope.modes { 0.5 * state.z.iter().map(|c| c * c).sum::<f64>() } else { 0.0 };
        let free_form = self.free_form_prior.as_ref().map_or(0.0, |prior| {
            let d = self.ordered(&state.d);
            0.5 * multiply(prior, &d, self.layout.free_form).iter().zip(&d).map(|(a, b)| a * b).sum::<f64>()
        });
        let velocity = if self.scope.velocity { 0.5 * whitened_velocity(state).norm_squared() } else { 0.0 };
        modes + free_form + velocity
    }

    /// Free-form parameters in the order of the normal equations.
    fn ordered(&self, d: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.layout.free_form];
        for (dof, value) in d.iter().enumerate() {
            out[self.layout.position[dof]] = *value;
        }
        out
    }

    fn add_row(
        &self,
        row: &Row,
        terms: &[Term],
        state: &ObjectState,
        vertices: &[Vector3<f64>],
        hessian: &mut Envelope,
        gradient: &mut [f64],
    ) {
        let weight = row.weight * row.kernel.weight(row.residual * row.residual);
        if weight == 0.0 {
            return;
        }
        let dense = self.dense_derivative(row, terms, vertices, &state.world_from_object);
        let sparse = if self.scope.free_form { self.sparse_derivative(terms) } else { Vec::new() };
        for (n, &(i, a)) in sparse.iter().enumerate() {
            gradient[i] += weight * a * row.residual;
            for &(j, b) in &sparse[..=n] {
                hessian.add(i, j, weight * a * b);
            }
        }
        let base = self.layout.free_form;
        for (k, &a) in dense.iter().enumerate() {
            let scaled = weight * a;
            gradient[base + k] += scaled * row.residual;
            for &(j, b) in &sparse {
                hessian.add(base + k, j, scaled * b);
            }
            for (entry, b) in hessian.run_mut(base + k, base, k + 1).iter_mut().zip(&dense) {
                *entry += scaled * b;
            }
        }
    }

    /// Rows u/σ of the velocity u = Rᵀv in the object's frame: ∂u/∂v = Rᵀ, ∂u/∂φ = û.
    fn add_velocity_prior(&self, state: &ObjectState, hessian: &mut Envelope, gradient: &mut [f64]) {
        let base = self.layout.free_form;
        let (turn, start) = (base + 3, base + self.velocity_start());
        let rotation = state.world_from_object.rotation.transpose();
        let (residual, by_turn) = (whitened_velocity(state), hat(&(rotation * state.velocity)));
        for (k, sigma) in VELOCITY_SIGMA_M_S.into_iter().enumerate() {
            let entry = |n: usize| {
                if n < 3 { (turn + n, by_turn[(k, n)] / sigma) } else { (start + n - 3, rotation[(k, n - 3)] / sigma) }
            };
            for (i, a) in (0..6).map(entry) {
                gradient[i] += a * residual[k];
                (0..6).map(entry).filter(|&(j, _)| j <= i).for_each(|(j, b)| hessian.add(i, j, a * b));
            }
        }
    }

    /// Where the velocity stands among the dense parameters.
    fn velocity_start(&self) -> usize {
        self.layout.dense - 3
    }

    /// Derivative over pose, modes and velocity.
    fn dense_derivative(&self, row: &Row, terms: &[Term], vertices: &[Vector3<f64>], pose: &Pose) -> Vec<f64> {
        let mut out = vec![0.0; self.layout.dense];
        out[..6].copy_from_slice(object_derivative(terms, vertices).as_slice());
        if self.scope.modes {
            for term in terms {
                for (entry, mode) in out[6..].iter_mut().zip(self.template.modes_of(term.vertex as usize)) {
                    *entry += term.gradient.dot(mode);
                }
            }
        }
        if self.scope.velocity {
            let force: Vector3<f64> = terms.iter().map(|term| term.gradient).sum();
            out[self.velocity_start()..].copy_from_slice((pose.rotation * force * row.time_s).as_slice());
        }
        out
    }

    /// Derivative over the free-form parameters, each named once.
    fn sparse_derivative(&self, terms: &[Term]) -> Vec<(usize, f64)> {
        let mut out: Vec<(usize, f64)> = Vec::with_capacity(3 * terms.len());
        for term in terms {
            for (dof, axis, sign) in self.template.symmetry.freedoms(term.vertex as usize) {
                let (at, value) = (self.layout.position[dof], sign * term.gradient[axis]);
                match out.iter_mut().find(|(i, _)| *i == at) {
                    Some((_, sum)) => *sum += value,
                    None => out.push((at, value)),
                }
            }
        }
        out
    }
}

impl Problem for ObjectProblem<'_> {
    type State = ObjectState;

    fn cost(&mut self, state: &ObjectState) -> f64 {
        let mut work = std::mem::take(&mut self.work);
        let vertices = self.template.vertices(&state.z, &state.d);
        self.point_rows(state, &vertices, &mut work.rows);
        let mut cost = work.rows.cost() + self.prior_cost(state);
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
        for (row, terms) in work.rows.iter() {
            self.add_row(row, terms, state, &vertices, hessian, gradient);
        }
        let of_points = work.rows.cost() + self.prior_cost(state);
        let cost = of_points + self.add_borders(state, &vertices, &mut work, hessian, gradient);
        self.work = work;
        if self.scope.modes {
            let base = self.layout.free_form + 6;
            for (k, c) in state.z.iter().enumerate() {
                gradient[base + k] += c;
                hessian.add(base + k, base + k, 1.0);
            }
        }
        if self.scope.velocity {
            self.add_velocity_prior(state, hessian, gradient);
        }
        if let Some(prior) = &self.free_form_prior {
            let product = multiply(prior, &self.ordered(&state.d), self.layout.free_form);
            gradient.iter_mut().zip(&product).for_each(|(g, p)| *g += p);
            hessian.add_matrix(prior);
        }
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
            next.velocity += Vector3::from_column_slice(&step[base + self.velocity_start()..]);
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

/// What an object turned out to be.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Where the optimizer ended, in the template's frame.
    pub state: ObjectState,
    /// How it got there.
    pub report: Report,
}

/// Lower the cost of an object's state over its pose and the blocks in `scope`.
///
/// # Errors
/// [`Error::Length`] if the state does not fit the template.
pub fn refine(
    template: &Template,
    views: &[&View],
    ground: Option<Ground>,
    model: Model,
    scope: Scope,
    state: ObjectState,
    options: &Options,
) -> Result<Estimate> {
    check_state(template, &state)?;
    let mut problem = ObjectProblem::new(template, views, ground, model, scope);
    let (state, report) = levenberg_marquardt(&mut problem, state, options);
    Ok(Estimate { state, report })
}

fn check_state(template: &Template, state: &ObjectState) -> Result<()> {
    check_length("mode coefficients", state.z.len(), template.mode_count)?;
    check_length("free-form displacement", state.d.len(), template.symmetry.dimension())
}
