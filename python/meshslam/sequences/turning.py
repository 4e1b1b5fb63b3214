"""How a camera turns from frame to frame, and where that takes what is far away."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np

from meshslam.geometry import Floats
from meshslam.sequences.sequence import ImuSamples, Sequence


def turns(sequence: Sequence) -> Callable[[int, int], Floats] | None:
    """Takes two frames' numbers to the homography (3, 3) of far points' pixels from one to the other.

    From the known poses, else from the gyroscope, whose bias is too small to matter from frame to frame; None where
    neither is known.
    """
    imu = sequence.imu
    has_imu = imu is not None and sequence.imu_from_camera is not None and len(imu.times_s) >= 2
    if sequence.world_from_camera is None and not has_imu:
        return None
    return partial(_turn, sequence.camera.matrix, cache(partial(_camera_rotations, sequence)))


def _turn(matrix: Floats, rotations: Callable[[], dict[int, Floats]], first: int, other: int) -> Floats:
    return _homography(matrix, rotations(), first, other)


def _homography(matrix: Floats, world_from_camera: dict[int, Floats], first: int, other: int) -> Floats:
    """K R K^-1 (Hartley and Zisserman 2004, Sec. 13.4)."""
    other_from_first = world_from_camera[other].T @ world_from_camera[first]
    found: Floats = matrix @ other_from_first @ np.linalg.inv(matrix)
    return found


def _camera_rotations(sequence: Sequence) -> dict[int, Floats]:
    """World from camera (3, 3) by frame number; the world's axes are any that stay."""
    if sequence.world_from_camera is not None:
        found = [pose.rotation for pose in sequence.world_from_camera]
    elif sequence.imu is not None and sequence.imu_from_camera is not None:
        found = _integrated(sequence.imu, sequence.imu_from_camera.rotation, sequence.times_s)
    else:
        found = []
    return dict(zip(sequence.frame_ids, found, strict=True))


def _integrated(imu: ImuSamples, imu_from_camera: Floats, times_s: Floats) -> list[Floats]:
    """The gyroscope's rates, integrated: a rotation (3, 3) at each time."""
    from scipy.spatial.transform import Rotation, Slerp  # slow to import

    steps = np.diff(imu.times_s)[:, None] * (imu.angular_rate_rad_s[1:] + imu.angular_rate_rad_s[:-1]) / 2
    world_from_imu = [Rotation.identity()]
    for step in Rotation.from_rotvec(steps):
        world_from_imu.append(world_from_imu[-1] * step)
    at_frames = Slerp(imu.times_s, Rotation.concatenate(world_from_imu))
    found = at_frames(np.clip(times_s, imu.times_s[0], imu.times_s[-1])).as_matrix() @ imu_from_camera
    return list(found)
