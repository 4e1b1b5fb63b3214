"""Lens models: how directions at z = 1 are bent before the intrinsic matrix makes pixels of them.

All are OpenCV's: `radtan` and `rational` as in cv2.projectPoints, `equidistant` as in cv2.fisheye (Kannala and Brandt
2006); `fov` is that of Devernay and Faugeras 2001. Directions are (x / z, y / z), angles are from the optical axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam.geometry import Floats

LensModel = Literal["radtan", "rational", "equidistant", "fov"]
_STEPS = 20_000  # of a table over angles


@dataclass(frozen=True)
class Lens:
    """One model: `bend` takes directions (..., 2) and coefficients to bent directions, `slope` to its derivatives."""

    names: str  # of the coefficients, in order
    counts: tuple[int, ...]  # how many there may be
    bend: Callable[[Floats, Floats], Floats]
    slope: Callable[[Floats, Floats], Floats] | None  # (..., 2, 2); None: the model is radial
    radius: Callable[[Floats, Floats], Floats]  # of bent directions at angles (...), tangential parts left out
    last_angle_rad: float  # that is looked at
    is_wide: bool  # made for lenses that see 90 degrees off their axis


def fold_angle_rad(lens: Lens, coefficients: Floats) -> float:
    """The angle from which on the bent radius no longer grows: beyond it the model means nothing."""
    angles, radii = _table(lens, coefficients)
    return float(angles[len(radii) - 1])


def angles_of(lens: Lens, coefficients: Floats, radii: Floats) -> Floats:
    """Angles (...) of bent radii (...), tangential parts left out; NaN beyond the fold."""
    angles, table = _table(lens, coefficients)
    found = np.interp(radii, table, angles[: len(table)], right=np.nan)
    step = 1e-6
    with np.errstate(all="ignore"):
        for _ in range(3):
            slope = lens.radius(found + step, coefficients) - lens.radius(found - step, coefficients)
            change = (radii - lens.radius(found, coefficients)) * 2 * step / slope
            found = np.where(np.abs(change) < 1e-2, found + change, found)
    return np.where(radii > 0, found, 0.0)


def straighten(lens: Lens, coefficients: Floats, bent: Floats) -> Floats:
    """Directions (..., 2) that are bent to `bent`; NaN where there is none before the fold and before 90 degrees."""
    radii: Floats = np.linalg.norm(bent, axis=-1)
    angles = angles_of(lens, coefficients, radii)
    with np.errstate(all="ignore"):
        grown = np.where(radii > 0, np.tan(np.where(angles < np.pi / 2, angles, np.nan)) / radii, 1.0)
        found: Floats = bent * grown[..., None]
        if lens.slope is not None:
            for _ in range(20):
                error = bent - lens.bend(found, coefficients)
                found = found + _newton_step(lens.slope(found, coefficients), error)
    return found


def _newton_step(slope: Floats, error: Floats) -> Floats:
    """Solve systems (..., 2, 2) for steps (..., 2); not finite where one is singular."""
    a, b, c, d = slope[..., 0, 0], slope[..., 0, 1], slope[..., 1, 0], slope[..., 1, 1]
    step = np.stack([d * error[..., 0] - b * error[..., 1], a * error[..., 1] - c * error[..., 0]], axis=-1)
    return step / (a * d - b * c)[..., None]


def _table(lens: Lens, coefficients: Floats) -> tuple[Floats, Floats]:
    """Angles, and bent radii of the first of them, as long as these grow."""
    angles = np.linspace(0.0, lens.last_angle_rad, _STEPS)
    with np.errstate(all="ignore"):
        radii = lens.radius(angles, coefficients)
        stops = np.flatnonzero(~(np.diff(radii) > 0) | ~np.isfinite(radii[1:]))
    return angles, radii[: stops[0] + 1] if len(stops) else radii


def bend_brown(directions: Floats, coefficients: Floats) -> Floats:
    """Radial and tangential (Brown 1971): k1, k2, p1, p2[, k3[, k4, k5, k6]]."""
    p1, p2 = coefficients[2:4]
    x, y = directions[..., 0], directions[..., 1]
    r2 = x * x + y * y
    radial, _ = _radial(r2, coefficients)
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([u, v], axis=-1)


def slope_brown(directions: Floats, coefficients: Floats) -> Floats:
    """Return the derivative (..., 2, 2) of `bend_brown`."""
    p1, p2 = coefficients[2:4]
    x, y = directions[..., 0], directions[..., 1]
    radial, grown = _radial(x * x + y * y, coefficients)
    mixed = grown * x * y + 2 * p1 * x + 2 * p2 * y
    return np.stack(
        [
            np.stack([radial + grown * x * x + 2 * p1 * y + 6 * p2 * x, mixed], axis=-1),
            np.stack([mixed, radial + grown * y * y + 6 * p1 * y + 2 * p2 * x], axis=-1),
        ],
        axis=-2,
    )


def _radial(r2: Floats, coefficients: Floats) -> tuple[Floats, Floats]:
    """The radial factor, and twice its derivative over r²."""
    k1, k2, _, _, k3, k4, k5, k6 = np.pad(coefficients, (0, 8 - len(coefficients)))
    radial, grown = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    if len(coefficients) < 8:
        return radial, grown
    below, grown_below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6)), 2 * (k4 + r2 * (2 * k5 + r2 * 3 * k6))
    return radial / below, (grown * below - radial * grown_below) / below**2


def _radius_brown(angles_rad: Floats, coefficients: Floats) -> Floats:
    r = np.tan(angles_rad)
    radial, _ = _radial(r * r, coefficients)
    return r * radial


def _radius_equidistant(angles_rad: Floats, coefficients: Floats) -> Floats:
    k1, k2, k3, k4 = coefficients
    t2 = angles_rad * angles_rad
    radius: Floats = angles_rad * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    return radius


def _bend_equidistant(directions: Floats, coefficients: Floats) -> Floats:
    r = np.linalg.norm(directions, axis=-1)
    bent = _radius_equidistant(np.arctan(r), coefficients)
    return directions * np.where(r > 1e-9, bent / np.maximum(r, 1e-9), 1.0)[..., None]


def _radius_fov(angles_rad: Floats, coefficients: Floats) -> Floats:
    (omega,) = coefficients
    radius: Floats = np.arctan(2 * np.tan(angles_rad) * np.tan(omega / 2)) / omega
    return radius


def _bend_fov(directions: Floats, coefficients: Floats) -> Floats:
    (omega,) = coefficients
    r = np.linalg.norm(directions, axis=-1)
    wide = 2 * np.tan(omega / 2)
    grown = np.where(r > 1e-9, np.arctan(r * wide) / np.maximum(r, 1e-9), wide)
    bent: Floats = directions * grown[..., None] / omega
    return bent


_BEFORE_90 = np.pi / 2 - 1e-3
LENSES: dict[LensModel, Lens] = {
    "radtan": Lens("k1, k2, p1, p2[, k3]", (4, 5), bend_brown, slope_brown, _radius_brown, _BEFORE_90, False),
    "rational": Lens("k1, k2, p1, p2, k3, k4, k5, k6", (8,), bend_brown, slope_brown, _radius_brown, _BEFORE_90, False),
    "equidistant": Lens("k1, k2, k3, k4", (4,), _bend_equidistant, None, _radius_equidistant, np.pi, True),
    "fov": Lens("omega", (1,), _bend_fov, None, _radius_fov, _BEFORE_90, True),
}
