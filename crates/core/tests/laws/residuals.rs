use std::sync::Arc;

use meshslam_core::kernel::Kernel;
use meshslam_core::lie::Pose;
use meshslam_core::mesh::Topology;
use meshslam_core::outline::{OutlineSample, outline};
use meshslam_core::raster::Rect;
use meshslam_core::residuals::border::{BorderMatch, BorderNoise};
use meshslam_core::residuals::ground::{Ground, contacts, ground_rows};
use meshslam_core::residuals::keypoints::{PositionNoise, keypoint_rows};
use meshslam_core::residuals::{Rows, camera_derivative, object_derivative};
use meshslam_core::view::{BorderPoint, KeypointObservation, View};
use nalgebra::{Vector2, Vector3, Vector6};

use crate::common::{Random, camera, cuboid, differences, drawn, ideal_view, looking, placed, signed, six};

/// A scene: an object before a camera.
struct Scene {
    world_from_camera: Pose,
    world_from_object: Pose,
    vertices: Vec<Vector3<f64>>,
}

impl Scene {
    fn new(random: &mut Random) -> Self {
        let from = Vector3::new(random.uniform(4.0, 6.0), random.uniform(-3.0, 3.0), random.uniform(0.5, 2.0));
        Self {
            world_from_camera: looking(from, random.vector(0.3)),
            world_from_object: Pose { rotation: random.rotation(), translation: random.vector(0.3) },
            vertices: (0..6).map(|_| random.vector(0.8)).collect(),
        }
    }

    fn camera_from_object(&self) -> Pose {
        self.world_from_camera.inverse().compose(&self.world_from_object)
    }
}

/// Compare each row's derivatives over object, camera and vertices with central differences of `rows`.
fn check_rows(scene: &Scene, rows: impl Fn(&Scene) -> Rows, seen_by_camera: bool) {
    let tolerance = 1e-5;
    let found = rows(scene);
    assert!(!found.is_empty());
    for (k, (_, terms)) in found.iter().enumerate() {
        let residual = |s: &Scene| rows(s).iter().nth(k).unwrap().0.residual;
        let moved = |change: &dyn Fn(&mut Scene)| {
            let mut copy = Scene { vertices: scene.vertices.clone(), ..*scene };
            change(&mut copy);
            residual(&copy)
        };
        let by_object =
            differences(|xi: &[f64; 6]| moved(&|s| s.world_from_object = s.world_from_object.retract(&six(xi))), 1e-5);
        let by_camera =
            differences(|xi: &[f64; 6]| moved(&|s| s.world_from_camera = s.world_from_camera.retract(&six(xi))), 1e-5);
        let scale = 1.0 + six(&by_object).amax();
        let object = object_derivative(terms, &scene.vertices);
        assert!((six(&by_object) - object).amax() < tolerance * scale, "object {:?} {object}", by_object);
        let camera = camera_derivative(terms, &scene.vertices, &scene.camera_from_object());
        let expected = if seen_by_camera { camera } else { Vector6::zeros() };
        assert!((six(&by_camera) - expected).amax() < tolerance * scale, "camera {by_camera:?} {expected}");
        for v in 0..scene.vertices.len() {
            let by_vertex = differences(|x: &[f64; 3]| moved(&|s| s.vertices[v] += Vector3::from(*x)), 1e-5);
            let sum: Vector3<f64> = terms.iter().filter(|t| t.vertex as usize == v).map(|t| t.gradient).sum();
            assert!((Vector3::from(by_vertex) - sum).amax() < tolerance * scale, "vertex {v}");
        }
    }
}

/// The category's key points are the instance's.
const SURE: PositionNoise = PositionNoise { sigma_m: 0.0, views: 1 };

#[test]
fn keypoint_derivatives_are_right() {
    let mut random = Random(1);
    for _ in 0..20 {
        let scene = Scene::new(&mut random);
        let observation = KeypointObservation { index: 0, pixel: Vector2::new(70.0, 50.0), sigma_px: 1.7 };
        let association = [(1, 0.3), (4, 0.5), (5, 0.2)];
        check_rows(
            &scene,
            |s| {
                let mut rows = Rows::default();
                let pose = s.camera_from_object();
                let kernel = Kernel::Squared;
                keypoint_rows(&camera(), &pose, &s.vertices, &association, &observation, SURE, kernel, &mut rows);
                rows
            },
            true,
        );
    }
}

