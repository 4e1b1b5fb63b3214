import numpy as np
import pytest

from tests.fixtures.imu_street import errors_m, slammed


@pytest.fixture(scope="module")
def found(drive, seen):
    return slammed(drive, seen)


def test_every_frame_has_a_pose_and_the_path_holds(found, drive, street):
    assert len(found.trajectory.world_from_camera) == len(drive)
    truth = street.world_from_camera
    length = np.linalg.norm(np.diff([p.translation for p in truth], axis=0), axis=1).sum()
    assert errors_m(found.trajectory.world_from_camera, truth)[-1] < 0.02 * length


def test_parked_cars_are_in_the_graph_and_the_one_that_drives_is_not(found):
    assert found.figures["objects_in_graph"] >= 2
