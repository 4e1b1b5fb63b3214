use meshslam_core::camera::Camera;
use meshslam_core::lie::{Pose, exp_so3};
use meshslam_core::road::{RoadPatch, RoadTexture};
use nalgebra::Vector3;

const SMALL: Camera = Camera { width: 160, height: 60, fx: 90.0, fy: 90.0, cx: 79.0, cy: 20.0, skew: 0.0 };

fn patch() -> RoadPatch {
    RoadPatch {
        up: Vector3::new(0.0, -1.0, 0.0),
        height_m: 1.5,
        min_distance_m: 4.0,
        max_distance_m: 12.0,
        aside_m: 1.6,
        step_px: 1,
    }
}

/// The road 1.5 m below a camera at a distance along z, with a smooth pattern.
fn drawn(ahead_m: f64) -> Vec<u8> {
    let value = |at: usize| {
        let (column, row) = ((at % SMALL.width) as f64, (at / SMALL.width) as f64);
        let depth = 1.5 * SMALL.fy / (row - SMALL.cy).max(0.5);
        let (x, z) = ((column - SMALL.cx) / SMALL.fx * depth, depth + ahead_m);
        (128.0 + 60.0 * (1.7 * z + 0.3 * x).sin() + 40.0 * (2.3 * x - 0.9 * z).cos()) as u8
    };
    (0..SMALL.width * SMALL.height).map(value).collect()
}

fn texture(first: &[u8], second: &[u8], free: &[u8]) -> RoadTexture {
    let moved = Pose { rotation: exp_so3(&Vector3::zeros()), translation: Vector3::new(0.0, 0.0, 2.0) };
    RoadTexture::new(SMALL, [first, second], free, &moved, &patch()).unwrap()
}

#[test]
fn the_true_displacement_agrees_best() {
    let free = vec![1; SMALL.width * SMALL.height];
    let texture = texture(&drawn(0.0), &drawn(1.0), &free);
    assert!(texture.len() > 1000);
    let lengths: Vec<f64> = (0..21).map(|k| 0.8 + 0.02 * f64::from(k)).collect();
    let found = texture.correlations(&lengths);
    let best = (0..found.len()).max_by(|&i, &j| found[i].total_cmp(&found[j])).unwrap();
    assert!((lengths[best] - 1.0).abs() < 0.021, "{}", lengths[best]);
    assert!(found[best] > 0.98);
}

#[test]
fn an_image_agrees_with_itself_and_with_a_brighter_one_of_more_contrast() {
    let (free, image) = (vec![1; SMALL.width * SMALL.height], drawn(0.0));
    let dim: Vec<u8> = image.iter().map(|v| v / 2).collect();
    let bright: Vec<u8> = dim.iter().map(|v| 2 * v + 1).collect();
    assert!((texture(&image, &image, &free).correlations(&[0.0])[0] - 1.0).abs() < 1e-12);
    assert!((texture(&dim, &bright, &free).correlations(&[0.0])[0] - 1.0).abs() < 1e-12);
    let dark: Vec<u8> = image.iter().map(|v| 255 - v).collect();
    assert!((texture(&image, &dark, &free).correlations(&[0.0])[0] + 1.0).abs() < 1e-12);
}

#[test]
fn what_shows_nothing_is_no_number_that_misleads() {
    let (free, image, flat) = (vec![1; 9600], drawn(0.0), vec![90; 9600]);
    assert_eq!(texture(&flat, &flat, &free).correlations(&[0.0, 1.0]), vec![0.0, 0.0]);
    // behind the camera, far away, nowhere
    let nowhere = texture(&image, &image, &free).correlations(&[-50.0, 1e300, f64::NAN, f64::INFINITY]);
    assert_eq!(nowhere[0], -1.0);
    assert!(nowhere.iter().all(|x| (-1.0..=1.0).contains(x)), "{nowhere:?}");
    let hidden = texture(&image, &image, &vec![0; 9600]);
    assert!(hidden.is_empty());
    assert_eq!(hidden.correlations(&[1.0]), vec![-1.0]);
}

#[test]
fn wrong_inputs_are_errors() {
    let (free, image) = (vec![1; 9600], drawn(0.0));
    let moved = |z: f64| Pose { rotation: exp_so3(&Vector3::zeros()), translation: Vector3::new(0.0, 0.0, z) };
    let made = |image: &[u8], moved: &Pose, patch: &RoadPatch| {
        RoadTexture::new(SMALL, [image, &drawn(0.0)], &free, moved, patch).is_ok()
    };
    assert!(made(&image, &moved(1.0), &patch()));
    assert!(!made(&image[1..], &moved(1.0), &patch()));
    assert!(!made(&image, &moved(0.0), &patch()));
    assert!(!made(&image, &moved(f64::NAN), &patch()));
    assert!(!made(&image, &moved(1.0), &RoadPatch { step_px: 0, ..patch() }));
    assert!(!made(&image, &moved(1.0), &RoadPatch { height_m: f64::INFINITY, ..patch() }));
}