#[test]
fn keypoint_residuals_are_pixels_over_sigma_and_the_positions_sigma_adds_up() {
    let mut random = Random(2);
    let scene = Scene::new(&mut random);
    let pose = scene.camera_from_object();
    let at = pose.transform(&scene.vertices[2]);
    let observation = KeypointObservation { index: 0, pixel: Vector2::new(70.0, 50.0), sigma_px: 2.0 };
    for position_sigma_m in [0.0, 0.1] {
        let mut rows = Rows::default();
        let (vertices, association) = (&scene.vertices, [(2, 1.0)]);
        keypoint_rows(
            &camera(),
            &pose,
            vertices,
            &association,
            &observation,
            PositionNoise { sigma_m: position_sigma_m, views: 1 },
            Kernel::Squared,
            &mut rows,
        );
        let sigma = (4.0 + (position_sigma_m * camera().fx / at.z).powi(2)).sqrt();
        let expected = (camera().project(&at) - observation.pixel) / sigma;
        for (axis, (row, _)) in rows.iter().enumerate() {
            assert!((row.residual - expected[axis]).abs() < 1e-9);
        }
        assert!((rows.cost() - 0.5 * expected.norm_squared()).abs() < 1e-9);
    }
}

#[test]
fn a_keypoint_behind_the_camera_adds_nothing() {
    let mut rows = Rows::default();
    let observation = KeypointObservation { index: 0, pixel: Vector2::zeros(), sigma_px: 1.0 };
    let behind = [Vector3::new(0.0, 0.0, -2.0)];
    let pose = Pose::identity();
    keypoint_rows(&camera(), &pose, &behind, &[(0, 1.0)], &observation, SURE, Kernel::Squared, &mut rows);
    assert!(rows.is_empty());
}

#[test]
fn views_that_share_an_offset_tell_together_what_one_mean_of_them_would() {
    let mut random = Random(4);
    let scene = Scene::new(&mut random);
    let (pose, at) = (scene.camera_from_object(), [(0, 1.0)]);
    let observation = KeypointObservation { index: 0, pixel: Vector2::new(30.0, 20.0), sigma_px: 2.0 };
    let cost = |position: PositionNoise| {
        let mut rows = Rows::default();
        keypoint_rows(&camera(), &pose, &scene.vertices, &at, &observation, position, Kernel::Squared, &mut rows);
        rows.cost()
    };
    let (views, sigma_m) = (9, 0.1);
    let alone = PositionNoise { sigma_m: sigma_m * 3.0, views: 1 };
    let ratio = cost(PositionNoise { sigma_m, views }) / cost(alone);
    assert!((ratio - 1.0).abs() < 1e-12, "{ratio}");
}

#[test]
fn ground_derivatives_are_right() {
    let mut random = Random(3);
    for _ in 0..20 {
        let scene = Scene::new(&mut random);
        let ground = Ground {
            normal: (Vector3::z() + random.vector(0.2)).normalize(),
            offset_m: -0.3,
            height_sigma_m: 0.05,
            tilt_sigma_rad: 0.03,
        };
        let stands = contacts(&scene.vertices, &[0, 1, 2, 3]);
        check_rows(
            &scene,
            |s| {
                let mut rows = Rows::default();
                ground_rows(&s.world_from_object, &s.vertices, &stands, &ground, Kernel::Squared, &mut rows);
                rows
            },
            false,
        )
    }
}

#[test]
fn wheels_that_stand_on_the_ground_cost_nothing_and_lift_pitch_and_roll_are_told_apart() {
    let wheels: Vec<Vector3<f64>> =
        [[1.4, 0.8, -0.7], [1.4, -0.8, -0.7], [-1.3, 0.8, -0.7], [-1.3, -0.8, -0.7]].map(Vector3::from).into();
    let stands = contacts(&wheels, &[0, 1, 2, 3]);
    assert_eq!(stands.len(), 3);
    assert_eq!(stands[0].lever_m, 0.0);
    assert!((stands[1].lever_m - 2.7).abs() < 1e-12 && (stands[2].lever_m - 1.6).abs() < 1e-12);
    let ground = Ground { normal: Vector3::z(), offset_m: 0.2, height_sigma_m: 0.1, tilt_sigma_rad: 0.02 };
    let residuals = |pose: &Pose| -> Vec<f64> {
        let mut rows = Rows::default();
        ground_rows(pose, &wheels, &stands, &ground, Kernel::Squared, &mut rows);
        rows.iter().map(|(row, _)| row.residual).collect()
    };
    let level = Pose { translation: Vector3::new(5.0, 3.0, 0.9), ..Pose::identity() };
    assert!(residuals(&level).iter().all(|r| r.abs() < 1e-9));
    let lifted = Pose { translation: Vector3::new(5.0, 3.0, 1.0), ..level };
    assert!((residuals(&lifted)[0] - 1.0).abs() < 1e-9, "a sigma of height is a residual of one");
    let pitched = level.retract(&six(&[0.0, 0.0, 0.0, 0.0, 0.02, 0.0]));
    assert!((residuals(&pitched)[1].abs() - 1.0).abs() < 0.01 && residuals(&pitched)[2].abs() < 1e-9);
    let rolled = level.retract(&six(&[0.0, 0.0, 0.0, 0.02, 0.0, 0.0]));
    assert!((residuals(&rolled)[2].abs() - 1.0).abs() < 0.01 && residuals(&rolled)[1].abs() < 1e-9);
}

