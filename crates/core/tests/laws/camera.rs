use meshslam_core::camera::Camera;
use meshslam_core::error::Error;
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

use crate::common::{camera, differences, vector3};

fn any_camera() -> impl Strategy<Value = Camera> {
    (50.0..2000.0, 50.0..2000.0, -50.0..700.0, -50.0..500.0, -20.0..20.0).prop_map(|(fx, fy, cx, cy, skew)| Camera {
        width: 640,
        height: 480,
        fx,
        fy,
        cx,
        cy,
        skew,
    })
}

fn before() -> impl Strategy<Value = Vector3<f64>> {
    (vector3(5.0), 0.2..40.0).prop_map(|(p, z)| Vector3::new(p.x, p.y, z))
}

proptest! {
    #[test]
    fn projects_as_the_matrix_does(c in any_camera(), p in before()) {
        let k = Matrix3::new(c.fx, c.skew, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0);
        let homogeneous = k * p;
        let pixel = c.project(&p);
        let scale = 1.0 + pixel.amax();
        prop_assert!((pixel - homogeneous.xy() / homogeneous.z).amax() < 1e-12 * scale);
    }

    #[test]
    fn a_ray_is_one_pixel(c in any_camera(), p in before(), s in 0.5..3.0) {
        let pixel = c.project(&p);
        prop_assert!((c.project(&(p * s)) - pixel).amax() < 1e-11 * (1.0 + pixel.amax()));
    }

    #[test]
    fn jacobian_is_the_derivative(c in any_camera(), p in before()) {
        let jacobian = c.projection_jacobian(&p);
        for row in 0..2 {
            let slope = differences(|d: &[f64; 3]| c.project(&(p + Vector3::from(*d)))[row], 1e-5 * p.z);
            for axis in 0..3 {
                let scale = 1.0 + jacobian.row(row).amax();
                prop_assert!((slope[axis] - jacobian[(row, axis)]).abs() < 1e-6 * scale);
            }
        }
    }
}

#[test]
fn values_without_meaning_are_refused() {
    let good = camera();
    assert!(good.checked().is_ok());
    for bad in [f64::NAN, f64::INFINITY] {
        for camera in [
            Camera { fx: bad, ..good },
            Camera { fy: bad, ..good },
            Camera { cx: bad, ..good },
            Camera { cy: bad, ..good },
            Camera { skew: bad, ..good },
        ] {
            assert!(matches!(camera.checked(), Err(Error::NotFinite { .. })));
        }
    }
    for bad in [0.0, -1.0] {
        assert!(matches!(Camera { fx: bad, ..good }.checked(), Err(Error::Range { .. })));
        assert!(matches!(Camera { fy: bad, ..good }.checked(), Err(Error::Range { .. })));
    }
}
