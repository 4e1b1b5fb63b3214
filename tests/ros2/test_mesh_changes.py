"""Which meshes are shown again."""

from dataclasses import replace

import numpy as np

from meshslam.geometry import Pose
from meshslam.maps import Map
from meshslam.ros2.mesh_changes import ShownObjects


def moved(thing, by_m):
    return replace(thing, world_from_object=Pose(np.eye(3), np.array([by_m, 0, 0])) @ thing.world_from_object)


def test_a_mesh_is_shown_once_until_it_changes(car):
    shown = ShownObjects()
    assert shown.update(Map((car,))) == ([car], [])
    assert shown.update(Map((car,))) == ([], [])
    assert shown.update(Map((moved(car, 0.004),))) == ([], [])
    farther = moved(car, 0.02)
    assert shown.update(Map((farther,))) == ([farther], [])


def test_small_steps_add_up(car):
    """What counts is the change since the mesh was shown, not since the last look."""
    shown = ShownObjects()
    shown.update(Map((car,)))
    counts = [len(shown.update(Map((moved(car, 0.004 * step),)))[0]) for step in range(1, 10)]
    assert sum(counts) == 3


def test_changed_shape_and_sigma_are_shown(car):
    shown = ShownObjects()
    shown.update(Map((car,)))
    wider = replace(car, vertices=car.vertices * [1.0, 1.05, 1.0])
    assert shown.update(Map((wider,)))[0] == [wider]
    surer = replace(wider, vertex_sigma_m=0.5 * wider.vertex_sigma_m)
    assert shown.update(Map((surer,)))[0] == [surer]
    unknown = replace(surer, vertex_sigma_m=None)
    assert shown.update(Map((unknown,)))[0] == [unknown]


def test_what_went_is_deleted_by_the_category_it_was_shown_with(car):
    shown, other = ShownObjects(), replace(car, id=9)
    shown.update(Map((car, other)))
    assert shown.update(Map((other,))) == ([], [("car", 7)])
    renamed = replace(other, category="truck")
    assert shown.update(Map((renamed,))) == ([renamed], [("car", 9)])
    assert list(shown.all()) == [renamed]
