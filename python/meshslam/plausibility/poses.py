"""Whether known poses are world_from_camera, z up, with the camera's axes: x right, y down, z forward.

A camera on a vehicle stands upright and moves along its optical axis, forwards or backwards. Of the conventions that
files come in, the one is told that makes this so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.plausibility.finding import Finding
from meshslam.sequences import CONVENTIONS, in_convention

_UPRIGHT, _ALONG = 0.8, 0.9  # cosines
_STEADIER, _WANDER_DEG = 1.5, 0.06  # by which another convention must let the axis wander less
_MIN_FRAMES = 24  # for that: noise of real poses passes for it in 1 of 100 parts of 17 frames, in none of 24
_FAST_M_S, _IMPOSSIBLE_M_S = 150.0, 1000.0
_SHORT_M = 5.0  # that a position by satellites may jump
_MIN_TRAVEL_M, _MIN_STEP_SHARE = 2.0, 0.2
_SAID = {
    "quaternion-first": "its quaternions begin with w",
    "camera-from-world": "they are camera_from_world, not world_from_camera",
    "first-camera-world": "their world is the first camera (z forward, y down), not z up",
    "body": "they are poses of a body (x forward, y left, z up), not of the camera",
}


@dataclass(frozen=True)
class Attitude:
    """How upright a camera stands, how well it moves along its axis (cosines), and how steadily its axis follows."""

    upright: float
    along_axis: float
    wander_deg: float  # standard deviation of the heading between axis and travel


def attitude_of(poses: tuple[Pose, ...]) -> Attitude | None:
    """Of a path of 2 m or more; None if it is shorter."""
    at = np.array([pose.translation for pose in poses])
    steps = np.diff(at, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if float(lengths.sum()) < _MIN_TRAVEL_M:
        return None
    upright = float(np.mean([-pose.rotation[2, 1] for pose in poses]))
    moving = lengths > _MIN_STEP_SHARE * float(lengths.max())
    axes = np.array([pose.rotation[:, 2] for pose in poses[:-1]])
    along = np.abs((steps * axes).sum(1))[moving] / lengths[moving]
    across = axes[:, 0] * steps[:, 1] - axes[:, 1] * steps[:, 0]
    headings = np.arctan2(across, (axes[:, :2] * steps[:, :2]).sum(1))[moving]
    wander = np.unwrap(2 * headings) / 2  # forwards or backwards
    return Attitude(upright, float(np.median(along)), float(np.degrees(np.std(wander))))


def judge_poses(poses: tuple[Pose, ...], source: str) -> list[Finding]:
    """Name the convention that poses look like, where it is not ours; an error where another one fits clearly."""
    found = attitude_of(poses)
    if found is None:
        return []
    others = {name: attitude_of(in_convention(poses, name)) for name in CONVENTIONS[1:]}
    if found.upright > _UPRIGHT:
        if len(poses) < _MIN_FRAMES:
            return []
        better = [name for name, at in others.items() if at is not None and _is_steadier(at, found)]
        return (
            [_convention(better[0], found, f"{source}: the camera's axis does not follow its path")] if better else []
        )
    tilted = f"{source}: by these poses the camera's up is {_degrees(found.upright):.0f}° away from the world's z axis"
    good = {n: at for n, at in others.items() if at and at.upright > _UPRIGHT and at.along_axis > _ALONG}
    if good:
        return [_convention(max(good, key=lambda n: good[n].upright + good[n].along_axis), found, tilted)]
    advice = "if the camera really is tilted this is right; else check axes, quaternion order and direction"
    return [Finding("poses_tilted", f"{tilted}: {advice}", "note", _figures(found))]


def judge_jumps(times_s: Floats, poses: Sequence[Pose], source: str) -> list[Finding]:
    """Steps between poses at times (n,) that no vehicle makes: a note for fast ones, an error for impossible ones."""
    at = np.array([pose.translation for pose in poses]).reshape(-1, 3)
    lengths = np.linalg.norm(np.diff(at, axis=0), axis=1)
    speeds = lengths / np.maximum(np.diff(times_s), 1e-9)
    fast = np.flatnonzero((speeds > _FAST_M_S) & (lengths > _SHORT_M))
    if not len(fast):
        return []
    worst = int(fast[np.argmax(speeds[fast])])
    message = (
        f"{source}: jumps between poses: {len(fast)}, the greatest from {times_s[worst]:.3f} s to "
        f"{times_s[worst + 1]:.3f} s: {lengths[worst]:.4g} m, {speeds[worst]:.4g} m/s: broken poses, or another unit"
    )
    figures = {"jumps": float(len(fast)), "speed_m_s": float(speeds[worst])}
    return [Finding("poses_jump", message, "error" if speeds[worst] > _IMPOSSIBLE_M_S else "note", figures)]


def _is_steadier(other: Attitude, found: Attitude) -> bool:
    """Whether another convention makes an upright camera follow its path far more steadily."""
    upright = other.upright > 0.97 and other.along_axis > 0.97
    return upright and found.wander_deg > _STEADIER * other.wander_deg + _WANDER_DEG


def _convention(name: str, found: Attitude, what: str) -> Finding:
    advice = f"{_SAID[name]}: give --poses-convention {name}, or rewrite the file"
    return Finding("poses_convention", f"{what}: {advice}", figures=_figures(found))


def _figures(found: Attitude) -> dict[str, float]:
    return {
        "upright_cosine": found.upright,
        "along_axis_cosine": found.along_axis,
        "wander_deg": found.wander_deg,
    }


def _degrees(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
