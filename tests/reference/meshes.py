"""Meshes that hide parts of themselves, that are open, or that have no proper surface."""

from __future__ import annotations

import numpy as np

from meshslam.categories.spheres import icosphere


def joined(*parts):
    """Several meshes as one."""
    vertices, faces, count = [], [], 0
    for v, f in parts:
        vertices.append(v)
        faces.append(np.asarray(f) + count)
        count += len(v)
    return np.concatenate(vertices), np.concatenate(faces)


def ball(centre, radii, depth=2):
    """A closed ellipsoid."""
    sphere = icosphere(depth)
    return sphere.vertices * radii + centre, sphere.faces


def with_mirrors_and_wheels(car):
    """A car with mirrors that stand off its sides and wheels that stick out of it, as closed parts of their own."""
    mirrors = [ball([0.6, side * 1.0, 0.25], [0.08, 0.15, 0.1], 1) for side in (-1, 1)]
    wheels = [ball([x, side * 0.75, -0.45], [0.33, 0.14, 0.33], 1) for x in (-1.3, 1.3) for side in (-1, 1)]
    return joined(car, *mirrors, *wheels)


def l_shape():
    """An upright L, 3 m long and 2 m high, 1 m thick: from many sides one arm hides part of the other."""
    outline = np.array([[-1.5, -1], [1.5, -1], [1.5, -0.2], [-0.6, -0.2], [-0.6, 1], [-1.5, 1]])
    front, back = (np.insert(outline, 1, y, axis=1) for y in (-0.5, 0.5))
    cap = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    sides = [[[i, 6 + i, j], [j, 6 + i, 6 + j]] for i, j in zip(range(6), [1, 2, 3, 4, 5, 0], strict=True)]
    return np.concatenate([front, back]), np.concatenate([cap, cap[:, ::-1] + 6, np.array(sides).reshape(-1, 3)])


def nested_shells():
    """A ball within a ball: the inner one is never seen."""
    return joined(ball([0, 0, 0], [1.6, 0.9, 0.7]), ball([0.2, 0.1, 0], [0.9, 0.5, 0.4]))


def crossing_shells():
    """Two balls that cut each other."""
    return joined(ball([-0.5, 0, 0], [1.2, 0.8, 0.6]), ball([0.7, 0.1, 0.3], [0.9, 0.7, 0.5]))


def open_half(vertices, faces):
    """The faces on one side of y = 0: an open mesh."""
    return vertices, faces[vertices[faces][:, :, 1].mean(1) > 0]
