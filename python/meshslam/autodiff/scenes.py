"""Objects that hide each other, composed of silhouettes: what both frameworks compute alike.

What is seen of object i is its region without those of the objects in front of it. With their union F, its share of a
pixel is share(F and i) − share(F): a difference of two silhouettes of joined meshes, each exact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from meshslam.geometry import Intrinsics

Array = Any  # of either framework
Mesh = tuple[Array, Array, Array]  # vertices (..., V, 3), faces (F, 3), camera_from_object (..., 4, 4)


def seen_shares(
    numpy_like: Any,  # noqa: ANN401 # torch, or jax.numpy
    draw: Callable[..., Array],
    hidden_by: Callable[[Array, Array, tuple[int, ...]], Array],
    fixed: Callable[[Array], Array],
    meshes: Sequence[Mesh],
    cameras: Intrinsics,
) -> Array:
    """How much of each pixel shows each object, (..., n, h, w).

    `hidden_by` (..., n, n) says which object hides which, `fixed` stops gradients, `draw` makes silhouettes (..., h, w)
    of points in the camera's frame.
    """
    xp = numpy_like
    placed = [vertices @ pose[..., :3, :3].mT + pose[..., None, :3, 3] for vertices, _, pose in meshes]
    batch = np.broadcast_shapes(*(p.shape[:-2] for p in placed), cameras.values.shape[:-1])
    placed = [xp.broadcast_to(points, (*batch, *points.shape[-2:])) for points in placed]
    points = xp.concatenate(placed, -2)
    sizes = [p.shape[-2] for p in placed]
    starts = np.cumsum([0, *sizes[:-1]]).tolist()
    faces = xp.concatenate([corners + start for (_, corners, _), start in zip(meshes, starts, strict=True)], 0)
    hidden = hidden_by(fixed(points), faces, tuple(corners.shape[0] for _, corners, _ in meshes))
    layers = []
    for i in range(len(meshes)):
        own = [xp.broadcast_to(hidden[..., i, j, None], (*batch, n)) for j, n in enumerate(sizes)]
        front = xp.concatenate(own, -1)
        own[i] = xp.ones_like(own[i])
        anchor = fixed(placed[i][..., :1, :])  # what is left out shrinks to a point, which covers nothing
        layers.append([xp.where(kept[..., None], points, anchor) for kept in (xp.concatenate(own, -1), front)])
    stacked = xp.stack([xp.stack(layer, -3) for layer in layers], -4)
    drawn = draw(stacked, faces, Intrinsics(cameras.values[..., None, None, :], cameras.width, cameras.height))
    return drawn[..., 0, :, :] - drawn[..., 1, :, :]


def share_iou(numpy_like: Any, shares: Array, masks: Array) -> Array:  # noqa: ANN401
    """-IoU of shares against masks that are shares, too (paper, Eq. 2); -1 where both are empty."""
    both = (shares * masks).sum((-2, -1))
    union = (shares + masks).sum((-2, -1)) - both
    some = union > 0
    return numpy_like.where(some, -both / numpy_like.where(some, union, 1.0), -1.0)
