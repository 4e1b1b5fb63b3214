"""Segmentation that is cut short goes on with the frames that are left, and gives what it gives in one go."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from meshslam.geometry import Camera
from meshslam.maps import FRAMES, RunDirectory
from meshslam.perception import KeypointConfig, SegmenterConfig, write_detections
from meshslam.runs import Config, InputConfig, Outlet
from meshslam.runs import perception as stage
from meshslam.sequences import open_sequence, write_sequence_folder
from tests.perception.networks import colour_network


@pytest.fixture
def recording(tmp_path):
    images = np.zeros((4, 64, 64, 3), np.uint8)
    for i, image in enumerate(images):
        image[10 : 40 + 3 * i, 8:40] = (0, 0, 255)
    folder = tmp_path / "drive"
    write_sequence_folder(folder, Camera(64, 64, 50.0, 50.0, 31.5, 31.5), np.arange(4) / 10, images=list(images))
    return open_sequence(folder)


@pytest.fixture
def config(tmp_path):
    network = colour_network(tmp_path / "net.onnx")
    settings = SegmenterConfig(zoom=1.0, min_area_px=20)
    chosen = InputConfig(segmenter=str(network))
    return Config(input=chosen, segmentation=settings, keypoints=KeypointConfig(enabled=False))


@pytest.fixture
def run(tmp_path):
    return RunDirectory.start(tmp_path / "run", "", "1.0")


@pytest.fixture
def segmented(monkeypatch):
    """The frames that the network has looked at."""
    seen = []

    def detect(frames, segmenter, *rest):
        [(frame, _)] = frames = list(frames)
        seen.append(frame)
        return genuine(frames, segmenter, *rest)

    genuine = stage.detect
    monkeypatch.setattr(stage, "detect", detect)
    return seen


def perceived(recording, config, run, progress=None):
    outlet = Outlet() if progress is None else Outlet(progress)
    return write_detections(stage.perceive(recording, config, outlet, run).detections)


def stop_after(count):
    def progress(_step, done, _total):
        if done == count:
            raise KeyboardInterrupt

    return progress


def test_frames_that_are_done_are_not_looked_at_again(recording, config, run, segmented):
    with pytest.raises(KeyboardInterrupt):
        perceived(recording, config, run, stop_after(2))
    assert segmented == [0, 1]
    found = perceived(recording, config, run)
    assert segmented == [0, 1, 2, 3]
    other = RunDirectory.start(run.folder.with_name("other"), "", "1.0")
    assert perceived(recording, config, other) == found
    assert found.count(b"image_id") == 4


def test_a_frame_whose_image_changed_is_looked_at_again(recording, config, run, segmented):
    perceived(recording, config, run)
    image = recording.read_image(2)
    image[:30] = 0
    cv2.imwrite(str(recording.image_paths[2]), image)
    perceived(recording, config, run)
    assert segmented == [0, 1, 2, 3, 2]


def test_another_network_or_setting_looks_at_all_frames_again(recording, config, run, segmented, tmp_path):
    perceived(recording, config, run)
    perceived(recording, replace(config, segmentation=replace(config.segmentation, min_area_px=21)), run)
    assert len(segmented) == 8
    colour_network(tmp_path / "net.onnx", score=0.8)
    perceived(recording, config, run)
    assert len(segmented) == 12


def test_a_frame_file_that_is_cut_off_is_made_again(recording, config, run, segmented):
    before = perceived(recording, config, run)
    file = min((run.folder / FRAMES).iterdir())
    file.write_bytes(file.read_bytes()[:50])
    assert perceived(recording, config, run) == before
    assert segmented == [0, 1, 2, 3, 0]


def test_a_finished_run_keeps_no_frames(recording, config, run):
    perceived(recording, config, run)
    assert len(list((run.folder / FRAMES).iterdir())) == 4
    run.finish()
    assert not (run.folder / FRAMES).exists()
