"""What standing objects say of the shapes of others: against the exact posterior of all variables."""

import numpy as np
import pytest

from meshslam.moving import ShapeEvidence, ShapePrior

MODES = 3


def observed(rng, mean, told):
    """An object's shape about a mean, seen with noise along some axes: its estimate under N(0, I)."""
    z = mean + rng.normal(size=MODES)
    rows = rng.normal(size=(told, MODES))
    seen = rows @ z + rng.normal(size=told)
    covariance = np.linalg.inv(np.eye(MODES) + rows.T @ rows)
    return ShapeEvidence(covariance @ rows.T @ seen, covariance), rows, seen


def exact(rows, seen):
    """The mean's posterior by all variables at once: m ~ N(0, I), z_i ~ N(m, I), y_i = A_i z_i + noise."""
    information, right = np.eye(MODES), np.zeros(MODES)
    for a, y in zip(rows, seen, strict=True):
        spread = np.linalg.inv(np.eye(len(y)) + a @ a.T)
        information += a.T @ spread @ a
        right += a.T @ spread @ y
    covariance = np.linalg.inv(information)
    return covariance @ right, covariance


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_exact_posterior_where_weights_are_one(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    evidence, rows, seen = zip(*(observed(rng, np.array([1.0, -2.0, 0.0]), 2) for _ in range(6)), strict=True)
    monkeypatch.setattr(ShapeEvidence, "weight", lambda self, mean: 1.0)
    found, (mean, covariance) = ShapePrior.of_drive(evidence, MODES), exact(rows, seen)
    np.testing.assert_allclose(found.mean, mean, atol=1e-9)
    np.testing.assert_allclose(np.linalg.inv(found.root.T @ found.root), np.eye(MODES) + covariance, atol=1e-9)


def test_nothing_seen_is_the_categorys_prior_and_an_object_of_which_nothing_is_seen_says_nothing():
    none = ShapePrior.of_drive([], MODES)
    blind = ShapePrior.of_drive([ShapeEvidence(np.zeros(MODES), np.eye(MODES))] * 5, MODES)
    for found in (none, blind):
        np.testing.assert_allclose(found.mean, 0.0)
        np.testing.assert_allclose(found.root.T @ found.root, np.eye(MODES) / 2, atol=1e-9)


def test_one_wrong_estimate_among_many_moves_the_mean_little(rng):
    right = [observed(rng, np.zeros(MODES), 30)[0] for _ in range(8)]
    wrong = ShapeEvidence(np.array([25.0, -25.0, 25.0]), 0.01 * np.eye(MODES))
    before, after = (ShapePrior.of_drive(known, MODES).mean for known in (right, [*right, wrong]))
    assert np.linalg.norm(after - before) < 0.3


def test_an_estimate_under_another_prior_is_turned_into_one_under_the_categorys(rng):
    told, rows, seen = observed(rng, np.zeros(MODES), 4)
    factor = rng.normal(size=(MODES, MODES)) + 2 * np.eye(MODES)
    prior = ShapePrior(rng.normal(size=MODES), factor)
    precision = factor.T @ factor
    covariance = np.linalg.inv(precision + rows.T @ rows)
    z = covariance @ (precision @ prior.mean + rows.T @ seen)
    found = prior.evidence(z, covariance)
    np.testing.assert_allclose(found.z, told.z, atol=1e-9)
    np.testing.assert_allclose(found.covariance, told.covariance, atol=1e-9)
