use meshslam_core::losses::{intersection_and_union, keypoint_loss, mask_loss};
use nalgebra::Vector2;
use proptest::prelude::*;

fn masks() -> impl Strategy<Value = (Vec<f64>, Vec<f64>)> {
    (1usize..40).prop_flat_map(|n| {
        (prop::collection::vec(prop_oneof![Just(0.0), Just(1.0)], n), prop::collection::vec(0.0..1.0, n))
    })
}

proptest! {
    #[test]
    fn mask_loss_is_minus_iou_of_binary_masks(
        pairs in prop::collection::vec((any::<bool>(), any::<bool>()), 1..60)
    ) {
        let number = |b: bool| f64::from(u8::from(b));
        let (s, p): (Vec<f64>, Vec<f64>) = pairs.iter().map(|&(a, b)| (number(a), number(b))).unzip();
        let both = pairs.iter().filter(|(a, b)| *a && *b).count() as f64;
        let either = pairs.iter().filter(|(a, b)| *a || *b).count() as f64;
        prop_assert_eq!(intersection_and_union(&s, &p), (both, either));
        let expected = if either > 0.0 { -both / either } else { -1.0 };
        prop_assert!((mask_loss(&s, &p).0 - expected).abs() < 1e-15);
    }

    #[test]
    fn mask_gradient_is_the_derivative((s, p) in masks()) {
        let (_, gradient) = mask_loss(&s, &p);
        prop_assume!(intersection_and_union(&s, &p).1 > 0.1);
        for i in 0..p.len() {
            let at = |value: f64| {
                let mut q = p.clone();
                q[i] += value;
                mask_loss(&s, &q).0
            };
            prop_assert!(((at(1e-6) - at(-1e-6)) / 2e-6 - gradient[i]).abs() < 1e-6 * (1.0 + gradient[i].abs()));
        }
    }

    #[test]
    fn keypoint_gradient_is_the_derivative(
        predicted in prop::collection::vec(prop::array::uniform2(-9.0..9.0), 3..8),
        noise in prop::collection::vec(prop::array::uniform2(-1.0..1.0), 3),
        pick in prop::array::uniform3(0usize..3),
    ) {
        let predicted: Vec<Vector2<f64>> = predicted.into_iter().map(Vector2::from).collect();
        let observed: Vec<Vector2<f64>> = noise.into_iter().map(Vector2::from).collect();
        let (loss, gradient) = keypoint_loss(&observed, &predicted, &pick);
        let literal: f64 = observed.iter().zip(pick).map(|(y, k)| (predicted[k] - y).norm_squared()).sum();
        prop_assert!((loss - literal).abs() < 1e-12 * (1.0 + literal));
        for k in 0..predicted.len() {
            for axis in 0..2 {
                let at = |value: f64| {
                    let mut q = predicted.clone();
                    q[k][axis] += value;
                    keypoint_loss(&observed, &q, &pick).0
                };
                prop_assert!(((at(1e-4) - at(-1e-4)) / 2e-4 - gradient[k][axis]).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn two_empty_masks_agree() {
    assert_eq!(mask_loss(&[0.0; 4], &[0.0; 4]), (-1.0, vec![0.0; 4]));
}
