from types import SimpleNamespace

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.objects.heading import heading_cost, likelihood, reversed_probability, viewing_angle_rad
from meshslam.objects.start_search import flipped


def test_the_viewing_angle_is_that_of_the_camera_seen_from_the_object():
    world_from_object = Pose.from_yaw(np.pi / 2, np.array([10.0, 0, 0]))
    for eye, expected in (([10, 5, 1], 0), ([10, -5, 1], np.pi), ([5, 0, 1], np.pi / 2)):
        found = viewing_angle_rad(Pose(np.eye(3), np.array(eye, float)), world_from_object)
        assert abs(np.angle(np.exp(1j * (found - expected)))) < 1e-9


def test_a_likelihood_averages_to_one_and_never_vanishes():
    shares = np.random.default_rng(0).dirichlet(np.full(36, 0.1))
    values = [likelihood(shares, a) for a in np.linspace(0, 2 * np.pi, 3600, endpoint=False)]
    assert np.mean(values) == pytest.approx(1, abs=1e-3)
    assert min(values) >= 0.009


def test_shares_up_to_a_factor_say_the_same():
    shares = np.random.default_rng(1).dirichlet(np.ones(36))
    for angle in np.linspace(0, 2 * np.pi, 50):
        for factor in (1e-3, 0.5, 250.0):
            assert likelihood(factor * shares, angle) == pytest.approx(likelihood(shares, angle), rel=1e-12)


def test_the_right_way_round_is_cheaper_and_nothing_is_said_without_angles():
    eye, pose = Pose(np.eye(3), np.zeros(3)), Pose.from_yaw(0.3, np.array([10.0, 1, 0]))
    centres = 2 * np.pi * np.arange(36) / 36
    shares = np.exp(20 * np.cos(viewing_angle_rad(eye, pose) - centres))
    told = SimpleNamespace(viewing_angle_shares=shares / shares.sum())
    track = SimpleNamespace(detections=(told, told), world_from_camera=(eye, eye))
    assert heading_cost(track, pose) < 0 < heading_cost(track, flipped(pose))
    silent = SimpleNamespace(viewing_angle_shares=None)
    assert heading_cost(SimpleNamespace(detections=(silent,), world_from_camera=(eye,)), pose) == 0


@pytest.mark.parametrize("rear", [0.0, 0.1, 0.3, 0.5])
def test_angles_that_hold_two_opposite_sides_leave_the_heading_in_doubt(rear):
    """One detection: the probability of the other way round is the distribution's mass there, over both."""
    eye, pose = Pose(np.eye(3), np.zeros(3)), Pose.from_yaw(0.3, np.array([10.0, 1, 0]))
    away = 2 * np.pi * np.arange(36) / 36 - viewing_angle_rad(eye, pose)
    peak = np.exp(20 * np.cos(away))
    shares = (1 - rear) * peak / peak.sum() + rear * np.exp(20 * np.cos(away - np.pi)) / peak.sum()
    track = SimpleNamespace(detections=(SimpleNamespace(viewing_angle_shares=shares),), world_from_camera=(eye,))
    assert reversed_probability(track, pose) == pytest.approx(rear, abs=0.01)
    assert reversed_probability(track, flipped(pose)) == pytest.approx(1 - rear, abs=0.01)


def test_no_angles_tell_no_probability():
    silent = SimpleNamespace(viewing_angle_shares=None)
    track = SimpleNamespace(detections=(silent,), world_from_camera=(Pose(np.eye(3), np.zeros(3)),))
    assert reversed_probability(track, Pose.from_yaw(0.3, np.ones(3))) is None
