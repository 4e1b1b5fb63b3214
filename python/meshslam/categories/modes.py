"""Principal modes of aligned shapes."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Floats, Ints

ALONG_THE_SURFACE = 0.3  # it changes neither outline nor volume


def principal_modes(shapes: Floats, faces: Ints, count: int, along: float = ALONG_THE_SURFACE) -> tuple[Floats, Floats]:
    """Mean (V, 3) and the first `count` modes (M, V, 3) of shapes (N, V, 3), each scaled by its standard deviation.

    The modes explain the most of the surface's motion: a vertex counts by its area, and motion along the surface by
    the factor `along` of motion across it. Signs are fixed: the largest coordinate of a mode is positive.
    """
    mean = shapes.mean(0)
    area, normal = vertex_areas_and_normals(mean, faces)
    across = normal[:, :, None] * normal[:, None, :]
    root = np.sqrt(area / area.sum())[:, None, None]
    metric = root * (across + along * (np.eye(3) - across))
    inverse = (across + (np.eye(3) - across) / along) / root
    measured = np.einsum("vij,nvj->nvi", metric, shapes - mean).reshape(len(shapes), -1)
    values, vectors = np.linalg.eigh(measured @ measured.T)
    order = np.argsort(values)[::-1][:count]
    order = order[values[order] > values.max() * 1e-10]
    modes = (vectors[:, order].T @ measured).reshape(len(order), -1, 3) / np.sqrt(max(len(shapes) - 1, 1))
    modes = np.einsum("vij,mvj->mvi", inverse, modes)
    flat = modes.reshape(len(modes), -1)
    sign = np.sign(flat[np.arange(len(modes)), np.abs(flat).argmax(1)])
    return mean, modes * sign[:, None, None]


def vertex_areas_and_normals(vertices: Floats, faces: Ints) -> tuple[Floats, Floats]:
    """Area (V,) that each vertex stands for, a third of its faces', and unit normal (V, 3)."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    face = np.cross(b - a, c - a) / 2
    area = np.bincount(faces.ravel(), np.repeat(np.linalg.norm(face, axis=1), 3), len(vertices)) / 3
    normal = np.stack([np.bincount(faces.ravel(), np.repeat(face[:, k], 3), len(vertices)) for k in range(3)], 1)
    return area, normal / np.linalg.norm(normal, axis=1, keepdims=True)
