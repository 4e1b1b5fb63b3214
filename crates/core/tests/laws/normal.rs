use meshslam_core::object::{ObjectProblem, Scope};
use meshslam_core::solve::levenberg_marquardt::Problem;
use meshslam_core::view::View;
use nalgebra::{DMatrix, DVector};

use crate::common::Random;
use crate::object::{SCOPES, disturbed, ground, model, start, template, views};

#[test]
fn rows_gathered_over_vertices_give_what_they_give_one_by_one() {
    let template = template();
    let state = disturbed(&template, &mut Random(9), 0.0);
    let views = views(&template, &start(&template), 3);
    let views: Vec<&View> = views.iter().collect();
    let linear = |free_form: bool| {
        let problem = ObjectProblem::new(&template, &views, ground(), model(), Scope { free_form, ..SCOPES[1] });
        let (mut hessian, n) = (problem.structure(), problem.structure().size());
        let mut gradient = vec![0.0; n];
        problem.linearize(&state, &mut hessian, &mut gradient);
        let last = DMatrix::from_fn(8, 8, |i, j| hessian.get(n - 8 + i, n - 8 + j)); // pose and two modes
        (last, DVector::from_column_slice(&gradient[n - 8..]))
    };
    let ((gathered, g), (single, h)) = (linear(false), linear(true)); // free form takes rows one by one
    assert!((&gathered - &single).amax() < 1e-9 * single.amax() && (&g - &h).amax() < 1e-9 * h.amax().max(1.0));
}
