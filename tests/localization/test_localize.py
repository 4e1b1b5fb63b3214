import dataclasses

import numpy as np
import pytest

from meshslam.errors import MapError
from meshslam.geometry import Pose, exp_so3
from meshslam.maps import Map
from meshslam.sequences import ImuSamples
from tests.fixtures.imu_street import errors_m, localized


@pytest.fixture(scope="module")
def clean(drive, seen, scene):
    return localized(drive, seen, scene)


def test_better_than_the_imu_alone(clean, street):
    truth = street.world_from_camera
    assert errors_m(clean.world_from_camera, truth).max() < 0.06
    assert errors_m(clean.inertial, truth)[-1] > 2 * errors_m(clean.world_from_camera, truth)[-1]
    assert clean.figures["objects_moved"] == 0


def test_detections_get_the_maps_ids(clean, seen, scene):
    known = {thing.id for thing in scene.objects}
    for before, after in zip(seen.detections, clean.detections.detections, strict=True):
        assert after.track_id is None or after.track_id == before.track_id
        assert before.track_id in known or after.track_id is None


def test_ids_are_only_a_hint(drive, seen, scene, street):
    none = seen.with_tracks({d.id: None for d in seen.detections})
    found = localized(drive, none, scene)
    assert errors_m(found.world_from_camera, street.world_from_camera).max() < 0.06
    rng, known = np.random.default_rng(1), [thing.id for thing in scene.objects]
    wrong = seen.with_tracks({d.id: int(rng.choice(known)) for d in seen.detections})
    found = localized(drive, wrong, scene)
    assert errors_m(found.world_from_camera, street.world_from_camera).max() < 0.06


def test_a_car_that_was_moved_is_found_and_left_out(drive, seen, scene, street):
    counts = {thing.id: sum(d.track_id == thing.id for d in seen.detections) for thing in scene.objects}
    most = max(counts, key=lambda n: counts[n])
    shift = Pose(np.eye(3), np.array([0.9, 0.5, 0.0]))
    things = [
        dataclasses.replace(t, world_from_object=shift @ t.world_from_object) if t.id == most else t
        for t in scene.objects
    ]
    found = localized(drive, seen, Map(tuple(things)))
    assert most in found.moved
    assert errors_m(found.world_from_camera, street.world_from_camera).max() < 0.12


def test_a_wrong_mounting_is_estimated(drive, seen, scene, street):
    turned = Pose(
        drive.imu_from_camera.rotation @ exp_so3(np.radians([0.6, -0.6, 0.5])), drive.imu_from_camera.translation
    )
    found = localized(dataclasses.replace(drive, imu_from_camera=turned), seen, scene)
    assert errors_m(found.world_from_camera, street.world_from_camera).max() < 0.1


def test_frames_without_objects_and_imu_gaps_are_bridged_and_said(drive, seen, scene, street):
    few = dataclasses.replace(seen, detections=tuple(d for d in seen.detections if d.frame not in (5, 6, 7)))
    keep = np.abs(drive.imu.times_s - drive.times_s[10]) > 0.08
    imu = ImuSamples(drive.imu.times_s[keep], drive.imu.angular_rate_rad_s[keep], drive.imu.specific_force_m_s2[keep])
    found = localized(dataclasses.replace(drive, imu=imu), few, scene)
    assert len(found.world_from_camera) == len(drive)
    assert found.figures["frames_without_objects"] >= 3
    assert found.figures["frames_with_imu_gap"] >= 1
    assert errors_m(found.world_from_camera, street.world_from_camera).max() < 0.1


def test_uncertain_objects_are_estimated_along(drive, seen, scene, street):
    rng = np.random.default_rng(5)
    sigma = np.array([0.1, 0.1, 0.03, 0.005, 0.005, 0.02])
    things = []
    for thing in scene.objects:
        step = rng.normal(0, sigma)
        pose = Pose(
            thing.world_from_object.rotation @ exp_so3(step[3:]), thing.world_from_object.translation + step[:3]
        )
        things.append(dataclasses.replace(thing, world_from_object=pose, pose_covariance=np.diag(sigma**2)))
    found = localized(drive, seen, Map(tuple(things)))
    assert not found.moved
    assert errors_m(found.world_from_camera, street.world_from_camera).max() < 0.2


def test_same_input_same_path(drive, seen, scene, clean):
    again = localized(drive, seen, scene)
    assert all(
        (a.matrix == b.matrix).all() for a, b in zip(clean.world_from_camera, again.world_from_camera, strict=True)
    )


def test_the_papers_mode_lowers_the_error(drive, seen, scene, street):
    found = localized(drive, seen, scene, solver="gradient")
    assert len(found.iterations) > 2
    last = errors_m(found.iterations[-1], street.world_from_camera)
    assert np.sqrt(np.mean(last**2)) < np.sqrt(np.mean(errors_m(found.inertial, street.world_from_camera) ** 2))


def test_an_empty_map_is_refused(drive, seen):
    with pytest.raises(MapError, match="no objects"):
        localized(drive, seen, Map(()))