#[test]
fn contacts_of_few_wheels_are_fewer() {
    let one = vec![Vector3::new(1.0, 0.5, 0.0); 3];
    assert!(contacts(&one, &[]).is_empty());
    assert_eq!(contacts(&one, &[0]).len(), 1);
    assert_eq!(contacts(&one, &[0, 1, 2]).len(), 1);
}

fn noise() -> BorderNoise {
    BorderNoise { sigma_px: 1.5, correlation_px: 20.0, kernel: Kernel::Squared, cap_px: 1e6 }
}

fn border_rows(
    view: &View,
    pose: &Pose,
    points: &[Vector3<f64>],
    samples: &[OutlineSample],
    noise: &BorderNoise,
) -> Rows {
    let (mut border, mut rows) = (BorderMatch::default(), Rows::default());
    border.find(view, samples, noise);
    border.push_rows(&view.camera, pose, points, samples, noise, &mut rows);
    assert!((border.cost(noise.kernel) - rows.cost()).abs() <= 1e-12 * rows.cost());
    rows
}

/// A sample that keeps its edge, its place on it and its normal while things move.
fn carried(scene: &Scene, sample: &OutlineSample) -> OutlineSample {
    let [a, b] = sample.vertices.map(|v| scene.camera_from_object().transform(&scene.vertices[v as usize]));
    let pixel = if sample.cut {
        camera().project(&a.lerp(&b, sample.share))
    } else {
        camera().project(&a).lerp(&camera().project(&b), sample.share)
    };
    OutlineSample { pixel, ..*sample }
}

/// A view whose distance is linear over its crop, so that central differences know no lines between pixels.
fn slanted_view(scene: &Scene, border: Vec<BorderPoint>) -> View {
    let crop = Rect::image(&camera());
    let distance = |i: usize| 0.6 * (i % crop.width) as f32 - 0.8 * (i / crop.width) as f32 - 3.0;
    View {
        camera: camera(),
        world_from_camera: scene.world_from_camera,
        time_s: 0.0,
        crop,
        distance_px: (0..crop.area()).map(distance).collect(),
        cut: vec![0; crop.area()].into(),
        hidden: vec![0; crop.area()].into(),
        border,
        area_px: 0,
        border_length_px: 0.0,
        surface_sigma_px: 0.0,
        keypoints: Vec::new(),
    }
    .checked(0)
    .unwrap()
}

#[test]
fn border_derivatives_are_right_both_ways() {
    let mut random = Random(4);
    for _ in 0..10 {
        let scene = Scene::new(&mut random);
        let samples: Vec<OutlineSample> = (0..5)
            .map(|k| {
                let normal = Vector2::new(random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0)).normalize();
                let blank = OutlineSample {
                    pixel: Vector2::zeros(),
                    normal,
                    vertices: [k, k + 1],
                    share: random.uniform(0.1, 0.9),
                    length: random.uniform(0.5, 2.0),
                    cut: k % 2 == 0,
                };
                carried(&scene, &blank)
            })
            .filter(|s| s.pixel.x > 1.0 && s.pixel.y > 1.0 && s.pixel.x < 158.0 && s.pixel.y < 118.0)
            .collect();
        let border =
            samples.iter().map(|s| BorderPoint { pixel: s.pixel + s.normal * 0.3, length: 2.0, own: true }).collect();
        let view = slanted_view(&scene, border);
        check_rows(
            &scene,
            |s| {
                let moved: Vec<OutlineSample> = samples.iter().map(|x| carried(s, x)).collect();
                border_rows(
                    &view,
                    &s.camera_from_object(),
                    &placed(&s.camera_from_object(), &s.vertices),
                    &moved,
                    &noise(),
                )
            },
            true,
        );
    }
}

/// Border rows of a box seen as it is but drawn `grow` times as large.
fn rows_of_a_box(grow: f64, change: impl Fn(&mut View), noise: &BorderNoise) -> (View, Rows) {
    let (points, faces) = cuboid(Vector3::new(-0.9, -0.5, -0.4), Vector3::new(0.9, 0.5, 0.4));
    let world_from_camera = looking(Vector3::new(5.0, 3.0, 2.0), Vector3::zeros());
    let mut view = ideal_view(&camera(), world_from_camera, &points, &[]);
    change(&mut view);
    let view = view.checked(0).unwrap();
    let larger: Vec<Vector3<f64>> = points.iter().map(|p| p * grow).collect();
    let in_camera = placed(&world_from_camera.inverse(), &larger);
    let topology = Topology::new(8, &signed(&faces)).unwrap();
    let mask = drawn(&camera(), &in_camera, &faces);
    let samples = outline(&camera(), &in_camera, &topology, &Rect::image(&camera()), &mask, 1.0);
    let rows = border_rows(&view, &world_from_camera.inverse(), &in_camera, &samples, noise);
    (view, rows)
}

