//! The paper's losses and their gradients (Eq. 2, Proposition 1).

use nalgebra::Vector2;

/// Areas of intersection and union of two masks, pixels.
#[must_use]
pub fn intersection_and_union(observed: &[f64], predicted: &[f64]) -> (f64, f64) {
    observed.iter().zip(predicted).fold((0.0, 0.0), |(i, u), (s, p)| (i + s * p, u + s + p - s * p))
}

/// L_mask(s, ŝ) = −I/U and its gradient −s/U + (1 − s) I/U²; two empty masks agree (loss −1, gradient 0).
#[must_use]
pub fn mask_loss(observed: &[f64], predicted: &[f64]) -> (f64, Vec<f64>) {
    let (i, u) = intersection_and_union(observed, predicted);
    if u <= 0.0 {
        return (-1.0, vec![0.0; observed.len()]);
    }
    (-i / u, observed.iter().map(|s| -s / u + (1.0 - s) * i / (u * u)).collect())
}

/// L_kps(y, ŷ) = ‖y − ŷ·vis‖² and its gradient 2 (ŷ·vis − y) visᵀ, with vis given as the index of each observed point.
#[must_use]
pub fn keypoint_loss(
    observed: &[Vector2<f64>],
    predicted: &[Vector2<f64>],
    visible: &[usize],
) -> (f64, Vec<Vector2<f64>>) {
    let mut gradient = vec![Vector2::zeros(); predicted.len()];
    let mut loss = 0.0;
    for (y, &k) in observed.iter().zip(visible) {
        let gap = predicted[k] - y;
        loss += gap.norm_squared();
        gradient[k] += 2.0 * gap;
    }
    (loss, gradient)
}
