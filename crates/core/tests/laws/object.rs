use std::sync::Arc;

use meshslam_core::kernel::Kernel;
use meshslam_core::lie::Pose;
use meshslam_core::object::{
    Block, Model, ObjectProblem, ObjectState, Scope, block_covariance, mask_iou, refine, uncertainty,
};
use meshslam_core::residuals::border::BorderNoise;
use meshslam_core::residuals::ground::Ground;
use meshslam_core::solve::envelope::Envelope;
use meshslam_core::solve::levenberg_marquardt::{Options, Problem};
use meshslam_core::template::Template;
use meshslam_core::view::View;
use nalgebra::{DMatrix, DVector, Matrix6, Vector3};

use crate::common::{
    Random, camera, cuboid, differences, drawn, icosphere, ideal_view, looking, mirror, placed, signed, six,
};

/// A rounded body of 4 x 1.8 x 1.4 m with two symmetric modes, six key points and four wheels.
pub fn template() -> Template {
    let (sphere, faces) = icosphere(2);
    let mean: Vec<Vector3<f64>> = sphere.iter().map(|v| v.component_mul(&Vector3::new(2.0, 0.9, 0.7))).collect();
    let modes = mean.iter().flat_map(|v| [Vector3::new(0.08 * v.x, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.1 * v.z * v.z)]);
    let nearest = |target: [f64; 3]| {
        let target = Vector3::from(target);
        let distance = |i: &usize| (mean[*i] - target).norm();
        (0..mean.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap()
    };
    let corners =
        [[1.2, 0.6, 0.3], [1.2, -0.6, 0.3], [-1.2, 0.6, 0.3], [-1.2, -0.6, 0.3], [2.0, 0.0, 0.0], [0.0, 0.0, 0.7]];
    let association = |target| {
        let i = nearest(target) as u32;
        vec![(i, 0.7), (nearest([0.0, 0.9, 0.0]) as u32, 0.3)]
    };
    let keypoints = corners.map(association).to_vec();
    let wheels =
        [[1.2, 0.5, -0.5], [1.2, -0.5, -0.5], [-1.2, 0.5, -0.5], [-1.2, -0.5, -0.5]].map(|t| nearest(t) as i64);
    let image = mirror(&mean);
    Template::new(mean.clone(), &signed(&faces), modes.collect(), Some(&image), keypoints, &wheels).unwrap()
}

pub fn model() -> Model {
    Model {
        border: BorderNoise { sigma_px: 1.5, correlation_px: 20.0, kernel: Kernel::Huber(3.0), cap_px: 60.0 },
        outline_step_px: 1.0,
        keypoint_position_sigma_m: 0.0,
        keypoint_kernel: Kernel::GemanMcClure(3.0),
        free_form_sigma_m: 0.1,
        smoothness_sigma_m: 0.02,
    }
}

fn truth() -> Pose {
    Pose { translation: Vector3::new(0.3, -0.2, 0.7), ..Pose::identity() }
        .retract(&six(&[0.0, 0.0, 0.0, 0.02, -0.01, 0.4]))
}

fn keypoints(template: &Template, vertices: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let point = |a: &Vec<(u32, f64)>| a.iter().map(|&(v, w)| vertices[v as usize] * w).sum();
    template.keypoints.iter().map(point).collect()
}

/// Ideal views of a state from cameras in a ring.
pub fn views(template: &Template, state: &ObjectState, count: usize) -> Vec<View> {
    let vertices = template.vertices(&state.z, &state.d);
    let points = placed(&state.world_from_object, &vertices);
    let seen = placed(&state.world_from_object, &keypoints(template, &vertices));
    (0..count)
        .map(|k| {
            let angle = 0.5 + 0.9 * k as f64;
            let from = Vector3::new(7.0 * angle.cos(), 7.0 * angle.sin(), 1.5);
            ideal_view(&camera(), looking(from, Vector3::new(0.2, 0.1, 0.5)), &points, &seen)
        })
        .collect()
}

pub fn start(template: &Template) -> ObjectState {
    let d = vec![0.0; template.symmetry.dimension()];
    ObjectState { world_from_object: truth(), z: vec![0.0; template.mode_count], d, velocity: Vector3::zeros() }
}

pub fn ground() -> Option<Ground> {
    Some(Ground { normal: Vector3::z(), offset_m: 0.15, height_sigma_m: 0.05, tilt_sigma_rad: 0.03 })
}

pub fn without_borders(views: &[View]) -> Vec<View> {
    views.iter().map(|v| View { border: Vec::new(), ..v.clone() }.checked(6).unwrap()).collect()
}

pub fn without_keypoints(views: &[View]) -> Vec<View> {
    views.iter().map(|v| View { keypoints: Vec::new(), ..v.clone() }).collect()
}

/// A state some way from the truth in every block.
pub fn disturbed(template: &Template, random: &mut Random, size: f64) -> ObjectState {
    let mut state = start(template);
    let step: [f64; 6] = std::array::from_fn(|_| random.uniform(-0.1, 0.1) * size);
    state.world_from_object = state.world_from_object.retract(&six(&step));
    state.z.iter_mut().for_each(|c| *c = random.uniform(-1.0, 1.0) * size);
    state.d.iter_mut().for_each(|c| *c = random.uniform(-0.03, 0.03) * size);
    state.velocity = random.vector(0.5) * size;
    state
}

pub const SCOPES: [Scope; 5] = [
    Scope { modes: false, free_form: false, velocity: false },
    Scope { modes: true, free_form: false, velocity: false },
    Scope { modes: false, free_form: true, velocity: false },
    Scope { modes: true, free_form: true, velocity: false },
    Scope { modes: true, free_form: true, velocity: true },
];

fn gradient_of(problem: &mut ObjectProblem, state: &ObjectState) -> (Envelope, Vec<f64>, f64) {
    let mut hessian = problem.structure();
    let mut gradient = vec![0.0; hessian.size()];
    let cost = problem.linearize(state, &mut hessian, &mut gradient);
    (hessian, gradient, cost)
}

fn slope(problem: &mut ObjectProblem, state: &ObjectState, direction: &[f64], h: f64) -> f64 {
    let mut at = |s: f64| problem.cost(&problem.retract(state, &direction.iter().map(|x| x * s).collect::<Vec<_>>()));
    (at(h) - at(-h)) / (2.0 * h)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[test]
fn the_gradient_of_key_points_ground_and_priors_is_that_of_the_true_cost() {
    let (template, mut random) = (template(), Random(1));
    let mut views = without_borders(&views(&template, &start(&template), 3));
    views.iter_mut().enumerate().for_each(|(k, v)| v.time_s = 0.3 * k as f64 - 0.2);
    let seen: Vec<&View> = views.iter().collect();
    for scope in SCOPES {
        let state = disturbed(&template, &mut random, 1.0);
        let mut problem = ObjectProblem::new(&template, &seen, ground(), model(), scope);
        let (_, gradient, cost) = gradient_of(&mut problem, &state);
        assert!((cost - problem.cost(&state)).abs() < 1e-9 * cost);
        for k in 0..gradient.len() {
            let mut unit = vec![0.0; gradient.len()];
            unit[k] = 1.0;
            let expected = slope(&mut problem, &state, &unit, 1e-5);
            assert!(
                (gradient[k] - expected).abs() < 1e-4 * (1.0 + expected.abs()),
                "{scope:?} {k}: {} {expected}",
                gradient[k]
            );
        }
    }
}

#[test]
fn the_hessian_of_priors_and_ground_is_that_of_the_true_cost() {
    // without views, and with the pose held, the cost is quadratic in z and d
    let (template, mut random) = (template(), Random(2));
    let scope = SCOPES[3];
    let mut problem = ObjectProblem::new(&template, &[], ground(), model(), scope);
    let state = disturbed(&template, &mut random, 1.0);
    let (hessian, gradient, cost) = gradient_of(&mut problem, &state);
    let (size, free_form) = (hessian.size(), template.symmetry.dimension());
    for _ in 0..20 {
        let mut step: Vec<f64> = (0..size).map(|_| random.uniform(-0.05, 0.05)).collect();
        step[free_form..free_form + 6].fill(0.0);
        let quadratic: f64 =
            (0..size).map(|i| (0..size).map(|j| step[i] * hessian.get(i, j) * step[j]).sum::<f64>()).sum();
        let expected = cost + dot(&gradient, &step) + 0.5 * quadratic;
        let found = problem.cost(&problem.retract(&state, &step));
        assert!((found - expected).abs() < 1e-9 * found, "{found} {expected}");
    }
}

/// A box with two symmetric modes: its outline stays on the same edges while it moves a little.
fn box_template() -> Template {
    let (mean, faces) = cuboid(Vector3::new(-2.0, -0.9, -0.7), Vector3::new(2.0, 0.9, 0.7));
    let modes = mean.iter().flat_map(|v| [Vector3::new(0.08 * v.x, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.1 * v.z)]);
    let image = mirror(&mean);
    Template::new(mean.clone(), &signed(&faces), modes.collect(), Some(&image), vec![vec![(0, 1.0)]; 6], &[]).unwrap()
}

#[test]
fn the_gradient_of_the_border_points_along_that_of_the_true_cost() {
    let (template, mut random) = (box_template(), Random(3));
    let mut views = without_keypoints(&views(&template, &start(&template), 4));
    views.iter_mut().enumerate().for_each(|(k, v)| v.time_s = 0.3 * k as f64 - 0.2);
    let seen: Vec<&View> = views.iter().collect();
    for scope in [SCOPES[1], SCOPES[3], SCOPES[4]] {
        let mut problem = ObjectProblem::new(&template, &seen, None, model(), scope);
        for _ in 0..6 {
            let state = disturbed(&template, &mut random, 0.7);
            let (hessian, gradient, _) = gradient_of(&mut problem, &state);
            let numeric: Vec<f64> = (0..gradient.len())
                .map(|k| {
                    let mut unit = vec![0.0; gradient.len()];
                    unit[k] = 1.0;
                    slope(&mut problem, &state, &unit, 3e-3)
                })
                .collect();
            // each parameter in its own units of the curvature
            let scale =
                |g: &[f64]| -> Vec<f64> { g.iter().enumerate().map(|(k, x)| x / hessian.get(k, k).sqrt()).collect() };
            let (a, b) = (scale(&gradient), scale(&numeric));
            let cosine = dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt();
            assert!(cosine > 0.98, "{cosine}\n{a:?}\n{b:?}");
            let ratio = (dot(&a, &a) / dot(&b, &b)).sqrt();
            assert!((0.9..1.1).contains(&ratio), "{ratio}");
        }
    }
}

#[test]
fn a_step_of_free_form_lowers_the_cost_of_the_border_as_the_gradient_says() {
    let (template, mut random) = (template(), Random(4));
    let views = without_keypoints(&views(&template, &disturbed(&template, &mut random, 0.5), 4));
    let seen: Vec<&View> = views.iter().collect();
    let mut problem = ObjectProblem::new(&template, &seen, None, model(), SCOPES[3]);
    let state = disturbed(&template, &mut random, 0.5);
    let (_, gradient, _) = gradient_of(&mut problem, &state);
    let norm = dot(&gradient, &gradient).sqrt();
    let direction: Vec<f64> = gradient.iter().map(|g| g / norm).collect();
    let found = slope(&mut problem, &state, &direction, 3e-3);
    assert!((found / norm - 1.0).abs() < 0.1, "{found} {norm}");
}

fn pose_error(a: &Pose, b: &Pose) -> (f64, f64) {
    let difference = a.inverse().compose(b).log();
    (difference.fixed_rows::<3>(0).norm(), difference.fixed_rows::<3>(3).norm())
}

#[test]
fn refine_finds_the_pose_of_an_object_seen_without_noise() {
    let (template, mut random) = (template(), Random(5));
    let truth = start(&template);
    let all = views(&template, &truth, 5);
    for (views, shift) in [(all.clone(), 1.5), (without_borders(&all), 1.5), (without_keypoints(&all), 1.0)] {
        let seen: Vec<&View> = views.iter().collect();
        let mut state = truth.clone();
        let step: [f64; 6] = std::array::from_fn(|_| random.uniform(-0.1, 0.1) * shift);
        state.world_from_object = state.world_from_object.retract(&six(&step));
        let options =
            Options { max_iterations: 60, relative_decrease: 1e-9, absolute_decrease: 1e-12, ..Options::default() };
        let found = refine(&template, &seen, None, model(), SCOPES[0], state, &options).unwrap();
        let (metres, radians) = pose_error(&truth.world_from_object, &found.state.world_from_object);
        assert!(metres < 2e-3 && radians < 2e-3, "{metres} m {radians} rad");
        assert!(found.report.iterations.iter().all(|i| i.new_cost <= i.cost));
    }
}

#[test]
fn refine_finds_the_modes_of_an_object_seen_without_noise() {
    let template = template();
    let mut truth = start(&template);
    truth.z = vec![0.8, -0.6];
    let views = views(&template, &truth, 6);
    let seen: Vec<&View> = views.iter().collect();
    let begin = start(&template);
    let sharp = Model { border: BorderNoise { sigma_px: 0.5, correlation_px: 1.0, ..model().border }, ..model() };
    let found = refine(&template, &seen, None, sharp, SCOPES[1], begin, &Options::default()).unwrap();
    // the prior z ~ N(0, I) pulls a little to the mean
    for (a, b) in found.state.z.iter().zip(&truth.z) {
        assert!((a - b).abs() < 0.03, "{:?}", found.state.z);
    }
    assert_eq!(found.state.d, vec![0.0; template.symmetry.dimension()], "a block out of scope does not move");
}

#[test]
fn refine_finds_the_velocity_of_an_object_that_drives() {
    let template = template();
    let mut truth = start(&template);
    truth.velocity = truth.world_from_object.rotation * Vector3::new(3.0, 0.0, 0.0);
    let moving: Vec<View> = (0..5)
        .map(|k| {
            let time_s = 0.1 * f64::from(k) - 0.2;
            let then = ObjectState { world_from_object: truth.pose_at(time_s), ..truth.clone() };
            View { time_s, ..views(&template, &then, 5).swap_remove(k as usize) }
        })
        .collect();
    let seen: Vec<&View> = moving.iter().collect();
    let scope = Scope { velocity: true, ..SCOPES[0] };
    let found = refine(&template, &seen, None, model(), scope, start(&template), &Options::default()).unwrap().state;
    assert!((found.velocity - truth.velocity).norm() < 0.05, "{}", found.velocity);
    assert!(pose_error(&truth.world_from_object, &found.world_from_object).0 < 5e-3);
    let mut later = truth.clone();
    later.world_from_object = truth.pose_at(0.7);
    assert!((later.world_from_object.translation - truth.world_from_object.translation).norm() - 2.1 < 1e-12);
}

#[test]
fn the_cost_of_shapes_knows_no_world() {
    // moving cameras, object and ground together changes nothing
    let (template, mut random) = (template(), Random(6));
    let state = disturbed(&template, &mut random, 0.7);
    let mut views = views(&template, &start(&template), 2);
    let move_all = Pose { rotation: random.rotation(), translation: random.vector(20.0) };
    views.iter_mut().enumerate().for_each(|(k, v)| v.time_s = 0.1 * k as f64);
    let turned: Vec<View> =
        views.iter().map(|v| View { world_from_camera: move_all.compose(&v.world_from_camera), ..v.clone() }).collect();
    let mut elsewhere = state.clone();
    elsewhere.velocity = move_all.rotation * state.velocity;
    elsewhere.world_from_object = move_all.compose(&state.world_from_object);
    let flat = ground().unwrap();
    let normal = move_all.rotation * flat.normal;
    let tilted = Ground { normal, offset_m: flat.offset_m + normal.dot(&move_all.translation), ..flat };
    let cost = |views: &[View], ground: Ground, state: &ObjectState| {
        let seen: Vec<&View> = views.iter().collect();
        ObjectProblem::new(&template, &seen, Some(ground), model(), SCOPES[4]).cost(state)
    };
    let (here, there) = (cost(&views, flat, &state), cost(&turned, tilted, &elsewhere));
    assert!((here - there).abs() < 1e-6 * here, "{here} {there}");
}

#[test]
fn the_covariance_of_the_pose_is_the_inverse_of_the_normal_matrix_moved_to_the_centre() {
    let (template, mut random) = (template(), Random(8));
    let views = views(&template, &start(&template), 3);
    let seen: Vec<&View> = views.iter().collect();
    let state = disturbed(&template, &mut random, 0.3);
    for scope in SCOPES {
        let found = uncertainty(&template, &seen, ground(), model(), scope, &state, true).unwrap();
        let mut problem = ObjectProblem::new(&template, &seen, ground(), model(), scope);
        let (hessian, _, _) = gradient_of(&mut problem, &state);
        let size = hessian.size();
        let dense = DMatrix::from_fn(size, size, |i, j| hessian.get(i, j)).try_inverse().unwrap();
        let jacobian = centre_jacobian(&problem, &template, &state, size);
        let expected = &jacobian * dense * jacobian.transpose();
        let error = Matrix6::from_fn(|i, j| expected[(i, j)]) - found.pose_covariance;
        assert!(error.amax() < 1e-4 * found.pose_covariance.amax(), "{scope:?}\n{}\n{expected}", found.pose_covariance);
        assert_eq!(found.vertex_sigma_m.len(), template.mean.len());
        let shape_moves = scope.modes || scope.free_form;
        assert!(
            found
                .vertex_sigma_m
                .iter()
                .all(|s| s.is_finite() && (*s > 0.0 || !scope.free_form) && (shape_moves || *s == 0.0))
        );
    }
}

/// Numeric derivative of the pose at the bounding box's centre over the parameters.
fn centre_jacobian(problem: &ObjectProblem, template: &Template, state: &ObjectState, size: usize) -> DMatrix<f64> {
    let centred = |s: &ObjectState| {
        let vertices = template.vertices(&s.z, &s.d);
        let (low, high) = vertices.iter().fold((vertices[0], vertices[0]), |(l, h), v| (l.inf(v), h.sup(v)));
        s.world_from_object.compose(&Pose { translation: (low + high) / 2.0, ..Pose::identity() })
    };
    let here = centred(state);
    let mut out = DMatrix::zeros(6, size);
    for k in 0..size {
        let mut step = vec![0.0; size];
        step[k] = 1e-6;
        let there = centred(&problem.retract(state, &step));
        let log = here.inverse().compose(&there).log() / 1e-6;
        out.set_column(k, &DVector::from_column_slice(log.as_slice()));
    }
    out
}

#[test]
fn the_covariance_of_blocks_is_that_of_what_they_move() {
    let (template, mut random) = (template(), Random(11));
    let views = views(&template, &start(&template), 3);
    let seen: Vec<&View> = views.iter().collect();
    let state = disturbed(&template, &mut random, 0.3);
    let blocks = [Block::Velocity, Block::FreeForm, Block::Pose, Block::Modes];
    for scope in SCOPES {
        let mut problem = ObjectProblem::new(&template, &seen, ground(), model(), scope);
        let (hessian, _, _) = gradient_of(&mut problem, &state);
        let size = hessian.size();
        let inverse = DMatrix::from_fn(size, size, |i, j| hessian.get(i, j)).try_inverse().unwrap();
        // what each parameter moves says which block it belongs to, and its place there
        let moved: Vec<Vec<f64>> = (0..size)
            .map(|k| {
                let mut step = vec![0.0; size];
                step[k] = 1e-6;
                let next = problem.retract(&state, &step);
                let pose = state.world_from_object.inverse().compose(&next.world_from_object).log();
                let differences = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
                let mut out = differences(next.velocity.as_slice(), state.velocity.as_slice());
                out.extend(differences(&next.d, &state.d));
                out.extend(pose.iter());
                out.extend(differences(&next.z, &state.z));
                out.iter().map(|x| x / 1e-6).collect()
            })
            .collect();
        let jacobian = DMatrix::from_fn(moved[0].len(), size, |i, k| moved[k][i]);
        let whole = &jacobian * inverse * jacobian.transpose();
        let free: Vec<usize> = (0..whole.nrows()).filter(|&i| jacobian.row(i).amax() > 0.5).collect();
        let expected = DMatrix::from_fn(free.len(), free.len(), |i, j| whole[(free[i], free[j])]);
        let found = block_covariance(&template, &seen, ground(), model(), scope, &state, &blocks).unwrap();
        assert_eq!(found.shape(), expected.shape());
        assert!((&found - &expected).amax() < 1e-4 * expected.amax(), "{scope:?}");
    }
}

#[test]
fn vertex_sigmas_are_those_of_the_inverse() {
    let (template, mut random) = (template(), Random(9));
    let views = views(&template, &start(&template), 2);
    let seen: Vec<&View> = views.iter().collect();
    let state = disturbed(&template, &mut random, 0.3);
    let found = uncertainty(&template, &seen, ground(), model(), SCOPES[3], &state, true).unwrap();
    let mut problem = ObjectProblem::new(&template, &seen, ground(), model(), SCOPES[3]);
    let (hessian, _, _) = gradient_of(&mut problem, &state);
    let size = hessian.size();
    let inverse = DMatrix::from_fn(size, size, |i, j| hessian.get(i, j)).try_inverse().unwrap();
    for vertex in [0, 5, 40, 100, 161] {
        let mut jacobian = DMatrix::zeros(3, size);
        for k in 0..size {
            let mut step = vec![0.0; size];
            step[k] = 1.0;
            let next = problem.retract(&state, &step);
            let moved = template.vertices(&next.z, &next.d)[vertex] - template.vertices(&state.z, &state.d)[vertex];
            jacobian.set_column(k, &moved);
        }
        let expected = ((&jacobian * &inverse * jacobian.transpose()).trace() / 3.0).sqrt();
        assert!((found.vertex_sigma_m[vertex] / expected - 1.0).abs() < 1e-6);
    }
}

#[test]
fn what_no_view_shows_keeps_its_prior_and_is_not_observed() {
    let template = template();
    let views = views(&template, &start(&template), 1);
    let seen: Vec<&View> = views.iter().collect();
    let state = start(&template);
    let blind = uncertainty(&template, &[], ground(), model(), SCOPES[2], &state, true);
    assert!(blind.is_err(), "nothing holds the pose");
    let found = uncertainty(&template, &seen, ground(), model(), SCOPES[2], &state, true).unwrap();
    assert!(found.vertex_observed.iter().any(|o| *o) && !found.vertex_observed.iter().all(|o| *o));
    let mean = |observed: bool| {
        let of: Vec<f64> = (0..template.mean.len())
            .filter(|&v| found.vertex_observed[v] == observed)
            .map(|v| found.vertex_sigma_m[v])
            .collect();
        of.iter().sum::<f64>() / of.len() as f64
    };
    assert!(mean(true) < mean(false));
}

#[test]
fn mask_iou_is_that_of_the_drawn_masks() {
    let (template, mut random) = (template(), Random(10));
    let truth = start(&template);
    let mut views = views(&template, &truth, 3);
    for (k, view) in views.iter_mut().enumerate() {
        if k == 1 {
            Arc::make_mut(&mut view.hidden).iter_mut().enumerate().for_each(|(i, h)| *h = u8::from(i % 3 == 0)); // stripes
        }
    }
    for view in &views {
        for _ in 0..5 {
            let state = disturbed(&template, &mut random, 1.0);
            let vertices = template.vertices(&state.z, &state.d);
            let pose = view.world_from_camera.inverse().compose(&state.world_from_object);
            let mask = drawn(&camera(), &placed(&pose, &vertices), &template.topology.faces);
            let (mut both, mut either) = (0, 0);
            for (i, &m) in mask.iter().enumerate() {
                let (x, y) = ((i % 160) as i64, (i / 160) as i64);
                let observed = view.crop.index(x, y).is_some_and(|i| view.distance_px[i] < 0.0);
                let crop = &view.crop;
                let nearest = crop.index(
                    x.clamp(crop.x0, crop.x0 + crop.width as i64 - 1),
                    y.clamp(crop.y0, crop.y0 + crop.height as i64 - 1),
                );
                let drawn = m > 0 && (observed || view.hidden[nearest.unwrap()] == 0);
                both += i32::from(drawn && observed);
                either += i32::from(drawn || observed);
            }
            let found = mask_iou(view, &state.world_from_object, &vertices, &template.topology);
            assert!((found - f64::from(both) / f64::from(either)).abs() < 1e-12);
        }
    }
}

#[test]
fn states_that_do_not_fit_are_refused() {
    let template = template();
    for (z, d) in [(3, template.symmetry.dimension()), (2, 5), (0, 0)] {
        let state =
            ObjectState { world_from_object: truth(), z: vec![0.0; z], d: vec![0.0; d], velocity: Vector3::zeros() };
        assert!(uncertainty(&template, &[], None, model(), SCOPES[3], &state, false).is_err());
        assert!(refine(&template, &[], None, model(), SCOPES[3], state, &Options::default()).is_err());
    }
}

/// Inverse covariance of the pose from key points alone, each with one offset of the category that all its views share:
/// the stacked pixels of n views have the covariance σ² I + τ² 1 1ᵀ, written out and inverted.
fn information_of_shared_offsets(template: &Template, state: &ObjectState, views: &[View], tau_m: f64) -> Matrix6<f64> {
    let vertices = template.vertices(&state.z, &state.d);
    let pixel = |view: &View, k: usize, step: &[f64; 6]| {
        let pose = state.world_from_object.retract(&six(step));
        let point = pose.transform(&keypoints(template, &vertices)[k]);
        view.camera.project(&view.world_from_camera.inverse().transform(&point))
    };
    let mut information = Matrix6::zeros();
    for k in 0..template.keypoints.len() {
        let depth = |view: &View| {
            let point = state.world_from_object.transform(&keypoints(template, &vertices)[k]);
            view.world_from_camera.inverse().transform(&point).z
        };
        let tau_px = tau_m * views[0].camera.fx / depth(&views[0]);
        let variance = views[0].keypoints[k].sigma_px.powi(2);
        let all =
            DMatrix::from_fn(views.len(), views.len(), |i, j| tau_px.powi(2) + if i == j { variance } else { 0.0 });
        let weight = all.try_inverse().unwrap();
        for axis in 0..2 {
            let rows: Vec<[f64; 6]> =
                views.iter().map(|view| differences(|step| pixel(view, k, step)[axis], 1e-6)).collect();
            let jacobian = DMatrix::from_fn(views.len(), 6, |i, j| rows[i][j]);
            let product = jacobian.transpose() * &weight * &jacobian;
            information += Matrix6::from_fn(|i, j| product[(i, j)]);
        }
    }
    information
}

#[test]
fn views_share_the_offset_of_a_key_point_in_the_covariance() {
    let template = template();
    let state = start(&template);
    let tau_m = 0.1;
    let noisy = Model { keypoint_position_sigma_m: tau_m, ..model() };
    let one = without_borders(&views(&template, &state, 1)).remove(0);
    let found = |count: usize| {
        let seen = vec![&one; count];
        block_covariance(&template, &seen, None, noisy, SCOPES[0], &state, &[Block::Pose]).unwrap()
    };
    for count in [1, 2, 7, 100] {
        let views = vec![one.clone(); count];
        let expected = information_of_shared_offsets(&template, &state, &views, tau_m).try_inverse().unwrap();
        let error = Matrix6::from_fn(|i, j| found(count)[(i, j)]) - expected;
        assert!(error.amax() < 1e-5 * expected.amax(), "{count} views\n{}\n{expected}", found(count));
        let seen = vec![&one; count];
        let centred = uncertainty(&template, &seen, None, noisy, SCOPES[0], &state, false).unwrap().pose_covariance;
        let turn = centred.fixed_view::<3, 3>(3, 3) - expected.fixed_view::<3, 3>(3, 3); // the same at each point
        assert!(turn.amax() < 1e-5 * expected.amax(), "{count} views");
    }
    // what the views share, no number of them takes away
    assert!(found(100)[(0, 0)] > 0.5 * found(1)[(0, 0)], "{} {}", found(100), found(1));
}
