"""What the flags of a command become."""

from pathlib import Path

import pytest

from meshslam.cli.options import with_input, with_keypoint_network
from meshslam.runs.config import Config


def test_files_are_kept_by_their_whole_paths(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    chosen = with_input(
        Config(), sequence=Path("drive"), map=Path("run"), segmenter="net.onnx", category="tram.npz", camera=3
    ).input
    assert chosen.sequence == str(tmp_path / "drive")
    assert chosen.map == str(tmp_path / "run")
    assert chosen.segmenter == str(tmp_path / "net.onnx")
    assert chosen.category == str(tmp_path / "tram.npz")
    assert chosen.camera == 3


def test_names_of_the_store_and_of_shipped_categories_stay_names(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    chosen = with_input(Config(), segmenter="yolov5n-seg", category="bus").input
    assert (chosen.segmenter, chosen.category) == ("yolov5n-seg", "bus")
    Path("yolov5n-seg").touch()
    assert with_input(Config(), segmenter="yolov5n-seg").input.segmenter == str(tmp_path / "yolov5n-seg")


def test_what_is_not_given_stays_as_the_configuration_has_it():
    before = with_input(Config(), layout="folder", segmenter="yolov5n-seg")
    assert with_input(before, layout=None, segmenter=None) == before


@pytest.mark.parametrize("given", [True, False, None])
def test_the_network_of_key_points_is_switched(given):
    before = Config()
    expected = before.keypoints.enabled if given is None else given
    assert with_keypoint_network(before, given).keypoints.enabled is expected
