use std::sync::Arc;

use meshslam_core::error::Error;
use meshslam_core::lie::Pose;
use meshslam_core::raster::Rect;
use meshslam_core::view::{BorderPoint, KeypointObservation, View};
use nalgebra::Vector2;

use crate::common::{Random, camera};

fn view(width: usize, height: usize, random: &mut Random) -> View {
    let crop = Rect { x0: 40, y0: 30, width, height };
    let border = BorderPoint { pixel: Vector2::new(45.0, 36.0), length: 2.0, own: true };
    View {
        camera: camera(),
        world_from_camera: Pose::identity(),
        time_s: 0.0,
        crop,
        distance_px: (0..crop.area()).map(|_| random.uniform(-5.0, 9.0) as f32).collect(),
        cut: vec![0; crop.area()].into(),
        hidden: vec![0; crop.area()].into(),
        border: vec![border, BorderPoint { own: false, ..border }, BorderPoint { length: 1.5, ..border }],
        area_px: 0,
        border_length_px: 0.0,
        surface_sigma_px: 0.0,
        keypoints: vec![KeypointObservation { index: 1, pixel: Vector2::new(50.0, 40.0), sigma_px: 1.0 }],
    }
}

#[test]
fn distance_is_bilinear_and_its_gradient_the_derivative() {
    let mut random = Random(1);
    let view = view(14, 9, &mut random).checked(2).unwrap();
    for _ in 0..500 {
        let p = Vector2::new(random.uniform(25.0, 70.0), random.uniform(15.0, 55.0));
        let near_line = |x: f64| (x - x.round()).abs() < 1e-3; // the gradient jumps at lines between pixel centres
        if near_line(p.x) || near_line(p.y) {
            continue;
        }
        let (_, gradient) = view.distance(&p);
        let h = 1e-5;
        let slope = |e: Vector2<f64>| (view.distance(&(p + e * h)).0 - view.distance(&(p - e * h)).0) / (2.0 * h);
        assert!((gradient.x - slope(Vector2::x())).abs() < 1e-6, "{p}");
        assert!((gradient.y - slope(Vector2::y())).abs() < 1e-6, "{p}");
    }
    for (i, d) in view.distance_px.iter().enumerate() {
        let centre = Vector2::new(40.0 + (i % 14) as f64, 30.0 + (i / 14) as f64);
        assert!((view.distance(&centre).0 - f64::from(*d)).abs() < 1e-6);
    }
}

#[test]
fn beyond_the_crop_the_distance_grows_by_the_way_out() {
    let mut random = Random(2);
    let view = view(14, 9, &mut random).checked(2).unwrap();
    let corner = view.distance(&Vector2::new(53.0, 38.0)).0;
    assert!((view.distance(&Vector2::new(56.0, 42.0)).0 - (corner + 5.0)).abs() < 1e-9);
}

#[test]
fn crops_of_one_pixel_are_crops() {
    let mut random = Random(3);
    for (w, h) in [(1, 1), (1, 6), (6, 1), (2, 2)] {
        let view = view(w, h, &mut random).checked(2).unwrap();
        for _ in 0..50 {
            let p = Vector2::new(random.uniform(30.0, 60.0), random.uniform(20.0, 50.0));
            let (d, g) = view.distance(&p);
            assert!(d.is_finite() && g.iter().all(|x| x.is_finite()));
        }
    }
}

#[test]
fn marks_are_read_at_the_nearest_pixel() {
    let mut view = view(14, 9, &mut Random(4));
    Arc::make_mut(&mut view.hidden)[2 * 14 + 3] = 1;
    Arc::make_mut(&mut view.cut)[0] = 1;
    assert!(view.is_hidden(&Vector2::new(43.4, 31.6)));
    assert!(!view.is_hidden(&Vector2::new(43.6, 31.6)));
    assert!(!view.is_hidden(&Vector2::new(0.0, 0.0)));
    Arc::make_mut(&mut view.hidden)[2 * 14 + 13] = 1;
    assert!(view.is_hidden(&Vector2::new(140.0, 32.0)), "an occluder at the crop's edge goes on beyond it");
    assert!(!view.is_hidden(&Vector2::new(140.0, 33.0)));
    assert!(view.look(&Vector2::new(140.0, 32.0)).is_none() && view.look(&Vector2::new(140.0, 33.0)).is_some());
    assert!(!view.border_is_own(&Vector2::new(-100.0, 3.0)), "beyond the crop its nearest pixel speaks");
    assert!(view.border_is_own(&Vector2::new(45.0, 33.0)));
    assert!(view.in_image(&Vector2::new(-0.49, 119.49)) && !view.in_image(&Vector2::new(-0.51, 3.0)));
    assert!(!view.in_image(&Vector2::new(159.5, 3.0)) && !view.in_image(&Vector2::new(3.0, 119.5)));
}

#[test]
fn only_the_objects_own_border_counts() {
    assert_eq!(view(14, 9, &mut Random(5)).checked(2).unwrap().border_length_px, 3.5);
}

#[test]
fn fields_that_do_not_fit_are_refused() {
    type Break = fn(&mut View);
    let lengths: [Break; 3] =
        [|v| v.distance_px = [0.0; 5].into(), |v| v.cut = vec![0; 14 * 9 + 1].into(), |v| v.hidden = [].into()];
    let values: [Break; 9] = [
        |v| v.time_s = f64::NAN,
        |v| Arc::make_mut(&mut v.distance_px)[7] = f32::NAN,
        |v| v.world_from_camera.translation.y = f64::INFINITY,
        |v| v.world_from_camera.rotation[(1, 2)] = f64::NAN,
        |v| v.border[1].pixel.x = f64::NAN,
        |v| v.border[2].length = f64::NAN,
        |v| v.keypoints[0].pixel.y = f64::NAN,
        |v| v.keypoints[0].sigma_px = f64::INFINITY,
        |v| v.camera.skew = f64::NAN,
    ];
    let ranges: [Break; 3] = [|v| v.keypoints[0].sigma_px = 0.0, |v| v.camera.fx = -1.0, |v| v.crop.width = 0];
    let broken = |change: Break| {
        let mut view = view(14, 9, &mut Random(6));
        change(&mut view);
        view.checked(2)
    };
    assert!(lengths.iter().all(|b| matches!(broken(*b), Err(Error::Length { .. }))));
    assert!(values.iter().all(|b| matches!(broken(*b), Err(Error::NotFinite { .. }))));
    assert!(ranges.iter().all(|b| matches!(broken(*b), Err(Error::Range { .. }))));
    assert!(matches!(broken(|v| v.keypoints[0].index = 2), Err(Error::Index { .. })));
}
