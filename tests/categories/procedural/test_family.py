import numpy as np
import pytest

from meshslam.categories.keypoints import KEYPOINT_NAMES
from meshslam.categories.procedural.car import cardinal_spline
from meshslam.categories.procedural.styles import CLASSES, draw_car, draw_of_class
from meshslam.categories.template import middle_car


@pytest.fixture(params=range(len(CLASSES)), ids=[f"{i}-{c.style}" for i, c in enumerate(CLASSES)])
def car(request):
    return draw_of_class(CLASSES[request.param], np.random.default_rng(request.param))


def test_a_car_has_its_measures(car):
    """Rays along the axes leave the solid where length, width and height say."""
    grid = np.stack(np.meshgrid(np.linspace(-3.5, 3.5, 281), np.linspace(0, 1.2, 49), np.linspace(-0.2, 2.4, 131)), -1)
    points = grid.reshape(-1, 3)
    inside = points[car.field(points) < 0]
    assert np.ptp(inside[:, 0]) == pytest.approx(car.length, abs=0.08)
    assert inside[:, 2].max() == pytest.approx(car.height, abs=0.06)
    assert inside[:, 2].min() == pytest.approx(0, abs=0.04)
    assert car.width / 2 - 0.06 < inside[:, 1].max() < car.width / 2 + car.mirror_reach + 0.05


def test_the_solid_is_symmetric(car, rng):
    points = rng.uniform([-3, -1.2, -0.1], [3, 1.2, 2], (500, 3))
    np.testing.assert_array_equal(car.field(points), car.field(points * [1, -1, 1]))


def test_wheels_stand_on_the_ground_with_air_between_them(car):
    axle, wheel = car.wheelbase / 2, car.width / 2 - car.wheel_inset - car.tyre_width / 2
    low = car.clearance / 2
    under = np.array([[axle, wheel, 0.02], [-axle, wheel, 0.02], [0, 0, low], [axle, 0, low], [0, wheel, low]])
    np.testing.assert_array_equal(car.field(under) < 0, [True, True, False, False, False])


def test_key_points_lie_on_the_surface(car):
    points = car.keypoints()
    assert points.shape == (len(KEYPOINT_NAMES), 3)
    hubs = np.array(["wheel" in name for name in KEYPOINT_NAMES])
    assert np.abs(car.field(points[~hubs])).max() < 0.01
    assert np.abs(car.field(points[hubs])).max() < 0.12  # the body may cover the hub


def test_the_greenhouse_is_narrower_than_the_body(car):
    at = np.array([0.0])
    assert car.half_width(at, np.array([car.height - 0.1]))[0] < car.half_width(at, np.array([car.widest]))[0] - 0.08


def test_landmarks_are_the_same_list_on_every_car(car):
    landmarks, others = car.landmarks(), middle_car().landmarks()
    assert landmarks.shape == others.shape
    assert np.isfinite(landmarks).all()
    np.testing.assert_array_equal(np.sign(landmarks[:, 1]), np.sign(others[:, 1]))
    assert np.linalg.norm(landmarks - others, axis=1).max() < 2.5


def test_draws_follow_the_published_sizes():
    rng = np.random.default_rng(1)
    for kind in CLASSES:
        cars = [draw_of_class(kind, rng) for _ in range(60)]
        for field in ("length", "width", "height", "wheelbase"):
            mean, sigma = getattr(kind, field)
            assert np.mean([getattr(c, field) for c in cars]) == pytest.approx(mean, abs=0.6 * sigma)
    assert len({draw_car(rng).length for _ in range(20)}) == 20


def test_the_spline_passes_its_points(rng):
    points = np.stack([np.cos(np.arange(9) * 0.7), np.sin(np.arange(9) * 0.7)], 1) * rng.uniform(1, 2, (9, 1))
    curve = cardinal_spline(points, 0.5, samples=10)
    np.testing.assert_allclose(curve[::10], points, atol=1e-12)
    assert curve.shape == (90, 2)
