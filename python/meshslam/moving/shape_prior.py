"""What the cars that stand in a drive say of the shapes of those that drive: an empirical prior of the modes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats

_FREEDOM = 4.0  # of Student's distribution of shapes about their mean: a wrong estimate counts little
_ROUNDS = 10
_LEAST = 1e-3  # what an unobserved mode is taken to tell, so that matrices can be inverted
_MEAN_SIGMA = 1.0  # of a drive's mean shape about the category's, as much as shapes differ in the category


@dataclass(frozen=True, eq=False)
class ShapeEvidence:
    """Modes of one object as they were estimated under the category's prior N(0, I), with their covariance."""

    z: Floats  # (modes,)
    covariance: Floats  # (modes, modes)

    def weight(self, mean: Floats) -> float:
        """Student's weight of the estimate, which has the mean (I - C) m and the covariance I - C."""
        told = np.eye(len(mean)) - self.covariance + _LEAST * np.eye(len(mean))
        gap = self.z - told @ mean
        return float((_FREEDOM + np.trace(told)) / (_FREEDOM + gap @ np.linalg.solve(told, gap)))


@dataclass(frozen=True, eq=False)
class ShapePrior:
    """Modes z ~ N(mean, (root^T root)^-1)."""

    mean: Floats  # (modes,)
    root: Floats  # (modes, modes)

    @staticmethod
    def of_category(modes: int) -> ShapePrior:
        """Return N(0, I)."""
        return ShapePrior(np.zeros(modes), np.eye(modes))

    @staticmethod
    def of_drive(evidence: Iterable[ShapeEvidence], modes: int) -> ShapePrior:
        """The prior of another object of a drive whose objects have a mean shape m of their own.

        With m ~ N(0, I) and z_i ~ N(m, I), an estimate z_i with covariance C_i under N(0, I) has the information
        I - C_i of m, at (I - C_i)^-1 z_i: the part of z_i that its observations told. An object that nothing was seen
        of has C_i = I, and says nothing; one far from the others says little.
        """
        known = list(evidence)
        mean, covariance, weights = np.zeros(modes), np.eye(modes), np.ones(len(known))
        for _ in range(_ROUNDS):
            information, right = np.eye(modes) / _MEAN_SIGMA**2, np.zeros(modes)
            for one, weight in zip(known, weights, strict=True):
                information += weight * (np.eye(modes) - one.covariance)
                right += weight * one.z
            covariance = np.asarray(np.linalg.inv(information), float)
            mean = covariance @ right
            weights = np.array([one.weight(mean) for one in known])
        precision = np.linalg.inv(np.eye(modes) + covariance)
        return ShapePrior(mean, np.asarray(np.linalg.cholesky(precision).T, float))

    def evidence(self, z: Floats, covariance: Floats) -> ShapeEvidence:
        """What an estimate with its covariance (modes, modes) under this prior would be under N(0, I)."""
        precision, prior = np.linalg.inv(covariance), self.root.T @ self.root
        without = np.linalg.inv(precision - prior + np.eye(len(z)))
        return ShapeEvidence(without @ (precision @ z - prior @ self.mean), np.asarray(without, float))

    def residuals(self, z: Floats) -> Floats:
        """Independent residuals (modes,), in standard deviations; `root` is their derivative."""
        found: Floats = self.root @ (z - self.mean)
        return found
