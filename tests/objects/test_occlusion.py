import numpy as np
import pytest

from meshslam.geometry import Pose, render
from meshslam.objects.occlusion import Occluders, Placed


@pytest.fixture
def placed(car):
    def make(x, y):
        pose = Pose.from_yaw(0.0, np.array([x, y, car.dimensions[2] / 2]))
        return Placed(pose, car.vertices, car.faces)

    return make


def test_without_estimates_the_lower_mask_is_before_the_higher(camera, box_detection, drive):
    low, high = box_detection(1, 0, (100, 60, 80, 70), 1), box_detection(2, 0, (150, 50, 80, 60), 2)
    occluders = Occluders(camera, {0: (low, high)}, {0: drive(1)[0]})
    assert not occluders.before(low).any()
    np.testing.assert_array_equal(occluders.before(high), low.mask())


def test_estimates_in_space_count_before_rows(camera, box_detection, drive, placed):
    low, high = box_detection(1, 0, (100, 60, 80, 70), 1), box_detection(2, 0, (150, 50, 80, 60), 2)
    here = {1: placed(20.0, 2.0), 2: placed(12.0, 1.0)}
    occluders = Occluders(camera, {0: (low, high)}, {0: drive(1)[0]}, here)
    np.testing.assert_array_equal(occluders.before(low), high.mask())
    assert not occluders.before(high).any()


@pytest.mark.parametrize("category", ["person", "truck", "bicycle", "traffic light"])
def test_detections_of_every_class_hide(camera, box_detection, drive, category):
    thing, behind = box_detection(1, 0, (100, 60, 20, 90), None, category), box_detection(2, 0, (90, 50, 80, 60), 2)
    occluders = Occluders(camera, {0: (thing, behind)}, {0: drive(1)[0]})
    np.testing.assert_array_equal(occluders.before(behind), thing.mask())


def test_what_is_far_away_in_the_image_or_in_another_frame_does_not_hide(camera, box_detection, drive):
    behind = box_detection(1, 0, (300, 50, 60, 50), 1)
    aside = box_detection(2, 0, (100, 60, 80, 90), 2)
    later = box_detection(3, 1, (300, 60, 60, 90), 3)
    occluders = Occluders(camera, {0: (behind, aside), 1: (later,)}, dict(enumerate(drive(2))))
    assert not occluders.before(behind).any()


def test_a_mapped_object_without_a_detection_hides_what_is_behind_it(camera, car, box_detection, drive, placed):
    pose, near, far = drive(1)[0], placed(10.0, 1.0), placed(20.0, 2.0)
    drawn = render(camera, [(pose.inverse() @ near.world_from_object, near.vertices, near.faces)]).mask
    behind = box_detection(1, 0, (270, 80, 40, 30), 1)
    occluders = Occluders(camera, {0: (behind,)}, {0: pose}, {1: far, 2: near})
    np.testing.assert_array_equal(occluders.before(behind), drawn)
    order = Occluders(camera, {0: (behind,)}, {0: pose}, {1: near, 2: far})
    assert not order.before(behind).any()


def test_a_mapped_object_behind_the_camera_hides_nothing(camera, box_detection, drive, placed):
    behind = box_detection(1, 0, (270, 80, 40, 30), 1)
    occluders = Occluders(camera, {0: (behind,)}, {0: drive(1)[0]}, {1: placed(20.0, 2.0), 2: placed(-9.0, 0.0)})
    assert not occluders.before(behind).any()


def test_of_many_mapped_objects_those_that_hide_are_found(camera, car, box_detection, drive):
    """The reference draws every object: the few that are looked at are all that matter."""
    rng = np.random.default_rng(3)
    pose, behind = drive(1)[0], box_detection(1, 0, (240, 60, 120, 70), 1)
    at = np.column_stack([rng.uniform(-30, 60, 200), rng.uniform(-40, 40, 200), np.full(200, car.dimensions[2] / 2)])
    there = {2 + k: Placed(Pose.from_yaw(rng.uniform(-3, 3), p), car.vertices, car.faces) for k, p in enumerate(at)}
    here = {1: Placed(Pose.from_yaw(0.0, np.array([30.0, 0.0, 0.8])), car.vertices, car.faces), **there}
    eye = pose.inverse()
    depth_m = (eye @ here[1].world_from_object).translation[2]
    every = [(eye @ thing.world_from_object, thing.vertices, thing.faces) for thing in there.values()]
    nearer = [one for one in every if -1.0 < one[0].translation[2] < depth_m]
    expected = render(camera, nearer).mask
    x, y, w, h = (int(v) for v in behind.bbox)
    found = Occluders(camera, {0: (behind,)}, {0: pose}, here).before(behind)
    assert found[y : y + h, x : x + w].any()
    np.testing.assert_array_equal(found[y : y + h, x : x + w], expected[y : y + h, x : x + w])


def test_other_places_differ_where_something_else_hides(camera, box_detection, drive, placed):
    low, high = box_detection(1, 0, (100, 60, 80, 70), 1), box_detection(2, 0, (150, 50, 80, 60), 2)
    alone = box_detection(3, 0, (400, 50, 80, 60), 3)
    none = Occluders(camera, {0: (low, high, alone)}, {0: drive(1)[0]})
    same = none.with_placed({1: placed(12.0, 1.0), 2: placed(20.0, 2.0), 3: placed(12.0, -3.0)})
    turned = none.with_placed({1: placed(20.0, 2.0), 2: placed(12.0, 1.0)})
    unseen = none.with_placed({3: placed(20.0, -5.0), 4: placed(8.0, -2.0)})
    for other, changed in ((same, set()), (turned, {1, 2}), (unseen, {3})):
        assert {d.id for d in (low, high, alone) if none.differs(other, d)} == changed
        for d in (low, high, alone):
            assert none.differs(other, d) == (not np.array_equal(none.before(d), other.before(d)))