#[test]
fn an_outline_on_the_border_costs_nothing_and_a_shift_costs_its_length() {
    let (view, rows) = rows_of_a_box(1.0, |_| {}, &noise());
    assert!(rows.cost() < 1e-2 * view.border_length_px / 40.0, "{}", rows.cost());
    // a border everywhere 2 px off: half the weight forward, half backward, each border pixel once over correlation and sigma
    let (view, rows) = rows_of_a_box(
        1.0,
        |v| {
            Arc::make_mut(&mut v.distance_px).iter_mut().for_each(|d| *d += 2.0);
            v.border.clear();
            v.border.push(BorderPoint { pixel: Vector2::zeros(), length: 100.0, own: true });
        },
        &noise(),
    );
    let forward: f64 = rows.iter().take(rows.len() - 1).map(|(r, _)| 0.5 * r.weight * r.residual * r.residual).sum();
    let expected = 0.5 * (0.5 * view.border_length_px / 20.0) * (2.0_f64 / 1.5).powi(2);
    assert!((forward / expected - 1.0).abs() < 0.05, "{forward} {expected}");
}

#[test]
fn the_surfaces_error_lowers_the_weight_and_leaves_residuals_as_they_are() {
    let (_, sharp) = rows_of_a_box(1.15, |_| {}, &noise());
    let (_, rough) = rows_of_a_box(1.15, |v| v.surface_sigma_px = 2.0, &noise());
    assert_eq!(sharp.len(), rough.len());
    let share = 1.5_f64.powi(2) / (1.5_f64.powi(2) + 2.0_f64.powi(2));
    for ((a, _), (b, _)) in sharp.iter().zip(rough.iter()) {
        assert!((a.residual - b.residual).abs() < 1e-12 && (b.weight / a.weight - share).abs() < 1e-12);
    }
}

#[test]
fn a_larger_model_is_outside_and_a_smaller_one_inside_in_both_directions() {
    for (grow, sign) in [(1.15, 1.0), (0.85, -1.0)] {
        let (_, rows) = rows_of_a_box(grow, |_| {}, &noise());
        let right = rows.iter().filter(|(row, _)| row.residual * sign > 0.0).count();
        assert!(right as f64 > 0.97 * rows.len() as f64, "{grow}: {right} of {}", rows.len());
    }
}

#[test]
fn a_border_that_is_not_the_objects_own_only_says_at_least_this_far() {
    let not_own = |v: &mut View| {
        Arc::make_mut(&mut v.cut).fill(1);
        v.border.iter_mut().for_each(|p| p.own = false);
    };
    assert!(rows_of_a_box(1.15, not_own, &noise()).1.is_empty(), "larger is allowed");
    let (_, rows) = rows_of_a_box(0.85, not_own, &noise());
    assert!(!rows.is_empty() && rows.iter().all(|(row, _)| row.residual < 0.0));
}

#[test]
fn samples_behind_an_occluder_pull_nothing() {
    let (_, rows) = rows_of_a_box(1.15, |v| Arc::make_mut(&mut v.hidden).fill(1), &noise());
    assert!(rows.is_empty());
    assert!(rows.cost() > 0.0, "but the border that is seen is not explained");
}

#[test]
fn a_model_out_of_sight_pays_as_much_as_the_cap() {
    let capped = BorderNoise { cap_px: 30.0, ..noise() };
    let (view, _) = rows_of_a_box(1.0, |_| {}, &capped);
    let rows = border_rows(&view, &Pose::identity(), &[], &[], &capped);
    let expected = 0.5 * (view.border_length_px / 20.0) * (30.0_f64 / 1.5).powi(2);
    assert!((rows.cost() / expected - 1.0).abs() < 1e-9, "{} {expected}", rows.cost());
}

#[test]
fn residuals_are_cut_at_the_cap() {
    let (_, rows) = rows_of_a_box(1.4, |_| {}, &BorderNoise { cap_px: 3.0, ..noise() });
    let largest = rows.iter().map(|(row, _)| row.residual.abs()).fold(0.0, f64::max);
    assert!((largest - 2.0).abs() < 1e-12, "{largest}");
}

#[test]
fn rows_forget_when_cleared() {
    let mut rows = rows_of_a_box(1.1, |_| {}, &noise()).1;
    rows.push_constant(3.0);
    rows.clear();
    assert!(rows.is_empty() && rows.cost() == 0.0);
}
