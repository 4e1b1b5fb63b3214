import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from meshslam.evaluation import evaluate_run
from meshslam.geometry import Pose, voxel_iou
from meshslam.mapping import MappingConfig, map_objects
from meshslam.maps import CameraPath
from meshslam.moving import MovingConfig
from meshslam.objects import ObjectConfig
from meshslam.objects.heading import viewing_angle_rad
from meshslam.perception import read_detections
from meshslam.sequences import open_sequence

CONFIG = ObjectConfig(), MappingConfig()


@pytest.fixture(scope="module")
def mapped(frames, tracked, car):
    return map_objects(frames, tracked, car, *CONFIG, fixed_tracks=True)


def reasons(mapping):
    return {row.track: row.reason for row in mapping.left_out}


def test_parked_cars_are_mapped_where_they_stand_as_they_are(street, mapped):
    found = {thing.id: thing for thing in mapped.map.objects}
    for truth in street.cars:
        if not truth.moves:
            thing = found[truth.id]
            true_from_found = truth.start.inverse() @ thing.world_from_object
            assert np.linalg.norm(true_from_found.translation) < 0.25
            assert abs(np.degrees(true_from_found.yaw_rad)) < 3
            placed = true_from_found.transform(thing.vertices)
            assert voxel_iou(truth.vertices, truth.faces, placed, thing.faces) > 0.85
            assert np.isfinite(thing.pose_covariance).all()
            assert (np.linalg.eigvalsh(thing.pose_covariance) > 0).all()
            assert thing.mask_iou > 0.9


def test_steps_bring_the_mesh_nearer_to_the_masks(mapped):
    ious = mapped.mask_ious
    assert ious["mask_iou_category_model"] <= ious["mask_iou_pose"] + 0.01
    assert ious["mask_iou_pose"] < ious["mask_iou_shape"]


def test_a_car_that_moves_is_apart_from_what_stands_with_its_path(street, mapped):
    car = next(body for body in street.cars if body.moves)
    assert car.id not in mapped.map
    assert car.id not in reasons(mapped)
    [found] = mapped.map.moving
    assert found.id == car.id
    path = found.path
    gaps = [
        car.at(t).translation - pose.translation for t, pose in zip(path.times_s, path.world_from_object, strict=True)
    ]
    assert np.median(np.linalg.norm(gaps, axis=1)) < 0.35
    np.testing.assert_allclose(path.velocity_in_world, np.tile(car.velocity(0.5), (len(path), 1)), atol=0.4)
    assert voxel_iou(car.vertices, car.faces, found.vertices, found.faces) > 0.75


def test_what_moves_is_left_out_where_moving_objects_are_not_asked_for(street, frames, tracked, car):
    moving = next(body.id for body in street.cars if body.moves)
    without = MappingConfig(moving=MovingConfig(enabled=False))
    mapping = map_objects(frames, tracked, car, ObjectConfig(), without, fixed_tracks=True)
    assert reasons(mapping)[moving] == "moves"
    assert mapping.map.moving == ()


def test_what_the_motion_test_lets_pass_is_tried_by_its_path(street, frames, tracked, car):
    """The motion test never fires: the car is mapped as standing, or left out as unfit, until its path is tried."""
    moving = next(body.id for body in street.cars if body.moves)
    blind = ObjectConfig(motion_gain=1e9)
    mapping = map_objects(frames, tracked, car, blind, MappingConfig(), fixed_tracks=True)
    assert [one.id for one in mapping.map.moving] == [moving]
    assert moving not in mapping.map
    assert moving not in mapping.stages
    assert moving not in reasons(mapping)


def test_what_does_not_drive_stays_left_out_and_says_why(street, frames, tracked, car):
    moving = next(body.id for body in street.cars if body.moves)
    doubting = MappingConfig(moving=MovingConfig(min_speed_sigmas=1e6))
    mapping = map_objects(frames, tracked, car, ObjectConfig(), doubting, fixed_tracks=True)
    [row] = [row for row in mapping.left_out if row.track == moving]
    assert row.reason == "moves"
    assert "its speed is not certain" in row.detail


def test_meshes_are_centred_and_stand_upright_on_the_road(mapped):
    for thing in mapped.map.objects:
        assert np.abs(thing.vertices.max(0) + thing.vertices.min(0)).max() < 1e-9
        assert thing.vertices_in_world[:, 2].min() == pytest.approx(0.0, abs=0.15)


