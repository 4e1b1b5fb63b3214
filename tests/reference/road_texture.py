"""The slow twin of the core's road texture: rays and homography by NumPy, grey values by OpenCV."""

from __future__ import annotations

import cv2
import numpy as np

_WIDTH = 256  # OpenCV takes no long columns


def patch(up, height_m, free, camera, *, depths_m, aside_m, step_px):
    """Pixels (n, 2) of the road ahead, and the points (n, 3) of it that they see, in the camera whose up is given."""
    v, u = np.mgrid[0 : camera.height : step_px, 0 : camera.width : step_px]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    pixels = pixels[free[pixels[:, 1], pixels[:, 0]] > 0]
    rays = camera.rays(pixels.astype(float))
    down = -(rays @ up)
    depth = np.where(down > 1e-3, height_m / np.maximum(down, 1e-3), np.inf)
    ahead = (depth > depths_m[0]) & (depth < depths_m[1])
    on = ahead & (np.abs(rays[:, 0] * np.where(ahead, depth, 0.0)) < aside_m)
    return pixels[on], rays[on] * depth[on, None]


def correlation(seen, image, pixels):
    """Normalized correlation of grey values (n,) with an image's at pixels (n, 2); -1 where few are inside."""
    padded = np.full((-len(pixels) % _WIDTH, 2), -1.0)
    at = np.concatenate([pixels, padded]).astype(np.float32).reshape(-1, _WIDTH, 2)
    values = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR).reshape(-1)[: len(pixels)].astype(np.float64)
    inside = ((pixels >= 0) & (pixels <= [image.shape[1] - 1, image.shape[0] - 1])).all(1)
    if inside.sum() < 0.5 * len(pixels):
        return -1.0
    a, b = seen[inside] - seen[inside].mean(), values[inside] - values[inside].mean()
    return float(a @ b / max(1e-9, np.sqrt((a @ a) * (b @ b))))


def correlations(camera, images, free, first_from_second, displacements_m, *, up, height_m, **region):
    """As `RoadTexture(...).correlations(displacements_m)`."""
    pixels, on_road = patch(up, height_m, free, camera, **region)
    seen = images[1][pixels[:, 1], pixels[:, 0]].astype(np.float64)
    turned = on_road @ first_from_second.rotation.T
    direction = first_from_second.translation / np.linalg.norm(first_from_second.translation)
    return np.array([correlation(seen, images[0], camera.project(turned + d * direction)) for d in displacements_m])
