import numpy as np
import pytest
from scipy.spatial import ConvexHull

from meshslam.geometry import convex_hull


def _points(rng, kind):
    """Points in general position, on a coarse grid, all of a small grid, or on a ball's grid."""
    count = int(rng.integers(5, 150))
    if kind == "general":
        return rng.normal(size=(count, 3)) * [4.0, 2.0, 1.5]
    if kind == "grid":
        return np.unique(np.round(2 * rng.normal(size=(count, 3))), axis=0)
    if kind == "block":
        return np.unique(rng.integers(0, 4, (4 * count, 3)), axis=0).astype(float)
    ball = rng.normal(size=(count, 3))
    return np.unique(np.round(9 * ball / np.linalg.norm(ball, axis=1, keepdims=True)), axis=0)


@pytest.mark.parametrize("kind", ["general", "grid", "block", "ball"])
def test_the_hull_is_that_of_qhull(rng, kind):
    for _ in range(60):
        points = _points(rng, kind)
        expected = ConvexHull(points)
        faces = convex_hull(points)
        a, b, c = points[faces.T]
        assert (np.cross(a, b) * c).sum() / 6 == pytest.approx(expected.volume, rel=1e-9)
        assert set(np.unique(faces)) <= set(expected.vertices.tolist()) | set(_on_facets(points, expected))


@pytest.mark.parametrize("kind", ["general", "grid", "block", "ball"])
def test_the_hull_is_closed_and_nothing_is_outside(rng, kind):
    for _ in range(60):
        points = _points(rng, kind)
        faces = convex_hull(points)
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        directed = {tuple(edge) for edge in edges.tolist()}
        assert len(directed) == len(edges)
        assert directed == {edge[::-1] for edge in directed}
        a, b, c = points[faces.T]
        normals = np.cross(b - a, c - a)
        assert ((points[:, None] - a) * normals).sum(axis=2).max() < 1e-5 * np.ptp(points) ** 3


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.zeros((9, 3)),
        np.eye(3),
        np.arange(30.0).reshape(10, 3),
        np.column_stack([np.random.default_rng(0).normal(size=(20, 2)), np.full(20, 7.0)]),
    ],
)
def test_flat_points_have_no_hull(points):
    assert convex_hull(points) is None


def _on_facets(points, hull):
    heights = points @ hull.equations[:, :3].T + hull.equations[:, 3]
    return np.flatnonzero((np.abs(heights) < 1e-9).any(axis=1)).tolist()
