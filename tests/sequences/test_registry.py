import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.sequences import LOADERS, Sequence, check_sequence, find_loader, open_sequence
from tests.sequences.conftest import CAMERA


def test_each_layout_is_found_from_its_path(folder, odometry, raw):
    assert [open_sequence(p).layout for p in (folder, odometry, raw)] == ["folder", "kitti-odometry", "kitti-raw"]


def test_exactly_one_loader_knows_each_layout(folder, odometry, raw):
    for path in (folder, odometry, raw):
        assert sum(loader.recognizes(path) for loader in LOADERS) == 1


def test_a_relative_path_and_dot_are_recognized(raw, monkeypatch):
    monkeypatch.chdir(raw)
    assert find_loader(raw.__class__(".")).name == "kitti-raw"


def test_an_unknown_folder_says_what_was_looked_for(tmp_path):
    with pytest.raises(SequenceError) as caught:
        open_sequence(tmp_path)
    assert all(loader.name in str(caught.value) for loader in LOADERS)
    assert [str(p) for p in check_sequence(tmp_path)] == [str(caught.value)]


@pytest.mark.parametrize(("name", "message"), [("missing", "no such folder"), ("file", "no known layout: the file")])
def test_a_path_that_is_no_folder_is_named(tmp_path, name, message):
    (tmp_path / "file").write_text("?")
    with pytest.raises(SequenceError, match=f"{name}: {message}"):
        open_sequence(tmp_path / name)
    assert [str(p) for p in check_sequence(tmp_path / name)] != []


def test_a_named_layout_is_taken_and_an_unknown_one_refused(folder, odometry):
    assert open_sequence(folder, layout="folder").layout == "folder"
    with pytest.raises(SequenceError, match=r"camera\.yaml: no such file"):
        open_sequence(odometry, layout="folder")
    with pytest.raises(
        SequenceError, match="unknown layout 'oxford', known are ros-bag, mcap, video, kitti-tracking, kitti-360, euroc"
    ):
        open_sequence(folder, layout="oxford")


def test_given_detections_take_the_place_of_the_folders_own(folder, raw, tmp_path):
    other = tmp_path / "mine.json"
    other.write_text((folder / "detections.json").read_text())
    assert open_sequence(folder, detections_path=other).detections_path == other
    assert open_sequence(raw, detections_path=other).detections_path == other
    with pytest.raises(SequenceError, match=r"nothing\.json: no such detection file"):
        open_sequence(folder, detections_path=tmp_path / "nothing.json")


def test_a_sequence_holds_one_entry_a_frame(tmp_path):
    with pytest.raises(SequenceError, match="2 frames but 3 times_s"):
        Sequence("s", "folder", tmp_path, CAMERA, (0, 1), np.zeros(3))
    with pytest.raises(SequenceError, match="no images, only detections"):
        Sequence("s", "folder", tmp_path, CAMERA, (0,), np.zeros(1)).read_image(0)


def test_an_empty_file_is_called_empty(tmp_path):
    (tmp_path / "drive.mcap").touch()
    with pytest.raises(SequenceError, match=r"drive\.mcap: the file is empty"):
        open_sequence(tmp_path / "drive.mcap")


def test_a_run_is_called_a_run(tmp_path):
    for name in ("manifest.json", "config.yaml", "camera.yaml"):
        (tmp_path / name).write_text("{}")
    with pytest.raises(SequenceError, match="is a run of meshslam, no recording"):
        open_sequence(tmp_path)
