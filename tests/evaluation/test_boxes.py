import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshslam.evaluation.boxes import GroundBox, box_ious, clipped, polygon_area
from meshslam.geometry import Pose

CAR = np.array([4.0, 2.0, 1.5])


def box(x=0.0, y=0.0, z=0.0, yaw=0.0, dimensions=CAR):
    return GroundBox(np.array([x, y, z]), np.asarray(dimensions, float), yaw)


@pytest.mark.parametrize(
    ("other", "bev", "space"),
    [
        (box(), 1.0, 1.0),
        (box(x=2.0), 1 / 3, 1 / 3),  # half of each is shared
        (box(z=0.75), 1.0, 1 / 3),
        (box(yaw=np.pi), 1.0, 1.0),
        (box(yaw=np.pi / 2), 4 / 12, 4 / 12),  # a square of 2 m is shared
        (box(x=5.0), 0.0, 0.0),
        (box(x=4.0), 0.0, 0.0),  # they touch
        (box(z=2.0), 1.0, 0.0),
        (box(dimensions=(2, 1, 1.5)), 0.25, 0.25),
    ],
)
def test_known_answers(other, bev, space):
    assert box_ious(box(), other) == (pytest.approx(bev), pytest.approx(space))


numbers = st.floats(-3, 3)


@given(numbers, numbers, numbers, st.floats(-4, 4), st.integers(0, 99))
@settings(max_examples=60, deadline=None)
def test_overlap_is_that_of_points(x, y, z, yaw, seed):
    one, other = box(), box(x, y, z, yaw)
    world = Pose.from_yaw(seed, np.array([10.0, -4.0, seed]))
    moved = [GroundBox(world.transform(b.centre), b.dimensions, b.yaw_rad + world.yaw_rad) for b in (one, other)]
    found = box_ious(one, other)
    assert found == (pytest.approx(box_ious(other, one)[0]), pytest.approx(box_ious(other, one)[1]))
    assert found == (pytest.approx(box_ious(*moved)[0], abs=1e-9), pytest.approx(box_ious(*moved)[1], abs=1e-9))
    points = np.random.default_rng(seed).uniform(-4, 4, (40_000, 3))

    def inside(b):
        own = Pose.from_yaw(b.yaw_rad, b.centre).inverse().transform(points)
        return np.abs(own) <= b.dimensions / 2

    a, b = inside(one), inside(other)
    in_plan = [s[:, :2].all(axis=1) for s in (a, b)]
    shared = (in_plan[0] & in_plan[1]).mean() * 64
    assert polygon_area(clipped(one.corners(), other.corners())) == pytest.approx(shared, abs=0.6)  # five of its sigmas
    assert 0 <= found[1] <= found[0] + 1e-12 <= 1 + 1e-9
