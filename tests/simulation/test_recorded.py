import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.sequences.tum import format_tum
from meshslam.simulation import PathFiles, StreetConfig, recorded_street, shapes_of, simulated_imu
from meshslam.simulation.motion import IMU_FROM_CAMERA, ImuNoise
from meshslam.simulation.street import FORWARD_FROM_CAMERA, street_camera

SMALL = StreetConfig(frames=12, cars_each_side=3, moving_cars=0)
TILT = Rotation.from_euler("xyz", [3.0, -5.0, 40.0], degrees=True).as_matrix()


def drive(count=30):
    """A bend to the left and uphill."""
    times = 100.0 + 0.1 * np.arange(count)
    headings = 0.02 * np.arange(count)
    steps = np.column_stack([np.cos(headings), np.sin(headings), np.full(count, 0.03)])
    places = np.cumsum(steps, axis=0)
    rotations = [Pose.from_yaw(h, np.zeros(3)).rotation @ FORWARD_FROM_CAMERA for h in headings]
    return times, tuple(Pose(r, p) for r, p in zip(rotations, places, strict=True))


def tilted(poses):
    turn = Pose(TILT, np.array([5.0, 6.0, 7.0]))
    return tuple(turn @ pose for pose in poses)


def files(folder, times, poses, imu=None, **more):
    (folder / "poses.tum").write_text(format_tum(times, poses))
    if imu is not None:
        rows = np.column_stack([imu.times_s, imu.angular_rate_rad_s, imu.specific_force_m_s2])
        lines = ["timestamp,wx,wy,wz,ax,ay,az"] + [",".join(map(str, row)) for row in rows.tolist()]
        (folder / "imu.csv").write_text("\n".join(lines) + "\n")
        (folder / "camera_from_imu.json").write_text(json.dumps(IMU_FROM_CAMERA.inverse().matrix.tolist()))
        more |= {"imu": folder / "imu.csv"}
    return PathFiles(folder / "poses.tum", **more)


def street_of(car, found):
    return recorded_street(shapes_of(car, 1.0), 0, SMALL, found, street_camera(SMALL))


def test_the_camera_drives_the_given_path_with_the_road_beneath_it(car, tmp_path):
    times, poses = drive()
    street = street_of(car, files(tmp_path, times, poses, start=4))
    np.testing.assert_allclose(street.times_s, times[4:16])
    first = poses[4].inverse()
    for mine, given in zip(street.world_from_camera, poses[4:16], strict=True):
        relative = street.world_from_camera[0].inverse() @ mine
        np.testing.assert_allclose(relative.matrix, (first @ given).matrix, atol=1e-6)
        along, aside = street.road.coordinates(mine.translation[None])
        assert aside[0] == pytest.approx(-SMALL.lane_m, abs=0.06)
        road = street.road.point(float(along[0]), float(aside[0]))
        assert mine.translation[2] - road[2] == pytest.approx(SMALL.camera_height_m, abs=0.03)


def test_a_recorded_imu_turns_the_world_upright(car, tmp_path):
    times, poses = drive()
    imu = simulated_imu(times, poses, IMU_FROM_CAMERA, ImuNoise(), np.random.default_rng(0)).samples
    street = street_of(car, files(tmp_path, times, tilted(poses), imu))
    np.testing.assert_allclose(street.imu.imu_from_camera.matrix, IMU_FROM_CAMERA.matrix, atol=1e-9)
    up = np.array([pose.rotation[2] for pose in street.world_from_camera])  # the world's up in the camera
    expected = np.array([pose.rotation[2] for pose in poses[:12]])
    assert np.degrees(np.arccos(np.clip((up * expected).sum(1), -1, 1))).max() < 0.5
    assert street.imu.samples.times_s[0] >= times[0] - 0.021
    assert street.imu.samples.times_s[-1] <= times[11] + 0.021
    ahead = street.world_from_camera[1].translation - street.world_from_camera[0].translation
    np.testing.assert_allclose(street.imu.velocity_in_world, ahead / 0.1, atol=0.15)


def test_no_car_stands_in_the_cameras_way(car, tmp_path):
    times, poses = drive()
    street = street_of(car, files(tmp_path, times, poses))
    path = np.array([pose.translation[:2] for pose in street.world_from_camera])
    for body in street.cars:
        away = np.linalg.norm(path - body.start.translation[:2], axis=1).min()
        assert away > body.body.dimensions[1] / 2 + 0.8


def test_what_is_missing_is_said(car, tmp_path):
    times, poses = drive()
    with pytest.raises(SequenceError, match="start"):
        street_of(car, files(tmp_path, times, poses, start=29))
    (tmp_path / "00.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 5)
    with pytest.raises(SequenceError, match="--times"):
        street_of(car, PathFiles(tmp_path / "00.txt"))
    imu = simulated_imu(times + 500.0, poses, IMU_FROM_CAMERA, ImuNoise(), np.random.default_rng(0)).samples
    with pytest.raises(SequenceError, match="do not overlap"):
        street_of(car, files(tmp_path, times, poses, imu))
    (tmp_path / "camera_from_imu.json").unlink()
    with pytest.raises(SequenceError, match="--imu-from-camera"):
        street_of(car, PathFiles(tmp_path / "poses.tum", imu=tmp_path / "imu.csv"))
