use meshslam_core::kernel::Kernel;
use proptest::prelude::*;

fn kernel() -> impl Strategy<Value = Kernel> {
    (0.1..10.0, 0usize..4)
        .prop_map(|(k, which)| [Kernel::Squared, Kernel::Huber(k), Kernel::Cauchy(k), Kernel::GemanMcClure(k)][which])
}

fn literal(kernel: Kernel, r: f64) -> f64 {
    match kernel {
        Kernel::Squared => r * r,
        Kernel::Huber(k) => {
            if r.abs() <= k {
                r * r
            } else {
                2.0 * k * r.abs() - k * k
            }
        }
        Kernel::Cauchy(k) => k * k * (1.0 + r * r / (k * k)).ln(),
        Kernel::GemanMcClure(k) => r * r / (1.0 + (r / k).powi(2)),
    }
}

proptest! {
    #[test]
    fn loss_is_the_published_formula(kernel in kernel(), r in -50.0..50.0_f64) {
        prop_assert!((kernel.loss(r * r) - literal(kernel, r)).abs() < 1e-11 * (1.0 + r * r));
    }

    #[test]
    fn weight_is_the_derivative_of_the_loss(kernel in kernel(), s in 1e-3..400.0) {
        let h = 1e-5 * s;
        let slope = (kernel.loss(s + h) - kernel.loss(s - h)) / (2.0 * h);
        prop_assert!((slope - kernel.weight(s)).abs() < 1e-5, "{kernel:?} {s}: {slope} {}", kernel.weight(s));
    }

    #[test]
    fn loss_starts_as_the_square_and_never_falls(kernel in kernel(), a in 0.0..100.0, b in 0.0..100.0) {
        prop_assert_eq!(kernel.loss(0.0), 0.0);
        prop_assert!((kernel.weight(0.0) - 1.0).abs() < 1e-15);
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        prop_assert!(kernel.loss(low) <= kernel.loss(high) + 1e-12);
        prop_assert!(kernel.weight(low) >= kernel.weight(high) - 1e-12);
    }

    #[test]
    fn geman_mcclure_is_bounded(k in 0.1..10.0, s in 0.0..1e9) {
        prop_assert!(Kernel::GemanMcClure(k).loss(s) <= k * k);
    }
}
