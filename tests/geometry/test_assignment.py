import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from meshslam.errors import GeometryError
from meshslam.geometry import best_pairs


def _scores(rng, kind):
    shape = rng.integers(1, 12, 2)
    scores = rng.random(shape)
    return {
        "different": scores,
        "equal": np.zeros(shape),
        "few values": np.round(3 * scores) / 3,
        "mostly none": np.where(rng.random(shape) < 0.7, 0.0, np.round(scores, 1)),
        "negative": -1e6 * scores,
    }[kind]


@pytest.mark.parametrize("kind", ["different", "equal", "few values", "mostly none", "negative"])
def test_the_pairs_are_those_of_scipy(rng, kind):
    for _ in range(200):
        scores = _scores(rng, kind)
        rows, columns = linear_sum_assignment(scores, maximize=True)
        assert best_pairs(scores) == list(zip(rows.tolist(), columns.tolist(), strict=True))


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_nothing_makes_no_pairs(shape):
    assert best_pairs(np.zeros(shape)) == []


def test_equal_scores_pair_in_order():
    assert best_pairs(np.ones((4, 4))) == [(i, i) for i in range(4)]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_scores_are_finite(bad):
    with pytest.raises(GeometryError, match="finite"):
        best_pairs(np.array([[1.0, bad]]))
