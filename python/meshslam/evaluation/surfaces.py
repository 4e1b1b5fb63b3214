"""Distances between the surfaces of meshes: Chamfer distance and F-score."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Ints

POINTS = 5000  # on each surface
F_SCORE_M = 0.05
_SPACING_M = 0.05  # of the points that find the faces near to a point
_CANDIDATES = 8  # faces that may be the nearest
_SEED = 0


@dataclass(frozen=True, eq=False)
class SurfaceDistances:
    """Distances of points of each surface to the other one."""

    from_estimate_m: Floats  # (POINTS,), to the true surface: accuracy
    from_truth_m: Floats  # (POINTS,), to the estimated surface: completeness

    @property
    def chamfer_m(self) -> float:
        """The mean of accuracy and completeness (Chamfer-L1, Mescheder et al. 2019)."""
        return float((self.from_estimate_m.mean() + self.from_truth_m.mean()) / 2)

    def f_score(self, threshold_m: float = F_SCORE_M) -> float:
        """Harmonic mean of the shares of both that are within a threshold (Knapitsch et al. 2017), from 0 to 1."""
        precision, recall = (float((d <= threshold_m).mean()) for d in (self.from_estimate_m, self.from_truth_m))
        return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0


def surface_distances(
    true_vertices: Floats, true_faces: Ints, vertices: Floats, faces: Ints, count: int = POINTS
) -> SurfaceDistances:
    """Compare two meshes (n, 3), metres, with faces (m, 3), in one frame; the same meshes give the same figures.

    Points lie evenly by area. Distances are to the surface, not to points on it.
    """
    return SurfaceDistances(
        distances_to_surface(sampled(vertices, faces, count), true_vertices, true_faces),
        distances_to_surface(sampled(true_vertices, true_faces, count), vertices, faces),
    )


def sampled(vertices: Floats, faces: Ints, count: int) -> Floats:
    """Points (count, 3) on a surface, spread evenly by its area, and always the same ones."""
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    ends = np.cumsum(areas)
    rng = np.random.default_rng(_SEED)
    at = (np.arange(count) + rng.random(count)) / count * ends[-1]
    chosen = corners[np.minimum(np.searchsorted(ends, at), len(faces) - 1)]
    root, along = np.sqrt(rng.random(count)), rng.random(count)
    shares = np.stack([1 - root, root * (1 - along), root * along], axis=1)
    points: Floats = np.einsum("nk,nkd->nd", shares, chosen)
    return points


def distances_to_surface(points: Floats, vertices: Floats, faces: Ints) -> Floats:
    """Distance (n,) of points (n, 3) to the nearest face of a mesh.

    The faces that hold the nearest of points laid 5 cm apart are compared exactly, so that small differences between
    far faces are all that can be missed.
    """
    from scipy.spatial import cKDTree

    laid, of_face = _laid(vertices[faces])
    _, nearest = cKDTree(laid).query(points, k=min(_CANDIDATES, len(laid)))
    candidates = np.asarray(of_face[nearest]).reshape(len(points), -1)
    flat = vertices[faces[candidates.ravel()]]
    away = _to_triangles(np.repeat(points, candidates.shape[1], axis=0), flat)
    found: Floats = away.reshape(candidates.shape).min(axis=1)
    return found


def _laid(corners: Floats) -> tuple[Floats, Ints]:
    """Points inside triangles (m, 3, 3), no sparser than _SPACING_M in each, and the triangle of each."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    pieces = np.maximum(np.ceil(longest / _SPACING_M), 1).astype(int)
    points, owners = [], []
    for n in np.unique(pieces):
        i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
        kept = i + j < n
        shares = (np.stack([i, j, n - 1 - i - j], axis=1)[kept] + 1 / 3) / n
        faces = np.flatnonzero(pieces == n)
        points.append(np.einsum("sc,fcd->fsd", shares, corners[faces]).reshape(-1, 3))
        owners.append(np.repeat(faces, len(shares)))
    return np.concatenate(points), np.concatenate(owners)


def _to_triangles(points: Floats, corners: Floats) -> Floats:
    """Distance (n,) of points (n, 3) to triangles (n, 3, 3), one to one: to the plane inside, else to the edges."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    square = np.maximum((normal**2).sum(axis=1), 1e-30)
    inside = np.ones(len(points), bool)
    edges = np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        along, to = end - start, points - start
        inside &= (np.cross(along, to) * normal).sum(axis=1) >= 0
        share = np.clip((to * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-30), 0, 1)
        edges = np.minimum(edges, np.linalg.norm(to - share[:, None] * along, axis=1))
    plane = np.abs(((points - a) * normal).sum(axis=1)) / np.sqrt(square)
    return np.where(inside, plane, edges)
