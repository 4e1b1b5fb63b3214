use meshslam_core::error::Error;
use meshslam_core::factor::square_root;
use meshslam_core::lie::Pose;
use meshslam_core::template::Template;
use meshslam_core::view::{KeypointObservation, View};
use nalgebra::{Matrix6, Vector3, Vector6};

use crate::common::{camera, icosphere, ideal_view, looking, placed, signed};
use crate::object::model;

fn template() -> Template {
    let (sphere, faces) = icosphere(2);
    let mean: Vec<Vector3<f64>> = sphere.iter().map(|v| v.component_mul(&Vector3::new(2.0, 0.9, 0.7))).collect();
    let keypoints = (0..8).map(|k| vec![(5 * k as u32, 1.0)]).collect();
    Template::new(mean, &signed(&faces), Vec::new(), None, keypoints, &[]).unwrap()
}

/// A view, and the relative pose from which it was made.
fn view(template: &Template, with_border: bool) -> (View, Pose) {
    let world_from_camera = looking(Vector3::new(6.0, -3.0, 1.0), Vector3::zeros());
    let points = placed(&Pose::identity(), &template.mean);
    let seen: Vec<Vector3<f64>> = template.keypoints.iter().map(|a| points[a[0].0 as usize]).collect();
    let mut view = ideal_view(&camera(), world_from_camera, &points, &seen);
    if !with_border {
        view.border.clear();
    }
    (view, world_from_camera.inverse())
}

fn cost(template: &Template, view: &View, relative: &Pose) -> f64 {
    square_root(template, view, &model(), relative, &[], &[], false).unwrap().cost
}

#[test]
fn the_root_is_a_triangle_whose_last_column_holds_the_cost() {
    let template = template();
    let (view, relative) = view(&template, true);
    let moved = relative.retract(&Vector6::new(0.1, -0.05, 0.08, 0.02, 0.01, -0.03));
    let found = square_root(&template, &view, &model(), &moved, &[], &[], false).unwrap();
    let width = found.columns + 1;
    assert_eq!(width, 7);
    assert!((0..width).all(|i| (0..i).all(|j| found.root[i * width + j].abs() < 1e-12)));
    let half: f64 = 0.5 * (0..width).map(|i| found.root[i * width + width - 1].powi(2)).sum::<f64>();
    assert!((half - found.cost).abs() < 1e-9 * found.cost.max(1.0));
    assert!(found.cost > cost(&template, &view, &relative));
    assert!(found.observations > 0.0);
}

#[test]
fn the_root_holds_the_derivative_of_the_cost() {
    let template = template();
    let (view, relative) = view(&template, false);
    let moved = relative.retract(&Vector6::new(0.05, -0.03, 0.04, 0.01, 0.01, -0.02));
    let found = square_root(&template, &view, &model(), &moved, &[], &[], false).unwrap();
    let at = |i: usize, j: usize| found.root[i * 7 + j];
    let (root, residual) = (Matrix6::from_fn(at), Vector6::from_fn(|i, _| at(i, 6)));
    let gradient = root.transpose() * residual;
    for k in 0..6 {
        let step = Vector6::from_fn(|i, _| if i == k { 1e-6 } else { 0.0 });
        let slope =
            (cost(&template, &view, &moved.retract(&step)) - cost(&template, &view, &moved.retract(&-step))) / 2e-6;
        assert!((slope - gradient[k]).abs() < 1e-4 * gradient.amax().max(1.0), "{k}: {slope} {}", gradient[k]);
    }
}

#[test]
fn a_state_that_does_not_fit_is_refused() {
    let template = template();
    let (view, relative) = view(&template, false);
    assert!(square_root(&template, &view, &model(), &relative, &[0.0], &[], false).is_err());
}

#[test]
fn a_key_point_that_the_template_has_not_is_named() {
    let template = template();
    let (mut view, relative) = view(&template, false);
    view.keypoints[3] = KeypointObservation { index: 99, ..view.keypoints[3] };
    let error = square_root(&template, &view, &model(), &relative, &[], &[], false).unwrap_err();
    assert_eq!(error, Error::Index { what: "key point", index: 99, count: 8 });
    assert_eq!(error.to_string(), "key point 99 is out of range: there are 8");
}
