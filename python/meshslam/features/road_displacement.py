"""The camera's displacement from the road's texture; the camera's known height above the road gives the scale.

Two images of a plane are related by a homography, which the camera's motion and the plane determine (Hartley and
Zisserman 2004, Sec. 13.1). Rotation and direction are known well from IMU and point tracks. The length of the
displacement is the one at which the road's texture in both images agrees best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Bytes, Camera, Floats, Pose, RoadTexture
from meshslam.settings import Settings, expert, public

_MIN_POINTS = 200  # of the road


@dataclass(frozen=True)
class RoadConfig(Settings):
    """The road as a measure of length; lengths in metres."""

    enabled: bool = public(True, doc="measure displacement by the road's texture, where there are images")
    min_distance_m: float = expert(5.0, above=0)  # of the patch of road, ahead of the camera
    max_distance_m: float = expert(14.0, above="min_distance_m")
    aside_m: float = expert(1.6, above=0)
    step_px: int = expert(2, low=1)
    min_baseline_m: float = expert(1.0, above=0)  # between the two cameras
    chord_m: float = expert(10.0, above=0)  # of the later path over the patch: the road lies along it
    search_share: float = expert(0.3, above=0, below=1)  # by which the displacement may differ from the expected
    min_correlation: float = expert(0.5, low=0, high=1)
    min_drop: float = expert(0.03, low=0, high=2)  # of the correlation, where it is `drop_share` longer or shorter
    drop_share: float = expert(0.08, above=0, below=1)
    sigma_share: float = expert(0.015, above=0)  # of one; errors of height and slope persist


def road_normal(centres: Sequence[Floats], config: RoadConfig) -> Floats | None:
    """The road's normal (3,) in the world ahead of a camera: it lies along the path, and is level across it.

    `centres` are the camera's from there on; None if they do not go far enough.
    """
    path = np.array(centres) - centres[0]
    far = np.flatnonzero(np.linalg.norm(path, axis=1) >= config.chord_m)
    if not len(far):
        return None
    along = path[far[0]] / np.linalg.norm(path[far[0]])
    normal = np.array([0.0, 0.0, 1.0]) - along[2] * along
    norm = float(np.linalg.norm(normal))
    return normal / norm if norm > 0.5 else None


def road_displacement_m(
    images: tuple[Bytes, Bytes],
    free: Bytes,
    cameras: tuple[Pose, Pose],
    normal: Floats,
    height_m: float,
    camera: Camera,
    config: RoadConfig,
) -> float | None:
    """Distance between two cameras; None if the road's texture does not determine it.

    `images` are grey, of the first and the second camera; `free` (h, w) marks what nothing hides in the second.
    """
    first_from_second = cameras[0].inverse() @ cameras[1]
    expected = float(np.linalg.norm(first_from_second.translation))
    if expected < 1e-3:
        return None
    texture = RoadTexture(
        camera,
        images,
        free,
        first_from_second,
        up=cameras[1].rotation.T @ normal,
        height_m=height_m,
        depths_m=(config.min_distance_m, config.max_distance_m),
        aside_m=config.aside_m,
        step_px=config.step_px,
    )
    if len(texture) < _MIN_POINTS:
        return None
    best, value = _peak(texture.correlations, expected, config)
    beside = texture.correlations(best * np.array([1 - config.drop_share, 1 + config.drop_share]))
    is_distinct = value - float(beside.max()) >= config.min_drop
    return best if value >= config.min_correlation and is_distinct else None


def _peak(correlations: Callable[[Floats], Floats], expected: float, config: RoadConfig) -> tuple[float, float]:
    """Where the correlation is largest around an expected displacement: a coarse search, a fine one, a parabola."""
    best = expected
    for reach, count in ((config.search_share, 25), (config.search_share / 12, 5)):
        tried = best * np.linspace(1 - reach, 1 + reach, count)
        values = correlations(tried)
        i = int(values.argmax())
        best = float(tried[i])
    if not 0 < i < len(tried) - 1:
        return best, float(values[i])
    left, middle, right = values[i - 1 : i + 2]
    shift = 0.5 * (left - right) / min(left - 2 * middle + right, -1e-9)
    return best + float(shift) * float(tried[1] - tried[0]), float(middle)
