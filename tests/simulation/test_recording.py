import hashlib
import json

import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.evaluation import read_truth
from meshslam.geometry import mask_iou
from meshslam.maps import Map
from meshslam.perception import read_detections
from meshslam.sequences import check_sequence, open_sequence
from meshslam.simulation import EXACT, ObserverConfig, StreetConfig, make_street, observe, render_image, write_recording
from meshslam.simulation.recording import roughen
from meshslam.simulation.render import draw


@pytest.fixture(scope="module")
def folder(street, tmp_path_factory):
    return write_recording(street, tmp_path_factory.mktemp("street") / "a")


def contents(folder):
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_the_same_street_gives_the_same_bytes(street, folder, tmp_path):
    assert contents(write_recording(street, tmp_path / "b")) == contents(folder)


def test_the_folder_is_a_sound_sequence(street, folder):
    assert check_sequence(folder) == []
    recording = open_sequence(folder)
    assert len(recording) == len(street.times_s)
    assert recording.height_above_ground_m == street.camera_height_m
    for mine, theirs in zip(recording.world_from_camera, street.world_from_camera, strict=True):
        np.testing.assert_allclose(mine.matrix, theirs.matrix, atol=1e-8)
    np.testing.assert_array_equal(recording.read_image(2), render_image(street, 2))


def test_the_truth_holds_the_parked_cars_as_they_are(street, folder):
    truth = read_truth(folder)
    parked = [car for car in street.cars if not car.moves]
    assert [thing.id for thing in truth.objects.objects] == [car.id for car in parked]
    for thing, car in zip(truth.objects.objects, parked, strict=True):
        np.testing.assert_allclose(thing.vertices_in_world, car.start.transform(car.vertices), atol=1e-6)
    ids = {a["id"] for a in json.loads((folder / "detections.json").read_text())["annotations"]}
    assert set(truth.object_of_annotation) == ids
    assert not any("track_id" in a for a in json.loads((folder / "detections.json").read_text())["annotations"])
    assert {car.id for car in street.cars if car.moves} <= set(truth.object_of_annotation.values())
    for mine, theirs in zip(truth.path.world_from_camera, street.world_from_camera, strict=True):
        np.testing.assert_allclose(mine.matrix, theirs.matrix, atol=1e-8)


def test_exact_masks_are_the_pixels_that_are_drawn_and_share_none(street):
    found, truth = observe(street, EXACT)
    number = {car.id: i for i, car in enumerate(street.cars)}
    for frame, detections in found.by_frame().items():
        drawn = draw(street, frame).object_index
        for detection in detections:
            np.testing.assert_array_equal(detection.mask(), drawn == number[truth[detection.id]])


def test_exact_key_points_project_where_they_are_and_hidden_ones_are_left_out(street):
    found, truth = observe(street, EXACT)
    by_id = {car.id: car for car in street.cars}
    hidden = 0
    for detection in found.detections:
        car, frame = by_id[truth[detection.id]], detection.frame
        camera_from_object = street.world_from_camera[frame].inverse() @ car.at(float(street.times_s[frame]))
        points = street.camera.project(camera_from_object.transform(np.array(list(car.keypoints.values()))))
        seen = detection.keypoint_scores > 0
        hidden += int((~seen).sum())
        np.testing.assert_allclose(detection.keypoints[seen], points[seen], atol=0.01)
    assert hidden > len(found.detections)  # of twelve points on a car, some are always on the far side


def test_noise_moves_borders_by_about_its_sigma(street, rng):
    mask = np.zeros((200, 300), np.uint8)
    mask[60:140, 80:220] = 1
    for sigma_px in (0.0, 0.7, 2.0):
        rough = roughen(mask, rng, sigma_px)
        changed = (rough != mask).sum() / (2 * (80 + 140))  # mean distance between the borders
        assert changed == pytest.approx(0.8 * sigma_px, abs=0.35)
    assert mask_iou(roughen(mask, rng, 0.0), mask) == 1.0


def test_images_hold_texture_to_follow_and_no_holes(street):
    image = render_image(street, 1)
    assert image.shape == (street.camera.height, street.camera.width, 3)
    assert image.dtype == np.uint8
    road = image[-25:, 100:300].astype(float)
    assert road.std() > 3.0
    assert (image.reshape(-1, 3).max(1) > 0).mean() > 0.99


def test_detections_read_back_as_they_were_observed(street, folder):
    found, _ = observe(street, ObserverConfig())
    read = read_detections(folder / "detections.json")
    assert read.warnings == ()
    for a, b in zip(found.detections, read.detections, strict=True):
        np.testing.assert_array_equal(a.mask(), b.mask())


def test_a_folder_that_cannot_be_written_is_named(car, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SequenceError, match="file"):
        write_recording(make_street(car, 0, StreetConfig(frames=1, width_px=100, height_px=40)), tmp_path / "file")


def test_the_truth_of_what_drives_is_a_map_of_its_own(street, folder):
    [car] = [body for body in street.cars if body.moves]
    [found] = Map.load(folder / "moving.json").moving
    assert found.id == car.id
    for i, (time_s, pose) in enumerate(zip(found.path.times_s, found.path.world_from_object, strict=True)):
        np.testing.assert_allclose(pose.matrix, car.at(float(time_s)).matrix, atol=1e-6)
        np.testing.assert_allclose(found.path.velocity_in_world[i], car.velocity(float(time_s)), atol=1e-5)
    np.testing.assert_allclose(found.vertices, car.vertices, atol=1e-6)
    assert car.id not in {entry["id"] for entry in json.loads((folder / "objects.json").read_text())["objects"]}
