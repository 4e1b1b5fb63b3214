"""Lay one symmetric mesh onto many solids so that a vertex means the same place on each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.interpolate import RBFInterpolator
from scipy.sparse.linalg import splu

from meshslam.categories.procedural.solid import Field, distance_and_normal, project
from meshslam.categories.spheres import Icosphere, edges_of
from meshslam.geometry import Floats, Ints

FLIP = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Wrapper:
    """The fixed linear parts of wrapping one symmetric topology: build once, use for every solid."""

    sphere: Icosphere

    @cached_property
    def edges(self) -> Ints:
        """The (E, 2) edges."""
        return edges_of(self.sphere.faces)

    @cached_property
    def symmetry(self) -> sparse.csr_matrix:
        """(3V, n) basis of the symmetric vertex sets: free coordinates to all coordinates."""
        mirror, rows, columns, values, n = self.sphere.mirror, [], [], [], 0
        for i, j in enumerate(mirror):
            if i > j:
                continue
            for axis in range(3):
                if i == j and axis == 1:
                    continue
                rows.append(3 * i + axis)
                columns.append(n)
                values.append(1.0)
                if i != j:
                    rows.append(3 * int(j) + axis)
                    columns.append(n)
                    values.append(-1.0 if axis == 1 else 1.0)
                n += 1
        return sparse.csr_matrix((values, (rows, columns)), shape=(3 * len(mirror), n))

    @cached_property
    def laplacian(self) -> sparse.csr_matrix:
        """(3V, 3V) uniform Laplacian: a vertex minus the mean of its neighbours."""
        v = len(self.sphere.vertices)
        adjacency = sparse.coo_matrix((np.ones(len(self.edges)), self.edges.T), shape=(v, v))
        adjacency = adjacency + adjacency.T
        scaled = sparse.diags(1 / np.asarray(adjacency.sum(1)).ravel()) @ adjacency
        return sparse.kron(sparse.eye(v) - scaled, sparse.eye(3)).tocsr()

    @cached_property
    def samples(self) -> tuple[Ints, Floats]:
        """Vertices, edge midpoints and face centres as (S, 3) corner indices and (S, 3) weights."""
        v, e, f = np.arange(len(self.sphere.vertices)), self.edges, self.sphere.faces
        corners = np.concatenate([np.stack([v, v, v], 1), e[:, [0, 1, 1]], f])
        kinds = np.repeat([[1.0, 0, 0], [0.5, 0.5, 0], [1 / 3, 1 / 3, 1 / 3]], [len(v), len(e), len(f)], axis=0)
        return corners, kinds

    def symmetrized(self, vertices: Floats) -> Floats:
        """The mean of a vertex set and its mirror image."""
        mean: Floats = (vertices + vertices[self.sphere.mirror] * FLIP) / 2
        return mean

    def sample_areas(self, vertices: Floats) -> Floats:
        """Share of the surface (S,) that each sample stands for: a third each for vertices, edges and faces."""
        corners = vertices[self.sphere.faces]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        vertex = np.bincount(self.sphere.faces.ravel(), np.repeat(area, 3), len(vertices)) / 3
        side = np.sort(self.sphere.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        key = self.edges[:, 0] * len(vertices) + self.edges[:, 1]
        index = np.searchsorted(key, side[:, 0] * len(vertices) + side[:, 1])
        edge = np.bincount(index, np.repeat(area, 3), len(self.edges)) / 3
        return np.concatenate([vertex, edge, area]) / 3

    def fit(
        self, field: Field, start: Floats, *, smoothness: float = 0.3, anchor: float = 0.02, iterations: int = 4
    ) -> Floats:
        """Bring the surface of the mesh (its faces too, not only its vertices) onto the solid's.

        Gauss-Newton on sum_s a_s d(p_s)^2 + smoothness * |L (v - start)|^2 + anchor * |v - start|^2 with d the distance
        of sample p_s to the solid and a_s its area; the result is exactly symmetric.
        """
        vertices, (corners, kinds) = self.symmetrized(start), self.samples
        unit = float(self.sample_areas(vertices).sum()) / len(vertices)
        roughness = self.laplacian @ self.symmetry
        stiff = unit * (smoothness * roughness.T @ roughness + anchor * self.symmetry.T @ self.symmetry)
        target = vertices.ravel()
        for _ in range(iterations):
            area = self.sample_areas(vertices)
            distance, normal = distance_and_normal(field, (vertices[corners] * kinds[:, :, None]).sum(1))
            jacobian = self._jacobian(normal)
            pull = unit * (
                smoothness * roughness.T @ (self.laplacian @ (target - vertices.ravel()))
                + anchor * self.symmetry.T @ (target - vertices.ravel())
            )
            weighted = sparse.diags(area) @ jacobian
            step = solve_normal(jacobian.T @ weighted + stiff, pull - weighted.T @ np.clip(distance, -0.3, 0.3))
            vertices = self.symmetrized(vertices + (self.symmetry @ step).reshape(-1, 3))
        return vertices

    def _jacobian(self, normal: Floats) -> sparse.csr_matrix:
        corners, kinds = self.samples
        rows = np.repeat(np.arange(len(corners)), 9)
        columns = (3 * corners[:, :, None] + np.arange(3)).ravel()
        values = (kinds[:, :, None] * normal[:, None, :]).ravel()
        full = sparse.coo_matrix((values, (rows, columns)), shape=(len(corners), self.symmetry.shape[0])).tocsr()
        free: sparse.csr_matrix = full @ self.symmetry
        return free

    def relax(self, field: Field, vertices: Floats, density: Field, iterations: int) -> Floats:
        """Slide vertices along the solid so that each face holds the same integral of `density` ((n, 3) to (n,)).

        Each vertex goes towards the mean of its faces' centres weighted by area times density (Lloyd's iteration).
        """
        faces, n = self.sphere.faces, len(vertices)
        for _ in range(iterations):
            corners = vertices[faces]
            centre = corners.mean(1)
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            weight = np.repeat(np.linalg.norm(normal, axis=1) * density(centre), 3)
            total = np.bincount(faces.ravel(), weight, n)
            spread = np.repeat(centre, 3, axis=0)
            mean = np.stack([np.bincount(faces.ravel(), weight * spread[:, k], n) / total for k in range(3)], 1)
            vertices = self.symmetrized(project(field, vertices + 0.5 * (mean - vertices), 2))
        return vertices


def solve_normal(matrix: sparse.csr_matrix, right: Floats) -> Floats:
    """Solve a sparse symmetric positive definite system."""
    options = {"SymmetricMode": True}
    solved: Floats = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve(
        right
    )
    return solved


def carry(vertices: Floats, from_landmarks: Floats, to_landmarks: Floats) -> Floats:
    """Take vertices (V, 3) along with the landmarks (n, 3) by the thin-plate spline in space."""
    warp = RBFInterpolator(from_landmarks, to_landmarks - from_landmarks, kernel="linear", degree=1, smoothing=1e-3)
    moved: Floats = vertices + warp(vertices)
    return moved
