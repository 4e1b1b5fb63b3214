import numpy as np
import pytest

from meshslam.perception.keypoints.decode import (
    ANGLES,
    CELL_PX,
    angle_distribution,
    keypoint_scores,
    peak_angle,
    points_in_input,
    reversed_share,
)


def heat_of(points, sigma=0.8):
    cells = (points + 0.5) / CELL_PX - 0.5
    x = (np.arange(32) - cells[..., :1]) ** 2
    y = (np.arange(24) - cells[..., 1:]) ** 2
    return (-(y[..., None] + x[:, :, None]) / (2 * sigma**2)).astype(np.float32)


def test_a_gaussian_heat_map_has_its_point_at_its_middle():
    points = np.random.default_rng(0).uniform([12, 12], [115, 83], (40, 12, 2))
    found, share = points_in_input(heat_of(points))
    assert np.abs(found - points).max() < 0.3
    assert share.min() > 0.95


def test_of_two_peaks_the_higher_decides_and_its_share_tells_of_the_other():
    first, second = np.full((1, 12, 2), 30.0), np.full((1, 12, 2), 80.0)
    found, share = points_in_input(np.logaddexp(heat_of(first), heat_of(second) - 0.7))
    assert np.abs(found - first).max() < 0.5
    assert share == pytest.approx(np.full((1, 12), 2 / 3), abs=0.03)


def test_angles_are_read_off_all_around():
    centres = 2 * np.pi * np.arange(ANGLES) / ANGLES
    angles = np.linspace(-np.pi, np.pi, 200)
    logits = (40 * np.cos(angles[:, None] - centres)).astype(np.float32)
    shares = angle_distribution(logits)
    assert shares.sum(1) == pytest.approx(1)
    gap = np.angle(np.exp(1j * (peak_angle(shares) - angles)))
    assert np.abs(gap).max() < 0.02


def test_a_network_that_cannot_tell_front_from_rear_scores_its_points_lower():
    """Of the angles' mass, what lies on the other side is taken off every score; a spread to the sides is not."""
    centres = 2 * np.pi * np.arange(ANGLES) / ANGLES
    share, visible = np.full((3, 12), 0.9), np.full((3, 12), 2.0, np.float32)
    peaks = np.exp(30 * (np.cos(centres - 0.4) - 1)), np.exp(30 * (np.cos(centres - 0.4 - np.pi) - 1))
    sideways = np.exp(3 * (np.cos(centres - 0.4) - 1)) * (np.cos(centres - 0.4) > 0)
    shares = np.array([peaks[0], 0.7 * peaks[0] + 0.3 * peaks[1], sideways])
    shares /= shares.sum(1, keepdims=True)
    assert reversed_share(shares) == pytest.approx([0, 0.3, 0], abs=1e-3)
    scores = keypoint_scores(share, visible, shares)
    assert scores[0] == pytest.approx(np.full(12, 0.9 / (1 + np.exp(-2.0))), abs=1e-3)
    assert scores[1] == pytest.approx(0.7 * scores[0], abs=1e-3)
    assert scores[2] == pytest.approx(scores[0], abs=1e-3)


def test_training_finds_points_as_the_runtime_does():
    torch = pytest.importorskip("torch")
    from meshslam.training.losses import local_mean

    heat = np.random.default_rng(1).normal(0, 3, (4, 12, 24, 32)).astype(np.float32)
    found, _ = points_in_input(heat)
    cells = local_mean(torch.from_numpy(heat)).numpy()
    assert np.allclose(CELL_PX * (cells + 0.5) - 0.5, found, atol=1e-3)
