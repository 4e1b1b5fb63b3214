import numpy as np
import pytest

from meshslam.categories import VANS, draw_of_van, draw_van


@pytest.fixture(params=range(len(VANS)))
def van(request):
    return VANS[request.param]


def test_a_van_has_its_published_size_and_its_key_points_on_it(van, rng):
    shapes = [draw_of_van(van, rng) for _ in range(6)]
    for field in ("width", "height", "wheelbase"):
        mean, sigma = getattr(van.body, field)
        assert np.mean([getattr(s, field) for s in shapes]) == pytest.approx(mean, abs=1.5 * sigma)
    for shape in shapes:
        assert np.abs(shape.field(shape.keypoints()[4:])).max() < 0.02
        ends = shape.profile.min(0), shape.profile.max(0)
        np.testing.assert_allclose(ends, [[shape.rear, shape.clearance], [shape.front, shape.height]], atol=1e-9)


def test_key_points_of_glass_and_lamps_are_where_vans_carry_them(van, rng):
    """Glass ends at the height of the driver's eyes, however high the roof; tail lamps are lower than on cars."""
    for _ in range(6):
        shape = draw_of_van(van, rng)
        heights = shape.keypoints()[:, 2]
        assert heights[4:6] == pytest.approx(shape.height - shape.windshield_top, abs=0.06)
        assert heights[6:8] == pytest.approx(shape.height - shape.window_top, abs=0.06)
        assert heights[4:8].max() < 2.2
        assert heights[10:] == pytest.approx(shape.trunk_share * shape.height, abs=0.06)


def test_a_van_ends_upright_behind_a_short_nose(van, rng):
    for _ in range(6):
        shape = draw_of_van(van, rng)
        points = shape.keypoints()
        nose, tail = shape.front - points[4, 0], points[6, 0] - shape.rear
        assert tail < 0.45
        assert nose > tail


def test_the_same_seed_draws_the_same_van():
    assert draw_van(np.random.default_rng(3)) == draw_van(np.random.default_rng(3))
