"""Cars of several drives are fitted to the views of all together."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import Pose, voxel_iou
from meshslam.maps import Map
from meshslam.merging import MergingConfig, merge_drives
from tests.merging.conftest import camera_path


@pytest.fixture(scope="module")
def few(street):
    """Five cars, and the numbers of those that are close enough to be fitted."""
    return street(21, 5)


@pytest.fixture(scope="module")
def two_sides(few, drive_by, seen_cars, car):
    """One drive along each side; each knows the category's mean mesh only, roughly in place."""

    def make(off_m=0.0, numbers=(3,)):
        drives, worlds = [], []
        for k, y in enumerate((0.0, -8.5)):
            path = camera_path(18, y=y, step=1.5, start=-6.0)
            drive, world = drive_by(f"d{k}", few, k + 1, views=seen_cars(few, path), path=path, scale=0.5)
            mean = car.vertices - (car.vertices.max(0) + car.vertices.min(0)) / 2
            objects = [_rough(o, mean, off_m if k == 1 and o.id in numbers else 0.0) for o in drive.map.objects]
            drives.append(replace(drive, map=Map(tuple(objects))))
            worlds.append(world)
        return tuple(drives), worlds

    return make


def _rough(thing, vertices, off_m):
    """The mean mesh in its place, far off across where it says so."""
    pose = thing.world_from_object @ Pose(np.eye(3), np.array([0.3 * off_m, off_m, 0.0]))
    return replace(thing, vertices=vertices, world_from_object=pose, vertex_observed=None, mask_iou=0.8)


def iou(merged, car, pose, vertices):
    """Voxel IoU of the nearest merged car with the true one."""
    gap = [np.linalg.norm(o.world_from_object.translation - pose.translation) for o in merged.map.objects]
    thing = merged.map.objects[int(np.argmin(gap))]
    placed = (pose.inverse() @ thing.world_from_object).transform(thing.vertices)
    return voxel_iou(vertices, car.faces, placed, thing.faces)


def test_views_of_both_sides_make_a_better_mesh_than_fused_figures(two_sides, few, car):
    drives, worlds = two_sides()
    by_views, by_figures = (merge_drives(drives, MergingConfig(use_views=use)) for use in (True, False))
    better = [iou(by_views, car, worlds[0] @ few[n][0], few[n][1]) for n in (1, 3)]
    worse = [iou(by_figures, car, worlds[0] @ few[n][0], few[n][1]) for n in (1, 3)]
    assert np.mean(better) > 0.90
    assert np.mean(better) > np.mean(worse) + 0.05


def test_two_estimates_of_one_car_are_joined_where_one_car_explains_all_views(two_sides, few, car):
    drives, worlds = two_sides(off_m=1.2)
    apart = merge_drives(drives, MergingConfig(use_views=False))
    [one] = [c for c in merge_drives(drives).worlds[0].cars if any(v.number == 3 for v in c.visits)]
    assert sum(any(v.number == 3 for v in c.visits) for c in apart.worlds[0].cars) == 1  # told as moved, or one
    assert one.status == "parked"
    assert [v.status for v in one.visits] == ["seen", "seen"]
    true = worlds[0] @ few[3][0]
    assert np.linalg.norm(one.thing.world_from_object.translation - true.translation) < 0.25


def test_the_same_drives_give_the_same_bytes(two_sides, tmp_path):
    drives, _ = two_sides()
    for name in ("one", "other"):
        merge_drives(drives).map.save(tmp_path / name)
    assert (tmp_path / "one" / "map.json").read_bytes() == (tmp_path / "other" / "map.json").read_bytes()
