use meshslam_core::lie::Pose;
use meshslam_core::outline::{OutlineSample, outline};
use meshslam_core::raster::Rect;
use meshslam_core::residuals::border::BorderMatch;
use meshslam_core::residuals::normal::{Dense, FreeForm, VertexNormal};
use meshslam_core::residuals::{Rows, Term};
use meshslam_core::solve::envelope::Envelope;
use meshslam_core::template::Template;
use meshslam_core::view::View;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use crate::common::{Random, camera, drawn, placed};
use crate::object::{disturbed, model, start, template, views};

/// What of the parameters moves, in the order free form, pose, modes, velocity.
struct Moving {
    modes: bool,
    velocity: Option<Matrix3<f64>>,
    free_form: bool,
}

/// J of a row over all parameters, term by term.
fn jacobian(
    terms: &[Term],
    vertices: &[Vector3<f64>],
    template: &Template,
    moving: &Moving,
    size: usize,
) -> DVector<f64> {
    let mut out = DVector::zeros(size);
    let base = if moving.free_form { template.symmetry.dimension() } else { 0 };
    for Term { vertex, gradient } in terms {
        let at = *vertex as usize;
        if moving.free_form {
            template.symmetry.freedoms(at).for_each(|(dof, axis, sign)| out[dof] += sign * gradient[axis]);
        }
        let torque = vertices[at].cross(gradient);
        (0..3).for_each(|k| out[base + k] += gradient[k]);
        (0..3).for_each(|k| out[base + 3 + k] += torque[k]);
        let mut next = base + 6;
        if moving.modes {
            for mode in template.modes_of(at) {
                out[next] += mode.dot(gradient);
                next += 1;
            }
        }
        if let Some(moved) = &moving.velocity {
            let force = moved.transpose() * gradient;
            (0..3).for_each(|k| out[next + k] += force[k]);
        }
    }
    out
}

/// Outline, match and rows of a view.
fn seen(
    view: &View,
    pose: &Pose,
    template: &Template,
    vertices: &[Vector3<f64>],
) -> (Vec<Vector3<f64>>, Vec<OutlineSample>, BorderMatch, Rows) {
    let points = placed(pose, vertices);
    let mask = drawn(&camera(), &points, &template.topology.faces);
    let samples = outline(&camera(), &points, &template.topology, &Rect::image(&camera()), &mask, 1.0);
    let (mut border, mut rows) = (BorderMatch::default(), Rows::default());
    border.find(view, &samples, &model().border);
    border.push_rows(&view.camera, pose, &points, &samples, &model().border, &mut rows);
    (points, samples, border, rows)
}

#[test]
fn pulls_gathered_over_vertices_give_what_rows_give_one_by_one() {
    let (template, mut random) = (template(), Random(9));
    let state = disturbed(&template, &mut random, 1.0);
    let vertices = template.vertices(&state.z, &state.d);
    let turned = random.rotation() * 0.7;
    let mut views = views(&template, &start(&template), 3);
    views[2] = cut_by_the_near_plane(&views[2], &state.world_from_object, &template, &vertices);
    views.push(View { hidden: vec![1; views[0].hidden.len()].into(), ..views[0].clone() }); // a border that no sample explains
    for (modes, velocity, free_form) in [
        (false, None, false),
        (true, None, false),
        (true, Some(turned), false),
        (true, Some(turned), true),
        (false, None, true),
    ] {
        let moving = Moving { modes, velocity, free_form };
        let shape = if modes { (template.modes.as_slice(), template.mode_count) } else { (&[][..], 0) };
        let dense = Dense { vertices: &vertices, modes: shape, velocity };
        let base = if free_form { template.symmetry.dimension() } else { 0 };
        let size = base + dense.columns();
        let (mut expected, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
        let (mut normal, mut cost, mut true_cost) = (VertexNormal::default(), 0.0, 0.0);
        normal.clear(vertices.len());
        for view in &views {
            let pose = view.world_from_camera.inverse().compose(&state.world_from_object);
            let (points, samples, border, rows) = seen(view, &pose, &template, &vertices);
            cost += normal.add_border(&view.camera, &pose.rotation, &points, &samples, &border, &model().border);
            true_cost += rows.cost();
            for (row, terms) in rows.iter() {
                let j = jacobian(terms, &vertices, &template, &moving, size);
                let weight = row.weight * row.kernel.weight(row.residual * row.residual);
                expected += &j * j.transpose() * weight;
                right += j * (weight * row.residual);
            }
        }
        let position: Vec<usize> = (0..base).collect();
        let free = FreeForm { symmetry: &template.symmetry, position: &position };
        let (mut hessian, mut gradient) = (Envelope::dense(size), vec![0.0; size]);
        normal.gather(&dense, free_form.then_some(&free), base, &mut hessian, &mut gradient);
        let found = DMatrix::from_fn(size, size, |i, j| hessian.get(i, j));
        assert!((cost - true_cost).abs() < 1e-9 * true_cost);
        assert!((&found - &expected).amax() < 1e-9 * expected.amax(), "{modes} {free_form}");
        assert!((DVector::from(gradient) - &right).amax() < 1e-9 * right.amax());
    }
}

/// A camera so near that the near plane cuts edges of the outline that it sees.
fn cut_by_the_near_plane(
    view: &View,
    world_from_object: &Pose,
    template: &Template,
    vertices: &[Vector3<f64>],
) -> View {
    let mut random = Random(5);
    let mut near = view.clone();
    loop {
        let beside = Vector3::new(random.uniform(-2.0, 2.0), random.uniform(-1.0, 1.0), random.uniform(-0.8, 0.8));
        near.world_from_camera = world_from_object.compose(&Pose { rotation: random.rotation(), translation: beside });
        let pose = near.world_from_camera.inverse().compose(world_from_object);
        if seen(&near, &pose, template, vertices).1.iter().filter(|s| s.cut).count() > 5 {
            return near;
        }
    }
}
