"""Geman and McClure's robust kernel (Geman and McClure 1985)."""

from __future__ import annotations

from typing import TypeVar

from meshslam.errors import GeometryError
from meshslam.geometry.arrays import Floats

Real = TypeVar("Real", float, Floats)


def geman_mcclure_soft(squared: Real, squared_kernel: float) -> Real:
    """The factor 1 + s / k^2 of Geman and McClure's kernel: a cost s is lowered by it, its weight by its square.

    `squared` s is a number or an array of any shape: squared residuals in sigmas, 0 or more. `squared_kernel` is k^2,
    the square of the threshold in sigmas; for a residual of n dimensions, n k^2 lets the threshold hold for each.
    Numbers give a number, arrays an array of their shape. GeometryError if `squared_kernel` is not positive.

    >>> geman_mcclure_soft(9.0, 3.0**2)
    2.0
    """
    if not squared_kernel > 0:
        raise GeometryError(f"a robust kernel's squared threshold must be positive, found {squared_kernel}")
    return 1.0 + squared / squared_kernel


def geman_mcclure(squared: Real, kernel: float) -> tuple[Real, Real]:
    """Cost s / (1 + s / k^2) and weight (1 + s / k^2)^-2 of squared residuals s (Geman and McClure 1985).

    `squared` s is a number or an array of any shape, in squared sigmas, 0 or more; `kernel` k is the threshold in
    sigmas. The cost is bounded by k^2. The weight is its derivative over s, by which iteratively reweighted least
    squares weighs a row. Both have the shape of `squared`. GeometryError if `kernel` is not positive.

    >>> geman_mcclure(9.0, 3.0)
    (4.5, 0.25)
    """
    if not kernel > 0:
        raise GeometryError(f"a robust kernel's threshold must be positive, found {kernel}")
    soft = geman_mcclure_soft(squared, kernel**2)
    return squared / soft, 1.0 / soft**2
