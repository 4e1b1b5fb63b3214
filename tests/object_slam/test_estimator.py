import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.localization import LocalizationConfig
from meshslam.object_slam import SlamConfig, slam_path
from meshslam.objects import MappingConfig
from tests.fixtures.imu_street import errors_m


@pytest.fixture(scope="module")
def found(drive, seen):
    quick = SlamConfig(min_baseline_m=2.0)
    return slam_path(drive, seen, load_category("car"), LocalizationConfig(), quick, MappingConfig())


def test_every_frame_has_a_pose_and_the_path_holds(found, drive, street):
    assert len(found.world_from_camera) == len(drive)
    truth = street.world_from_camera
    length = np.linalg.norm(np.diff([p.translation for p in truth], axis=0), axis=1).sum()
    assert errors_m(found.world_from_camera, truth)[-1] < 0.02 * length


def test_parked_cars_are_in_the_graph_and_the_one_that_drives_is_not(found):
    assert found.figures["objects_in_graph"] >= 2
