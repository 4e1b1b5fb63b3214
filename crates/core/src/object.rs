//! One object from its views: pose, modes and free-form shape by Levenberg–Marquardt.

use nalgebra::{Matrix6, Vector3, Vector6};

use crate::error::{Result, check_length};
use crate::lie::{Pose, hat};
use crate::outline::{OutlineSample, contour_samples, outline};
use crate::raster::{Rect, fill_mask};
use crate::residuals::border::{BorderNoise, border_rows};
use crate::residuals::ground::{Ground, ground_rows};
use crate::residuals::kernel::Kernel;
use crate::residuals::keypoints::{PositionNoise, keypoint_rows};
use crate::residuals::normal::VertexNormal;
use crate::residuals::{Row, Rows, Term, object_derivative};
use crate::silhouette::Silhouette;
use crate::solve::envelope::{Envelope, reverse_cuthill_mckee};
use crate::solve::levenberg_marquardt::{Options, Problem, Report, levenberg_marquardt};
use crate::template::Template;
use crate::view::View;

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
}

/// Where each parameter stands in the normal equations: free-form first, in an order that keeps neighbours together, then pose, modes, velocity.
struct Layout {
    position: Vec<usize>,
    first: Vec<usize>,
    free_form: usize,
    dense: usize,
}

impl Layout {
    fn new(template: &Template, scope: Scope) -> Self {
        let dense = 6 + if scope.modes { template.mode_count } else { 0 } + if scope.velocity { 3 } else { 0 };
        if !scope.free_form {
            return Self { position: Vec::new(), first: vec![0; dense], free_form: 0, dense };
        }
        let symmetry = &template.symmetry;
        let (mut coupled, in_contact) = (coupled_blocks(template), contact_blocks(template));
        let mut order = reverse_cuthill_mckee(&coupled);
        order.sort_by_key(|block| in_contact.contains(block)); // stable: wheels touch each other through the ground, so they come last
        in_contact.iter().for_each(|&block| coupled[block as usize].extend(&in_contact));
        let mut position = vec![0; symmetry.dimension()];
        let mut block_start = vec![0; coupled.len()];
        let mut next = 0;
        for block in order {
            let block = block as usize;
            block_start[block] = next;
            for at in &mut position[symmetry.offset[block]..symmetry.offset[block + 1]] {
                *at = next;
                next += 1;
            }
        }
        let mut first = vec![0; next + dense];
        for (block, others) in coupled.iter().enumerate() {
            let earliest = others.iter().map(|&b| block_start[b as usize]).fold(block_start[block], usize::min);
            for dof in symmetry.offset[block]..symmetry.offset[block + 1] {
                first[position[dof]] = earliest;
            }
        }
        Self { position, first, free_form: next, dense }
    }
}

/// Free-form blocks of the vertices that touch the ground.
fn contact_blocks(template: &Template) -> Vec<u32> {
    let vertices = template.contacts.iter().flat_map(|contact| &contact.weights);
    let mut blocks: Vec<u32> = vertices.map(|&(v, _)| template.symmetry.block_of[v as usize]).collect();
    blocks.sort_unstable();
    blocks.dedup();
    blocks
}

