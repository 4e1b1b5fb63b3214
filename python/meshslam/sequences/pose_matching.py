"""Poses of a path at the times of frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from collections.abc import Sequence as Items
from pathlib import Path

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.sequences.interpolation import interpolate_poses
from meshslam.sequences.report import Report

_SAME_TIME_S = 1e-5  # stamps are often rounded to so much
POSE_TOLERANCE_S = 5e-3  # a pose this near will do where there is none on the other side
LONGEST_POSE_GAP_S = 0.25  # between two poses: braking at 3 m/s² bends the way by 2 cm


def poses_at(times_s: Floats, pose_times_s: Floats, poses: Items[Pose], path: Path, report: Report) -> dict[int, Pose]:
    """Poses by frame: one of the same time, else between two that are near, else the nearest within 5 ms.

    Both times increase. That frames have none is noted; that all have none is a problem of the file `path`.
    """
    found = {i: pose for i, time_s in enumerate(times_s) if (pose := _pose_at(float(time_s), pose_times_s, poses))}
    between = sum(pose not in _ids(poses) for pose in _ids(found.values()))
    if between:
        report.note(path, "", f"{between} frames have no pose of their time: theirs lie between their neighbours'")
    spans = (
        f"poses from {pose_times_s[0]:.3f} to {pose_times_s[-1]:.3f} s, frames {times_s[0]:.3f} to {times_s[-1]:.3f} s"
    )
    if not found:
        report.add(path, "", f"no frame has a pose: {spans}: another clock, or another unit?")
    elif len(found) < len(times_s):
        first = next(i for i in range(len(times_s)) if i not in found)
        missing = f"{len(times_s) - len(found)} of {len(times_s)} frames have no pose within reach"
        report.note(
            path, "", f"{missing} (first: frame {first} at {times_s[first]:.6f} s); {spans}; map leaves them out"
        )
    return found


def all_or_some(poses: Mapping[int, Pose], count: int) -> tuple[tuple[Pose, ...] | None, dict[int, Pose] | None]:
    """world_from_camera and partial_poses of a Sequence of so many frames: the one if all have poses, else the other.

    Both are None where no frame has one.
    """
    known = {i: poses[i] for i in range(count) if i in poses}
    if not known:
        return None, None
    return (tuple(known.values()), None) if len(known) == count else (None, known)


def _ids(poses: Iterable[Pose]) -> set[int]:
    return {id(pose) for pose in poses}


def _pose_at(time_s: float, times_s: Floats, poses: Items[Pose]) -> Pose | None:
    after = int(np.searchsorted(times_s, time_s))
    near = min((k for k in (after - 1, after) if 0 <= k < len(poses)), key=lambda k: abs(times_s[k] - time_s))
    gap_s = abs(float(times_s[near]) - time_s)
    if gap_s <= _SAME_TIME_S:
        return poses[near]
    if 0 < after < len(poses) and times_s[after] - times_s[after - 1] <= LONGEST_POSE_GAP_S:
        pair = slice(after - 1, after + 1)
        return interpolate_poses(times_s[pair], poses[pair], np.array([time_s]))[0]
    return poses[near] if gap_s <= POSE_TOLERANCE_S else None
