"""The camera's displacement from the road's texture; the camera's known height above the road gives the scale.

Two images of a plane are related by a homography, which the camera's motion and the plane determine (Hartley and
Zisserman 2004, Sec. 13.1). Rotation and direction are known well from IMU and point tracks. The length of the
displacement is the one at which the road's texture in both images agrees best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from meshslam.geometry import Bytes, Camera, Floats, Pose
from meshslam.settings import Settings, expert, public


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
    direction = first_from_second.translation / expected
    pixels, on_road = _patch(cameras[1].rotation.T @ normal, height_m, free, camera, config)
    if len(pixels) < 200:
        return None
    seen = images[1][pixels[:, 1], pixels[:, 0]].astype(np.float64)
    turned = on_road @ first_from_second.rotation.T

    def correlation(displacement_m: float) -> float:
        return _correlation(seen, images[0], camera.project(turned + displacement_m * direction))

    best, value = _peak(correlation, expected, config)
    drop = value - max(correlation(best * (1 + s * config.drop_share)) for s in (-1, 1))
    return best if value >= config.min_correlation and drop >= config.min_drop else None


def _patch(
    up: Floats, height_m: float, free: Bytes, camera: Camera, config: RoadConfig
) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.int64]], Floats]:
    """Pixels (n, 2) of the road ahead, and the points (n, 3) of it that they see, in the camera whose up is given."""
    v, u = np.mgrid[0 : camera.height : config.step_px, 0 : camera.width : config.step_px]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    pixels = pixels[free[pixels[:, 1], pixels[:, 0]] > 0]
    rays = camera.rays(pixels.astype(float))
    down = -(rays @ up)
    depth = np.where(down > 1e-3, height_m / np.maximum(down, 1e-3), np.inf)
    ahead = (depth > config.min_distance_m) & (depth < config.max_distance_m)
    on = ahead & (np.abs(rays[:, 0] * np.where(ahead, depth, 0.0)) < config.aside_m)
    return pixels[on], rays[on] * depth[on, None]


def _correlation(seen: Floats, image: Bytes, pixels: Floats) -> float:
    """Normalized correlation of grey values (n,) with an image's at pixels (n, 2); -1 where few are inside."""
    width = 256  # OpenCV takes no long columns
    padded = np.full((-len(pixels) % width, 2), -1.0)
    at = np.concatenate([pixels, padded]).astype(np.float32).reshape(-1, width, 2)
    values = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR).reshape(-1)[: len(pixels)].astype(np.float64)
    inside = ((pixels >= 0) & (pixels <= [image.shape[1] - 1, image.shape[0] - 1])).all(1)
    if inside.sum() < 0.5 * len(pixels):
        return -1.0
    a, b = seen[inside] - seen[inside].mean(), values[inside] - values[inside].mean()
    return float(a @ b / max(1e-9, np.sqrt((a @ a) * (b @ b))))


def _peak(correlation: Callable[[float], float], expected: float, config: RoadConfig) -> tuple[float, float]:
    """Where the correlation is largest around an expected displacement: a coarse search, a fine one, a parabola."""
    best = expected
    for reach, count in ((config.search_share, 25), (config.search_share / 12, 5)):
        tried = best * np.linspace(1 - reach, 1 + reach, count)
        values = np.array([correlation(float(length)) for length in tried])
        i = int(values.argmax())
        best = float(tried[i])
    if not 0 < i < len(tried) - 1:
        return best, float(values[i])
    left, middle, right = values[i - 1 : i + 2]
    shift = 0.5 * (left - right) / min(left - 2 * middle + right, -1e-9)
    return best + float(shift) * float(tried[1] - tried[0]), float(middle)
