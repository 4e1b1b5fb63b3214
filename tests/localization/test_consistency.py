"""Covariances of poses are as large as the errors are, over drives whose noise is what the estimator is told.

Two drives are few: benchmarks/trajectory_uncertainty.py has twenty, tests/graph/test_consistency.py the IMU's part.
"""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.geometry import Pose, exp_so3
from meshslam.initialization import EstimationConfig
from meshslam.localization import LocalizationConfig, localize_sequence
from meshslam.maps import Map, MapObject
from meshslam.object_slam import SlamConfig, slam_sequence
from meshslam.runs import Config
from meshslam.sequences import InitialState
from meshslam.simulation import ImuNoise, ObserverConfig, StreetConfig, make_street, observe, simulated_imu

SEEDS = range(2)
MOUNTED = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([1.0, 0.1, 0.7]))


@pytest.fixture(scope="module")
def streets():
    small = StreetConfig(frames=9, width_px=560, height_px=180, focal_px=330.0, cars_each_side=3)
    return [make_street(load_category("car"), seed, small) for seed in SEEDS]


def drawn(street, drive, told, rng):
    """The drive with an IMU, a start, a mounting and a clock that are drawn from what the estimator is told of them."""
    truth, start = street.world_from_camera, EstimationConfig().start
    readings = simulated_imu(street.times_s, truth, MOUNTED, ImuNoise(), rng)
    clock_s = rng.normal(0, told.time_offset_sigma_s)
    turn = exp_so3(rng.normal(0, np.radians(told.extrinsic_rotation_sigma_deg), 3))
    tilt, heading = np.radians([start.rotation_sigma_deg, start.heading_sigma_deg])
    first = Pose(
        exp_so3(rng.normal(0, [tilt, tilt, heading])) @ truth[0].rotation,
        truth[0].translation + rng.normal(0, start.position_sigma_m, 3),
    )
    velocity = readings.velocity_in_world + rng.normal(0, start.velocity_sigma_m_s, 3)
    samples = replace(readings.samples, times_s=readings.samples.times_s - clock_s)
    return replace(
        drive,
        camera=street.camera,
        times_s=street.times_s,
        frame_ids=tuple(range(len(truth))),
        imu=samples,
        imu_from_camera=Pose(MOUNTED.rotation @ turn, MOUNTED.translation),
        initial_state=InitialState(float(street.times_s[0]), first, velocity),
        height_above_ground_m=street.camera_height_m,
    )


def nees(estimate, truth):
    """e^T C^-1 e over its dimension, mean over the frames: of position, and of rotation."""
    out = []
    for pose, covariance, true in zip(estimate.trajectory.world_from_camera, estimate.covariances, truth, strict=True):
        error = pose.local(true)
        out.append([error[p] @ np.linalg.solve(covariance[p, p], error[p]) / 3 for p in (slice(3), slice(3, 6))])
    return np.mean(out, axis=0)


def test_in_a_known_map(streets, drive):
    found = []
    for seed, street in zip(SEEDS, streets, strict=True):
        rng = np.random.default_rng([seed, 1])
        told = drawn(street, drive, EstimationConfig().imu, rng)
        seen, truth = observe(street, ObserverConfig())
        parked = [car for car in street.cars if not car.moves]
        scene = Map(
            tuple(MapObject(c.id, c.category, c.start, c.vertices, c.faces, keypoints=c.keypoints) for c in parked)
        )
        result = localize_sequence(told, seen.with_tracks(truth), scene, EstimationConfig(), LocalizationConfig())
        found.append(nees(result.estimate, street.world_from_camera))
        assert np.linalg.eigvalsh(result.estimate.covariances).min() > 0
    position, rotation = np.mean(found, axis=0)
    assert 0.1 < position < 2.5
    assert 0.1 < rotation < 2.5


def test_among_objects_that_are_not_known(streets, drive):
    found, settings = [], Config(slam=SlamConfig(min_baseline_m=2.0, gyroscope_noise=1e-3))
    for seed, street in zip(SEEDS, streets, strict=True):
        told = drawn(street, drive, settings.slam, np.random.default_rng([seed, 2]))
        seen, truth = observe(street, ObserverConfig())
        result = slam_sequence(told, seen.with_tracks(truth), load_category("car"), settings)
        found.append(nees(result.estimate, street.world_from_camera))
        assert np.linalg.eigvalsh(result.estimate.covariances).min() > 0
    position, rotation = np.mean(found, axis=0)
    assert 0.1 < position < 2.5
    assert 0.1 < rotation < 2.5
