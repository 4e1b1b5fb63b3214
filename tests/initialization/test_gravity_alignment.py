import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.geometry import Camera, Pose
from meshslam.initialization.gravity_alignment import AlignmentConfig, BoxObservation, CameraMotion, align, levelled

CAMERA = Camera(width=1240, height=370, fx=720.0, fy=720.0, cx=610.0, cy=172.0)
LEVEL_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
HEIGHT_M, GRAVITY = 1.6, 9.81


def ride(rng, speed, pushing, bending):
    """A ride on a level road: its motions before gravity and velocity are known, its boxes, and what is true."""
    level_from_imu = Rotation.from_euler("ZYX", [0.0, *rng.normal(0, 0.3, 2)]).as_matrix()
    imu_from_camera = level_from_imu.T @ LEVEL_FROM_CAMERA
    velocity, down = np.array([speed, 0.0, 0.0]), np.array([0.0, 0.0, -GRAVITY])
    cars = {k: np.array([rng.uniform(15, 40), (-1) ** k * rng.uniform(3, 6), 0.75 - HEIGHT_M]) for k in range(4)}
    motions, observations = [], []
    for frame, t in enumerate(np.linspace(0, 2, 21)):
        heading, along = bending * t, speed * t + 0.5 * pushing * t * t
        eye = np.array([along, 0.5 * bending * t * along, 0.0])
        turned = Rotation.from_euler("z", heading).as_matrix() @ LEVEL_FROM_CAMERA
        gain = np.array([pushing * t, bending * speed * t, 0.0])
        offset = level_from_imu.T @ (eye - velocity * t - 0.5 * down * t * t)
        gain = level_from_imu.T @ (gain - down * t)
        motions.append(CameraMotion(t, level_from_imu.T @ turned, offset, gain))
        for k, place in cars.items():
            seen = Pose(turned, eye).inverse().transform(place)
            if seen[2] > 6:
                pixel = CAMERA.project(seen)
                near = seen[2] - AlignmentConfig().nearer_m
                observations.append(BoxObservation(k, frame, (pixel[0], pixel[1]), CAMERA.fy * 1.5 / near, 1.5))
    force = level_from_imu.T @ (np.array([pushing, bending * speed, 0.0]) - down)
    return motions, observations, force, level_from_imu.T @ down, level_from_imu.T @ velocity, imu_from_camera


@pytest.mark.parametrize(("speed", "pushing", "bending"), [(12.0, 0.0, 0.0), (5.0, 0.5, 0.0), (6.0, 0.0, 0.15)])
def test_gravity_and_velocity_come_out(speed, pushing, bending):
    motions, observations, force, down, velocity, _ = ride(np.random.default_rng(1), speed, pushing, bending)
    found = align(motions, observations, CAMERA, force, GRAVITY, HEIGHT_M, AlignmentConfig())
    tilt = np.degrees(np.arccos(found.gravity_m_s2 @ down / GRAVITY**2))
    assert tilt < 1.5
    assert np.linalg.norm(found.velocity_m_s - velocity) < 0.08 * speed
    assert np.linalg.norm(found.gravity_m_s2) == pytest.approx(GRAVITY)


def test_a_car_that_drives_does_not_count():
    motions, observations, force, _, velocity, _ = ride(np.random.default_rng(2), 10.0, 0.0, 0.0)
    before = align(motions, observations, CAMERA, force, GRAVITY, HEIGHT_M, AlignmentConfig()).velocity_m_s
    ahead = [BoxObservation(9, k, (600.0, 200.0), 55.0, 1.5) for k in range(21)]  # keeps its distance
    after = align(motions, observations + ahead, CAMERA, force, GRAVITY, HEIGHT_M, AlignmentConfig()).velocity_m_s
    assert np.linalg.norm(after - before) < 0.05 * np.linalg.norm(velocity)


def test_levelled_turns_down_to_minus_z_and_ahead_into_the_plane_of_x():
    for _ in range(20):
        down, ahead = np.random.default_rng().normal(size=(2, 3))
        turn = levelled(down, ahead)
        assert np.allclose(turn @ turn.T, np.eye(3))
        assert np.linalg.det(turn) > 0
        assert np.allclose(turn @ down / np.linalg.norm(down), [0, 0, -1])
        assert abs((turn @ ahead)[1]) < 1e-12
        assert (turn @ ahead)[0] > 0
