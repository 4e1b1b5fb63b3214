import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.geometry import Pose
from meshslam.motion import ImuConfig
from meshslam.motion.imu import Mounting, state_of_camera
from meshslam.motion.inertial_odometry import inertial_path
from meshslam.sequences import open_sequence
from meshslam.simulation import ImuNoise, StreetConfig, make_street, simulated_imu, write_recording
from meshslam.simulation.motion import IMU_FROM_CAMERA, Motion

SILENT = ImuNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def wild_path(count=30):
    times = np.linspace(0.0, 3.0, count)
    turns = Rotation.from_rotvec(np.column_stack([0.1 * np.sin(times), 0.1 * np.cos(2 * times), 0.4 * times]))
    places = np.column_stack([8 * times, np.sin(times), 0.3 * np.cos(times)])
    return times, tuple(Pose(r, p) for r, p in zip(turns.as_matrix(), places, strict=True))


def test_rates_and_forces_are_the_motions_derivatives():
    times, poses = wild_path()
    motion, step, at = Motion(times, poses), 1e-4, np.array([0.4, 1.3, 2.2])
    samples = motion.ideal_imu(at)
    for t, rate, force in zip(at, samples.angular_rate_rad_s, samples.specific_force_m_s2, strict=True):
        before, now, after = (motion.pose(t + k * step) for k in (-1, 0, 1))
        turn = Rotation.from_matrix(before.rotation.T @ after.rotation).as_rotvec() / (2 * step)
        np.testing.assert_allclose(rate, turn, atol=1e-5)
        pull = (after.translation - 2 * now.translation + before.translation) / step**2 + [0, 0, 9.81]
        np.testing.assert_allclose(force, now.rotation.T @ pull, atol=1e-3)


def test_an_imu_without_errors_leads_back_along_the_path():
    times, poses = wild_path()
    imu = simulated_imu(times, poses, IMU_FROM_CAMERA, SILENT, np.random.default_rng(0))
    motion = Motion(times, [pose @ IMU_FROM_CAMERA.inverse() for pose in poses])
    rate = motion.ideal_imu(times[:1]).angular_rate_rad_s[0]
    start = state_of_camera(times[0], poses[0], imu.velocity_in_world, rate, IMU_FROM_CAMERA)
    path = inertial_path(imu.samples, times, start, Mounting(IMU_FROM_CAMERA), ImuConfig())
    gaps = [np.linalg.norm(a.translation - b.translation) for a, b in zip(path, poses, strict=True)]
    assert max(gaps) < 0.03


def test_errors_have_the_density_and_the_walk_that_are_asked_for():
    times = np.array([0.0, 400.0])
    still = (Pose.identity(), Pose.identity())
    rng = np.random.default_rng(1)
    white = simulated_imu(times, still, Pose.identity(), ImuNoise(1e-3, 1e-2, 0, 0, 0, 0), rng)
    assert white.samples.angular_rate_rad_s.std() == pytest.approx(1e-3 * 10, rel=0.03)
    assert (white.samples.specific_force_m_s2 - [0, 0, 9.81]).std() == pytest.approx(1e-2 * 10, rel=0.03)
    walks = [
        simulated_imu(times / 4, still, Pose.identity(), ImuNoise(0, 0, 1e-3, 0, 0, 0), np.random.default_rng(k))
        for k in range(40)
    ]
    ends = np.array([walk.samples.angular_rate_rad_s[-1] - walk.samples.angular_rate_rad_s[0] for walk in walks])
    assert ends.std() == pytest.approx(1e-3 * np.sqrt(100.0), rel=0.2)


def test_the_recording_holds_imu_and_start(street, tmp_path):
    recording = open_sequence(write_recording(street, tmp_path / "street"))
    assert recording.imu.rate_hz == pytest.approx(100.0)
    assert recording.imu.times_s[0] < recording.times_s[0]
    assert recording.imu.times_s[-1] > recording.times_s[-1]
    np.testing.assert_allclose(recording.imu_from_camera.matrix, IMU_FROM_CAMERA.matrix)
    speed = np.linalg.norm(recording.initial_state.velocity_in_world)
    assert speed == pytest.approx(20.0, rel=0.05)


def test_one_frame_alone_has_no_imu(car, tmp_path):
    street = make_street(car, 0, StreetConfig(frames=1, width_px=100, height_px=40))
    assert open_sequence(write_recording(street, tmp_path / "one")).imu is None
