from dataclasses import replace

import numpy as np
import pytest

from meshslam.features import RotationConfig
from meshslam.features.camera_rotations import RelativeRotation, epipolar_correction, static_corners, with_corrections
from meshslam.geometry import Camera, Pose, exp_so3, log_so3
from meshslam.maps import CameraPath

CAMERA = Camera(1242, 375, 720.0, 720.0, 610.0, 173.0)
CONFIG = RotationConfig()
PERTURBED_RAD, RECOVERED_DEG = np.radians(0.3), 0.03


def forward_path(rng, count):
    """A camera that drives along its z axis and turns a little."""
    pose, poses = Pose.identity(), []
    for _ in range(count):
        poses.append(pose)
        pose = pose @ Pose(exp_so3(rng.normal(0, 0.01, 3)), np.array([0.02, 0.01, 0.9]))
    return poses


def matches(rng, first, second, count=300, noise_px=0.2, wild=0.2):
    """Pixels of random points in both cameras, a share of them anywhere."""
    depth_m = rng.uniform(5, 40, 4 * count)
    pixels = rng.uniform(0, [CAMERA.width, CAMERA.height], (4 * count, 2))
    world = first.transform(CAMERA.rays(pixels) * depth_m[:, None])
    seen = CAMERA.project(second.inverse().transform(world))
    inside = (seen > 0).all(1) & (seen < [CAMERA.width, CAMERA.height]).all(1)
    pixels, seen = pixels[inside][:count], seen[inside][:count] + rng.normal(0, noise_px, (count, 2))
    lost = rng.random(count) < wild
    seen[lost] += rng.uniform(-40, 40, (lost.sum(), 2))
    return pixels, seen


@pytest.mark.parametrize("seed", range(6))
def test_matches_tell_the_rotation_that_the_poses_miss(seed):
    rng = np.random.default_rng(seed)
    first, second = forward_path(rng, 2)
    true = second.inverse() @ first
    error = rng.normal(size=3)
    error *= PERTURBED_RAD / np.linalg.norm(error)
    given = Pose(exp_so3(-error) @ true.rotation, true.translation)
    found = epipolar_correction(CAMERA, given, *matches(rng, first, second))
    left = log_so3(exp_so3(found) @ given.rotation @ true.rotation.T)
    assert np.degrees(np.linalg.norm(left)) < 2 * RECOVERED_DEG


def test_right_poses_need_no_correction(rng):
    first, second = forward_path(rng, 2)
    pixels, seen = matches(rng, first, second, noise_px=0.0, wild=0.0)
    correction = epipolar_correction(CAMERA, second.inverse() @ first, pixels, seen)
    assert np.degrees(np.linalg.norm(correction)) < 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_a_path_turned_by_tenths_of_degrees_comes_back(seed):
    rng = np.random.default_rng(seed)
    true = forward_path(rng, 12)
    given = tuple(Pose(p.rotation @ exp_so3(rng.normal(0, PERTURBED_RAD / np.sqrt(3), 3)), p.translation) for p in true)
    measured = []
    for j in range(12):
        for i in range(max(0, j - 3), j):
            relative = given[j].inverse() @ given[i]
            truth = true[j].inverse() @ true[i]
            measured.append(RelativeRotation(i, j, log_so3(truth.rotation @ relative.rotation.T)))
    frames = CameraPath(CAMERA, tuple(range(12)), np.arange(12) * 0.1, given, 1.65)
    turned = with_corrections(frames, measured, CONFIG).world_from_camera

    def errors_deg(poses):
        pairs = [(poses[i + 1].inverse() @ poses[i], true[i + 1].inverse() @ true[i]) for i in range(11)]
        return np.degrees([np.linalg.norm(log_so3(a.rotation @ b.rotation.T)) for a, b in pairs])

    assert np.median(errors_deg(given)) > 0.2
    assert errors_deg(turned).max() < RECOVERED_DEG
    for before, after in zip(given, turned, strict=True):
        np.testing.assert_array_equal(after.translation, before.translation)


def test_nothing_measured_changes_nothing(rng):
    frames = CameraPath(CAMERA, (0, 1), np.array([0.0, 0.1]), tuple(forward_path(rng, 2)), 1.65)
    assert with_corrections(frames, [], CONFIG) is frames


def test_the_given_rotations_hold_what_no_image_says(rng):
    """Relative rotations say nothing of the whole path's: it stays where the poses have it."""
    poses = tuple(forward_path(rng, 6))
    frames = CameraPath(CAMERA, tuple(range(6)), np.arange(6) * 0.1, poses, 1.65)
    small = [RelativeRotation(i, i + 1, rng.normal(0, 1e-3, 3)) for i in range(5)]
    turned = with_corrections(frames, small, CONFIG).world_from_camera
    away = np.array([log_so3(a.rotation.T @ b.rotation) for a, b in zip(poses, turned, strict=True)])
    assert np.abs(away.mean(0)).max() < 2e-4
    assert np.abs(away).max() > 2e-4


def test_corners_lie_outside_all_detections(rng, camera, box_detection):
    image = rng.integers(0, 255, (camera.height, camera.width), dtype=np.uint8)
    thing = box_detection(1, 0, (100, 40, 200, 120))
    points = static_corners(image, (thing,), replace(CONFIG, corners=400))
    assert len(points) > 100
    x, y = points.T
    assert not ((x >= 100) & (x < 300) & (y >= 40) & (y < 160)).any()