/// Free-form blocks that share a row: a vertex's neighbours through the Laplacian, a key point's vertices.
fn coupled_blocks(template: &Template) -> Vec<Vec<u32>> {
    let symmetry = &template.symmetry;
    let mut coupled = vec![Vec::new(); symmetry.representative.len()];
    let around = template.laplacian.iter().enumerate().map(|(block, row)| (Some(block as u32), row));
    let keypoints = template.keypoints.iter().map(|association| (None, association));
    for (block, row) in around.chain(keypoints) {
        let members: Vec<u32> = row.iter().map(|&(v, _)| symmetry.block_of[v as usize]).chain(block).collect();
        for &a in &members {
            coupled[a as usize].extend(members.iter().copied().filter(|&b| b != a));
        }
    }
    for list in &mut coupled {
        list.sort_unstable();
        list.dedup();
    }
    coupled
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
        Self { template, views, ground, model, scope, layout, free_form_prior, keypoint_views }
    }

    /// The same problem with each key point's views sharing one offset of the category: right for a covariance. A
    /// solution keeps them apart, since a start far away needs every one of them to tell front from rear.
    #[must_use]
    fn with_shared_keypoint_offsets(mut self) -> Self {
        self.keypoint_views.fill(0);
        self.views.iter().flat_map(|view| &view.keypoints).for_each(|seen| self.keypoint_views[seen.index] += 1);
        self
    }

    /// Rows of every view and of the ground at a state, with the vertices there.
    fn rows(&self, state: &ObjectState) -> (Rows, Vec<Vector3<f64>>) {
        let vertices = self.template.vertices(&state.z, &state.d);
        let mut rows = Rows::default();
        for view in self.views {
            rows.set_time(view.time_s);
            self.view_rows(view, state, &vertices, &mut rows);
        }
        rows.set_time(0.0);
        if let Some(ground) = &self.ground {
            ground_rows(
                &state.world_from_object,
                &vertices,
                &self.template.contacts,
                ground,
                Kernel::Squared,
                &mut rows,
            );
        }
        (rows, vertices)
    }

    fn view_rows(&self, view: &View, state: &ObjectState, vertices: &[Vector3<f64>], rows: &mut Rows) {
        let camera_from_object = view.world_from_camera.inverse().compose(&state.pose_at(view.time_s));
        view_rows(self.template, &self.model, view, &camera_from_object, vertices, &self.keypoint_views, rows);
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

    fn cost(&self, state: &ObjectState) -> f64 {
        self.rows(state).0.cost() + self.prior_cost(state)
    }

    fn linearize(&self, state: &ObjectState, hessian: &mut Envelope, gradient: &mut [f64]) -> f64 {
        let (rows, vertices) = self.rows(state);
        let mut borders = VertexNormal::new(vertices.len());
        for (row, terms) in rows.iter() {
            match terms {
                // rows of the border, nearly all: gathered over the two vertices first
                [first, second] if !self.scope.free_form && !self.scope.velocity => borders.add(row, first, second),
                _ => self.add_row(row, terms, state, &vertices, hessian, gradient),
            }
        }
        let modes = self.scope.modes.then_some(self.template);
        borders.gather(&vertices, modes, self.layout.free_form, hessian, gradient);
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
        rows.cost() + self.prior_cost(state)
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

/// Rows of one view's border and key points; `keypoint_views` says in how many views each key point shares its offset.
pub(crate) fn view_rows(
    template: &Template,
    model: &Model,
    view: &View,
    camera_from_object: &Pose,
    vertices: &[Vector3<f64>],
    keypoint_views: &[u32],
    rows: &mut Rows,
) {
    if !view.border.is_empty() {
        let samples = view_outline(view, camera_from_object, vertices, template, model.outline_step_px);
        border_rows(view, camera_from_object, &samples, &model.border, rows);
    }
    for observation in &view.keypoints {
        let association = &template.keypoints[observation.index];
        let views = keypoint_views[observation.index];
        let position = PositionNoise { sigma_m: model.keypoint_position_sigma_m, views };
        let kernel = model.keypoint_kernel;
        keypoint_rows(&view.camera, camera_from_object, vertices, association, observation, position, kernel, rows);
    }
}

/// Product of the leading part of a symmetric matrix with a vector.
fn multiply(matrix: &Envelope, x: &[f64], size: usize) -> Vec<f64> {
    let mut out = vec![0.0; size];
    for i in 0..size {
        let (first, row) = matrix.row(i);
        let mut sum = row[i - first] * x[i];
        for (j, entry) in (first..i).zip(row) {
            sum += entry * x[j];
            out[j] += entry * x[i];
        }
        out[i] += sum;
    }
    out
}

/// Precision of d: each vertex stays near 0, and near its neighbours' average (normalized cotangent Laplacian of the mean).
fn free_form_prior(template: &Template, layout: &Layout, model: &Model) -> Envelope {
    let mut out = Envelope::new(layout.first.clone());
    let symmetry = &template.symmetry;
    for (block, neighbours) in template.laplacian.iter().enumerate() {
        let area = template.relative_area[block];
        let alone = area / model.free_form_sigma_m.powi(2);
        let together = 1.0 / (area * model.smoothness_sigma_m.powi(2));
        for dof in symmetry.offset[block]..symmetry.offset[block + 1] {
            out.add(layout.position[dof], layout.position[dof], alone);
        }
        for axis in 0..3 {
            let vertex = symmetry.representative[block] as usize;
            let mut row: Vec<(usize, f64)> = Vec::new();
            let mut push = |v: usize, share: f64| {
                for (dof, _, sign) in symmetry.freedoms(v).filter(|&(_, a, _)| a == axis) {
                    let at = layout.position[dof];
                    match row.iter_mut().find(|(i, _)| *i == at) {
                        Some((_, sum)) => *sum += share * sign,
                        None => row.push((at, share * sign)),
                    }
                }
            };
            push(vertex, 1.0);
            neighbours.iter().for_each(|&(v, share)| push(v as usize, -share));
            for n in 0..row.len() {
                for m in 0..=n {
                    out.add(row[n].0, row[m].0, together * row[n].1 * row[m].1);
                }
            }
        }
    }
    out
}

/// Outline of the mesh in a view, with the mesh's own mask drawn where it or the observed mask may lie.
fn view_outline(
    view: &View,
    camera_from_object: &Pose,
    vertices: &[Vector3<f64>],
    template: &Template,
    step_px: f64,
) -> Vec<OutlineSample> {
    let points: Vec<Vector3<f64>> = vertices.iter().map(|v| camera_from_object.transform(v)).collect();
    let mut drawn = Silhouette::default();
    drawn.draw(&view.camera, &points, &template.topology);
    let mut samples = Vec::new();
    if drawn.by_contour {
        contour_samples(&points, &drawn, step_px, &mut samples);
    } else {
        let rect = drawn.rect;
        samples = outline(&view.camera, &points, &template.topology, &rect, drawn.mask(), step_px);
    }
    samples
}

/// The part of the image that a mesh may cover.
fn mesh_rect(view: &View, points_in_camera: &[Vector3<f64>]) -> Rect {
    let image = Rect::image(&view.camera);
    if points_in_camera.iter().any(|p| p.z < crate::raster::NEAR_M) {
        return image;
    }
    Rect::around(points_in_camera.iter().map(|p| view.camera.project(p))).intersection(&image)
}

/// IoU of the drawn mesh with the observed mask in a view; pixels that an occluder hides count only where the mask has them.
#[must_use]
pub fn mask_iou(view: &View, world_from_object: &Pose, vertices: &[Vector3<f64>], faces: &[[u32; 3]]) -> f64 {
    let camera_from_object = view.world_from_camera.inverse().compose(world_from_object);
    let points: Vec<Vector3<f64>> = vertices.iter().map(|v| camera_from_object.transform(v)).collect();
    let rect = mesh_rect(view, &points);
    let mut drawn = vec![0; rect.area()];
    fill_mask(&view.camera, &points, faces, &rect, &mut drawn);
    let (mut both, mut only_drawn) = (0usize, 0usize);
    for row in 0..rect.height {
        for column in 0..rect.width {
            if drawn[row * rect.width + column] == 0 {
                continue;
            }
            match view.crop.index(column as i64 + rect.x0, row as i64 + rect.y0) {
                Some(i) if view.distance_px[i] < 0.0 => both += 1,
                Some(i) if view.hidden[i] > 0 => {}
                _ => only_drawn += 1,
            }
        }
    }
    let observed = view.distance_px.iter().filter(|d| **d < 0.0).count();
    both as f64 / (observed + only_drawn).max(1) as f64
}

/// Signed distances between the observed border and the mesh's outline in a view, in the order of the border's points:
/// nᵀ(x − b), pixels; NaN where the border is not the object's own or nothing is near.
#[must_use]
pub fn border_distances(template: &Template, view: &View, state: &ObjectState, step_px: f64) -> Vec<f64> {
    let camera_from_object = view.world_from_camera.inverse().compose(&state.pose_at(view.time_s));
    let vertices = template.vertices(&state.z, &state.d);
    let samples = view_outline(view, &camera_from_object, &vertices, template, step_px);
    crate::residuals::border::backward_distances(view, &samples)
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
    check_length("mode coefficients", state.z.len(), template.mode_count)?;
    check_length("free-form displacement", state.d.len(), template.symmetry.dimension())?;
    let problem = ObjectProblem::new(template, views, ground, model, scope);
    let (state, report) = levenberg_marquardt(&problem, state, options);
    Ok(Estimate { state, report })
}

/// Uncertainty of an estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    /// Covariance of the pose whose origin is the centre of the mesh's bounding box: right perturbation, (translation, rotation).
    pub pose_covariance: Matrix6<f64>,
    /// Standard deviation of each vertex in the object's frame, root mean square over the axes, metres; empty unless asked for.
    pub vertex_sigma_m: Vec<f64>,
    /// Which vertices (or their mirror images) some view or key point fixes.
    pub vertex_observed: Vec<bool>,
}

/// A vertex is observed where the measurements alone fix it along some direction to this, metres.
const OBSERVED_SIGMA_M: f64 = 0.05;

/// Uncertainty from the inverse of the normal matrix at `state`.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] where nothing holds a parameter, [`Error::Length`] if the state does not fit.
pub fn uncertainty(
    template: &Template,
    views: &[&View],
    ground: Option<Ground>,
    model: Model,
    scope: Scope,
    state: &ObjectState,
    per_vertex: bool,
) -> Result<Uncertainty> {
    check_length("mode coefficients", state.z.len(), template.mode_count)?;
    check_length("free-form displacement", state.d.len(), template.symmetry.dimension())?;
    let problem = ObjectProblem::new(template, views, ground, model, scope).with_shared_keypoint_offsets();
    let mut factor = problem.structure();
    let mut gradient = vec![0.0; factor.size()];
    problem.linearize(state, &mut factor, &mut gradient);
    let vertex_observed = observed_vertices(&problem, state);
    factor.factorize()?;
    let vertices = template.vertices(&state.z, &state.d);
    let pose_covariance = centre_covariance(&problem, &factor, &vertices);
    let vertex_sigma_m = if per_vertex { vertex_sigmas(&problem, &factor) } else { Vec::new() };
    Ok(Uncertainty { pose_covariance, vertex_sigma_m, vertex_observed })
}

/// Rows (as columns of the transpose) of a vertex's derivative over the shape's parameters.
fn shape_derivative(problem: &ObjectProblem, vertex: usize) -> [Vec<(usize, f64)>; 3] {
    let mut out = [Vec::new(), Vec::new(), Vec::new()];
    if problem.scope.free_form {
        for (dof, axis, sign) in problem.template.symmetry.freedoms(vertex) {
            out[axis].push((problem.layout.position[dof], sign));
        }
    }
    if problem.scope.modes {
        let base = problem.layout.free_form + 6;
        for (k, mode) in problem.template.modes_of(vertex).iter().enumerate() {
            (0..3).for_each(|axis| out[axis].push((base + k, mode[axis])));
        }
    }
    out
}

/// L⁻¹ aᵀ of a sparse row a.
fn half_solve(factor: &Envelope, row: &[(usize, f64)]) -> Vec<f64> {
    let mut x = vec![0.0; factor.size()];
    row.iter().for_each(|&(i, value)| x[i] += value);
    let from = row.iter().map(|&(i, _)| i).min().unwrap_or(0);
    factor.forward(&mut x, from);
    x
}

/// Covariance of the pose at the mesh's centre c: its perturbation is (ρ + φ × c + ∂c, φ), and c moves with the shape.
fn centre_covariance(problem: &ObjectProblem, factor: &Envelope, vertices: &[Vector3<f64>]) -> Matrix6<f64> {
    let base = problem.layout.free_form;
    let (mut centre, mut rows) = (Vector3::zeros(), vec![Vec::new(); 6]);
    for axis in 0..3 {
        let by = |a: &usize, b: &usize| vertices[*a][axis].total_cmp(&vertices[*b][axis]);
        let (low, high) = ((0..vertices.len()).min_by(by).unwrap_or(0), (0..vertices.len()).max_by(by).unwrap_or(0));
        centre[axis] = 0.5 * (vertices[low][axis] + vertices[high][axis]);
        for end in [low, high] {
            rows[axis].extend(shape_derivative(problem, end)[axis].iter().map(|&(i, value)| (i, 0.5 * value)));
        }
    }
    for axis in 0..3 {
        rows[axis].push((base + axis, 1.0));
        rows[axis + 3].push((base + 3 + axis, 1.0));
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3); // (φ × c)_i = φ_j c_k − φ_k c_j
        rows[axis].push((base + 3 + j, centre[k]));
        rows[axis].push((base + 3 + k, -centre[j]));
    }
    let solved: Vec<Vec<f64>> = rows.iter().map(|row| half_solve(factor, row)).collect();
    Matrix6::from_fn(|i, j| solved[i].iter().zip(&solved[j]).map(|(a, b)| a * b).sum())
}

