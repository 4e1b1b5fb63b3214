"""Meshes of a category in few bytes: mode weights, an offset, and a residual in half millimetres.

Vertices are rounded to a grid of half a millimetre, which moves them by 0.25 mm an axis at most, and stay the same when
they are written again. On that grid a mesh is `round(shape(z) + offset) + residual`. The residual is kept for one half
of the vertices where the mesh is symmetric, as all meshes are that the category's model made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import AnyArray, Bools, Bytes, Floats, Ints

STEP_M = 5e-4
FARTHEST_M = 8.0  # of a vertex from the mean mesh's; meshes beyond are kept as they are
_SYMMETRIC_M = 1e-6
_Z_DECIMALS = 4  # what z lacks is in the residual
_RIDGE = 1e-9  # modes that are hardly there get no large weights
_SIGMA_LEAST_M, _SIGMA_STEPS = 1e-3, 64.0  # steps a decade: 3.7% apart
_FLIP = np.array([1.0, -1.0, 1.0])

Arrays = dict[str, AnyArray]


@dataclass(frozen=True, eq=False)
class MeshCode:
    """How meshes of one category are written and read."""

    category: Category

    @property
    def half(self) -> Ints:
        """One vertex of each mirrored pair, and those of the plane."""
        found: Ints = np.flatnonzero(np.arange(len(self.category.mirror)) <= self.category.mirror)
        return found

    def covers(self, vertices: Floats, faces: Ints) -> bool:
        """Whether a mesh has the category's topology, and lies in its size's range."""
        if not np.array_equal(faces, self.category.faces):
            return False
        return bool(np.abs(vertices - self.category.vertices).max() < FARTHEST_M)

    def is_symmetric(self, vertices: Floats) -> bool:
        """Whether a mesh (V, 3) is its own mirror image."""
        return bool(np.abs(vertices - vertices[self.category.mirror] * _FLIP).max() < _SYMMETRIC_M)

    def encode(self, meshes: Floats, *, symmetric: bool) -> Arrays:
        """Arrays of meshes (N, V, 3): z (N, M), offset (N, 3), and the residual in steps, (3, V or half, N)."""
        steps = np.round(meshes / STEP_M)
        away = steps * STEP_M - self.category.vertices
        z = np.round(self._weights(away - away.mean(axis=1, keepdims=True)), _Z_DECIMALS).astype(np.float32)
        shapes = self._shapes(z)
        offset = (steps * STEP_M - shapes).mean(axis=1).astype(np.float32)
        chosen = self.half if symmetric else np.arange(meshes.shape[1])
        residual = (steps - _grid(shapes, offset))[:, chosen].transpose(2, 1, 0)
        whole = np.int16 if np.abs(residual).max() <= np.iinfo(np.int16).max else np.int32
        return {"z": z, "offset": offset, "residual": np.ascontiguousarray(residual.astype(whole))}

    def decode(self, arrays: Arrays, *, symmetric: bool) -> Floats:
        """The meshes (N, V, 3) again."""
        residual = arrays["residual"].transpose(2, 1, 0).astype(float)
        grid = _grid(self._shapes(arrays["z"]), arrays["offset"])
        if symmetric:
            return self._mirrored(grid[:, self.half] + residual) * STEP_M
        meshes: Floats = (grid + residual) * STEP_M
        return meshes

    def encode_vertex_values(self, values: Bytes, *, symmetric: bool) -> Bytes:
        """Values (N, V) of symmetric meshes by their half."""
        return values[:, self.half] if symmetric else values

    def decode_vertex_values(self, values: Bytes, *, symmetric: bool) -> Bytes:
        """The reverse: (N, V)."""
        if not symmetric:
            return values
        whole = np.empty((len(values), len(self.category.mirror)), values.dtype)
        whole[:, self.half] = values
        whole[:, self.category.mirror[self.half]] = values
        return whole

    def _weights(self, away: Floats) -> Floats:
        """The modes' weights (N, M) that come nearest to displacements (N, V, 3) from the mean, but for a shift."""
        centred = self.category.modes - self.category.modes.mean(axis=1, keepdims=True)
        modes = centred.reshape(len(centred), -1)
        products = away.reshape(len(away), -1) @ modes.T
        return np.asarray(np.linalg.solve(modes @ modes.T + _RIDGE * np.eye(len(modes)), products.T).T, float)

    def _shapes(self, z: AnyArray) -> Floats:
        shapes: Floats = self.category.vertices + np.tensordot(np.asarray(z, float), self.category.modes, axes=1)
        return shapes

    def _mirrored(self, half: Floats) -> Floats:
        whole = np.empty((len(half), len(self.category.mirror), 3))
        whole[:, self.category.mirror[self.half]] = half * _FLIP
        whole[:, self.half] = half
        return whole + 0.0  # no -0


def _grid(shapes: Floats, offset: AnyArray) -> Floats:
    """Where modes and offset put the vertices (N, V, 3), in whole steps."""
    steps: Floats = np.round((shapes + np.asarray(offset, float)[:, None]) / STEP_M)
    return steps


def sigma_code(sigma_m: Floats) -> Bytes:
    """Standard deviations as a byte each, in equal steps of their logarithm; below 1 mm is 1 mm, 9.7 m is the most."""
    decades = np.log10(np.maximum(sigma_m, _SIGMA_LEAST_M) / _SIGMA_LEAST_M)
    code: Bytes = np.clip(np.round(_SIGMA_STEPS * decades), 0, 255).astype(np.uint8)
    return code


def sigma_of_code(code: Bytes) -> Floats:
    """The standard deviations again, metres, to 2%."""
    sigma: Floats = _SIGMA_LEAST_M * 10.0 ** (np.asarray(code, float) / _SIGMA_STEPS)
    return sigma


def packed(flags: Sequence[Bools] | Bools) -> Bytes:
    """Flags (N, V) as bits (N, ceil(V / 8))."""
    bits: Bytes = np.packbits(np.asarray(flags, bool), axis=1)
    return bits


def unpacked(bits: Bytes, count: int) -> Bools:
    """The flags (N, count) again."""
    flags: Bools = np.unpackbits(bits, axis=1, count=count).astype(bool)
    return flags
