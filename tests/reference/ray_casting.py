"""The slow twin of the rasterizer: a ray through each pixel's centre against every face; no projection, no clipping."""

from __future__ import annotations

import numpy as np

NEAR_M = 0.1


def cast(camera, meshes, rect=None):
    """Object, face (-1 where there is none) and depth (infinity) of what is nearest in each pixel; each is (h, w).

    `meshes` are (points_in_camera, faces).
    """
    x0, y0, width, height = rect or (0, 0, camera.width, camera.height)
    pixels = np.stack(np.meshgrid(np.arange(x0, x0 + width), np.arange(y0, y0 + height)), -1).astype(float)
    rays = camera.rays(pixels)
    depth = np.full((height, width), np.inf)
    objects, faces_seen = np.full((height, width), -1), np.full((height, width), -1)
    for number, (points, faces) in enumerate(meshes):
        for index, face in enumerate(faces):
            a, b, c = points[face]
            normal = np.cross(b - a, c - a)
            along = rays @ normal
            with np.errstate(divide="ignore", invalid="ignore"):
                t = (a @ normal) / along
                hit = rays * t[..., None]
                sides = [np.cross(q - p, hit - p) @ normal for p, q in ((a, b), (b, c), (c, a))]
            inside = np.all([s > 0 for s in sides], axis=0) & (t >= NEAR_M) & (t < depth)
            depth[inside], objects[inside], faces_seen[inside] = t[inside], number, index
    return objects, faces_seen, depth
