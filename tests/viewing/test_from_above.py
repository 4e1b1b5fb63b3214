import numpy as np
import pytest

from meshslam.viewing.from_above import ellipse, footprint, position_covariance, round_length_m


@pytest.mark.parametrize("longest", [0.0123, 0.99, 1.0, 4.9, 5.0, 99.0, 12345.0])
def test_round_lengths(longest):
    length = round_length_m(longest)
    assert length <= longest * (1 + 1e-9) < 2.51 * length
    assert f"{length:e}"[0] in "125"


def test_a_footprint_holds_every_vertex_and_no_more(cars, rng):
    for thing in cars.objects:
        hull, flat = footprint(thing), thing.vertices_in_world[:, :2]
        for direction in rng.normal(size=(40, 2)):
            assert (hull @ direction).max() == pytest.approx((flat @ direction).max(), abs=1e-4)


def test_covariances_turn_with_the_object(make_car):
    thing = make_car(1, 8.0, 3.0, 0.7, pose_covariance=np.diag([0.5, 0.2, 0.1, 0.1, 0.1, 0.1]) ** 2)
    rotation = thing.world_from_object.rotation
    expected = rotation @ np.diag([0.25, 0.04, 0.01]) @ rotation.T
    np.testing.assert_allclose(position_covariance(thing), expected, atol=1e-12)
    long, short, angle = ellipse(position_covariance(thing))
    assert (long, short) == pytest.approx((0.5, 0.2))
    assert np.tan(angle) == pytest.approx(np.tan(0.7))


def test_what_is_not_known_has_no_covariance(make_car):
    assert position_covariance(make_car(1, 8.0, 3.0, pose_covariance=None)) is None
