"""Known camera poses against the images: small errors of rotation are taken out.

Poses from a navigation unit are off by tenths of a degree, which is pixels on the image and decimetres at an object.
Corners of the static scene, followed between frames, fix the relative rotation far better: they must lie on each
other's epipolar lines. All relative rotations and the given poses are then brought together by least squares.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from meshslam.geometry import Bytes, Camera, Floats, Pose, exp_so3, hat
from meshslam.maps import CameraPath
from meshslam.perception import Detection, corners, follow, grey
from meshslam.settings import Settings, expert, public

_STEPS = (1, 2, 3)  # frames apart
_KERNEL_PX = 0.5  # Cauchy's threshold for the distance to the epipolar line


@dataclass(frozen=True)
class RotationConfig(Settings):
    """Settings of the correction."""

    enabled: bool = public(True, doc="correct the given camera rotations by what images show")
    corners: int = expert(500, low=1)  # followed in each frame
    min_corners: int = expert(60, low=1)
    min_baseline_m: float = expert(0.2, low=0)
    given_sigma_rad: float = expert(5e-3, above=0)  # of each given rotation
    measured_sigma_rad: float = expert(5e-4, above=0)  # of each relative rotation


@dataclass(frozen=True, eq=False)
class RelativeRotation:
    """exp(correction) R is the rotation first -> second that the images show, R the one that the poses give."""

    first: int
    second: int
    correction_rad: Floats  # (3,), in the second camera


def correct_rotations(
    frames: CameraPath,
    read_image: Callable[[int], Bytes],
    detections_of_frame: Mapping[int, tuple[Detection, ...]],
    config: RotationConfig,
    progress: Callable[[str, int, int], None] | None = None,
) -> CameraPath:
    """The same path with rotations that agree with the images; `read_image` takes an index to a BGR image."""
    greys: dict[int, Bytes] = {}
    points: dict[int, Floats] = {}
    measured: list[RelativeRotation] = []
    count = len(frames.frame_ids)
    with ThreadPoolExecutor(max_workers=len(_STEPS)) as pool:
        for i in range(count):
            greys[i] = grey(read_image(i))
            points[i] = static_corners(greys[i], detections_of_frame[frames.frame_ids[i]], config)
            greys.pop(i - max(_STEPS) - 1, None)
            earlier = [i - step for step in _STEPS if i >= step]
            pairs = [(frames, greys[j], greys[i], points[j], j, i, config) for j in earlier]
            measured += [found for found in pool.map(lambda pair: _between(*pair), pairs) if found is not None]
            if progress is not None:
                progress("rotations", i + 1, count)
    return with_corrections(frames, measured, config)


def static_corners(image: Bytes, detections: tuple[Detection, ...], config: RotationConfig) -> Floats:
    """Corners (n, 2) outside all detections: what moves is mostly detected."""
    free = np.ones(image.shape, np.uint8)
    for detection in detections:
        free[detection.mask() > 0] = 0
    return corners(image, free, 0, 0, config.corners)


def _between(
    frames: CameraPath, first: Bytes, second: Bytes, points: Floats, i: int, j: int, config: RotationConfig
) -> RelativeRotation | None:
    """The relative rotation of two frames; None with too few corners or too short a baseline."""
    second_from_first = frames.world_from_camera[j].inverse() @ frames.world_from_camera[i]
    if float(np.linalg.norm(second_from_first.translation)) < config.min_baseline_m:
        return None
    flow = follow(first, second, points, agreement_px=0.5)
    if int(flow.good.sum()) < config.min_corners:
        return None
    correction = epipolar_correction(frames.camera, second_from_first, points[flow.good], flow.points[flow.good])
    return RelativeRotation(i, j, correction)


def epipolar_correction(camera: Camera, second_from_first: Pose, first: Floats, second: Floats) -> Floats:
    """Rotation vector w (3,), so that with exp(w) R matched pixels (n, 2) lie on their epipolar lines; robust."""
    from scipy.optimize import least_squares  # slow to import

    rays, seen = camera.rays(first), camera.rays(second)
    baseline = second_from_first.translation / np.linalg.norm(second_from_first.translation)
    across = hat(baseline) @ second_from_first.rotation

    def distance_px(w: Floats) -> Floats:
        lines = rays @ (hat(baseline) @ exp_so3(w) @ second_from_first.rotation).T
        gap: Floats = camera.fx * (seen * lines).sum(1) / np.maximum(np.hypot(lines[:, 0], lines[:, 1]), 1e-9)
        return gap

    usable = np.linalg.norm(rays @ across.T, axis=1) > 1e-3  # a ray along the baseline has no epipolar line
    rays, seen = rays[usable], seen[usable]
    found: Floats = least_squares(distance_px, np.zeros(3), loss="cauchy", f_scale=_KERNEL_PX).x
    return found


def with_corrections(frames: CameraPath, measured: list[RelativeRotation], config: RotationConfig) -> CameraPath:
    """Turn each camera by d_i: the smallest d for which R_ji d_i - d_j agrees with every measured correction."""
    from scipy.sparse import coo_array  # slow to import
    from scipy.sparse.linalg import spsolve

    if not measured:
        return frames
    count = len(frames.frame_ids)
    rows, columns, values, right = [], [], [], np.zeros(3 * count)
    axes = np.arange(3)

    def add(i: int, j: int, block: Floats) -> None:
        rows.append(np.repeat(3 * i + axes, 3))
        columns.append(np.tile(3 * j + axes, 3))
        values.append(block.ravel())

    given, weight = config.given_sigma_rad**-2, config.measured_sigma_rad**-2
    for i in range(count):
        add(i, i, given * np.eye(3))
    for m in measured:
        turn = frames.world_from_camera[m.second].rotation.T @ frames.world_from_camera[m.first].rotation
        add(m.first, m.first, weight * np.eye(3))
        add(m.second, m.second, weight * np.eye(3))
        add(m.first, m.second, -weight * turn.T)
        add(m.second, m.first, -weight * turn)
        right[3 * m.first + axes] += weight * turn.T @ m.correction_rad
        right[3 * m.second + axes] -= weight * m.correction_rad
    index = (np.concatenate(rows), np.concatenate(columns))
    normal = coo_array((np.concatenate(values), index), shape=(3 * count, 3 * count)).tocsc()
    # rounded, so that the last bits of the linear algebra, which vary with memory's alignment, end here
    turns: Floats = np.round(np.asarray(spsolve(normal, right), float), 10).reshape(-1, 3)
    turned = tuple(
        Pose(pose.rotation @ exp_so3(d), pose.translation)
        for pose, d in zip(frames.world_from_camera, turns, strict=True)
    )
    return replace(frames, world_from_camera=turned)
