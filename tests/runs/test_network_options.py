"""What Python tells of a network, classes, detections and key points: as the command line does."""

import dataclasses
import json

import cv2
import numpy as np
import pytest
import trimesh

import meshslam
from meshslam.errors import ConfigError, SequenceError
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject
from meshslam.perception import load_segmenter
from meshslam.runs import InputConfig, map_run
from meshslam.sequences import write_sequence_folder
from tests.perception.test_networks import ADAPTER, own_network, painted
from tests.sequences.conftest import CAMERA, coco_document

FRAMES = 3
BALL = trimesh.creation.icosphere(1)
AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@pytest.fixture
def drive(tmp_path):
    poses = [Pose(AHEAD, np.array([0.5 * i, 0.0, 1.6])) for i in range(FRAMES)]
    folder = write_sequence_folder(tmp_path / "s", CAMERA, np.arange(FRAMES) * 0.1, world_from_camera=poses)
    (folder / "images").mkdir(exist_ok=True)
    for frame in range(FRAMES):
        cv2.imwrite(str(folder / "images" / f"{frame:06d}.png"), painted(CAMERA.height, CAMERA.width)[0])
    return folder


@pytest.fixture
def network(tmp_path):
    (tmp_path / "a.yaml").write_text(ADAPTER.replace("[person, car]", "[person, forklift]"))
    return {"segmenter": own_network(tmp_path / "net.onnx"), "adapter": tmp_path / "a.yaml"}


def test_an_adapter_and_class_names_are_arguments(drive, network):
    found = meshslam.map_drive(drive, **network, classes={"Forklift": "car", "person": "walker"}, keypoints=False)
    assert {d.category for d in found.detections.detections} == {"car", "walker"}
    assert any('"forklift" is read as "car"' in note for note in found.notes)
    assert {d.category for d in meshslam.map_drive(drive, **network).detections.detections} == {"forklift", "person"}


def test_key_points_are_switched(drive, network):
    told, steps = {**network, "classes": {"forklift": "car"}}, {False: set(), True: set()}
    for given, seen in steps.items():
        meshslam.map_drive(drive, **told, keypoints=given, progress=lambda step, *_, seen=seen: seen.add(step))
    assert steps[True] - steps[False] == {"key points"}


@pytest.mark.parametrize("is_open", [False, True])
def test_detections_of_a_file_take_the_place_of_a_network(drive, tmp_path, is_open):
    path = tmp_path / "d.json"
    path.write_text(json.dumps(coco_document(FRAMES)))
    given = meshslam.open_sequence(drive) if is_open else drive
    found = meshslam.map_drive(given, detections=path, keypoints=False)
    assert len(found.detections.detections) > 0
    with pytest.raises(SequenceError, match=r"none\.json: no such detection file"):
        meshslam.map_drive(given, detections=tmp_path / "none.json")


def test_objects_that_may_face_the_other_way_are_noted(drive, tmp_path, monkeypatch):
    path, mapped = tmp_path / "d.json", map_run.map_objects
    path.write_text(json.dumps(coco_document(FRAMES)))

    def doubtful(*given, **options):
        found = mapped(*given, **options)
        cars = Map(tuple(MapObject(i, "car", Pose.identity(), BALL.vertices, BALL.faces) for i in (4, 5)))
        return dataclasses.replace(found, map=cars, reversed_probabilities={4: 0.3, 5: 0.0, 6: 0.3})

    monkeypatch.setattr(map_run, "map_objects", doubtful)
    notes = meshslam.map_drive(drive, detections=path, keypoints=False).notes
    assert [note.split(":")[0] for note in notes if "front and rear may be exchanged" in note] == ["object 4"]


def test_an_adapter_without_a_network_is_an_error(drive, network, tmp_path):
    (tmp_path / "d.json").write_text(json.dumps(coco_document(FRAMES)))
    with pytest.raises(ConfigError, match=r"adapter: .* is read, no network: leave the adapter out"):
        meshslam.map_drive(drive, detections=tmp_path / "d.json", adapter=network["adapter"])
    camera = meshslam.open_sequence(drive).camera
    with pytest.raises(ConfigError, match="adapter: the segmenter is no file of a network"):
        meshslam.Slam(camera, segmenter="colour", adapter=network["adapter"])
    own = load_segmenter(network["segmenter"], adapter=network["adapter"])
    with pytest.raises(ConfigError, match="classes: the segmenter is no file of a network"):
        meshslam.Slam(camera, segmenter=own, classes={"forklift": "car"})


@pytest.mark.parametrize("classes", [["forklift=car"], "forklift=car", {"forklift": ""}])
def test_classes_of_another_kind_are_an_error(drive, network, classes):
    with pytest.raises(ConfigError, match="expected"):
        meshslam.map_drive(drive, **network, classes=classes)


def test_streams_read_adapter_and_class_names(drive, network):
    recording = meshslam.open_sequence(drive)
    slam = meshslam.Slam(recording.camera, **network, classes={"forklift": "car"}, by_odometry=True)
    found = slam._perception.process(0, recording.read_image(0))
    assert {d.category for d in found} >= {"car"}


def test_settings_of_a_recording_that_is_open_already_are_said(drive, network):
    config = meshslam.Config(input=InputConfig(frames="0:2"))
    found = meshslam.map_drive(meshslam.open_sequence(drive), **network, config=config)
    assert any("input.frames is not used, as the recording is open already" in note for note in found.notes)
    assert len(found.trajectory.times_s) == FRAMES
    assert len(meshslam.map_drive(drive, **network, config=config).trajectory.times_s) == 2