def split(tracked, number, other):
    """Put the second half of a track on another one."""
    ids = [d.id for d in tracked.by_track()[number]]
    return tracked.with_tracks(dict.fromkeys(ids[len(ids) // 2 :], other))


def longest(tracked, street):
    parked = {car.id for car in street.cars if not car.moves}
    return max(parked & tracked.by_track().keys(), key=lambda n: len(tracked.by_track()[n]))


def test_two_tracks_of_one_car_are_joined(street, frames, tracked, car, only):
    number = longest(tracked, street)
    halves = split(only(tracked, number), number, 77)
    joined = map_objects(frames, halves, car, *CONFIG)
    assert len(joined.map) == 1
    keep = joined.map.objects[0].id
    assert reasons(joined) == {({number, 77} - {keep}).pop(): "the same object"}
    assert {d.track_id for d in joined.detections.detections} == {keep}
    assert joined.map.objects[0].views == len(tracked.by_track()[number])


def test_tracks_that_were_given_stay_and_a_second_object_in_one_place_is_dropped(street, frames, tracked, car, only):
    number = longest(tracked, street)
    halves = split(only(tracked, number), number, 77)
    both = map_objects(frames, halves, car, *CONFIG, fixed_tracks=True)
    assert len(both.map) == 1
    assert list(reasons(both).values()) == ["the same object"]
    assert [d.track_id for d in both.detections.detections] == [d.track_id for d in halves.detections]


def test_tracks_that_cannot_become_objects_are_named_with_the_reason(camera, car, box_detection, as_set, drive):
    found = [box_detection(i + 1, i, (100, 80, 20, 12), 1) for i in range(5)]  # small
    found += [box_detection(i + 11, i, (200, 80, 80, 40), 2) for i in range(2)]  # two views
    found += [box_detection(i + 21, i, (300, 80, 80, 40), 3, "truck") for i in range(5)]
    found += [box_detection(31, 0, (400, 80, 80, 40), None)]
    widths = (20, 20, 80, 80)  # two views that are wide enough
    found += [box_detection(41 + i, i, (500, 80, w, w / 2), 4) for i, w in enumerate(widths)]
    frames = CameraPath(camera, tuple(range(5)), np.arange(5) * 0.1, drive(5), 1.65)
    mapping = map_objects(frames, as_set(5, found), car, *CONFIG)
    assert reasons(mapping) == {1: "too small", 2: "too few views", 3: "other category", 4: "too few views"}
    assert len(mapping.map) == 0
    assert mapping.mask_ious == {}


def test_no_detections_make_an_empty_map(camera, car, as_set, drive):
    frames = CameraPath(camera, (0, 1), np.array([0.0, 0.1]), drive(2), None)
    assert len(map_objects(frames, as_set(2, []), car, *CONFIG).map) == 0


def test_one_frame_is_enough_where_there_is_no_more(camera, car, car_detection, as_set, drive):
    true = Pose.from_yaw(0.3, np.array([10.0, 2.5, car.dimensions[2] / 2]))
    seen = car_detection(1, 0, drive(1)[0], true, car.vertices)
    frames = CameraPath(camera, (0,), np.array([0.0]), drive(1), 1.65)
    found = map_objects(frames, as_set(1, [seen]), car, *CONFIG).map.objects
    assert len(found) == 1
    assert np.linalg.norm(found[0].world_from_object.translation - true.translation) < 0.4


@pytest.mark.parametrize("rear", [0.05, 0.4])
def test_viewing_angles_of_two_opposite_sides_leave_it_in_doubt_which_way_a_car_faces(
    camera, car, car_detection, as_set, drive, rear
):
    """One view of a car from ahead and its left; the network gives the opposite side some of the probability."""
    true = Pose.from_yaw(np.pi + 0.3, np.array([10.0, 2.5, car.dimensions[2] / 2]))
    away = 2 * np.pi * np.arange(36) / 36 - viewing_angle_rad(drive(1)[0], true)
    peaks = [np.exp(20 * (np.cos(away - turn) - 1)) for turn in (0.0, np.pi)]
    shares = ((1 - rear) * peaks[0] + rear * peaks[1]) / peaks[0].sum()
    plain = car_detection(1, 0, drive(1)[0], true, car.vertices)
    frames = CameraPath(camera, (0,), np.array([0.0]), drive(1), 1.65)
    told = map_objects(frames, as_set(1, [replace(plain, viewing_angle_shares=shares)]), car, *CONFIG)
    assert told.reversed_probabilities == {told.map.objects[0].id: pytest.approx(rear, abs=0.03)}
    assert map_objects(frames, as_set(1, [plain]), car, *CONFIG).reversed_probabilities == {}


def test_the_map_is_the_same_bytes_however_many_threads_work(frames, tracked, car, only, street, tmp_path, monkeypatch):
    some = only(tracked, *[body.id for body in street.cars[:3]])
    written = []
    for count in (1, 2, 5):
        monkeypatch.setattr(os, "cpu_count", lambda count=count: count)
        folder = tmp_path / str(count)
        map_objects(frames, some, car, *CONFIG, fixed_tracks=True).map.save(folder)
        written.append((folder / "map.json").read_bytes())
    assert len(set(written)) == 1
    assert json.loads(written[0])["objects"]


def test_progress_is_told_of_every_step(frames, tracked, car, only, street):
    told = []
    some = only(tracked, street.cars[0].id)
    map_objects(frames, some, car, *CONFIG, progress=lambda *row: told.append(row))
    steps = [step for step, _, _ in told]
    assert {"initialize", "fit", "shape"} <= set(steps)
    assert all(done <= total for _, done, total in told)


@pytest.mark.data
def test_a_real_cars_shape_is_found_from_a_ring_of_views(data_folder, car, tmp_path):
    make_case = data_folder.parent / "tools" / "make_case.py"
    case, run = tmp_path / "ring", tmp_path / "run"
    command = [sys.executable, str(make_case), "ring", str(case), "--views", "8", "--seed", "6"]
    subprocess.run(command, check=True, capture_output=True)
    recording = open_sequence(case)
    frames = CameraPath(
        recording.camera,
        recording.frame_ids,
        recording.times_s,
        recording.world_from_camera,
        recording.height_above_ground_m,
    )
    detections = read_detections(recording.detections_path)
    map_objects(frames, detections, car, *CONFIG, fixed_tracks=True).map.save(run)
    figures = evaluate_run(case, run)
    assert figures["recall"] == 1.0
    assert figures["voxel_iou_mean"] >= 0.88
    assert figures["voxel_iou_mean"] > figures["voxel_iou_category_model"]
