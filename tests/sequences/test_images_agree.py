"""The images say whether poses, calibration and times are right: matched points lie on their epipolar lines."""

import cv2
import numpy as np
import pytest

from meshslam.sequences import open_sequence

pytestmark = pytest.mark.data


def flow(a, b):
    """Pixels (n, 2) of corners in two images, by flow that comes back to where it started."""
    points = cv2.goodFeaturesToTrack(a, 400, 0.01, 8)
    moved, there, _ = cv2.calcOpticalFlowPyrLK(a, b, points, None, maxLevel=4)
    back, here, _ = cv2.calcOpticalFlowPyrLK(b, a, moved, None, maxLevel=4)
    points, moved, back = (x.reshape(-1, 2).astype(float) for x in (points, moved, back))
    good = (there.ravel() > 0) & (here.ravel() > 0) & (np.linalg.norm(points - back, axis=1) < 0.5)
    return points[good], moved[good]


def epipolar_error_px(sequence, first, last):
    """Median distance of points in the last frame to the lines that the first frame's points allow."""
    a, b = (cv2.cvtColor(sequence.read_image(i), cv2.COLOR_BGR2GRAY) for i in (first, last))
    points, moved = flow(a, b)
    last_from_first = sequence.world_from_camera[last].inverse() @ sequence.world_from_camera[first]
    essential = np.cross(last_from_first.translation, last_from_first.rotation, axisb=0, axisc=0)
    inverse = np.linalg.inv(sequence.camera.matrix)
    lines = np.column_stack([points, np.ones(len(points))]) @ (inverse.T @ essential @ inverse).T
    distances = (lines * np.column_stack([moved, np.ones(len(moved))])).sum(1) / np.linalg.norm(lines[:, :2], axis=1)
    return np.median(np.abs(distances))


@pytest.mark.parametrize(
    ("path", "camera", "first"),
    [
        ("kitti_raw/2011_09_26/2011_09_26_drive_0048_sync", 2, 0),
        ("kitti_raw/2011_09_26/2011_09_26_drive_0048_sync", 3, 0),
        ("kitti_odometry/06", None, 12),  # in the frames before, the ground truth turns by up to 0.3° too much
    ],
)
def test_points_move_as_the_poses_say(data_folder, path, camera, first):
    sequence = open_sequence(data_folder / path, camera_number=camera)
    errors_px = [epipolar_error_px(sequence, i, i + 3) for i in range(first, first + 18, 3)]
    assert np.mean(errors_px) < 0.65
