use meshslam_core::error::Error;
use meshslam_core::template::Template;
use nalgebra::Vector3;

use crate::common::{Random, icosphere, mirror, signed};

struct Parts {
    mean: Vec<Vector3<f64>>,
    faces: Vec<[i64; 3]>,
    modes: Vec<Vector3<f64>>,
    mirror: Option<Vec<i64>>,
    keypoints: Vec<Vec<(u32, f64)>>,
    wheels: Vec<i64>,
}

impl Parts {
    fn new() -> Self {
        let (mean, faces) = icosphere(1);
        let mut random = Random(1);
        Self {
            modes: (0..3 * mean.len()).map(|_| random.vector(0.1)).collect(),
            mirror: Some(mirror(&mean)),
            faces: signed(&faces),
            keypoints: vec![vec![(0, 0.5), (3, 0.5)], vec![(7, 1.0)]],
            wheels: vec![1, 2],
            mean,
        }
    }

    fn build(self) -> Result<Template, Error> {
        Template::new(self.mean, &self.faces, self.modes, self.mirror.as_deref(), self.keypoints, &self.wheels)
    }
}

#[test]
fn vertices_are_mean_and_modes_and_free_form() {
    let template = Parts::new().build().unwrap();
    let (mut random, symmetry) = (Random(2), &template.symmetry);
    let z: Vec<f64> = (0..3).map(|_| random.uniform(-2.0, 2.0)).collect();
    let d: Vec<f64> = (0..symmetry.dimension()).map(|_| random.uniform(-0.3, 0.3)).collect();
    for (v, found) in template.vertices(&z, &d).iter().enumerate() {
        let moved: Vector3<f64> = (0..3).map(|m| template.modes[3 * v + m] * z[m]).sum();
        assert!((found - (template.mean[v] + moved + symmetry.displacement(v, &d))).amax() < 1e-14);
    }
    assert_eq!(template.vertices(&[0.0; 3], &[]), template.mean);
}

#[test]
fn laplacian_rows_sum_to_one_over_the_neighbours() {
    let template = Parts::new().build().unwrap();
    let around = template.topology.neighbours();
    assert_eq!(template.laplacian.len(), template.symmetry.representative.len());
    for (row, &v) in template.laplacian.iter().zip(&template.symmetry.representative) {
        assert!((row.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(row.iter().all(|(_, w)| *w > 0.0));
        assert_eq!(row.iter().map(|(u, _)| *u).collect::<Vec<_>>(), around[v as usize]);
    }
    assert!(template.relative_area.iter().all(|a| *a >= 0.05 && *a < 3.0));
}

#[test]
fn parts_that_do_not_fit_are_refused() {
    type Break = fn(&mut Parts);
    let broken = |change: Break| {
        let mut parts = Parts::new();
        change(&mut parts);
        parts.build()
    };
    assert!(Parts::new().build().is_ok());
    assert!(matches!(broken(|p| p.mean.clear()), Err(Error::Range { .. })));
    assert!(matches!(broken(|p| p.mean[3].x = f64::NAN), Err(Error::NotFinite { .. })));
    assert!(matches!(broken(|p| p.modes[3].z = f64::INFINITY), Err(Error::NotFinite { .. })));
    assert!(matches!(broken(|p| p.modes.truncate(5)), Err(Error::Length { .. })));
    assert!(matches!(broken(|p| p.faces[5][1] = 42), Err(Error::FaceIndex { face: 5, index: 42, .. })));
    assert!(matches!(broken(|p| p.mirror = Some(vec![0])), Err(Error::Length { .. })));
    assert!(matches!(broken(|p| p.keypoints[1][0].0 = 42), Err(Error::Index { .. })));
    assert!(matches!(broken(|p| p.keypoints[1][0].1 = f64::NAN), Err(Error::NotFinite { .. })));
    assert!(matches!(broken(|p| p.wheels[0] = 42), Err(Error::Index { .. })));
    assert!(matches!(broken(|p| p.wheels[0] = -1), Err(Error::Index { .. })));
}

#[test]
fn more_modes_than_the_normal_equations_hold_are_refused() {
    let with = |count: usize| {
        let mut parts = Parts::new();
        parts.modes = vec![Vector3::new(0.01, 0.0, 0.0); count * parts.mean.len()];
        parts.build()
    };
    assert_eq!(with(55).unwrap().mode_count, 55);
    assert!(matches!(with(56), Err(Error::Range { what: "mode count", .. })));
}