fn vertex_sigmas(problem: &ObjectProblem, factor: &Envelope) -> Vec<f64> {
    let symmetry = &problem.template.symmetry;
    let of_block: Vec<f64> = symmetry
        .representative
        .iter()
        .map(|&v| {
            let variance: f64 = shape_derivative(problem, v as usize)
                .iter()
                .map(|row| half_solve(factor, row).iter().map(|x| x * x).sum::<f64>())
                .sum();
            (variance / 3.0).sqrt()
        })
        .collect();
    symmetry.block_of.iter().map(|&b| of_block[b as usize]).collect()
}

fn observed_vertices(problem: &ObjectProblem, state: &ObjectState) -> Vec<bool> {
    let symmetry = &problem.template.symmetry;
    let vertices = problem.template.vertices(&state.z, &state.d);
    let mut rows = Rows::default();
    problem.views.iter().for_each(|view| problem.view_rows(view, state, &vertices, &mut rows));
    let mut information = vec![0.0; symmetry.representative.len()];
    for (row, terms) in rows.iter() {
        let weight = row.weight * row.kernel.weight(row.residual * row.residual);
        for term in terms {
            information[symmetry.block_of[term.vertex as usize] as usize] += weight * term.gradient.norm_squared();
        }
    }
    let enough = 1.0 / (OBSERVED_SIGMA_M * OBSERVED_SIGMA_M);
    symmetry.block_of.iter().map(|&b| information[b as usize] >= enough).collect()
}
