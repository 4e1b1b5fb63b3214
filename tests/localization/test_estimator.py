"""How uncertain a predicted camera is, before its frame is looked at."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.initialization import EstimationConfig
from meshslam.localization import LocalizationConfig, estimator
from meshslam.localization.estimator import LocalizationEstimator
from meshslam.localization.map_models import KnownMap
from meshslam.motion import ImuConfig, Mounting, Preintegrator
from tests.fixtures.imu_street import IMU_FROM_CAMERA, start_of

PROCESS = np.diag(np.square([0.01] * 3 + [1e-3] * 3))  # m, rad: what one prediction adds at least


@pytest.fixture
def predicted(drive, seen, scene, monkeypatch):
    """Go through some frames; of each, the covariance that the correction is given and what it should be made of."""

    def run(imu, frames=5):
        given = []
        plain = estimator.correct

        def watched(pose, covariance, observations):
            given.append(covariance)
            return plain(pose, covariance, observations)

        monkeypatch.setattr(estimator, "correct", watched)
        names = {c.name: c.keypoints for c in seen.categories}
        told = Mounting(IMU_FROM_CAMERA), names, EstimationConfig(imu=imu), LocalizationConfig()
        localizer = LocalizationEstimator(drive.camera, KnownMap(scene, 70.0), *told)
        by_frame, state, rows = seen.by_frame(), start_of(drive), []
        localizer.begin(0, state, drive.imu, by_frame[0])
        for index in range(1, frames):
            last = localizer.camera_covariance
            begun, before = localizer._state, localizer.path[index - 1]
            given.clear()
            report = localizer.process(index, float(drive.times_s[index]), drive.imu, by_frame[index])
            interval = Preintegrator(imu).between(drive.imu, begun.time_s, float(drive.times_s[index]), begun)
            rows.append((before, report.predicted, last, interval.measurements.preintMeasCov(), given[0]))
        return rows

    return run


def in_camera(covariance):
    """A covariance of the IMU's pose as one of the camera's."""
    adjoint = IMU_FROM_CAMERA.inverse().adjoint()
    return adjoint @ covariance @ adjoint.T


def moved(covariance, before, after):
    """A covariance of one camera as one of the next."""
    adjoint = (after.inverse() @ before).adjoint()
    return adjoint @ covariance @ adjoint.T


def test_a_prediction_is_the_last_pose_moved_along_and_what_the_step_adds(predicted):
    for before, after, last, step, given in predicted(ImuConfig()):
        added = PROCESS.copy()
        added[:3, :3] += step[3:6, 3:6]  # GTSAM: rotation, translation, velocity
        added[3:, 3:] += step[:3, :3]
        expected = moved(last, before, after) + in_camera(added)
        scale = np.sqrt(np.outer(np.diag(given), np.diag(given)))
        assert (np.abs(given - expected) < 0.02 * scale).all()


def test_no_prediction_is_surer_than_the_frame_before(predicted):
    for before, after, last, _, given in predicted(ImuConfig()):
        grown = np.linalg.eigvalsh(given - moved(last, before, after))
        assert grown.min() > 0
        assert grown.max() > 0.9 * PROCESS.max()


def test_a_noisier_imu_makes_a_less_certain_prediction(predicted):
    usual = predicted(ImuConfig(), 2)[0][-1]
    shaken = predicted(replace(ImuConfig(), accelerometer_noise=2.0, gyroscope_noise=0.1), 2)[0][-1]
    assert (np.diag(shaken) > 1.5 * np.diag(usual)).all()
