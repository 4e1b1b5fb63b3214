"""A run's folder, read for an export."""

import pytest

from meshslam.errors import MapError
from meshslam.exporting import FinishedRun
from meshslam.perception import write_detections
from meshslam.sequences import camera_yaml
from tests.exporting.conftest import CAMERA, FRAMES


@pytest.fixture
def folder(run, tmp_path):
    """A run's folder as `meshslam slam` leaves it."""
    run.scene.save(tmp_path)
    run.path.save(tmp_path / "trajectory.tum")
    run.estimate.save(tmp_path / "trajectory.csv")
    (tmp_path / "detections.json").write_bytes(write_detections(run.detections))
    (tmp_path / "camera.yaml").write_text(camera_yaml(CAMERA))
    return tmp_path


def test_a_folder_is_read_whole(folder, run):
    found = FinishedRun.load(folder)
    assert (found.frame_ids, found.camera, list(found.scene)) == (FRAMES, CAMERA, list(run.scene))
    assert [d.track_id for d in found.found_at(3)] == [d.track_id for d in run.found_at(3)]
    assert found.image_name(0) == "0000000020.jpg"
    assert not found.notes


def test_without_uncertainty_frames_are_those_of_the_detections(folder):
    (folder / "trajectory.csv").unlink()
    assert FinishedRun.load(folder).frame_ids == FRAMES
    (folder / "detections.json").unlink()
    found = FinishedRun.load(folder)
    assert found.frame_ids == tuple(range(len(FRAMES)))
    assert "counted from 0" in found.notes[0]


def test_a_run_without_a_map_of_its_own_says_so(folder):
    (folder / "map.json").unlink()
    found = FinishedRun.load(folder)
    assert not len(found.scene)
    assert "no map.json" in found.notes[0]


def test_a_folder_that_is_no_run_is_named(tmp_path):
    with pytest.raises(MapError, match=r"no finished run: it holds no trajectory\.tum"):
        FinishedRun.load(tmp_path)
