"""What SLAM is told reaches what it concerns."""

from dataclasses import replace

import numpy as np
import pytest
from gtsam.symbol_shorthand import E, T

from meshslam.categories import load_category
from meshslam.initialization import EstimationConfig
from meshslam.motion import Mounting
from meshslam.object_slam import SlamConfig, SlamEstimator
from meshslam.object_slam.setup import SlamSetup
from tests.fixtures.imu_street import IMU_FROM_CAMERA, start_of

OWN = {"time_offset_sigma_s": 0.011, "extrinsic_rotation_sigma_deg": 0.7, "gyroscope_noise": 0.0123}


@pytest.fixture
def setup(drive):
    """Settings of which each differs from the default."""
    names, slam = load_category("car").keypoint_names, SlamConfig(**OWN)
    return SlamSetup(drive.camera, load_category("car"), names, Mounting(IMU_FROM_CAMERA), 1.65, slam)


def test_three_settings_of_the_imu_are_slams_own_and_all_others_are_estimations(setup):
    estimation = EstimationConfig(imu=replace(EstimationConfig().imu, accelerometer_noise=0.5, gap_periods=7.0))
    setup = replace(setup, estimation=estimation)
    assert setup.imu == replace(estimation.imu, **OWN)
    for name, value in OWN.items():
        assert getattr(setup.imu, name) == value != getattr(estimation.imu, name)


def test_without_a_map_gyroscope_counts_less_and_clock_and_mounting_are_held_tighter(setup):
    usual, given = replace(setup, slam=SlamConfig()).imu, EstimationConfig().imu
    assert usual.gyroscope_noise > given.gyroscope_noise
    assert usual.time_offset_sigma_s < given.time_offset_sigma_s
    assert usual.extrinsic_rotation_sigma_deg < given.extrinsic_rotation_sigma_deg


def test_the_graph_begins_with_slams_own_sigmas(setup, drive):
    estimator = SlamEstimator(setup)
    estimator.begin(0, start_of(drive), drive.imu, ())
    window = estimator.smoother.window
    assert np.sqrt(window.covariance(T(0))) == pytest.approx(OWN["time_offset_sigma_s"])
    turn = np.degrees(np.sqrt(np.diag(window.covariance(E(0)))))
    assert turn == pytest.approx(OWN["extrinsic_rotation_sigma_deg"])


def test_the_camera_turns_as_uncertainly_as_slams_gyroscope_is_noisy(setup, drive):
    """Over a second without observations: the variance grows by the density squared times the time."""
    grown = []
    for noise in (0.01, 0.02):
        estimator = SlamEstimator(replace(setup, slam=replace(setup.slam, gyroscope_noise=noise, lag_s=10.0)))
        estimator.begin(0, start_of(drive), drive.imu, ())
        for index in range(1, 11):
            estimator.process(index, float(drive.times_s[index]), drive.imu, ())
        grown.append(np.trace(estimator.smoother.cameras.pose_covariance(10)[3:, 3:]) / 3)
    seconds = float(drive.times_s[10] - drive.times_s[0])
    assert grown[1] - grown[0] == pytest.approx((0.02**2 - 0.01**2) * seconds, rel=0.02)


def test_the_window_is_as_long_as_slams_own_lag(setup, drive):
    for lag_s in (0.35, 0.75):
        estimator = SlamEstimator(replace(setup, slam=replace(setup.slam, lag_s=lag_s)))
        estimator.begin(0, start_of(drive), drive.imu, ())
        for index in range(1, len(drive)):
            estimator.process(index, float(drive.times_s[index]), drive.imu, ())
            held = estimator.smoother.frames
            assert held == [f for f in range(index + 1) if drive.times_s[f] >= drive.times_s[index] - lag_s]
