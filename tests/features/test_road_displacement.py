import cv2
import numpy as np
import pytest

from meshslam.features.road_displacement import RoadConfig, road_displacement_m, road_normal
from meshslam.geometry import Camera, Pose, RoadTexture, exp_so3
from tests.reference import road_texture

CAMERA = Camera(width=620, height=190, fx=360.0, fy=360.0, cx=305.0, cy=80.0)
LEVEL_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
HEIGHT_M = 1.5
FREE = np.ones((190, 620), np.uint8)


def drawn(world_from_camera, texture, cell_m=0.04):
    """The road z = -height with a texture on it."""
    v, u = np.mgrid[0:190, 0:620]
    rays = CAMERA.rays(np.stack([u.ravel(), v.ravel()], 1).astype(float)) @ world_from_camera.rotation.T
    eye = world_from_camera.translation
    far = np.where(rays[:, 2] < -1e-3, (-HEIGHT_M - eye[2]) / np.minimum(rays[:, 2], -1e-3), 1e3)
    at = (eye + rays * far[:, None])[:, :2] / cell_m + [0.0, 400.0]
    grid = at.reshape(190, 620, 2).astype(np.float32)
    return cv2.remap(texture, grid[..., 0], grid[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)


@pytest.fixture(scope="module")
def texture():
    noise = np.random.default_rng(3).normal(128, 60, (800, 1000)).astype(np.float32)
    return np.clip(cv2.GaussianBlur(noise, (0, 0), 2.0) * 3 - 256, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("way_m", [0.8, 1.3])
@pytest.mark.parametrize("believed", [0.85, 1.1])
def test_the_way_is_found_whatever_was_believed(texture, way_m, believed):
    """Cameras pitched by 1 degree that turn by half a degree between the images."""
    pitched = LEVEL_FROM_CAMERA @ exp_so3(np.array([-0.017, 0.0, 0.0]))
    one = Pose(pitched, np.zeros(3))
    other = Pose(pitched @ exp_so3(np.array([0.0, 0.009, 0.0])), np.array([way_m, 0.02, 0.0]))
    images = drawn(one, texture), drawn(other, texture)
    thought = Pose(other.rotation, believed * other.translation)
    up = np.array([0.0, 0.0, 1.0])
    found = road_displacement_m(images, FREE, (one, thought), up, HEIGHT_M, CAMERA, RoadConfig())
    assert found == pytest.approx(way_m, rel=0.015)


def test_a_road_without_texture_tells_nothing(texture):
    one, other = (Pose(LEVEL_FROM_CAMERA, np.array([x, 0.0, 0.0])) for x in (0.0, 1.0))
    flat = np.full((190, 620), 90, np.uint8)
    up, config = np.array([0.0, 0.0, 1.0]), RoadConfig()
    assert road_displacement_m((flat, flat), FREE, (one, other), up, HEIGHT_M, CAMERA, config) is None
    hidden = np.zeros_like(FREE)
    image = drawn(one, texture)
    assert road_displacement_m((image, image), hidden, (one, other), up, HEIGHT_M, CAMERA, config) is None


def test_the_road_lies_along_the_path():
    slope = np.array([1.0, 0.0, 0.05]) / np.hypot(1.0, 0.05)
    normal = road_normal([k * slope for k in range(15)], RoadConfig())
    assert normal @ slope == pytest.approx(0.0, abs=1e-12)
    assert normal[1] == pytest.approx(0.0)
    assert normal[2] > 0.99
    assert road_normal([k * slope for k in range(5)], RoadConfig()) is None


@pytest.mark.parametrize("seed", range(4))
def test_correlations_are_those_of_the_slow_twin(texture, seed):
    random = np.random.default_rng(seed)
    one = Pose(LEVEL_FROM_CAMERA @ exp_so3(random.normal(0, 0.01, 3)), np.zeros(3))
    moved = Pose(LEVEL_FROM_CAMERA @ exp_so3(random.normal(0, 0.01, 3)), np.array([1.1, 0.05, 0.01]))
    images, free = (drawn(one, texture), drawn(moved, texture)), (random.random(FREE.shape) < 0.8).astype(np.uint8)
    patch = {"up": moved.rotation.T @ [0.0, 0.0, 1.0], "height_m": HEIGHT_M, "aside_m": 1.6}
    patch |= {"depths_m": (5.0, 14.0), "step_px": int(random.integers(1, 4))}
    lengths = np.array([*np.linspace(0.5, 2.0, 20), 30.0, -30.0])
    between = one.inverse() @ moved
    found = RoadTexture(CAMERA, images, free, between, **patch).correlations(lengths)
    expected = road_texture.correlations(CAMERA, images, free, between, lengths, **patch)
    assert found == pytest.approx(expected, abs=1e-4)
    assert expected.max() > 0.9
    assert expected[-1] == -1.0
