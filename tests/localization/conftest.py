"""A small street with known cars, seen by a camera that an IMU goes with."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from meshslam.categories import load_category
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject
from meshslam.sequences import ImuSamples, InitialState, Sequence
from meshslam.simulation import ObserverConfig, StreetConfig, make_street, observe

RATE_HZ = 100.0
GRAVITY = np.array([0.0, 0.0, 9.81])
# the IMU looks forward, left, up; the camera sits 1 m before it
IMU_FROM_CAMERA = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([1.0, 0.1, 0.7]))


def samples_of(world_from_imu, times_s):
    """What an ideal IMU reads along a path, which is a function of time."""
    step = 1e-4
    rates, forces = [], []
    for t in times_s:
        before, now, after = (world_from_imu(t + k * step) for k in (-1, 0, 1))
        turn = before.rotation.T @ after.rotation / (2 * step)
        rates.append([turn[2, 1], turn[0, 2], turn[1, 0]])
        pull = (after.translation - 2 * now.translation + before.translation) / step**2
        forces.append(now.rotation.T @ (pull + GRAVITY))
    return ImuSamples(np.asarray(times_s), np.array(rates), np.array(forces))


@pytest.fixture(scope="session")
def street():
    small = StreetConfig(frames=16, width_px=560, height_px=180, focal_px=330.0, cars_each_side=3)
    return make_street(load_category("car"), 4, small)


@pytest.fixture(scope="session")
def seen(street):
    found, truth = observe(street, ObserverConfig())
    return found.with_tracks(truth)


@pytest.fixture(scope="session")
def scene(street):
    parked = [car for car in street.cars if not car.moves]
    return Map(tuple(MapObject(c.id, c.category, c.start, c.vertices, c.faces, keypoints=c.keypoints) for c in parked))


@pytest.fixture(scope="session")
def drive(street, tmp_path_factory):
    """The street as a sequence with a noisy IMU, and a start that is known."""
    times, poses = street.times_s, street.world_from_camera
    placed = [pose @ IMU_FROM_CAMERA.inverse() for pose in poses]
    turns = RotationSpline(times, Rotation.from_matrix([pose.rotation for pose in placed]))
    places = CubicSpline(times, [pose.translation for pose in placed])
    eyes = CubicSpline(times, [pose.translation for pose in poses])
    at = np.arange(times[0], times[-1] + 0.005, 1 / RATE_HZ)
    ideal = samples_of(lambda t: Pose(turns(t).as_matrix(), places(t)), at)
    rng = np.random.default_rng(3)
    rate = ideal.angular_rate_rad_s + rng.normal(0, 1e-3, (len(at), 3)) + [1e-3, -1e-3, 1e-3]
    force = ideal.specific_force_m_s2 + rng.normal(0, 0.05, (len(at), 3)) + [0.08, -0.05, 0.05]
    imu, velocity = ImuSamples(at, rate, force), eyes(times[0], 1)
    return Sequence(
        name="street",
        layout="folder",
        root=tmp_path_factory.mktemp("street"),
        camera=street.camera,
        frame_ids=tuple(range(len(times))),
        times_s=times,
        imu=imu,
        imu_from_camera=IMU_FROM_CAMERA,
        initial_state=InitialState(float(times[0]), poses[0], velocity),
        height_above_ground_m=street.camera_height_m,
    )


def errors_m(estimate, truth):
    return np.array([np.linalg.norm(a.translation - b.translation) for a, b in zip(estimate, truth, strict=True)])
