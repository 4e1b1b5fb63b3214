"""What a report shows of the truth."""

from types import SimpleNamespace

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject, Trajectory
from meshslam.runs.truth import shown_truth


def car_at(number, x):
    car = load_category("car")
    return MapObject(number, "car", Pose.from_yaw(0.0, [x, 0.0, 0.8]), car.vertices, car.faces)


@pytest.fixture
def recording(tmp_path):
    """Three frames, the truth of the first two of them, and two true cars."""
    times = np.array([0.0, 0.1, 0.2])
    path = tuple(Pose.from_yaw(0.0, [x, 0.0, 1.6]) for x in (0.0, 1.0))
    (tmp_path / "groundtruth.tum").write_bytes(Trajectory(times[:2], path).to_tum())
    Map((car_at(1, 10.0), car_at(2, 30.0))).save(tmp_path / "true")
    (tmp_path / "true" / "map.json").rename(tmp_path / "true" / "objects.json")
    for name in ("objects.json", "objects"):
        (tmp_path / "true" / name).rename(tmp_path / name)
    return SimpleNamespace(root=tmp_path, times_s=times)


def test_errors_are_of_each_frame_that_has_a_truth(recording):
    turned = tuple(Pose.from_yaw(0.1, [x, 0.3, 1.6]) for x in (0.0, 1.0, 2.0))
    shown = shown_truth(recording, None, {"estimate": turned, "IMU alone": ()})
    assert list(shown.errors) == ["estimate"]
    np.testing.assert_allclose(shown.errors["estimate"][:2], [[0.3, np.degrees(0.1)]] * 2, atol=1e-6)
    assert np.isnan(shown.errors["estimate"][2]).all()
    assert len(shown.path["truth"]) == 2
    assert shown.objects == ()  # the map was given


def test_true_objects_are_matched_or_missed(recording):
    shown = shown_truth(recording, Map((car_at(7, 10.2),)), {})
    found, missed = shown.objects
    assert (found.id, found.estimated_id, missed.id, missed.estimated_id) == (1, 7, 2, None)
    assert found.centre_error_m == pytest.approx(0.2, abs=1e-4)
    assert 0.5 < found.voxel_iou < 1
    assert missed.centre_error_m is None


def test_without_truth_nothing_is_shown(recording, tmp_path_factory):
    bare = replace_root(recording, tmp_path_factory.mktemp("bare"))
    shown = shown_truth(bare, Map((car_at(7, 10.2),)), {"estimate": ()})
    assert (shown.path, shown.objects, shown.errors) == ({}, (), {})


def replace_root(recording, root):
    return SimpleNamespace(**{**vars(recording), "root": root})
