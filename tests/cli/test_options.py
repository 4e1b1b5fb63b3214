"""What the flags of a command become."""

import inspect
from pathlib import Path

import pytest

import meshslam
from meshslam.cli.localize import localize
from meshslam.cli.map import map_
from meshslam.cli.options import _camera, with_input, with_keypoint_network
from meshslam.cli.slam import slam
from meshslam.errors import ConfigError
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


def test_a_camera_is_a_number_a_file_or_one_of_each():
    assert _camera([]) == {}
    assert _camera(["1"]) == {"camera": 1}
    assert _camera(["chain.yaml", "1"]) == {"camera": 1, "camera_file": Path("chain.yaml")}
    for given in (["1", "2"], ["a.yaml", "b.yaml"], ["1", "a.yaml", "2"]):
        with pytest.raises(ConfigError, match="give one number, one file, or one of each"):
            _camera(given)


IN_MEMORY = {"out", "overwrite", "json", "frames_in_report"}  # Python's results are no files
BY_ANOTHER_NAME = {  # the command line's to Python's
    "sequence": "drive",
    "camera": "camera_number",  # a number, or `camera`, a file
    "rate": "rate_hz",
    "topic": "topics",
    "from_": "from_s",
    "to": "to_s",
    "imu_time_offset": "imu_time_offset_s",
    "poses_time_offset": "poses_time_offset_s",
    "map_path": "map",
    "view": "log",  # what `open_run_log` gives
    "serve": "log",
    "rrd": "log",
    "mcap": "log",
    "colour": "log",
}
ELSEWHERE = {
    "tracker",
    "solver",
    "allow_outside",
    "live",
}  # settings of Config; Map.load(…, allow_outside=True); LiveSlam
OF_PYTHON_ALONE = {"path", "camera", "progress", "use_imu", "detections_path"}


@pytest.mark.parametrize(
    ("command", "function"), [(map_, meshslam.map_drive), (localize, meshslam.localize), (slam, meshslam.slam)]
)
def test_python_takes_what_the_command_line_takes(command, function):
    flags = set(inspect.signature(command).parameters) - IN_MEMORY
    named = {BY_ANOTHER_NAME.get(flag, flag) for flag in flags - ELSEWHERE}
    python = {*inspect.signature(function).parameters, *inspect.signature(meshslam.open_sequence).parameters}
    assert named - python == set(), "flags that Python lacks"
    assert python - named - OF_PYTHON_ALONE == set(), "arguments that the command line lacks"


def test_streams_take_what_is_told_of_a_network():
    network = {"segmenter", "adapter", "classes"}
    assert network <= set(inspect.signature(meshslam.Slam).parameters)
    assert network <= set(inspect.signature(meshslam.Localizer).parameters)
